//! The `[devices]` table of a rig file: which real devices a rig has, and how they are driven. Every key is explained in
//! `presets/rigs/stage-devices.toml`.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

/// Real devices. Without the table everything is virtual.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Devices {
    /// Takes the photographs.
    pub camera: CameraDevice,
    /// Turntable and arm; none where nothing moves.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub axes: Option<AxesDevice>,
    /// Lamps of a stage.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lamps: Option<LampsDevice>,
    /// The screen of a monitor rig, or the projector of a gantry.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub screen: Option<ScreenDevice>,
    /// The watchdog switches off and ends the tool when it gives no sign of life for so long, seconds; 0: no watchdog. Left out, it is
    /// worked out from the longest exposure.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub watchdog_s: Option<f64>,
}

/// A camera.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "driver", rename_all = "kebab-case", deny_unknown_fields)]
pub enum CameraDevice {
    /// Over USB through libgphoto2, which is opened at run time.
    Gphoto2 {
        /// A part of the model's name, where several are connected.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        model: Option<String>,
        /// As `relume devices` lists it, where two of one model are connected.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        port: Option<String>,
        /// The value of the camera's image format to set, as in "RAW + Fine"; left out, it stays as it is.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        format: Option<String>,
        /// Which file counts where the camera makes two.
        #[serde(default)]
        counts: Counts,
        /// Leave the photographs on the card.
        #[serde(default)]
        keep_on_card: bool,
    },
    /// Any software that puts photographs into a folder.
    Folder {
        /// The folder.
        path: PathBuf,
        /// A command that takes a photograph; `{time_s}`, `{iso}` and `{f_number}` are put in. Left out, the operator is asked to.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        trigger: Vec<String>,
        /// Which file counts where each photograph makes two.
        #[serde(default)]
        counts: Counts,
        /// A photograph has to be there so many seconds after its exposure ended.
        #[serde(default = "thirty")]
        within_s: f64,
        /// Look for files so often, seconds, in place of being told by the system: network shares. 0: be told.
        #[serde(default)]
        poll_s: f64,
    },
    /// Photographs what the virtual rig shows while real lamps, axes and screens are driven: a rehearsal.
    Virtual,
}

/// Which of two files of a photograph counts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Counts {
    /// The picture (JPEG, TIFF): the raw file is kept beside it.
    #[default]
    Picture,
    /// The raw file, which `relume` has to be built to read (feature `raw`).
    Raw,
}

/// Turntable and arm.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "driver", rename_all = "kebab-case", deny_unknown_fields)]
pub enum AxesDevice {
    /// A board with GRBL (1.1) on a serial port, its steps set per degree (or per what `per_deg` says).
    Grbl {
        /// As in "/dev/ttyUSB0" or "COM3".
        port: String,
        /// Bits a second.
        #[serde(default = "baud_grbl")]
        baud: u32,
        /// Look for the limit switches when a session begins ($H). Without, where the axes stand then is zero.
        #[serde(default)]
        home: bool,
        /// The axis under the object.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        turntable: Option<Axis>,
        /// The axis that lifts the projector.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        arm: Option<Axis>,
        /// After a move nothing trembles any more, seconds.
        #[serde(default = "second")]
        settle_s: f64,
        /// A board that says nothing for so long is lost, seconds.
        #[serde(default = "second")]
        reply_s: f64,
        /// The longest that a move may take, seconds.
        #[serde(default = "two_minutes")]
        move_limit_s: f64,
    },
    /// The operator turns by hand, and is asked to.
    Hand,
}

/// An axis.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Axis {
    /// The board's letter for it: X, Y, Z or A.
    pub letter: char,
    /// The board's units a degree; negative turns it the other way about.
    #[serde(default = "one")]
    pub per_deg: f64,
    /// The board's position, in its units, at 0 degrees.
    #[serde(default)]
    pub zero: f64,
    /// It is never moved outside, degrees.
    #[serde(default = "full_turns")]
    pub limits_deg: [f64; 2],
    /// Positions are always come to from so far below, degrees: gears have play.
    #[serde(default)]
    pub backlash_deg: f64,
    /// Degrees a second; left out, as fast as the board moves.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub speed_deg_s: Option<f64>,
}

