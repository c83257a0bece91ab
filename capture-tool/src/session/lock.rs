//! One process at a time.
//!
//! The system's own lock on `session.lock`: it goes with the process, however that ends, so there are no stale ones. The file's
//! text tells the next one who has it.

use std::fs::{File, OpenOptions, TryLockError};
use std::io::{Read, Seek, Write};
use std::path::Path;

use relume_core::{Error, Result};

const FILE: &str = "session.lock";

/// Held while it lives.
#[derive(Debug)]
pub struct Lock {
    _file: File,
}

impl Lock {
    /// Takes the lock of a session.
    ///
    /// # Errors
    /// Another process has it: its id and when it started are in the message. A disk that knows no locks.
    pub fn take(root: &Path) -> Result<Self> {
        let path = root.join(FILE);
        let fail = |source| Error::io("lock", &path, source);
        let mut file =
            OpenOptions::new().read(true).write(true).create(true).truncate(false).open(&path).map_err(fail)?;
        match file.try_lock() {
            Ok(()) => {}
            Err(TryLockError::Error(source)) => return Err(fail(source)),
            Err(TryLockError::WouldBlock) => {
                let mut holder = String::new();
                let _ = file.read_to_string(&mut holder);
                let holder = if holder.trim().is_empty() { "another process" } else { holder.trim() };
                let expected = "a session that nobody captures into: wait for it, or stop it first";
                return Err(Error::invalid(root.display().to_string(), format!("{holder} at work in it"), expected));
            }
        }
        let now = jiff::Timestamp::now().strftime("%Y-%m-%d %H:%M:%S UTC");
        let text = format!("process {} (started {now})\n", std::process::id());
        let write = |file: &mut File| {
            file.set_len(0)?;
            file.rewind()?;
            file.write_all(text.as_bytes())?;
            file.flush()
        };
        write(&mut file).map_err(fail)?;
        Ok(Self { _file: file })
    }
}
