//! One pixel after another: from what it answered to the patterns to the wavelets that it is made of.

use std::sync::Arc;

use nalgebra::{Matrix3, Vector3};
use pulp::Arch;

use super::dictionary::{Dictionary, Group, LANES};
use super::kernels::{Add, Against, CHANNELS, Energy, Gains, Outer, Project, Remove, TakeOut, run};
use super::{Options, Stop, Terms};
use crate::error::{Error, Result};

/// A function that keeps less than this share of its energy, once what is known was taken out, repeats it: rounding of f32.
const DEPENDENT: f32 = 1e-6;

/// Growth ends when this share of the response's energy is left: rounding of f32.
const EXPLAINED: f32 = 1e-12;

/// Finds terms of pixels. Cheap to share between threads, each with its own [`Scratch`].
#[derive(Debug, Clone)]
pub struct Solver {
    dictionary: Arc<Dictionary>,
    options: Options,
    /// Terms that are tried before the least of them are taken back.
    tried: usize,
    arch: Arch,
}

/// Room for one pixel, used again for the next; one a thread.
#[derive(Debug, Clone)]
pub struct Scratch {
    /// Numbers of a vector of the basis: patterns, then coefficients of what it is a combination of.
    length: usize,
    stride: usize,
    /// Orthonormal vectors q_k with their columns of `R^-1`.
    basis: Vec<f32>,
    /// `q_k^T B`.
    shares: Vec<[f32; CHANNELS]>,
    response: Vec<f32>,
    residual: Vec<f32>,
    candidates: Vec<Candidate>,
    groups: Vec<Group>,
    gains: Vec<f32>,
    chosen: Vec<Chosen>,
    /// Of each vector: its row in the dictionary.
    rows: Vec<u32>,
    solution: Vec<[f32; CHANNELS]>,
    /// `(W W^T)^-1` of the rows.
    inverse: Vec<f32>,
    columns: Vec<f32>,
    scaled: Vec<f32>,
}

#[derive(Debug, Clone, Copy)]
struct Candidate {
    /// Place in `chosen` of what it hangs from.
    parent: Option<usize>,
}

/// A group that became part of the tree.
#[derive(Debug, Clone, Copy)]
struct Chosen {
    parent: Option<usize>,
    first: usize,
    count: usize,
    /// Groups below it that are part of the tree.
    children: usize,
    kept: bool,
}

