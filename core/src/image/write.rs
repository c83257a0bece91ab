//! Writing pictures, whole or not at all.

use std::io::{Cursor, Seek, Write};
use std::path::Path;

use ::image::codecs::png::{CompressionType, FilterType, PngEncoder};
use ::image::codecs::{hdr::HdrEncoder, jpeg::JpegEncoder};
use ::image::{ExtendedColorType, ImageEncoder, ImageError, Rgb};

use super::stored::{check_size, refuse_non_finite};
use super::{ColourSpace, Image, exr, srgb, tiff};
use crate::error::{Error, Result};
use crate::files::{check_folder, write_whole};

/// What can be chosen when writing.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct EncodeOptions {
    /// EXR: 16-bit halves in place of 32-bit floats; values beyond 65504 are clamped.
    pub half: bool,
    /// PNG: 8 bits in place of 16.
    pub png8: bool,
    /// EXR: the space of the colours, told in the file. Nothing is converted; other types cannot tell it.
    pub colour_space: ColourSpace,
}

/// JPEG quality: no visible blocks; who needs exact numbers takes another type.
const JPEG_QUALITY: u8 = 95;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum FileType {
    Exr,
    Hdr,
    Png,
    Tiff,
    Jpeg,
}

/// Writes a picture; the extension chooses the type. The file appears whole or not at all.
///
/// | extension | samples | alpha |
/// |---|---|---|
/// | `.exr` | linear float, or half; ZIP, with its primaries | premultiplied (associated) |
/// | `.hdr` | linear RGBE, rounded to the nearest; negatives become 0 | dropped: colour over black |
/// | `.png` | sRGB, 16 bits, or 8; clamped to 0..1 | divided out; where it is 0 so is colour |
/// | `.tif`, `.tiff` | linear float | premultiplied, tagged as associated |
/// | `.jpg`, `.jpeg` | sRGB, 8 bits, quality 95; clamped to 0..1 | dropped: colour over black |
///
/// # Errors
/// [`Error::Invalid`] for an unknown extension, an empty picture, NaN or infinity (with pixel and channel), a size the
/// type cannot hold; [`Error::Io`] when the folder is absent or full.
pub fn write(path: &Path, image: &Image, options: EncodeOptions) -> Result<()> {
    let file_type = file_type(path)?;
    check_size(path, image.width(), image.height())?;
    refuse_non_finite(&path.display().to_string(), image.data(), image.width(), image.channels())?;
    write_whole(path, |writer| match file_type {
        FileType::Exr => exr::write(path, writer, image, options),
        FileType::Hdr => write_hdr(writer, image).map_err(|error| failure(path, error)),
        FileType::Png => write_png(writer, image, options.png8).map_err(|error| failure(path, error)),
        FileType::Tiff => tiff::write(path, writer, image),
        FileType::Jpeg => write_jpeg(writer, image).map_err(|error| failure(path, error)),
    })
}

/// Checks that [`write()`] can write to `path` as far as the path shows it: the extension, the folder. Ask before the work.
///
/// # Errors
/// [`Error::Invalid`] for an unknown extension; [`Error::Io`] when the folder is absent or `path` is one.
pub fn check_output(path: &Path) -> Result<()> {
    file_type(path)?;
    check_folder(path)
}

/// An 8-bit sRGB PNG in memory, for previews: clamped to 0..1, alpha unassociated.
///
/// # Errors
/// An empty picture, NaN or infinity.
pub fn encode_png8(image: &Image) -> Result<Vec<u8>> {
    let place = Path::new("preview");
    check_size(place, image.width(), image.height())?;
    refuse_non_finite("preview", image.data(), image.width(), image.channels())?;
    let mut bytes = Cursor::new(Vec::new());
    write_png(&mut bytes, image, true).map_err(|error| failure(place, error))?;
    Ok(bytes.into_inner())
}

/// A 16-bit RGB PNG in memory, of codes as they are: `codes[(y * width + x) * 3 + c]`, row 0 at the top. Compression is of the
/// fast kind: photographs are written one after another, and sensor noise cannot be packed anyway.
///
/// # Errors
/// An empty picture, and codes that do not fill its size.
pub fn encode_png16(width: usize, height: usize, codes: &[u16]) -> Result<Vec<u8>> {
    let place = Path::new("photograph");
    check_size(place, width, height)?;
    if codes.len() != width * height * 3 {
        let found = format!("{} codes", codes.len());
        return Err(Error::invalid("photograph", found, format!("{width} x {height} x 3")));
    }
    let mut bytes = Vec::with_capacity(codes.len() * 2 + 1024);
    PngEncoder::new_with_quality(&mut bytes, CompressionType::Fast, FilterType::Up)
        .write_image(bytemuck::cast_slice(codes), width as u32, height as u32, ExtendedColorType::Rgb16)
        .map_err(|error| failure(place, error))?;
    Ok(bytes)
}

