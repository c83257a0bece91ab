//! A reconstruction for the maps of one size: the matrix `U` of eq. 4.6.

use std::sync::Arc;

use super::sparse::Sparse;
use super::texels::Texels;
use super::{Outside, Reconstruction};
use crate::illumination::EnvMap;

/// `U[j, texel]`, the integral over a texel of lamp j's kernel, in steradians, as a product: first the integrals of the
/// map times the method's functions, then the adjoint of how samples become coefficients. Results do not depend on threads.
#[derive(Debug, Clone)]
pub struct Operator {
    reconstruction: Arc<Reconstruction>,
    /// Size of the maps it takes.
    size: (usize, usize),
    /// Size they are averaged down to first.
    inner: (usize, usize),
    moments: Sparse,
}

impl Operator {
    /// Integrates a method's functions over the texels of `width` x `height` lat-long maps: about a second for 1024 x
    /// 512. With [`Outside::Drop`] the total is scaled (by some 1e-4 at most) to the exact solid angle of the coverage.
    pub fn new(reconstruction: Arc<Reconstruction>, outside: Outside, width: usize, height: usize) -> Self {
        let columns = reconstruction.basis().finest_columns();
        let inner = if width > columns { (columns, height.min((columns / 2).max(1))) } else { (width, height) };
        let basis = reconstruction.basis();
        let texels = Texels { domain: reconstruction.domain(), basis, outside, width: inner.0, height: inner.1 };
        let functions = basis.len() + reconstruction.domain().sites().len();
        let moments = Sparse::new(functions, inner.0 * inner.1, &texels.integrate());
        Self { reconstruction, size: (width, height), inner, moments }
    }

    /// Columns and rows of the maps it takes.
    pub fn size(&self) -> (usize, usize) {
        self.size
    }

    /// How many lamps.
    pub fn lamps(&self) -> usize {
        self.reconstruction.domain().len()
    }

    /// `U L'` (eq. 4.7): for each lamp the integral of its kernel times the radiance, RGB. Sums run in f64.
    ///
    /// # Panics
    /// When the map is not of [`Operator::size`].
    pub fn downsample(&self, map: &EnvMap) -> Vec<[f32; 3]> {
        assert_eq!(map.image().size(), self.size, "the operator was made for another map size");
        let map = map.averaged(self.inner);
        let moments = self.moments.times(map.image().data());
        let (functions, sites) = moments.split_at(self.reconstruction.basis().len());
        self.reconstruction.weights(functions, Some(sites))
    }

    /// `U^T t`: for each texel the integral over it of the reconstructed reflectance function, steradians included, so that
    /// `<U^T t, L'> = <t, U L'>`. Divide by the texel's solid angle for the function's mean there.
    ///
    /// # Panics
    /// When `samples` does not hold one number a lamp.
    pub fn upsample(&self, samples: &[f32]) -> Vec<f32> {
        let mut coefficients = self.reconstruction.coefficients(samples);
        coefficients.extend(self.reconstruction.to_sites(samples));
        let texels = self.moments.transposed_times(&coefficients);
        let texels = EnvMap::spread(&texels, self.inner, self.size);
        texels.into_iter().map(|v| v as f32).collect()
    }

    /// Omega_j, the solid angle of each lamp's kernel: `U` applied to a constant map of radiance 1.
    pub fn solid_angles(&self) -> Vec<f64> {
        let (w, h) = self.size;
        self.downsample(&EnvMap::from_fn(w, h, |_| [1.0; 3])).iter().map(|w| f64::from(w[0])).collect()
    }
}
