//! An open session folder.

use std::collections::{HashMap, HashSet};
use std::fs::{self, File};
use std::path::{Path, PathBuf};

use relume_core::files::{folder_of, sync_folder};
use relume_core::{Error, Result};

use super::description::Description;
use super::journal::{Exposure, Frame, Journal, Line, Photograph};
use super::lock::Lock;
use crate::new_folder::NewFolder;

/// Photographs whose files are hashed when a session is opened: those that a crash could have touched, with a margin. All are
/// looked for, with their lengths; `pack` hashes what it reads.
const HASHED: usize = 64;

/// A session that this process alone may add to.
#[derive(Debug)]
pub struct Session {
    root: PathBuf,
    journal: Journal,
    /// Numbers of photographs whose files are gone or changed.
    damaged: HashSet<u64>,
    _lock: Lock,
}

impl Session {
    /// Begins a session in a new or empty folder.
    ///
    /// # Errors
    /// Something is there already; the disk's.
    pub fn create(root: &Path, description: Description) -> Result<Self> {
        let folder = NewFolder::begin(root)?;
        description.write(folder.path())?;
        for name in ["photos", "calibration"] {
            let path = folder.path().join(name);
            fs::create_dir(&path).map_err(|source| Error::io("create", &path, source))?;
        }
        Journal::open(folder.path())?;
        folder.commit()?;
        sync_folder(folder_of(root))?;
        Self::open(root)
    }

    /// Opens a session to go on with it: clears away what a killed process left half done, and looks for the files of all
    /// photographs.
    ///
    /// # Errors
    /// No session, a newer one, one that another process has open, a damaged journal.
    pub fn open(root: &Path) -> Result<Self> {
        Description::read(root)?;
        let lock = Lock::take(root)?;
        let (journal, _torn) = Journal::open(root)?;
        let mut session = Self { root: root.to_owned(), journal, damaged: HashSet::new(), _lock: lock };
        session.sweep()?;
        session.damaged = damaged(root, &session.photographs().cloned().collect::<Vec<_>>());
        Ok(session)
    }

    /// The folder.
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// All lines of the journal.
    pub fn lines(&self) -> &[Line] {
        self.journal.lines()
    }

    /// Photographs in order, replaced and damaged ones too.
    pub fn photographs(&self) -> impl Iterator<Item = &Photograph> {
        photographs(self.journal.lines())
    }

    /// The photograph that answers a step: the last one, if its files are whole.
    pub fn answer(&self, step: u64) -> Option<&Photograph> {
        self.photographs().filter(|p| p.step == step).last().filter(|p| !self.damaged.contains(&p.number))
    }

    /// Photographs whose files are gone or changed and that no later one has replaced, in order.
    pub fn damaged(&self) -> Vec<&Photograph> {
        let last: HashMap<u64, u64> = self.photographs().map(|p| (p.step, p.number)).collect();
        self.photographs().filter(|p| self.damaged.contains(&p.number) && last[&p.step] == p.number).collect()
    }

    /// Begins the next photograph.
    ///
    /// # Errors
    /// The disk's.
    pub fn begin(&self) -> Result<PhotoFolder> {
        let number = self.photographs().count() as u64 + 1;
        let path = self.root.join("photos").join(format!(".{number:06}.part"));
        let fail = |source| Error::io("create", &path, source);
        if path.exists() {
            fs::remove_dir_all(&path).map_err(fail)?;
        }
        fs::create_dir(&path).map_err(fail)?;
        Ok(PhotoFolder { path, number, kept: false })
    }

