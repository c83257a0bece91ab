//! Settings of light near the object, for hosts: up to four beams and a slide, light files, and the light fields that ship.
//!
//! Places are in the stage frame and in the units of the asset's projector positions: right, up, towards the camera.

use std::sync::Arc;

use super::{Kind, Setting, light4d};
use crate::error::{Error, Result};
use crate::illumination::light_field::{Emitter, Frame, Lookup, Slide, Source, Spot};
use crate::image::Image;
use crate::math::Vec3;

/// A light field that ships.
pub const LIGHT4D: Setting = Setting {
    id: "light4d",
    label: "Near light",
    hint: "Lights with lamps near the object that ship with Relume, in place of beams, slide, lighting and environment. For assets captured with a projector.",
    kind: Kind::Choice { default: 0, options: light4d::OPTIONS },
};
/// Path of a light file.
pub const LIGHT4D_FILE: Setting = Setting {
    id: "light4dFile",
    label: "Light file",
    hint: "Lights with the lamps near the object of a light file (.toml), in place of Near light, beams, slide, lighting and environment.",
    kind: Kind::File,
};
/// Light as it is at each point, or as at the origin.
pub const SPACE: Setting = Setting {
    id: "lightSpace",
    label: "Near light in space",
    hint: "As it is: light near the object differs from point to point. Flat: all of it is as it is in the middle of the object, which assets captured with lamps can show too.",
    kind: Kind::Choice { default: 0, options: &[("near", "As it is"), ("flat", "Flat")] },
};

const fn number(
    id: &'static str,
    label: &'static str,
    hint: &'static str,
    default: f64,
    (hard, soft): ((f64, f64), (f64, f64)),
) -> Setting {
    Setting { id, label, hint, kind: Kind::Number { default, hard, soft } }
}

/// Hard bounds, then ends of the slider.
type Range = ((f64, f64), (f64, f64));
const PLACE: Range = ((-1e5, 1e5), (-10.0, 10.0));
const ANGLE: Range = ((0.01, 170.0), (1.0, 90.0));
const EDGE: Range = ((0.0, 90.0), (0.0, 45.0));
const STOPS: Range = ((-40.0, 40.0), (-6.0, 6.0));
const TURN: Range = ((-1e6, 1e6), (-180.0, 180.0));

/// What the settings of one beam are called.
#[derive(Debug, Clone, Copy)]
pub struct BeamSettings {
    /// Off or on.
    pub on: Setting,
    /// Where it is.
    pub position: [Setting; 3],
    /// Where it points.
    pub aim: [Setting; 3],
    /// Of its even part.
    pub angle: Setting,
    /// Beyond it.
    pub edge: Setting,
    /// Its colour.
    pub colour: Setting,
    /// Its intensity.
    pub stops: Setting,
}

macro_rules! beam {
    ($n:literal, $x:literal, $y:literal, $z:literal) => {
        BeamSettings {
            on: Setting {
                id: concat!("beam", $n),
                label: concat!("Beam ", $n),
                hint: "Lights with this beam, in place of lighting and environment. For assets captured with a projector.",
                kind: Kind::Choice { default: 0, options: &[("off", "Off"), ("on", "On")] },
            },
            position: [
                number(concat!("beam", $n, "X"), "Position X", "Where the beam comes from: to the right of the object.", $x, PLACE),
                number(concat!("beam", $n, "Y"), "Position Y", "Where the beam comes from: above the object.", $y, PLACE),
                number(concat!("beam", $n, "Z"), "Position Z", "Where the beam comes from: towards the camera.", $z, PLACE),
            ],
            aim: [
                number(concat!("beam", $n, "AimX"), "Aim X", "Where the beam points, and where its stops count: to the right.", 0.0, PLACE),
                number(concat!("beam", $n, "AimY"), "Aim Y", "Where the beam points: above the middle of the object.", 0.0, PLACE),
                number(concat!("beam", $n, "AimZ"), "Aim Z", "Where the beam points: towards the camera.", 0.0, PLACE),
            ],
            angle: number(concat!("beam", $n, "Angle"), "Beam angle", "Degrees across the even part of the beam.", 12.0, ANGLE),
            edge: number(concat!("beam", $n, "Edge"), "Edge", "Degrees beyond the beam angle over which light falls to nothing; 0 is hard.", 3.0, EDGE),
            colour: Setting {
                id: concat!("beam", $n, "Colour"),
                label: "Colour",
                hint: "The beam's colour, linear Rec.709.",
                kind: Kind::Colour { default: [1.0; 3], hard: (0.0, 1e6), soft: (0.0, 1.0) },
            },
            stops: number(concat!("beam", $n, "Stops"), "Stops", "Intensity; at 0 a white diffuser at the aim that faces the beam becomes 1.", 0.0, STOPS),
        }
    };
}

