//! Which place of a screen each pixel of the camera sees directly (6.3).
//!
//! `(u, v) = H (x, y) + r(x, y)`: H a homography, exact for a pinhole camera and a flat screen, r what a lens and a bent
//! screen add to it, a cubic polynomial of the pixel. Both are fitted in `calibrate::screen`.
//!
//! Pixels: columns to the right, rows down, from the top left corner of the picture; pixel centres lie at +0.5. Screen: shares
//! of its width from the left and of its height from the top, 0 to 1 inside, as the camera sees the bare screen.

use nalgebra::Matrix3;
use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};

/// Terms of a cubic polynomial of two variables.
pub const TERMS: usize = 10;
/// Newton converges in 3 or 4 steps from the homography's answer.
const STEPS: usize = 30;
/// Pixels: a step that is no step.
const STILL: f64 = 1e-10;
/// A camera has no more pixels in a row; numbers beyond are damage.
const FARTHEST: f64 = 1e6;

/// A rectangle of the picture, pixels.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Area {
    /// Left and top.
    pub from: [f64; 2],
    /// Right and bottom.
    pub to: [f64; 2],
}

impl Area {
    /// Place in it: -1 at the left or top, 1 at the right or bottom; beyond its edges that of the edge.
    pub(crate) fn place(&self, pixel: [f64; 2]) -> [f64; 2] {
        std::array::from_fn(|i| {
            let (middle, half) = (0.5 * (self.from[i] + self.to[i]), 0.5 * (self.to[i] - self.from[i]));
            ((pixel[i] - middle) / half).clamp(-1.0, 1.0)
        })
    }

    fn corners(&self) -> [[f64; 2]; 4] {
        let ([left, top], [right, bottom]) = (self.from, self.to);
        [[left, top], [right, top], [left, bottom], [right, bottom]]
    }
}

/// Monomials of s and t up to the third degree, in the order of the coefficients of [`Correspondence`].
pub fn monomials([s, t]: [f64; 2]) -> [f64; TERMS] {
    [1.0, s, t, s * s, s * t, t * t, s * s * s, s * s * t, s * t * t, t * t * t]
}

/// The derivatives of [`monomials`] by s and by t.
fn slopes_at([s, t]: [f64; 2]) -> [[f64; TERMS]; 2] {
    [
        [0.0, 1.0, 0.0, 2.0 * s, t, 0.0, 3.0 * s * s, 2.0 * s * t, t * t, 0.0],
        [0.0, 0.0, 1.0, 0.0, s, 2.0 * t, 0.0, s * s, 2.0 * s * t, 3.0 * t * t],
    ]
}

/// From pixels to places on a screen, and back.
///
/// ```
/// use relume_core::domain::{Area, Correspondence};
/// let area = Area { from: [0.0, 0.0], to: [200.0, 100.0] };
/// let screen = Correspondence::new([[0.005, 0.0, 0.0], [0.0, 0.01, 0.0], [0.0, 0.0, 1.0]], area, None)?;
/// assert_eq!(screen.screen_of([50.0, 25.0]), [0.25, 0.25]);
/// assert_eq!(screen.pixel_of([0.25, 0.25]), Some([50.0, 25.0]));
/// # Ok::<(), relume_core::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Numbers", into = "Numbers")]
pub struct Correspondence {
    numbers: Numbers,
    /// From the screen to pixels, without the residual.
    back: Matrix3<f64>,
}

/// As it stands in files.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Numbers {
    /// Rows; `u = (h00 x + h01 y + h02) / (h20 x + h21 y + h22)`.
    homography: [[f64; 3]; 3],
    /// Where it was fitted: the residual stays what it is at the edge beyond it.
    area: Area,
    /// Coefficients of u, then of v, over [`monomials`] of the place in the area.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    residual: Option<[[f64; TERMS]; 2]>,
}

impl TryFrom<Numbers> for Correspondence {
    type Error = Error;

