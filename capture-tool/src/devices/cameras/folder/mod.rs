//! A camera behind any software that puts its photographs into a folder: tethering programs of the makers, a phone's, a script.
//!
//! Which file is of which exposure decides everything here, for a photograph taken for its neighbour's would not be noticed before
//! the asset looks wrong:
//!
//! - files that are there before an exposure never count, nor do files that share their stem (a raw file that comes late);
//! - a file counts once it is whole ([`watch`]);
//! - the time in its EXIF data has to agree with the others' ([`clock`]): a file of an exposure that was given up does not;
//! - two photographs for one exposure end the run;
//! - the exposure time in its EXIF data is compared with what was asked for by whoever called;
//! - a session that gave an exposure up waits for its file when it is resumed, before the next exposure.
//!
//! Files are copied and left where they are: they belong to the software that wrote them.

mod clock;
#[cfg(test)]
mod tests;
mod trigger;
mod watch;

use std::collections::HashSet;
use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant, SystemTime};

use clock::CameraClock;
use relume_core::files::write_whole;
use relume_core::{Error, hdr};
use trigger::Trigger;
use watch::{Watch, stem_of};

use super::delivery::{FileKind, counted_first, exif, file_kind, jpeg_is_whole};
use crate::devices::{Camera, Delivered, Finding, Operator, Trouble};
use crate::progress;
use crate::rigs::Counts;
use crate::session::Exposure;

/// In a session's folder while an exposure is made and its file has not come.
const PENDING: &str = "exposing";
/// The first photograph shows whether files come in pairs: a second one comes within this time.
const LEARN: Duration = Duration::from_millis(1500);
/// A wait that people would wonder about.
const WORTH_TELLING: Duration = Duration::from_secs(5);

/// How a rig file wants a folder watched.
#[derive(Debug, Clone)]
pub struct Options {
    /// The folder.
    pub path: PathBuf,
    /// Takes a photograph; empty: the operator does.
    pub trigger: Vec<String>,
    /// Which of two files counts.
    pub counts: Counts,
    /// A file has to come within this time, seconds.
    pub within_s: f64,
    /// Between two looks, seconds; 0: the system tells.
    pub poll_s: f64,
}

/// The camera.
pub struct FolderCamera {
    options: Options,
    trigger: Option<Trigger>,
    operator: Arc<dyn Operator>,
    watch: Watch,
    clock: CameraClock,
    pending: PathBuf,
    resumed: bool,
    wanted: Option<Exposure>,
    exposed: Option<Exposed>,
    /// Does each photograph make two files? Learnt from the first.
    pairs: Option<bool>,
}

/// An exposure whose files are waited for.
#[derive(Debug)]
struct Exposed {
    /// Stems of the files that were there before.
    before: HashSet<String>,
    asked: Instant,
    until: Instant,
}

/// What has come since an exposure.
#[derive(Debug, Default)]
struct Come {
    files: Vec<PathBuf>,
    /// Those that are of another exposure, by their EXIF time.
    strangers: Vec<PathBuf>,
    /// When the first file came.
    since: Option<Instant>,
}

impl FolderCamera {
    /// Watches a folder for a session.
    ///
    /// # Errors
    /// A folder that is not there; a trigger that cannot be understood.
    pub fn open(options: Options, session: &Path, operator: Arc<dyn Operator>) -> Result<Self, Trouble> {
        if !options.path.is_dir() {
            let what = format!("the camera's folder {} is not there", options.path.display());
            return Err(Trouble::stop(what, "make it, and let the camera's software put photographs into it"));
        }
        let trigger = Trigger::new(&options.trigger)?;
        let watch = Watch::new(&options.path, options.poll_s);
        Ok(Self {
            trigger,
            operator,
            watch,
            clock: CameraClock::default(),
            pending: session.join(PENDING),
            resumed: false,
            wanted: None,
            exposed: None,
            pairs: None,
            options,
        })
    }

    fn within(&self) -> Duration {
        Duration::from_secs_f64(self.options.within_s)
    }

