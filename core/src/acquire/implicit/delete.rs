//! Least squares over the grown tree, and the terms of it that are not worth keeping.

use super::kernels::{Add, Against, CHANNELS, Outer, Remove, run};
use super::solver::{Scratch, Solver};
use super::{Stop, generalised};

impl Solver {
    /// Least squares over all that was tried: `c = R^-1 Q^T B`, and `(W W^T)^-1 = R^-1 R^-T`.
    pub(super) fn fit(&self, s: &mut Scratch) {
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

    /// Takes the least terms back (backward deletion of Friedman, "Multivariate adaptive regression splines", 1991): until
    /// there are no more than wanted, and while the rule to stop finds more noise than signal in them.
    pub(super) fn delete(&self, s: &mut Scratch, energy: f32) {
        let mut energy = f64::from(energy);
        let (mut terms, patterns) = (s.rows.len(), self.dictionary.patterns());
        s.kept.clear();
        s.kept.resize(terms, true);
        while let Some((least, loss)) = least(s) {
            let loss = f64::from(loss);
            let noise = || {
                let (before, after) =
                    (generalised(energy, terms, patterns), generalised(energy + loss, terms - 1, patterns));
                self.options.stop == Stop::On && after <= before
            };
            if terms <= self.options.terms && !noise() {
                break;
            }
            self.remove(s, least);
            energy += loss;
            terms -= 1;
        }
    }

    /// The least-squares solution without a term: `c -= h c_j / h_j`, `H -= h h^T / h_j`, h the column j of H.
    fn remove(&self, s: &mut Scratch, at: usize) {
        let side = s.length - s.stride;
        s.column.copy_from_slice(&s.inverse[at * side..][..side]);
        let pivot = s.column[at].recip();
        let own = s.solution[at].map(|c| c * pivot);
        for (coefficients, h) in s.solution.iter_mut().zip(&s.column) {
            (0..CHANNELS).for_each(|c| coefficients[c] -= h * own[c]);
        }
        run(self.arch, Remove { matrix: &mut s.inverse, side, used: s.rows.len(), column: &s.column, pivot });
        // Exactly nothing, whatever rounding left.
        s.solution[at] = [0.0; CHANNELS];
        s.inverse[at * side..][..side].fill(0.0);
        s.inverse.iter_mut().skip(at).step_by(side).take(s.rows.len()).for_each(|v| *v = 0.0);
        s.kept[at] = false;
    }

    /// One step of iterative refinement: what rounding left in the residual.
    pub(super) fn refine(&self, s: &mut Scratch) {
        let (side, stride) = (s.length - s.stride, s.stride);
        s.residual.copy_from_slice(&s.response);
        for ((row, coefficients), _) in s.rows.iter().zip(&s.solution).zip(&s.kept).filter(|(_, kept)| **kept) {
            for (channel, c) in s.residual.chunks_exact_mut(stride).zip(coefficients) {
                run(self.arch, Add { to: channel, factor: -c, from: self.dictionary.rows(*row, 1) });
            }
        }
        for at in (0..s.rows.len()).filter(|at| s.kept[*at]) {
            let row = self.dictionary.rows(s.rows[at], 1);
            let against = run(self.arch, Against { row, residual: &s.residual });
            for (coefficients, x) in s.solution.iter_mut().zip(&s.inverse[at * side..][..side]) {
                (0..CHANNELS).for_each(|c| coefficients[c] += x * against[c]);
            }
        }
    }
}

/// The term that explains least, and how much energy the residual gains without it: `||c_j||^2 / h_j`.
fn least(s: &Scratch) -> Option<(usize, f32)> {
    let side = s.length - s.stride;
    let mut least: Option<(usize, f32)> = None;
    for (at, c) in s.solution.iter().enumerate().filter(|(at, _)| s.kept[*at]) {
        let loss = (c[0] * c[0] + c[1] * c[1] + c[2] * c[2]) / s.inverse[at * side + at];
        if least.is_none_or(|(_, smallest)| loss < smallest) {
            least = Some((at, loss));
        }
    }
    least
}
