//! A matrix as the product of two thin ones: the truncated singular value decomposition, as short as a bound on its error
//! allows.
//!
//! `M ~ L R`, M (m x n), L (m x r), R (r x n) with orthonormal rows, in order of falling singular value; `L = M R^T`, so that
//! column i of L is as long as singular value i. Leaving out the later ones leaves `||M - L R||^2 = sum over i >= r of
//! sigma_i^2` (Frobenius), and no matrix of rank r comes nearer (Eckart and Young 1936).
//!
//! **Few rows or columns** (a side of up to 256): the eigenvectors of the smaller of `M^T M` and `M M^T`, in f64.
//!
//! **Both many**: a randomised search for the right factor, block by block (Halko, Martinsson and Tropp 2011, algorithm 4.4;
//! Yu, Gu and Li 2018, randQB, algorithm 1, with its explicit deflation). `D` is what is left of M, at first all of it:
//!
//! ```text
//! W = random signs (n x b);  V_i = orth(D^T D W, against V);  L_i = D V_i;  D = D - L_i V_i^T;  until ||D||^2 <= bound
//! V = orth(M^T L S)      one step of subspace iteration over all that was found; S only keeps columns of one length
//! L = M V;  V = V Q      Q: eigenvectors of L^T L, falling (Rayleigh and Ritz)
//! ```
//!
//! What is outside the subspace is measured as `||M - L V^T||^2`, a sum of squares and no difference of large numbers, and by
//! Pythagoras the error at rank r is that plus the squares of the columns of L left out. So the bound holds whatever the
//! random signs were, and only the rank is subject to chance: it may be one or two above that of the exact decomposition.

use nalgebra::{DMatrix, DMatrixView, Dyn, SymmetricEigen};
use rand::{RngExt, SeedableRng};

use crate::error::{Error, Result};

/// Up to so many rows or columns the small Gram matrix is cheaper than the search.
const EXACT_SIDE: usize = 256;
/// Directions found at a time: wide enough for the product to run at full speed; half of one is wasted on average.
const BLOCK: usize = 32;
/// Parts of the squared norm that f32 cannot tell from 0: relative error 1e-6, some ten roundings.
const FLOOR: f64 = 1e-12;
/// Of columns to be made orthonormal, directions with less of the squared length than this are left to a later block: the
/// Gram matrix loses them in rounding.
const TOO_SHORT: f64 = 1e-10;
/// Columns are independent enough for Cholesky's factors where each has at least this part of the longest one's length beside
/// those before it; then the second pass of [`orthonormal`] mends what f32 loses.
const INDEPENDENT: f64 = 0.01;
/// nalgebra 0.35 multiplies matrices with a side up to 5 by another way, which reads past the end of a view with strides.
const NARROW: usize = 8;
/// Rows or columns turned to f64 at a time, so that they stay in cache.
const PANEL: usize = 256;

/// A matrix in two factors.
#[derive(Debug, Clone, PartialEq)]
pub struct LowRank {
    /// L: rows x rank.
    pub left: DMatrix<f32>,
    /// R transposed: columns x rank, its columns orthonormal. In memory `[rank][column]`.
    pub right: DMatrix<f32>,
    /// `||M - L R||^2`.
    pub residual: f64,
}

impl LowRank {
    /// Columns of L.
    pub fn rank(&self) -> usize {
        self.left.ncols()
    }
}

