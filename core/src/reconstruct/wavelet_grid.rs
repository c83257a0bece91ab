//! Wavelet interpolation (4.3.5) of lamps on a grid of longitudes and latitudes.
//!
//! Samples are scaling coefficients; finer wavelet coefficients are zero. So the function is the sum of the samples times
//! the product of the synthesis scaling function in longitude and in latitude. Longitude goes round. Latitude is mirrored at
//! an edge, and at a pole goes on half a turn on, which is what lies there; the thesis mirrors at both.

use std::sync::Arc;

use super::basis::Basis;
use crate::domain::{Directions, LatLongGrid};
use crate::error::Result;
use crate::math::Vec3;
use crate::wavelet::{Scaling, Wavelet};

/// Texels from one longitude to the next that the widest kernel needs: its error is about a hundredth.
const TEXELS_A_COLUMN: usize = 8;

/// Products of scaling functions, one a site.
#[derive(Debug)]
pub(super) struct WaveletGrid {
    domain: Arc<Directions>,
    grid: LatLongGrid,
    scaling: Scaling,
    wavelet: Wavelet,
}

impl WaveletGrid {
    /// `Ok(None)` where the lamps are no grid.
    ///
    /// # Errors
    /// A wavelet without a symmetric scaling function.
    pub fn new(domain: Arc<Directions>, wavelet: Wavelet) -> Result<Option<Self>> {
        let scaling = Scaling::new(wavelet)?;
        Ok(LatLongGrid::find(&domain).map(|grid| Self { domain, grid, scaling, wavelet }))
    }
}

impl Basis for WaveletGrid {
    fn len(&self) -> usize {
        self.domain.sites().len()
    }

    fn at(&self, direction: &Vec3, values: &mut Vec<(u32, f64)>) -> u32 {
        let (column, row) = self.grid.coordinates(direction);
        let reach = self.scaling.reach();
        let around = |at: f64| {
            let whole = at.floor() as i64;
            (whole + 1 - reach..=whole + reach).map(move |k| (k, self.scaling.at(at - k as f64))).filter(|v| v.1 != 0.0)
        };
        for (r, across) in around(row) {
            values.extend(around(column).map(|(c, along)| (self.grid.site(c, r), along * across)));
        }
        // Haar jumps half-way between samples, the others bend at them.
        let shift = if self.wavelet == Wavelet::Haar { 0.5 } else { 0.0 };
        let (i, j) = ((column + shift).floor() as u32, (row + shift + 4.0).floor() as u32);
        j * (self.grid.longitudes() as u32 + 1) + i
    }

    fn refinement(&self) -> usize {
        match self.wavelet {
            // As zero-order.
            Wavelet::Haar => 8,
            // As linear.
            Wavelet::LeGall53 => 4,
            _ => 2,
        }
    }

    fn finest_columns(&self) -> usize {
        match self.wavelet {
            Wavelet::Daubechies97 => (TEXELS_A_COLUMN * self.grid.longitudes()).next_power_of_two().clamp(128, 2048),
            _ => usize::MAX,
        }
    }
}
