//! `relume rig`: setting up a rig, and switching it off.

mod check;
mod dark;
mod new;
#[cfg(unix)]
mod simulate;
mod watch;

use clap::Subcommand;

/// What can be done with a rig.
#[derive(Debug, Subcommand)]
pub enum Task {
    /// Talk to every device of a rig, flash each lamp, move each axis a little, take a photograph; print what works.
    Check(check::Arguments),
    /// Ask what stands on set, and write a rig file that explains itself.
    New(new::Arguments),
    /// Put every lamp of a rig out, whatever went wrong before.
    Dark(dark::Arguments),
    /// Stand in for the boards of a rig file on pseudo-terminals, and for what its camera would see.
    #[cfg(unix)]
    Simulate(simulate::Arguments),
    /// The watchdog of a capture, which starts it.
    #[command(hide = true)]
    Watch(watch::Arguments),
}

impl Task {
    /// Does it.
    ///
    /// # Errors
    /// A bad rig file; devices that do not answer.
    pub fn run(self) -> anyhow::Result<String> {
        match self {
            Self::Check(arguments) => arguments.run(),
            Self::New(arguments) => arguments.run(),
            Self::Dark(arguments) => arguments.run(),
            #[cfg(unix)]
            Self::Simulate(arguments) => arguments.run(),
            Self::Watch(arguments) => arguments.run(),
        }
    }
}
