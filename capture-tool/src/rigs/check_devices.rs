//! The `[devices]` table, checked: numbers within what devices take, and nothing missing that the rig needs.

use std::collections::HashSet;
use std::path::Path;

use relume_core::{Error, Result};

use super::check::{in_range, refuse};
use super::devices::{AxesDevice, Axis, CameraDevice, Devices, LampsDevice, ScreenDevice, Wiring};
use super::file::{Kind, RigFile};

/// Channels of a DMX universe.
const CHANNELS: u16 = 512;

impl Devices {
    /// Paths relative to the rig file, which lies in `folder`, become absolute: a session is resumed from anywhere.
    pub fn resolved(mut self, folder: &Path) -> Self {
        if let CameraDevice::Folder { path, .. } = &mut self.camera
            && let Ok(absolute) = std::path::absolute(folder.join(&*path))
        {
            *path = absolute;
        }
        self
    }

    /// Refuses what no device takes, and what the rig cannot do without. `place` names the file.
    ///
    /// # Errors
    /// Each names the key.
    pub fn check(&self, place: &str, rig: &RigFile) -> Result<()> {
        let place = &format!("{place}, [devices]");
        self.check_there(place, rig)?;
        if let CameraDevice::Folder { within_s, poll_s, .. } = &self.camera {
            in_range(place, &[("within_s", *within_s, 0.01..=3600.0), ("poll_s", *poll_s, 0.0..=60.0)])?;
        }
        if let Some(axes) = &self.axes {
            axes.check(place, rig)?;
        }
        if let Some(lamps) = &self.lamps {
            lamps.check(place, rig.stage.as_ref().map_or(0, |stage| stage.lamps.per_stop()))?;
        }
        if let Some(screen) = &self.screen {
            screen.check(place)?;
        }
        if let Some(limit) = self.watchdog_s.filter(|limit| *limit != 0.0) {
            let slowest = rig.camera.limits_s[1];
            if !(slowest..=86_400.0).contains(&limit) {
                let expected = format!("0, or more than the longest exposure, {slowest} s, and a day at most");
                return refuse(place, "watchdog_s", limit.to_string(), &expected);
            }
        }
        Ok(())
    }

    /// The devices of the rig's kind, and no others. Before a virtual camera some may be left out.
    fn check_there(&self, place: &str, rig: &RigFile) -> Result<()> {
        let rehearsal = self.camera == CameraDevice::Virtual;
        let is = |kind: Kind| rig.kind == kind;
        let moves = rig.stops() > 1;
        let rules = [
            ("lamps", self.lamps.is_some(), is(Kind::Stage), is(Kind::Stage)),
            ("screen", self.screen.is_some(), !is(Kind::Stage), !is(Kind::Stage)),
            ("axes", self.axes.is_some(), !is(Kind::Monitor), moves),
        ];
        for (key, there, possible, needed) in rules {
            if there && !possible {
                return refuse(place, key, format!("`{key}` in a rig of another kind"), "a rig that has them");
            }
            if needed && !there && !rehearsal {
                let advice =
                    if key == "axes" { "; { driver = \"hand\" } asks the operator to turn the table" } else { "" };
                return refuse(
                    place,
                    key,
                    format!("no `{key}`"),
                    &format!("them, since the rig has {}{advice}", rig.stops_in_words()),
                );
            }
        }
        Ok(())
    }
}

impl RigFile {
    /// Places that a turntable or an arm goes to.
    pub fn stops(&self) -> usize {
        match (&self.stage, &self.gantry) {
            (Some(stage), _) => stage.lamps.stops(),
            (None, Some(gantry)) => gantry.positions.count(),
            (None, None) => 1,
        }
    }

    fn stops_in_words(&self) -> String {
        match self.kind {
            Kind::Stage => format!("lamps at {} stops of the turntable", self.stops()),
            Kind::Monitor => "a screen".to_owned(),
            Kind::Gantry => format!("a projector at {} positions", self.stops()),
        }
    }
}

