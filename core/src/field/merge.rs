//! A field of a screen from parts of it that were solved apart.
//!
//! A part is a container of the whole picture, whose pixels outside of some rows of blocks have no terms; what else it holds is
//! the same in all parts, as is the scale of its halves, so that merging changes no number.

use std::ops::Range;
use std::path::Path;

use super::BLOCK_PIXELS;
use super::asset::Asset;
use super::manifest::{Kind, Manifest, Precision, Representation};
use super::sparse::{Sparse, TermBuffer};
use super::writer::{BlockTerms, Contents, HALF_CEILING, TermBands, write_terms};
use crate::error::{Error, Result};

/// The name in the provenance under which a part tells its tiles: `[first, last, all]`, from 1; a tile is a row of blocks.
pub const TILES: &str = "tiles";

/// The tiles of a part, from 0, and how many there are in all; `None` for a field that is whole.
///
/// # Errors
/// Numbers that cannot be.
pub fn tiles_of(asset: &Asset) -> Result<Option<(Range<usize>, usize)>> {
    let Some(told) = asset.manifest().provenance.get(TILES) else { return Ok(None) };
    let all = asset.height().div_ceil(super::BLOCK_HEIGHT);
    match serde_json::from_value::<[usize; 3]>(told.clone()) {
        Ok([first, last, of]) if first >= 1 && first <= last && last <= of && of == all => {
            Ok(Some((first - 1..last, of)))
        }
        _ => {
            let place = format!("{}, manifest.json", asset.path().display());
            Err(Error::invalid(place, format!("tiles {told}"), format!("some of 1 to {all}")))
        }
    }
}

/// Writes the field that the parts make together to `output`, whole or not at all. `progress(tiles done, tiles)` may stop it.
///
/// # Errors
/// A container that is no part; parts of different fields, or solved in different ways; tiles that are missing, or there
/// twice; folder absent or full.
pub fn merge(parts: &[Asset], output: &Path, progress: &mut dyn FnMut(u64, u64) -> Result<()>) -> Result<()> {
    let Some(first) = parts.first() else {
        return Err(Error::invalid("parts", "none", "at least one"));
    };
    let of_tile = places(parts)?;
    let (own, sparse) = (whole(first.manifest()), sparse_of(first)?);
    for part in parts {
        if whole(part.manifest()) != own {
            let place = part.path().display().to_string();
            let expected = format!("a part of the same field as {}, solved in the same way", first.path().display());
            return Err(Error::invalid(place, "a part of another field", expected));
        }
    }
    let Some(Representation::Wavelet { most_terms, .. }) = own.representation(Kind::Wavelet) else {
        return Err(no_part(first));
    };
    let basis = sparse.basis();
    let contents = Contents {
        domain: first.domain().clone(),
        irradiance: Vec::new(),
        width: first.width(),
        height: first.height(),
        colour_space: first.colour_space(),
        precision: Precision::Half,
        largest: sparse.scale() * HALF_CEILING,
        ambient: first.ambient().cloned(),
        alpha: first.alpha().map(<[f32]>::to_vec),
        reliability: None,
        provenance: own.provenance.clone(),
    };
    let mut bands = Parts { parts, of_tile: &of_tile, progress };
    write_terms(output, &contents, (basis, *most_terms), &mut bands)
}

/// Which part holds each tile.
fn places(parts: &[Asset]) -> Result<Vec<usize>> {
    let mut of_tile: Vec<Option<usize>> = Vec::new();
    for (n, part) in parts.iter().enumerate() {
        let (tiles, all) = tiles_of(part)?.ok_or_else(|| no_part(part))?;
        of_tile.resize(all.max(of_tile.len()), None);
        for tile in tiles {
            if let Some(other) = of_tile[tile].replace(n) {
                let place = part.path().display().to_string();
                let expected =
                    format!("tiles that no other part has; {} has it as well", parts[other].path().display());
                return Err(Error::invalid(place, format!("tile {}", tile + 1), expected));
            }
        }
    }
    match of_tile.iter().position(Option::is_none) {
        Some(missing) => {
            let expected = format!("parts of all {} tiles; solve it with `relume pack --tiles`", of_tile.len());
            Err(Error::invalid("parts", format!("none with tile {}", missing + 1), expected))
        }
        None => Ok(of_tile.into_iter().flatten().collect()),
    }
}

/// What parts have in common: everything but their tiles and the bytes.
fn whole(manifest: &Manifest) -> Manifest {
    let mut manifest = manifest.clone();
    manifest.blake3.clear();
    if let serde_json::Value::Object(provenance) = &mut manifest.provenance {
        provenance.remove(TILES);
    }
    manifest
}

fn sparse_of(asset: &Asset) -> Result<&Sparse> {
    asset.sparse().filter(|_| asset.domain().plane().is_some()).ok_or_else(|| no_part(asset))
}

fn no_part(asset: &Asset) -> Error {
    let expected = "parts that `relume pack --tiles` wrote";
    Error::invalid(asset.path().display().to_string(), "a field that is whole, or of another kind", expected)
}

/// Terms from whichever part has them.
struct Parts<'a> {
    parts: &'a [Asset],
    of_tile: &'a [usize],
    progress: &'a mut dyn FnMut(u64, u64) -> Result<()>,
}

impl TermBands for Parts<'_> {
    fn fill(&mut self, bx: usize, by: usize, block: &mut BlockTerms) -> Result<()> {
        if bx == 0 {
            (self.progress)(by as u64, self.of_tile.len() as u64)?;
        }
        let sparse = sparse_of(&self.parts[self.of_tile[by]])?;
        let (mut buffer, mut locations) = (TermBuffer::default(), Vec::new());
        let terms = sparse.block(bx, by, &mut buffer)?;
        for k in 0..BLOCK_PIXELS {
            let halves = terms.of_pixel(k, &mut locations);
            block.counts[k] = locations.len() as u32;
            block.locations.extend_from_slice(&locations);
            let triples = halves.as_chunks::<3>().0.iter();
            block.coefficients.extend(triples.map(|rgb| rgb.map(|half| half.to_f32() * sparse.scale())));
        }
        Ok(())
    }
}
