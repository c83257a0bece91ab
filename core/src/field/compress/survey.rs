//! Energy and largest numbers of a field.

use rayon::prelude::*;

use super::{Progress, Stage};
use crate::error::Result;
use crate::field::dense::{BLOCK_PIXELS, CHANNELS};
use crate::field::{BlockBuffer, Samples};

/// What thresholds and scales depend on, in units of `T`.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Survey {
    /// Sum of squares over pixels, channels and elements.
    pub energy: f64,
    /// The part of the energy that the means alone have: the sum over pixels and channels of elements x (mean over the
    /// elements)^2. Glints have much energy and little of this; under even light it is what shows.
    pub even_energy: f64,
    /// The largest |T|.
    pub largest: f32,
    /// The largest norm of a reflectance function in one channel.
    pub largest_norm: f64,
}

/// Reads the whole field once. Pixels beyond the edges of the picture are zeros and add nothing.
///
/// # Errors
/// As [`Samples::read`]; what `progress` returns.
pub fn survey(samples: Samples<'_>, progress: &mut Progress<'_>) -> Result<Survey> {
    let layout = samples.layout();
    let mut sums = Survey::default();
    for by in 0..layout.rows() {
        let of_block = |(room, numbers): &mut (BlockBuffer, Vec<f32>), n: usize| {
            samples.read(n / CHANNELS, by, n % CHANNELS, room, numbers)?;
            let (mut squares, mut totals) = ([0.0f64; BLOCK_PIXELS], [0.0f64; BLOCK_PIXELS]);
            let mut largest = 0.0f32;
            for element in numbers.chunks_exact(BLOCK_PIXELS) {
                squares.iter_mut().zip(element).for_each(|(sum, t)| *sum += f64::from(*t) * f64::from(*t));
                totals.iter_mut().zip(element).for_each(|(sum, t)| *sum += f64::from(*t));
                largest = element.iter().fold(largest, |most, t| most.max(t.abs()));
            }
            let even = totals.iter().map(|total| total * total).sum::<f64>() / layout.elements as f64;
            Ok((squares, even, largest))
        };
        let blocks: Vec<([f64; BLOCK_PIXELS], f64, f32)> = (0..layout.columns() * CHANNELS)
            .into_par_iter()
            .map_init(Default::default, of_block)
            .collect::<Result<_>>()?;
        for (squares, even, largest) in blocks {
            sums.energy += squares.iter().sum::<f64>();
            sums.even_energy += even;
            sums.largest = sums.largest.max(largest);
            sums.largest_norm = squares.iter().fold(sums.largest_norm, |most, square| most.max(square.sqrt()));
        }
        progress(Stage::Measuring, by as u64 + 1, layout.rows() as u64)?;
    }
    let scale = samples.scale();
    let square = f64::from(scale) * f64::from(scale);
    Ok(Survey {
        energy: sums.energy * square,
        even_energy: sums.even_energy * square,
        largest: sums.largest * scale,
        largest_norm: sums.largest_norm * f64::from(scale),
    })
}
