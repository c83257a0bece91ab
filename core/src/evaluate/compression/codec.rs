//! Coefficients of a function, how many are needed, and what they decode to.

use super::functions::CHANNELS;
use super::norms::{relative, squares, subtract};
use crate::domain::StageGrid;
use crate::error::Result;
use crate::wavelet::{Approximation, Transform, Tree, Wavelet};

/// Rounds of looking for the number of terms that reaches an error; each decodes once. Three do, as a rule.
const ROUNDS: usize = 6;
/// A number of terms is found when fewer by this part are known to fail.
const CLOSE: usize = 50;

/// How many coefficients a function may have.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Budget {
    /// So many, or all where there are fewer.
    Terms(usize),
    /// As few as bring the relative L2 error of the function, three channels together, down to this: the non-linear
    /// approximation's own prefix, to 2 % of the number.
    Error(f64),
}

/// A wavelet on a grid.
#[derive(Debug)]
pub struct Codec {
    transform: Transform,
    tree: Tree,
    /// `||s_j||_2`.
    norms: Vec<f32>,
}

/// A transformed function.
#[derive(Debug)]
pub(super) struct Coefficients {
    /// `[location][channel]`.
    values: Vec<f32>,
    /// `sqrt(sum_c c_j^2) ||s_j||_2`: channels share the set.
    pub magnitudes: Vec<f32>,
}

impl Codec {
    /// A wavelet in the constant-energy normalisation: columns go round, rows are mirrored at both ends.
    ///
    /// # Errors
    /// A wavelet that is not symmetric.
    pub fn new(wavelet: Wavelet, grid: &StageGrid) -> Result<Self> {
        let transform = grid.transform(wavelet)?;
        Ok(Self { tree: transform.tree(), norms: transform.synthesis_norms(), transform })
    }

    /// The wavelet.
    pub fn wavelet(&self) -> Wavelet {
        self.transform.wavelet()
    }

    /// Coefficients of a function `[texel][channel]`.
    pub(super) fn analyse(&self, function: &[f32]) -> Coefficients {
        let mut values = function.to_vec();
        self.transform.forward(&mut values, CHANNELS);
        let magnitude = |(rgb, norm): (&[f32], &f32)| rgb.iter().map(|c| c * c).sum::<f32>().sqrt() * norm;
        let magnitudes = values.chunks_exact(CHANNELS).zip(&self.norms).map(magnitude).collect();
        Coefficients { values, magnitudes }
    }

    /// The locations that a way of choosing takes.
    pub(super) fn choose(&self, how: Approximation, coefficients: &Coefficients, terms: usize) -> Vec<u32> {
        how.choose(&self.tree, &coefficients.magnitudes, terms)
    }

    /// What several sets of coefficients decode to, side by side: `[texel][set][channel]`.
    pub(super) fn decode(&self, coefficients: &Coefficients, sets: &[&[u32]]) -> Vec<f32> {
        let lanes = sets.len() * CHANNELS;
        let mut data = vec![0.0; self.tree.len() * lanes];
        for (n, set) in sets.iter().enumerate() {
            for &location in *set {
                let from = &coefficients.values[location as usize * CHANNELS..][..CHANNELS];
                data[location as usize * lanes + n * CHANNELS..][..CHANNELS].copy_from_slice(from);
            }
        }
        if lanes > 0 {
            self.transform.inverse(&mut data, lanes);
        }
        data
    }

    /// How many of the coefficients in `order` each budget takes.
    pub(super) fn terms(
        &self,
        function: &[f32],
        coefficients: &Coefficients,
        order: &[u32],
        budgets: &[Budget],
    ) -> Vec<usize> {
        let energy: f64 = function.iter().map(|v| f64::from(*v).powi(2)).sum();
        let tails = tails(&coefficients.magnitudes, order);
        let search = |budget: &Budget| match *budget {
            Budget::Terms(terms) => Search::settled_at(terms.min(order.len())),
            Budget::Error(error) => Search::new(error * energy.sqrt(), &tails),
        };
        let mut searches: Vec<Search> = budgets.iter().map(search).collect();
        for _ in 0..ROUNDS {
            let open: Vec<&mut Search> = searches.iter_mut().filter(|search| !search.is_settled()).collect();
            if open.is_empty() {
                break;
            }
            let sets: Vec<&[u32]> = open.iter().map(|search| &order[..search.next]).collect();
            let errors = self.lost(function, coefficients, &sets);
            open.into_iter().zip(errors).for_each(|(search, error)| search.learn(error, &tails));
        }
        searches.iter().map(|search| search.enough).collect()
    }

    /// `||v' - v||_2` of each set.
    fn lost(&self, function: &[f32], coefficients: &Coefficients, sets: &[&[u32]]) -> Vec<f64> {
        let lanes = sets.len() * CHANNELS;
        let mut decoded = self.decode(coefficients, sets);
        subtract(&mut decoded, lanes, function, CHANNELS);
        squares(&decoded, self.tree.size(), lanes, CHANNELS).iter().map(|off| off.l2.sqrt()).collect()
    }

    /// Relative L2 errors of some sets.
    pub(super) fn relative_errors(&self, function: &[f32], coefficients: &Coefficients, sets: &[&[u32]]) -> Vec<f64> {
        let energy: f64 = function.iter().map(|v| f64::from(*v).powi(2)).sum();
        self.lost(function, coefficients, sets).iter().map(|lost| relative(lost * lost, energy)).collect()
    }
}

/// `sqrt(sum of the squared magnitudes from n on)` for n = 0 to all: the error of dropping them where basis functions are
/// orthogonal, and a guess where they are not.
fn tails(magnitudes: &[f32], order: &[u32]) -> Vec<f64> {
    let mut tails = vec![0.0; order.len() + 1];
    for (n, location) in order.iter().enumerate().rev() {
        tails[n] = tails[n + 1] + f64::from(magnitudes[*location as usize]).powi(2);
    }
    tails.iter_mut().for_each(|tail| *tail = tail.sqrt());
    tails
}

/// The search for the fewest terms whose error does not exceed a bound. The ratio of the true error to the tail changes
/// slowly with the number of terms, so each measurement corrects the next guess.
#[derive(Debug, Clone, Copy)]
struct Search {
    bound: f64,
    /// Fewer are known to fail.
    least: usize,
    /// So many are known to do.
    enough: usize,
    /// To be tried next.
    next: usize,
}

impl Search {
    fn settled_at(terms: usize) -> Self {
        Self { bound: 0.0, least: terms, enough: terms, next: terms }
    }

    fn new(bound: f64, tails: &[f64]) -> Self {
        let next = tails.partition_point(|tail| *tail > bound);
        Self { bound, least: 0, enough: tails.len() - 1, next: next.min(tails.len() - 1) }
    }

    fn is_settled(&self) -> bool {
        self.enough.saturating_sub(self.least) <= self.enough / CLOSE
    }

    fn learn(&mut self, error: f64, tails: &[f64]) {
        let ratio = if tails[self.next] > 0.0 { error / tails[self.next] } else { 1.0 };
        let guess = tails.partition_point(|tail| tail * ratio > self.bound);
        if error <= self.bound {
            self.enough = self.next;
            // Far enough below to settle it when that fails.
            self.next = guess.min((self.enough - self.enough / CLOSE).saturating_sub(1)).max(self.least);
        } else {
            self.least = self.next + 1;
            // A little above, so that it is likely to do.
            self.next = (guess + guess / (2 * CLOSE)).clamp(self.least, self.enough.max(self.least));
        }
    }
}
