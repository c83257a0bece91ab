//! Least squares over the grown tree, and the leaves that are not worth keeping.

use nalgebra::{Matrix3, Vector3};

use super::kernels::{Add, Against, CHANNELS, Outer, Remove, run};
use super::solver::{Chosen, Scratch, Solver};
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

    /// Takes the least leaves back (backward deletion of Friedman, "Multivariate adaptive regression splines", 1991): until
    /// there are no more than wanted, and while the rule to stop finds more noise than signal in them.
    pub(super) fn prune(&self, s: &mut Scratch, energy: f32) {
        let mut energy = f64::from(energy);
        let (mut terms, patterns) = (s.rows.len(), self.dictionary.patterns());
        while let Some((leaf, loss)) = self.least(s) {
            let loss = f64::from(loss);
            let count = s.chosen[leaf].count;
            let noise = || {
                let (before, after) =
                    (generalised(energy, terms, patterns), generalised(energy + loss, terms - count, patterns));
                self.options.stop == Stop::On && after <= before
            };
            if terms <= self.options.terms && !noise() {
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
    pub(super) fn refine(&self, s: &mut Scratch) {
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
