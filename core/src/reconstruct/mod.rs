//! Reconstruction of sampled reflectance functions (4.3), used as downsampling of the illumination (4.4.2).
//!
//! A method gives kernels `U_j(w)`, one a lamp, that sum to one everywhere in the coverage. Upsampling a reflectance
//! function and relighting with the full map equals downsampling the map and relighting with the samples:
//! `(T U) L' = T (U L')` (eq. 4.7). So a method is one [`Kernel`], and an [`Operator`] is that kernel integrated over the
//! texels of a map: `U[j, texel] = integral over the texel of U_j(w) dw`, in steradians; solid angle (the thesis's
//! Jacobian, 2.3) lives here and nowhere else.
//!
//! | part | what it holds |
//! |---|---|
//! | `kernel` | the trait, and what a direction answers |
//! | `zero_order` | spherical Voronoi cells (4.3.1) |
//! | `delaunay`, `linear` | spherical Delaunay triangles and barycentric weights (4.3.2) |
//! | `operator` | texels x lamps, `downsample` and `upsample` |

mod delaunay;
mod kernel;
mod linear;
mod operator;
mod zero_order;

pub use kernel::{Kernel, Stencil};
pub use linear::Linear;
pub use operator::Operator;
pub use zero_order::ZeroOrder;

use crate::domain::Directions;

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
    /// The kernels of this method for a set of lamps.
    pub fn kernel<'a>(self, domain: &'a Directions) -> Box<dyn Kernel + 'a> {
        match self {
            Method::ZeroOrder => Box::new(ZeroOrder::new(domain)),
            Method::Linear => Box::new(Linear::new(domain)),
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
