//! Movement of object or camera, and drift of the lamps, from the references.

use relume_core::Result;
use relume_core::calibrate::drift::Drift;
use relume_core::calibrate::movement::{Movement, movement};
use relume_core::image::Image;

use super::develop::Developer;
use super::records::Records;
use crate::rigs::Condition;
use crate::session::{Photograph, Role};

/// What the references say.
#[derive(Debug, Default)]
pub struct Checks {
    drift: Option<Drift>,
    /// Numbers of the references, with what moved since the first.
    movements: Vec<(u64, Movement)>,
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
        let reference = picture(first)?;
        let mut drift = Drift::new(reference.clone(), first.number as f64)?;
        let mut movements = Vec::new();
        for photograph in references {
            let later = picture(photograph)?;
            drift.add(&later, photograph.number as f64)?;
            movements.push((photograph.number, movement(&reference, &later)));
        }
        Ok(Self { drift: Some(drift), movements })
    }

    /// Is drift corrected?
    pub fn corrects(&self) -> bool {
        !self.movements.is_empty()
    }

    /// The lamps' light at a photograph, in units of the first reference's.
    pub fn gain(&self, number: u64) -> [f32; 3] {
        self.drift.as_ref().map_or([1.0; 3], |drift| drift.gain(number as f64))
    }

    /// For the report.
    pub fn words(&self) -> String {
        let (Some(drift), false) = (&self.drift, self.movements.is_empty()) else { return String::new() };
        let largest = self.movements.iter().filter_map(|(_, movement)| match movement {
            Movement::Known(shift) => Some(shift.pixels[0].hypot(shift.pixels[1])),
            Movement::Unknown(_) => None,
        });
        format!(
            "movement   at most {:.2} pixels, by {} references\ndrift      at most {:+.1} %, corrected\n",
            largest.fold(0.0, f64::max),
            self.movements.len() + 1,
            100.0 * drift.largest()
        )
    }

    /// What a person should know, a sentence each: the first movement, since later ones follow from it, and drift.
    pub fn doubts(&self) -> impl Iterator<Item = String> {
        let verdict = |(number, movement): &(u64, Movement)| movement.verdict(&format!("photograph {number}"));
        let moved = self.movements.iter().find_map(verdict);
        moved.into_iter().chain(self.drift.as_ref().and_then(Drift::verdict))
    }
}
