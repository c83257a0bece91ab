//! `relume calibrate screen`: which place of a screen each pixel sees.

use std::path::PathBuf;

use clap::Args;
use relume_core::files::check_folder;
use relume_core::image::{EncodeOptions, Image, check_output, write};

use super::input::Input;
use crate::commands::note;
use crate::pack::places::{Found, ScreenFile, correspondence};
use crate::progress::{Progress, Unit};

const EXAMPLES: &str = "\
Examples:
  relume calibrate screen glass-session
  relume calibrate screen glass-session -o screen.json
  relume calibrate screen --patterns codes --photos photographs -o screen.json --map places.png

Patterns are Gray codes, plain binary codes or 2, 4, 8... stripes, of columns and of rows, with inverses
or without, in any order; white and black pictures among them help. They are known by what they
show. The camera sees the screen past the object, or without it: what it sees in mirrors and through
glass is left out of the fit. Errors are measured on stripes that were not fitted to, if a session has
them, else on every fifth block of the picture (then rounding to whole texels is in them).";

/// Beyond this the plate is visibly off (done-when of the matte: half a pixel).
const GOOD_PX: f64 = 0.5;

/// Raw flags.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    #[command(flatten)]
    input: Input,
    /// The correspondence to write, as JSON.
    #[arg(short, long, value_name = "FILE.json")]
    output: Option<PathBuf>,
    /// Also write a picture of the places: red from the left of the screen to its right, green from top to bottom, blue where
    /// the screen is seen directly; black where it is not seen.
    #[arg(long, value_name = "IMG")]
    map: Option<PathBuf>,
}

impl Arguments {
    /// Finds, says, and writes.
    pub fn run(self) -> anyhow::Result<String> {
        self.output.as_deref().map(check_folder).transpose()?;
        self.map.as_deref().map(check_output).transpose()?;
        let found = self.input.with(|shots| {
            let mut progress = Progress::new("reading patterns", Unit::Steps);
            Ok(correspondence(shots, &mut |done, all| progress.step(done, all))?)
        })?;
        if let Some(map) = &self.map {
            write(map, &places(&found), EncodeOptions::default())?;
        }
        if let Some(output) = &self.output {
            ScreenFile::new(&found).write(output)?;
        }
        if found.held_out.median_px > GOOD_PX && found.held_out_kind == "stripes" {
            note("the correspondence is off by more than half a pixel; was anything moved between the photographs?");
        }
        Ok(report(&found))
    }
}

/// See `--map`.
fn places(found: &Found) -> Image {
    let (width, height) = found.decoded.size;
    Image::from_fn(width, height, |x, y| match found.decoded.screen(x, y) {
        Some([u, v]) => [u as f32, v as f32, if found.direct[y * width + x] { 1.0 } else { 0.0 }],
        None => [0.0; 3],
    })
}

fn report(found: &Found) -> String {
    let (decoded, fit) = (&found.decoded, &found.fit);
    let seen = decoded.places.iter().flatten().count();
    let direct = found.direct.iter().filter(|direct| **direct).count();
    let share = |n: usize| 100.0 * n as f64 / decoded.places.len() as f64;
    let mut text = format!(
        "{} x {} pixels, {} x {} texels of {:.2} pixels\n",
        decoded.size.0, decoded.size.1, decoded.texels.0, decoded.texels.1, fit.texel_px
    );
    text +=
        &format!("{seen} pixels see the screen ({:.1} %), {direct} directly ({:.1} %)\n", share(seen), share(direct));
    if !decoded.unresolved.is_empty() {
        let [across, down] = decoded.resolution;
        text += &format!(
            "{} patterns are too fine for the camera: places are known to {across} columns and {down} rows\n",
            decoded.unresolved.len()
        );
    }
    let line = |name: &str, count: usize, what: &str, median: f64, most: f64| {
        format!("{name:<12}median {median:.3}, 95 % {most:.3} pixels ({count} {what})\n")
    };
    text += &line("homography", fit.homography.count, "places", fit.homography.median_px, fit.homography.most_px);
    text += &line("fitted", fit.inliers.count, "places", fit.inliers.median_px, fit.inliers.most_px);
    let what = if found.held_out_kind == "stripes" { "edges of stripes" } else { "places" };
    text += &line("held out", found.held_out.count, what, found.held_out.median_px, found.held_out.most_px);
    if fit.correspondence.is_mirrored() {
        text += "the camera sees the screen mirrored\n";
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::commands::testing;

    #[test]
    fn wrong_usage_is_refused_by_the_parser() {
        for line in [
            "screen",
            "screen --patterns a",
            "screen s --patterns a --photos b",
            "screen s --encoding linear",
            "screen s t",
        ] {
            assert!(testing::parse::<Arguments>(line).is_err(), "{line}");
        }
        assert!(testing::parse::<Arguments>("screen --patterns a --photos b --encoding srgb -o c.json").is_ok());
    }
}
