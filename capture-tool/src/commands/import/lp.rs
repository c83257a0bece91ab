//! `relume import lp`: a photograph a lamp -> a field, a session folder, or both.

use std::f32::consts::PI;
use std::path::{Path, PathBuf};

use clap::Args;
use relume_core::acquire::{FlatField, ImportLp, Measured};
use relume_core::domain::{Directions, lp};
use relume_core::field::{Access, Asset};
use relume_core::files;
use relume_core::image::ColourSpace;

use super::{EncodingChoice, PrecisionChoice, tell_duplicates, white_balance};
use crate::commands::info::Info;
use crate::commands::{surface, values};
use crate::progress::{Progress, Unit};
use crate::{new_folder, session};

const EXAMPLES: &str = "\
Examples:
  relume import lp photographs/dirs.lp -o vase.rfield
  relume import lp photographs/dirs.lp -o vase.rfield --encoding linear --black black.tif --irradiance 2.7
  relume import lp photographs/dirs.lp -o vase.rfield --exclude 37,52 --white-balance 1.9,1,1.6 --normals
  relume import lp photographs/lights.lp -o vase.rfield --lamps photographs/lights.lamps.tsv
  relume import lp near/lights.lp -o coin.rfield --lamps near/lights.lamps.tsv --flat-field places --metres-per-pixel 2e-5
  relume import lp photographs/dirs.lp --session vase-session";

/// Raw flags.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct LpArguments {
    /// The .lp file: the number of lamps, then `photograph x y z` a line (x right, y up, z to the camera). Photographs are
    /// looked for in its folder.
    lp: PathBuf,
    #[command(flatten)]
    target: TargetArguments,
    /// How the photographs' numbers become light [default: sRGB for 8 and 16 bits, linear for floats].
    #[arg(long, value_enum)]
    encoding: Option<EncodingChoice>,
    /// The colour space of the photographs, once decoded to light: lin_rec709 (as of sRGB pictures), lin_rec2020, acescg,
    /// aces2065_1 or lin_p3d65. The field keeps it.
    #[arg(long, value_name = "SPACE", value_parser = values::colour_space, default_value_t = ColourSpace::default())]
    colour_space: ColourSpace,
    /// The photograph with every lamp off: subtracted, and kept as the ambient picture.
    #[arg(long, value_name = "IMG")]
    black: Option<PathBuf>,
    /// How the field is stored: 16-bit or 32-bit floats.
    #[arg(long, value_enum, default_value_t = PrecisionChoice::Half)]
    precision: PrecisionChoice,
    /// Irradiance of every lamp on a patch facing it [default: pi, so that a white diffuser facing the lamp is 1].
    #[arg(long, value_name = "E", allow_negative_numbers = true, value_parser = values::positive)]
    irradiance: Option<f32>,
    /// Irradiance (and place, of near lamps) of each lamp: the table that `relume calibrate lamps` writes.
    #[arg(long, value_name = "TABLE.tsv", conflicts_with = "irradiance")]
    lamps: Option<PathBuf>,
    /// Even out near lamps: a folder with a photograph of a flat white card under every lamp, each named as the object's, or
    /// `places`: by the lamps' places in the table, on a plane through the object that faces the camera.
    #[arg(long, value_name = "DIR|places")]
    flat_field: Option<PathBuf>,
    /// Size of a pixel on the object, for `--flat-field places`.
    #[arg(long, value_name = "M", allow_negative_numbers = true, value_parser = values::positive)]
    metres_per_pixel: Option<f32>,
    /// The pixel that shows the object's middle, where irradiances hold [default: the middle of the picture].
    #[arg(long, value_name = "X,Y", allow_negative_numbers = true, requires = "flat_field",
          value_parser = values::list::<2>)]
    origin: Option<[f64; 2]>,
    /// A picture of the object's coverage: white object, black surroundings, taken as stored.
    #[arg(long, value_name = "IMG")]
    alpha: Option<PathBuf>,
    /// Scale direction vectors to length 1 where the file has others.
    #[arg(long)]
    normalise_directions: bool,
    /// Lamps to leave out, counted from 1 in the order of the .lp file: those that `relume calibrate failed` found.
    #[arg(long, value_name = "N,N", value_delimiter = ',')]
    exclude: Vec<usize>,
    /// White balance: a gain a channel, or a file that `relume calibrate white` wrote.
    #[arg(long, value_name = "R,G,B|FILE", allow_hyphen_values = true)]
    white_balance: Option<String>,
    /// Also find normals and albedo (as `relume surface` does) and store them as layers.
    #[arg(long, requires = "output")]
    normals: bool,
}

