//! From a session of a projector at many positions to a field (7.3, 7.5).
//!
//! ```text
//! position after position: photographs -> light, its own black subtracted -> squares (one by one, or told apart from H and V sets)
//!     -> divided by the intensity of white -> pictures in memory, spilled beyond it -> samples | terms a pixel
//! ```
//!
//! Memory is that of the photographs of one position, and 2 GiB at most of its squares, however many positions there are.

use std::collections::HashMap;
use std::f32::consts::PI;
use std::path::Path;

use rayon::prelude::*;
use relume_core::acquire::separable::{Gathering, Reliability, Separable};
use relume_core::acquire::{Photographs, PositionTerms, Reporting};
use relume_core::domain::{Filter, Gantry, Pose};
use relume_core::field::{self, BLOCK_HEIGHT, BLOCK_PIXELS, BlockTerms, Contents, Precision, TermBands};
use relume_core::files::folder_of;
use relume_core::image::Image;
use relume_core::{Error, Result};

use super::develop::Developer;
use super::records::{Records, relative};
use crate::capture::patterns::Samples;
use crate::rigs::{Condition, GantryRig};
use crate::session::{Photograph, Role};

/// How squares were photographed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scheme {
    /// One after another.
    Each,
    /// From horizontal and vertical sets.
    Crossed(Separable),
}

/// How `T` is stored.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Store {
    /// A picture a square.
    Samples(Precision),
    /// Terms of each pixel, up to a relative error.
    Terms(f64),
}

/// Everything that goes into the field of a gantry.
pub struct GantryPack<'a> {
    /// The photographs.
    pub records: &'a Records,
    /// The rig.
    pub rig: &'a GantryRig,
    /// The camera.
    pub developer: &'a Developer,
    /// How squares were photographed.
    pub scheme: Scheme,
    /// How `T` is stored.
    pub store: Store,
    /// Radiant intensity of the projector's white in the camera's unit, if it is known.
    pub intensity: Option<f64>,
    /// What red, green and blue are multiplied by, so that the projector's white is neutral.
    pub gains: [f32; 3],
    /// Coverage of the object, of the photographs' size.
    pub alpha: Option<Vec<f32>>,
}

/// What came of it.
#[derive(Debug, Default)]
pub struct Packed {
    /// Positions in the field.
    pub positions: usize,
    /// What a person should know, a sentence each.
    pub remarks: Vec<String>,
    /// Where squares that were lit together could not be told apart, one picture a position that has some of it.
    pub unreliable: Vec<(usize, Image)>,
    /// The relative error of terms.
    pub lost: Option<f64>,
    /// Share of the worst photograph that every exposure clips.
    pub clipped: f64,
}

/// Photographs of one position.
struct AtPosition<'a> {
    black: &'a Photograph,
    /// Of each pattern.
    patterns: Vec<&'a Photograph>,
    /// What the patterns are: a position of a session of sets may have its squares one by one as well, and then they count.
    scheme: Scheme,
}

/// The picture of reliability has this excess as white.
const FULL: f64 = 0.5;

