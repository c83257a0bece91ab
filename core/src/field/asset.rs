//! An open container.

use std::ops::Range;
use std::path::Path;
use std::sync::{Arc, OnceLock};

use rayon::prelude::*;

use super::archive::{self, Entries};
use super::dense::{Dense, Layout};
use super::explicit::Explicit;
use super::factored::{Described, Factored};
use super::harmonics::Harmonics;
use super::manifest::{Kind, Manifest, Precision, Representation};
use super::npy;
use super::samples::Samples;
use super::sparse::Sparse;
use super::store::{Access, Scratch, Store};
use crate::domain::{Directions, Domain};
use crate::error::{Error, Result};
use crate::image::{ColourSpace, Image};

/// How much is hashed at a time.
const HASH_CHUNK: u64 = 16 << 20;

/// An open `.rfield`: its manifest, lamps and layers in memory, its arrays mapped or read when needed. Everything but the
/// hashes of the arrays was checked when it was opened.
#[derive(Debug)]
pub struct Asset {
    manifest: Manifest,
    colour_space: ColourSpace,
    domain: Domain,
    dense: Option<Dense>,
    harmonics: Option<Harmonics>,
    factored: Option<Factored>,
    sparse: Option<Sparse>,
    explicit: Option<Explicit>,
    ambient: Option<Image>,
    alpha: Option<Vec<f32>>,
    reliability: Option<Vec<f32>>,
    normals: Option<Picture>,
    albedo: Option<Picture>,
    entries: Entries,
    store: Arc<Store>,
}

impl Asset {
    /// Opens a container.
    ///
    /// # Errors
    /// A sentence that names the file, the entry, what was found and what was expected: not a container, truncated, a
    /// newer version, an array whose size does not fit the manifest, NaN in a layer.
    pub fn open(path: &Path, access: Access) -> Result<Self> {
        let entries = archive::list(path)?;
        let place = path.display().to_string();
        let manifest = Manifest::parse(&archive::manifest_bytes(path, &entries)?, &place)?;
        let domain =
            manifest.emitter().map_err(|error| Error::invalid(&place, error.to_string(), "a usable domain"))?;
        let colour_space = manifest.colours()?;
        let store = Arc::new(Store::open(path, access)?);
        let open = Opening { store: &store, entries: &entries, place: &place };
        let (w, h) = (manifest.width, manifest.height);
        let (mut dense, mut harmonics, mut factored, mut sparse, mut explicit) = (None, None, None, None, None);
        for representation in &manifest.representations {
            if let Some(loss) = representation.loss() {
                open.array(&loss.errors, Precision::Half.descr(), &[h, w], Precision::Half.bytes())?;
            }
            match representation {
                Representation::Dense { array, precision, scale, .. } => {
                    let layout = Layout { width: w, height: h, elements: domain.len() };
                    dense = Some(open.dense(array, layout, *precision, *scale)?);
                }
                Representation::Harmonics { array, functions, scale, .. } => {
                    let layout = Layout { width: w, height: h, elements: *functions };
                    let pictures = open.dense(array, layout, Precision::Half, *scale)?;
                    // The manifest has none for screens.
                    harmonics = domain.directions().map(|lamps| Harmonics::new(pictures, lamps));
                }
                Representation::Factored { tile, ranks, left, right, scale, .. } => {
                    let layout = Layout { width: w, height: h, elements: domain.len() };
                    let described = Described { layout, tile: *tile, ranks, left, right, scale: *scale };
                    factored = Some(Factored::open(&open, &store, &described)?);
                }
                Representation::Wavelet { .. } => sparse = Sparse::open(&open, &domain, (w, h), representation)?,
                Representation::Explicit { array, wavelet, locations, functions, scale } => {
                    let layout = Layout { width: w, height: h, elements: *functions };
                    let pictures = open.dense(array, layout, Precision::Half, *scale)?;
                    let at = open.array(locations, "<u4", &[*functions], 4)?;
                    explicit = Explicit::open(&open, pictures, &domain, wavelet, at)?;
                }
            }
        }
        let layer = |name: &str, shape: &[usize]| -> Result<Option<Vec<f32>>> {
            manifest.layers.get(name).map(|entry| open.layer(entry, shape)).transpose()
        };
        let ambient = layer("ambient", &[h, w, 3])?.map(|data| Image::from_data(w, h, 3, data)).transpose()?;
        let alpha = layer("alpha", &[h, w])?;
        if let Some(at) = alpha.iter().flatten().position(|a| !(0.0..=1.0).contains(a)) {
            let place = format!("{place}, layers/alpha.npy, pixel ({}, {})", at % w, at / w);
            return Err(Error::invalid(place, "a number outside 0 to 1", "a coverage"));
        }
        let reliability = layer("reliability", &[h, w])?;
        let picture = |name: &str| -> Result<Option<Picture>> {
            let entry = manifest.layers.get(name);
            entry.map(|entry| Ok(Picture::new(entry, open.array(entry, "<f4", &[h, w, 3], 4)?))).transpose()
        };
        let (normals, albedo) = (picture("normals")?, picture("albedo")?);
        Ok(Self {
            manifest,
            colour_space,
            domain,
            dense,
            harmonics,
            factored,
            sparse,
            explicit,
            ambient,
            alpha,
            reliability,
            normals,
            albedo,
            entries,
            store,
        })
    }