impl BeamSettings {
    /// How many there are.
    pub const COUNT: usize = 11;

    /// All of them, in the order shown.
    pub const fn all(&self) -> [Setting; Self::COUNT] {
        let ([x, y, z], [a, b, c]) = (self.position, self.aim);
        [self.on, x, y, z, a, b, c, self.angle, self.edge, self.colour, self.stops]
    }
}

/// The beams.
pub const BEAMS: [BeamSettings; 4] =
    [beam!("1", -2.5, 2.5, 2.0), beam!("2", 2.5, 2.5, 2.0), beam!("3", 0.0, 3.5, 2.0), beam!("4", 0.0, 1.5, 3.7)];

/// Settings of the first beam, and so on.
pub const BEAM_TABLES: [[Setting; BeamSettings::COUNT]; 4] =
    [BEAMS[0].all(), BEAMS[1].all(), BEAMS[2].all(), BEAMS[3].all()];

/// Path of the picture that is thrown.
pub const SLIDE: Setting = Setting {
    id: "slide",
    label: "Slide",
    hint: "A picture that a projector throws, in place of lighting and environment. For assets captured with a projector.",
    kind: Kind::File,
};
/// Where the slide's projector is.
pub const SLIDE_POSITION: [Setting; 3] = [
    number("slideX", "Position X", "Where the slide's projector is: to the right of the object.", 0.0, PLACE),
    number("slideY", "Position Y", "Where the slide's projector is: above the object.", 1.5, PLACE),
    number("slideZ", "Position Z", "Where the slide's projector is: towards the camera.", 3.7, PLACE),
];
/// Where it looks.
pub const SLIDE_AIM: [Setting; 3] = [
    number(
        "slideAimX",
        "Aim X",
        "Where the middle of the slide falls, and where its stops count: to the right.",
        0.0,
        PLACE,
    ),
    number("slideAimY", "Aim Y", "Where the middle of the slide falls: above the middle of the object.", 0.0, PLACE),
    number("slideAimZ", "Aim Z", "Where the middle of the slide falls: towards the camera.", 0.0, PLACE),
];
/// Across its picture.
pub const SLIDE_VIEW: Setting =
    number("slideView", "View", "Degrees across the width of the slide as thrown.", 30.0, ANGLE);
/// About its axis.
pub const SLIDE_TURN: Setting =
    number("slideTurn", "Turn", "Turns the slide about its axis, in degrees: its top goes to its right.", 0.0, TURN);
/// Its intensity.
pub const SLIDE_STOPS: Setting = number(
    "slideStops",
    "Stops",
    "Intensity; at 0 a white diffuser at the aim that faces white becomes 1.",
    0.0,
    STOPS,
);

/// All of the slide, in the order shown.
pub const SLIDE_TABLE: [Setting; 10] = {
    let ([x, y, z], [a, b, c]) = (SLIDE_POSITION, SLIDE_AIM);
    [SLIDE, x, y, z, a, b, c, SLIDE_VIEW, SLIDE_TURN, SLIDE_STOPS]
};

