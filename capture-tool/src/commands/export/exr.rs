//! `relume export exr`: a field -> one OpenEXR file with a part a lamp.

use std::path::PathBuf;

use clap::Args;
use relume_core::field::{Access, Asset};
use relume_core::image::Image;
use relume_core::image::layers::{self, NewFile, NewPart};
use relume_core::{Error, files};

use super::{Photographs, left_behind, name};
use crate::commands::note;
use crate::progress::{Progress, Unit};

const EXAMPLES: &str = "\
Examples:
  relume export exr vase.rfield -o vase.exr
  relume export exr vase.rfield -o vase.exr --half
  relume import exr vase.exr -o again.rfield

Every part holds what one lamp adds (T E), so that any mixture of lamps is a sum of parts; where the
field has them, the parts `ambient` and `alpha` follow. Attributes of a part tell where its lamp
stands (relumeDirection: x right, y up, z to the camera) and its irradiance E (relumeIrradiance).";

/// The largest half.
const LARGEST_HALF: f32 = 65504.0;

/// Raw flags.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    /// The field.
    asset: PathBuf,
    /// The OpenEXR file to write.
    #[arg(short, long, value_name = "FILE.exr")]
    output: PathBuf,
    /// 16-bit floats in place of 32.
    #[arg(long)]
    half: bool,
}

/// Checked flags.
#[derive(Debug)]
struct Plan {
    asset: Asset,
    output: PathBuf,
    half: bool,
}

impl Arguments {
    /// Exports.
    pub fn run(self) -> anyhow::Result<String> {
        self.plan()?.carry_out()
    }

    /// Refuses what can be known to fail before the work.
    fn plan(self) -> anyhow::Result<Plan> {
        files::check_folder(&self.output)?;
        if self.output.extension().is_none_or(|extension| !extension.eq_ignore_ascii_case("exr")) {
            return Err(Error::invalid(self.output.display().to_string(), "another extension", ".exr").into());
        }
        let asset = Asset::open(&self.asset, Access::Read)?;
        asset.samples()?;
        Ok(Plan { asset, output: self.output, half: self.half })
    }
}

impl Plan {
    fn carry_out(&self) -> anyhow::Result<String> {
        let asset = &self.asset;
        let mut photographs = Photographs::new(asset)?;
        let lamps = photographs.len();
        let file = NewFile {
            size: (asset.width(), asset.height()),
            colour_space: asset.colour_space(),
            half: self.half,
            parts: self.parts(lamps)?,
        };
        let alpha = |pixels: &[f32]| {
            let width = asset.width();
            Image::from_fn(width, asset.height(), |x, y| [pixels[y * width + x]; 3])
        };
        // After the lamps.
        let mut layers_left: Vec<Image> =
            asset.ambient().cloned().into_iter().chain(asset.alpha().map(alpha)).collect();
        let (parts, mut clipped) = (file.parts.len(), 0);
        let mut progress = Progress::new("writing parts", Unit::Steps);
        layers::write(&self.output, &file, &mut |n| {
            progress.step(n as u64, parts as u64)?;
            let picture = if n < lamps { photographs.get(n)? } else { layers_left.remove(0) };
            clipped += usize::from(self.half && picture.data().iter().any(|v| v.abs() > LARGEST_HALF));
            Ok(picture)
        })?;
        drop(progress);
        if clipped > 0 {
            note(&format!(
                "{clipped} of {parts} pictures are clipped: halves end at {LARGEST_HALF}; without --half they are whole"
            ));
        }
        if let Some(layers) = left_behind(asset)? {
            note(&layers);
        }
        Ok(format!("{}: {parts} parts, {lamps} of them lamps, {}\n", self.output.display(), asset.colour_space()))
    }

    /// A part a lamp, then ambient and alpha.
    fn parts(&self, lamps: usize) -> relume_core::Result<Vec<NewPart>> {
        let lamp = |(n, (d, e)): (usize, (&relume_core::math::Vec3, &f32))| NewPart {
            name: name(n, lamps),
            grey: false,
            direction: Some([d.x as f32, d.y as f32, d.z as f32]),
            irradiance: Some(*e),
        };
        let layer = |name: &str, grey: bool| NewPart { name: name.to_owned(), grey, direction: None, irradiance: None };
        let told = self.asset.directions()?.lamps().iter().zip(self.asset.manifest().irradiance());
        let mut parts: Vec<NewPart> = told.enumerate().map(lamp).collect();
        parts.extend(self.asset.ambient().map(|_| layer("ambient", false)));
        parts.extend(self.asset.alpha().map(|_| layer("alpha", true)));
        Ok(parts)
    }
}
