//! `session.toml`: what captures, or was imported, here.

use std::fs;
use std::io::Write;
use std::path::Path;

use relume_core::files::write_whole;
use relume_core::{Error, Result};
use serde::{Deserialize, Serialize};

use crate::rigs::RigFile;

/// Version of the layout of session folders. Version 1 held imports alone and was never released.
pub const SESSION_VERSION: u32 = 2;
const FILE: &str = "session.toml";

/// What was decided when the session began; never changed afterwards.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Description {
    /// [`SESSION_VERSION`].
    pub version: u32,
    /// Tool and version that began it.
    pub tool: String,
    /// When, UTC, RFC 3339. For people: nothing depends on it.
    pub begun: String,
    /// Where photographs come from.
    pub source: Source,
}

/// Where photographs come from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Source {
    /// A rig, real or virtual.
    Capture(Box<CaptureDescription>),
    /// Files made elsewhere.
    Import(ImportDescription),
}

/// A capture.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CaptureDescription {
    /// Which conditions, in which order: `scan`, `noise`...
    pub sampler: String,
    /// Start of all random numbers.
    pub seed: u64,
    /// The rig file as it was.
    pub rig: RigFile,
}

impl CaptureDescription {
    /// Refuses a session that has the object in it where the bare screen is wanted; `place` names it.
    ///
    /// # Errors
    /// That.
    pub fn check_bare(&self, place: &Path) -> Result<()> {
        if self.sampler == "bare" {
            return Ok(());
        }
        let found = format!("a session of --sampler {}, with the object in it", self.sampler);
        Err(Error::invalid(place.display().to_string(), found, "one of the bare screen: `relume capture --bare`"))
    }
}

/// An import.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ImportDescription {
    /// `lp`, `exr` or `pairs`.
    pub kind: String,
    /// Columns of the photographs.
    pub width: usize,
    /// Rows of the photographs.
    pub height: usize,
    /// How codes of the photographs become light: `auto`, `srgb` or `linear`.
    pub encoding: String,
    /// Id of the colours of the photographs, once decoded.
    pub colour_space: String,
    /// What the kind of import has of its own: files (paths inside the session, with forward slashes), sizes, irradiance.
    #[serde(default, skip_serializing_if = "toml::Table::is_empty")]
    pub settings: toml::Table,
}

impl Description {
    /// A session that begins now.
    pub fn new(source: Source) -> Self {
        Self {
            version: SESSION_VERSION,
            tool: concat!("relume ", env!("CARGO_PKG_VERSION")).to_owned(),
            begun: jiff::Timestamp::now().strftime("%Y-%m-%dT%H:%M:%SZ").to_string(),
            source,
        }
    }

    /// Writes `session.toml` into a folder.
    ///
    /// # Errors
    /// The disk's.
    pub fn write(&self, root: &Path) -> Result<()> {
        let path = root.join(FILE);
        let fail = |source| Error::io("write", &path, source);
        let text = toml::to_string(self).map_err(|error| fail(std::io::Error::other(error)))?;
        write_whole(&path, |file| file.write_all(text.as_bytes()).map_err(fail))
    }

    /// Reads `session.toml` of a folder.
    ///
    /// # Errors
    /// No session; one of a newer layout, with the tool that made it; text that is not as this tool writes it.
    pub fn read(root: &Path) -> Result<Self> {
        let path = root.join(FILE);
        let place = path.display().to_string();
        if !path.is_file() {
            let found = if root.is_dir() { "no session.toml in it" } else { "no such folder" };
            let expected = "a session folder, as `relume capture` and `relume import` make them";
            return Err(Error::invalid(root.display().to_string(), found, expected));
        }
        let text = fs::read_to_string(&path).map_err(|source| Error::io("read", &path, source))?;
        let broken = |error: toml::de::Error| {
            Error::invalid(&place, one_line(&error), "a session description as `relume capture` writes it")
        };
        let table: toml::Table = text.parse().map_err(broken)?;
        let version = table.get("version").and_then(toml::Value::as_integer).unwrap_or_default();
        if version != i64::from(SESSION_VERSION) {
            let tool = table.get("tool").and_then(toml::Value::as_str).unwrap_or("another tool").to_owned();
            let advice = if version > i64::from(SESSION_VERSION) {
                "it was left as it is; use that version, or a newer one"
            } else {
                "import or capture again"
            };
            return Err(Error::Unsupported {
                place,
                what: format!("a session of layout {version} (made by {tool}; this is layout {SESSION_VERSION})"),
                advice: advice.to_owned(),
            });
        }
        toml::from_str(&text).map_err(broken)
    }
}

/// The message of a parser without its drawing of the line.
pub fn one_line(error: &toml::de::Error) -> String {
    error.message().replace('\n', " ")
}