    /// Makes a photograph part of the session: its files are synced, get their name, and the journal its line. `files` are
    /// those in the folder that count, with their exposures, `beside` the others; the numbers and files of `photograph` are filled in here.
    ///
    /// # Errors
    /// The disk's. Then the photograph is not part of the session.
    pub fn finish(
        &mut self,
        mut folder: PhotoFolder,
        files: &[(PathBuf, Exposure)],
        beside: &[PathBuf],
        mut photograph: Photograph,
    ) -> Result<()> {
        let name = format!("{:06}", folder.number);
        photograph.number = folder.number;
        photograph.frames =
            files.iter().map(|(path, exposure)| frame(path, &name, Some(*exposure))).collect::<Result<_>>()?;
        photograph.beside = beside.iter().map(|path| frame(path, &name, None)).collect::<Result<_>>()?;
        sync_folder(&folder.path)?;
        let photos = self.root.join("photos");
        let to = photos.join(&name);
        fs::rename(&folder.path, &to).map_err(|source| Error::io("rename to", &to, source))?;
        (folder.path, folder.kept) = (to, true);
        sync_folder(&photos)?;
        let appended = self.journal.append(Line::Photograph(photograph));
        if appended.is_err() {
            // Not promised, so not kept.
            folder.kept = false;
        }
        appended
    }

    /// Adds a line that is not a photograph's.
    ///
    /// # Errors
    /// The disk's.
    pub fn append(&mut self, line: Line) -> Result<()> {
        self.journal.append(line)
    }

    /// Removes photographs in flight: unfinished folders, and the one folder that had its name but not yet its line.
    fn sweep(&self) -> Result<()> {
        let photos = self.root.join("photos");
        let next = format!("{:06}", self.photographs().count() + 1);
        let fail = |source| Error::io("read", &photos, source);
        for entry in fs::read_dir(&photos).map_err(fail)? {
            let path = entry.map_err(fail)?.path();
            let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
            if name == next || (name.starts_with('.') && name.ends_with(".part")) {
                fs::remove_dir_all(&path).map_err(|source| Error::io("remove", &path, source))?;
            }
        }
        Ok(())
    }
}

/// The photographs of a journal, in order.
pub fn photographs(lines: &[Line]) -> impl Iterator<Item = &Photograph> {
    lines.iter().filter_map(|line| match line {
        Line::Photograph(photograph) => Some(photograph),
        Line::Series { .. } => None,
    })
}

/// A photograph in flight: gone when dropped before it is finished.
#[derive(Debug)]
pub struct PhotoFolder {
    path: PathBuf,
    number: u64,
    kept: bool,
}

impl PhotoFolder {
    /// Where to put the files.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Counted from 1.
    pub fn number(&self) -> u64 {
        self.number
    }
}

impl Drop for PhotoFolder {
    fn drop(&mut self) {
        if !self.kept {
            // What cannot be removed now is swept when the session is opened again.
            let _ = fs::remove_dir_all(&self.path);
        }
    }
}

/// Syncs and hashes a file that will lie in `photos/NAME/`.
fn frame(path: &Path, name: &str, exposure: Option<Exposure>) -> Result<Frame> {
    File::open(path).and_then(|file| file.sync_all()).map_err(|source| Error::io("sync", path, source))?;
    let (bytes, blake3) = file_hash(path)?;
    let file = format!("photos/{name}/{}", path.file_name().unwrap_or_default().to_string_lossy());
    Ok(Frame { file, exposure, bytes, blake3 })
}

/// Length and BLAKE3 (hexadecimal) of a file.
///
/// # Errors
/// A file that cannot be read.
pub fn file_hash(path: &Path) -> Result<(u64, String)> {
    let mut hasher = blake3::Hasher::new();
    let file = File::open(path).map_err(|source| Error::io("read", path, source))?;
    hasher.update_reader(file).map_err(|source| Error::io("read", path, source))?;
    Ok((hasher.count(), hasher.finalize().to_hex().to_string()))
}

/// Photographs whose files are not there at their length, and, among the last ones, not with their hash.
fn damaged(root: &Path, photographs: &[Photograph]) -> HashSet<u64> {
    let hashed_from = photographs.len().saturating_sub(HASHED);
    let whole = |n: usize, frame: &Frame| {
        let path = root.join(&frame.file);
        let length = fs::metadata(&path).map(|m| m.len()).ok();
        length == Some(frame.bytes)
            && (n < hashed_from || file_hash(&path).is_ok_and(|(_, blake3)| blake3 == frame.blake3))
    };
    let is_damaged = |(n, p): (usize, &Photograph)| (!p.files().all(|f| whole(n, f))).then_some(p.number);
    photographs.iter().enumerate().filter_map(is_damaged).collect()
}
