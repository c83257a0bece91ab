//! Relighting by wavelet coefficients: for each pixel a gather from the transformed light.

use super::Weights;
use super::kernels::{self, Isa};
use super::strips::{Target, by_rows, check, rows_of};
use crate::error::Result;
use crate::field::{BLOCK_HEIGHT, BLOCK_WIDTH, Block, Layout, Sparse, TermBuffer};
use crate::image::{Image, Window};

/// The transformed light by location, RGB and a zero: no row crosses a cache line, and 256 x 64 of them stay in the
/// second level of the cache.
type Table = Vec<[f32; 4]>;
/// Terms that are added up apart, so that one need not wait for another.
const APART: usize = 4;

/// `sum_k c_k (S^T w)_k` for several illuminations at once: one picture of the window's size (RGB) each. Terms are read and
/// converted once whatever their number; each picture is the same as if it were made alone.
///
/// Cost: reads the terms of the blocks that the window touches, 8 bytes each with up to 65536 texels. Rows of blocks are
/// spread over the current rayon threads, and the result does not depend on their number.
///
/// # Errors
/// Weights that do not fit the field, a window outside the picture, bytes that cannot be read or are damaged.
pub(super) fn apply_sparse(sparse: &Sparse, weights: &[&Weights], target: Target<'_>) -> Result<Vec<Image>> {
    let layout = Layout { elements: sparse.places(), ..sparse.layout() };
    check(layout, weights, target.window)?;
    let scale = sparse.scale();
    let table = |w: &&Weights| w.factors().iter().map(|&[r, g, b]| [r * scale, g * scale, b * scale, 0.0]).collect();
    let Target { window, channels, .. } = target;
    let tables = weights.iter().map(table).collect();
    let gather = Gather { sparse, tables, window, channels, isa: Isa::detect() };
    by_rows(layout, sparse.path(), weights.len(), target, |by, strips| gather.row(by, strips))
}

/// One pass over a field.
struct Gather<'a> {
    sparse: &'a Sparse,
    tables: Vec<Table>,
    window: Window,
    channels: usize,
    isa: Isa,
}

impl Gather<'_> {
    /// One row of blocks into one strip a picture.
    fn row(&self, by: usize, strips: &mut [&mut [f32]]) -> Result<()> {
        let (columns, _) = self.sparse.layout().blocks(self.window);
        let (mut buffer, mut locations, mut coefficients) = (TermBuffer::default(), Vec::new(), Vec::new());
        let rows = rows_of(by, self.window);
        for bx in columns {
            let terms = self.sparse.block(bx, by, &mut buffer)?;
            if terms.is_empty() {
                continue;
            }
            let columns = (bx * BLOCK_WIDTH).max(self.window.x0)..((bx + 1) * BLOCK_WIDTH).min(self.window.x1);
            for (y, x) in rows.clone().flat_map(|y| columns.clone().map(move |x| (y, x))) {
                let k = y % BLOCK_HEIGHT * BLOCK_WIDTH + x % BLOCK_WIDTH;
                let halves = terms.of_pixel(k, &mut locations);
                if halves.is_empty() {
                    continue;
                }
                kernels::expand(self.isa, Block::Half(halves), &mut coefficients);
                let at = ((y - rows.start) * self.window.width() + x - self.window.x0) * self.channels;
                for (strip, table) in strips.iter_mut().zip(&self.tables) {
                    strip[at..at + 3].copy_from_slice(&sum(&locations, &coefficients, table));
                }
            }
        }
        Ok(())
    }
}

/// `sum of coefficient x table[location]`, channel by channel; three coefficients a location.
fn sum(locations: &[u32], coefficients: &[f32], table: &[[f32; 4]]) -> [f32; 3] {
    let mut sums = [[0.0f32; 3]; APART];
    let (parts, rest) = locations.as_chunks::<APART>();
    let (of_parts, of_rest) = coefficients.split_at(3 * APART * parts.len());
    for (locations, rgb) in parts.iter().zip(of_parts.as_chunks::<{ 3 * APART }>().0) {
        for (k, sums) in sums.iter_mut().enumerate() {
            add(sums, &rgb[3 * k..3 * k + 3], &table[locations[k] as usize]);
        }
    }
    for (location, rgb) in rest.iter().zip(of_rest.chunks_exact(3)) {
        add(&mut sums[0], rgb, &table[*location as usize]);
    }
    std::array::from_fn(|c| (sums[0][c] + sums[1][c]) + (sums[2][c] + sums[3][c]))
}

fn add(sums: &mut [f32; 3], rgb: &[f32], light: &[f32; 4]) {
    sums.iter_mut().zip(rgb).zip(light).for_each(|((sum, c), light)| *sum += c * light);
}
