//! Has the object or the camera moved? Two pictures of one condition, taken at different times, are laid over each other to
//! parts of a pixel.
//!
//! Minimised is `sum w (B(x + d) - g A(x))^2` over the shift d and the gain g, by Gauss and Newton from coarse to fine (B.
//! Lucas and T. Kanade, "An iterative image registration technique with an application to stereo vision", 1981), with the
//! mean of both pictures' gradients (S. Benhimane and E. Malis, "Real-time image-based tracking of planes using efficient
//! second-order minimization", 2004), which is exact to the second order. Weights are Tukey's: what moved otherwise, such as a
//! highlight, counts little.
//!
//! Pictures are compared as square roots of light, in which photon noise is even, and smoothed by a pixel, so that cubic
//! interpolation between pixels costs nothing.
//!
//! A shift is known as well as the gradients are large beside the noise: its deviation is `s (sum w J J^T)^-1/2`. Noise has
//! gradients of its own; of two pictures they are independent, so the sum of products of the two gradients is what both have in
//! common, and the deviation is divided by its share. Where it is too large (a plain object, one straight edge), or the pictures
//! do not match, [`Movement::Unknown`] says why.

use nalgebra::{Matrix3, Vector3};

use super::black::median;
use super::highlight::luminance;
use crate::image::Image;

/// Levels of the pyramid: shifts up to about 40 pixels are found.
const LEVELS: usize = 6;
/// No level is smaller than this on its shorter side.
const SMALLEST: usize = 24;
/// Rounds a level; three bring a shift of a pixel to a hundredth.
const ROUNDS: usize = 12;
/// Pixels count whose gradient is at least this share of the steep ones': the rest adds noise.
const STEEP_SHARE: f32 = 0.1;
/// The steep ones: so many of a thousand pixels are steeper.
const STEEPER: f64 = 2.0;
/// Fewer pixels than this tell nothing.
const FEWEST: usize = 60;
/// Tukey's constant for 95 % efficiency at normal noise.
const TUKEY: f64 = 4.685;
/// Steep edges may differ by as much as a shift of so many pixels makes before they count as outliers: brackets are noisier
/// where short exposures gave the light, and lenses breathe.
const LENIENT_PX: f64 = 0.1;
/// Smoothing 1 4 6 4 1 both ways leaves this share of white noise's variance, (70 / 256)^2; along slow gradients the noise is
/// as it was before, so this turns the deviation of residuals into what counts, and is cautious elsewhere.
const SMOOTHED: f64 = 0.0748;
/// A shift less sure than this, in pixels, is none.
const LEAST_SURE_PX: f64 = 0.25;
/// Gradients that both pictures have in common must be at least this share of them, or they are noise.
const LEAST_COMMON: f64 = 0.25;
/// Pictures that agree over less than this share of their gradients show different things.
const LEAST_AGREEMENT: f64 = 0.4;
/// Movement from here on spoils a reflectance field; below, the camera's own noise and warming up are as large.
pub const WORTH_PX: f64 = 0.25;

/// What two pictures say.
#[derive(Debug, Clone, PartialEq)]
pub enum Movement {
    /// They match, shifted by this; it may be nothing.
    Known(Shift),
    /// They do not say, and why.
    Unknown(String),
}

/// A shift between two pictures.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shift {
    /// What the first shows at (x, y) the second shows at (x, y) + `pixels`.
    pub pixels: [f64; 2],
    /// Standard deviation of the less sure direction, pixels.
    pub sure_px: f64,
    /// The second picture's light in units of the first's.
    pub gain: f64,
    /// Share of the pictures' gradients that agrees with the shift; less than one where only a part moved.
    pub agreement: f64,
}

impl Movement {
    /// A sentence where something moved by more than [`WORTH_PX`] and three deviations, or nothing is known; `what` names the
    /// second picture.
    pub fn verdict(&self, what: &str) -> Option<String> {
        match self {
            Self::Unknown(why) => Some(format!("{what}: movement cannot be told: {why}")),
            Self::Known(shift) => {
                let [x, y] = shift.pixels;
                let size = x.hypot(y);
                let rest = if shift.agreement < 0.8 { "; not all of the picture moved alike" } else { "" };
                (size > WORTH_PX.max(3.0 * shift.sure_px)).then(|| {
                    format!(
                        "{what}: object or camera moved by {size:.2} pixels ({x:+.2} right, {y:+.2} down){rest}: photograph again \
                         what came since the last reference that had not"
                    )
                })
            }
        }
    }
}