    /// After a run that gave an exposure up: its file may still come, and must not be taken for the next one's.
    fn let_late_files_come(&mut self) -> Result<(), Trouble> {
        if std::mem::replace(&mut self.resumed, true) {
            return Ok(());
        }
        let Ok(text) = fs::read_to_string(&self.pending) else { return Ok(()) };
        let mut numbers = text.split_whitespace().map(str::parse::<u64>);
        let (Some(Ok(files)), Some(Ok(until))) = (numbers.next(), numbers.next()) else { return Ok(()) };
        // A clock that was put back does not make it longer.
        let left = Duration::from_millis(until.saturating_sub(now_ms())).min(2 * self.within());
        let end = Instant::now() + left;
        if left > WORTH_TELLING && (self.watch.stems()?.len() as u64) <= files {
            let seconds = left.as_secs();
            crate::complain(&format!("note: waiting up to {seconds} s for the file of an exposure that was given up"));
        }
        while (self.watch.stems()?.len() as u64) <= files && Instant::now() < end {
            progress::check_urgent()?;
            self.watch.wait();
        }
        Ok(())
    }

    /// Notes that an exposure is made, for a session that is resumed.
    fn note(&self, files: usize, time_s: f64) -> Result<(), Trouble> {
        let until = now_ms() + ((time_s + 2.0 * self.options.within_s) * 1000.0) as u64;
        let folder_is_there = self.pending.parent().is_some_and(Path::is_dir);
        if folder_is_there {
            let fail = |source| Error::io("write", &self.pending, source);
            fs::write(&self.pending, format!("{files} {until}\n")).map_err(fail)?;
        }
        Ok(())
    }

    /// Files that have come since the exposure and are of it.
    fn look(&mut self, exposed: &Exposed, come: &mut Come) -> Result<(), Trouble> {
        for path in self.watch.whole(&exposed.before)? {
            if come.files.contains(&path) || come.strangers.contains(&path) || !is_complete(&path) {
                continue;
            }
            let window = [exposed.asked, Instant::now()];
            let agrees = hdr::taken_s(&path).is_none_or(|taken| self.clock.agrees(taken, window));
            if agrees {
                come.since.get_or_insert_with(Instant::now);
                come.files.push(path);
            } else {
                come.strangers.push(path);
            }
        }
        Ok(())
    }

    /// Has all come that is to be waited for?
    fn is_all(&self, come: &Come) -> bool {
        let raw = |path: &PathBuf| file_kind(path) == Some(FileKind::Raw);
        let counted = come.files.iter().any(|path| raw(path) == (self.options.counts == Counts::Raw));
        let waited = come.since.map_or(Duration::ZERO, |since| since.elapsed());
        match self.pairs {
            _ if !counted => false,
            Some(false) => true,
            None => come.files.len() > 1 || waited >= LEARN,
            Some(true) => come.files.len() > 1 || waited >= self.within(),
        }
    }

    fn nothing_came(&self, come: Come) -> Trouble {
        let folder = self.options.path.display();
        let within_s = self.options.within_s;
        let what = format!("no photograph came into {folder} within {within_s} s");
        if let Some(stranger) = come.strangers.first().and_then(|path| path.file_name()) {
            let what = format!("{what}, but {}, which is of another exposure by its EXIF time", stranger.display());
            return Trouble::stop(what, "if the camera's clock was changed, just resume; else look at its software");
        }
        if let Some(growing) = self.watch.growing() {
            let what = format!("{} is not whole {within_s} s after its exposure", growing.display());
            return Trouble::stop(what, "a larger within_s in the rig file waits longer");
        }
        Trouble::stop(
            what,
            "check that the camera is connected and that its software stores there, each photograph under a new name; a larger \
             within_s waits longer",
        )
    }

    /// Copies the files of an exposure.
    fn copy(&self, files: Vec<PathBuf>, folder: &Path, stem: &str) -> Result<Vec<PathBuf>, Trouble> {
        let files = counted_first(files, self.options.counts, "the camera's software")?;
        let mut copies = Vec::new();
        for file in files {
            let extension = file.extension().unwrap_or_default().to_string_lossy();
            let copy = folder.join(format!("{stem}.{extension}"));
            let bytes = fs::read(&file).map_err(|source| Error::io("read", &file, source))?;
            write_whole(&copy, |out| out.write_all(&bytes).map_err(|source| Error::io("write", &copy, source)))?;
            copies.push(copy);
        }
        Ok(copies)
    }
}

