//! `relume pack`: a session -> a field.

mod gantry;
mod screen;

use std::fmt::Write as _;
use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use relume_core::acquire::{FlatField, ImportLp, Measured};
use relume_core::calibrate::linearity::Compared;
use relume_core::domain::lp;
use relume_core::field::{Access, Asset, Precision};
use relume_core::files::{check_folder, write_whole};
use relume_core::hdr::Curve;
use relume_core::image::{ColourSpace, EncodeOptions, Encoding, write};
use relume_core::{Error, Result as CoreResult};

use self::gantry::GantryFlags;
use self::screen::ScreenFlags;
use super::info::Info;
use super::note;
use crate::new_folder::{self, NewFolder};
use crate::pack::checks::Checks;
use crate::pack::develop::Developer;
use crate::pack::lamps::Irradiances;
use crate::pack::records::Records;
use crate::pack::stage::{Packed, StagePack};
use crate::progress::{Progress, Unit};
use crate::rigs::StageRig;
use crate::session::staging::LIGHTS;
use crate::session::{CaptureDescription, Description, ImportDescription, Role, Source};

const EXAMPLES: &str = "\
Examples:
  relume pack vase -o vase.rfield
  relume pack vase -o vase.rfield --alpha vase-matte.png
  relume pack vase -o vase.rfield --partial
  relume pack vase --merged vase-light
  relume pack glass -o glass.rfield --terms 64
  relume pack glass -o glass.rfield --basis 9/7 --bare glass-bare
  relume pack glass -o glass.rfield --tiles 1-32
  relume pack chess -o chess.rfield --store terms --error 0.01
  relume pack chess -o chess.rfield --white-patch 300,220,24,24

Brackets are merged with the camera's response and black level, the ambient light is subtracted, drift of the lamps is corrected,
and each photograph is divided by what its lamp gives a patch facing it. What was found stands in the session's calibration/.
The photographs stay as they are: pack again as often as you like.

Patterns of noise on a screen are solved pixel by pixel. Where Gray codes and stripes were photographed as well, the screen that
is seen past the object is taken out of the photographs, and T is in units of the white screen. A tile is a row of 8 pixels:
--tiles writes A.rfield.part-A-B, and `relume merge` joins what several machines have solved. A large field that was stopped
goes on where it was.

Squares of a projector that were lit together are told apart by the smaller of two photographs (7.5). Where that fails, in hollows, the
notes say so, and calibration/reliability/ in the session shows it; the layer `reliability` of the field sums it up.";

/// Raw flags.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    /// The session folder.
    session: PathBuf,
    #[command(flatten)]
    target: Target,
    /// A picture of the object's coverage: white object, black surroundings, taken as stored.
    #[arg(long, value_name = "IMG")]
    alpha: Option<PathBuf>,
    /// Leave out lamps that have no photograph.
    #[arg(long)]
    partial: bool,
    /// How the field is stored: 16-bit or 32-bit floats.
    #[arg(long, value_enum, default_value_t = PrecisionChoice::Half)]
    precision: PrecisionChoice,
    #[command(flatten)]
    screen: ScreenFlags,
    #[command(flatten)]
    gantry: GantryFlags,
}

/// Where to: at least one.
#[derive(Debug, Args)]
#[group(required = true, multiple = true)]
struct Target {
    /// The .rfield file to write.
    #[arg(short, long, value_name = "A.rfield")]
    output: Option<PathBuf>,
    /// A new folder for the merged photographs as EXR, linear light, the ambient light still in them.
    #[arg(long, value_name = "DIR")]
    merged: Option<PathBuf>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum PrecisionChoice {
    Half,
    Float,
}

impl PrecisionChoice {
    fn precision(self) -> Precision {
        match self {
            Self::Half => Precision::Half,
            Self::Float => Precision::Float,
        }
    }
}

impl Arguments {
    /// Packs.
    ///
    /// # Errors
    /// No session, one that is not complete, files that are gone or changed, no room.
    pub fn run(self) -> anyhow::Result<String> {
        if let Some(output) = &self.target.output {
            check_folder(output)?;
        }
        if let Some(folder) = &self.target.merged {
            new_folder::check(folder)?;
        }
        let description = Description::read(&self.session)?;
        match &description.source {
            Source::Capture(capture) => self.captured(capture, &description),
            Source::Import(import) => self.imported(import),
        }
    }