/// Factors a matrix with the smallest rank whose squared Frobenius error is within `bound`; rank 0 where the matrix is.
///
/// A bound below 1e-12 of the squared norm of the matrix, 0 among them, is more than f32 can keep, and is taken as that. Seeded;
/// the result does not depend on the number of threads, of which it uses one.
///
/// Cost: exact, `2 m n s + O(s^3)` for the smaller side s in f64; else about `16 m n k` operations in f32, k the rank rounded up
/// to whole blocks, and a copy of the matrix.
///
/// # Errors
/// A matrix without numbers or with some that are not finite; a bound that is negative or NaN.
pub fn low_rank(matrix: &DMatrix<f32>, bound: f64, seed: u64) -> Result<LowRank> {
    let (rows, columns) = matrix.shape();
    let energy = squared(matrix);
    if matrix.is_empty() || !energy.is_finite() {
        let found = if matrix.is_empty() { "no number" } else { "a number that is not finite" };
        return Err(Error::invalid(format!("matrix of {rows} x {columns}"), found, "finite numbers"));
    }
    if bound.is_nan() || bound < 0.0 {
        return Err(Error::invalid("low-rank factorisation", format!("an error of {bound}"), "0 or more"));
    }
    if energy <= bound {
        let (left, right) = (DMatrix::zeros(rows, 0), DMatrix::zeros(columns, 0));
        return Ok(LowRank { left, right, residual: energy });
    }
    let bound = bound.max(FLOOR * energy);
    let subspace = if rows.min(columns) <= EXACT_SIDE { exact(matrix, bound) } else { search(matrix, bound, seed) };
    let (rank, residual) = subspace.cut(bound);
    let right = subspace.right.columns(0, rank).into_owned();
    let left = matrix * &right;
    Ok(LowRank { left, right, residual })
}

/// Orthonormal directions in the space of rows, by what M has along them.
struct Subspace {
    /// n x k.
    right: DMatrix<f32>,
    /// `||M v_i||^2`, falling.
    energies: Vec<f64>,
    /// `||M - M V V^T||^2`.
    outside: f64,
}

impl Subspace {
    /// The smallest rank within the bound, and its squared error; all of the subspace where none is.
    fn cut(&self, bound: f64) -> (usize, f64) {
        let (mut rank, mut residual) = (self.energies.len(), self.outside);
        while rank > 0 && residual + self.energies[rank - 1] <= bound {
            rank -= 1;
            residual += self.energies[rank];
        }
        (rank, residual)
    }
}

/// By the Gram matrix of the shorter side.
fn exact(matrix: &DMatrix<f32>, bound: f64) -> Subspace {
    if matrix.nrows() >= matrix.ncols() {
        let (energies, vectors) = falling(gram(matrix));
        return Subspace { right: vectors.cast(), energies, outside: 0.0 };
    }
    // M^T u_i / sigma_i = v_i: only for those that will be kept, whose sigma is not lost in rounding.
    let (energies, vectors) = falling(gram_of_rows(matrix));
    let all = Subspace { right: DMatrix::zeros(0, 0), energies, outside: 0.0 };
    let (rank, outside) = all.cut(bound);
    let scaled = DMatrix::from_fn(matrix.nrows(), rank, |i, j| (vectors[(i, j)] / all.energies[j].sqrt()) as f32);
    ritz(matrix, orthonormal(tr_mul(matrix, &scaled), None), outside)
}

/// By random blocks.
fn search(matrix: &DMatrix<f32>, bound: f64, seed: u64) -> Subspace {
    let (rows, columns) = matrix.shape();
    let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(seed);
    let mut rest = matrix.clone();
    let (mut left, mut right) = (DMatrix::zeros(rows, 0), DMatrix::zeros(columns, 0));
    while squared(&rest) > bound && right.ncols() < rows.min(columns) {
        let signs = DMatrix::from_fn(columns, BLOCK, |_, _| if rng.random() { 1.0f32 } else { -1.0 });
        let new = orthonormal(tr_mul(&rest, &(&rest * signs)), Some(&right));
        if new.is_empty() {
            break;
        }
        let seen = &rest * &new;
        rest.gemm(-1.0, &seen, &new.transpose(), 1.0);
        append(&mut left, &seen);
        append(&mut right, &new);
    }
    // Columns of M^T L Q / lambda are all nearly of length 1: as they are already nearly the right singular vectors.
    let (energies, rotation) = falling(gram(&left));
    let kept = energies.iter().take_while(|&&energy| energy > FLOOR * energies[0]).count();
    let scaled = DMatrix::from_fn(left.ncols(), kept, |i, j| (rotation[(i, j)] / energies[j]) as f32);
    let right = orthonormal(tr_mul(matrix, &(left * scaled)), None);
    rest.copy_from(matrix);
    rest.gemm(-1.0, &(matrix * &right), &right.transpose(), 1.0);
    ritz(matrix, right, squared(&rest))
}

