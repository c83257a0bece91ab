//! Rig files, read and checked: the one door for them.

use std::fmt::Display;
use std::ops::RangeInclusive;
use std::path::Path;

use relume_core::domain::{EmitterCurve, Filter};
use relume_core::files::folder_of;
use relume_core::wavelet::Wavelet;
use relume_core::{Error, Result};

use super::file::{EmitterChoice, GantryRig, Kind, RigFile};
use crate::session::one_line;

/// Pixels along a side of what projectors show: those of the largest there are.
const MOST_PIXELS: usize = 4096;
/// Version of rig files.
const VERSION: u32 = 1;

impl EmitterChoice {
    /// With the numbers of the file it names, which lies in `folder`.
    fn resolved(&self, folder: &Path) -> Result<Self> {
        let Self::File(name) = self else { return Ok(self.clone()) };
        let curve = EmitterCurve::read(&folder.join(name))?;
        Ok(Self::Measured((0..=255).map(|code| curve.light(f64::from(code) / 255.0)).collect()))
    }

    /// The curve.
    ///
    /// # Errors
    /// Numbers that are no curve, as somebody may have written them into a session.
    pub fn curve(&self) -> Result<EmitterCurve> {
        match self {
            Self::Linear => Ok(EmitterCurve::Linear),
            Self::Srgb => Ok(EmitterCurve::Srgb),
            Self::File(name) => EmitterCurve::read(Path::new(name)),
            Self::Measured(light) => {
                let place = "the measured curve of the rig";
                let light = <[f64; 256]>::try_from(light.as_slice());
                let light = light.map_err(|_| Error::invalid(place, "another number of codes", "256 of them"))?;
                EmitterCurve::table(place, light)
            }
        }
    }
}

impl GantryRig {
    /// Checks the squares: what can be lit together, and drawn.
    ///
    /// # Errors
    /// At `place`: an influence without squares, or so small that squares overlap; texels that do not draw them.
    pub fn check_squares(&self, place: &str) -> Result<()> {
        let Self { squares, influence, filter, texels, .. } = *self;
        if filter != Filter::Box && texels < 2 {
            let expected = format!("2 or more, say 4, pixels along a square of filter = \"{}\"", filter.id());
            return refuse(place, "texels", texels.to_string(), &expected);
        }
        if self.pixels() > MOST_PIXELS {
            let found = format!("{squares} squares of {texels} texels");
            return refuse(place, "texels", found, &format!("{MOST_PIXELS} projector pixels a side at most"));
        }
        if !(1..=squares).contains(&influence) {
            let expected =
                format!("1 to {squares}, the squares along a side: every so many of them are lit together (7.5)");
            return refuse(place, "influence", influence.to_string(), &expected);
        }
        let least = (2.0 * filter.reach()).ceil() as usize;
        if influence < least {
            let expected = format!(
                "{least} or more: squares of filter = \"{}\" reach {} squares to either side, and those lit together must not overlap",
                filter.id(),
                filter.reach()
            );
            return refuse(place, "influence", influence.to_string(), &expected);
        }
        Ok(())
    }
}

impl RigFile {
    /// Reads and checks a rig file.
    ///
    /// # Errors
    /// Each names the file and the key: unknown keys, numbers that are none, a table that the kind of rig lacks.
    pub fn read(path: &Path) -> Result<Self> {
        let text = std::fs::read_to_string(path).map_err(|source| Error::io("read", path, source))?;
        Self::parse(&text, path)
    }

    /// Parses the text of a rig file; `path` names it in messages, and its folder is where the files it names lie.
    ///
    /// # Errors
    /// As [`RigFile::read`].
    pub fn parse(text: &str, path: &Path) -> Result<Self> {
        let place = path.display().to_string();
        let mut rig: Self = toml::from_str(text).map_err(|error| {
            let line = error.span().map_or(1, |span| text[..span.start.min(text.len())].matches('\n').count() + 1);
            let expected = "a rig file; `presets/rigs/` explains every key";
            Error::invalid(format!("{place}, line {line}"), one_line(&error), expected)
        })?;
        if rig.version != VERSION {
            let found = format!("version = {}", rig.version);
            return Err(Error::invalid(place, found, format!("version = {VERSION}; a newer tool reads newer files")));
        }
        rig.check(&place)?;
        let curves = [rig.monitor.as_mut().map(|m| &mut m.curve), rig.gantry.as_mut().map(|g| &mut g.curve)];
        for curve in curves.into_iter().flatten() {
            *curve = curve.resolved(folder_of(path))?;
        }
        let stage = rig.stage.as_mut().map(|stage| (&mut stage.lamps, "[stage.lamps]"));
        let gantry = rig.gantry.as_mut().map(|gantry| (&mut gantry.positions, "[gantry.positions]"));
        if let Some((lamps, table)) = stage.or(gantry) {
            *lamps = lamps.clone().resolved(folder_of(path))?;
            lamps.check(&format!("{place}, {table}"))?;
        }
        if let Some(devices) = rig.devices.take() {
            let devices = devices.resolved(folder_of(path));
            devices.check(&place, &rig)?;
            rig.devices = Some(devices);
        }
        Ok(rig)
    }

