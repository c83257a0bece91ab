//! The samples of a field at the lamps, whatever they are stored as.

use std::path::Path;

use super::dense::{BLOCK_HEIGHT, BLOCK_PIXELS, BLOCK_WIDTH, BlockBuffer, CHANNELS, Dense, Layout};
use super::factored::Factored;
use super::manifest::Kind;
use crate::error::{Error, Result};

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
