//! Files by typed path. An instance holds what it used last; whoever asks for the same file shares it.
//!
//! Files are read on our own threads ([`Pool`]), for reading can use rayon; locks are taken on the host's thread alone.

use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

use crate::error::Result;
use crate::paths;
use crate::pool::Pool;
use crate::registry::{Shelf, Stamp};

/// The file that an instance used last; it stays open with it.
#[derive(Debug)]
pub struct Held<T>(Mutex<Option<Arc<T>>>);

impl<T> Default for Held<T> {
    fn default() -> Self {
        Self(Mutex::default())
    }
}

impl<T> Held<T> {
    fn put(&self, value: Option<Arc<T>>) {
        let before = std::mem::replace(&mut *self.0.lock().unwrap_or_else(PoisonError::into_inner), value);
        // Closing a large file takes time: not under the lock.
        drop(before);
    }
}

/// The file of a typed path, open.
///
/// # Errors
/// A path that cannot be used; whatever `read` refuses.
pub fn open<T: Send + Sync>(
    shelf: &Shelf<T>,
    held: &Held<T>,
    typed: &str,
    read: impl FnOnce(&Path) -> Result<T> + Send,
) -> Result<Arc<T>> {
    let path = paths::expand(typed)?;
    let value = shelf.get(&Stamp::of(&path)?, || Pool::shared()?.run(|| read(&path)))?;
    held.put(Some(Arc::clone(&value)));
    Ok(value)
}

/// Makes the next picture open the file of a typed path again.
pub fn forget<T>(shelf: &Shelf<T>, held: &Held<T>, typed: &str) {
    held.put(None);
    if let Ok(path) = paths::expand(typed) {
        shelf.forget(&path);
    }
}

/// The last part of a typed path, for the status line.
pub fn file_name(typed: &str) -> String {
    paths::expand(typed)
        .ok()
        .as_deref()
        .and_then(Path::file_name)
        .map_or_else(|| typed.to_owned(), |name| name.to_string_lossy().into_owned())
}
