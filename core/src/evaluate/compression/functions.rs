//! Reflectance functions of some pixels, rebuilt on the grid.

use std::sync::Arc;

use rayon::prelude::*;

use super::super::blocks::{Progress, read};
use crate::domain::{Directions, StageGrid};
use crate::error::{Error, Result};
use crate::field::{BLOCK_HEIGHT, BLOCK_PIXELS, BLOCK_WIDTH, Samples};
use crate::reconstruct::{Method, Reconstruction, Resampling};

/// Red, green, blue.
pub(super) const CHANNELS: usize = 3;
/// Pixels of a block that are rebuilt together: 48 functions, three groups of lanes.
const TOGETHER: usize = 16;
/// Groups of pixels between two reports of progress, a thread.
const GROUPS_A_THREAD: usize = 2;

/// The reflectance functions of a field on a grid.
#[derive(Debug)]
pub struct Functions<'a> {
    samples: Samples<'a>,
    grid: StageGrid,
    resampling: Resampling,
}

/// A pixel of the list that was asked for.
#[derive(Debug, Clone, Copy)]
struct Member {
    /// Column and row of its block.
    block: (usize, usize),
    /// Its number in the list.
    n: usize,
    /// Its place in the block.
    at: usize,
}

impl<'a> Functions<'a> {
    /// Looks at the functions of a method in all directions of the grid.
    ///
    /// # Errors
    /// A field of other lamps; a method that the lamps do not allow.
    pub fn new(samples: Samples<'a>, lamps: &Arc<Directions>, method: Method, grid: StageGrid) -> Result<Self> {
        if samples.layout().elements != lamps.len() {
            let found = format!("{} lamps", lamps.len());
            return Err(Error::invalid("lamps", found, format!("{}, as the field has", samples.layout().elements)));
        }
        let reconstruction = Reconstruction::new(lamps.clone(), method)?;
        let resampling = Resampling::new(&reconstruction, grid.directions()?.lamps());
        Ok(Self { samples, grid, resampling })
    }

    /// The grid.
    pub fn grid(&self) -> &StageGrid {
        &self.grid
    }

    /// The samples behind them.
    pub fn samples(&self) -> Samples<'a> {
        self.samples
    }

    /// Calls `work` with the function of each pixel (`y * width + x`), `[texel][channel]`, on all threads, and `take` with
    /// the number of the pixel in the list and what `work` made of it, block by block, in an order that depends on the list
    /// alone. Memory: some megabytes a thread; of the field only the blocks of these pixels are read.
    ///
    /// # Errors
    /// A pixel outside the picture; bytes that cannot be read, numbers that are not finite; what `progress` returns, which
    /// counts pixels.
    pub fn visit<T: Send>(
        &self,
        pixels: &[u32],
        work: impl Fn(&[f32]) -> T + Sync,
        mut take: impl FnMut(usize, T),
        progress: &mut Progress<'_>,
    ) -> Result<()> {
        let groups = self.groups(pixels)?;
        let mut done = 0;
        for some in groups.chunks(GROUPS_A_THREAD * rayon::current_num_threads()) {
            let answers: Vec<Vec<T>> = some.par_iter().map(|group| self.group(group, &work)).collect::<Result<_>>()?;
            for (group, answers) in some.iter().zip(answers) {
                done += answers.len() as u64;
                group.iter().zip(answers).for_each(|(member, answer)| take(member.n, answer));
            }
            progress(done, pixels.len() as u64)?;
        }
        Ok(())
    }

    /// Groups of pixels of one block each.
    fn groups(&self, pixels: &[u32]) -> Result<Vec<Vec<Member>>> {
        let layout = self.samples.layout();
        let mut members = Vec::with_capacity(pixels.len());
        for (n, &pixel) in pixels.iter().enumerate() {
            let (x, y) = (pixel as usize % layout.width, pixel as usize / layout.width);
            if y >= layout.height {
                let expected = format!("below {}", layout.width * layout.height);
                let place = self.samples.path().display().to_string();
                return Err(Error::invalid(place, format!("pixel {pixel}"), expected));
            }
            let at = y % BLOCK_HEIGHT * BLOCK_WIDTH + x % BLOCK_WIDTH;
            members.push(Member { block: (x / BLOCK_WIDTH, y / BLOCK_HEIGHT), n, at });
        }
        members.sort_by_key(|member| (member.block.1, member.block.0, member.n));
        let of_block = |members: &[Member]| members.chunks(TOGETHER).map(<[_]>::to_vec).collect::<Vec<_>>();
        Ok(members.chunk_by(|a, b| a.block == b.block).flat_map(of_block).collect())
    }

    fn group<T>(&self, group: &[Member], work: &impl Fn(&[f32]) -> T) -> Result<Vec<T>> {
        let channels = read(self.samples, group[0].block.0, group[0].block.1)?;
        let (lanes, scale) = (group.len() * CHANNELS, self.samples.scale());
        let mut samples = vec![0.0; self.samples.layout().elements * lanes];
        for (lamp, lanes) in samples.chunks_exact_mut(lanes).enumerate() {
            for (rgb, member) in lanes.chunks_exact_mut(CHANNELS).zip(group) {
                (0..CHANNELS).for_each(|c| rgb[c] = channels[c][lamp * BLOCK_PIXELS + member.at] * scale);
            }
        }
        let mut values = vec![0.0; self.grid.texels() * lanes];
        self.resampling.apply(&samples, &mut values);
        let function = |k: usize| -> Vec<f32> {
            let rgb = |lanes: &[f32]| [lanes[CHANNELS * k], lanes[CHANNELS * k + 1], lanes[CHANNELS * k + 2]];
            values.chunks_exact(lanes).flat_map(rgb).collect()
        };
        Ok((0..group.len()).map(|k| work(&function(k))).collect())
    }
}
