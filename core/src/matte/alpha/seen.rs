//! What a pixel would see of stripes on the bare screen: their mean over the part of its footprint that lies on the screen, lit 1
//! and dark -1.

use crate::calibrate::screen::Along;
use crate::domain::Correspondence;

/// Places across the footprint's lesser extent.
const ACROSS: usize = 4;
/// Less of a footprint on the screen is none.
const LEAST: f64 = 1e-3;

/// The integral of a line of stripes.
#[derive(Debug, Clone)]
pub(super) struct Integral(Vec<f32>);

impl Integral {
    pub fn new(lit: &[bool]) -> Self {
        let mut sums = vec![0.0];
        let mut sum = 0.0;
        for lit in lit {
            sum += if *lit { 1.0 } else { -1.0 };
            sums.push(sum);
        }
        Self(sums)
    }

    /// From the edge of the screen to a share of its side, in columns (or rows); beyond the screen nothing is added.
    fn to(&self, share: f64) -> f64 {
        let last = self.0.len() - 1;
        let at = (share * last as f64).clamp(0.0, last as f64);
        let low = (at as usize).min(last - 1);
        f64::from(self.0[low]) + (at - low as f64) * f64::from(self.0[low + 1] - self.0[low])
    }

    /// The mean over a part of the side.
    fn mean(&self, from: f64, to: f64) -> f64 {
        (self.to(to) - self.to(from)) / ((to - from) * (self.0.len() - 1) as f64)
    }
}

/// Where a pixel lies on the screen, along its sides.
#[derive(Debug, Clone, Copy)]
pub(super) struct Footprint {
    /// The middle, columns and rows in shares.
    middle: [f64; 2],
    /// Half the longer and the shorter extent along each side, of a pixel's width.
    half: [[f64; 2]; 2],
}

impl Footprint {
    /// Of the pixel at a place; `width` of a pixel is what it is blurred over.
    pub fn new(correspondence: &Correspondence, pixel: [f64; 2], width: f64) -> Self {
        let slopes = correspondence.slopes(pixel);
        let half = slopes.map(|[x, y]| {
            let (x, y) = (0.5 * width * x.abs(), 0.5 * width * y.abs());
            [x.max(y).max(1e-12), x.min(y)]
        });
        Self { middle: correspondence.screen_of(pixel), half }
    }

    /// The mean of stripes over it: the trapezoid of a parallelogram is a box moved over another. 0 beside the screen.
    pub fn seen(&self, along: Along, integral: &Integral) -> f64 {
        let axis = usize::from(along == Along::Rows);
        let ([long, short], middle) = (self.half[axis], self.middle[axis]);
        if middle.is_nan() {
            return 0.0;
        }
        let (mut sum, mut inside) = (0.0, 0.0);
        for n in 0..ACROSS {
            let at = middle + short * (2.0 * (n as f64 + 0.5) / ACROSS as f64 - 1.0);
            let (from, to) = (at - long, at + long);
            sum += integral.mean(from, to);
            inside += (to.min(1.0) - from.max(0.0)).max(0.0) / (to - from);
        }
        if inside > LEAST { sum / inside } else { 0.0 }
    }

    /// Does all of it lie on the screen?
    pub fn inside(&self) -> bool {
        (0..2).all(|i| {
            let reach = self.half[i][0] + self.half[i][1];
            self.middle[i] - reach >= 0.0 && self.middle[i] + reach <= 1.0
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::domain::Area;

    #[test]
    fn footprints_are_areas() {
        // Sheared: a pixel covers 0.02 of the screen's width by its columns and 0.005 by its rows.
        let area = Area { from: [0.0; 2], to: [50.0; 2] };
        let homography = [[0.02, 0.005, 0.0], [0.0, 0.02, 0.0], [0.0, 0.0, 1.0]];
        let correspondence = Correspondence::new(homography, area, None).unwrap();
        let lit: Vec<bool> = (0..30).map(|n| n % 3 == 0).collect();
        let integral = Integral::new(&lit);
        for pixel in [[7.5, 3.5], [20.2, 9.9], [31.4, 28.0]] {
            let footprint = Footprint::new(&correspondence, pixel, 1.0);
            let samples = 200;
            let mut sum = 0.0;
            for n in 0..samples * samples {
                let at = |k: usize, i: usize| pixel[i] - 0.5 + (k as f64 + 0.5) / samples as f64;
                let [u, _] = correspondence.screen_of([at(n % samples, 0), at(n / samples, 1)]);
                sum += if lit[(u * 30.0) as usize] { 1.0 } else { -1.0 };
            }
            let seen = footprint.seen(Along::Columns, &integral);
            assert!((seen - sum / (samples * samples) as f64).abs() < 0.02, "{seen}");
            assert!(footprint.inside());
        }
        let edge = Footprint::new(&correspondence, [0.2, 0.2], 1.0);
        assert!(!edge.inside() && (edge.seen(Along::Columns, &integral) - 1.0).abs() < 1e-9);
        assert_eq!(Footprint::new(&correspondence, [-20.0, 20.0], 1.0).seen(Along::Columns, &integral), 0.0);
    }
}
