//! `relume evaluate`: measurements as a folder of pictures, numbers and one page.
//!
//! | file | what it does |
//! |---|---|
//! | `reconstruction` | how well fields are rebuilt from a part of their lamps |
//! | `compression` | how well few coefficients stand for reflectance functions, and compact fields for samples |
//! | `explicit` | how well functions shown on a screen one by one capture what stands before it |
//! | `reference` | relit pictures against photographs under the same picture on a screen |
//! | `separable` | how well squares are recovered from sets of them, and whether the map tells where not |
//! | `implicit` | how well implicit sampling relights, by terms and patterns |
//! | `inputs` | flags that both take |
//! | `lines` | line charts |
//! | `pictures` | what is shown: exposure, false colours, sizes |
//! | `page` | the self-contained page, and the files beside it |

mod compression;
mod explicit;
mod implicit;
mod inputs;
mod lines;
mod page;
mod pictures;
mod reconstruction;
mod reference;
mod separable;

use clap::Subcommand;

/// What can be measured.
#[derive(Debug, Subcommand)]
pub enum Subject {
    /// Rebuild a field from a part of its lamps by every method, and compare with all of them.
    Reconstruction(reconstruction::Arguments),
    /// Hold a field of a screen, relit, against photographs of pictures on that screen.
    Reference(reference::Arguments),
    /// Measure what wavelets and compact representations of a field lose, and what they save.
    Compression(compression::Arguments),
    /// Measure explicit sampling on virtual screens: errors of relit pictures over the number of functions.
    Explicit(explicit::Arguments),
    /// Solve the virtual monitor by implicit sampling, and measure errors by terms and patterns.
    Implicit(implicit::Arguments),
    /// Recover squares of a virtual projector from horizontal and vertical sets, and measure errors and the reliability map.
    Separable(separable::Arguments),
}

impl Subject {
    /// Measures and writes.
    pub fn run(self) -> anyhow::Result<String> {
        match self {
            Subject::Reconstruction(arguments) => arguments.run(),
            Subject::Reference(arguments) => arguments.run(),
            Subject::Compression(arguments) => arguments.run(),
            Subject::Explicit(arguments) => arguments.run(),
            Subject::Implicit(arguments) => arguments.run(),
            Subject::Separable(arguments) => arguments.run(),
        }
    }
}
