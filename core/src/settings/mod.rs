//! The one table of user settings, shared by the command line and the plugin. Ids are permanent: compositing projects
//! store them. A new setting gets a neutral default.
//!
//! The settings of an object before a plate are in [`matte`], those of light near an object in [`near`]. Beside them the files in which people write settings down:
//! [`lighting`] (lamps, and the presets that ship), [`light4d`] (light that varies in space) and [`animation`] (lights that change
//! with the frame).

pub mod animation;
mod curve;
pub mod light4d;
pub mod lighting;
pub mod matte;
pub mod near;
mod table;

use crate::field::Kind as FieldKind;
use crate::illumination::MapCentre;
use crate::image::ColourSpace;
use crate::reconstruct::{Method, Outside};

/// What a setting holds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Kind {
    /// A number; `hard` bounds are refused beyond, `soft` ones are the slider's ends.
    Number {
        /// The neutral value.
        default: f64,
        /// Smallest and largest allowed.
        hard: (f64, f64),
        /// Ends of the slider.
        soft: (f64, f64),
    },
    /// A linear RGB colour, or a gain for each channel.
    Colour {
        /// The neutral value.
        default: [f64; 3],
        /// Smallest and largest allowed, of each channel.
        hard: (f64, f64),
        /// Ends of the sliders.
        soft: (f64, f64),
    },
    /// A whole number.
    Integer {
        /// The neutral value.
        default: i32,
        /// Smallest and largest allowed.
        hard: (i32, i32),
    },
    /// One of several: `(id, label)`.
    Choice {
        /// Index of the neutral value.
        default: usize,
        /// Ids (command line) and labels (hosts), in permanent order.
        options: &'static [(&'static str, &'static str)],
    },
    /// A path to a file.
    File,
}

/// One thing a user can turn.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Setting {
    /// Permanent id; a plugin's parameter name.
    pub id: &'static str,
    /// What hosts show.
    pub label: &'static str,
    /// One or two sentences of help.
    pub hint: &'static str,
    /// What it holds.
    pub kind: Kind,
}

