//! The pixels of a field, block by block, on all threads, in bounded memory.

use rayon::prelude::*;

use crate::error::Result;
use crate::field::{BLOCK_HEIGHT, BLOCK_PIXELS, BLOCK_WIDTH, BlockBuffer, Samples};

/// Rows of blocks between two reports of progress, a thread: enough that threads seldom wait for each other.
const ROWS_A_THREAD: usize = 2;

/// Called with the rows of pixels done and all of them; an error stops the work.
pub type Progress<'a> = dyn FnMut(u64, u64) -> Result<()> + 'a;

/// Numbers of the three channels of a block, each `[element][8][16]`, as stored: [`Samples::scale`] is left out.
pub(super) type Channels = [Vec<f32>; 3];

/// Calls `work` with every block; what it returns, `[plane][8][16]`, is put together to `planes` planes of width x height,
/// row 0 at the top.
///
/// # Errors
/// Bytes that cannot be read, numbers that are not finite, what `progress` returns.
pub(super) fn map_pixels<T: Copy + Default + Send>(
    samples: Samples<'_>,
    planes: usize,
    work: impl Fn(&Channels) -> Vec<T> + Sync,
    progress: &mut Progress<'_>,
) -> Result<Vec<Vec<T>>> {
    let layout = samples.layout();
    let mut pixels = vec![vec![T::default(); layout.width * layout.height]; planes];
    let step = ROWS_A_THREAD * rayon::current_num_threads();
    for first in (0..layout.rows()).step_by(step) {
        let rows = first..(first + step).min(layout.rows());
        let places: Vec<(usize, usize)> =
            rows.clone().flat_map(|by| (0..layout.columns()).map(move |bx| (bx, by))).collect();
        let work = |&(bx, by): &(usize, usize)| Ok(work(&read(samples, bx, by)?));
        let answers = places.par_iter().map(work).collect::<Result<Vec<_>>>()?;
        for (&(bx, by), answers) in places.iter().zip(&answers) {
            for (at, answer) in answers.iter().enumerate() {
                let (plane, x) = (at / BLOCK_PIXELS, bx * BLOCK_WIDTH + at % BLOCK_WIDTH);
                let y = by * BLOCK_HEIGHT + at % BLOCK_PIXELS / BLOCK_WIDTH;
                if x < layout.width && y < layout.height {
                    pixels[plane][y * layout.width + x] = *answer;
                }
            }
        }
        progress((rows.end * BLOCK_HEIGHT).min(layout.height) as u64, layout.height as u64)?;
    }
    Ok(pixels)
}

/// The block in column `bx` of row `by`.
///
/// # Errors
/// Bytes that cannot be read, numbers that are not finite.
pub(super) fn read(samples: Samples<'_>, bx: usize, by: usize) -> Result<Channels> {
    let (mut room, mut channels) = (BlockBuffer::default(), Channels::default());
    for (c, floats) in channels.iter_mut().enumerate() {
        samples.read(bx, by, c, &mut room, floats)?;
    }
    Ok(channels)
}
