//! Wavelets (appendix A): transforms of many reflectance functions at once, the tree of their coefficients, and which
//! coefficients to keep (6.4, 6.5).
//!
//! A function t becomes coefficients `c = A t` ([`Transform::forward`]) and comes back as `t = S c`
//! ([`Transform::inverse`]): the columns of S are the basis functions, the rows of A what measures them, `A S = S A = I`.
//! To *compress*, coefficients of t are dropped and the light is turned by the adjoint, `<t, L> = <c, S^T L>`
//! ([`Transform::inverse_adjoint`]); to *emit* patterns, the columns of S are shown and the light is expanded, `a = A L`.
//! For orthonormal wavelets both agree, for the 5/3 and the 9/7 they do not: with the filters of A.4 their *synthesis*
//! side is the smooth one (A.4 says analysis), so dropped coefficients leave smooth functions.
//!
//! In the constant-energy normalisation, the low-pass filter of one level multiplies a constant signal by sqrt 2, and the
//! high-pass filter an alternating one. Details of Haar are positive where the signal falls (A.2), those of the 5/3 and the
//! 9/7 where a sample exceeds its neighbours (A.4).
//!
//! | part | what it holds |
//! |---|---|
//! | `scaling` | scaling functions of the synthesis side, tabulated |
//! | `extension` | what lies beyond the ends of a line |
//! | `lifting` | Haar, 5/3 and 9/7 as lifting steps |
//! | `bank` | D4 and D8 as orthonormal filter banks |
//! | `line` | one level along one axis, over lanes |
//! | `transform` | all levels in two dimensions: forward, inverse, both adjoints |
//! | `tree` | parent, children, level and orientation of a location |
//! | `approximation` | which coefficients to keep: linear, non-linear, best tree, progressive trees |

mod approximation;
mod bank;
mod extension;
mod lifting;
mod line;
mod scaling;
mod transform;
mod tree;

use std::str::FromStr;

pub use approximation::{Approximation, Greedy, Optimal};
pub use extension::Edge;
pub use scaling::Scaling;
pub use transform::{Normalisation, Transform};
pub use tree::{Orientation, Place, Tree};

use crate::error::{Error, Result};

/// A wavelet.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Wavelet {
    /// Haar: piecewise constant.
    Haar,
    /// 5/3, LeGall and Tabatabai (1988): its synthesis scaling function is the linear B-spline.
    LeGall53,
    /// 9/7, Cohen, Daubechies and Feauveau (1992), the lossy filter of JPEG 2000: four vanishing moments.
    Daubechies97,
    /// Daubechies' orthonormal wavelet of 4 taps (1988): two vanishing moments, not symmetric.
    Daubechies4,
    /// Daubechies' orthonormal wavelet of 8 taps (1988): four vanishing moments, not symmetric.
    Daubechies8,
}

impl Wavelet {
    /// All of them, in permanent order.
    pub const ALL: &'static [Self] =
        &[Self::Haar, Self::LeGall53, Self::Daubechies97, Self::Daubechies4, Self::Daubechies8];

    /// The permanent name for command lines and files.
    pub fn id(self) -> &'static str {
        match self {
            Self::Haar => "haar",
            Self::LeGall53 => "5/3",
            Self::Daubechies97 => "9/7",
            Self::Daubechies4 => "d4",
            Self::Daubechies8 => "d8",
        }
    }

    /// Whether its filters are symmetric, so that a line can be mirrored at its ends.
    pub fn is_symmetric(self) -> bool {
        !matches!(self, Self::Daubechies4 | Self::Daubechies8)
    }

    /// Polynomials below this degree have zero details away from edges (on the analysis side).
    pub fn vanishing_moments(self) -> usize {
        match self {
            Self::Haar => 1,
            Self::LeGall53 | Self::Daubechies4 => 2,
            Self::Daubechies97 | Self::Daubechies8 => 4,
        }
    }
}

impl FromStr for Wavelet {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self> {
        Self::ALL.iter().copied().find(|wavelet| wavelet.id() == name).ok_or_else(|| {
            let ids: Vec<&str> = Self::ALL.iter().map(|wavelet| wavelet.id()).collect();
            Error::invalid("the wavelet", format!("`{name}`"), format!("one of {}", ids.join(", ")))
        })
    }
}

#[cfg(test)]
mod tests;
