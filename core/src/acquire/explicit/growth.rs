//! Which functions to show next: a greedy progressive tree over places (6.5, 6.6.2).
//!
//! [`wavelet::Greedy`](crate::wavelet) asks for magnitudes of single coefficients. Here a place is asked for with all its
//! orientations, and chosen by the sum of what they weigh (6.6.4), and the answers come in from outside, one by one.

use std::cmp::{Ordering, Reverse};
use std::collections::{BinaryHeap, HashMap, HashSet, VecDeque};

use super::Norm;
use crate::wavelet::Tree;

/// How large coefficients of light may be (eq. 6.6): `weight(v) = c_r 2^(-v c_s)`, v = 0 the coarsest level.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Weight {
    /// c_r: the range of the light. It scales all weights alike, so no choice depends on it.
    pub range: f64,
    /// c_s: 1 for any light of limited range, more where all of it is smooth. (6.6.2)
    pub smoothness: f64,
}

impl Default for Weight {
    /// The thesis's: both 1.
    fn default() -> Self {
        Self { range: 1.0, smoothness: 1.0 }
    }
}

impl Weight {
    /// Of functions of a level.
    pub fn of(&self, level: u32) -> f64 {
        self.range * (-f64::from(level) * self.smoothness).exp2()
    }
}

/// A place whose functions were all seen, and nothing below it yet. The largest is the greatest; of equals, the lowest.
#[derive(Debug, Clone, Copy)]
struct Leaf {
    priority: f64,
    first: Reverse<u32>,
}

impl Ord for Leaf {
    fn cmp(&self, other: &Self) -> Ordering {
        self.priority.total_cmp(&other.priority).then(self.first.cmp(&other.first))
    }
}

impl PartialOrd for Leaf {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Leaf {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Leaf {}

/// A greedy progressive tree that grows with what is seen.
///
/// ```
/// use relume_core::acquire::explicit::{Growth, Norm, Weight};
/// use relume_core::wavelet::Tree;
///
/// let mut growth = Growth::new(Tree::new((4, 4))?, Weight::default(), 0.0);
/// let mut order = Vec::new();
/// while let Some(location) = growth.next(None) {
///     // Here the function is shown and photographed.
///     growth.observe(location, &Norm::exact(1.0 / f64::from(location + 1)));
///     order.push(location);
/// }
/// assert_eq!((order.len(), order[0]), (16, 0));
/// # Ok::<(), relume_core::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct Growth {
    tree: Tree,
    weight: Weight,
    /// Leaves below this share of `reference` get no children.
    threshold: f64,
    /// The largest weighted norm of a scaling function.
    reference: f64,
    /// To be shown next.
    pending: VecDeque<u32>,
    /// Of places of which some functions were seen: the sum of weighted norms so far, and how many are still to come.
    partly: HashMap<u32, (f64, usize)>,
    leaves: BinaryHeap<Leaf>,
    /// Members, in the order in which they were seen.
    members: Vec<u32>,
    /// Sum of weighted norms of all members: the right side of (6.7), as far as it is known.
    known: f64,
}

impl Growth {
    /// Starts from the scaling functions. `threshold` ends the growth: leaves that weigh less than this share of the heaviest
    /// scaling function get no children; 0 lets all grow that are more than noise.
    pub fn new(tree: Tree, weight: Weight, threshold: f64) -> Self {
        let pending = tree.roots().collect();
        Self {
            tree,
            weight,
            threshold,
            reference: 0.0,
            pending,
            partly: HashMap::new(),
            leaves: BinaryHeap::new(),
            members: Vec::new(),
            known: 0.0,
        }
    }

    /// The location to be shown next; `None` when no leaf earns children, or all are members.
    ///
    /// Where a capture is taken up again, `recorded` is what was shown in this place before: its place is opened if it can be,
    /// whatever the priorities are (a photograph may have been taken again since, and norms changed a little).
    pub fn next(&mut self, recorded: Option<u32>) -> Option<u32> {
        if self.pending.is_empty() {
            let first = recorded.and_then(|location| self.leaf_above(location)).or_else(|| self.heaviest())?;
            self.leaves.retain(|leaf| leaf.first.0 != first);
            self.pending.extend(self.tree.below(first));
        }
        self.pending.pop_front()
    }

