//! `relume import graycode`: codes seen through clear glass -> a field of one place a pixel.

use std::path::PathBuf;

use clap::Args;
use relume_core::acquire::Refraction;
use relume_core::domain::{Domain, Plane};
use relume_core::field::{Access, Asset, Contents, Precision, TermBasis, write_terms};
use relume_core::files::check_folder;
use relume_core::image::ColourSpace;

use super::{EncodingChoice, one_size, pictures};
use crate::commands::info::Info;
use crate::commands::{note, values};
use crate::pack::places::{alpha, correspondence};
use crate::pack::shots::Shots;
use crate::progress::{Progress, Unit};

const EXAMPLES: &str = "\
Examples:
  relume import graycode --patterns codes --photos photographs -o glass.rfield
  relume matte glass.rfield --plate street.jpg -o composite.png

The camera looks through a clear object at a screen that shows Gray codes (or plain binary codes, or
2, 4, 8... stripes) of columns and of rows, with inverses or without, in any order; a white picture
among them tells colours better. Every pixel gets the one place of the screen that it sees and what
is left of its light: what glass and mirrors do, and no more. What scatters light, or shows two
places at once, wants patterns of noise: `relume capture --sampler noise`, `relume import pairs`. The
field is cropped to where the patterns are seen.";

/// More of the object than this without a place deserves a word.
const LOST: f64 = 0.1;

/// Raw flags.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct GraycodeArguments {
    /// The folder of the pictures that were shown.
    #[arg(long, value_name = "DIR")]
    patterns: PathBuf,
    /// The folder of their photographs, in the same order by name.
    #[arg(long, value_name = "DIR")]
    photos: PathBuf,
    /// The .rfield file to write.
    #[arg(short, long, value_name = "A.rfield")]
    output: PathBuf,
    /// How the photographs' numbers become light [default: sRGB for 8 and 16 bits, linear for floats].
    #[arg(long, value_enum)]
    encoding: Option<EncodingChoice>,
    /// The colour space of the photographs, once decoded to light: lin_rec709, lin_rec2020, acescg, aces2065_1 or lin_p3d65.
    #[arg(long, value_name = "SPACE", value_parser = values::colour_space, default_value_t = ColourSpace::default())]
    colour_space: ColourSpace,
}

impl GraycodeArguments {
    /// Imports.
    pub fn run(self) -> anyhow::Result<String> {
        check_folder(&self.output)?;
        let (patterns, photographs) = (pictures(&self.patterns)?, pictures(&self.photos)?);
        one_size(patterns.iter())?;
        one_size(photographs.iter())?;
        let shots = Shots::of_folders(&patterns, photographs, EncodingChoice::of(self.encoding))?;
        let mut progress = Progress::new("reading codes", Unit::Steps);
        let found = correspondence(&shots, &mut |done, all| progress.step(done, all))?;
        let covered = alpha(&shots, &found.fit.correspondence, &mut |done, all| progress.step(done, all))?;
        drop(progress);
        let field = Refraction::new(&found.decoded, &covered, &found.fit.correspondence)?;
        self.write(&field, found.decoded.texels)?;
        let object = field.alpha.iter().filter(|alpha| **alpha > 0.5).count();
        if field.lost as f64 > LOST * object as f64 {
            note(&format!(
                "{} of the object's {object} pixels show no place of the screen and stay black: they are dark, matt or blurred",
                field.lost
            ));
        }
        let summary = Info::of(&Asset::open(&self.output, Access::Read)?).summary();
        let error = found.held_out.median_px;
        Ok(format!("{summary}\nwhere pixels look past the object is known to {error:.2} pixels (median)\n"))
    }

    fn write(&self, field: &Refraction, texels: (usize, usize)) -> anyhow::Result<()> {
        let plane = Plane::new(texels.0, texels.1)?;
        let (width, height) = field.size();
        let contents = Contents {
            domain: Domain::Plane(plane, Some(Box::new(field.correspondence.clone()))),
            irradiance: Vec::new(),
            width,
            height,
            colour_space: self.colour_space,
            precision: Precision::Half,
            largest: field.largest,
            ambient: None,
            alpha: Some(field.alpha.clone()),
            reliability: None,
            provenance: serde_json::json!({
                "import": "graycode",
                "crop": [field.window.x0, field.window.y0, field.window.x1, field.window.y1],
            }),
        };
        Ok(write_terms(&self.output, &contents, (TermBasis::Texels, None), &mut &*field)?)
    }
}
