//! Open files, shared between instances.
//!
//! A [`Shelf`] opens each file once, however many instances and threads ask at the same time, and a changed file anew.
//! The instances own what they use, so it goes with the last of them; the shelf itself keeps only the few it was asked
//! for last, because some hosts make a fresh instance for every frame.

use std::collections::{HashMap, VecDeque};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};
use std::time::SystemTime;

use relume_core::Error as CoreError;

use crate::error::Result;

/// How many files a shelf keeps open without an owner.
const KEPT: usize = 2;

/// Tells one state of a file from another.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub struct Stamp {
    path: PathBuf,
    bytes: u64,
    modified: Option<SystemTime>,
}

impl Stamp {
    /// Looks at a file; links are followed, so two names of one file share.
    ///
    /// # Errors
    /// The file is missing or may not be read.
    pub fn of(path: &Path) -> Result<Self> {
        let fail = |source| CoreError::io("read", path, source);
        let canonical = path.canonicalize().map_err(fail)?;
        let about = canonical.metadata().map_err(fail)?;
        Ok(Self { path: canonical, bytes: about.len(), modified: about.modified().ok() })
    }
}

/// A place where one file is opened by one thread while others wait.
type Slot<T> = Arc<Mutex<Weak<T>>>;

/// Files of one kind, open.
#[derive(Debug)]
pub struct Shelf<T> {
    state: Mutex<State<T>>,
}

#[derive(Debug)]
struct State<T> {
    slots: HashMap<Stamp, Slot<T>>,
    /// Asked for last, latest first.
    recent: VecDeque<(Stamp, Arc<T>)>,
}

impl<T> Default for Shelf<T> {
    fn default() -> Self {
        Self { state: Mutex::new(State { slots: HashMap::new(), recent: VecDeque::new() }) }
    }
}

impl<T> Shelf<T> {
    /// The open file; `open` runs when nobody has it open.
    ///
    /// # Errors
    /// Whatever `open` meets; the next caller tries again.
    pub fn get(&self, stamp: &Stamp, open: impl FnOnce() -> Result<T>) -> Result<Arc<T>> {
        let slot = Arc::clone(self.lock().slots.entry(stamp.clone()).or_default());
        let value = {
            let mut held = slot.lock().unwrap_or_else(PoisonError::into_inner);
            match held.upgrade() {
                Some(value) => value,
                None => {
                    let value = Arc::new(open()?);
                    *held = Arc::downgrade(&value);
                    value
                }
            }
        };
        drop(slot);
        let dropped = self.lock().keep(stamp, &value);
        // Closing a large file takes time: not under the lock.
        drop(dropped);
        Ok(value)
    }

    /// Makes the next caller open the file again, even if it looks the same.
    pub fn forget(&self, path: &Path) {
        let Ok(path) = path.canonicalize() else { return };
        let mut state = self.lock();
        state.slots.retain(|stamp, _| stamp.path != path);
        let kept = std::mem::take(&mut state.recent).into_iter().partition(|(stamp, _)| stamp.path != path);
        let (kept, dropped): (VecDeque<_>, VecDeque<_>) = kept;
        state.recent = kept;
        drop(state);
        drop(dropped);
    }

    /// Lets go of everything that no instance owns.
    pub fn clear(&self) {
        let dropped = std::mem::take(&mut self.lock().recent);
        drop(dropped);
        self.lock().slots.retain(|_, slot| in_use(slot));
    }

    fn lock(&self) -> MutexGuard<'_, State<T>> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl<T> State<T> {
    /// Puts a file in front; returns what falls off the end.
    fn keep(&mut self, stamp: &Stamp, value: &Arc<T>) -> Vec<(Stamp, Arc<T>)> {
        let mut dropped: Vec<_> = match self.recent.iter().position(|(s, _)| s == stamp) {
            Some(at) => self.recent.remove(at).into_iter().collect(),
            None => Vec::new(),
        };
        self.recent.push_front((stamp.clone(), Arc::clone(value)));
        let end = self.recent.len().min(KEPT);
        dropped.extend(self.recent.drain(end..));
        self.slots.retain(|_, slot| in_use(slot));
        dropped
    }
}

