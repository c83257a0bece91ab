//! OpenEXR, in and out.
//!
//! Reading takes the blocks of one part only, so that picking one picture out of a file with hundreds costs no more
//! memory than that picture. Blocks are decompressed in batches on the global thread pool: the `exr` crate would start
//! a pool per file, and a panic inside it would abort the process.

use std::fs::File;
use std::io::{BufReader, Read, Seek, Write};
use std::path::Path;

use ::exr::block::UncompressedBlock;
use ::exr::block::chunk::Chunk;
use ::exr::block::lines::LineRef;
use ::exr::block::reader::{ChunksReader, Reader};
use ::exr::error::Error as ExrError;
use ::exr::math::Vec2;
use ::exr::meta::MetaData;
use ::exr::meta::attribute::{Chromaticities, SampleType};
use ::exr::meta::header::Header;
use ::exr::prelude as exrs;
use ::exr::prelude::WritableImage;
use half::f16;
use half::slice::HalfFloatSliceExt;
use rayon::prelude::*;

use super::stored::{Alpha, Samples, Stored, check_size};
use super::{EncodeOptions, Image};
use crate::error::{Error, Result};

/// Blocks decompressed together: enough for every thread, little enough memory.
const BATCH: usize = 64;

/// The most that one uncompressed block may claim, 1 GiB; a 16384 x 256 block of 60 float channels fits.
const MAX_BLOCK_BYTES: usize = 1 << 30;

/// Which part of the file, which of its channels, and where its data window lies in the display window.
struct Plan {
    part: usize,
    /// For each channel of the part: its place in the interleaved pixel.
    slots: Vec<Option<usize>>,
    types: Vec<SampleType>,
    channels: usize,
    width: usize,
    height: usize,
    /// Data window minus display window.
    offset: (i64, i64),
}

/// Reads the part [`super::read`] describes, cropped or zero-padded to the display window.
///
/// # Errors
/// Damaged, truncated or too large files; deep data; subsampled channels; parts without a picture.
pub(super) fn read(path: &Path, file: BufReader<File>) -> Result<Stored> {
    let failed = |error| failure(path, error);
    let reader = Reader::read_from_buffered(file, false).map_err(failed)?;
    let plan = Plan::new(path, reader.meta_data())?;
    let chunks = reader
        .filter_chunks(false, |_, tile, block| block.layer == plan.part && tile.level_index == Vec2(0, 0))
        .map_err(failed)?;
    let meta = chunks.meta_data().clone();
    let mut samples = vec![0.0; plan.width * plan.height * plan.channels];
    let mut chunks = chunks.peekable();
    while chunks.peek().is_some() {
        let batch: Vec<Chunk> = chunks.by_ref().take(BATCH).collect::<Result<_, ExrError>>().map_err(failed)?;
        let blocks: Vec<UncompressedBlock> = batch
            .into_par_iter()
            .map(|chunk| UncompressedBlock::decompress_chunk(chunk, &meta, false))
            .collect::<Result<_, ExrError>>()
            .map_err(failed)?;
        for block in &blocks {
            plan.place(path, &meta.headers[plan.part], block, &mut samples)?;
        }
    }
    let Plan { width, height, channels, .. } = plan;
    Ok(Stored { width, height, channels, alpha: Alpha::Associated, samples: Samples::F32(samples) })
}

/// Width and height of the display window.
///
/// # Errors
/// Damaged headers; files [`read`] would refuse for their channels.
pub(super) fn probe_size(path: &Path, file: impl Read + Seek) -> Result<(usize, usize)> {
    let reader = Reader::read_from_buffered(file, false).map_err(|error| failure(path, error))?;
    let plan = Plan::new(path, reader.meta_data())?;
    Ok((plan.width, plan.height))
}

