//! Reconstruction of sampled reflectance functions (4.3), used as downsampling of the illumination (4.4.2).
//!
//! A method gives kernels `U_j(w)`, one a lamp, that sum to one everywhere in the coverage. Upsampling a reflectance
//! function and relighting with the full map equals downsampling the map and relighting with the samples:
//! `(T U) L' = T (U L')` (eq. 4.7). Every method is linear in the samples t, so it is some functions of direction
//! `phi_b(w)` and a matrix `F` that makes their coefficients, `U_j(w) = sum_b F_bj phi_b(w)`: to downsample is to integrate
//! the map times each function over the texels, in steradians, and to apply `F^T`. Solid angle (the thesis's Jacobian,
//! 2.3) lives in those integrals and nowhere else.
//!
//! | part | what it holds |
//! |---|---|
//! | `basis` | what a method is made of: functions, and the fit |
//! | `zero_order` | spherical Voronoi cells (4.3.1) |
//! | `delaunay`, `linear` | spherical Delaunay triangles and barycentric weights (4.3.2) |
//! | `inverse_distance` | Shepard's weights of the 32 nearest (4.3.3) |
//! | `harmonics`, `harmonic_moments` | spherical harmonics by least squares (4.3.4), and their separable integrals |
//! | `wavelet_grid` | scaling functions on a grid of longitudes and latitudes (4.3.5) |
//! | `lattice`, `spline` | multi-level B-splines on paraboloid maps (4.3.6) |
//! | `reconstruction` | a method over one set of lamps |
//! | `texels`, `sparse` | functions integrated over the texels of a map |
//! | `operator` | both together: `downsample` and `upsample` |
//! | `squares` | 4D light onto the squares of a projector (7.2) |
//! | `resampling` | many functions rebuilt at once, at the same directions |

mod basis;
mod delaunay;
mod harmonic_moments;
mod harmonics;
mod inverse_distance;
mod lattice;
mod linear;
mod operator;
mod reconstruction;
mod resampling;
mod sparse;
mod spline;
mod squares;
mod texels;
mod wavelet_grid;
mod zero_order;

pub use operator::Operator;
pub use reconstruction::Reconstruction;
pub use resampling::Resampling;
pub use squares::Squares;

use crate::wavelet::Wavelet;

/// How the reflectance function is filled in between the lamps.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Method {
    /// Each direction takes the sample of the nearest lamp (spherical Voronoi cells, 4.3.1).
    ZeroOrder,
    /// Barycentric in the spherical Delaunay triangle (4.3.2).
    #[default]
    Linear,
    /// The 32 nearest lamps, weighted by the inverse square of the angle (4.3.3).
    InverseDistance,
    /// Spherical harmonics of some bands, bands squared functions, fitted by least squares (4.3.4).
    Harmonics {
        /// 5, 15 or 25 in the thesis.
        bands: u32,
    },
    /// The scaling functions of a wavelet, Haar, 5/3 or 9/7; needs lamps on a grid of longitudes and latitudes (4.3.5).
    Wavelet(Wavelet),
    /// Multi-level B-splines (4.3.6).
    BSpline,
}

impl Method {
    /// Every method that a user can choose, in permanent order.
    pub const ALL: &'static [Self] = &[
        Self::ZeroOrder,
        Self::Linear,
        Self::InverseDistance,
        Self::Harmonics { bands: 5 },
        Self::Harmonics { bands: 15 },
        Self::Harmonics { bands: 25 },
        Self::Wavelet(Wavelet::Haar),
        Self::Wavelet(Wavelet::LeGall53),
        Self::Wavelet(Wavelet::Daubechies97),
        Self::BSpline,
    ];

    /// Permanent names for command lines and files, and names for people, in the order of [`Method::ALL`].
    pub const NAMES: &'static [(&'static str, &'static str)] = &[
        ("zero-order", "Zero-order"),
        ("linear", "Linear"),
        ("inverse-distance", "Inverse distance"),
        ("harmonics-25", "25 spherical harmonics"),
        ("harmonics-225", "225 spherical harmonics"),
        ("harmonics-625", "625 spherical harmonics"),
        ("haar", "Haar wavelet"),
        ("5/3", "5/3 wavelet"),
        ("9/7", "9/7 wavelet"),
        ("b-spline", "Multi-level B-spline"),
    ];

    /// The permanent name of one of [`Method::ALL`]; empty for another.
    pub fn id(self) -> &'static str {
        self.names().0
    }

    /// The name for people of one of [`Method::ALL`]; empty for another.
    pub fn label(self) -> &'static str {
        self.names().1
    }

    fn names(self) -> (&'static str, &'static str) {
        Self::ALL.iter().position(|method| *method == self).map_or(("", ""), |n| Self::NAMES[n])
    }
}

/// What becomes of light from outside the coverage of the lamps.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Outside {
    /// It is dropped.
    #[default]
    Drop,
    /// It is given to the nearest lamp.
    Nearest,
}

#[cfg(test)]
mod tests;
