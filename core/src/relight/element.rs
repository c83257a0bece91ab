//! The element `T L + g S` of an asset, by whichever representation its weights are for.

use super::apply::apply_dense;
use super::choice::absent;
use super::factored::apply_factored;
use super::sparse::apply_sparse;
use super::strips::Target;
use super::{Look, Weights};
use crate::error::Result;
use crate::field::{Asset, Kind};
use crate::image::{Conversion, Image, Window};

/// RGBA premultiplied (alpha 1 where the asset has none) of a window, one picture a light, in one pass over the field for each
/// representation.
///
/// # Errors
/// As [`apply`](super::apply).
pub(super) fn many(asset: &Asset, lights: &[(&Weights, &Look)], window: Window) -> Result<Vec<Image>> {
    let mut pictures: Vec<Option<Image>> = vec![None; lights.len()];
    for kind in Kind::ALL {
        let of_kind: Vec<usize> = (0..lights.len()).filter(|&n| lights[n].0.kind == kind).collect();
        if of_kind.is_empty() {
            continue;
        }
        let weights: Vec<&Weights> = of_kind.iter().map(|&n| lights[n].0).collect();
        let finish = |n: usize, y: usize, line: &mut [f32]| finish(asset, line, (window.x0, y), lights[of_kind[n]].1);
        let target = Target { window, channels: 4, finish: &finish };
        for (n, picture) in of_kind.iter().zip(lit(asset, kind, &weights, target)?) {
            pictures[*n] = Some(picture);
        }
    }
    Ok(pictures.into_iter().flatten().collect())
}

/// `T L` by one representation.
fn lit(asset: &Asset, kind: Kind, weights: &[&Weights], target: Target<'_>) -> Result<Vec<Image>> {
    let absent = || absent(asset, kind);
    match kind {
        Kind::Dense => apply_dense(asset.dense().ok_or_else(absent)?, weights, target),
        Kind::Harmonics => apply_dense(asset.harmonics().ok_or_else(absent)?.pictures(), weights, target),
        Kind::Explicit => apply_dense(asset.explicit().ok_or_else(absent)?.pictures(), weights, target),
        Kind::Factored => apply_factored(asset.factored().ok_or_else(absent)?, weights, target),
        Kind::Wavelet => apply_sparse(asset.sparse().ok_or_else(absent)?, weights, target),
    }
}

/// Adds `g S` and alpha to a row of RGBA from `(x, y)` on, and turns it to the colours asked for.
fn finish(asset: &Asset, line: &mut [f32], (x, y): (usize, usize), look: &Look) {
    let colours = Conversion::between(asset.colour_space(), look.output_space);
    let first = y * asset.width() + x;
    let pixels = line.as_chunks_mut::<4>().0;
    if let Some(ambient) = asset.ambient().filter(|_| look.ambient != 0.0) {
        for (pixel, s) in pixels.iter_mut().zip(ambient.data()[3 * first..].as_chunks::<3>().0) {
            (0..3).for_each(|c| pixel[c] += look.ambient as f32 * s[c]);
        }
    }
    if !colours.is_identity() {
        pixels.iter_mut().for_each(|[r, g, b, _]| [*r, *g, *b] = colours.apply([*r, *g, *b]));
    }
    match asset.alpha() {
        Some(alpha) => pixels.iter_mut().zip(&alpha[first..]).for_each(|(pixel, alpha)| pixel[3] = *alpha),
        None => pixels.iter_mut().for_each(|pixel| pixel[3] = 1.0),
    }
}
