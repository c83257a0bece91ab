//! What a photograph strays by, measured: two photographs of the same differ by noise alone.
//!
//! So no figure of the camera is needed, and merged brackets, flicker of the screen and stray light are all in it.

use crate::error::{Error, Result};
use crate::image::Image;

/// Samples looked at of a pair of photographs.
const SAMPLES: usize = 200_000;
/// Brightnesses told apart. With 40 x 30 pixels and two pairs some 200 samples fall into each: their variance is known to
/// 10 %.
const BINS: usize = 32;

/// Variance of a photograph's values, by their brightness.
#[derive(Debug, Clone, PartialEq)]
pub struct Noise {
    /// Value and variance, values rising.
    knots: Vec<(f32, f64)>,
}

impl Noise {
    /// No noise at all.
    pub fn none() -> Self {
        Self { knots: vec![(0.0, 0.0)] }
    }

    /// From pairs of photographs of the same conditions: a bright one and a dark one tell most.
    ///
    /// # Errors
    /// Photographs of different sizes; none.
    pub fn measured(pairs: &[(&Image, &Image)]) -> Result<Self> {
        let mut samples: Vec<(f32, f64)> = Vec::new();
        for (first, second) in pairs {
            if first.data().len() != second.data().len() || first.data().is_empty() {
                let found =
                    format!("{} x {} and {} x {}", first.width(), first.height(), second.width(), second.height());
                return Err(Error::invalid("two photographs of the same", found, "two pictures of one size"));
            }
            let step = first.data().len().div_ceil(SAMPLES);
            let both = first.data().iter().zip(second.data()).step_by(step);
            samples.extend(both.map(|(a, b)| (0.5 * (a + b), 0.5 * f64::from(a - b).powi(2))));
        }
        if samples.is_empty() {
            return Err(Error::invalid("the noise of photographs", "no pair of them", "two of the same at least"));
        }
        samples.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mean = |bin: &[(f32, f64)]| {
            let count = bin.len() as f64;
            let value = bin.iter().map(|s| f64::from(s.0)).sum::<f64>() / count;
            (value as f32, bin.iter().map(|s| s.1).sum::<f64>() / count)
        };
        Ok(Self { knots: samples.chunks(samples.len().div_ceil(BINS)).map(mean).collect() })
    }

    /// Variance at a brightness: between those measured on a line; below and above them as at the ends, brighter ones
    /// in proportion (photons).
    pub fn variance(&self, value: f32) -> f64 {
        let after = self.knots.partition_point(|knot| knot.0 <= value);
        let [first, last] = [self.knots[0], self.knots[self.knots.len() - 1]];
        match after {
            0 => first.1,
            n if n == self.knots.len() && last.0 > 0.0 => last.1 * f64::from(value / last.0),
            n if n == self.knots.len() => last.1,
            n => {
                let (low, high) = (self.knots[n - 1], self.knots[n]);
                let share = f64::from((value - low.0) / (high.0 - low.0));
                low.1 + share * (high.1 - low.1)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_distr::StandardNormal;
    use rand_pcg::Pcg32;

    use super::*;

    #[test]
    fn two_photographs_tell_how_far_one_strays() {
        let mut rng = Pcg32::seed_from_u64(4);
        let truth = |light: f32| 1e-6 + 2e-4 * light;
        let mut shot = |bright: f32| {
            let mut shot = Image::from_fn(120, 90, |x, y| [bright * x as f32 / 120.0, bright * y as f32 / 90.0, 0.0]);
            shot.data_mut().iter_mut().for_each(|v| *v += truth(*v).sqrt() * rng.sample::<f32, _>(StandardNormal));
            shot
        };
        let noise = Noise::measured(&[(&shot(1.0), &shot(1.0)), (&shot(0.0), &shot(0.0))]).unwrap();
        for light in [0.0, 0.03, 0.2, 0.5, 0.9] {
            let off = noise.variance(light) / f64::from(truth(light)) - 1.0;
            assert!(off.abs() < 0.2, "{light}: {off}");
        }
        // Twice as bright as the brightest seen.
        let beyond = noise.variance(2.0) / f64::from(truth(2.0)) - 1.0;
        assert!(beyond.abs() < 0.2, "{beyond}");
        assert_eq!(Noise::none().variance(3.0), 0.0);
        let (a, b) = (Image::new(4, 4, 3), Image::new(4, 5, 3));
        assert!(Noise::measured(&[(&a, &b)]).is_err() && Noise::measured(&[]).is_err());
    }
}
