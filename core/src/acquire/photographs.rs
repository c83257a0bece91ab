//! Pictures of `T`, one a lamp, turned into the container's blocks in bounded memory.
//!
//! Pictures arrive one after another, blocks want all pictures at once. Up to a budget pictures stay in memory; beyond it
//! they are spilled, a batch at a time and already in block order, to an unnamed file beside the output, so that both
//! writing and reading back are long runs (an external merge).

use std::fs::File;
use std::io::{BufWriter, Read, Seek, SeekFrom, Write};
use std::ops::Range;
use std::path::{Path, PathBuf};

use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::field::{BLOCK_HEIGHT, BLOCK_PIXELS, BLOCK_WIDTH, Bands, Layout};
use crate::image::Image;

/// Pictures kept in memory before they are spilled.
const BUDGET_BYTES: usize = 2 << 30;

/// Pictures of `T` in the order of the lamps; a source of [`Bands`].
#[derive(Debug)]
pub struct Photographs {
    width: usize,
    height: usize,
    folder: PathBuf,
    budget: usize,
    spill: Option<File>,
    /// Pictures in each spilled batch.
    batches: Vec<usize>,
    pending: Vec<Image>,
    largest: f32,
}

impl Photographs {
    /// For pictures of `width` x `height`; `folder` is where a spill file may lie (the output's own folder has the room).
    pub fn new(width: usize, height: usize, folder: &Path) -> Self {
        Self::with_budget(width, height, folder, BUDGET_BYTES)
    }

    /// [`Photographs::new`] with a budget in bytes.
    pub fn with_budget(width: usize, height: usize, folder: &Path, budget: usize) -> Self {
        let folder = folder.to_owned();
        Self { width, height, folder, budget, spill: None, batches: Vec::new(), pending: Vec::new(), largest: 0.0 }
    }

    /// How many pictures.
    pub fn len(&self) -> usize {
        self.batches.iter().sum::<usize>() + self.pending.len()
    }

    /// None yet?
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The largest |T| so far.
    pub fn largest(&self) -> f32 {
        self.largest
    }

    /// Takes the next lamp's picture of `T`, RGB.
    ///
    /// # Errors
    /// Another size than announced; no room for the spill file.
    pub fn push(&mut self, picture: Image) -> Result<()> {
        if picture.size() != (self.width, self.height) || picture.channels() != 3 {
            let found = format!("{} x {} x {}", picture.width(), picture.height(), picture.channels());
            return Err(Error::invalid("photograph", found, format!("{} x {} x 3", self.width, self.height)));
        }
        self.largest = picture.data().par_iter().map(|v| v.abs()).reduce(|| self.largest, f32::max);
        self.pending.push(picture);
        let held = self.pending.len() * self.width * self.height * 3 * size_of::<f32>();
        if held >= self.budget { self.spill() } else { Ok(()) }
    }

    fn layout(&self, elements: usize) -> Layout {
        Layout { width: self.width, height: self.height, elements }
    }

    /// Writes the pending pictures out in block order.
    fn spill(&mut self) -> Result<()> {
        let layout = self.layout(self.pending.len());
        let fail = |source| Error::io("write a temporary file in", &self.folder, source);
        let file = match &mut self.spill {
            Some(file) => file,
            none => none.insert(tempfile::tempfile_in(&self.folder).map_err(fail)?),
        };
        let mut out = BufWriter::with_capacity(1 << 20, file);
        let mut row = vec![0.0f32; layout.columns() * 3 * layout.block_len()];
        for by in 0..layout.rows() {
            row.fill(0.0);
            gather(&self.pending, by, 0, &mut row, 0..layout.elements, layout.elements);
            out.write_all(bytemuck::cast_slice(&row)).map_err(fail)?;
        }
        out.flush().map_err(fail)?;
        drop(out);
        self.batches.push(self.pending.len());
        self.pending.clear();
        Ok(())
    }

    /// Reads one spilled batch's blocks for `columns` of row `by`.
    fn read_batch(&mut self, batch: usize, by: usize, columns: &Range<usize>) -> Result<Vec<f32>> {
        let layouts: Vec<Layout> = self.batches.iter().map(|&n| self.layout(n)).collect();
        let size = |l: &Layout| l.rows() * l.columns() * 3 * l.block_len();
        let before: usize = layouts[..batch].iter().map(size).sum();
        let layout = layouts[batch];
        let first = before + (by * layout.columns() + columns.start) * 3 * layout.block_len();
        let mut numbers = vec![0.0f32; columns.len() * 3 * layout.block_len()];
        let fail = |source| Error::io("read a temporary file in", &self.folder, source);
        let Some(file) = &mut self.spill else { return Ok(numbers) };
        file.seek(SeekFrom::Start((first * size_of::<f32>()) as u64)).map_err(fail)?;
        file.read_exact(bytemuck::cast_slice_mut(&mut numbers)).map_err(fail)?;
        Ok(numbers)
    }
}