/// Turns an orthonormal basis so that what M has along its directions is orthogonal, and falls.
fn ritz(matrix: &DMatrix<f32>, right: DMatrix<f32>, outside: f64) -> Subspace {
    let (energies, rotation) = falling(gram(&(matrix * &right)));
    Subspace { right: right * rotation.cast::<f32>(), energies, outside }
}

/// Eigenvalues, falling and not negative, and their eigenvectors.
fn falling(gram: DMatrix<f64>) -> (Vec<f64>, DMatrix<f64>) {
    let eigen = SymmetricEigen::new(gram);
    let mut order: Vec<usize> = (0..eigen.eigenvalues.len()).collect();
    order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
    let values = order.iter().map(|&i| eigen.eigenvalues[i].max(0.0)).collect();
    (values, eigen.eigenvectors.select_columns(&order))
}

/// An orthonormal basis of what the columns have beside those of `against`, less directions that are [`TOO_SHORT`]. Twice:
/// the second time the columns are nearly orthonormal, and no rounding is enlarged (as CholeskyQR2, Yamamoto et al. 2015).
fn orthonormal(mut columns: DMatrix<f32>, against: Option<&DMatrix<f32>>) -> DMatrix<f32> {
    for _ in 0..2 {
        if let Some(against) = against.filter(|a| !a.is_empty()) {
            let along = tr_mul(against, &columns);
            columns.gemm(-1.0, against, &along, 1.0);
        }
        columns *= whitening(gram(&columns));
    }
    columns
}

/// For the Gram matrix G of some columns a W with `W^T G W = 1`: by Cholesky's factors where the columns are independent
/// enough, else by eigenvectors, which cost many times as much and leave out what is [`TOO_SHORT`].
fn whitening(gram: DMatrix<f64>) -> DMatrix<f32> {
    let side = gram.nrows();
    if let Some(lower) = gram.clone().cholesky().map(|cholesky| cholesky.l()) {
        let lengths = lower.diagonal();
        let independent = lengths.min() > INDEPENDENT * lengths.max();
        let inverse = lower.solve_lower_triangular(&DMatrix::identity(side, side));
        if let Some(inverse) = inverse.filter(|_| independent) {
            return inverse.transpose().cast();
        }
    }
    let (squares, vectors) = falling(gram);
    let kept = squares.iter().take_while(|&&square| square > TOO_SHORT * squares[0]).count();
    DMatrix::from_fn(side, kept, |i, j| (vectors[(i, j)] / squares[j].sqrt()) as f32)
}

/// `M^T M`, summed in f64.
fn gram(matrix: &DMatrix<f32>) -> DMatrix<f64> {
    let mut gram = DMatrix::zeros(matrix.ncols(), matrix.ncols());
    for first in (0..matrix.nrows()).step_by(PANEL) {
        let panel: DMatrix<f64> = matrix.rows(first, PANEL.min(matrix.nrows() - first)).map(f64::from);
        gram.gemm(1.0, &panel.transpose(), &panel, 1.0);
    }
    gram
}

/// `M M^T`, summed in f64.
fn gram_of_rows(matrix: &DMatrix<f32>) -> DMatrix<f64> {
    let mut gram = DMatrix::zeros(matrix.nrows(), matrix.nrows());
    for first in (0..matrix.ncols()).step_by(PANEL) {
        let panel: DMatrix<f64> = matrix.columns(first, PANEL.min(matrix.ncols() - first)).map(f64::from);
        gram.gemm(1.0, &panel, &panel.transpose(), 1.0);
    }
    gram
}