/// What the settings of a beam or of the slide say.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Thrown {
    /// Where it is.
    pub position: [f64; 3],
    /// Where it points.
    pub aim: [f64; 3],
    /// Across the even part of a beam, or the width of a slide, degrees.
    pub angle_deg: f64,
    /// Beyond a beam, degrees.
    pub edge_deg: f64,
    /// Of a slide, about its axis, degrees.
    pub turn_deg: f64,
    /// Linear Rec.709.
    pub colour: [f64; 3],
    /// Intensity.
    pub stops: f64,
}

impl Thrown {
    fn frame(&self, name: &str) -> Result<Frame> {
        let frame = Frame::new(self.position.into(), self.aim.into(), Vec3::y());
        frame.map(|frame| frame.rolled(self.turn_deg.to_radians())).ok_or_else(|| {
            let [x, y, z] = self.position;
            Error::invalid(name, format!("position and aim both at {x}, {y}, {z}"), "two different points")
        })
    }

    /// The beam.
    ///
    /// # Errors
    /// A position that is the aim.
    pub fn beam(&self, name: &str) -> Result<Source> {
        let spot = Spot::new(self.frame(name)?, self.angle_deg.to_radians(), self.edge_deg.to_radians());
        Ok(Source::new(name, Emitter::Spot(spot)).lit(self.colour, self.stops))
    }

    /// The slide, of a [prepared](Slide::prepared) picture.
    ///
    /// # Errors
    /// A position that is the aim; a picture that was not prepared.
    pub fn slide(&self, name: &str, picture: Arc<Image>) -> Result<Source> {
        let slide = Slide::with(self.frame(name)?, self.angle_deg.to_radians(), picture, Lookup::Smooth);
        let slide = slide.ok_or_else(|| Error::invalid(name, "a picture that cannot be thrown", "an RGB picture"))?;
        Ok(Source::new(name, Emitter::Slide(slide)).lit(self.colour, self.stops))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::illumination::Incident;
    use crate::settings::RELIGHT;

    #[test]
    fn ids_are_told_apart_and_all_are_in_the_table() {
        let mut ids: Vec<&str> = RELIGHT.iter().map(|setting| setting.id).collect();
        let tables = BEAM_TABLES.iter().flatten().chain(&SLIDE_TABLE).chain([&LIGHT4D, &LIGHT4D_FILE, &SPACE]);
        for setting in tables {
            assert!(ids.contains(&setting.id), "{}", setting.id);
        }
        assert_eq!(ids.len(), 20 + 4 * 11 + 10 + 3);
        ids.sort_unstable();
        ids.dedup();
        assert_eq!(ids.len(), RELIGHT.len());
    }

    #[test]
    fn what_is_set_is_what_is_thrown() {
        let thrown = Thrown {
            position: [0.0, 0.0, 4.0],
            aim: [0.0; 3],
            angle_deg: 20.0,
            edge_deg: 5.0,
            turn_deg: 90.0,
            colour: [1.0, 0.5, 0.0],
            stops: 1.0,
        };
        let green = |source: Source, at: Vec3| {
            let mut sum = 0.0;
            source.arriving(&at, &mut |_, e| sum += e[1] / std::f64::consts::PI);
            sum
        };
        assert!((green(thrown.beam("beam 1").unwrap(), Vec3::zeros()) - 1.0).abs() < 1e-12);
        assert_eq!(green(thrown.beam("beam 1").unwrap(), Vec3::new(1.1, 0.0, 0.0)), 0.0);
        // White in its upper half; a quarter turn carries the top to the right.
        let picture = Image::from_fn(64, 64, |_, y| [f32::from(u8::from(y < 32)); 3]);
        let picture = Slide::prepared(picture).unwrap();
        let slide = |x: f64, y: f64| green(thrown.slide("slide", picture.clone()).unwrap(), Vec3::new(x, y, 0.0));
        assert!(slide(0.3, 0.3) > 0.9 && slide(0.3, -0.3) > 0.9 && slide(-0.3, 0.3) == 0.0, "{}", slide(0.3, 0.3));
        let message = Thrown { aim: thrown.position, ..thrown }.beam("beam 2").unwrap_err().to_string();
        assert!(message.contains("beam 2") && message.contains("0, 0, 4"), "{message}");
    }
}
