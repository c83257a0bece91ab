//! Implicit sampling (6.7): from photographs under wavelet noise to the wavelets that each pixel's reflectance function is
//! made of.

mod dictionary;
mod field;
mod kernels;
mod solver;

pub use dictionary::Dictionary;
pub use field::{Solving, TILE_ROWS};
pub use solver::{Scratch, Solver};

/// When a pixel has terms enough.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Stop {
    /// At the number of terms asked for.
    Off,
    /// When more terms would model noise.
    #[default]
    On,
}

/// What is wanted of a [`Solver`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// Terms at most.
    pub terms: usize,
    /// Whether to stop earlier.
    pub stop: Stop,
    /// x
    pub growth: f64,
    /// x
    pub penalty: f32,
}

impl Default for Options {
    fn default() -> Self {
        Self { terms: 64, stop: Stop::On, growth: 1.5, penalty: 2.0 }
    }
}

/// Terms of pixels, one pixel after another.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Terms {
    /// Where a coefficient lies in the transform: row x columns + column.
    pub locations: Vec<u32>,
    /// Its value for R, G and B.
    pub coefficients: Vec<[f32; 3]>,
}
