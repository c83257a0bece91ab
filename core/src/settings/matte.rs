//! Settings of an object that is put before a plate: Relume Environment Matte and `relume matte`.
//!
//! Where a setting means what it means for Relume Relight, it is the same one.

use super::{AMBIENT, ASSET, EXPOSURE, Kind, MAP_CENTRE, OUTPUT_SPACE, Setting, TINT};
use crate::field::Kind as FieldKind;
use crate::matte::{Place, Show};

/// To the right.
pub const POSITION_X: Setting = Setting {
    id: "positionX",
    label: "Position X",
    hint: "How far the middle of the object's picture lies to the right of the plate's middle, in pixels of the plate at full size.",
    kind: Kind::Number { default: 0.0, hard: (-1e5, 1e5), soft: (-2000.0, 2000.0) },
};
/// Upwards.
pub const POSITION_Y: Setting = Setting {
    id: "positionY",
    label: "Position Y",
    hint: "How far the middle of the object's picture lies above the plate's middle, in pixels of the plate at full size.",
    kind: Kind::Number { default: 0.0, hard: (-1e5, 1e5), soft: (-2000.0, 2000.0) },
};
/// Size.
pub const SCALE: Setting = Setting {
    id: "scale",
    label: "Scale",
    hint: "Pixels of the plate for one pixel of the object's picture.",
    kind: Kind::Number { default: 1.0, hard: (0.001, 100.0), soft: (0.1, 4.0) },
};
/// Turn in the picture.
pub const ROTATE: Setting = Setting {
    id: "rotate",
    label: "Rotate",
    hint: "Turns the object in the picture, counter-clockwise about its middle, in degrees; what it shows of the plate turns as if the screen had been turned with it.",
    kind: Kind::Number { default: 0.0, hard: (-1e6, 1e6), soft: (-180.0, 180.0) },
};
/// What lies beyond the plate.
pub const BEYOND: Setting = Setting {
    id: "beyond",
    label: "Beyond the plate",
    hint: "What the object sees where the screen reached farther than the plate does: the plate's edge going on, a colour, or a lat-long map.",
    kind: Kind::Choice {
        default: 0,
        options: &[("stretch", "Stretched edge"), ("colour", "Colour"), ("map", "Lat-long map")],
    },
};
/// The colour beyond.
pub const BEYOND_COLOUR: Setting = Setting {
    id: "beyondColour",
    label: "Colour beyond",
    hint: "The light from beyond the plate where that is a colour, in the colours of the plate.",
    kind: Kind::Colour { default: [0.0; 3], hard: (0.0, 1e6), soft: (0.0, 1.0) },
};
/// Path of the map beyond.
pub const BEYOND_MAP: Setting = Setting {
    id: "beyondMap",
    label: "Map beyond",
    hint: "The light from beyond the plate where that is a lat-long map (EXR, HDR, PNG, TIFF, JPEG), in the colours of the plate.",
    kind: Kind::File,
};
/// Horizontal angle of the plate. 40 degrees is what a lens of 50 mm shows on 36 mm of film: 2 atan(18/50) = 39.6.
pub const VIEW_ANGLE: Setting = Setting {
    id: "viewAngle",
    label: "View angle",
    hint: "How wide the plate is, in degrees, where a lat-long map stands around it: the horizontal angle of the camera that made it.",
    kind: Kind::Number { default: 40.0, hard: (1.0, 170.0), soft: (10.0, 120.0) },
};
/// One of [`FieldKind::OF_SCREENS`], or the first that there is.
pub const REPRESENTATION: Setting = Setting {
    id: "representation",
    label: "Representation",
    hint: "Which form of the field is used, where the asset holds several. Automatic: the first of these that it holds.",
    kind: Kind::Choice {
        default: 0,
        options: &[
            ("automatic", "Automatic"),
            (FieldKind::Dense.id(), "Samples"),
            (FieldKind::Factored.id(), "Factored"),
            (FieldKind::Wavelet.id(), "Wavelet"),
            (FieldKind::Explicit.id(), "Explicit"),
        ],
    },
};
/// One of [`Show`].
pub const OUTPUT: Setting = Setting {
    id: "output",
    label: "Output",
    hint: "The object over the plate, the lit object alone, or its alpha.",
    kind: Kind::Choice {
        default: 0,
        options: &[("composite", "Composite"), ("element", "Element"), ("alpha", "Alpha")],
    },
};

/// The settings of Relume Environment Matte, in the order shown.
pub const MATTE: &[Setting] = &[
    ASSET,
    POSITION_X,
    POSITION_Y,
    SCALE,
    ROTATE,
    EXPOSURE,
    TINT,
    BEYOND,
    BEYOND_COLOUR,
    BEYOND_MAP,
    MAP_CENTRE,
    VIEW_ANGLE,
    AMBIENT,
    REPRESENTATION,
    OUTPUT,
    OUTPUT_SPACE,
];

/// The place that position, scale and rotation mean. Positions go up, as in OpenFX; places go down, as rows of pictures do.
pub fn place([x, y]: [f64; 2], scale: f64, rotate_deg: f64) -> Place {
    Place { shift: [x, -y], scale, rotate_deg }
}

/// The kind of an option of [`REPRESENTATION`]; `None` is automatic.
pub fn representation(option: usize) -> Option<FieldKind> {
    FieldKind::OF_SCREENS.get(option.checked_sub(1)?).copied()
}

/// The meaning of an option of [`OUTPUT`].
pub fn show(option: usize) -> Show {
    [Show::Composite, Show::Element, Show::Alpha].get(option).copied().unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_are_in_the_order_of_what_they_mean() {
        let Kind::Choice { options, .. } = REPRESENTATION.kind else { panic!("a choice") };
        assert_eq!(options.len(), FieldKind::OF_SCREENS.len() + 1);
        for (n, (id, _)) in options.iter().enumerate().skip(1) {
            assert_eq!(representation(n).map(FieldKind::id), Some(*id));
        }
        assert_eq!((representation(0), representation(5)), (None, None));
        assert_eq!([0, 1, 2, 9].map(show), [Show::Composite, Show::Element, Show::Alpha, Show::Composite]);
    }

    /// What a host lets through is a place.
    #[test]
    fn every_value_within_bounds_is_a_place() {
        let ends = |setting: &Setting| match setting.kind {
            Kind::Number { hard, .. } => [hard.0, hard.1],
            _ => panic!("{} is a number", setting.id),
        };
        for (n, scale) in ends(&SCALE).into_iter().enumerate() {
            let (x, y, rotate) = (ends(&POSITION_X)[n], ends(&POSITION_Y)[n], ends(&ROTATE)[n]);
            place([x, y], scale, rotate).check().unwrap();
        }
        assert_eq!(place([3.0, 4.0], 1.0, 0.0).shift, [3.0, -4.0]);
    }

    #[test]
    fn ids_are_unique() {
        let mut ids: Vec<_> = MATTE.iter().map(|setting| setting.id).collect();
        ids.sort_unstable();
        ids.dedup();
        assert_eq!(ids.len(), MATTE.len());
    }
}