    /// Where it lies.
    pub fn path(&self) -> &Path {
        self.store.path()
    }

    /// Bytes on disk.
    pub fn file_len(&self) -> u64 {
        self.store.length()
    }

    /// What it says of itself.
    pub fn manifest(&self) -> &Manifest {
        &self.manifest
    }

    /// The colours of transport and layers.
    pub fn colour_space(&self) -> ColourSpace {
        self.colour_space
    }

    /// Columns of the pictures.
    pub fn width(&self) -> usize {
        self.manifest.width
    }

    /// Rows of the pictures.
    pub fn height(&self) -> usize {
        self.manifest.height
    }

    /// What the rig could emit.
    pub fn domain(&self) -> &Domain {
        &self.domain
    }

    /// The lamps.
    ///
    /// # Errors
    /// A field of a screen or of a projector, which have none.
    pub fn directions(&self) -> Result<&Arc<Directions>> {
        self.domain.directions().ok_or_else(|| {
            let (what, advice) = match &self.domain {
                Domain::Gantry(_) => (
                    "what needs lamps at infinity, on a field of a projector near the object,",
                    "light it with `relume relight`, or look from the projector's side with `relume dual`",
                ),
                _ => (
                    "light from all round on a field of a screen",
                    "light it with a picture: `relume matte`, `relume relight --plane`, or Relume Environment Matte",
                ),
            };
            let place = self.path().display().to_string();
            Error::Unsupported { place, what: what.to_owned(), advice: advice.to_owned() }
        })
    }

    /// The samples at the lamps or texels, as photographed, if the asset holds them.
    pub fn dense(&self) -> Option<&Dense> {
        self.dense.as_ref()
    }

    /// The spherical harmonics, if the asset holds them.
    pub fn harmonics(&self) -> Option<&Harmonics> {
        self.harmonics.as_ref()
    }

    /// The factored field, if the asset holds one.
    pub fn factored(&self) -> Option<&Factored> {
        self.factored.as_ref()
    }

    /// The wavelet coefficients, if the asset holds them.
    pub fn sparse(&self) -> Option<&Sparse> {
        self.sparse.as_ref()
    }

    /// The answers to the wavelets that a screen showed, if the asset holds them.
    pub fn explicit(&self) -> Option<&Explicit> {
        self.explicit.as_ref()
    }

