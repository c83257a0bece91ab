//! `relume jog`: moves a turntable or an arm by hand, as it were.

use std::path::PathBuf;
use std::sync::Arc;

use clap::{Args, ValueEnum};

use super::values;
use crate::devices::operator::AtTerminal;
use crate::devices::{Axes, Operator, Place, Trouble, axes};
use crate::progress::{DevicesOn, SwitchingOff};
use crate::rigs::RigFile;

const EXAMPLES: &str = "\
Examples:
  relume jog stage.toml
  relume jog stage.toml --home
  relume jog stage.toml turntable --to 90
  relume jog gantry.toml arm --by -2.5

Without --to, --by or --home it says where the axes are. Moves end when the axes have truly arrived, within the limits of the rig file, and come
from the side that its backlash_deg says. --to homes first (or asks for the axes to be put at zero); --by moves from wherever they stand,
which is how they are put at zero.";

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
        let _on = DevicesOn::begin();
        let moved = self.moved(&mut *axes);
        // Whatever happened, nothing goes on moving.
        let unhurried = SwitchingOff::begin();
        let held = axes.hold();
        drop(unhurried);
        moved?;
        let place = axes.place();
        held?;
        Ok(match (place, self.by) {
            (Ok(place), _) => format!("{}\n", words(&place)),
            // Whoever puts an axis at its zero does so before anybody knows where that is.
            (Err(_), Some(by)) => format!("{} moved by {by} degrees\n", self.name()),
            (Err(trouble), None) => return Err(trouble.into()),
        })
    }

    fn moved(&self, axes: &mut dyn Axes) -> Result<(), Trouble> {
        if self.home || self.to.is_some() {
            axes.home()?;
        }
        match (self.to, self.by) {
            (Some(to), _) => axes.go(self.place(to)),
            (None, Some(by)) => axes.nudge(self.place(by)),
            (None, None) => Ok(()),
        }
    }

    fn place(&self, deg: f64) -> Place {
        match self.axis {
            AxisChoice::Turntable => Place { turntable_deg: Some(deg), arm_deg: None },
            AxisChoice::Arm => Place { turntable_deg: None, arm_deg: Some(deg) },
        }
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
