//! Is light additive here? The pictures of the lamps one by one must add up to the picture of all of them lit (3.2.1).
//!
//! What the sum of all lamps and the picture of all lamps differ in tells of a wrong response or dark level, of
//! lamps that dim when others are on, of ambient light that was not subtracted (it counts once a lamp in the sum), or of
//! something that moved meanwhile.

use super::black::median;
use crate::error::{Error, Result};
use crate::image::Image;

/// Sums to within this pass: what response, dark level and intensities are recovered to.
const TOLERANCE: f64 = 0.01;
/// The relative error may be this large where the ratio is right: it has the noise of all lamps' pictures.
const NOISY: f64 = 0.03;
/// Ratios are taken where the picture of all lamps has this share of its brightest pixels' light.
const LEAST_LIGHT: f64 = 0.05;

/// Adds up pictures of single lamps: linear, ambient light subtracted, not divided by the lamps' irradiance.
#[derive(Debug, Clone)]
pub struct Linearity {
    sum: Image,
    lamps: usize,
}

/// The sum of the lamps against the picture of all of them.
#[derive(Debug, Clone, PartialEq)]
pub struct Compared {
    /// Lamps in the sum.
    pub lamps: usize,
    /// `|sum - all|_2 / |all|_2` over the pixels of each channel.
    pub relative_error: [f64; 3],
    /// Median of sum / all over the lit pixels of each channel; 1 where none is lit.
    pub median_ratio: [f64; 3],
}

impl Linearity {
    /// For pictures of one size.
    pub fn new(width: usize, height: usize) -> Self {
        Self { sum: Image::new(width, height, 3), lamps: 0 }
    }

    /// The picture of one lamp more.
    ///
    /// # Errors
    /// [`Error::Invalid`] for another size.
    pub fn add(&mut self, lamp: &Image) -> Result<()> {
        self.check(lamp, &format!("lamp {}", self.lamps + 1))?;
        self.sum.data_mut().iter_mut().zip(lamp.data()).for_each(|(sum, v)| *sum += v);
        self.lamps += 1;
        Ok(())
    }

    fn check(&self, picture: &Image, place: &str) -> Result<()> {
        if picture.size() == self.sum.size() && picture.channels() == 3 {
            return Ok(());
        }
        let found = format!("{} x {} x {}", picture.width(), picture.height(), picture.channels());
        Err(Error::invalid(place, found, format!("{} x {} x 3", self.sum.width(), self.sum.height())))
    }

    /// Compares the sum with the picture of all lamps lit.
    ///
    /// # Errors
    /// [`Error::Invalid`] for no lamp yet, another size, or a black picture.
    pub fn compare(&self, all: &Image) -> Result<Compared> {
        let place = "the picture of all lamps";
        self.check(all, place)?;
        if self.lamps == 0 {
            return Err(Error::invalid("the sum of the lamps", "no lamp", "a picture of each lamp"));
        }
        let brightest = all.data().iter().copied().fold(0.0, f32::max);
        if brightest <= 0.0 {
            return Err(Error::invalid(place, "a black picture", "all lamps lit"));
        }
        let mut compared = Compared { lamps: self.lamps, relative_error: [0.0; 3], median_ratio: [1.0; 3] };
        for c in 0..3 {
            let channel =
                |image: &Image| -> Vec<f64> { image.data().iter().skip(c).step_by(3).map(|v| f64::from(*v)).collect() };
            let (sum, all) = (channel(&self.sum), channel(all));
            let (mut off, mut norm) = (0.0, 0.0);
            for (s, a) in sum.iter().zip(&all) {
                (off, norm) = (off + (s - a).powi(2), norm + a * a);
            }
            if norm > 0.0 {
                compared.relative_error[c] = (off / norm).sqrt();
            }
            // Highlights do not say what is lit: a hundredth of the pixels may be brighter.
            let mut sorted = all.clone();
            let rank = (sorted.len() * 99 / 100).min(sorted.len() - 1);
            let limit = LEAST_LIGHT * *sorted.select_nth_unstable_by(rank, f64::total_cmp).1;
            let lit = sum.iter().zip(&all).filter(|(_, a)| limit > 0.0 && **a > limit);
            let mut ratios: Vec<f64> = lit.map(|(s, a)| s / a).collect();
            if !ratios.is_empty() {
                compared.median_ratio[c] = median(&mut ratios);
            }
        }
        Ok(compared)
    }
}