    /// The shortest and the longest exposure, seconds: what the camera can do, and no shorter than one picture of the screen,
    /// of which a photograph would show a part (6.3).
    pub fn exposure_limits(&self) -> [f64; 2] {
        let refresh = self.monitor.as_ref().map_or(0.0, |monitor| 1.0 / monitor.refresh_hz);
        let [fastest, slowest] = self.camera.limits_s;
        [fastest.max(refresh), slowest]
    }

    fn check(&self, place: &str) -> Result<()> {
        self.check_tables(place)?;
        self.check_times(place)?;
        self.check_emitter(place)?;
        let (camera, simulation) = (&self.camera, &self.simulation);
        in_range(
            place,
            &[
                ("step_stops", camera.step_stops, 0.1..=6.0),
                ("iso", camera.iso, 1.0..=1e7),
                ("f_number", camera.f_number, 0.1..=1000.0),
                ("overhead_s", camera.overhead_s, 0.0..=600.0),
                ("megabytes", camera.megabytes, 0.0..=1e4),
                ("patience_s", camera.patience_s, 0.0..=3600.0),
                ("irradiance", simulation.irradiance, 1e-9..=1e12),
                ("spread", simulation.spread, 0.0..=0.5),
                ("drift", simulation.drift, -0.9..=9.0),
                ("ambient", simulation.ambient, 0.0..=1e3),
                ("full_well_e", simulation.sensor.full_well_e, 10.0..=1e9),
                ("read_e", simulation.sensor.read_e, 0.0..=1e6),
                ("dark", simulation.sensor.dark, 0.0..=0.5),
            ],
        )?;
        if let Some(ball) = &self.calibration.white_ball {
            in_range(place, &[("albedo", ball.albedo, 0.01..=1.0)])?;
            in_range(place, &[("focal_px", ball.focal_px.unwrap_or(1.0), 1.0..=1e6)])?;
            if ball.circle_px.is_some_and(|circle| circle.iter().any(|v| !(0.0..=1e5).contains(v)) || circle[2] < 2.0) {
                let found = format!("{:?}", ball.circle_px.unwrap_or_default());
                return refuse(place, "circle_px", found, "column, row and radius in pixels, a radius of 2 at least");
            }
        }
        in_range(
            place,
            &[
                ("width", simulation.width, 8..=65535),
                ("height", simulation.height, 8..=65535),
                ("samples", simulation.samples, 1..=65536),
                ("bits", simulation.sensor.bits as usize, 8..=16),
            ],
        )
    }

    /// The table of the rig's kind, and no other.
    fn check_tables(&self, place: &str) -> Result<()> {
        if !self.simulation.scene.is_for(self.kind) {
            let found = format!("\"{}\"", self.simulation.scene.id());
            let expected = "\"mixed\"; \"diffuse\" is for a screen, \"convex\" and \"bowl\" are for a projector";
            return refuse(place, "scene", found, expected);
        }
        let tables = [
            (Kind::Stage, "stage", self.stage.is_some()),
            (Kind::Monitor, "monitor", self.monitor.is_some()),
            (Kind::Gantry, "gantry", self.gantry.is_some()),
        ];
        for (kind, name, there) in tables {
            if there && kind != self.kind {
                let found = format!("a [{name}] table in a rig of another kind");
                return refuse(place, "kind", found, "the table of its kind alone");
            }
            if !there && kind == self.kind {
                return refuse(place, "kind", format!("no [{name}] table"), "the table of its kind");
            }
        }
        Ok(())
    }

