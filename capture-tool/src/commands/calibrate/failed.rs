//! `relume calibrate failed`: which lamps of an asset were dark or hidden.

use std::fmt::Write;
use std::path::PathBuf;

use clap::Args;
use relume_core::calibrate::failed::{Failed, LampCheck, check_lamps};
use relume_core::field::{Access, Asset};

use crate::progress::{Progress, Unit};

const EXAMPLES: &str = "\
Examples:
  relume calibrate failed vase.rfield
  relume calibrate failed vase.rfield --json
  relume import lp photographs/dirs.lp -o vase.rfield --exclude 37,52";

/// Raw flags.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    /// The .rfield file.
    asset: PathBuf,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

impl Arguments {
    /// Looks at every lamp.
    pub fn run(self) -> anyhow::Result<String> {
        let asset = Asset::open(&self.asset, Access::Read)?;
        let mut progress = Progress::new("looking at lamps", Unit::Steps);
        let check = check_lamps(&asset, &mut |done, all| progress.step(done, all))?;
        drop(progress);
        if self.json {
            return Ok(serde_json::to_string_pretty(&check)? + "\n");
        }
        Ok(report(&check, &Names::of(&asset))?)
    }
}

fn report(check: &LampCheck, names: &Names) -> Result<String, std::fmt::Error> {
    let mut out = format!(
        "{} lamps; an ordinary one is within {:.1} % of what its neighbours predict\n",
        check.lamps,
        100.0 * check.spread
    );
    if check.failed.is_empty() {
        out += "none failed\n";
        return Ok(out);
    }
    for failed in &check.failed {
        let Failed { lamp, direction: [x, y, z], off, deviations } = failed;
        let how = if *off < 0.0 { "darker" } else { "brighter" };
        let photograph = names.photograph(*lamp).map(|name| format!(", {name}")).unwrap_or_default();
        writeln!(
            out,
            "lamp {lamp} ({x:.3}, {y:.3}, {z:.3}){photograph}: {:.0} % {how} than predicted, {:.0} deviations",
            100.0 * off.abs(),
            deviations.abs()
        )?;
    }
    let mut numbers: Vec<usize> =
        check.failed.iter().map(|failed| names.listed(failed.lamp)).chain(names.excluded.iter().copied()).collect();
    numbers.sort_unstable();
    let numbers: Vec<String> = numbers.iter().map(usize::to_string).collect();
    writeln!(out, "to leave them out: relume import lp ... --exclude {}", numbers.join(","))?;
    Ok(out)
}

/// What the provenance says of the photographs.
#[derive(Debug, Default)]
struct Names {
    photographs: Vec<String>,
    /// Numbers in the `.lp` file that the import left out, ascending.
    excluded: Vec<usize>,
}

impl Names {
    fn of(asset: &Asset) -> Self {
        let provenance = &asset.manifest().provenance;
        let list = |name: &str| provenance[name].as_array().into_iter().flatten();
        Self {
            photographs: list("photographs").filter_map(|name| Some(name.as_str()?.to_owned())).collect(),
            excluded: list("excluded").filter_map(|n| usize::try_from(n.as_u64()?).ok()).collect(),
        }
    }

    fn photograph(&self, lamp: usize) -> Option<&str> {
        self.photographs.get(lamp - 1).map(String::as_str)
    }

    /// The number in the `.lp` file of a lamp of the asset: those left out before it count.
    fn listed(&self, lamp: usize) -> usize {
        self.excluded.iter().fold(lamp, |number, left_out| number + usize::from(*left_out <= number))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_of_the_asset_become_numbers_of_the_list() {
        let names = Names { photographs: Vec::new(), excluded: vec![1, 3, 4] };
        // The list has 1 to 7; 2, 5, 6, 7 are lamps 1 to 4.
        assert_eq!([1, 2, 3, 4].map(|lamp| names.listed(lamp)), [2, 5, 6, 7]);
    }

    #[test]
    fn the_report_names_lamp_file_and_advice() {
        let failed = Failed { lamp: 2, direction: [0.0, 0.6, 0.8], off: -0.5, deviations: -21.0 };
        let check = LampCheck { lamps: 30, spread: 0.02, failed: vec![failed] };
        let names = Names { photographs: vec!["a.jpg".into(), "b.jpg".into()], excluded: vec![2] };
        let text = report(&check, &names).unwrap();
        for words in ["lamp 2 (0.000, 0.600, 0.800), b.jpg: 50 % darker", "21 deviations", "--exclude 2,3"] {
            assert!(text.contains(words), "{text}");
        }
        assert!(report(&LampCheck { failed: vec![], ..check }, &names).unwrap().contains("none failed"));
    }
}
