//! Light near the object: of a light file, of a light field that ships, or of the beams and the slide that are on.

use std::path::{Path, PathBuf};
use std::sync::{Arc, PoisonError, Weak};

use relume_core::illumination::LightField;
use relume_core::illumination::light_field::Slide;
use relume_core::image::{Encoding, Image as Picture, read};
use relume_core::settings::light4d;
use relume_core::settings::near::Thrown;

use super::controls::Near;
use super::library::{Instance, Library};
use crate::effects::files::{self, file_name};
use crate::error::Result;
use crate::registry::Stamp;

/// A light file with the pictures it names, as they were when it was read.
#[derive(Debug)]
pub struct NearFile {
    light: Arc<LightField>,
    pictures: Vec<(PathBuf, Option<Stamp>)>,
}

impl NearFile {
    fn load(path: &Path) -> Result<Self> {
        let file = light4d::load(path)?;
        let stamped = |path: PathBuf| (path.clone(), Stamp::of(&path).ok());
        Ok(Self { light: Arc::new(file.light), pictures: file.pictures.into_iter().map(stamped).collect() })
    }

    /// Are its pictures as they were read?
    fn is_fresh(&self) -> bool {
        self.pictures.iter().all(|(path, stamp)| Stamp::of(path).ok() == *stamp)
    }
}

/// Light near the object, owned, with what it was made from.
#[derive(Debug, Clone)]
pub struct Lights {
    /// The light.
    pub field: Arc<LightField>,
    /// What it was made from.
    pub origin: Origin,
    /// As at the origin everywhere.
    pub flat: bool,
}

/// What tells one light from another. Files are held weakly.
#[derive(Debug, Clone)]
pub enum Origin {
    /// A file, or a light field that ships.
    Whole(Weak<LightField>),
    /// Parameters, and the slide's picture.
    Parameters([Option<Thrown>; 4], Option<(Thrown, Weak<Picture>)>),
}

impl Origin {
    /// Is it the same light?
    pub fn is(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Whole(a), Self::Whole(b)) => Weak::ptr_eq(a, b),
            (Self::Parameters(a, None), Self::Parameters(b, None)) => a == b,
            (Self::Parameters(a, Some((s, p))), Self::Parameters(b, Some((t, q)))) => {
                a == b && s == t && Weak::ptr_eq(p, q)
            }
            _ => false,
        }
    }
}

impl Library {
    /// What lights from near.
    ///
    /// # Errors
    /// A light file or a slide that cannot be used; a beam whose position is its aim.
    pub fn near(&self, instance: &Instance, near: &Near) -> Result<Lights> {
        let whole =
            |field: Arc<LightField>| Lights { origin: Origin::Whole(Arc::downgrade(&field)), field, flat: near.flat };
        match (near.file(), near.preset) {
            (Some(typed), _) => Ok(whole(Arc::clone(&self.near_file(instance, typed)?.light))),
            (None, Some(preset)) => self.near_preset(preset).map(whole),
            (None, None) => self.near_parameters(instance, near),
        }
    }

    fn near_file(&self, instance: &Instance, typed: &str) -> Result<Arc<NearFile>> {
        let open = || files::open(&self.near_files, &instance.near_file, typed, NearFile::load);
        let file = open()?;
        if file.is_fresh() {
            return Ok(file);
        }
        drop(file);
        // The file is as it was, a picture is not.
        files::forget(&self.near_files, &instance.near_file, typed);
        open()
    }

    fn near_preset(&self, preset: &'static light4d::Preset) -> Result<Arc<LightField>> {
        let mut presets = self.near_presets.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, field)) = presets.iter().find(|entry| entry.0 == preset.id) {
            return Ok(Arc::clone(field));
        }
        let field = Arc::new(preset.load()?.light);
        presets.push((preset.id, Arc::clone(&field)));
        Ok(field)
    }

    fn near_parameters(&self, instance: &Instance, near: &Near) -> Result<Lights> {
        let mut sources = Vec::new();
        for (n, beam) in near.beams.iter().enumerate() {
            if let Some(beam) = beam {
                sources.push(beam.beam(&format!("beam {}", n + 1))?);
            }
        }
        let mut slide = None;
        if let Some(typed) = near.slide() {
            let picture = files::open(&self.slides, &instance.slide, typed, slide_picture)?;
            sources.push(near.thrown.slide("the slide", Arc::clone(&picture))?);
            slide = Some((near.thrown, Arc::downgrade(&picture)));
        }
        let origin = Origin::Parameters(near.beams, slide);
        Ok(Lights { field: Arc::new(LightField::new(sources)), origin, flat: near.flat })
    }
}

fn slide_picture(path: &Path) -> Result<Picture> {
    let picture = read(path, Encoding::Auto)?;
    let empty = || relume_core::Error::invalid(path.display().to_string(), "no pixels", "at least one");
    let picture = Slide::prepared(picture).ok_or_else(empty)?;
    Ok(Arc::unwrap_or_clone(picture))
}

/// Makes the next picture open the files again.
pub fn forget(library: &Library, instance: &Instance, near: &Near) {
    files::forget(&library.near_files, &instance.near_file, &near.file);
    files::forget(&library.slides, &instance.slide, &near.slide);
}

/// The light in words.
pub fn said(near: &Near, lights: &Lights) -> String {
    let count = |n: usize, what: &str| if n == 1 { format!("1 {what}") } else { format!("{n} {what}s") };
    if let Some(typed) = near.file() {
        return format!("{}, {}", file_name(typed), count(lights.field.sources.len(), "light"));
    }
    if let Some(preset) = near.preset {
        return preset.label.to_owned();
    }
    let beams = near.beams.iter().flatten().count();
    let beams = (beams > 0).then(|| count(beams, "beam"));
    let slide = near.slide().map(|typed| format!("the slide {}", file_name(typed)));
    beams.into_iter().chain(slide).collect::<Vec<_>>().join(" and ")
}
