//! Where the minimum of both sets is too bright: the recovered squares, summed, against the photograph of all of them.
//!
//! `excess = (sum of min - white) / white`, of a pixel or, where noise asks for it, of a window about it, is by how much too bright the picture under all squares would be.
//! The sum has n^2 terms of which most are dark, each with the noise of its photographs and all with that of the one black
//! photograph that was subtracted: `n^2 - d n` times its deviation is left in the difference, which is nearly all. Pixels whose white
//! does not stand out of that are not judged.
//!
//! **A larger d.** Light over other surfaces that comes evenly from all squares adds `x (n / d - 1) / (1 + x)`, `x` its ratio to direct
//! light, so that the excess at another influence d' is the one seen times `(n / d' - 1) / (n / d - 1)`. That foretells it.

use rayon::prelude::*;

use super::{Position, common};
use crate::image::Image;

/// Pixels to either side of the window, tried in turn until noise is small: 81 of them have a ninth of it.
const AROUND: [usize; 4] = [0, 1, 2, 4];
/// Noise is small when the deviation of the excess is below this.
const SMALL: f64 = 0.03;
/// Pixels are judged where the deviation of their excess is below this.
const JUDGED: f64 = 0.1;
/// Deviations that an excess has to be beyond the threshold.
const SURE: f64 = 2.0;
/// A larger d is enough when it leaves so much of the picture.
const LEFT: f64 = 0.01;

/// How far the recovered squares of a position are too bright, pixel by pixel.
#[derive(Debug, Clone, PartialEq)]
pub struct Reliability {
    width: usize,
    side: usize,
    influence: usize,
    /// NaN where it is not judged.
    excess: Vec<f32>,
    deviation: Vec<f32>,
}

impl Reliability {
    /// What is too bright by less is not worth more photographs: a tenth under even light.
    pub const THRESHOLD: f64 = 0.1;

    pub(super) fn of(position: &Position) -> Self {
        let (width, height) = position.sums[0].size();
        let white = grey(&position.white());
        let over: Vec<f32> = summed(position).iter().zip(&white).map(|(sum, white)| sum - white).collect();
        let scheme = position.scheme;
        // Black's noise is in every term; three channels are summed.
        let terms = (scheme.side * scheme.side - scheme.set()) as f64;
        let noise = terms * position.noise * 3f64.sqrt();
        let mut map = Self {
            width,
            side: scheme.side,
            influence: scheme.influence,
            excess: vec![f32::NAN; white.len()],
            deviation: vec![f32::INFINITY; white.len()],
        };
        for around in AROUND {
            let (over, white) = (window(&over, (width, height), around), window(&white, (width, height), around));
            let noise = noise / (2 * around + 1) as f64;
            let pixels = map.excess.iter_mut().zip(&mut map.deviation).zip(over.iter().zip(&white));
            for ((excess, deviation), (over, white)) in pixels {
                let own = noise / f64::from(*white);
                if *white > 0.0 && own < JUDGED && f64::from(*deviation) > SMALL && own < f64::from(*deviation) {
                    (*excess, *deviation) = (over / white, own as f32);
                }
            }
        }
        map
    }

    /// Excess of a pixel: 0.5 is half too much light under all squares. `None` where nothing is seen but noise.
    pub fn excess(&self, x: usize, y: usize) -> Option<f64> {
        Some(f64::from(self.excess[y * self.width + x])).filter(|excess| !excess.is_nan())
    }

    /// Share of the picture that is judged.
    pub fn judged(&self) -> f64 {
        self.excess.iter().filter(|excess| !excess.is_nan()).count() as f64 / self.excess.len().max(1) as f64
    }

    /// Share of the judged picture whose excess is surely beyond a threshold.
    pub fn affected(&self, threshold: f64) -> f64 {
        self.affected_at(threshold, 1.0)
    }

    fn affected_at(&self, threshold: f64, scale: f64) -> f64 {
        let judged = self.excess.iter().zip(&self.deviation).filter(|(excess, _)| !excess.is_nan());
        let (mut beyond, mut count) = (0usize, 0usize);
        for (excess, deviation) in judged {
            count += 1;
            beyond += usize::from((f64::from(*excess) - SURE * f64::from(*deviation)) * scale > threshold);
        }
        beyond as f64 / count.max(1) as f64
    }

