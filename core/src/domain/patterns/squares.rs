//! The picture of a projector in n x n squares, one lit after another: box-filtered samples of angle (7.3).

use super::{Element, Series, check_parts, part};
use crate::domain::Plane;
use crate::error::Result;

#[derive(Debug)]
pub(super) struct Squares {
    plane: Plane,
    side: usize,
}

impl Squares {
    /// # Errors
    /// More squares than texels.
    pub fn new(side: usize, plane: Plane) -> Result<Self> {
        check_parts("squares along each side", side, plane)?;
        Ok(Self { plane, side })
    }
}

impl Series for Squares {
    fn len(&self) -> usize {
        self.side * self.side
    }

    fn element(&self, n: usize) -> Element {
        Element::Square { column: n % self.side, row: n / self.side }
    }

    fn values(&self, n: usize) -> Vec<f32> {
        let mut values = vec![0.0; self.plane.len()];
        light(&mut values, self.plane, self.side, n % self.side, n / self.side);
        values
    }
}

/// Lights a square.
pub(super) fn light(values: &mut [f32], plane: Plane, side: usize, column: usize, row: usize) {
    let columns = part(column, side, plane.columns());
    for row in part(row, side, plane.rows()) {
        values[row * plane.columns()..][columns.clone()].fill(1.0);
    }
}