impl GantryPack<'_> {
    /// The positions and squares.
    ///
    /// # Errors
    /// Squares that no projector has.
    pub fn domain(&self) -> Result<Gantry> {
        let poses = self.rig.places().into_iter().map(Pose::at_origin).collect();
        Gantry::new(poses, self.rig.squares, self.rig.view_deg.to_radians(), self.filter())
    }

    fn filter(&self) -> Filter {
        self.rig.filter
    }

    /// Photographs a position, without the black one, and the set they are of.
    fn patterns(&self, scheme: Scheme) -> (usize, &'static str) {
        match scheme {
            Scheme::Each => (self.rig.squares * self.rig.squares, Samples::Squares.set()),
            Scheme::Crossed(scheme) => (scheme.photographs(), Samples::Crossed.set()),
        }
    }

    /// The size of the photographs.
    ///
    /// # Errors
    /// No photograph; a file that is gone or changed.
    pub fn size(&self) -> Result<(usize, usize)> {
        let first = self.records.of(Role::Sample).next();
        let first = first.ok_or_else(|| Error::invalid("the session", "no photograph", "at least one"))?;
        Ok(self.records.codes(first, &first.frames[0])?.0.size())
    }

    /// Bytes of the samples of all positions.
    ///
    /// # Errors
    /// As [`GantryPack::size`].
    pub fn sample_bytes(&self, precision: Precision) -> Result<u64> {
        let (w, h) = self.size()?;
        let blocks = w.div_ceil(16) * h.div_ceil(BLOCK_HEIGHT) * 3;
        let squares = self.rig.squares * self.rig.squares * self.rig.positions.count();
        Ok((blocks * BLOCK_PIXELS * precision.bytes()) as u64 * squares as u64)
    }

    /// The photographs by position, all of them there.
    fn by_position(&self) -> Result<Vec<AtPosition<'_>>> {
        let mut found: HashMap<(&str, usize, usize), &Photograph> = HashMap::new();
        for photograph in self.records.of(Role::Sample) {
            if let Condition::Pattern { set, number, stop } = &photograph.condition {
                found.insert((set, *stop, *number), photograph);
            }
        }
        let under = |scheme: Scheme, stop: usize| -> Vec<Option<&Photograph>> {
            let (count, set) = self.patterns(scheme);
            (0..count).map(|number| found.get(&(set, stop, number)).copied()).collect()
        };
        let at = |stop: usize| -> Result<AtPosition<'_>> {
            let place = format!("position {}", stop + 1);
            let again = "go on with `relume capture --resume`";
            let Some(black) = self.records.find(Role::Black, &Condition::Black { stop }) else {
                let expected = format!(
                    "one: a projector's black is light, and is subtracted from every photograph (7.3); {again}"
                );
                return Err(Error::invalid(place, "no black photograph", expected));
            };
            let each: Option<Vec<&Photograph>> = under(Scheme::Each, stop).into_iter().collect();
            if let Some(patterns) = each {
                return Ok(AtPosition { black, patterns, scheme: Scheme::Each });
            }
            let patterns = under(self.scheme, stop);
            if let Some(missing) = patterns.iter().position(Option::is_none) {
                let lost = patterns.iter().filter(|p| p.is_none()).count();
                let (count, set) = self.patterns(self.scheme);
                let found = format!("{lost} of {count} patterns without a photograph, {set} {} first", missing + 1);
                return Err(Error::invalid(place, found, format!("all of them; {again}")));
            }
            Ok(AtPosition { black, patterns: patterns.into_iter().flatten().collect(), scheme: self.scheme })
        };
        (0..self.rig.positions.count()).map(at).collect()
    }

    /// Writes the container. `progress(steps done, steps)` may stop it.
    ///
    /// # Errors
    /// Positions without their photographs; files that are gone or changed; no room.
    pub fn write(
        &self,
        output: &Path,
        provenance: serde_json::Value,
        progress: &mut dyn FnMut(u64, u64) -> Result<()>,
    ) -> Result<Packed> {
        let positions = self.by_position()?;
        let (gantry, size) = (self.domain()?, self.size()?);
        let domain = field_domain(gantry)?;
        // And a step a position.
        let photographs: usize = positions.iter().map(|position| position.patterns.len() + 1).sum();
        let mut job = Job {
            pack: self,
            size,
            packed: Packed { positions: positions.len(), ..Packed::default() },
            ambient: None,
            sums: [vec![0.0; size.0 * size.1], vec![0.0; size.0 * size.1]],
            unit: self.unit(&positions)?,
            done: 0,
            total: (photographs + size.1.div_ceil(BLOCK_HEIGHT)) as u64,
        };
        let squares = self.rig.squares * self.rig.squares;
        let mut samples = Photographs::new(size.0, size.1, folder_of(output));
        let mut terms = match self.store {
            Store::Samples(_) => None,
            Store::Terms(error) => {
                let picture = relume_core::domain::Plane::new(self.rig.squares, self.rig.squares)?;
                Some(PositionTerms::new(size, (positions.len(), picture), error, output)?)
            }
        };
        for (stop, position) in positions.iter().enumerate() {
            match &mut terms {
                None => job.squares(stop, position, &mut samples, progress)?,
                Some(terms) => {
                    let mut own = Photographs::new(size.0, size.1, folder_of(output));
                    job.squares(stop, position, &mut own, progress)?;
                    terms.push(&mut own)?;
                }
            }
        }
        let intensities: Vec<f32> = (0..positions.len()).map(|stop| self.white(stop)).collect();
        let mut contents = Contents {
            domain,
            irradiance: intensities,
            width: size.0,
            height: size.1,
            colour_space: Default::default(),
            precision: Precision::Half,
            largest: samples.largest(),
            ambient: job.ambient.take(),
            alpha: self.alpha.clone(),
            reliability: job.reliability(),
            provenance,
        };
        let (done, total) = (job.done, job.total);
        match (&mut terms, self.store) {
            (Some(terms), _) => {
                contents.largest = terms.largest();
                job.packed.lost = Some(terms.lost());
                progress(done, total)?;
                let basis = terms.basis();
                field::write_terms(output, &contents, (basis, None), &mut Told { terms, progress, done, total })?;
            }
            (None, Store::Samples(precision)) => {
                contents.precision = precision;
                // It counts pictures of T and rows; pictures are done.
                let pictures = (squares * positions.len()) as u64;
                let step = &mut |at: u64, _: u64| progress(done + at.saturating_sub(pictures), total);
                field::write(output, &contents, &mut Reporting { photographs: &mut samples, progress: step, total })?;
            }
            (None, Store::Terms(_)) => {}
        }
        progress(total, total)?;
        Ok(job.packed)
    }

    /// From the camera's unit to that of the field.
    fn unit(&self, positions: &[AtPosition<'_>]) -> Result<f32> {
        if self.intensity.is_some() {
            return Ok(1.0);
        }
        // White facing the projector is taken as the white code of the middle exposure.
        let frames = positions.first().and_then(|position| position.patterns.first()).map(|p| &p.frames);
        let middle = frames.and_then(|frames| frames.get(frames.len() / 2)?.exposure.as_ref()).map(relative);
        let exposure =
            middle.ok_or_else(|| Error::invalid("the session", "no exposure times", "photographs with them"))?;
        Ok(exposure as f32)
    }

    /// Radiant intensity of white at a position: `pi d^2`, as if a white diffuser at the origin that faces it photographed as 1, where it was not
    /// measured.
    fn white(&self, stop: usize) -> f32 {
        match self.intensity {
            Some(intensity) => intensity as f32,
            None => PI * self.rig.places().get(stop).map_or(1.0, |place| place.norm_squared() as f32),
        }
    }

    /// A photograph as light, its own black subtracted, in the units of the field; and the share that is clipped.
    fn lit(&self, photograph: &Photograph, (black, size): (&Image, (usize, usize)), unit: f32) -> Result<(Image, f64)> {
        let merged = self.developer.develop(self.records, photograph)?;
        let mut picture = merged.image;
        if picture.size() != size {
            let found = format!("{} x {} pixels", picture.width(), picture.height());
            let place = format!("photograph {}", photograph.number);
            return Err(Error::invalid(place, found, format!("{} x {}, as the others", size.0, size.1)));
        }
        let factors = self.gains.map(|gain| gain * unit);
        for (pixel, black) in picture.data_mut().as_chunks_mut::<3>().0.iter_mut().zip(black.data().as_chunks::<3>().0)
        {
            (0..3).for_each(|c| pixel[c] = (pixel[c] - black[c]) * factors[c]);
        }
        Ok((picture, merged.report.clipped_everywhere.rgb.iter().sum::<f64>() / 3.0))
    }
}

