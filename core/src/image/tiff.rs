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
