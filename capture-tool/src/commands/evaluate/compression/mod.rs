//! `relume evaluate compression`: flags, and what is checked before the work.
//!
//! | file | what it does |
//! |---|---|
//! | `measure` | the measuring of wavelets on reflectance functions |
//! | `representations` | compact representations: size, speed, errors of relit pictures |
//! | `report` | the numbers as JSON and as tables |
//! | `page` | all of it on one page |

mod measure;
mod page;
mod report;
mod representations;

use std::path::{Path, PathBuf};

use clap::Args;
use relume_core::Error;
use relume_core::domain::StageGrid;
use relume_core::field::{Access, Asset};
use relume_core::reconstruct::{Method, Reconstruction};

use super::inputs::{self, method};
use super::page::put;
use crate::commands::values;
use crate::new_folder::{self, NewFolder};
use measure::{Measured, Task};

const EXAMPLES: &str = "\
Examples:
  relume evaluate compression car.rfield -o car-compression
  relume evaluate compression car.rfield --env park.hdr --env city.hdr --pixels 5000 -o car-compression
  relume evaluate compression car.rfield --grid 128x32 --reconstruct linear --column 90 -o car-compression

Reflectance functions are rebuilt on a grid and decoded from a part of their wavelet coefficients (Peers 2006, 5.4); and the
whole field is made into every compact representation, which is relit beside the samples. Open DIR/index.html; the numbers
are in DIR/compression.json.";

/// Pixels that are measured if nothing else is said: about a minute on two cores.
const PIXELS: usize = 1000;

/// Raw flags.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    /// The captured object: a .rfield file with the samples as photographed.
    asset: PathBuf,
    /// The folder to write to; it must be new or empty.
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// Longitudes x angles from the axis that reflectance functions are rebuilt on.
    #[arg(long, value_name = "WxH", default_value = "256x64", value_parser = values::grid)]
    grid: (usize, usize),
    /// How they are rebuilt, and how light is projected onto the lamps.
    #[arg(long, value_name = "METHOD", default_value = "b-spline", value_parser = method())]
    reconstruct: Method,
    /// How many pixels to measure wavelets on, chosen by chance from those that are not black; all where there are fewer.
    /// The time is proportional to it.
    #[arg(long, value_name = "N", default_value_t = PIXELS, value_parser = values::at_least_one)]
    pixels: usize,
    /// The column of the picture that is shown under the turning sliver of light, from 0; the middle if not given.
    #[arg(long, value_name = "X")]
    column: Option<usize>,
    /// Relight with this lat-long map too; may be given several times.
    #[arg(long = "env", value_name = "MAP")]
    environments: Vec<PathBuf>,
}

impl Arguments {
    /// Measures and writes.
    pub fn run(self) -> anyhow::Result<String> {
        let output = self.output.clone();
        let task = self.plan()?;
        let folder = NewFolder::begin(&output)?;
        let measured = task.carry_out(folder.path())?;
        write(&task, &measured, folder.path())?;
        folder.commit()?;
        let (table, page) = (report::tables(&measured.report), output.join("index.html"));
        Ok(format!("{table}\nOpen {}\n", page.display()))
    }

    /// Refuses what can be known to fail before the work.
    fn plan(self) -> anyhow::Result<Task> {
        new_folder::check(&self.output)?;
        let asset = Asset::open(&self.asset, Access::Mapped)?;
        if asset.dense().is_none() {
            let what = "measuring against samples: it no longer holds those as photographed".to_owned();
            let advice = "use the asset that it was made from".to_owned();
            return Err(Error::Unsupported { place: self.asset.display().to_string(), what, advice }.into());
        }
        let column = inputs::column(self.column, &asset)?;
        let grid = StageGrid::new(asset.directions()?, self.grid)?;
        // Refuses a method that the lamps do not allow.
        Reconstruction::new(asset.directions()?.clone(), self.reconstruct)?;
        let environments =
            self.environments.iter().map(|path| inputs::environment(path)).collect::<anyhow::Result<Vec<_>>>()?;
        let command = self.command(column);
        Ok(Task { asset, grid, method: self.reconstruct, pixels: self.pixels, column, environments, command })
    }

    /// What repeats the measurement, with every default written out.
    fn command(&self, column: usize) -> String {
        let mut words = format!(
            "relume evaluate compression {} -o {} --grid {}x{} --reconstruct {} --pixels {} --column {column}",
            self.asset.display(),
            self.output.display(),
            self.grid.0,
            self.grid.1,
            self.reconstruct.id(),
            self.pixels
        );
        self.environments.iter().for_each(|path| words += &format!(" --env {}", path.display()));
        words
    }
}

/// Puts all files into a folder.
fn write(task: &Task, measured: &Measured, folder: &Path) -> anyhow::Result<()> {
    let report = &measured.report;
    let (json, table) = (serde_json::to_string_pretty(report)? + "\n", report::tables(report));
    put(folder, [("compression.json", json.as_bytes()), ("compression.txt", table.as_bytes())])?;
    let figures = page::Figures::new(task, measured)?;
    put(folder, figures.files())?;
    put(folder, [("index.html", page::page(report, &figures).as_bytes())])?;
    Ok(())
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
        let plain = parse("compression a.rfield -o d").unwrap();
        assert_eq!((plain.grid, plain.reconstruct, plain.pixels), ((256, 64), Method::BSpline, PIXELS));
        let line =
            "compression a.rfield -o d --grid 64x16 --reconstruct linear --pixels 7 --column 3 --env a.hdr --env b.hdr";
        let given = parse(line).unwrap();
        assert_eq!((given.grid, given.reconstruct, given.column), ((64, 16), Method::Linear, Some(3)));
        assert_eq!(given.environments.len(), 2);
        // The command that is shown does the same again.
        let shown = given.command(3);
        let again = parse(shown.strip_prefix("relume evaluate ").unwrap()).unwrap();
        assert_eq!(shown, again.command(3));
    }

    #[test]
    fn wrong_usage_is_refused_by_the_parser() {
        for (options, words) in [
            ("--grid 256", "256x64"),
            ("--grid 256x", "256x64"),
            ("--grid -8x4", "256x64"),
            ("--pixels 0", "at least 1"),
            ("--pixels many", "whole number"),
            ("--reconstruct cubic", "possible values: zero-order, linear"),
            ("--column 1.5", "invalid digit"),
        ] {
            let options = options.replacen(' ', "=", 1);
            let message = parse(&format!("compression a.rfield -o d {options}")).unwrap_err().to_string();
            assert!(message.contains(words), "{options}: {message}");
        }
        assert!(parse("compression a.rfield").is_err());
    }
}
