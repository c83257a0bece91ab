//! OpenEXR, in and out.
//!
//! Reading takes the blocks of one part only, so that picking one picture out of a file with hundreds costs no more
//! memory than that picture. Blocks are decompressed in batches on the global thread pool: the `exr` crate would start
//! a pool per file, and a panic inside it would abort the process.

use std::fs::File;
use std::io::{BufReader, Read, Seek, Write};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

use ::exr::block::UncompressedBlock;
use ::exr::block::chunk::{Chunk, CompressedBlock, CompressedScanLineBlock, CompressedTileBlock};
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
use super::{ColourSpace, EncodeOptions, Image, Primaries};
use crate::error::{Error, Result};

/// Blocks decompressed together: enough for every thread, little enough memory.
pub(super) const BATCH: usize = 64;

/// The most that one uncompressed block may claim, 1 GiB; a 16384 x 256 block of 60 float channels fits.
const MAX_BLOCK_BYTES: usize = 1 << 30;

/// A part of a file, checked: where its data window lies in the display window, and what its channels hold.
pub(super) struct Part {
    index: usize,
    types: Vec<SampleType>,
    width: usize,
    height: usize,
    /// Data window minus display window.
    offset: (i64, i64),
}

/// Which part of the file, and which of its channels.
struct Plan {
    part: Part,
    /// For each channel of the part: its place in the interleaved pixel.
    slots: Vec<Option<usize>>,
    channels: usize,
}

/// Reads the part [`super::read`] describes, cropped or zero-padded to the display window.
///
/// # Errors
/// Damaged, truncated or too large files; deep data; subsampled channels; parts without a picture.
pub(super) fn read(path: &Path, file: BufReader<File>) -> Result<Stored> {
    caught(path, || read_unguarded(path, file))
}

/// Width and height of the display window.
///
/// # Errors
/// Damaged headers; files [`read`] would refuse for their channels.
pub(super) fn probe_size(path: &Path, file: impl Read + Seek) -> Result<(usize, usize)> {
    caught(path, || {
        let reader = Reader::read_from_buffered(file, false).map_err(|error| failure(path, error))?;
        Ok(Plan::new(path, reader.meta_data())?.part.size())
    })
}

/// Turns a panic of the decoder into an error. Damaged files do make `exr` 1.74.2 panic where overflow is checked, as in
/// debug builds (`compression/b44/mod.rs`, `unpack14`: "attempt to subtract with overflow"; found by the test of
/// mutated files). What the closure may have left broken, it owned.
pub(super) fn caught<T>(path: &Path, body: impl FnOnce() -> Result<T>) -> Result<T> {
    catch_unwind(AssertUnwindSafe(body)).unwrap_or_else(|_| {
        Err(Error::invalid(path.display().to_string(), "data that the decoder gave up on", "a whole OpenEXR file"))
    })
}

fn read_unguarded(path: &Path, file: BufReader<File>) -> Result<Stored> {
    let failed = |error| failure(path, error);
    let reader = Reader::read_from_buffered(file, false).map_err(failed)?;
    let plan = Plan::new(path, reader.meta_data())?;
    let chunks = reader
        .filter_chunks(false, |_, tile, block| block.layer == plan.part.index && tile.level_index == Vec2(0, 0))
        .map_err(failed)?;
    let meta = chunks.meta_data().clone();
    let (width, height) = plan.part.size();
    let mut samples = vec![0.0; width * height * plan.channels];
    let mut chunks = chunks.peekable();
    while chunks.peek().is_some() {
        let batch: Vec<Chunk> = chunks.by_ref().take(BATCH).collect::<Result<_, ExrError>>().map_err(failed)?;
        for block in &decompressed(path, &meta, batch, |part| part == plan.part.index)? {
            plan.place(path, &meta.headers[plan.part.index], block, &mut samples)?;
        }
    }
    let channels = plan.channels;
    Ok(Stored { width, height, channels, alpha: Alpha::Associated, samples: Samples::F32(samples) })
}

/// Decompresses blocks on all threads. Those of parts that nobody `asked` for were not checked, and are refused.
pub(super) fn decompressed(
    path: &Path,
    meta: &MetaData,
    batch: Vec<Chunk>,
    asked: impl Fn(usize) -> bool,
) -> Result<Vec<UncompressedBlock>> {
    for chunk in &batch {
        match meta.headers.get(chunk.layer_index).filter(|_| asked(chunk.layer_index)) {
            Some(header) => check_dwa(path, header, chunk)?,
            // An offset table that lies may lead to the blocks of another part or level.
            None => return Err(astray(path)),
        }
    }
    let block = |chunk| UncompressedBlock::decompress_chunk(chunk, meta, false);
    batch.into_par_iter().map(block).collect::<Result<_, ExrError>>().map_err(|error| failure(path, error))
}

