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
use super::manifest::{self, FORMAT, MOST_ELEMENTS, Manifest, Precision, Representation, Stand, VERSION};
use super::npy;
use super::sparse::{TEXELS, places};
use super::terms::{COEFFICIENTS, LOCATIONS, OFFSETS, Term, TermArrays};
use crate::domain::Domain;
use crate::error::{Error, Result};
use crate::files::write_whole;
use crate::image::{ColourSpace, Conversion, Image, encode_png8};
use crate::wavelet::{Transform, Wavelet};

/// `T` is asked for in pieces of about this many bytes (as f32).
const PIECE_BYTES: usize = 64 << 20;
/// Halves are scaled so that the largest number lies below this: a factor of four from their end, 65504.
pub(super) const HALF_CEILING: f32 = 16384.0;

/// What goes into a container beside `T`.
#[derive(Debug, Clone)]
pub struct Contents {
    /// The lamps or texels.
    pub domain: Domain,
    /// E_j: the irradiance that lamp j gave a patch facing it, T_j = photo_j / E_j; of a projector, the radiant intensity of its white
    /// at each position. None of a screen.
    pub irradiance: Vec<f32>,
    /// Columns of the pictures.
    pub width: usize,
    /// Rows of the pictures.
    pub height: usize,
    /// The colours of `T` and the layers.
    pub colour_space: ColourSpace,
    /// How `T` is stored.
    pub precision: Precision,
    /// The largest |T| (coefficient, of wavelets) there can be; it sets the scale of halves.
    pub largest: f32,
    /// `S`: the black photograph, 3 channels.
    pub ambient: Option<Image>,
    /// Coverage of the object, width x height, 0 to 1, row 0 at the top.
    pub alpha: Option<Vec<f32>>,
    /// How far `T` can be trusted, width x height: 1 where what was told apart adds up to what was photographed together (7.5).
    pub reliability: Option<Vec<f32>>,
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

/// A source of terms, one block after another: rows of blocks from the top, in a row from the left.
pub trait TermBands {
    /// The terms of the pixels of a block; `block` comes empty. Pixels past the edges of the picture have none.
    ///
    /// # Errors
    /// Whatever the source meets; [`Error::Cancelled`] to stop.
    fn fill(&mut self, bx: usize, by: usize, block: &mut BlockTerms) -> Result<()>;
}

/// Terms of the pixels of a block.
#[derive(Debug, Clone, PartialEq)]
pub struct BlockTerms {
    /// How many each pixel has, `[8][16]`.
    pub counts: [u32; BLOCK_PIXELS],
    /// Locations, pixel after pixel.
    pub locations: Vec<u32>,
    /// RGB, one triple a location.
    pub coefficients: Vec<[f32; CHANNELS]>,
}

impl Default for BlockTerms {
    fn default() -> Self {
        Self { counts: [0; BLOCK_PIXELS], locations: Vec::new(), coefficients: Vec::new() }
    }
}

/// What terms on a screen are of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TermBasis {
    /// Synthesis functions of a wavelet in the constant-energy normalisation.
    Wavelet(Wavelet),
    /// Texels.
    Texels,
    /// Both: locations from the texels' number on are texels.
    Both(Wavelet),
}

/// Writes a container of samples, whole or not at all. Memory: about 100 MB and one row of the picture, however large the field.
///
/// # Errors
/// Folder absent or full; layers of another size; NaN, or numbers beyond [`Contents::largest`]; what the source returns.
pub fn write(path: &Path, contents: &Contents, bands: &mut dyn Bands) -> Result<()> {
    let layout = layout(contents, contents.domain.len());
    assemble(path, contents, |out| {
        let (array, precision) = ("transport/dense.npy", contents.precision);
        let scale = if precision == Precision::Float { 1.0 } else { power_of_two_for(contents.largest) };
        let even = vec![1.0 / layout.elements as f32; layout.elements];
        let preview = out.dense(array, &Pictures { layout, precision, scale, shown_by: &even }, bands)?;
        let basis = contents.domain.elements().to_owned();
        Ok((Representation::Dense { array: array.to_owned(), basis, precision, scale }, preview))
    })
}

