//! Source as a plate: a grid of square cells in which the object is placed, and what the plate shows in it.
//!
//! Where the host's pixels are square a cell is a pixel. Where they are not (anamorphic formats, a render scale that differs in
//! the two directions) cells are as large as a pixel is along its shorter side; the plate is linear between pixels along the
//! other, and what is made in cells is averaged back to pixels by [`crate::area`].

use rayon::prelude::*;
use relume_core::image::Image as Picture;
use relume_core::matte::Place;

use crate::area::Axis;
use crate::effects::canvas::read_row;
use crate::effects::regions;
use crate::error::{Error, Result};
use crate::host::{Image, Rect};

/// A side beyond this is a host's way of saying "no end".
const LARGEST_SIDE: usize = 1 << 17;
/// Pixels farther from square than this are a mistake: the most anamorphic lenses squeeze by 2, proxies by a power of two.
const LARGEST_RATIO: f64 = 16.0;
/// Edges closer to a whole pixel than this are on it: scales such as 1/3 are not exact in binary.
const SNAP: f64 = 1e-6;
/// The scales that a core's place allows.
const SCALES: (f64, f64) = (0.001, 1000.0);

/// The plate's place in the host's grid of pixels, and its cells.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Grid {
    /// The plate's pixels at the render scale.
    pixels: Rect<i32>,
    /// Its cells, counted as pixels are.
    cells: Rect<i32>,
    /// Cells to a pixel, across and up; one of them is 1.
    ratio: (f64, f64),
    /// Cells to a canonical unit.
    density: f64,
    /// The plate's middle in cells.
    middle: (f64, f64),
}

impl Grid {
    /// The grid of a plate's image: of the region that the clip tells (canonical), or, where that is not known or the image does
    /// not have it, of the region that the image itself tells. Rendered at a scale, in pixels so many times as wide as high.
    ///
    /// # Errors
    /// An image that is only a part of the plate; a plate without end; pixels far from square.
    pub fn of(image: &Image<'_>, region: Option<Rect<f64>>, scale: (f64, f64), aspect: f64) -> Result<Self> {
        let bounds = image.layout().bounds;
        // A pixel less on a side is a host that rounds another way.
        let held = |grid: &Self| {
            let Rect { x1, y1, x2, y2 } = grid.pixels;
            let grown = Rect {
                x1: bounds.x1.saturating_sub(1),
                y1: bounds.y1.saturating_sub(1),
                x2: bounds.x2.saturating_add(1),
                y2: bounds.y2.saturating_add(1),
            };
            x1 < x2 && y1 < y2 && bounds.width() > 0 && bounds.height() > 0 && grown.covers(&grid.pixels)
        };
        let told = region.map(|region| Self::new(&region, scale, aspect)).transpose()?;
        if let Some(grid) = told.filter(held) {
            return Ok(grid);
        }
        Some(Self::new(&regions::of_image(image, scale), scale, aspect)?).filter(held).ok_or_else(|| Error::Host {
            what: "delivered only part of Source, and all of it is light".to_owned(),
            advice: "switch off tiles or regions of interest for this effect, or crop Source to its format before it",
        })
    }

    fn new(region: &Rect<f64>, scale: (f64, f64), aspect: f64) -> Result<Self> {
        // Pixels to a canonical unit.
        let (across, up) = (scale.0 / aspect, scale.1);
        let density = across.max(up);
        let ratio = (density / across, density / up);
        if [ratio.0, ratio.1].iter().any(|side| side.is_nan() || *side > LARGEST_RATIO) {
            return Err(Error::host(format!("gave pixels {:.3} times as wide as high", up / across)));
        }
        let outwards = |x: f64, y: f64| {
            let (low, high) = (|v: f64| (v + SNAP).floor() as i32, |v: f64| (v - SNAP).ceil() as i32);
            Rect { x1: low(region.x1 * x), y1: low(region.y1 * y), x2: high(region.x2 * x), y2: high(region.y2 * y) }
        };
        let (pixels, cells) = (outwards(across, up), outwards(density, density));
        if cells.width() > LARGEST_SIDE || cells.height() > LARGEST_SIDE {
            return Err(Error::Host {
                what: format!("says that Source has {} x {} pixels", cells.width(), cells.height()),
                advice: "crop or reformat Source to the size of the project before this effect",
            });
        }
        let middle = (density * 0.5 * (region.x1 + region.x2), density * 0.5 * (region.y1 + region.y2));
        Ok(Self { pixels, cells, ratio, density, middle })
    }

