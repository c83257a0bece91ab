//! `relume evaluate implicit`: flags, and what is checked before the work.
//!
//! | file | what it does |
//! |---|---|
//! | `measure` | the measuring on the virtual monitor |
//! | `report` | the numbers as JSON and as a table, the chart, and all of it on one page |

mod measure;
mod report;

use std::path::{Path, PathBuf};

use clap::Args;
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use relume_core::Error;
use relume_core::domain::Plane;
use relume_core::evaluate::implicit::{Backdrop, Setup, dead_leaves};
use relume_core::image::{Encoding, Image, read};
use relume_core::wavelet::Wavelet;

use super::page::put;
use crate::commands::values;
use crate::new_folder::{self, NewFolder};
use measure::Task;

const EXAMPLES: &str = "\
Examples:
  relume evaluate implicit -o implicit
  relume evaluate implicit --texels 128x128 --size 160x120 --backdrop street.jpg --backdrop park.hdr -o implicit-128
  relume evaluate implicit --basis 9/7 --noise 0.5 -o implicit-smooth

The virtual monitor (glass, mirror, glossy and diffuse bodies) is photographed under wavelet noise, solved with 16 to 128
terms from 96 to 512 patterns, with and without the rule to stop, and relit by backdrops (Peers 2006, figure 6.30). Open
DIR/index.html; the numbers are in DIR/implicit.json. The default takes about a minute on two cores.";

/// Backdrops that are made where none is given.
const BACKDROPS: u64 = 4;

/// Raw flags.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    /// The folder to write to; it must be new or empty.
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// Columns x rows of the screen's texels.
    #[arg(long, value_name = "WxH", default_value = "64x64", value_parser = values::grid)]
    texels: (usize, usize),
    /// Width x height of the photographs.
    #[arg(long, value_name = "WxH", default_value = "96x72", value_parser = values::grid)]
    size: (usize, usize),
    /// The wavelet that reflectance functions are made of.
    #[arg(long, value_name = "WAVELET", default_value = "haar", value_parser = basis())]
    basis: Wavelet,
    /// Camera noise: its standard deviation where the white screen is seen, in percent; it falls as the root of the light.
    #[arg(long, value_name = "PERCENT", default_value_t = 100.0 * f64::from(Setup::NOISE), value_parser = percent)]
    noise: f64,
    /// Seed of the patterns, the noise, and the backdrops.
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Relight by this picture, stretched over the screen and clipped to its range; may be given several times. Four made
    /// ones (dead leaves) if not given.
    #[arg(long = "backdrop", value_name = "IMAGE")]
    backdrops: Vec<PathBuf>,
}

/// A parser for the wavelets that a screen allows.
fn basis() -> impl TypedValueParser<Value = Wavelet> {
    let known = || Wavelet::ALL.iter().copied().filter(|wavelet| wavelet.is_symmetric());
    let names = known().map(|wavelet| PossibleValue::new(wavelet.id()));
    PossibleValuesParser::new(names).map(move |name| name.parse().unwrap_or(Wavelet::Haar))
}

/// A number of percent, zero included.
fn percent(text: &str) -> Result<f64, String> {
    let number = values::finite(text)?;
    if (0.0..=100.0).contains(&number) { Ok(number) } else { Err("a number of percent, 0 to 100".to_owned()) }
}

impl Arguments {
    /// Measures and writes.
    pub fn run(self) -> anyhow::Result<String> {
        let output = self.output.clone();
        let task = self.plan()?;
        let folder = NewFolder::begin(&output)?;
        let report = task.carry_out()?;
        write(&report, folder.path())?;
        folder.commit()?;
        let page = output.join("index.html");
        Ok(format!("{}\nOpen {}\n", report::table(&report), page.display()))
    }

    /// Refuses what can be known to fail before the work.
    fn plan(self) -> anyhow::Result<Task> {
        new_folder::check(&self.output)?;
        let plane = Plane::new(self.texels.0, self.texels.1)?;
        let mut backdrops = Vec::new();
        for path in &self.backdrops {
            let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
            backdrops.push((name, shrunk(&read(path, Encoding::Auto)?.into_rgb(), plane, path)?));
        }
        if backdrops.is_empty() {
            let made = |n| (format!("dead leaves {n}"), dead_leaves(plane, self.seed.wrapping_add(n)));
            backdrops = (1..=BACKDROPS).map(made).collect();
        }
        let command = self.command();
        Ok(Task {
            plane,
            size: self.size,
            basis: self.basis,
            noise: (self.noise / 100.0) as f32,
            seed: self.seed,
            backdrops,
            command,
        })
    }

