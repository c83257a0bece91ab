//! The commands, one a file: raw flags (clap) -> a checked plan -> the work -> a report.

mod calibrate;
mod calibrate_lamps;
mod compare;
mod demo;
mod import;
mod info;
mod probe;
mod relight;
mod values;
mod verify;

use clap::Subcommand;

/// What the tool can do.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Photograph a virtual still life under 2560 lamps, relight it, and compare with the scene lit directly.
    Demo(demo::Arguments),
    /// Turn photographs taken elsewhere into a field.
    #[command(subcommand)]
    Import(import::Source),
    /// Turn a picture of the surroundings (mirror ball, fisheye, cube, lat-long) into another projection.
    Probe(probe::Arguments),
    /// Find out what a rig must know: lamps.
    #[command(subcommand)]
    Calibrate(calibrate::Target),
    /// Light a captured object anew.
    Relight(relight::Arguments),
    /// Tell what a .rfield file holds.
    Info(info::Arguments),
    /// Check the bytes of a .rfield file against its hashes.
    Verify(verify::Arguments),
    /// Measure how far a picture is from a reference.
    Compare(compare::Arguments),
}

impl Command {
    /// Does the work; returns what to print.
    ///
    /// # Errors
    /// Bad input, with the file named; `relume_core::Error::Cancelled` after Ctrl-C.
    pub fn run(self) -> anyhow::Result<String> {
        match self {
            Command::Demo(arguments) => arguments.run(),
            Command::Import(source) => source.run(),
            Command::Calibrate(target) => target.run(),
            Command::Probe(arguments) => arguments.run(),
            Command::Relight(arguments) => arguments.run(),
            Command::Info(arguments) => arguments.run(),
            Command::Verify(arguments) => arguments.run(),
            Command::Compare(arguments) => arguments.run(),
        }
    }
}

/// One line of advice on stderr, so that it never mixes with what is piped.
fn note(line: &str) {
    crate::complain(&format!("note: {line}"));
}
