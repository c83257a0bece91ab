//! Which place of a screen each pixel sees (6.3): binary patterns of columns and rows -> places -> a [`Correspondence`].
//!
//! ```text
//! patterns -> Shown (which columns or rows are lit) -> Tree (what the next bit tells)
//! photographs -> decode -> a place for every pixel that sees the screen, directly or not
//!             -> sightings -> fit: RANSAC of a homography, then a cubic residual -> Correspondence
//! stripes held out of the fit -> edges -> how far off, in pixels
//! ```
//!
//! Patterns are known by what they show and not by their names: Gray codes, plain binary codes and stripes, with inverses or
//! without, in any order, with white and black pictures or without.
//!
//! | part | what it holds |
//! |---|---|
//! | `shown` | a pattern as the columns or rows that it lights |
//! | `tree` | from bits to places |
//! | `decode` | photographs to places |
//! | `fit` | places to a correspondence, outliers left out |
//! | `edges` | edges of stripes, between pixels |
//!
//! [`Correspondence`]: crate::domain::Correspondence

mod decode;
mod edges;
mod fit;
mod shown;
mod tree;

pub use decode::{Decoded, Line, Place, decode, lines};
pub use edges::{HeldOut, held_out};
pub use fit::{Fit, Sighting, Spread, fit};
pub use shown::{Along, Shown};
