//! `relume rig`: what there is to do with a rig before it captures.

#[cfg(unix)]
mod simulate;

use clap::Subcommand;

/// What to do.
#[derive(Debug, Subcommand)]
pub enum Action {
    /// Stand in for the boards of a rig file on pseudo-terminals, and for what its camera would see.
    #[cfg(unix)]
    Simulate(simulate::Arguments),
}

impl Action {
    /// Does the work; returns what to print.
    ///
    /// # Errors
    /// As the action's.
    pub fn run(self) -> anyhow::Result<String> {
        match self {
            #[cfg(unix)]
            Action::Simulate(arguments) => arguments.run(),
        }
    }
}
