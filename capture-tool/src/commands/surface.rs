//! `relume surface`: normals and albedo from the reflectance functions, as layers of the asset.

use std::path::{Path, PathBuf};

use clap::Args;
use relume_core::acquire::surface;
use relume_core::field::{Access, Asset, NewLayer, add_layers};
use relume_core::files;

use super::note;
use crate::progress::{Progress, Unit};

const EXAMPLES: &str = "\
Examples:
  relume surface vase.rfield -o vase-normals.rfield
  relume surface vase.rfield -o vase.rfield
  relume relight vase.rfield --layer normals -o normals.exr

Pixels whose lamps do not agree on a surface (dark, mirrors, glass, fewer than three lit lamps) get no normal: zero.";

/// Below this share of reliable pixels it is worth a word.
const MOSTLY: f64 = 0.8;

/// Raw flags.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    /// The captured object: a .rfield file.
    asset: PathBuf,
    /// The .rfield file to write: the asset with the layers `normals` and `albedo`. It may be the asset itself.
    #[arg(short, long, value_name = "B.rfield")]
    output: PathBuf,
}

impl Arguments {
    /// Finds the surface and writes it.
    pub fn run(self) -> anyhow::Result<String> {
        files::check_folder(&self.output)?;
        // Read, not mapped: the output may take the asset's place.
        add_surface(&Asset::open(&self.asset, Access::Read)?, &self.output)
    }
}

/// Writes `asset` with normals and albedo to `output`; returns what to say.
pub(super) fn add_surface(asset: &Asset, output: &Path) -> anyhow::Result<String> {
    let mut progress = Progress::new("finding normals", Unit::Steps);
    let found = surface(asset, &mut |done, all| progress.step(done, all))?;
    drop(progress);
    let layers =
        [NewLayer { name: "normals", picture: &found.normals }, NewLayer { name: "albedo", picture: &found.albedo }];
    let about = serde_json::json!({
        "method": "photometric stereo, biweight", "pixels": found.pixels, "reliable": found.reliable,
    });
    let mut progress = Progress::new("writing", Unit::Bytes);
    add_layers(asset, output, &layers, ("surface", about), &mut |done, all| progress.step(done, all))?;
    drop(progress);
    let share = found.reliable as f64 / found.pixels.max(1) as f64;
    if share < MOSTLY {
        note(&format!(
            "{:.0} % of the pixels have no normal (zero): dark, mirror-like or transparent, or lit by too few lamps",
            100.0 * (1.0 - share)
        ));
    }
    let named = output.display();
    Ok(format!("{named}: normals and albedo of {} of {} pixels\n", found.reliable, found.pixels))
}
