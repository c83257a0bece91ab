//! Blurring a map by an angle: the heat flow on the sphere.
//!
//! A Gaussian on the sphere is the kernel of the heat equation, df/dt = Laplacian f, run for t = sigma^2 / 2: what a plane's
//! Gaussian of standard deviation sigma (about each axis) becomes, for any angle (P. Hartman, G. S. Watson, "'Normal'
//! distribution functions on spheres and the modified Bessel functions", 1974). We solve it on the texels themselves as
//! finite volumes: what leaves a texel through an edge enters its neighbour, so energy is kept and a constant stays, the
//! edges at longitude 0 are like all others, and at the poles edges have no length and nothing is special.
//!
//! Longitude is decoupled by a Fourier transform of each row. What is left for each frequency m is a tridiagonal matrix
//! over the rows, and its exponential is a sum of seven solves ([`POLES`]).

use std::borrow::Cow;
use std::f64::consts::PI;

use nalgebra::Complex;
use rayon::prelude::*;
use realfft::RealFftPlanner;

use super::EnvMap;
use crate::image::Image;

type C64 = Complex<f64>;

/// exp(x) = [`AT_INFINITY`] + 2 Re sum_k residue_k / (x - pole_k) to 2e-14 for all x <= 0: the Chebyshev rational
/// approximation of degree 14 (A. J. Carpenter, A. Ruttan, R. S. Varga, 1984), in partial fractions as M. Pusa gives them
/// ("Rational approximations to the matrix exponential in burnup calculations", 2011, table I). `(pole, residue)`.
const POLES: [(C64, C64); 7] = [
    (C64::new(-8.897773186468888, 16.630982619902085), C64::new(-7.154288063589067e-5, 1.43610433495413e-4)),
    (C64::new(-3.703275049423448, 13.65637187148327), C64::new(9.439025310736168e-3, -1.718479195848302e-2)),
    (C64::new(-0.2087586382501301, 10.99126056190126), C64::new(-0.3763600387822696, 0.335183470294501)),
    (C64::new(3.993369710578568, 6.004831642235037), C64::new(-23.4982320910827, -5.808359129714207)),
    (C64::new(5.089345060580624, 3.588824029027006), C64::new(46.93327448883129, 45.64364976882776)),
    (C64::new(5.623142572745977, 1.194069046343967), C64::new(-27.87516194014564, -102.1473399905645)),
    (C64::new(2.269783829231113, 8.46173797304022), C64::new(4.807112098832508, -1.320979383742872)),
];
/// The limit of the approximation at minus infinity.
const AT_INFINITY: f64 = 1.832_174_378_254_041e-14;
/// Frequencies that decay by more than exp(-40) = 4e-18 hold nothing that f64 keeps.
const DECAYED: f64 = 40.0;
/// Numbers of a row at one frequency: real and imaginary part of three channels.
const LANES: usize = 6;

impl EnvMap {
    /// Blurs with a Gaussian on the sphere of standard deviation `sigma_deg` degrees (along each of the two directions; its
    /// full width at half maximum is 2.355 times that). Energy is kept to rounding, constants stay, nothing becomes
    /// negative that was not. 0 and less change nothing. From the ideal Gaussian it differs by about a quarter of
    /// (texel / sigma)^2 of its peak, the texel being that of the equator; its variance is right for any angle.
    ///
    /// Cost: a Fourier transform of each row and 7 tridiagonal solves for each frequency that survives; wide blurs are cheaper.
    pub fn blurred(&self, sigma_deg: f64) -> Cow<'_, Self> {
        if sigma_deg.is_nan() || sigma_deg <= 0.0 {
            return Cow::Borrowed(self);
        }
        let (w, h) = self.image().size();
        let t = sigma_deg.to_radians().powi(2) / 2.0;
        let spectrum = rows_to_frequencies(self.image());
        let mut blurred = vec![0.0; spectrum.len()];
        let flow = Flow::new(w, h, t);
        let frequencies = blurred.par_chunks_mut(h * LANES).zip(spectrum.par_chunks(h * LANES)).enumerate();
        frequencies.filter(|(m, _)| flow.least_decay(*m) < DECAYED).for_each(|(m, (out, rows))| flow.run(m, rows, out));
        Cow::Owned(Self { image: frequencies_to_rows(&blurred, self.image()) })
    }
}

