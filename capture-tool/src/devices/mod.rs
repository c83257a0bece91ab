//! Devices: cameras, and what can go wrong with any device.
//!
//! | part | what it holds |
//! |---|---|
//! | [`Trouble`], [`Finding`] | what a device answers when it does not do what it was asked; what was looked at before the start |
//! | [`Camera`], [`cameras`] | libgphoto2, a watched folder, a virtual one |
//! | [`Axes`], [`axes`] | turntable and arm: GRBL, or the operator's hand |
//! | [`Lights`], [`lights`] | lamps: lines of text, ENTTEC DMX USB Pro, Art-Net, sACN |
//! | [`Display`], [`displays`] | a screen or projector: X11 with confirmation, or a full-screen window |
//! | [`Operator`], [`operator`] | who puts the ball in place when asked to |
//! | [`port`] | serial ports |
//! | [`rehearsal`] | bad days on purpose |

use std::fmt;
use std::path::{Path, PathBuf};

use relume_core::Error;
use relume_core::image::Image;

use crate::session::Exposure;

pub mod axes;
pub mod cameras;
pub mod displays;
pub mod lights;
pub mod operator;
pub mod port;
pub mod rehearsal;

pub use axes::{Axes, Place};
pub use displays::{Display, Texels};
pub use lights::Lights;
pub use operator::Operator;

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

impl Trouble {
    /// A person has to do something.
    pub fn stop(what: impl Into<String>, advice: impl Into<String>) -> Self {
        Self::Stop { what: what.into(), advice: advice.into() }
    }
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
    /// The exposure as the file itself says, where it does: it is believed before what the camera was asked for.
    pub exposure: Option<Exposure>,
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

    /// The settings as they are now: somebody may have touched a dial since. `None` where the camera cannot say before its file
    /// does.
    ///
    /// # Errors
    /// As [`Camera::set`].
    fn setting(&mut self) -> Result<Option<Exposure>, Trouble>;

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