/// The shift from picture `a` to `b`: linear pictures of one size, under the same light but for its brightness.
///
/// # Panics
/// When their sizes differ.
pub fn movement(a: &Image, b: &Image) -> Movement {
    assert_eq!(a.size(), b.size(), "pictures of one condition are of one size");
    let Some(white) = bright(a) else { return Movement::Unknown("the first picture is black".to_owned()) };
    if bright(b).is_none() {
        return Movement::Unknown("the second picture is black".to_owned());
    }
    let (first, second) = (pyramid(a, white), pyramid(b, white));
    let mut fit = Fit { shift: [0.0; 2], gain: 1.0, sure_px: f64::INFINITY, agreement: 0.0, common: 0.0 };
    let mut told = Err("too little is seen in them".to_owned());
    for (level, (a, b)) in first.iter().zip(&second).enumerate().rev() {
        fit.shift = fit.shift.map(|d| 2.0 * d);
        told = match fit.refine(a, b) {
            Ok(next) => {
                fit = next;
                Ok(())
            }
            // A coarse level may be too small to say anything; the finest decides.
            Err(why) => {
                if level + 1 < first.len() {
                    fit.shift = fit.shift.map(|d| if d.abs() < a.width.max(a.height) as f64 { d } else { 0.0 });
                }
                Err(why)
            }
        };
    }
    match told {
        Err(why) => Movement::Unknown(why),
        Ok(()) if fit.agreement < LEAST_AGREEMENT => Movement::Unknown(format!(
            "the pictures agree over {:.0} % of their gradients only: they show different things, or parts moved differently",
            100.0 * fit.agreement
        )),
        Ok(()) if fit.sure_px > LEAST_SURE_PX => Movement::Unknown(format!(
            "the object is too plain or the noise too strong (unsure by {:.1} pixels)",
            fit.sure_px
        )),
        // From roots of light.
        Ok(()) => Movement::Known(Shift {
            pixels: fit.shift,
            sure_px: fit.sure_px,
            gain: fit.gain * fit.gain,
            agreement: fit.agreement,
        }),
    }
}

/// The luminance that one pixel of a hundred exceeds; `None` where that is no light.
fn bright(image: &Image) -> Option<f32> {
    let mut values: Vec<f32> = image.data().chunks_exact(image.channels()).map(luminance).collect();
    let rank = (values.len() * 99 / 100).min(values.len().checked_sub(1)?);
    let value = *values.select_nth_unstable_by(rank, f32::total_cmp).1;
    (value.is_finite() && value > 0.0).then_some(value)
}

/// One level.
struct Grey {
    width: usize,
    height: usize,
    values: Vec<f32>,
}

/// Finest first, each smoothed.
fn pyramid(image: &Image, white: f32) -> Vec<Grey> {
    let root = |p: &[f32]| (luminance(p) / white).clamp(0.0, 4.0).sqrt();
    let values = image.data().chunks_exact(image.channels()).map(root).collect();
    let mut plain = Grey { width: image.width(), height: image.height(), values };
    let mut levels = Vec::new();
    loop {
        levels.push(plain.smoothed());
        if levels.len() == LEVELS || plain.width.min(plain.height) < 2 * SMALLEST {
            return levels;
        }
        plain = plain.half();
    }
}

impl Grey {
    fn at(&self, x: usize, y: usize) -> f32 {
        self.values[y * self.width + x]
    }