/// Writes a container of pictures under wavelets that a screen showed, at these locations, as [`write()`]: `C_j = T s_j` where
/// the others have `T_j`. Halves.
///
/// # Errors
/// As [`write()`]; a domain that is no screen; a wavelet that cannot be mirrored.
pub fn write_explicit(
    path: &Path,
    contents: &Contents,
    (wavelet, locations): (Wavelet, &[u32]),
    bands: &mut dyn Bands,
) -> Result<()> {
    if contents.domain.plane().is_none() {
        return Err(no_screen());
    }
    let layout = layout(contents, locations.len());
    let transform = on_screen(contents, wavelet)?;
    assemble(path, contents, |out| {
        let (array, of_places) = ("transport/explicit.npy", "transport/explicit-locations.npy");
        let scale = power_of_two_for(contents.largest);
        let mut white = vec![1.0; contents.domain.len()];
        transform.forward(&mut white, 1);
        let shown_by: Vec<f32> = locations.iter().map(|&location| white[location as usize]).collect();
        let precision = Precision::Half;
        let preview = out.dense(array, &Pictures { layout, precision, scale, shown_by: &shown_by }, bands)?;
        let mut bytes = npy::header("<u4", &[locations.len()]);
        bytes.extend(locations.iter().flat_map(|location| location.to_le_bytes()));
        out.entry(of_places, &bytes)?;
        let (wavelet, functions) = (wavelet.id().to_owned(), locations.len());
        let (array, locations) = (array.to_owned(), of_places.to_owned());
        Ok((Representation::Explicit { array, wavelet, locations, functions, scale }, preview))
    })
}

/// Writes a container of terms on a screen, or on the squares of a projector's positions, each pixel its own:
/// `T_p = sum of c_k s_k`; location `position x squares + place`. As [`write()`]; halves, and temporary
/// files beside the container, as large as it.
///
/// # Errors
/// As [`write_explicit`]; locations beyond the screen.
pub fn write_terms(
    path: &Path,
    contents: &Contents,
    (basis, most_terms): (TermBasis, Option<usize>),
    bands: &mut dyn TermBands,
) -> Result<()> {
    let layout = layout(contents, contents.domain.len());
    let Some(picture) = contents.domain.picture() else { return Err(no_screen()) };
    // A projector's positions light as a sphere of lamps would: the mean of them.
    let mut white = vec![picture.len() as f32 / layout.elements as f32; layout.elements];
    let plain = white.clone();
    let with_texels = matches!(basis, TermBasis::Both(_));
    let wavelet = match basis {
        TermBasis::Texels => TEXELS,
        TermBasis::Wavelet(wavelet) | TermBasis::Both(wavelet) => {
            let transform = on_screen(contents, wavelet)?;
            white.chunks_exact_mut(picture.len()).for_each(|picture| transform.inverse_adjoint(picture, 1));
            wavelet.id()
        }
    };
    if with_texels {
        white.extend(plain);
    }
    let places = places(layout.elements, with_texels);
    assemble(path, contents, |out| {
        let scale = power_of_two_for(contents.largest);
        let mut arrays = TermArrays::beside(path, Layout { elements: places, ..layout })?;
        let (mut preview, mut block) = (Image::new(layout.width, layout.height, CHANNELS), BlockTerms::default());
        for (by, bx) in (0..layout.rows()).flat_map(|by| (0..layout.columns()).map(move |bx| (by, bx))) {
            block.counts.fill(0);
            block.locations.clear();
            block.coefficients.clear();
            bands.fill(bx, by, &mut block)?;
            arrays.push(&block.counts, &in_halves(&block, places, scale)?)?;
            add_lit(&block, &white, (bx, by), &mut preview);
        }
        arrays.write(out)?;
        let representation = Representation::Wavelet {
            wavelet: wavelet.to_owned(),
            with_texels,
            grid: [picture.columns(), layout.elements / picture.columns()],
            reconstruction: None,
            offsets: OFFSETS.to_owned(),
            locations: LOCATIONS.to_owned(),
            coefficients: COEFFICIENTS.to_owned(),
            scale,
            most_terms,
            loss: None,
        };
        Ok((representation, preview))
    })
}

fn layout(contents: &Contents, elements: usize) -> Layout {
    Layout { width: contents.width, height: contents.height, elements }
}

fn no_screen() -> Error {
    Error::invalid("field", "wavelets that a screen showed, in a field of lamps", "a field of a screen")
}

fn on_screen(contents: &Contents, wavelet: Wavelet) -> Result<Transform> {
    contents.domain.picture().ok_or_else(no_screen)?.transform(wavelet)
}

