//! A container made from another: what is kept is copied as it is, byte by byte.

use std::collections::BTreeMap;
use std::mem::ManuallyDrop;
use std::path::Path;

use zip::ZipWriter;

use super::asset::Asset;
use super::manifest::{Manifest, VERSION};
use super::store::Scratch;
use super::writer::{Entries, failed};
use crate::error::{Error, Result};
use crate::files::write_whole;
use crate::image::Image;

/// How much is copied at a time.
const CHUNK: u64 = 16 << 20;

/// A picture of three channels to put beside `T`.
#[derive(Debug, Clone, Copy)]
pub struct NewLayer<'a> {
    /// Its name: letters, digits, `_`, `-`. One of that name is replaced.
    pub name: &'a str,
    /// The picture, of the field's size.
    pub picture: &'a Image,
}

/// Writes `asset` with `layers` added to `output`, which may be the asset's own file; `note` is a name and a value for the
/// provenance. The other entries are copied, and checked against their hashes on the way; `progress(done, total)` counts bytes
/// and may stop it. Whole or not at all.
///
/// # Errors
/// Layers of another size; entries that were damaged; folder absent or full; what `progress` returns.
pub fn add_layers(
    asset: &Asset,
    output: &Path,
    layers: &[NewLayer<'_>],
    note: (&str, serde_json::Value),
    progress: &mut dyn FnMut(u64, u64) -> Result<()>,
) -> Result<()> {
    let (width, height) = (asset.width(), asset.height());
    if let Some(wrong) = layers.iter().find(|l| l.picture.size() != (width, height) || l.picture.channels() != 3) {
        let found = format!("{} x {} x {}", wrong.picture.width(), wrong.picture.height(), wrong.picture.channels());
        return Err(Error::invalid(format!("layer `{}`", wrong.name), found, format!("{width} x {height} x 3")));
    }
    let entry = |name: &str| format!("layers/{name}.npy");
    let kept = |name: &str| !layers.iter().any(|layer| entry(layer.name) == name);
    rewrite(asset, output, &kept, progress, |out, manifest| {
        for layer in layers {
            out.floats(&entry(layer.name), &[height, width, 3], layer.picture.data())?;
            manifest.layers.insert(layer.name.to_owned(), entry(layer.name));
        }
        annotate(manifest, note);
        Ok(())
    })
}

/// Puts a name and a value into the provenance.
pub(super) fn annotate(manifest: &mut Manifest, (name, value): (&str, serde_json::Value)) {
    if let serde_json::Value::Object(provenance) = &mut manifest.provenance {
        provenance.insert(name.to_owned(), value);
    }
}

/// Writes the entries of `asset` that are `kept` to `output`, then what `add` adds to them and to the manifest. Copies are
/// checked against their hashes; `progress(done, total)` counts their bytes. Whole or not at all.
///
/// # Errors
/// Entries that were damaged; folder absent or full; what `progress` and `add` return.
pub(super) fn rewrite(
    asset: &Asset,
    output: &Path,
    kept: &dyn Fn(&str) -> bool,
    progress: &mut dyn FnMut(u64, u64) -> Result<()>,
    add: impl FnOnce(&mut Entries<'_>, &mut Manifest) -> Result<()>,
) -> Result<()> {
    let mut manifest = asset.manifest().clone();
    manifest.version = VERSION;
    let copied: Vec<(&String, u64)> = asset
        .entries()
        .iter()
        .filter(|(name, _)| *name != "manifest.json" && kept(name))
        .map(|(name, range)| (name, range.end - range.start))
        .collect();
    let total = copied.iter().map(|(_, length)| length).sum();
    write_whole(output, |file| {
        let mut out = Entries { zip: ManuallyDrop::new(ZipWriter::new(file)), path: output, blake3: BTreeMap::new() };
        let mut done = 0;
        for (name, _) in &copied {
            copy(asset, name, &mut out, &mut |bytes| {
                done += bytes;
                progress(done, total)
            })?;
        }
        add(&mut out, &mut manifest)?;
        manifest.blake3 = std::mem::take(&mut out.blake3);
        out.manifest(&manifest)?;
        ManuallyDrop::into_inner(out.zip).finish().map_err(|error| failed(output, error))?;
        Ok(())
    })
}

/// Copies one entry; what is copied must still be what was hashed when it was made.
fn copy(asset: &Asset, name: &str, out: &mut Entries<'_>, step: &mut dyn FnMut(u64) -> Result<()>) -> Result<()> {
    let range = &asset.entries()[name];
    let (mut hasher, mut scratch) = (blake3::Hasher::new(), Scratch::default());
    out.start(name)?;
    let mut at = range.start;
    while at < range.end {
        let length = CHUNK.min(range.end - at);
        out.append(asset.store().get(at, length as usize, &mut scratch)?, &mut hasher)?;
        at += length;
        step(length)?;
    }
    out.end(name, &hasher);
    let found = hasher.finalize().to_hex().to_string();
    match asset.manifest().blake3.get(name) {
        Some(listed) if !listed.eq_ignore_ascii_case(&found) => Err(Error::invalid(
            format!("{}, {name}", asset.path().display()),
            format!("BLAKE3 {found}: the bytes have changed"),
            listed.clone(),
        )),
        _ => Ok(()),
    }
}
