//! Explicit sampling (6.6): a basis function is shown in its parts, the photographs are developed and weighed, and what they
//! weigh decides which functions come next.
//!
//! First all that a screen is calibrated by, then black and white twice each: two photographs of the same tell the noise. Of
//! the object's pictures three are kept in memory (black, white, what is left of the bound), and the one or two of the
//! function in hand; a resumed capture reads its photographs again.

use std::collections::{HashMap, VecDeque};
use std::path::{Path, PathBuf};

use relume_core::acquire::explicit::{Bound, Growth, Measure, Noise, Parts, Weight};
use relume_core::domain::patterns::{Element, Kind, PatternSet};
use relume_core::image::Image;
use relume_core::wavelet::Transform;
use relume_core::{Error, Result};

use super::patterns::{Samples, Sets};
use super::{Sampler, Step, Times};
use crate::pack::covered::covered;
use crate::pack::develop::Developer;
use crate::pack::records::Records;
use crate::rigs::{Condition, MonitorRig, RigFile};
use crate::session::{Photograph, Role};

/// Asks for functions, by what was seen of others.
#[derive(Debug)]
pub struct Explicit {
    root: PathBuf,
    rig: RigFile,
    /// Steps before the first function.
    opening: Vec<Step>,
    set: PatternSet,
    /// Numbers of the patterns of each function.
    parts: HashMap<u32, Vec<usize>>,
    /// Functions at most.
    most: usize,
    growth: Growth,
    weight: Weight,
    /// Patterns that a run before this one showed, by step.
    recorded: HashMap<u64, usize>,
    /// Functions asked for.
    begun: usize,
    /// Patterns of the function in hand.
    asked: VecDeque<usize>,
    /// The next step's.
    index: u64,
    /// Photographs of black and white.
    plain: Vec<Photograph>,
    scale: Option<Scale>,
    /// The photograph of a positive part whose negative one is to come.
    half: Option<Image>,
    over: bool,
}

/// What photographs are weighed with.
#[derive(Debug)]
struct Scale {
    records: Records,
    developer: Developer,
    black: Image,
    white: Image,
    measure: Measure,
    bound: Bound,
    /// Pixels that count, of all.
    counted: [usize; 2],
}

impl Explicit {
    /// Begins, or goes on where the journal of `root` ends. `opening` are the steps before the first function; `sets` has the
    /// functions in their parts.
    ///
    /// # Errors
    /// A rig without a screen; a journal that cannot be read.
    pub fn new(root: &Path, rig: &RigFile, opening: Vec<Step>, sets: &Sets) -> Result<Self> {
        let set = sets.get(Samples::Functions.set());
        let (Some(monitor), Some(set)) = (&rig.monitor, set) else {
            return Err(Error::invalid("rig", "no screen", "one"));
        };
        let weight = Weight { smoothness: monitor.smoothness, ..Weight::default() };
        let mut parts: HashMap<u32, Vec<usize>> = HashMap::new();
        for number in 0..set.len() {
            parts.entry(location(set, number)?).or_default().push(number);
        }
        let records = Records::read(root)?;
        let shown = records.of(Role::Sample).filter_map(|p| match p.condition {
            Condition::Pattern { number, .. } if number < set.len() => Some((p.step, number)),
            _ => None,
        });
        Ok(Self {
            root: root.to_owned(),
            rig: rig.clone(),
            opening,
            growth: Growth::new(transform(monitor, set)?.tree(), weight, monitor.threshold),
            set: set.clone(),
            parts,
            most: monitor.functions,
            weight,
            recorded: shown.collect(),
            begun: 0,
            asked: VecDeque::new(),
            index: 0,
            plain: Vec::new(),
            scale: None,
            half: None,
            over: false,
        })
    }

    /// All before the first function is there: what photographs are weighed with follows from it. Samples are not looked at,
    /// so that a resumed capture comes to the same.
    fn begin(&mut self) -> Result<()> {
        let records = Records::read(&self.root)?;
        let developer = Developer::for_previews(&records, &self.rig.camera)?;
        let pictures = |role: Role| -> Result<Vec<Image>> {
            let of_role = self.plain.iter().filter(|p| p.role == role);
            of_role.map(|photograph| developer.picture(&records, photograph)).collect()
        };
        let (blacks, whites) = (pictures(Role::Black)?, pictures(Role::AllLit)?);
        let ([black, black2], [white, white2]) = (&blacks[..], &whites[..]) else {
            return Err(Error::invalid(
                "the session",
                "no black and white photographs",
                "two of each, which come first",
            ));
        };
        let noise = Noise::measured(&[(black, black2), (white, white2)])?;
        let (black, white) = (mean(black, black2), mean(white, white2));
        let mut lit = white.clone();
        lit.data_mut().iter_mut().zip(black.data()).for_each(|(v, s)| *v -= s);
        let covered = covered(&self.rig, &records, &developer, lit.width() * lit.height())?;
        let tree = Transform::tree(&transform(self.monitor()?, &self.set)?);
        let bound = Bound::new(tree, self.weight, &lit, covered.clone())?;
        let counted = [covered.iter().filter(|covered| **covered).count(), covered.len()];
        let measure = Measure::new(covered, noise);
        self.scale = Some(Scale { records, developer, black, white, measure, bound, counted });
        Ok(())
    }

    fn monitor(&self) -> Result<&MonitorRig> {
        self.rig.monitor.as_ref().ok_or_else(|| Error::invalid("rig", "no screen", "one"))
    }

