//! The element in the plate, and over it.

use rayon::prelude::*;

use super::place::{Mapping, Place};
use crate::error::{Error, Result};
use crate::image::{Image, Window};
use crate::relight::{Look, ScreenRelighter, Weights};

/// Places across a pixel of the plate where the object's picture is looked at, at most: below a scale of 1/16 it is dust.
const MOST_ACROSS: usize = 16;

/// What is shown.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Show {
    /// The object over the plate.
    #[default]
    Composite,
    /// The object alone, premultiplied.
    Element,
    /// Its coverage, as grey.
    Alpha,
}

/// An object placed in plates of one size.
#[derive(Debug, Clone, Copy)]
pub struct Composite {
    object: (usize, usize),
    plate: (usize, usize),
    mapping: Mapping,
}

impl Composite {
    /// An object's picture of one size in plates of another, width and height.
    ///
    /// # Errors
    /// What [`Place::check`] refuses.
    pub fn new(object: (usize, usize), place: &Place, plate: (usize, usize)) -> Result<Self> {
        place.check()?;
        Ok(Self { object, plate, mapping: place.between(object, plate) })
    }

    /// The element `T L + g S` in a window of the plate, RGBA premultiplied, in the colours of the look. Linear between pixels
    /// where it is moved, averaged where it shrinks, pixel for pixel where it is neither.
    ///
    /// # Errors
    /// As [`ScreenRelighter::render`]; a window outside of the plate.
    pub fn element(
        &self,
        relighter: &ScreenRelighter,
        (weights, look): (&Weights, &Look),
        window: Window,
    ) -> Result<Image> {
        if window.x1 > self.plate.0 || window.y1 > self.plate.1 || window.x0 > window.x1 || window.y0 > window.y1 {
            let expected = format!("one inside {} x {}", self.plate.0, self.plate.1);
            return Err(Error::invalid("window", format!("{window:?}"), expected));
        }
        let Some(part) = self.part_of(window) else { return Ok(Image::new(window.width(), window.height(), 4)) };
        let lit = relighter.render(weights, look, part)?;
        Ok(self.placed(&lit, part, window))
    }

    /// Element and plate together, RGBA; both of a window of the plate, the plate without alpha taken as opaque.
    ///
    /// # Panics
    /// When the two differ in size.
    pub fn over(element: &Image, plate: &Image) -> Image {
        assert_eq!(element.size(), plate.size(), "element and plate of one window");
        let mut out = element.clone();
        let channels = plate.channels();
        let pixels = out.data_mut().par_chunks_exact_mut(4);
        pixels.zip(plate.data().par_chunks_exact(channels)).for_each(|(pixel, plate)| {
            let through = 1.0 - pixel[3];
            (0..3).for_each(|c| pixel[c] += through * plate[c]);
            pixel[3] += through * plate.get(3).copied().unwrap_or(1.0);
        });
        out
    }

    /// The part of the object's picture that a window shows, if any.
    fn part_of(&self, window: Window) -> Option<Window> {
        let (w, h) = (window.x1 as f64, window.y1 as f64);
        let (x0, y0) = (window.x0 as f64, window.y0 as f64);
        let corners = [[x0, y0], [w, y0], [x0, h], [w, h]].map(|corner| self.mapping.object(corner));
        let ends = |i: usize| {
            let all = corners.map(|corner| corner[i]);
            (all.iter().copied().fold(f64::INFINITY, f64::min), all.iter().copied().fold(f64::NEG_INFINITY, f64::max))
        };
        // A pixel more on each side for what lies between pixels.
        let side = |(least, most): (f64, f64), size: usize| {
            let first = (least - 1.0).floor().clamp(0.0, size as f64) as usize;
            (first, ((most + 1.0).ceil().clamp(0.0, size as f64) as usize))
        };
        let ((x0, x1), (y0, y1)) = (side(ends(0), self.object.0), side(ends(1), self.object.1));
        (x0 < x1 && y0 < y1).then_some(Window { x0, y0, x1, y1 })
    }

    /// A part of the object's picture in a window of the plate.
    fn placed(&self, lit: &Image, part: Window, window: Window) -> Image {
        let across = ((1.0 / self.mapping.scale).ceil() as usize).clamp(1, MOST_ACROSS);
        let (share, width) = (1.0 / (across * across) as f32, window.width());
        let mut out = Image::new(width, window.height(), 4);
        let rows = out.data_mut().par_chunks_exact_mut(4 * width.max(1)).enumerate();
        rows.for_each(|(y, row)| {
            for (x, pixel) in row.as_chunks_mut::<4>().0.iter_mut().enumerate() {
                for n in 0..across * across {
                    let inside = |k: usize| (k as f64 + 0.5) / across as f64;
                    let at = [(window.x0 + x) as f64 + inside(n % across), (window.y0 + y) as f64 + inside(n / across)];
                    let [u, v] = self.mapping.object(at);
                    let weight = share * self.coverage([u, v]);
                    if weight > 0.0 {
                        let mut rgba = [0.0; 4];
                        linear(lit, [u - part.x0 as f64, v - part.y0 as f64], &mut rgba);
                        pixel.iter_mut().zip(rgba).for_each(|(sum, v)| *sum += weight * v);
                    }
                }
            }
        });
        out
    }

    /// 1 in the object's picture, 0 beyond it, and a ramp of a pixel of the plate across its edge.
    fn coverage(&self, [u, v]: [f64; 2]) -> f32 {
        let along = |at: f64, size: usize| (at.min(size as f64 - at) * self.mapping.scale + 0.5).clamp(0.0, 1.0);
        (along(u, self.object.0) * along(v, self.object.1)) as f32
    }
}

/// A picture at a place, linear between pixel centres (+0.5), its edge beyond them.
pub(super) fn linear<const N: usize>(image: &Image, [x, y]: [f64; 2], out: &mut [f32; N]) {
    let along = |at: f64, size: usize| {
        let at = (at - 0.5).clamp(0.0, (size - 1) as f64);
        let low = at.floor();
        (low as usize, (low as usize + 1).min(size - 1), (at - low) as f32)
    };
    let ((x0, x1, s), (y0, y1, t)) = (along(x, image.width()), along(y, image.height()));
    let corners = [(x0, y0, (1.0 - s) * (1.0 - t)), (x1, y0, s * (1.0 - t)), (x0, y1, (1.0 - s) * t), (x1, y1, s * t)];
    *out = [0.0; N];
    for (x, y, weight) in corners {
        if weight > 0.0 {
            out.iter_mut().zip(image.pixel(x, y)).for_each(|(sum, v)| *sum += weight * v);
        }
    }
}
