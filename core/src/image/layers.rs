//! Many pictures of one size in one OpenEXR file: a part each, or layers of channels (`lamp07.R`, `lamp07.G`, `lamp07.B`) in
//! one part, as light groups of renderers and compositing packages are kept.
//!
//! Pictures are read some at a time, so that memory does not grow with the file. Where many layers share a part each of its
//! blocks holds all of them, and a pass over the file reads all that the pictures asked for together need.

use std::cmp::Ordering;
use std::collections::HashMap;
use std::fs::File;
use std::io::{BufReader, Seek, Write};
use std::path::{Path, PathBuf};

use ::exr::block::chunk::Chunk;
use ::exr::block::reader::{ChunksReader, Reader};
use ::exr::block::writer::{ChunkWriter, ChunksWriter, write_chunks_with};
use ::exr::block::{BlockIndex, UncompressedBlock};
use ::exr::error::{Error as ExrError, UnitResult};
use ::exr::math::Vec2;
use ::exr::meta::attribute::{AttributeValue, ChannelDescription, Chromaticities, LineOrder, SampleType, Text};
use ::exr::meta::header::{Header, ImageAttributes, LayerAttributes};
use ::exr::meta::{BlockDescription, MetaData};
use ::exr::prelude::{Compression, SmallVec};
use half::f16;
use rayon::prelude::*;

use super::exr::{BATCH, Part, caught, chromaticities, decompressed, failure};
use super::stored::{check_size, refuse_non_finite};
use super::{ColourSpace, Image};
use crate::error::{Error, Result};
use crate::files::write_whole;

/// Blocks decompressed together take no more than this, where one alone does not.
const BATCH_BYTES: usize = 256 << 20;
/// Chromaticities are those of a colour space if they are no farther: files have f32, and people round.
const CHROMATICITY: f32 = 1e-3;
/// What red, green and blue are called: by renderers, and by Nuke in layers other than its first.
const COLOURS: [[&str; 3]; 3] = [["R", "G", "B"], ["r", "g", "b"], ["red", "green", "blue"]];
/// Attribute of a part: the unit vector towards its lamp, stage frame (x right, y up, z to the camera).
const DIRECTION: &str = "relumeDirection";
/// Attribute of a part: the irradiance that its lamp gives a patch facing it.
const IRRADIANCE: &str = "relumeIrradiance";
/// Pictures in a file at most; a header for each is read before anything is known of them.
const MOST_LAYERS: usize = 1 << 16;

/// What is known of a picture without reading it.
#[derive(Debug, Clone, PartialEq)]
pub struct Layer {
    /// Name of the layer, or of the part where its channels have none, or `part N`.
    pub name: String,
    /// Where its lamp stands, if the file tells.
    pub direction: Option<[f32; 3]>,
    /// What irradiance the lamp gives, if the file tells.
    pub irradiance: Option<f32>,
    part: usize,
    /// R, G and B, or grey; places in the part's list.
    channels: Vec<usize>,
}

/// A file of many pictures.
#[derive(Debug)]
pub struct Layers {
    path: PathBuf,
    size: (usize, usize),
    colour_space: Option<ColourSpace>,
    layers: Vec<Layer>,
}

impl Layers {
    /// Lists the pictures of a file: parts in its order, layers of one part in the order of their names, numbers in names by
    /// value. A layer is what has R, G and B (or
    /// r, g, b, or red, green, blue), or Y; a part of one channel is a grey picture.
    ///
    /// # Errors
    /// A file that is no OpenEXR; no picture in it; what `read` refuses.
    pub fn open(path: &Path) -> Result<Self> {
        let file = File::open(path).map_err(|source| Error::io("read", path, source))?;
        caught(path, || {
            let reader =
                Reader::read_from_buffered(BufReader::new(file), false).map_err(|error| failure(path, error))?;
            Self::of(path, reader.meta_data())
        })
    }

