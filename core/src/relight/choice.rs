//! Which of an asset's representations is used.
//!
//! The choice depends on the asset, on whether the light is one captured lamp, and on what a user asks for; never on what a
//! map shows or on the frame, so that it cannot change in the course of an animation.

use crate::error::{Error, Result};
use crate::field::{Asset, Kind};

/// A factored field with at most this relative error is taken for the samples: pictures are off by about half of it or less
/// (`cargo bench -p relume-core --bench compact`), and come faster.
const AS_GOOD: f64 = 0.05;

/// The representation that lights an asset: the one `wanted`, or the best. One captured lamp is a photograph, and the samples
/// come first; for other light a factored field that is as good comes before them. Wavelets, whose reconstruction is
/// fixed, and harmonics, which only have soft light, are taken by themselves where there is nothing else.
///
/// # Errors
/// A representation that the asset does not hold.
pub(super) fn choose(asset: &Asset, wanted: Option<Kind>, captured_lamp: bool) -> Result<Kind> {
    let held = |kind: &Kind| asset.manifest().representation(*kind);
    if let Some(kind) = wanted {
        return held(&kind).map(|_| kind).ok_or_else(|| absent(asset, kind));
    }
    let as_good = held(&Kind::Factored).and_then(|r| r.loss()).is_some_and(|loss| loss.reached <= AS_GOOD);
    let order = match as_good && !captured_lamp {
        true => [Kind::Factored, Kind::Dense, Kind::Wavelet, Kind::Harmonics],
        false => [Kind::Dense, Kind::Factored, Kind::Wavelet, Kind::Harmonics],
    };
    // A manifest holds one at least.
    Ok(order.into_iter().find(|kind| held(kind).is_some()).unwrap_or(Kind::Dense))
}

/// What is said of a representation that is not there.
pub(super) fn absent(asset: &Asset, kind: Kind) -> Error {
    let held: Vec<&str> = asset.manifest().representations.iter().map(|r| r.kind().id()).collect();
    Error::invalid(
        asset.path().display().to_string(),
        format!("no `{}` representation", kind.id()),
        format!("automatic, or what the asset holds: {} (`relume compress --keep` adds others)", held.join(", ")),
    )
}
