//! `T^T c`: for each element of the light, `sum over pixels of T x c`: the answer of the rig's places to light that leaves by the
//! camera's pixels (dual light transport, 3.3.3).
//!
//! `<T l, c> = <l, T^T c>` whatever the representation. As relighting, this streams the field once and is bound by memory; but
//! sums go to elements in place of pixels. So runs of blocks come one after another, and within a run threads share the
//! elements: each element's sum is added up by one thread in the order of the blocks, and neither their number nor how elements
//! are shared changes a bit. Products of a block are summed in single precision, blocks in double.
//!
//! | part | what it holds |
//! |---|---|
//! | `pictures` | what pixels are lit with, by blocks; coefficient pictures |
//! | `tiles` | tiles of low rank: `B^T (A^T c)` |
//! | `terms` | wavelet coefficients of each pixel: a scatter, then S |

mod pictures;
mod terms;
mod tiles;

use std::ops::Range;

use super::choice::absent;
use crate::error::{Error, Result};
use crate::field::{Asset, Kind, Layout};
use crate::image::Image;

/// Called with the rows of blocks done and all of them; an error stops the work.
pub type Progress<'a> = dyn FnMut(u64, u64) -> Result<()> + 'a;

/// Double-precision RGB: the sums of one element under one picture.
type Sum = [f64; 3];

/// From sums of coefficients to answers of elements.
type Making<'a> = dyn Fn(&[[f32; 3]]) -> Vec<[f32; 3]> + 'a;

/// How many elements the light of a representation has: lamps, texels or squares; for wavelets of a field of lamps, the texels of
/// the grid that they live on, as in [`Weights::rgb`](super::Weights::rgb).
///
/// # Errors
/// A representation that the asset does not hold.
pub fn elements_of(asset: &Asset, kind: Kind) -> Result<usize> {
    let absent = || absent(asset, kind);
    Ok(match kind {
        Kind::Dense => asset.dense().ok_or_else(absent)?.layout().elements,
        Kind::Factored => asset.factored().ok_or_else(absent)?.layout().elements,
        Kind::Wavelet => asset.sparse().ok_or_else(absent)?.layout().elements,
        Kind::Harmonics => asset.harmonics().map(|_| asset.domain().len()).ok_or_else(absent)?,
        Kind::Explicit => asset.explicit().map(|_| asset.domain().len()).ok_or_else(absent)?,
    })
}

/// `T^T c` for some `elements` (of [all](elements_of)) and several pictures at once, by one representation: for each picture c one
/// RGB triple an element. Channels are apart: the red of c with the red of T. Pictures have the asset's size and three channels;
/// negative numbers are as good as others.
///
/// Cost: samples and tiles read the wanted elements of the blocks that are lit, other representations all of those blocks; on all
/// threads of the pool, and the result does not depend on their number. Memory: 24 bytes an element and picture, and for wavelets
/// up to 32 times as much, 100 MB or less where possible.
///
/// # Errors
/// A representation that the asset does not hold; pictures of another size or with numbers that are not finite; elements beyond the
/// last; bytes that cannot be read or are damaged; what `progress` returns.
pub fn adjoint(
    asset: &Asset,
    kind: Kind,
    lit: &[&Image],
    elements: Range<usize>,
    progress: &mut Progress<'_>,
) -> Result<Vec<Vec<[f32; 3]>>> {
    let count = elements_of(asset, kind)?;
    check(asset, lit)?;
    if elements.start > elements.end || elements.end > count {
        return Err(Error::invalid("elements", format!("{elements:?}"), format!("a part of 0..{count}")));
    }
    let absent = || absent(asset, kind);
    // Where elements are made of coefficients, all of them are.
    let made = |sums: Vec<Vec<Sum>>, make: &Making<'_>| -> Vec<Vec<[f32; 3]>> {
        sums.into_iter().map(|sums| make(&rounded(sums))[elements.clone()].to_vec()).collect()
    };
    let answers: Vec<Vec<[f32; 3]>> = match kind {
        Kind::Dense => {
            let dense = asset.dense().ok_or_else(absent)?;
            pictures::adjoint(dense, lit, elements, progress)?.into_iter().map(rounded).collect()
        }
        Kind::Factored => {
            let factored = asset.factored().ok_or_else(absent)?;
            tiles::adjoint(factored, lit, elements, progress)?.into_iter().map(rounded).collect()
        }
        Kind::Harmonics => {
            let harmonics = asset.harmonics().ok_or_else(absent)?;
            let functions = 0..harmonics.pictures().layout().elements;
            let sums = pictures::adjoint(harmonics.pictures(), lit, functions, progress)?;
            made(sums, &|sums| harmonics.moments_adjoint(sums))
        }
        Kind::Explicit => {
            let explicit = asset.explicit().ok_or_else(absent)?;
            let functions = 0..explicit.pictures().layout().elements;
            let sums = pictures::adjoint(explicit.pictures(), lit, functions, progress)?;
            made(sums, &|sums| explicit.expanded_adjoint(sums))
        }
        Kind::Wavelet => {
            let sparse = asset.sparse().ok_or_else(absent)?;
            made(terms::adjoint(sparse, lit, progress)?, &|sums| sparse.transformed_adjoint(sums))
        }
    };
    check_finite(asset, &answers)?;
    Ok(answers)
}

