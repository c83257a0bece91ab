//! How bright lamps are: irradiance from pictures of a matt white ball, one lamp each.
//!
//! A Lambert ball of reflectance rho under a lamp in direction l shows at a point of normal n the radiance
//! `rho / pi * E * (n . l)` where that is positive, with E the irradiance on a patch facing the lamp (design: pi makes a
//! white diffuser facing the lamp photograph as 1). So every lit pixel measures E, and the
//! least-squares line through the origin over all of them does with the noise averaged out.
//!
//! A lamp at distance D from the ball's middle (in its radii) lights the point n from `v = D l - n`, with
//! `D^2 (n . v) / |v|^3` in the place of `n . l`; E stays that at the middle.
//!
//! Left out are the rim, where half a pixel turns the normal by degrees, and the terminator, where lamps that are no points
//! set part by part. Glossy paint's highlight, dust and the stand are outliers (Tukey's biweight).

use std::f64::consts::PI;

use nalgebra::Matrix3;

use super::black::median;
use super::reflect::Ball;
use crate::error::{Error, Result};
use crate::image::Image;
use crate::math::Vec3;

/// Pixels farther out than this share of the radius are left out; there a shift of the outline by a hundredth of the
/// radius changes the cosine to a lamp at the side by 3 %, which the weights below take into account.
const RIM: f64 = 0.95;
/// Least cosine between normal and lamp: lamps 25 degrees wide are whole above the horizon.
const TERMINATOR: f64 = 0.22;
/// Fewer pixels than this are no measurement.
const FEWEST: usize = 40;
/// Tukey's constant for 95 % efficiency at normal noise.
const TUKEY: f64 = 4.685;
/// Rounds of reweighting; the fifth changes nothing by 1e-4.
const ROUNDS: usize = 10;
/// Least spread taken for noise, as a share of the brightest: half-tones of a real ball are no better.
const LEAST_SPREAD: f64 = 1e-3;
/// A ball that strays further from Lambert's law than this (rms, of the brightest) is glossy, dirty or not where it is said
/// to be; matt paint strays by 0.02.
const MOST_RESIDUAL: f64 = 0.04;
/// Directions of light that differ by more than this are of another lamp, or another ball.
const MOST_TURN_RAD: f64 = 5.0 * PI / 180.0;
/// Light that does not follow the cosine, above this share of the lamp's.
const MOST_AMBIENT: f64 = 0.03;

/// The lamp that lit a picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lamp {
    /// Unit vector from the ball to the lamp, stage frame.
    pub direction: Vec3,
    /// Distance from the ball's middle in its radii; `None` of a far lamp.
    pub distance: Option<f64>,
}

/// What a picture of the ball says about its lamp.
#[derive(Debug, Clone, PartialEq)]
pub struct Irradiance {
    /// At the ball's middle on a patch facing the lamp, RGB, in the picture's unit.
    pub rgb: [f64; 3],
    /// Pixels used.
    pub pixels: usize,
    /// Root mean square of what Lambert's law leaves at the pixels used, in shares of the brightest.
    pub residual: f64,
    /// Angle between the lamp's direction and where the shading says that light comes from; `None` where too little of the
    /// lit side is seen.
    pub turned_rad: Option<f64>,
    /// What a person should know, a sentence each.
    pub doubts: Vec<String>,
}