impl Solver {
    /// A solver for all pixels photographed under the dictionary's patterns.
    ///
    /// # Errors
    /// No terms; as many terms as patterns or more, which no photographs can tell apart.
    pub fn new(dictionary: Arc<Dictionary>, options: Options) -> Result<Self> {
        let (terms, patterns) = (options.terms, dictionary.patterns());
        if terms == 0 {
            return Err(Error::invalid("the terms of a pixel", "0", "at least one"));
        }
        if terms >= patterns {
            let found = format!("{terms} terms from {patterns} patterns");
            let expected =
                format!("fewer terms than patterns (a quarter is well determined: {})", (patterns / 4).max(1));
            return Err(Error::invalid("the terms of a pixel", found, expected));
        }
        let tried = ((terms as f64 * options.growth) as usize).clamp(terms, patterns - 1);
        Ok(Self { dictionary, options, tried, arch: Arch::new() })
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
            candidates: Vec::new(),
            groups: Vec::new(),
            gains: Vec::new(),
            chosen: Vec::with_capacity(self.tried),
            rows: Vec::with_capacity(self.tried),
            solution: Vec::with_capacity(self.tried),
            inverse: vec![0.0; self.tried * side],
            columns: vec![0.0; 3 * side],
            scaled: vec![0.0; 3 * side],
        }
    }

    /// Appends the terms of one pixel, and returns how many; the same numbers on every thread.
    ///
    /// `response` is what the pixel answered to each pattern, channel by channel, `[3][patterns]`, the black photograph
    /// subtracted. `noise` is the standard deviation of one of its numbers, where it is known. Numbers that are not finite give
    /// no terms.
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
        self.prune(scratch, energy);
        self.refine(scratch);
        self.emit(scratch, terms)
    }

    fn room(&self) -> (usize, usize) {
        let stride = self.dictionary.stride();
        (stride, self.tried * (stride + self.tried.next_multiple_of(LANES)))
    }

    /// Grows the tree, best group first; returns the energy of what is left.
    fn grow(&self, scratch: &mut Scratch, noise: Option<f32>) -> f32 {
        let s = scratch;
        s.residual.copy_from_slice(&s.response);
        (s.candidates.clear(), s.groups.clear(), s.chosen.clear(), s.rows.clear(), s.shares.clear());
        for root in 0..self.dictionary.roots() {
            s.candidates.push(Candidate { parent: None });
            s.groups.push(self.dictionary.group(root));
        }
        let whole = run(self.arch, Energy(&s.residual));
        // What noise alone would leave (the discrepancy principle of Morozov, 1966), or rounding.
        let noise = noise.map_or(0.0, |noise| (CHANNELS * self.dictionary.patterns()) as f32 * noise * noise);
        let enough = noise.max(EXPLAINED * whole);
        let mut left = whole;
        while left > enough && !s.groups.is_empty() {
            s.gains.resize(s.groups.len(), 0.0);
            let work =
                Gains { dictionary: &self.dictionary, groups: &s.groups, residual: &s.residual, gains: &mut s.gains };
            run(self.arch, work);
            let (best, gain) = largest(&s.gains);
            if !(gain > 0.0) || s.rows.len() + s.groups[best].count as usize > self.tried {
                break;
            }
            let (group, candidate) = (s.groups.swap_remove(best), s.candidates.swap_remove(best));
            let at = s.chosen.len();
            let first = s.rows.len();
            self.append(s, group);
            s.chosen.push(Chosen {
                parent: candidate.parent,
                first,
                count: s.rows.len() - first,
                children: 0,
                kept: true,
            });
            if let Some(parent) = candidate.parent {
                s.chosen[parent].children += 1;
            }
            for child in group.child..group.child + group.children {
                s.candidates.push(Candidate { parent: Some(at) });
                s.groups.push(self.dictionary.group(child));
            }
            left = run(self.arch, Energy(&s.residual));
        }
        left
    }

    /// Makes the members of a group part of the basis, and takes what they explain out of the residual.
    fn append(&self, s: &mut Scratch, group: Group) {
        let (length, stride, count) = (s.length, s.stride, group.count as usize);
        let first = s.rows.len();
        let (basis, new) = s.basis.split_at_mut(first * length);
        let new = &mut new[..count * length];
        let rows = self.dictionary.rows(group.row, group.count);
        for (vector, row) in new.chunks_exact_mut(length).zip(rows.chunks_exact(stride)) {
            vector[..stride].copy_from_slice(row);
            vector[stride..].fill(0.0);
        }
        run(self.arch, Project { basis, vectors: new, length, stride });
        let mut used = 0;
        for (member, row) in (0..count).zip(rows.chunks_exact(stride)) {
            new.copy_within(member * length..(member + 1) * length, used * length);
            let (earlier, vector) = new[..(used + 1) * length].split_at_mut(used * length);
            run(self.arch, Project { basis: earlier, vectors: vector, length, stride });
            let energy = run(self.arch, Energy(&vector[..stride]));
            if !(energy > DEPENDENT * run(self.arch, Energy(row))) {
                continue;
            }
            vector[stride + s.rows.len()] = 1.0;
            let scale = energy.sqrt().recip();
            vector.iter_mut().for_each(|v| *v *= scale);
            s.shares.push(run(self.arch, TakeOut { vector: &vector[..stride], residual: &mut s.residual }));
            s.rows.push(group.row + member as u32);
            used += 1;
        }
    }

    /// Least squares over all that was tried: `c = R^-1 Q^T B`, and `(W W^T)^-1 = R^-1 R^-T`.
    fn fit(&self, s: &mut Scratch) {
        let (length, stride, used) = (s.length, s.stride, s.rows.len());
        let side = length - stride;
        s.solution.clear();
        s.solution.resize(used, [0.0; CHANNELS]);
        for (k, (vector, shares)) in s.basis.chunks_exact(length).zip(&s.shares).enumerate() {
            for (coefficients, x) in s.solution.iter_mut().zip(&vector[stride..=stride + k]) {
                (0..CHANNELS).for_each(|c| coefficients[c] += x * shares[c]);
            }
        }
        let matrix = &mut s.inverse[..used * side];
        matrix.fill(0.0);
        run(self.arch, Outer { vectors: &s.basis[..used * length], length, skip: stride, matrix });
    }

    /// Takes the least leaves back (backward deletion of Friedman, "Multivariate adaptive regression splines", 1991): until
    /// there are no more than wanted, and while the rule to stop finds more noise than signal in them.
    fn prune(&self, s: &mut Scratch, mut energy: f32) {
        let mut terms = s.rows.len();
        let patterns = self.dictionary.patterns() as f32;
        let penalty = match self.options.stop {
            Stop::Off => None,
            Stop::On => Some(self.options.penalty),
        };
        let generalised = |energy: f32, terms: usize| {
            let free = patterns - penalty.unwrap_or(0.0) * terms as f32;
            if free > 0.0 { energy / (free * free) } else { f32::INFINITY }
        };
        while let Some((leaf, loss)) = self.least(s) {
            let count = s.chosen[leaf].count;
            let better = || {
                let (before, after) = (generalised(energy, terms), generalised(energy + loss, terms - count));
                penalty.is_some() && after <= before
            };
            if terms <= self.options.terms && !better() {
                break;
            }
            self.remove(s, leaf);
            energy += loss;
            terms -= count;
        }
    }

    /// The leaf that explains least, and how much energy the residual gains without it.
    fn least(&self, s: &Scratch) -> Option<(usize, f32)> {
        let side = s.length - s.stride;
        let mut least: Option<(usize, f32)> = None;
        for (at, leaf) in s.chosen.iter().enumerate().filter(|(_, group)| group.kept && group.children == 0) {
            let inverse = within(&s.inverse, side, leaf);
            let loss: f32 = (0..CHANNELS)
                .map(|c| {
                    let part =
                        Vector3::from_fn(|m, _| if m < leaf.count { s.solution[leaf.first + m][c] } else { 0.0 });
                    part.dot(&(inverse * part))
                })
                .sum();
            if least.is_none_or(|(_, smallest)| loss < smallest) {
                least = Some((at, loss));
            }
        }
        least
    }

    /// The least-squares solution without a leaf.
    fn remove(&self, s: &mut Scratch, at: usize) {
        let side = s.length - s.stride;
        let leaf = s.chosen[at];
        let inverse = within(&s.inverse, side, &leaf);
        let rows = leaf.first * side..(leaf.first + leaf.count) * side;
        let columns = &mut s.columns[..leaf.count * side];
        columns.copy_from_slice(&s.inverse[rows]);
        let scaled = &mut s.scaled[..leaf.count * side];
        scaled.fill(0.0);
        for (m, row) in scaled.chunks_exact_mut(side).enumerate() {
            for (n, column) in columns.chunks_exact(side).enumerate() {
                run(self.arch, Add { to: row, factor: inverse[(m, n)], from: column });
            }
        }
        let own: [[f32; CHANNELS]; 3] =
            std::array::from_fn(|m| if m < leaf.count { s.solution[leaf.first + m] } else { [0.0; CHANNELS] });
        for (m, row) in scaled.chunks_exact(side).enumerate() {
            for (coefficients, x) in s.solution.iter_mut().zip(row) {
                (0..CHANNELS).for_each(|c| coefficients[c] -= x * own[m][c]);
            }
        }
        run(self.arch, Remove { matrix: &mut s.inverse, side, used: s.rows.len(), scaled, columns });
        for member in leaf.first..leaf.first + leaf.count {
            s.solution[member] = [0.0; CHANNELS];
            s.inverse[member * side..][..side].fill(0.0);
            s.inverse.iter_mut().skip(member).step_by(side).take(s.rows.len()).for_each(|v| *v = 0.0);
        }
        s.chosen[at].kept = false;
        if let Some(parent) = leaf.parent {
            s.chosen[parent].children -= 1;
        }
    }

    /// One step of iterative refinement: what rounding left in the residual.
    fn refine(&self, s: &mut Scratch) {
        let (side, stride) = (s.length - s.stride, s.stride);
        s.residual.copy_from_slice(&s.response);
        for (row, coefficients) in s.rows.iter().zip(&s.solution) {
            for (channel, c) in s.residual.chunks_exact_mut(stride).zip(coefficients) {
                run(self.arch, Add { to: channel, factor: -c, from: self.dictionary.rows(*row, 1) });
            }
        }
        for group in s.chosen.iter().filter(|group| group.kept) {
            for member in group.first..group.first + group.count {
                let row = self.dictionary.rows(s.rows[member], 1);
                let against = run(self.arch, Against { row, residual: &s.residual });
                for (coefficients, x) in s.solution.iter_mut().zip(&s.inverse[member * side..][..side]) {
                    (0..CHANNELS).for_each(|c| coefficients[c] += x * against[c]);
                }
            }
        }
    }

    fn emit(&self, s: &Scratch, terms: &mut Terms) -> usize {
        let before = terms.locations.len();
        for group in s.chosen.iter().filter(|group| group.kept) {
            for member in group.first..group.first + group.count {
                terms.locations.push(self.dictionary.location(s.rows[member]));
                terms.coefficients.push(s.solution[member]);
            }
        }
        terms.locations.len() - before
    }
}

/// The first of the largest numbers; there is at least one.
fn largest(numbers: &[f32]) -> (usize, f32) {
    let mut best = (0, numbers[0]);
    for (at, number) in numbers.iter().enumerate().skip(1) {
        if *number > best.1 {
            best = (at, *number);
        }
    }
    best
}

/// `(H_gg)^-1`, bordered by the identity where a group has fewer than three members.
fn within(inverse: &[f32], side: usize, group: &Chosen) -> Matrix3<f32> {
    let number = |m: usize, n: usize| {
        if m < group.count && n < group.count {
            inverse[(group.first + m) * side + group.first + n]
        } else {
            f32::from(u8::from(m == n))
        }
    };
    Matrix3::from_fn(number).try_inverse().unwrap_or_else(Matrix3::zeros)
}
