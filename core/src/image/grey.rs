//! Grey PNG of codes that are already what the file shall hold: patterns, which no curve may touch.

use std::io::Write;
use std::path::Path;

use ::image::codecs::png::{CompressionType, FilterType, PngEncoder};
use ::image::{ExtendedColorType, ImageEncoder, ImageError};

use super::stored::check_size;
use crate::error::{Error, Result};
use crate::files::write_whole;

/// Writes a grey PNG of 8 bits (codes of 0 to 255; larger ones become 255), or of 16, row 0 at the top; whole or not at all.
///
/// # Errors
/// Codes that do not fill the size; the disk's.
pub fn write_grey(path: &Path, size: (usize, usize), codes: &[u16], eight_bits: bool) -> Result<()> {
    let (width, height) = size;
    check_size(path, width, height)?;
    if codes.len() != width * height {
        let found = format!("{} codes", codes.len());
        return Err(Error::invalid(path.display().to_string(), found, format!("{width} x {height}")));
    }
    write_whole(path, |writer| {
        encode(writer, (width as u32, height as u32), codes, eight_bits).map_err(|error| match error {
            ImageError::IoError(source) => Error::io("write", path, source),
            other => Error::invalid(path.display().to_string(), other.to_string(), "a picture that fits a PNG file"),
        })
    })
}

fn encode(writer: impl Write, (width, height): (u32, u32), codes: &[u16], eight_bits: bool) -> Result<(), ImageError> {
    let encoder = PngEncoder::new_with_quality(writer, CompressionType::Default, FilterType::Adaptive);
    if eight_bits {
        let bytes: Vec<u8> = codes.iter().map(|&code| u8::try_from(code).unwrap_or(u8::MAX)).collect();
        return encoder.write_image(&bytes, width, height, ExtendedColorType::L8);
    }
    encoder.write_image(bytemuck::cast_slice(codes), width, height, ExtendedColorType::L16)
}

#[cfg(test)]
mod tests {
    use super::super::read_codes;
    use super::*;

    #[test]
    fn codes_return() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        let codes: Vec<u16> = (0..35).map(|n| n * 7).collect();
        for (eight, white) in [(true, 255.0), (false, 65535.0)] {
            write_grey(&path, (7, 5), &codes, eight).unwrap();
            let (image, _) = read_codes(&path).unwrap();
            assert_eq!(image.size(), (7, 5));
            for (pixel, code) in image.data().chunks_exact(3).zip(&codes) {
                assert!(pixel.iter().all(|v| (v * white - f32::from(*code)).abs() < 1e-2));
            }
        }
        assert!(write_grey(&path, (7, 4), &codes, true).unwrap_err().to_string().contains("7 x 4"));
    }
}