    fn of(path: &Path, meta: &MetaData) -> Result<Self> {
        let mut layers = Vec::new();
        for (part, header) in meta.headers.iter().enumerate() {
            layers.extend(layers_of(part, header));
        }
        let place = || path.display().to_string();
        let Some(first) = layers.first() else {
            let expected = "pictures: parts, or layers of a part, with the channels R, G, B or Y";
            return Err(Error::invalid(place(), "none", expected));
        };
        if layers.len() > MOST_LAYERS {
            let found = format!("{} pictures", layers.len());
            return Err(Error::invalid(place(), found, format!("at most {MOST_LAYERS}")));
        }
        let size = Part::new(path, meta, first.part)?.size();
        let mut checked = None;
        for layer in &layers {
            if checked == Some(layer.part) {
                continue;
            }
            checked = Some(layer.part);
            let other = Part::new(path, meta, layer.part)?.size();
            if other != size {
                let found = format!("{} x {} pixels", other.0, other.1);
                let expected = format!("{} x {}, as {} has", size.0, size.1, layers[0].name);
                return Err(Error::invalid(format!("{}, {}", place(), layer.name), found, expected));
            }
        }
        let told = meta.headers[layers[0].part].shared_attributes.chromaticities;
        Ok(Self { path: path.to_owned(), size, colour_space: told.and_then(|c| space_of(&c)), layers })
    }

    /// Where it lies.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Width and height of every picture.
    pub fn size(&self) -> (usize, usize) {
        self.size
    }

    /// The space of its colours, if the file tells of one that is known.
    pub fn colour_space(&self) -> Option<ColourSpace> {
        self.colour_space
    }

    /// The pictures.
    pub fn layers(&self) -> &[Layer] {
        &self.layers
    }

    /// Reads pictures, RGB, row 0 at the top, in the order asked for; without their alpha (colour is premultiplied). One pass
    /// over the parts that hold them.
    ///
    /// # Errors
    /// Damaged or truncated files; NaN and infinities, with layer and pixel; a file that has changed since it was opened.
    ///
    /// # Panics
    /// When there is no such picture.
    pub fn read(&self, wanted: &[usize]) -> Result<Vec<Image>> {
        let file = File::open(&self.path).map_err(|source| Error::io("read", &self.path, source))?;
        let pictures = caught(&self.path, || self.read_unguarded(BufReader::new(file), wanted))?;
        for (&n, picture) in wanted.iter().zip(&pictures) {
            let place = format!("{}, {}", self.path.display(), self.layers[n].name);
            refuse_non_finite(&place, picture.data(), self.size.0, 3)?;
        }
        Ok(pictures)
    }

    fn read_unguarded(&self, file: BufReader<File>, wanted: &[usize]) -> Result<Vec<Image>> {
        let (path, failed) = (&self.path, |error| failure(&self.path, error));
        let reader = Reader::read_from_buffered(file, false).map_err(failed)?;
        if Self::of(path, reader.meta_data())?.layers != self.layers {
            let expected = "the file that it was when it was opened";
            return Err(Error::invalid(path.display().to_string(), "other layers than before", expected));
        }
        let targets = self.targets(reader.meta_data(), wanted);
        let asked = |part: usize| targets.contains_key(&part);
        let chunks = reader
            .filter_chunks(false, |_, tile, block| asked(block.layer) && tile.level_index == Vec2(0, 0))
            .map_err(failed)?;
        let meta = chunks.meta_data().clone();
        let parts: HashMap<usize, Part> =
            targets.keys().map(|&part| Ok((part, Part::new(path, &meta, part)?))).collect::<Result<_>>()?;
        let largest = targets.keys().map(|&part| meta.headers[part].max_block_byte_size()).max().unwrap_or(1);
        let batch_len = (BATCH_BYTES / largest.max(1)).clamp(1, BATCH);
        let (width, height) = self.size;
        let mut pictures: Vec<Image> = wanted.iter().map(|_| Image::new(width, height, 3)).collect();
        let mut chunks = chunks.peekable();
        while chunks.peek().is_some() {
            let batch: Vec<Chunk> = chunks.by_ref().take(batch_len).collect::<Result<_, ExrError>>().map_err(failed)?;
            for block in &decompressed(path, &meta, batch, asked)? {
                let (part, targets) = (&parts[&block.index.layer], &targets[&block.index.layer]);
                let header = &meta.headers[block.index.layer];
                let is_wanted = |channel: usize| !targets[channel].is_empty();
                part.lines(path, header, block, is_wanted, |channel, first, values| {
                    for &(picture, colour) in &targets[channel] {
                        let samples = pictures[picture].data_mut()[first * 3 + colour..].iter_mut().step_by(3);
                        samples.zip(values).for_each(|(out, value)| *out = *value);
                    }
                })?;
            }
        }
        Ok(pictures)
    }

