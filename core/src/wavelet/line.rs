//! One level along one axis of an array of many functions.
//!
//! Numbers that lie side by side go through the same filter: lanes along x, lanes of a whole row along y. So a strip of
//! lines is copied into a small room with even and odd samples apart, filtered there in long plain loops that vectorise
//! whatever the number of lanes, and copied back as low-pass then high-pass coefficients.

use std::f64::consts::SQRT_2;

use super::Wavelet;
use super::bank::{Bank, Extended};
use super::extension::{Edge, halves};
use super::lifting::{Lifting, Side, Split};
use super::transform::Normalisation;

/// The room of a strip stays within half of a small first-level cache (32 KB).
const ROOM: usize = (16 << 10) / size_of::<f32>();
/// A cache line: strips are no narrower, where functions allow.
const NARROWEST: usize = 64 / size_of::<f32>();

#[derive(Debug, Clone)]
enum Kernel {
    Lifting(Lifting),
    Bank(Bank),
}

/// The filters of one level, in one normalisation.
#[derive(Debug, Clone)]
pub(super) struct Filter {
    kernel: Kernel,
    /// What multiplies low-pass and high-pass coefficients at the end of A.
    gains: [f64; 2],
}

/// Lines to filter: where their samples lie in an array.
#[derive(Debug, Clone, Copy)]
pub(super) struct Axis {
    /// Samples of a line.
    pub length: usize,
    /// Numbers from one sample to the next.
    pub stride: usize,
    /// Numbers side by side at each sample, each of another line.
    pub width: usize,
    /// How often all of this comes,
    pub repeats: usize,
    /// and how many numbers apart.
    pub repeat_stride: usize,
    pub edge: Edge,
}

/// Memory to work in.
#[derive(Debug, Default)]
pub(super) struct Room {
    even: Vec<f32>,
    odd: Vec<f32>,
    extended: Extended,
}

impl Filter {
    pub fn new(wavelet: Wavelet, normalisation: Normalisation) -> Self {
        // What their gains are without ours: one for lifting, sqrt 2 for orthonormal banks.
        let lifted = |lifting: Lifting| (lifting.gains, 1.0, Kernel::Lifting(lifting));
        let banked = |bank| ([1.0, 1.0], SQRT_2, Kernel::Bank(bank));
        let (gains, present, kernel) = match wavelet {
            Wavelet::Haar => lifted(Lifting::haar()),
            Wavelet::LeGall53 => lifted(Lifting::le_gall_53()),
            Wavelet::Daubechies97 => lifted(Lifting::daubechies_97()),
            Wavelet::Daubechies4 => banked(Bank::daubechies_4()),
            Wavelet::Daubechies8 => banked(Bank::daubechies_8()),
        };
        let wanted = match normalisation {
            Normalisation::Energy => SQRT_2,
            Normalisation::Amplitude => 1.0,
        };
        Self { kernel, gains: gains.map(|gain| gain * wanted / present) }
    }

    /// Samples become coefficients, low-pass ones first: A, or `S^T`. A line of one sample is left alone.
    pub fn analyse(&self, data: &mut [f32], axis: &Axis, side: Side, room: &mut Room) {
        let gains = self.gains.map(|gain| if side == Side::Dual { gain.recip() } else { gain } as f32);
        let (low, high) = axis.coefficients();
        let (even, odd) = axis.samples();
        axis.strips(data, room, |strip, room, m| {
            even.gather(strip, &mut room.even, m, 1.0);
            odd.gather(strip, &mut room.odd, m, 1.0);
            let line = &mut Split { even: &mut room.even, odd: &mut room.odd, m };
            match &self.kernel {
                Kernel::Lifting(lifting) => lifting.analyse(line, axis.edge, side),
                Kernel::Bank(bank) => bank.analyse(line, &mut room.extended, side),
            }
            low.scatter(strip, &room.even, m, gains[0]);
            high.scatter(strip, &room.odd, m, gains[1]);
        });
    }

