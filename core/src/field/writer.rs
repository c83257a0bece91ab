//! Writing a container in bounded memory: `T` comes in pieces, is rounded, hashed and appended.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::mem::ManuallyDrop;
use std::ops::Range;
use std::path::Path;

use half::f16;
use rayon::prelude::*;
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipWriter};

use super::dense::{BLOCK_HEIGHT, BLOCK_PIXELS, BLOCK_WIDTH, CHANNELS, Layout};
use super::manifest::{Domain, FORMAT, Manifest, Precision, Representation, VERSION};
use super::npy;
use crate::domain::Directions;
use crate::error::{Error, Result};
use crate::files::write_whole;
use crate::image::{ColourSpace, Conversion, Image, encode_png8};

/// `T` is asked for in pieces of about this many bytes (as f32).
const PIECE_BYTES: usize = 64 << 20;
/// Halves are scaled so that the largest number lies below this: a factor of four from their end, 65504.
const HALF_CEILING: f32 = 16384.0;

/// What goes into a container beside `T`.
#[derive(Debug, Clone)]
pub struct Contents {
    /// The lamps.
    pub domain: Directions,
    /// E_j: the irradiance that lamp j gave a patch facing it. T_j = photo_j / E_j.
    pub irradiance: Vec<f32>,
    /// Columns of the pictures.
    pub width: usize,
    /// Rows of the pictures.
    pub height: usize,
    /// The colours of `T` and the layers.
    pub colour_space: ColourSpace,
    /// How `T` is stored.
    pub precision: Precision,
    /// The largest |T| there can be; it sets the scale of halves.
    pub largest: f32,
    /// `S`: the black photograph, 3 channels.
    pub ambient: Option<Image>,
    /// Coverage of the object, width x height, 0 to 1, row 0 at the top.
    pub alpha: Option<Vec<f32>>,
    /// Where the field came from, free form.
    pub provenance: serde_json::Value,
}

/// A source of `T`, one run of blocks after another: rows of blocks from the top, in a row from the left.
pub trait Bands {
    /// Fills the blocks in `columns` of row `by` with `T` laid out `[block x][channel][element][8][16]`. The buffer comes
    /// zeroed, and pixels past the edges of the picture stay zero.
    ///
    /// # Errors
    /// Whatever the source meets; [`Error::Cancelled`] to stop.
    fn fill(&mut self, by: usize, columns: Range<usize>, blocks: &mut [f32]) -> Result<()>;
}

/// Writes a container, whole or not at all. Memory: about 100 MB and one row of the picture, however large the field.
///
/// # Errors
/// Folder absent or full; layers of another size; NaN, or numbers beyond [`Contents::largest`]; what the source returns.
pub fn write(path: &Path, contents: &Contents, bands: &mut dyn Bands) -> Result<()> {
    let layout = Layout { width: contents.width, height: contents.height, elements: contents.domain.len() };
    if contents.irradiance.len() != layout.elements {
        let found = format!("{} irradiances", contents.irradiance.len());
        return Err(Error::invalid("field", found, format!("{}, one a lamp", layout.elements)));
    }
    let pixels = layout.width * layout.height;
    let ambient_fits =
        contents.ambient.as_ref().is_none_or(|s| s.size() == (layout.width, layout.height) && s.channels() == 3);
    let alpha_fits = contents.alpha.as_ref().is_none_or(|alpha| alpha.len() == pixels);
    if pixels == 0 || !ambient_fits || !alpha_fits {
        let expected = format!("{} x {} pixels, as the field, and at least one", layout.width, layout.height);
        return Err(Error::invalid("field", "layers of another size, or no pixels", expected));
    }
    write_whole(path, |file| {
        let mut out = Entries { zip: ManuallyDrop::new(ZipWriter::new(file)), path, blake3: BTreeMap::new() };
        let scale = scale_for(contents);
        let preview = out.dense("transport/dense.npy", contents, layout, scale, bands)?;
        let mut layers = BTreeMap::new();
        if let Some(ambient) = &contents.ambient {
            out.floats("layers/ambient.npy", &[layout.height, layout.width, CHANNELS], ambient.data())?;
            layers.insert("ambient".to_owned(), "layers/ambient.npy".to_owned());
        }
        if let Some(alpha) = &contents.alpha {
            out.floats("layers/alpha.npy", &[layout.height, layout.width], alpha)?;
            layers.insert("alpha".to_owned(), "layers/alpha.npy".to_owned());
        }
        let mut preview = preview;
        // sRGB has the primaries of Rec. 709.
        preview.convert(&Conversion::between(contents.colour_space, ColourSpace::LinRec709));
        out.entry("preview.png", &encode_png8(&exposed(preview))?)?;
        let manifest = Manifest {
            format: FORMAT.to_owned(),
            version: VERSION,
            tool: concat!("relume ", env!("CARGO_PKG_VERSION")).to_owned(),
            colour_space: contents.colour_space.id().to_owned(),
            width: layout.width,
            height: layout.height,
            domain: Domain::Directions {
                axis: contents.domain.axis(),
                coverage: contents.domain.coverage(),
                directions: contents.domain.lamps().iter().map(|d| [d.x, d.y, d.z]).collect(),
                irradiance: contents.irradiance.clone(),
            },
            representations: vec![Representation::Dense {
                array: "transport/dense.npy".to_owned(),
                basis: "lamps".to_owned(),
                precision: contents.precision,
                scale,
            }],
            layers,
            provenance: contents.provenance.clone(),
            blake3: std::mem::take(&mut out.blake3),
        };
        out.manifest(&manifest)?;
        ManuallyDrop::into_inner(out.zip).finish().map_err(|error| failed(path, error))?;
        Ok(())
    })
}

