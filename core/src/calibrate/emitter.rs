//! The curve of a screen or projector, from photographs of flat codes (6.3).
//!
//! `g(z) = (I_z - I_0) / (I_255 - I_0)`, a ratio of sums over the pixels that see light, so that noise biases nothing. The
//! picture is cut into tiles; of their ratios the middle fifth counts, by light: where something moved, shone or was covered
//! in one photograph, the others outvote it. Codes that were photographed are made to rise (the nearest curve of
//! least squares that does, Ayer et al. 1955); between them runs a monotone cubic (Fritsch and Carlson 1980).

use std::fmt::Write;

use crate::domain::EmitterCurve;
use crate::error::{Error, Result};
use crate::image::Image;

/// Codes of an emitter.
const CODES: usize = 256;
/// Tiles along the longer side of the picture.
const TILES: usize = 32;
/// Pixels count that are brighter under white than this share of the bright ones.
const LEAST_LIGHT: f64 = 0.05;
/// The bright ones: one pixel of a hundred is brighter.
const BRIGHTER: f64 = 0.01;
/// White is so many times black at least, or the photographs show no screen.
const LEAST_RANGE: f64 = 1.02;
/// A ramp that ends elsewhere by more than this of the range is not in the order of its codes.
const FALL: f64 = 0.05;

/// Collects photographs of flat codes.
#[derive(Debug, Clone)]
pub struct Ramp {
    black: Image,
    /// Per tile and channel: the light of white less black.
    range: Vec<[f64; 3]>,
    tile: usize,
    lit: Vec<bool>,
    /// Code and g, RGB.
    points: Vec<(u8, [f64; 3])>,
}

impl Ramp {
    /// From the photographs of codes 0 and 255, as light.
    ///
    /// # Errors
    /// Pictures of two sizes; a white one that is no brighter.
    pub fn new(black: &Image, white: &Image) -> Result<Self> {
        let refuse =
            |found: String, expected: &str| Err(Error::invalid("the photographs of grey levels", found, expected));
        if black.size() != white.size() {
            return refuse("pictures of two sizes".into(), "one size");
        }
        let (black, white) = (black.clone().into_rgb(), white.clone().into_rgb());
        let sum = |image: &Image| image.data().iter().map(|v| f64::from(*v)).sum::<f64>();
        if sum(&white).partial_cmp(&(LEAST_RANGE * sum(&black))) != Some(std::cmp::Ordering::Greater) {
            return refuse(
                format!("light of {:.4} under code 255 and {:.4} under code 0", sum(&white), sum(&black)),
                "more under code 255: are they the photographs of the first and the last code?",
            );
        }
        let grey = |n: usize| (0..3).map(|c| f64::from(white.data()[3 * n + c] - black.data()[3 * n + c])).sum::<f64>();
        let mut sorted: Vec<f64> = (0..white.width() * white.height()).map(grey).collect();
        let at = sorted.len() - 1 - (BRIGHTER * sorted.len() as f64) as usize;
        let bright = *sorted.select_nth_unstable_by(at, f64::total_cmp).1;
        let lit = (0..white.width() * white.height()).map(|n| grey(n) > LEAST_LIGHT * bright).collect();
        let tile = white.width().max(white.height()).div_ceil(TILES);
        let mut ramp = Self { black, range: Vec::new(), tile, lit, points: Vec::new() };
        ramp.range = ramp.tiles(&white);
        Ok(ramp)
    }

    /// The photograph of a code.
    ///
    /// # Errors
    /// A picture of another size.
    pub fn add(&mut self, code: u8, picture: &Image) -> Result<()> {
        if picture.size() != self.black.size() {
            let found = format!("{} x {} pixels", picture.width(), picture.height());
            let expected = format!("{} x {}", self.black.width(), self.black.height());
            return Err(Error::invalid(format!("the photograph of code {code}"), found, expected));
        }
        let sums = self.tiles(&picture.clone().into_rgb());
        self.points.push((code, std::array::from_fn(|c| middle(&sums, &self.range, c))));
        Ok(())
    }

