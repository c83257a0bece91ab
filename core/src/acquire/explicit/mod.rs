//! Explicit sampling (6.6): basis functions are shown one after another, and what is seen decides which come next.
//!
//! ```text
//! Growth: a location -> its patterns are shown, photographs developed -> Parts: C = T psi -> Measure: ||C||, noise
//!    ^                                                                                            |
//!    +------------------------------- weight(v) ||C||, summed over the place's orientations <-----+
//! ```
//!
//! `psi` is a column of S in the constant-energy normalisation, so that `T L = sum_j a_j C_j` with `a = A L`. Functions are
//! shown scaled to the range of the screen; [`PatternSet::scale`](crate::domain::patterns::PatternSet::scale) undoes that.
//!
//! | part | what it holds |
//! |---|---|
//! | [`Growth`], [`Weight`] | the greedy progressive tree over places (eq. 6.2, 6.6; figures 6.11, 6.12) |
//! | [`Parts`] | two photographs -> `C` (6.6.4) |
//! | [`Measure`], [`Norm`] | `||C||_2` over covered pixels, and how much of it is noise |
//! | [`Noise`] | what a photograph strays by, from two of the same |
//! | [`Bound`] | what is left of the bound (6.7) on the error of any relit picture |

mod bound;
mod growth;
mod noise;
mod response;

pub use bound::Bound;
pub use growth::{Growth, Weight};
pub use noise::Noise;
pub use response::{Measure, Norm, Parts};
