//! The output: bands of rows, each made, scaled, composited and stored.

use rayon::prelude::*;
use relume_core::image::{Image as Picture, Window};

use crate::area::{self, Axis, Tap};
use crate::error::{Error, Result};
use crate::host::{Depth, Effect, Image, Layout, Rect};
use crate::pixels;
use crate::pool::Pool;

/// Rows of a band: enough work for all threads, little enough to stop soon.
pub const BAND: i32 = 128;

/// A picture of which any window can be made.
pub trait Element: Sync {
    /// Where its columns and rows lie in the host's grid.
    fn axes(&self) -> (Axis, Axis);

    /// A window of it, RGBA, rows downwards. Runs on our threads: no locks.
    ///
    /// # Errors
    /// What the field meets.
    fn pixels(&self, window: Window) -> Result<Picture>;

    /// Rows made at once.
    fn band(&self) -> i32 {
        BAND
    }

    /// Last changes to scaled pixels (RGBA, so many columns), for the depth that they are stored in.
    ///
    /// # Errors
    /// None in practice.
    fn stored(&self, rgba: Vec<f32>, _columns: usize, _depth: Depth) -> Result<Vec<f32>> {
        Ok(rgba)
    }
}

/// The output image, cleared unless it is finished.
pub struct Canvas<'a> {
    image: Image<'a>,
    window: Rect<i32>,
    finished: bool,
}

impl<'a> Canvas<'a> {
    /// An output of which a window is to be drawn; all of it for `None`.
    pub fn new(image: Image<'a>, window: Option<Rect<i32>>) -> Self {
        let bounds = image.layout().bounds;
        Self { image, window: window.map_or(bounds, |window| window.clipped(&bounds)), finished: false }
    }

    /// How it lies in memory.
    pub fn layout(&self) -> &Layout {
        self.image.layout()
    }

    /// Draws an element, over a plate if there is one.
    ///
    /// # Errors
    /// What the element meets; [`Error::Aborted`].
    pub fn draw(&mut self, effect: &Effect<'_>, element: &impl Element, plate: Option<&Image<'_>>) -> Result<()> {
        let (pool, layout, window) = (Pool::shared()?, *self.image.layout(), self.window);
        let axes = element.axes();
        let columns = axes.0.taps(window.x1, window.x2);
        let row_bytes = window.width() * layout.pixel_bytes();
        if row_bytes == 0 {
            self.finished = true;
            return Ok(());
        }
        let rows_at_once = element.band().max(1);
        for y1 in (window.y1..window.y2).step_by(rows_at_once as usize) {
            if effect.aborted() {
                return Err(Error::Aborted);
            }
            let y2 = y1.saturating_add(rows_at_once).min(window.y2);
            let under = plate.map(|plate| read_band(plate, &Rect { y1, y2, ..window }));
            let rows = axes.1.taps(y1, y2);
            let band = pool.run(|| band(element, &columns, &rows, under.as_deref(), &layout))?;
            for (y, stored) in (y1..y2).zip(band.chunks_exact(row_bytes)) {
                if let Some(row) = self.image.row_mut(y, window.x1, window.x2) {
                    row.copy_from_slice(stored);
                }
            }
        }
        self.finished = true;
        Ok(())
    }
}

impl Drop for Canvas<'_> {
    fn drop(&mut self) {
        if self.finished {
            return;
        }
        for y in self.window.y1..self.window.y2 {
            if let Some(row) = self.image.row_mut(y, self.window.x1, self.window.x2) {
                row.fill(0);
            }
        }
    }
}

/// The stored bytes of some rows, without padding. Runs on our threads: no locks.
fn band(
    element: &impl Element,
    columns: &[Tap],
    rows: &[Tap],
    under: Option<&[f32]>,
    layout: &Layout,
) -> Result<Vec<u8>> {
    let window = area::window(columns, rows);
    let rgba = if window.is_empty() {
        vec![0.0; columns.len() * rows.len() * 4]
    } else {
        area::resample(&element.pixels(window)?, window, columns, rows)
    };
    let mut rgba = element.stored(rgba, columns.len(), layout.depth)?;
    if let Some(under) = under {
        rgba.par_chunks_exact_mut(4).zip(under.par_chunks_exact(4)).for_each(|(e, s)| over(e, s));
    }
    let mut stored = vec![0; columns.len() * rows.len() * layout.pixel_bytes()];
    stored
        .par_chunks_mut(columns.len() * layout.pixel_bytes())
        .zip(rgba.par_chunks(columns.len() * 4))
        .for_each(|(stored, rgba)| pixels::encode(layout, rgba, stored));
    Ok(stored)
}

/// element + (1 - alpha) plate, both premultiplied. Where the element is opaque the plate counts for nothing, not even
/// as NaN.
fn over(element: &mut [f32], plate: &[f32]) {
    let through = 1.0 - element[3];
    if through != 0.0 {
        element.iter_mut().zip(plate).for_each(|(e, s)| *e += through * s);
    }
}

/// Linear premultiplied RGBA of a rectangle of an image, bottom row first; nothing outside the image's bounds.
fn read_band(image: &Image<'_>, rect: &Rect<i32>) -> Vec<f32> {
    let width = rect.width();
    let mut band = vec![0.0; width * rect.height() * 4];
    let inside = rect.clipped(&image.layout().bounds);
    if inside.width() == 0 {
        return band;
    }
    let left = (inside.x1 - rect.x1) as usize * 4;
    for y in inside.y1..inside.y2 {
        let start = (y - rect.y1) as usize * width * 4 + left;
        read_row(image, y, inside.x1, inside.x2, &mut band[start..start + inside.width() * 4]);
    }
    band
}

/// Linear premultiplied RGBA of part of a row; nothing where that is outside the image's bounds.
pub fn read_row(image: &Image<'_>, y: i32, x1: i32, x2: i32, out: &mut [f32]) {
    match image.row(y, x1, x2) {
        Some(bytes) => pixels::decode(image.layout(), bytes, out),
        None => out.fill(0.0),
    }
}

#[cfg(test)]
mod tests {
    use super::over;

    #[test]
    fn over_is_premultiplied_and_opaque_hides_everything() {
        let mut element = [0.5, 0.0, 2.0, 0.25];
        over(&mut element, &[1.0, 4.0, -2.0, 0.5]);
        assert_eq!(element, [1.25, 3.0, 0.5, 0.625]);
        let mut opaque = [0.5, 0.25, 0.125, 1.0];
        over(&mut opaque, &[f32::NAN, f32::INFINITY, 1.0, 1.0]);
        assert_eq!(opaque, [0.5, 0.25, 0.125, 1.0]);
        let mut nothing = [0.0; 4];
        over(&mut nothing, &[0.1, 0.2, 0.3, 0.4]);
        assert_eq!(nothing, [0.1, 0.2, 0.3, 0.4]);
    }
}
