//! Turning a map about any axis.
//!
//! Heading alone is a shift of columns ([`EnvMap::oriented`]). Any other rotation looks up, for sub-samples of every new
//! texel, where its light came from.

use std::f32::consts::{FRAC_PI_2, PI, TAU};

use rayon::prelude::*;

use super::{EnvMap, MapCentre};
use crate::image::Image;
use crate::math::{Mat3, Orientation, latlong};

/// Sub-samples of a texel along each side, fewer along longitude towards the poles. A bilinear tent sampled four times a
/// texel keeps its sum to 0.2 % in most directions, and to 1.2 % in the worst, across the diagonal of the samples.
const FINER: usize = 4;

impl EnvMap {
    /// The map in the stage frame: its centre column put where `centre` says, then turned.
    ///
    /// With heading alone this is [`EnvMap::oriented`], to the bit; otherwise [`EnvMap::rotated`].
    pub fn turned(&self, centre: MapCentre, by: &Orientation) -> Self {
        if by.is_heading() {
            return self.oriented(centre, by.heading_deg);
        }
        let behind = Orientation { heading_deg: 180.0, ..Orientation::default() };
        match centre {
            MapCentre::Front => self.rotated(&by.matrix()),
            MapCentre::Behind => self.rotated(&(by.matrix() * behind.matrix())),
        }
    }

    /// The map turned by a rotation matrix: light from direction d comes from `rotation * d` afterwards. The integral of
    /// each channel is kept.
    ///
    /// The source is interpolated bilinearly, across the poles too, after rows towards the poles were averaged
    /// along longitude over 1 / cos(lat) texels: there texels are slivers, of which sub-samples would miss some and hit others.
    /// A sun of one texel spreads to about two. What the interpolation gains or loses (about 0.2 %, but up to 8 % of light right on a
    /// pole texel) is put right by one factor for the whole map; channels that are about as negative as positive have no such
    /// factor and stay.
    pub fn rotated(&self, rotation: &Mat3) -> Self {
        let (w, h) = self.image().size();
        let source = Source::new(self.image());
        // Where light came from: the inverse, applied to new directions.
        let back = rotation.transpose().map(|v| v as f32);
        let columns: [Vec<[f32; 2]>; FINER] = std::array::from_fn(|finer| meridians(w * (finer + 1)));
        let mut image = Image::new(w, h, 3);
        image.data_mut().par_chunks_mut(3 * w).enumerate().for_each_init(
            || vec![[0.0f32; 2]; w * FINER],
            |places, (j, row)| {
                let cos = latlong::texel_solid_angle(j, w, h) / latlong::texel_solid_angle(h / 2, w, h);
                let finer = ((FINER as f64 * cos).ceil() as usize).clamp(1, FINER);
                let places = &mut places[..w * finer];
                for (y, r, share) in parallels(j, h) {
                    for (place, [s, c]) in places.iter_mut().zip(&columns[finer - 1]) {
                        let (x, z) = (s * r, c * r);
                        let from = |k: usize| back[(k, 0)] * x + back[(k, 1)] * y + back[(k, 2)] * z;
                        *place = source.place(from(0), from(1), from(2));
                    }
                    let share = share / finer as f32;
                    for (pixel, places) in row.chunks_exact_mut(3).zip(places.chunks_exact(finer)) {
                        let sum = places.iter().fold([0.0; 4], |sum, place| add(sum, source.at(*place)));
                        pixel.iter_mut().zip(sum).for_each(|(p, s)| *p += share * s);
                    }
                }
            },
        );
        let mut turned = Self { image };
        turned.match_integral(self);
        turned
    }

    /// Scales each channel so that its integral is that of `other`, where both are mostly of one sign.
    fn match_integral(&mut self, other: &Self) {
        let (found, expected) = (self.integral(), other.integral());
        let magnitude = self.integral_of(|v| v.abs());
        let gain = |c: usize| if found[c].abs() > magnitude[c] / 2.0 { (expected[c] / found[c]) as f32 } else { 1.0 };
        let gains = [gain(0), gain(1), gain(2)];
        self.image.data_mut().chunks_exact_mut(3).for_each(|p| p.iter_mut().zip(gains).for_each(|(v, g)| *v *= g));
    }
}

