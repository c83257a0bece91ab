//! One pixel in plain double precision, a step after another as it stands in the text: the oracle of the fast solver, and
//! what its speed is compared with.

use nalgebra::{DMatrix, DVector};

use super::dictionary::{Dictionary, Group};
use super::grow::{DEPENDENT, enough};
use super::kernels::CHANNELS;
use super::{Options, Stop, Terms, generalised, tried};

/// A group of the tree.
struct Node {
    parent: Option<usize>,
    rows: Vec<u32>,
}

/// The terms of one pixel, as [`Solver::solve`](super::Solver::solve) finds them, but for rounding. Slow: an orthonormal basis
/// is kept as columns, and least squares are solved anew for every leaf that is taken back.
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
    let mut tree = grow(dictionary, tried(options.terms, patterns), &response, noise);
    let solution = loop {
        let rows: Vec<u32> = tree.iter().flat_map(|node| node.rows.iter().copied()).collect();
        let (solution, inverse, left) = least_squares(dictionary, &rows, &response);
        let Some((leaf, loss)) = least(&tree, &solution, &inverse) else { break solution };
        let fewer = rows.len() - tree[leaf].rows.len();
        let noise = generalised(left + loss, fewer, patterns) <= generalised(left, rows.len(), patterns);
        if rows.len() <= options.terms && !(options.stop == Stop::On && noise) {
            break solution;
        }
        tree.remove(leaf);
        for parent in tree.iter_mut().filter_map(|node| node.parent.as_mut()) {
            *parent -= usize::from(*parent > leaf);
        }
    };
    let rows = tree.iter().flat_map(|node| &node.rows);
    Terms {
        locations: rows.map(|row| dictionary.location(*row)).collect(),
        coefficients: solution.row_iter().map(|row| std::array::from_fn(|c| row[c] as f32)).collect(),
    }
}

/// A row of W.
fn row(dictionary: &Dictionary, row: u32) -> DVector<f64> {
    DVector::from_iterator(dictionary.patterns(), dictionary.patterns_of(row).iter().map(|w| f64::from(*w)))
}

fn grow(dictionary: &Dictionary, most: usize, response: &DMatrix<f64>, noise: Option<f32>) -> Vec<Node> {
    let mut candidates: Vec<(Option<usize>, Group)> =
        (0..dictionary.roots()).map(|root| (None, dictionary.group(root))).collect();
    let (mut tree, mut basis, mut residual) = (Vec::new(), Vec::new(), response.clone());
    let enough = f64::from(enough(response.norm_squared() as f32, noise, dictionary.patterns()));
    while residual.norm_squared() > enough {
        let gains = candidates.iter().map(|(_, group)| gain(dictionary, group, &residual));
        let best = gains.enumerate().reduce(|best, next| if next.1 > best.1 { next } else { best });
        let Some((best, _)) = best.filter(|best| best.1 > 0.0) else { break };
        if basis.len() + candidates[best].1.count as usize > most {
            break;
        }
        let (parent, group) = candidates.remove(best);
        let mut node = Node { parent, rows: Vec::new() };
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
                node.rows.push(number);
            }
        }
        let below = group.child..group.child + group.children;
        candidates.extend(below.map(|child| (Some(tree.len()), dictionary.group(child))));
        tree.push(node);
    }
    tree
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

/// The leaf without which least energy more is left, and how much: `c_g^T (H_gg)^-1 c_g`.
fn least(tree: &[Node], solution: &DMatrix<f64>, inverse: &DMatrix<f64>) -> Option<(usize, f64)> {
    let mut first = 0;
    let mut least: Option<(usize, f64)> = None;
    for (at, node) in tree.iter().enumerate() {
        let count = node.rows.len();
        if !tree.iter().any(|other| other.parent == Some(at)) {
            let own = solution.rows(first, count);
            let within = inverse.view((first, first), (count, count)).clone_owned();
            let loss = own.dot(&(within.try_inverse().expect("a positive matrix") * own));
            if least.is_none_or(|(_, smallest)| loss < smallest) {
                least = Some((at, loss));
            }
        }
        first += count;
    }
    least
}
