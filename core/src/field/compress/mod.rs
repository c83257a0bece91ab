//! Compact representations of a field (chapter 5, and one step past it): from the samples of an asset to another asset.
//!
//! The samples are read block by block, some blocks at a time, so memory stays bounded however large the field is; what comes
//! out grows in temporary files, because its size is not known before, and is put into the container at the end. Every
//! representation is decoded again as it is stored, rounding included: the error `e_p` of each pixel and the error reached over
//! all are measured, never estimated.
//!
//! | part | what it holds |
//! |---|---|
//! | `survey` | energy and largest numbers of a field, for thresholds and scales |
//! | `errors` | `e_p` and the error reached |
//! | `harmonics` | spherical harmonics |
//! | `factored` | tiles of low rank |
//! | `selection` | the largest terms of a pixel, by count and by error |
//! | `wavelet`, `wavelet_arrays` | for each pixel its own set of wavelet coefficients |

mod errors;
mod factored;
mod harmonics;
mod selection;
mod survey;
mod wavelet;
mod wavelet_arrays;

use std::path::Path;

use super::asset::Asset;
use super::manifest::{Kind, Manifest, Representation};
use super::rewrite::{annotate, rewrite};
use super::samples::Samples;
use super::writer::Entries;
use crate::error::{Error, Result};
use crate::files::check_folder;
use crate::reconstruct::Method;
use crate::wavelet::Wavelet;

/// The grid of wavelets where a user names none: 1.4 degrees a texel over a hemisphere (thesis, 5.4).
pub const WAVELET_GRID: (usize, usize) = (256, 64);

/// What a field is compressed to.
#[derive(Debug, Clone, PartialEq)]
pub enum Scheme {
    /// Spherical harmonics, a square number of functions from 4 to 625: 25, 225.
    Harmonics {
        /// How many.
        functions: usize,
    },
    /// Tiles of low rank.
    Factored {
        /// The relative error over the whole field, Frobenius, from 0.001 to 1: at most so much. Less where glints have most of
        /// the energy, so that pictures under even light are off by at most 1.4 times as much, in practice far less.
        error: f64,
    },
    /// For each pixel its own set of wavelet coefficients, by `error`, by `terms`, or by the first of them that is met.
    Wavelet {
        /// Haar, 5/3 or 9/7.
        wavelet: Wavelet,
        /// Longitudes x angles from the axis over the coverage of the lamps, even numbers: [`WAVELET_GRID`].
        grid: (usize, usize),
        /// How functions are rebuilt on the grid: [`Method::BSpline`].
        reconstruction: Method,
        /// The largest relative error of a reflectance function, all channels together, from 0.001 to 1.
        error: Option<f64>,
        /// The most coefficients of a pixel.
        terms: Option<usize>,
    },
}

/// What is going on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stage {
    /// Reading the samples for their energy; counts rows of blocks.
    Measuring,
    /// Trying sizes of tiles on a part of the picture; counts the tiles of one size.
    Choosing,
    /// Compressing; counts rows of blocks or of tiles.
    Compressing,
    /// Copying what is kept; counts bytes.
    Writing,
}

/// Called with the stage, what is done and all of it; an error stops the work.
pub type Progress<'a> = dyn FnMut(Stage, u64, u64) -> Result<()> + 'a;

/// Writes `asset` to `output` with a compact representation made from its samples, in place of one of that kind; of the
/// representations that it holds, those of the kinds in `keep` stay. Layers stay. Whole or not at all.
///
/// # Errors
/// An asset without the samples as photographed: errors are measured against them. What a scheme cannot do, as a
/// sentence; numbers that are not finite; folder absent or full; what `progress` returns.
pub fn compress(
    asset: &Asset,
    output: &Path,
    scheme: &Scheme,
    keep: &[Kind],
    progress: &mut Progress<'_>,
) -> Result<()> {
    check_folder(output)?;
    let Some(dense) = asset.dense() else {
        return Err(Error::Unsupported {
            place: asset.path().display().to_string(),
            what: "compressing a field that no longer holds its samples as photographed".to_owned(),
            advice: "compress the asset that it was made from (--keep puts several representations into one)"
                .to_owned(),
        });
    };
    let samples = Samples::Dense(dense);
    let made: Made = match scheme {
        Scheme::Harmonics { functions } => harmonics::compress(asset, samples, *functions, output, progress)?,
        Scheme::Factored { error } => factored::compress(samples, *error, output, progress)?,
        Scheme::Wavelet { wavelet, grid, reconstruction, error, terms } => {
            let wanted = wavelet::Wanted {
                wavelet: *wavelet,
                grid: *grid,
                reconstruction: *reconstruction,
                error: *error,
                terms: *terms,
            };
            wavelet::compress(asset, samples, &wanted, output, progress)?
        }
    };
    let kind = made.kind();
    let stays = |r: &Representation| r.kind() != kind && keep.contains(&r.kind());
    let gone = |name: &str| asset.manifest().representations.iter().any(|r| !stays(r) && r.entries().contains(&name));
    let copying = &mut |done, total| progress(Stage::Writing, done, total);
    rewrite(asset, output, &|name| !gone(name), copying, |out, manifest: &mut Manifest| {
        manifest.representations.retain(stays);
        manifest.representations.push(made.write(out)?);
        annotate(manifest, ("compressed", serde_json::json!(concat!("relume ", env!("CARGO_PKG_VERSION")))));
        Ok(())
    })
}

/// A representation whose arrays wait in temporary files.
trait Finished {
    fn kind(&self) -> Kind;

    /// Puts the arrays into the container.
    fn write(self: Box<Self>, out: &mut Entries<'_>) -> Result<Representation>;
}

type Made = Box<dyn Finished>;
