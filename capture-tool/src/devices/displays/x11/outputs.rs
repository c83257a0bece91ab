//! Outputs of an X server that are lit: where they are, and what they do to pixels.

use x11rb::protocol::randr::{Connection, ConnectionExt as _, GetScreenResourcesCurrentReply, ModeFlag, Rotation};
use x11rb::protocol::render::Transform;

use super::gamma::Gamma;
use super::link::Link;
use crate::devices::Trouble;

/// A rectangle of the screen, pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Place {
    /// Left.
    pub x: i16,
    /// Top.
    pub y: i16,
    /// Columns.
    pub width: u16,
    /// Rows.
    pub height: u16,
}

/// An output.
#[derive(Debug, Clone, PartialEq)]
pub struct Output {
    /// As in "HDMI-1".
    pub name: String,
    id: u32,
    /// What drives it.
    pub crtc: u32,
    /// Its part of the screen.
    pub place: Place,
    /// Pictures a second, where the server knows.
    pub refresh_hz: Option<f64>,
    /// Pixels are scaled or bent on their way out (`xrandr --scale`).
    resampled: bool,
    /// What becomes of codes.
    pub gamma: Gamma,
}

impl Place {
    /// Do two have pixels in common?
    pub fn meets(&self, other: &Place) -> bool {
        let along = |a: i16, a_len: u16, b: i16, b_len: u16| {
            i32::from(a) < i32::from(b) + i32::from(b_len) && i32::from(b) < i32::from(a) + i32::from(a_len)
        };
        along(self.x, self.width, other.x, other.width) && along(self.y, self.height, other.y, other.height)
    }

    fn words(&self) -> String {
        format!("{} x {} pixels at ({}, {})", self.width, self.height, self.x, self.y)
    }
}

impl Output {
    /// The outputs that are lit, in the server's order.
    ///
    /// # Errors
    /// A server without RandR 1.3.
    pub fn all(link: &Link) -> Result<Vec<Self>, Trouble> {
        let version = link.server.randr_query_version(1, 3).map_err(Into::into).and_then(|cookie| cookie.reply());
        if !version.is_ok_and(|version| (version.major_version, version.minor_version) >= (1, 3)) {
            return Err(Trouble::stop(
                format!("the X server {} does not tell its outputs (RandR 1.3)", link.name),
                "use driver = \"window\" under [devices] screen",
            ));
        }
        let resources = resources(link)?;
        let ids = resources.outputs.clone();
        let read = ids.into_iter().map(|id| Self::read(link, &resources, id));
        read.filter_map(Result::transpose).collect()
    }

    /// An output as it is now; none where it is not lit. One round trip after the server knows which CRTC.
    fn read(link: &Link, resources: &GetScreenResourcesCurrentReply, id: u32) -> Result<Option<Self>, Trouble> {
        let at = resources.config_timestamp;
        let info = link.told(link.told(link.server.randr_get_output_info(id, at))?.reply())?;
        if info.crtc == 0 || info.connection == Connection::DISCONNECTED {
            return Ok(None);
        }
        let name = String::from_utf8_lossy(&info.name).into_owned();
        let asked = (
            link.told(link.server.randr_get_crtc_info(info.crtc, at))?,
            link.told(link.server.randr_get_crtc_gamma(info.crtc))?,
            link.told(link.server.randr_get_crtc_transform(info.crtc))?,
        );
        let (crtc, gamma, transform) =
            (link.told(asked.0.reply())?, link.told(asked.1.reply())?, link.told(asked.2.reply())?);
        if crtc.mode == 0 {
            return Ok(None);
        }
        let mode = resources.modes.iter().find(|mode| mode.id == crtc.mode);
        let turned = u16::from(crtc.rotation) & u16::from(Rotation::ROTATE90 | Rotation::ROTATE270) != 0;
        let scaled = mode.is_some_and(|mode| {
            let size = if turned { (mode.height, mode.width) } else { (mode.width, mode.height) };
            size != (crtc.width, crtc.height)
        });
        Ok(Some(Self {
            name,
            id,
            crtc: info.crtc,
            place: Place { x: crtc.x, y: crtc.y, width: crtc.width, height: crtc.height },
            refresh_hz: mode.and_then(|mode| {
                let lines =
                    f64::from(mode.vtotal) * if mode.mode_flags.contains(ModeFlag::DOUBLE_SCAN) { 2.0 } else { 1.0 };
                let pixels = f64::from(mode.htotal) * lines;
                (mode.dot_clock > 0 && pixels > 0.0).then(|| f64::from(mode.dot_clock) / pixels)
            }),
            resampled: scaled || !is_identity(&transform.current_transform),
            gamma: Gamma { channels: [gamma.red, gamma.green, gamma.blue] },
        }))
    }