/// Measures a lamp from a linear picture of a white ball, ambient light subtracted. `albedo` is its reflectance, RGB.
/// The ball's outline is given, or found by [`find_ball`](super::ball::find_ball) in a picture in which it is
/// lit all over: the mean of all lamps' pictures will do.
///
/// # Errors
/// [`Error::Invalid`] with `place` where the camera sees too little of the lit side, or it is dark; for an albedo outside
/// (0, 1].
pub fn irradiance(picture: &Image, ball: &Ball, albedo: [f64; 3], lamp: &Lamp, place: &str) -> Result<Irradiance> {
    if let Some(bad) = albedo.iter().find(|a| !(**a > 0.0 && **a <= 1.0)) {
        return Err(Error::invalid(place, format!("a reflectance of {bad}"), "above 0 and at most 1"));
    }
    if lamp.distance.is_some_and(|d| d.is_nan() || d <= 1.0) {
        return Err(Error::invalid(place, "a lamp inside the ball", "a distance in radii above 1, from its middle"));
    }
    let points = points(picture, ball, lamp);
    if points.len() < FEWEST {
        let found = format!("{} pixels of the ball's lit side in view", points.len());
        let expected = "at least 40; give this lamp the irradiance of its neighbours, or photograph the ball larger";
        return Err(Error::invalid(place, found, expected));
    }
    let mut fits = Vec::with_capacity(3);
    for (c, channel) in ["red", "green", "blue"].into_iter().enumerate() {
        let fit = Line::fit(&points, c);
        if fit.slope.is_nan() || fit.slope <= 0.0 {
            let found = format!("no {channel} light on the ball");
            return Err(Error::invalid(place, found, "the picture of a lit white ball, ambient light subtracted"));
        }
        fits.push(fit);
    }
    let brightest = fits.iter().enumerate().max_by(|a, b| a.1.slope.total_cmp(&b.1.slope)).map_or(1, |(c, _)| c);
    let rgb = std::array::from_fn(|c| fits[c].slope * PI / albedo[c]);
    let residual = fits.iter().map(|f| f.residual).fold(0.0, f64::max);
    let turned_rad =
        light_from(&points, brightest, &lamp.direction).map(|from| crate::math::angle_between(&from, &lamp.direction));
    let mut found = Irradiance { rgb, pixels: points.len(), residual, turned_rad, doubts: Vec::new() };
    found.doubt(place, offset(&points, brightest, fits[brightest].slope));
    Ok(found)
}

/// One lit pixel.
struct Point {
    normal: Vec3,
    /// What Lambert's law makes of unit irradiance, but for rho / pi.
    cosine: f64,
    /// How sure the normal is.
    weight: f64,
    rgb: [f64; 3],
}

fn points(picture: &Image, ball: &Ball, lamp: &Lamp) -> Vec<Point> {
    let circle = ball.circle();
    let range = |middle: f64, size: usize| {
        let (from, to) = (middle - RIM * circle.radius, middle + RIM * circle.radius);
        (from.floor().max(0.0) as usize).min(size)..(to.ceil().max(0.0) as usize).min(size)
    };
    let mut points = Vec::new();
    for y in range(circle.y, picture.height()) {
        for x in range(circle.x, picture.width()) {
            let (px, py) = (x as f64 + 0.5, y as f64 + 0.5);
            let Some(normal) = ball.reflect(px, py).filter(|_| ball.radius_at(px, py) < RIM).map(|r| r.normal) else {
                continue;
            };
            let cosine = match lamp.distance {
                None => normal.dot(&lamp.direction),
                Some(d) => {
                    let v = lamp.direction * d - normal;
                    d * d * normal.dot(&v) / v.norm().powi(3)
                }
            };
            if cosine > TERMINATOR && normal.dot(&lamp.direction) > TERMINATOR {
                let p = picture.pixel(x, y);
                let rgb = std::array::from_fn(|c| f64::from(p[c]));
                // A pixel of outline turns the normal by 1 / cos of the angle between normal and view.
                let facing = 1.0 - ball.radius_at(px, py).powi(2);
                points.push(Point { normal, cosine, weight: facing, rgb });
            }
        }
    }
    points
}

/// `value = slope * cosine` over the points.
struct Line {
    slope: f64,
    /// Of what is not an outlier, relative to the brightest.
    residual: f64,
}

impl Line {
    fn fit(points: &[Point], c: usize) -> Self {
        let mut slope = median(&mut points.iter().map(|p| p.rgb[c] / p.cosine).collect::<Vec<_>>());
        let brightest = points.iter().map(|p| p.cosine).fold(0.0, f64::max);
        let mut residual = 0.0;
        for _ in 0..ROUNDS {
            let left = |p: &Point| p.rgb[c] - slope * p.cosine;
            let spread = 1.4826 * median(&mut points.iter().map(|p| left(p).abs()).collect::<Vec<_>>());
            let reach = TUKEY * spread.max(LEAST_SPREAD * (slope * brightest).abs());
            let (mut up, mut across, mut squares, mut count) = (0.0, 0.0, 0.0, 0.0);
            for p in points {
                let r = left(p);
                let w = p.weight * (1.0 - (r / reach).powi(2)).max(0.0).powi(2);
                up += w * p.rgb[c] * p.cosine;
                across += w * p.cosine * p.cosine;
                if r.abs() < reach {
                    (squares, count) = (squares + r * r, count + 1.0);
                }
            }
            slope = up / across;
            residual = f64::sqrt(squares / f64::max(count, 1.0)) / (slope * brightest);
        }
        Self { slope, residual }
    }
}

