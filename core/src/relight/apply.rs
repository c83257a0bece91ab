//! The loop over blocks.

use super::Weights;
use super::factored::apply_factored;
use super::kernels::{self, Isa, Sums, TOGETHER};
use super::strips::{Target, by_rows, check, rows_of};
use crate::error::Result;
use crate::field::{BLOCK_HEIGHT, BLOCK_PIXELS, BLOCK_WIDTH, Block, BlockBuffer, Dense, Layout, Samples};
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
    apply_samples(samples, weights, Target::plain(window))
}

/// [`apply`] into what a picture is made of.
///
/// # Errors
/// As [`apply`].
pub(super) fn apply_samples(samples: Samples<'_>, weights: &[&Weights], target: Target<'_>) -> Result<Vec<Image>> {
    match samples {
        Samples::Dense(dense) => apply_dense(dense, weights, target),
        Samples::Factored(factored) => apply_factored(factored, weights, target),
    }
}

/// [`apply_samples`] for coefficient pictures of any projection.
///
/// # Errors
/// As [`apply`].
pub(super) fn apply_dense(dense: &Dense, weights: &[&Weights], target: Target<'_>) -> Result<Vec<Image>> {
    check(dense.layout(), weights, target.window)?;
    let lights = weights.len();
    let weights = std::array::from_fn(|c| weights.iter().map(|w| w.channel(c, dense.scale())).collect());
    stream(&Whole { dense, weights }, lights, target)
}

/// Where blocks come from, and what their numbers are multiplied by.
pub(super) trait Source: Sync {
    /// Sizes of the pictures.
    fn layout(&self) -> Layout;

    /// The file, for messages.
    fn path(&self) -> &std::path::Path;

    /// The numbers of a block.
    ///
    /// # Errors
    /// Bytes that cannot be read.
    fn block<'a>(&'a self, bx: usize, by: usize, c: usize, buffer: &'a mut BlockBuffer) -> Result<Block<'a>>;

    /// For each illumination one factor an element of that block, the field's scale included.
    ///
    /// # Errors
    /// Bytes that cannot be read.
    fn factors(&self, bx: usize, by: usize, c: usize) -> Result<&[Vec<f32>]>;
}

/// Coefficient pictures: the same factors everywhere.
struct Whole<'a> {
    dense: &'a Dense,
    /// Channel by channel.
    weights: [Vec<Vec<f32>>; 3],
}

impl Source for Whole<'_> {
    fn layout(&self) -> Layout {
        self.dense.layout()
    }

    fn path(&self) -> &std::path::Path {
        self.dense.path()
    }

    fn block<'a>(&'a self, bx: usize, by: usize, c: usize, buffer: &'a mut BlockBuffer) -> Result<Block<'a>> {
        self.dense.block(bx, by, c, buffer)
    }

    fn factors(&self, _: usize, _: usize, c: usize) -> Result<&[Vec<f32>]> {
        Ok(&self.weights[c])
    }
}

/// One pass over the blocks of a window: a picture an illumination.
///
/// # Errors
/// Bytes that cannot be read, NaN in the field.
pub(super) fn stream(source: &impl Source, lights: usize, target: Target<'_>) -> Result<Vec<Image>> {
    let stream = Stream { source, window: target.window, channels: target.channels, isa: Isa::detect() };
    by_rows(source.layout(), source.path(), lights, target, |by, strips| stream.row(by, strips))
}

/// One pass over a field.
struct Stream<'a, S> {
    source: &'a S,
    window: Window,
    channels: usize,
    isa: Isa,
}

impl<S: Source> Stream<'_, S> {
    /// One row of blocks into one strip a picture.
    fn row(&self, by: usize, strips: &mut [&mut [f32]]) -> Result<()> {
        let (columns, _) = self.source.layout().blocks(self.window);
        let (mut buffer, mut floats) = (BlockBuffer::default(), Vec::new());
        for bx in columns {
            for c in 0..3 {
                let block = self.source.block(bx, by, c, &mut buffer)?;
                let factors = self.source.factors(bx, by, c)?;
                // A black tile: pictures come black.
                if factors.iter().all(Vec::is_empty) {
                    continue;
                }
                if let [weights] = factors {
                    self.scatter(&kernels::block_sums(self.isa, block, weights), bx, by, c, strips[0]);
                    continue;
                }
                // Converted once, in cache, and used by every illumination.
                kernels::expand(self.isa, block, &mut floats);
                let groups = factors.chunks(TOGETHER).zip(strips.chunks_mut(TOGETHER));
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
            let across = self.window.width() * self.channels;
            let line = &mut strip[(y - rows.start) * across..][..across];
            let pixels = line[(columns.start - self.window.x0) * self.channels..].chunks_exact_mut(self.channels);
            let row = &sums[y % BLOCK_HEIGHT * BLOCK_WIDTH..][..BLOCK_WIDTH];
            pixels.zip(&row[columns.start % BLOCK_WIDTH..][..columns.len()]).for_each(|(pixel, sum)| pixel[c] = *sum);
        }
    }
}
