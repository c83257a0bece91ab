//! `Factored`: tiles of the picture as products of two thin matrices.
//!
//! In a tile, rows are its pixels and channels, columns the lamps: `T_tile ~ A B`, B with orthonormal rows shared by the three
//! channels, both in halves.
//!
//! ```text
//! transport/factored-ranks.npy   rank of each tile, [tile row, tile column], `<u4`
//! transport/factored-left.npy    A, tile after tile, row after row; in a tile its blocks likewise, each [channel][rank][8][16]
//! transport/factored-right.npy   B, tile after tile, each [rank][lamp]
//! ```
//!
//! A block of A is laid out as a block of a dense field of as many elements as the tile has ranks, and is relit as one: the
//! weights of these elements are `B w`. A tile of rank 0 is black, and has no bytes.

use std::sync::Arc;

use half::f16;
use half::slice::HalfFloatSliceExt;
use nalgebra::{DMatrix, DMatrixView};

use super::asset::Opening;
use super::dense::{BLOCK_HEIGHT, BLOCK_PIXELS, BLOCK_WIDTH, Block, BlockBuffer, CHANNELS, Layout};
use super::manifest::Precision;
use super::store::{Scratch, Store};
use crate::error::{Error, Result};

/// The tiles of a picture, from its top left; those at the right and the bottom hold what is left.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Tiles {
    /// The picture.
    pub layout: Layout,
    /// Columns and rows of a tile, in pixels; whole blocks.
    pub size: [usize; 2],
}

impl Tiles {
    /// Blocks in a row and in a column of a whole tile.
    fn blocks(&self) -> (usize, usize) {
        (self.size[0] / BLOCK_WIDTH, self.size[1] / BLOCK_HEIGHT)
    }

    /// Tiles in a row.
    pub fn columns(&self) -> usize {
        self.layout.columns().div_ceil(self.blocks().0)
    }

    /// Rows of tiles.
    pub fn rows(&self) -> usize {
        self.layout.rows().div_ceil(self.blocks().1)
    }

    /// All of them, row after row.
    pub fn count(&self) -> usize {
        self.columns() * self.rows()
    }

    /// The blocks of a tile: columns and rows.
    pub fn blocks_of(&self, tile: usize) -> (std::ops::Range<usize>, std::ops::Range<usize>) {
        let ((across, down), (tx, ty)) = (self.blocks(), (tile % self.columns(), tile / self.columns()));
        let columns = tx * across..((tx + 1) * across).min(self.layout.columns());
        (columns, ty * down..((ty + 1) * down).min(self.layout.rows()))
    }

    /// The tile of a block, and the block's number in it.
    pub fn place(&self, bx: usize, by: usize) -> (usize, usize) {
        let (across, down) = self.blocks();
        let tile = by / down * self.columns() + bx / across;
        (tile, by % down * self.blocks_of(tile).0.len() + bx % across)
    }

    /// Rows of a tile's matrix: its pixels, those beyond the edges of the picture among them, times channels.
    pub fn matrix_rows(&self, tile: usize) -> usize {
        let (columns, rows) = self.blocks_of(tile);
        columns.len() * rows.len() * BLOCK_PIXELS * CHANNELS
    }

    /// Pixels of a tile that the picture has.
    pub fn pixels(&self, tile: usize) -> usize {
        let (columns, rows) = self.blocks_of(tile);
        let width = (columns.end * BLOCK_WIDTH).min(self.layout.width) - columns.start * BLOCK_WIDTH;
        let height = (rows.end * BLOCK_HEIGHT).min(self.layout.height) - rows.start * BLOCK_HEIGHT;
        width * height
    }
}

/// What the manifest says of a factored field.
pub(super) struct Described<'a> {
    pub layout: Layout,
    pub tile: [usize; 2],
    pub ranks: &'a str,
    pub left: &'a str,
    pub right: &'a str,
    pub scale: f32,
}

