//! For each pixel its own set of wavelet coefficients: rebuilt on a grid, transformed, chosen, rounded, measured.
//!
//! Of the coefficients `c = A t` those with the largest `|c_j| ||s_j||` are kept, `|c_j|` over the three channels. What is
//! dropped would be the squared error if the basis were orthonormal; as the 5/3 and the 9/7 are not, and halves round, the
//! sets are decoded, `t' = S c`, and where the error asked for is missed, or met by far, chosen anew with a threshold
//! corrected by what was found.

use std::path::Path;

use half::f16;
use rayon::prelude::*;

use super::errors::BlockErrors;
use super::selection::Selection;
use super::survey::survey;
use super::wavelet_arrays::{Arrays, CodedBlock};
use super::{Made, Progress, Stage};
use crate::domain::StageGrid;
use crate::error::{Error, Result};
use crate::field::asset::Asset;
use crate::field::dense::{BLOCK_PIXELS, CHANNELS};
use crate::field::terms::Term;
use crate::field::writer::power_of_two_for;
use crate::field::{BlockBuffer, Samples};
use crate::reconstruct::{Method, Reconstruction, Resampling};
use crate::wavelet::{Transform, Wavelet};

/// Pixels that are transformed together: their functions of one channel are as wide as a cache line.
const GROUP: usize = 16;
/// Blocks in flight for each thread: their terms wait in memory for their turn.
const BLOCKS_A_THREAD: usize = 4;
/// Rebuilding and the analysis filters overshoot; together by less than this. Coefficients of the coarsest level are larger
/// than what they stand for by 2 a level.
const OVERSHOOT: f32 = 4.0;
/// Sets whose error is this part of what was asked for are not tried to be made smaller.
const CLOSE_ENOUGH: f64 = 0.95;
/// A corrected threshold aims at this part of the squared error.
const AIM: f64 = 0.97;
/// A budget grows by no more than this at a time.
const MOST_GROWTH: f64 = 4.0;
/// The smallest error that can be asked for: rounding to halves alone, to 11 bits, is some 3e-4.
const LEAST_ERROR: f64 = 1e-3;
/// Choices after which a set that will do is left as it is.
const TRIES: usize = 3;
/// Choices after which the best that halves allow is taken as it is.
const MOST_TRIES: usize = 12;

/// [`super::Scheme::Wavelet`].
#[derive(Debug, Clone, Copy)]
pub struct Wanted {
    pub wavelet: Wavelet,
    pub grid: (usize, usize),
    pub reconstruction: Method,
    pub error: Option<f64>,
    pub terms: Option<usize>,
}

impl Wanted {
    fn check(&self) -> Result<()> {
        if let Some(error) = self.error.filter(|error| !(LEAST_ERROR..1.0).contains(error)) {
            let expected =
                format!("{LEAST_ERROR} to 1, such as 0.01: halves keep no less, and an error of 1 keeps nothing");
            return Err(Error::invalid("the error of wavelets", error.to_string(), expected));
        }
        match (self.error, self.terms) {
            (None, None) => {
                Err(Error::invalid("wavelets", "neither an error nor a number of terms", "one of them, or both"))
            }
            _ if self.reconstruction.id().is_empty() => {
                let found = format!("{:?}", self.reconstruction);
                Err(Error::invalid("the reconstruction of wavelets", found, "one that has a name"))
            }
            (_, Some(0)) => Err(Error::invalid("the terms of wavelets", "0", "at least 1 a pixel, such as 256")),
            _ => Ok(()),
        }
    }
}

/// Rebuilds, transforms, chooses and measures; see [`super::compress`].
pub fn compress(
    asset: &Asset,
    samples: Samples<'_>,
    wanted: &Wanted,
    output: &Path,
    progress: &mut Progress<'_>,
) -> Result<Made> {
    wanted.check()?;
    let mut coder = Coder::new(asset, samples.scale(), wanted)?;
    let largest = survey(samples, progress)?.largest;
    coder.scale = power_of_two_for(largest * OVERSHOOT * (coder.transform.tree().levels() as f32).exp2());
    let layout = samples.layout();
    let mut coded = Arrays::new(layout, wanted, coder.scale, output)?;
    let together = BLOCKS_A_THREAD * rayon::current_num_threads();
    for by in 0..layout.rows() {
        for first in (0..layout.columns()).step_by(together) {
            let columns = first..(first + together).min(layout.columns());
            let blocks: Vec<CodedBlock> = columns
                .clone()
                .into_par_iter()
                .map_init(Room::default, |room, bx| coder.block(samples, bx, by, room))
                .collect::<Result<_>>()?;
            for (bx, block) in columns.zip(&blocks) {
                coded.push(bx, by, block)?;
            }
        }
        progress(Stage::Compressing, by as u64 + 1, layout.rows() as u64)?;
    }
    Ok(Box::new(coded))
}

