//! Files that appear whole or not at all.
//!
//! Every output is written to a temporary file in its own folder, synced and renamed, and the folder synced, so that a killed process, a full
//! disk or a second reader never meets half a file.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

use crate::error::{Error, Result};

/// Writes `path` through `body`: temporary file in the same folder, flush, sync, rename. On any error the target is
/// untouched and the temporary file is gone.
///
/// # Errors
/// [`Error::Io`] when the folder is absent or full; whatever `body` returns.
pub fn write_whole<T>(path: &Path, body: impl FnOnce(&mut BufWriter<File>) -> Result<T>) -> Result<T> {
    check_folder(path)?;
    let folder = folder_of(path);
    let temporary = tempfile::Builder::new()
        .prefix(".relume-")
        .suffix(".part")
        .permissions_like_umask()
        .tempfile_in(folder)
        .map_err(|source| Error::io("write", path, source))?;
    let (file, temporary_path) = temporary.into_parts();
    let mut writer = BufWriter::with_capacity(1 << 20, file);
    let value = body(&mut writer)?;
    writer.flush().map_err(|source| Error::io("write", path, source))?;
    let file = writer.into_inner().map_err(|error| Error::io("write", path, error.into_error()))?;
    file.sync_all().map_err(|source| Error::io("write", path, source))?;
    temporary_path.persist(path).map_err(|error| Error::io("rename to", path, error.error))?;
    sync_folder(folder)?;
    Ok(value)
}

/// Makes the names in a folder durable: after a file was created, renamed or removed in it.
///
/// # Errors
/// [`Error::Io`] naming the folder. Systems that cannot open folders have nothing to sync.
pub fn sync_folder(folder: &Path) -> Result<()> {
    if cfg!(unix) {
        File::open(folder).and_then(|f| f.sync_all()).map_err(|source| Error::io("sync", folder, source))?;
    }
    Ok(())
}

/// Checks that `path` can become a file: its folder exists, and it is no folder itself. Ask before an hour of work.
///
/// # Errors
/// [`Error::Io`] naming the path.
pub fn check_folder(path: &Path) -> Result<()> {
    let refuse = |kind, why: String| Err(Error::io("write", path, std::io::Error::new(kind, why)));
    let folder = folder_of(path);
    if !folder.is_dir() {
        return refuse(std::io::ErrorKind::NotFound, format!("the folder {} does not exist", folder.display()));
    }
    if path.is_dir() {
        return refuse(std::io::ErrorKind::IsADirectory, "it is a folder".to_owned());
    }
    Ok(())
}

/// The folder a file lies in; `.` for a bare name.
pub fn folder_of(path: &Path) -> &Path {
    match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    }
}

/// Temporary files are private by default; ours become ordinary files, so they take the permissions of one.
trait PermissionsLikeUmask {
    fn permissions_like_umask(&mut self) -> &mut Self;
}

impl PermissionsLikeUmask for tempfile::Builder<'_, '_> {
    #[cfg(unix)]
    fn permissions_like_umask(&mut self) -> &mut Self {
        use std::os::unix::fs::PermissionsExt;
        // The kernel applies the umask to this mode, as for any newly created file.
        self.permissions(std::fs::Permissions::from_mode(0o666))
    }

    #[cfg(not(unix))]
    fn permissions_like_umask(&mut self) -> &mut Self {
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect()
    }

    #[test]
    fn a_finished_body_replaces_the_target() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        std::fs::write(&path, "old").unwrap();
        let value = write_whole(&path, |w| {
            w.write_all(b"new").map_err(|e| Error::io("write", &path, e))?;
            Ok(7)
        });
        assert_eq!(value.unwrap(), 7);
        assert_eq!(std::fs::read(&path).unwrap(), b"new");
        assert_eq!(names(folder.path()), ["a.txt"]);
    }

    #[test]
    fn a_failed_body_leaves_the_target_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        std::fs::write(&path, "old").unwrap();
        let result: Result<()> = write_whole(&path, |w| {
            w.write_all(&[0; 1 << 21]).map_err(|e| Error::io("write", &path, e))?;
            Err(Error::Cancelled)
        });
        assert!(matches!(result, Err(Error::Cancelled)));
        assert_eq!(std::fs::read(&path).unwrap(), b"old");
        assert_eq!(names(folder.path()), ["a.txt"]);
    }

    #[test]
    fn a_panicking_body_leaves_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        let caught = std::panic::catch_unwind(|| write_whole::<()>(&path, |_| panic!("a bug in the body")));
        assert!(caught.is_err());
        assert!(names(folder.path()).is_empty());
    }

    #[test]
    fn an_absent_folder_is_named_and_not_made() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("no/such/a.txt");
        let message = write_whole(&path, |_| Ok(())).unwrap_err().to_string();
        assert!(message.contains("a.txt") && message.contains("does not exist"), "{message}");
        assert!(names(folder.path()).is_empty());
    }

    #[test]
    fn a_folder_in_the_way_is_refused_and_nothing_is_left() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("taken");
        std::fs::create_dir(&path).unwrap();
        assert!(matches!(write_whole(&path, |_| Ok(())), Err(Error::Io { .. })));
        assert_eq!(names(folder.path()), ["taken"]);
    }

    #[cfg(unix)]
    #[test]
    fn a_new_file_has_the_permissions_of_any_new_file() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().unwrap();
        let (ours, plain) = (folder.path().join("ours"), folder.path().join("plain"));
        write_whole(&ours, |_| Ok(())).unwrap();
        std::fs::write(&plain, "").unwrap();
        let mode = |path: &Path| std::fs::metadata(path).unwrap().permissions().mode() & 0o777;
        assert_eq!(mode(&ours), mode(&plain));
    }

    #[test]
    fn bare_names_lie_in_the_current_folder() {
        assert_eq!(folder_of(Path::new("a.exr")), Path::new("."));
        assert_eq!(folder_of(Path::new("x/a.exr")), Path::new("x"));
        assert_eq!(folder_of(Path::new("/a.exr")), Path::new("/"));
    }
}
