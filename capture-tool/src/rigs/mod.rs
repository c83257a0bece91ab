//! Rigs: what emits light conditions.
//!
//! | part | what it holds |
//! |---|---|
//! | [`Condition`] | what can be asked for |
//! | [`RigFile`] | a rig as a file says it: `presets/rigs/*.toml`; `check` reads and refuses |
//! | [`Lamps`] | where the lamps of a stage stand, and at which stop of the turntable each is lit |
//! | [`Devices`] | which real devices a rig has: the `[devices]` table |
//! | [`Shown`] | what a screen shows under a condition |
//! | [`Rig`] | the trait that devices, real or virtual, are driven through |
//! | [`real`] | real axes, lamps and screens, in the one order that is safe |
//! | [`virtual_stage`] | a stage whose light is computed |
//! | [`virtual_emitter`] | the same of a screen or a projector |
//! | `cache` | where computed scenes are kept |

mod cache;
mod check;
mod condition;
mod devices;
mod file;
mod lamps;
pub mod real;
mod shown;
pub mod virtual_emitter;
pub mod virtual_stage;

pub use condition::Condition;
pub use devices::{AxesDevice, Axis, CameraDevice, Counts, Devices, LampsDevice, ScreenDevice, ScreenLook, Wiring};
pub use file::{
    CameraRig, GantryRig, Kind, MonitorRig, PartsChoice, ResponseChoice, RigFile, SceneChoice, SensorResponseChoice,
    StageRig,
};
pub use lamps::Lamps;
pub use shown::Shown;

use crate::capture::Step;
use crate::devices::{Finding, Trouble};

/// What emits light. Calls block; while they wait they look at [`crate::progress::check`].
pub trait Rig {
    /// Is everything there and ready? Moves nothing, lights nothing.
    fn preflight(&mut self) -> Vec<Finding>;

    /// Emits the condition of a step: motion complete, settled, lamp or pattern confirmed. Only then returns, so that a
    /// photograph never shows the condition before.
    ///
    /// # Errors
    /// [`Trouble::Busy`] when the same call may succeed soon; anything else ends the capture.
    fn emit(&mut self, step: &Step) -> Result<(), Trouble>;

    /// Did what was emitted stay as it was? Asked when the exposures of a step are over, before its photograph counts.
    ///
    /// # Errors
    /// What came between: the photograph is not kept.
    fn stayed(&mut self) -> Result<(), Trouble> {
        Ok(())
    }

    /// Lamps off or screen black, motors held. Called at the end, however it comes about.
    ///
    /// # Errors
    /// The operator must switch off by hand.
    fn dark(&mut self) -> Result<(), Trouble>;
}
