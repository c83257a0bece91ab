//! The light of the bare white screen at each pixel, from where it is seen: a cubic over the picture, for light falls off
//! towards the corners of the picture and with the angle that the screen is looked at.

use nalgebra::{SMatrix, SVector};

use crate::domain::{Area, TERMS, monomials};
use crate::image::Image;

/// Rounds of leaving out what does not fit.
const ROUNDS: usize = 6;
/// Left out is what is farther off than so many times the median error: half of what is seen undisturbed is enough.
const WIDE: f64 = 4.0;
/// And this share of the light at least.
const LEAST: f64 = 0.01;
/// Pixels at most that are looked at.
const MOST: usize = 20_000;

/// White less black of the bare screen, RGB.
#[derive(Debug, Clone, PartialEq)]
pub struct BareWhite {
    area: Area,
    rgb: [SVector<f64, TERMS>; 3],
}

impl BareWhite {
    /// From the pixels that see the screen directly, most of them nothing else. None of fewer than 100.
    pub fn fit(light: &Image, direct: impl Fn(usize) -> bool) -> Option<Self> {
        let width = light.width();
        let all: Vec<usize> = (0..width * light.height()).filter(|pixel| direct(*pixel)).collect();
        let pixels: Vec<usize> = all.iter().copied().step_by(all.len().div_ceil(MOST).max(1)).collect();
        if pixels.len() < 100 {
            return None;
        }
        // Edges of the object are among them; a cubic means nothing beyond those that fit.
        let (_, kept) = Self::over(light, &pixels)?;
        Some(Self::over(light, &kept)?.0)
    }

    /// The fit over some pixels, and those that fit.
    fn over(light: &Image, pixels: &[usize]) -> Option<(Self, Vec<usize>)> {
        let width = light.width();
        let place = |pixel: usize| [(pixel % width) as f64 + 0.5, (pixel / width) as f64 + 0.5];
        let mut area = Area { from: [f64::INFINITY; 2], to: [f64::NEG_INFINITY; 2] };
        for pixel in pixels {
            for (i, at) in place(*pixel).into_iter().enumerate() {
                (area.from[i], area.to[i]) = (area.from[i].min(at - 0.5), area.to[i].max(at + 0.5));
            }
        }
        let samples: Vec<(SVector<f64, TERMS>, [f64; 3])> = pixels
            .iter()
            .map(|pixel| {
                let rgb: [f64; 3] = std::array::from_fn(|c| f64::from(light.data()[3 * pixel + c]));
                (SVector::from(monomials(area.place(place(*pixel)))), rgb)
            })
            .collect();
        let mut kept = vec![true; samples.len()];
        let mut rgb = [SVector::zeros(); 3];
        for _ in 0..ROUNDS {
            rgb = solve(&samples, &kept)?;
            // What is seen through something is darker, in all channels.
            let grey = |v: &[f64; 3]| v.iter().sum::<f64>();
            let off = |(terms, seen): &(SVector<f64, TERMS>, [f64; 3])| {
                let expected = grey(&rgb.map(|of| of.dot(terms)));
                ((grey(seen) - expected) / expected.max(1e-300)).abs()
            };
            let errors: Vec<f64> = samples.iter().map(off).collect();
            let mut sorted: Vec<f64> = errors.iter().zip(&kept).filter(|(_, kept)| **kept).map(|(e, _)| *e).collect();
            let middle = sorted.len() / 2;
            let bound = (WIDE * *sorted.select_nth_unstable_by(middle, f64::total_cmp).1).max(LEAST);
            kept.iter_mut().zip(&errors).for_each(|(kept, error)| *kept = *error <= bound);
        }
        let fitting = pixels.iter().zip(&kept).filter(|(_, kept)| **kept).map(|(pixel, _)| *pixel).collect();
        Some((Self { area, rgb }, fitting))
    }

    /// At a place of the picture, pixels; beyond where the screen is seen, that of its edge.
    pub fn at(&self, pixel: [f64; 2]) -> [f32; 3] {
        let terms = SVector::from(monomials(self.area.place(pixel)));
        self.rgb.map(|of| of.dot(&terms).max(0.0) as f32)
    }
}

fn solve(samples: &[(SVector<f64, TERMS>, [f64; 3])], kept: &[bool]) -> Option<[SVector<f64, TERMS>; 3]> {
    let mut gram = SMatrix::<f64, TERMS, TERMS>::zeros();
    let mut right = [SVector::<f64, TERMS>::zeros(); 3];
    for (terms, rgb) in samples.iter().zip(kept).filter(|(_, kept)| **kept).map(|(sample, _)| sample) {
        gram.ger(1.0, terms, terms, 1.0);
        right.iter_mut().zip(rgb).for_each(|(right, v)| *right += terms * *v);
    }
    let ridge = 1e-7 * gram.trace();
    let factor = (gram + SMatrix::identity() * ridge).cholesky()?;
    Some(right.map(|right| factor.solve(&right)))
}