fn file_type(path: &Path) -> Result<FileType> {
    let extension = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
    match extension.as_str() {
        "exr" => Ok(FileType::Exr),
        "hdr" => Ok(FileType::Hdr),
        "png" => Ok(FileType::Png),
        "tif" | "tiff" => Ok(FileType::Tiff),
        "jpg" | "jpeg" => Ok(FileType::Jpeg),
        _ => Err(Error::invalid(
            path.display().to_string(),
            if extension.is_empty() { "no extension".to_owned() } else { format!("the extension .{extension}") },
            ".exr, .hdr, .png, .tif, .tiff, .jpg or .jpeg",
        )),
    }
}

/// Width and height as the encoders want them; `check_size` has bounded them.
fn size_u32(image: &Image) -> (u32, u32) {
    (image.width() as u32, image.height() as u32)
}

fn write_png(writer: impl Write, image: &Image, eight_bits: bool) -> std::result::Result<(), ImageError> {
    let (width, height) = size_u32(image);
    let encoder = PngEncoder::new_with_quality(writer, CompressionType::Default, FilterType::Adaptive);
    let codes = image.data().chunks_exact(image.channels()).flat_map(unassociated_codes);
    match (eight_bits, image.channels()) {
        (true, channels) => {
            let bytes: Vec<u8> = codes.map(|code| (code * 255.0).round() as u8).collect();
            let color = if channels == 4 { ExtendedColorType::Rgba8 } else { ExtendedColorType::Rgb8 };
            encoder.write_image(&bytes, width, height, color)
        }
        (false, channels) => {
            let words: Vec<u16> = codes.map(|code| (code * 65535.0).round() as u16).collect();
            let color = if channels == 4 { ExtendedColorType::Rgba16 } else { ExtendedColorType::Rgb16 };
            encoder.write_image(bytemuck::cast_slice(&words), width, height, color)
        }
    }
}

/// sRGB codes 0..1 of one pixel, alpha divided out of the colour and itself left linear.
fn unassociated_codes(pixel: &[f32]) -> impl Iterator<Item = f32> + use<> {
    let alpha = pixel.get(3).map(|a| a.clamp(0.0, 1.0));
    let colour = |c: f32| match alpha {
        Some(0.0) => 0.0,
        Some(alpha) => code_of(c / alpha),
        None => code_of(c),
    };
    [colour(pixel[0]), colour(pixel[1]), colour(pixel[2])].into_iter().chain(alpha)
}

/// Light clamped to 0..1, as an sRGB code 0..1.
fn code_of(light: f32) -> f32 {
    srgb::encode(light.clamp(0.0, 1.0))
}

fn write_jpeg(writer: impl Write + Seek, image: &Image) -> std::result::Result<(), ImageError> {
    let (width, height) = size_u32(image);
    let pixels = image.data().chunks_exact(image.channels());
    let bytes: Vec<u8> = pixels.flat_map(|p| [p[0], p[1], p[2]]).map(|c| (code_of(c) * 255.0).round() as u8).collect();
    JpegEncoder::new_with_quality(writer, JPEG_QUALITY).write_image(&bytes, width, height, ExtendedColorType::Rgb8)
}

fn write_hdr(writer: impl Write, image: &Image) -> std::result::Result<(), ImageError> {
    let pixels: Vec<Rgb<f32>> =
        image.data().chunks_exact(image.channels()).map(|p| Rgb(nearest_rgbe([p[0], p[1], p[2]]))).collect();
    HdrEncoder::new(writer).encode(&pixels, image.width(), image.height())
}

