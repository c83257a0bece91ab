//! Relighting tiles of low rank: `T w ~ A (B w)`.
//!
//! `u = B w` is made once for each tile that the window touches, channel and light; the blocks of A are then streamed as those
//! of a dense field of as many elements as the tile has ranks, with `u` as their weights.

use rayon::prelude::*;

use super::Weights;
use super::apply::{Source, stream};
use super::kernels::{self, Isa};
use super::strips::check;
use crate::error::Result;
use crate::field::{BLOCK_HEIGHT, BLOCK_WIDTH, Block, BlockBuffer, Factored, Layout};
use crate::image::{Image, Window};

/// [`apply`](super::apply) for a factored field.
///
/// Cost: reads A of the window's blocks and B of its tiles, and multiplies as many numbers a light; on all threads of the pool.
///
/// # Errors
/// As [`apply`](super::apply).
pub(super) fn apply_factored(factored: &Factored, weights: &[&Weights], window: Window) -> Result<Vec<Image>> {
    check(factored.layout(), weights, window)?;
    stream(&Projected::new(factored, weights, window)?, weights.len(), window)
}

/// For each channel and light, `u` of one tile.
type Factors = [Vec<Vec<f32>>; 3];

/// Tiles with what their blocks are multiplied by.
struct Projected<'a> {
    factored: &'a Factored,
    /// The tiles of the window, row after row.
    factors: Vec<Factors>,
    /// Column and row of the first of them, and how many are in a row.
    first: (usize, usize),
    across: usize,
}

impl<'a> Projected<'a> {
    fn new(factored: &'a Factored, weights: &[&Weights], window: Window) -> Result<Self> {
        let tiles = factored.tiles();
        let [width, height] = tiles.size;
        let (columns, rows) =
            (window.x0 / width..window.x1.div_ceil(width), window.y0 / height..window.y1.div_ceil(height));
        let (first, across) = ((columns.start, rows.start), columns.len());
        let scaled: Factors = std::array::from_fn(|c| weights.iter().map(|w| w.channel(c, factored.scale())).collect());
        let touched: Vec<usize> =
            rows.flat_map(|ty| columns.clone().map(move |tx| ty * tiles.columns() + tx)).collect();
        let isa = Isa::detect();
        let factors = touched
            .into_par_iter()
            .map_init(Default::default, |room, tile| project(factored, tile, &scaled, isa, room))
            .collect::<Result<_>>()?;
        Ok(Self { factored, factors, first, across })
    }
}

/// `B w` of a tile: each row of B is read and converted once for all channels and lights.
fn project(
    factored: &Factored,
    tile: usize,
    weights: &Factors,
    isa: Isa,
    (buffer, row): &mut (BlockBuffer, Vec<f32>),
) -> Result<Factors> {
    let rank = factored.ranks()[tile] as usize;
    let right = factored.right(tile, buffer)?;
    let mut factors: Factors = std::array::from_fn(|c| vec![Vec::with_capacity(rank); weights[c].len()]);
    for halves in right.chunks_exact(factored.layout().elements) {
        kernels::expand(isa, Block::Half(halves), row);
        for (factors, weights) in factors.iter_mut().flatten().zip(weights.iter().flatten()) {
            factors.push(kernels::dot(isa, row, weights));
        }
    }
    Ok(factors)
}

impl Source for Projected<'_> {
    fn layout(&self) -> Layout {
        self.factored.layout()
    }

    fn path(&self) -> &std::path::Path {
        self.factored.path()
    }

    fn block<'a>(&'a self, bx: usize, by: usize, c: usize, buffer: &'a mut BlockBuffer) -> Result<Block<'a>> {
        self.factored.block(bx, by, c, buffer)
    }

    fn factors(&self, bx: usize, by: usize, c: usize) -> &[Vec<f32>] {
        let [width, height] = self.factored.tiles().size;
        let (tx, ty) = (bx * BLOCK_WIDTH / width - self.first.0, by * BLOCK_HEIGHT / height - self.first.1);
        &self.factors[ty * self.across + tx][c]
    }
}
