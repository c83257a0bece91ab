//! The conversation with a board: commands and their answers, whatever comes between them.
//!
//! GRBL answers each line with `ok` or `error:n`, in order, when it is *taken*; status reports (`<...>`) and messages come between.
//! An answer that is lost or late puts the count of `ok`s out: then a fence is sent, `$G`, whose answer has a shape of its own, and
//! what came before it is forgotten.

use std::time::{Duration, Instant};

use super::report::{Said, State, Status};
use super::words;
use crate::devices::Trouble;
use crate::devices::port::{Port, pause};

/// How often a board in motion is asked where it is.
const POLL: Duration = Duration::from_millis(200);
/// An Arduino waits up to 2 s for a new program after it was restarted, and only then starts its own.
const STARTS_WITHIN: Duration = Duration::from_secs(4);
/// Lines that come with one answer: `$$` has some 34, `$#` 11. More are noise.
const MOST_LINES: usize = 256;
/// Offsets are told with every 10th report of a board at rest, every 30th of one in motion.
const REPORTS: usize = 40;
/// Soft reset: forgets what is queued.
const RESET: u8 = 0x18;

/// Why the board did not do what it was told.
#[derive(Debug)]
pub enum Upset {
    /// It did not answer, or not so that it could be understood.
    Silent,
    /// It refused a line.
    Refused(u32),
    /// It started anew.
    Restarted,
    /// It stopped by itself.
    Alarm(Option<u32>),
    /// It is in a state in which nothing moves: held, door open, asleep.
    Resting(State),
    /// It moved for too long.
    Slow,
    /// It says that it is elsewhere.
    Elsewhere,
    /// The port, or a request to stop.
    Port(Trouble),
}

impl From<Trouble> for Upset {
    fn from(trouble: Trouble) -> Self {
        Self::Port(trouble)
    }
}

impl Upset {
    /// May it be otherwise when the same is asked again?
    pub fn may_pass(&self) -> bool {
        match self {
            Self::Silent | Self::Elsewhere => true,
            Self::Refused(code) => words::may_be_noise(*code),
            _ => false,
        }
    }

    /// For a person. `port` names the board.
    pub fn told(self, port: &str) -> Trouble {
        let go_on = "resume makes positions known again";
        match self {
            Self::Silent => Trouble::stop(
                format!("the board at {port} does not answer as GRBL 1.1 does"),
                "check its cable, its power, and baud in the rig file",
            ),
            Self::Refused(code) => Trouble::stop(
                format!("the board at {port} refused a command: {} (error:{code})", words::error(code)),
                "look at its settings ($$) with its own tool",
            ),
            Self::Restarted => Trouble::stop(
                format!("the board at {port} restarted, and its position is lost"),
                format!("check its power; {go_on}"),
            ),
            Self::Alarm(Some(code)) => Trouble::stop(
                format!("the board at {port} stopped with an alarm: {} (ALARM:{code})", words::alarm(code)),
                format!("see that nothing is in the way; {go_on}"),
            ),
            Self::Alarm(None) => Trouble::stop(
                format!("the board at {port} is locked by an alarm"),
                format!("see that nothing is in the way; {go_on}"),
            ),
            Self::Resting(State::Door) => {
                Trouble::stop(format!("the safety door at {port} is open"), "close it, and go on")
            }
            Self::Resting(State::Sleep) => {
                Trouble::stop(format!("the board at {port} sleeps, with its motors off"), format!("reset it; {go_on}"))
            }
            Self::Resting(_) => Trouble::stop(
                format!("the axes at {port} are held: somebody stopped them"),
                format!("release or reset the board; {go_on}"),
            ),
            Self::Slow => Trouble::stop(
                format!("the axes at {port} move for longer than move_limit_s"),
                "see that nothing is in the way, or give them more time in the rig file",
            ),
            Self::Elsewhere => Trouble::stop(
                format!("the axes at {port} do not come to where they are sent"),
                "see that nothing is in the way, and that no other program moves them",
            ),
            Self::Port(trouble) => trouble,
        }
    }
}