/// Rounds the terms of a block.
fn in_halves(block: &BlockTerms, places: usize, scale: f32) -> Result<Vec<Term>> {
    let counted: usize = block.counts.iter().map(|count| *count as usize).sum();
    if counted != block.locations.len() || counted != block.coefficients.len() {
        let found = format!("{counted} terms counted, {} places", block.locations.len());
        return Err(Error::invalid("field", found, "one place and one colour a term"));
    }
    if let Some(beyond) = block.locations.iter().find(|location| **location as usize >= places) {
        let expected = format!("locations below {places}");
        return Err(Error::invalid("field", format!("a term at location {beyond}"), expected));
    }
    let half = |c: f32| f16::from_f32(c / scale);
    Ok(block.locations.iter().zip(&block.coefficients).map(|(at, rgb)| (*at, rgb.map(half))).collect())
}

/// Adds a block under the white screen to the picture.
fn add_lit(block: &BlockTerms, white: &[f32], (bx, by): (usize, usize), picture: &mut Image) {
    let (w, h) = picture.size();
    let mut terms = block.locations.iter().zip(&block.coefficients);
    for (k, count) in block.counts.iter().enumerate() {
        let mut sum = [0.0; CHANNELS];
        for (location, rgb) in terms.by_ref().take(*count as usize) {
            sum.iter_mut().zip(rgb).for_each(|(sum, c)| *sum += c * white[*location as usize]);
        }
        let (x, y) = (bx * BLOCK_WIDTH + k % BLOCK_WIDTH, by * BLOCK_HEIGHT + k / BLOCK_WIDTH);
        if x < w && y < h {
            picture.pixel_mut(x, y).copy_from_slice(&sum);
        }
    }
}