/// `M^T X` at the full speed of a product, which nalgebra's `tr_mul` does not have, and without a copy of M.
fn tr_mul(matrix: &DMatrix<f32>, x: &DMatrix<f32>) -> DMatrix<f32> {
    let (rows, columns) = matrix.shape();
    if rows.min(columns).min(x.ncols()) <= NARROW {
        return matrix.tr_mul(x);
    }
    let transposed: DMatrixView<'_, f32, Dyn, Dyn> =
        DMatrixView::from_slice_with_strides(matrix.as_slice(), columns, rows, rows, 1);
    transposed * x
}

fn append(matrix: &mut DMatrix<f32>, columns: &DMatrix<f32>) {
    let before = matrix.ncols();
    *matrix = std::mem::replace(matrix, DMatrix::zeros(0, 0)).resize_horizontally(before + columns.ncols(), 0.0);
    matrix.columns_mut(before, columns.ncols()).copy_from(columns);
}

/// `||M||^2` in f64.
fn squared(matrix: &DMatrix<f32>) -> f64 {
    // Columns first, so that many small numbers are not lost in a large sum.
    matrix.as_slice().chunks(1 << 12).map(|part| part.iter().map(|v| f64::from(*v).powi(2)).sum::<f64>()).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn random(rows: usize, columns: usize, rng: &mut rand_pcg::Pcg64Mcg) -> DMatrix<f32> {
        // Sums of four are near enough to normal.
        DMatrix::from_fn(rows, columns, |_, _| (0..4).map(|_| rng.random_range(-1.0f32..1.0)).sum())
    }

    /// Rank `rank` with singular values that fall by `ratio` each, and noise.
    fn matrix(rows: usize, columns: usize, rank: usize, ratio: f32, noise: f32, seed: u64) -> DMatrix<f32> {
        let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(seed);
        let mut left = random(rows, rank, &mut rng);
        left.column_iter_mut().enumerate().for_each(|(i, mut column)| column *= ratio.powi(i as i32));
        left * random(rank, columns, &mut rng) / (columns as f32).sqrt() + random(rows, columns, &mut rng) * noise
    }

    /// What every factorisation must be.
    fn check(matrix: &DMatrix<f32>, bound: f64, seed: u64) -> LowRank {
        let factors = low_rank(matrix, bound, seed).unwrap();
        let (left, right, rank) = (&factors.left, &factors.right, factors.rank());
        assert_eq!((left.shape(), right.shape()), ((matrix.nrows(), rank), (matrix.ncols(), rank)));
        let energy = squared(matrix);
        let rest = squared(&(matrix - left * right.transpose()));
        assert!(rest <= bound * 1.000_01 + 4.0 * FLOOR * energy, "{rest} is beyond {bound}");
        assert!(
            (rest - factors.residual).abs() <= 1e-5 * rest + 4.0 * FLOOR * energy,
            "{rest}, not {}",
            factors.residual
        );
        let product: DMatrix<f64> = gram(right);
        assert!((product - DMatrix::identity(rank, rank)).amax() < 2e-6, "rows of R are not orthonormal");
        let lengths: Vec<f32> = left.column_iter().map(|c| c.norm()).collect();
        assert!(lengths.windows(2).all(|pair| pair[0] >= pair[1] * 0.999_99), "not falling: {lengths:?}");
        assert!((left - matrix * right).amax() <= 1e-5 * lengths.first().copied().unwrap_or(0.0));
        factors
    }

    /// The rank and the singular values by nalgebra's own decomposition.
    fn oracle(matrix: &DMatrix<f32>, bound: f64) -> (usize, Vec<f64>) {
        let values: Vec<f64> = matrix.map(f64::from).singular_values().iter().copied().collect();
        let within = |r: &usize| values[*r..].iter().map(|v| v * v).sum::<f64>() <= bound;
        ((0..=values.len()).find(within).unwrap(), values)
    }

    #[test]
    fn the_rank_is_the_smallest_there_is() {
        // Tall and wide, by both ways; the last two are beyond the exact one.
        for (rows, columns) in [(1, 1), (7, 3), (3, 7), (200, 72), (72, 200), (12, 3000), (420, 300), (300, 420)] {
            let matrix = matrix(rows, columns, 24.min(rows.min(columns)), 0.8, 1e-4, (rows * columns) as u64);
            for error in [0.5f64, 0.1, 0.02, 0.004] {
                let bound = error.powi(2) * squared(&matrix);
                let (rank, values) = oracle(&matrix, bound);
                let factors = check(&matrix, bound, 1);
                assert_eq!(factors.rank(), rank, "{rows} x {columns}, error {error}");
                for (column, value) in factors.left.column_iter().zip(&values) {
                    assert!((f64::from(column.norm()) / value - 1.0).abs() < 1e-4, "{} is not {value}", column.norm());
                }
            }
        }
    }

    /// Noise alone has the flattest spectrum, which is the hardest for the search.
    #[test]
    fn noise_takes_hardly_more_than_the_smallest_rank() {
        let matrix = random(500, 300, &mut rand_pcg::Pcg64Mcg::seed_from_u64(3));
        for error in [0.9f64, 0.5, 0.1] {
            let bound = error.powi(2) * squared(&matrix);
            let (smallest, _) = oracle(&matrix, bound);
            let rank = check(&matrix, bound, 1).rank();
            assert!((smallest..=smallest + 2 + smallest / 20).contains(&rank), "{rank} for {smallest}");
        }
    }

    #[test]
    fn a_matrix_within_the_bound_has_rank_0() {
        assert_eq!(check(&DMatrix::zeros(5, 4), 0.0, 1).rank(), 0);
        let small = matrix(300, 400, 3, 0.5, 0.0, 1);
        let energy = squared(&small);
        assert_eq!(check(&small, energy, 1).rank(), 0);
        assert!(check(&small, 0.999 * energy, 1).rank() > 0);
    }

    #[test]
    fn a_bound_of_0_gives_all_that_f32_can_tell() {
        for (rows, columns) in [(40, 30), (30, 40), (300, 320)] {
            assert_eq!(check(&matrix(rows, columns, 5, 0.5, 0.0, 2), 0.0, 1).rank(), 5, "{rows} x {columns}");
            let full = random(rows, columns, &mut rand_pcg::Pcg64Mcg::seed_from_u64(2));
            let least = rows.min(columns);
            assert!((least - 1..=least).contains(&check(&full, 0.0, 1).rank()), "{rows} x {columns}");
        }
    }

    #[test]
    fn the_same_seed_gives_the_same_bits() {
        let matrix = matrix(300, 290, 20, 0.9, 1e-3, 4);
        let bound = 1e-3 * squared(&matrix);
        let first = low_rank(&matrix, bound, 1).unwrap();
        let pool = rayon::ThreadPoolBuilder::new().num_threads(3).build().unwrap();
        assert_eq!(pool.install(|| low_rank(&matrix, bound, 1)).unwrap(), first);
        let other = low_rank(&matrix, bound, 2).unwrap();
        assert_eq!(other.rank(), first.rank());
        assert!((&other.left * other.right.transpose() - &first.left * first.right.transpose()).amax() < 1e-3);
    }

    #[test]
    fn what_is_no_matrix_is_refused() {
        let mut bad = DMatrix::from_element(3, 3, 1.0f32);
        for bound in [-1.0, f64::NAN] {
            assert!(low_rank(&bad, bound, 1).unwrap_err().to_string().contains("0 or more"));
        }
        assert!(low_rank(&DMatrix::zeros(0, 3), 1.0, 1).unwrap_err().to_string().contains("no number"));
        for number in [f32::NAN, f32::INFINITY] {
            bad[(1, 1)] = number;
            assert!(low_rank(&bad, 1.0, 1).unwrap_err().to_string().contains("not finite"));
        }
    }
}
