//! A reconstruction for the maps of one size: the matrix `U` of eq. 4.6.

use std::sync::Arc;

use super::basis::Basis;
use super::harmonic_moments::HarmonicMoments;
use super::sparse::Sparse;
use super::texels::{Entry, FINEST_ROWS, Texels};
use super::{Outside, Reconstruction};
use crate::illumination::EnvMap;
use crate::math::Vec3;

/// `U[j, texel]`, the integral over a texel of lamp j's kernel, in steradians, as a product: first the integrals of the
/// map times the method's functions, then the adjoint of how samples become coefficients. Results do not depend on threads.
#[derive(Debug, Clone)]
pub struct Operator {
    reconstruction: Arc<Reconstruction>,
    /// Size of the maps it takes.
    size: (usize, usize),
    /// Size they are averaged down to first.
    inner: (usize, usize),
    moments: Moments,
}

/// How a map's integrals with the functions come about.
#[derive(Debug, Clone)]
enum Moments {
    /// Functions, and after them the light that is given straight to sites.
    Sparse(Sparse),
    /// Spherical harmonics, and the light that is given straight to sites.
    Harmonic(HarmonicMoments, Sparse),
}

impl Operator {
    /// Integrates a method's functions over the texels of `width` x `height` lat-long maps: about a second for 1024 x
    /// 512. With [`Outside::Drop`] the total is scaled (by some 1e-4 at most) to the exact solid angle of the coverage.
    pub fn new(reconstruction: Arc<Reconstruction>, outside: Outside, width: usize, height: usize) -> Self {
        let columns = reconstruction.basis().finest_columns();
        let inner = if width > columns { (columns, height.min((columns / 2).max(1))) } else { (width, height) };
        let moments = match reconstruction.basis().bands() {
            Some(bands) => Moments::harmonic(&reconstruction, outside, inner, bands),
            None => {
                let basis = reconstruction.basis();
                let texels = texels(&reconstruction, basis, outside, inner);
                let functions = basis.len() + reconstruction.domain().sites().len();
                Moments::Sparse(Sparse::new(functions, inner.0 * inner.1, &texels.integrate()))
            }
        };
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

    /// Bytes that downsampling reads beside the map.
    pub fn bytes(&self) -> usize {
        match &self.moments {
            Moments::Sparse(moments) => moments.bytes(),
            Moments::Harmonic(moments, sites) => moments.bytes() + sites.bytes(),
        }
    }

    /// `U L'` (eq. 4.7): for each lamp the integral of its kernel times the radiance, RGB. Sums run in f64.
    ///
    /// # Panics
    /// When the map is not of [`Operator::size`].
    pub fn downsample(&self, map: &EnvMap) -> Vec<[f32; 3]> {
        assert_eq!(map.image().size(), self.size, "the operator was made for another map size");
        let map = map.averaged(self.inner);
        let radiance = map.image().data();
        match &self.moments {
            Moments::Sparse(moments) => {
                let moments = moments.times(radiance);
                let (functions, sites) = moments.split_at(self.reconstruction.basis().len());
                self.reconstruction.weights(functions, Some(sites))
            }
            Moments::Harmonic(moments, sites) => {
                self.reconstruction.weights(&moments.times(radiance), Some(&sites.times(radiance)))
            }
        }
    }

    /// `U^T t`: for each texel the integral over it of the reconstructed reflectance function, steradians included, so that
    /// `<U^T t, L'> = <t, U L'>`. Divide by the texel's solid angle for the function's mean there.
    ///
    /// # Panics
    /// When `samples` does not hold one number a lamp.
    pub fn upsample(&self, samples: &[f32]) -> Vec<f32> {
        let mut coefficients = self.reconstruction.coefficients(samples);
        let sites = self.reconstruction.to_sites(samples);
        let texels = match &self.moments {
            Moments::Sparse(moments) => {
                coefficients.extend(sites);
                moments.transposed_times(&coefficients)
            }
            Moments::Harmonic(moments, direct) => {
                let direct = direct.transposed_times(&sites);
                moments.transposed_times(&coefficients).iter().zip(direct).map(|(a, b)| a + b).collect()
            }
        };
        let texels = EnvMap::spread(&texels, self.inner, self.size);
        texels.into_iter().map(|v| v as f32).collect()
    }

    /// Omega_j, the solid angle of each lamp's kernel: `U` applied to a constant map of radiance 1.
    pub fn solid_angles(&self) -> Vec<f64> {
        let (w, h) = self.size;
        self.downsample(&EnvMap::from_fn(w, h, |_| [1.0; 3])).iter().map(|w| f64::from(w[0])).collect()
    }
}

impl Moments {
    /// The coverage of each texel comes from integrating the constant 1.
    fn harmonic(reconstruction: &Reconstruction, outside: Outside, size: (usize, usize), bands: usize) -> Self {
        let entries = texels(reconstruction, &One, outside, size).integrate();
        let mut covered = vec![0.0; size.0 * size.1];
        let mut direct = Vec::new();
        for entry in entries {
            match entry.function.checked_sub(1) {
                None => covered[entry.texel as usize] = entry.steradians as f32,
                Some(site) => direct.push(Entry { function: site, ..entry }),
            }
        }
        let direct = Sparse::new(reconstruction.domain().sites().len(), size.0 * size.1, &direct);
        Self::Harmonic(HarmonicMoments::new(bands, size, covered), direct)
    }
}

fn texels<'a>(
    reconstruction: &'a Reconstruction,
    basis: &'a dyn Basis,
    outside: Outside,
    (width, height): (usize, usize),
) -> Texels<'a> {
    Texels { domain: reconstruction.domain(), basis, outside, width, height, finest_rows: FINEST_ROWS }
}

/// The function that is 1 everywhere.
#[derive(Debug)]
struct One;

impl Basis for One {
    fn len(&self) -> usize {
        1
    }

    fn at(&self, _: &Vec3, values: &mut Vec<(u32, f64)>) -> u32 {
        values.push((0, 1.0));
        0
    }

    fn refinement(&self) -> usize {
        1
    }
}
