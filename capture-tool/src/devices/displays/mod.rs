//! Screens and projectors.

use super::{Finding, Trouble};
use crate::rigs::ScreenDevice;

/// A picture as the screen is given it: codes of texels, row 0 at the top, RGB.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Texels {
    /// Texels along a row.
    pub columns: usize,
    /// Rows.
    pub rows: usize,
    /// The code of white: 255, or 1023.
    pub white: u16,
    /// `columns * rows` of them.
    pub codes: Vec<[u16; 3]>,
}

/// A screen. Calls block; while they wait they look at [`crate::progress::check_urgent`].
pub trait Display {
    /// Is the output there, of the right size and depth, its gamma table the identity? Shows nothing.
    fn preflight(&mut self) -> Vec<Finding>;

    /// Shows the texels, in the middle of the output, black about them; returns when the picture is confirmed (where the system does) and
    /// the panel has settled.
    ///
    /// # Errors
    /// [`Trouble::Busy`] when the same call may succeed soon; anything else ends the capture.
    fn show(&mut self, texels: &Texels) -> Result<(), Trouble>;

    /// Is the last picture still there, nothing before it, the gamma table as it was?
    ///
    /// # Errors
    /// As [`Display::show`]; that it is not.
    fn confirm(&mut self) -> Result<(), Trouble> {
        Ok(())
    }

    /// All black.
    ///
    /// # Errors
    /// As [`Display::show`].
    fn dark(&mut self) -> Result<(), Trouble>;
}

/// Opens the screen of a rig file for pictures of so many texels.
///
/// # Errors
/// No such output, one that is too small, no depth 30 for 10 bits.
pub fn open(device: &ScreenDevice, _texels: (usize, usize)) -> Result<Box<dyn Display>, Trouble> {
    Err(Trouble::stop(format!("{device:?}"), "not driven yet"))
}

/// What `relume devices` says of outputs, a line each.
pub fn list() -> Vec<String> {
    Vec::new()
}
