//! Environment matting: an object in front of a screen, put before another picture (6.2, 6.6.4).
//!
//! ```text
//! plate --placed, through the correspondence--> light L of each texel --> T L + g S = element, premultiplied
//! composite = element, placed + (1 - alpha) plate
//! ```
//!
//! Where the object stood in front of the screen, the plate takes the screen's place: what the camera saw of the screen at a
//! pixel is the plate at that pixel, and the light of a texel is what the plate shows where the texel was seen, or would have
//! been.
//!
//! | part | what it holds |
//! |---|---|
//! | [`alpha`] | how much of a pixel the object covers |
//! | `behind` | what the camera sees of the screen itself |
//! | `place` | where the object stands in the plate |
//! | `backdrop` | from a plate to the light of the screen's texels |
//! | `composite` | the element in the plate, and over it |

pub mod alpha;
mod backdrop;
mod behind;
mod composite;
mod place;

pub use backdrop::{Backdrop, Beyond};
pub use behind::Behind;
pub use composite::{Composite, Show};
pub use place::Place;

#[cfg(test)]
mod tests;
