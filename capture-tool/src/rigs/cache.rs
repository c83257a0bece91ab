//! Traced scenes: kept under a name made of all that they depend on.

use std::fs;
use std::path::{Path, PathBuf};

use relume_core::files::folder_of;
use relume_core::{Error, Result};

use super::RigFile;

/// Counts changes of the virtual scenes, so that older traces are not taken for new ones.
const SCENES: u32 = 1;

/// The file of a rig's scene.
///
/// # Errors
/// No home folder.
pub fn file(rig: &RigFile, geometry: &str, extension: &str) -> Result<PathBuf> {
    let simulation = &rig.simulation;
    let told = format!(
        "{} {SCENES} {} {} {} {} {geometry}",
        env!("CARGO_PKG_VERSION"),
        simulation.width,
        simulation.height,
        simulation.samples,
        simulation.seed
    );
    let hash = blake3::hash(told.as_bytes()).to_hex();
    Ok(folder()?.join(format!("virtual-{}.{extension}", &hash.as_str()[..16])))
}

/// `RELUME_CACHE`, or the system's folder for what can be made again.
fn folder() -> Result<PathBuf> {
    let folder = std::env::var_os("RELUME_CACHE").map(PathBuf::from);
    folder.or_else(|| dirs::cache_dir().map(|folder| folder.join("relume"))).ok_or_else(|| {
        Error::invalid("the cache folder", "no home folder", "one, or its name in the variable RELUME_CACHE")
    })
}

/// Makes the folder that a file is to lie in.
///
/// # Errors
/// The disk's.
pub fn make_room(file: &Path) -> Result<()> {
    let folder = folder_of(file);
    fs::create_dir_all(folder).map_err(|source| Error::io("create", folder, source))
}