/// Where to: at least one.
#[derive(Debug, Args)]
#[group(required = true, multiple = true)]
struct TargetArguments {
    /// The .rfield file to write.
    #[arg(short, long, value_name = "A.rfield")]
    output: Option<PathBuf>,
    /// Also (or, without -o, only) copy everything into a new session folder.
    #[arg(long, value_name = "DIR")]
    session: Option<PathBuf>,
}

/// Checked flags.
#[derive(Debug)]
struct Plan {
    import: ImportLp,
    output: Option<PathBuf>,
    session: Option<PathBuf>,
    normals: bool,
}

impl LpArguments {
    /// Imports.
    pub fn run(self) -> anyhow::Result<String> {
        self.plan()?.carry_out()
    }

    /// Refuses what can be known to fail before the work.
    fn plan(self) -> anyhow::Result<Plan> {
        if let Some(output) = &self.target.output {
            files::check_folder(output)?;
        }
        if let Some(folder) = &self.target.session {
            new_folder::check(folder)?;
        }
        let measured = self.measured()?;
        let import = ImportLp {
            lp: self.lp,
            encoding: EncodingChoice::of(self.encoding),
            colour_space: self.colour_space,
            black: self.black,
            alpha: self.alpha,
            irradiance: self.irradiance.unwrap_or(PI),
            measured,
            precision: self.precision.into(),
            lengths: if self.normalise_directions { lp::Lengths::Normalise } else { lp::Lengths::Unit },
            exclude: self.exclude,
            correction: self.white_balance.as_deref().map(white_balance).transpose()?,
        };
        Ok(Plan { import, output: self.target.output, session: self.target.session, normals: self.normals })
    }

    fn measured(&self) -> anyhow::Result<Measured> {
        let by_places = self.flat_field.as_deref().is_some_and(|path| path == Path::new("places"));
        anyhow::ensure!(
            by_places == self.metres_per_pixel.is_some() && (!by_places || self.lamps.is_some()),
            "--flat-field places, --metres-per-pixel and --lamps belong together"
        );
        let flat_field = match (&self.flat_field, self.metres_per_pixel) {
            (None, _) => FlatField::None,
            (Some(_), Some(metres)) => FlatField::Places { metres_per_pixel: f64::from(metres) },
            (Some(folder), None) => FlatField::Cards(folder.clone()),
        };
        Ok(Measured { lamps: self.lamps.clone(), flat_field, origin_px: self.origin })
    }
}

impl Plan {
    /// The session is staged first and takes its name last, so that a failed import leaves neither.
    fn carry_out(&self) -> anyhow::Result<String> {
        let checked = self.import.check()?;
        tell_duplicates(&Directions::new(checked.lp.directions.clone())?);
        let staged = match &self.session {
            None => None,
            Some(folder) => {
                let mut progress = Progress::new("copying", Unit::Steps);
                Some(session::staging::stage(folder, &self.import, &checked, &mut |done, all| {
                    progress.step(done, all)
                })?)
            }
        };
        let mut report = String::new();
        if let Some(output) = &self.output {
            let said = self.pack(output)?;
            let asset = Asset::open(output, Access::Read)?;
            report += &format!("{}\n{said}", Info::of(&asset).summary());
        }
        if let Some(staged) = staged {
            let folder = staged.commit()?;
            report += &format!("{}: {} photographs\n", folder.display(), checked.lp.photographs.len());
        }
        Ok(report)
    }

