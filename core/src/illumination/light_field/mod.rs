//! Light that varies in space: a 4D incident light field, as sources at finite distance and what stands before them (7.1).
//!
//! Everything is in the stage frame and in the scene's units of length. A [`LightField`] is [`Incident`] light: for any point
//! near the object it says what arrives there, rays from points, suns and samples of areas, and the radiance of what is a
//! continuum, maps and grids of probes. The two parts add; no source gives both. Asking allocates nothing.
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

mod area;
mod blinds;
mod far;
mod frame;
mod lamps;
mod probes;
mod slide;
#[cfg(test)]
mod tests;

use std::sync::Arc;

use super::{EnvMap, Incident};
use crate::math::Vec3;

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
#[derive(Debug, Clone, PartialEq, Default)]
pub struct LightField {
    /// In any order: light adds.
    pub sources: Vec<Source>,
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
            Self::Map(map) => map.between(towards),
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

    /// Does what comes through the window, if there is one, reach a point?
    fn passes(&self, at: &Vec3, towards: &Vec3, distance: f64) -> bool {
        self.blinds.as_ref().is_none_or(|blinds| blinds.pass(at, towards, distance))
    }
}

impl Incident for Source {
    fn arriving(&self, at: &Vec3, each: &mut dyn FnMut(Vec3, [f64; 3])) {
        self.emitter.rays(at, &mut |towards, distance, irradiance| {
            if self.passes(at, &towards, distance) {
                each(towards, std::array::from_fn(|c| irradiance[c] * self.gain[c]));
            }
        });
    }

    fn radiance(&self, at: &Vec3, towards: &Vec3) -> [f64; 3] {
        if !self.has_radiance() || !self.passes(at, towards, f64::INFINITY) {
            return [0.0; 3];
        }
        let radiance = self.emitter.radiance(at, towards);
        std::array::from_fn(|c| radiance[c] * self.gain[c])
    }

    fn has_radiance(&self) -> bool {
        matches!(self.emitter, Emitter::Map(_) | Emitter::Probes(_))
    }

    fn varies(&self) -> bool {
        matches!(self.emitter, Emitter::Probes(_)) || self.has_radiance() && self.blinds.is_some()
    }

    fn parts(&self) -> Vec<(String, &dyn Incident)> {
        vec![(self.name.clone(), self)]
    }
}

impl LightField {
    /// Sources, lit together.
    pub fn new(sources: Vec<Source>) -> Self {
        Self { sources }
    }
}

impl Incident for LightField {
    fn arriving(&self, at: &Vec3, each: &mut dyn FnMut(Vec3, [f64; 3])) {
        self.sources.iter().for_each(|source| source.arriving(at, each));
    }

    fn radiance(&self, at: &Vec3, towards: &Vec3) -> [f64; 3] {
        self.sources.iter().fold([0.0; 3], |sum, source| {
            let radiance = source.radiance(at, towards);
            std::array::from_fn(|c| sum[c] + radiance[c])
        })
    }

    fn has_radiance(&self) -> bool {
        self.sources.iter().any(Incident::has_radiance)
    }

    fn varies(&self) -> bool {
        self.sources.iter().any(Incident::varies)
    }

    fn parts(&self) -> Vec<(String, &dyn Incident)> {
        self.sources.iter().flat_map(Incident::parts).collect()
    }
}
