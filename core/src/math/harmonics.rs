//! Real spherical harmonics about +y, orthonormal on the sphere.
//!
//! `Y_lm(w) = P_l|m|(sin lat) times 1, sqrt 2 cos(m lon), sqrt 2 sin(|m| lon)` for m = 0, m > 0, m < 0, with latitude and
//! longitude as in [`latlong`](super::latlong) and `P` the associated Legendre functions without the Condon-Shortley sign,
//! normalised so that the integral of `Y^2` over the sphere is 1. Function (l, m) has the number `l^2 + l + m`; `bands` n
//! means l < n, n^2 functions.

use std::f64::consts::{PI, SQRT_2};

use super::Vec3;

/// The number of the function (l, m).
pub fn number(l: usize, m: isize) -> usize {
    (l * l + l).wrapping_add_signed(m)
}

/// `P_lm(x)` for `0 <= m <= l < bands`, at `l (l + 1) / 2 + m`, for x = sin latitude and m from 0. Upward recurrence in l,
/// which is stable (Press et al., Numerical Recipes, 3rd ed., 6.7.1, normalised form).
pub fn legendre(x: f64, bands: usize, out: &mut Vec<f64>) {
    let place = |l: usize, m: usize| l * (l + 1) / 2 + m;
    out.clear();
    out.resize(place(bands, 0), 0.0);
    let cos = (1.0 - x * x).max(0.0).sqrt();
    let mut diagonal = (4.0 * PI).recip().sqrt();
    for m in 0..bands {
        if m > 0 {
            diagonal *= cos * ((2 * m + 1) as f64 / (2 * m) as f64).sqrt();
        }
        out[place(m, m)] = diagonal;
        if m + 1 < bands {
            out[place(m + 1, m)] = x * ((2 * m + 3) as f64).sqrt() * diagonal;
        }
        for l in m + 2..bands {
            let (lf, mf) = (l as f64, m as f64);
            let a = ((4.0 * lf * lf - 1.0) / (lf * lf - mf * mf)).sqrt();
            let b = (((lf - 1.0).powi(2) - mf * mf) / (4.0 * (lf - 1.0).powi(2) - 1.0)).sqrt();
            out[place(l, m)] = a * (x * out[place(l - 1, m)] - b * out[place(l - 2, m)]);
        }
    }
}

/// All functions at a unit direction, by number.
pub fn at(direction: &Vec3, bands: usize) -> Vec<f64> {
    let mut p = Vec::new();
    legendre(direction.y.clamp(-1.0, 1.0), bands, &mut p);
    let lon = direction.x.atan2(direction.z);
    let mut values = vec![0.0; bands * bands];
    for m in 0..bands {
        let (sin, cos) = (m as f64 * lon).sin_cos();
        for l in m..bands {
            let p = p[l * (l + 1) / 2 + m];
            if m == 0 {
                values[number(l, 0)] = p;
            } else {
                values[number(l, m as isize)] = SQRT_2 * cos * p;
                values[number(l, -(m as isize))] = SQRT_2 * sin * p;
            }
        }
    }
    values
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::latlong;

    #[test]
    fn functions_are_orthonormal() {
        let (w, h, bands) = (128, 512, 9);
        let n = bands * bands;
        let mut gram = vec![0.0; n * n];
        for j in 0..h {
            let steradians = latlong::texel_solid_angle(j, w, h);
            for i in 0..w {
                let values = at(&latlong::direction(i as f64 + 0.5, j as f64 + 0.5, w, h), bands);
                for a in 0..n {
                    for b in 0..=a {
                        gram[a * n + b] += steradians * values[a] * values[b];
                    }
                }
            }
        }
        for a in 0..n {
            for b in 0..=a {
                let expected = f64::from(u8::from(a == b));
                assert!((gram[a * n + b] - expected).abs() < 1e-3, "({a}, {b}): {}", gram[a * n + b]);
            }
        }
    }

    #[test]
    fn the_first_functions_are_the_known_ones() {
        let d = Vec3::new(0.48, 0.6, 0.64);
        let values = at(&d, 3);
        let (c0, c1) = (0.5 / PI.sqrt(), (3.0 / (4.0 * PI)).sqrt());
        let c2 = 0.5 * (15.0 / PI).sqrt();
        for (number, expected) in [
            (0, c0),
            (1, c1 * d.x),
            (2, c1 * d.y),
            (3, c1 * d.z),
            (4, c2 * d.x * d.z),
            (5, c2 * d.x * d.y),
            (6, 0.25 * (5.0 / PI).sqrt() * (3.0 * d.y * d.y - 1.0)),
            (7, c2 * d.y * d.z),
            (8, 0.5 * c2 * (d.z * d.z - d.x * d.x)),
        ] {
            assert!((values[number] - expected).abs() < 1e-12, "{number}: {} is not {expected}", values[number]);
        }
    }

    /// The addition theorem: `sum_m Y_lm(a) Y_lm(b) = (2 l + 1) / (4 pi) P_l(a . b)`; at a = b, up to l = 24.
    #[test]
    fn bands_are_invariant() {
        for d in [Vec3::y(), Vec3::new(0.1, -0.99, 0.05).normalize(), Vec3::new(-0.7, 0.1, -0.4).normalize()] {
            let values = at(&d, 25);
            for l in 0..25 {
                let sum: f64 = (l * l..(l + 1) * (l + 1)).map(|n| values[n] * values[n]).sum();
                assert!((sum * 4.0 * PI / (2 * l + 1) as f64 - 1.0).abs() < 1e-9, "band {l} at {d}: {sum}");
            }
        }
    }
}