    /// Columns and rows of cells.
    pub fn size(&self) -> (usize, usize) {
        (self.cells.width(), self.cells.height())
    }

    /// A place at full scale, in cells.
    pub fn place(&self, place: &Place) -> Place {
        let Rect { x1, y1, x2, y2 } = self.cells;
        let middle = |a: i32, b: i32| 0.5 * (f64::from(a) + f64::from(b));
        // Rounding outwards can move the middle of the cells away from that of the plate. Places go down, regions up.
        let (right, up) = (self.middle.0 - middle(x1, x2), self.middle.1 - middle(y1, y2));
        let [x, y] = place.shift.map(|pixels| self.density * pixels);
        let scale = (self.density * place.scale).clamp(SCALES.0, SCALES.1);
        Place { shift: [x + right, y - up], scale, ..*place }
    }

    /// Where the cells lie in the host's grid.
    pub fn axes(&self) -> (Axis, Axis) {
        let (width, height) = self.size();
        let (left, bottom) = (f64::from(self.cells.x1), f64::from(self.cells.y1));
        (
            Axis { step: self.ratio.0, origin: left, length: width, flipped: false },
            Axis { step: self.ratio.1, origin: bottom, length: height, flipped: true },
        )
    }

    /// Tells one plate from another by all of its pixels: hosts' identifiers of images are not to be relied on.
    pub fn digest(&self, image: &Image<'_>) -> blake3::Hash {
        let layout = image.layout();
        let part = self.pixels.clipped(&layout.bounds);
        let mut hasher = blake3::Hasher::new();
        hasher.update(format!("{part:?} {:?} {:?} {:?}", layout.depth, layout.components, layout.alpha).as_bytes());
        for y in part.y1..part.y2 {
            image.row(y, part.x1, part.x2).into_iter().for_each(|row| {
                hasher.update(row);
            });
        }
        hasher.finalize()
    }

    /// The plate's pixels as linear premultiplied RGB, rows downwards. What is not a number is no light; a pixel that is missing
    /// at an edge is the one next to it.
    ///
    /// # Errors
    /// None in practice: the sizes agree.
    pub fn read(&self, image: &Image<'_>) -> Result<Picture> {
        let (bounds, whole) = (image.layout().bounds, self.pixels);
        let part = whole.clipped(&bounds);
        let mut data = Vec::with_capacity(whole.width() * whole.height() * 3);
        let mut row = vec![0.0; part.width() * 4];
        for y in (whole.y1..whole.y2).rev() {
            read_row(image, y.clamp(part.y1, part.y2 - 1), part.x1, part.x2, &mut row);
            for x in whole.x1..whole.x2 {
                let at = (x.clamp(part.x1, part.x2 - 1) - part.x1) as usize * 4;
                data.extend(row[at..at + 3].iter().map(|v| if v.is_finite() { *v } else { 0.0 }));
            }
        }
        Ok(Picture::from_data(whole.width(), whole.height(), 3, data)?)
    }

    /// A plate's pixels as cells. Runs on our threads.
    ///
    /// # Errors
    /// None in practice: the sizes agree.
    pub fn squared(&self, pixels: Picture) -> Result<Picture> {
        if self.ratio == (1.0, 1.0) {
            return Ok(pixels);
        }
        let (width, height) = self.size();
        let columns: Vec<_> = (0..width)
            .map(|i| self.between(i, (self.cells.x1, self.pixels.x1), self.ratio.0, pixels.width()))
            .collect();
        // Rows go down: the first is the top one.
        let tops = (-self.cells.y2, -self.pixels.y2);
        let mut data = vec![0.0f32; width * height * 3];
        data.par_chunks_exact_mut(width * 3).enumerate().for_each(|(j, out)| {
            let (y0, y1, t) = self.between(j, tops, self.ratio.1, pixels.height());
            for ((x0, x1, s), out) in columns.iter().zip(out.as_chunks_mut::<3>().0) {
                let mix = |y: usize, c: usize| (1.0 - s) * pixels.pixel(*x0, y)[c] + s * pixels.pixel(*x1, y)[c];
                *out = std::array::from_fn(|c| (1.0 - t) * mix(y0, c) + t * mix(y1, c));
            }
        });
        Ok(Picture::from_data(width, height, 3, data)?)
    }

