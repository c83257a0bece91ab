//! Spherical harmonics (4.3.4): a least-squares fit of n^2 functions to the samples.
//!
//! A set that covers about half of the sphere is mirrored to the other half, as in the thesis. The fit minimises
//! `sum_j Omega_j (f(w_j) - t_j)^2 + RIDGE sum_{l > 0} c_lm^2`, each site counting by its Voronoi cell (all of them 4 pi,
//! mirror images included). Without the ridge there is no unique answer where sites are fewer than functions; it does not
//! touch the constant, so constants are met exactly.

use std::f64::consts::{FRAC_PI_2, PI};
use std::sync::Arc;

use nalgebra::{Cholesky, DMatrix, DMatrixView, DVector};
use rayon::prelude::*;

use super::Outside;
use super::basis::{Basis, Fit};
use super::resampling::DENSE_SHARE;
use super::sparse::Sparse;
use super::texels::Texels;
use super::zero_order::ZeroOrder;
use crate::domain::{Coverage, Directions};
use crate::math::{Vec3, harmonics};

/// Against a Gram matrix that is the identity for a dense set: a thousandth damps what is well sampled by as much.
const RIDGE: f64 = 1e-3;
/// Half the sphere, give or take what half a spacing adds.
const MIRRORED_UP_TO_RAD: f64 = FRAC_PI_2 + 0.2;

/// All functions of `bands` bands; none is zero anywhere.
#[derive(Debug)]
pub(super) struct Harmonics {
    bands: usize,
}

impl Harmonics {
    /// The functions of some bands.
    pub fn new(bands: usize) -> Self {
        Self { bands }
    }
}

impl Basis for Harmonics {
    fn len(&self) -> usize {
        self.bands * self.bands
    }

    fn at(&self, direction: &Vec3, values: &mut Vec<(u32, f64)>) -> u32 {
        values.extend((0..).zip(harmonics::at(direction, self.bands)));
        0
    }

    fn refinement(&self) -> usize {
        1
    }

    fn bands(&self) -> Option<usize> {
        Some(self.bands)
    }
}

/// `F`, functions x sites.
#[derive(Debug)]
pub(super) struct LeastSquares {
    matrix: DMatrix<f64>,
    /// Its transpose, for functions that lie in rows.
    transposed: DMatrix<f32>,
}

impl LeastSquares {
    /// Solves for all sites at once.
    pub fn new(domain: &Arc<Directions>, bands: usize) -> Self {
        let sites = domain.sites();
        let mirrored = match domain.coverage() {
            Coverage::Cap { half_angle_rad } => half_angle_rad <= MIRRORED_UP_TO_RAD,
            Coverage::Sphere => false,
        };
        let axis = domain.axis().vector();
        let image = |s: &Vec3| s - axis * (2.0 * s.dot(&axis));
        let columns = |f: &(dyn Fn(&Vec3) -> Vec3 + Sync)| {
            let values: Vec<Vec<f64>> = sites.par_iter().map(|s| harmonics::at(&f(s), bands)).collect();
            DMatrix::from_iterator(bands * bands, sites.len(), values.into_iter().flatten())
        };
        let mut weights = cells(domain);
        let scale = 4.0 * PI / weights.sum() / if mirrored { 2.0 } else { 1.0 };
        weights *= scale;
        let direct = columns(&|s| *s);
        let mut weighted = weigh(&direct, &weights);
        let mut gram = &weighted * direct.transpose();
        if mirrored {
            let images = columns(&image);
            let weighted_images = weigh(&images, &weights);
            gram += &weighted_images * images.transpose();
            weighted += weighted_images;
        }
        (1..bands * bands).for_each(|n| gram[(n, n)] += RIDGE);
        // The ridge makes the matrix positive definite: its first row alone has none, and is that of a positive sum.
        let matrix = Cholesky::new(gram).map_or_else(|| weighted.clone(), |cholesky| cholesky.solve(&weighted));
        let transposed = matrix.transpose().map(|number| number as f32);
        Self { matrix, transposed }
    }
}

impl Fit for LeastSquares {
    fn coefficients(&self, samples: &[f64]) -> Vec<f64> {
        (&self.matrix * DVector::from_column_slice(samples)).data.into()
    }

    fn coefficients_of_lanes(&self, samples: &[f32], lanes: usize) -> Vec<f32> {
        let samples = DMatrixView::from_slice(samples, lanes, self.matrix.ncols());
        (samples * &self.transposed).data.into()
    }

    fn cost(&self) -> usize {
        (self.matrix.len() as f64 * DENSE_SHARE) as usize
    }

    fn adjoint(&self, moments: &[f64]) -> Vec<f64> {
        self.matrix.tr_mul(&DVector::from_column_slice(moments)).data.into()
    }
}

/// Solid angles of the sites' Voronoi cells inside the coverage: weights, so some percent will do.
fn cells(domain: &Arc<Directions>) -> DVector<f64> {
    let (width, height) = (256, 128);
    let basis = ZeroOrder::new(domain.clone());
    let texels = Texels { domain, basis: &basis, outside: Outside::Drop, width, height, finest_rows: height };
    let sums = Sparse::new(basis.len(), width * height, &texels.integrate()).times(&vec![1.0; 3 * width * height]);
    // A cell that the texels missed still has some weight.
    DVector::from_iterator(sums.len(), sums.iter().map(|sum| sum[0].max(1e-6)))
}

fn weigh(columns: &DMatrix<f64>, weights: &DVector<f64>) -> DMatrix<f64> {
    let mut weighted = columns.clone();
    weighted.column_iter_mut().zip(weights).for_each(|(mut column, weight)| column *= *weight);
    weighted
}
