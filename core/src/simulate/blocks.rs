//! A pixel's answers while they are collected: elements that it shows sharply, and blocks.

use super::grids::{Grids, Node};
use super::material::Rgb;
use super::rows::Row;
use super::tracer::peak;

/// Blocks of one parent become the parent when they stray from an even spread by at most this share of it...
const EVEN: f32 = 0.03;
/// ... or of all that the pixel answers by blocks: together at most a few percent of it move, to a neighbouring block.
const LITTLE: f32 = 2e-4;

/// Sums of one pixel. Blocks are held for all levels from `finest` on.
#[derive(Debug)]
pub(super) struct Blocks {
    grids: Grids,
    finest: usize,
    /// `[level - finest]`, three planes of `layer`, row, column.
    sums: Vec<[Vec<f32>; 3]>,
    sharp: Vec<(u32, Rgb)>,
}

impl Blocks {
    pub fn new(grids: Grids, finest: usize) -> Self {
        let level = |level: usize| {
            let (columns, rows) = grids.size(level);
            std::array::from_fn(|_| vec![0.0; columns * rows * grids.layers])
        };
        Self { grids, finest, sums: (finest..=grids.top()).map(level).collect(), sharp: Vec::new() }
    }

    pub fn clear(&mut self) {
        self.sums.iter_mut().flatten().for_each(|plane| plane.fill(0.0));
        self.sharp.clear();
    }

    /// Adds to one element.
    pub fn add_sharp(&mut self, element: u32, rgb: Rgb) {
        self.sharp.push((element, rgb));
    }

    /// Adds to the block of a level that holds an element.
    pub fn add(&mut self, level: usize, [column, row, layer]: [usize; 3], rgb: &Rgb) {
        let (columns, rows) = self.grids.size(level);
        let at = (layer * rows + (row >> level)) * columns + (column >> level);
        self.sums[level - self.finest].iter_mut().zip(rgb).for_each(|(plane, v)| plane[at] += v);
    }

    /// The three planes of a level.
    pub fn planes(&mut self, level: usize) -> [&mut [f32]; 3] {
        let [r, g, b] = &mut self.sums[level - self.finest];
        [r, g, b]
    }

    /// The pixel's row, every sum times `scale`.
    pub fn row(&mut self, scale: f32) -> Row {
        let total: f32 =
            self.sums.iter().map(|planes| planes.iter().map(|p| p.iter().sum::<f32>()).fold(0.0, f32::max)).sum();
        let mut entries = std::mem::take(&mut self.sharp);
        if total > 0.0 {
            for level in self.finest..self.grids.top() {
                self.merge(level, LITTLE * total);
            }
            for level in self.finest..=self.grids.top() {
                let (first, [r, g, b]) = (self.grids.first(level) as u32, &self.sums[level - self.finest]);
                let colours = r.iter().zip(g).zip(b).map(|((r, g), b)| [*r, *g, *b]);
                entries.extend((first..).zip(colours).filter(|(_, rgb)| *rgb != [0.0; 3]));
            }
        }
        entries.iter_mut().for_each(|(_, rgb)| rgb.iter_mut().for_each(|v| *v *= scale));
        let row = Row::new(&mut entries);
        self.sharp = entries;
        row
    }

    /// Moves the children of a level to their parents where these say as much.
    fn merge(&mut self, level: usize, little: f32) {
        let (across, down) = self.grids.size(level + 1);
        for n in 0..across * down * self.grids.layers {
            let (column, row, layer) = (n % across, n / across % down, n / across / down);
            self.merge_children(Node { level: level + 1, layer, column, row }, n, little);
        }
    }

    fn merge_children(&mut self, parent: Node, at: usize, little: f32) {
        let level = parent.level - 1;
        let (columns, rows) = self.grids.size(level);
        let (column, row) = (2 * parent.column, 2 * parent.row);
        let inside = |k: usize| (column + k % 2 < columns && row + k / 2 < rows).then_some(k);
        let (fine, coarse) = self.sums.split_at_mut(parent.level - self.finest);
        let (fine, coarse) = (&mut fine[level - self.finest], &mut coarse[0]);
        let index = |k: usize| (parent.layer * rows + row + k / 2) * columns + column + k % 2;
        let child = |k: usize| Node { level, layer: parent.layer, column: column + k % 2, row: row + k / 2 };
        let colour = |k: usize| -> Rgb { std::array::from_fn(|c| fine[c][index(k)]) };
        let mut sum = [0.0; 3];
        for k in (0..4).filter_map(inside) {
            sum.iter_mut().zip(colour(k)).for_each(|(s, v)| *s += v);
        }
        let all = self.grids.count(parent) as f32;
        let strays = |k: usize| {
            let (even, found) = (self.grids.count(child(k)) as f32 / all, colour(k));
            peak(&std::array::from_fn(|c| (found[c] - even * sum[c]).abs()))
        };
        let stray: f32 = (0..4).filter_map(inside).map(strays).sum();
        if stray <= (EVEN * peak(&sum)).max(little) {
            for k in (0..4).filter_map(inside) {
                (0..3).for_each(|c| fine[c][index(k)] = 0.0);
            }
            (0..3).for_each(|c| coarse[c][at] += sum[c]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulate::rows::Rows;

    const GRIDS: Grids = Grids { columns: 13, rows: 8, layers: 2 };

    fn photograph(row: &Row, emitted: &[Rgb]) -> Rgb {
        let mut rows = Rows::new(1, 1, GRIDS);
        rows.push(row);
        let picture = rows.photograph(emitted).unwrap();
        std::array::from_fn(|c| picture.data()[c])
    }

    #[test]
    fn even_answers_become_one_block_and_edges_stay() {
        let mut blocks = Blocks::new(GRIDS, 1);
        let even = |blocks: &mut Blocks, layer: usize, edge: usize| {
            for row in (0..8).step_by(2) {
                for column in (0..13).step_by(2) {
                    let elements = if column == 12 { 2.0 } else { 4.0 };
                    let value = if column < edge { 0.5 * elements } else { 0.0 };
                    blocks.add(1, [column, row, layer], &[value, 2.0 * value, 0.0]);
                }
            }
        };
        even(&mut blocks, 1, 13);
        let row = blocks.row(0.25);
        assert_eq!(row.nodes, [GRIDS.nodes() as u32 - 1], "one block for all of layer 1");
        let white = vec![[1.0; 3]; 208];
        assert!((photograph(&row, &white)[1] - 0.25 * 104.0).abs() < 0.02);
        blocks.clear();
        // An edge inside of blocks of level 2 and 3: light from either side of it stays where it was.
        even(&mut blocks, 0, 6);
        blocks.add_sharp(200, [3.0, 0.0, 0.0]);
        let row = blocks.row(1.0);
        let lit = |inside: &dyn Fn(usize) -> bool| -> Vec<Rgb> {
            (0..208).map(|e| if inside(e) { [1.0; 3] } else { [0.0; 3] }).collect()
        };
        let left = photograph(&row, &lit(&|e| e < 104 && e % 13 < 6));
        let right = photograph(&row, &lit(&|e| e < 104 && e % 13 >= 6));
        assert!((left[0] - 24.0).abs() < 0.02 && right[0] == 0.0, "{left:?}, {right:?}");
        assert_eq!(photograph(&row, &lit(&|e| e == 200)), [3.0, 0.0, 0.0]);
        assert!(row.nodes.len() < 15, "{} entries", row.nodes.len());
    }
}