impl AxesDevice {
    fn check(&self, place: &str, rig: &RigFile) -> Result<()> {
        let Self::Grbl { port, baud, turntable, arm, settle_s, reply_s, move_limit_s, .. } = self else {
            return Ok(());
        };
        check_port(place, port)?;
        in_range(place, &[("baud", *baud, 300..=4_000_000)])?;
        in_range(
            place,
            &[
                ("settle_s", *settle_s, 0.0..=60.0),
                ("reply_s", *reply_s, 0.001..=60.0),
                ("move_limit_s", *move_limit_s, 0.01..=3600.0),
            ],
        )?;
        let wanted = [("turntable", turntable, true), ("arm", arm, rig.kind == Kind::Gantry)];
        for (key, axis, needed) in wanted {
            match axis {
                None if needed => {
                    return refuse(
                        place,
                        key,
                        format!("no `{key}`"),
                        "the board's axis for it, as in { letter = \"X\" }",
                    );
                }
                None => {}
                Some(axis) => axis.check(&format!("{place}, {key}"))?,
            }
        }
        if let (Some(a), Some(b)) = (turntable, arm)
            && a.letter == b.letter
        {
            return refuse(
                place,
                "arm",
                format!("the letter {} for both", a.letter),
                "another letter than the turntable's",
            );
        }
        for (stop, at) in rig.stations().into_iter().enumerate() {
            for (key, axis, deg) in [("turntable", turntable, at.turntable_deg), ("arm", arm, at.arm_deg)] {
                let outside = |axis: &Axis, deg: f64| deg < axis.limits_deg[0] || deg > axis.limits_deg[1];
                if let (Some(axis), Some(deg)) = (axis, deg)
                    && outside(axis, deg)
                {
                    let found = format!("stop {} at {deg:.1} degrees", stop + 1);
                    return refuse(&format!("{place}, {key}"), "limits_deg", found, "limits that hold every stop");
                }
            }
        }
        Ok(())
    }
}

impl Axis {
    fn check(&self, place: &str) -> Result<()> {
        if !"XYZABC".contains(self.letter) {
            return refuse(place, "letter", format!("\"{}\"", self.letter), "X, Y, Z, A, B or C");
        }
        if !(1e-6..=1e6).contains(&self.per_deg.abs()) {
            return refuse(
                place,
                "per_deg",
                self.per_deg.to_string(),
                "the board's units a degree: 1, or -1 for the other way about",
            );
        }
        let [low, high] = self.limits_deg;
        if !(low < high && low >= -36_000.0 && high <= 36_000.0) {
            return refuse(
                place,
                "limits_deg",
                format!("{:?}", self.limits_deg),
                "the lowest and the highest angle, degrees",
            );
        }
        in_range(
            place,
            &[
                ("zero", self.zero, -1e6..=1e6),
                ("backlash_deg", self.backlash_deg, 0.0..=90.0),
                ("speed_deg_s", self.speed_deg_s.unwrap_or(1.0), 1e-3..=1e4),
            ],
        )
    }
}

impl LampsDevice {
    fn check(&self, place: &str, lamps: usize) -> Result<()> {
        let place = &format!("{place}, lamps");
        let dmx = !matches!(self, Self::Text { .. });
        self.wiring().check(place, lamps, dmx)?;
        match self {
            Self::Text { port, baud, on, off, reply_s, .. } => {
                check_port(place, port)?;
                in_range(place, &[("baud", *baud, 300..=4_000_000)])?;
                in_range(place, &[("reply_s", *reply_s, 0.001..=60.0)])?;
                for (key, template) in [("on", Some(on)), ("off", off.as_ref())] {
                    if template.is_some_and(|template| !template.contains("{lamp}")) {
                        let found = format!("\"{}\"", template.map_or("", String::as_str));
                        return refuse(place, key, found, "a line with {lamp} in it, as in \"<{lamp},1>\"");
                    }
                }
                Ok(())
            }
            Self::DmxUsbPro { port, reply_s, .. } => {
                check_port(place, port)?;
                in_range(place, &[("reply_s", *reply_s, 0.001..=60.0)])
            }
            Self::ArtNet { host, universe, .. } => {
                if host.is_empty() {
                    return refuse(
                        place,
                        "host",
                        "an empty name".to_owned(),
                        "the node's address, as in \"10.0.0.20\"",
                    );
                }
                in_range(place, &[("universe", *universe, 0..=32_767)])
            }
            Self::Sacn { universe, priority, .. } => {
                in_range(place, &[("universe", *universe, 1..=63_999)])?;
                in_range(place, &[("priority", *priority, 0..=200)])
            }
        }
    }
}

impl Wiring {
    fn check(&self, place: &str, lamps: usize, dmx: bool) -> Result<()> {
        in_range(place, &[("settle_s", self.settle_s, 0.0..=60.0)])?;
        in_range(place, &[("level", self.level, 1..=255)])?;
        let most = if dmx { CHANNELS } else { u16::MAX };
        if lamps > usize::from(most) {
            return refuse(place, "channel_of", format!("{lamps} lamps"), &format!("{most} at most on one line"));
        }
        let channels = self.channels(lamps);
        if channels.len() != lamps {
            let found = format!("{} channels", channels.len());
            return refuse(place, "channel_of", found, &format!("{lamps}, one for each physical lamp"));
        }
        let mut seen = HashSet::new();
        for channel in channels {
            if dmx && !(1..=CHANNELS).contains(&channel) {
                return refuse(place, "channel_of", format!("channel {channel}"), &format!("1 to {CHANNELS}"));
            }
            if !seen.insert(channel) {
                return refuse(place, "channel_of", format!("channel {channel} twice"), "one for each physical lamp");
            }
        }
        Ok(())
    }
}

