//! The samples of a field at the lamps, whatever they are stored as.

use std::ops::Range;
use std::path::Path;

use rayon::prelude::*;

use super::dense::{BLOCK_HEIGHT, BLOCK_PIXELS, BLOCK_WIDTH, BlockBuffer, CHANNELS, Dense, Layout};
use super::factored::Factored;
use super::manifest::Kind;
use crate::error::{Error, Result};
use crate::image::Image;

/// `T` by lamp, block by block: as it was photographed, or decoded.
#[derive(Debug, Clone, Copy)]
pub enum Samples<'a> {
    /// As photographed.
    Dense(&'a Dense),
    /// Decoded from tiles of low rank.
    Factored(&'a Factored),
}

impl Samples<'_> {
    /// What they are stored as.
    pub fn kind(&self) -> Kind {
        match self {
            Samples::Dense(_) => Kind::Dense,
            Samples::Factored(_) => Kind::Factored,
        }
    }

    /// Sizes, as those of a dense field.
    pub fn layout(&self) -> Layout {
        match self {
            Samples::Dense(dense) => dense.layout(),
            Samples::Factored(factored) => factored.layout(),
        }
    }

    /// The file they lie in.
    pub fn path(&self) -> &Path {
        match self {
            Samples::Dense(dense) => dense.path(),
            Samples::Factored(factored) => factored.path(),
        }
    }

    /// A power of two: T = number x scale.
    pub fn scale(&self) -> f32 {
        match self {
            Samples::Dense(dense) => dense.scale(),
            Samples::Factored(factored) => factored.scale(),
        }
    }

    /// The numbers of the block in column `bx`, row `by`, of channel `c`: `[element][8][16]`; [`Samples::scale`] is left out.
    ///
    /// # Errors
    /// Bytes that cannot be read; numbers that are not finite, with the pixel and the lamp.
    pub fn read(&self, bx: usize, by: usize, c: usize, room: &mut BlockBuffer, out: &mut Vec<f32>) -> Result<()> {
        match self {
            Samples::Dense(dense) => dense.block(bx, by, c, room)?.expand(out),
            Samples::Factored(factored) => factored.decode((bx, by, c), room, out)?,
        }
        let Some(at) = out.iter().position(|v| !v.is_finite()) else { return Ok(()) };
        let (x, y) = (bx * BLOCK_WIDTH + at % BLOCK_WIDTH, by * BLOCK_HEIGHT + at % BLOCK_PIXELS / BLOCK_WIDTH);
        let place = format!("{}, pixel ({x}, {y}), lamp {}", self.path().display(), at / BLOCK_PIXELS + 1);
        let expected = "a finite number (`relume verify` tells whether the file was damaged)";
        Err(Error::invalid(place, out[at].to_string(), expected))
    }

    /// The pictures of `T` under some lamps, RGB: one pass over the field, however many they are.
    ///
    /// # Errors
    /// As [`Samples::read`].
    ///
    /// # Panics
    /// When there are no such lamps.
    pub fn pictures(&self, lamps: Range<usize>) -> Result<Vec<Image>> {
        let layout = self.layout();
        assert!(lamps.end <= layout.elements, "lamps {lamps:?} of {}", layout.elements);
        let mut pictures: Vec<Image> =
            lamps.clone().map(|_| Image::new(layout.width, layout.height, CHANNELS)).collect();
        for by in 0..layout.rows() {
            let wanted = lamps.start * BLOCK_PIXELS..lamps.end * BLOCK_PIXELS;
            let block = |(room, numbers): &mut (BlockBuffer, Vec<f32>), n: usize| {
                self.read(n / CHANNELS, by, n % CHANNELS, room, numbers)?;
                Ok(numbers[wanted.clone()].to_vec())
            };
            let blocks = (0..layout.columns() * CHANNELS).into_par_iter().map_init(Default::default, block);
            let blocks: Vec<Vec<f32>> = blocks.collect::<Result<_>>()?;
            pictures.par_iter_mut().enumerate().for_each(|(k, picture)| self.place(&blocks, k, by, picture));
        }
        Ok(pictures)
    }

    /// Copies lamp `k` of a row of blocks into its picture.
    fn place(&self, blocks: &[Vec<f32>], k: usize, by: usize, picture: &mut Image) {
        let (width, scale) = (picture.width(), self.scale());
        let rows = picture.data_mut().chunks_exact_mut(width * CHANNELS).skip(by * BLOCK_HEIGHT).take(BLOCK_HEIGHT);
        for (y, row) in rows.enumerate() {
            for (n, block) in blocks.iter().enumerate() {
                let line = &block[k * BLOCK_PIXELS + y * BLOCK_WIDTH..][..BLOCK_WIDTH];
                let pixels = row.chunks_exact_mut(CHANNELS).skip(n / CHANNELS * BLOCK_WIDTH);
                pixels.zip(line).for_each(|(pixel, t)| pixel[n % CHANNELS] = t * scale);
            }
        }
    }

    /// The reflectance function of a pixel: one RGB triple an element.
    ///
    /// # Errors
    /// A pixel outside the picture; as [`Samples::read`].
    pub fn reflectance(&self, x: usize, y: usize) -> Result<Vec<[f32; 3]>> {
        let layout = self.layout();
        if x >= layout.width || y >= layout.height {
            let expected = format!("0,0 to {},{}, from the top left", layout.width - 1, layout.height - 1);
            return Err(Error::invalid(self.path().display().to_string(), format!("pixel {x},{y}"), expected));
        }
        let at = y % BLOCK_HEIGHT * BLOCK_WIDTH + x % BLOCK_WIDTH;
        let mut answers = vec![[0.0; CHANNELS]; layout.elements];
        let (mut room, mut numbers) = (BlockBuffer::default(), Vec::new());
        for c in 0..CHANNELS {
            self.read(x / BLOCK_WIDTH, y / BLOCK_HEIGHT, c, &mut room, &mut numbers)?;
            let of_pixel = numbers.iter().skip(at).step_by(BLOCK_PIXELS);
            answers.iter_mut().zip(of_pixel).for_each(|(rgb, t)| rgb[c] = t * self.scale());
        }
        Ok(answers)
    }
}