/// Sine and cosine of the longitudes at the centres of `n` columns.
fn meridians(n: usize) -> Vec<[f32; 2]> {
    let at = |i: usize| latlong::direction(i as f64 + 0.5, 0.5, n, 1);
    (0..n).map(|i| [at(i).x as f32, at(i).z as f32]).collect()
}

/// Sine and cosine of the latitudes at the centres of the sub-rows of row j, and their shares of its solid angle.
fn parallels(j: usize, h: usize) -> [(f32, f32, f32); FINER] {
    let edge = |k: usize| j as f64 + k as f64 / FINER as f64;
    let whole = latlong::band_solid_angle(edge(0), edge(FINER), h);
    std::array::from_fn(|k| {
        let (sin, cos) = (std::f64::consts::PI * (0.5 - (edge(k) + edge(k + 1)) / 2.0 / h as f64)).sin_cos();
        (sin as f32, cos as f32, (latlong::band_solid_angle(edge(k), edge(k + 1), h) / whole) as f32)
    })
}

fn add(a: [f32; 4], b: [f32; 4]) -> [f32; 4] {
    std::array::from_fn(|c| a[c] + b[c])
}

/// A map ready for interpolation: one more column, and beyond each pole the row across it.
struct Source {
    /// `[row + 1][column][r, g, b, 0]`.
    texels: Vec<[f32; 4]>,
    w: usize,
    h: usize,
}

impl Source {
    fn new(image: &Image) -> Self {
        let (w, h) = image.size();
        let rows: Vec<Vec<[f32; 4]>> = (0..h).into_par_iter().map(|j| averaged(image, j)).collect();
        let mut texels = Vec::with_capacity((w + 1) * (h + 2));
        let mut push = |row: &[[f32; 4]], shift: usize| texels.extend((0..=w).map(|i| row[(i + shift) % w]));
        push(&rows[0], w / 2);
        rows.iter().for_each(|row| push(row, 0));
        push(&rows[h - 1], w / 2);
        Self { texels, w, h }
    }

    /// Column and row, counted from the centres of the first texel and of the row across the pole, of a unit vector.
    fn place(&self, x: f32, y: f32, z: f32) -> [f32; 2] {
        let u = (PI - atan2(x, z)) / TAU * self.w as f32 - 0.5;
        let v = (FRAC_PI_2 - atan2(y, (x * x + z * z).sqrt())) / PI * self.h as f32 + 0.5;
        [if u < 0.0 { u + self.w as f32 } else { u }, v]
    }

    /// Bilinear.
    fn at(&self, [u, v]: [f32; 2]) -> [f32; 4] {
        let (i, j) = ((u as usize).min(self.w - 1), (v as usize).min(self.h));
        let (fu, fv) = (u - i as f32, v - j as f32);
        let at = j * (self.w + 1) + i;
        let (top, bottom) = (&self.texels[at..at + 2], &self.texels[at + self.w + 1..at + self.w + 3]);
        std::array::from_fn(|c| {
            let a = top[0][c] + fu * (top[1][c] - top[0][c]);
            let b = bottom[0][c] + fu * (bottom[1][c] - bottom[0][c]);
            a + fv * (b - a)
        })
    }
}

/// Row j, every texel the mean over 1 / cos(lat) texels about it, all around at most; the row's sum stays.
fn averaged(image: &Image, j: usize) -> Vec<[f32; 4]> {
    let (w, h) = image.size();
    let row = image.row(j);
    let cos = (std::f64::consts::PI * (j as f64 + 0.5) / h as f64).sin();
    let width = (1.0 / cos).min(w as f64);
    // before[i]: the sum of what lies left of edge i, over two turns.
    let mut before = vec![[0.0f64; 3]; 3 * w + 1];
    for i in 0..3 * w {
        before[i + 1] = std::array::from_fn(|c| before[i][c] + f64::from(row[3 * (i % w) + c]));
    }
    let upto = |u: f64, c: usize| {
        let i = (u as usize).min(3 * w - 1);
        before[i][c] + (u - i as f64) * (before[i + 1][c] - before[i][c])
    };
    let mean = |i: usize, c: usize| {
        let centre = (w + i) as f64 + 0.5;
        ((upto(centre + width / 2.0, c) - upto(centre - width / 2.0, c)) / width) as f32
    };
    (0..w).map(|i| [mean(i, 0), mean(i, 1), mean(i, 2), 0.0]).collect()
}