    /// The same output as it is now.
    ///
    /// # Errors
    /// One that is gone, or has another place or mode.
    pub fn again(&self, link: &Link) -> Result<Self, Trouble> {
        let now = Self::read(link, &resources(link)?, self.id)?;
        let advice = "put the screen back as it was, keep the desktop from changing it, and go on";
        match now {
            None => Err(Trouble::stop(format!("output {} was unplugged or switched off", self.name), advice)),
            Some(now) if now.place != self.place || now.crtc != self.crtc => Err(Trouble::stop(
                format!("output {} had {} and now has {}", self.name, self.place.words(), now.place.words()),
                advice,
            )),
            Some(now) => Ok(now),
        }
    }

    /// Pixels and codes come out as they go in.
    ///
    /// # Errors
    /// Scaling; a gamma table that is not the identity, unless any will do.
    pub fn check(&self, white: u16, any_gamma: bool) -> Result<(), Trouble> {
        if self.resampled {
            return Err(Trouble::stop(
                format!("output {} scales pixels on their way to the panel", self.name),
                format!("set its own resolution without scaling (xrandr --output {} --auto --scale 1x1)", self.name),
            ));
        }
        if any_gamma || self.gamma.is_identity(white) || self.gamma.is_unwritten() {
            return Ok(());
        }
        let advice = "switch off night light, redshift and colour profiles for it (or set any_gamma = true under [devices] \
                      screen, and measure the screen's curve with all of that as it is)";
        Err(match self.gamma.len() {
            0 | 1 => Trouble::stop(format!("the gamma table of output {} cannot be read", self.name), advice),
            _ => Trouble::stop(
                format!("the graphics card bends the codes of output {}: {}", self.name, self.gamma.words()),
                advice,
            ),
        })
    }

    /// For lists.
    pub fn words(&self, white: u16) -> String {
        let rate = self.refresh_hz.map_or_else(String::new, |rate| format!(", {rate:.2} Hz"));
        let gamma = match self.gamma.len() {
            0 | 1 => "gamma table not readable",
            _ if self.gamma.is_unwritten() => "gamma table: none is in use",
            _ if self.gamma.is_identity(white) => "gamma table: identity",
            _ => "gamma table: NOT the identity",
        };
        let scaled = if self.resampled { ", SCALED on its way to the panel" } else { "" };
        format!("{}: {}{rate}, {gamma}{scaled}", self.name, self.place.words())
    }
}

fn resources(link: &Link) -> Result<GetScreenResourcesCurrentReply, Trouble> {
    link.told(link.told(link.server.randr_get_screen_resources_current(link.screen().root))?.reply())
}

/// Fixed numbers of 16.16 bits; where a server says nothing all are 0.
fn is_identity(t: &Transform) -> bool {
    let one = t.matrix33;
    let along = [t.matrix11, t.matrix22];
    let across = [t.matrix12, t.matrix13, t.matrix21, t.matrix23, t.matrix31, t.matrix32];
    along.iter().all(|v| *v == one) && across.iter().all(|v| *v == 0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rectangles_meet_in_pixels_not_in_edges() {
        let at = |x, y, width, height| Place { x, y, width, height };
        let screen = at(100, 0, 50, 40);
        for (other, meets) in [
            (at(0, 0, 100, 40), false),
            (at(0, 0, 101, 1), true),
            (at(150, 0, 10, 10), false),
            (at(149, 39, 10, 10), true),
            (at(120, 40, 10, 10), false),
            (at(-200, -200, 30000, 30000), true),
        ] {
            assert_eq!((screen.meets(&other), other.meets(&screen)), (meets, meets), "{other:?}");
        }
    }
}
