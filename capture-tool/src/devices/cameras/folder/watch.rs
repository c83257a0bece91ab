//! Files of a folder, and when each of them is whole.
//!
//! Where the system tells (`notify`), a file is whole when who wrote it has closed it, or has renamed it into the folder. Where it
//! does not tell of closing, or says nothing of a file at all (network shares), a file is whole when two looks find it the same.

use std::collections::{HashMap, HashSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::{Duration, Instant, SystemTime};

use notify::event::{AccessKind, AccessMode, EventKind, ModifyKind, RenameMode};
use notify::{RecommendedWatcher, RecursiveMode, Watcher};
use relume_core::Error;

use crate::devices::Trouble;
use crate::devices::cameras::delivery::file_kind;

/// Between two looks where the system tells, so that a request to stop is seen.
const LOOK: Duration = Duration::from_millis(50);
/// A file of whose closing nobody will tell is whole when it has not changed for so long.
const STEADY: Duration = Duration::from_secs(1);
/// Looks where the system cannot tell though it was to, seconds.
const FALLBACK_S: f64 = 0.5;

/// A folder that is watched.
pub struct Watch {
    folder: PathBuf,
    told: Option<Told>,
    /// Between two looks where nobody tells.
    poll: Duration,
    looked: Option<Instant>,
    files: HashMap<PathBuf, Look>,
}

struct Told {
    events: Receiver<notify::Result<notify::Event>>,
    /// Stops telling when it is dropped.
    _watcher: RecommendedWatcher,
}

/// A file, as it was last found.
#[derive(Debug, Clone)]
struct Look {
    bytes: u64,
    modified: Option<SystemTime>,
    /// It has been so since then, and was found so this often.
    since: Instant,
    times: u32,
    hand: Hand,
}

/// What was told of who writes a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
enum Hand {
    #[default]
    Unknown,
    Writing,
    Done,
}

impl Watch {
    /// Of a folder that is there. `poll_s` 0: the system tells, where it can.
    pub fn new(folder: &Path, poll_s: f64) -> Self {
        let told = if poll_s > 0.0 { None } else { tell(folder) };
        let poll = Duration::from_secs_f64(if poll_s > 0.0 { poll_s } else { FALLBACK_S });
        Self { folder: folder.to_path_buf(), told, poll, looked: None, files: HashMap::new() }
    }

    /// Between two looks, where the system does not tell.
    pub fn seconds(&self) -> Option<f64> {
        self.told.is_none().then_some(self.poll.as_secs_f64())
    }

    /// Stems of all files that are there now.
    ///
    /// # Errors
    /// A folder that cannot be read.
    pub fn stems(&self) -> Result<HashSet<String>, Trouble> {
        Ok(self.list()?.iter().map(|path| stem_of(path)).collect())
    }

    fn list(&self) -> Result<Vec<PathBuf>, Trouble> {
        let fail = |source| Error::io("read", &self.folder, source);
        let mut found = Vec::new();
        for entry in fs::read_dir(&self.folder).map_err(fail)? {
            let path = entry.map_err(fail)?.path();
            if file_kind(&path).is_some() {
                found.push(path);
            }
        }
        found.sort();
        Ok(found)
    }

    /// Files with other stems than those, whole. Where nobody tells, nothing is found between two looks.
    ///
    /// # Errors
    /// A folder that cannot be read.
    pub fn whole(&mut self, before: &HashSet<String>) -> Result<Vec<PathBuf>, Trouble> {
        if self.told.is_none() && self.looked.is_some_and(|looked| looked.elapsed() < self.poll) {
            return Ok(Vec::new());
        }
        self.looked = Some(Instant::now());
        // What is told of a file comes after the file: in this order nothing told is lost.
        self.hear();
        let new: Vec<PathBuf> = self.list()?.into_iter().filter(|path| !before.contains(&stem_of(path))).collect();
        self.files.retain(|path, _| new.contains(path));
        let mut whole = Vec::new();
        for path in new {
            // Gone again, or not readable yet.
            let Ok(now) = fs::metadata(&path) else { continue };
            let (bytes, modified) = (now.len(), now.modified().ok());
            let steady = if self.told.is_some() { STEADY } else { self.poll };
            let look = self.files.entry(path.clone()).or_insert_with(|| Look::new(bytes, modified));
            if (look.bytes, look.modified) == (bytes, modified) {
                look.times += 1;
            } else {
                *look = Look { hand: look.hand, ..Look::new(bytes, modified) };
            }
            let is_steady = look.times > 1 && look.since.elapsed() >= steady;
            let is_whole = match look.hand {
                Hand::Done => true,
                Hand::Writing => false,
                Hand::Unknown => is_steady,
            };
            if is_whole && bytes > 0 {
                whole.push(path);
            }
        }
        Ok(whole)
    }

    /// A file that is there and was not whole at the last look.
    pub fn growing(&self) -> Option<&Path> {
        self.files.keys().min().map(PathBuf::as_path)
    }

    /// Until the next look.
    pub fn wait(&mut self) {
        match &self.told {
            None => std::thread::sleep(self.poll.min(LOOK)),
            Some(told) => match told.events.recv_timeout(LOOK) {
                Ok(event) => self.take(event),
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => self.told = None,
            },
        }
    }

    /// All that was told by now.
    fn hear(&mut self) {
        while let Some(Ok(event)) = self.told.as_ref().map(|told| told.events.try_recv()) {
            self.take(event);
        }
    }

    fn take(&mut self, event: notify::Result<notify::Event>) {
        // What is lost is found by looking.
        let Ok(event) = event else { return };
        let hand = match event.kind {
            EventKind::Access(AccessKind::Close(AccessMode::Write)) => Hand::Done,
            EventKind::Modify(ModifyKind::Name(RenameMode::To)) => Hand::Done,
            EventKind::Modify(ModifyKind::Name(RenameMode::Both)) => Hand::Done,
            // Systems that tell of writing but not of closing leave it to looks.
            EventKind::Modify(ModifyKind::Data(_)) if TELLS_OF_CLOSING => Hand::Writing,
            _ => return,
        };
        for path in event.paths.into_iter().rev().take(1) {
            let look = self.files.entry(path).or_insert_with(|| Look::new(0, None));
            look.hand = hand;
        }
    }
}

/// inotify does.
const TELLS_OF_CLOSING: bool = cfg!(any(target_os = "linux", target_os = "android"));

impl Look {
    fn new(bytes: u64, modified: Option<SystemTime>) -> Self {
        Self { bytes, modified, since: Instant::now(), times: 1, hand: Hand::Unknown }
    }
}

/// None where the system cannot: then it is looked at again and again.
fn tell(folder: &Path) -> Option<Told> {
    let (sender, events) = channel();
    let mut watcher = notify::recommended_watcher(sender).ok()?;
    watcher.watch(folder, RecursiveMode::NonRecursive).ok()?;
    Some(Told { events, _watcher: watcher })
}

/// The name without its extension: what the files of one photograph share.
pub fn stem_of(path: &Path) -> String {
    path.file_stem().unwrap_or_default().to_string_lossy().into_owned()
}
