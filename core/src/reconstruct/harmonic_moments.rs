//! Integrals of a map times every spherical harmonic: row by row, for the functions are products of one of longitude and one
//! of latitude.

use std::f64::consts::{PI, SQRT_2, TAU};

use rayon::prelude::*;

use super::texels::FINEST_ROWS;
use crate::math::{harmonics, latlong};

/// The functions of some bands over the texels of one map size.
#[derive(Debug, Clone)]
pub(super) struct HarmonicMoments {
    bands: usize,
    width: usize,
    height: usize,
    /// For each texel the solid angle of its part in the coverage.
    covered: Vec<f32>,
    /// For each column `2 bands - 1` numbers: 1, and for m from 1 on sqrt 2 times the means over the texel of cos(m lon) and
    /// sin(m lon).
    columns: Vec<f64>,
    /// For each row the means over the texel of `P_lm(sin lat)`, as [`harmonics::legendre`] orders them.
    rows: Vec<f64>,
}

impl HarmonicMoments {
    /// `covered`: for each texel the solid angle of its part in the coverage, over which the functions are integrated (a
    /// texel at the rim as if that part were spread over it).
    pub fn new(bands: usize, (width, height): (usize, usize), covered: Vec<f32>) -> Self {
        let mut columns = Vec::with_capacity(width * (2 * bands - 1));
        for i in 0..width {
            let lon = PI - TAU * (i as f64 + 0.5) / width as f64;
            columns.push(1.0);
            for m in 1..bands {
                let half = m as f64 * PI / width as f64;
                let mean = SQRT_2 * half.sin() / half;
                let (sin, cos) = (m as f64 * lon).sin_cos();
                columns.extend([mean * cos, mean * sin]);
            }
        }
        let rows = (0..height).flat_map(|j| row(j, height, bands)).collect();
        Self { bands, width, height, covered, columns, rows }
    }

    /// What a product reads.
    pub fn bytes(&self) -> usize {
        size_of_val(&*self.covered) + size_of_val(&*self.columns) + size_of_val(&*self.rows)
    }

    /// For each function the integral over the coverage of it times the radiance; `radiance` is RGB, texel after texel.
    pub fn times(&self, radiance: &[f32]) -> Vec<[f64; 3]> {
        let functions = self.bands * self.bands;
        let rows: Vec<Vec<[f64; 3]>> = (0..self.height).into_par_iter().map(|j| self.waves(j, radiance)).collect();
        let mut moments = vec![[0.0; 3]; functions];
        for (j, waves) in rows.iter().enumerate().filter(|row| !row.1.is_empty()) {
            self.each(j, |number, wave, p| {
                (0..3).for_each(|c| moments[number][c] += p * waves[wave][c]);
            });
        }
        moments
    }

    /// For each texel the sum over the functions of coefficient times the integral over the covered part.
    pub fn transposed_times(&self, coefficients: &[f64]) -> Vec<f64> {
        let waves = 2 * self.bands - 1;
        let row = |j: usize| {
            let mut sums = vec![0.0; waves];
            self.each(j, |number, wave, p| sums[wave] += p * coefficients[number]);
            let texel = |i: usize| {
                let value: f64 = self.columns[i * waves..][..waves].iter().zip(&sums).map(|(a, b)| a * b).sum();
                f64::from(self.covered[j * self.width + i]) * value
            };
            (0..self.width).map(texel).collect::<Vec<f64>>()
        };
        (0..self.height).into_par_iter().flat_map_iter(row).collect()
    }

    /// Sums over row `j` of covered solid angle, radiance and the functions of longitude; empty where nothing is covered.
    fn waves(&self, j: usize, radiance: &[f32]) -> Vec<[f64; 3]> {
        let covered = &self.covered[j * self.width..][..self.width];
        if covered.iter().all(|c| *c == 0.0) {
            return Vec::new();
        }
        let waves = 2 * self.bands - 1;
        // One plane a channel, so that the inner loop runs along it.
        let mut sums = [vec![0.0; waves], vec![0.0; waves], vec![0.0; waves]];
        let texels = radiance[j * self.width * 3..][..self.width * 3].chunks_exact(3);
        for ((column, rgb), covered) in self.columns.chunks_exact(waves).zip(texels).zip(covered) {
            for (sum, light) in sums.iter_mut().zip(rgb) {
                let light = f64::from(*light) * f64::from(*covered);
                sum.iter_mut().zip(column).for_each(|(sum, wave)| *sum += light * wave);
            }
        }
        (0..waves).map(|n| [sums[0][n], sums[1][n], sums[2][n]]).collect()
    }

    /// Calls with (number of the function, its function of longitude, its `P` in row `j`).
    fn each(&self, j: usize, mut call: impl FnMut(usize, usize, f64)) {
        let count = self.bands * (self.bands + 1) / 2;
        let p = &self.rows[j * count..][..count];
        for l in 0..self.bands {
            for m in 0..=l {
                let p = p[l * (l + 1) / 2 + m];
                if m == 0 {
                    call(harmonics::number(l, 0), 0, p);
                } else {
                    call(harmonics::number(l, m as isize), 2 * m - 1, p);
                    call(harmonics::number(l, -(m as isize)), 2 * m, p);
                }
            }
        }
    }
}

/// Means over row `j` of the functions of latitude, weighted by solid angle.
fn row(j: usize, height: usize, bands: usize) -> Vec<f64> {
    let cut = FINEST_ROWS.div_ceil(height).max(1);
    let mut sums = vec![0.0; bands * (bands + 1) / 2];
    let mut p = Vec::new();
    let whole = latlong::band_solid_angle(j as f64, j as f64 + 1.0, height);
    for k in 0..cut {
        let top = j as f64 + k as f64 / cut as f64;
        let bottom = top + 1.0 / cut as f64;
        let share = latlong::band_solid_angle(top, bottom, height) / whole;
        let sin = (PI / 2.0 - PI * (top + bottom) / 2.0 / height as f64).sin();
        harmonics::legendre(sin, bands, &mut p);
        sums.iter_mut().zip(&p).for_each(|(sum, p)| *sum += share * p);
    }
    sums
}
