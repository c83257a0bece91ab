//! The loop over blocks.

use super::Weights;
use super::kernels::{self, Isa, Sums, TOGETHER};
use super::strips::{by_rows, rows_of};
use crate::error::{Error, Result};
use crate::field::{BLOCK_HEIGHT, BLOCK_PIXELS, BLOCK_WIDTH, Block, BlockBuffer, Dense, Samples};
use crate::image::{Image, Window};

/// `T L` for several illuminations at once: one picture of the window's size (RGB) per set of weights. The field is
/// streamed once whatever their number; each picture is the same as if it were made alone.
///
/// Cost: reads `window x elements x 3` numbers; rows of blocks are spread over the current rayon threads, and the result
/// does not depend on their number.
///
/// # Errors
/// Weights that do not fit the field, a window outside the picture, bytes that cannot be read, NaN in the field.
pub fn apply(samples: Samples<'_>, weights: &[&Weights], window: Window) -> Result<Vec<Image>> {
    match samples {
        Samples::Dense(dense) => apply_dense(dense, weights, window),
    }
}

/// [`apply`] for coefficient pictures of any projection.
///
/// # Errors
/// As [`apply`].
pub(super) fn apply_dense(dense: &Dense, weights: &[&Weights], window: Window) -> Result<Vec<Image>> {
    let layout = dense.layout();
    if let Some(wrong) = weights.iter().find(|w| w.factors().len() != layout.elements) {
        let found = format!("{} weights", wrong.factors().len());
        return Err(Error::invalid("illumination", found, format!("{}, one an element", layout.elements)));
    }
    let stream = Stream { dense, weights: prepare(dense, weights), window, isa: Isa::detect() };
    by_rows(layout, dense.path(), weights.len(), window, |by, strips| stream.row(by, strips))
}

/// For each channel, each illumination's weights, the field's scale included.
fn prepare(dense: &Dense, weights: &[&Weights]) -> [Vec<Vec<f32>>; 3] {
    std::array::from_fn(|c| weights.iter().map(|w| w.channel(c, dense.scale())).collect())
}

/// One pass over a field.
struct Stream<'a> {
    dense: &'a Dense,
    weights: [Vec<Vec<f32>>; 3],
    window: Window,
    isa: Isa,
}

impl Stream<'_> {
    /// One row of blocks into one strip a picture.
    fn row(&self, by: usize, strips: &mut [&mut [f32]]) -> Result<()> {
        let (columns, _) = self.dense.layout().blocks(self.window);
        let (mut buffer, mut floats) = (BlockBuffer::default(), Vec::new());
        for bx in columns {
            for c in 0..3 {
                let block = self.dense.block(bx, by, c, &mut buffer)?;
                if let [weights] = &self.weights[c][..] {
                    self.scatter(&kernels::block_sums(self.isa, block, weights), bx, by, c, strips[0]);
                    continue;
                }
                // Converted once, in cache, and used by every illumination.
                kernels::expand(self.isa, block, &mut floats);
                let groups = self.weights[c].chunks(TOGETHER).zip(strips.chunks_mut(TOGETHER));
                for (weights, strips) in groups {
                    self.together(&floats, weights, strips, (bx, by, c));
                }
            }
        }
        Ok(())
    }

    /// One expanded block under up to [`TOGETHER`] illuminations.
    fn together(
        &self,
        floats: &[f32],
        weights: &[Vec<f32>],
        strips: &mut [&mut [f32]],
        (bx, by, c): (usize, usize, usize),
    ) {
        if let [p, q, r, s] = weights {
            let sums = kernels::block_sums_together(self.isa, floats, [p, q, r, s]);
            strips.iter_mut().zip(&sums).for_each(|(strip, sums)| self.scatter(sums, bx, by, c, strip));
            return;
        }
        for (weights, strip) in weights.iter().zip(strips) {
            let sums = kernels::block_sums(self.isa, Block::Float(floats), weights);
            self.scatter(&sums, bx, by, c, strip);
        }
    }

    /// Puts a block's sums where the window has them.
    fn scatter(&self, sums: &Sums, bx: usize, by: usize, c: usize, strip: &mut [f32]) {
        const _: () = assert!(BLOCK_PIXELS == BLOCK_WIDTH * BLOCK_HEIGHT);
        let rows = rows_of(by, self.window);
        let columns = (bx * BLOCK_WIDTH).max(self.window.x0)..((bx + 1) * BLOCK_WIDTH).min(self.window.x1);
        for y in rows.clone() {
            let line = &mut strip[(y - rows.start) * self.window.width() * 3..][..self.window.width() * 3];
            for x in columns.clone() {
                line[(x - self.window.x0) * 3 + c] = sums[(y % BLOCK_HEIGHT) * BLOCK_WIDTH + x % BLOCK_WIDTH];
            }
        }
    }
}
