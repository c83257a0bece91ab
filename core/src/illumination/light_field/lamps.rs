//! Lamps that are points: alike to all sides, or in a cone.

use std::f64::consts::PI;

use super::{Frame, NEAREST, Ray};
use crate::math::Vec3;

/// A point that shines alike to all sides.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point {
    /// Where it is.
    pub place: Vec3,
    /// Its radiant intensity for stops 0: `pi d^2`, d the distance to what it is aimed at.
    intensity: f64,
}

impl Point {
    /// Stops count at `aim`. `None` where place and aim are one point, or not finite.
    pub fn new(place: Vec3, aim: Vec3) -> Option<Self> {
        let squared = (aim - place).norm_squared();
        (squared > 0.0 && squared.is_finite()).then_some(Self { place, intensity: PI * squared })
    }

    pub(super) fn rays(&self, at: &Vec3, each: Ray<'_>) {
        let to = self.place - at;
        let squared = to.norm_squared();
        if squared > NEAREST * NEAREST * self.intensity / PI {
            let distance = squared.sqrt();
            each(to / distance, distance, [self.intensity / squared; 3]);
        }
    }
}

/// A cone of light: of one radiant intensity in the middle, then falling to nothing.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spot {
    /// Where it is, and where it points.
    pub frame: Frame,
    /// From the axis to the end of the even part.
    even_rad: f64,
    /// Over what angle light falls from there to nothing.
    edge_rad: f64,
}

impl Spot {
    /// A spot whose even part is `beam_rad` across, and whose edge falls from 1 to 0 over `edge_rad` beyond it on every side, as
    /// `1 - 3 t^2 + 2 t^3`. An edge of 0 is a hard one.
    pub fn new(frame: Frame, beam_rad: f64, edge_rad: f64) -> Self {
        Self { frame, even_rad: beam_rad / 2.0, edge_rad }
    }

    /// Intensity at an angle from the axis against that on it.
    pub fn profile(&self, angle_rad: f64) -> f64 {
        let beyond = angle_rad - self.even_rad;
        if beyond <= 0.0 {
            return 1.0;
        }
        // Beyond the edge, and for any angle beyond a hard one.
        if beyond >= self.edge_rad {
            return 0.0;
        }
        let t = beyond / self.edge_rad;
        1.0 - t * t * (3.0 - 2.0 * t)
    }

    pub(super) fn rays(&self, at: &Vec3, each: Ray<'_>) {
        let Some((towards, distance)) = self.frame.seen_from(at) else { return };
        let cos = -towards.dot(&self.frame.axis);
        // Exact near the axis too, where the arc cosine is not.
        let angle = (towards + self.frame.axis * cos).norm().atan2(cos);
        let share = self.profile(angle);
        if share > 0.0 {
            each(towards, distance, [share * PI * (self.frame.distance / distance).powi(2); 3]);
        }
    }
}
