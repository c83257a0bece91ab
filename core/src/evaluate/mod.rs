//! Errors and figures.
//!
//! | part | what it holds |
//! |---|---|
//! | `compare` | how far one picture is from another |
//! | `subset` | a set of lamps thinned, to judge what is filled in between (4.4.1) |
//! | [`reconstruction`] | relative errors of rebuilt reflectance functions, for every method |
//! | [`pixel_sets`] | diffuse, glossy and shadowed pixels, from their reflectance functions |
//! | [`sliver`] | a turning sliver of light: a column of the picture over time (figures 4.17 and 4.18) |
//! | [`compression`] | errors of reflectance functions of few wavelet coefficients |
//! | [`explicit`] | errors of relit pictures, by the number of functions of explicit sampling (6.6.5) |
//! | [`mod@reference`] | relit pictures against photographs under the same picture on a screen (6.3) |
//! | [`implicit`] | errors of implicit sampling, by terms and patterns (figure 6.30) |
//! | [`separable`] | errors of squares recovered from sets of them, and of the map that tells (7.5) |
//! | `relit` | errors of relit pictures, by lamps left out |
//! | `representations` | errors of relit pictures, by compact representations |
//! | `blocks` | the field, block by block, in bounded memory |

mod blocks;
mod compare;
pub mod compression;
pub mod explicit;
pub mod implicit;
pub mod pixel_sets;
pub mod reconstruction;
pub mod reference;
mod relit;
mod representations;
pub mod separable;
pub mod sliver;
mod subset;
#[cfg(test)]
mod testing;

pub use blocks::Progress;
pub use compare::{Comparison, compare};
pub use relit::relit_errors;
pub use representations::relit_against;
pub use subset::{FEWEST_KEPT, Keep, Rule, Subset};