    /// For each part that is needed and each of its channels: where its samples go, as picture and colour.
    fn targets(&self, meta: &MetaData, wanted: &[usize]) -> HashMap<usize, Vec<Vec<(usize, usize)>>> {
        let mut targets: HashMap<usize, Vec<Vec<(usize, usize)>>> = HashMap::new();
        for (picture, &n) in wanted.iter().enumerate() {
            let Layer { part, channels, .. } = &self.layers[n];
            let of_part =
                targets.entry(*part).or_insert_with(|| vec![Vec::new(); meta.headers[*part].channels.list.len()]);
            for colour in 0..3 {
                // Grey is all three.
                of_part[channels[colour.min(channels.len() - 1)]].push((picture, colour));
            }
        }
        targets
    }
}

/// The pictures of a part.
fn layers_of(part: usize, header: &Header) -> Vec<Layer> {
    if header.deep {
        return Vec::new();
    }
    let names: Vec<String> = header.channels.list.iter().map(|c| c.name.to_string()).collect();
    let places: HashMap<&str, usize> = names.iter().zip(0..).map(|(name, place)| (name.as_str(), place)).collect();
    let mut prefixes: Vec<&str> = names.iter().map(|name| name.rfind('.').map_or("", |dot| &name[..=dot])).collect();
    prefixes.sort_by(|a, b| natural(a, b));
    prefixes.dedup();
    let part_name = header.own_attributes.layer_name.as_ref().map(ToString::to_string).unwrap_or_default();
    let layer = |prefix: &&str| {
        let of = |wanted: &[&str]| -> Option<Vec<usize>> {
            wanted.iter().map(|channel| places.get(format!("{prefix}{channel}").as_str()).copied()).collect()
        };
        let single = || (names.len() == 1).then(|| vec![0]);
        let channels = COLOURS.iter().find_map(|colours| of(colours)).or_else(|| of(&["Y"])).or_else(single)?;
        let name = match prefix.trim_end_matches('.') {
            "" if part_name.is_empty() => format!("part {}", part + 1),
            "" => part_name.clone(),
            layer => layer.to_owned(),
        };
        Some(Layer { name, direction: direction_of(header), irradiance: irradiance_of(header), part, channels })
    };
    prefixes.iter().filter_map(layer).collect()
}

/// An attribute of a part, whichever of both maps it is read into.
fn attribute<'a>(header: &'a Header, name: &str) -> Option<&'a AttributeValue> {
    let name = Text::new_or_none(name)?;
    header.own_attributes.other.get(&name).or_else(|| header.shared_attributes.other.get(&name))
}

fn direction_of(header: &Header) -> Option<[f32; 3]> {
    match attribute(header, DIRECTION)? {
        AttributeValue::FloatVec3((x, y, z)) => Some([*x, *y, *z]),
        _ => None,
    }
}

fn irradiance_of(header: &Header) -> Option<f32> {
    match attribute(header, IRRADIANCE)? {
        AttributeValue::F32(irradiance) => Some(*irradiance),
        _ => None,
    }
}

/// The colour space with these chromaticities.
fn space_of(found: &Chromaticities) -> Option<ColourSpace> {
    let near = |a: Vec2<f32>, b: Vec2<f32>| (a.0 - b.0).abs() < CHROMATICITY && (a.1 - b.1).abs() < CHROMATICITY;
    ColourSpace::ALL.into_iter().find(|space| {
        let of = chromaticities(*space);
        near(of.red, found.red)
            && near(of.green, found.green)
            && near(of.blue, found.blue)
            && near(of.white, found.white)
    })
}