/// The domain, if a container holds as many squares.
fn field_domain(gantry: Gantry) -> Result<relume_core::domain::Domain> {
    let domain = gantry.into();
    field::check_elements(&domain)?;
    Ok(domain)
}

/// Terms that tell how far writing has come, and stop where they are told to.
struct Told<'a> {
    terms: &'a mut PositionTerms,
    progress: &'a mut dyn FnMut(u64, u64) -> Result<()>,
    done: u64,
    total: u64,
}

impl TermBands for Told<'_> {
    fn fill(&mut self, bx: usize, by: usize, block: &mut BlockTerms) -> Result<()> {
        if bx == 0 {
            (self.progress)((self.done + by as u64).min(self.total), self.total)?;
        }
        self.terms.fill(bx, by, block)
    }
}

/// A field at work.
struct Job<'a> {
    pack: &'a GantryPack<'a>,
    size: (usize, usize),
    packed: Packed,
    ambient: Option<Image>,
    /// Of all positions: what was recovered, and what was photographed together.
    sums: [Vec<f64>; 2],
    unit: f32,
    done: u64,
    total: u64,
}

impl Job<'_> {
    /// `T` under each square of a position.
    fn squares(
        &mut self,
        stop: usize,
        position: &AtPosition<'_>,
        into: &mut Photographs,
        progress: &mut dyn FnMut(u64, u64) -> Result<()>,
    ) -> Result<()> {
        let black = self.pack.developer.picture(self.pack.records, position.black)?;
        if black.size() != self.size {
            let found = format!("a black photograph of {} x {} pixels", black.width(), black.height());
            let expected = format!("{} x {}, as the others", self.size.0, self.size.1);
            return Err(Error::invalid(format!("position {}", stop + 1), found, expected));
        }
        self.see_ambient(&black);
        let unit = self.unit / self.pack.white(stop);
        let mut gathering = match position.scheme {
            Scheme::Each => None,
            Scheme::Crossed(scheme) => {
                let mut gathering = scheme.gather(format!("position {}", stop + 1));
                // Subtracted already, as the photographs come.
                gathering.black(Image::new(self.size.0, self.size.1, 3));
                Some(gathering)
            }
        };
        let numbered: Vec<(usize, &Photograph)> = position.patterns.iter().copied().enumerate().collect();
        // As many at a time as there are threads: their order stays, memory stays bounded.
        for group in numbered.chunks(rayon::current_num_threads()) {
            let lit = |(_, photograph): &(usize, &Photograph)| self.pack.lit(photograph, (&black, self.size), unit);
            let pictures: Vec<Result<(Image, f64)>> = group.par_iter().map(lit).collect();
            for ((number, _), picture) in group.iter().zip(pictures) {
                let (picture, clipped) = picture?;
                self.packed.clipped = self.packed.clipped.max(clipped);
                match &mut gathering {
                    Some(gathering) => gathering.photograph(*number, picture)?,
                    None => {
                        // What was photographed apart is told apart.
                        self.add(0, &picture);
                        self.add(1, &picture);
                        into.push(picture)?;
                    }
                }
            }
            self.done += group.len() as u64;
            progress(self.done, self.total)?;
        }
        if let Some(gathering) = gathering {
            self.told_apart(stop, gathering, into)?;
        }
        self.done += 1;
        progress(self.done, self.total)
    }

    /// Squares from sets of them, and what is to be said of that.
    fn told_apart(&mut self, stop: usize, gathering: Gathering, into: &mut Photographs) -> Result<()> {
        let side = self.pack.rig.squares;
        let position = gathering.complete()?;
        for (row, column) in (0..side).flat_map(|row| (0..side).map(move |column| (row, column))) {
            let square = position.square(column, row);
            self.add(0, &square);
            into.push(square)?;
        }
        self.add(1, &position.white());
        let remarks = position.remarks(Reliability::THRESHOLD);
        if !remarks.is_empty() {
            self.packed.unreliable.push((stop, position.reliability().picture(FULL)));
        }
        self.packed.remarks.extend(remarks);
        Ok(())
    }

    /// Adds a picture to what was recovered (0), or photographed together (1).
    fn add(&mut self, which: usize, picture: &Image) {
        if self.pack.scheme != Scheme::Each {
            let grey = picture.data().as_chunks::<3>().0.iter().map(|rgb| f64::from(rgb.iter().sum::<f32>()));
            self.sums[which].iter_mut().zip(grey).for_each(|(sum, v)| *sum += v);
        }
    }

    /// S: a projector's black is light too, so the least of all positions is nearest to no light.
    fn see_ambient(&mut self, black: &Image) {
        let factors = self.pack.gains.map(|gain| gain * self.unit);
        let mut own = black.clone();
        own.data_mut().as_chunks_mut::<3>().0.iter_mut().for_each(|rgb| (0..3).for_each(|c| rgb[c] *= factors[c]));
        match &mut self.ambient {
            None => self.ambient = Some(own),
            Some(least) => least.data_mut().iter_mut().zip(own.data()).for_each(|(least, v)| *least = least.min(*v)),
        }
    }

    /// White over what was recovered: 1 where squares were told apart well, less where they got light of each other.
    fn reliability(&self) -> Option<Vec<f32>> {
        if self.pack.scheme == Scheme::Each {
            return None;
        }
        let share = |(recovered, white): (&f64, &f64)| {
            if *recovered > 0.0 && *white > 0.0 { (white / recovered).min(1.0) as f32 } else { 1.0 }
        };
        Some(self.sums[0].iter().zip(&self.sums[1]).map(share).collect())
    }
}
