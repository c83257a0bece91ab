//! All pixels of a picture, a row of blocks at a time.

use std::ops::Range;

use rayon::prelude::*;

use super::{Edges, Scratch, Solver, Terms};
use crate::acquire::Photographs;
use crate::error::{Error, Result};
use crate::field::{BLOCK_HEIGHT, BLOCK_PIXELS, BLOCK_WIDTH, Bands, BlockTerms, TermBands};

/// A tile, a row of blocks, is what is solved together, on all threads; nothing depends on their number.
pub const TILE_ROWS: usize = BLOCK_HEIGHT;

/// Photographs under the patterns, in their order, turned into terms as they are wanted.
pub struct Solving<'a> {
    solver: &'a Solver,
    photographs: &'a mut Photographs,
    size: (usize, usize),
    /// Is a pixel solved at all?
    wanted: &'a (dyn Fn(usize, usize) -> bool + Sync),
    edges: &'a Edges,
    tiles: Range<usize>,
    /// Called with the tiles done and all of them.
    progress: &'a mut dyn FnMut(u64, u64) -> Result<()>,
    /// The blocks of the last row.
    row: Vec<BlockTerms>,
}

impl<'a> Solving<'a> {
    /// The `tiles` of a picture of a size, width and height; pixels that are not `wanted` (x, y), and those of other tiles, get no
    /// terms. What `edges` see of the screen is taken out. `progress(tiles done, tiles)` may stop it.
    ///
    /// # Errors
    /// As many photographs as patterns; tiles that there are not.
    pub fn new(
        solver: &'a Solver,
        photographs: &'a mut Photographs,
        (size, tiles): ((usize, usize), Range<usize>),
        (wanted, edges): (&'a (dyn Fn(usize, usize) -> bool + Sync), &'a Edges),
        progress: &'a mut dyn FnMut(u64, u64) -> Result<()>,
    ) -> Result<Self> {
        let (patterns, all) = (solver.dictionary().patterns(), size.1.div_ceil(TILE_ROWS));
        if photographs.len() != patterns {
            let found = format!("{} photographs", photographs.len());
            return Err(Error::invalid("implicit sampling", found, format!("{patterns}, one a pattern")));
        }
        if tiles.is_empty() || tiles.end > all {
            let found = format!("tiles {} to {}", tiles.start + 1, tiles.end);
            return Err(Error::invalid("implicit sampling", found, format!("some of 1 to {all}")));
        }
        Ok(Self { solver, photographs, size, wanted, edges, tiles, progress, row: Vec::new() })
    }

    /// Solves a row of blocks.
    fn solve(&mut self, by: usize) -> Result<Vec<BlockTerms>> {
        let patterns = self.photographs.len();
        let columns = self.size.0.div_ceil(BLOCK_WIDTH);
        let of_block = 3 * patterns * BLOCK_PIXELS;
        let mut responses = vec![0.0f32; columns * of_block];
        self.photographs.fill(by, 0..columns, &mut responses)?;
        let (solver, wanted, edges, (width, height)) = (self.solver, self.wanted, self.edges, self.size);
        let pixel = |(scratch, response): &mut (Scratch, Vec<f32>), at: usize| {
            let (bx, k) = (at / BLOCK_PIXELS, at % BLOCK_PIXELS);
            let (x, y) = (bx * BLOCK_WIDTH + k % BLOCK_WIDTH, by * BLOCK_HEIGHT + k / BLOCK_WIDTH);
            let mut terms = Terms::default();
            if x < width && y < height && wanted(x, y) {
                response.clear();
                response.extend(responses[bx * of_block + k..][..of_block - k].iter().step_by(BLOCK_PIXELS));
                edges.take_out(y * width + x, response);
                solver.solve(scratch, response, None, &mut terms);
            }
            terms
        };
        let room = || (solver.scratch(), Vec::with_capacity(3 * patterns));
        let solved: Vec<Terms> = (0..columns * BLOCK_PIXELS).into_par_iter().map_init(room, pixel).collect();
        let block = |pixels: &[Terms]| {
            let mut block = BlockTerms::default();
            for (count, terms) in block.counts.iter_mut().zip(pixels) {
                *count = terms.locations.len() as u32;
                block.locations.extend_from_slice(&terms.locations);
                block.coefficients.extend_from_slice(&terms.coefficients);
            }
            block
        };
        Ok(solved.chunks_exact(BLOCK_PIXELS).map(block).collect())
    }
}

impl TermBands for Solving<'_> {
    fn fill(&mut self, bx: usize, by: usize, block: &mut BlockTerms) -> Result<()> {
        if !self.tiles.contains(&by) {
            return Ok(());
        }
        if bx == 0 {
            (self.progress)((by - self.tiles.start) as u64, self.tiles.len() as u64)?;
            self.row = self.solve(by)?;
        }
        *block = std::mem::take(&mut self.row[bx]);
        Ok(())
    }
}
