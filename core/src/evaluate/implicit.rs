//! How well implicit sampling relights, by the number of terms and of patterns (figure 6.30).
//!
//! A virtual monitor is photographed under wavelet noise: 8-bit codes through the emitter's curve, a black level, photon
//! noise. Every covered, lit pixel is solved, and relit by backdrops that it never saw; the error is
//! `||C - C'|| / ||C'||` over those pixels and all channels, `C'` the transport's own answer without noise.

use std::sync::Arc;

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg32;
use rayon::prelude::*;
use serde::Serialize;

use super::blocks::Progress;
use crate::acquire::implicit::{Dictionary, Options, Solver, Stop, Terms};
use crate::domain::patterns::{Kind, Noise, Pattern, PatternSet};
use crate::domain::{Bits, Emitter, EmitterCurve, Plane};
use crate::error::{Error, Result};
use crate::image::Image;
use crate::simulate::{Rows, Screen};
use crate::wavelet::{Edge, Normalisation, Transform, Wavelet};

/// A backdrop: the light of every texel, in the order of [`Plane::element`].
pub type Backdrop = Vec<[f32; 3]>;

/// What a pixel must answer to a white screen to be lit, as a share of the screen itself.
const LIT: f32 = 0.01;

/// What is photographed, and how.
#[derive(Debug)]
pub struct Setup<'a> {
    /// The transport of the virtual monitor.
    pub rows: &'a Rows,
    /// Share of each pixel that shows the screen itself: such pixels are left out.
    pub directly_seen: &'a [f32],
    /// The screen.
    pub screen: &'a Screen,
    /// The patterns: as many as will ever be used.
    pub patterns: Noise,
    /// The basis of the solution.
    pub basis: Wavelet,
    /// Standard deviation of camera noise where the white screen is seen, as a share of it. It is photon noise: elsewhere it
    /// falls as the root of the light.
    pub noise: f32,
}

impl Setup<'_> {
    /// Camera noise if nothing is said, 0.2 %: a quarter of a million electrons, some ten photographs of a good sensor.
    pub const NOISE: f32 = 0.002;
}

/// All that was photographed.
#[derive(Debug)]
pub struct Photographed {
    transform: Transform,
    patterns: Vec<Pattern>,
    /// Of each covered, lit pixel: `[channel][pattern]`.
    responses: Vec<Vec<f32>>,
    /// Of each backdrop: what the pixels should be.
    truths: Vec<Vec<[f32; 3]>>,
    /// Of each backdrop: `S^T L`, RGB by location.
    lights: Vec<Vec<f32>>,
}

/// What is tried.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Trial {
    /// The first so many patterns.
    pub patterns: usize,
    /// Terms of a pixel, and the rule to stop.
    pub options: Options,
}

/// What came of it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Outcome {
    /// Patterns that were used.
    pub patterns: usize,
    /// Terms that were asked for.
    pub terms: usize,
    /// Whether the rule to stop was on.
    pub stop: bool,
    /// Relative L2 error of each backdrop.
    pub errors: Vec<f64>,
    /// Terms of a pixel, on average.
    pub terms_found: f64,
}

impl Outcome {
    /// The mean error of all backdrops.
    pub fn mean(&self) -> f64 {
        self.errors.iter().sum::<f64>() / self.errors.len() as f64
    }
}

