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