/// Path of the `.rfield`.
pub const ASSET: Setting = Setting {
    id: "asset",
    label: "Asset",
    hint: "The captured object: a .rfield file. Relative paths and ${VAR} are understood.",
    kind: Kind::File,
};
/// Path of the light.
pub const ENVIRONMENT: Setting = Setting {
    id: "environment",
    label: "Environment",
    hint: "The light: a lat-long map (EXR, HDR, PNG, TIFF, JPEG). A connected Illumination clip takes its place.",
    kind: Kind::File,
};
/// A lighting that ships.
pub const LIGHTING: Setting = Setting {
    id: "lighting",
    label: "Lighting",
    hint: "Lights with lamps that ship with Relume, in place of the environment.",
    kind: Kind::Choice { default: 0, options: lighting::OPTIONS },
};
/// Path of a lighting file.
pub const LIGHTING_FILE: Setting = Setting {
    id: "lightingFile",
    label: "Lighting file",
    hint: "Lights with the lamps of a lighting file (.toml), in place of Lighting and the environment.",
    kind: Kind::File,
};
/// One captured lamp.
pub const LAMP: Setting = Setting {
    id: "lamp",
    label: "Lamp",
    hint: "Lights one captured lamp, counted from 1, as it was photographed, in place of every other light but a connected Illumination clip; 0 is none.",
    kind: Kind::Integer { default: 0, hard: (0, 1_000_000) },
};
/// Heading of the light.
pub const ROTATION: Setting = Setting {
    id: "rotation",
    label: "Rotation",
    hint: "Turns the light about the vertical axis, in degrees: light from the camera moves to the right of the picture.",
    kind: Kind::Number { default: 0.0, hard: (-1e6, 1e6), soft: (-180.0, 180.0) },
};
/// Pitch of the light.
pub const PITCH: Setting = Setting {
    id: "pitch",
    label: "Pitch",
    hint: "Tips the light about the axis to the right, in degrees, before Rotation: light from the top moves towards the camera.",
    kind: Kind::Number { default: 0.0, hard: (-1e6, 1e6), soft: (-180.0, 180.0) },
};
/// Roll of the light.
pub const ROLL: Setting = Setting {
    id: "roll",
    label: "Roll",
    hint: "Rolls the light about the axis to the camera, in degrees, before Pitch: light from the right moves to the top.",
    kind: Kind::Number { default: 0.0, hard: (-1e6, 1e6), soft: (-180.0, 180.0) },
};
/// Gain of each channel.
pub const TINT: Setting = Setting {
    id: "tint",
    label: "Tint",
    hint: "Multiplies the red, green and blue of the light, in the asset's colour space.",
    kind: Kind::Colour { default: [1.0; 3], hard: (0.0, 1e6), soft: (0.0, 2.0) },
};
/// Blur of the map.
pub const BLUR: Setting = Setting {
    id: "blur",
    label: "Blur",
    hint: "Blurs the environment, keeping its energy: standard deviation of a Gaussian on the sphere, in degrees.",
    kind: Kind::Number { default: 0.0, hard: (0.0, 180.0), soft: (0.0, 60.0) },
};
/// Largest radiance.
pub const CLAMP: Setting = Setting {
    id: "clamp",
    label: "Clamp",
    hint: "Scales brighter parts of the environment down until their brightest channel is this, keeping hue; before Blur. 0 is no limit.",
    kind: Kind::Number { default: 0.0, hard: (0.0, 1e30), soft: (0.0, 100.0) },
};
/// Colours of the map.
pub const MAP_SPACE: Setting = Setting {
    id: "mapSpace",
    label: "Map colours",
    hint: "The colour space of the environment, as a file or the Illumination clip.",
    kind: Kind::Choice { default: 0, options: COLOUR_SPACES },
};
/// Colours of the picture.
pub const OUTPUT_SPACE: Setting = Setting {
    id: "outputSpace",
    label: "Output colours",
    hint: "The colour space of the picture; Source is taken to be in it.",
    kind: Kind::Choice { default: 0, options: COLOUR_SPACES },
};
/// [`ColourSpace::ALL`].
const COLOUR_SPACES: &[(&str, &str)] = {
    const fn option(space: ColourSpace) -> (&'static str, &'static str) {
        (space.id(), space.label())
    }
    let [a, b, c, d, e] = ColourSpace::ALL;
    &[option(a), option(b), option(c), option(d), option(e)]
};
/// Stops.
pub const EXPOSURE: Setting = Setting {
    id: "exposure",
    label: "Exposure",
    hint: "Exposure of the light, in stops.",
    kind: Kind::Number { default: 0.0, hard: (-40.0, 40.0), soft: (-6.0, 6.0) },
};
/// g of the ambient picture.
pub const AMBIENT: Setting = Setting {
    id: "ambient",
    label: "Ambient",
    hint: "How much of the ambient picture (seen with every lamp off, or the screen black) is added.",
    kind: Kind::Number { default: 0.0, hard: (0.0, 1000.0), soft: (0.0, 1.0) },
};
/// One of [`FieldKind::OF_LAMPS`], or the best.
pub const REPRESENTATION: Setting = Setting {
    id: "representation",
    label: "Representation",
    hint: "Which form of the field is used, where the asset holds several. Automatic: samples for a captured lamp, else factored before samples. Wavelet has a reconstruction of its own; harmonics are for soft light.",
    kind: Kind::Choice {
        default: 0,
        options: &[
            ("automatic", "Automatic"),
            (FieldKind::Dense.id(), "Samples"),
            (FieldKind::Factored.id(), "Factored"),
            (FieldKind::Wavelet.id(), "Wavelet"),
            (FieldKind::Harmonics.id(), "Harmonics"),
        ],
    },
};
/// One of [`Method::ALL`].
pub const RECONSTRUCTION: Setting = Setting {
    id: "reconstruction",
    label: "Reconstruction",
    hint: "How the answer to light is filled in between the lamps. Haar, 5/3 and 9/7 need lamps on rings of equal longitudes.",
    kind: Kind::Choice { default: 1, options: Method::NAMES },
};
/// Front or behind.
pub const MAP_CENTRE: Setting = Setting {
    id: "mapCentre",
    label: "Map centre",
    hint: "What the middle of the map shows: the side of the camera (front), or what the camera sees past the object (behind).",
    kind: Kind::Choice { default: 0, options: &[("front", "Front"), ("behind", "Behind")] },
};
/// Drop or nearest.
pub const OUTSIDE: Setting = Setting {
    id: "outside",
    label: "Outside light",
    hint: "Light from where no lamp was: dropped, or given to the nearest lamp.",
    kind: Kind::Choice { default: 0, options: &[("drop", "Drop"), ("nearest", "Nearest")] },
};
/// Composite, element, alpha, normals, albedo.
pub const OUTPUT: Setting = Setting {
    id: "output",
    label: "Output",
    hint: "Composite over Source, the lit element alone, its alpha, or the normals or albedo that the asset holds.",
    kind: Kind::Choice {
        default: 0,
        options: &[
            ("composite", "Composite"),
            ("element", "Element"),
            ("alpha", "Alpha"),
            ("normals", "Normals"),
            ("albedo", "Albedo"),
        ],
    },
};

