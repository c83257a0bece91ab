//! How far pictures relit by a compact representation are from those of the samples.

use super::blocks::Progress;
use crate::error::Result;
use crate::field::BLOCK_HEIGHT;
use crate::image::{Image, Window};
use crate::relight::{Look, Relighter, Weights};

/// Pictures of a band of rows are made together; about this much memory for them.
const BAND_BYTES: usize = 64 << 20;

/// `||C - C'||_2 / ||C'||_2` for each light, over all pixels and channels: C relit by `compact` with `tries`, C' by
/// `reference` with `truths`. 0 where both are black, infinite where only the reference is.
///
/// # Errors
/// As [`Relighter::render`]; what `progress` returns.
pub fn relit_against(
    (reference, truths): (&Relighter, &[Weights]),
    (compact, tries): (&Relighter, &[Weights]),
    progress: &mut Progress<'_>,
) -> Result<Vec<f64>> {
    let (width, height) = (reference.asset().width(), reference.asset().height());
    let mut sums = vec![(0.0f64, 0.0f64); truths.len().min(tries.len())];
    // RGBA of both.
    let row_bytes = (2 * sums.len() * width * 16).max(1);
    let rows = (BAND_BYTES / row_bytes).next_multiple_of(BLOCK_HEIGHT).max(BLOCK_HEIGHT);
    for y0 in (0..height).step_by(rows) {
        let window = Window { x0: 0, y0, x1: width, y1: (y0 + rows).min(height) };
        let pictures = |relighter: &Relighter, weights: &[Weights]| -> Result<Vec<Image>> {
            let neutral = Look::default();
            let lights: Vec<(&Weights, &Look)> = weights.iter().map(|weights| (weights, &neutral)).collect();
            relighter.render_many(&lights, window)
        };
        let (truths, tries) = (pictures(reference, truths)?, pictures(compact, tries)?);
        for ((off, norm), (truth, lit)) in sums.iter_mut().zip(truths.iter().zip(&tries)) {
            for (a, b) in lit.data().chunks_exact(4).zip(truth.data().chunks_exact(4)) {
                for c in 0..3 {
                    *off += f64::from(a[c] - b[c]).powi(2);
                    *norm += f64::from(b[c]).powi(2);
                }
            }
        }
        progress(window.y1 as u64, height as u64)?;
    }
    Ok(sums.into_iter().map(|(off, norm)| if off == 0.0 { 0.0 } else { (off / norm).sqrt() }).collect())
}