    fn check_times(&self, place: &str) -> Result<()> {
        let camera = &self.camera;
        let [fastest, slowest] = camera.limits_s;
        if !(fastest > 0.0 && fastest < slowest && slowest.is_finite()) {
            let found = format!("{:?}", camera.limits_s);
            return refuse(place, "limits_s", found, "the shortest and the longest time, seconds");
        }
        let lists = [
            ("times_s", camera.times_s.as_ref()),
            ("response_times_s", Some(&self.calibration.response_times_s)),
            ("dark_times_s", Some(&self.calibration.dark_times_s)),
        ];
        for (key, times) in lists {
            let times = times.map_or(&[][..], Vec::as_slice);
            if let Some(bad) = times.iter().find(|t| !(fastest..=slowest).contains(*t)) {
                return refuse(place, key, format!("{bad} s"), "times within limits_s");
            }
            if !times.is_sorted_by(|a, b| a < b) {
                return refuse(place, key, "times out of order".to_owned(), "short ones first, none twice");
            }
        }
        if camera.times_s.as_ref().is_some_and(Vec::is_empty) {
            let expected = "at least one, or no such key to choose them by preview";
            return refuse(place, "times_s", "no time".to_owned(), expected);
        }
        Ok(())
    }

    /// A screen is drawn again and again: a photograph that is shorter than one refresh shows a part of it.
    fn check_refresh(&self, place: &str, refresh_hz: f64) -> Result<()> {
        let lists =
            [("times_s", self.camera.times_s.as_ref()), ("response_times_s", Some(&self.calibration.response_times_s))];
        let slowest = [("limits_s", Some(self.camera.limits_s[1]))];
        let shortest = lists.map(|(key, times)| (key, times.and_then(|times| times.first()).copied()));
        for (key, time) in shortest.into_iter().chain(slowest) {
            if let Some(time) = time.filter(|time| *time < 1.0 / refresh_hz) {
                let expected = format!(
                    "{:.4} s or more: a shorter exposure shows a part of the screen's picture, at refresh_hz = {refresh_hz}; \
                     take a smaller aperture",
                    1.0 / refresh_hz
                );
                return refuse(place, key, format!("{time} s"), &expected);
            }
        }
        Ok(())
    }

    /// Screens and projectors.
    fn check_emitter(&self, place: &str) -> Result<()> {
        let known = ["ramp", "gray-code", "stripes"];
        if let Some(wrong) = self.calibration.patterns.iter().find(|name| !known.contains(&name.as_str())) {
            return refuse(place, "patterns", format!("`{wrong}`"), &known.join(", "));
        }
        if let Some(monitor) = &self.monitor {
            if monitor.wavelet.parse::<Wavelet>().is_err() {
                return refuse(place, "wavelet", format!("`{}`", monitor.wavelet), "haar, 5/3 or 9/7");
            }
            in_range(
                place,
                &[
                    ("functions", monitor.functions, 1..=1_000_000),
                    ("columns", monitor.columns, 2..=4096),
                    ("rows", monitor.rows, 2..=4096),
                    ("noise", monitor.noise, 1..=100_000),
                    ("squares", monitor.squares, 1..=256),
                ],
            )?;
            in_range(
                place,
                &[
                    ("threshold", monitor.threshold, 0.0..=1.0),
                    ("smoothness", monitor.smoothness, 0.0..=10.0),
                    ("refresh_hz", monitor.refresh_hz, 1.0..=10_000.0),
                ],
            )?;
            self.check_refresh(place, monitor.refresh_hz)?;
        }
        if let Some(gantry) = &self.gantry {
            in_range(place, &[("squares", gantry.squares, 1..=256), ("texels", gantry.texels, 1..=64)])?;
            gantry.check_squares(place)?;
            in_range(place, &[("distance", gantry.distance, 0.1..=1e4), ("view_deg", gantry.view_deg, 0.1..=160.0)])?;
            in_range(place, &[("lean_deg", gantry.lean_deg, -90.0..=90.0)])?;
        }
        Ok(())
    }
}

/// Refuses a key.
///
/// # Errors
/// Always.
pub fn refuse(place: &str, key: &str, found: String, expected: &str) -> Result<()> {
    Err(Error::invalid(format!("{place}, {key}"), found, expected))
}

/// Refuses the first number that is out of its range.
///
/// # Errors
/// That.
pub fn in_range<T: PartialOrd + Display>(place: &str, numbers: &[(&str, T, RangeInclusive<T>)]) -> Result<()> {
    match numbers.iter().find(|(_, value, range)| !range.contains(value)) {
        None => Ok(()),
        Some((key, value, range)) => {
            let expected = format!("a number from {} to {}", range.start(), range.end());
            refuse(place, key, value.to_string(), &expected)
        }
    }
}