/// The settings of Relume Relight, in the order shown; those of Relume Environment Matte are [`matte::MATTE`].
pub const RELIGHT: &[Setting] = &joined();

/// In front of the light near the object, and behind it.
const BEFORE: [Setting; 14] = [
    ASSET,
    ENVIRONMENT,
    LIGHTING,
    LIGHTING_FILE,
    LAMP,
    ROTATION,
    PITCH,
    ROLL,
    MAP_CENTRE,
    MAP_SPACE,
    BLUR,
    CLAMP,
    EXPOSURE,
    TINT,
];
const NEAR: [Setting; 3] = [near::LIGHT4D, near::LIGHT4D_FILE, near::SPACE];
const AFTER: [Setting; 6] = [AMBIENT, REPRESENTATION, RECONSTRUCTION, OUTSIDE, OUTPUT, OUTPUT_SPACE];
const RELIGHT_COUNT: usize = BEFORE.len() + NEAR.len() + 4 * near::BeamSettings::COUNT + 10 + AFTER.len();

/// The tables one after another.
const fn joined() -> [Setting; RELIGHT_COUNT] {
    let [one, two, three, four] = &near::BEAM_TABLES;
    let tables: [&[Setting]; 8] = [&BEFORE, &NEAR, one, two, three, four, &near::SLIDE_TABLE, &AFTER];
    let mut all = [ASSET; RELIGHT_COUNT];
    let (mut table, mut at) = (0, 0);
    while table < tables.len() {
        let mut n = 0;
        while n < tables[table].len() {
            all[at] = tables[table][n];
            at += 1;
            n += 1;
        }
        table += 1;
    }
    all
}

/// The kind of an option of [`REPRESENTATION`]; `None` is automatic.
pub fn representation(option: usize) -> Option<FieldKind> {
    FieldKind::OF_LAMPS.get(option.checked_sub(1)?).copied()
}

/// The method of an option of [`RECONSTRUCTION`].
pub fn method(option: usize) -> Method {
    Method::ALL.get(option).copied().unwrap_or_default()
}

/// The meaning of an option of [`MAP_CENTRE`].
pub fn map_centre(option: usize) -> MapCentre {
    [MapCentre::Front, MapCentre::Behind].get(option).copied().unwrap_or_default()
}

/// The meaning of an option of [`MAP_SPACE`] and [`OUTPUT_SPACE`].
pub fn colour_space(option: usize) -> ColourSpace {
    ColourSpace::ALL.get(option).copied().unwrap_or_default()
}

/// The meaning of an option of [`OUTSIDE`].
pub fn outside(option: usize) -> Outside {
    [Outside::Drop, Outside::Nearest].get(option).copied().unwrap_or_default()
}
