//! The deviation of what is dark in the photographs of a position, from them alone.
//!
//! A line of squares lights little of the picture, so two neighbouring patterns of a set are the same but for noise nearly
//! everywhere. The diagonal difference of 2 x 2 pixels of their difference takes off what is left of smooth light, and the median
//! of its size does not mind the few pixels that either lights (Donoho and Johnstone 1994: the deviation is the median over 0.6745).

use crate::image::Image;

/// Pairs of photographs that are looked at.
const PAIRS: usize = 12;
/// Blocks of 2 x 2 pixels that are looked at of a pair: their median is known to a percent.
const BLOCKS: usize = 8_000;
/// Median of the size of a normal number of deviation 1.
const MEDIAN: f64 = 0.6745;

/// The deviation of one photograph's values where it is dark; 0 for pictures of less than 2 x 2 pixels. `influence` neighbours belong
/// to one line.
pub(super) fn of_dark(photographs: &[Image], influence: usize) -> f64 {
    let (width, height) = photographs[0].size();
    let (across, blocks) = (width / 2, (width / 2) * (height / 2));
    if blocks == 0 || photographs.len() <= influence {
        return 0.0;
    }
    // Patterns of neighbouring lines and of one offset.
    let pairs = photographs.len() - influence;
    let mut sizes = Vec::new();
    for n in (0..pairs).step_by(pairs.div_ceil(PAIRS)) {
        let (a, b) = (&photographs[n], &photographs[n + influence]);
        for block in (0..blocks).step_by(blocks.div_ceil(BLOCKS)) {
            let (x, y) = (2 * (block % across), 2 * (block / across));
            for c in 0..3 {
                let at = |x: usize, y: usize| f64::from(a.pixel(x, y)[c]) - f64::from(b.pixel(x, y)[c]);
                sizes.push(0.5 * (at(x, y) - at(x + 1, y) - at(x, y + 1) + at(x + 1, y + 1)).abs());
            }
        }
    }
    let middle = sizes.len() / 2;
    let (_, median, _) = sizes.select_nth_unstable_by(middle, f64::total_cmp);
    // Of the difference of two photographs.
    *median / MEDIAN / std::f64::consts::SQRT_2
}
