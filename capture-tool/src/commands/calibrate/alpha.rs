//! `relume calibrate alpha`: what the object covers of the screen behind it.

use std::path::{Path, PathBuf};

use clap::Args;
use relume_core::image::{EncodeOptions, Image, check_output, read, write};
use relume_core::matte::alpha::{self, Triangulation};

use super::input::Input;
use crate::commands::import::{one_size, pictures};
use crate::pack::places::{ScreenFile, alpha as from_stripes, correspondence};
use crate::pack::shots::Shots;
use crate::progress::{Progress, Unit};

const EXAMPLES: &str = "\
Examples:
  relume calibrate alpha glass-session -o alpha.exr
  relume calibrate alpha --patterns stripes --photos photographs --screen screen.json -o alpha.exr
  relume calibrate alpha --photos with-object --bare without-object -o alpha.exr

From stripes (and Gray codes) alpha is what does not show them where the bare screen would: right for
glass, mirrors and soft edges. From photographs before two or more backdrops (--bare: the same
backdrops without the object, in the same order) it is right for opaque objects alone: through glass
the backdrop is seen as well. White is object; write EXR or TIFF, for PNG and JPEG bend the values.";

/// Raw flags.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    #[command(flatten)]
    input: Input,
    /// The correspondence that `relume calibrate screen` wrote [default: found from the same patterns].
    #[arg(long, value_name = "FILE.json", conflicts_with = "bare")]
    screen: Option<PathBuf>,
    /// The folder of the backdrops' photographs without the object: triangulation in place of stripes.
    #[arg(long, value_name = "DIR", requires = "photos", conflicts_with_all = ["patterns", "session"])]
    bare: Option<PathBuf>,
    /// The picture to write.
    #[arg(short, long, value_name = "IMG")]
    output: PathBuf,
}

impl Arguments {
    /// Finds, says, and writes.
    pub fn run(self) -> anyhow::Result<String> {
        check_output(&self.output)?;
        let (alpha, size, method) = match (&self.bare, self.input.photos()) {
            (Some(bare), Some(photos)) => self.triangulated(photos, bare)?,
            _ => self.input.with(|shots| self.of_stripes(shots))?,
        };
        let picture = Image::from_fn(size.0, size.1, |x, y| [alpha[y * size.0 + x]; 3]);
        write(&self.output, &picture, EncodeOptions::default())?;
        let share =
            |keep: fn(f32) -> bool| 100.0 * alpha.iter().filter(|a| keep(**a)).count() as f64 / alpha.len() as f64;
        Ok(format!(
            "{}: {method}\nobject {:.1} %, screen {:.1} %, soft edges {:.1} % of the pixels\n",
            self.output.display(),
            share(|a| a >= 1.0),
            share(|a| a <= 0.0),
            share(|a| a > 0.0 && a < 1.0),
        ))
    }

    fn of_stripes(&self, shots: &Shots<'_>) -> anyhow::Result<(Vec<f32>, (usize, usize), String)> {
        let mut progress = Progress::new("reading patterns", Unit::Steps);
        let mut told = |done, all| progress.step(done, all);
        let correspondence = match &self.screen {
            Some(path) => ScreenFile::read(path, shots.picture(0)?.size())?.correspondence,
            None => correspondence(shots, &mut told)?.fit.correspondence,
        };
        let found = from_stripes(shots, &correspondence, &mut told)?;
        let method = format!(
            "from stripes, noise {:.2} %, a pixel is blurred over {} pixels",
            100.0 * found.noise,
            found.width_px
        );
        Ok((found.alpha, found.size, method))
    }

    fn triangulated(&self, with: &Path, without: &Path) -> anyhow::Result<(Vec<f32>, (usize, usize), String)> {
        let (with, without) = (pictures(with)?, pictures(without)?);
        anyhow::ensure!(
            with.len() == without.len(),
            "{} photographs with the object and {} without it; each backdrop is photographed twice",
            with.len(),
            without.len()
        );
        let size = one_size(with.iter().chain(&without))?;
        let (encoding, count) = (self.input.encoding(), with.len() as u64);
        let mut triangulation = Triangulation::default();
        let mut progress = Progress::new("reading backdrops", Unit::Steps);
        for (n, (with, without)) in with.iter().zip(&without).enumerate() {
            triangulation.add(&read(with, encoding)?, &read(without, encoding)?)?;
            progress.step(n as u64 + 1, count)?;
        }
        let found = triangulation.finish()?;
        alpha::check(&found, size, "alpha by triangulation")?;
        Ok((found, size, format!("by triangulation of {} backdrops", with.len())))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::commands::testing;

    #[test]
    fn wrong_usage_is_refused_by_the_parser() {
        for line in [
            "alpha -o a.exr",
            "alpha s",
            "alpha --photos a --bare b --screen c.json -o a.exr",
            "alpha --photos a --patterns p --bare b -o a.exr",
            "alpha s --bare b -o a.exr",
        ] {
            assert!(testing::parse::<Arguments>(line).is_err(), "{line}");
        }
        assert!(testing::parse::<Arguments>("alpha --photos a --bare b -o a.exr").is_ok());
        assert!(testing::parse::<Arguments>("alpha s --screen c.json -o a.exr").is_ok());
    }
}
