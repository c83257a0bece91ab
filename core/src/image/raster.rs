//! Radiance HDR, PNG and JPEG, decoded by the `image` crate.

use std::fs::File;
use std::io::{BufRead, BufReader, Cursor, Read, Seek};
use std::path::Path;

use ::image::codecs::{hdr::HdrDecoder, jpeg::JpegDecoder, png::PngDecoder};
use ::image::{DynamicImage, ImageDecoder, ImageError, ImageFormat, Limits};

use super::stored::{Alpha, MAX_PIXELS, Samples, Stored, check_size};
use crate::error::{Error, Result};

/// Reads one picture. `format` is HDR, PNG or JPEG.
///
/// # Errors
/// Damaged, truncated, too large or unsupported files.
pub(super) fn read(path: &Path, mut file: BufReader<File>, format: ImageFormat) -> Result<Stored> {
    match format {
        ImageFormat::Hdr => decode(path, HdrDecoder::new_nonstrict(file), format),
        ImageFormat::Png => decode(path, PngDecoder::with_limits(file, limits()), format),
        _ => {
            let mut bytes = Vec::new();
            file.read_to_end(&mut bytes).map_err(|source| Error::io("read", path, source))?;
            refuse_cut_jpeg(path, &bytes)?;
            decode(path, JpegDecoder::new(Cursor::new(bytes)), format)
        }
    }
}

/// Width and height from the header.
///
/// # Errors
/// Damaged or unsupported headers.
pub(super) fn probe_size(path: &Path, file: impl BufRead + Seek, format: ImageFormat) -> Result<(usize, usize)> {
    let size = match format {
        ImageFormat::Hdr => HdrDecoder::new_nonstrict(file).map(|d| d.dimensions()),
        ImageFormat::Png => PngDecoder::with_limits(file, limits()).map(|d| d.dimensions()),
        _ => JpegDecoder::new(file).map(|d| d.dimensions()),
    };
    let (width, height) = size.map_err(|error| failure(path, format, error))?;
    Ok((width as usize, height as usize))
}

/// 16 bytes for each pixel of the largest picture, for the picture and a decoder's own buffers.
fn limits() -> Limits {
    let mut limits = Limits::no_limits();
    limits.max_alloc = Some(16 * MAX_PIXELS as u64);
    limits
}

fn decode(
    path: &Path,
    decoder: std::result::Result<impl ImageDecoder, ImageError>,
    format: ImageFormat,
) -> Result<Stored> {
    let failed = |error| failure(path, format, error);
    let mut decoder = decoder.map_err(failed)?;
    let (width, height) = decoder.dimensions();
    let (width, height) = (width as usize, height as usize);
    check_size(path, width, height)?;
    decoder.set_limits(limits()).map_err(failed)?;
    let picture = DynamicImage::from_decoder(decoder).map_err(failed)?;
    let channels = usize::from(picture.color().channel_count());
    let samples = match picture {
        DynamicImage::ImageLuma8(p) => Samples::U8(p.into_raw()),
        DynamicImage::ImageLumaA8(p) => Samples::U8(p.into_raw()),
        DynamicImage::ImageRgb8(p) => Samples::U8(p.into_raw()),
        DynamicImage::ImageRgba8(p) => Samples::U8(p.into_raw()),
        DynamicImage::ImageLuma16(p) => Samples::U16(p.into_raw()),
        DynamicImage::ImageLumaA16(p) => Samples::U16(p.into_raw()),
        DynamicImage::ImageRgb16(p) => Samples::U16(p.into_raw()),
        DynamicImage::ImageRgba16(p) => Samples::U16(p.into_raw()),
        DynamicImage::ImageRgb32F(p) => Samples::F32(p.into_raw()),
        other => return Err(unsupported(path, format!("the pixel type {:?}", other.color()))),
    };
    Ok(Stored { width, height, channels, alpha: Alpha::Unassociated, samples })
}

/// The decoder fills what is missing of a cut JPEG with grey; a photograph that is half grey must not pass for data.
/// In the scan 0xff is followed by 0x00 or a restart marker only, so an end marker (EOI) after the last start of scan
/// (SOS) is the end of the picture.
fn refuse_cut_jpeg(path: &Path, bytes: &[u8]) -> Result<()> {
    let start = bytes.windows(2).rposition(|marker| marker == [0xff, 0xda]);
    if start.is_some_and(|start| bytes[start..].windows(2).any(|marker| marker == [0xff, 0xd9])) {
        return Ok(());
    }
    Err(Error::invalid(
        path.display().to_string(),
        format!("no end marker in {} bytes", bytes.len()),
        "a whole JPEG file (this one was cut short)",
    ))
}

fn failure(path: &Path, format: ImageFormat, error: ImageError) -> Error {
    let name = match format {
        ImageFormat::Hdr => "Radiance HDR",
        ImageFormat::Png => "PNG",
        _ => "JPEG",
    };
    let invalid = |found: String| Error::invalid(path.display().to_string(), found, format!("a whole {name} file"));
    match error {
        ImageError::IoError(source) if source.kind() == std::io::ErrorKind::UnexpectedEof => {
            invalid("the end of the file".to_owned())
        }
        ImageError::IoError(source) => Error::io("read", path, source),
        ImageError::Unsupported(what) => unsupported(path, what.to_string()),
        other => invalid(other.to_string()),
    }
}

fn unsupported(path: &Path, what: String) -> Error {
    Error::Unsupported {
        place: path.display().to_string(),
        what,
        advice: "convert the file to OpenEXR, 16-bit PNG or float TIFF".to_owned(),
    }
}
