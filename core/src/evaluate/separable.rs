//! How well one photograph a square is recovered from horizontal and vertical sets (7.5), and whether the reliability map knows.
//!
//! Everything is of one position of a virtual gantry: photographs under the patterns, with noise of a camera and a black one if
//! asked for; the squares that [`Separable`] makes of them; the true ones, of the traced scene.

use rand::{RngExt, SeedableRng};
use rand_distr::StandardNormal;
use rand_pcg::Pcg32;

use crate::acquire::separable::{Position, Reliability, Separable};
use crate::domain::patterns::{Kind, PatternSet};
use crate::domain::{Filter, Plane};
use crate::error::Result;
use crate::image::Image;
use crate::simulate::Rows;

/// A pixel is bad when its recovered answers are off by more than this share of them, all squares together: five times what is
/// asked of a photograph.
pub const BAD: f64 = 0.1;
/// Squares count whose photographs have this share of the brightest one's energy at least: the others miss the bodies, or graze them.
const LIT: f64 = 1e-4;

/// Noise of a virtual photograph.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CameraNoise {
    /// As a share of its light.
    pub share: f32,
    /// In the dark, as a share of the mean of the photograph of all squares where that shows anything.
    pub floor: f32,
    /// Start of the random numbers.
    pub seed: u64,
}

impl CameraNoise {
    /// None.
    pub const NONE: Self = Self { share: 0.0, floor: 0.0, seed: 0 };
}

/// One position of a gantry, with its true squares.
#[derive(Debug)]
pub struct Study<'a> {
    rows: &'a Rows,
    position: usize,
    side: usize,
    truth: Vec<Image>,
}

/// What a position came to.
#[derive(Debug)]
pub struct Outcome {
    /// d.
    pub influence: usize,
    /// Photographs, black included.
    pub photographs: usize,
    /// `||recovered - true||_2 / ||true||_2` of a square's photograph, mean over the squares that light something.
    pub error: f64,
    /// The same of the worst one.
    pub worst: f64,
    /// The same of brute force with the same camera.
    pub brute_force: f64,
    /// `||recovered - true|| / ||true||` of each pixel over all squares; `None` where it is not judged or there is nothing.
    pub errors: Vec<Option<f64>>,
    /// Share of judged pixels beyond [`BAD`].
    pub bad: f64,
    /// Area under the curve of the map's ranking of bad pixels: 1 is perfect, 0.5 is chance; `None` where all are good or all bad.
    pub auc: Option<f64>,
    /// The map.
    pub reliability: Reliability,
    /// Difference of the sums of both sets.
    pub agreement: f64,
}

impl<'a> Study<'a> {
    /// Of a traced gantry.
    ///
    /// # Errors
    /// A position that there is not.
    pub fn new(rows: &'a Rows, position: usize) -> Result<Self> {
        let side = rows.grids().columns;
        let first = position * side * side;
        let truth = (first..first + side * side).map(|n| rows.element(n)).collect::<Result<_>>()?;
        Ok(Self { rows, position, side, truth })
    }

    /// The photograph of all squares.
    pub fn white(&self) -> Result<Image> {
        self.photograph(&vec![1.0; self.side * self.side])
    }

    /// Column and row of the square whose photograph has most light.
    pub fn brightest(&self) -> (usize, usize) {
        let light = |n: usize| self.truth[n].data().iter().map(|v| f64::from(*v)).sum::<f64>();
        let best = (0..self.truth.len()).max_by(|a, b| light(*a).total_cmp(&light(*b))).unwrap_or(0);
        (best % self.side, best / self.side)
    }

    /// The true photograph of a square.
    pub fn truth(&self, column: usize, row: usize) -> &Image {
        &self.truth[row * self.side + column]
    }

    /// Photographs of the patterns and the black one, recovered. `plain`: the minimum whatever the noise.
    ///
    /// # Errors
    /// An influence that there is not.
    pub fn recovered(&self, influence: usize, noise: CameraNoise, plain: bool) -> Result<Position> {
        let scheme = Separable::new(self.side, influence)?;
        let kind = Kind::Crossed { side: self.side, influence, filter: Filter::Box };
        let set = PatternSet::new(kind, Plane::new(self.side, self.side)?)?;
        let mut camera = self.camera(noise)?;
        let mut gathering = scheme.gather(format!("position {}", self.position + 1));
        gathering.black(camera.of(Image::new(self.rows.size().0, self.rows.size().1, 3)));
        for n in 0..set.len() {
            gathering.photograph(n, camera.of(self.photograph(&set.pattern(n).values)?))?;
        }
        let position = gathering.complete()?;
        Ok(if plain { position.plain() } else { position })
    }

