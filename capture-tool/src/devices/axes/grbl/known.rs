//! Positions made known: by the limit switches or the operator, and the mark that says so.

use super::Grbl;
use super::board::{Patience, Upset};
use super::geared::LETTERS;
use super::report::{Said, State};

/// Work position given to the unused axis: a number that nobody chooses, within what boards accept.
const MARK: f64 = 92.714;

impl Grbl {
    /// The axis that carries the mark: one that the rig does not use.
    pub(super) fn marked(&self) -> usize {
        (0..3).find(|at| self.geared().all(|axis| axis.at != *at)).unwrap_or(2)
    }

    /// Is the mark there? If not, the board was restarted or reset since positions were made known.
    pub(super) fn has_mark(&mut self) -> Result<bool, Upset> {
        let marked = self.marked();
        // Seen twice: a damaged number is no restart.
        for _ in 0..2 {
            let heard = self.board.command("$#", Patience::Reply)?;
            let offset = heard.iter().find_map(|said| match said {
                Said::Offset(name, values) if name == "G92" => values.get(marked).copied(),
                _ => None,
            });
            // Machine less work coordinate; the unused axis stands at what the other offsets say, mostly zero.
            let Some(offset) = offset else { return Err(Upset::Silent) };
            if offset != 0.0 {
                return Ok(true);
            }
        }
        Ok(false)
    }

    pub(super) fn need_mark(&mut self) -> Result<(), Upset> {
        if self.has_mark()? { Ok(()) } else { Err(Upset::Restarted) }
    }

    /// By the limit switches.
    pub(super) fn find_switches(&mut self) -> Result<(), Upset> {
        if self.board.status()?.state != State::Idle {
            self.board.reset()?;
        }
        (self.moving, self.unsettled, self.homing) = (true, true, true);
        self.board.command("$H", Patience::Deaf(self.move_limit))?;
        self.homing = false;
        self.mark(&[])
    }

    /// Where the axes stand now is zero degrees.
    pub(super) fn declare_zero(&mut self) -> Result<(), Upset> {
        self.board.left_alone();
        match self.board.status()?.state {
            State::Idle => {}
            State::Alarm => {
                // The operator has just seen to it that nothing is in the way.
                self.board.reset()?;
                if self.board.status()?.state == State::Alarm {
                    self.board.command("$X", Patience::Reply)?;
                }
            }
            _ => self.board.reset()?,
        }
        let zeros: Vec<(usize, f64)> = self.geared().map(|axis| (axis.at, axis.axis.zero)).collect();
        self.mark(&zeros)?;
        let at = self.look_at_rest()?;
        if self.is_at(&zeros, &at) { Ok(()) } else { Err(Upset::Elsewhere) }
    }

    /// Gives the unused axis its mark, and these axes their work positions.
    pub(super) fn mark(&mut self, positions: &[(usize, f64)]) -> Result<(), Upset> {
        let mut line = format!("G21G92{}{MARK:.3}", LETTERS[self.marked()]);
        positions.iter().for_each(|(at, units)| line += &format!("{}{units:.3}", LETTERS[*at]));
        self.board.offset = None;
        self.board.command(&line, Patience::Reply)?;
        self.need_mark()
    }
}
