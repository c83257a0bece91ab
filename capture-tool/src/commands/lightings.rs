//! `relume lightings`: the lightings that ship, far ones and light fields, as a list or as files to start from.

use std::fmt::Write;

use clap::Args;
use clap::builder::PossibleValuesParser;
use relume_core::settings::light4d;
use relume_core::settings::lighting::{PRESETS, preset};

const EXAMPLES: &str = "\
Examples:
  relume lightings
  relume lightings three-point
  relume lightings venetian-blinds

A lighting file is a list of lamps:

  [[light]]
  kind = \"softbox\"     # directional | disc | softbox | ring | dome
  azimuth = 45         # degrees: 0 from the camera, positive to the right of the picture
  elevation = 35       # degrees above the horizon
  width = 1            # softbox: any unit of length, the same for all three
  height = 1
  distance = 2
  kelvin = 5600        # or rgb = [1, 0.5, 0.2], linear Rec.709; white if neither
  stops = 0            # 0: a white diffuser facing the lamp becomes 1, whatever the lamp's size

A disc has a `radius`, a ring `inner` and `outer`, all in degrees; a softbox can have a `turn` in
its plane. A dome has no azimuth and elevation but `horizon_kelvin` or `horizon_rgb`, `horizon_stops`
(horizon against zenith) and `ground` (albedo of the ground); its stops count from one that gives a
white diffuser facing the zenith the value 1.

A light file of --light4d has these kinds too, and spots, points, areas, slides, suns, maps and grids of
probes at places of their own, behind blinds if you like: print one of the light fields to start from.";

/// Raw flags.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    /// Print this lighting's file, to save and change; without it all are listed.
    #[arg(value_name = "NAME", hide_possible_values = true,
          value_parser = PossibleValuesParser::new(names()))]
    name: Option<String>,
}

impl Arguments {
    /// Lists or prints.
    pub fn run(self) -> anyhow::Result<String> {
        if let Some(preset) = self.name.as_deref().and_then(preset) {
            return Ok(preset.text.to_owned());
        }
        if let Some(preset) = self.name.as_deref().and_then(light4d::preset) {
            return Ok(preset.text.to_owned());
        }
        let mut text = String::from("For relight --lighting NAME; `relume lightings NAME` prints the file.\n\n");
        for preset in PRESETS {
            writeln!(text, "  {:16} {}", preset.id, preset.load()?.about)?;
        }
        text += "\nFor relight --light4d NAME, of fields that a projector made:\n\n";
        for preset in light4d::PRESETS {
            writeln!(text, "  {:16} {}", preset.id, preset.load()?.about)?;
        }
        Ok(text)
    }
}

fn names() -> impl Iterator<Item = &'static str> {
    PRESETS.iter().map(|preset| preset.id).chain(light4d::PRESETS.iter().map(|preset| preset.id))
}
