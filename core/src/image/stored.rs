//! From samples as a file holds them to linear, premultiplied f32.

use std::path::Path;
use std::sync::OnceLock;

use super::{Encoding, Image, srgb};
use crate::error::{Error, Result};

/// The largest picture that is read: 2^28 pixels, 16384 x 16384. A header is checked against it before anything of the
/// picture's size is allocated, so that a few hostile bytes cannot ask for terabytes.
pub(super) const MAX_PIXELS: usize = 1 << 28;

/// How colour and alpha of a file belong together.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Alpha {
    /// Colour stands for itself; it is multiplied by alpha after linearising (PNG; TIFF `ExtraSamples` 0 and 2).
    Unassociated,
    /// Colour is already multiplied by alpha (OpenEXR; TIFF `ExtraSamples` 1).
    Associated,
}

/// Interleaved samples of one of the types files use.
pub(super) enum Samples {
    U8(Vec<u8>),
    U16(Vec<u16>),
    F32(Vec<f32>),
}

/// A decoded file before linearising: `channels` is 1 (grey), 2 (grey, alpha), 3 (RGB) or 4 (RGBA).
pub(super) struct Stored {
    pub width: usize,
    pub height: usize,
    pub channels: usize,
    pub alpha: Alpha,
    pub samples: Samples,
}

impl Stored {
    /// Linear, premultiplied RGB or RGBA. Integer samples are divided by their largest code; alpha is never put through
    /// a transfer curve; grey is copied to R, G and B.
    ///
    /// # Errors
    /// NaN or infinity in the file, or made by the curve, with its pixel and channel; samples that do not fill the size.
    pub fn into_linear(self, path: &Path, encoding: Encoding) -> Result<Image> {
        let srgb = match (encoding, &self.samples) {
            (Encoding::Srgb, _) => true,
            (Encoding::Linear, _) | (Encoding::Auto, Samples::F32(_)) => false,
            (Encoding::Auto, Samples::U8(_) | Samples::U16(_)) => true,
        };
        let Self { width, height, channels, alpha, samples } = self;
        let shape = Shape { channels, alpha, srgb };
        let out = if channels.is_multiple_of(2) { 4 } else { 3 };
        let data = match samples {
            Samples::U8(codes) => {
                let table: [f32; 256] = std::array::from_fn(|i| srgb::decode(i as f32 / 255.0));
                shape.convert(&codes, |s| f32::from(s) / 255.0, |s| table[usize::from(s)])
            }
            Samples::U16(codes) => {
                let table = table_of_16_bits();
                shape.convert(&codes, |s| f32::from(s) / 65535.0, |s| table[usize::from(s)])
            }
            Samples::F32(values) => {
                refuse_non_finite(&path.display().to_string(), &values, width, channels)?;
                if !srgb && channels == out && (channels == 3 || alpha == Alpha::Associated) {
                    return Image::from_data(width, height, channels, values);
                }
                let data = shape.convert(&values, |s| s, srgb::decode);
                // The curve's power may carry a huge value beyond f32.
                refuse_non_finite(&path.display().to_string(), &data, width, out)?;
                data
            }
        };
        Image::from_data(width, height, out, data).map_err(|_| {
            Error::invalid(path.display().to_string(), "too few samples", format!("{width} x {height} pixels"))
        })
    }
}

/// What there is to know about a pixel of a file.
#[derive(Clone, Copy)]
struct Shape {
    channels: usize,
    alpha: Alpha,
    srgb: bool,
}

impl Shape {
    /// `value` gives the sample on the scale where white is 1, `decoded` the light an sRGB sample stands for.
    fn convert<T: Copy>(self, samples: &[T], value: impl Fn(T) -> f32, decoded: impl Fn(T) -> f32) -> Vec<f32> {
        let has_alpha = self.channels.is_multiple_of(2);
        let mut data = Vec::with_capacity(samples.len() / self.channels * if has_alpha { 4 } else { 3 });
        let colours = if self.channels > 2 { [0, 1, 2] } else { [0, 0, 0] };
        for pixel in samples.chunks_exact(self.channels) {
            let light = |c: usize| if self.srgb { decoded(pixel[c]) } else { value(pixel[c]) };
            if !has_alpha {
                data.extend(colours.map(light));
                continue;
            }
            let alpha = value(pixel[self.channels - 1]);
            data.extend(colours.map(|c| match self.alpha {
                Alpha::Unassociated => light(c) * alpha,
                // The curve holds for the colour of the surface, not for its product with coverage.
                Alpha::Associated if self.srgb && alpha > 0.0 => srgb::decode(value(pixel[c]) / alpha) * alpha,
                Alpha::Associated => light(c),
            }));
            data.push(alpha);
        }
        data
    }
}

/// sRGB decoding of every 16-bit code; the power function is too slow to be run per sample.
fn table_of_16_bits() -> &'static [f32] {
    static TABLE: OnceLock<Vec<f32>> = OnceLock::new();
    TABLE.get_or_init(|| (0..=u16::MAX).map(|code| srgb::decode(f32::from(code) / 65535.0)).collect())
}