/// A board.
pub struct Board {
    port: Port,
    /// It answers within this time, where it answers at all.
    reply: Duration,
    /// Machine less work coordinates, as far as known.
    pub offset: Option<Vec<f64>>,
    /// An answer is still to come, or was lost.
    open: bool,
}

/// What a wait may take.
#[derive(Debug, Clone, Copy)]
pub enum Patience {
    /// A line that is only taken.
    Reply,
    /// A line that is answered when motion ends; meanwhile the board is asked for its state.
    Motion(Duration),
    /// A line during which the board answers nothing at all ($H), not even when asked for its state.
    Deaf(Duration),
}

impl Board {
    /// Waits until the board on this port says something that makes sense.
    pub fn open(port: Port, reply: Duration) -> Result<Self, Upset> {
        let mut board = Self { port, reply, offset: None, open: true };
        let end = Instant::now() + STARTS_WITHIN.max(4 * reply);
        while Instant::now() < end {
            board.port.send(b"?")?;
            let by = (Instant::now() + board.reply.min(POLL)).min(end);
            while let Some(line) = board.port.line(by)? {
                if matches!(Said::of(&line), Said::Banner(_) | Said::Status(_)) {
                    // Settings that it tells unasked, and answers to later questions.
                    board.port.drain(board.reply / 10)?;
                    return Ok(board);
                }
            }
        }
        Err(Upset::Silent)
    }

    /// The port's name.
    pub fn name(&self) -> &str {
        self.port.name()
    }

    /// Sends a line and waits for its `ok`; returns what came before it.
    pub fn command(&mut self, line: &str, patience: Patience) -> Result<Vec<Said>, Upset> {
        if self.open {
            self.fence()?;
        }
        self.open = true;
        self.port.send(format!("{line}\n").as_bytes())?;
        let heard = self.wait(patience, |said| matches!(said, Said::Ok | Said::Error(_)))?;
        self.open = false;
        match heard.last() {
            Some(Said::Error(code)) => Err(Upset::Refused(*code)),
            _ => Ok(heard),
        }
    }

    /// After this nothing that was sent before is answered any more.
    fn fence(&mut self) -> Result<(), Upset> {
        self.port.drain(self.reply / 10)?;
        // An unfinished line is ended first: noise may have begun one.
        self.port.send(b"\n$G\n")?;
        self.wait(Patience::Reply, |said| *said == Said::Modes)?;
        self.wait(Patience::Reply, |said| *said == Said::Ok)?;
        self.open = false;
        Ok(())
    }

    /// Reads until a line is the last one. A board that moves is waited for, as long as it says that it does.
    fn wait(&mut self, patience: Patience, is_last: impl Fn(&Said) -> bool) -> Result<Vec<Said>, Upset> {
        let begun = Instant::now();
        let (limit, mut silent_at) = match patience {
            Patience::Reply => (self.reply, begun + self.reply),
            Patience::Motion(limit) => (limit, begun + self.reply),
            Patience::Deaf(limit) => (limit, begun + limit),
        };
        let asks = !matches!(patience, Patience::Reply);
        let deaf = matches!(patience, Patience::Deaf(_));
        let poll = POLL.min(self.reply / 4);
        let mut ask_at = begun + poll;
        let mut heard = Vec::new();
        loop {
            let by = if asks { silent_at.min(ask_at) } else { silent_at };
            if let Some(line) = self.port.line(by)? {
                let said = self.understood(&line)?;
                if let Said::Status(status) = &said {
                    match status.state {
                        // So its answer is still to come.
                        State::Run | State::Jog | State::Home => silent_at = silent_at.max(Instant::now() + self.reply),
                        // It hears again, so that its answer is near, or was lost.
                        State::Idle | State::Alarm if deaf => silent_at = silent_at.min(Instant::now() + self.reply),
                        State::Alarm if asks => return Err(Upset::Alarm(None)),
                        State::Hold(_) | State::Door | State::Sleep if asks => {
                            return Err(Upset::Resting(status.state));
                        }
                        _ => {}
                    }
                }
                let last = is_last(&said);
                heard.push(said);
                if last {
                    return Ok(heard);
                }
                if heard.len() > MOST_LINES {
                    return Err(Upset::Silent);
                }
            }
            let now = Instant::now();
            if asks && now >= ask_at {
                self.port.send(b"?")?;
                ask_at = now + poll;
            }
            if now >= silent_at {
                return Err(Upset::Silent);
            }
            if asks && begun.elapsed() > limit {
                return Err(Upset::Slow);
            }
        }
    }

