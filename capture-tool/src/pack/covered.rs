//! Which pixels see the object, and not the screen itself.

use relume_core::calibrate::screen::{Shown, Sighting, decode, fit};
use relume_core::domain::patterns::{Element, PatternSet};
use relume_core::image::Image;
use relume_core::{Error, Result};

use super::develop::Developer;
use super::records::Records;
use crate::capture::patterns::Sets;
use crate::rigs::Condition;
use crate::session::{Photograph, Role};

/// A place on the screen may be so far, in texels, from where a pixel looks past the object, beside what rounding leaves.
const NEAR: f64 = 1.0;

/// Marks a pixel that shows the object, row by row: what sees the screen itself answers to single texels, as a perfect mirror
/// would, and would draw all functions to it (6.6.4). A pixel does that whose place on the screen, read from Gray codes or
/// stripes, is where a straight line of sight meets it.
///
/// Without such patterns among the calibration photographs all pixels count, and so they do where nothing of the screen is seen
/// past the object.
///
/// # Errors
/// Files that are gone or changed.
pub fn covered(records: &Records, developer: &Developer, sets: &Sets, size: (usize, usize)) -> Result<Vec<bool>> {
    let all = vec![true; size.0 * size.1];
    let Some((shown, photographs)) = codes(records, sets) else { return Ok(all) };
    let picture = &mut |n: usize| -> Result<Image> { developer.picture(records, photographs[n]) };
    let decoded = match decode(&shown, picture) {
        Ok(decoded) => decoded,
        // Patterns that do not tell a place are no reason to stop a capture; damaged files are.
        Err(Error::Invalid { .. }) if readable(records, &photographs) => return Ok(all),
        Err(error) => return Err(error),
    };
    let pixel = |n: usize| [(n % size.0) as f64 + 0.5, (n / size.0) as f64 + 0.5];
    let place = |n: usize| decoded.screen(n % size.0, n / size.0);
    let sightings: Vec<Sighting> =
        (0..all.len()).filter_map(|n| Some(Sighting { pixel: pixel(n), screen: place(n)? })).collect();
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

/// Binary patterns of a session with their photographs, black and white with them; none where it has none.
fn codes<'a>(records: &'a Records, sets: &Sets) -> Option<(Vec<Shown>, Vec<&'a Photograph>)> {
    let (mut shown, mut photographs) = (Vec::new(), Vec::new());
    for photograph in records.of(Role::Calibration) {
        let Condition::Pattern { set, number, .. } = &photograph.condition else { continue };
        let Some(set) = sets.get(set).filter(|set| *number < set.len()) else { continue };
        if tells_a_place(set, *number) {
            shown.push(Shown::of(&set.pattern(*number)));
            photographs.push(photograph);
        }
    }
    if shown.is_empty() {
        return None;
    }
    let plain = |role: Role, what: Shown| records.of(role).next().map(|photograph| (what, photograph));
    for (what, photograph) in
        [plain(Role::Black, Shown::Black), plain(Role::AllLit, Shown::White)].into_iter().flatten()
    {
        shown.push(what);
        photographs.push(photograph);
    }
    Some((shown, photographs))
}

fn tells_a_place(set: &PatternSet, number: usize) -> bool {
    matches!(set.element(number), Element::GrayCode { .. } | Element::Stripes { .. })
}

fn readable(records: &Records, photographs: &[&Photograph]) -> bool {
    photographs.iter().all(|p| p.frames.iter().all(|frame| records.codes(p, frame).is_ok()))
}
