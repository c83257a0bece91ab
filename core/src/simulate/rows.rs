//! `T` of a virtual rig, sparse, row by row: for each pixel the nodes of the emitter it answers to.
//!
//! An entry is a node of [`Grids`] and the pixel's answer to the whole block emitting 1; a photograph is
//! `sum over entries of answer * mean of what the block emits`, so a block's answer is spread evenly over its elements.
//!
//! **Memory and file.** 10 bytes an entry (id, three halves) and 16 (12 in the file) a pixel. Halves are scaled by a power of
//! two for each pixel, its largest entry between 2^14 and 2^15: answers keep 11 bits over nine decades.

use half::f16;
use half::slice::HalfFloatSliceExt;
use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::image::Image;

use super::grids::{Grids, Node};

/// One pixel's answers: ids that rise, and their halves.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Row {
    pub nodes: Vec<u32>,
    pub values: Vec<f16>,
    pub scale: f32,
}

/// Largest half that is used: 2^15.
const TOP: f32 = 32768.0;

impl Row {
    /// Packs entries in any order; those of one node add up, what is black is dropped.
    pub fn new(entries: &mut [(u32, [f32; 3])]) -> Self {
        entries.sort_by_key(|(node, _)| *node);
        let mut sums: Vec<(u32, [f32; 3])> = Vec::with_capacity(entries.len());
        for &(node, rgb) in entries.iter() {
            match sums.last_mut() {
                Some((last, sum)) if *last == node => sum.iter_mut().zip(rgb).for_each(|(s, v)| *s += v),
                _ => sums.push((node, rgb)),
            }
        }
        let largest = sums.iter().flat_map(|(_, rgb)| *rgb).fold(0.0, f32::max);
        if !(largest > 0.0 && largest.is_finite()) {
            return Self::default();
        }
        let scale = 2f32.powi(largest.log2().ceil() as i32) / TOP;
        let halves = |rgb: [f32; 3]| rgb.map(|v| f16::from_f32(v / scale));
        let kept = sums.into_iter().map(|(node, rgb)| (node, halves(rgb)));
        let kept: Vec<(u32, [f16; 3])> = kept.filter(|(_, rgb)| *rgb != [f16::ZERO; 3]).collect();
        Self {
            nodes: kept.iter().map(|(node, _)| *node).collect(),
            values: kept.iter().flat_map(|(_, rgb)| *rgb).collect(),
            scale,
        }
    }
}

/// The sparse `T` of a rig, pixels in rows from the top left.
#[derive(Debug, Clone, PartialEq)]
pub struct Rows {
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) grids: Grids,
    /// Where each pixel's entries start, and at last their number.
    pub(super) starts: Vec<u64>,
    pub(super) nodes: Vec<u32>,
    /// Three an entry.
    pub(super) values: Vec<f16>,
    /// One a pixel.
    pub(super) scales: Vec<f32>,
}

impl Rows {
    /// No pixels yet.
    pub(super) fn new(width: usize, height: usize, grids: Grids) -> Self {
        Self { width, height, grids, starts: vec![0], nodes: Vec::new(), values: Vec::new(), scales: Vec::new() }
    }

    /// Appends the next pixel.
    pub(super) fn push(&mut self, row: &Row) {
        self.nodes.extend_from_slice(&row.nodes);
        self.values.extend_from_slice(&row.values);
        self.scales.push(row.scale);
        self.starts.push(self.nodes.len() as u64);
    }

    /// Width and height of its photographs.
    pub fn size(&self) -> (usize, usize) {
        (self.width, self.height)
    }

    /// What its elements are.
    pub fn grids(&self) -> Grids {
        self.grids
    }

    /// Number of entries of all pixels.
    pub fn entries(&self) -> usize {
        self.nodes.len()
    }

    /// Bytes in memory.
    pub fn bytes(&self) -> usize {
        10 * self.nodes.len() + 12 * self.scales.len()
    }

    fn entries_of(&self, pixel: usize) -> std::ops::Range<usize> {
        self.starts[pixel] as usize..self.starts[pixel + 1] as usize
    }

    /// The photograph's light while the elements emit: one colour an element. Cost: a pass over the entries.
    ///
    /// # Errors
    /// [`Error::Invalid`] when there are more or fewer colours than elements.
    pub fn photograph(&self, emitted: &[[f32; 3]]) -> Result<Image> {
        if emitted.len() != self.grids.elements() {
            let found = format!("{} colours", emitted.len());
            return Err(Error::invalid("emitted light", found, format!("{}, one an element", self.grids.elements())));
        }
        let means = self.grids.means(emitted);
        Ok(self.picture(|pixel, halves: &mut Vec<f32>| {
            let entries = self.entries_of(pixel);
            halves.resize(3 * entries.len(), 0.0);
            self.values[3 * entries.start..3 * entries.end].convert_to_f32_slice(halves);
            let mut sum = [0.0; 3];
            for (node, value) in self.nodes[entries].iter().zip(halves.chunks_exact(3)) {
                let mean = &means[*node as usize];
                (0..3).for_each(|c| sum[c] += value[c] * mean[c]);
            }
            sum.map(|s| s * self.scales[pixel])
        }))
    }

