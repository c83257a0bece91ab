//! How far a correspondence is off, by edges of stripes that it was not fitted to.
//!
//! Between neighbouring pixels of a row (of a column, for horizontal stripes) the difference of a pattern and its inverse
//! changes sign at an edge (6.3: "the edges of the individual stripes are detected"). Where, follows to a fraction of a pixel
//! from the sum of the pixels about it: with L before and R after the edge, it lies `sum (v - R) / (L - R)` pixels after the
//! first of them, whatever the lens blurs evenly to both sides. Its error is the distance along the row from there to where
//! the correspondence has the nearest edge of the pattern, so it cannot be told from one of a whole stripe more: stripes must
//! be wider than what is looked for.

use super::decode::Line;
use super::fit::Spread;
use super::shown::Along;
use crate::domain::Correspondence;

/// Both sides of an edge have this contrast, of white less black: stripes that are seen directly and resolved.
const CLEAR: f32 = 0.5;
/// Pixels on each side of an edge that it may be blurred over; the next ones are L and R.
const BLURRED: usize = 2;
/// Stripes count that are so many pixels wide: what lies about an edge, and a pixel.
const NARROWEST: f64 = 2.0 * (BLURRED as f64 + 1.0) + 1.0;

/// Collects the edges of one pattern after another.
#[derive(Debug, Clone, Default)]
pub struct HeldOut {
    errors: Vec<f64>,
    patterns: usize,
}

impl HeldOut {
    /// Errors of all edges; none where none was clear.
    pub fn spread(&self) -> Option<Spread> {
        Spread::of(self.errors.clone())
    }

    /// Patterns that had clear edges.
    pub fn patterns(&self) -> usize {
        self.patterns
    }
}

/// Adds the edges of a pattern, in a picture `width` pixels wide; `direct` says of each pixel whether it sees the screen
/// directly.
pub fn held_out(into: &mut HeldOut, line: &Line<'_>, width: usize, direct: &[bool], correspondence: &Correspondence) {
    let (axis, lit) = (usize::from(line.along == Along::Rows), line.lit);
    let edges: Vec<f64> =
        (1..lit.len()).filter(|n| lit[*n] != lit[n - 1]).map(|n| n as f64 / lit.len() as f64).collect();
    let height = line.contrast.len() / width;
    let (steps, lines) = if axis == 0 { (width, height) } else { (height, width) };
    let found = into.errors.len();
    for across in 0..lines {
        let at = |step: usize| if axis == 0 { across * width + step } else { step * width + across };
        let value = |step: usize| line.contrast[at(step)];
        let seen = |step: usize| direct[at(step)];
        for step in BLURRED..steps.saturating_sub(1 + BLURRED) {
            let (a, b) = (value(step), value(step + 1));
            let sides = (step - BLURRED..=step + 1 + BLURRED).all(seen);
            if !sides || (a > 0.0) == (b > 0.0) {
                continue;
            }
            let (before, after) = (value(step - BLURRED), value(step + 1 + BLURRED));
            if before.abs().min(after.abs()) < CLEAR || (before > 0.0) == (after > 0.0) {
                continue;
            }
            let first = step + 1 - BLURRED;
            let lit: f32 = (first..=step + BLURRED).map(|n| (value(n) - after) / (before - after)).sum();
            let (mut pixel, middle) = ([0.0; 2], first as f64 + f64::from(lit));
            (pixel[axis], pixel[1 - axis]) = (middle, across as f64 + 0.5);
            let slope = correspondence.slopes(pixel)[axis][axis].abs();
            let screen = correspondence.screen_of(pixel)[axis];
            let off = edges.iter().map(|edge| (edge - screen).abs()).fold(f64::INFINITY, f64::min) / slope;
            let stripe = 1.0 / (edges.len() + 1) as f64 / slope;
            if off.is_finite() && stripe >= NARROWEST {
                into.errors.push(off);
            }
        }
    }
    into.patterns += usize::from(into.errors.len() > found);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::domain::Area;

    /// A screen of 32 columns over 200 pixels, seen `off` pixels to the right of where the correspondence has it.
    fn measured(off: f64, axis: usize) -> Spread {
        let size = 200usize;
        let lit: Vec<bool> = (0..32).map(|n| n / 4 % 2 == 0).collect();
        let coverage = |from: f64| -> f32 {
            let samples = 64;
            let lit = (0..samples).filter(|n| {
                let at = (from - off + (f64::from(*n) + 0.5) / f64::from(samples)) * 32.0 / size as f64;
                lit[(at.max(0.0) as usize).min(31)]
            });
            lit.count() as f32 / samples as f32 * 2.0 - 1.0
        };
        let along = |x: usize, y: usize| coverage([x, y][axis] as f64);
        let contrast: Vec<f32> = (0..size * size).map(|n| along(n % size, n / size)).collect();
        let area = Area { from: [0.0; 2], to: [size as f64; 2] };
        let homography = [[0.005, 0.0, 0.0], [0.0, 0.005, 0.0], [0.0, 0.0, 1.0]];
        let correspondence = Correspondence::new(homography, area, None).unwrap();
        let mut out = HeldOut::default();
        let direct = vec![true; size * size];
        let direction = if axis == 0 { Along::Columns } else { Along::Rows };
        let line = Line { along: direction, lit: &lit, contrast: &contrast };
        held_out(&mut out, &line, size, &direct, &correspondence);
        assert_eq!(out.patterns(), 1);
        out.spread().unwrap()
    }

    #[test]
    fn edges_are_found_between_pixels() {
        for axis in [0, 1] {
            for off in [0.0, 0.3, -0.7, 2.25] {
                let spread = measured(off, axis);
                assert!((spread.median_px - off.abs()).abs() < 0.02, "{off}: {spread:?}");
                assert_eq!(spread.count, 7 * 200);
            }
        }
    }
}