/// The nearest colour that RGBE (G. Ward, "Real Pixels", Graphics Gems II, 1991) holds exactly: 8-bit mantissas that
/// share the exponent of the largest channel. The encoder of the `image` crate truncates and no reader adds the half
/// step back, which would darken a picture by 0.3 % on average; of what is rounded beforehand it cuts nothing off.
fn nearest_rgbe(colour: [f32; 3]) -> [f32; 3] {
    /// 255 * 2^(255 - 136), the largest number of RGBE.
    const MAX: f32 = 255.0 * (1u128 << 119) as f32;
    /// 2^-126, the smallest normal number of f32; two binades below it exponents wrap around in the encoder.
    const MIN: f32 = f32::MIN_POSITIVE;
    let colour = colour.map(|c| c.clamp(0.0, MAX));
    let largest = colour[0].max(colour[1]).max(colour[2]);
    if largest < MIN {
        return [0.0; 3];
    }
    // The exponent of f32 itself: largest lies in [2^exponent, 2^(exponent + 1)).
    let exponent = (largest.to_bits() >> 23) as i32 - 127;
    let mut step = 2f64.powi(exponent - 7);
    // A mantissa that rounds to 256 moves the pixel to the next exponent.
    if (f64::from(largest) / step).round() >= 256.0 {
        step *= 2.0;
    }
    colour.map(|c| ((f64::from(c) / step).round() * step) as f32)
}

