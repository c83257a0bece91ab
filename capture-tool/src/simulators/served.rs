//! A board on a pseudo-terminal, in a thread of its own.

use std::io::{self, ErrorKind, Read, Write};
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use serialport::{SerialPort, TTYPort};

use super::mischief::{Mischief, Strike};

/// A request to end is looked for so often.
const LOOK: Duration = Duration::from_millis(20);
/// While nobody has the port open, it is looked for so often.
const CLOSED: Duration = Duration::from_millis(2);

/// What speaks at the other end.
pub trait Board: Send {
    /// Somebody opened the port.
    fn opened(&mut self);

    /// Bytes came.
    fn take(&mut self, bytes: &[u8]);

    /// Time has passed; gives an answer that is due, one at a time.
    fn answer(&mut self) -> Option<Vec<u8>>;

    /// When it has something to do by itself next.
    fn wakes(&self) -> Option<Instant>;

    /// Is it at work, so that a restart or an alarm would do harm?
    fn works(&self) -> bool;

    /// It restarts, as after a brown-out.
    fn restart(&mut self);

    /// It stops by itself, as at a limit switch.
    fn alarm(&mut self) {}
}

/// Where the port is called as its driver wants to call it.
type Link = Arc<Mutex<Option<PathBuf>>>;

/// A board that is served; it ends when this is dropped.
pub struct Served {
    path: String,
    link: Link,
    ends: Arc<AtomicBool>,
    mischief: Arc<Mutex<Mischief>>,
    thread: Option<JoinHandle<()>>,
}

/// Serves a board on a new pseudo-terminal.
///
/// # Errors
/// The system's: no more of them.
pub fn serve(board: impl Board + 'static, mischief: Mischief) -> io::Result<Served> {
    let (ours, theirs) = TTYPort::pair()?;
    let path = theirs.name().ok_or_else(|| io::Error::other("a pseudo-terminal without a name"))?;
    drop(theirs);
    let ends = Arc::new(AtomicBool::new(false));
    let mischief = Arc::new(Mutex::new(mischief));
    let link = Link::default();
    let line = Line { port: ours, open: false, ends: ends.clone(), mischief: mischief.clone(), link: link.clone() };
    let thread = std::thread::Builder::new().name("simulated board".to_owned()).spawn(move || line.run(board))?;
    Ok(Served { path, link, ends, mischief, thread: Some(thread) })
}

/// Takes the link away.
fn unlink(link: &Link) {
    if let Some(path) = link.lock().unwrap_or_else(PoisonError::into_inner).take() {
        let _ = std::fs::remove_file(path);
    }
}

impl Served {
    /// Gives the port another name too, for as long as it is plugged in. A link that is there is replaced.
    ///
    /// # Errors
    /// Something else of that name, a folder that cannot be written to.
    pub fn link_at(self, path: &Path) -> io::Result<Self> {
        if path.is_symlink() {
            std::fs::remove_file(path)?;
        }
        symlink(&self.path, path)?;
        *self.link.lock().unwrap_or_else(PoisonError::into_inner) = Some(path.to_owned());
        Ok(self)
    }

    /// As in "/dev/pts/7".
    #[cfg(test)]
    pub fn path(&self) -> &Path {
        Path::new(&self.path)
    }

    /// What went wrong so far.
    pub fn struck(&self) -> Vec<Strike> {
        self.mischief.lock().unwrap_or_else(PoisonError::into_inner).struck().to_vec()
    }

    /// From now on nothing goes wrong.
    #[cfg(test)]
    pub fn calm(&self) {
        self.mischief.lock().unwrap_or_else(PoisonError::into_inner).calm();
    }
}

impl Drop for Served {
    fn drop(&mut self) {
        self.ends.store(true, Ordering::Relaxed);
        unlink(&self.link);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// Our end.
struct Line {
    port: TTYPort,
    open: bool,
    ends: Arc<AtomicBool>,
    mischief: Arc<Mutex<Mischief>>,
    link: Link,
}

impl Line {
    /// Until it is to end, or the cable is pulled: then the port is closed, and the driver's end hangs up.
    fn run(mut self, mut board: impl Board) {
        let mut bytes = [0; 1024];
        while !self.ends.load(Ordering::Relaxed) {
            match self.wait(&board, &mut bytes) {
                Ok(count) => {
                    if !self.open {
                        self.open = true;
                        board.opened();
                    }
                    if count > 0 && !self.mischief().swallows() {
                        board.take(&bytes[..count]);
                    }
                }
                Err(_) => {
                    self.open = false;
                    std::thread::sleep(CLOSED);
                }
            }
            if self.open && self.speak(&mut board).is_break() {
                return;
            }
        }
    }

    fn mischief(&self) -> std::sync::MutexGuard<'_, Mischief> {
        self.mischief.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Waits for bytes, or until there is something to do.
    fn wait(&mut self, board: &impl Board, bytes: &mut [u8]) -> io::Result<usize> {
        let now = Instant::now();
        let next = [board.wakes(), self.mischief().next()].into_iter().flatten().min();
        let left = next.map_or(LOOK, |at| at.saturating_duration_since(now)).min(LOOK);
        self.port.set_timeout(left)?;
        match self.port.read(bytes) {
            Err(error) if matches!(error.kind(), ErrorKind::TimedOut | ErrorKind::Interrupted) => Ok(0),
            other => other,
        }
    }

    /// Gives the answers that are due.
    fn speak(&mut self, board: &mut impl Board) -> std::ops::ControlFlow<()> {
        match self.mischief().strike_on_the_way(board.works()) {
            Some(Strike::Reset) => board.restart(),
            Some(Strike::Alarm) => board.alarm(),
            Some(Strike::HangUp) => {
                // As the system does with the name of what was unplugged: the next pseudo-terminal may get this one's number.
                unlink(&self.link);
                return std::ops::ControlFlow::Break(());
            }
            _ => {}
        }
        while let Some(answer) = board.answer() {
            self.mischief().answer(answer);
        }
        loop {
            let ready = self.mischief().ready();
            let Some(answer) = ready else { break };
            // Who does not listen misses it.
            let _ = self.port.set_timeout(LOOK);
            let _ = self.port.write_all(&answer);
        }
        std::ops::ControlFlow::Continue(())
    }
}
