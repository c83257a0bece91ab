//! A place, where it looks, and what is right and up there.

use crate::math::Vec3;

/// Sine of 0.8 degrees: nearer to its axis, what is upright does not say where the top is. A gantry's projector has the same bound.
const UPRIGHT: f64 = 0.014_142;

/// A place that looks at a point: right-handed, `axis = up x right`, as whoever stands there sees it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Frame {
    /// Where.
    pub place: Vec3,
    /// Unit vector from the place to its aim.
    pub axis: Vec3,
    /// To the right of what is seen from the place.
    pub right: Vec3,
    /// To the top of it.
    pub up: Vec3,
    /// From the place to its aim.
    pub distance: f64,
}

impl Frame {
    /// Looks from `place` at `aim`, its top towards `upright`; where it looks along that, the top is away from the camera
    /// (-z), or towards +y. `None` where place and aim are one point, or not finite.
    pub fn new(place: Vec3, aim: Vec3, upright: Vec3) -> Option<Self> {
        let to = aim - place;
        let distance = to.norm();
        if !(distance > 0.0 && distance.is_finite()) {
            return None;
        }
        let axis = to / distance;
        let across = |up: Vec3| {
            let across = axis.cross(&up.try_normalize(0.0)?);
            across.try_normalize(UPRIGHT)
        };
        let right = across(upright).or_else(|| across(-Vec3::z())).or_else(|| across(Vec3::y()))?;
        Some(Self { place, axis, right, up: right.cross(&axis), distance })
    }

    /// Turned in its own plane: its top goes to its right.
    pub fn rolled(self, turn_rad: f64) -> Self {
        let (s, c) = turn_rad.sin_cos();
        Self { right: self.right * c - self.up * s, up: self.up * c + self.right * s, ..self }
    }

    /// Where it looks.
    pub fn aim(&self) -> Vec3 {
        self.place + self.axis * self.distance
    }

    /// Unit vector from `at` to the place, and the distance; `None` where [`NEAREST`](super::NEAREST) says that they are one.
    pub(super) fn seen_from(&self, at: &Vec3) -> Option<(Vec3, f64)> {
        let to = self.place - at;
        let distance = to.norm();
        (distance > self.distance * super::NEAREST).then(|| (to / distance, distance))
    }
}