impl Plan {
    fn new(path: &Path, meta: &MetaData) -> Result<Self> {
        let found = meta.headers.iter().enumerate().find_map(|(i, h)| Some((i, colour_channels(h)?)));
        let (part, names) = match found.or_else(|| Some((0, grey_channels(meta.headers.first()?)?))) {
            Some(found) => found,
            None => return Err(no_picture(path, meta)),
        };
        let header = &meta.headers[part];
        let list = &header.channels.list;
        let slots: Vec<_> = list.iter().map(|c| names.iter().position(|n| *n == c.name.to_string())).collect();
        if let Some((channel, _)) =
            list.iter().zip(&slots).find(|(c, s)| s.is_some() && c.sampling != Vec2(1, 1)).or_else(|| {
                // The crate lays out blocks as if no channel were subsampled: a foreign one would shift ours.
                list.iter().zip(&slots).find(|(c, _)| c.sampling != Vec2(1, 1))
            })
        {
            return Err(unsupported(path, format!("the subsampled channel {}", channel.name)));
        }
        let display = header.shared_attributes.display_window;
        let (width, height) = (display.size.0, display.size.1);
        check_size(path, width, height)?;
        check_size(path, header.layer_size.0, header.layer_size.1)?;
        check_block(path, header)?;
        let data = header.own_attributes.layer_position;
        let offset =
            (i64::from(data.0) - i64::from(display.position.0), i64::from(data.1) - i64::from(display.position.1));
        let types = list.iter().map(|c| c.sample_type).collect();
        Ok(Self { part, slots, types, channels: names.len(), width, height, offset })
    }

    /// Copies the lines of a block to where they lie in the display window.
    fn place(&self, path: &Path, header: &Header, block: &UncompressedBlock, out: &mut [f32]) -> Result<()> {
        // An offset table that lies may lead to the blocks of another part or level.
        if block.index.layer != self.part || block.index.level != Vec2(0, 0) {
            return Err(Error::invalid(
                path.display().to_string(),
                "an offset table that points to blocks of another part",
                "a whole OpenEXR file",
            ));
        }
        let mut values = vec![0.0; block.index.pixel_size.0];
        let mut halves = vec![f16::ZERO; block.index.pixel_size.0];
        for line in block.lines(&header.channels) {
            let Some(slot) = self.slots[line.location.channel] else { continue };
            let y = line.location.position.1 as i64 + self.offset.1;
            if y < 0 || y >= self.height as i64 {
                continue;
            }
            let x0 = line.location.position.0 as i64 + self.offset.0;
            samples_of(line, self.types[line.location.channel], &mut values, &mut halves)
                .map_err(|error| failure(path, error))?;
            let (first, last) = (x0.max(0), (x0 + values.len() as i64).min(self.width as i64));
            let row = y as usize * self.width;
            for x in first..last {
                out[(row + x as usize) * self.channels + slot] = values[(x - x0) as usize];
            }
        }
        Ok(())
    }
}

/// One line of any sample type as f32. The slices are as long as the line.
fn samples_of(
    line: LineRef<'_>,
    sample_type: SampleType,
    values: &mut [f32],
    halves: &mut [f16],
) -> Result<(), ExrError> {
    match sample_type {
        SampleType::F32 => line.read_samples_into_slice(values)?,
        SampleType::F16 => {
            line.read_samples_into_slice(halves)?;
            halves.convert_to_f32_slice(values);
        }
        SampleType::U32 => {
            for (value, sample) in values.iter_mut().zip(line.read_samples::<u32>()) {
                *value = sample? as f32;
            }
        }
    }
    Ok(())
}

/// Names of the R, G, B and, where there is one, A channels: without a layer name, else of the first layer (in the
/// file's order, alphabetical) that has all three.
fn colour_channels(header: &Header) -> Option<Vec<String>> {
    let names: Vec<String> = header.channels.list.iter().map(|c| c.name.to_string()).collect();
    let layers = names.iter().filter_map(|name| name.strip_suffix(".R").map(|layer| format!("{layer}.")));
    std::iter::once(String::new()).chain(layers).find_map(|layer| with_alpha(&names, &layer, &["R", "G", "B"]))
}

/// Names of a luminance channel and its alpha; a part of one single channel is grey, whatever that one is called.
fn grey_channels(header: &Header) -> Option<Vec<String>> {
    let names: Vec<String> = header.channels.list.iter().map(|c| c.name.to_string()).collect();
    if let [only] = &names[..] {
        return Some(vec![only.clone()]);
    }
    // With RY and BY beside it, luminance is but a third of a colour picture.
    if names.iter().any(|name| name == "RY" || name == "BY") {
        return None;
    }
    let layers = names.iter().filter_map(|name| name.strip_suffix(".Y").map(|layer| format!("{layer}.")));
    std::iter::once(String::new()).chain(layers).find_map(|layer| with_alpha(&names, &layer, &["Y"]))
}

