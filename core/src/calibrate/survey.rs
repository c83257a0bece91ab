//! Reads a set of photographs, one lamp each, and notes what their balls and their patch show.
//!
//! One photograph for each thread is in memory at a time. What stands still is the median of at most fifteen of them,
//! spread over the set: reflections of windows, of the room, of the table are in every photograph, a lamp's highlight
//! in one.

use std::path::{Path, PathBuf};

use rayon::prelude::*;

use super::ball::find_balls;
use super::highlight::{Crop, Spots, find, luminance, still};
use super::reflect::{Ball, Lens};
use crate::error::{Error, Result};
use crate::illumination::probe::Circle;
use crate::image::{Encoding, Image, Window, probe_size, read};

/// Photographs that tell what stands still, and in whose mean balls are found.
const SAMPLE: usize = 15;

/// The outlines of the balls.
#[derive(Debug, Clone, PartialEq)]
pub enum Outlines {
    /// Given in pixels.
    Given(Vec<Circle>),
    /// So many are looked for in the mean of the photographs.
    Find(usize),
}

/// What to read, and what to look at.
#[derive(Debug, Clone, PartialEq)]
pub struct Survey {
    /// One lamp each.
    pub photographs: Vec<PathBuf>,
    /// How their numbers become light.
    pub encoding: Encoding,
    /// The photograph with every lamp off.
    pub black: Option<PathBuf>,
    /// The balls.
    pub outlines: Outlines,
    /// Field of view from the left of the picture to the right; `None` of a far camera.
    pub view_rad: Option<f64>,
    /// A white or grey patch.
    pub patch: Option<Window>,
}

/// What was seen.
#[derive(Debug, Clone, PartialEq)]
pub struct Surveyed {
    /// Columns and rows of every photograph.
    pub size: (usize, usize),
    /// The balls.
    pub balls: Vec<Ball>,
    /// `spots[photograph][ball]`.
    pub spots: Vec<Vec<Spots>>,
    /// Mean luminance of the patch in each photograph.
    pub patch: Option<Vec<f64>>,
}

impl Survey {
    /// Reads everything. `progress(photographs read, all)` may stop it with an error.
    ///
    /// # Errors
    /// Each names its file: no photograph, one that is missing, unreadable or of another size, a ball or a patch
    /// outside the picture, balls that are not found.
    pub fn run(&self, progress: &mut dyn FnMut(u64, u64) -> Result<()>) -> Result<Surveyed> {
        let size = self.size()?;
        self.check_patch(size)?;
        let black = self.black.as_deref().map(|path| read(path, self.encoding)).transpose()?;
        let lens = self.view_rad.map_or(Ok(Lens::Far), |view| Lens::pinhole(size.0, size.1, view))?;
        let circles = self.circles(size)?;
        let balls: Vec<Ball> = circles.into_iter().map(|circle| Ball::new(circle, lens)).collect();
        let still = self.still(&balls, black.as_ref())?;
        let look = |path: &PathBuf| -> Result<(Vec<Spots>, Option<f64>)> {
            let image = read(path, self.encoding)?;
            let crops = crops(&image, &balls, black.as_ref());
            let spots = (0..balls.len()).map(|b| find(&crops[b], &balls[b], still[b].as_deref())).collect();
            Ok((spots, self.patch.map(|patch| mean(&image, patch) - black.as_ref().map_or(0.0, |b| mean(b, patch)))))
        };
        let (mut spots, mut patch) = (Vec::new(), Vec::new());
        for group in self.photographs.chunks(rayon::current_num_threads()) {
            let seen: Vec<Result<_>> = group.par_iter().map(look).collect();
            for one in seen {
                let (shown, grey) = one?;
                spots.push(shown);
                patch.extend(grey);
            }
            progress(spots.len() as u64, self.photographs.len() as u64)?;
        }
        Ok(Surveyed { size, balls, spots, patch: self.patch.map(|_| patch) })
    }

    /// The one size of all photographs.
    fn size(&self) -> Result<(usize, usize)> {
        let Some(first) = self.photographs.first() else {
            return Err(Error::invalid("photographs", "none", "at least one"));
        };
        let size = probe_size(first)?;
        for path in self.photographs.iter().chain(&self.black) {
            let other = probe_size(path)?;
            if other != size {
                let expected = format!("{} x {} pixels, as {} has", size.0, size.1, first.display());
                let found = format!("{} x {} pixels", other.0, other.1);
                return Err(Error::invalid(path.display().to_string(), found, expected));
            }
        }
        Ok(size)
    }

    fn check_patch(&self, (w, h): (usize, usize)) -> Result<()> {
        match self.patch {
            Some(patch) if patch.is_empty() || patch.x1 > w || patch.y1 > h => {
                let found = format!("columns {} to {}, rows {} to {}", patch.x0, patch.x1, patch.y0, patch.y1);
                Err(Error::invalid("patch", found, format!("a rectangle inside the picture of {w} x {h} pixels")))
            }
            _ => Ok(()),
        }
    }

    /// Photographs spread over the set.
    fn sample(&self) -> Vec<&Path> {
        let n = self.photographs.len();
        let count = n.min(SAMPLE);
        (0..count).map(|k| self.photographs[k * n / count].as_path()).collect()
    }

    fn circles(&self, (w, h): (usize, usize)) -> Result<Vec<Circle>> {
        let place = self.photographs[0].display().to_string();
        match &self.outlines {
            Outlines::Given(circles) => {
                for circle in circles {
                    circle.check_inside(&place, w, h)?;
                }
                Ok(circles.clone())
            }
            Outlines::Find(count) => {
                let mut sum = Image::new(w, h, 3);
                for path in self.sample() {
                    let image = read(path, self.encoding)?.into_rgb();
                    sum.data_mut().iter_mut().zip(image.data()).for_each(|(s, v)| *s += v);
                }
                find_balls(&sum, &place, *count)
            }
        }
    }

    /// What stands still about each ball.
    fn still(&self, balls: &[Ball], black: Option<&Image>) -> Result<Vec<Option<Vec<f32>>>> {
        let mut seen: Vec<Vec<Crop>> = vec![Vec::new(); balls.len()];
        for path in self.sample() {
            let image = read(path, self.encoding)?;
            for (list, crop) in seen.iter_mut().zip(crops(&image, balls, black)) {
                list.push(crop);
            }
        }
        Ok(seen.iter().map(|crops| still(crops)).collect())
    }
}

fn crops(image: &Image, balls: &[Ball], black: Option<&Image>) -> Vec<Crop> {
    let crop = |ball: &Ball| {
        let mut crop = Crop::of(image, ball);
        if let Some(black) = black {
            let dark = Crop::of(black, ball);
            crop.values.iter_mut().zip(&dark.values).for_each(|(v, d)| *v -= d);
        }
        crop
    };
    balls.iter().map(crop).collect()
}

fn mean(image: &Image, window: Window) -> f64 {
    let pixels = (window.y0..window.y1).flat_map(|y| (window.x0..window.x1).map(move |x| (x, y)));
    let sum: f64 = pixels.map(|(x, y)| f64::from(luminance(image.pixel(x, y)))).sum();
    sum / (window.width() * window.height()) as f64
}