impl ScreenDevice {
    fn check(&self, place: &str) -> Result<()> {
        let place = &format!("{place}, screen");
        let look = self.look();
        in_range(place, &[("settle_s", look.settle_s, 0.0..=60.0)])?;
        in_range(place, &[("texel_px", look.texel_px.unwrap_or(1), 1..=4096)])?;
        match (look.bits, self) {
            (8, _) | (10, Self::X11 { .. }) => Ok(()),
            (10, _) => refuse(place, "bits", "10".to_owned(), "8, or driver = \"x11\""),
            (other, _) => refuse(place, "bits", other.to_string(), "8 or 10"),
        }
    }
}

fn check_port(place: &str, port: &str) -> Result<()> {
    if port.trim().is_empty() {
        return Err(Error::invalid(
            format!("{place}, port"),
            "an empty name",
            "a serial port; `relume devices` lists them",
        ));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    const STAGE: &str = r#"
version = 1
name = "Stage"
kind = "stage"
[camera]
limits_s = [0.001, 30.0]
[stage.lamps]
layout = "arc"
latitudes = 3
longitudes = 4
[devices]
camera = { driver = "gphoto2" }
axes = { driver = "grbl", port = "/dev/ttyUSB0", turntable = { letter = "X" } }
lamps = { driver = "dmx-usb-pro", port = "/dev/ttyUSB1", channel_of = [10, 11, 12] }
"#;

    fn parse(text: &str) -> Result<RigFile> {
        RigFile::parse(text, Path::new("rig.toml"))
    }

    #[test]
    fn a_rig_of_real_devices_needs_no_virtual_table() {
        let rig = parse(STAGE).unwrap();
        assert!(!rig.is_virtual());
        let lamps = rig.devices.as_ref().unwrap().lamps.as_ref().unwrap();
        assert_eq!(lamps.wiring().channels(3), [10, 11, 12]);
        let written = toml::to_string(&rig).unwrap();
        assert!(!written.contains("[virtual]"), "{written}");
        assert_eq!(toml::from_str::<RigFile>(&written).unwrap(), rig);
    }

    #[test]
    fn what_no_device_takes_is_refused_by_its_key() {
        for (from, to, words) in [
            ("[10, 11, 12]", "[10, 11]", "2 channels"),
            ("[10, 11, 12]", "[10, 11, 513]", "channel 513"),
            ("[10, 11, 12]", "[10, 11, 11]", "channel 11 twice"),
            ("[10, 11, 12]", "[10, 11, 12], brightness = 3", "brightness"),
            ("letter = \"X\"", "letter = \"Q\"", "letter"),
            ("letter = \"X\"", "letter = \"X\", per_deg = 0", "per_deg"),
            ("letter = \"X\"", "letter = \"X\", limits_deg = [0, 200]", "stop 4 at 270.0 degrees"),
            ("turntable = { letter = \"X\" }", "baud = 9600", "no `turntable`"),
            ("\"/dev/ttyUSB1\"", "\"\"", "empty name"),
            ("lamps = {", "screen = { driver = \"x11\" }\nlamps = {", "`screen` in a rig of another kind"),
            ("axes = { driver = \"grbl\", port = \"/dev/ttyUSB0\", turntable = { letter = \"X\" } }", "", "no `axes`"),
            ("driver = \"gphoto2\"", "driver = \"polaroid\"", "polaroid"),
            ("[devices]", "[devices]\nwatchdog_s = 5", "watchdog_s"),
        ] {
            assert!(STAGE.contains(from), "{from}");
            let error = parse(&STAGE.replace(from, to)).unwrap_err().to_string();
            assert!(error.contains(words) && error.starts_with("rig.toml"), "{to}: {error}");
        }
    }

    #[test]
    fn before_a_virtual_camera_devices_may_be_left_out() {
        let text = STAGE.replace("\"gphoto2\"", "\"virtual\"");
        let lamps_alone = text.lines().filter(|line| !line.starts_with("axes")).collect::<Vec<_>>().join("\n");
        assert!(parse(&lamps_alone).unwrap().is_virtual());
    }
}