/// Each row's Fourier transform, as `[frequency][row][channel][real, imaginary]`.
fn rows_to_frequencies(image: &Image) -> Vec<f64> {
    let (w, h) = image.size();
    let forward = RealFftPlanner::<f64>::new().plan_fft_forward(w);
    let transformed: Vec<Vec<C64>> = (0..3 * h)
        .into_par_iter()
        .map(|line| {
            let mut row: Vec<f64> = image.row(line / 3).iter().skip(line % 3).step_by(3).map(|&v| v.into()).collect();
            let mut out = forward.make_output_vec();
            // It fails only for buffers of other lengths than its own.
            let _ = forward.process(&mut row, &mut out);
            out
        })
        .collect();
    let mut spectrum = vec![0.0; (w / 2 + 1) * h * LANES];
    spectrum.par_chunks_mut(h * LANES).enumerate().for_each(|(m, rows)| {
        for (pair, line) in rows.chunks_exact_mut(2).zip(&transformed) {
            (pair[0], pair[1]) = (line[m].re, line[m].im);
        }
    });
    spectrum
}

/// Back to a picture of the size of `original`.
fn frequencies_to_rows(spectrum: &[f64], original: &Image) -> Image {
    let (w, h) = original.size();
    let inverse = RealFftPlanner::<f64>::new().plan_fft_inverse(w);
    // Rounding must not make light negative: where a channel had none of that, it gets none.
    let floor: [f32; 3] = std::array::from_fn(|c| {
        let negative = original.data().iter().skip(c).step_by(3).any(|v| *v < 0.0);
        if negative { f32::NEG_INFINITY } else { 0.0 }
    });
    let mut image = Image::new(w, h, 3);
    image.data_mut().par_chunks_mut(3 * w).enumerate().for_each(|(j, row)| {
        for c in 0..3 {
            let at = |m: usize| spectrum[(m * h + j) * LANES + 2 * c..][..2].iter();
            let mut line: Vec<C64> = (0..w / 2 + 1)
                .map(|m| {
                    let mut pair = at(m);
                    C64::new(pair.next().copied().unwrap_or(0.0), pair.next().copied().unwrap_or(0.0))
                })
                .collect();
            // Zero anyway, but the transform wants it exactly.
            line[0].im = 0.0;
            if w.is_multiple_of(2) {
                line[w / 2].im = 0.0;
            }
            let mut out = inverse.make_output_vec();
            let _ = inverse.process(&mut line, &mut out);
            row.iter_mut().skip(c).step_by(3).zip(&out).for_each(|(v, o)| *v = ((o / w as f64) as f32).max(floor[c]));
        }
    });
    image
}

/// The finite volumes of a map, for a time t.
///
/// Texel (i, j) has area a_j = sin(top) - sin(bottom) times dlon. Through the edge between rows j - 1 and j flows
/// k_j (f_{j-1} - f_j) with k_j = cos(latitude of the edge) / dlat, times dlon; through the edges between columns
/// flows dlat / (cos(lat_j) dlon) times the difference, which for frequency m is a decay of 2 - 2 cos(m dlon).
struct Flow {
    /// t / a_j.
    per_area: Vec<f64>,
    /// k_j, for j = 0 (the pole: zero) to H (the other pole).
    edges: Vec<f64>,
    /// dlat / (cos(lat_j) dlon^2).
    around: Vec<f64>,
    dlon: f64,
    t: f64,
}

