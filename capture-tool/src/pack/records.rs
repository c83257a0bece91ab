//! Which photograph counts for what, and its files, checked.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use relume_core::hdr::Shot;
use relume_core::image::{Encoding, Image, SampleType, read, read_codes};
use relume_core::{Error, Result};

use crate::rigs::Condition;
use crate::session::{Exposure, Frame, Journal, Photograph, Role, file_hash, photographs};

/// The photographs of a session that count: the last one of each step.
#[derive(Debug)]
pub struct Records {
    root: PathBuf,
    photographs: Vec<Photograph>,
}

impl Records {
    /// Reads the journal. The session may be at work: what is finished now counts.
    ///
    /// # Errors
    /// A journal that cannot be read.
    pub fn read(root: &Path) -> Result<Self> {
        let lines = Journal::read(root)?;
        let mut list: Vec<Photograph> = Vec::new();
        let mut of_step = std::collections::HashMap::new();
        for photograph in photographs(&lines) {
            match of_step.insert(photograph.step, list.len()) {
                Some(before) => {
                    // The place of the first one stays, so that the order is that of the plan.
                    list[before] = photograph.clone();
                    of_step.insert(photograph.step, before);
                }
                None => list.push(photograph.clone()),
            }
        }
        Ok(Self { root: root.to_owned(), photographs: list })
    }

    /// Those of a role, in the order of the plan.
    pub fn of(&self, role: Role) -> impl Iterator<Item = &Photograph> {
        self.photographs.iter().filter(move |p| p.role == role)
    }

    /// All, in the order of the plan.
    pub fn all(&self) -> impl Iterator<Item = &Photograph> {
        self.photographs.iter()
    }

    /// The one of a role that shows a condition.
    pub fn find(&self, role: Role, condition: &Condition) -> Option<&Photograph> {
        self.of(role).find(|p| p.condition == *condition)
    }

    /// Codes of a file, RGB, and how it holds them, after a look at its hash.
    ///
    /// # Errors
    /// A file that is gone, changed or no picture: with the number to photograph again.
    pub fn codes(&self, photograph: &Photograph, frame: &Frame) -> Result<(Arc<Image>, SampleType)> {
        let path = self.checked(photograph, frame)?;
        let (image, sample_type) = read_codes(&path)?;
        Ok((Arc::new(image.into_rgb()), sample_type))
    }

    /// An imported photograph as light, RGB.
    ///
    /// # Errors
    /// As [`Records::codes`].
    pub fn picture(&self, photograph: &Photograph, encoding: Encoding) -> Result<Image> {
        let place = || format!("photograph {}", photograph.number);
        let frame = photograph.frames.first().ok_or_else(|| Error::invalid(place(), "no file", "one"))?;
        Ok(read(&self.checked(photograph, frame)?, encoding)?.into_rgb())
    }

    /// One number for all photographs, by their hashes: what was solved from others is another field.
    pub fn hash(&self) -> String {
        let mut hasher = blake3::Hasher::new();
        for frame in self.photographs.iter().flat_map(|photograph| &photograph.frames) {
            hasher.update(frame.blake3.as_bytes());
        }
        hasher.finalize().to_hex().to_string()
    }

    /// The path of a file, after a look at its hash.
    fn checked(&self, photograph: &Photograph, frame: &Frame) -> Result<PathBuf> {
        let path = self.root.join(&frame.file);
        let (bytes, blake3) = file_hash(&path)?;
        if (bytes, &blake3) != (frame.bytes, &frame.blake3) {
            let expected = format!(
                "the file that was stored; photograph it again with `relume capture --session {} --resume --redo {}`",
                self.root.display(),
                photograph.number
            );
            return Err(Error::invalid(
                path.display().to_string(),
                "other bytes than the journal's hash says",
                expected,
            ));
        }
        Ok(path)
    }
}

/// The relative exposure of a frame, `t * (ISO / 100) / N^2` as far as these are known.
pub fn relative(exposure: &Exposure) -> f64 {
    exposure.time_s * exposure.iso.unwrap_or(100.0) / 100.0 / exposure.f_number.unwrap_or(1.0).powi(2)
}

/// A frame as a shot of a bracket.
///
/// # Errors
/// A frame without an exposure time.
pub fn shot(photograph: &Photograph, frame: &Frame) -> Result<Shot> {
    let Some(exposure) = &frame.exposure else {
        let place = format!("photograph {}, {}", photograph.number, frame.file);
        return Err(Error::invalid(place, "no exposure time", "one"));
    };
    Ok(Shot { exposure: relative(exposure), iso: exposure.iso.unwrap_or(100.0), offset: [0; 2] })
}