/// Lamps.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "driver", rename_all = "kebab-case", deny_unknown_fields)]
pub enum LampsDevice {
    /// A board that takes lines of text, as home-made domes do.
    Text {
        /// Serial port.
        port: String,
        /// Bits a second.
        #[serde(default = "baud_text")]
        baud: u32,
        /// The line that lights a lamp; `{lamp}` is its number, `{level}` its level.
        on: String,
        /// The line that puts a lamp out. Left out, `all_off` is sent before the next one is lit.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        off: Option<String>,
        /// The line that puts all lamps out.
        all_off: String,
        /// How the board answers each line; `{lamp}` may be in it. Left out, it does not answer.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        reply: Option<String>,
        /// What ends a line.
        #[serde(default = "newline")]
        ends: String,
        /// A board that does not answer for so long is lost, seconds.
        #[serde(default = "second")]
        reply_s: f64,
        /// What the board calls the first lamp, where `channel_of` is left out: the others follow.
        #[serde(default)]
        first: i64,
        /// What every lamp has in common.
        #[serde(flatten)]
        wiring: Wiring,
    },
    /// An ENTTEC DMX USB Pro, or what speaks as it does.
    DmxUsbPro {
        /// Serial port.
        port: String,
        /// A widget that does not answer for so long is lost, seconds.
        #[serde(default = "second")]
        reply_s: f64,
        /// What every lamp has in common.
        #[serde(flatten)]
        wiring: Wiring,
    },
    /// Art-Net over the network.
    ArtNet {
        /// The node's address, as in "10.0.0.20", or a broadcast one.
        host: String,
        /// UDP port.
        #[serde(default = "port_art_net")]
        udp_port: u16,
        /// Port address, 0 to 32767.
        #[serde(default)]
        universe: u16,
        /// What every lamp has in common.
        #[serde(flatten)]
        wiring: Wiring,
    },
    /// sACN (E1.31) over the network.
    Sacn {
        /// 1 to 63999.
        universe: u16,
        /// The node's address; left out, multicast.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        host: Option<String>,
        /// The address of this machine's network to send from; left out, the system chooses.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        from: Option<String>,
        /// 0 to 200: of several senders the highest counts.
        #[serde(default = "hundred")]
        priority: u8,
        /// What every lamp has in common.
        #[serde(flatten)]
        wiring: Wiring,
    },
}

/// How lamps are wired, whatever carries the levels.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Wiring {
    /// The channel (DMX: 1 to 512; text: the board's number) of each physical lamp, in the order of [stage.lamps]: of an arc from the
    /// horizon up. Left out: 1, 2, 3... (text: from `first` on).
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub channel_of: Vec<u16>,
    /// The level of a lamp that is on.
    #[serde(default = "full")]
    pub level: u8,
    /// From the command until the lamp shines steadily, seconds: DMX alone takes 0.025.
    #[serde(default = "tenth")]
    pub settle_s: f64,
}

/// A screen or a projector.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "driver", rename_all = "kebab-case", deny_unknown_fields)]
pub enum ScreenDevice {
    /// On X11, each picture confirmed by the server (Present).
    X11 {
        /// As in ":0"; left out, the variable DISPLAY.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        display: Option<String>,
        /// What every screen has in common.
        #[serde(flatten)]
        look: ScreenLook,
    },
    /// A full-screen window of the system: Windows, macOS, Wayland, X11. Nothing confirms that a picture is shown: mind `settle_s`.
    Window {
        /// What every screen has in common.
        #[serde(flatten)]
        look: ScreenLook,
    },
}

/// How pictures come onto a screen.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ScreenLook {
    /// The output's name as `relume devices` lists it, or a part of it; left out, the only one there is.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub output: Option<String>,
    /// Pixels along each side of a texel; left out, as many as fit.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub texel_px: Option<usize>,
    /// Bits of a code: 8, or 10 where the X server has depth 30.
    #[serde(default = "eight")]
    pub bits: u8,
    /// From the confirmation until the panel shows the picture, seconds.
    #[serde(default = "tenth")]
    pub settle_s: f64,
    /// Show patterns though the graphics card bends codes (a gamma table that is not the identity).
    #[serde(default)]
    pub any_gamma: bool,
}

impl LampsDevice {
    /// How the lamps are wired.
    pub fn wiring(&self) -> &Wiring {
        match self {
            Self::Text { wiring, .. }
            | Self::DmxUsbPro { wiring, .. }
            | Self::ArtNet { wiring, .. }
            | Self::Sacn { wiring, .. } => wiring,
        }
    }
}

impl Wiring {
    /// The channel of each of so many lamps.
    pub fn channels(&self, lamps: usize) -> Vec<u16> {
        if self.channel_of.is_empty() { (1..=lamps as u16).collect() } else { self.channel_of.clone() }
    }
}

impl ScreenDevice {
    /// How pictures come onto it.
    pub fn look(&self) -> &ScreenLook {
        match self {
            Self::X11 { look, .. } | Self::Window { look } => look,
        }
    }
}

fn thirty() -> f64 {
    30.0
}

fn second() -> f64 {
    1.0
}

fn two_minutes() -> f64 {
    120.0
}

fn tenth() -> f64 {
    0.1
}

fn one() -> f64 {
    1.0
}

fn full_turns() -> [f64; 2] {
    [-360.0, 360.0]
}

fn baud_grbl() -> u32 {
    115_200
}

fn baud_text() -> u32 {
    9600
}

fn newline() -> String {
    "\n".to_owned()
}

fn port_art_net() -> u16 {
    6454
}

fn hundred() -> u8 {
    100
}

fn full() -> u8 {
    255
}

fn eight() -> u8 {
    8
}
