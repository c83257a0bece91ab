//! `relume calibrate`: what a rig must know before its photographs mean light.

mod alpha;
mod failed;
mod gamma;
mod input;
mod lamps;
mod screen;
mod white;

use clap::Subcommand;

pub(super) use input::Captured;
pub(super) use white::read_correction;

/// What is measured.
#[derive(Debug, Subcommand)]
pub enum Subject {
    /// Find where lamps stand, from highlights on a mirror or black ball, and how bright they are, from a patch.
    Lamps(lamps::Arguments),
    /// White balance from a patch of known reflectance, or a colour matrix from a chart of 24 patches.
    White(white::Arguments),
    /// Lamps that were dark, or hidden by the camera or an arm, found from the smoothness of the set.
    Failed(failed::Arguments),
    /// The curve of a screen or projector, from photographs of grey levels.
    Gamma(gamma::Arguments),
    /// Which place of a screen each pixel of the camera sees, from stripes or Gray codes.
    Screen(screen::Arguments),
    /// What the object covers of the screen behind it, from stripes or from several backdrops.
    Alpha(alpha::Arguments),
}

impl Subject {
    /// Measures; returns what to print.
    pub fn run(self) -> anyhow::Result<String> {
        match self {
            Subject::Lamps(arguments) => arguments.run(),
            Subject::White(arguments) => arguments.run(),
            Subject::Failed(arguments) => arguments.run(),
            Subject::Gamma(arguments) => arguments.run(),
            Subject::Screen(arguments) => arguments.run(),
            Subject::Alpha(arguments) => arguments.run(),
        }
    }
}
