//! `relume rig dark`: every lamp off.

use std::path::PathBuf;

use clap::Args;

use crate::devices::lights;
use crate::rigs::RigFile;

const EXAMPLES: &str = "\
Example:
  relume rig dark stage.toml

Every capture does this by itself when it ends, however it ends; this is for lamps that somebody else left on. Axes are left alone: opening
the port of many boards restarts them.";

/// Raw flags.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    /// The rig file.
    rig: PathBuf,
}

impl Arguments {
    /// Opens the lamps and puts them out.
    ///
    /// # Errors
    /// A rig without lamps that are driven; lamps that cannot be reached.
    pub fn run(self) -> anyhow::Result<String> {
        let rig = RigFile::read(&self.rig)?;
        let lamps = rig.devices.as_ref().and_then(|devices| devices.lamps.as_ref());
        let Some(lamps) = lamps else { anyhow::bail!("{}: no lamps in [devices]", self.rig.display()) };
        lights::open(lamps, rig.bulbs())
            .and_then(|mut lights| lights.dark())
            .map_err(|trouble| anyhow::anyhow!("{trouble}; if lamps are on, switch them off by hand"))?;
        Ok(format!("{}: all lamps are off\n", rig.name))
    }
}
