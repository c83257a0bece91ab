//! Where an archive is written to, silent once the writing has failed.
//!
//! `zip`'s writer completes its archive when it is dropped and complains on stderr if it cannot. A library never prints, and
//! the file is about to be removed anyway: after the first failure nothing is written any more, and nothing fails.

use std::cell::Cell;
use std::io::{Error, ErrorKind, Result, Seek, SeekFrom, Write};

/// Passes on to `inner` until `failed` is set, by an error of its own or by its owner; from then on it only counts.
pub(super) struct Sink<'a, W> {
    inner: W,
    failed: &'a Cell<bool>,
    at: u64,
    end: u64,
}

impl<'a, W: Write + Seek> Sink<'a, W> {
    /// `inner` is empty.
    pub fn new(inner: W, failed: &'a Cell<bool>) -> Self {
        Self { inner, failed, at: 0, end: 0 }
    }

    fn pass<T>(&mut self, call: impl FnOnce(&mut W) -> Result<T>, otherwise: T) -> Result<T> {
        if self.failed.get() {
            return Ok(otherwise);
        }
        let result = call(&mut self.inner);
        // An interrupted call is tried again by the caller; it has failed nothing.
        if result.as_ref().is_err_and(|error| error.kind() != ErrorKind::Interrupted) {
            self.failed.set(true);
        }
        result
    }
}

impl<W: Write + Seek> Write for Sink<'_, W> {
    fn write(&mut self, bytes: &[u8]) -> Result<usize> {
        let written = self.pass(|inner| inner.write(bytes), bytes.len())?;
        self.at += written as u64;
        self.end = self.end.max(self.at);
        Ok(written)
    }

    fn flush(&mut self) -> Result<()> {
        self.pass(Write::flush, ())
    }
}

impl<W: Write + Seek> Seek for Sink<'_, W> {
    fn seek(&mut self, to: SeekFrom) -> Result<u64> {
        let target = match to {
            SeekFrom::Start(at) => Some(at),
            SeekFrom::Current(by) => self.at.checked_add_signed(by),
            SeekFrom::End(by) => self.end.checked_add_signed(by),
        };
        let target = target.ok_or_else(|| Error::from(ErrorKind::InvalidInput))?;
        self.at = self.pass(|inner| inner.seek(to), target)?;
        Ok(self.at)
    }
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use super::*;

    #[test]
    fn a_failed_sink_counts_on_in_silence() {
        let failed = Cell::new(false);
        let mut bytes = [0u8; 4];
        let mut sink = Sink::new(Cursor::new(&mut bytes[..]), &failed);
        sink.write_all(b"abc").unwrap();
        assert_eq!(sink.seek(SeekFrom::Start(1)).unwrap(), 1);
        sink.write_all(b"x").unwrap();
        // The cursor's end is the slice's.
        assert_eq!((sink.seek(SeekFrom::End(0)).unwrap(), failed.get()), (4, false));
        failed.set(true);
        sink.write_all(b"far beyond the end").unwrap();
        assert_eq!(sink.stream_position().unwrap(), 22);
        assert_eq!(sink.seek(SeekFrom::End(-2)).unwrap(), 20);
        sink.flush().unwrap();
        assert_eq!(&bytes, b"axc\0");
    }

    #[test]
    fn the_first_failure_is_told() {
        struct Full;
        impl Write for Full {
            fn write(&mut self, _: &[u8]) -> Result<usize> {
                Err(ErrorKind::StorageFull.into())
            }
            fn flush(&mut self) -> Result<()> {
                Ok(())
            }
        }
        impl Seek for Full {
            fn seek(&mut self, _: SeekFrom) -> Result<u64> {
                Ok(0)
            }
        }
        let failed = Cell::new(false);
        let mut sink = Sink::new(Full, &failed);
        assert_eq!(sink.write(b"a").unwrap_err().kind(), ErrorKind::StorageFull);
        assert!(failed.get());
        sink.write_all(b"a").unwrap();
    }
}