/// Names the first NaN or infinity by pixel and channel.
///
/// # Errors
/// [`Error::Invalid`] at `place`.
pub(super) fn refuse_non_finite(place: &str, samples: &[f32], width: usize, channels: usize) -> Result<()> {
    let Some(at) = samples.iter().position(|s| !s.is_finite()) else { return Ok(()) };
    let names: &[&str] = if channels < 3 { &["Y", "A"] } else { &["R", "G", "B", "A"] };
    let (pixel, channel) = (at / channels, names[at % channels]);
    let (x, y) = (pixel % width, pixel / width);
    Err(Error::invalid(
        format!("{place}, pixel ({x}, {y}), channel {channel}"),
        if samples[at].is_nan() { "NaN" } else { "an infinity" },
        "a finite number",
    ))
}

/// Refuses empty and absurd sizes, before anything is allocated for them.
///
/// # Errors
/// [`Error::Invalid`] with the size and the limit.
pub(super) fn check_size(place: &Path, width: usize, height: usize) -> Result<()> {
    match width.checked_mul(height) {
        Some(pixels) if (1..=MAX_PIXELS).contains(&pixels) => Ok(()),
        _ => Err(Error::invalid(
            place.display().to_string(),
            format!("a picture of {width} x {height} pixels"),
            format!("between 1 and {MAX_PIXELS} pixels"),
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn linear(channels: usize, alpha: Alpha, samples: Samples, encoding: Encoding) -> Vec<f32> {
        let stored = Stored { width: 1, height: 1, channels, alpha, samples };
        stored.into_linear(Path::new("a.png"), encoding).unwrap().data().to_vec()
    }

    fn assert_close(found: &[f32], expected: &[f32]) {
        assert_eq!(found.len(), expected.len(), "{found:?} is not {expected:?}");
        assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6), "{found:?} is not {expected:?}");
    }

    #[test]
    fn integers_are_srgb_and_floats_linear_unless_forced() {
        // sRGB 128/255 is 0.2158605 (IEC 61966-2-1), 0.5 is 0.2140411.
        use Encoding::*;
        let un = Alpha::Unassociated;
        for (encoding, expected) in [(Auto, 0.215_860_5), (Srgb, 0.215_860_5), (Linear, 128.0 / 255.0)] {
            assert_close(&linear(1, un, Samples::U8(vec![128]), encoding), &[expected; 3]);
        }
        for (encoding, expected) in [(Auto, 0.215_860_5), (Srgb, 0.215_860_5), (Linear, 128.0 / 255.0)] {
            assert_close(&linear(1, un, Samples::U16(vec![128 * 257]), encoding), &[expected; 3]);
        }
        for (encoding, expected) in [(Auto, 0.5), (Srgb, 0.214_041_14), (Linear, 0.5)] {
            assert_close(&linear(1, un, Samples::F32(vec![0.5]), encoding), &[expected; 3]);
        }
    }

    #[test]
    fn unassociated_alpha_multiplies_light_not_codes() {
        let (un, alpha) = (Alpha::Unassociated, 51.0 / 255.0);
        let found = linear(4, un, Samples::U8(vec![128, 255, 0, 51]), Encoding::Auto);
        assert_close(&found, &[0.215_860_5 * alpha, alpha, 0.0, alpha]);
        let grey = linear(2, un, Samples::U16(vec![65535, 13107]), Encoding::Linear);
        assert_close(&grey, &[0.2, 0.2, 0.2, 0.2]);
    }

    #[test]
    fn associated_alpha_is_kept_and_the_curve_sees_the_surface() {
        let by = Alpha::Associated;
        assert_close(&linear(4, by, Samples::F32(vec![0.25, 0.0, 2.0, 0.5]), Encoding::Auto), &[0.25, 0.0, 2.0, 0.5]);
        let found = linear(4, by, Samples::F32(vec![0.25, 0.5, 0.0, 0.5]), Encoding::Srgb);
        assert_close(&found, &[0.214_041_14 * 0.5, 0.5, 0.0, 0.5]);
        // Light without coverage (a glow) stays.
        assert_close(
            &linear(2, by, Samples::F32(vec![0.5, 0.0]), Encoding::Srgb),
            &[0.214_041_14, 0.214_041_14, 0.214_041_14, 0.0],
        );
    }

    #[test]
    fn what_is_not_finite_is_named() {
        let stored = |value| Stored {
            width: 2,
            height: 2,
            channels: 2,
            alpha: Alpha::Associated,
            samples: Samples::F32(vec![0.0, 0.0, 0.0, 0.0, 0.0, value, 0.0, 0.0]),
        };
        let message =
            |value, encoding| stored(value).into_linear(Path::new("a.tif"), encoding).unwrap_err().to_string();
        let found = message(f32::NEG_INFINITY, Encoding::Auto);
        assert!(found.contains("a.tif, pixel (0, 1), channel A: found an infinity"), "{found}");
        let huge = Stored { samples: Samples::F32(vec![1e30; 8]), ..stored(0.0) };
        let huge = Stored { channels: 1, height: 4, ..huge };
        let found = huge.into_linear(Path::new("a.tif"), Encoding::Srgb).unwrap_err().to_string();
        assert!(found.contains("pixel (0, 0), channel R: found an infinity"), "{found}");
    }

    #[test]
    fn sizes_have_bounds() {
        let check = |w, h| check_size(Path::new("a.png"), w, h).is_ok();
        assert!(check(1, 1) && check(16384, 16384));
        assert!(!check(0, 5) && !check(5, 0) && !check(16384, 16385) && !check(usize::MAX, 2));
    }
}
