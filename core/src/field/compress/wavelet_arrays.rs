//! The arrays of a wavelet representation, as blocks come in.

use std::path::Path;

use half::f16;

use super::Finished;
use super::errors::{BlockErrors, ErrorMap};
use super::spool::Spool;
use super::wavelet::Wanted;
use crate::error::{Error, Result};
use crate::field::dense::{BLOCK_PIXELS, CHANNELS, Layout};
use crate::field::manifest::{Kind, Precision, Representation};
use crate::field::npy;
use crate::field::sparse::{location_bytes, unsigned};
use crate::field::writer::Entries;

const OFFSETS: &str = "transport/wavelet-offsets.npy";
const LOCATIONS: &str = "transport/wavelet-locations.npy";
const COEFFICIENTS: &str = "transport/wavelet-coefficients.npy";
const ERRORS: &str = "transport/wavelet-error.npy";

/// Location, and coefficients RGB.
pub type Term = (u32, [f16; CHANNELS]);

/// A block: terms pixel after pixel, and errors in units of T.
pub struct CodedBlock {
    pub counts: [u32; BLOCK_PIXELS],
    pub terms: Vec<Term>,
    pub errors: BlockErrors,
}

/// Arrays that wait in temporary files.
pub struct Arrays {
    wanted: Wanted,
    scale: f32,
    /// The first term of each pixel.
    offsets: Vec<u64>,
    terms: u64,
    locations: Spool,
    coefficients: Spool,
    errors: ErrorMap,
}

impl Arrays {
    /// Empty ones, beside `output`.
    ///
    /// # Errors
    /// A folder that cannot be written to.
    pub fn new(layout: Layout, wanted: &Wanted, scale: f32, output: &Path) -> Result<Self> {
        Ok(Self {
            wanted: *wanted,
            scale,
            offsets: Vec::with_capacity(layout.rows() * layout.columns() * BLOCK_PIXELS + 1),
            terms: 0,
            locations: Spool::beside(output)?,
            coefficients: Spool::beside(output)?,
            errors: ErrorMap::new(layout.width, layout.height),
        })
    }

    /// Appends the next block.
    ///
    /// # Errors
    /// A full disk; coefficients that are no halves.
    pub fn push(&mut self, bx: usize, by: usize, block: &CodedBlock) -> Result<()> {
        for count in block.counts {
            self.offsets.push(self.terms);
            self.terms += u64::from(count);
        }
        let bytes = location_bytes(self.wanted.grid.0 * self.wanted.grid.1);
        let locations = block.terms.iter().flat_map(|(location, _)| location.to_le_bytes().into_iter().take(bytes));
        self.locations.push(&locations.collect::<Vec<u8>>())?;
        let halves: Vec<f16> = block.terms.iter().flat_map(|(_, rgb)| *rgb).collect();
        if halves.iter().any(|half| !half.is_finite()) {
            return Err(Error::invalid(
                "wavelets",
                "a coefficient beyond half precision",
                "transport within its range",
            ));
        }
        self.coefficients.halves(&halves)?;
        self.errors.add(bx, by, &block.errors);
        Ok(())
    }
}

impl Finished for Arrays {
    fn kind(&self) -> Kind {
        Kind::Wavelet
    }

    fn write(mut self: Box<Self>, out: &mut Entries<'_>) -> Result<Representation> {
        let Wanted { wavelet, grid, reconstruction, error, terms } = self.wanted;
        self.offsets.push(self.terms);
        let mut bytes = npy::header(unsigned(8), &[self.offsets.len()]);
        bytes.extend(self.offsets.iter().flat_map(|offset| offset.to_le_bytes()));
        out.entry(OFFSETS, &bytes)?;
        let count = self.terms as usize;
        self.locations.write(out, LOCATIONS, unsigned(location_bytes(grid.0 * grid.1)), &[count])?;
        self.coefficients.write(out, COEFFICIENTS, Precision::Half.descr(), &[count, CHANNELS])?;
        Ok(Representation::Wavelet {
            wavelet: wavelet.id().to_owned(),
            grid: [grid.0, grid.1],
            reconstruction: reconstruction.id().to_owned(),
            offsets: OFFSETS.to_owned(),
            locations: LOCATIONS.to_owned(),
            coefficients: COEFFICIENTS.to_owned(),
            scale: self.scale,
            most_terms: terms,
            loss: self.errors.write(out, ERRORS, error)?,
        })
    }
}
