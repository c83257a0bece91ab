//! `e_p` of every pixel, and the error reached over the whole field.

use half::f16;

use crate::error::Result;
use crate::field::dense::{BLOCK_HEIGHT, BLOCK_PIXELS, BLOCK_WIDTH, CHANNELS};
use crate::field::manifest::{Loss, Precision};
use crate::field::npy;
use crate::field::writer::{Entries, power_of_two_for};

/// Squared errors and energies of one block, in units of `T`.
#[derive(Debug, Clone)]
pub struct BlockErrors {
    /// `[channel][pixel]`: squared norms of what the decoded function lacks.
    pub lost: [[f64; BLOCK_PIXELS]; CHANNELS],
    /// Sum of squares of the function itself, over all pixels and channels of the block.
    pub energy: f64,
}

impl Default for BlockErrors {
    fn default() -> Self {
        Self { lost: [[0.0; BLOCK_PIXELS]; CHANNELS], energy: 0.0 }
    }
}

impl BlockErrors {
    /// Adds channel `c`: `[element][pixel]` of the function and of what is decoded, in units of `T / scale`.
    pub fn add(&mut self, c: usize, function: &[f32], decoded: &[f32], scale: f32) {
        let square = f64::from(scale) * f64::from(scale);
        let mut lost = [0.0f64; BLOCK_PIXELS];
        let mut energy = 0.0f64;
        for (t, d) in function.chunks_exact(BLOCK_PIXELS).zip(decoded.chunks_exact(BLOCK_PIXELS)) {
            for ((lost, t), d) in lost.iter_mut().zip(t).zip(d) {
                let (t, d) = (f64::from(*t), f64::from(*d));
                *lost += (t - d) * (t - d);
                energy += t * t;
            }
        }
        self.lost[c].iter_mut().zip(lost).for_each(|(sum, lost)| *sum += lost * square);
        self.energy += energy * square;
    }
}

/// The errors of a picture.
#[derive(Debug)]
pub struct ErrorMap {
    size: (usize, usize),
    /// e_p, row 0 at the top.
    errors: Vec<f32>,
    lost: f64,
    energy: f64,
}

impl ErrorMap {
    /// Nothing lost yet.
    pub fn new(width: usize, height: usize) -> Self {
        Self { size: (width, height), errors: vec![0.0; width * height], lost: 0.0, energy: 0.0 }
    }

    /// Takes the errors of the block in column `bx`, row `by`.
    pub fn add(&mut self, bx: usize, by: usize, block: &BlockErrors) {
        self.energy += block.energy;
        for k in 0..BLOCK_PIXELS {
            let (x, y) = (bx * BLOCK_WIDTH + k % BLOCK_WIDTH, by * BLOCK_HEIGHT + k / BLOCK_WIDTH);
            if x < self.size.0 && y < self.size.1 {
                let lost = block.lost.map(|channel| channel[k]);
                self.lost += lost.iter().sum::<f64>();
                self.errors[y * self.size.0 + x] = lost.into_iter().fold(0.0, f64::max).sqrt() as f32;
            }
        }
    }

    /// The relative error so far, Frobenius; 0 for a black field.
    pub fn reached(&self) -> f64 {
        if self.energy > 0.0 { (self.lost / self.energy).sqrt() } else { 0.0 }
    }

    /// Writes `e_p`, rounded up so that it stays a bound.
    ///
    /// # Errors
    /// A full disk.
    pub fn write(&self, out: &mut Entries<'_>, name: &str, asked: Option<f64>) -> Result<Loss> {
        let largest = self.errors.iter().copied().fold(0.0, f32::max);
        let scale = power_of_two_for(largest);
        let mut bytes = npy::header(Precision::Half.descr(), &[self.size.1, self.size.0]);
        bytes.extend(self.errors.iter().flat_map(|e| half_above(e / scale).to_le_bytes()));
        out.entry(name, &bytes)?;
        Ok(Loss { asked, reached: self.reached(), errors: name.to_owned(), scale })
    }
}

/// The smallest half that is not below a number of 0 to 65504, give or take the rounding of the f32 that it comes as.
fn half_above(number: f32) -> f16 {
    // What f64 sums lost on their way to f32.
    let number = number * (1.0 + 2.0 * f32::EPSILON);
    let half = f16::from_f32(number);
    if half.to_f32() < number { f16::from_bits(half.to_bits() + 1) } else { half }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn halves_round_up() {
        for number in [0.0, 1e-9, 0.1, 1.0, 1000.3, 16000.0] {
            let half = half_above(number).to_f32();
            assert!(half >= number && half <= number * 1.002 + 6e-8, "{number}: {half}");
        }
    }

    #[test]
    fn the_map_holds_the_worst_channel_and_the_whole() {
        let mut map = ErrorMap::new(17, 9);
        let mut block = BlockErrors::default();
        let function = vec![2.0; 3 * BLOCK_PIXELS];
        for (c, off) in [1.0, 2.0, 0.0].into_iter().enumerate() {
            block.add(c, &function, &vec![2.0 - off; 3 * BLOCK_PIXELS], 0.5);
        }
        map.add(0, 0, &block);
        assert!((map.errors[0] - 3f32.sqrt()).abs() < 1e-6, "{}", map.errors[0]);
        assert_eq!(map.errors[16], 0.0);
        // (1 + 4) / (3 x 4).
        assert!((map.reached() - (5.0f64 / 12.0).sqrt()).abs() < 1e-9);
    }
}
