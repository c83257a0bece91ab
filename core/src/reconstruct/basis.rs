//! What a method is made of: functions of direction, and how samples become their coefficients.

use std::fmt::Debug;

use crate::math::Vec3;

/// Functions of direction `phi_b(w)`, few of them not zero at any one direction.
///
/// For every unit direction the kernels made of them sum to one over the lamps. Where there is no [`Fit`], function n
/// belongs to site n and is its kernel.
pub(super) trait Basis: Debug + Send + Sync {
    /// How many functions.
    fn len(&self) -> usize;

    /// Appends (number, value) of the functions that are not zero at a unit direction. Returns a number that is equal
    /// for directions between which the values vary smoothly (the same cell, triangle or edge), below 2^31.
    fn at(&self, direction: &Vec3, values: &mut Vec<(u32, f64)>) -> u32;

    /// Into how many parts a side of a texel is cut where regions meet in it.
    fn refinement(&self) -> usize;

    /// Maps with more columns than this hold nothing that the functions resolve: they are averaged down to it. Coarser maps
    /// are cut until the functions are looked at about as finely, or 1024 columns finely.
    fn finest_columns(&self) -> usize {
        usize::MAX
    }

    /// How many bands, where the functions are the spherical harmonics: their integrals over a map are separable.
    fn bands(&self) -> Option<usize> {
        None
    }
}

/// Coefficients from samples: the linear map `F` in `c = F t`, one sample a site.
pub(super) trait Fit: Debug + Send + Sync {
    /// `F t`: from one sample a site to one coefficient a function.
    fn coefficients(&self, samples: &[f64]) -> Vec<f64>;

    /// `F t` of many functions side by side: from `[site][lane]` to `[function][lane]`.
    fn coefficients_of_lanes(&self, samples: &[f32], lanes: usize) -> Vec<f32>;

    /// Multiplications that [`Fit::coefficients_of_lanes`] takes a lane, about; one within a matrix product counts as
    /// [`DENSE_SHARE`](super::resampling::DENSE_SHARE).
    fn cost(&self) -> usize;

    /// `F^T m`: from one number a function to one a site.
    fn adjoint(&self, moments: &[f64]) -> Vec<f64>;
}
