//! Arrays that grow in temporary files.

use std::fs::File;
use std::io::{BufWriter, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use half::f16;

use crate::error::{Error, Result};
use crate::field::npy;
use crate::field::writer::Entries;
use crate::files::folder_of;

/// How much is copied at a time.
const CHUNK: usize = 4 << 20;

/// An array whose length is not known yet, in a nameless file of the folder that it will end in: it goes with the process,
/// however that ends.
#[derive(Debug)]
pub struct Spool {
    file: BufWriter<File>,
    /// The output that it is for; messages name it.
    output: PathBuf,
}

impl Spool {
    /// An empty one beside `output`.
    ///
    /// # Errors
    /// A folder that cannot be written to.
    pub fn beside(output: &Path) -> Result<Self> {
        let file = tempfile::tempfile_in(folder_of(output)).map_err(|source| Error::io("write", output, source))?;
        Ok(Self { file: BufWriter::with_capacity(1 << 20, file), output: output.to_owned() })
    }

    /// Appends bytes.
    ///
    /// # Errors
    /// A full disk.
    pub fn push(&mut self, bytes: &[u8]) -> Result<()> {
        self.file.write_all(bytes).map_err(|source| Error::io("write", &self.output, source))
    }

    /// Appends halves, little-endian.
    ///
    /// # Errors
    /// A full disk.
    pub fn halves(&mut self, numbers: &[f16]) -> Result<()> {
        let bytes: Vec<u8> = numbers.iter().flat_map(|number| number.to_le_bytes()).collect();
        self.push(&bytes)
    }

    /// Puts the array into a container.
    ///
    /// # Errors
    /// A full disk.
    pub fn write(self, out: &mut Entries<'_>, name: &str, descr: &str, shape: &[usize]) -> Result<()> {
        let fail = |source| Error::io("write", &self.output, source);
        let mut file = self.file.into_inner().map_err(|error| Error::io("write", &self.output, error.into_error()))?;
        file.seek(SeekFrom::Start(0)).map_err(fail)?;
        out.start(name)?;
        let mut hasher = blake3::Hasher::new();
        out.append(&npy::header(descr, shape), &mut hasher)?;
        let mut chunk = vec![0; CHUNK];
        loop {
            match file.read(&mut chunk).map_err(fail)? {
                0 => break,
                read => out.append(&chunk[..read], &mut hasher)?,
            }
        }
        out.end(name, &hasher);
        Ok(())
    }
}
