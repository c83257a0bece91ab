//! `relume jog`: moves a turntable or an arm by hand, as it were.

use std::path::PathBuf;
use std::sync::Arc;

use clap::{Args, ValueEnum};

use super::values;
use crate::devices::operator::AtTerminal;
use crate::devices::{Axes, Operator, Place, axes};
use crate::rigs::RigFile;

const EXAMPLES: &str = "\
Examples:
  relume jog stage.toml
  relume jog stage.toml --home
  relume jog stage.toml turntable --to 90
  relume jog gantry.toml arm --by -2.5

Without --to, --by or --home it says where the axes are. Moves end when the axes have truly arrived, within the limits of the rig file, and come
from the side that its backlash_deg says. --to homes first (or asks for the axes to be put at zero), --by does not.";

/// Raw flags.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    /// The rig file.
    rig: PathBuf,
    /// Which axis.
    #[arg(value_enum, default_value_t = AxisChoice::Turntable)]
    axis: AxisChoice,
    /// Go to this angle, degrees.
    #[arg(long, value_name = "DEG", allow_negative_numbers = true, value_parser = values::finite, conflicts_with = "by")]
    to: Option<f64>,
    /// Go this much further, degrees.
    #[arg(long, value_name = "DEG", allow_negative_numbers = true, value_parser = values::finite)]
    by: Option<f64>,
    /// Find zero by the limit switches first.
    #[arg(long)]
    home: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum AxisChoice {
    /// Under the object.
    Turntable,
    /// What lifts the projector.
    Arm,
}

impl Arguments {
    /// Moves, and says where the axes are then.
    ///
    /// # Errors
    /// A rig without axes that are driven; a board that does not answer; an angle outside the limits.
    pub fn run(self) -> anyhow::Result<String> {
        let rig = RigFile::read(&self.rig)?;
        let device = rig.devices.as_ref().and_then(|devices| devices.axes.as_ref());
        let Some(device) = device else { anyhow::bail!("{}: no axes in [devices]", self.rig.display()) };
        let operator: Arc<dyn Operator> = Arc::new(AtTerminal);
        let mut axes = axes::open(device, &operator)?;
        let ready = axes.preflight();
        if let Some(missing) = ready.iter().find(|finding| !finding.fine) {
            anyhow::bail!("{}", missing.text);
        }
        let moved = self.moved(&mut *axes);
        // Whatever happened, nothing goes on moving.
        let held = axes.hold();
        let place = moved?;
        held?;
        Ok(format!("{}\n", words(&place)))
    }

    fn moved(&self, axes: &mut dyn Axes) -> anyhow::Result<Place> {
        if self.home || self.to.is_some() {
            axes.home()?;
        }
        let at = axes.place()?;
        let here = if self.axis == AxisChoice::Arm { at.arm_deg } else { at.turntable_deg };
        let goal = match (self.to, self.by) {
            (Some(to), _) => Some(to),
            (None, Some(by)) => {
                let here = here.ok_or_else(|| anyhow::anyhow!("where the {} is, is not known", self.name()))?;
                Some(here + by)
            }
            (None, None) => None,
        };
        let Some(goal) = goal else { return Ok(at) };
        let to = match self.axis {
            AxisChoice::Turntable => Place { turntable_deg: Some(goal), arm_deg: None },
            AxisChoice::Arm => Place { turntable_deg: None, arm_deg: Some(goal) },
        };
        axes.go(to)?;
        Ok(axes.place()?)
    }

    fn name(&self) -> &'static str {
        if self.axis == AxisChoice::Arm { "arm" } else { "turntable" }
    }
}

/// As people say it.
pub fn words(place: &Place) -> String {
    let axes = [("turntable", place.turntable_deg), ("arm", place.arm_deg)];
    let known: Vec<String> =
        axes.iter().filter_map(|(name, deg)| deg.map(|deg| format!("{name} at {deg:.3} degrees"))).collect();
    if known.is_empty() { "where the axes are, nobody measures".to_owned() } else { known.join(", ") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_are_said_with_their_axes() {
        let place = Place { turntable_deg: Some(90.0), arm_deg: Some(-2.5) };
        assert_eq!(words(&place), "turntable at 90.000 degrees, arm at -2.500 degrees");
        assert!(words(&Place::default()).contains("nobody"));
    }
}
