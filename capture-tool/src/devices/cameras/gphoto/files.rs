//! The files of an exposure: which they are, and how they come to disk.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use relume_core::Error;
use relume_core::files::write_whole;

use super::body::{Event, Place};
use super::words::Kind;
use super::{Exposed, GphotoCamera};
use crate::devices::cameras::delivery::{FileKind, counted_first, exif, file_kind, jpeg_is_whole};
use crate::devices::{Delivered, Trouble};
use crate::progress;

/// The second of two files comes within this time after the first: cameras write raw files of 60 MB to slow cards.
pub(super) const SECOND_FILE: Duration = Duration::from_secs(20);
/// A camera that does not tell its format shows at its first photograph how many files it makes.
pub(super) const LEARN: Duration = Duration::from_millis(1500);
/// Between two looks at what it says.
const LISTEN: Duration = Duration::from_millis(100);

impl GphotoCamera {
    /// Waits until all files of the exposure are on the camera.
    pub(super) fn gather(&mut self) -> Result<(), Trouble> {
        if self.exposed.is_empty() {
            let what = format!("{} has made no photograph", self.name);
            return Err(Trouble::stop(what, "this is a mistake in relume"));
        }
        let expected = self.files_each.unwrap_or(2);
        let wait = if self.files_each.is_some() { self.second_file } else { self.learn };
        let begun = Instant::now();
        while self.exposed.len() < expected && begun.elapsed() < wait {
            progress::check_urgent()?;
            let asked = Instant::now();
            match self.ask(|body| body.event(LISTEN))? {
                Event::Stored(place) if self.is_new(&place) => self.exposed.push(Exposed { place, stored: None }),
                // Some drivers do not wait.
                Event::Quiet => std::thread::sleep(LISTEN.saturating_sub(asked.elapsed()) / 4),
                Event::Stored(_) | Event::Complete | Event::Other => {}
            }
        }
        if self.files_each.is_some() && self.exposed.len() < expected {
            let found: Vec<&str> = self.exposed.iter().map(|file| file.place.name.as_str()).collect();
            let what = format!("{} makes two files of a photograph, and only {} came", self.name, found.join(", "));
            return Err(Trouble::stop(what, "check the room on its card, or set another format in the rig file"));
        }
        self.files_each = Some(self.exposed.len());
        Ok(())
    }

    /// Another file of the exposure in flight: sound and films are none.
    fn is_new(&self, place: &Place) -> bool {
        let known = self.others.contains(place) || self.exposed.iter().any(|file| file.place == *place);
        !known && file_kind(Path::new(&place.name)).is_some()
    }

    /// Downloads, checks and deletes what is not yet stored.
    pub(super) fn store(&mut self, folder: &Path, stem: &str) -> Result<Delivered, Trouble> {
        for n in 0..self.exposed.len() {
            if self.exposed[n].stored.is_none() {
                let place = self.exposed[n].place.clone();
                let path = self.path_of(folder, stem, &place);
                let bytes = self.whole(&place)?;
                write_whole(&path, |file| file.write_all(&bytes).map_err(|source| Error::io("write", &path, source)))?;
                self.exposed[n].stored = Some(path);
                self.delete(&place);
            }
        }
        let files: Vec<PathBuf> = self.exposed.drain(..).filter_map(|file| file.stored).collect();
        let files = counted_first(files, self.options.counts, &self.name)?;
        let exposure = files.first().and_then(|file| exif(file));
        Ok(Delivered { files, thumbnail: None, exposure })
    }

    /// The stem with the camera's own extension; numbered where two files share it.
    fn path_of(&self, folder: &Path, stem: &str, place: &Place) -> PathBuf {
        let extension = Path::new(&place.name).extension().unwrap_or_default().to_string_lossy().into_owned();
        let taken = |path: &PathBuf| self.exposed.iter().any(|file| file.stored.as_ref() == Some(path));
        let first = folder.join(format!("{stem}.{extension}"));
        if taken(&first) { folder.join(format!("{stem}-b.{extension}")) } else { first }
    }

    /// A file's bytes, all of them: what comes short is asked for again.
    fn whole(&mut self, place: &Place) -> Result<Vec<u8>, Trouble> {
        let size = self.ask(|body| match body.size(place) {
            Err(refusal) if refusal.kind() == Kind::Other => Ok(None),
            size => size,
        })?;
        let bytes = self.ask(|body| body.fetch(place))?;
        let short = size.is_some_and(|size| size != bytes.len() as u64);
        let jpeg = file_kind(Path::new(&place.name)) == Some(FileKind::Jpeg);
        if bytes.is_empty() || short || (jpeg && !jpeg_is_whole(&bytes)) {
            let of = size.map_or_else(String::new, |size| format!(" of {size}"));
            return Err(Trouble::Busy(format!("{} delivers {}{of} bytes of {}", self.name, bytes.len(), place.name)));
        }
        Ok(bytes)
    }

    /// The photograph is safe: a camera that does not delete it is left alone, until its card is full.
    fn delete(&mut self, place: &Place) {
        let deleted = !self.options.keep_on_card && self.ask(|body| body.delete(place)).is_ok();
        if deleted {
            // Cameras may give the name again.
            self.others.remove(place);
        } else {
            self.others.insert(place.clone());
        }
    }
}