    fn try_from(numbers: Numbers) -> Result<Self> {
        Self::new(numbers.homography, numbers.area, numbers.residual)
    }
}

impl From<Correspondence> for Numbers {
    fn from(correspondence: Correspondence) -> Self {
        correspondence.numbers
    }
}

impl Correspondence {
    /// From its numbers: the rows of the homography, where it was fitted, and the residual's coefficients for u and v over
    /// [`monomials`].
    ///
    /// # Errors
    /// Numbers that are not finite, an empty area, a homography that has no inverse or whose horizon crosses the area, a
    /// residual beyond the size of the screen.
    pub fn new(homography: [[f64; 3]; 3], area: Area, residual: Option<[[f64; TERMS]; 2]>) -> Result<Self> {
        let refuse =
            |found: String, expected: &str| Err(Error::invalid("the correspondence of the screen", found, expected));
        let Area { from, to } = area;
        let inside = [from, to].as_flattened().iter().all(|v| v.abs() <= FARTHEST);
        if !(inside && from[0] < to[0] && from[1] < to[1]) {
            return refuse(format!("the area {from:?} to {to:?}"), "left before right and top above bottom, in pixels");
        }
        let forward = Matrix3::from_fn(|i, j| homography[i][j]);
        let finite = homography.as_flattened().iter().all(|v| v.is_finite());
        let Some(back) = forward.try_inverse().filter(|back| finite && back.iter().all(|v| v.is_finite())) else {
            return refuse(format!("the homography {homography:?}"), "nine finite numbers with an inverse");
        };
        let depth = |[x, y]: [f64; 2]| homography[2][0] * x + homography[2][1] * y + homography[2][2];
        if !area.corners().iter().all(|corner| depth(*corner) > 0.0) {
            return refuse(
                "a homography whose horizon crosses the picture".into(),
                "one whose third row is positive in its area",
            );
        }
        if residual.is_some_and(|r| !r.as_flattened().iter().all(|v| v.abs() <= 1.0)) {
            return refuse(format!("the residual {residual:?}"), "numbers of -1 to 1, shares of the screen");
        }
        Ok(Self { numbers: Numbers { homography, area, residual }, back })
    }

    /// The rows of the homography from pixels to the screen.
    pub fn homography(&self) -> &[[f64; 3]; 3] {
        &self.numbers.homography
    }

    /// Where it was fitted.
    pub fn area(&self) -> Area {
        self.numbers.area
    }

    /// The coefficients of the residual, if there is one.
    pub fn residual(&self) -> Option<&[[f64; TERMS]; 2]> {
        self.numbers.residual.as_ref()
    }

    /// The place on the screen that a pixel sees: `[u, v]`, outside 0 to 1 beside it. NaN beyond the screen's horizon.
    pub fn screen_of(&self, pixel: [f64; 2]) -> [f64; 2] {
        let [u, v, depth] = self.projected(pixel);
        if depth <= 0.0 || depth.is_nan() {
            return [f64::NAN; 2];
        }
        let Some(residual) = &self.numbers.residual else { return [u / depth, v / depth] };
        let terms = monomials(self.numbers.area.place(pixel));
        let off = |of: &[f64; TERMS]| of.iter().zip(&terms).map(|(c, m)| c * m).sum::<f64>();
        [u / depth + off(&residual[0]), v / depth + off(&residual[1])]
    }