    /// What repeats the measurement, with every default written out.
    fn command(&self) -> String {
        let mut words = format!(
            "relume evaluate implicit -o {} --texels {}x{} --size {}x{} --basis {} --noise {} --seed {}",
            self.output.display(),
            self.texels.0,
            self.texels.1,
            self.size.0,
            self.size.1,
            self.basis.id(),
            self.noise,
            self.seed
        );
        self.backdrops.iter().for_each(|path| words += &format!(" --backdrop {}", path.display()));
        words
    }
}

/// A picture as texels: means over the pixels whose centres lie in each.
fn shrunk(picture: &Image, plane: Plane, path: &Path) -> relume_core::Result<Backdrop> {
    let (width, height) = picture.size();
    let (columns, rows) = plane.size();
    if width < columns || height < rows {
        let found = format!("{width} x {height} pixels");
        let expected = format!("at least a pixel for each of {columns} x {rows} texels");
        return Err(Error::invalid(path.display().to_string(), found, expected));
    }
    let mut sums = vec![([0.0; 3], 0.0); plane.len()];
    for y in 0..height {
        for x in 0..width {
            let (sum, count) = &mut sums[plane.element(x * columns / width, y * rows / height)];
            let pixel = picture.pixel(x, y);
            (0..3).for_each(|c| sum[c] += pixel[c].clamp(0.0, 1.0));
            *count += 1.0;
        }
    }
    Ok(sums.into_iter().map(|(sum, count): ([f32; 3], f32)| sum.map(|v| v / count)).collect())
}

/// Puts all files into a folder.
fn write(report: &report::Report, folder: &Path) -> anyhow::Result<()> {
    let (json, table) = (serde_json::to_string_pretty(report)? + "\n", report::table(report));
    let chart = report::chart(report)?;
    let page = report::page(report, &chart);
    let files = [
        ("implicit.json", json.as_bytes()),
        ("implicit.txt", table.as_bytes()),
        ("errors.svg", chart.as_bytes()),
        ("index.html", page.as_bytes()),
    ];
    Ok(put(folder, files)?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::commands::testing;

    fn parse(line: &str) -> Result<Arguments, clap::Error> {
        testing::parse(line)
    }

    #[test]
    fn flags_are_understood() {
        let plain = parse("implicit -o d").unwrap();
        assert_eq!((plain.texels, plain.size, plain.basis, plain.seed), ((64, 64), (96, 72), Wavelet::Haar, 1));
        assert!((plain.noise - 0.2).abs() < 1e-6);
        let given = parse("implicit -o d --texels 32x16 --size 20x10 --basis 9/7 --noise 0 --backdrop a.png").unwrap();
        assert_eq!((given.texels, given.basis, given.backdrops.len()), ((32, 16), Wavelet::Daubechies97, 1));
        // The command that is shown does the same again.
        let shown = given.command();
        let again = parse(shown.strip_prefix("relume evaluate ").unwrap()).unwrap();
        assert_eq!(shown, again.command());
    }

    #[test]
    fn wrong_usage_is_refused_by_the_parser() {
        for (options, words) in [
            ("--texels 64", "256x64"),
            ("--basis d4", "possible values: haar, 5/3, 9/7"),
            ("--noise -1", "0 to 100"),
            ("--noise much", "number"),
        ] {
            let options = options.replacen(' ', "=", 1);
            let message = parse(&format!("implicit -o d {options}")).unwrap_err().to_string();
            assert!(message.contains(words), "{options}: {message}");
        }
        assert!(parse("implicit").is_err());
    }

    #[test]
    fn backdrops_are_means_of_pixels() {
        let plane = Plane::new(2, 1).unwrap();
        let picture = Image::from_fn(4, 2, |x, y| [x as f32 / 4.0, y as f32, 5.0]);
        let texels = shrunk(&picture, plane, Path::new("a.png")).unwrap();
        assert_eq!(texels, [[0.125, 0.5, 1.0], [0.625, 0.5, 1.0]]);
        let message = shrunk(&picture, Plane::new(8, 2).unwrap(), Path::new("a.png")).unwrap_err().to_string();
        assert!(message.contains("a.png") && message.contains("8 x 2 texels"), "{message}");
    }
}
