//! `relume compress`: a compact representation of a field.

use std::path::PathBuf;

use clap::{ArgGroup, Args, ValueEnum};
use relume_core::field::compress::{Scheme, Stage, compress};
use relume_core::field::{Access, Asset, Kind};
use relume_core::settings;
use relume_core::wavelet::Wavelet;

use super::info::Info;
use super::relight::AccessChoice;
use super::values;
use crate::progress::{Progress, Unit};

const EXAMPLES: &str = "\
Examples:
  relume compress vase.rfield -o small.rfield --factored
  relume compress vase.rfield -o small.rfield --factored --error 0.04 --keep dense
  relume compress vase.rfield -o wave.rfield --wavelet 9/7
  relume compress vase.rfield -o wave.rfield --wavelet 5/3 --grid 128x32 --error 0.02 --keep all
  relume compress vase.rfield -o soft.rfield --harmonic 25

Factored is for all light: lamps, maps and any reconstruction work as with the samples, faster the more lamps there are. Wavelets have
functions rebuilt on a fine grid, once, by --reconstruct. Harmonics are smooth: for soft light alone.

What is lost is measured as it is stored, for each pixel, and told by `relume info`. An asset with several representations is lit by
the best (relight --representation).";

/// A relative error that relit pictures hardly show: they are off by a part of it.
const FACTORED_ERROR: f64 = 0.02;
/// The count of the thesis (5.4); with many more of them a gather is slower than the stream of the samples.
const WAVELET_TERMS: usize = 256;