    /// What was seen of a location.
    pub fn observe(&mut self, location: u32, norm: &Norm) {
        let weighted = self.weight.of(self.tree.level(location)) * norm.above_noise();
        self.members.push(location);
        self.known += weighted;
        let is_root = self.tree.orientation(location).is_none();
        if is_root {
            self.reference = self.reference.max(weighted);
        }
        let mut group = self.tree.group(location);
        let Some(first) = group.next() else { return };
        let count = 1 + group.count();
        let (sum, left) = self.partly.entry(first).or_insert((0.0, count));
        *sum += weighted;
        *left -= 1;
        if *left > 0 {
            return;
        }
        let priority = *sum;
        self.partly.remove(&first);
        // Noise earns no children. Where the scaling functions show nothing, there is nothing to decide by, and all go on.
        if (priority > 0.0 || is_root) && self.tree.groups_below(first).next().is_some() {
            self.leaves.push(Leaf { priority, first: Reverse(first) });
        }
    }

    /// Locations seen so far, in order.
    pub fn members(&self) -> &[u32] {
        &self.members
    }

    /// What the heaviest leaf weighs, as a share of the heaviest scaling function; `None` without a leaf.
    pub fn largest_leaf(&self) -> Option<f64> {
        let leaf = self.leaves.peek()?;
        Some(if self.reference > 0.0 { leaf.priority / self.reference } else { 0.0 })
    }

    /// `sum over members of weight(v) ||C||_2`: what bounds any relit picture of the light that [`Weight`] describes (6.7).
    pub fn known(&self) -> f64 {
        self.known
    }

    /// The leaf that earns its children first.
    fn heaviest(&self) -> Option<u32> {
        let leaf = self.leaves.peek()?;
        (leaf.priority >= self.threshold * self.reference).then_some(leaf.first.0)
    }