    /// Binomial, 1 4 6 4 1, both ways; edges repeat.
    fn smoothed(&self) -> Self {
        let (w, h) = (self.width, self.height);
        let near = |p: usize, k: usize, size: usize| (p + k).saturating_sub(2).min(size - 1);
        let kernel = [1.0, 4.0, 6.0, 4.0, 1.0].map(|v: f32| v / 16.0);
        let mean = |f: &dyn Fn(usize) -> f32| (0..5).map(|k| kernel[k] * f(k)).sum::<f32>();
        let across: Vec<f32> = (0..w * h).map(|i| mean(&|k| self.at(near(i % w, k, w), i / w))).collect();
        let values = (0..w * h).map(|i| mean(&|k| across[near(i / w, k, h) * w + i % w])).collect();
        Self { values, ..*self }
    }

    /// Means of 2 x 2.
    fn half(&self) -> Self {
        let (width, height) = (self.width / 2, self.height / 2);
        let mean = |i: usize| {
            let (x, y) = (2 * (i % width), 2 * (i / width));
            0.25 * (self.at(x, y) + self.at(x + 1, y) + self.at(x, y + 1) + self.at(x + 1, y + 1))
        };
        Self { width, height, values: (0..width * height).map(mean).collect() }
    }

    /// Central differences; `None` at the border.
    fn gradient(&self, x: usize, y: usize) -> Option<[f32; 2]> {
        let inside = x > 0 && y > 0 && x + 1 < self.width && y + 1 < self.height;
        inside.then(|| [0.5 * (self.at(x + 1, y) - self.at(x - 1, y)), 0.5 * (self.at(x, y + 1) - self.at(x, y - 1))])
    }

    /// Value and gradient between pixels by Catmull and Rom's cubic; `None` near the border and beyond.
    fn between(&self, x: f64, y: f64) -> Option<[f64; 3]> {
        let (i, j) = (x.floor(), y.floor());
        if !(i >= 1.0 && j >= 1.0 && i + 2.0 < self.width as f64 && j + 2.0 < self.height as f64) {
            return None;
        }
        let ((wx, dx), (wy, dy)) = (cubic(x - i), cubic(y - j));
        let (i, j) = (i as usize - 1, j as usize - 1);
        let mut out = [0.0; 3];
        for k in 0..4 {
            let (mut value, mut slope) = (0.0, 0.0);
            for m in 0..4 {
                let v = f64::from(self.at(i + m, j + k));
                value += wx[m] * v;
                slope += dx[m] * v;
            }
            out[0] += wy[k] * value;
            out[1] += wy[k] * slope;
            out[2] += dy[k] * value;
        }
        Some(out)
    }
}

/// Weights of Catmull and Rom's cubic and of its derivative at `t` between the middle two of four.
fn cubic(t: f64) -> ([f64; 4], [f64; 4]) {
    let (t2, t3) = (t * t, t * t * t);
    (
        [-0.5 * t3 + t2 - 0.5 * t, 1.5 * t3 - 2.5 * t2 + 1.0, -1.5 * t3 + 2.0 * t2 + 0.5 * t, 0.5 * t3 - 0.5 * t2],
        [-1.5 * t2 + 2.0 * t - 0.5, 4.5 * t2 - 5.0 * t, -4.5 * t2 + 4.0 * t + 0.5, 1.5 * t2 - t],
    )
}

#[derive(Debug, Clone, Copy)]
struct Fit {
    shift: [f64; 2],
    gain: f64,
    sure_px: f64,
    agreement: f64,
    /// Share of the gradients that both pictures have in common.
    common: f64,
}

/// A pixel that counts: its place, value and gradient in the first picture.
struct Anchor {
    x: usize,
    y: usize,
    value: f64,
    gradient: [f64; 2],
}

/// An equation: derivatives by shift and gain, what is left.
struct Row {
    derivative: Vector3<f64>,
    left: f64,
    /// Product of the two pictures' gradients.
    common: f64,
}

fn anchors(a: &Grey) -> Vec<Anchor> {
    let pixels = (0..a.width * a.height).map(|i| (i % a.width, i / a.width));
    let steep: Vec<(usize, usize, [f32; 2])> = pixels.filter_map(|(x, y)| Some((x, y, a.gradient(x, y)?))).collect();
    let mut sizes: Vec<f32> = steep.iter().map(|(_, _, g)| g[0].hypot(g[1])).collect();
    let rank = (sizes.len() as f64 * (1.0 - STEEPER / 1000.0)) as usize;
    let Some(last) = sizes.len().checked_sub(1) else { return Vec::new() };
    let limit = STEEP_SHARE * *sizes.select_nth_unstable_by(rank.min(last), f32::total_cmp).1;
    let kept = steep.into_iter().filter(|(_, _, g)| limit > 0.0 && g[0].hypot(g[1]) >= limit);
    kept.map(|(x, y, g)| Anchor { x, y, value: f64::from(a.at(x, y)), gradient: g.map(f64::from) }).collect()
}