    /// The samples at the lamps, as photographed or decoded.
    ///
    /// # Errors
    /// An asset that holds none: one compressed to wavelets or harmonics alone.
    pub fn samples(&self) -> Result<Samples<'_>> {
        if let Some(dense) = &self.dense {
            return Ok(Samples::Dense(dense));
        }
        if let Some(factored) = &self.factored {
            return Ok(Samples::Factored(factored));
        }
        let held: Vec<&str> = self.manifest.representations.iter().map(|r| r.kind().id()).collect();
        Err(Error::Unsupported {
            place: self.path().display().to_string(),
            what: format!("looking at the samples of a field that holds {} alone", held.join(" and ")),
            advice: "use the asset that it was compressed from".to_owned(),
        })
    }

    /// `e_p` of a lossy representation, width x height, row 0 at the top: the largest over the channels of the absolute error
    /// of the reflectance function of each pixel, so that a picture is off by at most `e_p ||w||` there. Zeros for the
    /// samples themselves, nothing where the asset does not hold the kind.
    ///
    /// # Errors
    /// Bytes that cannot be read; numbers that are negative or not finite.
    pub fn errors(&self, kind: Kind) -> Result<Option<Vec<f32>>> {
        let Some(representation) = self.manifest.representation(kind) else { return Ok(None) };
        let (w, h) = (self.width(), self.height());
        let Some(loss) = representation.loss() else { return Ok(Some(vec![0.0; w * h])) };
        let place = self.path().display().to_string();
        let open = Opening { store: &self.store, entries: &self.entries, place: &place };
        let range = open.array(&loss.errors, Precision::Half.descr(), &[h, w], Precision::Half.bytes())?;
        let mut scratch = Scratch::default();
        let bytes = self.store.get(range.start, (range.end - range.start) as usize, &mut scratch)?;
        let half = |b: &[u8]| half::f16::from_le_bytes([b[0], b[1]]).to_f32() * loss.scale;
        let errors: Vec<f32> = bytes.chunks_exact(2).map(half).collect();
        match errors.iter().position(|e| !(e.is_finite() && *e >= 0.0)) {
            Some(at) => {
                let place = format!("{place}, {}, pixel ({}, {})", loss.errors, at % w, at / w);
                Err(Error::invalid(place, errors[at].to_string(), "an error, finite and not negative"))
            }
            None => Ok(Some(errors)),
        }
    }

    /// Bytes of a representation, its error map left out; 0 where the asset does not hold the kind.
    pub fn bytes(&self, kind: Kind) -> u64 {
        let representation = self.manifest.representation(kind);
        let errors = representation.and_then(|r| r.loss()).map(|loss| &loss.errors);
        let own = representation.map(|r| r.entries()).unwrap_or_default();
        let arrays = own.iter().filter(|entry| errors.is_none_or(|errors| errors != **entry));
        arrays.filter_map(|entry| self.entries.get(*entry)).map(|range| range.end - range.start).sum()
    }

    /// `S`, what is seen with every lamp off, if it was photographed; width x height x 3.
    pub fn ambient(&self) -> Option<&Image> {
        self.ambient.as_ref()
    }

    /// Coverage of the object, 0 to 1, width x height, row 0 at the top.
    pub fn alpha(&self) -> Option<&[f32]> {
        self.alpha.as_deref()
    }

    /// How far `T` can be trusted, width x height, row 0 at the top: 1 where what was told apart adds up to what was photographed
    /// together (7.5).
    pub fn reliability(&self) -> Option<&[f32]> {
        self.reliability.as_deref()
    }

    /// Unit normals in the stage frame, width x height x 3, zero where unreliable; read from the file on first use.
    ///
    /// # Errors
    /// Bytes that cannot be read; numbers that are not finite; a vector that is neither zero nor of unit length.
    pub fn normals(&self) -> Result<Option<&Image>> {
        let check = |n: &[f32]| {
            let square: f32 = n.iter().map(|v| v * v).sum();
            // Halves and quantised maps of other makers are a little off.
            square == 0.0 || (0.98..1.02).contains(&square)
        };
        self.normals.as_ref().map(|layer| layer.get(self, check, "a unit vector, or zero")).transpose()
    }

    /// Diffuse albedo, linear RGB, width x height x 3, zero where unreliable; read from the file on first use.
    ///
    /// # Errors
    /// Bytes that cannot be read; numbers that are negative or not finite.
    pub fn albedo(&self) -> Result<Option<&Image>> {
        let check = |a: &[f32]| a.iter().all(|v| *v >= 0.0);
        self.albedo.as_ref().map(|layer| layer.get(self, check, "no negative number")).transpose()
    }

    /// Where every entry lies.
    pub(super) fn entries(&self) -> &Entries {
        &self.entries
    }

    /// The file.
    pub(super) fn store(&self) -> &Store {
        &self.store
    }

    /// Checks the BLAKE3 of every entry against the manifest; `progress(done, total)` in bytes may stop it.
    ///
    /// # Errors
    /// The first entry (by name) that differs, is not listed, or is listed and absent.
    pub fn verify(&self, progress: &mut dyn FnMut(u64, u64) -> Result<()>) -> Result<()> {
        let place = |entry: &str| format!("{}, {entry}", self.path().display());
        let listed = &self.manifest.blake3;
        if let Some(absent) = listed.keys().find(|name| !self.entries.contains_key(*name)) {
            return Err(Error::invalid(place(absent), "no such entry", "the entry that the manifest lists"));
        }
        let total: u64 = self.entries.values().map(|range| range.end - range.start).sum();
        let mut done = 0;
        for (name, range) in self.entries.iter().filter(|entry| entry.0 != "manifest.json") {
            let expected = listed
                .get(name)
                .ok_or_else(|| Error::invalid(place(name), "an entry", "only entries that the manifest lists"))?;
            let mut hasher = blake3::Hasher::new();
            let mut scratch = Scratch::default();
            let mut at = range.start;
            while at < range.end {
                let length = HASH_CHUNK.min(range.end - at);
                hasher.update_rayon(self.store.get(at, length as usize, &mut scratch)?);
                at += length;
                done += length;
                progress(done, total)?;
            }
            let found = hasher.finalize().to_hex().to_string();
            if !found.eq_ignore_ascii_case(expected) {
                return Err(Error::invalid(
                    place(name),
                    format!("BLAKE3 {found}: the bytes have changed"),
                    expected.clone(),
                ));
            }
        }
        Ok(())
    }
}

