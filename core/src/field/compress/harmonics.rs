//! Spherical harmonics: the least-squares fit of [`Method::Harmonics`], stored.

use std::path::Path;

use half::f16;
use nalgebra::{DMatrix, DMatrixView};
use rayon::prelude::*;

use super::errors::{BlockErrors, ErrorMap};
use super::survey::survey;
use super::{Finished, Made, Progress, Stage};
use crate::error::{Error, Result};
use crate::field::asset::Asset;
use crate::field::dense::{BLOCK_PIXELS, CHANNELS, Layout};
use crate::field::harmonics::values;
use crate::field::manifest::{Kind, Precision, Representation, bands_of};
use crate::field::spool::Spool;
use crate::field::writer::{Entries, power_of_two_for};
use crate::field::{BlockBuffer, Samples};
use crate::reconstruct::{Method, Reconstruction};

const ARRAY: &str = "transport/harmonics.npy";
const ERRORS: &str = "transport/harmonics-error.npy";

/// Fits, rounds and measures; see [`super::compress`].
pub(super) fn compress(
    asset: &Asset,
    samples: Samples<'_>,
    functions: usize,
    output: &Path,
    progress: &mut Progress<'_>,
) -> Result<Made> {
    let bands = bands_of(functions).ok_or_else(|| {
        let found = format!("{functions} functions");
        Error::invalid("spherical harmonics", found, "a square number from 4 to 625, such as 25 or 225: whole bands")
    })?;
    let layout = samples.layout();
    let coder = Coder::new(asset, bands, survey(samples, progress)?.largest)?;
    let mut errors = ErrorMap::new(layout.width, layout.height);
    let mut spool = Spool::beside(output)?;
    for by in 0..layout.rows() {
        let blocks: Vec<(Vec<f16>, BlockErrors)> = (0..layout.columns())
            .into_par_iter()
            .map_init(Default::default, |room, bx| coder.block(samples, bx, by, room))
            .collect::<Result<_>>()?;
        for (bx, (halves, lost)) in blocks.iter().enumerate() {
            spool.halves(halves)?;
            errors.add(bx, by, lost);
        }
        progress(Stage::Compressing, by as u64 + 1, layout.rows() as u64)?;
    }
    Ok(Box::new(Coded { layout: Layout { elements: functions, ..layout }, scale: coder.scale, spool, errors }))
}

/// The fit and its inverse.
struct Coder {
    /// `F` transposed, lamps x functions: pixels lie in rows.
    fit: DMatrix<f32>,
    /// `Y`, lamps x functions, transposed: functions x lamps.
    values: DMatrix<f32>,
    /// coefficient = half x scale.
    scale: f32,
}

impl Coder {
    fn new(asset: &Asset, bands: usize, largest: f32) -> Result<Self> {
        let domain = asset.directions()?;
        let lamps = domain.len();
        let functions = bands * bands;
        let reconstruction = Reconstruction::new(domain.clone(), Method::Harmonics { bands: bands as u32 })?;
        let column = |lamp: usize| {
            let mut one = vec![0.0; lamps];
            one[lamp] = 1.0;
            reconstruction.coefficients(&one)
        };
        let columns: Vec<Vec<f64>> = (0..lamps).into_par_iter().map(column).collect();
        let fit = DMatrix::from_iterator(functions, lamps, columns.into_iter().flatten().map(|f| f as f32));
        let values = DMatrix::from_vec(functions, lamps, values(domain, functions));
        // No coefficient is larger than the sum of |F| along its row times the largest |T|.
        let reach = fit.row_iter().map(|row| row.iter().map(|f| f.abs()).sum::<f32>()).fold(0.0, f32::max);
        Ok(Self { fit: fit.transpose(), values, scale: power_of_two_for(largest * reach) })
    }

    /// The three channels of a block: halves `[channel][function][pixel]`, and what was lost.
    fn block(
        &self,
        samples: Samples<'_>,
        bx: usize,
        by: usize,
        (room, numbers): &mut (BlockBuffer, Vec<f32>),
    ) -> Result<(Vec<f16>, BlockErrors)> {
        let (lamps, functions) = self.fit.shape();
        let mut halves = Vec::with_capacity(CHANNELS * functions * BLOCK_PIXELS);
        let mut errors = BlockErrors::default();
        // From numbers as the samples store them to halves as they are stored here; powers of two.
        let to_half = samples.scale() / self.scale;
        for c in 0..CHANNELS {
            samples.read(bx, by, c, room, numbers)?;
            let view = DMatrixView::from_slice(numbers, BLOCK_PIXELS, lamps);
            let coefficients = view * &self.fit;
            let start = halves.len();
            halves.extend(coefficients.iter().map(|v| f16::from_f32(v * to_half)));
            let stored = halves[start..].iter().map(|h| h.to_f32() / to_half);
            let decoded = DMatrix::from_iterator(BLOCK_PIXELS, functions, stored) * &self.values;
            errors.add(c, numbers, decoded.as_slice(), samples.scale());
        }
        Ok((halves, errors))
    }
}

/// Coefficient pictures, waiting.
struct Coded {
    layout: Layout,
    scale: f32,
    spool: Spool,
    errors: ErrorMap,
}

impl Finished for Coded {
    fn kind(&self) -> Kind {
        Kind::Harmonics
    }

    fn write(self: Box<Self>, out: &mut Entries<'_>) -> Result<Representation> {
        self.spool.write(out, ARRAY, Precision::Half.descr(), &self.layout.shape())?;
        let loss = self.errors.write(out, ERRORS, None)?;
        let functions = self.layout.elements;
        Ok(Representation::Harmonics { array: ARRAY.to_owned(), functions, scale: self.scale, loss })
    }
}
