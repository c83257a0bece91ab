//! Tiles of low rank.
//!
//! Each tile, a matrix of (pixels x channels) by lamps, is factored with the smallest rank that keeps its squared error within
//! its pixels' share of what the whole field may lose. The share is the same for every pixel, so a tile that is dark beside
//! the rest has rank 0 however much it varies in itself, and noise, which no rank but the full one holds, is left out.
//!
//! **What may be lost.** With `--error` e, a pixel may lose `e^2` times the field's energy per pixel (squares summed over channels
//! and lamps), so that the relative Frobenius error of the field is at most e. One more condition: at most `e^2` times
//! [`GLINTS`] times its *even energy*, that of the mean over the lamps. Under even light, where `C = T 1`, the Cauchy-Schwarz
//! inequality gives `||dC||^2 <= n ||dT||^2` and `||C||^2 = n x even energy`, so that no such picture is off by more than
//! `sqrt(GLINTS) e = 1.4 e`, in practice by a tenth of it. Without the condition a mirror drowns the rest: it answers each lamp
//! in a few pixels, hundreds of times as brightly as paper does, and has nearly all the energy of a field while it is no
//! brighter in a picture. On the demonstration's still life (1280 lamps, e = 4 %), whose energy is 175 times its even energy,
//! pictures under four maps are off by 0.3 % (`cargo bench -p relume-core --bench compact`); with it taken out they were by 6 %. Photographs of a painting (1.9 times) do not
//! notice it.
//!
//! **Tiles** are squares of 64, 32 or 16 pixels, whichever stores a sample of the picture smallest: large ones share B among more
//! pixels, small ones have lower ranks where a mirror or an edge of a shadow gives every pixel a function of its own. On the
//! still life at 256 x 192, in a trial without the condition, squares of 64, 32 and 16 made it 7.6, 19 and 36 times smaller.

use std::path::Path;

use half::f16;
use nalgebra::DMatrix;
use rayon::prelude::*;

use super::errors::{BlockErrors, ErrorMap};
use super::survey::{Survey, survey};
use super::{Finished, Made, Progress, Stage};
use crate::error::{Error, Result};
use crate::field::dense::{BLOCK_PIXELS, CHANNELS};
use crate::field::factored::Tiles;
use crate::field::manifest::{Kind, Precision, Representation};
use crate::field::npy;
use crate::field::spool::Spool;
use crate::field::writer::{Entries, power_of_two_for};
use crate::field::{BlockBuffer, Samples};
use crate::math::low_rank::{LowRank, low_rank};

const RANKS: &str = "transport/factored-ranks.npy";
const LEFT: &str = "transport/factored-left.npy";
const RIGHT: &str = "transport/factored-right.npy";
const ERRORS: &str = "transport/factored-error.npy";

/// The smallest error that can be asked for; see [`ROUNDING`].
const LEAST_ERROR: f64 = 1e-3;
/// Squared relative error of rounding both factors to halves: twice `2^-22 / 3`, the mean square of half a unit in the last
/// place, times 0.54, the mean of 1 / m^2 over mantissas m that are spread evenly in the logarithm.
const ROUNDING: f64 = 2.0 * 0.54 / 3.0 / (1u64 << 22) as f64;
/// How many times its even energy the energy of a field counts at most: what things without glints have, so that their error is
/// the Frobenius error that was asked for.
const GLINTS: f64 = 2.0;
/// Tiles that are tried, from the smallest; the first is a block's width in squares.
const SIZES: [usize; 3] = [16, 32, 64];
/// Where one tile's matrix would be larger, in bytes, tiles are smaller.
const LARGEST_TILE: usize = 256 << 20;
/// Matrices in memory at a time, in bytes, but at least one a thread.
const IN_FLIGHT: usize = 256 << 20;
/// Parts of the picture on which sizes of tiles are tried, in a row and in a column.
const TRIALS: usize = 4;
/// Start of the random numbers of the factorisation.
const SEED: u64 = 1;

/// Factors, rounds and measures; see [`super::compress`].
pub(super) fn compress(samples: Samples<'_>, error: f64, output: &Path, progress: &mut Progress<'_>) -> Result<Made> {
    if !(LEAST_ERROR..1.0).contains(&error) {
        let expected = format!("{LEAST_ERROR} to 1: halves keep no less, and an error of 1 keeps nothing");
        return Err(Error::invalid("factored field", format!("an error of {error}"), expected));
    }
    let layout = samples.layout();
    let survey = survey(samples, progress)?;
    let share = allowed(&survey, error) / (layout.width * layout.height) as f64;
    let tiles = Tiles { layout, size: best_size(samples, share, progress)? };
    let coder = Coder { samples, tiles, share, scale: power_of_two_for(survey.largest_norm as f32) };
    let mut made = Coded {
        tiles,
        scale: coder.scale,
        error,
        ranks: Vec::with_capacity(tiles.count()),
        left: Spool::beside(output)?,
        right: Spool::beside(output)?,
        errors: ErrorMap::new(layout.width, layout.height),
    };
    let all: Vec<usize> = (0..tiles.count()).collect();
    for some in all.chunks(in_flight(&tiles)) {
        let coded: Vec<Tile> = some.par_iter().map(|&tile| coder.tile(tile)).collect::<Result<_>>()?;
        coded.iter().try_for_each(|tile| made.push(tile))?;
        progress(Stage::Compressing, made.ranks.len() as u64, all.len() as u64)?;
    }
    Ok(Box::new(made))
}

