//! TIFF, in and out. The `tiff` crate is used directly because its tags tell associated from unassociated alpha.

use std::fs::File;
use std::io::{BufRead, BufReader, Seek, Write};
use std::path::Path;

use ::tiff::decoder::{Decoder, DecodingResult, Limits};
use ::tiff::encoder::{TiffEncoder, TiffKind, colortype};
use ::tiff::tags::{ExtraSamples, Tag};
use ::tiff::{ColorType, TiffError};

use super::Image;
use super::stored::{Alpha, MAX_PIXELS, Samples, Stored, check_size};
use crate::error::{Error, Result};

/// Reads the first picture of a TIFF file: grey or RGB, with or without alpha, 8 or 16 bits, half, float or double.
///
/// # Errors
/// Damaged, truncated or too large files; palettes, CMYK and other sample types.
pub(super) fn read(path: &Path, file: BufReader<File>) -> Result<Stored> {
    let failed = |error| failure(path, error);
    let mut decoder = Decoder::new(file).map_err(failed)?;
    let (width, height) = decoder.dimensions().map_err(failed)?;
    let (width, height) = (width as usize, height as usize);
    check_size(path, width, height)?;
    let (channels, alpha) = layout(path, &mut decoder)?;
    let mut limits = Limits::default();
    // Four doubles for each pixel of the largest picture.
    limits.decoding_buffer_size = 32 * MAX_PIXELS;
    limits.intermediate_buffer_size = 32 * MAX_PIXELS;
    let mut decoder = decoder.with_limits(limits);
    let mut buffer = DecodingResult::U8(Vec::new());
    let planes = decoder.read_image_to_buffer(&mut buffer).map_err(failed)?.planes;
    let samples = match buffer {
        DecodingResult::U8(v) => Samples::U8(interleaved(v, planes)),
        DecodingResult::U16(v) => Samples::U16(interleaved(v, planes)),
        DecodingResult::F16(v) => Samples::F32(interleaved(v, planes).into_iter().map(f32::from).collect()),
        DecodingResult::F32(v) => Samples::F32(interleaved(v, planes)),
        DecodingResult::F64(v) => Samples::F32(interleaved(v, planes).into_iter().map(|s| s as f32).collect()),
        _ => return Err(unsupported(path, "samples that are neither unsigned 8 or 16 bits nor float")),
    };
    Ok(Stored { width, height, channels, alpha, samples })
}

/// Width and height from the header.
///
/// # Errors
/// Damaged headers.
pub(super) fn probe_size(path: &Path, file: impl BufRead + Seek) -> Result<(usize, usize)> {
    let (width, height) = Decoder::new(file).and_then(|mut d| d.dimensions()).map_err(|error| failure(path, error))?;
    Ok((width as usize, height as usize))
}

/// Channels per pixel, and what the alpha tag says.
fn layout(path: &Path, decoder: &mut Decoder<BufReader<File>>) -> Result<(usize, Alpha)> {
    let failed = |error| failure(path, error);
    let color = decoder.colortype().map_err(failed)?;
    let channels = match color {
        ColorType::Gray(_) => 1,
        ColorType::GrayA(_) => 2,
        ColorType::RGB(_) => 3,
        ColorType::RGBA(_) => 4,
        other => return Err(unsupported(path, format!("the colour type {other:?}"))),
    };
    if !matches!(color.bit_depth(), 8 | 16 | 32 | 64) {
        return Err(unsupported(path, format!("{} bits per sample", color.bit_depth())));
    }
    let stored = decoder.find_tag_unsigned::<u16>(Tag::SamplesPerPixel).map_err(failed)?.unwrap_or(1);
    if usize::from(stored) != channels {
        return Err(unsupported(path, format!("{stored} samples per pixel of the colour type {color:?}")));
    }
    let extra = decoder.find_tag_unsigned_vec::<u16>(Tag::ExtraSamples).map_err(failed)?.unwrap_or_default();
    let associated = extra.first() == Some(&ExtraSamples::AssociatedAlpha.to_u16());
    Ok((channels, if associated { Alpha::Associated } else { Alpha::Unassociated }))
}

/// Planes one after another (`PlanarConfiguration` 2) -> samples of a pixel side by side.
fn interleaved<T: Copy>(samples: Vec<T>, planes: usize) -> Vec<T> {
    if planes < 2 {
        return samples;
    }
    let pixels = samples.len() / planes;
    (0..pixels)
        .flat_map(|pixel| (0..planes).map(move |plane| (pixel, plane)))
        .map(|(i, p)| samples[p * pixels + i])
        .collect()
}

/// Writes 32-bit float, linear, uncompressed; alpha, when there, is tagged as associated.
///
/// # Errors
/// The disk's.
pub(super) fn write(path: &Path, writer: impl Write + Seek, image: &Image) -> Result<()> {
    let failed = |error| match error {
        TiffError::IoError(source) => Error::io("write", path, source),
        other => Error::invalid(path.display().to_string(), other.to_string(), "a picture that fits a TIFF file"),
    };
    // Offsets of plain TIFF have 32 bits.
    if size_of_val(image.data()) < (u32::MAX - (1 << 20)) as usize {
        encode(TiffEncoder::new(writer).map_err(failed)?, image).map_err(failed)
    } else {
        encode(TiffEncoder::new_big(writer).map_err(failed)?, image).map_err(failed)
    }
}

