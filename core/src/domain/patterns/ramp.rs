//! All 256 codes of an emitter, one after another over the whole screen, to measure its curve (6.3).

use super::{Element, Series};
use crate::domain::Plane;

/// 8-bit codes.
const CODES: usize = 256;

#[derive(Debug)]
pub(super) struct Ramp {
    plane: Plane,
}

impl Ramp {
    pub fn new(plane: Plane) -> Self {
        Self { plane }
    }
}

impl Series for Ramp {
    fn len(&self) -> usize {
        CODES
    }

    fn element(&self, n: usize) -> Element {
        Element::Ramp { code: n as u8 }
    }

    fn values(&self, n: usize) -> Vec<f32> {
        vec![n as f32 / (CODES - 1) as f32; self.plane.len()]
    }
}
