//! Wavelet coefficients of each pixel: `T^T c = S (sum over pixels of c_p x coefficients)`.
//!
//! Any pixel may have any location, so each of a fixed number of jobs has a table of its own, and takes every so many-th row of
//! blocks; tables are added up in their order.

use rayon::prelude::*;

use super::super::kernels::{self, Isa};
use super::{Progress, Sum};
use crate::error::Result;
use crate::field::{BLOCK_HEIGHT, BLOCK_WIDTH, Block, Sparse, TermBuffer};
use crate::image::Image;

/// Tables take so many bytes together, within the bounds of their number.
const TABLES_BYTES: usize = 64 << 20;
/// The fewest and the most tables, whatever the number of threads: sums must not depend on it.
const TABLES: (usize, usize) = (4, 32);
/// Rows of blocks of each job between two reports of progress.
const ROWS_AT_ONCE: usize = 4;

/// `sum over pixels of c_p x coefficients`, `[picture][location]`.
///
/// # Errors
/// Bytes that cannot be read or are damaged; what `progress` returns.
pub(super) fn adjoint(sparse: &Sparse, lit: &[&Image], progress: &mut Progress<'_>) -> Result<Vec<Vec<Sum>>> {
    let layout = sparse.layout();
    let length = layout.elements * lit.len();
    let jobs = (TABLES_BYTES / (length * size_of::<Sum>()).max(1)).clamp(TABLES.0, TABLES.1);
    let mut tables: Vec<Vec<Sum>> = vec![vec![[0.0; 3]; length]; jobs.min(layout.rows())];
    let (jobs, isa) = (tables.len(), Isa::detect());
    for first in (0..layout.rows()).step_by(jobs * ROWS_AT_ONCE) {
        let end = (first + jobs * ROWS_AT_ONCE).min(layout.rows());
        tables.par_iter_mut().enumerate().try_for_each(|(job, table)| {
            let mut scatter = Scatter { sparse, lit, isa, table };
            (first + job..end).step_by(jobs).try_for_each(|by| scatter.row(by))
        })?;
        progress(end as u64, layout.rows() as u64)?;
    }
    let scale = f64::from(sparse.scale());
    let sum =
        |at: usize| -> Sum { std::array::from_fn(|c| tables.iter().map(|table| table[at][c]).sum::<f64>() * scale) };
    let of = |picture: usize| (0..layout.elements).map(|n| sum(picture * layout.elements + n)).collect();
    Ok((0..lit.len()).map(of).collect())
}

/// One job.
struct Scatter<'a> {
    sparse: &'a Sparse,
    lit: &'a [&'a Image],
    isa: Isa,
    /// `[picture][location]`.
    table: &'a mut [Sum],
}

impl Scatter<'_> {
    /// One row of blocks.
    fn row(&mut self, by: usize) -> Result<()> {
        let layout = self.sparse.layout();
        let (mut buffer, mut locations, mut coefficients) = (TermBuffer::default(), Vec::new(), Vec::new());
        for bx in 0..layout.columns() {
            let terms = self.sparse.block(bx, by, &mut buffer)?;
            if terms.is_empty() {
                continue;
            }
            let columns = bx * BLOCK_WIDTH..((bx + 1) * BLOCK_WIDTH).min(layout.width);
            let rows = by * BLOCK_HEIGHT..((by + 1) * BLOCK_HEIGHT).min(layout.height);
            for (y, x) in rows.flat_map(|y| columns.clone().map(move |x| (y, x))) {
                if self.lit.iter().all(|picture| *picture.pixel(x, y) == [0.0; 3]) {
                    continue;
                }
                let halves = terms.of_pixel(y % BLOCK_HEIGHT * BLOCK_WIDTH + x % BLOCK_WIDTH, &mut locations);
                kernels::expand(self.isa, Block::Half(halves), &mut coefficients);
                self.add((x, y), &locations, &coefficients);
            }
        }
        Ok(())
    }

    /// One pixel's terms.
    fn add(&mut self, (x, y): (usize, usize), locations: &[u32], coefficients: &[f32]) {
        let tables = self.table.chunks_exact_mut(self.sparse.layout().elements);
        for (picture, table) in self.lit.iter().zip(tables) {
            let lit: Sum = std::array::from_fn(|c| f64::from(picture.pixel(x, y)[c]));
            for (location, rgb) in locations.iter().zip(coefficients.as_chunks::<3>().0) {
                let sum = &mut table[*location as usize];
                (0..3).for_each(|c| sum[c] += lit[c] * f64::from(rgb[c]));
            }
        }
    }
}
