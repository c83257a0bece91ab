//! Pictures made one row of blocks after another, on all threads.

use std::ops::Range;
use std::path::Path;

use rayon::prelude::*;

use super::Weights;
use crate::error::{Error, Result};
use crate::field::{BLOCK_HEIGHT, Layout};
use crate::image::{Image, Window};

/// Rows of the picture that row `by` of blocks has inside a window.
pub(super) fn rows_of(by: usize, window: Window) -> Range<usize> {
    (by * BLOCK_HEIGHT).max(window.y0)..((by + 1) * BLOCK_HEIGHT).min(window.y1)
}

/// Refuses weights that do not fit a field, and a window outside its pictures.
///
/// # Errors
/// Either.
pub(super) fn check(layout: Layout, weights: &[&Weights], window: Window) -> Result<()> {
    if let Some(wrong) = weights.iter().find(|w| w.factors().len() != layout.elements) {
        let found = format!("{} weights", wrong.factors().len());
        return Err(Error::invalid("illumination", found, format!("{}, one an element", layout.elements)));
    }
    if window.x1 > layout.width || window.y1 > layout.height {
        let expected = format!("one inside {} x {}", layout.width, layout.height);
        return Err(Error::invalid("window", format!("{window:?}"), expected));
    }
    Ok(())
}

/// What pictures are made of.
#[derive(Clone, Copy)]
pub(super) struct Target<'a> {
    /// The part of the picture.
    pub window: Window,
    /// 3, or 4 where `finish` adds alpha.
    pub channels: usize,
    /// Called once with the number of a picture, a row of the whole picture and that row's numbers inside the window, once its red, green and
    /// blue are there: while they are in cache.
    pub finish: &'a (dyn Fn(usize, usize, &mut [f32]) + Sync),
}

impl Target<'static> {
    /// RGB as it comes.
    pub fn plain(window: Window) -> Self {
        Self { window, channels: 3, finish: &|_, _, _| {} }
    }
}

/// `count` pictures of a window, which was [checked](check): `row` fills what they have of one row of blocks, one strip a
/// picture, from the top left of the window's part. Rows are spread over the current rayon threads; the result does not
/// depend on their number.
///
/// # Errors
/// What `row` returns, numbers that are not finite.
pub(super) fn by_rows(
    layout: Layout,
    path: &Path,
    count: usize,
    target: Target<'_>,
    row: impl Fn(usize, &mut [&mut [f32]]) -> Result<()> + Sync,
) -> Result<Vec<Image>> {
    let Target { window, channels, finish } = target;
    let mut pictures: Vec<Image> = (0..count).map(|_| Image::new(window.width(), window.height(), channels)).collect();
    if window.is_empty() || count == 0 {
        return Ok(pictures);
    }
    // Each row of blocks owns its rows of every picture.
    let (_, rows) = layout.blocks(window);
    let across = window.width() * channels;
    let mut strips: Vec<(usize, Vec<&mut [f32]>)> = rows.map(|by| (by, Vec::new())).collect();
    for picture in &mut pictures {
        let mut rest = picture.data_mut();
        for (by, strip) in &mut strips {
            let (own, after) = rest.split_at_mut(rows_of(*by, window).len() * across);
            strip.push(own);
            rest = after;
        }
    }
    strips.into_par_iter().try_for_each(|(by, mut strips)| {
        row(by, &mut strips)?;
        for (n, strip) in strips.iter_mut().enumerate() {
            for (y, line) in rows_of(by, window).zip(strip.chunks_exact_mut(across)) {
                check_finite(line, channels, (window.x0, y), path)?;
                finish(n, y, line);
            }
        }
        Ok(())
    })?;
    Ok(pictures)
}

/// One look at the result finds NaN in the field wherever it sits: NaN times anything is NaN.
fn check_finite(line: &[f32], channels: usize, (x0, y): (usize, usize), path: &Path) -> Result<()> {
    // All of them, without a way out in between: that vectorises.
    if line.iter().fold(true, |finite, v| finite & v.is_finite()) {
        return Ok(());
    }
    let x = x0 + line.iter().position(|v| !v.is_finite()).unwrap_or(0) / channels;
    let place = format!("{}, pixel ({x}, {y})", path.display());
    let expected = "finite transport (`relume verify` tells whether the file was damaged)";
    Err(Error::invalid(place, "a number that is not finite", expected))
}