impl Photographed {
    /// Photographs a monitor under all patterns, and under all backdrops, whose light is clipped to 0 to 1.
    ///
    /// # Errors
    /// A screen that is none; no backdrop, or one of another size; a picture without covered, lit pixels; patterns that cannot
    /// be; what `progress` returns, to stop.
    pub fn new(setup: &Setup<'_>, backdrops: &[Backdrop], progress: &mut Progress<'_>) -> Result<Self> {
        setup.screen.check("the virtual screen")?;
        let grids = setup.rows.grids();
        let plane = Plane::new(grids.columns, grids.rows)?;
        let set = PatternSet::new(Kind::Noise(setup.patterns), plane)?;
        let edges = (Edge::Mirrored, Edge::Mirrored);
        let transform = Transform::new(setup.basis, plane.size(), edges, Normalisation::Energy)?;
        check_backdrops(backdrops, plane)?;
        let white = setup.rows.photograph(&vec![[1.0; 3]; plane.len()])?;
        let pixels = covered(setup.directly_seen, &white)?;
        let table: [f64; 256] = std::array::from_fn(|code| setup.screen.share(code as u8));
        let emitter = Emitter::new(&EmitterCurve::table("the virtual screen", table)?, Bits::Eight);
        let camera = Shots { setup, pixels: &pixels };
        let black = camera.take(&vec![0; plane.len()], set.len() as u64)?;
        let mut patterns = Vec::with_capacity(set.len());
        let mut responses = vec![vec![0.0; 3 * set.len()]; pixels.len()];
        for n in 0..set.len() {
            let mut pattern = set.pattern(n);
            let codes = pattern.codes(&emitter);
            for ((response, rgb), dark) in responses.iter_mut().zip(camera.take(&codes, n as u64)?).zip(&black) {
                (0..3).for_each(|c| response[c * set.len() + n] = rgb[c] - dark[c]);
            }
            pattern.values = codes.iter().map(|code| emitter.light(*code)).collect();
            patterns.push(pattern);
            progress(n as u64 + 1, set.len() as u64)?;
        }
        let (mut truths, mut lights) = (Vec::new(), Vec::new());
        for backdrop in backdrops {
            let light: Backdrop = backdrop.iter().map(|rgb| rgb.map(|v| v.clamp(0.0, 1.0))).collect();
            truths.push(at(&setup.rows.photograph(&camera.emitted(&light))?, &pixels));
            let mut light = light.concat();
            transform.inverse_adjoint(&mut light, 3);
            lights.push(light);
        }
        Ok(Self { transform, patterns, responses, truths, lights })
    }

    /// Pixels that are solved.
    pub fn pixels(&self) -> usize {
        self.responses.len()
    }

    /// Solves all pixels, and relights them by every backdrop; the same for any number of threads.
    ///
    /// # Errors
    /// More patterns than there are; terms that they do not determine.
    pub fn measure(&self, trial: Trial) -> Result<Outcome> {
        let Some(patterns) = self.patterns.get(..trial.patterns) else {
            let found = format!("{} patterns", trial.patterns);
            return Err(Error::invalid("the measurement", found, format!("at most {}", self.patterns.len())));
        };
        let solver = Solver::new(Arc::new(Dictionary::new(&self.transform, patterns)?), trial.options)?;
        let solve = |(scratch, terms, response): &mut (_, Terms, Vec<f32>), all: &Vec<f32>| {
            response.clear();
            all.chunks_exact(self.patterns.len()).for_each(|channel| response.extend(&channel[..trial.patterns]));
            terms.clear();
            let count = solver.solve(scratch, response, None, terms);
            let relit: Vec<[f64; 3]> = self.lights.iter().map(|light| relit(terms, light)).collect();
            (count, relit)
        };
        let room = || (solver.scratch(), Terms::default(), Vec::new());
        let solved: Vec<(usize, Vec<[f64; 3]>)> = self.responses.par_iter().map_init(room, solve).collect();
        let error = |(n, truth): (usize, &Vec<[f32; 3]>)| {
            let (mut off, mut all) = (0.0, 0.0);
            for ((_, relit), truth) in solved.iter().zip(truth) {
                for (a, b) in relit[n].iter().zip(truth) {
                    off += (a - f64::from(*b)).powi(2);
                    all += f64::from(*b).powi(2);
                }
            }
            (off / all).sqrt()
        };
        Ok(Outcome {
            patterns: trial.patterns,
            terms: trial.options.terms,
            stop: trial.options.stop == Stop::On,
            errors: self.truths.iter().enumerate().map(error).collect(),
            terms_found: solved.iter().map(|(count, _)| *count).sum::<usize>() as f64 / solved.len() as f64,
        })
    }
}

/// `<c, S^T L>`.
fn relit(terms: &Terms, light: &[f32]) -> [f64; 3] {
    let mut sum = [0.0; 3];
    for (location, rgb) in terms.locations.iter().zip(&terms.coefficients) {
        let light = &light[3 * *location as usize..][..3];
        (0..3).for_each(|c| sum[c] += f64::from(rgb[c]) * f64::from(light[c]));
    }
    sum
}

