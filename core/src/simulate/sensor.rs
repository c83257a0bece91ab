//! A virtual camera's sensor: from light to the codes of a file, with all that a real one adds.
//!
//! `x = dark + y + noise`, `y = light * exposure` in shares of white; `code = round(response(clip(x)) * largest)`. Noise is
//! that of [`Noise`]: photons arrive as a Poisson process, reading adds Gaussian noise. The dark level is an offset of the
//! electronics, so it carries no photon noise of its own, and keeps read noise about black from being clipped.

use rand::SeedableRng;
use rand_distr::{Distribution, Poisson, StandardNormal};
use rand_pcg::Pcg32;
use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::hdr::Noise;
use crate::image::{self, Image};

/// How codes answer to light; both run from 0 to 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum SensorResponse {
    /// Codes are proportional to light, as those of a raw file are.
    #[default]
    Linear,
    /// What cameras do before they write a picture: a gamma of 2.2 with a finite slope at black, then an S-curve (toe and shoulder).
    ///
    /// `t(x) = ((x + a)^(1/g) - a^(1/g)) / ((1 + a)^(1/g) - a^(1/g))`, `code = (l(t) - l(0)) / (l(1) - l(0))` with the
    /// logistic `l(t) = 1 / (1 + exp(-k (t - m)))`: smooth, rising, and inverted in closed form.
    Film,
}

/// g, the gamma of displays.
const GAMMA: f64 = 2.2;
/// a: with it [`SensorResponse::Film`] has a slope of 9 at black (sRGB: 12.9).
const FOOT: f64 = 0.003;
/// k: the slope of the S-curve is 1.2 in the middle and 0.6 to 0.8 at its ends, within what Grossberg and Nayar ("What is the
/// Space of Camera Response Functions?", 2003) found among 201 cameras and films.
const STEEPNESS: f64 = 3.0;
/// m.
const MIDDLE: f64 = 0.45;

fn logistic(t: f64) -> f64 {
    1.0 / (1.0 + (-STEEPNESS * (t - MIDDLE)).exp())
}

impl SensorResponse {
    /// The code, 0 to 1, of light 0 to 1.
    pub fn code(self, light: f64) -> f64 {
        let light = light.clamp(0.0, 1.0);
        match self {
            Self::Linear => light,
            Self::Film => {
                let root = |x: f64| (x + FOOT).powf(1.0 / GAMMA);
                let t = (root(light) - root(0.0)) / (root(1.0) - root(0.0));
                (logistic(t) - logistic(0.0)) / (logistic(1.0) - logistic(0.0))
            }
        }
    }

    /// The light, 0 to 1, of a code 0 to 1: the inverse of [`Self::code`].
    pub fn light(self, code: f64) -> f64 {
        let code = code.clamp(0.0, 1.0);
        match self {
            Self::Linear => code,
            Self::Film => {
                let l = logistic(0.0) + code * (logistic(1.0) - logistic(0.0));
                let t = MIDDLE + (l / (1.0 - l)).ln() / STEEPNESS;
                let root = |x: f64| (x + FOOT).powf(1.0 / GAMMA);
                ((root(0.0) + t * (root(1.0) - root(0.0))).powf(GAMMA) - FOOT).clamp(0.0, 1.0)
            }
        }
    }
}

/// A sensor and what lies between it and the file.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sensor {
    /// Photons and reading.
    pub noise: Noise,
    /// Depth of the codes, 8 to 16 bits.
    pub bits: u32,
    /// Added to the light of every pixel, as a share of white.
    pub dark: f64,
    /// From light to codes.
    pub response: SensorResponse,
}

impl Default for Sensor {
    /// A linear sensor of 12 bits whose black lies at 1/64 of white, as that of many cameras.
    fn default() -> Self {
        Self { noise: Noise::default(), bits: 12, dark: 1.0 / 64.0, response: SensorResponse::Linear }
    }
}

/// A photograph as the sensor gives it: `data[(y * width + x) * 3 + c]`, row 0 at the top; codes of fewer than 16 bits are
/// spread over all 16, `code * 65535 / largest`, rounded.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Codes {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Codes, RGB.
    pub data: Vec<u16>,
}

impl Codes {
    /// A 16-bit RGB PNG.
    ///
    /// # Errors
    /// As [`image::encode_png16`].
    pub fn encode_png16(&self) -> Result<Vec<u8>> {
        image::encode_png16(self.width, self.height, &self.data)
    }
}

