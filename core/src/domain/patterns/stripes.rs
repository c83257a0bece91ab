//! Stripes, lit and dark by turns, each pattern with its inverse.
//!
//! Progressively finer ones tell which pixels see the screen directly (Zongker, Werner, Curless and Salesin 1999, "Environment
//! matting and compositing"; 6.6.4). Some 64 of them in each direction tie the camera's pixels to the screen's (6.3).

use super::{Direction, Element, Series, check_parts};
use crate::domain::Plane;
use crate::error::{Error, Result};

#[derive(Debug)]
pub(super) struct Stripes {
    plane: Plane,
    patterns: Vec<(Direction, usize, bool)>,
}

impl Stripes {
    /// `count` stripes in each direction, or, if nothing is said, 2, 4, 8 and so on until they are one texel wide.
    ///
    /// # Errors
    /// Fewer than two stripes, or more than the shorter side has texels.
    pub fn new(count: Option<usize>, plane: Plane) -> Result<Self> {
        if count == Some(1) {
            return Err(Error::invalid("stripes", "one alone", "two or more"));
        }
        count.map_or(Ok(()), |count| check_parts("stripes", count, plane))?;
        let counts = |side: usize| -> Vec<usize> {
            let finer = std::iter::successors(Some(2usize), |count| Some(2 * count));
            count.map_or_else(|| finer.take_while(|count| *count <= side).collect(), |count| vec![count])
        };
        let both = |direction: Direction, side: usize| {
            counts(side).into_iter().flat_map(move |count| [false, true].map(|inverse| (direction, count, inverse)))
        };
        let vertical = both(Direction::Vertical, plane.columns());
        let patterns = vertical.chain(both(Direction::Horizontal, plane.rows())).collect();
        Ok(Self { plane, patterns })
    }
}

impl Series for Stripes {
    fn len(&self) -> usize {
        self.patterns.len()
    }

    fn element(&self, n: usize) -> Element {
        let (stripes, count, inverse) = self.patterns[n];
        Element::Stripes { stripes, count, inverse }
    }

    fn values(&self, n: usize) -> Vec<f32> {
        let (direction, count, inverse) = self.patterns[n];
        let lit = |at: usize, side: usize| (at * count / side).is_multiple_of(2) != inverse;
        along(self.plane, direction, lit)
    }
}

/// Light of a pattern that changes in one direction only: `lit(place, side)`.
pub(super) fn along(plane: Plane, direction: Direction, lit: impl Fn(usize, usize) -> bool) -> Vec<f32> {
    let (columns, rows) = plane.size();
    let value = |element: usize| match direction {
        Direction::Vertical => lit(element % columns, columns),
        Direction::Horizontal => lit(element / columns, rows),
    };
    (0..plane.len()).map(|element| f32::from(u8::from(value(element)))).collect()
}
