//! Light that varies in space: a 4D incident light field, as sources at finite distance and what stands before them (7.1).
//!
//! Everything is in the stage frame and in the scene's units of length. A [`LightField`] is asked, for any point near the
//! object, what arrives there: rays from points, suns and samples of areas ([`LightField::arriving`]), and the radiance of what is
//! a continuum, maps and grids of probes ([`LightField::radiance`]). The two parts add; no source gives both.
//!
//! **Intensity.** As for [lamps far away](super::lighting), stops count from a source that gives a white diffuser the value 1
//! (irradiance pi): the diffuser stands at the point the source is aimed at, faces it, and nothing is in between. A source at a
//! finite distance then falls off with the square of the distance. Maps and probes hold radiance: stops count from what their files
//! say.
//!
//! **At a source.** A point within [`NEAREST`] of its distance from the aim gets nothing from a source, rather than infinity.
//!
//! | part | what it holds |
//! |---|---|
//! | `frame` | a place, where it looks, and its right and up |
//! | `lamps` | points and spots |
//! | `area` | rectangles that shine evenly to one side |
//! | `slide` | a projector with a picture |
//! | `far` | suns, and the lamps of lighting files |
//! | `blinds` | a window with slats |
//! | `probes` | Unger's grids of maps (2.2.3) |
//! | `flat` | the 2D approximation: all light as it is at one point |

mod area;
mod blinds;
mod far;
mod flat;
mod frame;
mod lamps;
mod probes;
mod slide;
#[cfg(test)]
mod tests;

use std::sync::Arc;

use super::EnvMap;
use crate::math::{Mat3, Vec3};

pub use area::Area;
pub use blinds::{Blinds, Slats};
pub use far::{Far, far_lamp};
pub use frame::Frame;
pub use lamps::{Point, Spot};
pub use probes::{Probes, ProbesAt};
pub use slide::{Lookup, Slide};

/// Nearer than this share of the distance from a source to its aim, a point counts as the source itself. Irradiance there
/// would be `1e10 pi`: no body is that near a lamp, and single precision still holds it.
pub const NEAREST: f64 = 1e-5;

/// Rays of an area or a disc are about this far apart, seen from the aim. Positions of a gantry are 5 degrees apart or more
/// (thesis, 7.4: 11), and what is between two of them is interpolated linearly.
pub const SPACING_RAD: f64 = 2.0 * std::f64::consts::PI / 180.0;

/// Light about the origin. Cloning shares maps and pictures.
#[derive(Debug, Clone, PartialEq)]
pub struct LightField {
    /// In any order: light adds.
    pub sources: Vec<Source>,
    /// The whole is turned about the origin: light from place p comes from `turn * p`.
    pub turn: Mat3,
}

/// One source of light.
#[derive(Debug, Clone, PartialEq)]
pub struct Source {
    /// What messages call it.
    pub name: String,
    /// What it gives is multiplied by this: its colour, linear Rec.709, times `2^stops`.
    pub gain: [f64; 3],
    /// What shines.
    pub emitter: Emitter,
    /// A window that all of its light comes through.
    pub blinds: Option<Blinds>,
}

/// What shines. The set is closed: a file's `kind` names one of them.
#[derive(Debug, Clone, PartialEq)]
pub enum Emitter {
    /// Alike to all sides.
    Point(Point),
    /// A cone of light.
    Spot(Spot),
    /// A rectangle.
    Area(Area),
    /// A picture, thrown.
    Slide(Slide),
    /// Parallel beams.
    Far(Far),
    /// A far surrounding.
    Map(Arc<EnvMap>),
    /// Surroundings from many places.
    Probes(Probes),
}

/// What an emitter hands over: unit vector to it, its distance (infinite of far light), and irradiance.
type Ray<'a> = &'a mut dyn FnMut(Vec3, f64, [f64; 3]);

impl Emitter {
    fn rays(&self, at: &Vec3, each: Ray<'_>) {
        match self {
            Self::Point(point) => point.rays(at, each),
            Self::Spot(spot) => spot.rays(at, each),
            Self::Area(area) => area.rays(at, each),
            Self::Slide(slide) => slide.rays(at, each),
            Self::Far(far) => far.beams.iter().for_each(|beam| each(beam.direction, f64::INFINITY, beam.irradiance)),
            Self::Map(_) | Self::Probes(_) => {}
        }
    }