impl Bands for Photographs {
    fn fill(&mut self, by: usize, columns: Range<usize>, blocks: &mut [f32]) -> Result<()> {
        let elements = self.len();
        let block = elements * BLOCK_PIXELS;
        let mut first = 0;
        for batch in 0..self.batches.len() {
            let count = self.batches[batch];
            let numbers = self.read_batch(batch, by, &columns)?;
            let sources = numbers.par_chunks(count * BLOCK_PIXELS);
            blocks.par_chunks_mut(block).zip(sources).for_each(|(block, source)| {
                block[first * BLOCK_PIXELS..(first + count) * BLOCK_PIXELS].copy_from_slice(source);
            });
            first += count;
        }
        gather(&self.pending, by, columns.start, blocks, first..elements, elements);
        Ok(())
    }
}

/// Photographs that tell how far writing has come.
pub struct Reporting<'a> {
    /// All of them.
    pub photographs: &'a mut Photographs,
    /// Told the steps done and all steps; an error of it ends the writing.
    pub progress: &'a mut dyn FnMut(u64, u64) -> Result<()>,
    /// Steps in all: photographs and rows of blocks.
    pub total: u64,
}

impl Bands for Reporting<'_> {
    fn fill(&mut self, by: usize, columns: Range<usize>, blocks: &mut [f32]) -> Result<()> {
        (self.progress)((self.photographs.len() + by) as u64, self.total)?;
        self.photographs.fill(by, columns, blocks)
    }
}

/// Copies pictures into blocks `[block x][channel][element][8][16]` of row `by` from column `first_column` on, as elements
/// `places` of `elements`.
fn gather(
    pictures: &[Image],
    by: usize,
    first_column: usize,
    blocks: &mut [f32],
    places: Range<usize>,
    elements: usize,
) {
    blocks.par_chunks_mut(elements * BLOCK_PIXELS).enumerate().for_each(|(n, block)| {
        let (bx, c) = (first_column + n / 3, n % 3);
        let places = block[places.start * BLOCK_PIXELS..places.end * BLOCK_PIXELS].chunks_exact_mut(BLOCK_PIXELS);
        for (place, picture) in places.zip(pictures) {
            let (w, h) = picture.size();
            let columns = bx * BLOCK_WIDTH..((bx + 1) * BLOCK_WIDTH).min(w);
            for y in by * BLOCK_HEIGHT..((by + 1) * BLOCK_HEIGHT).min(h) {
                let source = picture.row(y)[columns.start * 3..columns.end * 3].chunks_exact(3);
                let line = &mut place[(y % BLOCK_HEIGHT) * BLOCK_WIDTH..];
                line.iter_mut().zip(source).for_each(|(out, rgb)| *out = rgb[c]);
            }
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spilling_changes_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let (w, h, n) = (37, 19, 11);
        let picture = |k: usize| Image::from_fn(w, h, |x, y| [k as f32, (x + 100 * y) as f32, -((x * y) as f32)]);
        let filled = |budget: usize, run: usize| {
            let mut photographs = Photographs::with_budget(w, h, folder.path(), budget);
            (0..n).for_each(|k| photographs.push(picture(k)).unwrap());
            assert_eq!((photographs.len(), photographs.largest()), (n, 1836.0));
            let layout = photographs.layout(n);
            let mut all = Vec::new();
            for by in 0..layout.rows() {
                for first in (0..layout.columns()).step_by(run) {
                    let columns = first..(first + run).min(layout.columns());
                    let mut blocks = vec![0.0; columns.len() * 3 * layout.block_len()];
                    photographs.fill(by, columns, &mut blocks).unwrap();
                    all.extend(blocks);
                }
            }
            all
        };
        let whole = filled(usize::MAX, 99);
        let layout = Layout { width: w, height: h, elements: n };
        let index = |x: usize, y: usize, c: usize, k: usize| {
            let block = ((y / 8) * layout.columns() + x / 16) * 3 + c;
            (block * n + k) * BLOCK_PIXELS + (y % 8) * 16 + x % 16
        };
        assert_eq!(whole[index(36, 18, 1, 5)], 1836.0);
        assert_eq!(whole[index(20, 3, 2, 10)], -60.0);
        assert_eq!(whole[index(0, 9, 0, 7)], 7.0);
        let one_picture = w * h * 12;
        for (budget, run) in [(1, 1), (2 * one_picture, 2), (4 * one_picture, 1), (11 * one_picture, 3)] {
            assert_eq!(filled(budget, run), whole, "budget {budget}");
        }
    }
}
