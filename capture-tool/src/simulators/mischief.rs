//! What goes wrong between a board and its driver, and when: from a seed, so that each bad day can be had again.

use std::collections::VecDeque;
use std::str::FromStr;
use std::time::{Duration, Instant};

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg32;

/// Something that goes wrong.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Strike {
    /// Random bytes before an answer.
    Garbage,
    /// An answer is cut off in its middle.
    HalfLine,
    /// Answers come so much later.
    Late(Duration),
    /// An answer is lost.
    LostReply,
    /// What the driver sent is lost.
    LostCommand,
    /// The board restarts while it does something.
    Reset,
    /// The board stops by itself while it does something.
    Alarm,
    /// The cable is pulled.
    HangUp,
}

/// What is to go wrong with which board, and after how many answers: as in `axes:reset@40`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Planned {
    /// `axes` or `lamps`.
    pub board: String,
    /// After so many answers.
    pub after: u32,
    /// What.
    pub strike: Strike,
}

/// The kinds, as they are written.
pub const KINDS: &str = "garbage, half-line, late, lost-reply, lost-command, reset, alarm or hang-up";
/// So much later: more than boards are waited for.
const LATE: Duration = Duration::from_secs(2);

impl FromStr for Planned {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wanted = || format!("write BOARD:KIND@N, as in axes:reset@40, with axes or lamps, and {KINDS}");
        let (board, rest) = text.split_once(':').ok_or_else(wanted)?;
        let (kind, after) = rest.split_once('@').ok_or_else(wanted)?;
        let strike = match kind {
            "garbage" => Strike::Garbage,
            "half-line" => Strike::HalfLine,
            "late" => Strike::Late(LATE),
            "lost-reply" => Strike::LostReply,
            "lost-command" => Strike::LostCommand,
            "reset" => Strike::Reset,
            "alarm" if board == "axes" => Strike::Alarm,
            "hang-up" => Strike::HangUp,
            _ => return Err(wanted()),
        };
        let known = board == "axes" || board == "lamps";
        let after = after.parse().ok().filter(|_| known).ok_or_else(wanted)?;
        Ok(Self { board: board.to_owned(), after, strike })
    }
}

/// A bad day: each strike comes after so many answers.
pub struct Mischief {
    strikes: Vec<(u32, Strike)>,
    rng: Pcg32,
    answers: u32,
    struck: Vec<Strike>,
    /// What was held back, and until when; all that comes behind waits as well.
    held: VecDeque<(Instant, Vec<u8>)>,
}

impl Default for Mischief {
    fn default() -> Self {
        Self::new(Vec::new(), 0)
    }
}

impl Mischief {
    /// Strikes after numbers of answers; random bytes from a seed.
    pub fn new(strikes: Vec<(u32, Strike)>, seed: u64) -> Self {
        let rng = Pcg32::seed_from_u64(seed);
        Self { strikes, rng, answers: 0, struck: Vec::new(), held: VecDeque::new() }
    }

    /// The first strike that is due and that `takes` accepts.
    fn due(&mut self, takes: impl Fn(Strike) -> bool) -> Option<Strike> {
        let at = self.strikes.iter().position(|(after, strike)| self.answers >= *after && takes(*strike))?;
        let (_, strike) = self.strikes.remove(at);
        self.struck.push(strike);
        Some(strike)
    }

    /// What happens to the board itself, now that it is at work or rests.
    pub fn strike_on_the_way(&mut self, working: bool) -> Option<Strike> {
        self.due(|strike| match strike {
            Strike::Reset | Strike::Alarm => working,
            Strike::HangUp => true,
            _ => false,
        })
    }

    /// Is what the driver sent lost?
    pub fn swallows(&mut self) -> bool {
        self.due(|strike| strike == Strike::LostCommand).is_some()
    }

    /// An answer goes out; it, and what happens to it, is kept until [`Mischief::ready`].
    pub fn answer(&mut self, mut bytes: Vec<u8>) {
        if bytes.is_empty() {
            return;
        }
        self.answers += 1;
        let mut until = Instant::now();
        match self
            .due(|strike| matches!(strike, Strike::Garbage | Strike::HalfLine | Strike::Late(_) | Strike::LostReply))
        {
            Some(Strike::Garbage) => {
                let count = self.rng.random_range(1..40);
                let noise: Vec<u8> = (0..count).map(|_| self.rng.random()).collect();
                let at = self.rng.random_range(0..=bytes.len());
                bytes.splice(at..at, noise);
            }
            Some(Strike::HalfLine) => bytes.truncate(self.rng.random_range(0..bytes.len())),
            Some(Strike::Late(by)) => until += by,
            Some(Strike::LostReply) => return,
            _ => {}
        }
        let after = self.held.back().map_or(until, |(last, _)| until.max(*last));
        self.held.push_back((after, bytes));
    }

    /// The next answer whose time has come.
    pub fn ready(&mut self) -> Option<Vec<u8>> {
        let due = self.held.front().is_some_and(|(until, _)| *until <= Instant::now());
        if due { self.held.pop_front().map(|(_, bytes)| bytes) } else { None }
    }

    /// When the next answer goes out.
    pub fn next(&self) -> Option<Instant> {
        self.held.front().map(|(until, _)| *until)
    }

    /// From now on nothing goes wrong; what was held back goes out.
    #[cfg(test)]
    pub fn calm(&mut self) {
        self.strikes.clear();
        self.held.iter_mut().for_each(|(until, _)| *until = Instant::now());
    }

    /// What has happened so far.
    pub fn struck(&self) -> &[Strike] {
        &self.struck
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bad_days_are_written_board_kind_at_number() {
        let planned = |board: &str, after, strike| Ok(Planned { board: board.to_owned(), after, strike });
        assert_eq!("axes:reset@40".parse(), planned("axes", 40, Strike::Reset));
        assert_eq!("lamps:hang-up@0".parse(), planned("lamps", 0, Strike::HangUp));
        for bad in ["reset@40", "axes:reset", "door:reset@1", "axes:rain@3", "lamps:alarm@3", "axes:reset@-1", ""] {
            assert!(bad.parse::<Planned>().unwrap_err().contains("axes:reset@40"), "{bad}");
        }
    }
}
