//! Two pictures of the same size, pixel by pixel.

use std::fmt;

use crate::error::{Error, Result};
use crate::image::Image;

/// How far a picture `a` is from a reference `b`, over the R, G and B of the pixels that count.
///
/// Infinities are written as `null` in JSON, which knows none, and as `inf` in text.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Comparison {
    /// `||a - b||_2 / ||b||_2`, over all channels together. 0 for equal pictures; infinite when only the reference is
    /// black.
    pub relative_l2: f64,
    /// `10 log10(peak^2 / mean((a - b)^2))` in decibels; the peak is the largest sample of the reference, as
    /// scene-referred pictures have no fixed white. Infinite for equal pictures; minus infinity when the reference has
    /// no positive sample.
    pub psnr_db: f64,
    /// `mean(a) / mean(b)`: 1 for equal energy. 1 when both means are 0; infinite when only the reference's is.
    pub ratio_of_means: f64,
    /// The largest `|a - b|`.
    pub largest_difference: f64,
    /// Where that is: column, row, channel (0 red, 1 green, 2 blue); the first such place in reading order.
    pub at: (usize, usize, usize),
    /// How many pixels counted.
    pub pixels: usize,
}

impl fmt::Display for Comparison {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (x, y, channel) = self.at;
        writeln!(f, "relative L2         {:.6}", self.relative_l2)?;
        writeln!(f, "PSNR                {:.2} dB (against the peak of the reference)", self.psnr_db)?;
        writeln!(f, "ratio of means      {:.6}", self.ratio_of_means)?;
        let name = ["R", "G", "B"][channel.min(2)];
        writeln!(f, "largest difference  {:.6} at pixel ({x}, {y}), channel {name}", self.largest_difference)?;
        write!(f, "pixels              {}", self.pixels)
    }
}

/// Compares `a` with the reference `b`. With a mask, only the pixels count where the mean of its R, G and B exceeds 0.5.
/// Alpha is not compared. Sums run in f64 in reading order: the figures do not depend on threads.
///
/// # Errors
/// [`Error::Invalid`] when the sizes differ, no pixel counts, or a pixel that counts is not finite.
///
/// ```
/// use relume_core::{evaluate::compare, image::Image};
///
/// let reference = Image::from_fn(4, 4, |_, _| [1.0, 1.0, 1.0]);
/// let brighter = Image::from_fn(4, 4, |_, _| [1.1, 1.1, 1.1]);
/// let figures = compare(&brighter, &reference, None)?;
/// assert!((figures.relative_l2 - 0.1).abs() < 1e-6);
/// assert!((figures.psnr_db - 20.0).abs() < 1e-4);
/// # Ok::<(), relume_core::Error>(())
/// ```
pub fn compare(a: &Image, b: &Image, mask: Option<&Image>) -> Result<Comparison> {
    same_size("the picture to compare", a, b)?;
    if let Some(mask) = mask {
        same_size("the mask", mask, b)?;
    }
    let mut sums = Sums::default();
    for y in 0..b.height() {
        for x in 0..b.width() {
            if mask.is_none_or(|mask| mask.pixel(x, y)[..3].iter().sum::<f32>() > 1.5) {
                sums.add(x, y, a.pixel(x, y), b.pixel(x, y))?;
            }
        }
    }
    match (sums.pixels, mask) {
        (0, Some(_)) => Err(Error::invalid("the mask", "no pixel whose mean exceeds 0.5", "at least one")),
        (0, None) => Err(Error::invalid("the reference", "an empty picture", "at least one pixel")),
        _ => Ok(sums.finish()),
    }
}

#[derive(Default)]
struct Sums {
    a: f64,
    b: f64,
    b_squared: f64,
    difference_squared: f64,
    peak: f64,
    largest: f64,
    at: (usize, usize, usize),
    pixels: usize,
}

impl Sums {
    fn add(&mut self, x: usize, y: usize, a: &[f32], b: &[f32]) -> Result<()> {
        for channel in 0..3 {
            let (a, b) = (f64::from(a[channel]), f64::from(b[channel]));
            let difference = (a - b).abs();
            if !difference.is_finite() {
                return Err(Error::invalid(
                    format!("pixel ({x}, {y}), channel {}", ["R", "G", "B"][channel]),
                    format!("{a} against {b}"),
                    "finite numbers",
                ));
            }
            self.a += a;
            self.b += b;
            self.b_squared += b * b;
            self.difference_squared += difference * difference;
            self.peak = self.peak.max(b);
            if difference > self.largest {
                (self.largest, self.at) = (difference, (x, y, channel));
            }
        }
        self.pixels += 1;
        Ok(())
    }

