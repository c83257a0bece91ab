//! Lat-long maps, laid out as OpenEXR's (`ImfEnvmap`).
//!
//! Texel (i, j) of a W x H map: lon = pi - 2 pi (i + 1/2) / W, lat = pi/2 - pi (j + 1/2) / H, direction =
//! (sin lon cos lat, sin lat, cos lon cos lat). Row 0 is +y, the centre column +z, and +x lies left of it: the map is
//! what an observer at the object sees.

use std::f64::consts::PI;

use super::Vec3;

/// The direction at continuous map coordinates, in texels: (0, 0) is the top left corner, (W, H) the bottom right.
pub fn direction(u: f64, v: f64, width: usize, height: usize) -> Vec3 {
    let lon = PI - 2.0 * PI * u / width as f64;
    let lat = PI / 2.0 - PI * v / height as f64;
    Vec3::new(lon.sin() * lat.cos(), lat.sin(), lon.cos() * lat.cos())
}

/// Continuous map coordinates of a unit direction: `0 <= u < W`, `0 <= v <= H`. Inverse of [`direction`].
pub fn coordinates(direction: &Vec3, width: usize, height: usize) -> (f64, f64) {
    let lon = direction.x.atan2(direction.z);
    let lat = direction.y.clamp(-1.0, 1.0).asin();
    let u = (PI - lon) / (2.0 * PI) * width as f64;
    let v = (PI / 2.0 - lat) / PI * height as f64;
    (if u >= width as f64 { 0.0 } else { u }, v.clamp(0.0, height as f64))
}

/// Solid angle in steradians of one texel of row `j`: `2 pi / W (sin lat_top - sin lat_bottom)`, exact.
pub fn texel_solid_angle(j: usize, width: usize, height: usize) -> f64 {
    band_solid_angle(j as f64, (j + 1) as f64, height) / width as f64
}

/// Solid angle of the whole band between two continuous rows.
pub fn band_solid_angle(v_top: f64, v_bottom: f64, height: usize) -> f64 {
    let lat = |v: f64| PI / 2.0 - PI * v / height as f64;
    2.0 * PI * (lat(v_top).sin() - lat(v_bottom).sin())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn poles_lie_where_openexr_puts_them() {
        let (w, h) = (16, 8);
        let close = |a: Vec3, b: Vec3| assert!((a - b).norm() < 1e-12, "{a} is not {b}");
        close(direction(8.0, 4.0, w, h), Vec3::z());
        close(direction(4.0, 4.0, w, h), Vec3::x());
        close(direction(12.0, 4.0, w, h), -Vec3::x());
        close(direction(0.0, 4.0, w, h), -Vec3::z());
        close(direction(3.0, 0.0, w, h), Vec3::y());
    }

    #[test]
    fn coordinates_invert_direction() {
        for (u, v) in [(0.5, 0.5), (7.9, 3.1), (15.99, 7.5), (0.01, 4.0)] {
            let (u2, v2) = coordinates(&direction(u, v, 16, 8), 16, 8);
            assert!((u - u2).abs() < 1e-9 && (v - v2).abs() < 1e-9, "({u}, {v}) became ({u2}, {v2})");
        }
    }

    #[test]
    fn solid_angles_fill_the_sphere() {
        let (w, h) = (37, 19);
        let sum: f64 = (0..h).map(|j| w as f64 * texel_solid_angle(j, w, h)).sum();
        assert!((sum - 4.0 * PI).abs() < 1e-12);
    }
}
