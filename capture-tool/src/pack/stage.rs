//! `T` of a stage.

use std::path::Path;

use rayon::prelude::*;
use relume_core::acquire::{Photographs, Reporting, coverage};
use relume_core::calibrate::linearity::{Compared, Linearity};
use relume_core::calibrate::near;
use relume_core::domain::Directions;
use relume_core::field::{self, BLOCK_HEIGHT, Contents, Precision};
use relume_core::files::folder_of;
use relume_core::image::{Image, probe_size};
use relume_core::{Error, Result};

use super::checks::Checks;
use super::develop::Developer;
use super::lamps::Irradiances;
use super::records::Records;
use crate::rigs::{Condition, StageRig};
use crate::session::{Photograph, Role};

/// Least cosine between the card's normal and the lamp: below, a degree of tilt is 10 %.
const LEAST_FACING: f64 = 0.17;

/// Everything that goes into the field of a stage.
pub struct StagePack<'a> {
    /// The photographs.
    pub records: &'a Records,
    /// The rig.
    pub stage: &'a StageRig,
    /// The camera.
    pub developer: &'a Developer,
    /// The lamps.
    pub irradiances: &'a Irradiances,
    /// Drift.
    pub checks: &'a Checks,
    /// A picture of the object's coverage, of the photographs' size.
    pub alpha: Option<&'a Path>,
    /// Leave out lamps that have no photograph.
    pub partial: bool,
    /// How `T` is stored.
    pub precision: Precision,
}

/// What came of it.
#[derive(Debug)]
pub struct Packed {
    /// Lamps in the field.
    pub lamps: usize,
    /// Lamps of the rig.
    pub of: usize,
    /// The check of every stop that has one, with its number from 0.
    pub linearity: Vec<(usize, Compared)>,
    /// Share of all pixels and channels that every exposure of their photograph clips.
    pub clipped: f64,
}