/// The angle of (x, y) from +x, in radians, to 3e-7: M. Abramowitz, I. A. Stegun, "Handbook of Mathematical Functions",
/// 4.4.49, without branches so that it is vectorised. 0 for (0, 0).
fn atan2(y: f32, x: f32) -> f32 {
    const A: [f32; 9] = [
        1.0,
        -0.333_331_45,
        0.199_935_51,
        -0.142_089,
        0.106_562_64,
        -0.075_289_64,
        0.042_909_614,
        -0.016_165_737,
        0.002_866_226,
    ];
    let (ax, ay) = (x.abs(), y.abs());
    let t = ax.min(ay) / ax.max(ay).max(f32::MIN_POSITIVE);
    let t2 = t * t;
    let r = t * A.iter().rev().fold(0.0, |sum, a| sum * t2 + a);
    let r = if ay > ax { FRAC_PI_2 - r } else { r };
    let r = if x < 0.0 { PI - r } else { r };
    r.copysign(y)
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};

    use super::*;
    use crate::math::{Vec3, angle_between};

    fn smooth(w: usize, h: usize) -> EnvMap {
        EnvMap::from_fn(w, h, |d| [(1.5 + d.x) as f32, (1.2 + d.y * d.z) as f32, (2.0 + d.z + d.x * d.y) as f32])
    }

    fn difference(a: &EnvMap, b: &EnvMap) -> f32 {
        a.image().data().iter().zip(b.image().data()).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
    }

    fn random(rng: &mut rand_pcg::Pcg64Mcg) -> Orientation {
        let mut angle = || rng.random_range(-180.0..180.0);
        Orientation { heading_deg: angle(), pitch_deg: angle(), roll_deg: angle() }
    }

    #[test]
    fn the_angle_is_right_in_every_octant() {
        for k in 0..10_000 {
            let (y, x) = (f64::from(k) / 10_000.0 * std::f64::consts::TAU - std::f64::consts::PI).sin_cos();
            let (y, x) = (y as f32, x as f32);
            assert!((atan2(y, x) - y.atan2(x)).abs() < 5e-7, "({y}, {x})");
        }
        assert_eq!(atan2(0.0, 0.0), 0.0);
    }

    #[test]
    fn a_sun_keeps_its_energy_and_its_place() {
        let (w, h) = (128, 64);
        let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(7);
        let mut sum_of_squares = 0.0;
        for case in 0..60 {
            // Every tenth in the second row from a pole, where texels are slivers.
            let (i, j) = (rng.random_range(0..w), if case % 10 == 0 { 1 } else { rng.random_range(1..h - 1) });
            // Much brighter than all the rest together, so that the one factor for all cannot put the sun right.
            let texel = latlong::texel_solid_angle(j, w, h);
            let lit = |x, y, sun: f32| if (x, y) == (i, j) { [sun, 0.0, 0.0] } else { [1.0, 0.0, 0.0] };
            let with = |sun: f64| EnvMap { image: Image::from_fn(w, h, |x, y| lit(x, y, (sun / texel) as f32 + 1.0)) };
            let (faint, bright) = (with(0.01), with(0.02));
            let matrix = random(&mut rng).matrix();
            let (faint, bright) = (faint.rotated(&matrix), bright.rotated(&matrix));
            let (mut energy, mut centroid) = (0.0, Vec3::zeros());
            for (x, y) in (0..h).flat_map(|y| (0..w).map(move |x| (x, y))) {
                let more = f64::from(bright.image().pixel(x, y)[0] - faint.image().pixel(x, y)[0]);
                let part = more * latlong::texel_solid_angle(y, w, h);
                energy += part;
                centroid += part * latlong::direction(x as f64 + 0.5, y as f64 + 0.5, w, h);
            }
            let error: f64 = energy / 0.01 - 1.0;
            assert!(error.abs() < 0.0125, "case {case}, row {j}: {energy}");
            sum_of_squares += error * error;
            let expected = matrix * latlong::direction(i as f64 + 0.5, j as f64 + 0.5, w, h);
            let off = angle_between(&centroid.normalize(), &expected).to_degrees();
            assert!(off < 0.5 * 360.0 / w as f64, "case {case}, row {j}: off by {off} degrees");
        }
        let rms = (sum_of_squares / 60.0_f64).sqrt();
        assert!(rms < 0.003, "{rms}");
    }

    #[test]
    fn a_rotation_and_its_inverse_are_nothing() {
        let map = smooth(128, 64);
        let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(3);
        for _ in 0..5 {
            let matrix = random(&mut rng).matrix();
            let back = map.rotated(&matrix).rotated(&matrix.transpose());
            assert!(difference(&back, &map) < 0.01, "{}", difference(&back, &map));
        }
    }

    #[test]
    fn turning_agrees_with_turning_directions_and_keeps_integrals() {
        let map = smooth(256, 128);
        let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(5);
        let by = random(&mut rng);
        let turned = map.turned(MapCentre::Front, &by);
        for d in [Vec3::x(), Vec3::y(), -Vec3::y(), Vec3::new(0.3, -0.2, -0.9).normalize()] {
            let (a, b) = (turned.radiance(&(by.matrix() * d)), map.radiance(&d));
            assert!((0..3).all(|c| (a[c] - b[c]).abs() < 0.03), "{d}: {a:?} is not {b:?}");
        }
        let (a, b) = (turned.integral(), map.integral());
        assert!((0..3).all(|c| (a[c] / b[c] - 1.0).abs() < 1e-6), "{a:?} is not {b:?}");
        let grey = EnvMap::from_fn(64, 32, |_| [0.5; 3]).turned(MapCentre::Behind, &by);
        assert!(grey.image().data().iter().all(|v| (v - 0.5).abs() < 1e-6));
    }

    #[test]
    fn heading_agrees_with_the_shift_of_columns() {
        let map = smooth(128, 64);
        for heading_deg in [0.0, 33.3, -170.0] {
            for centre in [MapCentre::Front, MapCentre::Behind] {
                let by = Orientation { heading_deg, ..Orientation::default() };
                let shifted = map.turned(centre, &by);
                assert_eq!(shifted, map.oriented(centre, heading_deg));
                // A hair of pitch takes the other way.
                let general = map.turned(centre, &Orientation { pitch_deg: 1e-9, ..by });
                assert!(difference(&shifted, &general) < 0.01, "{heading_deg}: {}", difference(&shifted, &general));
            }
        }
    }

    #[test]
    fn the_chart_turns_by_the_right_hand() {
        let map = EnvMap::six_poles(128, 64);
        let near = |a: [f32; 3], b: [f32; 3]| (0..3).all(|c| (a[c] - b[c]).abs() < 1e-3);
        let (red, green, blue) = ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]);
        let pitched = map.turned(MapCentre::Front, &Orientation { pitch_deg: 90.0, ..Orientation::default() });
        assert!(near(pitched.radiance(&Vec3::z()), green) && near(pitched.radiance(&-Vec3::y()), blue));
        assert!(near(pitched.radiance(&Vec3::x()), red));
        let rolled = map.turned(MapCentre::Front, &Orientation { roll_deg: 90.0, ..Orientation::default() });
        assert!(near(rolled.radiance(&Vec3::y()), red) && near(rolled.radiance(&-Vec3::x()), green));
        // Roll first, heading last: red goes up by the roll and forward by the pitch, where heading carries it to the right.
        let all = Orientation { heading_deg: 90.0, pitch_deg: 90.0, roll_deg: 90.0 };
        assert!(near(map.turned(MapCentre::Front, &all).radiance(&Vec3::x()), red));
        let behind = map.turned(MapCentre::Behind, &Orientation { pitch_deg: 90.0, ..Orientation::default() });
        assert!(near(behind.radiance(&Vec3::y()), blue), "{:?}", behind.radiance(&Vec3::y()));
    }

    #[test]
    fn the_smallest_maps_turn() {
        for (w, h) in [(1, 1), (2, 1), (3, 2)] {
            let map = EnvMap::from_fn(w, h, |_| [2.0; 3]);
            let turned = map.rotated(&Orientation { pitch_deg: 30.0, ..Orientation::default() }.matrix());
            assert!(turned.image().data().iter().all(|v| (v - 2.0).abs() < 1e-5));
        }
    }
}
