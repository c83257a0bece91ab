//! The conditions of a screen (6.3) and of a projector (7.3), in order: calibration, then for each position the black
//! photograph, which is subtracted (7.3), the white one, and the patterns. Horizontal and vertical sets need no white photograph: it
//! is the sum of either set, so a position is black and 2 d n photographs (7.5).

use std::collections::BTreeMap;

use relume_core::domain::patterns::{Element, Kind, Noise, PatternSet};
use relume_core::domain::{Filter, Plane};
use relume_core::{Error, Result};

use super::{Step, Times};
use crate::rigs::{Condition, GantryRig, MonitorRig, PartsChoice, RigFile};
use crate::session::Role;

/// Pattern sets by name, as conditions call them.
pub type Sets = BTreeMap<String, PatternSet>;

/// Which patterns make the samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Samples {
    /// One square after another.
    Squares,
    /// Wavelet noise (6.7).
    Noise,
    /// Horizontal and vertical sets of squares (7.5).
    Crossed,
    /// Basis functions of a wavelet, chosen while they are shown (6.6).
    Functions,
    /// None: the object is away.
    Bare,
}

impl Samples {
    /// The name of the set.
    pub fn set(self) -> &'static str {
        match self {
            Samples::Squares => "squares",
            Samples::Noise => "noise",
            Samples::Crossed => "hv",
            Samples::Functions => "wavelet",
            Samples::Bare => "none",
        }
    }
}

/// The sets that a rig shows.
///
/// # Errors
/// Sizes that do not go together.
pub fn sets(rig: &RigFile, samples: Samples, seed: u64) -> Result<Sets> {
    let (plane, side, influence, filter) = match (&rig.monitor, &rig.gantry) {
        (Some(MonitorRig { columns, rows, squares, .. }), _) => {
            (Plane::new(*columns, *rows)?, *squares, 1, Filter::Box)
        }
        (None, Some(gantry)) => {
            let GantryRig { squares, influence, filter, .. } = gantry;
            (Plane::new(gantry.pixels(), gantry.pixels())?, *squares, *influence, *filter)
        }
        (None, None) => return Err(Error::invalid("rig", "no screen and no projector", "one")),
    };
    let mut sets = Sets::new();
    let wavelet = || rig.monitor.as_ref().map_or("haar", |m| m.wavelet.as_str()).parse();
    let kind = match samples {
        Samples::Squares => Some(Kind::Squares { side, filter }),
        Samples::Crossed => Some(Kind::Crossed { side, influence, filter }),
        Samples::Noise => {
            let count = rig.monitor.as_ref().map_or(0, |m| m.noise);
            Some(Kind::Noise(Noise { wavelet: wavelet()?, count, seed, deviation: Noise::DEVIATION }))
        }
        Samples::Functions => Some(match rig.monitor.as_ref().map(|m| m.parts) {
            Some(PartsChoice::Shifted) => Kind::Shifted(wavelet()?),
            _ => Kind::Wavelet(wavelet()?),
        }),
        Samples::Bare => None,
    };
    if let Some(kind) = kind {
        sets.insert(samples.set().to_owned(), PatternSet::new(kind, plane)?);
    }
    for name in &rig.calibration.patterns {
        let kind = match name.as_str() {
            "ramp" => Kind::Ramp,
            "gray-code" => Kind::GrayCode,
            _ => Kind::Stripes(None),
        };
        sets.insert(name.clone(), PatternSet::new(kind, plane)?);
    }
    Ok(sets)
}

