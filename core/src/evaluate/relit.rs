//! How far relit pictures are off when the field holds fewer lamps (4.4.1, "visual error analysis").

use super::blocks::Progress;
use super::pixel_sets::PixelSet;
use crate::error::Result;
use crate::field::{BLOCK_HEIGHT, Samples};
use crate::image::{Image, Window};
use crate::relight::{Weights, apply};

/// Pictures of a band of rows are made together; about this much memory for them.
const BAND_BYTES: usize = 64 << 20;

/// `||C - C'||_2 / ||C'||_2` over a set of pixels and all channels: C lit by `methods[m][light]`, C' by
/// `reference[light]`; returned as `[method][set][light]`. One pass over the field. 0 where reference and picture are both
/// black, infinite where only the reference is.
///
/// # Errors
/// As [`apply`]; what `progress` returns.
pub fn relit_errors(
    samples: Samples<'_>,
    reference: &[Weights],
    methods: &[Vec<Weights>],
    sets: &[PixelSet],
    progress: &mut Progress<'_>,
) -> Result<Vec<Vec<Vec<f64>>>> {
    let (width, height) = (samples.layout().width, samples.layout().height);
    let lights = reference.len();
    let weights: Vec<&Weights> = reference.iter().chain(methods.iter().flatten()).collect();
    let members: Vec<Vec<usize>> = membership(sets, width * height);
    let rows = (BAND_BYTES / (weights.len() * width * 12).max(1)).next_multiple_of(BLOCK_HEIGHT).max(BLOCK_HEIGHT);
    // [method][set][light], and [set][light] of the reference.
    let mut off = vec![vec![vec![0.0f64; lights]; sets.len()]; methods.len()];
    let mut norms = vec![vec![0.0f64; lights]; sets.len()];
    for y0 in (0..height).step_by(rows) {
        let window = Window { x0: 0, y0, x1: width, y1: (y0 + rows).min(height) };
        let pictures = apply(samples, &weights, window)?;
        let (truths, tries) = pictures.split_at(lights);
        for (at, sets) in members[y0 * width..window.y1 * width].iter().enumerate() {
            for &set in sets {
                for (light, truth) in truths.iter().enumerate() {
                    norms[set][light] += squared(pixel(truth, at), &[0.0; 3]);
                    for (method, off) in off.iter_mut().enumerate() {
                        off[set][light] += squared(pixel(&tries[method * lights + light], at), pixel(truth, at));
                    }
                }
            }
        }
        progress(window.y1 as u64, height as u64)?;
    }
    for sets in &mut off {
        for (off, norm) in sets.iter_mut().flatten().zip(norms.iter().flatten()) {
            *off = if *off == 0.0 { 0.0 } else { (*off / norm).sqrt() };
        }
    }
    Ok(off)
}

/// For each pixel the sets that it is in.
fn membership(sets: &[PixelSet], pixels: usize) -> Vec<Vec<usize>> {
    let mut members = vec![Vec::new(); pixels];
    for (n, set) in sets.iter().enumerate() {
        set.pixels.iter().for_each(|&i| members[i as usize].push(n));
    }
    members
}

fn pixel(picture: &Image, at: usize) -> &[f32] {
    &picture.data()[3 * at..][..3]
}

fn squared(a: &[f32], b: &[f32]) -> f64 {
    a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2)).sum()
}