    /// The leaf over a location.
    fn leaf_above(&self, location: u32) -> Option<u32> {
        let parent = self.tree.parent(location)?;
        let first = self.tree.group(parent).next()?;
        let leaves: HashSet<u32> = self.leaves.iter().map(|leaf| leaf.first.0).collect();
        leaves.contains(&first).then_some(first)
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg32;

    use super::*;
    use crate::wavelet::{Approximation, Edge, Normalisation, Transform, Wavelet};

    /// What a pixel that sees `function` answers to each basis function: `<t, psi_j>`, so S^T t.
    fn answers(function: impl Fn(f32, f32) -> f32, size: (usize, usize), wavelet: Wavelet) -> (Tree, Vec<f32>) {
        let edges = (Edge::Mirrored, Edge::Mirrored);
        let transform = Transform::new(wavelet, size, edges, Normalisation::Energy).unwrap();
        let share = |n: usize, of: usize| (n as f32 + 0.5) / of as f32;
        let at = |n: usize| function(share(n % size.0, size.0), share(n / size.0, size.1));
        let mut data: Vec<f32> = (0..size.0 * size.1).map(at).collect();
        transform.inverse_adjoint(&mut data, 1);
        (transform.tree(), data)
    }

    fn hill(x: f32, y: f32) -> f32 {
        (-40.0 * ((x - 0.31).powi(2) + (y - 0.62).powi(2))).exp() + 0.2 * x
    }

    fn grown(growth: &mut Growth, answers: &[f32], count: usize) -> Vec<u32> {
        for _ in 0..count {
            let Some(location) = growth.next(None) else { break };
            growth.observe(location, &Norm::exact(f64::from(answers[location as usize].abs())));
        }
        growth.members().to_vec()
    }

    /// Greedy trees of single magnitudes come to the same when every member of a place is given the place's sum.
    #[test]
    fn grows_as_a_greedy_tree_of_the_sums_over_places() {
        for (size, wavelet) in
            [((32, 32), Wavelet::Haar), ((32, 16), Wavelet::LeGall53), ((16, 48), Wavelet::Daubechies97)]
        {
            let (tree, answers) = answers(hill, size, wavelet);
            let weight = Weight { range: 3.0, smoothness: 1.5 };
            let sums: Vec<f32> = (0..tree.len() as u32)
                .map(|location| {
                    let weighted = |l: u32| weight.of(tree.level(l)) * f64::from(answers[l as usize].abs());
                    tree.group(location).map(weighted).sum::<f64>() as f32
                })
                .collect();
            let wanted = Approximation::GreedyTree.choose(&tree, &sums, 300);
            let mut growth = Growth::new(tree.clone(), weight, 0.0);
            assert_eq!(grown(&mut growth, &answers, 300), wanted, "{size:?} {wavelet:?}");
        }
    }

    #[test]
    fn places_come_whole_and_after_what_they_hang_from() {
        let (tree, answers) = answers(hill, (32, 8), Wavelet::Haar);
        let mut growth = Growth::new(tree.clone(), Weight::default(), 0.0);
        let order = grown(&mut growth, &answers, usize::MAX);
        assert_eq!(order.len(), tree.len(), "with nothing to stop it, all is shown");
        let at: HashMap<u32, usize> = order.iter().enumerate().map(|(n, location)| (*location, n)).collect();
        for (n, location) in order.iter().enumerate() {
            let group: Vec<usize> = tree.group(*location).map(|l| at[&l]).collect();
            assert!(group.windows(2).all(|pair| pair[1] == pair[0] + 1));
            let above = tree.parent(*location).map(|parent| tree.group(parent).map(|l| at[&l]).max());
            assert!(above.is_none_or(|above| above < Some(n)));
        }
        assert!(growth.next(None).is_none() && growth.largest_leaf().is_none());
    }

    /// (6.6), and that a smooth-light weight keeps to coarser levels.
    #[test]
    fn weights_fall_with_the_level() {
        let weight = Weight { range: 2.0, smoothness: 1.5 };
        assert_eq!([0, 2].map(|v| weight.of(v)), [2.0, 0.25]);
        let (tree, answers) = answers(hill, (64, 64), Wavelet::Haar);
        let mean_level = |smoothness: f64| {
            let mut growth = Growth::new(tree.clone(), Weight { range: 1.0, smoothness }, 0.0);
            let order = grown(&mut growth, &answers, 200);
            order.iter().map(|l| f64::from(tree.level(*l))).sum::<f64>() / 200.0
        };
        assert!(mean_level(4.0) <= mean_level(1.0) && mean_level(1.0) < mean_level(0.0));
    }

    #[test]
    fn growth_ends_at_the_threshold_and_at_noise() {
        let (tree, answers) = answers(hill, (64, 64), Wavelet::Haar);
        let mut last = usize::MAX;
        for threshold in [0.0, 1e-3, 1e-2, 1e-1] {
            let mut growth = Growth::new(tree.clone(), Weight::default(), threshold);
            let count = grown(&mut growth, &answers, usize::MAX).len();
            assert!(count < last, "{threshold}: {count}");
            assert!(growth.largest_leaf().is_none_or(|leaf| leaf < threshold));
            last = count;
        }
        assert!(last > 1);
        // All is noise below level 2.
        let mut growth = Growth::new(tree.clone(), Weight::default(), 0.0);
        while let Some(location) = growth.next(None) {
            let norm = f64::from(answers[location as usize].abs());
            let noise = if tree.level(location) < 2 { 0.0 } else { 2.0 * norm };
            growth.observe(location, &Norm { measured: norm, noise, noise_spread: 0.0 });
        }
        assert_eq!(growth.members().len(), 8 * 8);
    }

    /// A capture that is taken up again shows what it showed, though a norm is another now, and goes on by the new one.
    #[test]
    fn what_was_shown_before_is_followed() {
        let (tree, mut answers) = answers(hill, (32, 32), Wavelet::Haar);
        let mut first = Growth::new(tree.clone(), Weight::default(), 0.0);
        let recorded = grown(&mut first, &answers, 100);
        let mut rng = Pcg32::seed_from_u64(5);
        answers.iter_mut().for_each(|v| *v *= 1.0 + 0.5 * rng.random::<f32>());
        let mut again = Growth::new(tree.clone(), Weight::default(), 0.0);
        for location in &recorded {
            assert_eq!(again.next(Some(*location)), Some(*location));
            again.observe(*location, &Norm::exact(f64::from(answers[*location as usize].abs())));
        }
        assert!(again.next(None).is_some_and(|next| !recorded.contains(&next)));
        // What cannot come next is not followed.
        let mut fresh = Growth::new(tree.clone(), Weight::default(), 0.0);
        assert_eq!(fresh.next(Some(recorded[60])), Some(0));
    }
}