/// The steps of a screen or a projector, all of them where they are known beforehand. Of [`Samples::Functions`] those before
/// the first function: black and white twice, for their noise.
pub fn steps(rig: &RigFile, sets: &Sets, samples: Samples) -> Vec<Step> {
    let positions = rig.gantry.as_ref().map_or(1, |gantry| gantry.positions.count());
    let mut steps: Vec<Step> = Vec::new();
    let mut scanned = 0;
    let mut add = |condition: Condition, role: Role, times: Times| {
        steps.push(Step { index: steps.len() as u64, condition, role, times, scanned });
        scanned += u64::from(role == Role::Sample);
    };
    let usual = || Times::Series { of: Role::Sample, factor: 1.0 };
    if !rig.calibration.dark_times_s.is_empty() {
        add(Condition::Black { stop: 0 }, Role::Dark, Times::Fixed(rig.calibration.dark_times_s.clone()));
    }
    if !rig.calibration.response_times_s.is_empty() {
        add(Condition::White { stop: 0 }, Role::Response, Times::Fixed(rig.calibration.response_times_s.clone()));
    }
    if rig.camera.times_s.is_none() {
        for condition in previews(sets, samples, positions) {
            add(condition, Role::Preview, Times::Fixed(super::scan::preview_times(rig)));
        }
    }
    for name in &rig.calibration.patterns {
        let count = sets.get(name).map_or(0, PatternSet::len);
        for number in 0..count {
            add(Condition::Pattern { set: name.clone(), number, stop: 0 }, Role::Calibration, usual());
        }
    }
    let count = sets.get(samples.set()).map_or(0, PatternSet::len);
    let times = if samples == Samples::Functions { 2 } else { 1 };
    let count = if samples == Samples::Functions { 0 } else { count };
    for stop in 0..positions {
        (0..times).for_each(|_| add(Condition::Black { stop }, Role::Black, usual()));
        if samples != Samples::Crossed {
            (0..times).for_each(|_| add(Condition::White { stop }, Role::AllLit, usual()));
        }
        for number in 0..count {
            let set = samples.set().to_owned();
            add(Condition::Pattern { set, number, stop }, Role::Sample, usual());
        }
    }
    steps
}

/// Steps from here on are squares one by one of positions that sets of squares did not do for; they come after all others.
const ONE_BY_ONE: u64 = 1 << 33;

/// Black and every square of some positions (from 1, as people count them), and their set among the others. Steps of a position are the
/// same whichever others are asked for.
///
/// # Errors
/// A position that the rig does not have.
pub fn one_by_one(rig: &RigFile, positions: &[u64], sets: &mut Sets) -> Result<Vec<Step>> {
    let count = rig.gantry.as_ref().map_or(0, |gantry| gantry.positions.count());
    if let Some(wrong) = positions.iter().find(|position| !(1..=count as u64).contains(position)) {
        let expected = format!("positions from 1 to {count}");
        return Err(Error::invalid("--brute-force", format!("position {wrong}"), expected));
    }
    let squares = self::sets(rig, Samples::Squares, 0)?.remove(Samples::Squares.set());
    let all = squares.as_ref().map_or(0, PatternSet::len);
    sets.extend(squares.map(|set| (Samples::Squares.set().to_owned(), set)));
    let mut steps = Vec::new();
    for stop in positions.iter().map(|position| *position as usize - 1) {
        let first = ONE_BY_ONE + (stop * (all + 1)) as u64;
        let step = |n: usize, condition: Condition, role: Role| Step {
            index: first + n as u64,
            condition,
            role,
            times: Times::Series { of: Role::Sample, factor: 1.0 },
            scanned: 0,
        };
        steps.push(step(0, Condition::Black { stop }, Role::Black));
        let square = |number: usize| Condition::Pattern { set: Samples::Squares.set().to_owned(), number, stop };
        steps.extend((0..all).map(|number| step(number + 1, square(number), Role::Sample)));
    }
    Ok(steps)
}

/// The photographs of so many functions, were they taken coarsest first: how many there will be at most.
pub fn functions(set: &PatternSet, count: usize, first: u64) -> Vec<Step> {
    let mut shown = 0;
    let belongs = |number: &usize| {
        let second = matches!(set.element(*number), Element::Wavelet { negative: true, .. });
        shown += usize::from(!second);
        shown <= count
    };
    let step = |number: usize| Step {
        index: first + number as u64,
        condition: Condition::Pattern { set: Samples::Functions.set().to_owned(), number, stop: 0 },
        role: Role::Sample,
        times: Times::Series { of: Role::Sample, factor: 1.0 },
        scanned: number as u64,
    };
    (0..set.len()).take_while(belongs).map(step).collect()
}

/// Functions among the coarser half of what explicit sampling is likely to show.
const PREVIEWED_FUNCTION: usize = 128;

/// White, the brightest; and patterns in the middle of the set, from several positions.
fn previews(sets: &Sets, samples: Samples, positions: usize) -> Vec<Condition> {
    let Some(set) = sets.get(samples.set()) else { return vec![Condition::White { stop: 0 }] };
    let middle = match samples {
        Samples::Functions => (set.len() / 2).min(PREVIEWED_FUNCTION),
        _ => set.len() / 2,
    };
    let mut stops = vec![0, positions / 3, 2 * positions / 3];
    stops.dedup();
    let pattern = |stop: usize| Condition::Pattern { set: samples.set().to_owned(), number: middle, stop };
    stops.into_iter().flat_map(|stop| [Condition::White { stop }, pattern(stop)]).collect()
}
