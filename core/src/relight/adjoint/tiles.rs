//! Tiles of low rank: `T^T c = sum over tiles of B^T (A^T c)`.

use std::ops::Range;

use half::slice::HalfFloatSliceExt;
use rayon::prelude::*;

use super::super::kernels::Isa;
use super::pictures::{LitRow, add_dots};
use super::{Progress, Sum, Sums, row_done};
use crate::error::Result;
use crate::field::{BlockBuffer, Factored};
use crate::image::Image;

/// Elements that a thread takes at once: their sums stay in the first level of the cache while the rows of B go by.
const AT_ONCE: usize = 512;

/// `T^T c` of some elements, `[picture][element]`.
///
/// # Errors
/// Bytes that cannot be read; what `progress` returns.
pub(super) fn adjoint(
    factored: &Factored,
    lit: &[&Image],
    elements: Range<usize>,
    progress: &mut Progress<'_>,
) -> Result<Vec<Vec<Sum>>> {
    let mut sums = Sums::new(elements.len(), lit.len());
    if elements.is_empty() || lit.is_empty() {
        return Ok(sums.by_picture());
    }
    let (layout, tiles) = (factored.layout(), factored.tiles());
    let mut buffer = BlockBuffer::default();
    for row in 0..tiles.rows() {
        let of_row = row * tiles.columns()..(row + 1) * tiles.columns();
        let blocks = tiles.blocks_of(of_row.start).1;
        let rows: Vec<LitRow> = blocks.clone().map(|by| LitRow::new(layout, lit, by)).collect();
        let projected: Result<Vec<Vec<Sum>>> =
            of_row.clone().into_par_iter().map(|tile| left(factored, tile, &rows, lit.len())).collect();
        for (tile, projected) in of_row.zip(projected?) {
            if projected.iter().flatten().any(|v| *v != 0.0) {
                right(factored, tile, &projected, &elements, &mut sums, &mut buffer)?;
            }
        }
        for by in blocks {
            row_done(progress, by, layout)?;
        }
    }
    Ok(sums.by_picture())
}

/// `A^T c` of a tile, the scale included: `[rank][picture]`.
fn left(factored: &Factored, tile: usize, rows: &[LitRow], pictures: usize) -> Result<Vec<Sum>> {
    let (mut buffer, mut floats) = (BlockBuffer::default(), Vec::new());
    let mut sums = vec![[0.0; 3]; factored.ranks()[tile] as usize * pictures];
    let (columns, blocks) = factored.tiles().blocks_of(tile);
    for (by, row) in blocks.zip(rows) {
        for (bx, c) in columns.clone().flat_map(|bx| (0..3).map(move |c| (bx, c))) {
            let Some(lit) = row.block(bx, c) else { continue };
            add_dots(Isa::detect(), factored.block(bx, by, c, &mut buffer)?, lit, c, &mut sums, &mut floats);
        }
    }
    let scale = f64::from(factored.scale());
    sums.iter_mut().for_each(|sum| *sum = sum.map(|v| v * scale));
    Ok(sums)
}

/// Adds `B^T` of what a tile was projected to.
fn right(
    factored: &Factored,
    tile: usize,
    projected: &[Sum],
    elements: &Range<usize>,
    sums: &mut Sums,
    buffer: &mut BlockBuffer,
) -> Result<()> {
    let (pictures, all) = (sums.pictures, factored.layout().elements);
    let halves = factored.right(tile, buffer)?;
    let shares = sums.sums.par_chunks_mut(AT_ONCE * pictures).enumerate();
    shares.for_each_init(
        || [0.0f32; AT_ONCE],
        |room, (n, sums)| {
            let (first, count) = (elements.start + n * AT_ONCE, sums.len() / pictures);
            for (row, projected) in halves.chunks_exact(all).zip(projected.chunks_exact(pictures)) {
                let numbers = &mut room[..count];
                row[first..first + count].convert_to_f32_slice(numbers);
                for (number, sums) in numbers.iter().zip(sums.chunks_exact_mut(pictures)) {
                    for (sum, by) in sums.iter_mut().zip(projected) {
                        (0..3).for_each(|c| sum[c] += f64::from(*number) * by[c]);
                    }
                }
            }
        },
    );
    Ok(())
}
