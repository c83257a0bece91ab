//! Cameras.
//!
//! | part | what it holds |
//! |---|---|
//! | [`delivery`] | what all cameras' files have in common |
//! | [`gphoto`] | cameras over USB, through libgphoto2 |
//! | [`folder`] | any software that puts photographs into a folder |
//! | [`virtual_camera`] | one that photographs a virtual rig |

mod delivery;
pub mod folder;
pub mod gphoto;
pub mod virtual_camera;

use std::path::Path;
use std::sync::Arc;

use super::{Camera, Operator, Trouble};
use crate::rigs::CameraDevice;

/// Opens the camera of a rig file. Of [`CameraDevice::Virtual`] the caller makes its own.
///
/// # Errors
/// No such camera, no library to drive it, a folder that is not there.
pub fn open(device: &CameraDevice, session: &Path, operator: &Arc<dyn Operator>) -> Result<Box<dyn Camera>, Trouble> {
    match device {
        CameraDevice::Gphoto2 { model, port, format, counts, keep_on_card } => {
            let options = gphoto::Options {
                model: model.clone(),
                port: port.clone(),
                format: format.clone(),
                counts: *counts,
                keep_on_card: *keep_on_card,
            };
            Ok(Box::new(gphoto::open(&options)?))
        }
        CameraDevice::Folder { path, trigger, counts, within_s, poll_s } => {
            let options = folder::Options {
                path: path.clone(),
                trigger: trigger.clone(),
                counts: *counts,
                within_s: *within_s,
                poll_s: *poll_s,
            };
            Ok(Box::new(folder::FolderCamera::open(options, session, operator.clone())?))
        }
        CameraDevice::Virtual => {
            Err(Trouble::stop("a virtual camera photographs what a virtual rig shows", "this is a mistake in relume"))
        }
    }
}

/// What `relume devices` says of cameras, a line each.
pub fn list() -> Vec<String> {
    gphoto::list()
}
