//! Wavelet noise (6.7.2): `M = S w` with normal weights.
//!
//! The deviation of the weights is `2^-level` in the constant-energy normalisation, level 0 the coarsest: functions of all
//! levels then are about equally high (white noise of coefficients would leave coarse structure unseen between the fine). All
//! patterns share one mean, so that photographs need one exposure, and one scale, that brings the texels' standard deviation
//! to a set share of the range. What leaves the range is clipped: who reconstructs takes the light that was emitted.

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use super::{Element, Series};
use crate::domain::Plane;
use crate::error::{Error, Result};
use crate::wavelet::{Transform, Tree, Wavelet};

/// The middle of the range.
const MEAN: f32 = 0.5;

/// Wavelet noise.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Noise {
    /// The wavelet.
    pub wavelet: Wavelet,
    /// Patterns.
    pub count: usize,
    /// Chooses the set. The first patterns of a seed are the same whatever the count.
    pub seed: u64,
    /// Standard deviation of a texel's light about the mean, 1/2.
    pub deviation: f64,
}

impl Noise {
    /// Deviation if nothing is said: the ends of the range lie 2.5 deviations from the mean, and one texel in 80 is clipped.
    pub const DEVIATION: f64 = 0.2;
}

/// The patterns of a grid.
#[derive(Debug)]
pub(super) struct Patterns {
    noise: Noise,
    transform: Transform,
    tree: Tree,
    /// From functions to light.
    gain: f32,
}

impl Patterns {
    /// # Errors
    /// D4 and D8; no patterns; a deviation outside (0, 1/2]; a grid of one texel, which has no noise.
    pub fn new(noise: Noise, plane: Plane) -> Result<Self> {
        if noise.count == 0 {
            return Err(Error::invalid("wavelet noise", "no patterns", "at least one"));
        }
        if !(noise.deviation > 0.0 && noise.deviation <= f64::from(MEAN)) {
            let found = noise.deviation.to_string();
            return Err(Error::invalid("the deviation of wavelet noise", found, "more than 0, at most 0.5"));
        }
        if plane.len() == 1 {
            return Err(Error::invalid("wavelet noise", "a grid of one texel", "two texels or more"));
        }
        let transform = plane.transform(noise.wavelet)?;
        let tree = transform.tree();
        // The variance of a texel: the sum of w_j^2 ||s_j||^2 over all texels, without the part of the mean.
        let energy = transform
            .synthesis_norms()
            .into_iter()
            .zip(0..)
            .map(|(norm, location)| (deviation(&tree, location) * f64::from(norm)).powi(2));
        let of_mean = if tree.roots().nth(1).is_none() { 1.0 } else { 0.0 };
        let texel = ((energy.sum::<f64>() - of_mean) / plane.len() as f64).sqrt();
        let gain = (noise.deviation / texel) as f32;
        Ok(Self { noise, transform, tree, gain })
    }

    /// `S w` less its mean.
    fn function(&self, number: usize) -> Vec<f32> {
        let mut normals = Normals::new(self.noise.seed, number);
        let weight = |location: u32| (deviation(&self.tree, location) * normals.next()) as f32;
        let mut values: Vec<f32> = (0..self.tree.len() as u32).map(weight).collect();
        self.transform.inverse(&mut values, 1);
        let mean = (values.iter().map(|v| f64::from(*v)).sum::<f64>() / values.len() as f64) as f32;
        values.iter_mut().for_each(|value| *value -= mean);
        values
    }
}

impl Series for Patterns {
    fn len(&self) -> usize {
        self.noise.count
    }

    fn element(&self, n: usize) -> Element {
        Element::Noise { number: n }
    }

    fn values(&self, n: usize) -> Vec<f32> {
        let mut values = self.function(n);
        values.iter_mut().for_each(|value| *value = (MEAN + self.gain * *value).clamp(0.0, 1.0));
        values
    }

    fn scale(&self, _n: usize) -> f32 {
        self.gain.recip()
    }
}

/// Of a weight.
fn deviation(tree: &Tree, location: u32) -> f64 {
    0.5f64.powi(tree.level(location) as i32)
}

/// Normal numbers by the method of G. E. P. Box and M. E. Muller ("A note on the generation of random normal deviates", 1958),
/// two at a time. The generator is seeded with a hash of seed and number, so patterns neither overlap nor depend on each other.
struct Normals {
    uniform: Pcg64Mcg,
    second: Option<f64>,
}

impl Normals {
    fn new(seed: u64, number: usize) -> Self {
        let mut words = [0; 16];
        words[..8].copy_from_slice(&seed.to_le_bytes());
        words[8..].copy_from_slice(&(number as u64).to_le_bytes());
        let mut key = [0; 16];
        key.copy_from_slice(&blake3::hash(&words).as_bytes()[..16]);
        Self { uniform: Pcg64Mcg::from_seed(key), second: None }
    }

    fn next(&mut self) -> f64 {
        if let Some(second) = self.second.take() {
            return second;
        }
        // In (0, 1]: the logarithm is finite.
        let (u, v) = (1.0 - self.uniform.random::<f64>(), self.uniform.random::<f64>());
        let (sin, cos) = (std::f64::consts::TAU * v).sin_cos();
        let radius = (-2.0 * u.ln()).sqrt();
        self.second = Some(radius * sin);
        radius * cos
    }
}
