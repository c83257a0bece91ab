//! Alpha by triangulation (Smith and Blinn 1996, "Blue screen matting", theorem 4, for any number of backdrops).
//!
//! `C_k = F + (1 - alpha) B_k`: C_k the photograph before backdrop k, B_k that backdrop alone, F the object. So over backdrops
//! and channels `1 - alpha = sum (C_k - C)(B_k - B) / sum (B_k - B)^2`, C and B the means. Right for opaque objects only: what
//! is seen through glass changes with the backdrop, too, and passes for the backdrop.

use crate::error::{Error, Result};
use crate::image::Image;

/// Where backdrops differ by less than this of what they differ by at most, nothing is known.
const LEAST: f64 = 1e-3;

/// Sums over the backdrops so far.
#[derive(Debug, Clone, Default)]
pub struct Triangulation {
    size: (usize, usize),
    count: usize,
    /// Of each channel: C, B, C B, B B.
    sums: Vec<[f64; 4]>,
}

impl Triangulation {
    /// A photograph with the object and one without, before the same backdrop.
    ///
    /// # Errors
    /// Pictures of another size.
    pub fn add(&mut self, with: &Image, without: &Image) -> Result<()> {
        let size = if self.count == 0 { with.size() } else { self.size };
        for picture in [with, without] {
            if picture.size() != size {
                let found = format!("{} x {} pixels", picture.width(), picture.height());
                let place = format!("backdrop {}", self.count + 1);
                return Err(Error::invalid(place, found, format!("{} x {}", size.0, size.1)));
            }
        }
        let (with, without) = (with.clone().into_rgb(), without.clone().into_rgb());
        if self.count == 0 {
            (self.size, self.sums) = (size, vec![[0.0; 4]; with.data().len()]);
        }
        for ((sums, c), b) in self.sums.iter_mut().zip(with.data()).zip(without.data()) {
            let (c, b) = (f64::from(*c), f64::from(*b));
            sums.iter_mut().zip([c, b, c * b, b * b]).for_each(|(sum, v)| *sum += v);
        }
        self.count += 1;
        Ok(())
    }

    /// Alpha of each pixel, row by row, 0 to 1; 1 where the backdrops are all the same, as beside the screen.
    ///
    /// # Errors
    /// Fewer than two backdrops, or backdrops that do not differ.
    pub fn finish(self) -> Result<Vec<f32>> {
        let refuse = |found: String, expected: &str| Err(Error::invalid("triangulation", found, expected));
        if self.count < 2 {
            return refuse(format!("{} backdrops", self.count), "two at least, with the object and without");
        }
        let pixels: Vec<[f64; 2]> = self.sums.chunks_exact(3).map(|pixel| products(pixel, self.count as f64)).collect();
        let most = pixels.iter().map(|[_, below]| *below).fold(0.0, f64::max);
        if most <= 0.0 {
            return refuse("backdrops that are all the same".into(), "backdrops that differ at every pixel");
        }
        let alpha = |[above, below]: &[f64; 2]| if *below < LEAST * most { 1.0 } else { 1.0 - above / below };
        Ok(pixels.iter().map(|pixel| alpha(pixel).clamp(0.0, 1.0) as f32).collect())
    }
}

/// The sums of products about the means, over the channels.
fn products(channels: &[[f64; 4]], count: f64) -> [f64; 2] {
    let about = |[c, b, cb, bb]: &[f64; 4]| [cb - c * b / count, bb - b * b / count];
    channels.iter().map(about).fold([0.0; 2], |sum, [above, below]| [sum[0] + above, sum[1] + below])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn opaque_objects_are_exact() {
        let alpha = |x: usize| x as f32 / 9.0;
        let backdrop = |k: usize| {
            Image::from_fn(10, 4, |x, y| [[0.9, 0.1, 0.2], [0.1, 0.2 + 0.01 * y as f32, 0.8], [0.3, 0.8, x as f32]][k])
        };
        let mut all = Triangulation::default();
        assert!(all.clone().finish().unwrap_err().to_string().contains("0 backdrops"));
        for k in 0..3 {
            let behind = backdrop(k);
            let with = Image::from_fn(10, 4, |x, y| {
                let object = [0.5, 0.2 * y as f32, 0.1].map(|v| v * alpha(x));
                std::array::from_fn(|c| object[c] + (1.0 - alpha(x)) * behind.pixel(x, y)[c])
            });
            all.add(&with, &behind).unwrap();
        }
        for (n, found) in all.clone().finish().unwrap().into_iter().enumerate() {
            assert!((found - alpha(n % 10)).abs() < 1e-5, "{n}: {found}");
        }
        assert!(all.add(&backdrop(0), &Image::new(3, 4, 3)).unwrap_err().to_string().contains("10 x 4"));
        let mut same = Triangulation::default();
        (0..2).for_each(|_| same.add(&backdrop(0), &backdrop(0)).unwrap());
        assert!(same.finish().unwrap_err().to_string().contains("all the same"));
    }
}