/// The order of names in which `lamp2` comes before `lamp10`: runs of digits by value, the rest by character.
pub fn natural(a: &str, b: &str) -> Ordering {
    let digits = |text: &str| text.len() - text.trim_start_matches(|c: char| c.is_ascii_digit()).len();
    let (mut x, mut y) = (a, b);
    while let (Some(c), Some(d)) = (x.chars().next(), y.chars().next()) {
        let (m, n) = (digits(x), digits(y));
        let order = if m > 0 && n > 0 {
            let (p, q) = (x[..m].trim_start_matches('0'), y[..n].trim_start_matches('0'));
            p.len().cmp(&q.len()).then_with(|| p.cmp(q))
        } else {
            c.cmp(&d)
        };
        if order != Ordering::Equal {
            return order;
        }
        let step = |text: &str, digits: usize, c: char| if digits > 0 { digits.min(text.len()) } else { c.len_utf8() };
        let (i, j) = if m > 0 && n > 0 { (m, n) } else { (step(x, 0, c), step(y, 0, d)) };
        (x, y) = (&x[i..], &y[j..]);
    }
    // `a01` and `a1` differ, but not in value.
    x.len().cmp(&y.len()).then_with(|| a.cmp(b))
}

/// A picture that is to be written.
#[derive(Debug, Clone, PartialEq)]
pub struct NewPart {
    /// Name of the part; all differ.
    pub name: String,
    /// Only red is written, as luminance Y.
    pub grey: bool,
    /// Towards its lamp.
    pub direction: Option<[f32; 3]>,
    /// Of its lamp.
    pub irradiance: Option<f32>,
}

/// A file that is to be written.
#[derive(Debug, Clone, PartialEq)]
pub struct NewFile {
    /// Width and height of all pictures.
    pub size: (usize, usize),
    /// The space of the colours, told in the file.
    pub colour_space: ColourSpace,
    /// 16-bit halves in place of floats; numbers beyond 65504 are clamped.
    pub half: bool,
    /// The pictures.
    pub parts: Vec<NewPart>,
}

/// Writes a file of many parts, ZIP-compressed scan lines; `picture(n)` is asked for one after another. Whole or not at all. A
/// multi-part file has its pictures one after another, so that each is read alone.
///
/// # Errors
/// What `picture` returns; a picture of another size; NaN and infinities; the disk's.
pub fn write(path: &Path, file: &NewFile, picture: &mut dyn FnMut(usize) -> Result<Image>) -> Result<()> {
    let (width, height) = file.size;
    check_size(path, width, height)?;
    let headers = file.parts.iter().map(|part| header(file, part)).collect();
    write_whole(path, |writer| {
        // The crate's errors cannot carry ours.
        let mut ours = None;
        let written = write_chunks_with(writer, headers, false, |meta, chunks| {
            for n in 0..meta.headers.len() {
                let part = picture(n).and_then(|picture| checked(path, file, n, picture));
                match part {
                    Ok(picture) => write_part(&meta, n, &picture, chunks)?,
                    Err(error) => {
                        ours = Some(error);
                        return Err(ExrError::Aborted);
                    }
                }
            }
            Ok(())
        });
        match (ours, written) {
            (Some(error), _) => Err(error),
            (None, Err(ExrError::Io(source))) => Err(Error::io("write", path, source)),
            (None, Err(other)) => {
                Err(Error::invalid(path.display().to_string(), other.to_string(), "pictures that fit an OpenEXR file"))
            }
            (None, Ok(())) => Ok(()),
        }
    })
}

fn checked(path: &Path, file: &NewFile, n: usize, picture: Image) -> Result<Image> {
    let place = format!("{}, {}", path.display(), file.parts[n].name);
    if picture.size() != file.size || picture.channels() != 3 {
        let found = format!("{} x {} x {}", picture.width(), picture.height(), picture.channels());
        return Err(Error::invalid(place, found, format!("{} x {} x 3", file.size.0, file.size.1)));
    }
    refuse_non_finite(&place, picture.data(), picture.width(), 3)?;
    Ok(picture)
}

