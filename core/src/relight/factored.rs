//! Relighting tiles of low rank: `T w ~ A (B w)`.
//!
//! `u = B w` is made once for each tile that the window touches, channel and light; the blocks of A are then streamed as those
//! of a dense field of as many elements as the tile has ranks, with `u` as their weights.

use std::sync::OnceLock;

use super::Weights;
use super::apply::{Source, stream};
use super::kernels::{self, Isa};
use super::strips::{Target, check};
use crate::error::{Error, Result};
use crate::field::{BLOCK_HEIGHT, BLOCK_WIDTH, Block, BlockBuffer, Factored, Layout};
use crate::image::{Image, Window};

/// [`apply`](super::apply) for a factored field.
///
/// Cost: reads A of the window's blocks and B of its tiles, and multiplies as many numbers a light; on all threads of the pool.
///
/// # Errors
/// As [`apply`](super::apply).
pub(super) fn apply_factored(factored: &Factored, weights: &[&Weights], target: Target<'_>) -> Result<Vec<Image>> {
    check(factored.layout(), weights, target.window)?;
    stream(&Projected::new(factored, weights, target.window), weights.len(), target)
}

/// For each channel and light, `u` of one tile.
type Factors = [Vec<Vec<f32>>; 3];

/// Tiles with what their blocks are multiplied by, made when the first of these is met: the field is read in one pass.
struct Projected<'a> {
    factored: &'a Factored,
    /// Weights of the lamps, the field's scale included.
    weights: Factors,
    /// The tiles of the window, row after row; nothing in one whose bytes cannot be read.
    factors: Vec<OnceLock<Option<Factors>>>,
    /// Column and row of the first of them, and how many are in a row.
    first: (usize, usize),
    across: usize,
    isa: Isa,
}

impl<'a> Projected<'a> {
    fn new(factored: &'a Factored, weights: &[&Weights], window: Window) -> Self {
        let [width, height] = factored.tiles().size;
        let (columns, rows) =
            (window.x0 / width..window.x1.div_ceil(width), window.y0 / height..window.y1.div_ceil(height));
        Self {
            factored,
            weights: std::array::from_fn(|c| weights.iter().map(|w| w.channel(c, factored.scale())).collect()),
            factors: (0..columns.len() * rows.len()).map(|_| OnceLock::new()).collect(),
            first: (columns.start, rows.start),
            across: columns.len(),
            isa: Isa::detect(),
        }
    }

    fn project(&self, tile: usize) -> Result<Factors> {
        project(self.factored, tile, &self.weights, self.isa)
    }
}

/// `B w` of a tile: each row of B is read once for all channels and lights.
fn project(factored: &Factored, tile: usize, weights: &Factors, isa: Isa) -> Result<Factors> {
    let (mut buffer, mut room) = (BlockBuffer::default(), Vec::new());
    let rank = factored.ranks()[tile] as usize;
    let right = factored.right(tile, &mut buffer)?;
    let mut factors: Factors = std::array::from_fn(|c| vec![Vec::with_capacity(rank); weights[c].len()]);
    for halves in right.chunks_exact(factored.layout().elements) {
        for light in 0..weights[0].len() {
            let of_light = weights.each_ref().map(|weights| weights[light].as_slice());
            let dots = kernels::dots(isa, halves, of_light, &mut room);
            factors.iter_mut().zip(dots).for_each(|(factors, dot)| factors[light].push(dot));
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

    fn factors(&self, bx: usize, by: usize, c: usize) -> Result<&[Vec<f32>]> {
        let tiles = self.factored.tiles();
        let [width, height] = tiles.size;
        let (tx, ty) = (bx * BLOCK_WIDTH / width, by * BLOCK_HEIGHT / height);
        let tile = ty * tiles.columns() + tx;
        let of_tile = &self.factors[(ty - self.first.1) * self.across + tx - self.first.0];
        match of_tile.get_or_init(|| self.project(tile).ok()) {
            Some(factors) => Ok(&factors[c]),
            // Once more, for the message.
            None => Err(self.project(tile).err().unwrap_or_else(|| {
                let place = self.path().display().to_string();
                Error::invalid(place, "bytes that could be read only the second time", "a disk that answers")
            })),
        }
    }
}
