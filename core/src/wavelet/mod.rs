//! Wavelets (appendix A).
//!
//! | part | what it holds |
//! |---|---|
//! | `scaling` | scaling functions of the synthesis side, tabulated |

mod scaling;

pub use scaling::Scaling;

/// A wavelet.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Wavelet {
    /// Haar: piecewise constant.
    Haar,
    /// 5/3, LeGall and Tabatabai (1988): its synthesis scaling function is the linear B-spline.
    LeGall53,
    /// 9/7, Cohen, Daubechies and Feauveau (1992), the lossy filter of JPEG 2000: four vanishing moments.
    Daubechies97,
}
