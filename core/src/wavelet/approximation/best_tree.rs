//! The best tree of a size, exactly (after Cartis and Thompson 2013, "An exact tree projection algorithm for wavelets").
//!
//! Nodes are groups, up to three coefficients of one place. `F_i(s)`: the largest sum of squares of s coefficients in the
//! subtree of group i, of which it holds at least one when s > 0. With j = 1, 2, 3 of its own, they are its largest, and
//! the s - j others are divided among its children as well as can be. Tables end at min(size of the subtree, k), so all
//! divisions together cost O(N k), and tables hold about N log_4 k numbers.

use super::Tree;

/// `F(0), F(1), ...`: never empty.
type Table = Vec<f64>;

/// The locations of the best tree (forest, where there are several roots), ascending.
pub(super) fn best_tree(tree: &Tree, magnitudes: &[f32], terms: usize) -> Vec<u32> {
    let terms = terms.min(tree.len());
    // Children before their parents; a group stands under its first member.
    let firsts = |location: &u32| tree.group(*location).next() == Some(*location);
    let mut order: Vec<u32> = tree.linear_order().filter(firsts).collect();
    order.reverse();
    let mut tables: Vec<Table> = vec![Table::new(); tree.len()];
    for first in order {
        let below = family(tree, first)
            .iter()
            .fold(vec![0.0], |sum, child| divided(&sum, &tables[*child as usize], terms.saturating_sub(1)));
        let own = own_gains(tree, magnitudes, first).1;
        let with_own = divided(&below, &own, terms.saturating_sub(1));
        tables[first as usize] = std::iter::once(0.0).chain(with_own).collect();
    }
    let mut chosen = Vec::with_capacity(terms);
    // Groups that share a number of terms.
    let mut shares = vec![(tree.roots().collect::<Vec<u32>>(), terms)];
    while let Some((groups, terms)) = shares.pop() {
        for (first, count) in groups.iter().zip(divide(&groups, &tables, terms)) {
            if count == 0 {
                continue;
            }
            let (members, gains) = own_gains(tree, magnitudes, *first);
            let children = family(tree, *first);
            let below =
                children.iter().fold(vec![0.0], |sum, child| divided(&sum, &tables[*child as usize], count - 1));
            let gain = |own: usize| gains[own - 1] + below[count - own];
            let possible = count.saturating_sub(below.len() - 1).max(1)..=count.min(gains.len());
            let own = possible.reduce(|best, own| if gain(own) > gain(best) { own } else { best }).unwrap_or(1);
            chosen.extend(&members[..own]);
            shares.push((children, count - own));
        }
    }
    chosen.sort_unstable();
    chosen
}

/// The groups under one.
fn family(tree: &Tree, first: u32) -> Vec<u32> {
    tree.groups_below(first).collect()
}

/// Members of a group, the largest first (equals by location), and the sums of squares of the first one, two, three.
fn own_gains(tree: &Tree, magnitudes: &[f32], first: u32) -> (Vec<u32>, Vec<f64>) {
    let square = |location: u32| {
        let square = f64::from(magnitudes[location as usize]).powi(2);
        if square.is_nan() { 0.0 } else { square }
    };
    let mut members: Vec<u32> = tree.group(first).collect();
    members.sort_by(|a, b| square(*b).total_cmp(&square(*a)).then(a.cmp(b)));
    let mut sum = 0.0;
    let gains = members.iter().map(|member| {
        sum += square(*member);
        sum
    });
    let gains = gains.collect();
    (members, gains)
}

/// The best of two sets of subtrees together, for every number of terms up to a limit.
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

/// How many terms each of some groups gets: the division behind the tables, found again on the way down.
fn divide(groups: &[u32], tables: &[Table], terms: usize) -> Vec<usize> {
    let mut prefixes = vec![vec![0.0]];
    for group in groups {
        prefixes.push(divided(&prefixes[prefixes.len() - 1], &tables[*group as usize], terms));
    }
    let mut left = terms;
    let mut counts = vec![0; groups.len()];
    for (n, group) in groups.iter().enumerate().rev() {
        let (before, own) = (&prefixes[n], &tables[*group as usize]);
        let gain = |count: usize| before[left - count] + own[count];
        let possible = (left + 1).saturating_sub(before.len())..=left.min(own.len() - 1);
        counts[n] = possible.reduce(|best, count| if gain(count) > gain(best) { count } else { best }).unwrap_or(0);
        left -= counts[n];
    }
    counts
}