impl Sensor {
    /// Checks the figures; ask once, where they come in.
    ///
    /// # Errors
    /// [`Error::Invalid`] at `place` for a figure no sensor has.
    pub fn check(&self, place: &str) -> Result<()> {
        let refuse = |field: &str, found: String, expected: &str| {
            Err(Error::invalid(format!("{place}, {field}"), found, expected))
        };
        let Noise { full_well_e, read_e } = self.noise;
        if !(full_well_e.is_finite() && full_well_e >= 1.0) {
            return refuse("full well", format!("{full_well_e}"), "one electron or more");
        }
        if !(read_e.is_finite() && read_e >= 0.0) {
            return refuse("read noise", format!("{read_e}"), "electrons, not negative");
        }
        if !(8..=16).contains(&self.bits) {
            return refuse("depth", format!("{} bits", self.bits), "8 to 16 bits");
        }
        if !(0.0..0.5).contains(&self.dark) {
            return refuse("dark level", format!("{}", self.dark), "a share of white from 0 to below 0.5");
        }
        Ok(())
    }

    /// The code, 0 to 1, of a signal `y` in shares of white, before rounding and without noise.
    pub fn code_of(&self, y: f64) -> f64 {
        self.response.code(self.dark + y)
    }

    /// The signal `y` that a code 0 to 1 stands for: the inverse of [`Self::code_of`].
    pub fn light_of(&self, code: f64) -> f64 {
        self.response.light(code) - self.dark
    }

    /// A photograph of `light` (of a picture with alpha the colours alone) at a relative exposure, the signal being
    /// `light * exposure`; `iso` sets the electrons at white. Negative light and NaN count as black. The same for the same
    /// `seed`, whatever the number of threads. Cost: some 10 ns a sample.
    pub fn expose(&self, light: &Image, exposure: f64, iso: f64, seed: u64) -> Codes {
        let rounding = Rounding::new(self);
        let grain = Grain::new(&self.noise, iso);
        let (width, height) = light.size();
        let mut data = vec![0; width * height * 3];
        let scale = exposure as f32;
        data.par_chunks_mut(3 * width.max(1)).enumerate().for_each(|(y, codes)| {
            let mut rng = Pcg32::seed_from_u64(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15).wrapping_add(y as u64));
            let pixels = light.row(y).chunks_exact(light.channels());
            for (code, pixel) in codes.chunks_exact_mut(3).zip(pixels) {
                for (code, value) in code.iter_mut().zip(pixel) {
                    *code =
                        rounding.code(self.dark as f32 + grain.strayed((value * scale).clamp(0.0, DAZZLING), &mut rng));
                }
            }
        });
        Codes { width, height, data }
    }
}

/// Brighter light changes nothing: it is white with any noise.
const DAZZLING: f32 = 1e6;

/// A normal law stands in for photons and reading together where the skewness of their sum is below this: its distribution
/// function is then off by at most 0.07 * skewness (the first term of Edgeworth's series), 0.7 %.
const SKEWNESS: f32 = 0.1;

/// [`Noise`] at one ISO speed, in electrons.
struct Grain {
    full: f32,
    share: f32,
    read: f32,
}

impl Grain {
    fn new(noise: &Noise, iso: f64) -> Self {
        let full = noise.electrons(iso);
        Self { full: full as f32, share: full.recip() as f32, read: noise.read_e as f32 }
    }

    /// The signal with its noise, shares of white.
    fn strayed(&self, y: f32, rng: &mut Pcg32) -> f32 {
        let electrons = y * self.full;
        let variance = electrons + self.read * self.read;
        let normal: f64 = StandardNormal.sample(rng);
        let normal = normal as f32;
        // The third cumulant, `electrons`, over variance^(3/2); squared, and with the division moved across.
        if electrons * electrons / variance <= (SKEWNESS * SKEWNESS) * variance * variance {
            return y + variance.sqrt() * normal * self.share;
        }
        let photons = match Poisson::new(electrons) {
            Ok(law) if electrons > 0.0 => law.sample(rng),
            _ => 0.0,
        };
        (photons + self.read * normal) * self.share
    }
}

/// Bins of light in the table that finds codes: of 12 bits at most one code begins in a bin.
const BINS: usize = 1 << 16;

/// Response and quantisation as one table: the light from which each code holds, and the code at the lower edge of each of
/// [`BINS`] bins of light.
struct Rounding {
    from: Vec<f32>,
    first: Vec<u16>,
    /// What each code is in the file.
    spread: Vec<u16>,
}