/// Does anybody own the file, or wait for it to be opened?
fn in_use<T>(slot: &Slot<T>) -> bool {
    Arc::strong_count(slot) > 1 || slot.try_lock().map_or(true, |held| held.strong_count() > 0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicUsize, Ordering};

    fn file(folder: &Path, name: &str, text: &str) -> PathBuf {
        let path = folder.join(name);
        std::fs::write(&path, text).unwrap();
        path
    }

    fn text(shelf: &Shelf<String>, path: &Path) -> Result<Arc<String>> {
        shelf
            .get(&Stamp::of(path)?, || std::fs::read_to_string(path).map_err(|e| CoreError::io("read", path, e).into()))
    }

    #[test]
    fn threads_that_ask_at_once_share_one_opening() {
        let folder = tempfile::tempdir().unwrap();
        let stamp = Stamp::of(&file(folder.path(), "a", "x")).unwrap();
        let (shelf, opened) = (Shelf::default(), AtomicUsize::new(0));
        let ask = || {
            shelf.get(&stamp, || {
                std::thread::sleep(std::time::Duration::from_millis(30));
                Ok(opened.fetch_add(1, Ordering::SeqCst))
            })
        };
        let values: Vec<_> = std::thread::scope(|scope| {
            let threads: Vec<_> = (0..8).map(|_| scope.spawn(ask)).collect();
            threads.into_iter().map(|t| t.join().unwrap().unwrap()).collect()
        });
        assert_eq!(opened.load(Ordering::SeqCst), 1);
        assert!(values.iter().all(|v| Arc::ptr_eq(v, &values[0])));
    }

    #[test]
    fn a_changed_file_is_opened_anew_and_an_equal_one_shared() {
        let folder = tempfile::tempdir().unwrap();
        let path = file(folder.path(), "a", "one");
        let shelf = Shelf::default();
        let first = text(&shelf, &path).unwrap();
        let other_name = folder.path().join("./a");
        assert!(Arc::ptr_eq(&first, &text(&shelf, &other_name).unwrap()));
        file(folder.path(), "a", "three");
        assert_eq!(*text(&shelf, &path).unwrap(), "three");
        assert_eq!(*first, "one", "whoever holds the old one keeps it");
    }

    #[test]
    fn the_last_owner_and_the_shelf_let_go() {
        let folder = tempfile::tempdir().unwrap();
        let paths: Vec<_> = ["a", "b", "c"].map(|n| file(folder.path(), n, n)).into();
        let shelf = Shelf::default();
        let weak: Vec<_> = paths.iter().map(|p| Arc::downgrade(&text(&shelf, p).unwrap())).collect();
        let alive = || weak.iter().map(|w| w.strong_count()).collect::<Vec<_>>();
        assert_eq!(alive(), [0, 1, 1], "the last two are kept without an owner");
        let owner = text(&shelf, &paths[2]).unwrap();
        shelf.clear();
        assert_eq!(alive(), [0, 0, 1], "an owned one stays");
        drop(owner);
        assert_eq!(alive(), [0, 0, 0]);
        shelf.clear();
        assert!(shelf.lock().slots.is_empty());
    }

    #[test]
    fn forgetting_opens_again_and_an_error_is_not_kept() {
        let folder = tempfile::tempdir().unwrap();
        let path = file(folder.path(), "a", "one");
        let shelf = Shelf::default();
        let first = text(&shelf, &path).unwrap();
        shelf.forget(&path);
        let second = text(&shelf, &path).unwrap();
        assert!(!Arc::ptr_eq(&first, &second));
        let stamp = Stamp::of(&file(folder.path(), "bad", "x")).unwrap();
        let failing = shelf.get(&stamp, || Err(crate::error::Error::Missing("no")));
        assert!(failing.is_err());
        assert_eq!(*shelf.get(&stamp, || Ok("yes".to_owned())).unwrap(), "yes");
        let message = Stamp::of(&folder.path().join("none.rfield")).unwrap_err().to_string();
        assert!(message.contains("none.rfield"), "{message}");
    }
}