/// The scale of the samples; 1 for floats.
fn scale_for(contents: &Contents) -> f32 {
    if contents.precision == Precision::Float { 1.0 } else { power_of_two_for(contents.largest) }
}

/// The power of two that brings the largest number just below [`HALF_CEILING`]; 1 where there is none.
pub(super) fn power_of_two_for(largest: f32) -> f32 {
    if !(largest.is_finite() && largest > 0.0) {
        return 1.0;
    }
    // Kept within what a normal f32 holds.
    ((largest / HALF_CEILING).log2().ceil()).clamp(-100.0, 100.0).exp2()
}

/// Scales the mean picture so that its 98th percentile shows as white.
fn exposed(mut picture: Image) -> Image {
    let mut levels: Vec<f32> = picture.data().to_vec();
    if levels.is_empty() {
        return picture;
    }
    let at = (levels.len() - 1) * 98 / 100;
    let white = *levels.select_nth_unstable_by(at, f32::total_cmp).1;
    if white > 0.0 {
        picture.data_mut().iter_mut().for_each(|v| *v /= white);
    }
    picture
}

pub(super) fn failed(path: &Path, error: zip::result::ZipError) -> Error {
    match error {
        zip::result::ZipError::Io(source) => Error::io("write", path, source),
        other => Error::io("write", path, std::io::Error::other(other)),
    }
}

/// The entries written so far.
pub(super) struct Entries<'a> {
    /// Not dropped after a failure: dropping an unfinished writer tries to finish it, into a file that is about to go, and
    /// complains on the standard error, which is not ours to write to.
    pub zip: ManuallyDrop<ZipWriter<&'a mut BufWriter<File>>>,
    pub path: &'a Path,
    /// Entry -> hash, for the manifest.
    pub blake3: BTreeMap<String, String>,
}

