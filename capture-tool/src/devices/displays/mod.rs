//! Screens and projectors.
//!
//! Codes of texels -> [`layout`]: which pixels of the output each texel is -> [`packing`]: the server's bytes -> a driver, which puts them on
//! the whole of an output and waits until they are seen.
//!
//! | driver | confirmation | gamma table | bits |
//! |---|---|---|---|
//! | [`x11`] | the Present extension tells when a picture is on the screen | read before and after each picture | 8, or 10 at depth 30 |
//! | [`window`] | none: `settle_s` alone | as above under X11, else not read | 8 |
//!
//! [`charts`] are for setting up: a grid, and what to focus on.

pub mod charts;
mod layout;
mod packing;
mod window;
mod x11;

use std::time::Duration;

pub use layout::Layout;
pub use packing::PixelFormat;

use super::{Finding, Trouble};
use crate::rigs::{ScreenDevice, ScreenLook};

/// Nothing is waited for longer than this without a look at requests to stop.
const GLANCE: Duration = Duration::from_millis(50);

/// A picture as the screen is given it: codes of texels, row 0 at the top, RGB.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Texels {
    /// Texels along a row.
    pub columns: usize,
    /// Rows.
    pub rows: usize,
    /// The code of white: 255, or 1023.
    pub white: u16,
    /// `columns * rows` of them.
    pub codes: Vec<[u16; 3]>,
}

impl Texels {
    /// One colour all over.
    pub fn plain((columns, rows): (usize, usize), white: u16, colour: [u16; 3]) -> Self {
        Self { columns, rows, white, codes: vec![colour; columns * rows] }
    }
}

/// A screen. Calls block; while they wait they look at [`crate::progress::check_urgent`].
pub trait Display {
    /// Is the output there, of the right size and depth, its gamma table the identity? Shows nothing.
    fn preflight(&mut self) -> Vec<Finding>;

    /// Shows the texels, in the middle of the output, black about them; returns when the picture is confirmed (where the system does) and
    /// the panel has settled.
    ///
    /// # Errors
    /// [`Trouble::Busy`] when the same call may succeed soon; anything else ends the capture.
    fn show(&mut self, texels: &Texels) -> Result<(), Trouble>;

    /// Is the last picture still there, nothing before it, the gamma table as it was?
    ///
    /// # Errors
    /// As [`Display::show`]; that it is not.
    fn confirm(&mut self) -> Result<(), Trouble> {
        Ok(())
    }

    /// All black.
    ///
    /// # Errors
    /// As [`Display::show`].
    fn dark(&mut self) -> Result<(), Trouble>;
}

/// An output, all its pixels.
pub trait Panel {
    /// As in "output HDMI-1".
    fn name(&self) -> String;

    /// Columns and rows.
    fn size(&self) -> (usize, usize);

    /// Is it as it has to be? Shows nothing.
    fn preflight(&mut self) -> Vec<Finding>;

    /// Is it still as it was when it was opened?
    ///
    /// # Errors
    /// As [`Display::show`]: another mode, another gamma table, unplugged, asleep.
    fn check(&mut self) -> Result<(), Trouble>;

    /// Puts a picture on it and waits until it is seen, as far as the system tells; does not wait for the panel to settle.
    ///
    /// # Errors
    /// As [`Display::show`].
    fn put(&mut self, texels: &Texels, layout: &Layout) -> Result<(), Trouble>;

    /// Waits, and does meanwhile what the system wants of who has a window.
    ///
    /// # Errors
    /// As [`Display::show`]; a window that was closed.
    fn rest(&mut self, time: Duration) -> Result<(), Trouble>;

    /// Is what was put what is seen? Asked once the panel has settled.
    ///
    /// # Errors
    /// As [`Panel::check`]; a window in front of it.
    fn still(&mut self) -> Result<(), Trouble>;

    /// From the first picture on, keys come here: Escape and Enter close it. To be asked for before it.
    ///
    /// # Errors
    /// As [`Display::show`].
    fn take_keys(&mut self) -> Result<(), Trouble>;

    /// Did somebody close it?
    fn is_closed(&self) -> bool;
}

/// Texels on an output.
struct OnPanel {
    panel: Box<dyn Panel>,
    layout: Layout,
    settle: Duration,
    /// Something was shown: there is something to put out.
    lit: bool,
}

impl OnPanel {
    fn new(panel: Box<dyn Panel>, look: &ScreenLook, texels: (usize, usize)) -> Result<Self, Trouble> {
        let layout = Layout::new(&panel.name(), texels, panel.size(), look.texel_px)?;
        Ok(Self { panel, layout, settle: Duration::from_secs_f64(look.settle_s), lit: false })
    }
}

impl Display for OnPanel {
    fn preflight(&mut self) -> Vec<Finding> {
        let Layout { texels: (columns, rows), texel_px, corner, .. } = self.layout;
        let mut findings = self.panel.preflight();
        findings.push(Finding::fine(format!(
            "screen: {columns} x {rows} texels of {texel_px} x {texel_px} pixels from ({}, {}) on",
            corner.0, corner.1
        )));
        findings
    }

