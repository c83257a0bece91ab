//! What lies beyond the ends of a line (A.6).
//!
//! A line is split into samples of even and of odd index, counted from 0. Filters reach over the ends; there a line goes
//! on as its [`Edge`] says. For lifting this only asks which sample of the *other* kind stands in for a neighbour that is
//! missing, so that any choice can be undone exactly.

/// How a line goes on beyond its ends.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Edge {
    /// It starts again. A line of odd length has two samples of even index side by side at the seam: lifting then mirrors
    /// it there, and filter banks repeat all but the last sample, which is a low-pass coefficient by itself.
    Cyclic,
    /// It is mirrored: on its last sample for the 5/3 and the 9/7, whose filters are odd in length, and beyond it (the
    /// last sample comes twice) for Haar, whose filters are even.
    Mirrored,
}

/// Samples by the parity of their index.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Parity {
    Even,
    Odd,
}

/// How many samples of a line of `n` have an even index, and how many an odd one: low-pass and high-pass coefficients.
pub(super) fn halves(n: usize) -> (usize, usize) {
    (n.div_ceil(2), n / 2)
}

/// Neighbours missing at the ends of a line of `n > 1` samples, when each sample of one parity looks at both neighbours:
/// (index among its own kind, index of its stand-in among the other kind).
pub(super) fn stand_ins(n: usize, of: Parity, edge: Edge) -> impl Iterator<Item = (usize, usize)> {
    let (evens, odds) = halves(n);
    let whole_periods = n.is_multiple_of(2);
    let pairs = match (of, edge) {
        // x[n - 1] is odd, and x[n] is x[0] or x[n - 2].
        (Parity::Odd, Edge::Cyclic) if whole_periods => [Some((odds - 1, 0)), None],
        (Parity::Odd, Edge::Mirrored) if whole_periods => [Some((odds - 1, evens - 1)), None],
        (Parity::Odd, _) => [None, None],
        // x[-1] is x[n - 1] or x[1].
        (Parity::Even, Edge::Cyclic) if whole_periods => [Some((0, odds - 1)), None],
        (Parity::Even, _) if whole_periods => [Some((0, 0)), None],
        // x[n - 1] is even too, and x[n] is x[n - 2].
        (Parity::Even, _) => [Some((0, 0)), Some((evens - 1, odds - 1))],
    };
    pairs.into_iter().flatten()
}
