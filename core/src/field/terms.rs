//! The arrays of a [`Sparse`](super::Sparse) field, as blocks come in.

use std::path::Path;

use half::f16;

use super::dense::{BLOCK_PIXELS, CHANNELS, Layout};
use super::manifest::Precision;
use super::npy;
use super::sparse::{location_bytes, unsigned};
use super::spool::Spool;
use super::writer::Entries;
use crate::error::{Error, Result};

pub(super) const OFFSETS: &str = "transport/wavelet-offsets.npy";
pub(super) const LOCATIONS: &str = "transport/wavelet-locations.npy";
pub(super) const COEFFICIENTS: &str = "transport/wavelet-coefficients.npy";

/// Location, and coefficients RGB in halves.
pub(super) type Term = (u32, [f16; CHANNELS]);

/// Terms that wait in temporary files, beside the container that they are for.
pub(super) struct TermArrays {
    texels: usize,
    /// The first term of each pixel.
    offsets: Vec<u64>,
    terms: u64,
    locations: Spool,
    coefficients: Spool,
}

impl TermArrays {
    /// Empty ones; the layout's elements are the locations.
    ///
    /// # Errors
    /// A folder that cannot be written to.
    pub fn beside(output: &Path, layout: Layout) -> Result<Self> {
        Ok(Self {
            texels: layout.elements,
            offsets: Vec::with_capacity(layout.rows() * layout.columns() * BLOCK_PIXELS + 1),
            terms: 0,
            locations: Spool::beside(output)?,
            coefficients: Spool::beside(output)?,
        })
    }

    /// Appends the next block: how many terms each of its pixels has, and the terms, pixel after pixel.
    ///
    /// # Errors
    /// A full disk; coefficients that are no halves.
    pub fn push(&mut self, counts: &[u32; BLOCK_PIXELS], terms: &[Term]) -> Result<()> {
        for count in counts {
            self.offsets.push(self.terms);
            self.terms += u64::from(*count);
        }
        let bytes = location_bytes(self.texels);
        let locations = terms.iter().flat_map(|(location, _)| location.to_le_bytes().into_iter().take(bytes));
        self.locations.push(&locations.collect::<Vec<u8>>())?;
        let halves: Vec<f16> = terms.iter().flat_map(|(_, rgb)| *rgb).collect();
        if halves.iter().any(|half| !half.is_finite()) {
            let expected = "transport within its range";
            return Err(Error::invalid("wavelets", "a coefficient beyond half precision", expected));
        }
        self.coefficients.halves(&halves)
    }

    /// Puts the arrays into the container, under the names above.
    ///
    /// # Errors
    /// A full disk.
    pub fn write(mut self, out: &mut Entries<'_>) -> Result<()> {
        self.offsets.push(self.terms);
        let mut bytes = npy::header(unsigned(8), &[self.offsets.len()]);
        bytes.extend(self.offsets.iter().flat_map(|offset| offset.to_le_bytes()));
        out.entry(OFFSETS, &bytes)?;
        let count = self.terms as usize;
        self.locations.write(out, LOCATIONS, unsigned(location_bytes(self.texels)), &[count])?;
        self.coefficients.write(out, COEFFICIENTS, Precision::Half.descr(), &[count, CHANNELS])
    }
}
