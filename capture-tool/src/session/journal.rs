//! `journal.jsonl`: one line a finished photograph, appended and synced.
//!
//! Only the end of the file can be torn: lines are appended by one process at a time, and each is synced before the next is
//! begun. So a last line that is cut off or is no JSON was never promised to anybody, and goes; a bad line before that is
//! damage, and is refused.

use std::fs::{File, OpenOptions};
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use relume_core::{Error, Result, hdr};
use serde::{Deserialize, Serialize};

use crate::rigs::Condition;

const FILE: &str = "journal.jsonl";
/// No rig has more lamps, patterns or stops.
const MOST: usize = 1_000_000_000;

/// A line of the journal.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Line {
    /// A photograph is whole in `photos/`.
    Photograph(Photograph),
    /// Exposure times were chosen from the previews, seconds, short to long.
    Series {
        /// For photographs of what: `sample` or `white-ball`.
        of: Role,
        /// Seconds.
        times_s: Vec<f64>,
    },
}

/// A finished photograph: a condition, seen at one exposure or several.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Photograph {
    /// Counted from 1: its folder in `photos/`.
    pub number: u64,
    /// Which step of the sampler it answers, from 0. Of several photographs of one step the last counts.
    pub step: u64,
    /// What was emitted.
    pub condition: Condition,
    /// What it is for.
    pub role: Role,
    /// The photograph it replaces.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub redo_of: Option<u64>,
    /// Files, short exposures first.
    pub frames: Vec<Frame>,
    /// What the camera made beside them, as the raw file of RAW + JPEG: kept, not read.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub beside: Vec<Frame>,
    /// When it was finished, UTC. For people: nothing depends on it, clocks jump.
    pub time: String,
    /// How long it took, by a clock that does not jump.
    pub seconds: f64,
    /// What the operator was told of it.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub remarks: Vec<String>,
}

impl Photograph {
    /// All files: those that count, then what lies beside them.
    pub fn files(&self) -> impl Iterator<Item = &Frame> {
        self.frames.iter().chain(&self.beside)
    }
}

/// What a photograph is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Role {
    /// A column of `T`, or a pattern's picture.
    Sample,
    /// Subtracted from the samples of its stop.
    Black,
    /// All lamps of a stop at once, for the check of linearity.
    AllLit,
    /// A condition that is repeated, to see movement and drift.
    Reference,
    /// A series of exposures, for the camera's response.
    Response,
    /// A series of exposures in the dark, for the camera's black level.
    Dark,
    /// A white ball, for the lamps' irradiances.
    WhiteBall,
    /// A white card, for what near lamps give each pixel.
    FlatField,
    /// A colour chart.
    Chart,
    /// Looked at to choose exposures.
    Preview,
    /// A calibration pattern: gray levels, stripes, Gray code.
    Calibration,
    /// A picture shown on a screen.
    Picture,
}

impl Role {
    /// Taken once a session, apart from the object's own samples.
    pub fn is_calibration(self) -> bool {
        matches!(
            self,
            Role::Response | Role::Dark | Role::WhiteBall | Role::FlatField | Role::Chart | Role::Calibration
        )
    }
}

/// One file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Frame {
    /// Path inside the session, with forward slashes.
    pub file: String,
    /// As the camera reported it; absent for imports without.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub exposure: Option<Exposure>,
    /// Length.
    pub bytes: u64,
    /// BLAKE3, hexadecimal.
    pub blake3: String,
}

/// Settings of a camera.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Exposure {
    /// Exposure time, seconds.
    pub time_s: f64,
    /// ISO speed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub iso: Option<f64>,
    /// F-number.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub f_number: Option<f64>,
}

impl From<Exposure> for hdr::Exposure {
    fn from(exposure: Exposure) -> Self {
        Self { time_s: exposure.time_s, iso: exposure.iso, f_number: exposure.f_number }
    }
}

/// The open journal.
#[derive(Debug)]
pub struct Journal {
    path: PathBuf,
    file: File,
    /// Bytes of whole lines.
    length: u64,
    lines: Vec<Line>,
}