    /// Writes the field; with normals by way of a temporary file beside it, so that it appears once and complete. Returns what
    /// is to be said of the layers.
    fn pack(&self, output: &Path) -> anyhow::Result<String> {
        let import = |to: &Path| {
            let mut progress = Progress::new("importing", Unit::Steps);
            self.import.run(to, &mut |done, all| progress.step(done, all))
        };
        if !self.normals {
            import(output)?;
            return Ok(String::new());
        }
        let folder = files::folder_of(output);
        let bare = tempfile::Builder::new().prefix(".relume-").suffix(".part").tempdir_in(folder);
        let bare = bare.map_err(|source| relume_core::Error::io("create a folder in", folder, source))?;
        let without = bare.path().join("without.rfield");
        import(&without)?;
        surface::add_surface(&Asset::open(&without, Access::Read)?, output)
    }
}

#[cfg(test)]
mod tests {
    use relume_core::field::Precision;
    use relume_core::image::Encoding;

    use super::*;
    use crate::commands::testing;

    fn parse(line: &str) -> Result<LpArguments, clap::Error> {
        testing::parse(line)
    }

    #[test]
    fn defaults() {
        let plan = parse("lp a.lp -o a.rfield").unwrap().plan().unwrap();
        assert_eq!((plan.import.irradiance, plan.import.precision), (PI, Precision::Half));
        assert_eq!((plan.import.encoding, plan.import.lengths), (Encoding::Auto, lp::Lengths::Unit));
        assert!(plan.session.is_none() && plan.import.black.is_none() && plan.import.alpha.is_none());
    }

    #[test]
    fn flags_reach_the_plan() {
        let line = "lp a.lp -o a.rfield --encoding srgb --black b.png --precision float --irradiance 2.5 --alpha m.png \
                    --normalise-directions --session no-such-folder --colour-space lin_p3d65";
        let plan = parse(line).unwrap().plan().unwrap();
        assert_eq!((plan.import.irradiance, plan.import.precision), (2.5, Precision::Float));
        assert_eq!((plan.import.encoding, plan.import.lengths), (Encoding::Srgb, lp::Lengths::Normalise));
        assert_eq!(plan.import.colour_space, ColourSpace::LinP3D65);
        assert_eq!(plan.import.black, Some("b.png".into()));
        assert_eq!(plan.import.alpha, Some("m.png".into()));
        assert_eq!(plan.session, Some("no-such-folder".into()));
    }

    #[test]
    fn a_target_is_required_and_numbers_are_numbers() {
        for line in [
            "lp a.lp",
            "lp -o a.rfield",
            "lp a.lp -o a.rfield --irradiance 0",
            "lp a.lp -o a.rfield --irradiance -1",
            "lp a.lp -o a.rfield --irradiance nan",
            "lp a.lp -o a.rfield --irradiance inf",
            "lp a.lp -o a.rfield --precision double",
            "lp a.lp -o a.rfield --encoding gamma",
            "lp a.lp -o a.rfield --colour-space rec709",
            "lp a.lp -o a.rfield --lamps l.tsv --irradiance 2",
            "lp a.lp -o a.rfield --origin 1,2",
            "lp a.lp -o a.rfield --flat-field cards --origin left",
        ] {
            assert!(parse(line).is_err(), "{line}");
        }
        assert!(parse("lp a.lp --session s").is_ok());
        for line in [
            "--flat-field places",
            "--flat-field places --metres-per-pixel 1e-4",
            "--lamps l.tsv --metres-per-pixel 1e-4",
        ] {
            let message = parse(&format!("lp a.lp -o a.rfield {line}")).unwrap().plan().unwrap_err().to_string();
            assert!(message.contains("belong together"), "{line}: {message}");
        }
    }
}
