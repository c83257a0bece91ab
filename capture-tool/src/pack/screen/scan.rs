//! A picture a square: brute force.

use std::path::Path;

use relume_core::acquire::Reporting;
use relume_core::domain::Plane;
use relume_core::field::{self, BLOCK_HEIGHT, Contents, Precision};
use relume_core::image::Image;
use relume_core::{Error, Result};

use super::emitted::Emitted;
use super::photographs::Photographs;
use super::view::{Ready, View};
use crate::progress::{Progress, Unit};
use crate::session::Photograph;

/// Everything that goes into the field.
pub struct ScanPack<'a> {
    /// The photographs.
    pub photographs: &'a Photographs<'a>,
    /// One a square, in their order.
    pub list: &'a [&'a Photograph],
    /// The squares on the screen.
    pub emitted: &'a Emitted,
    /// Squares along each side.
    pub side: usize,
    /// Where pixels look.
    pub view: &'a View,
    /// The same, ready.
    pub ready: &'a Ready,
    /// How `T` is stored.
    pub precision: Precision,
}

impl ScanPack<'_> {
    /// Writes the field: its texels are the squares.
    ///
    /// # Errors
    /// Squares without a photograph; files that are gone or changed; no room.
    pub fn write(&self, output: &Path, provenance: serde_json::Value) -> Result<()> {
        let (count, size) = (self.emitted.patterns.len(), self.photographs.size());
        if self.list.len() != count {
            let found = format!("{} photographs for {count} squares", self.list.len());
            return Err(Error::invalid("the session", found, "one a square: go on with `relume capture --resume`"));
        }
        let mut progress = Progress::new("packing", Unit::Steps);
        let take_out = |n: usize, picture: &mut Image| {
            self.ready.of_object(picture, &self.emitted.patterns[n].values);
        };
        let total = (count + size.1.div_ceil(BLOCK_HEIGHT)) as u64;
        let step = &mut |done, _| progress.step(done, total);
        let mut gathered = self.photographs.gathered(self.list, output, &take_out, step)?;
        let mut ambient = self.photographs.black().cloned();
        ambient.iter_mut().for_each(|ambient| self.ready.in_units(ambient));
        let contents = Contents {
            domain: self.view.domain(Plane::new(self.side, self.side)?),
            irradiance: Vec::new(),
            width: size.0,
            height: size.1,
            colour_space: self.photographs.colour_space(),
            precision: self.precision,
            largest: gathered.largest(),
            ambient,
            alpha: self.view.alpha.clone(),
            reliability: None,
            provenance,
        };
        let step = &mut |done, all| progress.step(done, all);
        let mut bands = Reporting { photographs: &mut gathered, progress: step, total };
        field::write(output, &contents, &mut bands)
    }
}
