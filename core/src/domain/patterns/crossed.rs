//! Horizontal and vertical sets of squares (7.5): many squares at once, and yet each alone.
//!
//! `H(x, o)` lights in column x every d-th square from row o on, `V(y, o)` in row y every d-th from column o on. What one
//! square answers is compact, so those lit together hardly meet, and `L(x, y) = min(H(x, y mod d), V(y, x mod d))` (7.1). 2 n d
//! photographs stand for n^2.

use super::squares::Squares;
use super::{Element, Series};
use crate::domain::{Filter, Plane};
use crate::error::{Error, Result};

#[derive(Debug)]
pub(super) struct Crossed {
    squares: Squares,
    side: usize,
    influence: usize,
}

impl Crossed {
    /// # Errors
    /// Squares that the plane does not have; an influence of zero, beyond the number of squares, or so small that squares that are
    /// lit together overlap.
    pub fn new(side: usize, influence: usize, filter: Filter, plane: Plane) -> Result<Self> {
        let squares = Squares::new(side, filter, plane)?;
        // A square reaches so far to either side; the next begins where it ends.
        let least = (2.0 * filter.reach()).ceil() as usize;
        if !(least.min(side)..=side).contains(&influence) {
            let why = if least > 1 {
                format!(": {} squares reach into their neighbours", filter.id())
            } else {
                String::new()
            };
            let expected = format!("{} to {side}, the number of squares along a side{why}", least.min(side));
            return Err(Error::invalid("the influence of a square", influence.to_string(), expected));
        }
        Ok(Self { squares, side, influence })
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
        let mut values = self.squares.dark();
        let (line, offset, horizontal) = self.line(n);
        for along in (offset..self.side).step_by(self.influence) {
            let (column, row) = if horizontal { (line, along) } else { (along, line) };
            self.squares.light(&mut values, column, row);
        }
        values
    }
}