    /// Sums over the lit pixels of each tile, less black.
    fn tiles(&self, picture: &Image) -> Vec<[f64; 3]> {
        let (width, height) = picture.size();
        let across = width.div_ceil(self.tile);
        let mut sums = vec![[0.0; 3]; across * height.div_ceil(self.tile)];
        let pixels = picture.data().chunks_exact(3).zip(self.black.data().chunks_exact(3));
        for (n, (pixel, black)) in pixels.enumerate().filter(|(n, _)| self.lit[*n]) {
            let tile = n / width / self.tile * across + n % width / self.tile;
            (0..3).for_each(|c| sums[tile][c] += f64::from(pixel[c] - black[c]));
        }
        sums
    }

    /// The curve.
    ///
    /// # Errors
    /// No code between 0 and 255; light that falls from code to code, by more than noise.
    pub fn finish(mut self) -> Result<Measured> {
        self.points.retain(|(code, _)| (1..255).contains(code));
        self.points.sort_by_key(|(code, _)| *code);
        self.points.dedup_by_key(|(code, _)| *code);
        if self.points.is_empty() {
            let expected = "some of the codes 1 to 254, say every sixteenth";
            return Err(Error::invalid("the photographs of grey levels", "codes 0 and 255 alone", expected));
        }
        self.points.insert(0, (0, [0.0; 3]));
        self.points.push((255, [1.0; 3]));
        let codes: Vec<u8> = self.points.iter().map(|(code, _)| *code).collect();
        let (mut light, mut uneven) = ([[0.0; CODES]; 3], 0.0f64);
        for (c, curve) in light.iter_mut().enumerate() {
            // A channel that sees no light (a filter, a dark screen) is as the mean of the others.
            let measured: Vec<f64> =
                self.points.iter().map(|(_, g)| if g[c].is_finite() { g[c] } else { mean(g) }).collect();
            let rising = rising(&measured);
            for ((value, rises), code) in measured.iter().zip(&rising).zip(&codes) {
                uneven = uneven.max((value - rises).abs());
                if (value - rises).abs() > FALL {
                    let found = format!("light {value:.3} of white where its neighbours give {rises:.3}");
                    let expected = "light that rises from code to code: are the photographs in the order of the codes?";
                    return Err(Error::invalid(format!("the photograph of code {code}"), found, expected));
                }
            }
            *curve = between(&codes, &rising);
        }
        Ok(Measured { light, codes, uneven })
    }
}

/// A measured curve.
#[derive(Debug, Clone, PartialEq)]
pub struct Measured {
    /// Light of each code, RGB, 0 at code 0 and 1 at 255.
    pub light: [[f64; CODES]; 3],
    /// The codes that were photographed, ascending, 0 and 255 among them.
    pub codes: Vec<u8>,
    /// By how much a photograph differed from a rising curve at most, of white: its noise.
    pub uneven: f64,
}

impl Measured {
    /// The mean of the channels, for patterns are grey.
    ///
    /// # Errors
    /// As [`EmitterCurve::table`].
    pub fn curve(&self) -> Result<EmitterCurve> {
        EmitterCurve::table("the measured curve", self.grey())
    }

    /// The largest difference of a channel from that mean: a screen whose greys are tinted.
    pub fn tint(&self) -> f64 {
        let grey = self.grey();
        let off = |c: usize| self.light[c].iter().zip(&grey).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        (0..3).map(off).fold(0.0, f64::max)
    }

    /// The exponent of the power that is nearest, by light: for people.
    pub fn gamma(&self) -> f64 {
        let grey = self.grey();
        let (mut above, mut below) = (0.0, 0.0);
        for (code, light) in grey.iter().enumerate().take(CODES - 1).skip(1).filter(|(_, light)| **light > 1e-4) {
            let (x, weight) = ((code as f64 / 255.0).ln(), light * light);
            above += weight * x * light.ln();
            below += weight * x * x;
        }
        above / below
    }