impl StagePack<'_> {
    /// Writes the container. `progress(steps done, steps)` may stop it.
    ///
    /// # Errors
    /// Lamps without a photograph; files that are gone or changed; no room.
    pub fn write(
        &self,
        output: &Path,
        provenance: serde_json::Value,
        progress: &mut dyn FnMut(u64, u64) -> Result<()>,
    ) -> Result<Packed> {
        let lamps = self.lamps()?;
        let (size, mut photographs) = self.room(&lamps, output)?;
        let alpha = self.alpha.map(|path| matte(path, size)).transpose()?;
        let total = (lamps.len() + size.1.div_ceil(BLOCK_HEIGHT)) as u64;
        let mut packed =
            Packed { lamps: lamps.len(), of: self.stage.lamps.count(), linearity: Vec::new(), clipped: 0.0 };
        let mut ambient = Mean::new(size);
        for stop in 0..self.stage.lamps.stops() {
            let of_stop: Vec<_> = lamps.iter().filter(|(lamp, _)| self.stop_of(*lamp) == stop).copied().collect();
            let black = self.black(stop, size)?;
            ambient.add(&black);
            let mut sum = Linearity::new(size.0, size.1);
            // As many at a time as there are threads: their order stays, memory stays bounded.
            for group in of_stop.chunks(rayon::current_num_threads()) {
                let lit = |(_, p): &(usize, &Photograph)| self.lit(p, &black);
                let pictures: Vec<Result<(Image, f64)>> = group.par_iter().map(lit).collect();
                for (picture, (lamp, _)) in pictures.into_iter().zip(group) {
                    let (mut picture, clipped) = picture?;
                    packed.clipped += clipped / lamps.len() as f64;
                    sum.add(&picture)?;
                    self.even_out(*lamp, &mut picture)?;
                    let per = self.irradiances.rgb(*lamp).map(|e| 1.0 / e);
                    picture.data_mut().chunks_exact_mut(3).for_each(|p| (0..3).for_each(|c| p[c] *= per[c]));
                    photographs.push(picture)?;
                }
                progress(photographs.len() as u64, total)?;
            }
            if of_stop.len() == self.stage.lamps.per_stop() {
                packed.linearity.extend(self.linearity(stop, &sum, &black)?.map(|compared| (stop, compared)));
            }
        }
        let unit = self.irradiances.unit;
        let mut ambient = ambient.finish();
        ambient.data_mut().iter_mut().for_each(|v| *v *= unit);
        let directions = self.stage.lamps.directions();
        let contents = Contents {
            domain: Directions::new(lamps.iter().map(|(lamp, _)| directions[*lamp]).collect())?.into(),
            irradiance: lamps.iter().map(|(lamp, _)| self.irradiances.mean(*lamp) * unit).collect(),
            width: size.0,
            height: size.1,
            colour_space: Default::default(),
            precision: self.precision,
            largest: photographs.largest(),
            ambient: Some(ambient),
            alpha,
            reliability: None,
            provenance,
        };
        field::write(output, &contents, &mut Reporting { photographs: &mut photographs, progress, total })?;
        Ok(packed)
    }

    /// The lamps that have a photograph, with it.
    fn lamps(&self) -> Result<Vec<(usize, &Photograph)>> {
        let count = self.stage.lamps.count();
        let mut found = vec![None; count];
        for photograph in self.records.of(Role::Sample) {
            if let Condition::Lamp(lamp) = photograph.condition
                && let Some(place) = found.get_mut(lamp)
            {
                *place = Some(photograph);
            }
        }
        let list: Vec<(usize, &Photograph)> =
            found.iter().enumerate().filter_map(|(lamp, p)| p.map(|p| (lamp, p))).collect();
        if list.len() == count || (self.partial && !list.is_empty()) {
            return Ok(list);
        }
        let missing = found.iter().position(Option::is_none).unwrap_or_default() + 1;
        Err(Error::invalid(
            "the session",
            format!("photographs of {} of {count} lamps (the first one missing is lamp {missing})", list.len()),
            "all of them: go on with `relume capture --resume`, or leave those lamps out with --partial",
        ))
    }

    /// Takes out what a near lamp gives one pixel more than another, where a white card was photographed under it.
    fn even_out(&self, lamp: usize, picture: &mut Image) -> Result<()> {
        let Some(photograph) = self.records.find(Role::FlatField, &Condition::FlatField(lamp)) else { return Ok(()) };
        // Lamps behind the card or grazing it tell nothing of it; they stay as they are.
        if self.stage.lamps.directions()[lamp].z < LEAST_FACING {
            return Ok(());
        }
        let card = self.developer.picture(self.records, photograph)?;
        let middle = [0.5 * card.width() as f64, 0.5 * card.height() as f64];
        let relative = near::flat_field(&card, None, middle, &format!("flat field, lamp {}", lamp + 1))?;
        near::even_out(picture, &relative);
        Ok(())
    }

    fn room(&self, lamps: &[(usize, &Photograph)], output: &Path) -> Result<((usize, usize), Photographs)> {
        let (_, first) = lamps.first().ok_or_else(|| Error::invalid("the session", "no photograph", "at least one"))?;
        let size = self.records.codes(first, &first.frames[0])?.0.size();
        Ok((size, Photographs::new(size.0, size.1, folder_of(output))))
    }

    fn stop_of(&self, lamp: usize) -> usize {
        lamp / self.stage.lamps.per_stop()
    }

    /// The ambient light of a stop; black where none was photographed.
    fn black(&self, stop: usize, size: (usize, usize)) -> Result<Image> {
        match self.records.find(Role::Black, &Condition::Black { stop }) {
            Some(photograph) => self.developer.picture(self.records, photograph),
            None => Ok(Image::new(size.0, size.1, 3)),
        }
    }

    /// `(photo - S) / g`, and the share that is clipped throughout.
    fn lit(&self, photograph: &Photograph, black: &Image) -> Result<(Image, f64)> {
        let merged = self.developer.develop(self.records, photograph)?;
        let clipped = clipped_share(&merged.report);
        let mut picture = merged.image;
        if picture.size() != black.size() {
            let found = format!("{} x {} pixels", picture.width(), picture.height());
            let place = format!("photograph {}", photograph.number);
            return Err(Error::invalid(place, found, format!("{} x {}, as the others", black.width(), black.height())));
        }
        let gain = self.checks.gain(photograph.number);
        let pixels = picture.data_mut().chunks_exact_mut(3).zip(black.data().chunks_exact(3));
        pixels.for_each(|(p, s)| (0..3).for_each(|c| p[c] = (p[c] - s[c]) / gain[c]));
        Ok((picture, clipped))
    }

    /// The lamps' sum against all of them together.
    fn linearity(&self, stop: usize, sum: &Linearity, black: &Image) -> Result<Option<Compared>> {
        let Some(photograph) = self.records.find(Role::AllLit, &Condition::AllLamps { stop }) else { return Ok(None) };
        let (together, _) = self.lit(photograph, black)?;
        sum.compare(&together).map(Some)
    }
}

/// The coverage of a picture of this size.
fn matte(path: &Path, (width, height): (usize, usize)) -> Result<Vec<f32>> {
    let found = probe_size(path)?;
    if found != (width, height) {
        let found = format!("{} x {} pixels", found.0, found.1);
        return Err(Error::invalid(
            path.display().to_string(),
            found,
            format!("{width} x {height}, as the photographs have"),
        ));
    }
    coverage(path)
}

fn clipped_share(report: &relume_core::hdr::Report) -> f64 {
    report.clipped_everywhere.rgb.iter().sum::<f64>() / 3.0
}

/// The mean of pictures.
struct Mean {
    sum: Image,
    count: usize,
}

impl Mean {
    fn new(size: (usize, usize)) -> Self {
        Self { sum: Image::new(size.0, size.1, 3), count: 0 }
    }

    fn add(&mut self, picture: &Image) {
        self.sum.data_mut().iter_mut().zip(picture.data()).for_each(|(s, v)| *s += v);
        self.count += 1;
    }

    fn finish(mut self) -> Image {
        let per = 1.0 / self.count.max(1) as f32;
        self.sum.data_mut().iter_mut().for_each(|v| *v *= per);
        self.sum
    }
}
