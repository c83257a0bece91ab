//! A projector that throws a picture, from a point.
//!
//! The picture is flat: equal texels are equal on a plane across the axis, as a gantry's squares are. Columns go to the right and
//! row 0 is at the top as the projector sees the scene. White has one radiant intensity over the whole picture; beyond it is
//! darkness. Colours may exceed 1; what is negative in a file throws nothing.

use std::f64::consts::PI;
use std::sync::Arc;

use super::{Frame, Ray};
use crate::image::Image;
use crate::math::Vec3;

/// What is between the centres of texels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Lookup {
    /// Bilinear; at the rim the outermost texels are held.
    #[default]
    Smooth,
    /// Each texel is an even square.
    Squares,
}

/// A projector with a picture.
#[derive(Debug, Clone, PartialEq)]
pub struct Slide {
    /// Where it is and where it looks; the aim is where stops count, on white.
    pub frame: Frame,
    /// Half of the picture's width and height, at distance 1.
    half: [f64; 2],
    picture: Arc<Image>,
    lookup: Lookup,
}

impl Slide {
    /// `view_rad` is the angle across the picture's width; the height follows from its sides. Alpha is taken as over black.
    /// `None` for an empty picture, or a view that is not in (0, pi).
    pub fn new(frame: Frame, view_rad: f64, picture: Image, lookup: Lookup) -> Option<Self> {
        Self::with(frame, view_rad, Self::prepared(picture)?, lookup)
    }

    /// A picture ready to be thrown: three channels, nothing negative. `None` of an empty one.
    pub fn prepared(picture: Image) -> Option<Arc<Image>> {
        let mut picture = picture.into_rgb();
        picture.data_mut().iter_mut().for_each(|v| *v = v.max(0.0));
        (picture.width() > 0 && picture.height() > 0).then(|| Arc::new(picture))
    }

    /// As [`Slide::new`], of a [prepared](Slide::prepared) picture that others may share; `None` of any other.
    pub fn with(frame: Frame, view_rad: f64, picture: Arc<Image>, lookup: Lookup) -> Option<Self> {
        let (w, h) = picture.size();
        if w == 0 || h == 0 || picture.channels() != 3 || !(view_rad > 0.0 && view_rad < PI) {
            return None;
        }
        let across = (view_rad / 2.0).tan();
        Some(Self { frame, half: [across, across * h as f64 / w as f64], picture, lookup })
    }

    /// Where the projector sees a point: shares of its picture to the right and down, in [0, 1); `None` beyond.
    pub fn seen(&self, at: &Vec3) -> Option<[f64; 2]> {
        let to = at - self.frame.place;
        let depth = to.dot(&self.frame.axis);
        if depth <= self.frame.distance * super::NEAREST {
            return None;
        }
        let right = 0.5 + 0.5 * to.dot(&self.frame.right) / (depth * self.half[0]);
        let down = 0.5 - 0.5 * to.dot(&self.frame.up) / (depth * self.half[1]);
        let inside = |share: f64| (0.0..1.0).contains(&share);
        (inside(right) && inside(down)).then_some([right, down])
    }

    /// What the picture shows at a share of its width and height.
    fn colour(&self, [right, down]: [f64; 2]) -> [f64; 3] {
        let (w, h) = self.picture.size();
        let texel = |x: usize, y: usize, c: usize| f64::from(self.picture.pixel(x, y)[c]);
        let (u, v) = (right * w as f64, down * h as f64);
        if self.lookup == Lookup::Squares {
            let (x, y) = ((u as usize).min(w - 1), (v as usize).min(h - 1));
            return std::array::from_fn(|c| texel(x, y, c));
        }
        let between = |at: f64, count: usize| {
            let from = (at - 0.5).clamp(0.0, (count - 1) as f64);
            let low = from as usize;
            (low, (low + 1).min(count - 1), from - low as f64)
        };
        let ((x0, x1, fx), (y0, y1, fy)) = (between(u, w), between(v, h));
        std::array::from_fn(|c| {
            let top = texel(x0, y0, c) * (1.0 - fx) + texel(x1, y0, c) * fx;
            let bottom = texel(x0, y1, c) * (1.0 - fx) + texel(x1, y1, c) * fx;
            top * (1.0 - fy) + bottom * fy
        })
    }

    pub(super) fn rays(&self, at: &Vec3, each: Ray<'_>) {
        let Some(seen) = self.seen(at) else { return };
        let Some((towards, distance)) = self.frame.seen_from(at) else { return };
        let white = PI * (self.frame.distance / distance).powi(2);
        let colour = self.colour(seen);
        if colour != [0.0; 3] {
            each(towards, distance, colour.map(|c| c * white));
        }
    }
}
