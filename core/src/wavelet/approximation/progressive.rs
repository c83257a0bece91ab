//! Trees grown from the scaling coefficients on (6.5).
//!
//! Both are iterators over locations, in the order in which they join. They ask for a magnitude only when the choice of
//! the next one needs it, and once, so that a query may be a photograph.

use std::cmp::{Ordering, Reverse};
use std::collections::{BinaryHeap, HashSet, VecDeque};

use super::Tree;

/// A coefficient that was asked for. The largest is the greatest; among equals, that of the lowest location.
#[derive(Debug, Clone, Copy)]
struct Known {
    magnitude: f32,
    location: Reverse<u32>,
}

impl Ord for Known {
    fn cmp(&self, other: &Self) -> Ordering {
        self.magnitude.total_cmp(&other.magnitude).then(self.location.cmp(&other.location))
    }
}

impl PartialOrd for Known {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Known {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Known {}

/// Groups whose descendants were taken up, by their first members.
#[derive(Debug, Default)]
struct Opened(HashSet<u32>);

impl Opened {
    /// Everything below a location, the first time that one of its group asks.
    fn below(&mut self, tree: &Tree, location: u32) -> impl Iterator<Item = u32> {
        let new = tree.group(location).next().is_some_and(|first| self.0.insert(first));
        new.then(|| tree.below(location)).into_iter().flatten()
    }
}

/// Greedy progressive tree (eq. 6.2): all scaling coefficients, then again and again everything below the largest member
/// with nothing below it yet. All that was asked for becomes a member: queries cost more than storage.
#[derive(Debug)]
pub struct Greedy<'a, Q> {
    tree: &'a Tree,
    query: Q,
    /// Members that may have nothing below them.
    leaves: BinaryHeap<Known>,
    opened: Opened,
    /// To become members next.
    next: VecDeque<u32>,
    /// A member that was not asked for yet.
    unknown: Option<u32>,
}

impl<'a, Q: FnMut(u32) -> f32> Greedy<'a, Q> {
    /// Starts from the scaling coefficients of a tree; `query` gives magnitudes.
    pub fn new(tree: &'a Tree, query: Q) -> Self {
        let next = tree.roots().collect();
        Self { tree, query, leaves: BinaryHeap::new(), opened: Opened::default(), next, unknown: None }
    }
}

impl<Q: FnMut(u32) -> f32> Iterator for Greedy<'_, Q> {
    type Item = u32;

    fn next(&mut self) -> Option<u32> {
        if let Some(location) = self.unknown.take() {
            self.leaves.push(Known { magnitude: (self.query)(location), location: Reverse(location) });
        }
        while self.next.is_empty() {
            let leaf = self.leaves.pop()?.location.0;
            self.next.extend(self.opened.below(self.tree, leaf));
        }
        self.unknown = self.next.pop_front();
        self.unknown
    }
}

/// Optimal progressive tree (eq. 6.3, by the priority queue of eq. 6.4): again and again the largest of the scaling
/// coefficients and of everything below members. What lies below is asked for when a first member of the group above was
/// taken and another one is wanted.
#[derive(Debug)]
pub struct Optimal<'a, Q> {
    tree: &'a Tree,
    query: Q,
    candidates: BinaryHeap<Known>,
    opened: Opened,
    /// To become candidates when the next member is wanted.
    unknown: Vec<u32>,
}

impl<'a, Q: FnMut(u32) -> f32> Optimal<'a, Q> {
    /// Starts from the scaling coefficients of a tree; `query` gives magnitudes.
    pub fn new(tree: &'a Tree, query: Q) -> Self {
        let unknown = tree.roots().collect();
        Self { tree, query, candidates: BinaryHeap::new(), opened: Opened::default(), unknown }
    }
}

impl<Q: FnMut(u32) -> f32> Iterator for Optimal<'_, Q> {
    type Item = u32;

    fn next(&mut self) -> Option<u32> {
        for location in self.unknown.drain(..) {
            self.candidates.push(Known { magnitude: (self.query)(location), location: Reverse(location) });
        }
        let location = self.candidates.pop()?.location.0;
        self.unknown.extend(self.opened.below(self.tree, location));
        Some(location)
    }
}
