//! `capture.log`: a line a photograph, for people.

use std::fs::{File, OpenOptions};
use std::io::Write;
use std::path::Path;

use relume_core::{Error, Result};

/// The open log.
#[derive(Debug)]
pub struct Log {
    file: File,
}

impl Log {
    /// Appends to the log of a session.
    ///
    /// # Errors
    /// The disk's.
    pub fn open(root: &Path) -> Result<Self> {
        let path = root.join("capture.log");
        let file = OpenOptions::new().append(true).create(true).open(&path);
        Ok(Self { file: file.map_err(|source| Error::io("open", &path, source))? })
    }

    /// Writes a line. The log is a convenience: a disk that refuses it does not end the capture.
    pub fn line(&mut self, text: &str) {
        let now = jiff::Timestamp::now().strftime("%Y-%m-%d %H:%M:%S");
        let _ = writeln!(self.file, "{now}  {text}");
    }
}
