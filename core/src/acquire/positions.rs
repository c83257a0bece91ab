//! Squares of a projector to terms, one position after another, in bounded memory.
//!
//! A pixel sees one square of a position brightly, where the projector lights what it shows, and a little of many, by way of other surfaces
//! (7.2, figure 7.4). The one is a spike, the other smooth. So its function over the squares is kept as a few spikes, and Haar
//! coefficients of what is left: spikes are what stands out from the median of its neighbourhood. Either alone takes several
//! times the terms: a spike is thirteen Haar coefficients of 16 x 16 squares, and smooth light a number a square.
//!
//! At each position a pixel may lose `error^2` times the mean energy of a lit pixel there, glints counted as no more than some
//! lit pixels; and what noise there is, told from the finest coefficients, which nearly all are nothing else (Donoho and Johnstone 1994).
//! Terms wait in a temporary file, position after position, until [`TermBands`] asks for them block by block.

use std::fs::File;
use std::io::{BufWriter, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use rayon::prelude::*;

use crate::domain::Plane;
use crate::error::{Error, Result};
use crate::field::{BLOCK_HEIGHT, BLOCK_PIXELS, BLOCK_WIDTH, Bands, BlockTerms, Layout, TermBands, TermBasis};
use crate::files::folder_of;
use crate::wavelet::{Transform, Wavelet};

/// Energies of pixels beyond so many times the median of lit ones count as that: glints would drown the rest.
const GLINTS: f64 = 16.0;
/// Below this share of the brightest pixel's energy a pixel is not lit, for the median.
const LIT: f64 = 1e-6;
/// Coefficients whose three channels have no more energy than so many variances are noise: 0.3 % of pure noise has (chi-squared of
/// three degrees).
const NOISE: f32 = 14.0;
/// Median of the absolute value of a normal number, in deviations.
const MEDIAN: f32 = 0.674_49;
/// Squares along each side of a neighbourhood.
const NEAR: usize = 4;
/// Spikes are worth a term of their own where they are this share of what a pixel may lose, squared.
const SPIKE: f32 = 1.0 / 16.0;
/// Every so many pixels the noise is looked at.
const NOISE_STEP: usize = 7;

/// Terms of all pixels, position after position.
#[derive(Debug)]
pub struct PositionTerms {
    layout: Layout,
    squares: Plane,
    transform: Transform,
    positions: usize,
    error: f64,
    output: PathBuf,
    file: File,
    length: u64,
    /// Of each position the first byte of every block.
    starts: Vec<Vec<u64>>,
    largest: f32,
    energy: f64,
    lost: f64,
    terms: u64,
    /// A row of blocks of all positions, while it is read.
    row: Option<(usize, Vec<Vec<u8>>)>,
}

impl PositionTerms {
    /// For pictures of `width` x `height` under `positions` pictures of squares; the temporary file lies beside `output`.
    /// `error` is the relative error that light may have.
    ///
    /// # Errors
    /// An error outside 0.0001 to 0.5; a folder that cannot be written to.
    pub fn new(
        (width, height): (usize, usize),
        (positions, squares): (usize, Plane),
        error: f64,
        output: &Path,
    ) -> Result<Self> {
        if !(1e-4..=0.5).contains(&error) {
            return Err(Error::invalid("terms of a projector", format!("an error of {error}"), "0.0001 to 0.5"));
        }
        let file = tempfile::tempfile_in(folder_of(output)).map_err(|source| Error::io("write", output, source))?;
        Ok(Self {
            layout: Layout { width, height, elements: squares.len() },
            squares,
            transform: squares.transform(Wavelet::Haar)?,
            positions,
            error,
            output: output.to_owned(),
            file,
            length: 0,
            starts: Vec::new(),
            largest: 0.0,
            energy: 0.0,
            lost: 0.0,
            terms: 0,
            row: None,
        })
    }

    /// What the terms are of.
    pub fn basis(&self) -> TermBasis {
        TermBasis::Both(Wavelet::Haar)
    }

    /// The largest coefficient so far.
    pub fn largest(&self) -> f32 {
        self.largest
    }

    /// Terms so far.
    pub fn terms(&self) -> u64 {
        self.terms
    }

    /// The relative error so far, noise that was taken off included: `||T - T'|| / ||T||`.
    pub fn lost(&self) -> f64 {
        if self.energy > 0.0 { (self.lost / self.energy).sqrt() } else { 0.0 }
    }

    /// Takes the next position: `T` under each of its squares, row by row.
    ///
    /// # Errors
    /// More positions than announced; what the source returns; no room for the temporary file.
    pub fn push(&mut self, position: &mut dyn Bands) -> Result<()> {
        if self.starts.len() == self.positions {
            return Err(Error::invalid("terms of a projector", "one position more", self.positions.to_string()));
        }
        let limits = self.limits(position)?;
        let (columns, rows) = (self.layout.columns(), self.layout.rows());
        let mut starts = Vec::with_capacity(columns * rows + 1);
        let mut out = BufWriter::with_capacity(1 << 20, &self.file);
        let fail = |source| Error::io("write", &self.output, source);
        let mut row = vec![0.0f32; columns * 3 * self.layout.block_len()];
        for by in 0..rows {
            row.fill(0.0);
            position.fill(by, 0..columns, &mut row)?;
            let code = |block: &[f32]| Coder { squares: self.squares, transform: &self.transform, limits }.block(block);
            let blocks: Vec<Coded> = row.par_chunks(3 * self.layout.block_len()).map(code).collect();
            for block in blocks {
                starts.push(self.length);
                out.write_all(&block.bytes).map_err(fail)?;
                self.length += block.bytes.len() as u64;
                self.largest = self.largest.max(block.largest);
                self.energy += block.energy;
                self.lost += block.lost;
                self.terms += block.terms;
            }
        }
        out.flush().map_err(fail)?;
        drop(out);
        starts.push(self.length);
        self.starts.push(starts);
        Ok(())
    }

    /// What pixels may lose at a position, and its noise.
    fn limits(&self, position: &mut dyn Bands) -> Result<Limits> {
        let columns = self.layout.columns();
        let mut row = vec![0.0f32; columns * 3 * self.layout.block_len()];
        let (mut energies, mut finest) = (Vec::new(), Vec::new());
        for by in 0..self.layout.rows() {
            row.fill(0.0);
            position.fill(by, 0..columns, &mut row)?;
            let measured: Vec<([f64; BLOCK_PIXELS], Vec<f32>)> = row
                .par_chunks(3 * self.layout.block_len())
                .enumerate()
                .map(|(bx, block)| (energies_of(block), finest_of(block, self.squares, &self.inside(bx, by))))
                .collect();
            for (of_block, noise) in measured {
                energies.extend(of_block);
                finest.extend(noise);
            }
        }
        let brightest = energies.iter().copied().fold(0.0, f64::max);
        let mut lit: Vec<f64> = energies.into_iter().filter(|energy| *energy > LIT * brightest).collect();
        if lit.is_empty() {
            return Ok(Limits { share: 0.0, noise: 0.0 });
        }
        let middle = lit.len() / 2;
        let most = GLINTS * *lit.select_nth_unstable_by(middle, f64::total_cmp).1;
        let mean = lit.iter().map(|energy| energy.min(most)).sum::<f64>() / lit.len() as f64;
        let noise = if finest.is_empty() {
            0.0
        } else {
            let middle = finest.len() / 2;
            *finest.select_nth_unstable_by(middle, f32::total_cmp).1 / MEDIAN
        };
        Ok(Limits { share: (self.error * self.error * mean) as f32, noise: NOISE * noise * noise })
    }

    /// Those pixels of a block that lie within the picture.
    fn inside(&self, bx: usize, by: usize) -> Vec<usize> {
        let within = |k: &usize| {
            let (x, y) = (bx * BLOCK_WIDTH + k % BLOCK_WIDTH, by * BLOCK_HEIGHT + k / BLOCK_WIDTH);
            x < self.layout.width && y < self.layout.height
        };
        (0..BLOCK_PIXELS).filter(within).collect()
    }

    /// The bytes of a row of blocks, position after position.
    fn read_row(&mut self, by: usize) -> Result<()> {
        if self.row.as_ref().is_some_and(|row| row.0 == by) {
            return Ok(());
        }
        let fail = |source| Error::io("read a temporary file beside", &self.output, source);
        let columns = self.layout.columns();
        let mut all = self.row.take().map(|row| row.1).unwrap_or_default();
        all.resize_with(self.starts.len(), Vec::new);
        for (bytes, starts) in all.iter_mut().zip(&self.starts) {
            let (first, last) = (starts[by * columns], starts[(by + 1) * columns]);
            bytes.resize((last - first) as usize, 0);
            self.file.seek(SeekFrom::Start(first)).map_err(fail)?;
            self.file.read_exact(bytes).map_err(fail)?;
        }
        self.row = Some((by, all));
        Ok(())
    }
}

impl TermBands for PositionTerms {
    fn fill(&mut self, bx: usize, by: usize, block: &mut BlockTerms) -> Result<()> {
        if self.starts.len() != self.positions {
            let found = format!("{} of {} positions", self.starts.len(), self.positions);
            return Err(Error::invalid("terms of a projector", found, "all of them"));
        }
        self.read_row(by)?;
        let Some((_, row)) = &self.row else { return Ok(()) };
        let (columns, squares) = (self.layout.columns(), self.squares.len() as u32);
        let singles = squares * self.positions as u32;
        let mut readers: Vec<Reader<'_>> = Vec::with_capacity(self.positions);
        for (bytes, starts) in row.iter().zip(&self.starts) {
            let at = by * columns + bx;
            let first = starts[by * columns];
            readers.push(Reader { bytes: &bytes[(starts[at] - first) as usize..(starts[at + 1] - first) as usize] });
        }
        for k in 0..BLOCK_PIXELS {
            for (reader, position) in readers.iter_mut().zip(0u32..) {
                for _ in 0..reader.count() {
                    let (place, rgb) = reader.term();
                    // Functions of the position, then its single squares.
                    let (single, place) = (place >= squares, place % squares);
                    block.locations.push(position * squares + place + if single { singles } else { 0 });
                    block.coefficients.push(rgb);
                    block.counts[k] += 1;
                }
            }
        }
        Ok(())
    }
}

/// What a pixel may lose at a position, squared; and energy below which a coefficient is noise.
#[derive(Debug, Clone, Copy)]
struct Limits {
    share: f32,
    noise: f32,
}

/// Sums of squares of the pixels of a block.
fn energies_of(block: &[f32]) -> [f64; BLOCK_PIXELS] {
    let mut sums = [0.0; BLOCK_PIXELS];
    for pixels in block.chunks_exact(BLOCK_PIXELS) {
        sums.iter_mut().zip(pixels).for_each(|(sum, t)| *sum += f64::from(*t) * f64::from(*t));
    }
    sums
}

/// Sizes of finest diagonal Haar coefficients of some pixels in green: nearly all are noise.
fn finest_of(block: &[f32], squares: Plane, pixels: &[usize]) -> Vec<f32> {
    let (columns, rows) = squares.size();
    let green = &block[squares.len() * BLOCK_PIXELS..];
    let mut found = Vec::new();
    for pixel in pixels.iter().step_by(NOISE_STEP) {
        let at = |x: usize, y: usize| green[(y * columns + x) * BLOCK_PIXELS + *pixel];
        for y in (0..rows.saturating_sub(1)).step_by(4) {
            for x in (0..columns.saturating_sub(1)).step_by(4) {
                found.push(0.5 * (at(x, y) - at(x + 1, y) - at(x, y + 1) + at(x + 1, y + 1)).abs());
            }
        }
    }
    found
}

/// Pixels of a block, coded.
struct Coded {
    bytes: Vec<u8>,
    largest: f32,
    energy: f64,
    lost: f64,
    terms: u64,
}

/// One position's pixels to terms.
struct Coder<'a> {
    squares: Plane,
    transform: &'a Transform,
    limits: Limits,
}

