//! Errors: each says where, what was found, what was expected, and keeps its source.

use std::path::{Path, PathBuf};

/// Result of everything in this crate that can fail.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// What went wrong. Messages are whole sentences for the person at the tool; match on the kind, never on the text.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The operating system refused: missing file, full disk, no permission.
    #[error("cannot {action} {}: {source}", path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// What was tried, as a verb: "read", "write", "create".
        action: &'static str,
        /// The system's answer.
        source: std::io::Error,
    },
    /// Data that breaks its format or our conventions.
    #[error("{place}: found {found}, expected {expected}")]
    Invalid {
        /// File, and line, byte, pixel or entry.
        place: String,
        /// What is there.
        found: String,
        /// What should be there.
        expected: String,
    },
    /// Data that is fine but that this version cannot use.
    #[error("{place}: {what} is not supported; {advice}")]
    Unsupported {
        /// File and entry.
        place: String,
        /// The feature.
        what: String,
        /// What to do instead.
        advice: String,
    },
    /// The caller asked to stop.
    #[error("stopped on request")]
    Cancelled,
}

impl Error {
    /// Wraps an [`std::io::Error`] with its path and a verb.
    pub fn io(action: &'static str, path: impl AsRef<Path>, source: std::io::Error) -> Self {
        Self::Io { path: path.as_ref().to_owned(), action, source }
    }

    /// Data that breaks its format: place, found, expected.
    pub fn invalid(place: impl Into<String>, found: impl Into<String>, expected: impl Into<String>) -> Self {
        Self::Invalid { place: place.into(), found: found.into(), expected: expected.into() }
    }
}
