//! X11: a window over the whole of an output, above all others and without a cursor, whose every picture the server confirms.
//!
//! A picture goes into a pixmap; Present puts that on the screen between two refreshes and tells when it did, under the serial
//! number it was given: an answer to an earlier picture is none. Before and after, the output is looked at: its mode and place, its
//! gamma table, and whether another window lies over it.
//!
//! | part | what it holds |
//! |---|---|
//! | `link` | the connection, whose waits end |
//! | `gamma` | the gamma table, and whether it is the identity |
//! | `outputs` | outputs and what they do to pixels |
//! | `surface` | the window, its pixels, what lies over it |
//! | `panel` | pictures, one after another |

#[cfg(target_os = "linux")]
mod gamma;
#[cfg(target_os = "linux")]
mod link;
#[cfg(target_os = "linux")]
mod outputs;
#[cfg(target_os = "linux")]
mod panel;
#[cfg(target_os = "linux")]
mod surface;
#[cfg(all(test, target_os = "linux"))]
mod tests;

use super::Panel;
use crate::devices::Trouble;
use crate::rigs::ScreenLook;

/// Opens an output.
///
/// # Errors
/// No server, no such output, no depth for so many bits; another system than Linux.
#[cfg(target_os = "linux")]
pub fn open(display: Option<&str>, look: &ScreenLook) -> Result<Box<dyn Panel>, Trouble> {
    Ok(Box::new(panel::X11Panel::open(display, look)?))
}

/// Opens an output.
///
/// # Errors
/// Always: not on this system.
#[cfg(not(target_os = "linux"))]
pub fn open(_display: Option<&str>, _look: &ScreenLook) -> Result<Box<dyn Panel>, Trouble> {
    Err(Trouble::stop(
        "the driver \"x11\" is for Linux",
        "use driver = \"window\" under [devices] screen, and measure settle_s",
    ))
}

/// An output that somebody else shows pictures on: looks after its mode and its gamma table.
#[cfg(target_os = "linux")]
pub struct Witness {
    link: link::Link,
    output: outputs::Output,
    any_gamma: bool,
}

/// Only X11 has it.
#[cfg(not(target_os = "linux"))]
pub enum Witness {}

#[cfg(target_os = "linux")]
impl Witness {
    /// Of the output with this name on the server that DISPLAY names; none where there is none.
    pub fn of(name: &str, any_gamma: bool) -> Option<Self> {
        let link = link::Link::connect(None).ok()?;
        let output = outputs::Output::all(&link).ok()?.into_iter().find(|output| output.name == name)?;
        Some(Self { link, output, any_gamma })
    }

    /// The output is as it was, and shows codes of 8 bits as they are.
    ///
    /// # Errors
    /// Another mode or place, a gamma table that is not the identity; a lost connection.
    pub fn check(&self) -> Result<(), Trouble> {
        self.output.again(&self.link)?.check(255, self.any_gamma)
    }

    /// The output, for lists.
    pub fn words(&self) -> String {
        self.output.words(255)
    }
}

#[cfg(not(target_os = "linux"))]
impl Witness {
    /// None.
    pub fn of(_name: &str, _any_gamma: bool) -> Option<Self> {
        None
    }

    /// Never asked.
    ///
    /// # Errors
    /// None.
    pub fn check(&self) -> Result<(), Trouble> {
        match *self {}
    }

    /// Never asked.
    pub fn words(&self) -> String {
        match *self {}
    }
}

/// A line for each output of the server that DISPLAY names; none where there is no such variable.
#[cfg(target_os = "linux")]
pub fn list() -> Option<Vec<String>> {
    std::env::var_os("DISPLAY").filter(|name| !name.is_empty())?;
    let lines = || -> Result<Vec<String>, Trouble> {
        let link = link::Link::connect(None)?;
        let depth = link.screen().root_depth;
        let deep = if depth >= 30 { "codes of 10 bits" } else { "codes of 8 bits" };
        let line = |output: &outputs::Output| format!("{}, depth {depth} ({deep})", output.words(255));
        Ok(outputs::Output::all(&link)?.iter().map(line).collect())
    };
    Some(lines().unwrap_or_else(|trouble| vec![trouble.to_string()]))
}

/// None.
#[cfg(not(target_os = "linux"))]
pub fn list() -> Option<Vec<String>> {
    None
}
