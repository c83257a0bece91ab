//! How well explicit sampling does on a virtual screen (6.6.5): figures 6.14, 6.19 and 6.20 as numbers.
//!
//! Photographs are those of the traced scene, with noise of a camera; functions are chosen from them as in a capture. Relit
//! pictures of given lights are summed up as the functions come, so memory does not grow with their number.

use rand::{RngExt, SeedableRng};
use rand_distr::StandardNormal;
use rand_pcg::Pcg32;

use crate::acquire::explicit::{Bound, Growth, Measure, Noise, Parts, Weight};
use crate::domain::Plane;
use crate::domain::patterns::Wavelets;
use crate::error::{Error, Result};
use crate::image::Image;
use crate::simulate::Rows;
use crate::wavelet::Wavelet;

/// Reading a photograph adds this much noise, as a share of the mean of the white one: 16 stops below it.
const READ: f32 = 1.5e-5;

/// A light on the screen: one colour a texel, 0 to 1.
pub type Light = Vec<[f32; 3]>;

/// What is sampled, and what is relit.
#[derive(Debug, Clone, Copy)]
pub struct Study<'a> {
    /// The traced screen.
    pub rows: &'a Rows,
    /// Pixels that do not see the screen itself.
    pub covered: &'a [bool],
    /// Lights to relight with.
    pub lights: &'a [Light],
    /// The basis.
    pub wavelet: Wavelet,
    /// What light is expected.
    pub weight: Weight,
    /// Noise of a photograph, as a share of its light.
    pub noise: f32,
    /// Start of the noise.
    pub seed: u64,
}

/// Relit pictures after so many functions.
#[derive(Debug)]
pub struct Point<'a> {
    /// Functions shown.
    pub functions: usize,
    /// Photographs of their parts; without black and white ones.
    pub photographs: usize,
    /// What is left of the bound (6.7), as a share.
    pub bound: f64,
    /// One a light.
    pub relit: &'a [Image],
}

impl Study<'_> {
    /// Samples until the largest of `counts` (rising), and hands over what is relit after each.
    ///
    /// # Errors
    /// Lights of another size than the screen; what `each` returns, to stop.
    pub fn run(&self, counts: &[usize], each: &mut dyn FnMut(&Point<'_>) -> Result<()>) -> Result<()> {
        let grids = self.rows.grids();
        let plane = Plane::new(grids.columns, grids.rows)?;
        let wavelets = Wavelets::new(self.wavelet, plane)?;
        let coefficients = self.coefficients(&wavelets)?;
        let mut camera = Camera { rng: Pcg32::seed_from_u64(self.seed), noise: self.noise, read: 0.0 };
        let white = self.photograph(&vec![1.0; plane.len()])?;
        camera.read = READ * white.data().iter().sum::<f32>() / white.data().len() as f32;
        let black = Image::new(white.width(), white.height(), 3);
        let noise = Noise::measured(&[
            (&camera.of(white.clone()), &camera.of(white.clone())),
            (&camera.of(black.clone()), &camera.of(black.clone())),
        ])?;
        let measure = Measure::new(self.covered.to_vec(), noise);
        let tree = wavelets.transform().tree();
        let mut bound = Bound::new(tree.clone(), self.weight, &white, self.covered.to_vec())?;
        let mut growth = Growth::new(tree, self.weight, 0.0);
        let mut relit = vec![black.clone(); self.lights.len()];
        let (mut functions, mut photographs) = (0, 0);
        for count in counts {
            while functions < *count {
                let Some(location) = growth.next(None) else { break };
                let ((up, scale), (down, _)) = (wavelets.part(location, false), wavelets.part(location, true));
                let positive = camera.of(self.photograph(&up)?);
                let single = down.iter().all(|v| *v == 0.0);
                let negative = if single { black.clone() } else { camera.of(self.photograph(&down)?) };
                let parts = if single { Parts::Positive(&positive) } else { Parts::Split(&positive, &negative) };
                let picture = parts.picture(scale, &black, &white)?;
                growth.observe(location, &measure.norm(&parts, scale, &picture));
                let area = up.iter().chain(&down).map(|v| f64::from(*v)).sum();
                bound.shown(location, |n| positive.data()[n] + negative.data()[n], area);
                for (relit, a) in relit.iter_mut().zip(&coefficients) {
                    let a = [0, 1, 2].map(|c| a[3 * location as usize + c]);
                    let pixels = relit.data_mut().chunks_exact_mut(3).zip(picture.data().chunks_exact(3));
                    pixels.for_each(|(v, t)| (0..3).for_each(|c| v[c] += a[c] * t[c]));
                }
                functions += 1;
                photographs += if single { 1 } else { 2 };
            }
            each(&Point { functions, photographs, bound: bound.share(), relit: &relit })?;
        }
        Ok(())
    }

    /// What the scene shows under each light.
    ///
    /// # Errors
    /// Lights of another size than the screen.
    pub fn truths(&self) -> Result<Vec<Image>> {
        self.lights.iter().map(|light| self.rows.photograph(light)).collect()
    }

    /// `a = A L` of every light, three channels a location.
    fn coefficients(&self, wavelets: &Wavelets) -> Result<Vec<Vec<f32>>> {
        let size = wavelets.transform().size();
        let of = |light: &Light| {
            if light.len() != size.0 * size.1 {
                let expected = format!("{} x {}, one a texel", size.0, size.1);
                return Err(Error::invalid("a light of the study", format!("{} colours", light.len()), expected));
            }
            let mut a = light.as_flattened().to_vec();
            wavelets.transform().forward(&mut a, 3);
            Ok(a)
        };
        self.lights.iter().map(of).collect()
    }

    fn photograph(&self, light: &[f32]) -> Result<Image> {
        let grey: Vec<[f32; 3]> = light.iter().map(|v| [*v; 3]).collect();
        self.rows.photograph(&grey)
    }
}