/// What truncation may lose of the whole field, squared: what is asked for, less what rounding and its floor
/// ([`Coder::factors`]) lose.
fn allowed(survey: &Survey, error: f64) -> f64 {
    let square = error * error;
    ((square - 1.25 * ROUNDING) * survey.energy).min(square * GLINTS * survey.even_energy)
}

/// The size of tiles that stores a sample of the picture smallest.
fn best_size(samples: Samples<'_>, share: f64, progress: &mut Progress<'_>) -> Result<[usize; 2]> {
    let layout = samples.layout();
    let fits = |size: &usize| size * size * CHANNELS * layout.elements * size_of::<f32>() <= LARGEST_TILE;
    let sizes: Vec<usize> = SIZES.into_iter().filter(fits).collect();
    let mut best: Option<(usize, [usize; 2])> = None;
    for (n, &size) in sizes.iter().enumerate() {
        let tiles = Tiles { layout, size: [size; 2] };
        let coder = Coder { samples, tiles, share, scale: 1.0 };
        let cost = |tile: &usize| {
            Ok(coder.factors(&coder.matrix(*tile)?, *tile)?.rank() * (tiles.matrix_rows(*tile) + layout.elements))
        };
        let tried = trials(&tiles);
        let (mut halves, mut done) = (0, 0);
        for some in tried.chunks(in_flight(&tiles)) {
            halves += some.par_iter().map(cost).sum::<Result<usize>>()?;
            done += some.len() as u64;
            progress(Stage::Choosing, done, tried.len() as u64)?;
        }
        // Larger tiles than ones that are too large already are not tried.
        if best.is_some_and(|(least, _)| least <= halves) && n > 0 {
            break;
        }
        best = Some((halves, [size; 2]));
    }
    // A block is the least there is.
    Ok(best.map_or([16, 8], |best| best.1))
}

/// The tiles in squares of the largest size that stand evenly spread over the picture: the same part of it for every size.
fn trials(tiles: &Tiles) -> Vec<usize> {
    let side = SIZES[SIZES.len() - 1];
    let (across, down) = (tiles.layout.width.div_ceil(side), tiles.layout.height.div_ceil(side));
    // The middles of equal parts.
    let chosen = |all: usize, at: usize| {
        let count = TRIALS.min(all);
        (0..count).any(|k| (2 * k + 1) * all / (2 * count) == at)
    };
    let of_trial = |tile: &usize| {
        let (x, y) = (tile % tiles.columns() * tiles.size[0] / side, tile / tiles.columns() * tiles.size[1] / side);
        chosen(across, x) && chosen(down, y)
    };
    (0..tiles.count()).filter(of_trial).collect()
}

/// Tiles worked on at a time: enough that threads seldom wait for each other.
fn in_flight(tiles: &Tiles) -> usize {
    let threads = rayon::current_num_threads();
    let bytes = tiles.size[0] * tiles.size[1] * CHANNELS * tiles.layout.elements * size_of::<f32>();
    (IN_FLIGHT / bytes).clamp(threads, 16 * threads)
}

/// Tiles to factors.
struct Coder<'a> {
    samples: Samples<'a>,
    tiles: Tiles,
    /// What a pixel may lose, squared, in units of `T`.
    share: f64,
    /// A = half x scale. Rows of B are orthonormal, so no number of A exceeds the norm of its pixel's function.
    scale: f32,
}

/// One tile as it is stored.
struct Tile {
    rank: u32,
    /// Blocks row by row, `[channel][rank][8][16]`.
    left: Vec<f16>,
    /// `[rank][lamp]`.
    right: Vec<f16>,
    errors: Vec<((usize, usize), BlockErrors)>,
}

