//! One pixel after another: from what it answered to the patterns to the wavelets that it is made of.

use std::sync::Arc;

use pulp::Arch;

use super::dictionary::{Dictionary, Group, LANES};
use super::kernels::CHANNELS;
use super::{Options, Terms, tried};
use crate::error::{Error, Result};

/// Finds terms of pixels. Cheap to share between threads, each with its own [`Scratch`].
#[derive(Debug, Clone)]
pub struct Solver {
    pub(super) dictionary: Arc<Dictionary>,
    pub(super) options: Options,
    /// Terms that are tried before the least of them are taken back.
    pub(super) tried: usize,
    pub(super) arch: Arch,
}

/// Room for one pixel, used again for the next; one a thread.
#[derive(Debug, Clone)]
pub struct Scratch {
    /// Numbers of a vector of the basis: patterns, then coefficients of what it is a combination of.
    pub(super) length: usize,
    pub(super) stride: usize,
    /// Orthonormal vectors q_k with their columns of `R^-1`.
    pub(super) basis: Vec<f32>,
    /// `q_k^T B`.
    pub(super) shares: Vec<[f32; CHANNELS]>,
    pub(super) response: Vec<f32>,
    pub(super) residual: Vec<f32>,
    /// Candidates.
    pub(super) groups: Vec<Group>,
    pub(super) gains: Vec<f32>,
    /// Of each vector: its row in the dictionary.
    pub(super) rows: Vec<u32>,
    pub(super) solution: Vec<[f32; CHANNELS]>,
    /// `(W W^T)^-1` of the rows.
    pub(super) inverse: Vec<f32>,
    /// A column of it.
    pub(super) column: Vec<f32>,
    /// What was not taken back.
    pub(super) kept: Vec<bool>,
}

impl Solver {
    /// A solver for all pixels photographed under the dictionary's patterns.
    ///
    /// # Errors
    /// No terms; as many terms as patterns or more, which no photographs can tell apart.
    pub fn new(dictionary: Arc<Dictionary>, options: Options) -> Result<Self> {
        let (terms, patterns) = (options.terms, dictionary.patterns());
        check(terms, patterns)?;
        Ok(Self { tried: tried(terms, patterns), dictionary, options, arch: Arch::new() })
    }

    /// Its dictionary.
    pub fn dictionary(&self) -> &Arc<Dictionary> {
        &self.dictionary
    }

    /// Its options.
    pub fn options(&self) -> Options {
        self.options
    }

    /// Room to work in.
    pub fn scratch(&self) -> Scratch {
        let (stride, side) = (self.dictionary.stride(), self.tried.next_multiple_of(LANES));
        let length = stride + side;
        Scratch {
            length,
            stride,
            basis: vec![0.0; self.tried * length],
            shares: Vec::with_capacity(self.tried),
            response: vec![0.0; CHANNELS * stride],
            residual: vec![0.0; CHANNELS * stride],
            groups: Vec::new(),
            gains: Vec::new(),
            rows: Vec::with_capacity(self.tried),
            solution: Vec::with_capacity(self.tried),
            inverse: vec![0.0; self.tried * side],
            column: vec![0.0; side],
            kept: Vec::with_capacity(self.tried),
        }
    }

    /// Appends the terms of one pixel, and returns how many; the same numbers on every thread.
    ///
    /// `response` is what the pixel answered to each pattern, channel by channel, `[3][patterns]`, the black photograph
    /// subtracted. `noise` is the standard deviation of one of its numbers, where it is known: a tree that leaves no more than
    /// that unexplained grows no further, unless the rule to stop is off. Numbers that are not finite give no terms.
    ///
    /// # Panics
    /// When `response` does not hold three numbers a pattern; when `scratch` is of another solver's size.
    pub fn solve(&self, scratch: &mut Scratch, response: &[f32], noise: Option<f32>, terms: &mut Terms) -> usize {
        let patterns = self.dictionary.patterns();
        assert_eq!(response.len(), CHANNELS * patterns, "three channels of {patterns} numbers");
        assert_eq!((scratch.stride, scratch.basis.len()), self.room(), "scratch of this solver");
        if !response.iter().all(|v| v.is_finite()) {
            return 0;
        }
        for (to, from) in scratch.response.chunks_exact_mut(scratch.stride).zip(response.chunks_exact(patterns)) {
            to[..patterns].copy_from_slice(from);
        }
        let energy = self.grow(scratch, noise);
        self.fit(scratch);
        self.delete(scratch, energy);
        self.refine(scratch);
        self.emit(scratch, terms)
    }

    fn room(&self) -> (usize, usize) {
        let stride = self.dictionary.stride();
        (stride, self.tried * (stride + self.tried.next_multiple_of(LANES)))
    }

    fn emit(&self, s: &Scratch, terms: &mut Terms) -> usize {
        let before = terms.locations.len();
        for at in (0..s.rows.len()).filter(|at| s.kept[*at]) {
            terms.locations.push(self.dictionary.location(s.rows[at]));
            terms.coefficients.push(s.solution[at]);
        }
        terms.locations.len() - before
    }
}

/// Refuses numbers of terms that patterns do not determine.
fn check(terms: usize, patterns: usize) -> Result<()> {
    if terms == 0 {
        return Err(Error::invalid("the terms of a pixel", "0", "at least one"));
    }
    if terms >= patterns {
        let found = format!("{terms} terms from {patterns} patterns");
        let advice = (patterns / 4).max(1);
        let expected = format!("fewer terms than patterns (a quarter of them is well determined: {advice})");
        return Err(Error::invalid("the terms of a pixel", found, expected));
    }
    Ok(())
}
