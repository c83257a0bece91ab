//! Orthonormal filter banks: Daubechies' D4 and D8 (A.3, A.4; Daubechies 1988, "Orthonormal bases of compactly supported
//! wavelets").
//!
//! `low_i = sum_k h_k x[2i + k]` and `high_i = sum_k g_k x[2i + k]` with `g_k = (-1)^k h_{1-k}` (Daubechies 1992, 5.1.34), which
//! puts both filters over the same place. With even and odd samples apart and h in pairs (a_j, b_j) = (h_2j, h_2j+1):
//!
//! ```text
//! low_i  = sum_j a_j even_(i+j) + b_j odd_(i+j)        even_i = sum_j a_j low_(i-j) + b_j high_(i+j)
//! high_i = sum_j b_j even_(i-j) - a_j odd_(i-j)        odd_i  = sum_j b_j low_(i-j) - a_j high_(i+j)
//! ```
//!
//! Cyclic lines of even length keep this orthonormal, however short. On an odd length the last sample is left out of the
//! bank: it becomes the last low-pass coefficient, times sqrt 2, the gain of a constant signal, so that constants stay
//! constant; this one function then has a norm of 1 / sqrt 2.

use std::f64::consts::SQRT_2;

use super::lifting::{Side, Split};

/// Daubechies 1992, table 6.1, to double precision; the tests check the conditions that define them.
const D8: [f64; 8] = [
    0.230_377_813_308_896_5,
    0.714_846_570_552_915_7,
    0.630_880_767_929_858_9,
    -0.027_983_769_416_859_854,
    -0.187_034_811_719_093_1,
    0.030_841_381_835_560_76,
    0.032_883_011_666_885_2,
    -0.010_597_401_785_069_032,
];

/// A low-pass filter h in pairs of an even and an odd tap; the high-pass one follows.
#[derive(Debug, Clone)]
pub(super) struct Bank {
    pairs: Vec<[f32; 2]>,
}

/// Room for two lines, longer by what the filters reach over their ends.
#[derive(Debug, Default)]
pub(super) struct Extended {
    even: Vec<f32>,
    odd: Vec<f32>,
}

impl Bank {
    /// D4, in closed form.
    pub fn daubechies_4() -> Self {
        let root = 3f64.sqrt();
        Self::of(&[1.0 + root, 3.0 + root, 3.0 - root, 1.0 - root].map(|tap| tap / (4.0 * SQRT_2)))
    }

    /// D8.
    pub fn daubechies_8() -> Self {
        Self::of(&D8)
    }

    fn of(taps: &[f64]) -> Self {
        Self { pairs: taps.chunks(2).map(|pair| [pair[0] as f32, pair[1] as f32]).collect() }
    }

    /// Samples become coefficients: low-pass in `even`, high-pass in `odd`.
    pub fn analyse(&self, line: &mut Split<'_>, room: &mut Extended, side: Side) {
        self.single(line, if side == Side::Dual { SQRT_2.recip() } else { SQRT_2 });
        let (m, length) = (line.m, line.odd.len());
        let reach = self.extend(line, room);
        self.sum(&mut line.even[..length], |j, [a, b]| {
            [(a, &room.even[(reach + j) * m..]), (b, &room.odd[(reach + j) * m..])]
        });
        self.sum(line.odd, |j, [a, b]| [(b, &room.even[(reach - j) * m..]), (-a, &room.odd[(reach - j) * m..])]);
    }

    /// The inverse, which is also the transpose but for the single sample of an odd length.
    pub fn synthesise(&self, line: &mut Split<'_>, room: &mut Extended, side: Side) {
        self.single(line, if side == Side::Dual { SQRT_2 } else { SQRT_2.recip() });
        let (m, length) = (line.m, line.odd.len());
        let reach = self.extend(line, room);
        self.sum(&mut line.even[..length], |j, [a, b]| {
            [(a, &room.even[(reach - j) * m..]), (b, &room.odd[(reach + j) * m..])]
        });
        self.sum(line.odd, |j, [a, b]| [(b, &room.even[(reach - j) * m..]), (-a, &room.odd[(reach + j) * m..])]);
    }

    /// The last sample of an odd length.
    fn single(&self, line: &mut Split<'_>, gain: f64) {
        line.even[line.odd.len()..].iter_mut().for_each(|value| *value *= gain as f32);
    }

    /// Copies both kinds with what comes before and after them; how many samples that is on each side.
    fn extend(&self, line: &Split<'_>, room: &mut Extended) -> usize {
        let (m, length) = (line.m, line.odd.len());
        let (reach, n) = (self.pairs.len() - 1, length / m);
        for (room, line) in [(&mut room.even, &line.even[..length]), (&mut room.odd, &*line.odd)] {
            room.clear();
            // Short lines go round several times.
            (0..reach).for_each(|k| room.extend_from_slice(&line[(k + n * reach - reach) % n * m..][..m]));
            room.extend_from_slice(line);
            (0..reach).for_each(|k| room.extend_from_slice(&line[k % n * m..][..m]));
        }
        reach
    }

    /// The sum over pairs of taps of what two runs give.
    fn sum<'a>(&self, to: &mut [f32], mut runs: impl FnMut(usize, [f32; 2]) -> [(f32, &'a [f32]); 2]) {
        to.fill(0.0);
        for (j, pair) in self.pairs.iter().enumerate() {
            let [(p, first), (q, second)] = runs(j, *pair);
            to.iter_mut().zip(first).zip(second).for_each(|((to, first), second)| *to += p * first + q * second);
        }
    }
}
