//! Lights to try a field with, as lat-long maps whose texels hold exact averages over their area.

use rayon::prelude::*;

use crate::error::Result;
use crate::illumination::EnvMap;
use crate::image::Image;
use crate::math::{Vec3, latlong};

/// Samples across a texel that an edge crosses.
const FINE: usize = 16;

/// A soft sky: blue above, warm at the horizon, a broad glow (half its peak at 25 degrees) high on the right before the
/// object, and darkness below the horizon. Radiance 0 to 4.
pub fn sky((width, height): (usize, usize)) -> EnvMap {
    let sun = Vec3::new(0.55, 0.62, 0.56).normalize();
    EnvMap::from_fn(width, height, |d| {
        if d.y < 0.0 {
            return [0.0; 3];
        }
        let up = d.y.sqrt();
        // exp(k (cos - 1)) is half at 25 degrees.
        let glow = 3.0 * (7.4 * (sun.dot(d) - 1.0)).exp();
        let (low, high, warm) = ([0.55, 0.50, 0.48], [0.16, 0.30, 0.62], [1.0, 0.86, 0.66]);
        std::array::from_fn(|c| (low[c] + (high[c] - low[c]) * up + glow * warm[c]) as f32)
    })
}

/// A square window `size_rad` wide seen from the object, about `centre`, level with the horizon: constant `radiance`. `size` is columns and rows of the map.
///
/// # Errors
/// An empty map, or a radiance that is not finite.
pub fn window(size: (usize, usize), centre: &Vec3, size_rad: f64, radiance: [f32; 3]) -> Result<EnvMap> {
    let centre = centre.normalize();
    let side = if centre.y.abs() > 0.999 { Vec3::x() } else { Vec3::y().cross(&centre).normalize() };
    let up = centre.cross(&side);
    let half = (0.5 * size_rad).tan();
    patch(size, radiance, |d| {
        let depth = d.dot(&centre);
        depth > 0.0 && d.dot(&side).abs() < half * depth && d.dot(&up).abs() < half * depth
    })
}

/// A strip light `size_rad` wide along the great circle through `centre` in the direction `along`, `length_rad` long,
/// and only above the horizon: constant `radiance`. `size` is columns and rows of the map.
///
/// # Errors
/// An empty map, or a radiance that is not finite.
pub fn strip(
    size: (usize, usize),
    centre: &Vec3,
    along: &Vec3,
    size_rad: f64,
    length_rad: f64,
    radiance: [f32; 3],
) -> Result<EnvMap> {
    let centre = centre.normalize();
    let pole = centre.cross(along).normalize();
    let along = pole.cross(&centre);
    let (thin, half) = ((0.5 * size_rad).sin(), 0.5 * length_rad);
    patch(size, radiance, |d| {
        d.y >= 0.0 && d.dot(&pole).abs() < thin && d.dot(&along).atan2(d.dot(&centre)).abs() < half
    })
}

/// A map of constant radiance where `inside` holds. Texels whose middle, corners and edges disagree are sampled
/// finely, so features should be wider than half a texel.
fn patch((width, height): (usize, usize), radiance: [f32; 3], inside: impl Fn(&Vec3) -> bool + Sync) -> Result<EnvMap> {
    let at = |i: usize, j: usize, a: usize, b: usize, n: usize| {
        let (u, v) = (i as f64 + a as f64 / n as f64, j as f64 + b as f64 / n as f64);
        inside(&latlong::direction(u, v, width, height))
    };
    let coverage = |i: usize, j: usize| {
        let first = at(i, j, 1, 1, 2);
        if (0..9).all(|k| at(i, j, k % 3, k / 3, 2) == first) {
            return if first { 1.0 } else { 0.0 };
        }
        let n = 2 * FINE;
        let hits = (0..FINE * FINE).filter(|k| at(i, j, 2 * (k % FINE) + 1, 2 * (k / FINE) + 1, n)).count();
        hits as f32 / (FINE * FINE) as f32
    };
    let rows: Vec<Vec<f32>> =
        (0..height).into_par_iter().map(|j| (0..width).map(|i| coverage(i, j)).collect()).collect();
    EnvMap::new(Image::from_fn(width, height, |i, j| radiance.map(|r| r * rows[j][i])))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn power(map: &EnvMap) -> f64 {
        let (w, h) = map.image().size();
        (0..h)
            .map(|j| {
                map.image().row(j).iter().step_by(3).map(|v| f64::from(*v)).sum::<f64>()
                    * latlong::texel_solid_angle(j, w, h)
            })
            .sum()
    }

    #[test]
    fn a_window_and_a_strip_have_their_solid_angles() {
        let size = (512, 256);
        for centre in [Vec3::new(0.4, 0.7, 0.5), Vec3::y(), Vec3::new(-0.8, 0.3, -0.4)] {
            let map = window(size, &centre, 10f64.to_radians(), [1.0; 3]).unwrap();
            // A square of half side t at distance 1: 4 asin(t^2 / (1 + t^2)).
            let t2 = 5f64.to_radians().tan().powi(2);
            assert!((power(&map) / (4.0 * (t2 / (1.0 + t2)).asin()) - 1.0).abs() < 5e-3, "window at {centre}");
        }
        let map = strip(size, &Vec3::y(), &Vec3::x(), 5f64.to_radians(), 180f64.to_radians(), [1.0; 3]).unwrap();
        let expected = std::f64::consts::TAU * 2.5f64.to_radians().sin();
        assert!((power(&map) / expected - 1.0).abs() < 5e-3);
        assert_eq!(map.radiance(&Vec3::new(0.6, 0.8, 0.0)), [1.0; 3]);
        assert_eq!(map.radiance(&Vec3::new(0.6, 0.7, 0.3).normalize()), [0.0; 3]);
    }
}
