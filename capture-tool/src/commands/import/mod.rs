//! `relume import`: photographs taken elsewhere -> a field, or a session folder.

mod exr;
mod graycode;
mod lp;
mod pairs;

use std::path::Path;

use clap::{Subcommand, ValueEnum};
use relume_core::calibrate::Correction;
use relume_core::domain::Directions;
use relume_core::field::Precision;
use relume_core::image::Encoding;

use super::{calibrate, note};

pub(super) use pairs::{one_size, pictures};

/// Kinds of import.
#[derive(Debug, Subcommand)]
pub enum Source {
    /// One photograph a lamp, listed with the lamps' directions in a .lp file.
    Lp(Box<lp::LpArguments>),
    /// One OpenEXR file with a picture a lamp: a part or a layer each.
    Exr(exr::ExrArguments),
    /// Patterns that a screen or projector showed, and the photograph under each: into a session folder.
    Pairs(pairs::PairsArguments),
    /// Gray codes that a camera saw through a clear object: into a field of one place of the screen a pixel.
    Graycode(graycode::GraycodeArguments),
}

impl Source {
    /// Imports.
    pub fn run(self) -> anyhow::Result<String> {
        match self {
            Source::Lp(arguments) => arguments.run(),
            Source::Exr(arguments) => arguments.run(),
            Source::Pairs(arguments) => arguments.run(),
            Source::Graycode(arguments) => arguments.run(),
        }
    }
}

/// How integer files are read.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum EncodingChoice {
    /// By the sRGB curve.
    Srgb,
    /// In proportion to light.
    Linear,
}

impl EncodingChoice {
    /// The encoding of a flag that may be absent.
    pub fn of(flag: Option<Self>) -> Encoding {
        match flag {
            None => Encoding::Auto,
            Some(Self::Srgb) => Encoding::Srgb,
            Some(Self::Linear) => Encoding::Linear,
        }
    }
}

/// How the numbers of a field are stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum PrecisionChoice {
    Half,
    Float,
}

impl From<PrecisionChoice> for Precision {
    fn from(choice: PrecisionChoice) -> Self {
        match choice {
            PrecisionChoice::Half => Self::Half,
            PrecisionChoice::Float => Self::Float,
        }
    }
}

/// `R,G,B`, or else the name of a file.
fn white_balance(text: &str) -> anyhow::Result<Correction> {
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|part| part.trim().parse()).collect();
    match numbers.as_deref() {
        Ok([r, g, b]) => Ok(Correction::gains([*r, *g, *b])?),
        Ok(other) => {
            anyhow::bail!("--white-balance {text}: found {} numbers, expected three gains or a file", other.len())
        }
        Err(_) => calibrate::read_correction(Path::new(text)),
    }
}

/// Duplicates are legal (they share their site's light equally) but often a mistake in the list.
fn tell_duplicates(domain: &Directions) {
    let shared: Vec<&Vec<u32>> = domain.members().iter().filter(|members| members.len() > 1).collect();
    let Some(first) = shared.first() else { return };
    let lamps: usize = shared.iter().map(|members| members.len()).sum();
    let numbers: Vec<String> = first.iter().take(5).map(|lamp| (lamp + 1).to_string()).collect();
    let several = if shared.len() > 1 { ", and others" } else { "" };
    let verb = if shared.len() > 1 { "share directions" } else { "share a direction" };
    note(&format!(
        "{lamps} lamps {verb} (lamps {}{several}); each gets an equal part of its light",
        numbers.join(", ")
    ));
}