    /// Measures what was recovered.
    ///
    /// # Errors
    /// As [`Study::recovered`].
    pub fn run(&self, influence: usize, noise: CameraNoise, plain: bool) -> Result<Outcome> {
        let position = self.recovered(influence, noise, plain)?;
        let reliability = position.reliability();
        let (mut photographs, mut pixels) =
            (Squares::default(), vec![(0.0f64, 0.0f64); self.truth[0].data().len() / 3]);
        for (n, truth) in self.truth.iter().enumerate() {
            let found = position.square(n % self.side, n / self.side);
            photographs.add(&found, truth);
            for (pixel, (found, truth)) in pixels.iter_mut().zip(pairs(&found, truth)) {
                (0..3).for_each(|c| {
                    pixel.0 += f64::from(found[c] - truth[c]).powi(2);
                    pixel.1 += f64::from(truth[c]).powi(2);
                });
            }
        }
        let width = self.rows.size().0;
        let judged = |(n, (off, norm)): (usize, &(f64, f64))| {
            reliability.excess(n % width, n / width).filter(|_| *norm > 0.0).map(|_| (off / norm).sqrt())
        };
        let errors: Vec<Option<f64>> = pixels.iter().enumerate().map(judged).collect();
        let ranked: Vec<(f64, bool)> = errors
            .iter()
            .enumerate()
            .filter_map(|(n, error)| Some((reliability.excess(n % width, n / width)?, (*error)? > BAD)))
            .collect();
        Ok(Outcome {
            influence,
            photographs: position.scheme().photographs() + 1,
            error: photographs.mean(),
            worst: photographs.worst(),
            brute_force: self.brute_force(noise)?,
            bad: ranked.iter().filter(|(_, bad)| *bad).count() as f64 / ranked.len().max(1) as f64,
            auc: area_under_curve(&ranked),
            errors,
            reliability,
            agreement: position.agreement().difference,
        })
    }

    /// The error of one photograph a square.
    fn brute_force(&self, noise: CameraNoise) -> Result<f64> {
        let mut camera = self.camera(CameraNoise { seed: noise.seed + 1, ..noise })?;
        let black = camera.of(Image::new(self.rows.size().0, self.rows.size().1, 3));
        let mut photographs = Squares::default();
        for truth in &self.truth {
            let mut found = camera.of(truth.clone());
            found.data_mut().iter_mut().zip(black.data()).for_each(|(v, black)| *v -= black);
            photographs.add(&found, truth);
        }
        Ok(photographs.mean())
    }

    fn photograph(&self, squares: &[f32]) -> Result<Image> {
        let grids = self.rows.grids();
        let mut light = vec![[0.0; 3]; grids.elements()];
        let first = self.position * squares.len();
        light[first..first + squares.len()].iter_mut().zip(squares).for_each(|(light, v)| *light = [*v; 3]);
        self.rows.photograph(&light)
    }

    fn camera(&self, noise: CameraNoise) -> Result<Shots> {
        let white = self.white()?;
        let lit: Vec<f64> = white.data().iter().filter(|v| **v > 0.0).map(|v| f64::from(*v)).collect();
        let mean = lit.iter().sum::<f64>() / lit.len().max(1) as f64;
        Ok(Shots { rng: Pcg32::seed_from_u64(noise.seed), share: noise.share, floor: noise.floor * mean as f32 })
    }
}

fn pairs<'a>(a: &'a Image, b: &'a Image) -> impl Iterator<Item = (&'a [f32], &'a [f32])> {
    a.data().chunks_exact(3).zip(b.data().chunks_exact(3))
}

/// A camera that adds noise.
struct Shots {
    rng: Pcg32,
    share: f32,
    floor: f32,
}

impl Shots {
    fn of(&mut self, mut light: Image) -> Image {
        if self.share > 0.0 || self.floor > 0.0 {
            for v in light.data_mut() {
                *v += (self.share * *v).hypot(self.floor) * self.rng.sample::<f32, _>(StandardNormal);
            }
        }
        light
    }
}

/// Errors of photographs, and how much light they have.
#[derive(Default)]
struct Squares(Vec<(f64, f64)>);

impl Squares {
    fn add(&mut self, found: &Image, truth: &Image) {
        let (mut off, mut norm) = (0.0f64, 0.0f64);
        for (found, truth) in found.data().iter().zip(truth.data()) {
            off += f64::from(found - truth).powi(2);
            norm += f64::from(*truth).powi(2);
        }
        self.0.push((off, norm));
    }

    fn relative(&self) -> Vec<f64> {
        let largest = self.0.iter().fold(0.0f64, |largest, (_, norm)| largest.max(*norm));
        self.0.iter().filter(|(_, norm)| *norm > LIT * largest).map(|(off, norm)| (off / norm).sqrt()).collect()
    }

    fn mean(&self) -> f64 {
        let errors = self.relative();
        errors.iter().sum::<f64>() / errors.len().max(1) as f64
    }