    fn show(&mut self, texels: &Texels) -> Result<(), Trouble> {
        if (texels.columns, texels.rows) != self.layout.texels {
            let what = format!("{} x {} texels for a screen of {:?}", texels.columns, texels.rows, self.layout.texels);
            return Err(Trouble::stop(what, "this is a mistake in relume"));
        }
        self.lit = true;
        self.panel.check()?;
        self.panel.put(texels, &self.layout)?;
        self.panel.rest(self.settle)?;
        self.panel.still()
    }

    /// What came between is gone for good with the exposure: asked again, it would not be seen.
    fn confirm(&mut self) -> Result<(), Trouble> {
        match self.panel.still() {
            Err(Trouble::Busy(what)) => Err(Trouble::stop(what, "keep it from happening, and go on")),
            other => other,
        }
    }

    fn dark(&mut self) -> Result<(), Trouble> {
        if !self.lit {
            return Ok(());
        }
        self.panel.put(&Texels::plain(self.layout.texels, 1, [0; 3]), &self.layout)
    }
}

/// Opens the screen of a rig file for pictures of so many texels.
///
/// # Errors
/// No such output, one that is too small, no depth 30 for 10 bits.
pub fn open(device: &ScreenDevice, texels: (usize, usize)) -> Result<Box<dyn Display>, Trouble> {
    Ok(Box::new(OnPanel::new(panel(device)?, device.look(), texels)?))
}

/// Opens the output of a rig file.
///
/// # Errors
/// As [`open()`].
pub fn panel(device: &ScreenDevice) -> Result<Box<dyn Panel>, Trouble> {
    match device {
        ScreenDevice::X11 { display, look } => x11::open(display.as_deref(), look),
        ScreenDevice::Window { look } => window::open(look),
    }
}

/// What `relume devices` says of outputs, a line each.
pub fn list() -> Vec<String> {
    match x11::list() {
        Some(lines) => lines,
        None => window::list(),
    }
}

/// Does the driver `x11` do here? Else `window` is the one to take.
pub fn is_x11() -> bool {
    let there = |name: &str| std::env::var_os(name).is_some_and(|value| !value.is_empty());
    cfg!(target_os = "linux") && there("DISPLAY") && !there("WAYLAND_DISPLAY")
}

/// What pictures end with that somebody closed.
fn closed() -> Trouble {
    Trouble::stop("the window with the patterns was closed", "leave it open, and go on")
}

/// Of outputs by their names the one that a rig file means: the name itself, else the only one with it as a part; without a word the
/// only one there is.
///
/// # Errors
/// None, or several: with their names.
fn choose(names: &[String], wanted: Option<&str>, place: &str) -> Result<usize, Trouble> {
    let quoted = |names: &[&String]| names.iter().map(|name| format!("\"{name}\"")).collect::<Vec<_>>().join(", ");
    let all = || quoted(&names.iter().collect::<Vec<_>>());
    if names.is_empty() {
        return Err(Trouble::stop(format!("{place} has no output that is lit"), "connect the screen and switch it on"));
    }
    let Some(wanted) = wanted else {
        return match names {
            [_] => Ok(0),
            _ => Err(Trouble::stop(
                format!("{place} has {} outputs: {}", names.len(), all()),
                "say which one shows the patterns (output under [devices] screen, or --output)",
            )),
        };
    };
    if let Some(same) = names.iter().position(|name| name == wanted) {
        return Ok(same);
    }
    let like = |name: &String| name.to_lowercase().contains(&wanted.to_lowercase());
    let found: Vec<usize> = (0..names.len()).filter(|n| like(&names[*n])).collect();
    match found[..] {
        [one] => Ok(one),
        [] => Err(Trouble::stop(
            format!("{place} has no output called \"{wanted}\" that is lit; there is {}", all()),
            "name one of these; if the screen is missing, connect it and switch it on",
        )),
        _ => Err(Trouble::stop(
            format!(
                "several outputs are called like \"{wanted}\": {}",
                quoted(&found.iter().map(|n| &names[*n]).collect::<Vec<_>>())
            ),
            "give more of the name",
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn outputs_are_chosen_by_a_part_of_their_name() {
        let names = ["DP-1", "HDMI-1", "DP-10"].map(str::to_owned);
        let chosen = |wanted| choose(&names, wanted, "the server");
        assert_eq!(chosen(Some("DP-1")).unwrap(), 0, "the name itself, though it is a part of another");
        assert_eq!(chosen(Some("hdmi")).unwrap(), 1);
        for (wanted, words) in [(None, "3 outputs"), (Some("DP"), "several"), (Some("VGA"), "no output called \"VGA\"")]
        {
            let said = chosen(wanted).unwrap_err().to_string();
            assert!(said.contains(words) && said.contains("\"HDMI-1\"") == (wanted != Some("DP")), "{said}");
        }
        assert_eq!(choose(&names[1..2], None, "the server").unwrap(), 0);
        assert!(choose(&[], None, "the server").unwrap_err().to_string().contains("no output"));
    }
}
