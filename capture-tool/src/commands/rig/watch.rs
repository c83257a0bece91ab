//! `relume rig watch`: the watchdog's process, which captures start.

use clap::Args;

use crate::watchdog;

const EXAMPLES: &str = "\
Example:
  relume rig watch";

/// No flags: orders come through the standard input.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {}

impl Arguments {
    /// Watches until the capture is done.
    ///
    /// # Errors
    /// Lamps that cannot be put out.
    pub fn run(self) -> anyhow::Result<String> {
        watchdog::watch()
    }
}