    /// A line; one that says that all is lost is an error.
    fn understood(&mut self, line: &str) -> Result<Said, Upset> {
        let said = Said::of(line);
        match &said {
            Said::Banner(_) => {
                self.offset = None;
                return Err(Upset::Restarted);
            }
            Said::Alarm(code) => return Err(Upset::Alarm(Some(*code))),
            Said::Status(Status { offset: Some(offset), .. }) => self.offset = Some(offset.clone()),
            _ => {}
        }
        Ok(said)
    }

    /// Its state and position now.
    pub fn status(&mut self) -> Result<Status, Upset> {
        // A report that is lost costs one more question.
        for _ in 0..3 {
            self.port.send(b"?")?;
            let by = Instant::now() + self.reply;
            while let Some(line) = self.port.line(by)? {
                if let Said::Status(status) = self.understood(&line)? {
                    return Ok(status);
                }
            }
        }
        Err(Upset::Silent)
    }

    /// Its state, and its position in machine or in work coordinates.
    pub fn position(&mut self, machine: bool) -> Result<(State, Vec<f64>), Upset> {
        for _ in 0..REPORTS {
            let status = self.status()?;
            let shifted = |from: &[f64], offset: &[f64], sign: f64| -> Vec<f64> {
                from.iter().zip(offset).map(|(p, o)| p + sign * o).collect()
            };
            let found = match (machine, &status.machine, &status.work, &self.offset) {
                (true, Some(position), _, _) | (false, _, Some(position), _) => Some(position.clone()),
                (true, None, Some(work), Some(offset)) => Some(shifted(work, offset, 1.0)),
                (false, Some(machine), None, Some(offset)) => Some(shifted(machine, offset, -1.0)),
                _ => None,
            };
            if let Some(position) = found {
                return Ok((status.state, position));
            }
        }
        Err(Upset::Silent)
    }

    /// Forgets what is queued and unlocks what can be unlocked so; waits until the board is there again. Offsets are gone.
    pub fn reset(&mut self) -> Result<(), Upset> {
        self.offset = None;
        self.open = true;
        self.port.drain(self.reply / 10)?;
        self.port.send(&[RESET])?;
        let by = Instant::now() + self.reply.max(STARTS_WITHIN / 2);
        while let Some(line) = self.port.line(by)? {
            if matches!(Said::of(&line), Said::Banner(_)) {
                self.port.drain(self.reply / 10)?;
                return Ok(());
            }
        }
        // Its banner may be lost; what it does next tells.
        Ok(())
    }

    /// Stops motion at once, and says whether the board then rests.
    pub fn hold(&mut self) -> Result<bool, Upset> {
        // A board at rest would be held as well, and then want to be released.
        if matches!(self.status(), Ok(Status { state: State::Idle | State::Alarm, .. })) {
            return Ok(true);
        }
        self.port.send(b"!")?;
        let end = Instant::now() + (4 * self.reply).max(Duration::from_secs(2));
        while Instant::now() < end {
            match self.status()?.state {
                State::Run | State::Jog | State::Home => pause(Duration::from_millis(10))?,
                // Still slowing down.
                State::Hold(n) if n != 0 => pause(Duration::from_millis(10))?,
                _ => return Ok(true),
            }
        }
        Ok(false)
    }

    /// Stops whatever it does, homing too; positions are lost.
    pub fn abort(&mut self) -> Result<(), Upset> {
        self.offset = None;
        self.open = true;
        Ok(self.port.send(&[RESET])?)
    }

    /// From now on the next command begins behind a fence: a person took their time, or another program talked.
    pub fn left_alone(&mut self) {
        self.open = true;
    }
}