impl Compared {
    /// Is light additive to within a hundredth, but for noise?
    pub fn passes(&self) -> bool {
        self.ratio_off().abs() <= TOLERANCE && self.error() <= NOISY
    }

    fn error(&self) -> f64 {
        self.relative_error.into_iter().fold(0.0, f64::max)
    }

    /// The median ratio farthest from 1, less 1.
    fn ratio_off(&self) -> f64 {
        let offs = self.median_ratio.map(|r| r - 1.0);
        offs.into_iter().fold(0.0, |worst: f64, off| if off.abs() > worst.abs() { off } else { worst })
    }

    /// What it means, a sentence.
    pub fn verdict(&self) -> String {
        let (off, error) = (100.0 * self.ratio_off(), 100.0 * self.error());
        let lamps = self.lamps;
        if self.passes() {
            return format!(
                "light adds up: the sum of {lamps} lamps is the picture of all to {off:+.2} % (median), {error:.2} % in each \
                 pixel, noise included"
            );
        }
        let cause = if self.ratio_off() > TOLERANCE {
            "lamps dim when all are on, ambient light was not subtracted, or the response or dark level is wrong"
        } else if self.ratio_off() < -TOLERANCE {
            "a lamp is missing in the sum, or the response or dark level is wrong"
        } else {
            "in places only: something moved, or the picture of all lamps is clipped"
        };
        format!(
            "light does not add up: the sum of {lamps} lamps is off by {off:+.1} % (median), {error:.1} % in each pixel: {cause}"
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lamp(n: usize) -> Image {
        Image::from_fn(64, 48, |x, y| {
            let v = (0.5 + 0.5 * ((x * (n + 1)) as f32 * 0.07 + y as f32 * 0.11).sin()) * 0.2;
            if x < 20 { [0.0; 3] } else { [v, 0.9 * v, 0.7 * v] }
        })
    }

    fn summed() -> (Linearity, Image) {
        let mut linearity = Linearity::new(64, 48);
        let mut all = Image::new(64, 48, 3);
        for n in 0..7 {
            linearity.add(&lamp(n)).unwrap();
            all.data_mut().iter_mut().zip(lamp(n).data()).for_each(|(a, v)| *a += v);
        }
        (linearity, all)
    }

    #[test]
    fn what_adds_up_passes_and_what_does_not_is_told_apart() {
        let (linearity, all) = summed();
        let same = linearity.compare(&all).unwrap();
        assert!(same.passes() && same.relative_error.iter().all(|e| *e < 1e-6), "{same:?}");
        assert!(same.verdict().contains("light adds up: the sum of 7 lamps"), "{}", same.verdict());

        let mut dim = all.clone();
        dim.data_mut().iter_mut().for_each(|v| *v *= 0.95);
        let dim = linearity.compare(&dim).unwrap();
        // Exact: 1 / 0.95, and 0.05 / 0.95 in the norm.
        assert!((0..3).all(|c| (dim.median_ratio[c] - 1.0 / 0.95).abs() < 1e-5), "{dim:?}");
        assert!((0..3).all(|c| (dim.relative_error[c] - 0.05 / 0.95).abs() < 1e-5), "{dim:?}");
        assert!(dim.verdict().contains("dim when all"), "{}", dim.verdict());

        let mut bright = all.clone();
        bright.data_mut().iter_mut().for_each(|v| *v *= 1.04);
        assert!(linearity.compare(&bright).unwrap().verdict().contains("missing"));

        let moved = Image::from_fn(64, 48, |x, y| std::array::from_fn(|c| all.pixel((x + 3) % 64, y)[c]));
        let moved = linearity.compare(&moved).unwrap();
        assert!(!moved.passes(), "{moved:?}");
    }

    #[test]
    fn what_cannot_be_compared_is_refused() {
        let (mut linearity, all) = summed();
        assert!(linearity.add(&Image::new(4, 4, 3)).unwrap_err().to_string().contains("lamp 8: found 4 x 4"));
        assert!(linearity.compare(&Image::new(64, 48, 3)).unwrap_err().to_string().contains("black"));
        assert!(Linearity::new(64, 48).compare(&all).unwrap_err().to_string().contains("no lamp"));
    }
}