    /// The two pixels on both sides of the middle of cell `n`, and the share of the second.
    fn between(&self, n: usize, (cell, pixel): (i32, i32), ratio: f64, count: usize) -> (usize, usize, f32) {
        let at = (f64::from(cell) + n as f64 + 0.5) / ratio - f64::from(pixel) - 0.5;
        let at = at.clamp(0.0, (count - 1) as f64);
        let low = at.floor() as usize;
        (low, (low + 1).min(count - 1), (at - at.floor()) as f32)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PLATE: Rect<f64> = Rect { x1: -8.0, y1: 10.0, x2: 1912.0, y2: 1090.0 };

    #[test]
    fn at_full_scale_a_cell_is_a_pixel_and_a_place_stays() {
        let grid = Grid::new(&PLATE, (1.0, 1.0), 1.0).unwrap();
        assert_eq!((grid.size(), grid.pixels), ((1920, 1080), Rect { x1: -8, y1: 10, x2: 1912, y2: 1090 }));
        let place = Place { shift: [33.5, -4.0], scale: 0.7, rotate_deg: 12.0 };
        assert_eq!(grid.place(&place), place);
        let (columns, rows) = grid.axes();
        // Lower left: the first column, and the last row of the picture.
        assert_eq!((columns.footprint(-8), rows.footprint(10)), ((0.0, 1.0), (1079.0, 1080.0)));
    }

    /// Half of 1921 pixels is not a whole number: the object stays where it is in the picture.
    #[test]
    fn smaller_scales_keep_the_middle() {
        let region = Rect { x1: 0.0, y1: 0.0, x2: 1921.0, y2: 1081.0 };
        let grid = Grid::new(&region, (0.5, 0.5), 1.0).unwrap();
        assert_eq!(grid.size(), (961, 541));
        let place = grid.place(&Place { shift: [10.0, 20.0], scale: 2.0, rotate_deg: 5.0 });
        // Middle of the plate: 480.25 of 961 across, 270.25 from below, which is 270.75 from above of 541.
        assert_eq!(place, Place { shift: [5.0 - 0.25, 10.0 + 0.25], scale: 1.0, rotate_deg: 5.0 });
        let third = Grid::new(&Rect { x1: 0.0, y1: 0.0, x2: 1920.0, y2: 1080.0 }, (1.0 / 3.0, 1.0 / 3.0), 1.0).unwrap();
        assert_eq!(third.size(), (640, 360), "a third is not exact, its edges are");
        let tiny = third.place(&Place { scale: 0.001, ..Place::default() });
        tiny.check().unwrap();
    }

    #[test]
    fn pixels_that_are_not_square_become_cells_that_are() {
        // Anamorphic by 2: a canonical region of 40 x 10 is 20 x 10 pixels.
        let grid = Grid::new(&Rect { x1: 0.0, y1: 0.0, x2: 40.0, y2: 10.0 }, (1.0, 1.0), 2.0).unwrap();
        assert_eq!((grid.pixels.width(), grid.size(), grid.ratio), (20, (40, 10), (2.0, 1.0)));
        // A ramp stays the ramp: cell i has its middle at (i + 0.5) / 2 pixels.
        let ramp = Picture::from_fn(20, 10, |x, y| [x as f32 + 0.5, y as f32 + 0.5, 1.0]);
        let cells = grid.squared(ramp).unwrap();
        for (x, y) in (1..39).flat_map(|x| (0..10).map(move |y| (x, y))) {
            assert_eq!(cells.pixel(x, y), [(x as f32 + 0.5) / 2.0, y as f32 + 0.5, 1.0]);
        }
        let (columns, _) = grid.axes();
        assert_eq!(columns.footprint(3), (6.0, 8.0));
        // Narrow pixels: rows are what is refined.
        let grid = Grid::new(&Rect { x1: -10.0, y1: 4.0, x2: 10.0, y2: 24.0 }, (1.0, 1.0), 0.5).unwrap();
        assert_eq!((grid.pixels.width(), grid.pixels.height(), grid.size()), (40, 20, (40, 40)));
        let cells = grid.squared(Picture::from_fn(40, 20, |x, y| [x as f32, y as f32 + 0.5, 0.0])).unwrap();
        assert_eq!(cells.pixel(7, 9), [7.0, 4.75, 0.0]);
    }

    #[test]
    fn absurd_plates_are_refused() {
        let side = |x2: f64| Rect { x1: 0.0, y1: 0.0, x2, y2: 10.0 };
        assert!(Grid::new(&side(1e8), (1.0, 1.0), 1.0).unwrap_err().to_string().contains("100000000 x 10"));
        for aspect in [1e-9, 1e9, f64::INFINITY, f64::NAN] {
            assert!(Grid::new(&side(10.0), (1.0, 1.0), aspect).is_err(), "{aspect}");
        }
    }
}
