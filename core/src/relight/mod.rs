//! Weights x field -> picture: `C = T L + g S`.
//!
//! A light is projected once to one RGB weight a lamp ([`Relighter::weights`]); then every block of the field is streamed
//! once ([`apply`]), for one illumination or several, for the whole picture or a window. What goes from pixels to lamps is the
//! [`adjoint`].
//!
//! | part | what it holds |
//! |---|---|
//! | `kernels` | block x weights -> 128 sums: the plain loop, and SIMD chosen at run time |
//! | `apply` | the loop over blocks, on all threads |
//! | `factored` | the same for tiles of low rank |
//! | `sparse` | the gather from a transformed light |
//! | `strips` | pictures made row of blocks by row of blocks, on all threads |
//! | `look` | what a user can turn |
//! | `adjoint` | `T^T c`: the same loops the other way |
//! | `dual` | pictures from the side of the light |
//! | `prepare` | a map clamped, blurred and turned as a look has it |
//! | `projections` | maps and beams to weights, with the structures kept |
//! | `choice` | which of an asset's representations is used |
//! | `element` | `T L + g S` by whichever representation |
//! | `relighter` | an asset of lamps and its projections |
//! | `screen` | an asset of a screen |
//! | `layers` | pictures that no light makes: coverage, normals, albedo, ambient |

mod adjoint;
mod apply;
mod choice;
mod dual;
mod element;
mod factored;
pub mod kernels;
mod layers;
mod look;
mod prepare;
mod projections;
mod relighter;
mod screen;
mod sparse;
mod strips;

use crate::field::Kind;
use crate::image::Conversion;

pub use adjoint::{Progress, adjoint, elements_of};
pub use apply::apply;
pub use dual::Dual;
pub use layers::{Layer, displayed_normals};
pub use look::Look;
pub use prepare::prepared;
pub use relighter::{Light, Relighter, WIDEST_MAP};
pub use screen::ScreenRelighter;

/// Weights of every lamp, RGB, for one picture: solid angle, exposure and colour of the light included.
#[derive(Debug, Clone, PartialEq)]
pub struct Weights {
    /// One RGB triple a lamp; a texel of the grid, for wavelets.
    pub rgb: Vec<[f32; 3]>,
    /// The representation that they are for.
    kind: Kind,
    /// What its coefficients are multiplied by, where those are not of lamps: another linear map of `rgb`.
    coefficients: Option<Vec<[f32; 3]>>,
}

impl Weights {
    /// For samples at the lamps, as photographed or decoded.
    pub fn of_lamps(rgb: Vec<[f32; 3]>) -> Self {
        Self { rgb, kind: Kind::Dense, coefficients: None }
    }

    /// Zero for all lamps.
    pub fn dark(lamps: usize) -> Self {
        Self::of_lamps(vec![[0.0; 3]; lamps])
    }

    /// The representation that they are for.
    pub fn kind(&self) -> Kind {
        self.kind
    }

    /// Multiplies each channel.
    pub fn scale(&mut self, gain: [f32; 3]) {
        let of = |w: &mut [f32; 3]| w.iter_mut().zip(gain).for_each(|(w, g)| *w *= g);
        self.rgb.iter_mut().chain(self.coefficients.iter_mut().flatten()).for_each(of);
    }

    /// Adds `gain` times other weights.
    ///
    /// # Panics
    /// When they are for another representation, or another number of lamps.
    pub fn add(&mut self, gain: f64, other: &Self) {
        assert!(self.kind == other.kind && self.rgb.len() == other.rgb.len(), "weights of one representation");
        let add = |sum: &mut [f32; 3], rgb: &[f32; 3]| {
            (0..3).for_each(|c| sum[c] = (f64::from(sum[c]) + gain * f64::from(rgb[c])) as f32);
        };
        self.rgb.iter_mut().zip(&other.rgb).for_each(|(sum, rgb)| add(sum, rgb));
        let coefficients = self.coefficients.iter_mut().flatten().zip(other.coefficients.iter().flatten());
        coefficients.for_each(|(sum, rgb)| add(sum, rgb));
    }

    /// The same light in another colour space.
    pub fn convert(&mut self, conversion: &Conversion) {
        if !conversion.is_identity() {
            let of = |w: &mut [f32; 3]| *w = conversion.apply(*w);
            self.rgb.iter_mut().chain(self.coefficients.iter_mut().flatten()).for_each(of);
        }
    }

    /// What stored numbers are multiplied by.
    fn factors(&self) -> &[[f32; 3]] {
        self.coefficients.as_deref().unwrap_or(&self.rgb)
    }

    /// One channel of the factors, element after element.
    fn channel(&self, c: usize, scale: f32) -> Vec<f32> {
        self.factors().iter().map(|rgb| rgb[c] * scale).collect()
    }
}

#[cfg(test)]
mod tests;
