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
//! | `reconstruction` | a method over one set of lamps |
//! | `texels`, `sparse` | functions integrated over the texels of a map |
//! | `operator` | both together: `downsample` and `upsample` |

mod basis;
mod delaunay;
mod linear;
mod operator;
mod reconstruction;
mod sparse;
mod texels;
mod zero_order;

pub use operator::Operator;
pub use reconstruction::Reconstruction;

/// How the reflectance function is filled in between the lamps.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Method {
    /// Each direction takes the sample of the nearest lamp (spherical Voronoi cells, 4.3.1).
    ZeroOrder,
    /// Barycentric in the spherical Delaunay triangle (4.3.2).
    #[default]
    Linear,
}

impl Method {
    /// Every method, in permanent order.
    pub const ALL: &'static [Self] = &[Self::ZeroOrder, Self::Linear];

    /// Permanent name for command lines and files.
    pub fn id(self) -> &'static str {
        match self {
            Self::ZeroOrder => "zero-order",
            Self::Linear => "linear",
        }
    }

    /// Name for people.
    pub fn label(self) -> &'static str {
        match self {
            Self::ZeroOrder => "Zero-order",
            Self::Linear => "Linear",
        }
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