impl Rounding {
    fn new(sensor: &Sensor) -> Self {
        let largest = (1u32 << sensor.bits.clamp(1, 16)) - 1;
        let edge = |code: u32| match code {
            0 => f32::NEG_INFINITY,
            _ => sensor.response.light((f64::from(code) - 0.5) / f64::from(largest)) as f32,
        };
        // A last edge that no light reaches ends the search.
        let from: Vec<f32> = (0..=largest).map(edge).chain([f32::INFINITY]).collect();
        let mut code = 0;
        let code_at = |bin: usize| {
            while from[code + 1] <= bin as f32 / BINS as f32 {
                code += 1;
            }
            code as u16
        };
        let spread = |code: u32| ((code * 65535 + largest / 2) / largest) as u16;
        let first = (0..=BINS).map(code_at).collect();
        Self { first, spread: (0..=largest).map(spread).collect(), from }
    }

    #[inline]
    fn code(&self, x: f32) -> u16 {
        let x = x.clamp(0.0, 1.0);
        let mut code = usize::from(self.first[(x * BINS as f32) as usize]);
        // Without a branch, for it could not be foretold; the loop goes on where codes are finer than bins.
        code += usize::from(self.from[code + 1] <= x);
        while self.from[code + 1] <= x {
            code += 1;
        }
        self.spread[code]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn even(value: f32) -> Image {
        Image::from_fn(100, 100, |_, _| [value; 3])
    }

    /// Mean and deviation of the light that codes of a linear sensor stand for, in shares of white.
    fn statistics(sensor: &Sensor, codes: &Codes) -> (f64, f64) {
        let light: Vec<f64> = codes.data.iter().map(|c| sensor.light_of(f64::from(*c) / 65535.0)).collect();
        let mean = light.iter().sum::<f64>() / light.len() as f64;
        let variance = light.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / light.len() as f64;
        (mean, variance.sqrt())
    }

    #[test]
    fn responses_rise_smoothly_from_zero_to_one_and_invert() {
        for response in [SensorResponse::Linear, SensorResponse::Film] {
            assert!(response.code(0.0).abs() < 1e-12 && (response.code(1.0) - 1.0).abs() < 1e-12);
            let codes: Vec<f64> = (0..=2000).map(|i| response.code(f64::from(i) / 2000.0)).collect();
            assert!(codes.windows(2).all(|w| w[1] > w[0]));
            // No kink: slopes of neighbours stay within 15 %, and within 2 % past the foot.
            let slopes: Vec<f64> = codes.windows(2).map(|w| w[1] - w[0]).collect();
            let bend = |w: &[f64]| (w[1] / w[0] - 1.0).abs();
            assert!(slopes.windows(2).all(|w| bend(w) < 0.15) && slopes[100..].windows(2).all(|w| bend(w) < 0.02));
            for i in 0..=1000 {
                let x = f64::from(i) / 1000.0;
                assert!((response.light(response.code(x)) - x).abs() < 1e-12, "{response:?} at {x}");
            }
        }
        assert!(SensorResponse::Film.code(0.2) > 0.4, "a gamma lifts the middle");
    }

    #[test]
    fn noise_has_the_variance_of_its_model_at_any_light() {
        // Poisson draws alone, both, and normal draws alone.
        for (full_well_e, read_e) in [(400.0, 0.0), (1000.0, 1.5), (20_000.0, 8.0)] {
            let noise = Noise { full_well_e, read_e };
            let sensor = Sensor { noise, bits: 16, dark: 0.1, response: SensorResponse::Linear };
            for (light, iso) in [(0.0, 100.0), (0.002, 100.0), (0.02, 200.0), (0.3, 100.0), (0.6, 400.0)] {
                let (mean, deviation) = statistics(&sensor, &sensor.expose(&even(light), 1.0, iso, 7));
                let expected = noise.variance(f64::from(light), iso).sqrt();
                // 30 000 samples: six times their standard errors; and rounding to 16 bits.
                assert!((mean - f64::from(light)).abs() < 0.035 * expected + 1e-5, "mean {mean} of {light}");
                assert!((deviation - expected).abs() < 0.03 * expected + 1e-5, "{deviation} is not {expected}");
            }
        }
    }

    #[test]
    fn few_electrons_come_in_whole_numbers() {
        let noise = Noise { full_well_e: 50.0, read_e: 0.0 };
        let sensor = Sensor { noise, bits: 16, dark: 0.0, response: SensorResponse::Linear };
        let codes = sensor.expose(&even(0.06), 1.0, 100.0, 3);
        let mut counts = [0usize; 51];
        for code in &codes.data {
            let electrons = f64::from(*code) / 65535.0 * 50.0;
            assert!((electrons - electrons.round()).abs() < 1e-3, "{electrons} electrons");
            counts[electrons.round() as usize] += 1;
        }
        // Poisson's law with a mean of 3: exp(-3) 3^k / k!.
        let mut expected = (-3f64).exp() * 30_000.0;
        for (k, count) in counts.iter().enumerate().take(8) {
            assert!((*count as f64 - expected).abs() < 6.0 * expected.sqrt(), "{count} of {k}, not {expected}");
            expected *= 3.0 / (k + 1) as f64;
        }
    }

    #[test]
    fn codes_are_the_rounded_response_of_the_light() {
        let quiet = Noise { full_well_e: 1e15, read_e: 0.0 };
        for (bits, response) in [(12, SensorResponse::Film), (8, SensorResponse::Linear), (16, SensorResponse::Film)] {
            let sensor = Sensor { noise: quiet, bits, dark: 0.02, response };
            let light = Image::from_fn(997, 3, |x, y| [x as f32 / 900.0, 0.01 * y as f32, -1.0]);
            let codes = sensor.expose(&light, 0.95, 100.0, 1);
            let largest = f64::from((1u32 << bits) - 1);
            for (code, value) in codes.data.iter().zip(light.data()) {
                let exact = sensor.code_of(f64::from(value.max(0.0)) * 0.95) * largest;
                let found = f64::from(*code) / 65535.0 * largest;
                assert!(
                    (found - found.round()).abs() < 0.51 * largest / 65535.0 + 1e-6,
                    "{found} is no code of {bits} bits"
                );
                assert!((found.round() - exact).abs() < 0.502 + 2e-3 * f64::from(bits > 12), "{found} is not {exact}");
            }
            assert_eq!(codes.data[3 * 996], 65535, "bright light clips");
        }
    }

    #[test]
    fn a_seed_gives_one_photograph_whatever_the_number_of_threads() {
        let light = Image::from_fn(64, 48, |x, y| [x as f32 / 64.0, y as f32 / 48.0, 0.0]);
        let sensor = Sensor::default();
        let with = |threads: usize, seed: u64| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| sensor.expose(&light, 1.0, 100.0, seed))
        };
        assert_eq!(with(1, 5), with(3, 5));
        let (a, b) = (with(1, 5), with(1, 6));
        let same = a.data.iter().zip(&b.data).filter(|(a, b)| a == b).count();
        assert!(same < a.data.len() / 4, "seeds share {same} codes");
    }

    #[test]
    fn nan_is_black_and_bad_figures_are_refused() {
        let sensor = Sensor { noise: Noise { full_well_e: 1e9, read_e: 0.0 }, dark: 0.0, ..Sensor::default() };
        let light = Image::from_data(1, 1, 4, vec![f32::NAN, f32::INFINITY, 0.5, 1.0]).unwrap();
        let codes = sensor.expose(&light, 1.0, 100.0, 1);
        assert_eq!((codes.data[0], codes.data[1], codes.data.len()), (0, 65535, 3));
        assert!(sensor.check("rig").is_ok());
        for (bad, word) in [
            (Sensor { bits: 17, ..sensor }, "17 bits"),
            (Sensor { dark: f64::NAN, ..sensor }, "NaN"),
            (Sensor { noise: Noise { full_well_e: 0.0, read_e: 1.0 }, ..sensor }, "full well"),
            (Sensor { noise: Noise { full_well_e: 10.0, read_e: -1.0 }, ..sensor }, "read noise"),
        ] {
            let message = bad.check("rig.toml").unwrap_err().to_string();
            assert!(message.contains(word) && message.contains("rig.toml"), "{message}");
        }
    }

    #[test]
    fn photographs_come_back_from_their_files() {
        let light = Image::from_fn(33, 17, |x, y| [x as f32 / 33.0, y as f32 / 17.0, 0.5]);
        let codes = Sensor { response: SensorResponse::Film, ..Sensor::default() }.expose(&light, 0.9, 100.0, 2);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        std::fs::write(&path, codes.encode_png16().unwrap()).unwrap();
        let (read, sample_type) = image::read_codes(&path).unwrap();
        assert_eq!((read.size(), sample_type), ((33, 17), image::SampleType::U16));
        assert!(read.data().iter().zip(&codes.data).all(|(a, b)| (a * 65535.0).round() as u16 == *b));
    }
}