/// Adds noise.
struct Camera {
    rng: Pcg32,
    noise: f32,
    read: f32,
}

impl Camera {
    fn of(&mut self, mut light: Image) -> Image {
        for v in light.data_mut() {
            let spread = (self.noise * *v).hypot(self.read);
            *v += spread * self.rng.sample::<f32, _>(StandardNormal);
        }
        light
    }
}

/// `||C - C'||_2 / ||C'||_2` over some pixels and all channels, C' the truth; 0 where it is black.
///
/// # Panics
/// When the pictures differ in size, or a pixel lies outside of them.
pub fn relative_error(picture: &Image, truth: &Image, pixels: &[usize]) -> f64 {
    let (mut off, mut norm) = (0.0f64, 0.0f64);
    for at in pixels.iter().flat_map(|pixel| 3 * pixel..3 * pixel + 3) {
        let (value, wanted) = (f64::from(picture.data()[at]), f64::from(truth.data()[at]));
        off += (value - wanted).powi(2);
        norm += wanted * wanted;
    }
    if norm > 0.0 { (off / norm).sqrt() } else { 0.0 }
}

/// Lights that change slowly over the screen (figure 6.14): a warm spot, a slope of colours, a bright window's blur.
pub fn smooth_lights((columns, rows): (usize, usize)) -> Vec<Light> {
    let light = |colour: &dyn Fn(f32, f32) -> [f32; 3]| -> Light {
        let at = |n: usize| ((n % columns) as f32 + 0.5, (n / columns) as f32 + 0.5);
        (0..columns * rows).map(at).map(|(x, y)| colour(x / columns as f32, y / rows as f32)).collect()
    };
    let spot = |x: f32, y: f32, at: [f32; 2], width: f32| {
        (-((x - at[0]).powi(2) + (y - at[1]).powi(2)) / (2.0 * width * width)).exp()
    };
    vec![
        light(&|x, y| {
            let s = spot(x, y, [0.3, 0.4], 0.16);
            [0.05 + 0.9 * s, 0.05 + 0.7 * s, 0.08 + 0.4 * s]
        }),
        light(&|x, y| [0.1 + 0.8 * x, 0.5 - 0.3 * y, 0.9 - 0.8 * x]),
        light(&|x, y| {
            let (warm, cold) = (spot(x, y, [0.75, 0.3], 0.2), spot(x, y, [0.2, 0.75], 0.25));
            [0.02 + 0.8 * warm + 0.1 * cold, 0.03 + 0.6 * warm + 0.3 * cold, 0.05 + 0.3 * warm + 0.7 * cold]
        }),
        light(&|x, y| {
            let wave = 0.5 + 0.4 * (std::f32::consts::TAU * (x + 0.5 * y)).sin();
            [wave, 0.8 * wave + 0.1, 0.4]
        }),
    ]
}