    /// As [`EmitterCurve::read`] takes it: a line `code red green blue` a code.
    pub fn text(&self) -> String {
        let mut text = String::from("# code red green blue: relative light, measured\n");
        for code in 0..CODES {
            let [r, g, b] = [0, 1, 2].map(|c| self.light[c][code]);
            // Writing to a String does not fail.
            let _ = writeln!(text, "{code} {r:.7} {g:.7} {b:.7}");
        }
        text
    }

    fn grey(&self) -> [f64; CODES] {
        std::array::from_fn(|code| (0..3).map(|c| self.light[c][code]).sum::<f64>() / 3.0)
    }
}

/// The mean of those that are numbers.
fn mean(values: &[f64; 3]) -> f64 {
    let known: Vec<f64> = values.iter().copied().filter(|v| v.is_finite()).collect();
    known.iter().sum::<f64>() / known.len().max(1) as f64
}

/// The mean of the middle fifth of the tiles' ratios, by light. NaN of a channel without light.
fn middle(sums: &[[f64; 3]], range: &[[f64; 3]], channel: usize) -> f64 {
    let ratios = sums.iter().zip(range).map(|(sum, range)| (sum[channel] / range[channel], range[channel]));
    let mut ratios: Vec<(f64, f64)> = ratios.filter(|(ratio, weight)| ratio.is_finite() && *weight > 0.0).collect();
    ratios.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
    let all: f64 = ratios.iter().map(|(_, weight)| weight).sum();
    let (mut before, mut sum, mut kept) = (0.0, 0.0, 0.0);
    for (ratio, weight) in ratios {
        let inside = (before + weight).min(0.6 * all) - before.max(0.4 * all);
        before += weight;
        if inside > 0.0 {
            sum += ratio * inside;
            kept += inside;
        }
    }
    sum / kept
}

/// The nearest rising sequence: neighbours that fall are pooled.
fn rising(values: &[f64]) -> Vec<f64> {
    let mut pools: Vec<(f64, usize)> = Vec::with_capacity(values.len());
    for value in values {
        pools.push((*value, 1));
        while let [.., (a, n), (b, m)] = pools[..] {
            if a <= b {
                break;
            }
            let merged = ((a * n as f64 + b * m as f64) / (n + m) as f64, n + m);
            pools.truncate(pools.len() - 2);
            pools.push(merged);
        }
    }
    let rising = pools.into_iter().flat_map(|(value, count)| std::iter::repeat_n(value, count));
    rising.map(|value| value.clamp(0.0, 1.0)).collect()
}