    /// The derivatives of [`Self::screen_of`]: `[[du/dx, du/dy], [dv/dx, dv/dy]]`, shares of the screen a pixel.
    pub fn slopes(&self, pixel: [f64; 2]) -> [[f64; 2]; 2] {
        let (h, [u, v, depth]) = (&self.numbers.homography, self.projected(pixel));
        let mut slopes = [u, v].map(|at| at / depth).map(|at| [at, at]);
        for (i, row) in slopes.iter_mut().enumerate() {
            *row = std::array::from_fn(|j| (h[i][j] - row[j] * h[2][j]) / depth);
        }
        let Some(residual) = &self.numbers.residual else { return slopes };
        let Area { from, to } = self.numbers.area;
        let place = self.numbers.area.place(pixel);
        for (j, terms) in slopes_at(place).iter().enumerate() {
            // Beyond the area the residual does not change.
            if pixel[j] < from[j] || pixel[j] > to[j] {
                continue;
            }
            let scale = 2.0 / (to[j] - from[j]);
            for (row, of) in slopes.iter_mut().zip(residual) {
                row[j] += scale * of.iter().zip(terms).map(|(c, m)| c * m).sum::<f64>();
            }
        }
        slopes
    }

    /// The place in the picture where a place of the screen is seen: the inverse of [`Self::screen_of`], by Newton's method
    /// from the homography's answer. None for what is behind the camera, and where the residual folds.
    pub fn pixel_of(&self, screen: [f64; 2]) -> Option<[f64; 2]> {
        let at = self.back * nalgebra::Vector3::new(screen[0], screen[1], 1.0);
        let mut pixel = [at.x / at.z, at.y / at.z];
        for _ in 0..STEPS {
            let seen = self.screen_of(pixel);
            let off = [seen[0] - screen[0], seen[1] - screen[1]];
            let [[a, b], [c, d]] = self.slopes(pixel);
            let determinant = a * d - b * c;
            let step = [(d * off[0] - b * off[1]) / determinant, (a * off[1] - c * off[0]) / determinant];
            if !step.iter().all(|s| s.is_finite()) {
                return None;
            }
            if step.iter().all(|s| s.abs() < STILL * (1.0 + pixel[0].abs().max(pixel[1].abs()))) {
                return Some(pixel);
            }
            pixel = [pixel[0] - step[0], pixel[1] - step[1]];
        }
        None
    }

    /// The same for a picture that begins at a pixel of this one: a crop.
    pub fn of_crop(&self, [left, top]: [f64; 2]) -> Self {
        let mut numbers = self.numbers.clone();
        for row in &mut numbers.homography {
            row[2] += row[0] * left + row[1] * top;
        }
        for corner in [&mut numbers.area.from, &mut numbers.area.to] {
            *corner = [corner[0] - left, corner[1] - top];
        }
        let back = Matrix3::new(1.0, 0.0, -left, 0.0, 1.0, -top, 0.0, 0.0, 1.0) * self.back;
        Self { numbers, back }
    }

    /// Does the camera see the screen in a mirror?
    pub fn is_mirrored(&self) -> bool {
        let Area { from, to } = self.numbers.area;
        let [[a, b], [c, d]] = self.slopes([0.5 * (from[0] + to[0]), 0.5 * (from[1] + to[1])]);
        a * d - b * c < 0.0
    }

