//! `relume merge`: parts of a field that several machines have solved -> the field.

use std::path::PathBuf;

use clap::Args;
use relume_core::field::{self, Access, Asset};
use relume_core::files::check_folder;

use super::info::Info;
use crate::progress::{Progress, Unit};

const EXAMPLES: &str = "\
Examples:
  relume pack glass -o glass.rfield --tiles 1-32
  relume pack glass -o glass.rfield --tiles 33-60
  relume merge glass.rfield.part-1-32 glass.rfield.part-33-60 -o glass.rfield

Every part is a field of its own, black where other parts have their tiles: `relume verify`, `relume info` and `relume relight`
take it as it is. The parts stay.";

/// Raw flags.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    /// The parts, in any order: together all tiles, each once.
    #[arg(required = true, value_name = "PART")]
    parts: Vec<PathBuf>,
    /// The .rfield file to write.
    #[arg(short, long, value_name = "A.rfield")]
    output: PathBuf,
}

impl Arguments {
    /// Merges.
    ///
    /// # Errors
    /// Parts of different fields, tiles that are missing or there twice, no room.
    pub fn run(self) -> anyhow::Result<String> {
        check_folder(&self.output)?;
        if let Some(part) =
            self.parts.iter().find(|part| part.canonicalize().ok() == self.output.canonicalize().ok() && part.exists())
        {
            anyhow::bail!("{}: the output is one of the parts", part.display());
        }
        let open = |path: &PathBuf| Asset::open(path, Access::Read);
        let parts: Vec<Asset> = self.parts.iter().map(open).collect::<Result<_, _>>()?;
        let mut progress = Progress::new("merging", Unit::Steps);
        field::merge(&parts, &self.output, &mut |done, all| progress.step(done, all))?;
        drop(progress);
        Ok(format!("{}\n", Info::of(&Asset::open(&self.output, Access::Read)?).summary()))
    }
}
