//! Lamps that stand near: where they are, and how their light falls off over the object.
//!
//! A lamp at p lights a point P of a surface with normal n with `E = I cos / d^2`, `d = |p - P|`, `cos = n . (p - P) /
//! d`. Photographs are divided by E(P) / E(origin), so that they look as if the lamp stood at infinity in the direction
//! of p: for the plane z = 0, which faces the camera, that ratio is `(|p| / |p - P|)^3`. A photograph of a flat white
//! card in that plane measures the same, and the lamp's own beam besides.

use nalgebra::{Matrix3, SymmetricEigen};
use rayon::prelude::*;

use super::highlight::luminance;
use crate::error::{Error, Result};
use crate::image::Image;
use crate::math::Vec3;

/// A straight line of sight.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Line {
    /// A point of it, metres.
    pub origin: Vec3,
    /// Unit direction.
    pub direction: Vec3,
}

impl Line {
    /// Where the line is `distance` from the stage's origin, ahead of its own; `None` where it starts farther off.
    pub fn at_distance(&self, distance: f64) -> Option<Vec3> {
        // |o + t d|^2 = D^2, the later t.
        let along = self.origin.dot(&self.direction);
        let room = along * along - self.origin.norm_squared() + distance * distance;
        let t = -along + (room >= 0.0).then(|| room.sqrt())?;
        (t > 0.0).then(|| self.origin + self.direction * t)
    }
}

/// Lines that meet at less than half a degree say which way, not how far: of two lines the least eigenvalue below is
/// `1 - cos` of their angle.
const LEAST_ANGLE_RAD: f64 = 0.5 * std::f64::consts::PI / 180.0;

/// The point nearest to all lines (least squares): `sum (I - d d^T) (p - o) = 0`. `None` of lines that are almost
/// parallel, or when the point lies behind one of them.
pub fn triangulate(lines: &[Line]) -> Option<Vec3> {
    let (mut a, mut b) = (Matrix3::zeros(), Vec3::zeros());
    for line in lines {
        let across = Matrix3::identity() - line.direction * line.direction.transpose();
        a += across;
        b += across * line.origin;
    }
    let least = SymmetricEigen::new(a).eigenvalues.min();
    if lines.len() < 2 || least < 1.0 - LEAST_ANGLE_RAD.cos() {
        return None;
    }
    let point = a.lu().solve(&b)?;
    let ahead = lines.iter().all(|line| (point - line.origin).dot(&line.direction) > 0.0);
    ahead.then_some(point)
}

/// The plane z = 0 as the photographs show it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plane {
    /// Size of a pixel on the object.
    pub metres_per_pixel: f64,
    /// The pixel that shows the stage's origin.
    pub origin_px: [f64; 2],
}

impl Plane {
    /// The point in metres at continuous picture coordinates.
    pub fn point(&self, x: f64, y: f64) -> Vec3 {
        let [ox, oy] = self.origin_px;
        Vec3::new((x - ox) * self.metres_per_pixel, (oy - y) * self.metres_per_pixel, 0.0)
    }

    /// Irradiance on each pixel's point relative to the origin's, row by row.
    ///
    /// # Errors
    /// A lamp behind the plane: it lights nothing that the camera sees.
    pub fn falloff(&self, lamp_m: &Vec3, width: usize, height: usize, place: &str) -> Result<Vec<f32>> {
        if lamp_m.z <= 0.0 {
            let found = format!("a lamp at z = {} m, behind the object's plane", lamp_m.z);
            return Err(Error::invalid(place, found, "z > 0, towards the camera"));
        }
        let factor = |k: usize| {
            let point = self.point((k % width) as f64 + 0.5, (k / width) as f64 + 0.5);
            (lamp_m.norm() / (lamp_m - point).norm()).powi(3) as f32
        };
        Ok((0..width * height).into_par_iter().map(factor).collect())
    }
}

/// A flat field darker than this share of its middle cannot be divided out: noise would be all that is left.
const DARKEST: f32 = 0.02;
/// A card with more pixels than this share at the top of the range is overexposed.
const MOST_CLIPPED: f64 = 0.01;

