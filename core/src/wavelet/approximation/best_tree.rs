//! The best tree of a size, exactly (Cartis and Thompson 2013, "An exact tree projection algorithm for wavelets").
//!
//! `F_i(s)`: the largest sum of squares of s coefficients in the subtree of i that contain i (s > 0) and all ancestors
//! within it. It is |c_i|^2 and the best division of s - 1 among the children. Tables end at min(size of the subtree, k), so
//! all divisions together cost O(N k), and tables hold about N log_4 k numbers.

use super::Tree;

/// `F(0), F(1), ...`: never empty.
type Table = Vec<f64>;

/// The locations of the best tree (forest, where there are several roots), ascending.
pub(super) fn best_tree(tree: &Tree, magnitudes: &[f32], terms: usize) -> Vec<u32> {
    let terms = terms.min(tree.len());
    // Children before their parents.
    let mut order: Vec<u32> = tree.linear_order().collect();
    order.reverse();
    let mut tables: Vec<Table> = vec![Table::new(); tree.len()];
    for location in order {
        let value = f64::from(magnitudes[location as usize]).powi(2);
        let value = if value.is_nan() { 0.0 } else { value };
        let below = tree
            .children(location)
            .fold(vec![0.0], |sum, child| divided(&sum, &tables[child as usize], terms.saturating_sub(1)));
        tables[location as usize] = std::iter::once(0.0).chain(below.iter().map(|gain| gain + value)).collect();
    }
    let mut chosen = Vec::with_capacity(terms);
    // Locations that share a number of terms.
    let mut shares = vec![(tree.roots().collect::<Vec<u32>>(), terms)];
    while let Some((family, terms)) = shares.pop() {
        for (member, count) in family.iter().zip(divide(&family, &tables, terms)) {
            if count > 0 {
                chosen.push(*member);
                shares.push((tree.children(*member).collect(), count - 1));
            }
        }
    }
    chosen.sort_unstable();
    chosen
}

/// The best of two subtrees together, for every number of terms up to a limit.
fn divided(first: &[f64], second: &[f64], limit: usize) -> Table {
    let mut best = vec![0.0; (first.len() + second.len() - 1).min(limit + 1)];
    for (a, gain) in first.iter().enumerate().take(best.len()) {
        best[a..].iter_mut().zip(second).for_each(|(best, more)| {
            let sum = gain + more;
            *best = if sum > *best { sum } else { *best };
        });
    }
    best
}

/// How many terms each of a family gets: the division behind the tables, found again on the way down.
fn divide(family: &[u32], tables: &[Table], terms: usize) -> Vec<usize> {
    let mut prefixes = vec![vec![0.0]];
    for member in family {
        prefixes.push(divided(&prefixes[prefixes.len() - 1], &tables[*member as usize], terms));
    }
    let mut left = terms;
    let mut counts = vec![0; family.len()];
    for (n, member) in family.iter().enumerate().rev() {
        let (before, own) = (&prefixes[n], &tables[*member as usize]);
        let gain = |count: usize| before[left - count] + own[count];
        let possible = (left + 1).saturating_sub(before.len())..=left.min(own.len() - 1);
        counts[n] = possible.reduce(|best, count| if gain(count) > gain(best) { count } else { best }).unwrap_or(0);
        left -= counts[n];
    }
    counts
}
