//! The columns of S as patterns (6.6.4): the functions that are emitted one after another in explicit sampling.
//!
//! Light cannot be negative, so each function is shown in two parts, and one is subtracted from the other: `C = C+ - C-`. Both
//! parts share one scale, that of the larger. The other mapping of 6.6.4, `psi' = (psi / scale + 1) / 2` and
//! `C = scale (2 C' - C_white)`, takes half the photographs, and half the range.

use super::{Element, Series};
use crate::domain::Plane;
use crate::error::Result;
use crate::wavelet::{Transform, Tree, Wavelet};

/// The basis functions of a wavelet on a screen, mirrored at its edges, in the constant-energy normalisation.
#[derive(Debug, Clone)]
pub struct Wavelets {
    transform: Transform,
    tree: Tree,
    /// Locations of coefficients, coarsest level first, the orientations of a place together; and whether it is the negative
    /// part.
    parts: Vec<(u32, bool)>,
}

impl Wavelets {
    /// The basis functions of a grid.
    ///
    /// # Errors
    /// D4 and D8, which cannot be mirrored.
    pub fn new(wavelet: Wavelet, plane: Plane) -> Result<Self> {
        let transform = plane.transform(wavelet)?;
        let tree = transform.tree();
        let mut order: Vec<u32> = (0..plane.len() as u32).collect();
        order.sort_by_cached_key(|&location| {
            let place = tree.place(location);
            (place.level, place.orientation.is_some(), place.y, place.x, place.orientation)
        });
        let several_roots = tree.roots().nth(1).is_some();
        let parts = |location: u32| {
            // Details have both parts. Of scaling functions only those of the 9/7 swing below zero, unless one covers all.
            let both = tree.orientation(location).is_some() || (wavelet == Wavelet::Daubechies97 && several_roots);
            std::iter::once((location, false)).chain(both.then_some((location, true)))
        };
        let parts = order.into_iter().flat_map(parts).collect();
        Ok(Self { tree: tree.clone(), parts, transform })
    }

    /// The transform whose S this is.
    pub fn transform(&self) -> &Transform {
        &self.transform
    }

    /// The basis function at a location: column of S, one number a texel.
    pub fn function(&self, location: u32) -> Vec<f32> {
        let mut function = vec![0.0; self.tree.len()];
        function[location as usize] = 1.0;
        self.transform.inverse(&mut function, 1);
        function
    }

    /// One part of the basis function at a location, scaled to 0 to 1, and the scale of both: the function is scale times the
    /// positive part less the negative one. (Explicit sampling asks for locations one after another.)
    pub fn part(&self, location: u32, negative: bool) -> (Vec<f32>, f32) {
        let mut values = self.function(location);
        let scale = values.iter().fold(0.0f32, |largest, value| largest.max(value.abs()));
        let gain = if negative { -1.0 } else { 1.0 } / scale;
        values.iter_mut().for_each(|value| *value = (*value * gain).max(0.0));
        (values, scale)
    }
}

impl Series for Wavelets {
    fn len(&self) -> usize {
        self.parts.len()
    }

    fn element(&self, n: usize) -> Element {
        let (location, negative) = self.parts[n];
        Element::wavelet(location, self.tree.place(location), negative)
    }

    fn values(&self, n: usize) -> Vec<f32> {
        let (location, negative) = self.parts[n];
        self.part(location, negative).0
    }

    fn scale(&self, n: usize) -> f32 {
        let (location, negative) = self.parts[n];
        self.part(location, negative).1
    }
}

/// The basis functions shifted to mid-grey, one pattern each.
#[derive(Debug, Clone)]
pub(super) struct Shifted {
    wavelets: Wavelets,
    /// Locations in the order of [`Wavelets`], and whether they are shifted: those with a negative part.
    functions: Vec<(u32, bool)>,
}

impl Shifted {
    /// The basis functions of a grid.
    ///
    /// # Errors
    /// D4 and D8, which cannot be mirrored.
    pub(super) fn new(wavelet: Wavelet, plane: Plane) -> Result<Self> {
        let wavelets = Wavelets::new(wavelet, plane)?;
        let mut functions: Vec<(u32, bool)> = Vec::new();
        for (location, negative) in &wavelets.parts {
            match functions.last_mut() {
                Some(last) if *negative => last.1 = true,
                _ => functions.push((*location, false)),
            }
        }
        Ok(Self { wavelets, functions })
    }
}

impl Series for Shifted {
    fn len(&self) -> usize {
        self.functions.len()
    }

    fn element(&self, n: usize) -> Element {
        let (location, shifted) = self.functions[n];
        let place = self.wavelets.tree.place(location);
        if shifted { Element::shifted(location, place) } else { Element::wavelet(location, place, false) }
    }

    fn values(&self, n: usize) -> Vec<f32> {
        let (location, shifted) = self.functions[n];
        let (mut values, scale) = self.wavelets.part(location, false);
        if shifted {
            values = self.wavelets.function(location);
            values.iter_mut().for_each(|value| *value = (0.5 * (*value / scale + 1.0)).clamp(0.0, 1.0));
        }
        values
    }

    fn scale(&self, n: usize) -> f32 {
        self.wavelets.part(self.functions[n].0, false).1
    }
}
