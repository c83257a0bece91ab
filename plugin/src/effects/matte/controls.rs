//! What the artist set, at a time. A parameter that a host does not have counts as its default.

use relume_core::illumination::MapCentre;
use relume_core::matte::{Place, Show};
use relume_core::relight::Look;
use relume_core::settings::{self, matte};

use crate::effects::values::Values;
use crate::host::Effect;

/// What lies beyond the plate.
#[derive(Debug, Clone, PartialEq)]
pub enum Beyond {
    /// Its edge goes on.
    Stretch,
    /// A colour, in those of the plate.
    Colour([f32; 3]),
    /// A lat-long map: its path as typed, what stands in its middle, and the plate's horizontal angle in degrees.
    Map(String, MapCentre, f64),
}

/// All parameters at one time.
#[derive(Debug, Clone, PartialEq)]
pub struct Controls {
    /// The asset's path as typed.
    pub asset: String,
    /// Where the object stands in the plate, at full scale.
    pub place: Place,
    /// What lies beyond the plate.
    pub beyond: Beyond,
    /// How light becomes a picture. Plate and picture have the same colours.
    pub look: Look,
    /// What is shown.
    pub show: Show,
}

impl Controls {
    /// Reads every parameter.
    pub fn read(effect: &Effect<'_>, time: f64) -> Self {
        let values = Values::at(effect, time);
        let colours = settings::colour_space(values.choice(&settings::OUTPUT_SPACE));
        let look = Look {
            representation: matte::representation(values.choice(&matte::REPRESENTATION)),
            exposure_ev: values.number(&settings::EXPOSURE),
            tint: values.colour(&settings::TINT),
            ambient: values.number(&settings::AMBIENT),
            map_space: colours,
            output_space: colours,
            ..Look::default()
        };
        let position = [&matte::POSITION_X, &matte::POSITION_Y].map(|setting| values.number(setting));
        let place = matte::place(position, values.number(&matte::SCALE), values.number(&matte::ROTATE));
        let beyond = match values.choice(&matte::BEYOND) {
            1 => Beyond::Colour(values.colour(&matte::BEYOND_COLOUR).map(|v| v as f32)),
            2 => {
                let centre = settings::map_centre(values.choice(&settings::MAP_CENTRE));
                Beyond::Map(values.text(&matte::BEYOND_MAP), centre, values.number(&matte::VIEW_ANGLE))
            }
            _ => Beyond::Stretch,
        };
        let show = matte::show(values.choice(&matte::OUTPUT));
        Self { asset: values.text(&settings::ASSET), place, beyond, look, show }
    }
}