    /// The next function's patterns, or none.
    fn ask(&mut self) -> Result<()> {
        if self.begun >= self.most {
            return Ok(());
        }
        let before = self.recorded.get(&self.index).map(|number| location(&self.set, *number)).transpose()?;
        if let Some(location) = self.growth.next(before) {
            self.begun += 1;
            self.asked.extend(&self.parts[&location]);
        }
        Ok(())
    }

    /// A function was seen whole.
    fn weigh(&mut self, number: usize, parts: &Parts<'_>) -> Result<()> {
        let Some(scale) = &mut self.scale else { return Ok(()) };
        let location = location(&self.set, number)?;
        let gain = self.set.scale(number);
        let picture = parts.picture(gain, &scale.black, &scale.white)?;
        let norm = scale.measure.norm(parts, gain, &picture);
        self.growth.observe(location, &norm);
        if let Parts::Split(positive, negative) = parts {
            let numbers = &self.parts[&location];
            let area = numbers.iter().flat_map(|n| self.set.pattern(*n).values).map(f64::from).sum();
            let [positive, negative, black] = [positive.data(), negative.data(), scale.black.data()];
            scale.bound.shown(location, |n| positive[n] + negative[n] - 2.0 * black[n], area);
        }
        Ok(())
    }
}

impl Sampler for Explicit {
    fn next(&mut self) -> Result<Option<Step>> {
        if let Some(step) = self.opening.get(self.index as usize) {
            self.index += 1;
            return Ok(Some(step.clone()));
        }
        // Where black and white were left out, as by `--only calibration`, nothing can be weighed.
        if self.scale.is_some() && self.asked.is_empty() {
            self.ask()?;
        }
        let Some(number) = self.asked.pop_front() else {
            self.over = true;
            return Ok(None);
        };
        let step = Step {
            index: self.index,
            condition: Condition::Pattern { set: Samples::Functions.set().to_owned(), number, stop: 0 },
            role: Role::Sample,
            times: Times::Series { of: Role::Sample, factor: 1.0 },
            scanned: self.index - self.opening.len() as u64,
        };
        self.index += 1;
        Ok(Some(step))
    }

    fn observe(&mut self, step: &Step, photograph: &Photograph) -> Result<()> {
        if (step.index as usize) < self.opening.len() {
            if matches!(step.role, Role::Black | Role::AllLit) {
                self.plain.push(photograph.clone());
            }
            return if step.index as usize + 1 == self.opening.len() { self.begin() } else { Ok(()) };
        }
        let (Some(scale), Condition::Pattern { number, .. }) = (&self.scale, &step.condition) else { return Ok(()) };
        let picture = scale.developer.picture(&scale.records, photograph)?;
        match self.set.element(*number) {
            Element::Shifted { .. } => self.weigh(*number, &Parts::Shifted(&picture)),
            Element::Wavelet { negative: true, .. } => {
                let Some(positive) = self.half.take() else {
                    return Err(Error::invalid(step.condition.to_string(), "no positive part", "one before it"));
                };
                self.weigh(*number, &Parts::Split(&positive, &picture))
            }
            _ if self.asked.is_empty() => self.weigh(*number, &Parts::Positive(&picture)),
            _ => {
                self.half = Some(picture);
                Ok(())
            }
        }
    }

    fn expected(&self) -> u64 {
        if self.over {
            return self.index;
        }
        let each = if matches!(self.set.kind(), Kind::Shifted(_)) { 1 } else { 2 };
        let rest = each * self.most.min(self.parts.len()).saturating_sub(self.begun) + self.asked.len();
        // Scaling functions that are nowhere negative have one part.
        let shown = self.parts.values().filter(|parts| parts.len() < each).count();
        let single = if self.begun == 0 { shown } else { 0 };
        self.index.max(self.opening.len() as u64) + (rest - single.min(rest)) as u64
    }

    fn said(&self) -> Option<String> {
        let count = self.growth.members().len();
        let scale = self.scale.as_ref().filter(|_| count > 0)?;
        let most = self.most.min(self.parts.len());
        let [counted, pixels] = scale.counted;
        let mut text = format!("function {count} of {most} by {counted} of {pixels} pixels");
        if !matches!(self.set.kind(), Kind::Shifted(_)) {
            text += &format!(": what is left of the bound (6.7) {:.1} %", 100.0 * scale.bound.share());
        }
        if let Some(leaf) = self.growth.largest_leaf() {
            text += &format!(", heaviest place without finer ones {leaf:.3} of the white screen");
        } else if self.over && count < most {
            text += ", all that is left is noise";
        }
        Some(text)
    }
}

/// Where the coefficient of a pattern lies.
///
/// # Errors
/// A pattern that is no part of a basis function.
pub fn location(set: &PatternSet, number: usize) -> Result<u32> {
    match set.element(number) {
        Element::Wavelet { location, .. } | Element::Shifted { location, .. } => Ok(location),
        other => {
            Err(Error::invalid("explicit sampling", format!("the pattern {other}"), "basis functions of a wavelet"))
        }
    }
}

/// The transform whose columns of S are shown.
fn transform(monitor: &MonitorRig, set: &PatternSet) -> Result<Transform> {
    set.plane().transform(monitor.wavelet.parse()?)
}

fn mean(a: &Image, b: &Image) -> Image {
    let mut mean = a.clone();
    mean.data_mut().iter_mut().zip(b.data()).for_each(|(a, b)| *a = 0.5 * (*a + b));
    mean
}
