//! Turntable and arm.
//!
//! | part | what it holds |
//! |---|---|
//! | [`grbl`] | a board with GRBL on a serial port |
//! | [`hand`] | the operator, who is asked to turn |

use std::sync::Arc;

use super::{Finding, Operator, Trouble};
use crate::rigs::AxesDevice;

pub mod grbl;
pub mod hand;

/// Where the axes are, or are to go; `None` for an axis that the rig does not have, or that stays.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Place {
    /// Right-handed about the axis of the table: the azimuth of the light from +z towards +x, as the object sees it.
    pub turntable_deg: Option<f64>,
    /// Above the horizon.
    pub arm_deg: Option<f64>,
}

/// Motors. Calls block; while they wait they look at [`crate::progress::check_urgent`].
pub trait Axes {
    /// Is the board there, and does it know where it is? Moves nothing.
    fn preflight(&mut self) -> Vec<Finding>;

    /// Makes positions known: by the limit switches, or by asking the operator to put the axes at zero. Done once a run.
    ///
    /// # Errors
    /// [`Trouble::Busy`] when the same call may succeed soon; anything else ends the capture.
    fn home(&mut self) -> Result<(), Trouble>;

    /// Moves, and returns when the axes have truly arrived and nothing trembles. A place where they are already costs a look.
    ///
    /// # Errors
    /// As [`Axes::home`]; a place outside the limits.
    fn go(&mut self, to: Place) -> Result<(), Trouble>;

    /// Have they stayed where [`Axes::go`] brought them, the board never restarted since?
    ///
    /// # Errors
    /// As [`Axes::home`]; that they have not.
    fn confirm(&mut self) -> Result<(), Trouble> {
        Ok(())
    }

    /// Moves by so much from wherever they stand, positions known or not: how an operator puts an axis at its zero. Returns when the
    /// axes have arrived.
    ///
    /// # Errors
    /// As [`Axes::home`]; axes without motors.
    fn nudge(&mut self, by: Place) -> Result<(), Trouble> {
        let _ = by;
        Err(Trouble::stop("these axes have no motors", "move them by hand"))
    }

    /// Where they are.
    ///
    /// # Errors
    /// As [`Axes::home`]; positions that are not known yet.
    fn place(&mut self) -> Result<Place, Trouble>;

    /// Stops where they are; motors stay energised.
    ///
    /// # Errors
    /// The operator must switch off by hand.
    fn hold(&mut self) -> Result<(), Trouble>;
}

/// Opens the axes of a rig file.
///
/// # Errors
/// No such port; a board that does not answer.
pub fn open(device: &AxesDevice, operator: &Arc<dyn Operator>) -> Result<Box<dyn Axes>, Trouble> {
    Ok(match device {
        AxesDevice::Grbl { .. } => Box::new(grbl::Grbl::open(device, operator)?),
        AxesDevice::Hand => Box::new(hand::Hand::new(operator)),
    })
}