fn astray(path: &Path) -> Error {
    let found = "an offset table that points to blocks of another part";
    Error::invalid(path.display().to_string(), found, "a whole OpenEXR file")
}

impl Plan {
    fn new(path: &Path, meta: &MetaData) -> Result<Self> {
        let found = meta.headers.iter().enumerate().find_map(|(i, h)| Some((i, colour_channels(h)?)));
        let (part, names) = match found.or_else(|| Some((0, grey_channels(meta.headers.first()?)?))) {
            Some(found) => found,
            None => return Err(no_picture(path, meta)),
        };
        let list = &meta.headers[part].channels.list;
        let slots: Vec<_> = list.iter().map(|c| names.iter().position(|n| *n == c.name.to_string())).collect();
        Ok(Self { part: Part::new(path, meta, part)?, slots, channels: names.len() })
    }

    /// Copies the lines of a block to where they lie in the display window.
    fn place(&self, path: &Path, header: &Header, block: &UncompressedBlock, out: &mut [f32]) -> Result<()> {
        let wanted = |channel: usize| self.slots[channel].is_some();
        self.part.lines(path, header, block, wanted, |channel, first, values| {
            let Some(slot) = self.slots[channel] else { return };
            let pixels = out[first * self.channels + slot..].iter_mut().step_by(self.channels);
            pixels.zip(values).for_each(|(out, value)| *out = *value);
        })
    }
}

