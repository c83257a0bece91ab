//! The one table of user settings, shared by the command line and the plugin. Ids are permanent: compositing projects
//! store them. A new setting gets a neutral default.

use crate::illumination::MapCentre;
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
/// One captured lamp.
pub const LAMP: Setting = Setting {
    id: "lamp",
    label: "Lamp",
    hint: "Lights one captured lamp, counted from 1, as it was photographed; 0 uses the environment.",
    kind: Kind::Integer { default: 0, hard: (0, 1_000_000) },
};
/// Heading of the light.
pub const ROTATION: Setting = Setting {
    id: "rotation",
    label: "Rotation",
    hint: "Turns the light about the vertical axis, in degrees: light from the camera moves to the right of the picture.",
    kind: Kind::Number { default: 0.0, hard: (-1e6, 1e6), soft: (-180.0, 180.0) },
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
    hint: "How much of the ambient picture (seen with every lamp off) is added.",
    kind: Kind::Number { default: 0.0, hard: (0.0, 1000.0), soft: (0.0, 1.0) },
};
/// Zero-order or linear.
pub const RECONSTRUCTION: Setting = Setting {
    id: "reconstruction",
    label: "Reconstruction",
    hint: "How the answer to light is filled in between the lamps.",
    kind: Kind::Choice { default: 1, options: &[("zero-order", "Zero-order"), ("linear", "Linear")] },
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

/// The settings of Relume Relight, in the order shown.
pub const RELIGHT: &[Setting] =
    &[ASSET, ENVIRONMENT, LAMP, ROTATION, MAP_CENTRE, EXPOSURE, AMBIENT, RECONSTRUCTION, OUTSIDE, OUTPUT];

/// The method of an option of [`RECONSTRUCTION`].
pub fn method(option: usize) -> Method {
    Method::ALL.get(option).copied().unwrap_or_default()
}

/// The meaning of an option of [`MAP_CENTRE`].
pub fn map_centre(option: usize) -> MapCentre {
    [MapCentre::Front, MapCentre::Behind].get(option).copied().unwrap_or_default()
}

/// The meaning of an option of [`OUTSIDE`].
pub fn outside(option: usize) -> Outside {
    [Outside::Drop, Outside::Nearest].get(option).copied().unwrap_or_default()
}