fn failure(path: &Path, error: ImageError) -> Error {
    match error {
        ImageError::IoError(source) => Error::io("write", path, source),
        other => Error::invalid(
            path.display().to_string(),
            other.to_string(),
            "a picture that the chosen file type can hold",
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Encoding, read};
    use super::*;

    fn ramp(scale: f32) -> Image {
        Image::from_fn(31, 17, |x, y| [x as f32 / 30.0, y as f32 / 16.0, (x * y) as f32 / 480.0].map(|c| c * scale))
    }

    fn round_trip(name: &str, image: &Image, options: EncodeOptions) -> Image {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(name);
        write(&path, image, options).unwrap();
        read(&path, Encoding::Auto).unwrap()
    }

    fn largest_difference(a: &Image, b: &Image) -> f32 {
        assert_eq!((a.size(), a.channels()), (b.size(), b.channels()));
        a.data().iter().zip(b.data()).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
    }

    #[test]
    fn float_types_keep_every_bit() {
        let image = Image::from_fn(31, 17, |x, y| [x as f32 - 12.3, 1e-20 * y as f32, 1e20 * x as f32]);
        for name in ["a.exr", "a.tif", "b.TIFF"] {
            assert_eq!(round_trip(name, &image, EncodeOptions::default()), image, "{name}");
        }
        let alpha = Image::from_data(2, 1, 4, vec![0.5, 0.25, 0.1, 0.5, 3.0, 0.1, 0.2, 0.0]).unwrap();
        for name in ["a.exr", "a.tif"] {
            assert_eq!(round_trip(name, &alpha, EncodeOptions::default()), alpha, "{name}");
        }
    }

    #[test]
    fn png_keeps_its_bits() {
        // Half a code, times the largest slope of the decoding curve: 2.4 / 1.055 < 2.28 at white.
        let wide = round_trip("a.png", &ramp(1.0), EncodeOptions::default());
        assert!(largest_difference(&wide, &ramp(1.0)) < 2.28 * 0.5 / 65535.0 + 1e-6);
        let narrow = round_trip("a.png", &ramp(1.0), EncodeOptions { png8: true, ..Default::default() });
        let difference = largest_difference(&narrow, &ramp(1.0));
        assert!(difference < 2.28 * 0.5 / 255.0 + 1e-6 && difference > 1.0 / 65535.0, "{difference}");
    }

    #[test]
    fn png_and_jpeg_clamp() {
        let image = Image::from_fn(16, 16, |_, _| [-1.0, 0.0, 7.0]);
        assert_eq!(round_trip("a.png", &image, EncodeOptions::default()).pixel(3, 3), [0.0, 0.0, 1.0]);
        let jpeg = round_trip("a.jpg", &image, EncodeOptions::default());
        let pixel = jpeg.pixel(3, 3);
        assert!(pixel[0] < 0.01 && pixel[1] < 0.01 && pixel[2] > 0.97, "{pixel:?}");
    }

    #[test]
    fn png_alpha_is_divided_out_and_back() {
        let image =
            Image::from_data(3, 1, 4, vec![0.2, 0.1, 0.05, 0.5, 0.0, 0.0, 0.0, 0.0, 0.9, 0.5, 0.0, 1.0]).unwrap();
        assert!(largest_difference(&round_trip("a.png", &image, EncodeOptions::default()), &image) < 3e-5);
        // Read as codes: the colour in the file is 0.2 / 0.5 = 0.4, sRGB code 0.6652, not 0.2.
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        write(&path, &image, EncodeOptions::default()).unwrap();
        let codes = ::image::open(&path).unwrap().into_rgba16();
        assert!((f32::from(codes.get_pixel(0, 0).0[0]) / 65535.0 - 0.665_185).abs() < 1e-4);
        assert_eq!(codes.get_pixel(0, 0).0[3], 32768);
    }

    #[test]
    fn jpeg_is_close() {
        let image = Image::from_fn(64, 48, |x, y| [0.2 + x as f32 / 128.0, 0.2 + y as f32 / 96.0, 0.4]);
        let difference = largest_difference(&round_trip("a.jpeg", &image, EncodeOptions::default()), &image);
        assert!(difference < 0.04, "{difference}");
    }

    #[test]
    fn radiance_is_rounded_to_the_nearest_without_bias() {
        for scale in [1e-30, 1e-3, 1.0, 12345.0, 1e30] {
            let image = ramp(scale);
            let back = round_trip("a.hdr", &image, EncodeOptions::default());
            let (mut sum, mut sum_back) = (0.0, 0.0);
            for (a, b) in back.data().chunks(3).zip(image.data().chunks(3)) {
                let largest = b[0].max(b[1]).max(b[2]);
                for c in 0..3 {
                    // Half a step of an 8-bit mantissa that lies in 128..255.
                    assert!((a[c] - b[c]).abs() <= largest * (0.5 / 128.0) * 1.0001, "{a:?} is not {b:?}");
                    sum += f64::from(b[c]);
                    sum_back += f64::from(a[c]);
                }
            }
            assert!((sum_back / sum - 1.0).abs() < 5e-4, "scale {scale}: energy {}", sum_back / sum);
        }
    }

    #[test]
    fn radiance_ends_gracefully() {
        let image = Image::from_fn(9, 2, |x, _| [[f32::MAX, 1.0, -3.0], [1e-40, 0.0, 0.0], [0.9999, 0.5, -0.1]][x % 3]);
        let back = round_trip("a.hdr", &image, EncodeOptions::default());
        assert_eq!(back.pixel(0, 0), [255.0 * 2f32.powi(119), 0.0, 0.0]);
        assert_eq!(back.pixel(1, 0), [0.0; 3]);
        assert_eq!(back.pixel(2, 0), [1.0, 0.5, 0.0]);
    }

    #[test]
    fn previews_are_8_bit_png() {
        let image = Image::from_data(2, 1, 4, vec![0.5, 0.25, 0.125, 0.5, 1.0, 1.0, 1.0, 1.0]).unwrap();
        let bytes = encode_png8(&image).unwrap();
        let picture = ::image::load_from_memory(&bytes).unwrap();
        assert_eq!(picture.color(), ::image::ColorType::Rgba8);
        assert_eq!(picture.into_rgba8().get_pixel(0, 0).0, [255, 188, 137, 128]);
        assert!(encode_png8(&Image::new(0, 3, 3)).is_err());
    }

    #[test]
    fn unknown_extensions_get_the_list() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["a.bmp", "a"] {
            let path = folder.path().join(name);
            let message = write(&path, &ramp(1.0), EncodeOptions::default()).unwrap_err().to_string();
            assert!(message.contains(".exr, .hdr, .png, .tif"), "{message}");
        }
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    }

    #[test]
    fn nothing_is_left_of_what_fails() {
        let folder = tempfile::tempdir().unwrap();
        let mut nan = ramp(1.0);
        nan.pixel_mut(5, 4)[2] = f32::NAN;
        for name in ["a.exr", "a.hdr", "a.png", "a.tif", "a.jpg"] {
            let absent = folder.path().join("absent").join(name);
            let message = write(&absent, &ramp(1.0), EncodeOptions::default()).unwrap_err().to_string();
            assert!(message.contains("does not exist"), "{message}");
            let path = folder.path().join(name);
            let message = write(&path, &nan, EncodeOptions::default()).unwrap_err().to_string();
            assert!(message.contains(name) && message.contains("pixel (5, 4), channel B"), "{message}");
        }
        // JPEG holds 65535 columns: the encoder fails after the file was begun.
        let wide = Image::new(70_000, 1, 3);
        assert!(write(&folder.path().join("wide.jpg"), &wide, EncodeOptions::default()).is_err());
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    }
}
