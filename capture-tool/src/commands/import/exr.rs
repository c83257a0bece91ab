//! `relume import exr`: an OpenEXR file with a picture a lamp -> a field.

use std::path::PathBuf;

use clap::Args;
use relume_core::acquire::ImportExr;
use relume_core::domain::{Directions, lp};
use relume_core::field::{Access, Asset};
use relume_core::files;
use relume_core::image::ColourSpace;

use super::{PrecisionChoice, tell_duplicates, white_balance};
use crate::commands::info::Info;
use crate::commands::{note, values};
use crate::progress::{Progress, Unit};

const EXAMPLES: &str = "\
Examples:
  relume import exr vase.exr -o vase.rfield
  relume import exr light-groups.exr -o vase.rfield --lp lamps.lp
  relume import exr photographs.exr -o vase.rfield --lp lamps.lp --black black.exr --irradiance 2.7

A picture is a part with the channels R, G, B (or Y), or a layer of channels NAME.R, NAME.G, NAME.B.
Where its lamp stands is told by its part's attributes relumeDirection (V3f: x right, y up, z to the
camera) and relumeIrradiance (float), as `relume export exr` writes them, or by a .lp file whose
photographs are called as the layers. Pictures add up, as light groups do: what was there without
lamps is a layer of its own, `ambient`, and the object's coverage one called `alpha`.";

/// Raw flags.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct ExrArguments {
    /// The OpenEXR file.
    exr: PathBuf,
    /// The .rfield file to write.
    #[arg(short, long, value_name = "A.rfield")]
    output: PathBuf,
    /// Where the lamps stand: a .lp file that names the layers; the rest are left out. Where no name fits, they are taken in
    /// order, if there are as many.
    #[arg(long, value_name = "FILE.lp")]
    lp: Option<PathBuf>,
    /// Scale direction vectors to length 1 where the .lp file has others.
    #[arg(long, requires = "lp")]
    normalise_directions: bool,
    /// Irradiance of every lamp on a patch facing it [default: as the file tells, or pi].
    #[arg(long, value_name = "E", allow_negative_numbers = true, value_parser = values::positive)]
    irradiance: Option<f32>,
    /// Irradiance of each lamp: a table as `relume calibrate lamps` writes, with the names of the layers.
    #[arg(long, value_name = "TABLE.tsv", conflicts_with = "irradiance")]
    lamps: Option<PathBuf>,
    /// A photograph with every lamp off: subtracted from all, and kept as the ambient picture.
    #[arg(long, value_name = "IMG")]
    black: Option<PathBuf>,
    /// The colour space: lin_rec709, lin_rec2020, acescg, aces2065_1 or lin_p3d65 [default: as the file tells, or lin_rec709].
    #[arg(long, value_name = "SPACE", value_parser = values::colour_space)]
    colour_space: Option<ColourSpace>,
    /// How the field is stored: 16-bit or 32-bit floats.
    #[arg(long, value_enum, default_value_t = PrecisionChoice::Half)]
    precision: PrecisionChoice,
    /// White balance: a gain a channel, or a file that `relume calibrate white` wrote.
    #[arg(long, value_name = "R,G,B|FILE", allow_hyphen_values = true)]
    white_balance: Option<String>,
}

/// Checked flags.
#[derive(Debug)]
struct Plan {
    import: ImportExr,
    output: PathBuf,
}

impl ExrArguments {
    /// Imports.
    pub fn run(self) -> anyhow::Result<String> {
        self.plan()?.carry_out()
    }

    /// Refuses what can be known to fail before the work.
    fn plan(self) -> anyhow::Result<Plan> {
        files::check_folder(&self.output)?;
        let import = ImportExr {
            exr: self.exr,
            lp: self.lp,
            lengths: if self.normalise_directions { lp::Lengths::Normalise } else { lp::Lengths::Unit },
            lamps: self.lamps,
            irradiance: self.irradiance,
            black: self.black,
            colour_space: self.colour_space,
            precision: self.precision.into(),
            correction: self.white_balance.as_deref().map(white_balance).transpose()?,
        };
        Ok(Plan { import, output: self.output })
    }
}

impl Plan {
    fn carry_out(&self) -> anyhow::Result<String> {
        let checked = self.import.check()?;
        if checked.by_order {
            note("no layer is called as a photograph of the .lp file; both were taken in their order");
        }
        if !checked.left_out.is_empty() {
            note(&format!(
                "{} layers are no lamps and were left out: {}",
                checked.left_out.len(),
                listed(&checked.left_out)
            ));
        }
        tell_duplicates(&Directions::new(checked.directions)?);
        let mut progress = Progress::new("importing", Unit::Steps);
        self.import.run(&self.output, &mut |done, all| progress.step(done, all))?;
        drop(progress);
        Ok(format!("{}\n", Info::of(&Asset::open(&self.output, Access::Read)?).summary()))
    }
}

/// The first few.
fn listed(names: &[String]) -> String {
    let more = if names.len() > 5 { ", ..." } else { "" };
    format!("{}{more}", names[..names.len().min(5)].join(", "))
}

#[cfg(test)]
mod tests {
    use relume_core::field::Precision;

    use super::*;
    use crate::commands::testing;

    fn parse(line: &str) -> Result<ExrArguments, clap::Error> {
        testing::parse(line)
    }

    #[test]
    fn flags_reach_the_plan() {
        let import = parse("exr a.exr -o a.rfield").unwrap().plan().unwrap().import;
        assert_eq!((import.irradiance, import.colour_space, import.precision), (None, None, Precision::Half));
        let line = "exr a.exr -o a.rfield --lp l.lp --normalise-directions --irradiance 2 --black b.exr --colour-space acescg \
                    --precision float --white-balance 1,2,3";
        let import = parse(line).unwrap().plan().unwrap().import;
        assert_eq!((import.lp, import.lengths), (Some("l.lp".into()), lp::Lengths::Normalise));
        assert_eq!((import.irradiance, import.colour_space), (Some(2.0), Some(ColourSpace::AcesCg)));
        assert!(import.black.is_some() && import.correction.is_some() && import.precision == Precision::Float);
        for bad in ["exr a.exr", "exr a.exr -o a.rfield --irradiance 0", "exr a.exr -o a.rfield --normalise-directions"]
        {
            assert!(parse(bad).is_err(), "{bad}");
        }
    }
}