    /// Coefficients become samples: S, or `A^T`.
    pub fn synthesise(&self, data: &mut [f32], axis: &Axis, side: Side, room: &mut Room) {
        let gains = self.gains.map(|gain| if side == Side::Dual { gain } else { gain.recip() } as f32);
        let (low, high) = axis.coefficients();
        let (even, odd) = axis.samples();
        axis.strips(data, room, |strip, room, m| {
            low.gather(strip, &mut room.even, m, gains[0]);
            high.gather(strip, &mut room.odd, m, gains[1]);
            let line = &mut Split { even: &mut room.even, odd: &mut room.odd, m };
            match &self.kernel {
                Kernel::Lifting(lifting) => lifting.synthesise(line, axis.edge, side),
                Kernel::Bank(bank) => bank.synthesise(line, &mut room.extended, side),
            }
            even.scatter(strip, &room.even, m, 1.0);
            odd.scatter(strip, &room.odd, m, 1.0);
        });
    }
}

/// Some samples of a strip: the first, how many, and how far apart, in numbers.
#[derive(Debug, Clone, Copy)]
struct Comb {
    start: usize,
    count: usize,
    stride: usize,
}

impl Axis {
    /// Even and odd samples.
    fn samples(&self) -> (Comb, Comb) {
        let (evens, odds) = halves(self.length);
        let comb = |start, count| Comb { start, count, stride: 2 * self.stride };
        (comb(0, evens), comb(self.stride, odds))
    }

    /// Low-pass and high-pass coefficients.
    fn coefficients(&self) -> (Comb, Comb) {
        let (lows, highs) = halves(self.length);
        let comb = |start, count| Comb { start, count, stride: self.stride };
        (comb(0, lows), comb(lows * self.stride, highs))
    }

    /// All lines, a strip after another, each as what of the array begins with it and the width of the strip.
    fn strips(&self, data: &mut [f32], room: &mut Room, mut work: impl FnMut(&mut [f32], &mut Room, usize)) {
        if self.length < 2 {
            return;
        }
        let widest = (ROOM / self.length / NARROWEST * NARROWEST).max(NARROWEST);
        for repeat in 0..self.repeats {
            for start in (0..self.width).step_by(widest) {
                let strip = &mut data[repeat * self.repeat_stride + start..];
                work(strip, room, widest.min(self.width - start));
            }
        }
    }
}

impl Comb {
    /// Samples of a strip, `m` numbers each, times a gain, one after another.
    fn gather(&self, strip: &[f32], to: &mut Vec<f32>, m: usize, gain: f32) {
        to.resize(self.count * m, 0.0);
        copy(&strip[self.start..], self.stride, to, m, m, gain);
    }

    /// The way back.
    fn scatter(&self, strip: &mut [f32], from: &[f32], m: usize, gain: f32) {
        copy(from, m, &mut strip[self.start..], self.stride, m, gain);
    }
}

/// Runs of `m` numbers, times a gain, from and to places some numbers apart.
fn copy(from: &[f32], from_stride: usize, to: &mut [f32], to_stride: usize, m: usize, gain: f32) {
    if from_stride == m && to_stride == m {
        return scale(from, to, gain);
    }
    match m {
        // One function alone, and the width that is meant to be fast: without a loop of unknown length inside.
        1 => copy_fixed::<1>(from, from_stride, to, to_stride, gain),
        NARROWEST => copy_fixed::<NARROWEST>(from, from_stride, to, to_stride, gain),
        _ => to.chunks_mut(to_stride).zip(from.chunks(from_stride)).for_each(|(to, from)| {
            let m = m.min(to.len()).min(from.len());
            scale(&from[..m], &mut to[..m], gain);
        }),
    }
}

fn copy_fixed<const M: usize>(from: &[f32], from_stride: usize, to: &mut [f32], to_stride: usize, gain: f32) {
    for (to, from) in to.chunks_mut(to_stride).zip(from.chunks(from_stride)) {
        if let (Some(to), Some(from)) = (to.first_chunk_mut::<M>(), from.first_chunk::<M>()) {
            *to = from.map(|value| value * gain);
        }
    }
}

fn scale(from: &[f32], to: &mut [f32], gain: f32) {
    to.iter_mut().zip(from).for_each(|(to, from)| *to = from * gain);
}
