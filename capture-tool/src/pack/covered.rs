//! Which pixels see the object, and not the screen itself.

use relume_core::calibrate::screen::{Sighting, decode, fit};
use relume_core::domain::patterns::Element;
use relume_core::image::Image;
use relume_core::{Error, Result};

use super::develop::Developer;
use super::records::Records;
use super::screen::view::{self, View};
use crate::capture::patterns::Sets;
use crate::session::Photograph;

/// Coverage from which a pixel counts: of the rest little is left, and measured coverage strays by some percent.
const OBJECT: f32 = 0.9;
/// A place on the screen may be so far, in texels, from where a pixel looks past the object, beside what rounding leaves.
const NEAR: f64 = 1.0;
/// Pixels that the line of sight is fitted to: more would not make it better.
const FITTED: usize = 100_000;

/// Marks a pixel that shows the object, row by row: what sees the screen itself answers to single texels, as a perfect mirror
/// would, and would draw all functions to it (6.6.4). Stripes tell the coverage; without them a pixel is taken to see the screen
/// whose place on it, read from Gray codes, is where a straight line of sight meets it.
///
/// Without such patterns among the calibration photographs all pixels count, and so they do where nothing of the screen is seen
/// past the object.
///
/// # Errors
/// Files that are gone or changed.
pub fn covered(records: &Records, developer: &Developer, sets: &Sets, size: (usize, usize)) -> Result<Vec<bool>> {
    let all = vec![true; size.0 * size.1];
    let Some((shown, photographs)) = view::codes(records, sets, tells_a_place) else { return Ok(all) };
    match view::of_session(records, developer, sets, (None, None)) {
        Ok((View { alpha: Some(alpha), .. }, _)) => return Ok(alpha.iter().map(|alpha| *alpha > OBJECT).collect()),
        Ok(_) => {}
        Err(Error::Invalid { .. }) if readable(records, &photographs) => {}
        Err(error) => return Err(error),
    }
    let picture = &mut |n: usize| -> Result<Image> { developer.picture(records, photographs[n]) };
    let decoded = match decode(&shown, picture) {
        Ok(decoded) => decoded,
        // Patterns that do not tell a place are no reason to stop a capture; damaged files are.
        Err(Error::Invalid { .. }) if readable(records, &photographs) => return Ok(all),
        Err(error) => return Err(error),
    };
    let pixel = |n: usize| [(n % size.0) as f64 + 0.5, (n / size.0) as f64 + 0.5];
    let place = |n: usize| decoded.screen(n % size.0, n / size.0);
    let step = decoded.places.iter().flatten().count().div_ceil(FITTED).max(1);
    let seen = (0..all.len()).filter_map(|n| Some(Sighting { pixel: pixel(n), screen: place(n)? }));
    let sightings: Vec<Sighting> = seen.step_by(step).collect();
    let Ok(fit) = fit(&sightings, size, decoded.texels) else { return Ok(all) };
    let texels = [decoded.texels.0 as f64, decoded.texels.1 as f64];
    let sees_object = |n: usize| {
        let Some(seen) = place(n) else { return true };
        let straight = fit.correspondence.screen_of(pixel(n));
        (0..2).any(|i| {
            let off = (seen[i] - straight[i]).abs() * texels[i];
            off > NEAR + decoded.resolution[i] as f64
        })
    };
    Ok((0..all.len()).map(sees_object).collect())
}

fn tells_a_place(element: Element) -> bool {
    matches!(element, Element::GrayCode { .. } | Element::Stripes { .. })
}

fn readable(records: &Records, photographs: &[&Photograph]) -> bool {
    photographs.iter().all(|p| p.frames.iter().all(|frame| records.codes(p, frame).is_ok()))
}