/// Raw flags.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES, group(ArgGroup::new("scheme").required(true)))]
pub struct Arguments {
    /// The field: a .rfield file with the samples as photographed.
    asset: PathBuf,
    /// The .rfield file to write; may be the same.
    #[arg(short, long, value_name = "OUT")]
    output: PathBuf,
    /// Tiles of low rank: the samples, smaller and faster to light.
    #[arg(long, group = "scheme")]
    factored: bool,
    /// For each pixel a set of wavelet coefficients: haar, 5/3 or 9/7.
    #[arg(long, value_name = "WAVELET", group = "scheme", value_parser = wavelet)]
    wavelet: Option<Wavelet>,
    /// Spherical harmonics, for soft light alone: 25 or 225 (any square number from 4 to 625).
    #[arg(long, value_name = "N", group = "scheme", conflicts_with = "error")]
    harmonic: Option<usize>,
    /// The relative error, from 0.001 to 1: of the field for --factored (0.02 if not given), of every reflectance function for
    /// --wavelet.
    #[arg(long, value_name = "E", allow_negative_numbers = true, value_parser = error)]
    error: Option<f64>,
    /// The most coefficients of a pixel (256 if neither this nor --error is given); beside --error, the first that is met counts.
    #[arg(long, value_name = "N", conflicts_with_all = ["factored", "harmonic"], allow_negative_numbers = true, value_parser = terms)]
    terms: Option<usize>,
    /// The grid of the wavelets: longitudes x angles from the axis, over the coverage of the lamps.
    #[arg(long, value_name = "WxH", conflicts_with_all = ["factored", "harmonic"], default_value = "256x64", value_parser = values::grid)]
    grid: (usize, usize),
    /// How functions are rebuilt on the grid.
    #[arg(long, value_name = "METHOD", conflicts_with_all = ["factored", "harmonic"], default_value = "b-spline",
          value_parser = values::choice(&settings::RECONSTRUCTION))]
    reconstruct: usize,
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
        let scheme = match (self.wavelet, self.harmonic) {
            (Some(wavelet), _) => Scheme::Wavelet {
                wavelet,
                grid: self.grid,
                reconstruction: settings::method(self.reconstruct),
                error: self.error,
                terms: self.terms.or(self.error.is_none().then_some(WAVELET_TERMS)),
            },
            (None, Some(functions)) => Scheme::Harmonics { functions },
            (None, None) => Scheme::Factored { error: self.error.unwrap_or(FACTORED_ERROR) },
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
                Stage::Choosing => "choosing tiles",
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

fn wavelet(text: &str) -> Result<Wavelet, String> {
    text.parse().map_err(|_| {
        let ids: Vec<&str> = Wavelet::ALL.iter().map(|wavelet| wavelet.id()).collect();
        format!("it must be one of {}", ids.join(", "))
    })
}

/// A part, not percent.
fn error(text: &str) -> Result<f64, String> {
    if let Some(percent) = text.strip_suffix('%').and_then(|number| values::finite(number.trim()).ok()) {
        return Err(format!("in place of percent write a part: {}", percent / 100.0));
    }
    let value = values::finite(text)?;
    if value > 0.0 && value < 1.0 {
        return Ok(value);
    }
    let all = if value == 0.0 { " (nothing lost is what the samples are: keep them)" } else { "" };
    Err(format!("not above 0 and below 1, as in 0.02{all}"))
}

fn terms(text: &str) -> Result<usize, String> {
    text.parse().ok().filter(|n| *n > 0).ok_or_else(|| "not a whole number from 1 on".to_owned())
}

#[cfg(test)]
mod tests {
    use relume_core::reconstruct::Method;

    use super::*;
    use crate::commands::testing;

    fn plan(line: &str) -> Plan {
        testing::parse::<Arguments>(line).unwrap().plan().unwrap()
    }

    #[test]
    fn defaults_are_those_of_the_help() {
        assert_eq!(plan("compress a.rfield -o b.rfield --factored").scheme, Scheme::Factored { error: 0.02 });
        let of = |wavelet, error, terms| Scheme::Wavelet {
            wavelet,
            grid: (256, 64),
            reconstruction: Method::BSpline,
            error,
            terms,
        };
        let given = plan("compress a.rfield -o b.rfield --wavelet 9/7");
        assert_eq!((given.scheme, given.keep), (of(Wavelet::Daubechies97, None, Some(256)), vec![]));
        let given = plan("compress a.rfield -o b.rfield --wavelet 5/3 --terms 64 --error 0.1 --keep dense,factored");
        assert_eq!(given.scheme, of(Wavelet::LeGall53, Some(0.1), Some(64)));
        assert_eq!(given.keep, [Kind::Dense, Kind::Factored]);
        let given = plan("compress a.rfield -o b.rfield --harmonic 225 --keep all");
        assert_eq!((given.scheme, given.keep), (Scheme::Harmonics { functions: 225 }, Kind::ALL.to_vec()));
    }

    #[test]
    fn wrong_usage_is_refused_by_the_parser() {
        for (options, word) in [
            ("", "--factored"),
            ("--factored --harmonic 25", "--harmonic"),
            ("--factored --error 0", "keep them"),
            ("--factored --error -0.1", "above 0"),
            ("--factored --error 1", "below 1"),
            ("--factored --error nan", "nan"),
            ("--factored --error 2%", "0.02"),
            ("--factored --terms 4", "--terms"),
            ("--factored --grid 64x16", "--grid"),
            ("--harmonic 25 --reconstruct linear", "--reconstruct"),
            ("--wavelet 9/7 --terms 0", "from 1 on"),
            ("--wavelet 9/7 --terms 1.5", "from 1 on"),
            ("--wavelet db4", "9/7"),
            ("--wavelet 9/7 --grid 64", "256x64"),
            ("--wavelet 9/7 --keep some", "dense"),
            ("--harmonic 25 --terms 4", "--terms"),
            ("--harmonic 25 --error 0.1", "--error"),
        ] {
            let line = format!("compress a.rfield -o b.rfield {options}");
            let message = testing::parse::<Arguments>(&line).unwrap_err().to_string();
            assert!(message.contains(word), "{line}: no `{word}` in {message}");
        }
    }
}
