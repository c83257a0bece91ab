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

#[cfg(test)]
mod tests {
    use ::image::{ImageBuffer, Luma, LumaA, Rgba};

    use super::super::{Encoding, read};
    use super::*;

    fn linear(picture: impl Into<DynamicImage>, name: &str) -> crate::image::Image {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(name);
        picture.into().save(&path).unwrap();
        read(&path, Encoding::Linear).unwrap()
    }

    fn assert_close(found: &[f32], expected: &[f32]) {
        assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6), "{found:?} is not {expected:?}");
        assert_eq!(found.len(), expected.len());
    }

    #[test]
    fn png_of_every_kind() {
        let grey8 = ImageBuffer::from_pixel(3, 2, Luma([51u8]));
        assert_close(linear(grey8, "a.png").pixel(2, 1), &[0.2; 3]);
        let grey16 = ImageBuffer::from_pixel(3, 2, Luma([13107u16]));
        assert_close(linear(grey16, "a.png").pixel(2, 1), &[0.2; 3]);
        let grey_alpha = ImageBuffer::from_pixel(3, 2, LumaA([51u8, 102]));
        assert_close(linear(grey_alpha, "a.png").pixel(2, 1), &[0.08, 0.08, 0.08, 0.4]);
        let rgb16 = ImageBuffer::from_pixel(3, 2, ::image::Rgb([1u16, 2, 65535]));
        assert_close(linear(rgb16, "a.png").pixel(2, 1), &[1.0 / 65535.0, 2.0 / 65535.0, 1.0]);
        let rgba = ImageBuffer::from_pixel(3, 2, Rgba([0u8, 51, 255, 51]));
        assert_close(linear(rgba, "a.png").pixel(2, 1), &[0.0, 0.04, 0.2, 0.2]);
    }

    #[test]
    fn png_with_a_palette() {
        // 2 x 1 pixels, 1 bit each, palette (255, 0, 51) and (0, 102, 255); written by hand with CRCs and stored deflate.
        let chunk = |kind: &[u8], body: &[u8]| {
            let content = [kind, body].concat();
            let crc = crc32(&content);
            [&(body.len() as u32).to_be_bytes()[..], &content, &crc.to_be_bytes()].concat()
        };
        let data = [0u8, 0b0100_0000];
        let adler = data.iter().fold((1u32, 0u32), |(a, b), d| (a + u32::from(*d), b + a + u32::from(*d)));
        let mut zlib = vec![0x78, 0x01, 1, 2, 0, 0xfd, 0xff, data[0], data[1]];
        zlib.extend((adler.1 << 16 | adler.0).to_be_bytes());
        let bytes = [
            b"\x89PNG\r\n\x1a\n".to_vec(),
            chunk(b"IHDR", &[0, 0, 0, 2, 0, 0, 0, 1, 1, 3, 0, 0, 0]),
            chunk(b"PLTE", &[255, 0, 51, 0, 102, 255]),
            chunk(b"IDAT", &zlib),
            chunk(b"IEND", &[]),
        ]
        .concat();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("palette.png");
        std::fs::write(&path, bytes).unwrap();
        let image = read(&path, Encoding::Linear).unwrap();
        assert_close(image.data(), &[1.0, 0.0, 0.2, 0.0, 0.4, 1.0]);
    }

    fn crc32(bytes: &[u8]) -> u32 {
        !bytes.iter().fold(!0u32, |crc, byte| {
            (0..8).fold(crc ^ u32::from(*byte), |c, _| if c & 1 == 1 { c >> 1 ^ 0xedb8_8320 } else { c >> 1 })
        })
    }

    #[test]
    fn jpeg_of_grey_and_colour() {
        let grey = ImageBuffer::from_pixel(19, 13, Luma([128u8]));
        let found = linear(grey, "a.jpg");
        assert_eq!((found.size(), found.channels()), ((19, 13), 3));
        assert!(found.data().iter().all(|s| (s - 128.0 / 255.0).abs() < 1.5 / 255.0));
    }

    #[test]
    fn a_cut_jpeg_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("cut.jpg");
        let picture = ImageBuffer::from_fn(64, 64, |x, y| Luma([(x * 3 + y * y) as u8]));
        DynamicImage::from(picture).save(&path).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        std::fs::write(&path, &bytes[..bytes.len() / 2 + 100]).unwrap();
        let message = read(&path, Encoding::Auto).unwrap_err().to_string();
        assert!(message.contains("cut.jpg") && message.contains("cut short"), "{message}");
    }

    #[test]
    fn radiance_by_hand() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.hdr");
        for magic in ["#?RADIANCE", "#?RGBE"] {
            let header = format!("{magic}\n# made by hand\nFORMAT=32-bit_rle_rgbe\nEXPOSURE=2\n\n-Y 1 +X 2\n");
            // Flat pixels: mantissas 128, 64, 32 with exponent 129 are 1, 0.5, 0.25; exponent 0 is black.
            let bytes = [header.as_bytes(), &[128, 64, 32, 129, 9, 9, 9, 0]].concat();
            std::fs::write(&path, bytes).unwrap();
            assert_eq!(read(&path, Encoding::Auto).unwrap().data(), [1.0, 0.5, 0.25, 0.0, 0.0, 0.0]);
        }
        for (from, to) in [("rgbe\n", "xyze\n"), ("-Y 1", "+Y 1")] {
            let text = "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 1\nabcd".replace(from, to);
            std::fs::write(&path, text).unwrap();
            let error = read(&path, Encoding::Auto).unwrap_err();
            assert!(matches!(error, Error::Unsupported { .. }), "{error}");
        }
        std::fs::write(&path, "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 4000000000 +X 4000000000\n").unwrap();
        assert!(read(&path, Encoding::Auto).is_err());
        std::fs::write(&path, "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 20000 +X 20000\n").unwrap();
        let message = read(&path, Encoding::Auto).unwrap_err().to_string();
        assert!(message.contains("20000 x 20000 pixels"), "{message}");
    }
}