/// What is the same for all pixels.
struct Coder {
    resampling: Resampling,
    transform: Transform,
    /// `||s_j||^2`, by location.
    squared_norms: Vec<f32>,
    most: usize,
    error: Option<f64>,
    /// T = number x this.
    samples_scale: f32,
    /// coefficient = half x this.
    scale: f32,
}

/// A pixel's terms and what they lack, in the numbers of the samples.
#[derive(Debug, Clone, Default)]
struct Coding {
    terms: Vec<Term>,
    lost: [f64; CHANNELS],
}

/// Memory to work in. Functions lie `[texel][pixel of the group]`, one array a channel.
#[derive(Default)]
struct Room {
    buffer: BlockBuffer,
    numbers: [Vec<f32>; CHANNELS],
    samples: Vec<f32>,
    functions: [Vec<f32>; CHANNELS],
    coefficients: [Vec<f32>; CHANNELS],
    decoded: [Vec<f32>; CHANNELS],
    /// `[pixel of the group][location]`: `||s_j||^2 sum_c c_j^2`.
    squares: Vec<f32>,
    selection: Selection,
    chosen: Vec<u32>,
}

/// A pixel whose set is being looked for.
struct Search {
    /// Squared norm of its function.
    energy: f64,
    /// How much the dropped squares may come to.
    budget: f64,
    /// What is left by the last choice, and whether the count ended it.
    left: f64,
    full: bool,
    current: Coding,
    /// The smallest set that will do so far.
    best: Option<Coding>,
    done: bool,
}

impl Coder {
    fn new(asset: &Asset, samples_scale: f32, wanted: &Wanted) -> Result<Self> {
        let grid = StageGrid::new(asset.directions()?, wanted.grid)?;
        let transform = grid.transform(wanted.wavelet)?;
        let reconstruction = Reconstruction::new(asset.directions()?.clone(), wanted.reconstruction)?;
        Ok(Self {
            resampling: Resampling::new(&reconstruction, grid.directions()?.lamps()),
            squared_norms: transform.synthesis_norms().iter().map(|norm| norm * norm).collect(),
            most: wanted.terms.unwrap_or(usize::MAX),
            error: wanted.error,
            transform,
            samples_scale,
            scale: 1.0,
        })
    }

    /// All pixels of a block that are not black, group by group.
    fn block(&self, samples: Samples<'_>, bx: usize, by: usize, room: &mut Room) -> Result<CodedBlock> {
        let mut lit = [false; BLOCK_PIXELS];
        for (c, numbers) in room.numbers.iter_mut().enumerate() {
            samples.read(bx, by, c, &mut room.buffer, numbers)?;
            for lamp in numbers.chunks_exact(BLOCK_PIXELS) {
                lit.iter_mut().zip(lamp).for_each(|(lit, t)| *lit |= *t != 0.0);
            }
        }
        let pixels: Vec<usize> = (0..BLOCK_PIXELS).filter(|&k| lit[k]).collect();
        let mut block = CodedBlock { counts: [0; BLOCK_PIXELS], terms: Vec::new(), errors: BlockErrors::default() };
        let square = f64::from(self.samples_scale) * f64::from(self.samples_scale);
        for group in pixels.chunks(GROUP) {
            for (&k, search) in group.iter().zip(self.group(group, room)) {
                let coding = search.best.unwrap_or_default();
                block.counts[k] = coding.terms.len() as u32;
                block.terms.extend(coding.terms);
                block.errors.energy += search.energy * square;
                (0..CHANNELS).for_each(|c| block.errors.lost[c][k] = coding.lost[c] * square);
            }
        }
        Ok(block)
    }

    /// Up to [`GROUP`] pixels of a block.
    fn group(&self, pixels: &[usize], room: &mut Room) -> Vec<Search> {
        let mut searches = self.analyse(pixels, room);
        for round in 1..=MOST_TRIES {
            for (lane, search) in searches.iter_mut().enumerate().filter(|(_, search)| !search.done) {
                self.choose(lane, search, room);
            }
            self.measure(&mut searches, room);
            searches.iter_mut().filter(|search| !search.done).for_each(|search| search.judge(self.error, round));
            if searches.iter().all(|search| search.done) {
                break;
            }
        }
        searches
    }

    /// Functions, coefficients and squares of a group.
    fn analyse(&self, pixels: &[usize], room: &mut Room) -> Vec<Search> {
        let texels = self.squared_norms.len();
        let mut energies = [0.0; GROUP];
        for c in 0..CHANNELS {
            room.samples.clear();
            for lamp in room.numbers[c].chunks_exact(BLOCK_PIXELS) {
                room.samples.extend((0..GROUP).map(|lane| pixels.get(lane).map_or(0.0, |&k| lamp[k])));
            }
            let function = &mut room.functions[c];
            function.resize(texels * GROUP, 0.0);
            self.resampling.apply(&room.samples, function);
            energies.iter_mut().zip(squared_distances(function, None)).for_each(|(sum, square)| *sum += square);
            room.coefficients[c].clone_from(function);
            self.transform.forward(&mut room.coefficients[c], GROUP);
        }
        room.squares.resize(texels * GROUP, 0.0);
        let [red, green, blue] = &room.coefficients;
        for (location, norm) in self.squared_norms.iter().enumerate() {
            let own = location * GROUP..(location + 1) * GROUP;
            let triples = red[own.clone()].iter().zip(&green[own.clone()]).zip(&blue[own]);
            for (lane, ((r, g), b)) in triples.enumerate() {
                room.squares[lane * texels + location] = norm * (r * r + g * g + b * b);
            }
        }
        let share = self.error.unwrap_or(0.0).powi(2);
        let search = |lane: usize| Search::new(energies[lane], share * energies[lane]);
        (0..pixels.len()).map(search).collect()
    }

