//! From photographs of the parts of a function to `C = T psi`, and its norm.

use super::Noise;
use crate::error::{Error, Result};
use crate::image::Image;

/// How many standard deviations the norm has to be above that of noise alone to count: one in 700 places of nothing but
/// noise passes.
const SIGNIFICANT: f64 = 3.0;

/// Photographs of a function in the parts in which it was shown (6.6.4), as light, the black one still in them.
#[derive(Debug, Clone, Copy)]
pub enum Parts<'a> {
    /// A function that is nowhere negative: `C = scale (P - S)`.
    Positive(&'a Image),
    /// Positive and negative part apart: `C = scale (P+ - P-)`; black cancels.
    Split(&'a Image, &'a Image),
    /// `(psi / scale + 1) / 2`: `C = scale (2 P - W - S)`, W the white screen.
    Shifted(&'a Image),
}

impl Parts<'_> {
    /// `C`, at the constant-energy normalisation.
    ///
    /// # Errors
    /// Photographs of different sizes.
    pub fn picture(&self, scale: f32, black: &Image, white: &Image) -> Result<Image> {
        let [first, second] = self.same_size([black, white])?;
        let mut picture = first.clone();
        for (n, value) in picture.data_mut().iter_mut().enumerate() {
            *value = scale
                * match self {
                    Parts::Positive(_) => *value - black.data()[n],
                    Parts::Split(..) => *value - second.data()[n],
                    Parts::Shifted(_) => 2.0 * *value - white.data()[n] - black.data()[n],
                };
        }
        Ok(picture)
    }

    /// Both photographs (the same one twice where there is one), of the size of all others.
    fn same_size(&self, others: [&Image; 2]) -> Result<[&Image; 2]> {
        let (first, second) = match self {
            Parts::Positive(one) | Parts::Shifted(one) => (*one, *one),
            Parts::Split(positive, negative) => (*positive, *negative),
        };
        let shape = |image: &Image| (image.size(), image.channels());
        match others.into_iter().chain([second]).find(|image| shape(image) != shape(first)) {
            None => Ok([first, second]),
            Some(other) => {
                let words = |image: &Image| format!("{} x {}", image.width(), image.height());
                Err(Error::invalid(
                    "photographs of one session",
                    words(other),
                    format!("{} as the others", words(first)),
                ))
            }
        }
    }
}

/// A norm, and that of noise alone.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Norm {
    /// `||C||_2` as photographed.
    pub measured: f64,
    /// The root of what `||C||_2^2` would be on average, did the function light nothing.
    pub noise: f64,
    /// Standard deviation of that square.
    pub noise_spread: f64,
}

impl Norm {
    /// Without noise.
    pub fn exact(norm: f64) -> Self {
        Self { measured: norm, noise: 0.0, noise_spread: 0.0 }
    }

    /// The norm without what noise adds on average, `E ||C + n||^2 = ||C||^2 + E ||n||^2`; 0 where noise alone explains it.
    pub fn above_noise(&self) -> f64 {
        let surplus = self.measured.powi(2) - self.noise.powi(2);
        if surplus > SIGNIFICANT * self.noise_spread { surplus.max(0.0).sqrt() } else { 0.0 }
    }
}

/// Takes norms over covered pixels.
#[derive(Debug, Clone)]
pub struct Measure {
    covered: Vec<bool>,
    noise: Noise,
}

impl Measure {
    /// `covered`: pixels that do not see the screen itself (6.6.4), row by row.
    pub fn new(covered: Vec<bool>, noise: Noise) -> Self {
        Self { covered, noise }
    }