/// The camera before the screen.
struct Shots<'a> {
    setup: &'a Setup<'a>,
    pixels: &'a [usize],
}

impl Shots<'_> {
    /// What the screen emits above black, as a share of white's, becomes radiance above black.
    fn emitted(&self, light: &[[f32; 3]]) -> Backdrop {
        let range = (1.0 - self.setup.screen.black) as f32;
        let white = self.setup.screen.white;
        light.iter().map(|rgb| std::array::from_fn(|c| range * rgb[c] * white[c])).collect()
    }

    /// A photograph under codes, with noise of its number.
    fn take(&self, codes: &[u16], number: u64) -> Result<Vec<[f32; 3]>> {
        let codes: Vec<[u16; 3]> = codes.iter().map(|code| [*code; 3]).collect();
        let white = self.setup.screen.white;
        let mut picture = at(&self.setup.rows.photograph(&self.setup.screen.emitted(&codes, 255))?, self.pixels);
        let mut uniform = Pcg32::seed_from_u64(self.setup.patterns.seed.wrapping_mul(1 << 32).wrapping_add(number));
        let mut normal = || {
            let (u, v) = (1.0 - uniform.random::<f32>(), uniform.random::<f32>());
            (-2.0 * u.ln()).sqrt() * (std::f32::consts::TAU * v).cos()
        };
        for rgb in &mut picture {
            (0..3).for_each(|c| rgb[c] += self.setup.noise * (rgb[c] * white[c]).max(0.0).sqrt() * normal());
        }
        Ok(picture)
    }
}

/// Pixels of a picture.
fn at(picture: &Image, pixels: &[usize]) -> Vec<[f32; 3]> {
    pixels.iter().map(|pixel| std::array::from_fn(|c| picture.data()[3 * pixel + c])).collect()
}

/// Pixels that do not see the screen itself and answer to it.
fn covered(directly_seen: &[f32], white: &Image) -> Result<Vec<usize>> {
    let lit = |pixel: &usize| white.data()[3 * pixel..][..3].iter().sum::<f32>() > 3.0 * LIT;
    let pixels: Vec<usize> = (0..directly_seen.len()).filter(|p| directly_seen[*p] == 0.0).filter(lit).collect();
    if pixels.is_empty() {
        let expected = "bodies before the screen that its light reaches";
        return Err(Error::invalid("the virtual monitor", "no pixel that is covered and lit", expected));
    }
    Ok(pixels)
}

fn check_backdrops(backdrops: &[Backdrop], plane: Plane) -> Result<()> {
    if backdrops.is_empty() {
        return Err(Error::invalid("the backdrops", "none", "at least one"));
    }
    match backdrops.iter().find(|backdrop| backdrop.len() != plane.len()) {
        Some(other) => {
            let expected = format!("{}, one a texel", plane.len());
            Err(Error::invalid("a backdrop", format!("{} colours", other.len()), expected))
        }
        None => Ok(()),
    }
}

