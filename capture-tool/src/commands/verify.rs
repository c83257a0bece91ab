//! `relume verify`: are the bytes those that were written?

use std::fmt::Write;
use std::path::PathBuf;

use clap::Args;
use relume_core::field::{Access, Asset};

use crate::progress::{Progress, Unit};

const EXAMPLES: &str = "\
Example:
  relume verify vase.rfield";

/// Raw flags.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    /// The .rfield file.
    asset: PathBuf,
}

impl Arguments {
    /// Hashes every entry and compares with the manifest.
    pub fn run(self) -> anyhow::Result<String> {
        // Read, not mapped: a file under suspicion may be cut short while we look.
        let asset = Asset::open(&self.asset, Access::Read)?;
        let mut progress = Progress::new("hashing", Unit::Bytes);
        asset.verify(&mut |done, total| progress.step(done, total))?;
        drop(progress);
        let mut report = String::new();
        for (entry, hash) in &asset.manifest().blake3 {
            writeln!(report, "OK  {entry}  {hash}")?;
        }
        writeln!(report, "OK  {}: {} entries as written", self.asset.display(), asset.manifest().blake3.len())?;
        Ok(report)
    }
}
