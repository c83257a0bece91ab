//! Spherical harmonics: reflectance functions as smooth ones, for soft light (5.4, linear approximation).

use rayon::prelude::*;

use super::dense::Dense;
use super::manifest::bands_of;
use crate::domain::Directions;
use crate::math::harmonics;

/// One coefficient picture per function: `t_j ~ sum_b c_b Y_b(w_j)` at the lamps j.
#[derive(Debug)]
pub struct Harmonics {
    pictures: Dense,
    /// `Y_b(w_j)`, `[lamp][function]`.
    functions: Vec<f32>,
}

impl Harmonics {
    /// Coefficient pictures in an open container, whose layout has a checked number of elements.
    pub(super) fn new(pictures: Dense, domain: &Directions) -> Self {
        let functions = values(domain, pictures.layout().elements);
        Self { pictures, functions }
    }

    /// The coefficients, as a dense field of functions.
    pub fn pictures(&self) -> &Dense {
        &self.pictures
    }

    /// `m = Y^T w`: what the coefficients are multiplied by, from RGB weights of the lamps.
    ///
    /// # Panics
    /// When there is not one weight a lamp.
    pub fn moments(&self, weights: &[[f32; 3]]) -> Vec<[f32; 3]> {
        let count = self.pictures.layout().elements;
        assert_eq!(weights.len() * count, self.functions.len(), "one weight a lamp");
        let mut moments = vec![[0.0f64; 3]; count];
        for (functions, rgb) in self.functions.chunks_exact(count).zip(weights) {
            if rgb.iter().all(|w| *w == 0.0) {
                continue;
            }
            for (moment, y) in moments.iter_mut().zip(functions) {
                (0..3).for_each(|c| moment[c] += f64::from(rgb[c]) * f64::from(*y));
            }
        }
        moments.into_iter().map(|m| m.map(|v| v as f32)).collect()
    }

    /// `Y m`, the adjoint of [`Harmonics::moments`]: one RGB triple a lamp from one a function.
    ///
    /// # Panics
    /// When there is not one triple a function.
    pub fn moments_adjoint(&self, sums: &[[f32; 3]]) -> Vec<[f32; 3]> {
        assert_eq!(sums.len(), self.pictures.layout().elements, "one triple a function");
        let of_lamp = |functions: &[f32]| {
            let mut answer = [0.0f64; 3];
            for (y, sum) in functions.iter().zip(sums) {
                (0..3).for_each(|c| answer[c] += f64::from(*y) * f64::from(sum[c]));
            }
            answer.map(|v| v as f32)
        };
        self.functions.chunks_exact(sums.len()).map(of_lamp).collect()
    }
}

/// `Y_b(w_j)`, `[lamp][function]`, for a whole number of bands.
pub(super) fn values(domain: &Directions, functions: usize) -> Vec<f32> {
    let bands = bands_of(functions).unwrap_or(0);
    let of_lamp = |lamp| harmonics::at(lamp, bands).into_iter().map(|y| y as f32);
    domain.lamps().par_iter().flat_map_iter(of_lamp).collect()
}