/// A factored field in an open container.
#[derive(Debug)]
pub struct Factored {
    store: Arc<Store>,
    tiles: Tiles,
    ranks: Vec<u32>,
    /// Byte of the file where A and B of each tile start.
    starts: Vec<(u64, u64)>,
    scale: f32,
}

impl Factored {
    /// Checks sizes, ranks and lengths. Whatever a file says, no more is allocated than some times what it holds.
    pub(super) fn open(opening: &Opening<'_>, store: &Arc<Store>, described: &Described<'_>) -> Result<Self> {
        let [width, height] = described.tile;
        let whole = |side: usize, block: usize| side > 0 && side.is_multiple_of(block);
        if !whole(width, BLOCK_WIDTH) || !whole(height, BLOCK_HEIGHT) {
            let (found, expected) = (format!("tiles of {width} x {height}"), "whole blocks of 16 x 8");
            return Err(Error::invalid(opening.at("manifest.json"), found, expected));
        }
        let tiles = Tiles { layout: described.layout, size: described.tile };
        let range = opening.array(described.ranks, "<u4", &[tiles.rows(), tiles.columns()], size_of::<u32>())?;
        let mut scratch = Scratch::default();
        let bytes = store.get(range.start, (range.end - range.start) as usize, &mut scratch)?;
        let ranks: Vec<u32> = bytes.chunks_exact(4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect();
        let (left, right) = lengths(&tiles, &ranks, &opening.at(described.ranks))?;
        let halves = |entry: &str, numbers: u64| {
            let shape = usize::try_from(numbers).map_err(|_| {
                Error::invalid(opening.at(entry), format!("{numbers} numbers"), "what memory can address")
            })?;
            Ok::<u64, Error>(opening.array(entry, Precision::Half.descr(), &[shape], Precision::Half.bytes())?.start)
        };
        let mut at = (halves(described.left, left)?, halves(described.right, right)?);
        let mut starts = Vec::with_capacity(ranks.len());
        for (tile, &rank) in ranks.iter().enumerate() {
            starts.push(at);
            at.0 += u64::from(rank) * (tiles.matrix_rows(tile) * Precision::Half.bytes()) as u64;
            at.1 += u64::from(rank) * (tiles.layout.elements * Precision::Half.bytes()) as u64;
        }
        Ok(Self { store: Arc::clone(store), tiles, ranks, starts, scale: described.scale })
    }

    /// Sizes of the field that it stands for.
    pub fn layout(&self) -> Layout {
        self.tiles.layout
    }

    /// Its tiles.
    pub fn tiles(&self) -> Tiles {
        self.tiles
    }

    /// The rank of each tile, row after row.
    pub fn ranks(&self) -> &[u32] {
        &self.ranks
    }

    /// The file it lies in.
    pub fn path(&self) -> &std::path::Path {
        self.store.path()
    }

    /// A power of two: A = stored x scale.
    pub fn scale(&self) -> f32 {
        self.scale
    }

    /// A of the block in column `bx`, row `by`, of channel `c`: `[rank][8][16]`.
    ///
    /// # Errors
    /// Bytes that cannot be read.
    pub fn block<'a>(&'a self, bx: usize, by: usize, c: usize, buffer: &'a mut BlockBuffer) -> Result<Block<'a>> {
        let (tile, number) = self.tiles.place(bx, by);
        let length = self.ranks[tile] as usize * BLOCK_PIXELS * Precision::Half.bytes();
        let start = self.starts[tile].0 + (number * CHANNELS + c) as u64 * length as u64;
        Ok(Block::Half(bytemuck::cast_slice(self.store.get(start, length, &mut buffer.0)?)))
    }

    /// B of a tile: `[rank][lamp]`.
    ///
    /// # Errors
    /// Bytes that cannot be read.
    pub fn right<'a>(&'a self, tile: usize, buffer: &'a mut BlockBuffer) -> Result<&'a [f16]> {
        let length = self.ranks[tile] as usize * self.tiles.layout.elements * Precision::Half.bytes();
        Ok(bytemuck::cast_slice(self.store.get(self.starts[tile].1, length, &mut buffer.0)?))
    }

    /// The samples of a block of channel `c`, `[lamp][8][16]`: A B, less the scale.
    ///
    /// # Errors
    /// Bytes that cannot be read.
    pub(super) fn decode(
        &self,
        (bx, by, c): (usize, usize, usize),
        buffer: &mut BlockBuffer,
        out: &mut Vec<f32>,
    ) -> Result<()> {
        let (rank, lamps) = (self.ranks[self.tiles.place(bx, by).0] as usize, self.tiles.layout.elements);
        let right = self.right(self.tiles.place(bx, by).0, buffer)?.to_f32_vec();
        self.block(bx, by, c, buffer)?.expand(out);
        let left = DMatrixView::from_slice(out, BLOCK_PIXELS, rank);
        let decoded = left * DMatrix::from_row_slice(rank, lamps, &right);
        out.clear();
        out.extend_from_slice(decoded.as_slice());
        Ok(())
    }
}

/// Numbers in A and in B; refuses ranks that no matrix has and sums beyond 64 bits.
fn lengths(tiles: &Tiles, ranks: &[u32], place: &str) -> Result<(u64, u64)> {
    let (mut left, mut right) = (0u64, 0u64);
    for (tile, &rank) in ranks.iter().enumerate() {
        let (rows, columns) = (tiles.matrix_rows(tile), tiles.layout.elements);
        if rank as usize > rows.min(columns) {
            let expected = format!("at most {}: a matrix of {rows} x {columns}", rows.min(columns));
            return Err(Error::invalid(format!("{place}, tile {tile}"), format!("rank {rank}"), expected));
        }
        let add = |sum: u64, side: usize| {
            let bytes = u64::from(rank).checked_mul(side as u64).and_then(|numbers| sum.checked_add(numbers));
            bytes.ok_or_else(|| Error::invalid(place, "more numbers than 64 bits count", "ranks of a picture"))
        };
        (left, right) = (add(left, rows)?, add(right, columns)?);
    }
    Ok((left, right))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_block_lies_in_one_tile_at_one_place() {
        let layout = Layout { width: 150, height: 77, elements: 5 };
        for size in [[64, 64], [32, 32], [16, 8], [48, 16], [512, 512]] {
            let tiles = Tiles { layout, size };
            let mut seen = std::collections::BTreeSet::new();
            for (bx, by) in (0..layout.rows()).flat_map(|by| (0..layout.columns()).map(move |bx| (bx, by))) {
                let (tile, number) = tiles.place(bx, by);
                let (columns, rows) = tiles.blocks_of(tile);
                assert!(columns.contains(&bx) && rows.contains(&by));
                assert_eq!(number, (by - rows.start) * columns.len() + bx - columns.start);
                assert!(seen.insert((tile, number)));
            }
            let numbers: usize = (0..tiles.count()).map(|tile| tiles.matrix_rows(tile)).sum();
            assert_eq!(numbers, seen.len() * BLOCK_PIXELS * CHANNELS, "{size:?}");
            assert_eq!((0..tiles.count()).map(|tile| tiles.pixels(tile)).sum::<usize>(), 150 * 77);
        }
    }

    #[test]
    fn ranks_that_no_matrix_has_are_refused() {
        let tiles = Tiles { layout: Layout { width: 64, height: 16, elements: 5 }, size: [32, 32] };
        assert_eq!(lengths(&tiles, &[5, 0], "x").unwrap(), (5 * 1536, 25));
        let message = lengths(&tiles, &[0, 6], "x").unwrap_err().to_string();
        assert!(message.contains("tile 1") && message.contains("rank 6") && message.contains("at most 5"), "{message}");
    }
}