    /// `||C||_2` over covered pixels and their channels, with `C` from [`Parts::picture`].
    ///
    /// # Panics
    /// When pictures have other pixels than those covered or not.
    pub fn norm(&self, parts: &Parts<'_>, scale: f32, picture: &Image) -> Norm {
        let channels = picture.channels();
        assert_eq!(picture.data().len(), self.covered.len() * channels, "one mark a pixel");
        let (first, second, gain) = match parts {
            Parts::Positive(one) => (one, None, 1.0),
            Parts::Split(positive, negative) => (positive, Some(negative), 1.0),
            Parts::Shifted(one) => (one, None, 4.0),
        };
        let gain = gain * f64::from(scale).powi(2);
        let (mut square, mut noise, mut spread) = (0.0f64, 0.0f64, 0.0f64);
        for pixel in (0..self.covered.len()).filter(|pixel| self.covered[*pixel]) {
            for at in channels * pixel..channels * (pixel + 1) {
                let of = |image: &Image| self.noise.variance(image.data()[at]);
                // Black and white are the same in all: what they stray by is no reason to choose.
                let variance = gain * (of(first) + second.map_or(0.0, |second| of(second)));
                square += f64::from(picture.data()[at]).powi(2);
                noise += variance;
                // Of the square of a normal variable: twice the variance squared.
                spread += 2.0 * variance * variance;
            }
        }
        Norm { measured: square.sqrt(), noise: noise.sqrt(), noise_spread: spread.sqrt() }
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_distr::StandardNormal;
    use rand_pcg::Pcg32;

    use super::*;

    const SIZE: (usize, usize) = (40, 30);

    fn picture(mut value: impl FnMut(usize) -> f32) -> Image {
        Image::from_fn(SIZE.0, SIZE.1, |x, y| {
            let v = value(y * SIZE.0 + x);
            [v, 0.5 * v, 0.25 * v]
        })
    }

    /// All three ways of showing a function come to the same picture, whatever the black level.
    #[test]
    fn parts_give_the_answer_to_the_function() {
        let black = picture(|n| 0.01 + 1e-5 * n as f32);
        let (up, down) = (|n: usize| (n % 7) as f32, |n: usize| (n % 5) as f32);
        let lit = |light: &dyn Fn(usize) -> f32| {
            let mut lit = picture(light);
            lit.data_mut().iter_mut().zip(black.data()).for_each(|(v, s)| *v += s);
            lit
        };
        // T of the white screen: more than both parts together.
        let white_light = |n: usize| up(n) + down(n) + 1.0;
        let white = lit(&white_light);
        let (positive, negative) = (lit(&up), lit(&down));
        let shifted = lit(&|n| 0.5 * (up(n) - down(n) + white_light(n)));
        let truth = |n: usize| 3.0 * (up(n) - down(n));
        let split = Parts::Split(&positive, &negative).picture(3.0, &black, &white).unwrap();
        let moved = Parts::Shifted(&shifted).picture(3.0, &black, &white).unwrap();
        let alone = Parts::Positive(&positive).picture(3.0, &black, &white).unwrap();
        for n in 0..SIZE.0 * SIZE.1 {
            for found in [&split, &moved] {
                assert!((found.data()[3 * n] - truth(n)).abs() < 1e-4);
            }
            assert!((alone.data()[3 * n + 1] - 1.5 * up(n)).abs() < 1e-4);
        }
        let small = Image::new(4, 4, 3);
        assert!(Parts::Positive(&small).picture(1.0, &black, &white).is_err());
        assert!(Parts::Split(&positive, &small).picture(1.0, &black, &white).is_err());
    }

    #[test]
    fn norms_leave_out_what_is_not_covered() {
        let picture = picture(|n| if n % 2 == 0 { 2.0 } else { 100.0 });
        let covered = (0..SIZE.0 * SIZE.1).map(|n| n % 2 == 0).collect();
        let norm = Measure::new(covered, Noise::none()).norm(&Parts::Positive(&picture), 1.0, &picture);
        let wanted = (600.0 * 4.0 * (1.0 + 0.25 + 0.0625f64)).sqrt();
        assert!((norm.measured - wanted).abs() < 1e-9 && norm.above_noise() == norm.measured);
    }

    /// The noise rule, on noise of a camera that strays by `sqrt(1e-6 + 1e-4 y)`.
    #[test]
    fn noise_alone_counts_nothing_and_light_loses_what_noise_adds() {
        let mut rng = Pcg32::seed_from_u64(2);
        let mut shot = |light: &dyn Fn(usize) -> f32| {
            let mut shot = picture(light);
            for v in shot.data_mut() {
                *v += (1e-6 + 1e-4 * *v).sqrt() * rng.sample::<f32, _>(StandardNormal);
            }
            shot
        };
        let light = |n: usize| 0.5 + 0.4 * (n as f32 * 0.1).sin();
        let dark = |_: usize| 0.0;
        let noise = Noise::measured(&[(&shot(&light), &shot(&light)), (&shot(&dark), &shot(&dark))]).unwrap();
        let measure = Measure::new(vec![true; SIZE.0 * SIZE.1], noise);
        let black = picture(dark);
        let mut norm = |up: &dyn Fn(usize) -> f32, down: &dyn Fn(usize) -> f32| {
            let (positive, negative) = (shot(up), shot(down));
            let parts = Parts::Split(&positive, &negative);
            measure.norm(&parts, 2.0, &parts.picture(2.0, &black, &black).unwrap())
        };
        let passed = (0..60).filter(|_| norm(&light, &light).above_noise() > 0.0).count();
        assert!(passed <= 2, "{passed} of 60 differences of nothing count");
        // A difference as large as its noise.
        let faint = |n: usize| light(n) + 0.01;
        let truth = 2.0 * 0.01 * (1200.0 * (1.0 + 0.25 + 0.0625f64)).sqrt();
        let found: Vec<f64> = (0..20).map(|_| norm(&faint, &light)).map(|n| n.above_noise()).collect();
        let mean = found.iter().sum::<f64>() / 20.0;
        assert!((mean / truth - 1.0).abs() < 0.05, "{mean} for {truth}");
    }
}
