//! Coefficient pictures: for each element, dot products of its blocks with what is lit.

use std::ops::Range;

use rayon::prelude::*;

use super::super::kernels::{self, Isa};
use super::{Progress, Sum, Sums, row_done};
use crate::error::Result;
use crate::field::{BLOCK_HEIGHT, BLOCK_PIXELS, BLOCK_WIDTH, Block, BlockBuffer, Dense, Layout};
use crate::image::Image;

/// Blocks are met in runs of about so many bytes, between which threads wait for each other: long against that, and short enough
/// that a file is read from its beginning to its end.
const RUN_BYTES: usize = 8 << 20;
/// Elements that a thread takes at once: expanded, they stay in the second level of the cache; the fewest still stream.
const AT_ONCE: (usize, usize) = (8, 128);
/// Shares a thread, so that none waits long for the last.
const SHARES: usize = 4;

/// What pixels are lit with, in one row of blocks: `[block x][channel][picture][8][16]`, zero beyond the edges.
pub(super) struct LitRow {
    numbers: Vec<f32>,
    pictures: usize,
}

impl LitRow {
    pub fn new(layout: Layout, lit: &[&Image], by: usize) -> Self {
        let (pictures, width) = (lit.len(), layout.width);
        let mut numbers = vec![0.0; layout.columns() * 3 * pictures * BLOCK_PIXELS];
        for (n, block) in numbers.chunks_exact_mut(BLOCK_PIXELS).enumerate() {
            let (picture, c, bx) = (n % pictures, n / pictures % 3, n / pictures / 3);
            for (y, line) in (by * BLOCK_HEIGHT..layout.height).zip(block.chunks_exact_mut(BLOCK_WIDTH)) {
                let row = &lit[picture].row(y)[3 * bx * BLOCK_WIDTH..];
                let columns = (width - bx * BLOCK_WIDTH).min(BLOCK_WIDTH);
                line[..columns].iter_mut().zip(row.iter().skip(c).step_by(3)).for_each(|(out, v)| *out = *v);
            }
        }
        Self { numbers, pictures }
    }

    /// The pictures at one block of one channel, one after another; `None` where all are black.
    pub fn block(&self, bx: usize, c: usize) -> Option<&[f32]> {
        let length = self.pictures * BLOCK_PIXELS;
        let block = &self.numbers[(bx * 3 + c) * length..][..length];
        // Without an early end the loop vectorises.
        block.iter().fold(false, |lit, v| lit | (*v != 0.0)).then_some(block)
    }
}

/// Adds to channel `c` of each element's sums, `[element][picture]`, the dot products of its 128 numbers with each picture's.
pub(super) fn add_dots(isa: Isa, block: Block<'_>, lit: &[f32], c: usize, sums: &mut [Sum], floats: &mut Vec<f32>) {
    kernels::expand(isa, block, floats);
    let pictures = lit.len() / BLOCK_PIXELS;
    for (numbers, sums) in floats.chunks_exact(BLOCK_PIXELS).zip(sums.chunks_exact_mut(pictures)) {
        for (lit, sum) in lit.chunks_exact(BLOCK_PIXELS).zip(sums) {
            sum[c] += f64::from(kernels::dot(isa, numbers, lit));
        }
    }
}

/// `T^T c` of some elements, `[picture][element]`.
///
/// # Errors
/// Bytes that cannot be read; what `progress` returns.
pub(super) fn adjoint(
    dense: &Dense,
    lit: &[&Image],
    elements: Range<usize>,
    progress: &mut Progress<'_>,
) -> Result<Vec<Vec<Sum>>> {
    let (layout, isa) = (dense.layout(), Isa::detect());
    let mut sums = Sums::new(elements.len(), lit.len());
    if elements.is_empty() || lit.is_empty() {
        return Ok(sums.by_picture());
    }
    let share = elements.len() / (SHARES * rayon::current_num_threads());
    let share = share.clamp(AT_ONCE.0, AT_ONCE.1);
    let run = RUN_BYTES / (elements.len() * BLOCK_PIXELS * dense.precision().bytes());
    for by in 0..layout.rows() {
        let row = LitRow::new(layout, lit, by);
        let blocks: Vec<(usize, usize)> = (0..layout.columns()).flat_map(|bx| (0..3).map(move |c| (bx, c))).collect();
        for run in blocks.chunks(run.max(1)) {
            let shares = sums.sums.par_chunks_mut(share * lit.len()).enumerate();
            shares.try_for_each_init(
                Default::default,
                |(buffer, floats): &mut (BlockBuffer, Vec<f32>), (n, sums)| {
                    let first = elements.start + n * share;
                    let own = first..first + sums.len() / lit.len();
                    for &(bx, c) in run {
                        let Some(lit) = row.block(bx, c) else { continue };
                        let block = dense.part((bx, by, c), own.clone(), buffer)?;
                        add_dots(isa, block, lit, c, sums, floats);
                    }
                    Ok::<(), crate::error::Error>(())
                },
            )?;
        }
        row_done(progress, by, layout)?;
    }
    // A power of two.
    let scale = f64::from(dense.scale());
    sums.sums.iter_mut().for_each(|sum| *sum = sum.map(|v| v * scale));
    Ok(sums.by_picture())
}