/// Refuses pictures that do not fit the asset.
fn check(asset: &Asset, lit: &[&Image]) -> Result<()> {
    for picture in lit {
        let (w, h) = picture.size();
        if picture.size() != (asset.width(), asset.height()) || picture.channels() != 3 {
            let expected = format!("{} x {} pixels, RGB, as {}", asset.width(), asset.height(), asset.path().display());
            let found = format!("{w} x {h} pixels of {} channels", picture.channels());
            return Err(Error::invalid("the picture that lights", found, expected));
        }
        if let Some(at) = picture.data().iter().position(|v| !v.is_finite()) {
            let place = format!("the picture that lights, pixel ({}, {})", at / 3 % w, at / 3 / w);
            return Err(Error::invalid(place, picture.data()[at].to_string(), "a finite number"));
        }
    }
    Ok(())
}

/// NaN in the field ends up in a sum, wherever it sits.
fn check_finite(asset: &Asset, answers: &[Vec<[f32; 3]>]) -> Result<()> {
    let bad = |answers: &Vec<[f32; 3]>| answers.iter().position(|rgb| !rgb.iter().all(|v| v.is_finite()));
    let Some(at) = answers.iter().find_map(bad) else { return Ok(()) };
    let place = format!("{}, element {}", asset.path().display(), at + 1);
    let expected = "finite transport (`relume verify` tells whether the file was damaged)";
    Err(Error::invalid(place, "a sum that is not finite", expected))
}

fn rounded(sums: Vec<Sum>) -> Vec<[f32; 3]> {
    sums.into_iter().map(|sum| sum.map(|v| v as f32)).collect()
}

/// Sums of some elements under some pictures, `[element][picture]`, so that threads share them by elements.
struct Sums {
    pictures: usize,
    sums: Vec<Sum>,
}

impl Sums {
    fn new(elements: usize, pictures: usize) -> Self {
        Self { pictures, sums: vec![[0.0; 3]; elements * pictures] }
    }

    /// `[picture][element]`.
    fn by_picture(&self) -> Vec<Vec<Sum>> {
        let of = |picture: usize| self.sums.iter().skip(picture).step_by(self.pictures).copied().collect();
        (0..self.pictures).map(of).collect()
    }
}

/// Rows of blocks done, for `progress`.
fn row_done(progress: &mut Progress<'_>, by: usize, layout: Layout) -> Result<()> {
    progress(by as u64 + 1, layout.rows() as u64)
}

#[cfg(test)]
mod tests;