/// Lights with the statistics of photographs: discs of all sizes over each other (the dead-leaves model; A. B. Lee, D. Mumford
/// and J. Huang, "Occlusion models for natural images", IJCV 2001), area density of radii as `r^-3`.
pub fn natural_lights((columns, rows): (usize, usize), count: usize, seed: u64) -> Vec<Light> {
    /// Radii, as shares of the longer side.
    const RADII: [f32; 2] = [0.02, 0.5];
    const DISCS: usize = 600;
    /// Points across a texel.
    const ACROSS: usize = 3;
    let mut rng = Pcg32::seed_from_u64(seed);
    let mut light = || -> Light {
        let longer = columns.max(rows) as f32;
        let (wide, high) = (ACROSS * columns, ACROSS * rows);
        let mut points = vec![[0.3f32; 3]; wide * high];
        for _ in 0..DISCS {
            let [low, top] = RADII.map(|r| r.powi(-2));
            let radius = (low + (top - low) * rng.random::<f32>()).powf(-0.5) * longer * ACROSS as f32;
            let (x, y) = (wide as f32 * rng.random::<f32>(), high as f32 * rng.random::<f32>());
            // Brightnesses of scenes are spread over decades.
            let bright = (0.02f32.ln() * rng.random::<f32>()).exp();
            let colour: [f32; 3] = std::array::from_fn(|_| bright * (0.5 + 0.5 * rng.random::<f32>()));
            for (n, point) in points.iter_mut().enumerate() {
                let (dx, dy) = ((n % wide) as f32 + 0.5 - x, (n / wide) as f32 + 0.5 - y);
                if dx * dx + dy * dy < radius * radius {
                    *point = colour;
                }
            }
        }
        let texel = |n: usize| {
            let (left, top) = (n % columns * ACROSS, n / columns * ACROSS);
            let inside = (0..ACROSS * ACROSS).map(|k| points[(top + k / ACROSS) * wide + left + k % ACROSS]);
            let sum = inside.fold([0.0f32; 3], |sum, p| [sum[0] + p[0], sum[1] + p[1], sum[2] + p[2]]);
            sum.map(|v| v / (ACROSS * ACROSS) as f32)
        };
        (0..columns * rows).map(texel).collect()
    };
    (0..count).map(|_| light()).collect()
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::acquire::implicit::{Dictionary, Options, Solver, Terms};
    use crate::domain::patterns::{self, Kind, Pattern, PatternSet};
    use crate::simulate::{Camera, Class, Monitor, Quality, classes};

    const SIZE: (usize, usize) = (40, 30);
    const TEXELS: (usize, usize) = (64, 64);

    struct Seen {
        rows: Rows,
        covered: Vec<bool>,
        /// Covered pixels.
        pixels: Vec<usize>,
        /// Glass and mirrors.
        specular: Vec<usize>,
    }

    fn seen(monitor: &Monitor) -> Seen {
        let quality = Quality { samples: 16, ..Quality::rig() };
        let rows = monitor.trace(&quality, &mut |_, _| Ok(())).unwrap();
        let classes = classes(&monitor.scene, &monitor.camera);
        let covered: Vec<bool> = monitor.directly_seen().iter().map(|share| *share == 0.0).collect();
        let pixels = (0..covered.len()).filter(|n| covered[*n]).collect();
        Seen { rows, covered, pixels, specular: classes.pixels(&[Class::Glass, Class::Mirror]) }
    }

    /// Errors after each count, mean over the lights.
    fn errors(seen: &Seen, pixels: &[usize], lights: &[Light], wavelet: Wavelet, counts: &[usize]) -> Vec<f64> {
        let study = Study {
            rows: &seen.rows,
            covered: &seen.covered,
            lights,
            wavelet,
            weight: Weight::default(),
            noise: 2e-3,
            seed: 3,
        };
        let truths = study.truths().unwrap();
        let mut list = Vec::new();
        let mut bounds = vec![1.0];
        let each = &mut |point: &Point<'_>| {
            let off = point.relit.iter().zip(&truths).map(|(relit, truth)| relative_error(relit, truth, pixels));
            list.push(off.sum::<f64>() / truths.len() as f64);
            assert!(point.bound <= bounds[bounds.len() - 1] + 1e-9, "the bound rises");
            bounds.push(point.bound);
            Ok(())
        };
        study.run(counts, each).unwrap();
        list
    }

    /// Figures 6.14 and 6.15: 400 Haar functions are enough for the soft shadows of diffuse bodies.
    #[test]
    fn soft_shadows_of_diffuse_bodies_take_400_functions() {
        let seen = seen(&Monitor::cubes(Camera::monitor(SIZE.0, SIZE.1), TEXELS));
        let smooth = smooth_lights(TEXELS);
        let off = errors(&seen, &seen.pixels, &smooth, Wavelet::Haar, &[25, 100, 400]);
        assert!(off[2] < 0.03 && off[2] < off[1] && off[1] < off[0], "{off:?}");
    }

    /// Figures 6.19 and 6.20: with glass and mirrors beside them the error falls with each of 100, 300, 600, 900 functions; at
    /// 100, functions that are smooth do better under a smooth light.
    #[test]
    fn more_functions_are_better_and_few_smooth_ones_beat_few_boxes() {
        let seen = seen(&Monitor::demo(Camera::monitor(SIZE.0, SIZE.1), TEXELS));
        let counts = [100, 300, 600, 900];
        let natural = natural_lights(TEXELS, 2, 7);
        let off = errors(&seen, &seen.pixels, &natural, Wavelet::Haar, &counts);
        assert!(off.windows(2).all(|pair| pair[1] < 0.97 * pair[0]), "{off:?}");
        let smooth = smooth_lights(TEXELS);
        let [haar, cdf] =
            [Wavelet::Haar, Wavelet::Daubechies97].map(|w| errors(&seen, &seen.pixels, &smooth, w, &counts[..1])[0]);
        assert!(cdf < 0.8 * haar, "9/7 {cdf}, Haar {haar}");
        assert!(!seen.specular.is_empty());
    }

    /// 6.6.6, 6.7.1: a small function lights few pixels of a specular body, while every pixel learns from each pattern of noise.
    #[test]
    fn noise_beats_chosen_functions_on_specular_bodies_at_as_many_photographs() {
        const PHOTOGRAPHS: usize = 256;
        let seen = seen(&Monitor::demo(Camera::monitor(SIZE.0, SIZE.1), TEXELS));
        let lights = natural_lights(TEXELS, 2, 7);
        // One photograph of the scaling function, two of each other.
        let explicit = errors(&seen, &seen.specular, &lights, Wavelet::Haar, &[PHOTOGRAPHS / 2])[0];

        let plane = Plane::new(TEXELS.0, TEXELS.1).unwrap();
        let transform = plane.transform(Wavelet::Haar).unwrap();
        let noise = patterns::Noise {
            wavelet: Wavelet::Haar,
            count: PHOTOGRAPHS,
            seed: 5,
            deviation: patterns::Noise::DEVIATION,
        };
        let set = PatternSet::new(Kind::Noise(noise), plane).unwrap();
        let shown: Vec<Pattern> = (0..PHOTOGRAPHS).map(|n| set.pattern(n)).collect();
        let mut camera = super::Camera { rng: Pcg32::seed_from_u64(9), noise: 2e-3, read: 0.0 };
        let mut answer = |pattern: &Pattern| {
            let light: Light = pattern.values.iter().map(|v| [*v; 3]).collect();
            camera.of(seen.rows.photograph(&light).unwrap())
        };
        let photographs: Vec<Image> = shown.iter().map(&mut answer).collect();
        let solver = Solver::new(Arc::new(Dictionary::new(&transform, &shown).unwrap()), Options::default()).unwrap();
        let truths: Vec<Image> = lights.iter().map(|light| seen.rows.photograph(light).unwrap()).collect();
        let mut relit: Vec<Image> = truths.clone();
        let weights: Vec<Vec<f32>> = lights
            .iter()
            .map(|light| {
                let mut weights = light.as_flattened().to_vec();
                transform.inverse_adjoint(&mut weights, 3);
                weights
            })
            .collect();
        let mut scratch = solver.scratch();
        for pixel in &seen.specular {
            let response: Vec<f32> =
                (0..3).flat_map(|c| photographs.iter().map(move |p| p.data()[3 * pixel + c])).collect();
            let mut terms = Terms::default();
            solver.solve(&mut scratch, &response, None, &mut terms);
            for (picture, weights) in relit.iter_mut().zip(&weights) {
                let of = |c: usize| {
                    let terms = terms.locations.iter().zip(&terms.coefficients);
                    terms.map(|(at, rgb)| rgb[c] * weights[3 * *at as usize + c]).sum::<f32>()
                };
                (0..3).for_each(|c| picture.data_mut()[3 * pixel + c] = of(c));
            }
        }
        let off = relit.iter().zip(&truths).map(|(relit, truth)| relative_error(relit, truth, &seen.specular));
        let implicit = off.sum::<f64>() / lights.len() as f64;
        assert!(implicit < 0.7 * explicit, "implicit {implicit}, explicit {explicit}");
    }

    #[test]
    fn lights_are_light_of_the_size_asked_for() {
        for (size, lights) in [((32, 20), smooth_lights((32, 20))), ((32, 20), natural_lights((32, 20), 2, 1))] {
            assert!(lights.iter().all(|light| light.len() == size.0 * size.1));
            assert!(lights.iter().flatten().flatten().all(|v| (0.0..=1.0).contains(v)));
        }
        assert_eq!(natural_lights((16, 16), 1, 5), natural_lights((16, 16), 1, 5));
        let far = Image::new(2, 1, 3);
        assert_eq!(relative_error(&far, &far, &[0, 1]), 0.0);
    }
}