    /// The terms of one pixel within its budget.
    fn choose(&self, lane: usize, search: &mut Search, room: &mut Room) {
        let texels = self.squared_norms.len();
        let squares = &room.squares[lane * texels..][..texels];
        search.left = room.selection.choose(squares, self.most, search.budget, &mut room.chosen);
        search.full = room.chosen.len() >= self.most;
        // Powers of two.
        let to_half = self.samples_scale / self.scale;
        let term = |&location: &u32| {
            let at = location as usize * GROUP + lane;
            (location, room.coefficients.each_ref().map(|channel| f16::from_f32(channel[at] * to_half)))
        };
        let rounded_away = |rgb: &[f16; CHANNELS]| rgb.iter().all(|half| half.to_f32() == 0.0);
        search.current.terms.clear();
        search.current.terms.extend(room.chosen.iter().map(term).filter(|(_, rgb)| !rounded_away(rgb)));
    }

    /// Decodes what was chosen, as it will be stored, and finds what it lacks.
    fn measure(&self, searches: &mut [Search], room: &mut Room) {
        let from_half = self.scale / self.samples_scale;
        for c in 0..CHANNELS {
            let decoded = &mut room.decoded[c];
            decoded.clear();
            decoded.resize(room.functions[c].len(), 0.0);
            for (lane, search) in searches.iter().enumerate().filter(|(_, search)| !search.done) {
                for (location, rgb) in &search.current.terms {
                    decoded[*location as usize * GROUP + lane] = rgb[c].to_f32() * from_half;
                }
            }
            self.transform.inverse(decoded, GROUP);
            let lost = squared_distances(&room.functions[c], Some(decoded));
            searches.iter_mut().zip(lost).for_each(|(search, lost)| search.current.lost[c] = lost);
        }
    }
}

impl Search {
    fn new(energy: f64, budget: f64) -> Self {
        Self { energy, budget, left: 0.0, full: false, current: Coding::default(), best: None, done: false }
    }

    /// Keeps the set that was measured, if it will do, and ends the search or corrects the budget.
    fn judge(&mut self, error: Option<f64>, round: usize) {
        let found: f64 = self.current.lost.iter().sum();
        let Some(error) = error else {
            self.best = Some(std::mem::take(&mut self.current));
            self.done = true;
            return;
        };
        let allowed = error * error * self.energy;
        let will_do = found <= allowed;
        // Nothing more can be had: the count is reached, or every coefficient that is not zero is there.
        let at_end = !will_do && (self.full || self.left <= 0.0 || round == MOST_TRIES);
        let smaller = self.best.as_ref().is_none_or(|best| self.current.terms.len() < best.terms.len());
        if (will_do && smaller) || (at_end && self.best.is_none()) {
            self.best = Some(self.current.clone());
        }
        let close = will_do && (found >= CLOSE_ENOUGH * CLOSE_ENOUGH * allowed || self.current.terms.is_empty());
        self.done = close || at_end || (self.best.is_some() && round >= TRIES);
        // Error and dropped squares stay about in proportion. Nothing lost at all tells little.
        let corrected = if found > 0.0 { AIM * allowed * self.left / found } else { f64::MAX };
        self.budget = corrected.min(MOST_GROWTH * self.budget);
    }
}

/// For each lane the squared distance of its function from another, or from zero. Added up in parts, so that single
/// precision does.
fn squared_distances(functions: &[f32], others: Option<&[f32]>) -> [f64; GROUP] {
    const TOGETHER: usize = 64 * GROUP;
    let mut sums = [0.0; GROUP];
    for (n, part) in functions.chunks(TOGETHER).enumerate() {
        let mut squares = [0.0f32; GROUP];
        match others {
            Some(others) => {
                let others = others[n * TOGETHER..].chunks_exact(GROUP);
                for (lanes, others) in part.chunks_exact(GROUP).zip(others) {
                    let pairs = squares.iter_mut().zip(lanes).zip(others);
                    pairs.for_each(|((sum, a), b)| *sum += (a - b) * (a - b));
                }
            }
            None => part.chunks_exact(GROUP).for_each(|lanes| {
                squares.iter_mut().zip(lanes).for_each(|(sum, a)| *sum += a * a);
            }),
        }
        sums.iter_mut().zip(squares).for_each(|(sum, square)| *sum += f64::from(square));
    }
    sums
}
