//! `relume evaluate reconstruction`: flags, and what is checked before the work.
//!
//! | file | what it does |
//! |---|---|
//! | `measure` | the measuring: errors, and pictures under a turning sliver and under maps |
//! | `report` | the numbers as JSON and as a table |
//! | `charts` | the bar charts |
//! | `page` | all of it on one page |

mod charts;
mod measure;
mod page;
mod report;

use std::path::{Path, PathBuf};

use anyhow::Context;
use clap::Args;
use relume_core::evaluate::pixel_sets::PixelSet;
use relume_core::evaluate::reconstruction::Thinned;
use relume_core::evaluate::{self, Keep};
use relume_core::field::{Access, Asset};
use relume_core::image::{Encoding, read};
use relume_core::reconstruct::Method;

use super::inputs::{self, method};
use super::page::put;
use crate::commands::values;
use crate::new_folder::{self, NewFolder};
use measure::{Lit, Task};

const EXAMPLES: &str = "\
Examples:
  relume evaluate reconstruction car.rfield -o car-report
  relume evaluate reconstruction car.rfield --keep 1/16 --column 90 --env park.hdr -o car-report
  relume evaluate reconstruction car.rfield --methods linear,zero-order --mask paint=paint.png -o car-report

The lamps that are not kept judge the methods: the error of a pixel is the norm of what is rebuilt minus what was measured,
over the norm of what was measured, over all lamps (Peers 2006, 4.4.1). Open DIR/index.html; the numbers are in DIR/errors.json.";

/// Raw flags.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    /// The captured object: a .rfield file.
    asset: PathBuf,
    /// The folder to write to; it must be new or empty.
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// How many lamps to rebuild from: a part, such as 1/4 or 0.25, or a number. Of a grid of lamps every n-th longitude of every
    /// m-th ring is kept, of other sets well-spread lamps.
    #[arg(long, value_name = "PART", default_value = "1/4", value_parser = values::keep)]
    keep: Keep,
    /// The column of the picture that is shown under the turning sliver of light, from 0; the middle if not given.
    #[arg(long, value_name = "X")]
    column: Option<usize>,
    /// Relight with this lat-long map too; may be given several times.
    #[arg(long = "env", value_name = "MAP")]
    environments: Vec<PathBuf>,
    /// Measure also where this picture, as stored, is brighter than one half. The names all, diffuse, glossy and shadowed replace the
    /// sets that are found; others are added. May be given several times.
    #[arg(long = "mask", value_name = "NAME=FILE", value_parser = named_file)]
    masks: Vec<(String, PathBuf)>,
    /// Only these methods, separated by commas.
    #[arg(long, value_name = "METHODS", value_delimiter = ',', value_parser = method())]
    methods: Vec<Method>,
}

fn named_file(text: &str) -> Result<(String, PathBuf), String> {
    match text.split_once('=') {
        Some((name, file)) if !name.trim().is_empty() && !file.is_empty() => Ok((name.trim().to_owned(), file.into())),
        _ => Err("not a name and a file, as in paint=paint.png".to_owned()),
    }
}

impl Arguments {
    /// Measures and writes.
    pub fn run(self) -> anyhow::Result<String> {
        let output = self.output.clone();
        let task = self.plan()?;
        let folder = NewFolder::begin(&output)?;
        let lit = task.carry_out()?;
        write(&task, &lit, folder.path())?;
        folder.commit()?;
        let (table, page) = (report::table(&lit.report), output.join("index.html"));
        Ok(format!("{table}\nOpen {}\n", page.display()))
    }

    /// Refuses what can be known to fail before the work.
    fn plan(self) -> anyhow::Result<Task> {
        new_folder::check(&self.output)?;
        let asset = Asset::open(&self.asset, Access::Mapped)?;
        let size = (asset.width(), asset.height());
        let column = inputs::column(self.column, &asset)?;
        let masks = self.masks.iter().map(|(name, file)| mask(name, file, size)).collect::<anyhow::Result<Vec<_>>>()?;
        let masks = evaluate::pixel_sets::with_masks(Vec::new(), masks)?;
        let mut methods = if self.methods.is_empty() { Method::ALL.to_vec() } else { self.methods };
        let mut seen = Vec::new();
        methods.retain(|method| {
            !seen.contains(method) && {
                seen.push(*method);
                true
            }
        });
        let thinned = Thinned::new(asset.directions()?, self.keep, &methods)
            .with_context(|| format!("cannot thin out {}", self.asset.display()))?;
        let environments =
            self.environments.iter().map(|path| inputs::environment(path)).collect::<anyhow::Result<Vec<_>>>()?;
        Ok(Task { asset, thinned, column, masks, environments })
    }
}

fn mask(name: &str, file: &Path, size: (usize, usize)) -> anyhow::Result<PixelSet> {
    // A mask is a number, not light: no curve.
    let picture = read(file, Encoding::Linear)?;
    PixelSet::from_mask(name, &picture, size).with_context(|| format!("cannot use {}", file.display()))
}

/// Puts all files into a folder.
fn write(task: &Task, lit: &Lit, folder: &Path) -> anyhow::Result<()> {
    let (json, table) = (serde_json::to_string_pretty(&lit.report)? + "\n", report::table(&lit.report));
    put(folder, [("errors.json", json.as_bytes()), ("errors.txt", table.as_bytes())])?;
    let figures = page::Figures::new(task, lit)?;
    put(folder, figures.files())?;
    put(folder, [("index.html", page::page(&lit.report, &figures).as_bytes())])?;
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
        let given = parse(
            "reconstruction a.rfield -o d --keep 1/16 --methods linear,zero-order --mask a=b=c.png --env a.hdr --env b.hdr \
             --column 7",
        )
        .unwrap();
        assert_eq!(given.keep, Keep::Share(1.0 / 16.0));
        assert_eq!(given.methods, [Method::Linear, Method::ZeroOrder]);
        assert_eq!(given.masks, [("a".to_owned(), PathBuf::from("b=c.png"))]);
        assert_eq!((given.environments.len(), given.column), (2, Some(7)));
        assert_eq!(parse("reconstruction a.rfield -o d").unwrap().keep, Keep::Share(0.25));
    }

    #[test]
    fn wrong_usage_is_refused_by_the_parser() {
        for (options, words) in [
            ("--keep 1/0", "divided by nothing"),
            ("--keep 0", "at least 4"),
            ("--keep 3", "at least 4"),
            ("--keep 5/4", "less than one"),
            ("--keep 1/1", "less than one"),
            ("--keep 0,25", "decimal dot"),
            ("--keep -0.5", "unexpected argument"),
            ("--keep=-1/4", "not a part"),
            ("--keep half", "not a part"),
            ("--methods cubic", "possible values: zero-order, linear"),
            ("--methods linear,", "possible values"),
            ("--mask paint.png", "as in paint=paint.png"),
            ("--mask =a.png", "as in paint=paint.png"),
            ("--column -1", "unexpected argument"),
            ("--column 1.5", "invalid digit"),
        ] {
            let message = parse(&format!("reconstruction a.rfield -o d {options}")).unwrap_err().to_string();
            assert!(message.contains(words), "{options}: {message}");
        }
        assert!(parse("reconstruction a.rfield").is_err());
    }
}
