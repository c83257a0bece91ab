//! `relume compare`: figures of how far one picture is from another.

use std::path::{Path, PathBuf};

use anyhow::Context;
use clap::Args;
use relume_core::evaluate::compare;
use relume_core::image::{Encoding, Image, read};

const EXAMPLES: &str = "\
Examples:
  relume compare relit.exr truth.exr
  relume compare relit.exr truth.exr --mask diffuse.png --json";

/// Raw flags.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    /// The picture to judge (EXR, HDR, PNG, TIFF, JPEG; compared in linear light).
    picture: PathBuf,
    /// The reference.
    reference: PathBuf,
    /// Only pixels count where this picture, as stored, is brighter than one half.
    #[arg(long, value_name = "MASK")]
    mask: Option<PathBuf>,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

impl Arguments {
    /// Reads and compares.
    pub fn run(self) -> anyhow::Result<String> {
        let load = |path: &Path| read(path, Encoding::Auto);
        let (picture, reference) = (load(&self.picture)?, load(&self.reference)?);
        // A mask is a number, not light: no curve.
        let mask: Option<Image> = self.mask.as_deref().map(|path| read(path, Encoding::Linear)).transpose()?;
        let figures = compare(&picture, &reference, mask.as_ref())
            .with_context(|| format!("cannot compare {} with {}", self.picture.display(), self.reference.display()))?;
        if self.json {
            return Ok(serde_json::to_string_pretty(&figures)? + "\n");
        }
        Ok(format!("{figures}\n"))
    }
}
