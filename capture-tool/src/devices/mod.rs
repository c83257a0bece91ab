//! Devices: cameras, and what can go wrong with any device.
//!
//! | part | what it holds |
//! |---|---|
//! | [`Camera`] | the trait that cameras, real or virtual, are driven through |
//! | [`Trouble`] | what a device answers when it does not do what it was asked |
//! | [`virtual_camera`] | a camera that photographs a virtual rig |
//! | [`rehearsal`] | bad days on purpose |

use std::fmt;
use std::path::{Path, PathBuf};

use relume_core::Error;
use relume_core::image::Image;

use crate::session::Exposure;

pub mod rehearsal;
pub mod virtual_camera;

/// Why a device did not do what it was asked.
#[derive(Debug)]
pub enum Trouble {
    /// Goes away by itself: asked again, with growing pauses.
    Busy(String),
    /// A person has to do something: what happened, and what to do. Whole clauses without a full stop.
    Stop {
        /// As in "the camera does not answer".
        what: String,
        /// As in "check its cable and its battery".
        advice: String,
    },
    /// The disk, or a request to stop.
    Failed(Error),
}

impl From<Error> for Trouble {
    fn from(error: Error) -> Self {
        Self::Failed(error)
    }
}

impl fmt::Display for Trouble {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Trouble::Busy(what) => write!(f, "{what}"),
            Trouble::Stop { what, advice } => write!(f, "{what}; {advice}"),
            Trouble::Failed(error) => write!(f, "{error}"),
        }
    }
}

impl std::error::Error for Trouble {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        if let Trouble::Failed(error) = self { error.source() } else { None }
    }
}

/// Something that was looked at before the start.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Finding {
    /// Can the capture start with it?
    pub fine: bool,
    /// As in "camera: virtual, 640 x 480".
    pub text: String,
}

impl Finding {
    /// All is well.
    pub fn fine(text: impl Into<String>) -> Self {
        Self { fine: true, text: text.into() }
    }

    /// The capture cannot start.
    pub fn missing(text: impl Into<String>) -> Self {
        Self { fine: false, text: text.into() }
    }
}

/// What a camera delivered.
#[derive(Debug)]
pub struct Delivered {
    /// The files, in the folder they were asked into; the first one is the picture that counts.
    pub files: Vec<PathBuf>,
    /// A small picture of codes (0 to 1) for the contact sheet and the check of the exposure, where it is cheap to give; else
    /// the file is decoded.
    pub thumbnail: Option<Image>,
}

/// A camera. Calls block; while they wait they look at [`crate::progress::check`].
pub trait Camera {
    /// Is it there, unclaimed, in manual mode, with room and power?
    fn preflight(&mut self) -> Vec<Finding>;

    /// Changes the settings and reads them back: cameras round, and some say yes and do something else.
    ///
    /// # Errors
    /// [`Trouble::Busy`] when the same call may succeed soon; anything else ends the capture.
    fn set(&mut self, wanted: &Exposure) -> Result<Exposure, Trouble>;

    /// Opens the shutter; returns when it has closed.
    ///
    /// # Errors
    /// As [`Camera::set`].
    fn expose(&mut self) -> Result<(), Trouble>;

    /// Fetches what was exposed into `folder`, under `stem` and the camera's own extensions, and deletes it from the camera.
    ///
    /// # Errors
    /// As [`Camera::set`].
    fn download(&mut self, folder: &Path, stem: &str) -> Result<Delivered, Trouble>;
}
