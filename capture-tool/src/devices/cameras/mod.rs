//! Cameras.
//!
//! | part | what it holds |
//! |---|---|
//! | [`virtual_camera`] | one that photographs a virtual rig |

pub mod virtual_camera;

use std::path::Path;
use std::sync::Arc;

use super::{Camera, Operator, Trouble};
use crate::rigs::CameraDevice;

/// Opens the camera of a rig file. Of [`CameraDevice::Virtual`] the caller makes its own.
///
/// # Errors
/// No such camera, no library to drive it, a folder that is not there.
pub fn open(device: &CameraDevice, _session: &Path, _operator: &Arc<dyn Operator>) -> Result<Box<dyn Camera>, Trouble> {
    Err(Trouble::stop(format!("{device:?}"), "not driven yet"))
}

/// What `relume devices` says of cameras, a line each.
pub fn list() -> Vec<String> {
    Vec::new()
}
