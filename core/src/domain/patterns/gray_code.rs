//! Gray codes: the column and the row that a pixel sees, bit by bit.
//!
//! Neighbouring columns differ in one bit alone (the reflected binary code, F. Gray, US patent 2632058, 1953), so a pixel on an
//! edge is off by one at most. Each bit is shown with its inverse: which of both is brighter needs no threshold.

use super::stripes::along;
use super::{Direction, Element, Series};
use crate::domain::Plane;

#[derive(Debug)]
pub(super) struct GrayCode {
    plane: Plane,
    patterns: Vec<(Direction, u32, bool)>,
}

impl GrayCode {
    pub fn new(plane: Plane) -> Self {
        // Bits that tell apart what lies along a side.
        let bits = |side: usize| usize::BITS - (side - 1).leading_zeros();
        let both = |direction: Direction, side: usize| {
            (0..bits(side)).rev().flat_map(move |bit| [false, true].map(|inverse| (direction, bit, inverse)))
        };
        let vertical = both(Direction::Vertical, plane.columns());
        Self { plane, patterns: vertical.chain(both(Direction::Horizontal, plane.rows())).collect() }
    }
}

impl Series for GrayCode {
    fn len(&self) -> usize {
        self.patterns.len()
    }

    fn element(&self, n: usize) -> Element {
        let (stripes, bit, inverse) = self.patterns[n];
        Element::GrayCode { stripes, bit, inverse }
    }

    fn values(&self, n: usize) -> Vec<f32> {
        let (direction, bit, inverse) = self.patterns[n];
        along(self.plane, direction, |at, _| (((at ^ (at >> 1)) >> bit) & 1 == 1) != inverse)
    }
}
