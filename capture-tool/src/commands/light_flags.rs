//! Flags that several commands share: what a user can do to a map, and to any light.

use clap::Args;
use relume_core::image::ColourSpace;
use relume_core::relight::Look;
use relume_core::settings;

use super::values;

/// What is done to a map.
#[derive(Debug, Args)]
pub(super) struct MapFlags {
    #[arg(long, value_name = "DEG", help = settings::ROTATION.hint,
          allow_negative_numbers = true, value_parser = values::number(&settings::ROTATION),
          default_value_t = values::neutral(&settings::ROTATION))]
    rotate: f64,
    #[arg(long, value_name = "DEG", help = settings::PITCH.hint,
          allow_negative_numbers = true, value_parser = values::number(&settings::PITCH),
          default_value_t = values::neutral(&settings::PITCH))]
    pitch: f64,
    #[arg(long, value_name = "DEG", help = settings::ROLL.hint,
          allow_negative_numbers = true, value_parser = values::number(&settings::ROLL),
          default_value_t = values::neutral(&settings::ROLL))]
    roll: f64,
    #[arg(long, value_name = "SIDE", help = settings::MAP_CENTRE.hint,
          value_parser = values::choice(&settings::MAP_CENTRE),
          default_value = values::neutral_option(&settings::MAP_CENTRE))]
    map_centre: usize,
    /// The colour space of the map: lin_rec709, lin_rec2020, acescg, aces2065_1 or lin_p3d65.
    #[arg(long, value_name = "SPACE", value_parser = values::colour_space, default_value_t = ColourSpace::default())]
    map_space: ColourSpace,
    #[arg(long, value_name = "DEG", help = settings::BLUR.hint,
          allow_negative_numbers = true, value_parser = values::number(&settings::BLUR),
          default_value_t = values::neutral(&settings::BLUR))]
    blur: f64,
    #[arg(long, value_name = "RADIANCE", help = settings::CLAMP.hint,
          allow_negative_numbers = true, value_parser = values::number(&settings::CLAMP),
          default_value_t = values::neutral(&settings::CLAMP))]
    clamp: f64,
}

/// The ids of [`MapFlags`], for a command whose other lights they mean nothing to.
pub(super) const MAP_FLAGS: [&str; 7] = ["rotate", "pitch", "roll", "map_centre", "map_space", "blur", "clamp"];

/// Those of [`MAP_FLAGS`] that mean nothing to lamps, which turn but are no map.
pub(super) const TEXEL_FLAGS: [&str; 4] = ["map_centre", "map_space", "blur", "clamp"];

/// What means nothing to a picture on a screen.
pub(super) const LAT_LONG_FLAGS: [&str; 9] =
    ["exclude", "reconstruct", "rotate", "pitch", "roll", "map_centre", "blur", "clamp", "outside"];

/// All flags that shape light, for a picture that is lit by none.
pub(super) const LIGHT_FLAGS: [&str; 14] = [
    "exclude",
    "reconstruct",
    "rotate",
    "pitch",
    "roll",
    "map_centre",
    "map_space",
    "blur",
    "clamp",
    "outside",
    "exposure",
    "tint",
    "ambient",
    "output_space",
];

/// What is done to any light, and to what comes out.
#[derive(Debug, Args)]
pub(super) struct GainFlags {
    #[arg(long, value_name = "EV", help = settings::EXPOSURE.hint,
          allow_negative_numbers = true, value_parser = values::number(&settings::EXPOSURE),
          default_value_t = values::neutral(&settings::EXPOSURE))]
    exposure: f64,
    #[arg(long, value_name = "R,G,B", help = settings::TINT.hint,
          allow_hyphen_values = true, value_parser = values::colour(&settings::TINT),
          default_value = "1,1,1")]
    tint: [f64; 3],
    /// The colour space of the output: lin_rec709, lin_rec2020, acescg, aces2065_1 or lin_p3d65. EXR files tell it.
    #[arg(long, value_name = "SPACE", value_parser = values::colour_space, default_value_t = ColourSpace::default())]
    output_space: ColourSpace,
}

impl MapFlags {
    /// Puts them into a look.
    pub fn set(&self, look: &mut Look) {
        look.heading_deg = self.rotate;
        look.pitch_deg = self.pitch;
        look.roll_deg = self.roll;
        look.centre = settings::map_centre(self.map_centre);
        look.map_space = self.map_space;
        look.blur_deg = self.blur;
        look.clamp = self.clamp;
    }
}

impl GainFlags {
    /// Puts them into a look.
    pub fn set(&self, look: &mut Look) {
        look.exposure_ev = self.exposure;
        look.tint = self.tint;
        look.output_space = self.output_space;
    }
}
