//! Which coefficients to keep (6.4, 6.5).
//!
//! A set of coefficients is a *tree* here when the group (the place, of whatever orientation) over each of its members has
//! a member too. So growth goes on from one orientation to all, as the thesis's definition of children has it (6.5: all
//! functions of the next level that overlap). Were only children of the same orientation to follow, one small coarse
//! coefficient would shut off all that lies under it. Measured at 0.5 % of the coefficients of ten photographs of
//! 512 x 512, the relative error of optimal progressive trees exceeds that of the non-linear approximation by 0.4 % (Haar)
//! and 0.8 % (9/7) on average; with children of the same orientation alone by 3.9 % and 3.3 %. The thesis found 0.7 %.
//!
//! | part | what it holds |
//! |---|---|
//! | `best_tree` | the best subtree of a size, by dynamic programming |
//! | `progressive` | trees grown from the root, asking only for the coefficients that they need |

mod best_tree;
mod progressive;

pub use progressive::{Greedy, Optimal};

use super::Tree;

/// A way to choose some of the coefficients.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Approximation {
    /// The first in a fixed order, whatever their values: level, row, column, orientation (figure 6.5).
    Linear,
    /// The largest.
    NonLinear,
    /// The tree with the largest sum of squares.
    BestTree,
    /// A tree that grows everything below its largest leaf at once (eq. 6.2).
    GreedyTree,
    /// A tree that grows the largest of all that lies below its members (eq. 6.3, 6.4).
    OptimalTree,
}

impl Approximation {
    /// All of them, in the order of their errors for one count, as a rule: the non-linear one is best.
    pub const ALL: [Self; 5] = [Self::NonLinear, Self::BestTree, Self::OptimalTree, Self::GreedyTree, Self::Linear];

    /// Chooses locations: `terms` of them, or all where there are no more. Magnitudes are by location, `|c_j| ||s_j||` so
    /// that the error is least (exactly for orthogonal wavelets, nearly for the others). Equal magnitudes are taken by
    /// ascending location; NaN counts as larger than all numbers, but for the best tree, where it counts nothing.
    ///
    /// Locations come in the order in which they are taken, so that fewer terms are a prefix; for the best tree, whose
    /// sets of different sizes need not contain each other, they ascend. `terms` of 0 gives none.
    ///
    /// Cost, for N coefficients and k terms: O(N + k log k) for the non-linear one, O(N k) at most for the best tree,
    /// O(k log k) for the others.
    ///
    /// # Panics
    /// When there is not one magnitude a location.
    pub fn choose(self, tree: &Tree, magnitudes: &[f32], terms: usize) -> Vec<u32> {
        assert_eq!(magnitudes.len(), tree.len(), "one magnitude a location");
        let query = |location: u32| magnitudes[location as usize];
        match self {
            Self::Linear => tree.linear_order().take(terms).collect(),
            Self::NonLinear => largest(magnitudes, terms),
            Self::BestTree => best_tree::best_tree(tree, magnitudes, terms),
            Self::GreedyTree => Greedy::new(tree, query).take(terms).collect(),
            Self::OptimalTree => Optimal::new(tree, query).take(terms).collect(),
        }
    }
}

/// The largest magnitudes, largest first.
fn largest(magnitudes: &[f32], terms: usize) -> Vec<u32> {
    let order = |a: &u32, b: &u32| {
        let magnitude = |n: &u32| magnitudes[*n as usize];
        magnitude(b).total_cmp(&magnitude(a)).then(a.cmp(b))
    };
    let mut all: Vec<u32> = (0..magnitudes.len() as u32).collect();
    if 0 < terms && terms < all.len() {
        all.select_nth_unstable_by(terms - 1, order);
    }
    all.truncate(terms);
    all.sort_unstable_by(order);
    all
}

#[cfg(test)]
mod tests;