impl Camera for FolderCamera {
    fn preflight(&mut self) -> Vec<Finding> {
        let folder = self.options.path.display();
        let how = match self.watch.seconds() {
            Some(seconds) => format!("looked at every {seconds} s"),
            None => "told by the system".to_owned(),
        };
        let mut found = match self.watch.stems() {
            Ok(_) => vec![Finding::fine(format!("camera: files that come into {folder}, {how}"))],
            Err(trouble) => vec![Finding::missing(format!("camera: {trouble}"))],
        };
        found.push(match &self.trigger {
            None => Finding::fine("camera: the operator takes each photograph"),
            Some(trigger) => trigger.preflight(),
        });
        if self.options.counts == Counts::Raw && !cfg!(feature = "raw") {
            found.push(Finding::missing(
                "camera: counts = \"raw\", which this relume was built without (cargo build --features raw)",
            ));
        }
        found
    }

    /// Nobody can be asked before the file comes, which then tells.
    fn set(&mut self, wanted: &Exposure) -> Result<Exposure, Trouble> {
        self.wanted = Some(*wanted);
        Ok(*wanted)
    }

    fn setting(&mut self) -> Result<Option<Exposure>, Trouble> {
        Ok(None)
    }

    fn expose(&mut self) -> Result<(), Trouble> {
        let wanted = self
            .wanted
            .ok_or_else(|| Trouble::stop("the camera was given no exposure time", "this is a mistake in relume"))?;
        self.let_late_files_come()?;
        let before = self.watch.stems()?;
        self.note(before.len(), wanted.time_s)?;
        let asked = Instant::now();
        match &self.trigger {
            Some(trigger) => trigger.run(&wanted, Duration::from_secs_f64(wanted.time_s) + self.within())?,
            None => {
                let words = crate::capture::words(&wanted);
                self.operator.ask(&format!("set the camera to {words} and take the photograph"))?;
            }
        }
        let until = Instant::now() + Duration::from_secs_f64(wanted.time_s) + self.within();
        self.exposed = Some(Exposed { before, asked, until });
        Ok(())
    }

    fn download(&mut self, folder: &Path, stem: &str) -> Result<Delivered, Trouble> {
        let exposed = self
            .exposed
            .take()
            .ok_or_else(|| Trouble::stop("the camera has made no photograph", "this is a mistake in relume"))?;
        let mut come = Come::default();
        loop {
            progress::check_urgent()?;
            self.look(&exposed, &mut come)?;
            let stems: HashSet<String> = come.files.iter().map(|path| stem_of(path)).collect();
            if stems.len() > 1 {
                let mut names: Vec<&str> = stems.iter().map(String::as_str).collect();
                names.sort_unstable();
                let what = format!("two photographs came for one exposure: {}", names.join(" and "));
                return Err(Trouble::stop(what, "nobody may press the camera's shutter during a capture; then resume"));
            }
            if self.is_all(&come) {
                break;
            }
            if Instant::now() >= exposed.until {
                // Of another kind than the one that counts: said by its name.
                if come.files.is_empty() {
                    return Err(self.nothing_came(come));
                }
                break;
            }
            self.watch.wait();
        }
        self.pairs = Some(come.files.len() > 1);
        let taken = come.files.iter().find_map(|path| hdr::taken_s(path));
        let copies = self.copy(come.files, folder, stem)?;
        if let Some(taken) = taken {
            self.clock.learn(taken, [exposed.asked, come.since.unwrap_or_else(Instant::now)]);
        }
        let _ = fs::remove_file(&self.pending);
        let exposure = copies.first().and_then(|copy| exif(copy));
        Ok(Delivered { files: copies, thumbnail: None, exposure })
    }
}

/// What can be told from a file's bytes: a JPEG that was cut off has no end. Files that cannot be read now are looked at again.
fn is_complete(path: &Path) -> bool {
    match file_kind(path) {
        Some(FileKind::Jpeg) => fs::read(path).is_ok_and(|bytes| jpeg_is_whole(&bytes)),
        _ => true,
    }
}

fn now_ms() -> u64 {
    let since = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
    u64::try_from(since.as_millis()).unwrap_or(u64::MAX)
}