/// Compresses on all threads, writes in order.
fn write_part<W: Write + Seek>(meta: &MetaData, n: usize, picture: &Image, chunks: &mut ChunkWriter<W>) -> UnitResult {
    let header = &meta.headers[n];
    let blocks: Vec<(usize, BlockIndex)> = header
        .enumerate_ordered_blocks()
        .map(|(place, tile)| {
            let bounds = header.get_absolute_block_pixel_coordinates(tile.location)?;
            let position = bounds.position.to_usize("block")?;
            let level = tile.location.level_index;
            Ok((place, BlockIndex { layer: n, pixel_position: position, pixel_size: bounds.size, level }))
        })
        .collect::<Result<_, ExrError>>()?;
    let compress = |&(place, index): &(usize, BlockIndex)| {
        let block = UncompressedBlock::from_lines(&header.channels, index, |line| {
            // In the file's order, alphabetical: B, G, R; Y is red.
            let colour = if header.channels.list.len() == 1 { 0 } else { 2 - line.location.channel };
            let row = &picture.row(line.location.position.1)[line.location.position.0 * 3..];
            let samples = row.iter().skip(colour).step_by(3).take(line.location.sample_count).copied();
            // Of the size of the line by construction.
            let _ = match header.channels.list[line.location.channel].sample_type {
                SampleType::F16 => line.write_samples_from_slice(&samples.map(to_half).collect::<Vec<_>>()),
                _ => line.write_samples_from_slice(&samples.collect::<Vec<_>>()),
            };
        });
        Ok((place, block.compress_to_chunk(&meta.headers)?))
    };
    let compressed: Vec<(usize, Chunk)> = blocks.par_iter().map(compress).collect::<Result<_, ExrError>>()?;
    compressed.into_iter().try_for_each(|(place, chunk)| chunks.write_chunk(place, chunk))
}

/// An infinity could not be read back.
fn to_half(value: f32) -> f16 {
    f16::from_f32(value.clamp(f16::MIN.to_f32(), f16::MAX.to_f32()))
}

fn header(file: &NewFile, part: &NewPart) -> Header {
    let sample_type = if file.half { SampleType::F16 } else { SampleType::F32 };
    let names: &[&str] = if part.grey { &["Y"] } else { &["B", "G", "R"] };
    let channels: SmallVec<[ChannelDescription; 5]> =
        names.iter().map(|name| ChannelDescription::new(*name, sample_type, false)).collect();
    let size = Vec2(file.size.0, file.size.1);
    let (mut own, mut shared) = (LayerAttributes::named(part.name.as_str()), ImageAttributes::with_size(size));
    shared.chromaticities = Some(chromaticities(file.colour_space));
    if let Some([x, y, z]) = part.direction {
        own.other.insert(Text::from(DIRECTION), AttributeValue::FloatVec3((x, y, z)));
    }
    if let Some(irradiance) = part.irradiance {
        // Written like the other. One a map: in a map of two their order, and so the file, would differ from run to run.
        shared.other.insert(Text::from(IRRADIANCE), AttributeValue::F32(irradiance));
    }
    Header::new(Text::from(part.name.as_str()), size, channels)
        .with_encoding(Compression::ZIP16, BlockDescription::ScanLines, LineOrder::Increasing)
        .with_attributes(own)
        .with_shared_attributes(shared)
}

#[cfg(test)]
mod tests {
    use ::exr::prelude as exrs;
    use ::exr::prelude::WritableImage;

    use super::*;

    const SIZE: (usize, usize) = (37, 29);

    /// Every pixel, channel and picture differs.
    fn picture(n: usize) -> Image {
        Image::from_fn(SIZE.0, SIZE.1, |x, y| [0, 1, 2].map(|c| (x + 40 * y + 2000 * c + 7000 * n) as f32 / 4096.0))
    }