impl Coder<'_> {
    /// `block`: `[channel][square][pixel]`.
    fn block(&self, block: &[f32]) -> Coded {
        let count = self.squares.len();
        let energies = energies_of(block);
        let mut coded = Coded { bytes: Vec::new(), largest: 0.0, energy: energies.iter().sum(), lost: 0.0, terms: 0 };
        let mut function = vec![[0.0f32; 3]; count];
        let mut terms: Vec<(u32, [f32; 3])> = Vec::new();
        for (pixel, energy) in energies.iter().enumerate() {
            terms.clear();
            if *energy > f64::from(self.limits.share) {
                for (square, rgb) in function.iter_mut().enumerate() {
                    *rgb = std::array::from_fn(|c| block[(c * count + square) * BLOCK_PIXELS + pixel]);
                }
                coded.lost += self.pixel(&mut function, &mut terms);
            } else {
                coded.lost += energy;
            }
            coded.bytes.extend((terms.len() as u32).to_le_bytes());
            coded.terms += terms.len() as u64;
            for (place, rgb) in &terms {
                coded.bytes.extend(place.to_le_bytes());
                rgb.iter().for_each(|v| coded.bytes.extend(v.to_le_bytes()));
                coded.largest = rgb.iter().fold(coded.largest, |most, v| most.max(v.abs()));
            }
        }
        coded
    }

    /// Spikes, then the coefficients of the rest; returns what is lost, squared. `function` is used up.
    fn pixel(&self, function: &mut [[f32; 3]], terms: &mut Vec<(u32, [f32; 3])>) -> f64 {
        let count = function.len() as u32;
        let least = (SPIKE * self.limits.share).max(self.limits.noise);
        for (square, spike) in self.spikes(function, least) {
            terms.push((count + square as u32, spike));
            function[square].iter_mut().zip(spike).for_each(|(v, s)| *v -= s);
        }
        self.transform.forward(function.as_flattened_mut(), 3);
        let size = |rgb: &[f32; 3]| rgb.iter().map(|v| v * v).sum::<f32>();
        let mut order: Vec<(f32, u32)> = function.iter().map(size).zip(0..).collect();
        order.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let (mut lost, mut dropped) = (0.0f64, 0);
        for (energy, _) in &order {
            let more = lost + f64::from(*energy);
            if more > f64::from(self.limits.share) && *energy > self.limits.noise {
                break;
            }
            (lost, dropped) = (more, dropped + 1);
        }
        let mut kept: Vec<u32> = order[dropped..].iter().map(|entry| entry.1).collect();
        kept.sort_unstable();
        terms.extend(kept.into_iter().map(|place| (place, function[place as usize])));
        lost
    }

    /// Squares that stand out from the median of their neighbourhood by more than `least`, squared, and by how much.
    fn spikes(&self, function: &[[f32; 3]], least: f32) -> Vec<(usize, [f32; 3])> {
        let (columns, rows) = self.squares.size();
        let (mut found, mut room) = (Vec::new(), [[0.0f32; NEAR * NEAR]; 3]);
        for (top, left) in
            (0..rows).step_by(NEAR).flat_map(|top| (0..columns).step_by(NEAR).map(move |left| (top, left)))
        {
            let near = || {
                (top..(top + NEAR).min(rows))
                    .flat_map(move |y| (left..(left + NEAR).min(columns)).map(move |x| y * columns + x))
            };
            let mut count = 0;
            for square in near() {
                (0..3).for_each(|c| room[c][count] = function[square][c]);
                count += 1;
            }
            let median =
                |values: &mut [f32; NEAR * NEAR]| *values[..count].select_nth_unstable_by(count / 2, f32::total_cmp).1;
            let usual: [f32; 3] = std::array::from_fn(|c| median(&mut room[c]));
            for square in near() {
                let off: [f32; 3] = std::array::from_fn(|c| function[square][c] - usual[c]);
                if off.iter().map(|v| v * v).sum::<f32>() > least {
                    found.push((square, off));
                }
            }
        }
        found
    }
}

/// Reads back what [`Coder`] wrote.
struct Reader<'a> {
    bytes: &'a [u8],
}

impl Reader<'_> {
    fn number(&mut self) -> [u8; 4] {
        let (four, rest) = self.bytes.split_at(4);
        self.bytes = rest;
        [four[0], four[1], four[2], four[3]]
    }

    fn count(&mut self) -> u32 {
        u32::from_le_bytes(self.number())
    }

    fn term(&mut self) -> (u32, [f32; 3]) {
        let place = u32::from_le_bytes(self.number());
        (place, std::array::from_fn(|_| f32::from_le_bytes(self.number())))
    }
}

#[cfg(test)]
mod tests;
