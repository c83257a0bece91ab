//! Bundles and libraries: finding the binary, mapping it, reading its plugins.

use std::ffi::{CStr, c_int};
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use libloading::{Library, Symbol};
use tempfile::TempDir;

use super::log::Rule;
use super::ofx::*;
use super::shared::Shared;

/// A mapped library and one of its plugins, which lives as long.
pub struct Opened {
    pub library: Library,
    pub plugin: *const OfxPlugin,
}

/// Copies a bundle into a temporary folder: the dynamic linker maps a copy anew, with its own statics.
pub fn private_copy(bundle: &Path) -> Result<(PathBuf, TempDir), String> {
    let folder = tempfile::tempdir().map_err(|error| format!("no temporary folder: {error}"))?;
    let name = bundle.file_name().ok_or_else(|| format!("{} is no bundle", bundle.display()))?;
    let copy = folder.path().join(name);
    copy_tree(bundle, &copy).map_err(|error| format!("cannot copy {}: {error}", bundle.display()))?;
    Ok((copy, folder))
}

fn copy_tree(from: &Path, to: &Path) -> std::io::Result<()> {
    if !from.is_dir() {
        return fs::copy(from, to).map(drop);
    }
    fs::create_dir_all(to)?;
    fs::read_dir(from)?.try_for_each(|entry| {
        let entry = entry?;
        copy_tree(&entry.path(), &to.join(entry.file_name()))
    })
}

fn architectures() -> &'static [&'static str] {
    if cfg!(windows) {
        &["Win64"]
    } else if cfg!(target_os = "macos") {
        &["MacOS"]
    } else if cfg!(target_arch = "aarch64") {
        &["Linux-aarch64", "Linux-arm64"]
    } else {
        &["Linux-x86-64"]
    }
}

fn binary_of(shared: &Shared, bundle: &Path) -> Result<PathBuf, String> {
    let contents = bundle.join("Contents");
    let stem = bundle.file_name().and_then(|name| name.to_str()).and_then(|name| name.strip_suffix(".ofx.bundle"));
    let stem = stem.ok_or_else(|| format!("{} is not called NAME.ofx.bundle", bundle.display()))?;
    if !contents.join("Info.plist").is_file() {
        shared.violate(Rule::Missing, "the bundle has no Contents/Info.plist");
    }
    let candidates = architectures().iter().map(|folder| contents.join(folder).join(format!("{stem}.ofx")));
    candidates
        .clone()
        .find(|path| path.is_file())
        .ok_or_else(|| format!("there is none of {:?}", candidates.collect::<Vec<_>>()))
}

/// Maps a bundle's binary and picks a plugin: the first, or that of an identifier.
pub fn open(shared: &Arc<Shared>, bundle: &Path, id: Option<&str>, host: &'static OfxHost) -> Result<Opened, String> {
    let path = binary_of(shared, bundle)?;
    // SAFETY: the project's own library, whose initialisers do nothing but what Rust's do.
    let library = unsafe { Library::new(&path) }.map_err(|error| format!("cannot load {}: {error}", path.display()))?;
    let plugin = pick(&library, id, host)?;
    Ok(Opened { library, plugin })
}

/// The identifiers of all plugins of a bundle's binary, in its order.
pub fn identifiers(shared: &Arc<Shared>, bundle: &Path) -> Result<Vec<String>, String> {
    let path = binary_of(shared, bundle)?;
    // SAFETY: as in `open`.
    let library = unsafe { Library::new(&path) }.map_err(|error| format!("cannot load {}: {error}", path.display()))?;
    // SAFETY: the identifier of a plugin struct of the library is NUL-terminated; copied before the library goes.
    let text =
        |plugin: *const OfxPlugin| unsafe { CStr::from_ptr((*plugin).pluginIdentifier) }.to_string_lossy().into();
    Ok(plugins(&library)?.into_iter().map(text).collect())
}

type Count = unsafe extern "C" fn() -> c_int;
type Get = unsafe extern "C" fn(c_int) -> *const OfxPlugin;
type SetHost = unsafe extern "C" fn(*const OfxHost) -> OfxStatus;

fn pick(library: &Library, id: Option<&str>, host: &'static OfxHost) -> Result<*const OfxPlugin, String> {
    // SAFETY: the standard fixes the type of this symbol (optional, since 1.4).
    if let Ok(set_host) = unsafe { library.get::<SetHost>(b"OfxSetHost\0") } {
        // SAFETY: the host lives for ever.
        let status = unsafe { set_host(host) };
        if ![kOfxStatOK, kOfxStatReplyDefault].contains(&status) {
            return Err(format!("OfxSetHost answered {}", status_name(status)));
        }
    }
    let plugins = plugins(library)?;
    let count = plugins.len();
    let found = plugins.into_iter().find(|&plugin| match id {
        None => true,
        // SAFETY: a plugin struct of the library, whose identifier is NUL-terminated.
        Some(id) => unsafe { CStr::from_ptr((*plugin).pluginIdentifier) }.to_bytes() == id.as_bytes(),
    });
    found.ok_or_else(|| format!("none of its {count} plugins fits {id:?}"))
}

/// All plugins of a library.
fn plugins(library: &Library) -> Result<Vec<*const OfxPlugin>, String> {
    // SAFETY: the standard fixes the types of these two symbols.
    let symbols: Result<(Symbol<Count>, Symbol<Get>), _> = unsafe {
        library.get(b"OfxGetNumberOfPlugins\0").and_then(|count| Ok((count, library.get(b"OfxGetPlugin\0")?)))
    };
    let (count, get) = symbols.map_err(|error| format!("an export is missing: {error}"))?;
    // SAFETY: without arguments.
    let count = unsafe { count() };
    // SAFETY: the index is in range.
    Ok((0..count).map(|at| unsafe { get(at) }).filter(|plugin| !plugin.is_null()).collect())
}
