//! Weights x field -> picture: `C = T L + g S`.
//!
//! A light is projected once to one RGB weight a lamp ([`Relighter::weights`]); then every block of the field is streamed
//! once ([`apply`]), for one illumination or several, for the whole picture or a window.
//!
//! | part | what it holds |
//! |---|---|
//! | `kernels` | block x weights -> 128 sums: the plain loop, and SIMD chosen at run time |
//! | `apply` | the loop over blocks, on all threads |
//! | `look` | what a user can turn |
//! | `prepare` | a map clamped, blurred and turned as a look has it |
//! | `projections` | maps and beams to weights, with the structures kept |
//! | `relighter` | an asset and its projections |
//! | `layers` | pictures that no light makes: coverage, normals, albedo, ambient |

mod apply;
pub mod kernels;
mod layers;
mod look;
mod prepare;
mod projections;
mod relighter;

use crate::image::Conversion;

pub use apply::apply;
pub use layers::{Layer, displayed_normals};
pub use look::Look;
pub use prepare::prepared;
pub use relighter::{Light, Relighter, WIDEST_MAP};

/// Weights of every element, RGB, for one picture: solid angle, exposure and colour of the light included.
#[derive(Debug, Clone, PartialEq)]
pub struct Weights {
    /// One RGB triple a lamp.
    pub rgb: Vec<[f32; 3]>,
}

impl Weights {
    /// Zero for all.
    pub fn dark(elements: usize) -> Self {
        Self { rgb: vec![[0.0; 3]; elements] }
    }

    /// Multiplies each channel.
    pub fn scale(&mut self, gain: [f32; 3]) {
        self.rgb.iter_mut().for_each(|w| w.iter_mut().zip(gain).for_each(|(w, g)| *w *= g));
    }

    /// The same light in another colour space.
    pub fn convert(&mut self, conversion: &Conversion) {
        if !conversion.is_identity() {
            self.rgb.iter_mut().for_each(|w| *w = conversion.apply(*w));
        }
    }

    /// One channel, element after element.
    fn channel(&self, c: usize, scale: f32) -> Vec<f32> {
        self.rgb.iter().map(|rgb| rgb[c] * scale).collect()
    }
}

#[cfg(test)]
mod tests;