    fn captured(&self, capture: &CaptureDescription, description: &Description) -> anyhow::Result<String> {
        let records = Records::read(&self.session)?;
        let developer = Developer::new(&records, &capture.rig.camera)?;
        let mut report = camera_words(&developer);
        if let Some(folder) = &self.target.merged {
            report += &self.merge_all(&records, &developer, folder)?;
        }
        let Some(output) = &self.target.output else { return Ok(report) };
        if let Some(gantry) = &capture.rig.gantry {
            self.screen.refuse("a field of a projector")?;
            if self.partial {
                anyhow::bail!("--partial is for stages: a position without its photographs is a hole in the light");
            }
            let captured = gantry::Captured { capture, gantry, records: &records, developer: &developer };
            report += &gantry::captured(self, &captured, output)?;
            developer.doubts().iter().for_each(|doubt| note(doubt));
            return Ok(report);
        }
        self.gantry.refuse("a field of another rig")?;
        if let Some(monitor) = &capture.rig.monitor {
            let captured = screen::Captured { capture, monitor, records: &records, developer: &developer };
            report += &screen::captured(self, &captured, output)?;
            developer.doubts().iter().for_each(|doubt| note(doubt));
            return Ok(report);
        }
        self.screen.refuse("a field of a stage")?;
        let Some(stage) = &capture.rig.stage else {
            return Err(Error::invalid(self.session.display().to_string(), "a rig without lights", "a rig file").into());
        };
        let irradiances = Irradiances::new(&records, &developer, &capture.rig, stage)?;
        let checks = Checks::new(&records, &developer)?;
        let job = StagePack {
            records: &records,
            stage,
            developer: &developer,
            irradiances: &irradiances,
            checks: &checks,
            alpha: self.alpha.as_deref(),
            partial: self.partial,
            precision: self.precision.precision(),
        };
        let provenance = serde_json::json!({
            "source": "capture",
            "rig": capture.rig.name,
            "session": self.session.file_name().map(|name| name.to_string_lossy()),
            "begun": description.begun,
            "sampler": capture.sampler,
            "seed": capture.seed,
            "photographs": records.of(Role::Sample).count(),
            "response": format!("{:?}", capture.rig.camera.response).to_lowercase(),
            "irradiances_measured": irradiances.measured,
            "drift_corrected": checks.corrects(),
        });
        let mut progress = Progress::new("packing", Unit::Steps);
        let packed = job.write(output, provenance, &mut |done, all| progress.step(done, all))?;
        drop(progress);
        report += &irradiances.words();
        report += &checks.words();
        report += &linearity_words(&packed);
        let doubts =
            irradiances.doubts.iter().chain(developer.doubts()).cloned().chain(checks.doubts()).chain(doubts(&packed));
        doubts.for_each(|doubt| note(&doubt));
        if let Err(error) = self.keep(stage, &developer, &irradiances, &report) {
            note(&format!("what was found could not be written into the session: {error}"));
        }
        let asset = Asset::open(output, Access::Read)?;
        Ok(format!("{}\n{report}", Info::of(&asset).summary()))
    }

    /// All samples as light.
    fn merge_all(&self, records: &Records, developer: &Developer, folder: &Path) -> anyhow::Result<String> {
        let new = NewFolder::begin(folder)?;
        let mut progress = Progress::new("merging", Unit::Steps);
        let all: Vec<_> = records.all().filter(|p| !matches!(p.role, Role::Dark | Role::Response)).collect();
        for (photograph, done) in all.iter().zip(0..) {
            progress.step(done, all.len() as u64)?;
            let words = photograph.condition.to_string().replace([' ', ',', '/'], "-").replace("--", "-");
            let path = new.path().join(format!("{:06}-{words}.exr", photograph.number));
            write(&path, &developer.picture(records, photograph)?, EncodeOptions { half: true, ..Default::default() })?;
        }
        drop(progress);
        let folder = new.commit()?;
        Ok(format!("{}: {} photographs as light\n", folder.display(), all.len()))
    }

