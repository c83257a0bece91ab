//! Photographs moved over each other, by median threshold bitmaps.
//!
//! G. Ward, "Fast, Robust Image Registration for Compositing High Dynamic Range Photographs from Handheld Exposures", Journal of
//! Graphics Tools 8(2), 2003. A photograph becomes a bitmap: brighter or darker than its own median, which is the same set
//! of pixels at every exposure. Pixels within the noise of the median are excluded. On a pyramid, coarse to fine, each
//! level doubles the shift and tries the nine around it.
//!
//! Ward compares neighbours in exposure, because a median that is black or clipped tells nothing; so do we, and take
//! another percentile where the median of either is near an end of the range.

use rayon::prelude::*;

use crate::image::{Image, srgb};

/// Levels of the pyramid: shifts up to 2^6 - 1 = 63 pixels each way are found between neighbours, in pictures of 512 and
/// more; smaller ones have fewer levels.
const LEVELS: usize = 6;
/// No level is smaller than this on its shorter side: fewer pixels say nothing.
const SMALLEST: usize = 16;
/// Pixels this near to the threshold are excluded, in codes (Ward's tolerance).
const TOLERANCE: u8 = 4;
/// Shares of darker pixels to try as threshold; the median first.
const SHARES: [f64; 5] = [0.5, 0.3, 0.7, 0.15, 0.85];

/// A pyramid of one photograph's brightness, finest first.
#[derive(Debug, Clone)]
pub struct Pyramid {
    levels: Vec<Grey>,
}

#[derive(Debug, Clone)]
struct Grey {
    width: usize,
    height: usize,
    codes: Vec<u8>,
}

impl Pyramid {
    /// From codes, RGB with white at 1 (values beyond are clamped). Where codes are `linear` light, half of the picture
    /// can lie in the lowest few: they are put through the sRGB curve first.
    pub fn new(codes: &Image, linear: bool) -> Self {
        // Ward's weights, (54 R + 183 G + 19 B) / 256.
        let grey = |p: &[f32]| (54.0 * p[0] + 183.0 * p[1] + 19.0 * p[2]) / 256.0;
        let finest: Vec<u8> = codes
            .data()
            .par_chunks_exact(codes.channels())
            .map(|p| grey(p).clamp(0.0, 1.0))
            .map(|v| ((if linear { srgb::encode(v) } else { v }) * 255.0 + 0.5) as u8)
            .collect();
        let mut levels = vec![Grey { width: codes.width(), height: codes.height(), codes: finest }];
        while let Some(last) = levels.last().filter(|l| l.width.min(l.height) >= 2 * SMALLEST) {
            if levels.len() == LEVELS {
                break;
            }
            let half = last.half();
            levels.push(half);
        }
        Self { levels }
    }
}

impl Grey {
    /// Means of 2 x 2.
    fn half(&self) -> Self {
        let (width, height) = (self.width / 2, self.height / 2);
        let mut codes = vec![0; width * height];
        codes.par_chunks_mut(width).enumerate().for_each(|(y, out)| {
            let above = &self.codes[2 * y * self.width..];
            let below = &self.codes[(2 * y + 1) * self.width..];
            for (x, code) in out.iter_mut().enumerate() {
                let sum = [above[2 * x], above[2 * x + 1], below[2 * x], below[2 * x + 1]];
                *code = ((sum.iter().map(|z| u16::from(*z)).sum::<u16>() + 2) / 4) as u8;
            }
        });
        Self { width, height, codes }
    }

    fn percentile(&self, share: f64) -> u8 {
        let mut histogram = [0usize; 256];
        self.codes.iter().for_each(|z| histogram[usize::from(*z)] += 1);
        let mut left = (self.codes.len() as f64 * share) as usize;
        let at = histogram.iter().position(|n| {
            let found = left < *n;
            left = left.saturating_sub(*n);
            found
        });
        at.unwrap_or(255) as u8
    }

    /// 1 brighter than the threshold, 0 darker, 2 excluded.
    fn bitmap(&self, threshold: u8) -> Vec<u8> {
        let bit = |z: &u8| if z.abs_diff(threshold) <= TOLERANCE { 2 } else { u8::from(*z > threshold) };
        self.codes.par_iter().map(bit).collect()
    }
}

