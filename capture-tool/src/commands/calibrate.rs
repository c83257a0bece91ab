//! `relume calibrate`: what a rig must know before its photographs mean light.

use clap::Subcommand;

use super::calibrate_lamps;

/// What can be calibrated.
#[derive(Debug, Subcommand)]
pub enum Target {
    /// Find where lamps stand, from highlights on a mirror or black ball, and how bright they are, from a patch.
    Lamps(calibrate_lamps::Arguments),
}

impl Target {
    /// Calibrates.
    pub fn run(self) -> anyhow::Result<String> {
        match self {
            Target::Lamps(arguments) => arguments.run(),
        }
    }
}