    /// The smallest influence at which hardly anything would be affected, and what would be; `None` where only one square at a time
    /// will do, or takes no more photographs.
    pub fn larger_influence(&self, threshold: f64) -> Option<(usize, f64)> {
        let (n, d) = (self.side as f64, self.influence as f64);
        let left = |larger: usize| self.affected_at(threshold, (n / larger as f64 - 1.0) / (n / d - 1.0));
        // 2 d n photographs against n^2.
        let mut worth = (self.influence + 1..self.side).take_while(|larger| 2 * larger < self.side);
        worth.find_map(|larger| Some((larger, left(larger))).filter(|(_, left)| *left < LEFT))
    }

    /// A picture of it: grey by excess, black 0 and white `full`; blue where it is not judged.
    pub fn picture(&self, full: f64) -> Image {
        Image::from_fn(self.width, self.excess.len() / self.width.max(1), |x, y| match self.excess(x, y) {
            Some(excess) => [(excess / full).clamp(0.0, 1.0) as f32; 3],
            None => [0.0, 0.0, 0.3],
        })
    }

    /// A sentence for the person where more than a hundredth of the picture is affected.
    pub fn remark(&self, name: &str, threshold: f64) -> Option<String> {
        let affected = self.affected(threshold);
        if affected < LEFT {
            return None;
        }
        let advice = match self.larger_influence(threshold) {
            Some((larger, left)) => format!(
                "take --influence {larger}, which would leave about {:.0} %, or brute force for this position (--brute-force)",
                100.0 * left
            ),
            None => {
                "take brute force for this position (--brute-force): no larger influence saves photographs".to_owned()
            }
        };
        Some(format!(
            "{name}: {:.0} % of the picture is more than {:.0} % too bright under all its squares, as light goes there over other \
             surfaces from several of those lit together; {advice}",
            100.0 * affected,
            100.0 * threshold
        ))
    }
}

/// Red, green and blue together.
fn grey(image: &Image) -> Vec<f32> {
    image.data().chunks_exact(3).map(|p| p[0] + p[1] + p[2]).collect()
}

/// The sum of all recovered squares, channels together.
fn summed(position: &Position) -> Vec<f32> {
    let (width, height) = position.sums[0].size();
    let (side, same) = (position.scheme.side, position.same());
    let mut out = vec![0.0f32; width * height];
    out.par_chunks_mut(width.max(1)).enumerate().for_each_init(
        || vec![0.0f32; 3 * width],
        |line, (y, out)| {
            let mut sums = vec![0.0f64; width];
            for row in 0..side {
                line.fill(0.0);
                for column in 0..side {
                    let [h, v] = position.scheme.pair(column, row).map(|n| position.photographs[n].row(y));
                    line.iter_mut().zip(h.iter().zip(v)).for_each(|(sum, (h, v))| *sum += common(*h, *v, same));
                }
                sums.iter_mut().zip(line.chunks_exact(3)).for_each(|(s, p)| *s += f64::from(p[0] + p[1] + p[2]));
            }
            out.iter_mut().zip(sums).for_each(|(out, sum)| *out = sum as f32);
        },
    );
    out
}

/// Means over the window of so many pixels to either side of each; beyond the picture there is nothing.
fn window(values: &[f32], (width, height): (usize, usize), reach: usize) -> Vec<f32> {
    let around = |at: usize, of: usize| at.saturating_sub(reach)..(at + reach + 1).min(of);
    let area = ((2 * reach + 1) * (2 * reach + 1)) as f32;
    let mut lines = vec![0.0f32; values.len()];
    lines.par_chunks_mut(width.max(1)).zip(values.par_chunks(width.max(1))).for_each(|(out, line)| {
        out.iter_mut().enumerate().for_each(|(x, out)| *out = line[around(x, width)].iter().sum());
    });
    let mut means = vec![0.0f32; values.len()];
    means.par_chunks_mut(width.max(1)).enumerate().for_each(|(y, out)| {
        for row in around(y, height) {
            out.iter_mut().zip(&lines[row * width..]).for_each(|(sum, v)| *sum += v);
        }
        out.iter_mut().for_each(|sum| *sum /= area);
    });
    means
}