/// Where the shading says that light comes from: `sum n n^T m = sum n value`, m along the direction. The fall-off of a near
/// lamp is taken off first.
fn light_from(points: &[Point], c: usize, lamp: &Vec3) -> Option<Vec3> {
    let (mut a, mut b) = (Matrix3::zeros(), Vec3::zeros());
    for p in points {
        a += p.weight * p.normal * p.normal.transpose();
        b += p.weight * p.rgb[c] * (p.normal.dot(lamp) / p.cosine) * p.normal;
    }
    // Of a thin crescent all normals are nearly alike.
    let conditioned = a.symmetric_eigenvalues().min() > 1e-3 * a.trace();
    conditioned.then(|| a.lu().solve(&b))?.map(|m| m.normalize())
}

/// Light that does not follow the cosine, in shares of the lamp's: the constant of a line with one.
fn offset(points: &[Point], c: usize, slope: f64) -> f64 {
    let n: f64 = points.iter().map(|p| p.weight).sum();
    let mean = |f: &dyn Fn(&Point) -> f64| points.iter().map(|p| p.weight * f(p)).sum::<f64>() / n;
    let (x, y) = (mean(&|p| p.cosine), mean(&|p| p.rgb[c]));
    let across = mean(&|p| (p.cosine - x).powi(2));
    // Cosines that are nearly alike tell no constant.
    if across < 0.02 {
        return 0.0;
    }
    (y - mean(&|p| (p.cosine - x) * (p.rgb[c] - y)) / across * x) / slope
}