/// What all containers have in common; `transport` writes the arrays, and makes the preview.
fn assemble(
    path: &Path,
    contents: &Contents,
    transport: impl FnOnce(&mut Entries<'_>) -> Result<(Representation, Image)>,
) -> Result<()> {
    let (width, height) = (contents.width, contents.height);
    let (lights, one) = match &contents.domain {
        Domain::Directions(lamps) => (lamps.len(), "one irradiance a lamp"),
        Domain::Gantry(gantry) => (gantry.poses().len(), "one intensity a position"),
        Domain::Plane(..) => (0, "none"),
    };
    if contents.irradiance.len() != lights {
        let found = format!("{} irradiances or intensities", contents.irradiance.len());
        return Err(Error::invalid("field", found, format!("{lights}, {one}")));
    }
    check_elements(&contents.domain)?;
    let ambient_fits = contents.ambient.as_ref().is_none_or(|s| s.size() == (width, height) && s.channels() == 3);
    let fits = |layer: &Option<Vec<f32>>| layer.as_ref().is_none_or(|layer| layer.len() == width * height);
    if width * height == 0 || !ambient_fits || !fits(&contents.alpha) || !fits(&contents.reliability) {
        let expected = format!("{width} x {height} pixels, as the field, and at least one");
        return Err(Error::invalid("field", "layers of another size, or no pixels", expected));
    }
    write_whole(path, |file| {
        let mut out = Entries { zip: ManuallyDrop::new(ZipWriter::new(file)), path, blake3: BTreeMap::new() };
        let (representation, mut preview) = transport(&mut out)?;
        let mut layers = BTreeMap::new();
        if let Some(ambient) = &contents.ambient {
            out.floats("layers/ambient.npy", &[height, width, CHANNELS], ambient.data())?;
            layers.insert("ambient".to_owned(), "layers/ambient.npy".to_owned());
        }
        if let Some(alpha) = &contents.alpha {
            out.floats("layers/alpha.npy", &[height, width], alpha)?;
            layers.insert("alpha".to_owned(), "layers/alpha.npy".to_owned());
        }
        if let Some(reliability) = &contents.reliability {
            out.floats("layers/reliability.npy", &[height, width], reliability)?;
            layers.insert("reliability".to_owned(), "layers/reliability.npy".to_owned());
        }
        // sRGB has the primaries of Rec. 709.
        preview.convert(&Conversion::between(contents.colour_space, ColourSpace::LinRec709));
        out.entry("preview.png", &encode_png8(&exposed(preview))?)?;
        let manifest = Manifest {
            format: FORMAT.to_owned(),
            version: VERSION,
            tool: concat!("relume ", env!("CARGO_PKG_VERSION")).to_owned(),
            colour_space: contents.colour_space.id().to_owned(),
            width,
            height,
            domain: described(contents),
            representations: vec![representation],
            layers,
            provenance: contents.provenance.clone(),
            blake3: std::mem::take(&mut out.blake3),
        };
        out.manifest(&manifest)?;
        ManuallyDrop::into_inner(out.zip).finish().map_err(|error| failed(path, error))?;
        Ok(())
    })
}

/// Refuses a screen of more texels, or a projector of more squares, than a container holds: who solves it should ask before the
/// work.
///
/// # Errors
/// That.
pub fn check_elements(domain: &Domain) -> Result<()> {
    if domain.len() <= MOST_ELEMENTS {
        return Ok(());
    }
    let (place, found, smaller) = match domain {
        Domain::Directions(lamps) => ("the lamps", format!("{} of them", lamps.len()), "fewer lamps"),
        Domain::Plane(plane, _) => {
            let found = format!("{} x {} texels", plane.columns(), plane.rows());
            ("the screen", found, "larger texels (several pixels of the screen each)")
        }
        Domain::Gantry(gantry) => {
            let found = format!("{0} positions of {1} x {1} squares", gantry.poses().len(), gantry.side());
            ("the projector", found, "fewer positions or squares")
        }
    };
    Err(Error::invalid(place, found, format!("at most {MOST_ELEMENTS}: {smaller}")))
}

/// The domain as the manifest has it.
fn described(contents: &Contents) -> manifest::Domain {
    match &contents.domain {
        Domain::Directions(lamps) => manifest::Domain::Directions {
            axis: lamps.axis(),
            coverage: lamps.coverage(),
            directions: lamps.lamps().iter().map(|d| [d.x, d.y, d.z]).collect(),
            irradiance: contents.irradiance.clone(),
        },
        Domain::Plane(plane, correspondence) => manifest::Domain::Plane {
            columns: plane.columns(),
            rows: plane.rows(),
            correspondence: correspondence.clone(),
        },
        Domain::Gantry(gantry) => manifest::Domain::Gantry {
            axis: gantry.directions().axis(),
            coverage: gantry.directions().coverage(),
            positions: gantry.poses().iter().map(Stand::from).collect(),
            intensity: contents.irradiance.clone(),
            squares: gantry.side(),
            view_rad: gantry.view_rad(),
            filter: gantry.filter(),
        },
    }
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

    /// Streams `T`; returns the picture that the preview shows.
    fn dense(&mut self, name: &str, pictures: &Pictures<'_>, bands: &mut dyn Bands) -> Result<Image> {
        let Pictures { layout, precision, scale, .. } = *pictures;
        self.start(name)?;
        let mut hasher = blake3::Hasher::new();
        self.append(&npy::header(precision.descr(), &layout.shape()), &mut hasher)?;
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
                encode(&piece, precision, scale, &mut bytes)?;
                self.append(&bytes, &mut hasher)?;
                add_weighted(&piece, pictures, (columns.start, by), &mut preview);
            }
        }
        self.end(name, &hasher);
        Ok(preview)
    }
}

/// An array of pictures in blocks.
struct Pictures<'a> {
    layout: Layout,
    precision: Precision,
    scale: f32,
    /// The weight of each in the preview.
    shown_by: &'a [f32],
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

/// Adds each block's weighted sum over its elements to the picture.
fn add_weighted(piece: &[f32], pictures: &Pictures<'_>, (first, by): (usize, usize), picture: &mut Image) {
    let (w, h) = picture.size();
    for (n, block) in piece.chunks_exact(pictures.layout.block_len()).enumerate() {
        let (bx, c) = (first + n / CHANNELS, n % CHANNELS);
        let mut sums = [0.0f32; BLOCK_PIXELS];
        for (element, weight) in block.chunks_exact(BLOCK_PIXELS).zip(pictures.shown_by) {
            sums.iter_mut().zip(element).for_each(|(sum, t)| *sum += t * weight);
        }
        for (k, sum) in sums.iter().enumerate() {
            let (x, y) = (bx * BLOCK_WIDTH + k % BLOCK_WIDTH, by * BLOCK_HEIGHT + k / BLOCK_WIDTH);
            if x < w && y < h {
                picture.pixel_mut(x, y)[c] = *sum;
            }
        }
    }
}