/// A picture with the statistics of natural ones: dead leaves, discs of every size that hide each other (A. B. Lee, D.
/// Mumford, J. Huang, "Occlusion models for natural images", 2001), with radii r distributed as r^-3 between a texel and a
/// third of the picture, and brightness spread evenly over six stops.
pub fn dead_leaves(plane: Plane, seed: u64) -> Backdrop {
    /// Samples along each side of a texel.
    const SAMPLES: usize = 4;
    let (width, height) = (plane.columns() * SAMPLES, plane.rows() * SAMPLES);
    let (least, most) = (SAMPLES as f32, 0.33 * width.max(height) as f32);
    let mut rng = Pcg32::seed_from_u64(seed);
    let mut samples: Vec<Option<[f32; 3]>> = vec![None; width * height];
    let mut open = samples.len();
    // Nearest first: a disc fills what is still open. The last hundredth is of the last colour.
    let mut colour = [0.0; 3];
    while open > samples.len() / 100 {
        let mut random = || rng.random::<f32>();
        // The share of radii beyond r falls as r^-2.
        let share = random();
        let radius = (share / most.powi(2) + (1.0 - share) / least.powi(2)).powf(-0.5);
        let (x, y) = (random() * width as f32, random() * height as f32);
        let brightness = (-6.0 * random()).exp2();
        colour = std::array::from_fn(|_| brightness * (0.4 + 0.6 * random()));
        let span =
            |centre: f32, side: usize| (centre - radius).max(0.0) as usize..((centre + radius) as usize + 1).min(side);
        for row in span(y, height) {
            for column in span(x, width) {
                let inside = (column as f32 + 0.5 - x).hypot(row as f32 + 0.5 - y) < radius;
                let sample = &mut samples[row * width + column];
                if inside && sample.is_none() {
                    *sample = Some(colour);
                    open -= 1;
                }
            }
        }
    }
    let texel = |element: usize| -> [f32; 3] {
        let (column, row) = plane.place(element);
        let mut sum = [0.0; 3];
        for at in 0..SAMPLES * SAMPLES {
            let (x, y) = (column * SAMPLES + at % SAMPLES, row * SAMPLES + at / SAMPLES);
            let sample = samples[y * width + x].unwrap_or(colour);
            (0..3).for_each(|c| sum[c] += sample[c] / (SAMPLES * SAMPLES) as f32);
        }
        sum
    };
    (0..plane.len()).map(texel).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulate::{Camera, Monitor, Quality};

    fn photographed(pixels: (usize, usize), texels: usize, count: usize) -> Photographed {
        let monitor = Monitor::demo(Camera::monitor(pixels.0, pixels.1), (texels, texels));
        let quality = Quality { samples: 64, ..Quality::rig() };
        let rows = monitor.trace(&quality, &mut |_, _| Ok(())).unwrap();
        let plane = Plane::new(texels, texels).unwrap();
        let backdrops: Vec<Backdrop> = (1..=4).map(|seed| dead_leaves(plane, seed)).collect();
        let patterns = Noise { wavelet: Wavelet::Haar, count, seed: 1, deviation: Noise::DEVIATION };
        let setup = Setup {
            rows: &rows,
            directly_seen: &monitor.directly_seen(),
            screen: &Screen::monitor(),
            patterns,
            basis: Wavelet::Haar,
            noise: Setup::NOISE,
        };
        Photographed::new(&setup, &backdrops, &mut |_, _| Ok(())).unwrap()
    }

    fn trial(patterns: usize, terms: usize, stop: Stop) -> Trial {
        Trial { patterns, options: Options { terms, stop } }
    }

    /// The figure that the method is judged by, at a size that is quick.
    #[test]
    fn glass_mirrors_gloss_and_diffuse_bodies_are_relit_within_2_4_percent() {
        let photographed = photographed((48, 36), 64, 256);
        let good = photographed.measure(trial(256, 64, Stop::On)).unwrap();
        assert!(photographed.pixels() > 300 && good.errors.len() == 4);
        // The mean is what is asked for; leaves of six stops and a texel across are harsher than photographs.
        assert!(good.mean() < 0.024 && good.errors.iter().all(|error| *error < 0.03), "{good:?}");
        // Fewer terms and fewer patterns are worse; the rule to stop takes terms away and not quality.
        let few = photographed.measure(trial(256, 16, Stop::Off)).unwrap();
        let short = photographed.measure(trial(96, 64, Stop::Off)).unwrap();
        let off = photographed.measure(trial(256, 64, Stop::Off)).unwrap();
        assert!(few.mean() > 2.0 * good.mean() && short.mean() > 2.0 * good.mean(), "{few:?} {short:?} {good:?}");
        assert!(good.terms_found < off.terms_found && good.mean() < 1.1 * off.mean(), "{good:?} {off:?}");
        let message = photographed.measure(trial(300, 64, Stop::On)).unwrap_err().to_string();
        assert!(message.contains("300 patterns"), "{message}");
    }

    #[test]
    fn leaves_fill_the_picture_with_few_bright_ones() {
        let plane = Plane::new(48, 32).unwrap();
        let picture = dead_leaves(plane, 7);
        assert_eq!(picture, dead_leaves(plane, 7));
        assert_ne!(picture, dead_leaves(plane, 8));
        assert!(picture.iter().flatten().all(|v| (0.0..=1.0).contains(v)));
        let mean = picture.iter().flatten().sum::<f32>() / (3 * plane.len()) as f32;
        assert!((0.03..0.4).contains(&mean), "{mean}");
    }
}
