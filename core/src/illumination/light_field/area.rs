//! A rectangle that shines evenly to one side, as points.
//!
//! It is of one radiance L (Lambert: intensity falls with the cosine). A cell of area A at distance r, seen at an angle of cosine
//! cos from its normal, gives a patch that faces it `L A cos / r^2`. Cells are equal, at most [`SPACING_RAD`] across as
//! seen from the aim, and at most [`MOST`] along a side; the same cells light every point, so that light is the same wherever
//! it is asked for.

use super::{Frame, NEAREST, Ray, SPACING_RAD};
use crate::math::Vec3;

/// Cells along one side at most: 64 degrees of them.
const MOST: f64 = 32.0;
/// Cells along one side at least, so that no area is a point to bodies as near as its size.
const FEWEST: f64 = 2.0;

/// A rectangle that faces its aim.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Area {
    /// Its middle, and where it faces.
    pub frame: Frame,
    cells: [usize; 2],
    /// From a cell to the next, scene units.
    steps: [f64; 2],
    /// L times the area of a cell, for stops 0.
    strength: f64,
}

impl Area {
    /// `width` along the frame's right, `height` along its up, scene units. Stops count at the aim, by the sum over the cells, so
    /// that the number of them changes nothing there.
    pub fn new(frame: Frame, width: f64, height: f64) -> Self {
        let cells = |size: f64| {
            let seen = 2.0 * (size / 2.0 / frame.distance).atan();
            (seen / SPACING_RAD).ceil().clamp(FEWEST, MOST)
        };
        let (columns, rows) = (cells(width), cells(height));
        let steps = [width / columns, height / rows];
        let mut area = Self { frame, cells: [columns as usize, rows as usize], steps, strength: 1.0 };
        // A patch at the aim that faces the middle.
        let (mut sum, aim, axis) = (0.0, frame.aim(), frame.axis);
        area.rays(&aim, &mut |towards, _, irradiance| sum -= irradiance[0] * towards.dot(&axis));
        area.strength = std::f64::consts::PI / sum;
        area
    }

    pub(super) fn rays(&self, at: &Vec3, each: Ray<'_>) {
        let Frame { place, axis, right, up, distance } = &self.frame;
        let before = (at - place).dot(axis);
        if before <= distance * NEAREST {
            return;
        }
        let [columns, rows] = self.cells.map(|n| n as f64);
        for j in 0..self.cells[1] {
            let row = place + up * (self.steps[1] * (j as f64 + 0.5 - rows / 2.0)) - at;
            for i in 0..self.cells[0] {
                let to = row + right * (self.steps[0] * (i as f64 + 0.5 - columns / 2.0));
                let squared = to.norm_squared();
                let distance = squared.sqrt();
                each(to / distance, distance, [self.strength * before / (squared * distance); 3]);
            }
        }
    }
}
