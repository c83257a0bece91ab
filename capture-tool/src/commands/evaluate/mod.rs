//! `relume evaluate`: measurements as a folder of pictures, numbers and one page.
//!
//! | file | what it does |
//! |---|---|
//! | `reconstruction` | how well fields are rebuilt from a part of their lamps |
//! | `compression` | how well few coefficients stand for reflectance functions, and compact fields for samples |
//! | `implicit` | how well implicit sampling relights, by terms and patterns |
//! | `inputs` | flags that both take |
//! | `lines` | line charts |
//! | `pictures` | what is shown: exposure, false colours, sizes |
//! | `page` | the self-contained page, and the files beside it |

mod compression;
mod implicit;
mod inputs;
mod lines;
mod page;
mod pictures;
mod reconstruction;

use clap::Subcommand;

/// What can be measured.
#[derive(Debug, Subcommand)]
pub enum Subject {
    /// Rebuild a field from a part of its lamps by every method, and compare with all of them.
    Reconstruction(reconstruction::Arguments),
    /// Measure what wavelets and compact representations of a field lose, and what they save.
    Compression(compression::Arguments),
    /// Solve the virtual monitor by implicit sampling, and measure errors by terms and patterns.
    Implicit(implicit::Arguments),
}

impl Subject {
    /// Measures and writes.
    pub fn run(self) -> anyhow::Result<String> {
        match self {
            Subject::Reconstruction(arguments) => arguments.run(),
            Subject::Compression(arguments) => arguments.run(),
            Subject::Implicit(arguments) => arguments.run(),
        }
    }
}
