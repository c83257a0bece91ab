//! How the bytes of a container arrive.

use std::fs::File;
use std::path::{Path, PathBuf};

use memmap2::Mmap;

use super::mapping;
use crate::error::{Error, Result};

/// The choice of how bytes arrive.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Hash)]
pub enum Access {
    /// Memory-mapped: fastest, shared between processes.
    #[default]
    Mapped,
    /// Read when needed, for network disks and files that somebody may truncate.
    Read,
}

/// An open file, mapped or read.
#[derive(Debug)]
pub(super) struct Store {
    path: PathBuf,
    length: u64,
    bytes: Bytes,
}

#[derive(Debug)]
enum Bytes {
    Mapped(Mmap),
    Read(File),
}

impl Store {
    /// Opens a file.
    pub fn open(path: &Path, access: Access) -> Result<Self> {
        let fail = |source| Error::io("open", path, source);
        let file = File::open(path).map_err(fail)?;
        let metadata = file.metadata().map_err(fail)?;
        if !metadata.is_file() {
            return Err(Error::invalid(path.display().to_string(), "something that is not a file", "a .rfield file"));
        }
        let length = metadata.len();
        let bytes = match access {
            Access::Mapped if length > 0 => Bytes::Mapped(mapping::map(&file).map_err(fail)?),
            _ => Bytes::Read(file),
        };
        Ok(Self { path: path.to_owned(), length, bytes })
    }

    /// Where it lies.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Bytes in the file when it was opened.
    pub fn length(&self) -> u64 {
        self.length
    }

    /// `length` bytes from `offset`: borrowed from the map, or read into `scratch` (16-byte aligned).
    pub fn get<'a>(&'a self, offset: u64, length: usize, scratch: &'a mut Scratch) -> Result<&'a [u8]> {
        let end = offset.checked_add(length as u64).filter(|&end| end <= self.length);
        if end.is_none() {
            let found = format!("{} bytes", self.length);
            return Err(Error::invalid(
                self.path.display().to_string(),
                found,
                format!("at least {offset} + {length}"),
            ));
        }
        match &self.bytes {
            Bytes::Mapped(map) => Ok(&map[offset as usize..offset as usize + length]),
            Bytes::Read(file) => {
                let bytes = scratch.take(length);
                read_exact_at(file, bytes, offset).map_err(|source| Error::io("read", &self.path, source))?;
                Ok(bytes)
            }
        }
    }
}

/// A buffer that keeps its allocation between reads, aligned for every number type.
#[derive(Debug, Default)]
pub(super) struct Scratch(Vec<u128>);

impl Scratch {
    fn take(&mut self, length: usize) -> &mut [u8] {
        self.0.resize(length.div_ceil(16), 0);
        &mut bytemuck::cast_slice_mut(&mut self.0)[..length]
    }
}

#[cfg(unix)]
fn read_exact_at(file: &File, bytes: &mut [u8], offset: u64) -> std::io::Result<()> {
    std::os::unix::fs::FileExt::read_exact_at(file, bytes, offset)
}

#[cfg(windows)]
fn read_exact_at(file: &File, mut bytes: &mut [u8], mut offset: u64) -> std::io::Result<()> {
    use std::os::windows::fs::FileExt;
    while !bytes.is_empty() {
        match file.seek_read(bytes, offset)? {
            0 => return Err(std::io::ErrorKind::UnexpectedEof.into()),
            n => {
                bytes = &mut bytes[n..];
                offset += n as u64;
            }
        }
    }
    Ok(())
}
