//! `relume compress`: a compact representation of a field.

use std::path::PathBuf;

use clap::{ArgGroup, Args, ValueEnum};
use relume_core::field::compress::{Scheme, Stage, compress};
use relume_core::field::{Access, Asset, Kind};

use super::info::Info;
use super::relight::AccessChoice;
use crate::progress::{Progress, Unit};

const EXAMPLES: &str = "\
Examples:
  relume compress vase.rfield -o small.rfield --harmonic 25
  relume compress vase.rfield -o soft.rfield --harmonic 225 --keep dense";

/// Raw flags.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES, group(ArgGroup::new("scheme").required(true)))]
pub struct Arguments {
    /// The field: a .rfield file with the samples as photographed.
    asset: PathBuf,
    /// The .rfield file to write; may be the same.
    #[arg(short, long, value_name = "OUT")]
    output: PathBuf,
    /// Spherical harmonics, for soft light alone: 25 or 225 (any square number from 4 to 625).
    #[arg(long, value_name = "N", group = "scheme")]
    harmonic: Option<usize>,
    /// What stays beside the new representation: dense (the samples), factored, wavelet, harmonics, as far as the field has
    /// them, or all. Nothing does if this is not given.
    #[arg(long, value_enum, value_name = "FORM,FORM", value_delimiter = ',')]
    keep: Vec<Keep>,
    /// How the field is opened: memory-mapped, or read piece by piece, for network disks.
    #[arg(long, value_enum, default_value_t = AccessChoice::Mapped)]
    access: AccessChoice,
}

/// What may stay.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Keep {
    All,
    Dense,
    Factored,
    Wavelet,
    Harmonics,
}

impl Keep {
    fn kinds(self) -> Vec<Kind> {
        match self {
            Keep::All => Kind::ALL.to_vec(),
            Keep::Dense => vec![Kind::Dense],
            Keep::Factored => vec![Kind::Factored],
            Keep::Wavelet => vec![Kind::Wavelet],
            Keep::Harmonics => vec![Kind::Harmonics],
        }
    }
}

/// Checked flags.
#[derive(Debug, PartialEq)]
struct Plan {
    asset: PathBuf,
    access: Access,
    output: PathBuf,
    scheme: Scheme,
    keep: Vec<Kind>,
}

impl Arguments {
    /// Compresses.
    pub fn run(self) -> anyhow::Result<String> {
        self.plan()?.carry_out()
    }

    fn plan(self) -> anyhow::Result<Plan> {
        let scheme = match self.harmonic {
            Some(functions) => Scheme::Harmonics { functions },
            None => anyhow::bail!("say how: --harmonic N"),
        };
        let keep = self.keep.iter().flat_map(|keep| keep.kinds()).collect();
        Ok(Plan { asset: self.asset, access: self.access.into(), output: self.output, scheme, keep })
    }
}

impl Plan {
    fn carry_out(&self) -> anyhow::Result<String> {
        let asset = Asset::open(&self.asset, self.access)?;
        let mut bar: Option<(Stage, Progress)> = None;
        compress(&asset, &self.output, &self.scheme, &self.keep, &mut |stage, done, all| {
            let words = match stage {
                Stage::Measuring => "measuring",
                Stage::Compressing => "compressing",
                Stage::Writing => "copying the rest",
            };
            let unit = if stage == Stage::Writing { Unit::Bytes } else { Unit::Steps };
            if bar.as_ref().is_none_or(|bar| bar.0 != stage) {
                bar = Some((stage, Progress::new(words, unit)));
            }
            bar.as_mut().map_or(Ok(()), |bar| bar.1.step(done, all))
        })?;
        drop(bar);
        let made = Asset::open(&self.output, Access::Read)?;
        Ok(Info::of(&made).held())
    }
}