    /// Radiance of a continuum; black of everything else.
    fn radiance(&self, at: &Vec3, towards: &Vec3) -> [f64; 3] {
        match self {
            Self::Map(map) => map.radiance(towards).map(f64::from),
            Self::Probes(probes) => probes.radiance(at, towards),
            _ => [0.0; 3],
        }
    }

    /// Where it is; `None` of what surrounds the object.
    pub fn place(&self) -> Option<Vec3> {
        match self {
            Self::Point(point) => Some(point.place),
            Self::Spot(spot) => Some(spot.frame.place),
            Self::Area(area) => Some(area.frame.place),
            Self::Slide(slide) => Some(slide.frame.place),
            Self::Far(_) | Self::Map(_) | Self::Probes(_) => None,
        }
    }
}

impl Source {
    /// A white source of stops 0.
    pub fn new(name: impl Into<String>, emitter: Emitter) -> Self {
        Self { name: name.into(), gain: [1.0; 3], emitter, blinds: None }
    }

    /// In this colour, at these stops.
    pub fn lit(self, colour: [f64; 3], stops: f64) -> Self {
        Self { gain: colour.map(|c| c * stops.exp2()), ..self }
    }

    /// Behind a window.
    pub fn behind(self, blinds: Blinds) -> Self {
        Self { blinds: Some(blinds), ..self }
    }

    /// Is it a continuum of directions, so that it has radiance?
    pub fn is_continuum(&self) -> bool {
        matches!(self.emitter, Emitter::Map(_) | Emitter::Probes(_))
    }

    /// Does what comes through the window, if there is one, reach a point?
    fn passes(&self, at: &Vec3, towards: &Vec3, distance: f64) -> bool {
        self.blinds.as_ref().is_none_or(|blinds| blinds.pass(at, towards, distance))
    }

    /// As [`LightField::arriving`], for this source, unturned.
    pub fn arriving(&self, at: &Vec3, each: &mut dyn FnMut(Vec3, [f64; 3])) {
        self.emitter.rays(at, &mut |towards, distance, irradiance| {
            if self.passes(at, &towards, distance) {
                each(towards, std::array::from_fn(|c| irradiance[c] * self.gain[c]));
            }
        });
    }

    /// As [`LightField::radiance`], for this source, unturned.
    pub fn radiance(&self, at: &Vec3, towards: &Vec3) -> [f64; 3] {
        if !self.is_continuum() || !self.passes(at, towards, f64::INFINITY) {
            return [0.0; 3];
        }
        let radiance = self.emitter.radiance(at, towards);
        std::array::from_fn(|c| radiance[c] * self.gain[c])
    }
}

impl Default for LightField {
    fn default() -> Self {
        Self::new(Vec::new())
    }
}

impl LightField {
    /// Sources, not turned.
    pub fn new(sources: Vec<Source>) -> Self {
        Self { sources, turn: Mat3::identity() }
    }

    /// Turned by a rotation about the origin, after what turned it before: light from direction d comes from `rotation * d`.
    pub fn turned(&self, rotation: &Mat3) -> Self {
        Self { sources: self.sources.clone(), turn: rotation * self.turn }
    }

    /// Rays that arrive at `at` from points, suns and samples of areas: for each, the unit vector from `at` towards the light, and
    /// the irradiance it gives a patch at `at` that faces it, linear RGB. All finite for a finite point. Nothing is allocated.
    pub fn arriving(&self, at: &Vec3, each: &mut dyn FnMut(Vec3, [f64; 3])) {
        let unturned = self.turn.tr_mul(at);
        for source in &self.sources {
            source.arriving(&unturned, &mut |towards, irradiance| each(self.turn * towards, irradiance));
        }
    }

    /// Radiance that arrives at `at` from `towards` (unit, from `at` to the light) of what is a continuum: maps, grids of probes.
    /// Maps are piecewise constant over their texels.
    pub fn radiance(&self, at: &Vec3, towards: &Vec3) -> [f64; 3] {
        let (at, towards) = (self.turn.tr_mul(at), self.turn.tr_mul(towards));
        self.sources.iter().fold([0.0; 3], |sum, source| {
            let radiance = source.radiance(&at, &towards);
            std::array::from_fn(|c| sum[c] + radiance[c])
        })
    }

    /// Is there a continuum, so that [`LightField::radiance`] is worth asking?
    pub fn has_radiance(&self) -> bool {
        self.sources.iter().any(Source::is_continuum)
    }
}
