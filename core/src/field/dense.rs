//! `Dense`: one coefficient picture per element of a projection, in blocks.

use std::ops::Range;
use std::sync::Arc;

use half::slice::HalfFloatSliceExt;
use rayon::prelude::*;

use super::manifest::Precision;
use super::store::{Scratch, Store};
use crate::error::Result;
use crate::image::{Image, Window};

/// Columns of a block.
pub const BLOCK_WIDTH: usize = 16;
/// Rows of a block.
pub const BLOCK_HEIGHT: usize = 8;
/// Pixels of a block: 128 accumulators are 8 AVX-512 registers.
pub const BLOCK_PIXELS: usize = BLOCK_WIDTH * BLOCK_HEIGHT;
/// Red, green, blue.
pub(super) const CHANNELS: usize = 3;

/// Sizes of a dense field, and where its blocks lie: `[block y, block x, channel, element, 8, 16]`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Layout {
    /// Columns of the pictures.
    pub width: usize,
    /// Rows of the pictures.
    pub height: usize,
    /// Elements, e.g. lamps.
    pub elements: usize,
}

impl Layout {
    /// Blocks in a row of them.
    pub fn columns(&self) -> usize {
        self.width.div_ceil(BLOCK_WIDTH)
    }

    /// Rows of blocks.
    pub fn rows(&self) -> usize {
        self.height.div_ceil(BLOCK_HEIGHT)
    }

    /// The shape of the array.
    pub fn shape(&self) -> [usize; 6] {
        [self.rows(), self.columns(), CHANNELS, self.elements, BLOCK_HEIGHT, BLOCK_WIDTH]
    }

    /// Numbers in one block of one channel: its elements x 128.
    pub fn block_len(&self) -> usize {
        self.elements * BLOCK_PIXELS
    }

    /// Numbers in the whole array, or `None` where that exceeds 64 bits.
    pub fn len(&self) -> Option<u64> {
        self.shape().iter().try_fold(1u64, |product, &n| product.checked_mul(n as u64))
    }

    /// No element?
    pub fn is_empty(&self) -> bool {
        self.elements == 0
    }

    /// The blocks that a window touches: (columns, rows).
    pub fn blocks(&self, window: Window) -> (Range<usize>, Range<usize>) {
        let columns = window.x0 / BLOCK_WIDTH..window.x1.div_ceil(BLOCK_WIDTH);
        let rows = window.y0 / BLOCK_HEIGHT..window.y1.div_ceil(BLOCK_HEIGHT);
        (columns, rows)
    }
}

/// A dense field in an open container.
#[derive(Debug, Clone)]
pub struct Dense {
    pub(super) store: Arc<Store>,
    /// Byte of the file where the numbers start; a multiple of 64.
    pub(super) start: u64,
    pub(super) layout: Layout,
    pub(super) precision: Precision,
    pub(super) scale: f32,
}

/// The numbers of one block of one channel: `[element][8][16]`.
#[derive(Debug, Clone, Copy)]
pub enum Block<'a> {
    /// Bit patterns of halves.
    Half(&'a [half::f16]),
    /// Floats.
    Float(&'a [f32]),
}

/// Room for a block where the file is read, not mapped.
#[derive(Debug, Default)]
pub struct BlockBuffer(pub(super) Scratch);

impl Block<'_> {
    /// The numbers as floats, as stored.
    pub fn expand(&self, out: &mut Vec<f32>) {
        match self {
            Block::Half(t) => {
                out.resize(t.len(), 0.0);
                t.convert_to_f32_slice(out);
            }
            Block::Float(t) => {
                out.clear();
                out.extend_from_slice(t);
            }
        }
    }
}

impl Dense {
    /// Sizes.
    pub fn layout(&self) -> Layout {
        self.layout
    }

    /// The file it lies in.
    pub fn path(&self) -> &std::path::Path {
        self.store.path()
    }

    /// How numbers are stored.
    pub fn precision(&self) -> Precision {
        self.precision
    }

    /// A power of two: T = stored x scale.
    pub fn scale(&self) -> f32 {
        self.scale
    }

    /// The block in column `bx`, row `by`, of channel `c`, as one contiguous stream.
    ///
    /// # Errors
    /// Bytes that cannot be read.
    pub fn block<'a>(&'a self, bx: usize, by: usize, c: usize, buffer: &'a mut BlockBuffer) -> Result<Block<'a>> {
        self.part((bx, by, c), 0..self.layout.elements, buffer)
    }

    /// Some elements of the block in column `bx`, row `by`, of channel `c`, which lie together.
    ///
    /// # Errors
    /// Bytes that cannot be read.
    ///
    /// # Panics
    /// When there are no such elements.
    pub fn part<'a>(
        &'a self,
        (bx, by, c): (usize, usize, usize),
        elements: Range<usize>,
        buffer: &'a mut BlockBuffer,
    ) -> Result<Block<'a>> {
        assert!(elements.end <= self.layout.elements, "elements {elements:?} of {}", self.layout.elements);
        let element = BLOCK_PIXELS * self.precision.bytes();
        let index = (by * self.layout.columns() + bx) * CHANNELS + c;
        let first = index as u64 * self.layout.elements as u64 + elements.start as u64;
        let at = self.start + first * element as u64;
        let bytes = self.store.get(at, elements.len() * element, &mut buffer.0)?;
        // Numbers are aligned: the map starts at a page, `start` was checked, an element is a multiple of 64 bytes.
        Ok(match self.precision {
            Precision::Half => Block::Half(bytemuck::cast_slice(bytes)),
            Precision::Float => Block::Float(bytemuck::cast_slice(bytes)),
        })
    }

    /// The coefficient picture of one element, RGB: of lamps, `T_j`. Reads 256 bytes of every block.
    ///
    /// # Errors
    /// Bytes that cannot be read.
    ///
    /// # Panics
    /// When there is no such element.
    pub fn picture(&self, element: usize) -> Result<Image> {
        assert!(element < self.layout.elements, "element {element} of {}", self.layout.elements);
        let (width, height) = (self.layout.width, self.layout.height);
        let mut picture = Image::new(width, height, CHANNELS);
        let rows = picture.data_mut().par_chunks_mut(width * CHANNELS * BLOCK_HEIGHT).enumerate();
        rows.try_for_each_init(BlockBuffer::default, |buffer, (by, rows)| {
            (0..self.layout.columns() * CHANNELS).try_for_each(|n| {
                let (bx, c) = (n / CHANNELS, n % CHANNELS);
                let block = self.tile(bx, by, c, element, buffer)?;
                for (y, row) in rows.chunks_exact_mut(width * CHANNELS).enumerate() {
                    let pixels = row.chunks_exact_mut(CHANNELS).skip(bx * BLOCK_WIDTH);
                    pixels.zip(&block[y * BLOCK_WIDTH..(y + 1) * BLOCK_WIDTH]).for_each(|(pixel, t)| pixel[c] = *t);
                }
                Ok::<(), crate::error::Error>(())
            })
        })?;
        Ok(picture)
    }

    /// The numbers of one element in a block, scaled.
    fn tile(
        &self,
        bx: usize,
        by: usize,
        c: usize,
        element: usize,
        buffer: &mut BlockBuffer,
    ) -> Result<[f32; BLOCK_PIXELS]> {
        let mut tile = [0.0f32; BLOCK_PIXELS];
        match self.part((bx, by, c), element..element + 1, buffer)? {
            Block::Half(t) => t.convert_to_f32_slice(&mut tile),
            Block::Float(t) => tile.copy_from_slice(t),
        }
        tile.iter_mut().for_each(|t| *t *= self.scale);
        Ok(tile)
    }
}
