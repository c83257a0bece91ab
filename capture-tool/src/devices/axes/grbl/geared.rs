//! An axis of a rig on a board: degrees and the board's units.

use crate::devices::Trouble;
use crate::rigs::Axis;

/// Letters of axes, in the order of reports.
pub const LETTERS: [char; 4] = ['X', 'Y', 'Z', 'A'];

/// An axis and its place on the board.
pub struct Geared {
    /// As the rig file says.
    pub axis: Axis,
    /// As in "the turntable".
    pub name: &'static str,
    /// Its place in reports.
    pub at: usize,
    /// Its last motion was upwards: its play is taken up.
    pub from_below: bool,
}

impl Geared {
    /// The board's axis of that letter.
    pub fn new(axis: &Axis, name: &'static str) -> Result<Self, Trouble> {
        let at = LETTERS.iter().position(|letter| letter.eq_ignore_ascii_case(&axis.letter)).ok_or_else(|| {
            Trouble::stop(format!("{name} has the letter {}", axis.letter), "write X, Y, Z or A in the rig file")
        })?;
        Ok(Self { axis: axis.clone(), name, at, from_below: false })
    }

    /// The board's units at an angle.
    pub fn units(&self, deg: f64) -> f64 {
        self.axis.zero + deg * self.axis.per_deg
    }

    /// The angle at the board's units.
    pub fn degrees(&self, units: f64) -> f64 {
        (units - self.axis.zero) / self.axis.per_deg
    }

    /// Refuses what it must not be moved to, before anything is sent.
    pub fn check(&self, deg: f64) -> Result<(), Trouble> {
        let Axis { limits_deg: [low, high], backlash_deg, .. } = self.axis;
        // Not a number is outside as well.
        if !(low..=high).contains(&deg) {
            let what = format!("{} is to go to {deg:.2} degrees, outside {low} to {high}", self.name);
            return Err(Trouble::stop(what, "correct limits_deg or the positions in the rig file"));
        }
        if deg - backlash_deg < low {
            let what = format!(
                "{} comes to {deg:.2} degrees from backlash_deg = {backlash_deg} below, outside {low} to {high}",
                self.name
            );
            return Err(Trouble::stop(what, "leave room below the lowest position in limits_deg"));
        }
        Ok(())
    }
}
