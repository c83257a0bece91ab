//! The picture of a projector in n x n squares, one lit after another: filtered samples of angle (7.3).
//!
//! A square of the box filter has edges; one of the tent or the Gaussian spreads over its neighbours, so each of its texels has its
//! own light, that of the filter at the texel's centre.

use super::{Element, Series, check_parts, part};
use crate::domain::{Filter, Plane};
use crate::error::{Error, Result};

/// Texels along a square that a filter which falls off needs to have a shape at all.
const SHAPED: usize = 2;

/// A picture of squares.
#[derive(Debug)]
pub(super) struct Squares {
    plane: Plane,
    side: usize,
    filter: Filter,
}

impl Squares {
    /// # Errors
    /// More squares than texels; fewer than [`SHAPED`] texels along a square that falls off.
    pub fn new(side: usize, filter: Filter, plane: Plane) -> Result<Self> {
        check_parts("squares along each side", side, plane)?;
        let shortest = plane.columns().min(plane.rows());
        if filter != Filter::Box && shortest < SHAPED * side {
            let place = format!("{side} {} squares along each side", filter.id());
            let expected = format!("{} texels or more: a square of one texel is a box", SHAPED * side);
            return Err(Error::invalid(place, format!("{shortest} texels"), expected));
        }
        Ok(Self { plane, side, filter })
    }

    /// No light.
    pub fn dark(&self) -> Vec<f32> {
        vec![0.0; self.plane.len()]
    }

    /// Adds the light of a square.
    pub fn light(&self, values: &mut [f32], column: usize, row: usize) {
        let across = profile(self.filter, column, self.side, self.plane.columns());
        for (row, down) in profile(self.filter, row, self.side, self.plane.rows()) {
            let line = &mut values[row * self.plane.columns()..];
            across.iter().for_each(|(column, light)| line[*column] += light * down);
        }
    }
}

/// Texels along one direction that the `n`-th of `count` squares lights, and how much.
fn profile(filter: Filter, n: usize, count: usize, texels: usize) -> Vec<(usize, f32)> {
    if filter == Filter::Box {
        return part(n, count, texels).map(|texel| (texel, 1.0)).collect();
    }
    let offset = |texel: usize| (texel as f64 + 0.5) * count as f64 / texels as f64 - (n as f64 + 0.5);
    (0..texels).map(|texel| (texel, filter.at(offset(texel)) as f32)).filter(|(_, light)| *light > 0.0).collect()
}

impl Series for Squares {
    fn len(&self) -> usize {
        self.side * self.side
    }

    fn element(&self, n: usize) -> Element {
        Element::Square { column: n % self.side, row: n / self.side }
    }

    fn values(&self, n: usize) -> Vec<f32> {
        let mut values = self.dark();
        self.light(&mut values, n % self.side, n / self.side);
        values
    }
}
