//! The arrays of a wavelet representation and its error map, as blocks come in.

use std::path::Path;

use super::Finished;
use super::errors::{BlockErrors, ErrorMap};
use super::wavelet::Wanted;
use crate::error::Result;
use crate::field::dense::{BLOCK_PIXELS, Layout};
use crate::field::manifest::{Kind, Representation};
use crate::field::terms::{COEFFICIENTS, LOCATIONS, OFFSETS, Term, TermArrays};
use crate::field::writer::Entries;

const ERRORS: &str = "transport/wavelet-error.npy";

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
    terms: TermArrays,
    errors: ErrorMap,
}

impl Arrays {
    /// Empty ones, beside `output`.
    ///
    /// # Errors
    /// A folder that cannot be written to.
    pub fn new(layout: Layout, wanted: &Wanted, scale: f32, output: &Path) -> Result<Self> {
        let terms = TermArrays::beside(output, Layout { elements: wanted.grid.0 * wanted.grid.1, ..layout })?;
        Ok(Self { wanted: *wanted, scale, terms, errors: ErrorMap::new(layout.width, layout.height) })
    }

    /// Appends the next block.
    ///
    /// # Errors
    /// A full disk; coefficients that are no halves.
    pub fn push(&mut self, bx: usize, by: usize, block: &CodedBlock) -> Result<()> {
        self.terms.push(&block.counts, &block.terms)?;
        self.errors.add(bx, by, &block.errors);
        Ok(())
    }
}

impl Finished for Arrays {
    fn kind(&self) -> Kind {
        Kind::Wavelet
    }

    fn write(self: Box<Self>, out: &mut Entries<'_>) -> Result<Representation> {
        let Wanted { wavelet, grid, reconstruction, error, terms } = self.wanted;
        self.terms.write(out)?;
        Ok(Representation::Wavelet {
            with_texels: false,
            wavelet: wavelet.id().to_owned(),
            grid: [grid.0, grid.1],
            reconstruction: Some(reconstruction.id().to_owned()),
            offsets: OFFSETS.to_owned(),
            locations: LOCATIONS.to_owned(),
            coefficients: COEFFICIENTS.to_owned(),
            scale: self.scale,
            most_terms: terms,
            loss: Some(self.errors.write(out, ERRORS, error)?),
        })
    }
}
