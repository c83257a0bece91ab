//! The tree of a pixel, grown from the coarsest functions on (6.24).

use super::Stop;
use super::dictionary::Group;
use super::kernels::{CHANNELS, Energy, Gains, Project, TakeOut, run};
use super::solver::{Scratch, Solver};

/// A function that keeps less than this share of its energy, once what is known was taken out, repeats it: rounding of f32.
pub(super) const DEPENDENT: f32 = 1e-6;

/// Growth ends when this share of the response's energy is left: rounding of f32.
pub(super) const EXPLAINED: f32 = 1e-12;

impl Solver {
    /// Grows the tree, best group first; returns the energy of what is left.
    pub(super) fn grow(&self, scratch: &mut Scratch, noise: Option<f32>) -> f32 {
        let s = scratch;
        s.residual.copy_from_slice(&s.response);
        s.groups.clear();
        s.rows.clear();
        s.shares.clear();
        for root in 0..self.dictionary.roots() {
            s.groups.push(self.dictionary.group(root));
        }
        let whole = run(self.arch, Energy(&s.residual));
        let enough = enough(whole, noise.filter(|_| self.options.stop == Stop::On), self.dictionary.patterns());
        let mut left = whole;
        while left > enough && !s.groups.is_empty() {
            s.gains.resize(s.groups.len(), 0.0);
            let work =
                Gains { dictionary: &self.dictionary, groups: &s.groups, residual: &s.residual, gains: &mut s.gains };
            run(self.arch, work);
            let (best, gain) = largest(&s.gains);
            let explains = gain > 0.0;
            if !explains || s.rows.len() + s.groups[best].count as usize > self.tried {
                break;
            }
            let group = s.groups.swap_remove(best);
            self.append(s, group);
            s.groups.extend((group.child..group.child + group.children).map(|child| self.dictionary.group(child)));
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
            let independent = energy > DEPENDENT * run(self.arch, Energy(row));
            if !independent {
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
}

/// The energy that is left when nothing more is to be learnt: what noise alone would leave (the discrepancy principle, V. A.
/// Morozov, 1966), or rounding.
pub(super) fn enough(whole: f32, noise: Option<f32>, patterns: usize) -> f32 {
    let noise = noise.map_or(0.0, |noise| (CHANNELS * patterns) as f32 * noise * noise);
    noise.max(EXPLAINED * whole)
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