impl Flow {
    fn new(w: usize, h: usize, t: f64) -> Self {
        let (dlat, dlon) = (PI / h as f64, 2.0 * PI / w as f64);
        // Colatitude: row j lies between j dlat and (j + 1) dlat.
        let edges = (0..=h).map(|j| if j == 0 || j == h { 0.0 } else { (j as f64 * dlat).sin() / dlat }).collect();
        let area = |j: usize| (j as f64 * dlat).cos() - ((j + 1) as f64 * dlat).cos();
        let around = |j: usize| dlat / (((j as f64 + 0.5) * dlat).sin() * dlon * dlon);
        Self { per_area: (0..h).map(|j| t / area(j)).collect(), edges, around: (0..h).map(around).collect(), dlon, t }
    }

    /// 2 - 2 cos(m dlon).
    fn difference(&self, m: usize) -> f64 {
        4.0 * (m as f64 * self.dlon / 2.0).sin().powi(2)
    }

    /// What frequency m decays by at least, as an exponent: that of the equator, where texels are widest.
    fn least_decay(&self, m: usize) -> f64 {
        self.t * self.difference(m) / (self.dlon * self.dlon)
    }

    /// out = exp(-t L_m) rows, L_m the (positive) Laplacian of frequency m; both `[row][lane]`, `out` zeroed.
    fn run(&self, m: usize, rows: &[f64], out: &mut [f64]) {
        let h = self.per_area.len();
        out.iter_mut().zip(rows).for_each(|(o, r)| *o = AT_INFINITY * r);
        let (mut ratios, mut solved) = (vec![C64::default(); h], vec![[C64::default(); LANES]; h]);
        for (pole, residue) in POLES {
            self.solve(m, pole, rows, (&mut ratios, &mut solved));
            for (out, y) in out.chunks_exact_mut(LANES).zip(&solved) {
                for (o, y) in out.iter_mut().zip(y) {
                    *o += 2.0 * (residue.re * y.re - residue.im * y.im);
                }
            }
        }
    }