/// The shift of `b` against `a`: pixel (x, y) of `a` shows what (x, y) + shift of `b` shows. Both of one size.
///
/// `None` when no threshold tells bright from dark in both (one is black, or white).
pub fn shift(a: &Pyramid, b: &Pyramid) -> Option<[i32; 2]> {
    let share = threshold_share(a.levels.first()?, b.levels.first()?)?;
    let mut best = [0, 0];
    for (a, b) in a.levels.iter().zip(&b.levels).rev() {
        let bitmap = |grey: &Grey| grey.bitmap(grey.percentile(share));
        let (bits_a, bits_b) = (bitmap(a), bitmap(b));
        best = best.map(|d| 2 * d);
        let around = (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| [dx, dy]));
        // The unmoved first: of equals it stays.
        let mut tried: Vec<[i32; 2]> = around.map(|[dx, dy]| [best[0] + dx, best[1] + dy]).collect();
        tried.sort_by_key(|d| (d[0] - best[0]).abs() + (d[1] - best[1]).abs());
        let errors = tried.iter().map(|d| disagreement(a, &bits_a, &bits_b, *d));
        best = tried.iter().zip(errors).min_by(|(_, e), (_, f)| e.total_cmp(f)).map_or(best, |(d, _)| *d);
    }
    Some(best)
}

/// The first percentile that is well inside the range in both.
fn threshold_share(a: &Grey, b: &Grey) -> Option<f64> {
    let inside = |z: u8| (3 * TOLERANCE..=255 - 3 * TOLERANCE).contains(&z);
    SHARES.into_iter().find(|share| inside(a.percentile(*share)) && inside(b.percentile(*share)))
}

/// The share of pixels, of those that overlap and are excluded in neither, whose bits differ.
fn disagreement(a: &Grey, bits_a: &[u8], bits_b: &[u8], [dx, dy]: [i32; 2]) -> f64 {
    let (w, h) = (a.width as i32, a.height as i32);
    let (x0, x1) = ((-dx).max(0), (w - dx).min(w));
    if x0 >= x1 {
        return 1.0;
    }
    let row = |y: i32| {
        let from_a = &bits_a[(y * w + x0) as usize..(y * w + x1) as usize];
        let from_b = &bits_b[((y + dy) * w + x0 + dx) as usize..((y + dy) * w + x1 + dx) as usize];
        // Bits that differ sum to 1; with an excluded one the sum is 2 or more, and so has bit 1 set, or the bits agree.
        from_a.iter().zip(from_b).fold((0u32, 0u32), |(differ, counted), (a, b)| {
            let count = u32::from((a | b) < 2);
            (differ + (count & u32::from(a ^ b)), counted + count)
        })
    };
    let add = |a: (u64, u64), b: (u64, u64)| (a.0 + b.0, a.1 + b.1);
    let rows = ((-dy).max(0)..(h - dy).min(h)).into_par_iter();
    let (differ, counted) = rows.map(row).map(|(d, n)| (u64::from(d), u64::from(n))).reduce(|| (0, 0), add);
    if counted == 0 { 1.0 } else { differ as f64 / counted as f64 }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A textured scene, exposed and shifted; no lattice, so that no other shift fits.
    fn scene(width: usize, height: usize, exposure: f32, [dx, dy]: [i32; 2]) -> Image {
        let wave = |x: f32, y: f32| {
            let a = (0.11 * x + 0.05 * y).sin() + (0.043 * x - 0.09 * y + 1.0).cos();
            a + (0.013 * x * (1.0 + 0.01 * y)).sin() + 0.5 * ((0.5 * x).sin() * (0.37 * y).cos())
        };
        Image::from_fn(width, height, |x, y| {
            let light = 0.1 * (1.2 * wave((x as i32 - dx) as f32, (y as i32 - dy) as f32)).exp();
            [((exposure * light).min(1.0).powf(0.45) * 255.0).round() / 255.0; 3]
        })
    }

    #[test]
    fn shifts_are_found_across_exposures() {
        for (exposure, offset) in [(1.0, [0, 0]), (4.0, [3, -2]), (0.25, [-17, 9]), (2.0, [22, -27])] {
            let a = Pyramid::new(&scene(400, 300, 1.0, [0, 0]), false);
            let b = Pyramid::new(&scene(400, 300, exposure, offset), false);
            assert_eq!(shift(&a, &b), Some(offset), "exposure {exposure}");
        }
    }

    #[test]
    fn what_shows_nothing_has_no_shift() {
        let black = Pyramid::new(&Image::new(64, 64, 3), true);
        let grey = Pyramid::new(&scene(64, 64, 1.0, [0, 0]), false);
        assert_eq!(shift(&grey, &black), None);
        // Too small for a second level, but compared all the same.
        let tiny = Pyramid::new(&scene(9, 5, 1.0, [0, 0]), false);
        assert_eq!(shift(&tiny, &tiny), Some([0, 0]));
    }
}
