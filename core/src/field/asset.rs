//! An open container.

use std::path::Path;
use std::sync::Arc;

use rayon::prelude::*;

use super::archive::{self, Entries};
use super::dense::{Dense, Layout};
use super::manifest::{Manifest, Representation};
use super::npy;
use super::store::{Access, Scratch, Store};
use crate::domain::Directions;
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
    domain: Arc<Directions>,
    dense: Dense,
    ambient: Option<Image>,
    alpha: Option<Vec<f32>>,
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
            manifest.directions().map_err(|error| Error::invalid(&place, error.to_string(), "a usable domain"))?;
        let colour_space = manifest.colours()?;
        let store = Arc::new(Store::open(path, access)?);
        let layout = Layout { width: manifest.width, height: manifest.height, elements: domain.len() };
        let Representation::Dense { array, precision, scale, .. } = &manifest.representation;
        let open = Opening { store: &store, entries: &entries, place: &place };
        let start = open.array(array, precision.descr(), &layout.shape(), precision.bytes())?.start;
        let dense = Dense { store: store.clone(), start, layout, precision: *precision, scale: *scale };
        let (w, h) = (manifest.width, manifest.height);
        let layer = |name: &str, shape: &[usize]| -> Result<Option<Vec<f32>>> {
            manifest.layers.get(name).map(|entry| open.layer(entry, shape)).transpose()
        };
        let ambient = layer("ambient", &[h, w, 3])?.map(|data| Image::from_data(w, h, 3, data)).transpose()?;
        let alpha = layer("alpha", &[h, w])?;
        if let Some(at) = alpha.iter().flatten().position(|a| !(0.0..=1.0).contains(a)) {
            let place = format!("{place}, layers/alpha.npy, pixel ({}, {})", at % w, at / w);
            return Err(Error::invalid(place, "a number outside 0 to 1", "a coverage"));
        }
        Ok(Self { manifest, colour_space, domain: Arc::new(domain), dense, ambient, alpha, entries, store })
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

    /// The lamps.
    pub fn domain(&self) -> &Arc<Directions> {
        &self.domain
    }

    /// `T`.
    pub fn dense(&self) -> &Dense {
        &self.dense
    }

    /// `S`, what is seen with every lamp off, if it was photographed; width x height x 3.
    pub fn ambient(&self) -> Option<&Image> {
        self.ambient.as_ref()
    }

    /// Coverage of the object, 0 to 1, width x height, row 0 at the top.
    pub fn alpha(&self) -> Option<&[f32]> {
        self.alpha.as_deref()
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

/// What opening an array needs.
struct Opening<'a> {
    store: &'a Store,
    entries: &'a Entries,
    place: &'a str,
}

impl Opening<'_> {
    /// Where the numbers of an array lie, once its header and size are right.
    fn array(&self, entry: &str, descr: &str, shape: &[usize], bytes: usize) -> Result<std::ops::Range<u64>> {
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
        let range = self.array(entry, "<f4", shape, 4)?;
        let mut scratch = Scratch::default();
        let bytes = self.store.get(range.start, (range.end - range.start) as usize, &mut scratch)?;
        let data: Vec<f32> = bytes.par_chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect();
        match data.iter().position(|v| !v.is_finite()) {
            Some(at) => Err(Error::invalid(
                format!("{}, {entry}, number {at}", self.place),
                data[at].to_string(),
                "a finite number",
            )),
            None => Ok(data),
        }
    }
}
