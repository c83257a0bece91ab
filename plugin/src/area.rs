//! Scaling by area: a pixel of the host is the mean of the element over the pixel's footprint.
//!
//! The element (rows downwards) lies somewhere in the host's pixel grid (rows upwards), a whole number of element
//! pixels from the origin, each `step` element pixels to the pixel of the host. Outside the element there is nothing,
//! so the sum of pixel areas times values is kept. At scale one every footprint is one element pixel and values pass
//! unchanged. The flip of rows happens here, in [`Axis::flipped`], and nowhere else.

use rayon::prelude::*;
use relume_core::image::{Image, Window};

/// Edges closer to a whole element pixel than this are on it: scales such as 1/3 are not exact in binary.
const SNAP: f64 = 1e-6;

/// One direction of the host's grid, seen from the element.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Axis {
    /// Element pixels from one host pixel to the next.
    pub step: f64,
    /// Element coordinate (upwards or rightwards) of the host's coordinate 0, negated: where the element starts.
    pub origin: f64,
    /// Element pixels in this direction.
    pub length: usize,
    /// Does the element count against the host's direction?
    pub flipped: bool,
}

impl Axis {
    /// The footprint of a host pixel in element coordinates, lower edge first; may lie outside the element.
    pub fn footprint(&self, index: i32) -> (f64, f64) {
        let edge = |i: f64| {
            let at = i * self.step - self.origin;
            let at = if self.flipped { self.length as f64 - at } else { at };
            if (at - at.round()).abs() < SNAP { at.round() } else { at }
        };
        let (a, b) = (edge(f64::from(index)), edge(f64::from(index) + 1.0));
        (a.min(b), a.max(b))
    }

    /// What each of the host pixels `from..to` takes from the element.
    pub fn taps(&self, from: i32, to: i32) -> Vec<Tap> {
        (from..to).map(|index| Tap::over(self.footprint(index), self.length)).collect()
    }
}

/// The element pixels under one footprint, each with its share of the footprint.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Tap {
    /// First element pixel.
    pub first: usize,
    /// Shares from there on; none where the footprint misses the element.
    pub shares: Vec<f32>,
}

impl Tap {
    fn over((low, high): (f64, f64), length: usize) -> Self {
        let (inside_low, inside_high) = (low.max(0.0), high.min(length as f64));
        if inside_low >= inside_high {
            return Self::default();
        }
        let (first, end) = (inside_low.floor() as usize, inside_high.ceil() as usize);
        let share = |i: usize| {
            let overlap = inside_high.min((i + 1) as f64) - inside_low.max(i as f64);
            (overlap / (high - low)) as f32
        };
        Self { first, shares: (first..end).map(share).collect() }
    }
}

/// The element pixels that some taps need: `first..end`, empty when none.
fn extent(taps: &[Tap]) -> (usize, usize) {
    let touched = || taps.iter().filter(|t| !t.shares.is_empty());
    let first = touched().map(|t| t.first).min().unwrap_or(0);
    let end = touched().map(|t| t.first + t.shares.len()).max().unwrap_or(0);
    (first, end)
}

/// The window of the element that some columns and rows of the host need.
pub fn window(columns: &[Tap], rows: &[Tap]) -> Window {
    let ((x0, x1), (y0, y1)) = (extent(columns), extent(rows));
    Window { x0, y0, x1, y1 }
}

/// The host's pixels, RGBA, row after row as `rows` are listed: `columns.len() * rows.len() * 4` samples. `element` is
/// the RGBA picture of `window` alone, rows downwards.
pub fn resample(element: &Image, window: Window, columns: &[Tap], rows: &[Tap]) -> Vec<f32> {
    let width = columns.len();
    let mut out = vec![0.0; width * rows.len() * 4];
    if window.is_empty() || width == 0 {
        return out;
    }
    let mut narrow = vec![0.0; width * window.height() * 4];
    narrow.par_chunks_mut(width * 4).enumerate().for_each(|(y, out)| {
        let row = element.row(y);
        for (tap, out) in columns.iter().zip(out.chunks_exact_mut(4)) {
            let start = tap.first.saturating_sub(window.x0) * 4;
            for (pixel, share) in row[start.min(row.len())..].chunks_exact(4).zip(&tap.shares) {
                add(out, pixel, *share);
            }
        }
    });
    out.par_chunks_mut(width * 4).zip(rows).for_each(|(out, tap)| {
        let start = tap.first.saturating_sub(window.y0);
        for (row, share) in narrow.chunks_exact(width * 4).skip(start).zip(&tap.shares) {
            add(out, row, *share);
        }
    });
    out
}

