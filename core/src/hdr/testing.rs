//! A camera for tests: known response, dark level, noise, rounding and clipping; 16-bit files of 12-bit codes.

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg32;

use super::Noise;
use crate::image::Image;

/// Code = response(clip(dark + light s + noise)), rounded.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Sensor {
    pub film: bool,
    pub dark: f64,
    pub noise: Noise,
}

pub(crate) const NOISE: Noise = Noise { full_well_e: 20_000.0, read_e: 8.0 };
/// 16 of 4095 codes, as raw files of 12 bits have it.
pub(crate) const DARK: f64 = 16.0 / 4095.0;
pub(crate) const LINEAR: Sensor = Sensor { film: false, dark: DARK, noise: NOISE };
pub(crate) const FILM: Sensor = Sensor { film: true, dark: DARK, noise: NOISE };

/// A toe and a shoulder, such as developing software makes: an S curve over a power. Strictly increasing on 0..1.
pub(crate) fn film(x: f64) -> f64 {
    let v = x.powf(0.42);
    v * v * (3.0 - 2.0 * v) * 0.6 + 0.4 * v
}

pub(crate) fn inverse_film(code: f64) -> f64 {
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if film(middle) < code { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

impl Sensor {
    pub fn code(&self, light: f64) -> f64 {
        let x = light.clamp(0.0, 1.0);
        if self.film { film(x) } else { x }
    }

    /// Light that the sensor sees at a code, the dark included.
    pub fn light(&self, code: f64) -> f64 {
        if self.film { inverse_film(code) } else { code }
    }

    /// Codes, white = 1, as a reader of 16-bit files gives them.
    pub fn photograph(&self, scene: &Image, s: f64, seed: u64) -> Image {
        let mut rng = Pcg32::seed_from_u64(seed);
        let mut image = scene.clone();
        let full = self.noise.full_well_e;
        for v in image.data_mut() {
            let mean = (f64::from(*v) * s + self.dark) * full;
            let electrons = poisson(mean.min(20.0 * full), &mut rng) + self.noise.read_e * normal(&mut rng);
            let code = (self.code(electrons / full) * 4095.0).round();
            *v = ((code * 65_535.0 / 4095.0).round() / 65_535.0) as f32;
        }
        image
    }
}

pub(crate) fn normal(rng: &mut Pcg32) -> f64 {
    // Box and Muller.
    let (u, v): (f64, f64) = (1.0 - rng.random::<f64>(), rng.random());
    (-2.0 * u.ln()).sqrt() * (std::f64::consts::TAU * v).cos()
}

/// Exact below 50 (Knuth's products), the normal limit above.
pub(crate) fn poisson(mean: f64, rng: &mut Pcg32) -> f64 {
    if mean > 50.0 {
        return (mean + mean.sqrt() * normal(rng)).round().max(0.0);
    }
    let (limit, mut product, mut count) = ((-mean).exp(), rng.random::<f64>(), 0.0);
    while product > limit {
        product *= rng.random::<f64>();
        count += 1.0;
    }
    count
}
