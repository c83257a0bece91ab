//! The loops over patterns, by the widest vectors that the processor has (safely, through `pulp`).
//!
//! All slices of numbers are padded to whole vectors. Sums are f32, over lanes first; they differ between processors by
//! rounding alone, and never between runs or threads.

use pulp::{Arch, Simd, WithSimd};

use super::dictionary::{Dictionary, Group};

/// Channels of a pixel.
pub(super) const CHANNELS: usize = 3;

/// How much of the residual's energy each group of wavelets would explain, one function at a time: the sum over its functions
/// and the channels of `<w_j, r>^2 / ||w_j||^2`.
pub(super) struct Gains<'a> {
    pub dictionary: &'a Dictionary,
    pub groups: &'a [Group],
    /// Channel by channel.
    pub residual: &'a [f32],
    pub gains: &'a mut [f32],
}

impl WithSimd for Gains<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let stride = self.dictionary.stride();
        let residual: [&[f32]; CHANNELS] = std::array::from_fn(|c| &self.residual[c * stride..][..stride]);
        for (group, gain) in self.groups.iter().zip(self.gains) {
            let rows = self.dictionary.rows(group.row, group.count);
            let weights = self.dictionary.weights(group.row, group.count);
            *gain = 0.0;
            if group.count == 3 {
                let rows = [&rows[..stride], &rows[stride..2 * stride], &rows[2 * stride..]];
                let dots = dots(simd, rows, residual);
                for m in 0..3 {
                    *gain += weights[m] * squares(dots[m]);
                }
            } else {
                for (row, weight) in rows.chunks_exact(stride).zip(weights) {
                    *gain += weight * squares(dots(simd, [row], residual)[0]);
                }
            }
        }
    }
}

#[inline(always)]
fn squares([r, g, b]: [f32; CHANNELS]) -> f32 {
    r * r + g * g + b * b
}

/// All inner products of `A` by `B` slices of one length. (Loops, not closures: only what is inlined here may use the wide
/// instructions.)
#[inline(always)]
fn dots<S: Simd, const A: usize, const B: usize>(simd: S, a: [&[f32]; A], b: [&[f32]; B]) -> [[f32; B]; A] {
    let length = a[0].len() / S::F32_LANES;
    let mut left: [&[S::f32s]; A] = [&[]; A];
    let mut right: [&[S::f32s]; B] = [&[]; B];
    for m in 0..A {
        left[m] = &S::as_simd_f32s(a[m]).0[..length];
    }
    for n in 0..B {
        right[n] = &S::as_simd_f32s(b[n]).0[..length];
    }
    let mut sums = [[simd.splat_f32s(0.0); B]; A];
    for at in 0..length {
        for m in 0..A {
            for n in 0..B {
                sums[m][n] = simd.mul_add_e_f32s(left[m][at], right[n][at], sums[m][n]);
            }
        }
    }
    let mut results = [[0.0; B]; A];
    for m in 0..A {
        for n in 0..B {
            results[m][n] = simd.reduce_sum_f32s(sums[m][n]);
        }
    }
    results
}

/// `to += factor * from`.
#[inline(always)]
fn add<S: Simd>(simd: S, to: &mut [f32], factor: f32, from: &[f32]) {
    let factor = simd.splat_f32s(factor);
    let (to, from) = (S::as_mut_simd_f32s(to).0, S::as_simd_f32s(from).0);
    for (to, from) in to.iter_mut().zip(from) {
        *to = simd.mul_add_e_f32s(factor, *from, *to);
    }
}

/// Takes out of up to three new vectors what `basis` spans (Gram and Schmidt), by inner products over the first `stride`
/// numbers of each. What follows them takes part in the sums alone: it starts as a column of the identity, and ends as the
/// combination of dictionary rows that the orthogonal vector is.
pub(super) struct Project<'a> {
    pub basis: &'a [f32],
    pub vectors: &'a mut [f32],
    /// Numbers of a vector, and how many of them enter the inner products.
    pub length: usize,
    pub stride: usize,
}

impl WithSimd for Project<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { basis, vectors, length, stride } = self;
        match vectors.len() / length {
            3 => project::<S, 3>(simd, basis, vectors, length, stride),
            2 => project::<S, 2>(simd, basis, vectors, length, stride),
            _ => project::<S, 1>(simd, basis, vectors, length, stride),
        }
    }
}

#[inline(always)]
fn project<S: Simd, const M: usize>(simd: S, basis: &[f32], vectors: &mut [f32], length: usize, stride: usize) {
    const BLOCK: usize = 4;
    // Modified by blocks of four: what is left after one block meets the next, which keeps f32 accurate.
    let mut blocks = basis.chunks_exact(BLOCK * length);
    for block in &mut blocks {
        project_block::<S, M, BLOCK>(simd, block, vectors, length, stride);
    }
    for one in blocks.remainder().chunks_exact(length) {
        project_block::<S, M, 1>(simd, one, vectors, length, stride);
    }
}

