//! What a merge tells about itself.

use rayon::prelude::*;
use serde::Serialize;

/// What became of a bracket.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Report {
    /// Pixels that every photograph shows clipped: too bright by an unknown amount.
    pub clipped_everywhere: Shares,
    /// Pixels that every photograph that is not clipped there shows as good as black: mostly noise.
    pub dark_everywhere: Shares,
    /// Estimated relative standard deviation of the samples in range, by the noise model: median and 95th percentile.
    pub noise: [f32; 2],
    /// Each photograph, in the order given.
    pub photographs: Vec<Use>,
}

/// Shares of pixels, 0..1.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Shares {
    /// In at least one channel.
    pub any: f64,
    /// In red, green and blue.
    pub rgb: [f64; 3],
}

impl Shares {
    pub(super) fn count(&mut self, marks: &[u8], is: impl Fn(&u8) -> bool + Sync) {
        let count = |pixel: &[u8]| {
            let rgb = [0, 1, 2].map(|c| u64::from(is(&pixel[c])));
            [rgb[0], rgb[1], rgb[2], u64::from(rgb.contains(&1))]
        };
        let add = |a: [u64; 4], b: [u64; 4]| std::array::from_fn(|i| a[i] + b[i]);
        let sums = marks.par_chunks_exact(3).map(count).reduce(|| [0; 4], add);
        let share = |n: u64| n as f64 / (marks.len() / 3).max(1) as f64;
        *self = Self { any: share(sums[3]), rgb: [0, 1, 2].map(|c| share(sums[c])) };
    }
}

/// What became of one photograph. The shares are of its samples and add up to one.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Use {
    /// In range.
    pub used: f64,
    /// Clipped, or so bright in the merged picture that they must be.
    pub clipped: f64,
    /// As good as black.
    pub dark: f64,
    /// How many stops brighter than the merged picture this photograph is where it is in range, the median: a wrong
    /// exposure time or response shows here. `None` when nothing is in range.
    pub deviation_ev: Option<f32>,
}

/// Largest number of samples whose median is taken.
const MOST_COMPARED: usize = 1 << 18;
/// One sample in so many is compared with the merged picture, in one row of so many.
const COMPARED_EVERY: u32 = 7;

/// Counts of one photograph, or some rows of it.
#[derive(Debug, Default)]
pub(super) struct Tally {
    pub samples: u64,
    pub used: u64,
    pub clipped: u64,
    pub dark: u64,
    compares: bool,
    turn: u32,
    stops: Vec<f32>,
}

impl Tally {
    pub(super) fn of_row(y: usize) -> Self {
        Self { compares: y.is_multiple_of(COMPARED_EVERY as usize), ..Self::default() }
    }

    /// Light of a sample beside what the merged picture makes expect.
    pub(super) fn compare(&mut self, x: f32, expected: f32) {
        if !self.compares {
            return;
        }
        self.turn += 1;
        if self.turn == COMPARED_EVERY {
            self.turn = 0;
            if x > 0.0 && expected > 0.0 {
                self.stops.push((x / expected).log2());
            }
        }
    }

    pub(super) fn join(mut self, mut other: Self) -> Self {
        self.samples += other.samples;
        self.used += other.used;
        self.clipped += other.clipped;
        self.dark += other.dark;
        self.stops.append(&mut other.stops);
        self
    }

    pub(super) fn into_use(mut self) -> Use {
        let share = |n: u64| n as f64 / self.samples.max(1) as f64;
        let (used, clipped, dark) = (share(self.used), share(self.clipped), share(self.dark));
        Use { used, clipped, dark, deviation_ev: percentile(&mut self.stops, 0.5) }
    }
}

impl Report {
    /// From estimates and the weights behind them: the variance of a mean weighted by inverse variances is the inverse of
    /// their sum.
    pub(super) fn measure_noise(&mut self, estimate: &[f32], weights: &[f32], in_range: impl Fn(usize) -> bool) {
        // Prime to 3, so that all channels are met.
        let stride = (estimate.len() / MOST_COMPARED).max(1) * 3 + 1;
        let found = (0..estimate.len()).step_by(stride).filter(|i| in_range(*i) && estimate[*i] > 0.0);
        let mut relative: Vec<f32> = found.map(|i| 1.0 / (weights[i].sqrt() * estimate[i])).collect();
        self.noise = [0.5, 0.95].map(|share| percentile(&mut relative, share).unwrap_or(0.0));
    }
}

fn percentile(values: &mut [f32], share: f64) -> Option<f32> {
    let last = values.len().checked_sub(1)?;
    let at = (last as f64 * share).round() as usize;
    Some(*values.select_nth_unstable_by(at, f32::total_cmp).1)
}
