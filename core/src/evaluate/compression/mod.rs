//! How well few wavelet coefficients stand for reflectance functions (5.4, figures 5.6 to 5.8; 6.4 and 6.5).
//!
//! Functions are rebuilt on a grid of longitudes x angles from the axis, transformed, and decoded again from some of their
//! coefficients; the three channels of a pixel are one function v, and share the set. Errors of the decoded function v' are
//! relative ones, `||v' - v|| / ||v||`, in two norms:
//!
//! - L2, `||v||^2 = v^T v`;
//! - Sobolev H1, `||v||^2 + ||grad v||^2` (5.4), which sees lost smoothness too. grad v holds the differences to the next
//!   column and to the next row: the thesis writes one index, `v_i - v_(i+1)`; on a grid we take both axes, so that an edge
//!   counts whichever way it runs. Longitude goes round, the last row has no next.
//!
//! Texels count alike, as they do in the thesis: no solid angles. *Over time* the function is what a pixel shows under a
//! sliver of light that turns about the object, one value a heading, and H1 takes differences from heading to heading, all
//! round.
//!
//! | part | what it holds |
//! |---|---|
//! | `functions` | reflectance functions of some pixels, rebuilt on the grid |
//! | `codec` | coefficients of a function, how many are needed, and what they decode to |
//! | `norms` | L2 and H1 |
//! | `sweep` | a turning sliver of light over functions on the grid |
//! | `measure` | errors by count, by threshold and by way of choosing; pictures over time |

mod codec;
mod functions;
mod measure;
mod norms;
mod sweep;

pub use codec::{Budget, Codec};
pub use functions::Functions;
pub use measure::{Figures, OverTime, approximations, errors, over_time};
pub use sweep::Sweep;

#[cfg(test)]
mod tests;
