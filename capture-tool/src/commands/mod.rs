//! The commands, one a file: raw flags (clap) -> a checked plan -> the work -> a report.

mod animate;
mod calibrate;
mod capture;
mod compare;
mod compress;
mod demo;
mod devices;
mod dual;
mod evaluate;
mod export;
mod hdr;
mod import;
mod info;
mod inspect;
mod jog;
mod layer;
mod light_flags;
mod lightings;
mod map;
mod matte;
mod merge;
mod pack;
mod patterns;
mod probe;
mod relight;
mod rig;
mod show;
mod surface;
#[cfg(test)]
mod testing;
mod values;
mod verify;

use clap::Subcommand;

/// What the tool can do.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Photograph a virtual still life under 2560 lamps, relight it, and compare with the scene lit directly.
    Demo(demo::Arguments),
    /// Photograph an object on a rig: every condition that a field needs, into a session that nothing is lost from.
    Capture(capture::Arguments),
    /// List the cameras, serial ports and screens that are connected, and what they can do.
    Devices(devices::Arguments),
    /// Check a rig, write a rig file, put lamps out, rehearse with boards that are not there.
    #[command(subcommand)]
    Rig(rig::Task),
    /// Move a turntable or an arm, or ask where it is.
    Jog(jog::Arguments),
    /// Make a field of a session: merge, calibrate, correct, check.
    Pack(pack::Arguments),
    /// Join parts of a field that were solved apart (`pack --tiles`).
    Merge(merge::Arguments),
    /// Turn photographs taken elsewhere into a field.
    #[command(subcommand)]
    Import(import::Source),
    /// Turn a field into what other tools read.
    #[command(subcommand)]
    Export(export::Target),
    /// Merge photographs of different exposures into one picture of linear light.
    Hdr(hdr::Arguments),
    /// Turn a picture of the surroundings (mirror ball, fisheye, cube, lat-long) into another projection.
    Probe(probe::Arguments),
    /// Light a captured object anew.
    Relight(relight::Arguments),
    /// See the scene from the side of the light: from the projector, lit by the camera (dual light transport).
    Dual(dual::Arguments),
    /// Put an object that was photographed before a screen before another picture.
    Matte(matte::Arguments),
    /// Light a captured object with lights that turn, fade and change: a picture a frame.
    Animate(animate::Arguments),
    /// List the lightings that ship, or print one to start from.
    Lightings(lightings::Arguments),
    /// Turn, blur, clamp, tint, expose, convert or resize a lat-long map (tint and exposure in the output's colours).
    Map(map::Arguments),
    /// Write the pictures that a screen or projector shows while an object is photographed.
    Patterns(patterns::Arguments),
    /// Show a chart, a grey, a picture or a pattern on a screen or projector, to set it up.
    Show(show::Arguments),
    /// Find normals and albedo, and store them as layers.
    Surface(surface::Arguments),
    /// Draw the reflectance functions of some pixels, as sampled and as reconstructed.
    Inspect(inspect::Arguments),
    /// Measure what a rig must know: where lamps stand, white, lamps that failed.
    #[command(subcommand)]
    Calibrate(calibrate::Subject),
    /// Make a field smaller and faster: a compact representation in place of its samples, or beside them.
    Compress(compress::Arguments),
    /// Tell what a .rfield file holds.
    Info(info::Arguments),
    /// Check the bytes of a .rfield file against its hashes.
    Verify(verify::Arguments),
    /// Measure how far a picture is from a reference.
    Compare(compare::Arguments),
    /// Measure methods against each other; the result is a page of pictures and numbers.
    #[command(subcommand)]
    Evaluate(evaluate::Subject),
}

impl Command {
    /// Does the work; returns what to print.
    ///
    /// # Errors
    /// Bad input, with the file named; `relume_core::Error::Cancelled` after Ctrl-C.
    pub fn run(self) -> anyhow::Result<String> {
        match self {
            Command::Demo(arguments) => arguments.run(),
            Command::Capture(arguments) => arguments.run(),
            Command::Devices(arguments) => arguments.run(),
            Command::Rig(task) => task.run(),
            Command::Jog(arguments) => arguments.run(),
            Command::Pack(arguments) => arguments.run(),
            Command::Merge(arguments) => arguments.run(),
            Command::Dual(arguments) => arguments.run(),
            Command::Matte(arguments) => arguments.run(),
            Command::Import(source) => source.run(),
            Command::Export(target) => target.run(),
            Command::Hdr(arguments) => arguments.run(),
            Command::Probe(arguments) => arguments.run(),
            Command::Relight(arguments) => arguments.run(),
            Command::Animate(arguments) => arguments.run(),
            Command::Lightings(arguments) => arguments.run(),
            Command::Map(arguments) => arguments.run(),
            Command::Patterns(arguments) => arguments.run(),
            Command::Show(arguments) => arguments.run(),
            Command::Surface(arguments) => arguments.run(),
            Command::Inspect(arguments) => arguments.run(),
            Command::Calibrate(subject) => subject.run(),
            Command::Compress(arguments) => arguments.run(),
            Command::Info(arguments) => arguments.run(),
            Command::Verify(arguments) => arguments.run(),
            Command::Compare(arguments) => arguments.run(),
            Command::Evaluate(subject) => subject.run(),
        }
    }
}

/// One line of advice on stderr, so that it never mixes with what is piped.
fn note(line: &str) {
    crate::complain(&format!("note: {line}"));
}