impl Fit {
    /// Improves a shift on one level, or says why not.
    fn refine(mut self, a: &Grey, b: &Grey) -> Result<Self, String> {
        let anchors = anchors(a);
        for _ in 0..ROUNDS {
            let rows: Vec<Row> = anchors.iter().filter_map(|anchor| self.row(anchor, b)).collect();
            if rows.len() < FEWEST {
                return Err("too little is seen in both of them".to_owned());
            }
            let spread = 1.4826 * median(&mut rows.iter().map(|r| r.left.abs()).collect::<Vec<_>>());
            let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
            let (mut agree, mut all, mut squares, mut weights, mut common) = (0.0, 0.0, 0.0, 0.0, 0.0);
            for row in &rows {
                let steepness = row.derivative.fixed_rows::<2>(0).norm_squared();
                let reach = TUKEY * (spread * spread + LENIENT_PX * LENIENT_PX * steepness).sqrt().max(1e-5);
                let w = (1.0 - (row.left / reach).powi(2)).max(0.0).powi(2);
                normal += w * row.derivative * row.derivative.transpose();
                right += w * row.left * row.derivative;
                (agree, all) = (agree + w.min(1.0) * steepness, all + steepness);
                (squares, weights) = (squares + w * row.left * row.left, weights + w);
                common += w * row.common;
            }
            let share = common / (normal[(0, 0)] + normal[(1, 1)]);
            self.common = if share.is_nan() { 0.0 } else { share.clamp(0.0, 1.0) };
            let inverse = normal.try_inverse().filter(|m| m.iter().all(|v| v.is_finite()));
            let inverse = inverse.ok_or("they show edges in one direction only, or none")?;
            let step = inverse * right;
            self.shift = [self.shift[0] - step[0], self.shift[1] - step[1]];
            self.gain -= step[2];
            // Residuals of Tukey's weights are 0.87 of the noise; the difference is of two noisy pictures, which is right.
            let variance = squares / f64::max(weights, 1e-300) / SMOOTHED;
            self.sure_px = (variance * inverse[(0, 0)].max(inverse[(1, 1)])).sqrt() / self.common.max(1e-3);
            self.agreement = agree / all;
            if step[0].hypot(step[1]) < 1e-3 {
                break;
            }
        }
        if self.common < LEAST_COMMON {
            return Err("the object is too plain or the noise too strong".to_owned());
        }
        let [x, y] = self.shift;
        let sound = x.abs() < a.width as f64 / 4.0 && y.abs() < a.height as f64 / 4.0 && self.gain > 0.0;
        if sound { Ok(self) } else { Err("they do not match at any shift up to a quarter of the picture".to_owned()) }
    }