impl Coder<'_> {
    /// A tile's numbers as the samples store them: rows are (block, channel, pixel), columns lamps.
    fn matrix(&self, tile: usize) -> Result<DMatrix<f32>> {
        let lamps = self.tiles.layout.elements;
        let mut matrix = DMatrix::zeros(self.tiles.matrix_rows(tile), lamps);
        let (mut room, mut numbers) = (BlockBuffer::default(), Vec::new());
        for (n, (bx, by)) in blocks(&self.tiles, tile).enumerate() {
            for c in 0..CHANNELS {
                self.samples.read(bx, by, c, &mut room, &mut numbers)?;
                let row = (n * CHANNELS + c) * BLOCK_PIXELS;
                for (mut column, element) in matrix.column_iter_mut().zip(numbers.chunks_exact(BLOCK_PIXELS)) {
                    column.as_mut_slice()[row..row + BLOCK_PIXELS].copy_from_slice(element);
                }
            }
        }
        Ok(matrix)
    }

    /// The smallest rank that loses no more than the tile's share. Where a tile is so bright that rounding loses more than
    /// that, truncating further than a quarter of what rounding loses would only cost.
    fn factors(&self, matrix: &DMatrix<f32>, tile: usize) -> Result<LowRank> {
        let energy: f64 = matrix.as_slice().iter().map(|t| f64::from(*t) * f64::from(*t)).sum();
        let unit = f64::from(self.samples.scale());
        let share = self.share * self.tiles.pixels(tile) as f64 / (unit * unit);
        low_rank(matrix, share.max(0.25 * ROUNDING * energy), SEED)
    }

    fn tile(&self, tile: usize) -> Result<Tile> {
        let matrix = self.matrix(tile)?;
        let factors = self.factors(&matrix, tile)?;
        // From numbers as the samples store them to those of A; powers of two.
        let to_half = self.samples.scale() / self.scale;
        let left = factors.left.map(|a| f16::from_f32(a * to_half));
        let right = factors.right.map(f16::from_f32);
        let stored_left = left.map(|a| a.to_f32() / to_half);
        let stored_right = right.map(f16::to_f32).transpose();
        let mut coded = Tile {
            rank: factors.rank() as u32,
            left: Vec::with_capacity(left.len()),
            right: right.as_slice().to_vec(),
            errors: Vec::new(),
        };
        for (n, place) in blocks(&self.tiles, tile).enumerate() {
            let mut errors = BlockErrors::default();
            for c in 0..CHANNELS {
                let row = (n * CHANNELS + c) * BLOCK_PIXELS;
                left.column_iter().for_each(|column| coded.left.extend(column.rows(row, BLOCK_PIXELS).iter()));
                let function = matrix.rows(row, BLOCK_PIXELS).into_owned();
                let decoded = stored_left.rows(row, BLOCK_PIXELS) * &stored_right;
                errors.add(c, function.as_slice(), decoded.as_slice(), self.samples.scale());
            }
            coded.errors.push((place, errors));
        }
        Ok(coded)
    }
}

/// The blocks of a tile, row after row.
fn blocks(tiles: &Tiles, tile: usize) -> impl Iterator<Item = (usize, usize)> {
    let (columns, rows) = tiles.blocks_of(tile);
    rows.flat_map(move |by| columns.clone().map(move |bx| (bx, by)))
}

/// Factors, waiting.
struct Coded {
    tiles: Tiles,
    scale: f32,
    error: f64,
    ranks: Vec<u32>,
    left: Spool,
    right: Spool,
    errors: ErrorMap,
}

impl Coded {
    /// The next tile.
    fn push(&mut self, tile: &Tile) -> Result<()> {
        self.ranks.push(tile.rank);
        self.left.halves(&tile.left)?;
        self.right.halves(&tile.right)?;
        tile.errors.iter().for_each(|((bx, by), errors)| self.errors.add(*bx, *by, errors));
        Ok(())
    }
}

impl Finished for Coded {
    fn kind(&self) -> Kind {
        Kind::Factored
    }

    fn write(self: Box<Self>, out: &mut Entries<'_>) -> Result<Representation> {
        let sum = |of_tile: &dyn Fn(usize) -> usize| -> usize {
            self.ranks.iter().enumerate().map(|(tile, &rank)| rank as usize * of_tile(tile)).sum()
        };
        let (left, right) = (sum(&|tile| self.tiles.matrix_rows(tile)), sum(&|_| self.tiles.layout.elements));
        let ranks: Vec<u8> = self.ranks.iter().flat_map(|rank| rank.to_le_bytes()).collect();
        let header = npy::header("<u4", &[self.tiles.rows(), self.tiles.columns()]);
        out.entry(RANKS, &[header, ranks].concat())?;
        self.left.write(out, LEFT, Precision::Half.descr(), &[left])?;
        self.right.write(out, RIGHT, Precision::Half.descr(), &[right])?;
        let loss = self.errors.write(out, ERRORS, Some(self.error))?;
        Ok(Representation::Factored {
            tile: self.tiles.size,
            ranks: RANKS.to_owned(),
            left: LEFT.to_owned(),
            right: RIGHT.to_owned(),
            scale: self.scale,
            loss,
        })
    }
}