fn encode<W: Write + Seek, K: TiffKind>(
    mut encoder: TiffEncoder<W, K>,
    image: &Image,
) -> std::result::Result<(), TiffError> {
    let (width, height) = (u32::try_from(image.width())?, u32::try_from(image.height())?);
    let mut picture = encoder.new_image::<colortype::RGB32Float>(width, height)?;
    if image.channels() == 4 {
        picture.extra_samples(&[ExtraSamples::AssociatedAlpha])?;
    }
    picture.write_data(image.data())
}

fn failure(path: &Path, error: TiffError) -> Error {
    let invalid = |found: String| Error::invalid(path.display().to_string(), found, "a whole TIFF file");
    match error {
        TiffError::IoError(source) if source.kind() == std::io::ErrorKind::UnexpectedEof => {
            invalid("the end of the file".to_owned())
        }
        TiffError::IoError(source) => Error::io("read", path, source),
        TiffError::UnsupportedError(what) => unsupported(path, what.to_string()),
        other => invalid(other.to_string()),
    }
}

fn unsupported(path: &Path, what: impl Into<String>) -> Error {
    Error::Unsupported {
        place: path.display().to_string(),
        what: what.into(),
        advice: "convert the file to RGB TIFF of 8 or 16 bits or float, or to OpenEXR".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use ::tiff::encoder::TiffValue;

    use super::super::{Encoding, read};
    use super::*;

    fn file<C: colortype::ColorType>(folder: &Path, extra: &[ExtraSamples], data: &[C::Inner]) -> PathBuf
    where
        [C::Inner]: TiffValue,
    {
        let path = folder.join("a.tif");
        let mut encoder = TiffEncoder::new(File::create(&path).unwrap()).unwrap();
        let mut picture = encoder.new_image::<C>(2, 1).unwrap();
        if !extra.is_empty() {
            picture.extra_samples(extra).unwrap();
        }
        picture.write_data(data).unwrap();
        path
    }

    fn linear(path: PathBuf) -> Vec<f32> {
        let image = read(&path, Encoding::Linear).unwrap();
        assert_eq!(super::super::probe_size(&path).unwrap(), (2, 1));
        assert_eq!(image.size(), (2, 1));
        image.data().to_vec()
    }

    fn assert_close(found: &[f32], expected: &[f32]) {
        assert_eq!(found.len(), expected.len(), "{found:?} is not {expected:?}");
        assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6), "{found:?} is not {expected:?}");
    }

    #[test]
    fn grey_and_colour_of_8_16_and_float() {
        let folder = tempfile::tempdir().unwrap();
        let at = folder.path();
        let grey = [0.2, 0.2, 0.2, 1.0, 1.0, 1.0];
        assert_close(&linear(file::<colortype::Gray8>(at, &[], &[51, 255])), &grey);
        assert_close(&linear(file::<colortype::Gray16>(at, &[], &[13107, 65535])), &grey);
        assert_close(&linear(file::<colortype::Gray32Float>(at, &[], &[0.2, 1.0])), &grey);
        assert_close(&linear(file::<colortype::Gray64Float>(at, &[], &[0.2, 1.0])), &grey);
        let colour = [0.0, 0.2, 1.0, 0.4, 0.6, 0.8];
        assert_close(&linear(file::<colortype::RGB8>(at, &[], &[0, 51, 255, 102, 153, 204])), &colour);
        let words = [0, 51, 255, 102, 153, 204].map(|s| s * 257);
        assert_close(&linear(file::<colortype::RGB16>(at, &[], &words)), &colour);
        let floats = [-2.0, 0.2, 100.0, 0.4, 0.6, 0.8];
        assert_close(&linear(file::<colortype::RGB32Float>(at, &[], &floats)), &floats);
    }

    #[test]
    fn the_tag_tells_associated_from_unassociated_alpha() {
        let folder = tempfile::tempdir().unwrap();
        let data = [0.5, 0.25, 0.0, 0.5, 1.0, 1.0, 1.0, 1.0];
        let multiplied = [0.25, 0.125, 0.0, 0.5, 1.0, 1.0, 1.0, 1.0];
        let with = |extra| linear(file::<colortype::RGB32Float>(folder.path(), &[extra], &data));
        assert_close(&with(ExtraSamples::AssociatedAlpha), &data);
        assert_close(&with(ExtraSamples::UnassociatedAlpha), &multiplied);
        // Without the tag the fourth sample can only be guessed; most writers mean unassociated alpha.
        assert_close(&linear(file::<colortype::RGBA32Float>(folder.path(), &[], &data)), &multiplied);
    }

    #[test]
    fn other_sample_and_colour_types_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let uint = file::<colortype::RGB32>(folder.path(), &[], &[1; 6]);
        assert!(matches!(read(&uint, Encoding::Auto), Err(Error::Unsupported { .. })));
        let cmyk = file::<colortype::CMYK8>(folder.path(), &[], &[1; 8]);
        let message = read(&cmyk, Encoding::Auto).unwrap_err().to_string();
        assert!(message.contains("CMYK") && message.contains("convert"), "{message}");
    }

    #[test]
    fn planes_are_interleaved() {
        assert_eq!(interleaved(vec![1, 2, 3, 10, 20, 30], 2), [1, 10, 2, 20, 3, 30]);
        assert_eq!(interleaved(vec![1, 2, 3], 1), [1, 2, 3]);
    }
}