/// Irradiance on each pixel relative to the origin's from a photograph of a flat white card; smoothed over a hundredth
/// of the picture, so that the card's grain and the sensor's noise are not printed on every photograph. `black` (of the
/// card's size) is taken off.
///
/// # Errors
/// A card that is dark at the origin, or overexposed.
pub fn flat_field(card: &Image, black: Option<&Image>, origin_px: [f64; 2], place: &str) -> Result<Vec<f32>> {
    let (w, h) = card.size();
    let mut values: Vec<f32> = card.data().chunks_exact(card.channels()).map(luminance).collect();
    if let Some(black) = black {
        let dark = black.data().chunks_exact(black.channels()).map(luminance);
        values.iter_mut().zip(dark).for_each(|(v, d)| *v -= d);
    }
    let full = card.data().chunks_exact(card.channels()).filter(|p| p[..3].contains(&1.0)).count();
    if full as f64 > MOST_CLIPPED * values.len() as f64 {
        let found = format!("{:.0} % of the pixels clipped", 100.0 * full as f64 / values.len() as f64);
        return Err(Error::invalid(place, found, "a flat white card that is not overexposed"));
    }
    let reach = (w.max(h) / 100).max(1);
    let even = box_mean(&box_mean(&values, w, h, reach), w, h, reach);
    let at = |v: f64, n: usize| (v.max(0.0) as usize).min(n.saturating_sub(1));
    let middle = even[at(origin_px[1], h) * w + at(origin_px[0], w)];
    let mean = even.iter().sum::<f32>() / even.len() as f32;
    if middle <= 0.0 || middle < DARKEST * mean {
        return Err(Error::invalid(place, "a card that is dark where the object's origin is", "a lit white card"));
    }
    Ok(even.iter().map(|v| (v / middle).max(DARKEST)).collect())
}

/// Mean over a rectangle of `reach` about each pixel, less near the picture's edges so that the pixel stays in its
/// middle: slopes are kept.
fn box_mean(values: &[f32], w: usize, h: usize, reach: usize) -> Vec<f32> {
    // Sums up to and including a row and column (a summed-area table), with a row and column of zeros before.
    let mut sums = vec![0.0f64; (w + 1) * (h + 1)];
    for y in 0..h {
        let mut row = 0.0;
        for x in 0..w {
            row += f64::from(values[y * w + x]);
            sums[(y + 1) * (w + 1) + x + 1] = sums[y * (w + 1) + x + 1] + row;
        }
    }
    let mean = |k: usize| {
        let (x, y) = (k % w, k / w);
        let (rx, ry) = (reach.min(x).min(w - 1 - x), reach.min(y).min(h - 1 - y));
        let (x0, y0, x1, y1) = (x - rx, y - ry, x + rx + 1, y + ry + 1);
        let at = |x: usize, y: usize| sums[y * (w + 1) + x];
        let sum = at(x1, y1) - at(x0, y1) - at(x1, y0) + at(x0, y0);
        (sum / ((x1 - x0) * (y1 - y0)) as f64) as f32
    };
    (0..w * h).map(mean).collect()
}

/// Divides a photograph by the irradiance that each of its pixels got relative to the origin.
pub fn even_out(photograph: &mut Image, relative: &[f32]) {
    let channels = photograph.channels();
    photograph.data_mut().chunks_exact_mut(channels).zip(relative).for_each(|(pixel, factor)| {
        pixel[..3].iter_mut().for_each(|v| *v /= factor);
    });
}

/// `E = pi L / (rho cos)`: the irradiance on a patch facing the lamp, from the radiance that a diffuse patch of
/// reflectance `rho` and normal `n` shows. `None` where the lamp grazes the patch (above 80 degrees, where a degree of
/// error is 10 %) or lies behind.
pub fn irradiance(radiance: f64, reflectance: f64, normal: &Vec3, direction: &Vec3) -> Option<f64> {
    let cos = normal.dot(direction);
    (cos > 80f64.to_radians().cos() && radiance > 0.0).then(|| std::f64::consts::PI * radiance / (reflectance * cos))
}

