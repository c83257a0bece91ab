//! The photographs of a screen's calibration patterns: of a session, or of a folder beside that of the patterns.

use std::path::PathBuf;

use relume_core::calibrate::screen::Shown;
use relume_core::domain::patterns::{Kind, PatternSet, emitted};
use relume_core::domain::{EmitterCurve, Plane};
use relume_core::image::{Encoding, Image, read};
use relume_core::{Error, Result};

use super::develop::Developer;
use super::records::Records;
use crate::rigs::{Condition, RigFile};
use crate::session::{Photograph, Role};

/// The sets that tell places, best first.
const SETS: [&str; 2] = ["gray-code", "stripes"];

/// Patterns, and what was seen of each.
#[derive(Debug)]
pub struct Shots<'a> {
    shown: Vec<Shown>,
    /// The set of each; white and black belong to all.
    sets: Vec<Option<&'static str>>,
    files: Files<'a>,
}

#[derive(Debug)]
enum Files<'a> {
    Session { records: &'a Records, developer: &'a Developer, photographs: Vec<Photograph> },
    Folder { photographs: Vec<PathBuf>, encoding: Encoding },
}

impl<'a> Shots<'a> {
    /// The calibration photographs of a session, its white and its black one.
    ///
    /// # Errors
    /// A session without, or of a rig without a screen.
    pub fn of_session(rig: &RigFile, records: &'a Records, developer: &'a Developer) -> Result<Self> {
        let Some(monitor) = &rig.monitor else {
            return Err(Error::invalid("the session", "a rig without a screen", "one of a monitor rig"));
        };
        let plane = Plane::new(monitor.columns, monitor.rows)?;
        let sets = [PatternSet::new(Kind::GrayCode, plane)?, PatternSet::new(Kind::Stripes(None), plane)?];
        let mut shots = Self {
            shown: Vec::new(),
            sets: Vec::new(),
            files: Files::Session { records, developer, photographs: Vec::new() },
        };
        let mut add = |shown: Shown, set: Option<&'static str>, photograph: &Photograph| {
            if let Files::Session { photographs, .. } = &mut shots.files {
                shots.shown.push(shown);
                shots.sets.push(set);
                photographs.push(photograph.clone());
            }
        };
        for photograph in records.of(Role::Calibration) {
            let Condition::Pattern { set, number, .. } = &photograph.condition else { continue };
            let Some(known) = SETS.iter().position(|name| name == set).filter(|n| *number < sets[*n].len()) else {
                continue;
            };
            add(Shown::of(&sets[known].pattern(*number)), Some(SETS[known]), photograph);
        }
        for (role, shown) in [(Role::AllLit, Shown::White), (Role::Black, Shown::Black)] {
            if let Some(photograph) = records.of(role).last() {
                add(shown, None, photograph);
            }
        }
        if shots.sets.iter().all(Option::is_none) {
            let expected = "photographs of gray-code or stripes: `patterns` under [calibration] of the rig file";
            return Err(Error::invalid("the session", "no calibration patterns", expected));
        }
        Ok(shots)
    }

    /// Pictures that were shown, and their photographs in the same order.
    ///
    /// # Errors
    /// Pictures that cannot be read, or in colour; as many photographs are needed as patterns.
    pub fn of_folders(patterns: &[PathBuf], photographs: Vec<PathBuf>, encoding: Encoding) -> Result<Self> {
        if patterns.len() != photographs.len() {
            let found = format!("{} photographs for {} patterns", photographs.len(), patterns.len());
            return Err(Error::invalid("the photographs", found, "one a pattern, in the order of their names"));
        }
        // What is black and white by codes is so by any curve.
        let shown = patterns.iter().map(|path| Ok(Shown::of(&emitted(path, &EmitterCurve::Linear, 1)?)));
        let shown = shown.collect::<Result<Vec<_>>>()?;
        let sets = shown.iter().map(|shown| matches!(shown, Shown::Stripes { .. }).then_some("patterns")).collect();
        Ok(Self { shown, sets, files: Files::Folder { photographs, encoding } })
    }

    /// How many.
    pub fn len(&self) -> usize {
        self.shown.len()
    }

    /// What was shown, of the set of this name alone (white and black belong to all); `None`: of all.
    pub fn shown(&self, set: Option<&str>) -> Vec<Shown> {
        let of = |of: &Option<&'static str>| set.is_none() || of.is_none() || *of == set;
        let keep = |(shown, of_set): (&Shown, _)| if of(of_set) { shown.clone() } else { Shown::Other };
        self.shown.iter().zip(&self.sets).map(keep).collect()
    }

    /// The set to fit a correspondence to.
    pub fn best_set(&self) -> Option<&'static str> {
        let has = |name: &&'static str| self.sets.contains(&Some(*name));
        SETS.iter().find(|name| has(name)).copied()
    }

    /// A set that is not the best one: to check the fit with.
    pub fn other_set(&self) -> Option<&'static str> {
        let best = self.best_set()?;
        SETS.iter().find(|name| **name != best && self.sets.contains(&Some(**name))).copied()
    }

    /// A photograph as light.
    ///
    /// # Errors
    /// A file that is gone, changed or no picture.
    pub fn picture(&self, n: usize) -> Result<Image> {
        match &self.files {
            Files::Session { records, developer, photographs } => developer.picture(records, &photographs[n]),
            Files::Folder { photographs, encoding } => read(&photographs[n], *encoding),
        }
    }
}
