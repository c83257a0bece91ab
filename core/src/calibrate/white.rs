//! White balance: photographs of lamps of some colour, seen by some sensor -> neutral linear Rec.709.

use crate::error::{Error, Result};
use crate::image::{Image, Window};

/// From here on an integer sample counts as clipped: 252 of 255, within the rounding of a JPEG.
const CLIPPED: f32 = 0.988;
/// Share of a patch that may be clipped: hot pixels and dust.
const CLIPPED_SHARE: f64 = 0.01;
/// Below this a patch is too dark: code 6 of 8-bit sRGB, whose rounding alone is 8 %.
pub(super) const DARK: f64 = 0.0018;
/// Determinants and gains beyond this are no camera's.
const SENSIBLE: (f64, f64) = (1e-3, 1e3);

/// A linear map of colours, row by row: `rgb' = matrix rgb`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Correction {
    matrix: [[f64; 3]; 3],
}

impl Correction {
    /// One gain a channel.
    ///
    /// # Errors
    /// A gain that is not between 0.001 and 1000.
    pub fn gains(gains: [f64; 3]) -> Result<Self> {
        if gains.iter().any(|g| !(SENSIBLE.0..=SENSIBLE.1).contains(g)) {
            return Err(Error::invalid(
                "white balance",
                format!("the gains {gains:?}"),
                "numbers between 0.001 and 1000",
            ));
        }
        Ok(Self { matrix: std::array::from_fn(|i| std::array::from_fn(|j| if i == j { gains[i] } else { 0.0 })) })
    }

    /// A full matrix.
    ///
    /// # Errors
    /// Numbers that are not finite or beyond 1000; rows that do not keep three colours apart.
    pub fn matrix(matrix: [[f64; 3]; 3]) -> Result<Self> {
        let sensible = matrix.iter().flatten().all(|v| v.abs() <= SENSIBLE.1);
        let determinant = nalgebra::Matrix3::from_fn(|i, j| matrix[i][j]).determinant();
        if !sensible || determinant.abs().is_nan() || determinant.abs() < 1e-6 {
            let found = format!("the matrix {matrix:?}");
            return Err(Error::invalid(
                "white balance",
                found,
                "3 x 3 numbers within 1000, with three independent rows",
            ));
        }
        Ok(Self { matrix })
    }

    /// The rows.
    pub fn rows(&self) -> &[[f64; 3]; 3] {
        &self.matrix
    }

    /// Corrects a colour.
    pub fn colour(&self, rgb: [f64; 3]) -> [f64; 3] {
        self.matrix.map(|row| row.iter().zip(rgb).map(|(m, v)| m * v).sum())
    }

    /// Corrects a picture; alpha stays.
    pub fn apply(&self, picture: &mut Image) {
        let rows = self.matrix.map(|row| row.map(|v| v as f32));
        let channels = picture.channels();
        for pixel in picture.data_mut().chunks_exact_mut(channels) {
            let (r, g, b) = (pixel[0], pixel[1], pixel[2]);
            for (out, row) in pixel.iter_mut().zip(rows) {
                *out = row[0] * r + row[1] * g + row[2] * b;
            }
        }
    }
}

/// The mean colour of a patch of a linear photograph; `place` names it in messages.
///
/// # Errors
/// A window that is empty or not inside the picture; a patch that is clipped or too dark to have a colour.
pub fn patch(photograph: &Image, window: Window, place: &str) -> Result<[f64; 3]> {
    let refuse = |found: &str| {
        let advice = "a patch that is neither clipped nor black; photograph it at another exposure";
        Err(Error::invalid(place, found, advice))
    };
    match mean_of(photograph, &samples(photograph, window, place)?) {
        Some(mean) if mean.iter().all(|v| *v >= DARK) => Ok(mean),
        Some(_) => refuse("a patch that is black in at least one channel"),
        None => refuse("a patch that is clipped"),
    }
}

/// The mean colour of a patch of light in any unit, however dark; clipped where the photograph looks like codes.
///
/// # Errors
/// A window that is empty or not inside the picture; a patch that is clipped.
pub(super) fn patch_of_light(photograph: &Image, window: Window, place: &str) -> Result<[f64; 3]> {
    let mean = mean_of(photograph, &samples(photograph, window, place)?);
    mean.ok_or_else(|| Error::invalid(place, "a patch that is clipped", "shorter exposures"))
}

