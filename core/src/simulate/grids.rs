//! Elements of an emitter as grids, and blocks of them: 2 x 2, 4 x 4 and so on, up to one block a grid.
//!
//! What a rough surface answers to a screen is smooth over the screen: it is kept by blocks, and what a mirror or the camera
//! sees by elements. A number a *node*: an element (level 0) or a block (level `l`, `2^l` elements wide, fewer at the right
//! and lower edge).

use crate::error::{Error, Result};

/// Most nodes there may be: ids are 32 bits, and so many emitted colours already take 3 GB.
const MOST: u64 = 1 << 28;

/// `layers` grids of `columns` x `rows` elements: one for a screen, one a position for projectors.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Grids {
    /// Elements across, from the left.
    pub columns: usize,
    /// Elements down, from the top.
    pub rows: usize,
    /// How many grids.
    pub layers: usize,
}

/// A block of elements.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Node {
    pub level: usize,
    pub layer: usize,
    pub column: usize,
    pub row: usize,
}

impl Grids {
    /// Checks the size.
    ///
    /// # Errors
    /// [`Error::Invalid`] at `place` for grids without elements or with more than 2^28 nodes.
    pub fn check(&self, place: &str) -> Result<()> {
        let product = [self.columns, self.rows, self.layers].iter().try_fold(1u64, |n, k| n.checked_mul(*k as u64));
        // Blocks add at most as many again, for grids one element wide; a third of square ones.
        match product {
            Some(count) if count > 0 && count <= MOST / 2 => Ok(()),
            _ => Err(Error::invalid(
                place,
                format!("{} x {} elements, {} times", self.columns, self.rows, self.layers),
                format!("1 to {} elements in all", MOST / 2),
            )),
        }
    }

    /// Number of elements; element `(layer * rows + row) * columns + column`.
    pub fn elements(&self) -> usize {
        self.columns * self.rows * self.layers
    }

    /// The level whose single block holds a whole grid.
    pub(super) fn top(&self) -> usize {
        self.columns.max(self.rows).next_power_of_two().trailing_zeros() as usize
    }

    /// Blocks across and down a grid at a level.
    pub(super) fn size(&self, level: usize) -> (usize, usize) {
        let blocks = |n: usize| n.div_ceil(1 << level);
        (blocks(self.columns), blocks(self.rows))
    }

    /// The finest level with at most `across` blocks across and down.
    pub(super) fn level_of(&self, across: usize) -> usize {
        let largest = |level| self.size(level).0.max(self.size(level).1);
        (0..self.top()).find(|level| largest(*level) <= across).unwrap_or(self.top())
    }

    /// Id of the first node of a level; of the level above the top: the number of nodes.
    pub(super) fn first(&self, level: usize) -> usize {
        (0..level).map(|l| self.size(l).0 * self.size(l).1).sum::<usize>() * self.layers
    }

    /// Number of nodes.
    pub(super) fn nodes(&self) -> usize {
        self.first(self.top() + 1)
    }

    /// Id of a node.
    pub(super) fn id(&self, node: Node) -> u32 {
        let (columns, rows) = self.size(node.level);
        (self.first(node.level) + (node.layer * rows + node.row) * columns + node.column) as u32
    }

    /// Columns and rows that a block covers.
    pub(super) fn covered(&self, node: Node) -> [std::ops::Range<usize>; 2] {
        let range = |at: usize, of: usize| at << node.level..((at + 1) << node.level).min(of);
        [range(node.column, self.columns), range(node.row, self.rows)]
    }

    /// Number of elements of a block.
    pub(super) fn count(&self, node: Node) -> usize {
        let [columns, rows] = self.covered(node);
        columns.len() * rows.len()
    }

    /// Means of what the elements of each node emit, by id; `emitted` has one colour an element.
    pub(super) fn means(&self, emitted: &[[f32; 3]]) -> Vec<[f32; 3]> {
        let mut sums = emitted.to_vec();
        sums.resize(self.nodes(), [0.0; 3]);
        for level in 0..self.top() {
            let (from, to, (columns, rows)) = (self.first(level), self.first(level + 1), self.size(level));
            let (finer, coarser) = sums.split_at_mut(to);
            let (across, down) = self.size(level + 1);
            for (n, value) in finer[from..].iter().enumerate() {
                let (column, row, layer) = (n % columns, n / columns % rows, n / columns / rows);
                let sum = &mut coarser[(layer * down + row / 2) * across + column / 2];
                sum.iter_mut().zip(value).for_each(|(s, v)| *s += v);
            }
        }
        for level in 1..=self.top() {
            let (columns, rows) = self.size(level);
            for (n, sum) in sums[self.first(level)..self.first(level + 1)].iter_mut().enumerate() {
                let node = Node { level, layer: 0, column: n % columns, row: n / columns % rows };
                let share = 1.0 / self.count(node) as f32;
                sum.iter_mut().for_each(|s| *s *= share);
            }
        }
        sums
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ids_are_dense_and_means_are_those_of_the_elements_covered() {
        for grids in [
            Grids { columns: 16, rows: 16, layers: 1 },
            Grids { columns: 13, rows: 6, layers: 3 },
            Grids { columns: 1, rows: 1, layers: 4 },
            Grids { columns: 1, rows: 9, layers: 1 },
        ] {
            let value = |e: usize| [(e as f32 * 0.7).sin(), e as f32, 1.0];
            let emitted: Vec<[f32; 3]> = (0..grids.elements()).map(value).collect();
            let means = grids.means(&emitted);
            let mut next = 0;
            for level in 0..=grids.top() {
                let (columns, rows) = grids.size(level);
                for n in 0..grids.layers * columns * rows {
                    let node = Node { level, layer: n / columns / rows, column: n % columns, row: n / columns % rows };
                    assert_eq!(grids.id(node) as usize, next, "{node:?}");
                    let [across, down] = grids.covered(node);
                    let mut sum = [0.0; 3];
                    for (row, column) in down.flat_map(|r| across.clone().map(move |c| (r, c))) {
                        let element = value((node.layer * grids.rows + row) * grids.columns + column);
                        sum.iter_mut().zip(element).for_each(|(s, v)| *s += v);
                    }
                    let mean = sum.map(|s| s / grids.count(node) as f32);
                    assert!(mean.iter().zip(means[next]).all(|(a, b)| (a - b).abs() < 1e-4 * a.abs().max(1.0)));
                    next += 1;
                }
            }
            assert_eq!((next, grids.size(grids.top())), (grids.nodes(), (1, 1)));
        }
        assert_eq!(Grids { columns: 512, rows: 300, layers: 1 }.level_of(16), 5);
    }

    #[test]
    fn absurd_sizes_are_refused() {
        for (columns, rows, layers) in [(0, 4, 1), (1 << 20, 1 << 20, 1), (usize::MAX, 3, 3)] {
            assert!(Grids { columns, rows, layers }.check("grid").is_err());
        }
        assert!(Grids { columns: 512, rows: 512, layers: 64 }.check("grid").is_ok());
    }
}
