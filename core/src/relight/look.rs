//! What a user can turn.

use crate::field::Kind;
use crate::illumination::MapCentre;
use crate::image::ColourSpace;
use crate::math::Orientation;
use crate::reconstruct::{Method, Outside};

/// What a user can turn, with neutral defaults.
///
/// A map is clamped, blurred and turned, in this order; its projection is then converted to the colours of the asset, tinted
/// and exposed; the picture, ambient included, is converted to the colours asked for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Look {
    /// The representation to use; `None` for the best that the light allows ([`Relighter::choose`]).
    ///
    /// [`Relighter::choose`]: super::Relighter::choose
    pub representation: Option<Kind>,
    /// How the reflectance function is filled in. Wavelets were rebuilt when they were compressed.
    pub method: Method,
    /// What becomes of light outside the coverage.
    pub outside: Outside,
    /// What stands in the middle column of the map.
    pub centre: MapCentre,
    /// Heading of the light in degrees about +y, right-handed; see [`Orientation`] for the three angles.
    pub heading_deg: f64,
    /// Pitch of the light in degrees about +x, applied before the heading.
    pub pitch_deg: f64,
    /// Roll of the light in degrees about +z, applied before the pitch.
    pub roll_deg: f64,
    /// Exposure of the light in stops; the ambient is not scaled.
    pub exposure_ev: f64,
    /// What each channel of the light is multiplied by, in the colours of the asset; the ambient is not tinted.
    pub tint: [f64; 3],
    /// Standard deviation, in degrees, of the Gaussian on the sphere that a map is blurred with; 0 is sharp.
    pub blur_deg: f64,
    /// The largest radiance of a map: brighter texels are scaled down, hue kept ([`EnvMap::clamped`]); 0 is no limit.
    ///
    /// [`EnvMap::clamped`]: crate::illumination::EnvMap::clamped
    pub clamp: f64,
    /// The colours of a map. A captured lamp has those of the asset.
    pub map_space: ColourSpace,
    /// The colours of the picture.
    pub output_space: ColourSpace,
    /// g in `T L + g S`.
    pub ambient: f64,
}

impl Default for Look {
    fn default() -> Self {
        Self {
            representation: None,
            method: Method::default(),
            outside: Outside::default(),
            centre: MapCentre::default(),
            heading_deg: 0.0,
            pitch_deg: 0.0,
            roll_deg: 0.0,
            exposure_ev: 0.0,
            tint: [1.0; 3],
            blur_deg: 0.0,
            clamp: 0.0,
            map_space: ColourSpace::default(),
            output_space: ColourSpace::default(),
            ambient: 0.0,
        }
    }
}

impl Look {
    /// How the light is turned.
    pub fn orientation(&self) -> Orientation {
        Orientation { heading_deg: self.heading_deg, pitch_deg: self.pitch_deg, roll_deg: self.roll_deg }
    }

    /// Tint and exposure together: what each channel of a light's weights is multiplied by.
    pub fn gain(&self) -> [f32; 3] {
        self.tint.map(|tint| self.exposure_ev.exp2() as f32 * tint as f32)
    }

    /// The part that weights depend on: looks that are equal in it share their weights.
    pub fn of_weights(&self) -> Self {
        Self { ambient: 0.0, output_space: ColourSpace::default(), ..*self }
    }
}
