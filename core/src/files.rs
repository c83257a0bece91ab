//! Files that appear whole or not at all.
//!
//! Every output is written to a temporary file in its own folder, synced and renamed, so that a killed process, a full
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
    let folder = folder_of(path);
    if !folder.is_dir() {
        let absent = std::io::Error::new(
            std::io::ErrorKind::NotFound,
            format!("the folder {} does not exist", folder.display()),
        );
        return Err(Error::io("write", path, absent));
    }
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
    Ok(value)
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
