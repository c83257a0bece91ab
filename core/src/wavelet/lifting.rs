//! Lifting (A.6; Daubechies and Sweldens 1998, "Factoring wavelet transforms into lifting steps").
//!
//! Even and odd samples lie apart, each sample a run of `m` numbers (lanes, or a strip of a row). A step adds to every
//! sample of one parity a weight times the sum of its neighbours of the other, so its inverse subtracts the same, and its
//! transpose goes the other way, from the receivers to the neighbours.

use super::extension::{Edge, Parity, halves, stand_ins};

/// Lifting constants of the 9/7 (Daubechies and Sweldens 1998, 7.7; JPEG 2000, annex F, table F.4), all digits that they
/// give: predict, update, predict, update.
const STEPS_97: [f64; 4] = [-1.586134342059924, -0.052980118572961, 0.882911075530934, 0.443506852043971];
/// Low-pass gain at a constant signal after these steps (JPEG 2000, annex F: K); the high-pass one at an alternating
/// signal is 2 / K.
const K_97: f64 = 1.230174104914001;

/// Which neighbours a sample looks at.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Neighbours {
    /// The one of the same index of the other kind.
    Partner,
    /// The one before and the one after.
    Both,
}

/// One lifting step.
#[derive(Debug, Clone, Copy)]
struct Step {
    receives: Parity,
    weight: f32,
    neighbours: Neighbours,
}

/// A wavelet as lifting steps. What remains to do after them is to multiply by `gains`.
#[derive(Debug, Clone)]
pub(super) struct Lifting {
    steps: Vec<Step>,
    /// For low-pass (even) and high-pass (odd) coefficients, so that both gains are one: constant amplitude.
    pub gains: [f64; 2],
}

/// Even and odd samples of a line, each a run of `m` numbers.
pub(super) struct Split<'a> {
    pub even: &'a mut [f32],
    pub odd: &'a mut [f32],
    pub m: usize,
}

/// Which operator a step is part of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Side {
    /// A or S themselves.
    Primal,
    /// Their adjoints: `S^T` is an analysis, `A^T` a synthesis.
    Dual,
}

impl Lifting {
    /// Haar (A.6). Differences are second minus first; the gain turns them round, as in A.2.
    pub fn haar() -> Self {
        let partner = |receives, weight| Step { receives, weight, neighbours: Neighbours::Partner };
        Self { steps: vec![partner(Parity::Odd, -1.0), partner(Parity::Even, 0.5)], gains: [1.0, -0.5] }
    }

    /// The 5/3 (A.6).
    pub fn le_gall_53() -> Self {
        Self { steps: vec![both(Parity::Odd, -0.5), both(Parity::Even, 0.25)], gains: [1.0, 0.5] }
    }

    /// The 9/7.
    pub fn daubechies_97() -> Self {
        let parities = [Parity::Odd, Parity::Even].into_iter().cycle();
        let steps = STEPS_97.iter().zip(parities).map(|(weight, receives)| both(receives, *weight)).collect();
        Self { steps, gains: [1.0 / K_97, K_97 / 2.0] }
    }

    /// Samples become coefficients, before gains: low-pass in `even`, high-pass in `odd`.
    pub fn analyse(&self, line: &mut Split<'_>, edge: Edge, side: Side) {
        self.steps.iter().for_each(|step| step.apply(line, edge, side, if side == Side::Dual { -1.0 } else { 1.0 }));
    }

    /// Coefficients, after gains, become samples.
    pub fn synthesise(&self, line: &mut Split<'_>, edge: Edge, side: Side) {
        self.steps.iter().rev().for_each(|step| {
            step.apply(line, edge, side, if side == Side::Dual { 1.0 } else { -1.0 });
        });
    }
}

fn both(receives: Parity, weight: f64) -> Step {
    Step { receives, weight: weight as f32, neighbours: Neighbours::Both }
}

impl Step {
    fn apply(&self, line: &mut Split<'_>, edge: Edge, side: Side, sign: f32) {
        let (m, weight) = (line.m, sign * self.weight);
        let receives = match (side, self.receives) {
            (Side::Primal, parity) => parity,
            (Side::Dual, Parity::Even) => Parity::Odd,
            (Side::Dual, Parity::Odd) => Parity::Even,
        };
        let n = (line.even.len() + line.odd.len()) / m;
        let (to, from) = match receives {
            Parity::Even => (&mut *line.even, &*line.odd),
            Parity::Odd => (&mut *line.odd, &*line.even),
        };
        if self.neighbours == Neighbours::Partner {
            return add(to, from, weight);
        }
        let (evens, odds) = halves(n);
        match receives {
            // x[2i] looks at x[2i - 1] and x[2i + 1], where they exist.
            Parity::Even => {
                add(&mut to[..m], &from[..m], weight);
                add_both(&mut to[m..odds * m], from, &from[m..], weight);
                add(&mut to[odds * m..], &from[(odds - 1) * m..], weight);
            }
            // x[2i + 1] looks at x[2i] and x[2i + 2].
            Parity::Odd => {
                let inner = odds.min(evens - 1) * m;
                add_both(&mut to[..inner], from, &from[m..], weight);
                add(&mut to[inner..], &from[inner..], weight);
            }
        }
        for (receiver, stand_in) in stand_ins(n, self.receives, edge) {
            let (t, f) = if side == Side::Dual { (stand_in, receiver) } else { (receiver, stand_in) };
            add(&mut to[t * m..][..m], &from[f * m..][..m], weight);
        }
    }
}

/// As far as the shorter of both goes.
fn add(to: &mut [f32], from: &[f32], weight: f32) {
    to.iter_mut().zip(from).for_each(|(to, from)| *to += weight * from);
}

fn add_both(to: &mut [f32], before: &[f32], after: &[f32], weight: f32) {
    to.iter_mut().zip(before).zip(after).for_each(|((to, before), after)| *to += weight * (before + after));
}