    fn row(&self, anchor: &Anchor, b: &Grey) -> Option<Row> {
        let [value, bx, by] = b.between(anchor.x as f64 + self.shift[0], anchor.y as f64 + self.shift[1])?;
        let [ax, ay] = anchor.gradient;
        let derivative = Vector3::new(0.5 * (bx + self.gain * ax), 0.5 * (by + self.gain * ay), -anchor.value);
        let common = self.gain * (ax * bx + ay * by);
        Some(Row { derivative, left: value - self.gain * anchor.value, common })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hdr::testing;

    /// A ball with stripes before a dark floor, 5 x 5 rays a pixel.
    fn scene(dx: f64, dy: f64, gain: f64) -> Image {
        let shade = |x: f64, y: f64| {
            let (u, v) = ((x - 90.0) / 45.0, (y - 60.0) / 45.0);
            if u.hypot(v) < 1.0 {
                0.1 + 0.5 * (1.0 - u * u - v * v).sqrt() * (1.2 + (9.0 * u + 4.0 * v * v).sin() * (7.0 * v).cos())
            } else {
                0.01
            }
        };
        Image::from_fn(180, 120, |x, y| {
            let at = |k: usize| (k as f64 + 0.5) / 5.0;
            let rays = (0..25).map(|k| shade(x as f64 + at(k % 5) - dx, y as f64 + at(k / 5) - dy));
            [(gain * rays.sum::<f64>() / 25.0) as f32; 3]
        })
    }

    fn noisy(light: &Image, seed: u64) -> Image {
        let mut seen = testing::LINEAR.photograph(light, 0.7, seed);
        seen.data_mut().iter_mut().for_each(|v| *v = (*v - testing::DARK as f32) / 0.7);
        seen
    }

    fn known(a: &Image, b: &Image) -> Shift {
        match movement(a, b) {
            Movement::Known(shift) => shift,
            Movement::Unknown(why) => panic!("{why}"),
        }
    }

    #[test]
    fn shifts_are_found_to_a_tenth_of_a_pixel_under_noise_and_gain() {
        let still = noisy(&scene(0.0, 0.0, 1.0), 1);
        for (n, (dx, dy, gain)) in
            [(0.0, 0.0, 1.0), (2.0, 0.0, 1.0), (0.3, -0.45, 0.97), (-1.2, 2.6, 1.1), (14.0, -9.5, 1.0)]
                .into_iter()
                .enumerate()
        {
            let shift = known(&still, &noisy(&scene(dx, dy, gain), 2 + n as u64));
            let error = (shift.pixels[0] - dx).hypot(shift.pixels[1] - dy);
            assert!(error < 0.05 && error < 4.0 * shift.sure_px + 0.02, "({dx}, {dy}): {shift:?}");
            assert!((shift.gain / gain - 1.0).abs() < 0.01 && shift.agreement > 0.8, "{shift:?}");
            let said = Movement::Known(shift).verdict("reference 3");
            assert_eq!(said.is_some(), dx != 0.0, "{said:?}");
        }
        let said = movement(&still, &noisy(&scene(2.0, 0.0, 1.0), 9)).verdict("reference 3").unwrap();
        assert!(said.contains("reference 3") && said.contains("moved by 2.0") && said.contains("right"), "{said}");
    }

    #[test]
    fn a_part_that_moved_otherwise_does_not_mislead() {
        let (still, moved) = (scene(0.0, 0.0, 1.0), scene(5.0, 3.0, 1.0));
        let part = Image::from_fn(180, 120, |x, y| {
            let from = if x > 110 { &moved } else { &still };
            std::array::from_fn(|c| from.pixel(x, y)[c])
        });
        let shift = known(&noisy(&still, 1), &noisy(&part, 2));
        assert!(shift.pixels[0].hypot(shift.pixels[1]) < 0.1 && shift.agreement < 0.9, "{shift:?}");
    }

    #[test]
    fn what_cannot_be_told_is_said() {
        let why = |a: &Image, b: &Image| match movement(a, b) {
            Movement::Unknown(why) => why,
            Movement::Known(shift) => panic!("{shift:?}"),
        };
        let picture = noisy(&scene(0.0, 0.0, 1.0), 1);
        let black = Image::new(180, 120, 3);
        assert!(why(&black, &picture).contains("first picture is black"));
        assert!(why(&picture, &black).contains("second picture is black"));
        let plain = |seed| noisy(&Image::from_fn(180, 120, |_, _| [0.3; 3]), seed);
        let said = why(&plain(1), &plain(2));
        assert!(said.contains("plain") || said.contains("agree") || said.contains("match"), "{said}");
        // One straight edge tells nothing of movement along it.
        let edge = |seed| noisy(&Image::from_fn(180, 120, |x, _| [if x < 90 { 0.1 } else { 0.6 }; 3]), seed);
        let said = why(&edge(3), &edge(4));
        assert!(said.contains("plain") || said.contains("one direction"), "{said}");
        let verdict = Movement::Unknown(said).verdict("reference 2").unwrap();
        assert!(verdict.contains("cannot be told"), "{verdict}");
    }
}
