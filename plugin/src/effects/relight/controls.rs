//! What the artist set, at a time. A parameter that a host does not have counts as its default.

use relume_core::relight::{Layer, Look};
use relume_core::settings;
use relume_core::settings::lighting::{PRESETS, Preset};
use relume_core::settings::near::{self, Thrown};
use relume_core::settings::{Setting, light4d};

use crate::effects::values::Values;
use crate::host::Effect;

/// What the output shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Output {
    /// The element over Source.
    Composite,
    /// The element alone.
    Element,
    /// A layer of the asset, which needs no light: alpha in all four channels, normals, albedo.
    Layer(Layer),
}

/// Light near the object.
#[derive(Debug, Clone, PartialEq)]
pub struct Near {
    /// The light file's path as typed.
    pub file: String,
    /// A light field that ships, or `None`.
    pub preset: Option<&'static light4d::Preset>,
    /// Beams that are on, by number.
    pub beams: [Option<Thrown>; 4],
    /// The slide's path as typed; a slide without one is off.
    pub slide: String,
    /// How the slide is thrown.
    pub thrown: Thrown,
    /// As at the origin everywhere.
    pub flat: bool,
}

impl Near {
    fn read(values: &Values<'_>) -> Self {
        let place = |settings: &[Setting; 3]| [0, 1, 2].map(|n| values.number(&settings[n]));
        let beam = |settings: &near::BeamSettings| Thrown {
            position: place(&settings.position),
            aim: place(&settings.aim),
            angle_deg: values.number(&settings.angle),
            edge_deg: values.number(&settings.edge),
            turn_deg: 0.0,
            colour: values.colour(&settings.colour),
            stops: values.number(&settings.stops),
        };
        Self {
            file: values.text(&near::LIGHT4D_FILE),
            preset: values.choice(&near::LIGHT4D).checked_sub(1).and_then(|n| light4d::PRESETS.get(n)),
            beams: near::BEAMS.map(|settings| (values.choice(&settings.on) == 1).then(|| beam(&settings))),
            slide: values.text(&near::SLIDE),
            thrown: Thrown {
                position: place(&near::SLIDE_POSITION),
                aim: place(&near::SLIDE_AIM),
                angle_deg: values.number(&near::SLIDE_VIEW),
                edge_deg: 0.0,
                turn_deg: values.number(&near::SLIDE_TURN),
                colour: [1.0; 3],
                stops: values.number(&near::SLIDE_STOPS),
            },
            flat: values.choice(&near::SPACE) == 1,
        }
    }

    /// The light file, if one is typed.
    pub fn file(&self) -> Option<&str> {
        Some(self.file.trim()).filter(|typed| !typed.is_empty())
    }

    /// The slide, if one is typed.
    pub fn slide(&self) -> Option<&str> {
        Some(self.slide.trim()).filter(|typed| !typed.is_empty())
    }

    /// Is there any?
    pub fn is_on(&self) -> bool {
        self.file().or(self.slide()).is_some() || self.preset.is_some() || self.beams.iter().any(Option::is_some)
    }
}

/// All parameters at one time.
#[derive(Debug, Clone, PartialEq)]
pub struct Controls {
    /// The asset's path as typed.
    pub asset: String,
    /// The environment's path as typed.
    pub environment: String,
    /// The lighting file's path as typed.
    pub lighting_file: String,
    /// A lighting that ships, or `None`.
    pub lighting: Option<&'static Preset>,
    /// What lights from near.
    pub near: Near,
    /// A lamp counted from 1, or `None` for another light.
    pub lamp: Option<usize>,
    /// How light becomes a picture.
    pub look: Look,
    /// What is shown.
    pub output: Output,
}

impl Controls {
    /// Reads every parameter.
    pub fn read(effect: &Effect<'_>, time: f64) -> Self {
        let values = Values::at(effect, time);
        let lamp = usize::try_from(values.integer(&settings::LAMP)).ok().filter(|lamp| *lamp > 0);
        let look = Look {
            representation: settings::representation(values.choice(&settings::REPRESENTATION)),
            method: settings::method(values.choice(&settings::RECONSTRUCTION)),
            outside: settings::outside(values.choice(&settings::OUTSIDE)),
            centre: settings::map_centre(values.choice(&settings::MAP_CENTRE)),
            heading_deg: values.number(&settings::ROTATION),
            pitch_deg: values.number(&settings::PITCH),
            roll_deg: values.number(&settings::ROLL),
            exposure_ev: values.number(&settings::EXPOSURE),
            tint: values.colour(&settings::TINT),
            blur_deg: values.number(&settings::BLUR),
            clamp: values.number(&settings::CLAMP),
            map_space: settings::colour_space(values.choice(&settings::MAP_SPACE)),
            output_space: settings::colour_space(values.choice(&settings::OUTPUT_SPACE)),
            ambient: values.number(&settings::AMBIENT),
        };
        let output = match values.choice(&settings::OUTPUT) {
            1 => Output::Element,
            2 => Output::Layer(Layer::Alpha),
            3 => Output::Layer(Layer::Normals),
            4 => Output::Layer(Layer::Albedo),
            _ => Output::Composite,
        };
        let (asset, environment) = (values.text(&settings::ASSET), values.text(&settings::ENVIRONMENT));
        let lighting_file = values.text(&settings::LIGHTING_FILE);
        // The first choice is none.
        let lighting = values.choice(&settings::LIGHTING).checked_sub(1).and_then(|n| PRESETS.get(n));
        let near = Near::read(&values);
        Self { asset, environment, lighting_file, lighting, near, lamp, look, output }
    }
}

impl Controls {
    /// The lighting file, if one is typed.
    pub fn lighting_file(&self) -> Option<&str> {
        Some(self.lighting_file.trim()).filter(|typed| !typed.is_empty())
    }
}
