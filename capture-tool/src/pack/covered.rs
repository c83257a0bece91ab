//! Which pixels see the object, and not the screen itself.

use relume_core::{Error, Result};

use super::develop::Developer;
use super::places;
use super::records::Records;
use super::shots::Shots;
use crate::progress;
use crate::rigs::RigFile;
use crate::session::Role;

/// Coverage from which a pixel counts: of the rest little is left, and measured coverage strays by some percent.
const OBJECT: f32 = 0.9;

/// Marks a pixel that shows the object, row by row: what sees the screen itself answers to single texels, as a perfect mirror
/// would, and would draw all functions to it (6.6.4). Stripes and Gray codes tell the coverage; where they do not, a pixel is
/// taken to see the screen whose place on it is where a straight line of sight meets it.
///
/// Without such patterns among the calibration photographs all of the `pixels` count, and so they do where these tell nothing:
/// that is no reason to stop a capture.
///
/// # Errors
/// Files that are gone or changed; a request to stop.
pub fn covered(rig: &RigFile, records: &Records, developer: &Developer, pixels: usize) -> Result<Vec<bool>> {
    let told = &mut |_, _| progress::check();
    let tells_nothing = |error: &Error| matches!(error, Error::Invalid { .. }) && readable(records);
    let shots = match Shots::of_session(rig, records, developer) {
        Ok(shots) => shots,
        Err(error) if tells_nothing(&error) => return Ok(vec![true; pixels]),
        Err(error) => return Err(error),
    };
    let found = match places::correspondence(&shots, told) {
        Ok(found) => found,
        Err(error) if tells_nothing(&error) => return Ok(vec![true; pixels]),
        Err(error) => return Err(error),
    };
    match places::alpha(&shots, &found.fit.correspondence, told) {
        Ok(found) => Ok(found.alpha.iter().map(|alpha| *alpha > OBJECT).collect()),
        Err(error) if tells_nothing(&error) => Ok(found.direct.iter().map(|direct| !direct).collect()),
        Err(error) => Err(error),
    }
}

/// Are all calibration photographs there and as they were?
fn readable(records: &Records) -> bool {
    records.of(Role::Calibration).all(|p| p.frames.iter().all(|frame| records.codes(p, frame).is_ok()))
}
