//! Photographs as light, captured or imported, with the black one subtracted.

use std::sync::atomic::{AtomicU32, Ordering};

use rayon::prelude::*;
use relume_core::acquire;
use relume_core::files::folder_of;
use relume_core::image::{ColourSpace, Encoding, Image};
use relume_core::{Error, Result};

use crate::pack::develop::Developer;
use crate::pack::records::Records;
use crate::rigs::Condition;
use crate::session::{Photograph, Role};

/// How photographs become light.
#[derive(Debug)]
enum Light<'a> {
    /// Brackets of a camera.
    Captured(&'a Developer),
    /// One picture each.
    Imported(Encoding),
}

/// The photographs of a screen.
#[derive(Debug)]
pub struct Photographs<'a> {
    records: &'a Records,
    light: Light<'a>,
    size: (usize, usize),
    colour_space: ColourSpace,
    black: Option<Image>,
    /// Bits of the largest share of a photograph that is clipped in all its exposures: those of positive floats rise with them.
    clipped: AtomicU32,
}

impl<'a> Photographs<'a> {
    /// Of a camera.
    ///
    /// # Errors
    /// No photograph; files that are gone or changed.
    pub fn captured(records: &'a Records, developer: &'a Developer) -> Result<Self> {
        Self::new(records, Light::Captured(developer), ColourSpace::default())
    }

    /// Made elsewhere.
    ///
    /// # Errors
    /// As [`Photographs::captured`].
    pub fn imported(records: &'a Records, encoding: Encoding, colour_space: ColourSpace) -> Result<Self> {
        Self::new(records, Light::Imported(encoding), colour_space)
    }

    fn new(records: &'a Records, light: Light<'a>, colour_space: ColourSpace) -> Result<Self> {
        let clipped = AtomicU32::new(0);
        let mut photographs = Self { records, light, size: (0, 0), colour_space, black: None, clipped };
        let first = records.of(Role::Sample).chain(records.all()).next();
        let first = first.ok_or_else(|| Error::invalid("the session", "no photograph", "at least one"))?;
        photographs.size = records.codes(first, &first.frames[0])?.0.size();
        if let Some(black) = records.find(Role::Black, &Condition::Black { stop: 0 }) {
            photographs.black = Some(photographs.developed(black)?);
        }
        Ok(photographs)
    }

    /// Columns and rows.
    pub fn size(&self) -> (usize, usize) {
        self.size
    }

    /// The colours of the light.
    pub fn colour_space(&self) -> ColourSpace {
        self.colour_space
    }

    /// S, if it was photographed.
    pub fn black(&self) -> Option<&Image> {
        self.black.as_ref()
    }

    /// The largest share of a photograph so far that every exposure clips.
    pub fn clipped(&self) -> f32 {
        f32::from_bits(self.clipped.load(Ordering::Relaxed))
    }

    /// A photograph as light, black subtracted.
    ///
    /// # Errors
    /// A file that is gone, changed, no picture or of another size.
    pub fn lit(&self, photograph: &Photograph) -> Result<Image> {
        let mut picture = self.developed(photograph)?;
        if let Some(black) = &self.black {
            picture.data_mut().iter_mut().zip(black.data()).for_each(|(v, s)| *v -= s);
        }
        Ok(picture)
    }

    /// Photographs in order, as light times `unit`, after `change(number in the list, picture)`; told the steps done.
    ///
    /// # Errors
    /// As [`Photographs::lit`]; no room beside `output` for what does not fit into memory.
    pub fn gathered(
        &self,
        list: &[&Photograph],
        output: &std::path::Path,
        change: &(dyn Fn(usize, &mut Image) + Sync),
        progress: &mut dyn FnMut(u64, u64) -> Result<()>,
    ) -> Result<acquire::Photographs> {
        let mut gathered = acquire::Photographs::new(self.size.0, self.size.1, folder_of(output));
        let numbered: Vec<(usize, &Photograph)> = list.iter().copied().enumerate().collect();
        // As many at a time as there are threads: their order stays, memory stays bounded.
        for group in numbered.chunks(rayon::current_num_threads()) {
            let lit = |(n, photograph): &(usize, &Photograph)| -> Result<Image> {
                let mut picture = self.lit(photograph)?;
                change(*n, &mut picture);
                Ok(picture)
            };
            let pictures: Vec<Result<Image>> = group.par_iter().map(lit).collect();
            for picture in pictures {
                gathered.push(picture?)?;
            }
            progress(gathered.len() as u64, list.len() as u64)?;
        }
        Ok(gathered)
    }

    fn developed(&self, photograph: &Photograph) -> Result<Image> {
        let picture = match &self.light {
            Light::Captured(developer) => {
                let merged = developer.develop(self.records, photograph)?;
                let share = merged.report.clipped_everywhere.rgb.iter().sum::<f64>() / 3.0;
                self.clipped.fetch_max((share as f32).to_bits(), Ordering::Relaxed);
                merged.image
            }
            Light::Imported(encoding) => self.records.picture(photograph, *encoding)?,
        };
        if picture.size() != self.size {
            let found = format!("{} x {} pixels", picture.width(), picture.height());
            let place = format!("photograph {}", photograph.number);
            return Err(Error::invalid(place, found, format!("{} x {}, as the others", self.size.0, self.size.1)));
        }
        Ok(picture)
    }
}