    fn worst(&self) -> f64 {
        self.relative().into_iter().fold(0.0, f64::max)
    }
}

/// The chance that one of the true has a higher score than one of the false, ties by half (Mann and Whitney 1947); `None` where there
/// are none of either.
pub fn area_under_curve(scored: &[(f64, bool)]) -> Option<f64> {
    let mut sorted = scored.to_vec();
    sorted.sort_by(|a, b| a.0.total_cmp(&b.0));
    let positives = sorted.iter().filter(|(_, is)| *is).count() as f64;
    let negatives = sorted.len() as f64 - positives;
    let (mut below, mut pairs) = (0.0, 0.0);
    for tie in sorted.chunk_by(|a, b| a.0 == b.0) {
        let here = tie.iter().filter(|(_, is)| *is).count() as f64;
        let others = tie.len() as f64 - here;
        pairs += here * (below + 0.5 * others);
        below += others;
    }
    (positives > 0.0 && negatives > 0.0).then(|| pairs / (positives * negatives))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulate::{Camera, Gantry, Quality, Scene};

    const SQUARES: usize = 12;

    /// Two positions, before which the bowl is open and from its side.
    fn traced(scene: Scene, blocks: usize) -> Rows {
        let camera = Camera::gantry(40, 30);
        let directions = [crate::math::Vec3::new(0.2, 0.5, 0.84), crate::math::Vec3::new(-0.6, 0.6, 0.53)];
        let positions = Gantry::above_table(&directions.map(|d| d.normalize()), 4.0);
        let gantry = Gantry { scene, positions, blocks, ..Gantry::demo(camera, (1, 1), SQUARES) };
        let quality = Quality { bounces: 32, stride: 1, ..Quality::rig() };
        gantry.trace(&quality, &mut |_, _| Ok(())).unwrap()
    }

    /// d = 3 is within 2 % where light goes straight.
    #[test]
    fn the_minimum_is_right_for_a_convex_body() {
        let convex = traced(Scene::convex(), 4);
        for position in 0..2 {
            let study = Study::new(&convex, position).unwrap();
            let outcome = study.run(3, CameraNoise::NONE, false).unwrap();
            assert!(outcome.error < 0.02 && outcome.bad < 0.01, "{}, {}", outcome.error, outcome.bad);
            assert!(outcome.reliability.affected(Reliability::THRESHOLD) < 0.01);
            // With noise it is no worse than brute force, which takes twice the photographs.
            let noisy = study.run(3, CameraNoise { share: 0.005, floor: 2e-4, seed: 3 }, false).unwrap();
            assert!(noisy.error < 1.05 * noisy.brute_force, "{}, {}", noisy.error, noisy.brute_force);
        }
    }

    /// It is not in a bowl, and the map knows where; whether light over other surfaces is held by blocks of squares or by single ones.
    #[test]
    fn the_minimum_fails_in_a_bowl_and_the_map_knows_where() {
        for blocks in [4, SQUARES] {
            let bowl = traced(Scene::bowl(), blocks);
            for position in 0..2 {
                let study = Study::new(&bowl, position).unwrap();
                let clean = study.run(3, CameraNoise::NONE, false).unwrap();
                let noisy = study.run(3, CameraNoise { share: 0.005, floor: 2e-4, seed: 3 }, false).unwrap();
                // Noise makes some pixels bad that no map of the scheme can know.
                for (outcome, least) in [(&clean, 0.94), (&noisy, 0.88)] {
                    let auc = outcome.auc.unwrap();
                    assert!(outcome.error > 0.05, "{}", outcome.error);
                    assert!(auc > least && (0.1..0.9).contains(&outcome.bad), "{blocks}: {auc}, {}", outcome.bad);
                    assert!(outcome.reliability.affected(Reliability::THRESHOLD) > 0.2);
                }
                let fewer = study.run(6, CameraNoise::NONE, false).unwrap();
                let none = study.run(SQUARES, CameraNoise::NONE, false).unwrap();
                assert!(fewer.error < 0.7 * clean.error && none.error < 1e-3, "{}, {}", fewer.error, none.error);
            }
        }
    }

    #[test]
    fn the_area_under_the_curve_is_that_of_its_definition() {
        let scored = [(0.1, false), (0.4, true), (0.35, false), (0.8, true), (0.4, false)];
        let mut wins = 0.0;
        for a in scored.iter().filter(|s| s.1) {
            for b in scored.iter().filter(|s| !s.1) {
                wins += if a.0 > b.0 {
                    1.0
                } else if a.0 == b.0 {
                    0.5
                } else {
                    0.0
                };
            }
        }
        assert!((area_under_curve(&scored).unwrap() - wins / 6.0).abs() < 1e-12);
        assert_eq!(area_under_curve(&scored[..1]), None);
    }
}
