//! Lamps.

use super::{Finding, Trouble};
use crate::rigs::LampsDevice;

/// Lamps. Calls block; while they wait they look at [`crate::progress::check_urgent`].
pub trait Lights {
    /// Is what drives them there? Lights nothing.
    fn preflight(&mut self) -> Vec<Finding>;

    /// Gives each physical lamp its level, 0 off, all others of the device off; returns when that is confirmed (where the device can) and
    /// the lamps shine steadily.
    ///
    /// # Errors
    /// [`Trouble::Busy`] when the same call may succeed soon; anything else ends the capture.
    fn show(&mut self, levels: &[u8]) -> Result<(), Trouble>;

    /// Does the device still show what it was last told, as far as it can say?
    ///
    /// # Errors
    /// As [`Lights::show`]; that it does not.
    fn confirm(&mut self) -> Result<(), Trouble> {
        Ok(())
    }

    /// All lamps off, of every channel. Tries hard: also after an error, also when the port has to be opened again.
    ///
    /// # Errors
    /// The operator must switch off by hand.
    fn dark(&mut self) -> Result<(), Trouble>;
}

/// Opens the lamps of a rig file, of which there are so many.
///
/// # Errors
/// No such port or address; a board that does not answer.
pub fn open(device: &LampsDevice, _lamps: usize) -> Result<Box<dyn Lights>, Trouble> {
    Err(Trouble::stop(format!("{device:?}"), "not driven yet"))
}
