//! What a capture will be: photographs, time, disk, and what is missing.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::Path;

use relume_core::files::folder_of;

use super::{Step, Times};
use crate::devices::Finding;
use crate::rigs::RigFile;
use crate::session::Role;

/// Exposures a photograph where they are still to be chosen, for the estimate.
const GUESSED_FRAMES: usize = 3;
/// Disk that should stay free beside the photographs: journal, contact sheets, the system.
const MARGIN_BYTES: f64 = 200e6;

/// Counts of a capture.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// Photographs by what they are for.
    pub photographs: BTreeMap<String, usize>,
    /// Files.
    pub frames: usize,
    /// Moves of the turntable or the arm.
    pub moves: usize,
    /// Time in all, seconds.
    pub seconds: f64,
    /// Bytes of all files.
    pub bytes: f64,
    /// Exposure times are still to be chosen.
    pub guessed: bool,
}

impl Plan {
    /// Of these steps.
    pub fn new<'a>(rig: &RigFile, steps: impl Iterator<Item = &'a Step>) -> Self {
        let camera = &rig.camera;
        let (per_stop, move_s, settle_s) = match (&rig.stage, &rig.monitor, &rig.gantry) {
            (Some(stage), ..) => (stage.lamps.per_stop(), stage.move_s, stage.lamp_s),
            (None, Some(monitor), _) => (1, 0.0, monitor.settle_s),
            (None, None, Some(gantry)) => (1, gantry.move_s, gantry.settle_s),
            (None, None, None) => (1, 0.0, 0.0),
        };
        // The middle of what the camera can do, in stops.
        let [fastest, slowest] = rig.exposure_limits();
        let usual = (fastest * slowest).sqrt();
        let mut plan = Self {
            photographs: BTreeMap::new(),
            frames: 0,
            moves: 0,
            seconds: 0.0,
            bytes: 0.0,
            guessed: camera.times_s.is_none(),
        };
        let mut stop = 0;
        for step in steps {
            *plan.photographs.entry(words(step.role).to_owned()).or_default() += 1;
            let times = match (&step.times, &camera.times_s) {
                (Times::Fixed(times), _) => times.clone(),
                (Times::Series { factor, .. }, Some(times)) => times.iter().map(|t| t * factor).collect(),
                (Times::Series { factor, .. }, None) => vec![usual * factor; GUESSED_FRAMES],
            };
            let there = step.condition.stop(per_stop);
            if there != stop {
                plan.moves += there.abs_diff(stop);
                plan.seconds += move_s * there.abs_diff(stop) as f64;
                stop = there;
            }
            plan.frames += times.len();
            plan.seconds += settle_s + times.iter().map(|t| t + camera.overhead_s).sum::<f64>();
        }
        plan.bytes = plan.frames as f64 * camera.megabytes * 1e6;
        plan
    }

    /// Photographs in all.
    pub fn count(&self) -> usize {
        self.photographs.values().sum()
    }

    /// Is there room for the files in the folder of a session?
    pub fn room(&self, session: &Path) -> Finding {
        let folder = if session.is_dir() { session } else { folder_of(session) };
        match fs4::available_space(folder) {
            Err(error) => Finding::missing(format!("disk: cannot tell what is free in {}: {error}", folder.display())),
            Ok(free) => {
                let wanted = self.bytes + MARGIN_BYTES;
                let text = format!("disk: {} free, {} wanted", size(free as f64), size(wanted));
                if free as f64 >= wanted { Finding::fine(text) } else { Finding::missing(text) }
            }
        }
    }

    /// For people.
    pub fn text(&self, rig: &RigFile, findings: &[Finding]) -> String {
        let mut text = format!("{}\n\n", rig.name);
        for (what, count) in &self.photographs {
            let _ = writeln!(text, "  {count:6}  {what}");
        }
        let about = if self.guessed { "about " } else { "" };
        let _ = writeln!(
            text,
            "  {:6}  photographs in all, {about}{} exposures, {} stops moved",
            self.count(),
            self.frames,
            self.moves
        );
        let _ = writeln!(text, "\ntime   {about}{}", duration(self.seconds));
        let _ = writeln!(text, "disk   {about}{}", size(self.bytes));
        if self.guessed {
            let _ = writeln!(
                text,
                "exposure times will be chosen from the previews (taken as {GUESSED_FRAMES} a photograph here)"
            );
        }
        text.push('\n');
        for finding in findings {
            let _ = writeln!(text, "  {}  {}", if finding.fine { "ok     " } else { "MISSING" }, finding.text);
        }
        text
    }
}

fn words(role: Role) -> &'static str {
    match role {
        Role::Sample => "samples",
        Role::Black => "black photographs",
        Role::AllLit => "all lamps, or all white",
        Role::Reference => "references",
        Role::Response => "series for the camera's response",
        Role::Dark => "series for the camera's black level",
        Role::WhiteBall => "white ball under a lamp",
        Role::FlatField => "white card under a lamp",
        Role::Chart => "colour chart",
        Role::Preview => "previews",
        Role::Calibration => "calibration patterns",
        Role::Picture => "pictures on the screen",
    }
}

/// As people say it: `3 h 12 min`, `40 s`.
pub fn duration(seconds: f64) -> String {
    let s = seconds.max(0.0).round() as u64;
    match (s / 3600, s / 60 % 60, s % 60) {
        (0, 0, s) => format!("{s} s"),
        (0, m, s) => format!("{m} min {s} s"),
        (h, m, _) => format!("{h} h {m} min"),
    }
}

/// Bytes in decimal units.
pub fn size(bytes: f64) -> String {
    match bytes {
        b if b < 1e6 => format!("{:.0} kB", b / 1e3),
        b if b < 1e9 => format!("{:.0} MB", b / 1e6),
        b => format!("{:.1} GB", b / 1e9),
    }
}
