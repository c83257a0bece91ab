//! What the artist set, at a time. A parameter that a host does not have counts as its default.

use relume_core::relight::{Layer, Look};
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
    /// A lamp counted from 1, or `None` for the environment.
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
            method: settings::method(source.choice(&settings::RECONSTRUCTION)),
            outside: settings::outside(source.choice(&settings::OUTSIDE)),
            centre: settings::map_centre(source.choice(&settings::MAP_CENTRE)),
            heading_deg: source.number(&settings::ROTATION),
            exposure_ev: source.number(&settings::EXPOSURE),
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
        Self { asset, environment, lamp, look, output }
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