impl Journal {
    /// Opens for appending (creating an empty one), clearing away a torn last line. Says whether there was one.
    ///
    /// # Errors
    /// The disk's; a bad line that is not the last.
    pub fn open(root: &Path) -> Result<(Self, bool)> {
        let path = root.join(FILE);
        let fail = |source| Error::io("open", &path, source);
        let mut file =
            OpenOptions::new().read(true).write(true).create(true).truncate(false).open(&path).map_err(fail)?;
        let mut bytes = Vec::new();
        file.read_to_end(&mut bytes).map_err(fail)?;
        let (lines, length) = parse(&bytes, &path)?;
        let torn = length < bytes.len() as u64;
        if torn {
            file.set_len(length).map_err(fail)?;
            file.sync_all().map_err(fail)?;
        }
        file.seek(SeekFrom::Start(length)).map_err(fail)?;
        Ok((Self { path, file, length, lines }, torn))
    }

    /// The lines as they are now, without touching the file.
    ///
    /// # Errors
    /// As [`Journal::open`].
    pub fn read(root: &Path) -> Result<Vec<Line>> {
        let path = root.join(FILE);
        let bytes = std::fs::read(&path).map_err(|source| Error::io("read", &path, source))?;
        Ok(parse(&bytes, &path)?.0)
    }

    /// All lines.
    pub fn lines(&self) -> &[Line] {
        &self.lines
    }

    /// Appends a line and syncs. When that fails, what was written of it is taken back.
    ///
    /// # Errors
    /// The disk's.
    pub fn append(&mut self, line: Line) -> Result<()> {
        let mut bytes = serde_json::to_vec(&line).map_err(|error| Error::io("write", &self.path, error.into()))?;
        bytes.push(b'\n');
        let written = self.file.write_all(&bytes).and_then(|()| self.file.sync_data());
        if let Err(source) = written {
            // If even this fails, the torn line is cleared away when the session is opened again.
            let _ = self.file.set_len(self.length).and_then(|()| self.file.seek(SeekFrom::Start(self.length)));
            return Err(Error::io("write", &self.path, source));
        }
        self.length += bytes.len() as u64;
        self.lines.push(line);
        Ok(())
    }
}

/// Whole lines, and how many bytes they take.
fn parse(bytes: &[u8], path: &Path) -> Result<(Vec<Line>, u64)> {
    let (mut lines, mut length) = (Vec::new(), 0);
    let pieces: Vec<&[u8]> = bytes.split_inclusive(|b| *b == b'\n').collect();
    for (n, piece) in pieces.iter().enumerate() {
        let parsed = piece.strip_suffix(b"\n").map(serde_json::from_slice::<Line>);
        match parsed {
            Some(Ok(line)) => lines.push(line),
            // Cut off, or blocks that the disk never filled.
            _ if n + 1 == pieces.len() => break,
            None => break,
            Some(Err(error)) => {
                let place = format!("{}, line {}", path.display(), n + 1);
                let expected = "a photograph's line; the journal was changed from outside: put the file back as it was";
                return Err(Error::invalid(place, error.to_string(), expected));
            }
        }
        length += piece.len() as u64;
    }
    check_numbers(&lines, path)?;
    Ok((lines, length))
}

/// Photographs are numbered 1, 2, 3... and their files lie in the session.
fn check_numbers(lines: &[Line], path: &Path) -> Result<()> {
    let photographs = lines.iter().filter_map(|line| match line {
        Line::Photograph(photograph) => Some(photograph),
        Line::Series { .. } => None,
    });
    for (photograph, number) in photographs.zip(1..) {
        let place = || format!("{}, photograph {}", path.display(), photograph.number);
        if photograph.number != number {
            return Err(Error::invalid(place(), "a number out of order", format!("photograph {number}")));
        }
        if photograph.condition.largest() > MOST {
            let found = format!("a condition numbered {}", photograph.condition.largest());
            return Err(Error::invalid(place(), found, format!("at most {MOST}")));
        }
        let outside = |frame: &&Frame| {
            Path::new(&frame.file).components().any(|part| !matches!(part, std::path::Component::Normal(_)))
        };
        if let Some(frame) = photograph.files().find(outside) {
            return Err(Error::invalid(place(), format!("the file `{}`", frame.file), "a path inside the session"));
        }
        if photograph.frames.is_empty() {
            return Err(Error::invalid(place(), "no file", "at least one exposure"));
        }
    }
    Ok(())
}
