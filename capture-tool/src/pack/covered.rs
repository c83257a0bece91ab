//! Which pixels see the object, and not the screen itself.

use relume_core::{Error, Result};

use super::develop::Developer;
use super::records::Records;
use super::screen::view;
use crate::rigs::RigFile;

/// Coverage from which a pixel counts: of the rest little is left, and measured coverage strays by some percent.
const OBJECT: f32 = 0.9;

/// Marks a pixel that shows the object, row by row: what sees the screen itself answers to single texels, as a perfect mirror
/// would, and would draw all functions to it (6.6.4). The session's Gray codes and stripes tell the coverage; without them all
/// pixels count, and so they do where nothing of the screen is seen past the object.
///
/// # Errors
/// Files that are gone or changed.
pub fn covered(rig: &RigFile, records: &Records, developer: &Developer, size: (usize, usize)) -> Result<Vec<bool>> {
    let all = vec![true; size.0 * size.1];
    match view::of_session(rig, records, developer, (None, None)) {
        Ok((view, _)) => Ok(view.alpha.map_or(all, |alpha| alpha.iter().map(|alpha| *alpha > OBJECT).collect())),
        // Patterns that do not tell a place are no reason to stop a capture; damaged files are.
        Err(Error::Invalid { .. }) if readable(records) => Ok(all),
        Err(error) => Err(error),
    }
}

fn readable(records: &Records) -> bool {
    records.all().all(|p| p.frames.iter().all(|frame| records.codes(p, frame).is_ok()))
}