/// A layer that most users never look at: found and measured when the container is opened, read when it is wanted.
#[derive(Debug)]
struct Picture {
    entry: String,
    range: Range<u64>,
    picture: OnceLock<Image>,
}

impl Picture {
    fn new(entry: &str, range: Range<u64>) -> Self {
        Self { entry: entry.to_owned(), range, picture: OnceLock::new() }
    }

    /// The picture; every pixel must pass `check`. Two threads that come first both read it; the result is the same.
    fn get(&self, asset: &Asset, check: impl Fn(&[f32]) -> bool, expected: &str) -> Result<&Image> {
        if let Some(picture) = self.picture.get() {
            return Ok(picture);
        }
        let place = format!("{}, {}", asset.path().display(), self.entry);
        let data = floats(&asset.store, &self.range, &place)?;
        if let Some(at) = data.chunks_exact(3).position(|pixel| !check(pixel)) {
            let (x, y) = (at % asset.width(), at / asset.width());
            let found = format!("{:?}", &data[3 * at..3 * at + 3]);
            return Err(Error::invalid(format!("{place}, pixel ({x}, {y})"), found, expected));
        }
        let picture = Image::from_data(asset.width(), asset.height(), 3, data)?;
        Ok(self.picture.get_or_init(|| picture))
    }
}

/// The numbers of a float layer; NaN and infinities are refused.
fn floats(store: &Store, range: &Range<u64>, place: &str) -> Result<Vec<f32>> {
    let mut scratch = Scratch::default();
    let bytes = store.get(range.start, (range.end - range.start) as usize, &mut scratch)?;
    let data: Vec<f32> = bytes.par_chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect();
    match data.iter().position(|v| !v.is_finite()) {
        Some(at) => Err(Error::invalid(format!("{place}, number {at}"), data[at].to_string(), "a finite number")),
        None => Ok(data),
    }
}

/// What opening an array needs.
pub(super) struct Opening<'a> {
    pub store: &'a Arc<Store>,
    entries: &'a Entries,
    pub place: &'a str,
}

impl Opening<'_> {
    /// How an entry is named in messages.
    pub fn at(&self, entry: &str) -> String {
        format!("{}, {entry}", self.place)
    }

    /// Coefficient pictures in blocks.
    fn dense(&self, entry: &str, layout: Layout, precision: Precision, scale: f32) -> Result<Dense> {
        let start = self.array(entry, precision.descr(), &layout.shape(), precision.bytes())?.start;
        Ok(Dense { store: Arc::clone(self.store), start, layout, precision, scale })
    }

    /// Where the numbers of an array lie, once its header and size are right.
    pub fn array(&self, entry: &str, descr: &str, shape: &[usize], bytes: usize) -> Result<Range<u64>> {
        let place = format!("{}, {entry}", self.place);
        let range = self
            .entries
            .get(entry)
            .ok_or_else(|| Error::invalid(&place, "no such entry", "the array that the manifest names"))?;
        let length = range.end - range.start;
        let mut scratch = Scratch::default();
        let head = self.store.get(range.start, length.min(npy::LONGEST_HEADER as u64) as usize, &mut scratch)?;
        let header = npy::check_header(head, descr, shape, &place)? as u64;
        let numbers = shape.iter().try_fold(bytes as u64, |product, &n| product.checked_mul(n as u64));
        if numbers.and_then(|n| n.checked_add(header)) != Some(length) {
            let expected = numbers
                .map_or("a size that fits in 64 bits".to_owned(), |n| format!("{} for shape {shape:?}", n + header));
            return Err(Error::invalid(place, format!("{length} bytes"), expected));
        }
        let start = range.start + header;
        if !start.is_multiple_of(npy::ALIGNMENT as u64) {
            return Err(Error::invalid(place, format!("data at byte {start}"), "data aligned to 64 bytes"));
        }
        Ok(start..range.end)
    }

    /// A whole float layer in memory; NaN and infinities are refused.
    fn layer(&self, entry: &str, shape: &[usize]) -> Result<Vec<f32>> {
        floats(self.store, &self.array(entry, "<f4", shape, 4)?, &format!("{}, {entry}", self.place))
    }
}
