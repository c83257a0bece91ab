//! `relume export lp`: a field -> a folder with a photograph a lamp and a `.lp` file.

use std::io::Write;
use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use relume_core::Error;
use relume_core::calibrate::lamp_table::{self, Row};
use relume_core::domain::lp;
use relume_core::field::{Access, Asset};
use relume_core::files::write_whole;
use relume_core::image::{self, ColourSpace, EncodeOptions, Image};

use super::{Photographs, left_behind, name};
use crate::commands::note;
use crate::new_folder::{self, NewFolder};
use crate::progress::{Progress, Unit};

const EXAMPLES: &str = "\
Examples:
  relume export lp vase.rfield -o photographs
  relume export lp vase.rfield -o for-rti --format jpg
  relume import lp photographs/lights.lp -o again.rfield --lamps photographs/lights.lamps.tsv --black photographs/black.exr

Photographs are as a camera would have taken them, T E + ambient. The folder gets lights.lp,
lights.lamps.tsv (the lamps' irradiances) and, where the field has them, the pictures black and alpha.";

/// The list of lamps.
const LIGHTS: &str = "lights.lp";
/// Their irradiances.
const TABLE: &str = "lights.lamps.tsv";

/// White that went through a field of halves may come back by half a step more: not clipped, only rounded.
const ROUNDED: f32 = 1.0 + 1.0 / 1024.0;

/// Raw flags.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    /// The field.
    asset: PathBuf,
    /// The folder to write, new or empty.
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// Type of the photographs: exr and tif hold linear floats, png 16-bit and jpg 8-bit sRGB, clipped at 1.
    #[arg(long, value_enum, default_value_t = FormatChoice::Exr)]
    format: FormatChoice,
    /// For exr: 16-bit floats in place of 32.
    #[arg(long)]
    half: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum FormatChoice {
    Exr,
    Tif,
    Png,
    Jpg,
}

impl FormatChoice {
    fn extension(self) -> &'static str {
        match self {
            Self::Exr => "exr",
            Self::Tif => "tif",
            Self::Png => "png",
            Self::Jpg => "jpg",
        }
    }

    /// Beyond this it clips.
    fn largest(self, half: bool) -> f32 {
        match self {
            Self::Exr if half => 65504.0,
            Self::Exr | Self::Tif => f32::INFINITY,
            Self::Png | Self::Jpg => 1.0,
        }
    }
}

/// Checked flags.
#[derive(Debug)]
struct Plan {
    asset: Asset,
    output: PathBuf,
    format: FormatChoice,
    half: bool,
}

impl Arguments {
    /// Exports.
    pub fn run(self) -> anyhow::Result<String> {
        self.plan()?.carry_out()
    }

    /// Refuses what can be known to fail before the work.
    fn plan(self) -> anyhow::Result<Plan> {
        new_folder::check(&self.output)?;
        anyhow::ensure!(!self.half || self.format == FormatChoice::Exr, "--half is for --format exr alone");
        let asset = Asset::open(&self.asset, Access::Read)?;
        asset.samples()?;
        Ok(Plan { asset, output: self.output, format: self.format, half: self.half })
    }
}

impl Plan {
    /// The folder takes its name last.
    fn carry_out(&self) -> anyhow::Result<String> {
        let folder = NewFolder::begin(&self.output)?;
        let mut photographs = Photographs::new(&self.asset)?;
        let count = photographs.len();
        let ambient = self.asset.ambient();
        let mut progress = Progress::new("writing photographs", Unit::Steps);
        let (mut names, mut clipped) = (Vec::with_capacity(count), 0);
        for lamp in 0..count {
            let mut picture = photographs.get(lamp)?;
            if let Some(ambient) = ambient {
                picture.data_mut().iter_mut().zip(ambient.data()).for_each(|(v, s)| *v += s);
            }
            clipped += usize::from(picture.data().iter().any(|v| *v > ROUNDED * self.format.largest(self.half)));
            let file = format!("{}.{}", name(lamp, count), self.format.extension());
            self.write(&folder.path().join(&file), &picture)?;
            names.push(file);
            progress.step(lamp as u64 + 1, count as u64)?;
        }
        drop(progress);
        if clipped > 0 {
            note(&format!(
                "{clipped} of {count} photographs are clipped: this type of file ends at {}",
                self.format.largest(self.half)
            ));
        }
        self.write_lists(folder.path(), &names)?;
        let options = self.write_layers(folder.path())?;
        if let Some(layers) = left_behind(&self.asset)? {
            note(&layers);
        }
        let folder = folder.commit()?;
        let (shown, space) = (folder.display(), self.asset.colour_space());
        let space = if space == ColourSpace::default() { String::new() } else { format!(" --colour-space {space}") };
        Ok(format!(
            "{shown}: {count} photographs\nTo import them again: relume import lp {} -o A.rfield --lamps {}{options}{space}\n",
            folder.join(LIGHTS).display(),
            folder.join(TABLE).display()
        ))
    }

    fn write(&self, path: &Path, picture: &Image) -> relume_core::Result<()> {
        let colour_space = self.asset.colour_space();
        image::write(path, picture, EncodeOptions { half: self.half, colour_space, ..EncodeOptions::default() })
    }

    /// Directions and irradiances.
    fn write_lists(&self, folder: &Path, names: &[String]) -> relume_core::Result<()> {
        let photographs = names.iter().map(PathBuf::from).collect();
        let lights = lp::text(&lp::Lp { photographs, directions: self.asset.directions()?.lamps().to_vec() });
        let row = |(photograph, e): (&String, &f32)| Row {
            photograph: photograph.clone(),
            irradiance: f64::from(*e),
            position_m: None,
        };
        let rows: Vec<Row> = names.iter().zip(self.asset.manifest().irradiance()).map(row).collect();
        for (name, text) in [(LIGHTS, lights), (TABLE, lamp_table::text(&rows))] {
            let path = folder.join(name);
            write_whole(&path, |out| {
                out.write_all(text.as_bytes()).map_err(|source| Error::io("write", &path, source))
            })?;
        }
        Ok(())
    }

    /// The black photograph, and coverage, as linear floats; the options that import them.
    fn write_layers(&self, folder: &Path) -> relume_core::Result<String> {
        let mut options = String::new();
        if let Some(ambient) = self.asset.ambient() {
            let file = format!("black.{}", self.format.extension());
            self.write(&folder.join(&file), ambient)?;
            options += &format!(" --black {}", self.output.join(file).display());
        }
        if let Some(alpha) = self.asset.alpha() {
            let width = self.asset.width();
            let picture = Image::from_fn(width, self.asset.height(), |x, y| [alpha[y * width + x]; 3]);
            image::write(&folder.join("alpha.exr"), &picture, EncodeOptions::default())?;
            options += &format!(" --alpha {}", self.output.join("alpha.exr").display());
        }
        Ok(options)
    }
}