/// The same of a lamp at a point, from a patch at another: the irradiance that a patch at the stage's origin facing the
/// lamp would get.
pub fn irradiance_at_origin(
    radiance: f64,
    reflectance: f64,
    normal: &Vec3,
    patch_m: &Vec3,
    lamp_m: &Vec3,
) -> Option<f64> {
    let from_patch = lamp_m - patch_m;
    let there = irradiance(radiance, reflectance, normal, &from_patch.try_normalize(1e-9)?)?;
    Some(there * from_patch.norm_squared() / lamp_m.norm_squared())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_through_a_point_meet_there() {
        let lamp = Vec3::new(0.4, 0.9, 1.1);
        let line = |origin: Vec3| Line { origin, direction: (lamp - origin).normalize() };
        let lines =
            [line(Vec3::new(-0.2, 0.0, 0.03)), line(Vec3::new(0.2, 0.0, 0.03)), line(Vec3::new(0.0, -0.2, 0.0))];
        for n in 2..=3 {
            assert!((triangulate(&lines[..n]).unwrap() - lamp).norm() < 1e-9);
        }
        assert!(triangulate(&lines[..1]).is_none());
        assert!((lines[0].at_distance(lamp.norm()).unwrap() - lamp).norm() < 1e-9);
        let away = lines.map(|l| Line { direction: -l.direction, ..l });
        assert!(triangulate(&away).is_none(), "behind");
        let parallel = lines.map(|l| Line { direction: Vec3::z(), ..l });
        assert!(triangulate(&parallel).is_none(), "parallel");
    }

    #[test]
    fn falloff_is_the_lambert_and_square_law() {
        let plane = Plane { metres_per_pixel: 0.01, origin_px: [50.0, 40.0] };
        let lamp = Vec3::new(0.3, 0.2, 0.5);
        let found = plane.falloff(&lamp, 100, 80, "lamp").unwrap();
        // From the definition, at the middle of pixel (90, 10).
        let irradiance = |p: Vec3| (lamp - p).normalize().z / (lamp - p).norm_squared();
        let expected = irradiance(Vec3::new(0.405, 0.295, 0.0)) / irradiance(Vec3::zeros());
        assert!((f64::from(found[10 * 100 + 90]) / expected - 1.0).abs() < 1e-6);
        assert!(plane.falloff(&-lamp, 10, 10, "lamp 3").unwrap_err().to_string().contains("lamp 3"));
    }

    #[test]
    fn a_card_measures_the_same_as_positions() {
        let plane = Plane { metres_per_pixel: 0.002, origin_px: [100.0, 75.0] };
        let lamp = Vec3::new(-0.25, 0.3, 0.6);
        let law = plane.falloff(&lamp, 200, 150, "lamp").unwrap();
        let card = Image::from_fn(200, 150, |x, y| [0.6 * law[y * 200 + x]; 3]);
        let measured = flat_field(&card, None, plane.origin_px, "card").unwrap();
        let worst = law.iter().zip(&measured).map(|(a, b)| (a / b - 1.0).abs()).fold(0.0, f32::max);
        assert!(worst < 0.01, "off by {worst}");
        let mut photograph = card.clone();
        even_out(&mut photograph, &law);
        assert!(photograph.data().iter().all(|v| (v - 0.6).abs() < 1e-5));
        let clipped = Image::from_fn(200, 150, |x, _| [if x < 50 { 1.0 } else { 0.7 }; 3]);
        assert!(flat_field(&clipped, None, [100.0, 75.0], "card.jpg").unwrap_err().to_string().contains("25 %"));
        assert!(flat_field(&Image::new(20, 10, 3), None, [10.0, 5.0], "card.jpg").is_err());
    }

    #[test]
    fn a_patch_tells_irradiance() {
        let light = Vec3::new(0.6, 0.0, 0.8);
        // A diffuser of reflectance 0.5 under E: L = rho E cos / pi.
        let radiance = 0.5 * 3.0 * 0.8 / std::f64::consts::PI;
        assert!((irradiance(radiance, 0.5, &Vec3::z(), &light).unwrap() - 3.0).abs() < 1e-12);
        assert!(irradiance(1.0, 0.5, &Vec3::z(), &Vec3::new(1.0, 0.0, 0.05).normalize()).is_none());
        // A lamp of intensity 2 a metre above the origin; the patch lies 0.75 m aside.
        let (lamp, patch) = (Vec3::z(), Vec3::new(0.75, 0.0, 0.0));
        let radiance = 0.5 / std::f64::consts::PI * 2.0 / 1.25f64.powi(2) * 0.8;
        assert!((irradiance_at_origin(radiance, 0.5, &Vec3::z(), &patch, &lamp).unwrap() - 2.0).abs() < 1e-12);
    }
}