fn with_alpha(names: &[String], layer: &str, wanted: &[&str]) -> Option<Vec<String>> {
    let mut found: Vec<String> = wanted.iter().map(|channel| format!("{layer}{channel}")).collect();
    if !found.iter().all(|name| names.contains(name)) {
        return None;
    }
    let alpha = format!("{layer}A");
    if names.contains(&alpha) {
        found.push(alpha);
    }
    Some(found)
}

/// Refuses blocks that would uncompress to more than [`MAX_BLOCK_BYTES`].
fn check_block(path: &Path, header: &Header) -> Result<()> {
    let Vec2(width, height) = header.max_block_pixel_size();
    let area = width.min(header.layer_size.0).checked_mul(height.min(header.layer_size.1));
    match area.and_then(|area| area.checked_mul(header.channels.bytes_per_pixel)) {
        Some(bytes) if bytes <= MAX_BLOCK_BYTES => Ok(()),
        _ => Err(Error::invalid(
            path.display().to_string(),
            format!("blocks of {width} x {height} pixels with {} channels", header.channels.list.len()),
            format!("at most {MAX_BLOCK_BYTES} bytes in a block"),
        )),
    }
}

fn no_picture(path: &Path, meta: &MetaData) -> Error {
    let names: Vec<String> =
        meta.headers.iter().flat_map(|h| &h.channels.list).take(12).map(|c| c.name.to_string()).collect();
    if names.iter().any(|name| name == "RY" || name == "BY") {
        return unsupported(path, "subsampled chroma (channels Y, RY, BY)".to_owned());
    }
    Error::invalid(
        path.display().to_string(),
        format!("the channels {}", names.join(", ")),
        "R, G, B (with or without a layer name), Y, or a single channel",
    )
}

/// Writes one part of half or float R, G, B (and A), ZIP-compressed scan lines, with the primaries of Rec. 709. Halves
/// beyond the largest, 65504, are clamped to it: an infinity could not be read back.
///
/// # Errors
/// The disk's.
pub(super) fn write(path: &Path, writer: impl Write + Seek, image: &Image, options: EncodeOptions) -> Result<()> {
    let channels = (0..image.channels()).map(|c| {
        let samples = image.data().iter().skip(c).step_by(image.channels());
        let samples = if options.half {
            let max = f16::MAX.to_f32();
            exrs::FlatSamples::F16(samples.map(|s| f16::from_f32(s.clamp(-max, max))).collect())
        } else {
            exrs::FlatSamples::F32(samples.copied().collect())
        };
        exrs::AnyChannel::new(["R", "G", "B", "A"][c], samples)
    });
    let encoding = exrs::Encoding {
        compression: exrs::Compression::ZIP16,
        blocks: exrs::Blocks::ScanLines,
        line_order: exrs::LineOrder::Increasing,
    };
    let layer = exrs::Layer::new(
        image.size(),
        exrs::LayerAttributes::default(),
        encoding,
        exrs::AnyChannels::sort(channels.collect()),
    );
    let mut picture = exrs::Image::from_layer(layer);
    picture.attributes.chromaticities = Some(REC709);
    picture.write().to_buffered(writer).map_err(|error| match error {
        ExrError::Io(source) => Error::io("write", path, source),
        other => Error::invalid(path.display().to_string(), other.to_string(), "a picture that fits an OpenEXR file"),
    })
}

/// Primaries and white of ITU-R BT.709.
const REC709: Chromaticities = Chromaticities {
    red: Vec2(0.64, 0.33),
    green: Vec2(0.30, 0.60),
    blue: Vec2(0.15, 0.06),
    white: Vec2(0.3127, 0.3290),
};

fn failure(path: &Path, error: ExrError) -> Error {
    match error {
        ExrError::Io(source) => Error::io("read", path, source),
        ExrError::NotSupported(what) => unsupported(path, what.into_owned()),
        other => Error::invalid(path.display().to_string(), other.to_string(), "a whole OpenEXR file"),
    }
}

fn unsupported(path: &Path, what: String) -> Error {
    Error::Unsupported {
        place: path.display().to_string(),
        what,
        advice: "convert the file to flat R, G, B channels of half or float".to_owned(),
    }
}