    fn finish(self) -> Comparison {
        let mean_squared = self.difference_squared / (3 * self.pixels) as f64;
        let equal = self.difference_squared == 0.0;
        Comparison {
            relative_l2: if equal { 0.0 } else { (self.difference_squared / self.b_squared).sqrt() },
            psnr_db: if equal { f64::INFINITY } else { 10.0 * (self.peak * self.peak / mean_squared).log10() },
            ratio_of_means: if self.a == self.b { 1.0 } else { self.a / self.b },
            largest_difference: self.largest,
            at: self.at,
            pixels: self.pixels,
        }
    }
}

fn same_size(what: &str, picture: &Image, reference: &Image) -> Result<()> {
    if picture.size() == reference.size() {
        return Ok(());
    }
    let size = |image: &Image| format!("{} x {} pixels", image.width(), image.height());
    Err(Error::invalid(what, size(picture), format!("{}, the size of the reference", size(reference))))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grey(width: usize, height: usize, value: f32) -> Image {
        Image::from_fn(width, height, |_, _| [value; 3])
    }

    #[test]
    fn figures_follow_their_formulas() {
        let b = Image::from_fn(2, 1, |x, _| [[1.0, 2.0, 2.0], [4.0, 0.0, 0.0]][x]);
        let a = Image::from_fn(2, 1, |x, _| [[1.0, 2.0, 2.5], [4.0, -1.0, 0.0]][x]);
        let figures = compare(&a, &b, None).unwrap();
        assert!((figures.relative_l2 - (1.25f64 / 25.0).sqrt()).abs() < 1e-12);
        assert!((figures.psnr_db - 10.0 * (16.0f64 / (1.25 / 6.0)).log10()).abs() < 1e-12);
        assert!((figures.ratio_of_means - 8.5 / 9.0).abs() < 1e-12);
        assert_eq!((figures.largest_difference, figures.at, figures.pixels), (1.0, (1, 0, 1), 2));
    }

    #[test]
    fn equal_pictures_have_no_error_and_json_gets_null() {
        let figures = compare(&grey(3, 2, 0.7), &grey(3, 2, 0.7), None).unwrap();
        assert_eq!((figures.relative_l2, figures.psnr_db, figures.ratio_of_means), (0.0, f64::INFINITY, 1.0));
        let json = serde_json::to_value(figures).unwrap();
        assert!(json["psnr_db"].is_null(), "{json}");
        assert_eq!(json["pixels"], 6);
        assert!(figures.to_string().contains("inf dB"), "{figures}");
    }

    #[test]
    fn a_black_reference_is_infinitely_far_unless_matched() {
        let black = grey(2, 2, 0.0);
        let equal = compare(&black, &black, None).unwrap();
        assert_eq!((equal.relative_l2, equal.ratio_of_means), (0.0, 1.0));
        let other = compare(&grey(2, 2, 0.1), &black, None).unwrap();
        assert_eq!((other.relative_l2, other.psnr_db), (f64::INFINITY, f64::NEG_INFINITY));
        assert_eq!(other.ratio_of_means, f64::INFINITY);
    }

    #[test]
    fn only_masked_pixels_count_and_alpha_does_not() {
        let b = grey(4, 1, 1.0);
        let mut a = Image::new(4, 1, 4);
        for x in 0..4 {
            a.pixel_mut(x, 0).copy_from_slice(&[1.0 + x as f32, 1.0, 1.0, 0.25]);
        }
        let mask = Image::from_fn(4, 1, |x, _| [[1.0, 1.0, 1.0], [0.9, 0.9, 0.0], [0.5; 3], [0.0; 3]][x]);
        let figures = compare(&a, &b, Some(&mask)).unwrap();
        assert_eq!((figures.pixels, figures.largest_difference, figures.at), (2, 1.0, (1, 0, 0)));
    }

    #[test]
    fn what_cannot_be_compared_is_refused() {
        let sizes = compare(&grey(2, 3, 1.0), &grey(3, 2, 1.0), None).unwrap_err().to_string();
        assert!(sizes.contains("2 x 3") && sizes.contains("3 x 2"), "{sizes}");
        let b = grey(2, 2, 1.0);
        assert!(compare(&b, &b, Some(&grey(2, 1, 1.0))).unwrap_err().to_string().contains("mask"));
        assert!(compare(&b, &b, Some(&grey(2, 2, 0.5))).unwrap_err().to_string().contains("no pixel"));
        let nan = Image::from_fn(2, 2, |x, y| [1.0, 1.0, if (x, y) == (1, 0) { f32::NAN } else { 1.0 }]);
        assert!(compare(&nan, &b, None).unwrap_err().to_string().contains("pixel (1, 0), channel B"));
        assert!(compare(&Image::new(0, 0, 3), &Image::new(0, 0, 3), None).is_err());
    }
}