/// `out += share * values`.
fn add(out: &mut [f32], values: &[f32], share: f32) {
    for (out, value) in out.iter_mut().zip(values) {
        *out += share * value;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A picture without symmetry, with alpha.
    fn picture(width: usize, height: usize) -> Image {
        let data = (0..width * height * 4).map(|i| ((i * 7919 + 13) % 1009) as f32 / 100.0 - 2.0).collect();
        Image::from_data(width, height, 4, data).unwrap()
    }

    fn axes(element: &Image, step: (f64, f64), origin: (f64, f64)) -> (Axis, Axis) {
        let (width, height) = element.size();
        (
            Axis { step: step.0, origin: origin.0, length: width, flipped: false },
            Axis { step: step.1, origin: origin.1, length: height, flipped: true },
        )
    }

    fn scaled(element: &Image, axes: (Axis, Axis), (x1, y1, x2, y2): (i32, i32, i32, i32)) -> Vec<f32> {
        let (columns, rows) = (axes.0.taps(x1, x2), axes.1.taps(y1, y2));
        let window = window(&columns, &rows);
        let data = (window.y0..window.y1)
            .flat_map(|y| element.row(y)[window.x0 * 4..window.x1 * 4].iter().copied())
            .collect::<Vec<_>>();
        let part = Image::from_data(window.width(), window.height(), 4, data).unwrap();
        resample(&part, window, &columns, &rows)
    }

    /// The mean over a footprint by adding up overlaps with every pixel of the element, in f64, upwards.
    fn naive(element: &Image, step: (f64, f64), origin: (f64, f64), x: i32, y: i32, channel: usize) -> f64 {
        let overlap = |a: f64, b: f64, i: usize| (b.min(i as f64 + 1.0) - a.max(i as f64)).max(0.0);
        let (x, y) = (f64::from(x), f64::from(y));
        let mut sum = 0.0;
        for row in 0..element.height() {
            let up = element.height() - 1 - row;
            let tall = overlap(y * step.1 - origin.1, (y + 1.0) * step.1 - origin.1, up);
            for column in 0..element.width() {
                let wide = overlap(x * step.0 - origin.0, (x + 1.0) * step.0 - origin.0, column);
                sum += wide * tall * f64::from(element.pixel(column, row)[channel]);
            }
        }
        sum / (step.0 * step.1)
    }

    #[test]
    fn agrees_with_adding_up_every_overlap() {
        let element = picture(13, 9);
        for (step, origin) in [
            ((2.0, 2.0), (3.0, -5.0)),
            ((3.0, 3.0), (0.0, 0.0)),
            ((1.0 / 0.37, 1.0 / 0.37), (-4.0, 2.0)),
            ((0.5, 0.5), (1.0, 1.0)),
            ((2.0 / 1.5, 2.0), (7.0, 1.0)),
        ] {
            let bounds = (-12, -9, 30, 25);
            let out = scaled(&element, axes(&element, step, origin), bounds);
            let mut at = out.chunks_exact(4);
            for y in bounds.1..bounds.3 {
                for x in bounds.0..bounds.2 {
                    let pixel = at.next().unwrap();
                    for (channel, value) in pixel.iter().enumerate() {
                        let expected = naive(&element, step, origin, x, y, channel);
                        assert!((f64::from(*value) - expected).abs() < 1e-5, "{step:?} ({x}, {y}): {value} {expected}");
                    }
                }
            }
        }
    }

    #[test]
    fn keeps_energy() {
        let element = picture(31, 17);
        let sum = |data: &[f32]| data.iter().skip(1).step_by(4).map(|v| f64::from(*v)).sum::<f64>();
        for scale in [1.0, 0.5, 0.25, 1.0 / 3.0, 0.37, 1.6] {
            let step = (1.0 / scale, 1.0 / scale);
            let out = scaled(&element, axes(&element, step, (5.0, -3.0)), (-40, -40, 80, 80));
            let (before, after) = (sum(element.data()), sum(&out) / (scale * scale));
            assert!((before - after).abs() < 1e-3 * before.abs(), "{scale}: {before} {after}");
        }
    }

    #[test]
    fn scale_one_passes_values_unchanged_and_flips_rows_once() {
        let element = picture(6, 5);
        let out = scaled(&element, axes(&element, (1.0, 1.0), (10.0, 20.0)), (10, 20, 16, 25));
        for y in 0..5 {
            assert_eq!(&out[y * 24..(y + 1) * 24], element.row(4 - y));
        }
        let corner = scaled(&element, axes(&element, (1.0, 1.0), (10.0, 20.0)), (15, 24, 17, 26));
        assert_eq!(corner[0..4], *element.pixel(5, 0), "the top right pixel is in the first row of the file");
        assert!(corner[4..].iter().all(|v| *v == 0.0), "nothing outside");
    }

    #[test]
    fn windows_of_a_scaled_picture_agree_with_the_whole() {
        let element = picture(40, 30);
        let axes = axes(&element, (3.0, 3.0), (1.0, 2.0));
        let whole = scaled(&element, axes, (0, 0, 16, 12));
        for (x1, y1, x2, y2) in [(0, 0, 5, 4), (5, 4, 16, 12), (3, 11, 4, 12), (9, 0, 9, 5)] {
            let part = scaled(&element, axes, (x1, y1, x2, y2));
            let rows = (y1..y2).flat_map(|y| whole[((y * 16 + x1) * 4) as usize..((y * 16 + x2) * 4) as usize].iter());
            assert!(part.iter().eq(rows), "({x1}, {y1}) to ({x2}, {y2})");
        }
    }

    #[test]
    fn far_footprints_are_empty() {
        let axis = Axis { step: 1e9, origin: -3.0, length: 8, flipped: true };
        for index in [i32::MIN, -2, 1, i32::MAX] {
            assert!(Tap::over(axis.footprint(index), 8).shares.is_empty());
        }
    }
}