impl Entries<'_> {
    pub fn start(&mut self, name: &str) -> Result<()> {
        let options = SimpleFileOptions::default()
            .compression_method(CompressionMethod::Stored)
            .large_file(true)
            .with_alignment(npy::ALIGNMENT as u16);
        self.zip.start_file(name, options).map_err(|error| failed(self.path, error))
    }

    pub fn append(&mut self, bytes: &[u8], hasher: &mut blake3::Hasher) -> Result<()> {
        hasher.update_rayon(bytes);
        self.zip.write_all(bytes).map_err(|source| Error::io("write", self.path, source))
    }

    pub fn end(&mut self, name: &str, hasher: &blake3::Hasher) {
        self.blake3.insert(name.to_owned(), hasher.finalize().to_hex().to_string());
    }

    pub fn entry(&mut self, name: &str, bytes: &[u8]) -> Result<()> {
        self.start(name)?;
        let mut hasher = blake3::Hasher::new();
        self.append(bytes, &mut hasher)?;
        self.end(name, &hasher);
        Ok(())
    }

    pub fn floats(&mut self, name: &str, shape: &[usize], data: &[f32]) -> Result<()> {
        let mut bytes = npy::header("<f4", shape);
        bytes.extend(data.iter().flat_map(|v| v.to_le_bytes()));
        self.entry(name, &bytes)
    }

    /// The last entry.
    pub fn manifest(&mut self, manifest: &Manifest) -> Result<()> {
        let text =
            serde_json::to_vec_pretty(manifest).map_err(|e| Error::invalid("manifest", e.to_string(), "JSON"))?;
        self.entry("manifest.json", &text)
    }

    /// Streams `T`; returns the mean over its elements, a picture lit from everywhere.
    fn dense(
        &mut self,
        name: &str,
        contents: &Contents,
        layout: Layout,
        scale: f32,
        bands: &mut dyn Bands,
    ) -> Result<Image> {
        self.start(name)?;
        let mut hasher = blake3::Hasher::new();
        self.append(&npy::header(contents.precision.descr(), &layout.shape()), &mut hasher)?;
        let mut preview = Image::new(layout.width, layout.height, CHANNELS);
        let block = CHANNELS * layout.block_len();
        let run = (PIECE_BYTES / (block * size_of::<f32>())).clamp(1, layout.columns());
        let (mut piece, mut bytes) = (Vec::new(), Vec::new());
        for by in 0..layout.rows() {
            for first in (0..layout.columns()).step_by(run) {
                let columns = first..(first + run).min(layout.columns());
                piece.clear();
                piece.resize(columns.len() * block, 0.0f32);
                bands.fill(by, columns.clone(), &mut piece)?;
                encode(&piece, contents.precision, scale, &mut bytes)?;
                self.append(&bytes, &mut hasher)?;
                add_means(&piece, layout, by, columns.start, &mut preview);
            }
        }
        self.end(name, &hasher);
        Ok(preview)
    }
}

/// Rounds numbers to their stored form, little-endian.
fn encode(piece: &[f32], precision: Precision, scale: f32, bytes: &mut Vec<u8>) -> Result<()> {
    bytes.resize(piece.len() * precision.bytes(), 0);
    let down = 1.0 / scale;
    let fits = match precision {
        Precision::Half => bytes.par_chunks_mut(1 << 16).zip(piece.par_chunks(1 << 15)).all(|(out, numbers)| {
            out.chunks_exact_mut(2).zip(numbers).fold(true, |fits, (out, number)| {
                let stored = f16::from_f32(number * down);
                out.copy_from_slice(&stored.to_le_bytes());
                fits & stored.is_finite()
            })
        }),
        Precision::Float => bytes.par_chunks_mut(1 << 16).zip(piece.par_chunks(1 << 14)).all(|(out, numbers)| {
            out.chunks_exact_mut(4).zip(numbers).fold(true, |fits, (out, number)| {
                out.copy_from_slice(&number.to_le_bytes());
                fits & number.is_finite()
            })
        }),
    };
    if fits {
        Ok(())
    } else {
        Err(Error::invalid("field", "a number that is not finite or beyond the stated largest", "finite transport"))
    }
}

/// Adds each block's mean over its elements to the picture.
fn add_means(piece: &[f32], layout: Layout, by: usize, first: usize, picture: &mut Image) {
    let (w, h) = picture.size();
    for (n, block) in piece.chunks_exact(layout.block_len()).enumerate() {
        let (bx, c) = (first + n / CHANNELS, n % CHANNELS);
        let mut sums = [0.0f32; BLOCK_PIXELS];
        for element in block.chunks_exact(BLOCK_PIXELS) {
            sums.iter_mut().zip(element).for_each(|(sum, t)| *sum += t);
        }
        for (k, sum) in sums.iter().enumerate() {
            let (x, y) = (bx * BLOCK_WIDTH + k % BLOCK_WIDTH, by * BLOCK_HEIGHT + k / BLOCK_WIDTH);
            if x < w && y < h {
                picture.pixel_mut(x, y)[c] = sum / layout.elements as f32;
            }
        }
    }
}