    /// The column of one element: the photograph while it alone emits 1.
    ///
    /// # Errors
    /// [`Error::Invalid`] for an element that there is not.
    pub fn element(&self, element: usize) -> Result<Image> {
        if element >= self.grids.elements() {
            let expected = format!("less than {}", self.grids.elements());
            return Err(Error::invalid("element", element.to_string(), expected));
        }
        let Grids { columns, rows, .. } = self.grids;
        let (column, row, layer) = (element % columns, element / columns % rows, element / columns / rows);
        let above = |level: usize| {
            let node = Node { level, layer, column: column >> level, row: row >> level };
            (self.grids.id(node), 1.0 / self.grids.count(node) as f32)
        };
        let nodes: Vec<(u32, f32)> = (0..=self.grids.top()).map(above).collect();
        Ok(self.picture(|pixel, _| {
            let entries = self.entries_of(pixel);
            let own = &self.nodes[entries.clone()];
            let mut sum = [0.0; 3];
            for (node, share) in &nodes {
                if let Ok(at) = own.binary_search(node) {
                    let value = &self.values[3 * (entries.start + at)..][..3];
                    (0..3).for_each(|c| sum[c] += value[c].to_f32() * share);
                }
            }
            sum.map(|s| s * self.scales[pixel])
        }))
    }

    fn picture(&self, colour: impl Fn(usize, &mut Vec<f32>) -> [f32; 3] + Sync) -> Image {
        let mut picture = Image::new(self.width, self.height, 3);
        let across = 3 * self.width.max(1);
        picture.data_mut().par_chunks_mut(across).enumerate().for_each_init(Vec::new, |scratch, (y, row)| {
            for (x, pixel) in row.chunks_exact_mut(3).enumerate() {
                pixel.copy_from_slice(&colour(y * self.width + x, scratch));
            }
        });
        picture
    }
}

#[cfg(test)]
pub(super) mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg32;

    use super::*;

    /// Random rows beside the same answers spread over single elements: `[pixel][element]`.
    pub(in crate::simulate) fn random(grids: Grids, width: usize, height: usize) -> (Rows, Vec<Vec<[f64; 3]>>) {
        let mut rng = Pcg32::seed_from_u64(4);
        let mut rows = Rows::new(width, height, grids);
        let mut dense = Vec::new();
        for _ in 0..width * height {
            let mut answers = vec![[0f64; 3]; grids.elements()];
            let mut entries = Vec::new();
            for _ in 0..rng.random_range(0..12) {
                let level = rng.random_range(0..=grids.top());
                let (columns, down) = grids.size(level);
                let (column, row) = (rng.random_range(0..columns), rng.random_range(0..down));
                let node = Node { level, layer: rng.random_range(0..grids.layers), column, row };
                let rgb: [f32; 3] = std::array::from_fn(|_| rng.random::<f32>().powi(6));
                entries.push((grids.id(node), rgb));
                let [across, down] = grids.covered(node);
                for (row, column) in down.flat_map(|r| across.clone().map(move |c| (r, c))) {
                    let answer = &mut answers[(node.layer * grids.rows + row) * grids.columns + column];
                    (0..3).for_each(|c| answer[c] += f64::from(rgb[c]) / grids.count(node) as f64);
                }
            }
            rows.push(&Row::new(&mut entries));
            dense.push(answers);
        }
        (rows, dense)
    }

    #[test]
    fn photographs_and_columns_are_those_of_the_dense_matrix() {
        let grids = Grids { columns: 7, rows: 5, layers: 2 };
        let (rows, dense) = random(grids, 9, 4);
        let mut rng = Pcg32::seed_from_u64(5);
        let emitted: Vec<[f32; 3]> = (0..70).map(|_| std::array::from_fn(|_| rng.random())).collect();
        let photograph = rows.photograph(&emitted).unwrap();
        // Halves are right to a share of 2^-11.
        let close = |found: f32, wanted: f64| (f64::from(found) - wanted).abs() < 5e-4 * wanted + 1e-7;
        for (pixel, answers) in dense.iter().enumerate() {
            for c in 0..3 {
                let sum: f64 = answers.iter().zip(&emitted).map(|(a, e)| a[c] * f64::from(e[c])).sum();
                let found = photograph.data()[3 * pixel + c];
                assert!(close(found, sum), "{found} is not {sum}");
            }
        }
        for element in [0, 13, 34, 35, 69] {
            let column = rows.element(element).unwrap();
            for (pixel, answers) in dense.iter().enumerate() {
                (0..3).for_each(|c| assert!(close(column.data()[3 * pixel + c], answers[element][c])));
            }
        }
        assert!(rows.element(70).is_err() && rows.photograph(&emitted[1..]).is_err());
    }

    #[test]
    fn answers_of_very_different_size_share_a_pixel() {
        let mut entries = [(5, [1000.0, 3.0, 0.0]), (2, [1e-5, 0.0, 0.0]), (5, [24.0, 0.0, 0.0]), (1, [0.0; 3])];
        let row = Row::new(&mut entries);
        assert_eq!(row.nodes, [2, 5]);
        let value = |n: usize| row.values[n].to_f32() * row.scale;
        assert!((value(0) / 1e-5 - 1.0).abs() < 1e-3 && value(3) == 1024.0 && (value(4) - 3.0).abs() < 2e-3);
        assert_eq!(Row::new(&mut []), Row::default());
    }
}