#[inline(always)]
fn project_block<S: Simd, const M: usize, const K: usize>(
    simd: S,
    block: &[f32],
    vectors: &mut [f32],
    length: usize,
    stride: usize,
) {
    let basis: [&[f32]; K] = std::array::from_fn(|k| &block[k * length..][..length]);
    let inner = {
        let vectors: [&[f32]; M] = std::array::from_fn(|m| &vectors[m * length..][..stride]);
        dots(simd, basis.map(|q| &q[..stride]), vectors)
    };
    let count = length / S::F32_LANES;
    let mut wide: [&[S::f32s]; K] = [&[]; K];
    for k in 0..K {
        wide[k] = &S::as_simd_f32s(basis[k]).0[..count];
    }
    for m in 0..M {
        let vector = &mut S::as_mut_simd_f32s(&mut vectors[m * length..][..length]).0[..count];
        let mut factors = [simd.splat_f32s(0.0); K];
        for k in 0..K {
            factors[k] = simd.splat_f32s(-inner[k][m]);
        }
        for at in 0..count {
            let mut sum = vector[at];
            for k in 0..K {
                sum = simd.mul_add_e_f32s(factors[k], wide[k][at], sum);
            }
            vector[at] = sum;
        }
    }
}

/// `||v||^2`.
pub(super) struct Energy<'a>(pub &'a [f32]);

impl WithSimd for Energy<'_> {
    type Output = f32;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> f32 {
        dots(simd, [self.0], [self.0])[0][0]
    }
}

/// Takes a unit vector out of the residual of each channel, and returns how much of it there was.
pub(super) struct TakeOut<'a> {
    pub vector: &'a [f32],
    pub residual: &'a mut [f32],
}

impl WithSimd for TakeOut<'_> {
    type Output = [f32; CHANNELS];

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> [f32; CHANNELS] {
        let stride = self.vector.len();
        let channels: [&[f32]; CHANNELS] = std::array::from_fn(|c| &self.residual[c * stride..][..stride]);
        let shares = dots(simd, [self.vector], channels)[0];
        for (channel, share) in self.residual.chunks_exact_mut(stride).zip(shares) {
            add(simd, channel, -share, self.vector);
        }
        shares
    }
}

/// `to += factor * from`.
pub(super) struct Add<'a> {
    pub to: &'a mut [f32],
    pub factor: f32,
    pub from: &'a [f32],
}

impl WithSimd for Add<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        add(simd, self.to, self.factor, self.from);
    }
}

/// `H += x x^T` for each of the vectors, of which the k-th has numbers up to `k` alone: with the columns of `X = R^-1`,
/// `H = X X^T = (W W^T)^-1`.
pub(super) struct Outer<'a> {
    /// Vectors, of which what follows `skip` numbers is meant.
    pub vectors: &'a [f32],
    pub length: usize,
    pub skip: usize,
    pub matrix: &'a mut [f32],
}

impl WithSimd for Outer<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let side = self.length - self.skip;
        for (k, vector) in self.vectors.chunks_exact(self.length).enumerate() {
            let x = &vector[self.skip..];
            let filled = (k + 1).next_multiple_of(super::dictionary::LANES);
            for (row, factor) in self.matrix.chunks_exact_mut(side).zip(&x[..=k]) {
                add(simd, &mut row[..filled], *factor, &x[..filled]);
            }
        }
    }
}

/// Takes a function out of a least-squares solution: `H -= h h^T / h_j`.
pub(super) struct Remove<'a> {
    pub matrix: &'a mut [f32],
    pub side: usize,
    /// Rows in use.
    pub used: usize,
    /// `h`.
    pub column: &'a [f32],
    /// `1 / h_j`.
    pub pivot: f32,
}

impl WithSimd for Remove<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let filled = self.used.next_multiple_of(super::dictionary::LANES);
        for (row, h) in self.matrix.chunks_exact_mut(self.side).take(self.used).zip(self.column) {
            // Zero for what was taken out before.
            if *h != 0.0 {
                add(simd, &mut row[..filled], -h * self.pivot, &self.column[..filled]);
            }
        }
    }
}

/// `<w, r>` of a row and each channel.
pub(super) struct Against<'a> {
    pub row: &'a [f32],
    pub residual: &'a [f32],
}

impl WithSimd for Against<'_> {
    type Output = [f32; CHANNELS];

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> [f32; CHANNELS] {
        let stride = self.row.len();
        let channels: [&[f32]; CHANNELS] = std::array::from_fn(|c| &self.residual[c * stride..][..stride]);
        dots(simd, [self.row], channels)[0]
    }
}

/// Runs a loop by the widest vectors there are.
pub(super) fn run<W: WithSimd>(arch: Arch, work: W) -> W::Output {
    arch.dispatch(work)
}