impl Irradiance {
    fn doubt(&mut self, place: &str, offset: f64) {
        if self.residual > MOST_RESIDUAL {
            self.doubts.push(format!(
                "{place}: the ball strays from a matt one by {:.1} % of its brightest: it is glossy or dirty, or its outline is \
                 wrong",
                100.0 * self.residual
            ));
        }
        if let Some(turned) = self.turned_rad.filter(|t| *t > MOST_TURN_RAD) {
            self.doubts.push(format!(
                "{place}: the ball's shading has its light from {:.0} degrees beside the lamp's direction: lamps are mixed up, or \
                 directions are wrong",
                turned.to_degrees()
            ));
        }
        if offset.abs() > MOST_AMBIENT {
            self.doubts.push(format!(
                "{place}: light of {:.1} % of the lamp's does not follow its direction: subtract the black photograph, or keep \
                 bright things away from the ball",
                100.0 * offset
            ));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibrate::reflect::Lens;
    use crate::hdr::testing;
    use crate::illumination::probe::Circle;

    const ALBEDO: [f64; 3] = [0.92, 0.9, 0.85];
    const TRUTH: [f64; 3] = [PI, 2.1, 0.7];

    fn ball() -> Ball {
        let lens = Lens::pinhole(160, 120, 0.4).unwrap();
        Ball::new(Circle { x: 80.0, y: 60.0, radius: 44.3 }, lens)
    }

    /// 6 x 6 rays a pixel; `gloss` adds a highlight, `ambient` an even light.
    fn picture(ball: &Ball, lamp: &Lamp, gloss: f64, ambient: f64) -> Image {
        let shade = |x: f64, y: f64, c: usize| {
            let Some(seen) = ball.reflect(x, y) else { return 0.0 };
            let cosine = match lamp.distance {
                None => seen.normal.dot(&lamp.direction),
                Some(d) => {
                    let v = lamp.direction * d - seen.normal;
                    v.normalize().dot(&seen.normal) * (d / v.norm()).powi(2)
                }
            };
            let highlight = gloss * seen.direction.dot(&lamp.direction).max(0.0).powi(400);
            TRUTH[c] / PI * (ALBEDO[c] * cosine.max(0.0) + highlight + ambient)
        };
        Image::from_fn(160, 120, |x, y| {
            std::array::from_fn(|c| {
                let at = |k: usize| (k as f64 + 0.5) / 6.0;
                let rays = (0..36).map(|k| shade(x as f64 + at(k % 6), y as f64 + at(k / 6), c));
                (rays.sum::<f64>() / 36.0) as f32
            })
        })
    }

    fn far(x: f64, y: f64, z: f64) -> Lamp {
        Lamp { direction: Vec3::new(x, y, z).normalize(), distance: None }
    }

    fn assert_within(found: &Irradiance, share: f64, what: &str) {
        for (found, truth) in found.rgb.iter().zip(TRUTH) {
            assert!((found / truth - 1.0).abs() < share, "{what}: {found} is not {truth}");
        }
    }

    #[test]
    fn lamps_all_round_are_measured_to_a_hundredth_through_a_noisy_camera() {
        let ball = ball();
        let near = Lamp { distance: Some(8.0), ..far(0.5, 0.3, 0.8) };
        let lamps = [far(0.0, 0.0, 1.0), far(-0.7, 0.4, 0.6), far(0.0, -1.0, 0.0), far(0.8, 0.2, -0.5), near];
        for (n, lamp) in lamps.iter().enumerate() {
            for gloss in [0.0, 2.0] {
                let light = picture(&ball, lamp, gloss, 0.0);
                let codes = testing::LINEAR.photograph(&light, 0.4, n as u64);
                let dark = testing::DARK;
                let seen = Image::from_fn(160, 120, |x, y| {
                    std::array::from_fn(|c| ((f64::from(codes.pixel(x, y)[c]) - dark) / 0.4) as f32)
                });
                let found = irradiance(&seen, &ball, ALBEDO, lamp, "ball").unwrap();
                assert_within(&found, 0.01, &format!("lamp {n}, gloss {gloss}"));
                assert!(found.turned_rad.is_none_or(|t| t < 0.09), "{n}: {found:?}");
                assert!(gloss > 0.0 || found.doubts.is_empty(), "{n}: {found:?}");
            }
        }
    }

    #[test]
    fn an_outline_half_a_pixel_off_costs_a_hundredth_at_most() {
        let lamp = far(-0.5, 0.3, 0.8);
        let light = picture(&ball(), &lamp, 0.0, 0.0);
        let lens = Lens::pinhole(160, 120, 0.4).unwrap();
        for (dx, dy, dr) in [(0.5, 0.0, 0.0), (0.0, -0.5, 0.0), (0.0, 0.0, 0.5), (0.0, 0.0, -0.5)] {
            let off = Ball::new(Circle { x: 80.0 + dx, y: 60.0 + dy, radius: 44.3 + dr }, lens);
            assert_within(&irradiance(&light, &off, ALBEDO, &lamp, "ball").unwrap(), 0.012, "outline");
        }
    }

    #[test]
    fn what_is_doubtful_is_said() {
        let ball = ball();
        let lamp = far(-0.5, 0.3, 0.8);
        let doubts = |light: &Image, lamp: &Lamp| irradiance(light, &ball, ALBEDO, lamp, "lamp 7").unwrap().doubts;
        let turned = doubts(&picture(&ball, &lamp, 0.0, 0.0), &far(-0.2, 0.3, 0.8));
        assert!(turned.iter().any(|d| d.contains("lamp 7") && d.contains("mixed up")), "{turned:?}");
        let ambient = doubts(&picture(&ball, &lamp, 0.0, 0.1), &lamp);
        assert!(ambient.iter().any(|d| d.contains("black photograph")), "{ambient:?}");
    }

    #[test]
    fn what_cannot_be_measured_is_refused() {
        let ball = ball();
        let behind = far(0.1, 0.0, -1.0);
        let light = picture(&ball, &behind, 0.0, 0.0);
        let refused =
            |lamp: &Lamp, albedo: [f64; 3]| irradiance(&light, &ball, albedo, lamp, "lamp 3").unwrap_err().to_string();
        let message = refused(&behind, ALBEDO);
        assert!(message.contains("lamp 3: found 0 pixels") && message.contains("neighbours"), "{message}");
        assert!(refused(&far(0.0, 0.0, 1.0), ALBEDO).contains("no red light"));
        assert!(refused(&behind, [0.9, 0.0, 0.9]).contains("reflectance of 0"));
        assert!(refused(&Lamp { distance: Some(0.5), ..behind }, ALBEDO).contains("inside the ball"));
    }
}