    fn part(name: &str) -> NewPart {
        NewPart { name: name.to_owned(), grey: false, direction: None, irradiance: None }
    }

    fn file(parts: Vec<NewPart>) -> NewFile {
        NewFile { size: SIZE, colour_space: ColourSpace::AcesCg, half: false, parts }
    }

    #[test]
    fn parts_return_with_what_is_told_of_them() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.exr");
        let mut parts: Vec<NewPart> = (0..20).map(|n| part(&format!("lamp{n}"))).collect();
        for (n, part) in parts.iter_mut().enumerate() {
            part.direction = Some([0.6, 0.8 * (n as f32).cos(), 0.8 * (n as f32).sin()]);
            part.irradiance = Some(1.0 + n as f32);
        }
        parts.push(NewPart { grey: true, ..part("alpha") });
        write(&path, &file(parts.clone()), &mut |n| Ok(picture(n))).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        write(&path, &file(parts.clone()), &mut |n| Ok(picture(n))).unwrap();
        assert_eq!(bytes, std::fs::read(&path).unwrap(), "the same every time");

        let layers = Layers::open(&path).unwrap();
        assert_eq!((layers.size(), layers.colour_space()), (SIZE, Some(ColourSpace::AcesCg)));
        assert_eq!(layers.layers().len(), 21);
        for (layer, part) in layers.layers().iter().zip(&parts) {
            let told =
                NewPart { name: layer.name.clone(), direction: layer.direction, irradiance: layer.irradiance, ..*part };
            assert_eq!(told, *part);
        }
        let read = layers.read(&[3, 20, 3, 0]).unwrap();
        assert_eq!((&read[0], &read[2], &read[3]), (&picture(3), &picture(3), &picture(0)));
        let grey = read[1].data().chunks_exact(3).zip(picture(20).data().chunks_exact(3)).all(|(a, b)| a == [b[0]; 3]);
        assert!(grey);
        // One part alone is what any reader gives.
        assert_eq!(super::super::read(&path, super::super::Encoding::Auto).unwrap(), picture(0));
    }

    #[test]
    fn halves_are_rounded_and_clamped() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.exr");
        let bright = Image::from_fn(SIZE.0, SIZE.1, |x, _| [x as f32 / 7.0, 1e6, -1e6]);
        write(&path, &NewFile { half: true, ..file(vec![part("a")]) }, &mut |_| Ok(bright.clone())).unwrap();
        let back = &Layers::open(&path).unwrap().read(&[0]).unwrap()[0];
        assert_eq!(back.pixel(5, 5)[1..], [65504.0, -65504.0]);
        assert!((back.pixel(5, 5)[0] - 5.0 / 7.0).abs() < 5.0 / 7.0 / 2048.0);
    }

    /// As compositing packages write: layers of channels in one part, with a plain picture and a depth beside them, tiles, and
    /// a data window within the display window.
    #[test]
    fn layers_of_one_part_are_found() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.exr");
        let (data, crop) = ((20, 10), (5, 7));
        let samples = |n: usize, c: usize| {
            let at = |i: usize| picture(n).pixel(i % data.0 + crop.0, i / data.0 + crop.1)[c];
            exrs::FlatSamples::F32((0..data.0 * data.1).map(at).collect())
        };
        let mut channels = SmallVec::new();
        for (n, layer) in ["", "lamp.2.", "lamp.10.", "lamp.1."].iter().enumerate() {
            for (c, name) in ["R", "G", "B", "A"].iter().enumerate() {
                channels.push(exrs::AnyChannel::new(format!("{layer}{name}").as_str(), samples(n, c % 3)));
            }
        }
        channels.push(exrs::AnyChannel::new("Z", samples(9, 0)));
        channels.push(exrs::AnyChannel::new("matte.Y", samples(8, 1)));
        for (c, name) in ["key.red", "key.green", "key.blue"].iter().enumerate() {
            channels.push(exrs::AnyChannel::new(*name, samples(6, c)));
        }
        let encoding = exrs::Encoding {
            compression: Compression::PIZ,
            blocks: exrs::Blocks::Tiles(Vec2(16, 8)),
            line_order: LineOrder::Increasing,
        };
        let attributes = LayerAttributes::named("beauty").with_position(Vec2(crop.0 as i32, crop.1 as i32));
        let layer = exrs::Layer::new(data, attributes, encoding, exrs::AnyChannels::sort(channels));
        let bounds = exrs::IntegerBounds::from_dimensions(SIZE);
        exrs::Image::empty(ImageAttributes::new(bounds)).with_layer(layer).write().to_file(&path).unwrap();

        let layers = Layers::open(&path).unwrap();
        let names: Vec<&str> = layers.layers().iter().map(|layer| layer.name.as_str()).collect();
        assert_eq!(names, ["beauty", "key", "lamp.1", "lamp.2", "lamp.10", "matte"]);
        assert!(layers.layers().iter().all(|layer| layer.direction.is_none()) && layers.colour_space().is_none());
        let cropped = |n: usize, colours: [usize; 3]| {
            Image::from_fn(SIZE.0, SIZE.1, |x, y| {
                let inside = (crop.0..crop.0 + data.0).contains(&x) && (crop.1..crop.1 + data.1).contains(&y);
                colours.map(|c| if inside { picture(n).pixel(x, y)[c] } else { 0.0 })
            })
        };
        let read = layers.read(&[4, 0, 5, 2, 1]).unwrap();
        let rgb = |n: usize| cropped(n, [0, 1, 2]);
        let expected = [rgb(2), rgb(0), cropped(8, [1; 3]), rgb(3), rgb(6)];
        assert!(read == expected);
    }

    #[test]
    fn what_cannot_be_written_leaves_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.exr");
        let parts = || file(vec![part("a"), part("b")]);
        let mut nan = picture(1);
        nan.pixel_mut(3, 4)[1] = f32::NAN;
        type Source = Box<dyn FnMut(usize) -> Result<Image>>;
        let mut bad: Vec<(Source, &str)> = vec![
            (Box::new(|n| if n == 0 { Ok(picture(0)) } else { Err(Error::Cancelled) }), "stopped on request"),
            (Box::new(move |n| if n == 0 { Ok(picture(0)) } else { Ok(nan.clone()) }), "b, pixel (3, 4), channel G"),
            (Box::new(|_| Ok(Image::new(3, 3, 3))), "expected 37 x 29 x 3"),
        ];
        for (picture, words) in &mut bad {
            let message = write(&path, &parts(), picture).unwrap_err().to_string();
            assert!(message.contains(*words), "`{words}` not in: {message}");
        }
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    }

    #[test]
    fn damaged_files_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.exr");
        let parts: Vec<NewPart> = (0..3).map(|n| part(&n.to_string())).collect();
        write(&path, &file(parts), &mut |n| Ok(picture(n))).unwrap();
        let whole = std::fs::read(&path).unwrap();
        let every = |bytes: &[u8]| {
            std::fs::write(&path, bytes).unwrap();
            let layers = Layers::open(&path)?;
            layers.read(&(0..layers.layers().len()).collect::<Vec<_>>())
        };
        assert!(every(&whole).is_ok());
        for length in (0..whole.len()).step_by(311) {
            assert!(every(&whole[..length]).is_err(), "cut to {length}");
        }
        // Any answer will do, but for a panic.
        for at in (0..whole.len()).step_by(83) {
            let mut bytes = whole.clone();
            bytes[at] ^= 0x55;
            let _ = every(&bytes);
        }
    }

    #[test]
    fn numbers_in_names_count() {
        let mut names = ["b", "a10", "a2", "a", "a02", "a2b", "10", "9", "a2.10", "a2.9"];
        names.sort_by(|a, b| natural(a, b));
        assert_eq!(names, ["9", "10", "a", "a02", "a2", "a2.9", "a2.10", "a2b", "a10", "b"]);
        assert_eq!(natural("lamp1", "lamp1"), Ordering::Equal);
    }
}
