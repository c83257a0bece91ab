//! Values of the settings, at a time. A parameter that a host does not have counts as its default.

use relume_core::settings::{Kind, Setting};

use crate::host::{Effect, Params};

/// Where values come from.
pub struct Values<'a> {
    params: Option<Params<'a>>,
    time: f64,
}

impl<'a> Values<'a> {
    /// The values of an instance.
    pub fn at(effect: &Effect<'a>, time: f64) -> Self {
        Self { params: effect.params(), time }
    }

    /// Clamped to the hard range: scripts and expressions get past a host's own check.
    pub fn number(&self, setting: &Setting) -> f64 {
        let Kind::Number { default, hard, .. } = setting.kind else { return 0.0 };
        let value = self.params.and_then(|p| p.double(setting.id, self.time));
        value.unwrap_or(default).clamp(hard.0, hard.1)
    }

    /// Clamped like numbers.
    pub fn colour(&self, setting: &Setting) -> [f64; 3] {
        let Kind::Colour { default, hard, .. } = setting.kind else { return [1.0; 3] };
        let value = self.params.and_then(|p| p.rgb(setting.id, self.time));
        value.unwrap_or(default).map(|v| v.clamp(hard.0, hard.1))
    }

    /// Clamped like numbers.
    pub fn integer(&self, setting: &Setting) -> i32 {
        let Kind::Integer { default, hard } = setting.kind else { return 0 };
        let value = self.params.and_then(|p| p.int(setting.id, self.time));
        value.unwrap_or(default).clamp(hard.0, hard.1)
    }

    /// The number of an option.
    pub fn choice(&self, setting: &Setting) -> usize {
        let Kind::Choice { default, options } = setting.kind else { return 0 };
        let value = self.params.and_then(|p| p.int(setting.id, self.time));
        value.and_then(|v| usize::try_from(v).ok()).filter(|v| *v < options.len()).unwrap_or(default)
    }

    /// As typed.
    pub fn text(&self, setting: &Setting) -> String {
        self.params.and_then(|p| p.string(setting.id, self.time)).unwrap_or_default()
    }
}