    /// Solves (-t L_m - pole) y = rows by elimination down the rows and substitution back up (Thomas). The imaginary part of
    /// the matrix is definite, so that no pivot vanishes.
    fn solve(&self, m: usize, pole: C64, rows: &[f64], (ratios, solved): (&mut [C64], &mut [[C64; LANES]])) {
        let (h, difference) = (self.per_area.len(), self.difference(m));
        let mut above = (C64::default(), [C64::default(); LANES]);
        for (j, row) in rows.chunks_exact(LANES).enumerate() {
            let (scale, up, down) = (self.per_area[j], self.edges[j], self.edges[j + 1]);
            let diagonal = -scale * (up + down + self.around[j] * difference) - pole;
            let (sub, sup) = (scale * up, scale * down);
            let pivot = (diagonal - above.0 * sub).inv();
            ratios[j] = pivot * sup;
            solved[j] = std::array::from_fn(|k| (C64::from(row[k]) - above.1[k] * sub) * pivot);
            above = (ratios[j], solved[j]);
        }
        for j in (0..h.saturating_sub(1)).rev() {
            let below = solved[j + 1];
            solved[j].iter_mut().zip(below).for_each(|(y, b)| *y -= ratios[j] * b);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::{Vec3, latlong};

    fn sun(w: usize, h: usize, i: usize, j: usize) -> EnvMap {
        EnvMap { image: Image::from_fn(w, h, |x, y| if (x, y) == (i, j) { [1000.0, 1.0, 0.0] } else { [0.0; 3] }) }
    }

    #[test]
    fn the_rational_function_is_the_exponential() {
        for k in 0..4000 {
            let x = -(1.01f64.powi(k - 2000));
            let sum: f64 = POLES.iter().map(|(pole, residue)| 2.0 * (residue / (x - pole)).re).sum();
            assert!((AT_INFINITY + sum - x.exp()).abs() < 1e-12, "{x}: {} is not {}", AT_INFINITY + sum, x.exp());
        }
    }

    /// The Gaussian on the sphere in closed form: sum over l of (2 l + 1) / 4 pi exp(-l (l + 1) t) P_l(cos angle).
    fn heat_kernel(cos_angle: f64, t: f64) -> f64 {
        let (mut before, mut legendre, mut sum) = (0.0, 1.0, 0.0);
        for l in 0..400 {
            let l = f64::from(l);
            sum += (2.0 * l + 1.0) / (4.0 * PI) * (-l * (l + 1.0) * t).exp() * legendre;
            let next = ((2.0 * l + 1.0) * cos_angle * legendre - l * before) / (l + 1.0);
            (before, legendre) = (legendre, next);
        }
        sum
    }

    #[test]
    fn a_sun_becomes_the_gaussian_of_the_sphere() {
        let (w, h) = (128, 64);
        // In the middle, at the seam, beside a pole, and on it.
        for (i, j, sigma_deg) in [(40, 30, 15.0), (0, 20, 12.0), (127, 2, 20.0), (64, 0, 12.0), (10, 50, 90.0)] {
            let blurred = sun(w, h, i, j).blurred(sigma_deg).into_owned();
            let t = f64::to_radians(sigma_deg).powi(2) / 2.0;
            let centre = latlong::direction(i as f64 + 0.5, j as f64 + 0.5, w, h);
            let energy = 1000.0 * latlong::texel_solid_angle(j, w, h);
            let peak = energy * heat_kernel(1.0, t);
            // Finite volumes are of second order in the size of a texel.
            let tolerance = peak * (0.27 * (180.0 / h as f64 / sigma_deg).powi(2)).max(0.002);
            for (x, y) in (0..h).flat_map(|y| (0..w).map(move |x| (x, y))) {
                let d = latlong::direction(x as f64 + 0.5, y as f64 + 0.5, w, h);
                let expected = energy * heat_kernel(centre.dot(&d), t);
                let found = f64::from(blurred.image().pixel(x, y)[0]);
                assert!((found - expected).abs() < tolerance, "({i}, {j}): {found}, {expected} at ({x}, {y})");
            }
        }
    }

    #[test]
    fn energy_and_constants_stay_and_nothing_turns_negative() {
        for (w, h) in [(1, 1), (2, 1), (5, 3), (64, 32), (37, 50)] {
            for sigma_deg in [0.01, 1.0, 30.0, 180.0] {
                let map = sun(w, h, w / 2, h / 3);
                let blurred = map.blurred(sigma_deg);
                assert!(blurred.image().data().iter().all(|v| *v >= 0.0), "{w} x {h}, {sigma_deg}");
                let (before, after) = (map.integral(), blurred.integral());
                for c in 0..3 {
                    assert!((before[c] - after[c]).abs() <= 1e-5 * before[c], "{w} x {h}, {sigma_deg}: {after:?}");
                }
                let grey = EnvMap::from_fn(w, h, |_| [0.75; 3]);
                let worst =
                    grey.blurred(sigma_deg).image().data().iter().fold(0.0, |m: f32, v| m.max((v - 0.75).abs()));
                assert!(worst < 1e-5, "{w} x {h}, {sigma_deg}: off by {worst}");
            }
        }
    }

    /// x, y and z are eigenfunctions of the Laplacian, of eigenvalue 2: blurring scales them alike, whatever their axis.
    #[test]
    fn gradients_fade_alike_along_every_axis() {
        let map = EnvMap::from_fn(128, 64, |d| [d.x as f32, d.y as f32, d.z as f32]);
        let blurred = map.blurred(40.0);
        let fade = (-f64::to_radians(40.0).powi(2)).exp() as f32;
        for (found, was) in blurred.image().data().iter().zip(map.image().data()) {
            assert!((found - fade * was).abs() < 1e-3, "{found} is not {}", fade * was);
        }
    }

    #[test]
    fn no_angle_changes_nothing() {
        let map = EnvMap::from_fn(8, 4, |d: &Vec3| [d.x as f32; 3]);
        for angle in [0.0, -1.0, f64::NAN] {
            assert!(matches!(map.blurred(angle), Cow::Borrowed(_)));
        }
    }
}