/// The colours of a window.
fn samples(photograph: &Image, window: Window, place: &str) -> Result<Vec<[f32; 3]>> {
    let (width, height) = photograph.size();
    let Window { x0, y0, x1, y1 } = window;
    if window.is_empty() || x1 > width || y1 > height {
        let found = format!("a patch from {x0},{y0} to {x1},{y1}");
        return Err(Error::invalid(place, found, format!("at least one pixel, inside {width} x {height}")));
    }
    let pixels = (y0..y1).flat_map(|y| (x0..x1).map(move |x| photograph.pixel(x, y)));
    Ok(pixels.map(|p| [p[0], p[1], p[2]]).collect())
}

/// The mean of samples of a photograph; `None` where they are clipped.
pub(super) fn mean_of(photograph: &Image, samples: &[[f32; 3]]) -> Option<[f64; 3]> {
    // Only codes clip at 1; floats beyond it say that these are no codes.
    let codes = photograph.data().iter().all(|v| *v <= 1.0);
    let clipped = samples.iter().filter(|rgb| codes && rgb.iter().any(|v| *v >= CLIPPED)).count();
    let mean = |c: usize| samples.iter().map(|rgb| f64::from(rgb[c])).sum::<f64>() / samples.len() as f64;
    (clipped as f64 <= CLIPPED_SHARE * samples.len() as f64).then(|| std::array::from_fn(mean))
}

/// The gains that bring a patch to its reflectance, up to exposure: green keeps its level.
///
/// # Errors
/// Colours so far apart that no lamp explains them.
pub fn white(seen: [f64; 3], reflectance: [f64; 3]) -> Result<Correction> {
    let gain = |c: usize| reflectance[c] / seen[c];
    Correction::gains(std::array::from_fn(|c| gain(c) / gain(1)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tinted_white_patch_becomes_white() {
        let lamp = [0.9, 0.6, 0.3];
        let photograph = Image::from_fn(20, 10, |x, _| if x < 10 { lamp } else { [0.1; 3] });
        let seen = patch(&photograph, Window { x0: 2, y0: 2, x1: 8, y1: 9 }, "white.exr").unwrap();
        let correction = white(seen, [1.0; 3]).unwrap();
        let found = correction.colour(seen);
        assert!(found.iter().all(|v| (v - 0.6).abs() < 1e-6), "{found:?}");
        let mut corrected = photograph.clone();
        correction.apply(&mut corrected);
        assert!(corrected.pixel(3, 3).iter().all(|v| (v - 0.6).abs() < 1e-6));
        // A warm grey card keeps its own colour.
        let found = white(seen, [0.5, 0.4, 0.3]).unwrap().colour(seen);
        assert!((found[0] / found[2] - 5.0 / 3.0).abs() < 1e-6 && (found[1] - 0.6).abs() < 1e-6);
    }

    #[test]
    fn patches_that_say_nothing_are_refused() {
        let photograph = Image::from_fn(20, 10, |x, _| if x < 10 { [1.0, 0.5, 0.5] } else { [0.0, 0.5, 0.5] });
        for (window, words) in [
            (Window { x0: 0, y0: 0, x1: 9, y1: 9 }, "clipped"),
            (Window { x0: 11, y0: 0, x1: 20, y1: 10 }, "black"),
            (Window { x0: 11, y0: 0, x1: 21, y1: 10 }, "inside 20 x 10"),
            (Window { x0: 5, y0: 5, x1: 5, y1: 6 }, "at least one pixel"),
        ] {
            let message = patch(&photograph, window, "card.png").unwrap_err().to_string();
            assert!(message.contains(words) && message.contains("card.png"), "{message}");
        }
        // Radiance above 1 is not clipped.
        let bright = Image::from_fn(4, 4, |_, _| [1.0, 3.0, 2.0]);
        assert!(patch(&bright, Window::full(4, 4), "card.exr").is_ok());
    }

    #[test]
    fn gains_and_matrices_are_sensible() {
        for bad in [[0.0, 1.0, 1.0], [-1.0, 1.0, 1.0], [f64::NAN, 1.0, 1.0], [1.0, 1e4, 1.0]] {
            assert!(Correction::gains(bad).is_err());
        }
        for bad in
            [[[1.0; 3]; 3], [[f64::NAN; 3]; 3], [[0.0; 3]; 3], [[1e9, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]]
        {
            assert!(Correction::matrix(bad).is_err(), "{bad:?}");
        }
    }
}
