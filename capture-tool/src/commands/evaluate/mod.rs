//! `relume evaluate`: measurements as a folder of pictures, numbers and one page.
//!
//! | file | what it does |
//! |---|---|
//! | `reconstruction` | flags and plan of `relume evaluate reconstruction` |
//! | `measure` | the measuring: errors, and pictures under a turning sliver and under maps |
//! | `report` | the numbers as JSON and as a table |
//! | `charts` | the bar charts |
//! | `pictures` | what is shown: exposure, false colours, sizes |
//! | `page` | all of it on one self-contained page |

mod charts;
mod measure;
mod page;
mod pictures;
mod reconstruction;
mod report;

use clap::Subcommand;

/// What can be measured.
#[derive(Debug, Subcommand)]
pub enum Subject {
    /// Rebuild a field from a part of its lamps by every method, and compare with all of them.
    Reconstruction(reconstruction::Arguments),
}

impl Subject {
    /// Measures and writes.
    pub fn run(self) -> anyhow::Result<String> {
        match self {
            Subject::Reconstruction(arguments) => arguments.run(),
        }
    }
}
