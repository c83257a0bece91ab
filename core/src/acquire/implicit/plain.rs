//! One pixel in plain double precision, a step after another as it stands in the text: the oracle of the fast solver, and
//! what its speed is compared with.

use nalgebra::{DMatrix, DVector};

use super::dictionary::{Dictionary, Group};
use super::grow::{DEPENDENT, enough};
use super::kernels::CHANNELS;
use super::{Options, Stop, Terms, generalised, tried};

/// The terms of one pixel, as [`Solver::solve`](super::Solver::solve) finds them, but for rounding. Slow: an orthonormal basis
/// is kept as columns, and least squares are solved anew for every term that is taken back.
///
/// # Panics
/// When `response` does not hold three numbers a pattern; when there are not fewer terms than patterns.
pub fn solve_plainly(dictionary: &Dictionary, options: Options, response: &[f32], noise: Option<f32>) -> Terms {
    let patterns = dictionary.patterns();
    assert!(options.terms < patterns && response.len() == CHANNELS * patterns, "a response to {patterns} patterns");
    if !response.iter().all(|v| v.is_finite()) {
        return Terms::default();
    }
    let response = DMatrix::from_fn(patterns, CHANNELS, |n, c| f64::from(response[c * patterns + n]));
    let noise = noise.filter(|_| options.stop == Stop::On);
    let mut rows = grow(dictionary, tried(options.terms, patterns), &response, noise);
    let solution = loop {
        let (solution, inverse, left) = least_squares(dictionary, &rows, &response);
        let loss = |at: usize| solution.row(at).norm_squared() / inverse[(at, at)];
        let losses = (0..rows.len()).map(|at| (at, loss(at)));
        let Some((least, loss)) = losses.reduce(|least, next| if next.1 < least.1 { next } else { least }) else {
            break solution;
        };
        let (before, after) = (rows.len(), rows.len() - 1);
        let noise = generalised(left + loss, after, patterns) <= generalised(left, before, patterns);
        if before <= options.terms && !(options.stop == Stop::On && noise) {
            break solution;
        }
        rows.remove(least);
    };
    Terms {
        locations: rows.iter().map(|row| dictionary.location(*row)).collect(),
        coefficients: solution.row_iter().map(|row| std::array::from_fn(|c| row[c] as f32)).collect(),
    }
}

/// A row of W.
fn row(dictionary: &Dictionary, row: u32) -> DVector<f64> {
    DVector::from_iterator(dictionary.patterns(), dictionary.patterns_of(row).iter().map(|w| f64::from(*w)))
}

fn grow(dictionary: &Dictionary, most: usize, response: &DMatrix<f64>, noise: Option<f32>) -> Vec<u32> {
    let mut candidates: Vec<Group> = (0..dictionary.roots()).map(|root| dictionary.group(root)).collect();
    let (mut rows, mut basis, mut residual) = (Vec::new(), Vec::new(), response.clone());
    let enough = f64::from(enough(response.norm_squared() as f32, noise, dictionary.patterns()));
    while residual.norm_squared() > enough {
        let gains = candidates.iter().map(|group| gain(dictionary, group, &residual));
        let best = gains.enumerate().reduce(|best, next| if next.1 > best.1 { next } else { best });
        let Some((best, _)) = best.filter(|best| best.1 > 0.0) else { break };
        if basis.len() + candidates[best].count as usize > most {
            break;
        }
        let group = candidates.remove(best);
        for number in group.row..group.row + group.count {
            let row = row(dictionary, number);
            let mut vector = row.clone();
            // Twice is enough (W. Kahan; L. Giraud et al., "Rounding error analysis of Gram-Schmidt", 2005).
            for q in basis.iter().chain(&basis) {
                let share: f64 = vector.dot(q);
                vector.axpy(-share, q, 1.0);
            }
            if vector.norm_squared() > f64::from(DEPENDENT) * row.norm_squared() {
                vector.normalize_mut();
                residual -= &vector * vector.tr_mul(&residual);
                basis.push(vector);
                rows.push(number);
            }
        }
        candidates.extend((group.child..group.child + group.children).map(|child| dictionary.group(child)));
    }
    rows
}

/// How much of the residual's energy a group explains, one function at a time.
fn gain(dictionary: &Dictionary, group: &Group, residual: &DMatrix<f64>) -> f64 {
    let weights = dictionary.weights(group.row, group.count);
    let gain = |(number, weight): (u32, &f32)| {
        let row = row(dictionary, number);
        residual.tr_mul(&row).norm_squared() * f64::from(*weight)
    };
    (group.row..).zip(weights).map(gain).sum()
}

/// Coefficients, `(W W^T)^-1`, and the energy that is left.
fn least_squares(dictionary: &Dictionary, rows: &[u32], response: &DMatrix<f64>) -> (DMatrix<f64>, DMatrix<f64>, f64) {
    let columns: Vec<DVector<f64>> = rows.iter().map(|number| row(dictionary, *number)).collect();
    if columns.is_empty() {
        return (DMatrix::zeros(0, CHANNELS), DMatrix::zeros(0, 0), response.norm_squared());
    }
    let w = DMatrix::from_columns(&columns);
    let inverse = w.tr_mul(&w).cholesky().expect("independent rows").inverse();
    let solution = &inverse * w.tr_mul(response);
    let left = (response - w * &solution).norm_squared();
    (solution, inverse, left)
}