    /// What was found, for people, in the session's `calibration/`.
    fn keep(&self, stage: &StageRig, developer: &Developer, irradiances: &Irradiances, report: &str) -> CoreResult<()> {
        let folder = self.session.join("calibration");
        fs::create_dir_all(&folder).map_err(|source| Error::io("create", &folder, source))?;
        if let Curve::Response(response) = developer.curve() {
            response.write(&folder.join("response.txt"))?;
        }
        let text = |name: &str, text: &str| {
            let path = folder.join(name);
            write_whole(&path, |out| out.write_all(text.as_bytes()).map_err(|source| Error::io("write", &path, source)))
        };
        text("report.txt", report)?;
        let mut table = String::from("lamp\tred\tgreen\tblue\n");
        for (bulb, [r, g, b]) in irradiances.bulbs.iter().enumerate().take(stage.lamps.per_stop()) {
            let _ = writeln!(table, "{}\t{r:.6}\t{g:.6}\t{b:.6}", bulb + 1);
        }
        text("irradiances.tsv", &table)
    }

    /// A session of photographs made elsewhere.
    fn imported(&self, import: &ImportDescription) -> anyhow::Result<String> {
        let Some(output) = &self.target.output else {
            anyhow::bail!("--merged is for captured brackets; imported photographs are merged already");
        };
        self.gantry.refuse("a field of another rig")?;
        match import.kind.as_str() {
            "lp" => self.screen.refuse("a field of lamps")?,
            "pairs" => return screen::imported(self, import, output),
            other => {
                return Err(Error::Unsupported {
                    place: self.session.display().to_string(),
                    what: format!("a field from imported {other}"),
                    advice: "this version makes fields of photographs of one lamp, or one pattern, each".to_owned(),
                }
                .into());
            }
        }
        let setting = |name: &str| import.settings.get(name).and_then(toml::Value::as_str);
        let file = |name: &str| setting(name).map(|path| self.session.join(path));
        let job = ImportLp {
            lp: self.session.join(LIGHTS),
            encoding: match import.encoding.as_str() {
                "srgb" => Encoding::Srgb,
                "linear" => Encoding::Linear,
                _ => Encoding::Auto,
            },
            colour_space: import.colour_space.parse::<ColourSpace>()?,
            black: file("black"),
            alpha: self.alpha.clone().or_else(|| file("alpha")),
            irradiance: import.settings.get("irradiance").and_then(toml::Value::as_float).unwrap_or_default() as f32,
            measured: Measured {
                lamps: file("lamps"),
                flat_field: file("flat_field").map_or(FlatField::None, FlatField::Cards),
                origin_px: None,
            },
            precision: self.precision.precision(),
            lengths: lp::Lengths::Normalise,
            exclude: Vec::new(),
            correction: None,
        };
        let mut progress = Progress::new("packing", Unit::Steps);
        job.run(output, &mut |done, all| progress.step(done, all))?;
        drop(progress);
        Ok(format!("{}\n", Info::of(&Asset::open(output, Access::Read)?).summary()))
    }
}

fn camera_words(developer: &Developer) -> String {
    let mut text = String::new();
    if let Some(black) = &developer.black {
        let [r, g, b] = black.level.map(|level| 100.0 * level);
        let _ = writeln!(text, "camera     black level {r:.2}, {g:.2}, {b:.2} % of white");
    }
    if let Some(recovery) = &developer.recovery {
        let [r, g, b] = recovery.residual_ev;
        let _ = writeln!(text, "response   recovered; strays by {r:.3}, {g:.3}, {b:.3} stops");
    }
    text
}

fn linearity_words(packed: &Packed) -> String {
    let error = |compared: &Compared| compared.relative_error.into_iter().fold(0.0, f64::max);
    let worst = packed.linearity.iter().map(|(stop, compared)| (error(compared), stop + 1));
    worst.max_by(|a, b| a.0.total_cmp(&b.0)).map_or_else(String::new, |(worst, stop)| {
        format!(
            "linearity  all lamps of a stop together differ from their sum by at most {:.2} % (stop {stop} of {})\n",
            100.0 * worst,
            packed.linearity.len()
        )
    })
}

fn doubts(packed: &Packed) -> Vec<String> {
    let failed = packed.linearity.iter().filter(|(_, compared)| !compared.passes());
    let mut doubts: Vec<String> =
        failed.take(1).map(|(stop, compared)| format!("stop {}: {}", stop + 1, compared.verdict())).collect();
    if packed.lamps < packed.of {
        doubts.push(format!("{} of {} lamps are in the field; the others have no photograph", packed.lamps, packed.of));
    }
    if packed.clipped > 1e-3 {
        doubts.push(format!(
            "{:.1} % of the pixels are clipped in every exposure of their photograph: shorter times are wanted",
            100.0 * packed.clipped
        ));
    }
    doubts
}