impl Part {
    /// Checks the sizes and channels of a part before anything is allocated for it.
    pub(super) fn new(path: &Path, meta: &MetaData, index: usize) -> Result<Self> {
        let header = &meta.headers[index];
        let list = &header.channels.list;
        // `exr` 1.74 refuses these itself; a version that does not must not find us copying short lines.
        if let Some(channel) = list.iter().find(|c| c.sampling != Vec2(1, 1)) {
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
        Ok(Self { index, types: list.iter().map(|c| c.sample_type).collect(), width, height, offset })
    }

    /// Width and height of the display window.
    pub(super) fn size(&self) -> (usize, usize) {
        (self.width, self.height)
    }

    /// Gives the lines of a block that lie in the display window, of the channels that are wanted: the channel, the pixel the
    /// line begins at (row by row from the top), and its samples.
    pub(super) fn lines(
        &self,
        path: &Path,
        header: &Header,
        block: &UncompressedBlock,
        wanted: impl Fn(usize) -> bool,
        mut take: impl FnMut(usize, usize, &[f32]),
    ) -> Result<()> {
        if block.index.layer != self.index || block.index.level != Vec2(0, 0) {
            return Err(astray(path));
        }
        let mut values = vec![0.0; block.index.pixel_size.0];
        let mut halves = vec![f16::ZERO; block.index.pixel_size.0];
        for line in block.lines(&header.channels) {
            let channel = line.location.channel;
            let y = line.location.position.1 as i64 + self.offset.1;
            if !wanted(channel) || y < 0 || y >= self.height as i64 {
                continue;
            }
            let x0 = line.location.position.0 as i64 + self.offset.0;
            samples_of(line, self.types[channel], &mut values, &mut halves).map_err(|error| failure(path, error))?;
            let (first, last) = (x0.max(0), (x0 + values.len() as i64).min(self.width as i64));
            if first < last {
                let begin = y as usize * self.width + first as usize;
                take(channel, begin, &values[(first - x0) as usize..(last - x0) as usize]);
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

/// Refuses a DWA block whose header claims more than a block can hold: `exr` 1.74.2 allocates what these counters say,
/// and a failed allocation aborts the process. Counters 1 and 5 to 9 of eleven little-endian u64 (`DwaCompressor` of
/// OpenEXR): sizes of the unknown section and of the three stages of the run-length one, coefficients AC and DC.
fn check_dwa(path: &Path, header: &Header, chunk: &Chunk) -> Result<()> {
    if !matches!(header.compression, exrs::Compression::DWAA(_) | exrs::Compression::DWAB(_)) {
        return Ok(());
    }
    let (CompressedBlock::ScanLine(CompressedScanLineBlock { compressed_pixels_le: bytes, .. })
    | CompressedBlock::Tile(CompressedTileBlock { compressed_pixels_le: bytes, .. })) = &chunk.compressed_block
    else {
        return Ok(());
    };
    let place = header.get_block_data_indices(&chunk.compressed_block);
    // A block that lies nowhere is refused when it is decompressed.
    let Ok(bounds) = place.and_then(|tile| header.get_absolute_block_pixel_coordinates(tile)) else { return Ok(()) };
    let Vec2(width, height) = bounds.size;
    // A block stored raw, because compression did not help, has no counters.
    if bytes.len() == width * height * header.channels.bytes_per_pixel {
        return Ok(());
    }
    // Sides are padded to multiples of 8; run lengths at most double their input.
    let limit = (2 * (width + 8) * (height + 8) * header.channels.bytes_per_pixel) as u64;
    let counters = bytes.chunks_exact(8).take(11).map(|b| b.iter().rev().fold(0, |n, b| n << 8 | u64::from(*b)));
    match counters.enumerate().find(|(i, n)| matches!(i, 1 | 5..=9) && *n > limit) {
        None => Ok(()),
        Some((_, claimed)) => Err(Error::invalid(
            path.display().to_string(),
            format!("a DWA block that claims {claimed} values"),
            format!("at most {limit}"),
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

/// Writes one part of half or float R, G, B (and A), ZIP-compressed scan lines, with the primaries of its colour space. Halves
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
    picture.attributes.chromaticities = Some(chromaticities(options.colour_space));
    picture.write().to_buffered(writer).map_err(|error| match error {
        ExrError::Io(source) => Error::io("write", path, source),
        other => Error::invalid(path.display().to_string(), other.to_string(), "a picture that fits an OpenEXR file"),
    })
}

/// Primaries and white as the attribute has them.
pub(super) fn chromaticities(space: ColourSpace) -> Chromaticities {
    let Primaries { red, green, blue, white } = space.primaries();
    let [red, green, blue, white] = [red, green, blue, white].map(|[x, y]| Vec2(x as f32, y as f32));
    Chromaticities { red, green, blue, white }
}

pub(super) fn failure(path: &Path, error: ExrError) -> Error {
    match error {
        ExrError::Io(source) => Error::io("read", path, source),
        // Their sentences end in "not supported (yet)", and so does ours.
        ExrError::NotSupported(what) => {
            unsupported(path, what.trim_end_matches(" yet").trim_end_matches(" not supported").to_owned())
        }
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

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use ::exr::meta::attribute::IntegerBounds;
    use exrs::{AnyChannel, AnyChannels, Blocks, Compression, FlatSamples, Layer, LayerAttributes, LineOrder};

    use super::super::{Encoding, probe_size, read, write};
    use super::*;

    const WIDTH: usize = 37;
    const HEIGHT: usize = 29;

    /// Smooth, so that lossy compression stays close; every pixel and channel differs.
    fn sample(x: usize, y: usize, c: usize) -> f32 {
        0.25 + 0.5 * (x as f32 / WIDTH as f32) + 0.25 * (y as f32 / HEIGHT as f32) + 0.125 * c as f32
    }

    fn floats(c: usize) -> FlatSamples {
        FlatSamples::F32((0..WIDTH * HEIGHT).map(|i| sample(i % WIDTH, i / WIDTH, c)).collect())
    }

    fn halves(c: usize) -> FlatSamples {
        FlatSamples::F16((0..WIDTH * HEIGHT).map(|i| f16::from_f32(sample(i % WIDTH, i / WIDTH, c))).collect())
    }

    fn layer(
        name: &str,
        channels: &[(&str, FlatSamples)],
        compression: Compression,
        blocks: Blocks,
    ) -> Layer<AnyChannels<FlatSamples>> {
        let channels = channels.iter().map(|(name, samples)| AnyChannel::new(*name, samples.clone())).collect();
        let encoding = exrs::Encoding { compression, blocks, line_order: LineOrder::Increasing };
        Layer::new((WIDTH, HEIGHT), LayerAttributes::named(name), encoding, AnyChannels::sort(channels))
    }

    fn rgb(kind: fn(usize) -> FlatSamples) -> [(&'static str, FlatSamples); 3] {
        [("R", kind(0)), ("G", kind(1)), ("B", kind(2))]
    }

    struct Folder(tempfile::TempDir);

    impl Folder {
        fn new() -> Self {
            Self(tempfile::tempdir().unwrap())
        }

        fn file(&self) -> PathBuf {
            self.0.path().join("a.exr")
        }

        fn with(&self, layer: Layer<AnyChannels<FlatSamples>>) -> PathBuf {
            exrs::Image::from_layer(layer).write().to_file(self.file()).unwrap();
            self.file()
        }
    }

    fn assert_picture(path: &Path, tolerance: f32, channels: [usize; 3]) {
        let image = read(path, Encoding::Auto).unwrap();
        assert_eq!((image.size(), image.channels()), ((WIDTH, HEIGHT), 3));
        assert_eq!(probe_size(path).unwrap(), (WIDTH, HEIGHT));
        for (i, pixel) in image.data().chunks(3).enumerate() {
            for c in 0..3 {
                let expected = sample(i % WIDTH, i / WIDTH, channels[c]);
                let difference = (pixel[c] - expected).abs();
                assert!(difference <= tolerance, "pixel {i}, channel {c}: {} is not {expected}", pixel[c]);
            }
        }
    }

    #[test]
    fn every_compression_and_block_layout_reads_the_same() {
        let folder = Folder::new();
        for blocks in [Blocks::ScanLines, Blocks::Tiles(Vec2(16, 8)), Blocks::Tiles(Vec2(64, 64))] {
            use Compression::*;
            for compression in [Uncompressed, RLE, ZIP1, ZIP16, PIZ] {
                assert_picture(&folder.with(layer("", &rgb(floats), compression, blocks)), 0.0, [0, 1, 2]);
            }
            for compression in [Uncompressed, RLE, ZIP1, ZIP16, PIZ, PXR24] {
                // Half of the spacing of halves below 2.
                let path = folder.with(layer("", &rgb(halves), compression, blocks));
                assert_picture(&path, 0.5 / 1024.0, [0, 1, 2]);
            }
            // B44 keeps 6 bits of difference in 4x4 blocks, DWA is perceptual: about a percent on a ramp.
            for compression in [B44, B44A, DWAA(Some(45.0)), DWAB(Some(45.0))] {
                let path = folder.with(layer("", &rgb(halves), compression, blocks));
                assert_picture(&path, 0.02, [0, 1, 2]);
            }
        }
    }

    #[test]
    fn uint_samples_are_numbers() {
        let folder = Folder::new();
        let channel = |c: usize| FlatSamples::U32((0..WIDTH * HEIGHT).map(|i| (i * 3 + c) as u32).collect());
        let image = read(&folder.with(layer("", &rgb(channel), Compression::ZIP16, Blocks::ScanLines)), Encoding::Auto);
        assert_eq!(image.unwrap().pixel(2, 1), [(WIDTH + 2) as f32 * 3.0, 118.0, 119.0]);
    }

    #[test]
    fn one_channel_is_grey() {
        let folder = Folder::new();
        for channels in [vec![("Y", floats(1))], vec![("depth.Z", floats(1))]] {
            let path = folder.with(layer("", &channels, Compression::ZIP16, Blocks::ScanLines));
            assert_picture(&path, 0.0, [1, 1, 1]);
        }
        let path = folder.with(layer("", &[("Y", floats(1)), ("A", floats(0))], Compression::PIZ, Blocks::ScanLines));
        let image = read(&path, Encoding::Auto).unwrap();
        assert_eq!(image.pixel(3, 2), [sample(3, 2, 1), sample(3, 2, 1), sample(3, 2, 1), sample(3, 2, 0)]);
    }

    #[test]
    fn colour_is_found_without_and_with_a_layer_name() {
        let folder = Folder::new();
        let mut named = [("beauty.R", floats(0)), ("beauty.G", floats(1)), ("beauty.B", floats(2))].to_vec();
        named.push(("albedo.X", floats(5)));
        assert_picture(&folder.with(layer("", &named, Compression::RLE, Blocks::ScanLines)), 0.0, [0, 1, 2]);
        named.extend([("R", floats(3)), ("G", floats(4)), ("B", floats(5))]);
        assert_picture(&folder.with(layer("", &named, Compression::RLE, Blocks::ScanLines)), 0.0, [3, 4, 5]);
    }

    #[test]
    fn of_several_parts_the_first_with_colour_is_read() {
        let folder = Folder::new();
        let depth = layer("depth", &[("Z", floats(6))], Compression::ZIP16, Blocks::ScanLines);
        let tiles = Blocks::Tiles(Vec2(8, 8));
        let beauty = layer("beauty", &rgb(floats), Compression::ZIP1, tiles);
        let other = layer(
            "other",
            &[("R", floats(3)), ("G", floats(4)), ("B", floats(5))],
            Compression::PIZ,
            Blocks::ScanLines,
        );
        let attributes = exrs::ImageAttributes::with_size((WIDTH, HEIGHT));
        let image = exrs::Image::empty(attributes).with_layer(depth).with_layer(beauty).with_layer(other);
        image.write().to_file(folder.file()).unwrap();
        assert_picture(&folder.file(), 0.0, [0, 1, 2]);
    }

    #[test]
    fn mip_maps_give_their_full_resolution() {
        let folder = Folder::new();
        let channels = [(0, "R"), (1, "G"), (2, "B")].map(|(c, name)| {
            let mut levels = vec![floats(c)];
            // Level n of a map rounded down: each side halved, at least 1.
            for n in 1..=5 {
                let size = (WIDTH >> n).max(1) * (HEIGHT >> n).max(1);
                levels.push(FlatSamples::F32(vec![-1.0; size]));
            }
            AnyChannel::new(
                name,
                exrs::Levels::Mip { rounding_mode: ::exr::math::RoundingMode::Down, level_data: levels },
            )
        });
        let encoding = exrs::Encoding {
            compression: Compression::ZIP16,
            blocks: Blocks::Tiles(Vec2(16, 16)),
            line_order: LineOrder::Increasing,
        };
        let channels = AnyChannels::sort(channels.into_iter().collect());
        let layer = Layer::new((WIDTH, HEIGHT), LayerAttributes::default(), encoding, channels);
        exrs::Image::from_layer(layer).write().to_file(folder.file()).unwrap();
        assert_picture(&folder.file(), 0.0, [0, 1, 2]);
    }

    #[test]
    fn the_data_window_is_placed_into_the_display_window() {
        let folder = Folder::new();
        let mut shifted = layer("", &rgb(floats), Compression::ZIP16, Blocks::Tiles(Vec2(16, 16)));
        // Display window: x from 10, y from -5. Data window: x from 8 (two columns cropped), y from -3 (two rows padded).
        shifted.attributes.layer_position = Vec2(8, -3);
        let display = IntegerBounds::new(Vec2(10, -5), Vec2(40, 20));
        let image = exrs::Image::new(exrs::ImageAttributes::new(display), shifted);
        image.write().to_file(folder.file()).unwrap();
        let image = read(&folder.file(), Encoding::Auto).unwrap();
        assert_eq!(image.size(), (40, 20));
        assert_eq!(probe_size(&folder.file()).unwrap(), (40, 20));
        for y in 0..20 {
            for x in 0..40 {
                let inside = y >= 2 && x + 2 < WIDTH;
                let expected = if inside { [0, 1, 2].map(|c| sample(x + 2, y - 2, c)) } else { [0.0; 3] };
                assert_eq!(image.pixel(x, y), expected, "pixel ({x}, {y})");
            }
        }
    }

    #[test]
    fn nan_is_refused_by_pixel_and_channel() {
        let folder = Folder::new();
        let mut channels = rgb(floats);
        let FlatSamples::F32(green) = &mut channels[1].1 else { unreachable!() };
        green[4 * WIDTH + 9] = f32::NAN;
        let path = folder.with(layer("", &channels, Compression::ZIP16, Blocks::ScanLines));
        let message = read(&path, Encoding::Auto).unwrap_err().to_string();
        assert!(message.contains("a.exr, pixel (9, 4), channel G: found NaN"), "{message}");
    }

    #[test]
    fn what_is_no_picture_is_refused_with_its_channels() {
        let folder = Folder::new();
        let path = folder.with(layer("", &[("u", floats(0)), ("v", floats(1))], Compression::RLE, Blocks::ScanLines));
        let message = read(&path, Encoding::Auto).unwrap_err().to_string();
        assert!(message.contains("found the channels u, v, expected R, G, B"), "{message}");
        let chroma = [("Y", halves(0)), ("RY", halves(1)), ("BY", halves(2))];
        let path = folder.with(layer("", &chroma, Compression::RLE, Blocks::ScanLines));
        let message = read(&path, Encoding::Auto).unwrap_err().to_string();
        assert!(message.contains("subsampled chroma"), "{message}");
    }

    #[test]
    fn subsampled_channels_are_refused() {
        let folder = Folder::new();
        let path = folder.with(layer("", &rgb(floats), Compression::Uncompressed, Blocks::ScanLines));
        let mut bytes = std::fs::read(&path).unwrap();
        let list = bytes.windows(7).position(|w| w == b"chlist\0").unwrap() + 7 + 4;
        // The first channel: "B\0", type, linearity and 3 reserved bytes, then the two sampling rates.
        let rates = list + 2 + 4 + 4;
        assert_eq!(bytes[rates..rates + 8], [1, 0, 0, 0, 1, 0, 0, 0]);
        // The crate itself refuses rates that do not divide the width.
        bytes[rates] = WIDTH as u8;
        std::fs::write(&path, bytes).unwrap();
        let error = read(&path, Encoding::Auto).unwrap_err();
        assert!(error.to_string().contains("channel subsampling is not supported; convert"), "{error}");
    }

    /// Found by mutation: 2^61 values were allocated, which aborts the process.
    #[test]
    fn a_dwa_block_that_claims_too_much_is_refused() {
        let folder = Folder::new();
        let path = folder.with(layer("", &rgb(halves), Compression::DWAA(Some(45.0)), Blocks::ScanLines));
        let bytes = std::fs::read(&path).unwrap();
        // The header ends with an empty name; one offset per block of 32 lines; then line number, size, and the counters.
        let offsets = bytes.len() - bytes.windows(8).rev().position(|w| w == 2u64.to_le_bytes()).unwrap() - 8;
        for counter in [1, 5, 6, 7, 8, 9] {
            let mut bytes = bytes.clone();
            bytes[offsets + counter * 8 + 7] = 0x20;
            std::fs::write(&path, bytes).unwrap();
            let message = read(&path, Encoding::Auto).unwrap_err().to_string();
            assert!(message.contains("a DWA block that claims 23058430092136"), "{message}");
        }
    }

    #[test]
    fn a_size_beyond_the_limit_is_refused_from_the_header() {
        let folder = Folder::new();
        let path = folder.with(layer("", &rgb(floats), Compression::Uncompressed, Blocks::ScanLines));
        let mut bytes = std::fs::read(&path).unwrap();
        let name = b"displayWindow\0box2i\0";
        let window = bytes.windows(name.len()).position(|w| w == name).unwrap() + name.len() + 4;
        bytes[window + 8..window + 12].copy_from_slice(&(1i32 << 20).to_le_bytes());
        bytes[window + 12..window + 16].copy_from_slice(&(1i32 << 20).to_le_bytes());
        std::fs::write(&path, bytes).unwrap();
        let message = read(&path, Encoding::Auto).unwrap_err().to_string();
        assert!(message.contains("1048577 x 1048577 pixels"), "{message}");
        assert_eq!(message, probe_size(&path).unwrap_err().to_string());
    }

    #[test]
    fn float_survives_exactly_and_half_to_its_spacing() {
        let folder = Folder::new();
        let image = Image::from_fn(WIDTH, HEIGHT, |x, y| [-1.5 * sample(x, y, 0), 1e-7 * sample(x, y, 1), 1e6]);
        write(&folder.file(), &image, EncodeOptions::default()).unwrap();
        assert_eq!(read(&folder.file(), Encoding::Auto).unwrap(), image);
        write(&folder.file(), &image, EncodeOptions { half: true, ..Default::default() }).unwrap();
        let back = read(&folder.file(), Encoding::Auto).unwrap();
        for (a, b) in back.data().chunks(3).zip(image.data().chunks(3)) {
            assert!((a[0] - b[0]).abs() <= b[0].abs() / 2048.0);
            // The spacing of subnormal halves is 2^-24.
            assert!((a[1] - b[1]).abs() <= 0.5f32.powi(25));
            assert_eq!(a[2], 65504.0);
        }
    }

    #[test]
    fn alpha_stays_associated_and_primaries_are_written() {
        let folder = Folder::new();
        let image = Image::from_data(2, 1, 4, vec![0.5, 0.25, 0.125, 0.5, 3.0, 0.0, 0.0, 0.0]).unwrap();
        for (colour_space, green) in [(ColourSpace::LinRec709, (0.30, 0.60)), (ColourSpace::AcesCg, (0.165, 0.830))] {
            write(&folder.file(), &image, EncodeOptions { colour_space, ..EncodeOptions::default() }).unwrap();
            assert_eq!(read(&folder.file(), Encoding::Auto).unwrap(), image);
            let meta = MetaData::read_from_file(folder.file(), true).unwrap();
            let found = meta.headers[0].shared_attributes.chromaticities.unwrap();
            assert_eq!((found.green.0, found.green.1), green);
        }
    }
}
