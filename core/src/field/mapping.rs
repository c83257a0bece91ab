//! Memory mapping: the one fenced use of it.
//!
//! A mapped file that somebody truncates in place kills the process (SIGBUS). Our writers always rename, so a reader
//! keeps the old file; network disks use [`super::Access::Read`].

use std::fs::File;
use std::io;

use memmap2::Mmap;

/// Maps a whole file for reading.
#[allow(unsafe_code)]
pub(super) fn map(file: &File) -> io::Result<Mmap> {
    // SAFETY: the map is read-only and private to us. That nobody changes the file under it is the convention above,
    // which no program can enforce; bytes that do change are numbers, never lengths or offsets: those were read and
    // checked once, at opening.
    unsafe { Mmap::map(file) }
}
