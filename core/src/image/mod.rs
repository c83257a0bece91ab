//! Pictures: linear, scene-referred, f32, interleaved RGB or premultiplied RGBA, row 0 at the top.
//!
//! Files come in through [`read`] (the one door: NaN and infinities are refused there) and leave through [`write()`].
//! Encoding is chosen per file type and can be forced; sizes and windows are in pixels.
//!
//! | file | what it does |
//! |---|---|
//! | `read` | tells the type of a file by its first bytes, hands it to a decoder, refuses what is not finite |
//! | `exr` | OpenEXR, in and out |
//! | `raster` | Radiance HDR, PNG and JPEG in |
//! | `tiff` | TIFF, in and out |
//! | `stored` | samples as a file holds them -> linear, premultiplied f32 |
//! | `write` | chooses the type by extension; HDR, PNG and JPEG out |
//! | [`layers`] | many pictures in one OpenEXR file, in and out |
//! | `grey` | codes of patterns, out |
//! | [`srgb`] | the transfer curve |
//! | `colour` | colour spaces and the matrices between them |

mod colour;
mod exr;
mod grey;
pub mod layers;
mod raster;
mod read;
pub mod srgb;
mod stored;
mod tiff;
mod write;

pub use colour::{ColourSpace, Conversion, Primaries};
pub use grey::write_grey;
pub use read::{Encoding, SampleType, probe_size, read, read_codes};
pub use write::{EncodeOptions, check_output, encode_png8, encode_png16, write};

use crate::error::{Error, Result};

/// A half-open rectangle of pixels: `x0 <= x < x1`, `y0 <= y < y1`, origin at the top left of the picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Window {
    /// Left edge, inside.
    pub x0: usize,
    /// Top edge, inside.
    pub y0: usize,
    /// Right edge, outside.
    pub x1: usize,
    /// Bottom edge, outside.
    pub y1: usize,
}

impl Window {
    /// The whole of a `width` x `height` picture.
    pub fn full(width: usize, height: usize) -> Self {
        Self { x0: 0, y0: 0, x1: width, y1: height }
    }

    /// Columns inside.
    pub fn width(&self) -> usize {
        self.x1.saturating_sub(self.x0)
    }

    /// Rows inside.
    pub fn height(&self) -> usize {
        self.y1.saturating_sub(self.y0)
    }

    /// No pixel inside?
    pub fn is_empty(&self) -> bool {
        self.width() == 0 || self.height() == 0
    }

    /// The part inside a `width` x `height` picture.
    pub fn clipped(&self, width: usize, height: usize) -> Self {
        let (x1, y1) = (self.x1.min(width), self.y1.min(height));
        Self { x0: self.x0.min(x1), y0: self.y0.min(y1), x1, y1 }
    }
}

/// A picture of 3 (RGB) or 4 (RGBA, premultiplied) channels; `data[(y * width + x) * channels + c]`, row 0 at the top.
#[derive(Debug, Clone, PartialEq)]
pub struct Image {
    width: usize,
    height: usize,
    channels: usize,
    data: Vec<f32>,
}

impl Image {
    /// A black (and, with 4 channels, transparent) picture.
    ///
    /// # Panics
    /// When `channels` is neither 3 nor 4: a mistake of the program, never of the data.
    pub fn new(width: usize, height: usize, channels: usize) -> Self {
        assert!(channels == 3 || channels == 4, "images have 3 or 4 channels");
        Self { width, height, channels, data: vec![0.0; width * height * channels] }
    }

    /// A picture from interleaved samples.
    ///
    /// # Errors
    /// When the number of samples does not fit the size.
    pub fn from_data(width: usize, height: usize, channels: usize, data: Vec<f32>) -> Result<Self> {
        if (channels != 3 && channels != 4)
            || Some(data.len()) != width.checked_mul(height).and_then(|n| n.checked_mul(channels))
        {
            return Err(Error::invalid(
                "image",
                format!("{} samples", data.len()),
                format!("{width} x {height} x (3 or 4)"),
            ));
        }
        Ok(Self { width, height, channels, data })
    }

    /// A picture computed pixel by pixel: `f(x, y)` gives linear RGB.
    pub fn from_fn(width: usize, height: usize, mut f: impl FnMut(usize, usize) -> [f32; 3]) -> Self {
        let mut data = Vec::with_capacity(width * height * 3);
        for y in 0..height {
            for x in 0..width {
                data.extend_from_slice(&f(x, y));
            }
        }
        Self { width, height, channels: 3, data }
    }

    /// Columns.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Rows.
    pub fn height(&self) -> usize {
        self.height
    }

    /// 3 or 4.
    pub fn channels(&self) -> usize {
        self.channels
    }

    /// Width and height, for comparing.
    pub fn size(&self) -> (usize, usize) {
        (self.width, self.height)
    }

    /// All samples, interleaved.
    pub fn data(&self) -> &[f32] {
        &self.data
    }

    /// All samples, interleaved, for writing.
    pub fn data_mut(&mut self) -> &mut [f32] {
        &mut self.data
    }

    /// One row of samples.
    pub fn row(&self, y: usize) -> &[f32] {
        let n = self.width * self.channels;
        &self.data[y * n..(y + 1) * n]
    }

    /// The samples of one pixel.
    pub fn pixel(&self, x: usize, y: usize) -> &[f32] {
        let at = (y * self.width + x) * self.channels;
        &self.data[at..at + self.channels]
    }

    /// The samples of one pixel, for writing.
    pub fn pixel_mut(&mut self, x: usize, y: usize) -> &mut [f32] {
        let at = (y * self.width + x) * self.channels;
        &mut self.data[at..at + self.channels]
    }

    /// The same picture without alpha (premultiplied colour stays as it is).
    pub fn into_rgb(self) -> Self {
        if self.channels == 3 {
            return self;
        }
        let data = self.data.chunks_exact(4).flat_map(|p| [p[0], p[1], p[2]]).collect();
        Self { channels: 3, data, ..self }
    }
}
