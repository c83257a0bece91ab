//! Scaling functions of the synthesis side: what one scaling coefficient adds to the signal.

use super::Wavelet;
use crate::error::{Error, Result};

/// Refinements of the table: 2^8 values from one sample to the next, between which it is linear.
const LEVELS: usize = 8;
const STEPS: usize = 1 << LEVELS;

/// Synthesis low-pass of the 9/7, from its middle outwards, in the normalisation where the taps sum to 2 and a constant
/// signal has constant coefficients (Cohen, Daubechies, Feauveau 1992, table 6.2; JPEG 2000, annex F).
const LOW_97: [f64; 4] = [1.115087052456994, 0.591_271_763_114_247, -0.057543526228500, -0.091271763114250];

/// `phi(x)`, one sample a unit: `sum_k phi(x - k) = 1` for every x. Even.
#[derive(Debug, Clone)]
pub struct Scaling(Shape);

#[derive(Debug, Clone)]
enum Shape {
    /// Haar.
    Box,
    /// 5/3.
    Tent,
    /// 9/7: `phi(k / STEPS)` from 0 on.
    Table(Vec<f64>),
}

impl Scaling {
    /// The scaling function of a wavelet.
    ///
    /// # Errors
    /// D4 and D8, whose scaling functions are not symmetric about a sample.
    pub fn new(wavelet: Wavelet) -> Result<Self> {
        Ok(Self(match wavelet {
            Wavelet::Haar => Shape::Box,
            Wavelet::LeGall53 => Shape::Tent,
            Wavelet::Daubechies97 => Shape::Table(cascade()),
            Wavelet::Daubechies4 | Wavelet::Daubechies8 => {
                return Err(Error::Unsupported {
                    place: "wavelet interpolation".to_owned(),
                    what: format!("the wavelet `{}`, which is not symmetric,", wavelet.id()),
                    advice: "use haar, 5/3 or 9/7".to_owned(),
                });
            }
        }))
    }

    /// `phi` is zero at this distance and beyond, or, for Haar, beyond half of it.
    pub fn reach(&self) -> i64 {
        match self.0 {
            Shape::Box | Shape::Tent => 1,
            Shape::Table(_) => 3,
        }
    }

    /// `phi(x)`. Haar is one on [-1/2, 1/2).
    pub fn at(&self, x: f64) -> f64 {
        match &self.0 {
            Shape::Box => f64::from(u8::from((-0.5..0.5).contains(&x))),
            Shape::Tent => (1.0 - x.abs()).max(0.0),
            Shape::Table(table) => {
                let at = x.abs() * STEPS as f64;
                let k = at as usize;
                let value = |k: usize| table.get(k).copied().unwrap_or(0.0);
                value(k) + (at - k as f64) * (value(k + 1) - value(k))
            }
        }
    }
}

/// The cascade algorithm: one scaling coefficient, synthesised [`LEVELS`] times with zero wavelet coefficients. The even and
/// the odd taps each sum to one, so at every level the shifted copies sum to one exactly.
fn cascade() -> Vec<f64> {
    let mut signal = vec![1.0];
    // The index of the middle.
    let mut middle = 0;
    for _ in 0..LEVELS {
        let reach = LOW_97.len() - 1;
        let mut finer = vec![0.0; 2 * signal.len() - 1 + 2 * reach];
        for (n, value) in signal.iter().enumerate() {
            for offset in 0..=2 * reach {
                finer[2 * n + offset] += value * LOW_97[offset.abs_diff(reach)];
            }
        }
        signal = finer;
        middle = 2 * middle + reach;
    }
    signal.split_off(middle)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shifted_copies_sum_to_one_and_reach_no_farther() {
        for wavelet in [Wavelet::Haar, Wavelet::LeGall53, Wavelet::Daubechies97] {
            let phi = Scaling::new(wavelet).unwrap();
            for n in 0..1000 {
                let x = f64::from(n) / 997.0;
                let sum: f64 = (-4..=4).map(|k| phi.at(x - f64::from(k))).sum();
                assert!((sum - 1.0).abs() < 1e-12, "{wavelet:?} at {x}: {sum}");
            }
            assert_eq!(phi.at(phi.reach() as f64), 0.0);
        }
    }

    /// The two-scale relation `phi(x) = sum_k h_k phi(2 x - k)` holds for the limit, and to 1e-3 for the table.
    #[test]
    fn the_table_refines_itself() {
        let phi = Scaling::new(Wavelet::Daubechies97).unwrap();
        for n in -300..300 {
            let x = f64::from(n) / 100.0;
            let refined: f64 =
                (-3i32..=3).map(|k| LOW_97[k.unsigned_abs() as usize] * phi.at(2.0 * x - f64::from(k))).sum();
            assert!((phi.at(x) - refined).abs() < 4e-3, "{} against {refined} at {x}", phi.at(x));
        }
    }
}