    fn projected(&self, [x, y]: [f64; 2]) -> [f64; 3] {
        self.numbers.homography.map(|row| row[0] * x + row[1] * y + row[2])
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const AREA: Area = Area { from: [20.0, 10.0], to: [620.0, 470.0] };

    /// A screen seen at an angle through a lens that bends by some pixels.
    fn oblique() -> Correspondence {
        let homography = [[0.0017, 0.0001, -0.03], [-0.00005, 0.0021, -0.02], [0.0001, -0.0002, 1.0]];
        let residual = [
            [0.001, 0.0, 0.002, 0.001, 0.0, 0.0, 0.004, 0.0, 0.004, 0.0],
            [0.0, -0.001, 0.0, 0.0, 0.002, 0.0, 0.0, 0.003, 0.0, 0.003],
        ];
        Correspondence::new(homography, AREA, Some(residual)).unwrap()
    }

    proptest! {
        #[test]
        fn pixels_return(x in -100.0f64..800.0, y in -100.0f64..600.0) {
            let screen = oblique();
            let back = screen.pixel_of(screen.screen_of([x, y])).unwrap();
            prop_assert!((back[0] - x).abs() < 1e-6 && (back[1] - y).abs() < 1e-6, "{back:?}");
        }

        #[test]
        fn slopes_are_differences(x in 25.0f64..615.0, y in 15.0f64..465.0) {
            let (screen, step) = (oblique(), 1e-4);
            let slopes = screen.slopes([x, y]);
            for (j, [dx, dy]) in [[step, 0.0], [0.0, step]].into_iter().enumerate() {
                let (a, b) = (screen.screen_of([x - dx, y - dy]), screen.screen_of([x + dx, y + dy]));
                for i in 0..2 {
                    prop_assert!(((b[i] - a[i]) / (2.0 * step) - slopes[i][j]).abs() < 1e-9);
                }
            }
        }
    }

    #[test]
    fn the_residual_is_held_at_the_edge() {
        let screen = oblique();
        let plain = Correspondence::new(*screen.homography(), AREA, None).unwrap();
        let off = |x: f64, y: f64| {
            let (a, b) = (screen.screen_of([x, y]), plain.screen_of([x, y]));
            [a[0] - b[0], a[1] - b[1]]
        };
        for (outside, edge) in [([700.0, 200.0], [620.0, 200.0]), ([-50.0, -80.0], [20.0, 10.0])] {
            let (a, b) = (off(outside[0], outside[1]), off(edge[0], edge[1]));
            assert!((a[0] - b[0]).abs() < 1e-12 && (a[1] - b[1]).abs() < 1e-12, "{a:?} {b:?}");
        }
        assert!(!screen.is_mirrored());
    }

    #[test]
    fn crops_see_the_same() {
        let (screen, crop) = (oblique(), oblique().of_crop([100.0, 50.0]));
        for [x, y] in [[130.0, 70.0], [500.0, 460.0], [700.0, 20.0]] {
            let (a, b) = (screen.screen_of([x, y]), crop.screen_of([x - 100.0, y - 50.0]));
            assert!((a[0] - b[0]).abs() < 1e-12 && (a[1] - b[1]).abs() < 1e-12);
            let back = crop.pixel_of(b).unwrap();
            assert!((back[0] - x + 100.0).abs() < 1e-6 && (back[1] - y + 50.0).abs() < 1e-6);
        }
    }

    #[test]
    fn beyond_the_horizon_is_nowhere() {
        let homography = [[0.002, 0.0, 0.0], [0.0, 0.002, 0.0], [0.001, 0.0, 0.5]];
        let screen = Correspondence::new(homography, AREA, None).unwrap();
        assert!(screen.screen_of([-500.0, 0.0])[0].is_nan() && screen.screen_of([-501.0, 0.0])[0].is_nan());
        // The line that no pixel sees.
        assert_eq!(screen.pixel_of([2.0, 0.0]), None);
    }

    #[test]
    fn files_are_checked() {
        let text = serde_json::to_string(&oblique()).unwrap();
        assert_eq!(serde_json::from_str::<Correspondence>(&text).unwrap(), oblique());
        for (from, to, words) in [
            ("0.0017", "1e400", "number"),
            ("-0.0002", "-0.2", "horizon"),
            ("620.0", "20.0", "area"),
            ("620.0", "1e9", "area"),
            ("0.004", "40", "residual"),
            ("\"residual\"", "\"rest\"", "rest"),
        ] {
            let broken = text.replacen(from, to, 1);
            let message = serde_json::from_str::<Correspondence>(&broken).unwrap_err().to_string();
            assert!(message.contains(words), "{words}: {message}");
        }
        let flat = [[0.001, 0.002, 0.0], [0.0, 0.0, 0.5], [0.0, 0.0, 1.0]];
        assert!(Correspondence::new(flat, AREA, None).unwrap_err().to_string().contains("inverse"));
    }
}
