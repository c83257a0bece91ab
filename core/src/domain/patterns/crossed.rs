//! Horizontal and vertical sets of squares (7.5): many squares at once, and yet each alone.
//!
//! `H(x, o)` lights in column x every d-th square from row o on, `V(y, o)` in row y every d-th from column o on. What one
//! square answers is compact, so those lit together hardly meet, and `L(x, y) = min(H(x, y mod d), V(y, x mod d))` (7.1). 2 n d
//! photographs stand for n^2.

use super::squares::light;
use super::{Element, Series, check_parts};
use crate::domain::Plane;
use crate::error::{Error, Result};

#[derive(Debug)]
pub(super) struct Crossed {
    plane: Plane,
    side: usize,
    influence: usize,
}

impl Crossed {
    /// # Errors
    /// More squares than texels; an influence of zero, or beyond the number of squares.
    pub fn new(side: usize, influence: usize, plane: Plane) -> Result<Self> {
        check_parts("squares along each side", side, plane)?;
        if !(1..=side).contains(&influence) {
            let expected = format!("1 to {side}, the number of squares along a side");
            return Err(Error::invalid("the influence of a square", influence.to_string(), expected));
        }
        Ok(Self { plane, side, influence })
    }

    /// The column or row, the offset, and whether it is of the horizontal set.
    fn line(&self, n: usize) -> (usize, usize, bool) {
        let (half, n) = (n / (self.side * self.influence), n % (self.side * self.influence));
        (n / self.influence, n % self.influence, half == 0)
    }
}

impl Series for Crossed {
    fn len(&self) -> usize {
        2 * self.side * self.influence
    }

    fn element(&self, n: usize) -> Element {
        match self.line(n) {
            (column, offset, true) => Element::Horizontal { column, offset },
            (row, offset, false) => Element::Vertical { row, offset },
        }
    }

    fn values(&self, n: usize) -> Vec<f32> {
        let mut values = vec![0.0; self.plane.len()];
        let (line, offset, horizontal) = self.line(n);
        for along in (offset..self.side).step_by(self.influence) {
            let (column, row) = if horizontal { (line, along) } else { (along, line) };
            light(&mut values, self.plane, self.side, column, row);
        }
        values
    }
}
