//! Implicit sampling (6.7): from photographs under wavelet noise to the wavelets that each pixel's reflectance function is
//! made of.
//!
//! A pixel's reflectance function is `t = S c` with few coefficients c that matter. Under the patterns M it answered
//! `B = <c, W>` with `W = S^T M` (the [`Dictionary`]), three channels at once, some 256 numbers each: far fewer than there are
//! wavelets. So the tree of those that matter is grown from the coarsest on, pixel by pixel ([`Solver`]):
//!
//! 1. **Grow** (6.24, 6.26). All groups (the three wavelets of a place) that hang from the tree are candidates. The one that
//!    explains most of the residual joins; its rows are orthogonalised against the basis Q and taken out of the residual
//!    (sequential QR by Gram and Schmidt, with the columns of `R^-1` carried along); the groups below it become candidates.
//! 2. **Delete.** The tree grows to one and a half times the terms that are wanted. Then terms are taken back one by one, from
//!    anywhere in the tree, the one whose loss costs least first, from the least-squares solution over all that is left: a path to
//!    a spot needs its ancestors to be found, not to be said. (Taking back whole leaves costs a seventh more error.)
//! 3. **Stop.** Deleting goes on while it lowers the generalised cross-validation error, so noise is not modelled, and
//!    nobody has to say how much of it there is.
//! 4. **Solve.** The least-squares coefficients of what is left, refined once.
//!
//! **Where this leaves the thesis, and why.** There a candidate is estimated once, when its parent joins, jointly with its
//! siblings, and keeps that estimate in the queue; early estimates are made while most of the function is still unexplained,
//! and so are the noisiest. Here all candidates are measured against the present residual, by the energy that they explain.
//! That is the magnitude of the coefficient weighted by the amplitude of its wavelet in the patterns, a weighted norm as in
//! eq. 6.5, and all candidates have the same error in it: bare magnitudes of fine wavelets, which the patterns hardly light,
//! are mostly error. (It is orthogonal matching pursuit on a tree: Y. C. Pati, R. Rezaiifar, P. S. Krishnaprasad, "Orthogonal
//! matching pursuit", 1993; deletion and its rule are those of J. H. Friedman, "Multivariate adaptive regression splines",
//! 1991.) With 256 patterns and 64 terms relit errors are less than half those of the queue with weighted estimates, and an
//! eighth of those with bare magnitudes.
//!
//! A damped linear estimate of the other coefficients, from what the terms leave unexplained, does not help: with the prior of
//! the patterns' own spectrum errors went from 1.26 to 1.36 % (64 x 64 texels) and from 2.9 to 3.0 % (128 x 128), and half of it
//! changed nothing. What is left after 64 well-chosen terms is spread too thinly for 256 photographs. So there is none.
//!
//! | part | what it holds |
//! |---|---|
//! | `dictionary` | W, in the order of the tree |
//! | `solver` | one pixel: from its answers to its terms |
//! | `grow` | the tree, with its basis |
//! | `delete` | least squares, and the terms that are not worth keeping |
//! | `field` | all pixels, a row of blocks at a time |
//! | `edges` | pixels that see some of the screen itself |
//! | `kernels` | the loops over patterns |
//! | `plain` | the same in plain double precision: the oracle |

mod delete;
mod dictionary;
mod edges;
mod field;
mod grow;
mod kernels;
mod plain;
mod solver;

use std::str::FromStr;

pub use dictionary::Dictionary;
pub use edges::{Edge, Edges};
pub use field::{Solving, TILE_ROWS};
pub use plain::solve_plainly;
pub use solver::{Scratch, Solver};

use crate::error::{Error, Result};

/// Terms that are tried for each that is wanted. Measured on the virtual monitor: from 1 to 1.5 errors with 128 x 128 texels
/// fall by a tenth, those with 64 x 64 stay as they are; beyond, both stay, and the time rises.
const GROWTH: f64 = 1.5;

/// What a term counts in the generalised cross-validation error. One is right for terms that are given (P. Craven, G. Wahba,
/// "Smoothing noisy data with spline functions", 1979), two to three for bases searched for freely (Friedman 1991); a tree
/// leaves less choice. Measured on the virtual monitor: 1 to 2 are nearly alike, with noise in proportion to the light and with
/// constant noise; 3 takes away what is seen.
const PENALTY: f64 = 1.5;

/// When a pixel has terms enough.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Stop {
    /// At the number of terms asked for.
    Off,
    /// When more terms would model noise.
    #[default]
    On,
}

impl Stop {
    /// Both.
    pub const ALL: &'static [Self] = &[Self::On, Self::Off];

    /// The permanent name for command lines.
    pub fn id(self) -> &'static str {
        match self {
            Self::Off => "off",
            Self::On => "on",
        }
    }
}

impl FromStr for Stop {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self> {
        let known = Self::ALL.iter().copied().find(|stop| stop.id() == name);
        known.ok_or_else(|| Error::invalid("the rule to stop", format!("`{name}`"), "`on` or `off`"))
    }
}

/// What is wanted of a [`Solver`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Options {
    /// Terms of a pixel, at most.
    pub terms: usize,
    /// Whether to stop earlier.
    pub stop: Stop,
}

impl Default for Options {
    /// 64 terms, which 256 patterns determine best (6.7.5), with the rule to stop.
    fn default() -> Self {
        Self { terms: 64, stop: Stop::On }
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

impl Terms {
    /// Forgets all pixels, and keeps the room.
    pub fn clear(&mut self) {
        self.locations.clear();
        self.coefficients.clear();
    }
}

/// Terms that are tried so that `terms` remain. Those beyond three quarters of the patterns would be too ill determined for
/// single precision: the condition of a random matrix so near to square is 14, its square what least squares feel (A. Edelman,
/// "Eigenvalues and condition numbers of random matrices", 1988).
fn tried(terms: usize, patterns: usize) -> usize {
    ((terms as f64 * GROWTH) as usize).min(3 * patterns / 4).max(terms)
}

/// The generalised cross-validation error (Craven and Wahba 1979; Friedman 1991, eq. 30), but for a constant: what is left,
/// over the square of the degrees of freedom that are.
fn generalised(left: f64, terms: usize, patterns: usize) -> f64 {
    let free = patterns as f64 - PENALTY * terms as f64;
    if free > 0.0 { left / (free * free) } else { f64::INFINITY }
}

#[cfg(test)]
mod tests;
