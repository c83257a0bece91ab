//! Folders that appear whole or not at all: written beside their place, renamed at the end.

use std::fs;
use std::path::{Path, PathBuf};

use relume_core::files::{check_folder, folder_of};
use relume_core::{Error, Result};

/// A folder that has not taken its name yet; dropping it removes it with all that is in it.
#[derive(Debug)]
pub struct NewFolder {
    folder: tempfile::TempDir,
    target: PathBuf,
}

impl NewFolder {
    /// An empty folder in the same place under a temporary name.
    ///
    /// # Errors
    /// A parent that cannot be written to.
    pub fn begin(target: &Path) -> Result<Self> {
        let parent = folder_of(target);
        let folder = tempfile::Builder::new().prefix(".relume-").suffix(".part").tempdir_in(parent);
        let folder = folder.map_err(|source| Error::io("create a folder in", parent, source))?;
        open_to_all(folder.path())?;
        Ok(Self { folder, target: target.to_owned() })
    }

    /// Where it is now: write here.
    pub fn path(&self) -> &Path {
        self.folder.path()
    }

    /// Gives the folder its name.
    ///
    /// # Errors
    /// Somebody has put something there meanwhile.
    pub fn commit(self) -> Result<PathBuf> {
        if self.target.is_dir() {
            // Empty, as `check` saw; not every system renames over a folder. Removing fails if it is not.
            fs::remove_dir(&self.target).map_err(|source| Error::io("replace", &self.target, source))?;
        }
        fs::rename(self.folder.path(), &self.target).map_err(|source| Error::io("create", &self.target, source))?;
        // Renamed: the temporary name must not be removed any more, should somebody take it.
        let _ = self.folder.keep();
        Ok(self.target)
    }
}

/// Checks that a folder can be created at `target`: absent or an empty folder, in a folder that exists. Ask before the work.
///
/// # Errors
/// Something is there already.
pub fn check(target: &Path) -> Result<()> {
    let place = || target.display().to_string();
    if target.is_dir() {
        let mut entries = fs::read_dir(target).map_err(|source| Error::io("read", target, source))?;
        return match entries.next() {
            None => Ok(()),
            Some(_) => Err(Error::invalid(place(), "a folder that is not empty", "a new or empty folder")),
        };
    }
    if target.exists() {
        return Err(Error::invalid(place(), "a file", "a new or empty folder"));
    }
    check_folder(target)
}

/// Temporary folders are private; ours become ordinary folders. The umask is not known here, so it takes its parent's
/// permissions.
fn open_to_all(folder: &Path) -> Result<()> {
    let fail = |source| Error::io("create", folder, source);
    let permissions = fs::metadata(folder_of(folder)).map_err(fail)?.permissions();
    fs::set_permissions(folder, permissions).map_err(fail)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_new_or_empty_folders_are_taken() {
        let folder = tempfile::tempdir().unwrap();
        let (empty, file) = (folder.path().join("empty"), folder.path().join("file"));
        fs::create_dir(&empty).unwrap();
        fs::write(&file, "").unwrap();
        check(&empty).unwrap();
        check(&folder.path().join("new")).unwrap();
        assert!(check(folder.path()).unwrap_err().to_string().contains("not empty"));
        assert!(check(&folder.path().join("absent/new")).unwrap_err().to_string().contains("does not exist"));
        assert!(check(&file).unwrap_err().to_string().contains("found a file"));
    }

    #[test]
    fn a_folder_appears_whole_or_not_at_all() {
        let parent = tempfile::tempdir().unwrap();
        let target = parent.path().join("target");
        let dropped = NewFolder::begin(&target).unwrap();
        fs::write(dropped.path().join("a"), "a").unwrap();
        drop(dropped);
        assert_eq!(fs::read_dir(parent.path()).unwrap().count(), 0);
        // An empty folder in the way is replaced.
        fs::create_dir(&target).unwrap();
        let folder = NewFolder::begin(&target).unwrap();
        fs::write(folder.path().join("a"), "a").unwrap();
        folder.commit().unwrap();
        assert_eq!(fs::read(target.join("a")).unwrap(), b"a");
        assert_eq!(fs::read_dir(parent.path()).unwrap().count(), 1);
    }
}
