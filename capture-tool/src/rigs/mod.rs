//! Rigs: what emits light conditions.
//!
//! | part | what it holds |
//! |---|---|
//! | [`Condition`] | what can be asked for |
//! | [`RigFile`] | a rig as a file says it: `presets/rigs/*.toml`; `check` reads and refuses |
//! | [`Lamps`] | where the lamps of a stage stand, and at which stop of the turntable each is lit |
//! | `Devices` | which real devices a rig has: the `[devices]` table |
//! | [`Shown`] | what a screen shows under a condition |
//! | [`Rig`] | the trait that devices, real or virtual, are driven through |
//! | [`real`] | real axes, lamps and screens, in the one order that is safe |
//! | [`virtual_stage`] | a stage whose light is computed |
//! | [`virtual_emitter`] | the same of a screen or a projector |
//! | `cache` | where computed scenes are kept |

mod cache;
mod check;
mod check_devices;
mod condition;
mod devices;
mod file;
mod lamps;
pub mod real;
mod shown;
pub mod virtual_emitter;
pub mod virtual_stage;

pub use condition::Condition;
pub use devices::{AxesDevice, Axis, CameraDevice, Counts, LampsDevice, ScreenDevice, ScreenLook, Wiring};
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

    /// Is what was emitted still there, now that it has been exposed? A board that restarted meanwhile, a table that was pushed or a window
    /// before the screen spoil a photograph, which is then not kept.
    ///
    /// # Errors
    /// As [`Rig::emit`].
    fn confirm(&mut self) -> Result<(), Trouble> {
        Ok(())
    }

    /// Lamps off or screen black, motors held. Called at the end, however it comes about.
    ///
    /// # Errors
    /// The operator must switch off by hand.
    fn dark(&mut self) -> Result<(), Trouble>;
}
