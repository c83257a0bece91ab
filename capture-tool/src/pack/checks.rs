//! Movement of object or camera, and drift of the lamps, from the references.

use relume_core::Result;
use relume_core::calibrate::drift::{Drift, Point};
use relume_core::calibrate::movement::Movement;
use relume_core::image::Image;

use super::develop::Developer;
use super::records::Records;
use crate::rigs::Condition;
use crate::session::{Photograph, Role};

/// What the references say.
#[derive(Debug, Default)]
pub struct Checks {
    drift: Option<Drift>,
}

impl Checks {
    /// Looks at all references; with fewer than two there is nothing to say.
    ///
    /// # Errors
    /// Files that are gone or changed; a reference without light.
    pub fn new(records: &Records, developer: &Developer) -> Result<Self> {
        let mut references = records.of(Role::Reference);
        let Some(first) = references.next() else { return Ok(Self::default()) };
        let black = records.find(Role::Black, &Condition::Black { stop: 0 });
        let black = black.map(|black| developer.picture(records, black)).transpose()?;
        let picture = |photograph: &Photograph| -> Result<Image> {
            let mut picture = developer.picture(records, photograph)?;
            if let Some(black) = &black {
                picture.data_mut().iter_mut().zip(black.data()).for_each(|(v, s)| *v -= s);
            }
            Ok(picture)
        };
        let mut drift = Drift::new(picture(first)?, first.number as f64)?;
        for photograph in references {
            drift.add(&picture(photograph)?, photograph.number as f64)?;
        }
        Ok(Self { drift: Some(drift) })
    }

    /// Is drift corrected?
    pub fn corrects(&self) -> bool {
        self.drift.as_ref().is_some_and(|drift| drift.points().len() > 1)
    }

    /// The lamps' light at a photograph, in units of the first reference's.
    pub fn gain(&self, number: u64) -> [f32; 3] {
        self.drift.as_ref().map_or([1.0; 3], |drift| drift.gain(number as f64))
    }

    /// For the report.
    pub fn words(&self) -> String {
        let Some(drift) = self.drift.as_ref().filter(|_| self.corrects()) else { return String::new() };
        let shift = |point: &Point| match &point.movement {
            Some(Movement::Known(shift)) => shift.pixels[0].hypot(shift.pixels[1]),
            Some(Movement::Unknown(_)) | None => 0.0,
        };
        format!(
            "movement   at most {:.2} pixels, by {} references\ndrift      at most {:+.1} %, corrected\n",
            drift.points().iter().map(shift).fold(0.0, f64::max),
            drift.points().len(),
            100.0 * drift.largest()
        )
    }

    /// What a person should know, a sentence each: the first movement, since later ones follow from it, and drift.
    pub fn doubts(&self) -> Vec<String> {
        let Some(drift) = &self.drift else { return Vec::new() };
        let moved = drift.moved(|number| format!("photograph {number}"));
        moved.into_iter().take(1).chain(drift.verdict()).collect()
    }
}
