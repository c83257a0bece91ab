//! What the artist set, at a time. A parameter that a host does not have counts as its default.

use relume_core::relight::{Layer, Look};
use relume_core::settings::lighting::{PRESETS, Preset};
use relume_core::settings::{self, Kind, Setting};

use crate::host::{Effect, Params};

/// Where the slider of the lamp ends.
pub const LAMP_SLIDER_END: i32 = 500;

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
        let source = Source { params: effect.params(), time };
        let lamp = usize::try_from(source.integer(&settings::LAMP)).ok().filter(|lamp| *lamp > 0);
        let look = Look {
            representation: settings::representation(source.choice(&settings::REPRESENTATION)),
            method: settings::method(source.choice(&settings::RECONSTRUCTION)),
            outside: settings::outside(source.choice(&settings::OUTSIDE)),
            centre: settings::map_centre(source.choice(&settings::MAP_CENTRE)),
            heading_deg: source.number(&settings::ROTATION),
            pitch_deg: source.number(&settings::PITCH),
            roll_deg: source.number(&settings::ROLL),
            exposure_ev: source.number(&settings::EXPOSURE),
            tint: source.colour(&settings::TINT),
            blur_deg: source.number(&settings::BLUR),
            clamp: source.number(&settings::CLAMP),
            map_space: settings::colour_space(source.choice(&settings::MAP_SPACE)),
            output_space: settings::colour_space(source.choice(&settings::OUTPUT_SPACE)),
            ambient: source.number(&settings::AMBIENT),
        };
        let output = match source.choice(&settings::OUTPUT) {
            1 => Output::Element,
            2 => Output::Layer(Layer::Alpha),
            3 => Output::Layer(Layer::Normals),
            4 => Output::Layer(Layer::Albedo),
            _ => Output::Composite,
        };
        let (asset, environment) = (source.text(&settings::ASSET), source.text(&settings::ENVIRONMENT));
        let lighting_file = source.text(&settings::LIGHTING_FILE);
        // The first choice is none.
        let lighting = source.choice(&settings::LIGHTING).checked_sub(1).and_then(|n| PRESETS.get(n));
        Self { asset, environment, lighting_file, lighting, lamp, look, output }
    }
}

impl Controls {
    /// The lighting file, if one is typed.
    pub fn lighting_file(&self) -> Option<&str> {
        Some(self.lighting_file.trim()).filter(|typed| !typed.is_empty())
    }
}

/// Where values come from.
struct Source<'a> {
    params: Option<Params<'a>>,
    time: f64,
}

impl Source<'_> {
    /// Clamped to the hard range: scripts and expressions get past a host's own check.
    fn number(&self, setting: &Setting) -> f64 {
        let Kind::Number { default, hard, .. } = setting.kind else { return 0.0 };
        let value = self.params.and_then(|p| p.double(setting.id, self.time));
        value.unwrap_or(default).clamp(hard.0, hard.1)
    }

    /// Clamped like numbers.
    fn colour(&self, setting: &Setting) -> [f64; 3] {
        let Kind::Colour { default, hard, .. } = setting.kind else { return [1.0; 3] };
        let value = self.params.and_then(|p| p.rgb(setting.id, self.time));
        value.unwrap_or(default).map(|v| v.clamp(hard.0, hard.1))
    }

    fn integer(&self, setting: &Setting) -> i32 {
        let Kind::Integer { default, hard } = setting.kind else { return 0 };
        let value = self.params.and_then(|p| p.int(setting.id, self.time));
        value.unwrap_or(default).clamp(hard.0, hard.1)
    }

    fn choice(&self, setting: &Setting) -> usize {
        let Kind::Choice { default, options } = setting.kind else { return 0 };
        let value = self.params.and_then(|p| p.int(setting.id, self.time));
        value.and_then(|v| usize::try_from(v).ok()).filter(|v| *v < options.len()).unwrap_or(default)
    }

    fn text(&self, setting: &Setting) -> String {
        self.params.and_then(|p| p.string(setting.id, self.time)).unwrap_or_default()
    }
}