/// A monotone cubic through the codes that were photographed.
fn between(codes: &[u8], light: &[f64]) -> [f64; CODES] {
    let step = |n: usize| f64::from(codes[n + 1]) - f64::from(codes[n]);
    let slope = |n: usize| (light[n + 1] - light[n]) / step(n);
    let last = codes.len() - 1;
    // The weighted harmonic mean of Fritsch and Butland 1984, which keeps the cubic monotone.
    let tangent = |n: usize| {
        if n == 0 || n == last {
            let (near, next) = if n == 0 { (0, 1) } else { (last - 1, last.saturating_sub(2)) };
            if last < 2 {
                return slope(near);
            }
            // The parabola through three points, held to what keeps the cubic monotone.
            let (h, k, a, b) = (step(near), step(next), slope(near), slope(next));
            return (((2.0 * h + k) * a - h * b) / (h + k)).clamp(0.0, 3.0 * a);
        }
        let (a, b, h, k) = (slope(n - 1), slope(n), step(n - 1), step(n));
        if a <= 0.0 || b <= 0.0 { 0.0 } else { 3.0 * (h + k) / ((2.0 * k + h) / a + (k + 2.0 * h) / b) }
    };
    let mut curve = [0.0; CODES];
    for n in 0..last {
        for code in codes[n]..=codes[n + 1] {
            let (h, t) = (step(n), (f64::from(code) - f64::from(codes[n])) / step(n));
            let (t2, t3) = (t * t, t * t * t);
            let ends = light[n] * (2.0 * t3 - 3.0 * t2 + 1.0) + light[n + 1] * (3.0 * t2 - 2.0 * t3);
            let value = ends + h * (tangent(n) * (t3 - 2.0 * t2 + t) + tangent(n + 1) * (t3 - t2));
            curve[usize::from(code)] = value.clamp(light[n], light[n + 1]);
        }
    }
    curve
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg32;

    use super::*;

    fn gamma(code: u8) -> f64 {
        (f64::from(code) / 255.0).powf(2.2)
    }

    /// A vignetted screen with a black level and noise; a third of it is covered while code 100 is shown.
    fn photograph(code: u8, light: f64) -> Image {
        let mut rng = Pcg32::seed_from_u64(u64::from(code));
        Image::from_fn(90, 60, |x, _| {
            let seen = if code == 100 && x < 30 { 0.0 } else { light };
            let gain = 1.0 - 0.005 * x as f32;
            [1.0, 0.7, 0.4].map(|c: f32| c * gain * (0.01 + seen as f32) + 0.004 * (rng.random::<f32>() - 0.5))
        })
    }

    fn measured(codes: &[u8]) -> Measured {
        let mut ramp = Ramp::new(&photograph(0, 0.0), &photograph(255, 1.0)).unwrap();
        for code in codes {
            ramp.add(*code, &photograph(*code, gamma(*code))).unwrap();
        }
        ramp.finish().unwrap()
    }

    #[test]
    fn noise_and_what_covers_the_screen_do_not_matter() {
        let all: Vec<u8> = (0..=255).collect();
        let found = measured(&all);
        let EmitterCurve::Table(table) = found.curve().unwrap() else { panic!("a table") };
        for code in 0..=255u8 {
            let off = (table[usize::from(code)] - gamma(code)).abs();
            // Of the tiles that were not covered, the middle leans to those that noise makes dark.
            assert!(off < if code == 100 { 2e-3 } else { 5e-4 }, "{code}: {off}");
        }
        assert!((found.gamma() - 2.2).abs() < 0.01 && found.tint() < 1e-3);
    }

    #[test]
    fn a_few_codes_are_enough_and_the_file_reads_back() {
        let found = measured(&[16, 32, 64, 100, 128, 192]);
        assert_eq!(found.codes, [0, 16, 32, 64, 100, 128, 192, 255]);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("screen.txt");
        std::fs::write(&path, found.text()).unwrap();
        let EmitterCurve::Table(table) = EmitterCurve::read(&path).unwrap() else { panic!("a table") };
        for code in 0..=255u8 {
            let off = (table[usize::from(code)] - gamma(code)).abs();
            assert!(off < 0.01, "{code}: {off}");
        }
    }

    #[test]
    fn what_is_no_ramp_is_refused() {
        let (black, white) = (photograph(0, 0.0), photograph(255, 1.0));
        assert!(Ramp::new(&white, &black).unwrap_err().to_string().contains("more under code 255"));
        let ramp = Ramp::new(&black, &white).unwrap();
        assert!(ramp.clone().finish().unwrap_err().to_string().contains("every sixteenth"));
        let mut shuffled = ramp.clone();
        for code in 1..255 {
            shuffled.add(code, &photograph(1, gamma(255 - code))).unwrap();
        }
        assert!(shuffled.finish().unwrap_err().to_string().contains("order of the codes"));
        assert!(ramp.clone().add(7, &Image::new(4, 4, 3)).unwrap_err().to_string().contains("90 x 60"));
    }
}
