//! The loops that must be fast: for one block of 128 pixels, `sum over elements of weight x T`.
//!
//! A block is one contiguous stream, read once; the 128 sums stay in registers (8 of AVX-512; two passes of 8 of AVX2, over
//! the left and the right half of each row of numbers). So the limit is memory bandwidth, not arithmetic. The plain loops
//! are the oracle of the tests and the fallback on any processor.
//!
//! This is the one fenced file of SIMD; all sums are f32, in the order of the elements, whatever the instruction set, and
//! differ between them by the rounding of fused multiply-adds alone.

#![allow(unsafe_code)]

use half::f16;

use crate::field::{BLOCK_PIXELS, Block};

/// Sums of one block.
pub type Sums = [f32; BLOCK_PIXELS];

/// An instruction set that this processor has: there is no other way to get one than by asking.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Isa(Kind);

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Plain,
    /// AVX2, FMA and F16C.
    #[cfg(target_arch = "x86_64")]
    Avx2,
    /// AVX-512F.
    #[cfg(target_arch = "x86_64")]
    Avx512,
}

impl Isa {
    /// The best that this processor has.
    pub fn detect() -> Self {
        Self::available().pop().unwrap_or(Self(Kind::Plain))
    }

    /// All that this processor has, the plain one first, the best last.
    pub fn available() -> Vec<Self> {
        let mut kinds = vec![Kind::Plain];
        #[cfg(target_arch = "x86_64")]
        {
            if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") && is_x86_feature_detected!("f16c") {
                kinds.push(Kind::Avx2);
            }
            if is_x86_feature_detected!("avx512f") {
                kinds.push(Kind::Avx512);
            }
        }
        kinds.into_iter().map(Self).collect()
    }
}

/// Sums of a block under one set of weights.
///
/// # Panics
/// When the block does not hold 128 numbers a weight.
pub fn block_sums(isa: Isa, block: Block<'_>, weights: &[f32]) -> Sums {
    let numbers = match block {
        Block::Half(t) => t.len(),
        Block::Float(t) => t.len(),
    };
    assert_eq!(numbers, weights.len() * BLOCK_PIXELS, "128 numbers a weight");
    match (isa.0, block) {
        #[cfg(target_arch = "x86_64")]
        // SAFETY: an `Isa` only comes from `available`, so the processor has the features; the lengths were
        // checked above, and the loops read exactly `weights.len() * 128` numbers.
        (Kind::Avx512, Block::Half(t)) => unsafe { avx512::half(t, weights) },
        #[cfg(target_arch = "x86_64")]
        // SAFETY: as above.
        (Kind::Avx2, Block::Half(t)) => unsafe { avx2::half(t, weights) },
        // Floats vectorise well without help; wider code is used where the processor has it.
        #[cfg(target_arch = "x86_64")]
        // SAFETY: as above.
        (Kind::Avx512, Block::Float(t)) => unsafe { avx512::float(t, weights) },
        #[cfg(target_arch = "x86_64")]
        // SAFETY: as above.
        (Kind::Avx2, Block::Float(t)) => unsafe { avx2::float(t, weights) },
        (_, Block::Half(t)) => plain_half(t, weights),
        (_, Block::Float(t)) => plain_float(t, weights),
    }
}

/// Illuminations that share a pass over an expanded block.
pub const TOGETHER: usize = 4;

/// Sums of an expanded block under [`TOGETHER`] sets of weights: each number is loaded once for all of them.
///
/// # Panics
/// When the block does not hold 128 numbers a weight.
pub fn block_sums_together(isa: Isa, floats: &[f32], weights: [&[f32]; TOGETHER]) -> [Sums; TOGETHER] {
    assert!(weights.iter().all(|w| floats.len() == w.len() * BLOCK_PIXELS), "128 numbers a weight");
    match isa.0 {
        #[cfg(target_arch = "x86_64")]
        // SAFETY: an `Isa` only comes from `available`; the lengths were checked above.
        Kind::Avx512 => unsafe { avx512::together(floats, weights) },
        _ => weights.map(|w| block_sums(isa, Block::Float(floats), w)),
    }
}

/// Expands a block to floats, for use under several sets of weights.
pub fn expand(isa: Isa, block: Block<'_>, out: &mut Vec<f32>) {
    match (isa.0, block) {
        #[cfg(target_arch = "x86_64")]
        (Kind::Avx512, Block::Half(t)) => {
            out.resize(t.len(), 0.0);
            // SAFETY: an `Isa` only comes from `available`; `out` is as long as `t`.
            unsafe { avx512::expand(t, out) }
        }
        _ => block.expand(out),
    }
}

/// The plain loop over halves: the oracle.
pub fn plain_half(t: &[f16], weights: &[f32]) -> Sums {
    let mut sums = [0.0; BLOCK_PIXELS];
    for (element, &weight) in t.chunks_exact(BLOCK_PIXELS).zip(weights) {
        for (sum, number) in sums.iter_mut().zip(element) {
            *sum += weight * number.to_f32();
        }
    }
    sums
}

/// The plain loop over floats: the oracle.
pub fn plain_float(t: &[f32], weights: &[f32]) -> Sums {
    let mut sums = [0.0; BLOCK_PIXELS];
    for (element, &weight) in t.chunks_exact(BLOCK_PIXELS).zip(weights) {
        for (sum, number) in sums.iter_mut().zip(element) {
            *sum += weight * number;
        }
    }
    sums
}

/// `sum a_i b_i`.
///
/// # Panics
/// When the two are not of one length.
pub fn dot(isa: Isa, a: &[f32], b: &[f32]) -> f32 {
    assert_eq!(a.len(), b.len(), "two vectors of one length");
    match isa.0 {
        #[cfg(target_arch = "x86_64")]
        // SAFETY: an `Isa` only comes from `available`, so the processor has the features.
        Kind::Avx512 => unsafe { avx512::dot(a, b) },
        #[cfg(target_arch = "x86_64")]
        // SAFETY: as above.
        Kind::Avx2 => unsafe { avx2::dot(a, b) },
        Kind::Plain => partial_sums(a, b, |a, b, sum| sum + a * b),
    }
}

/// Sums that [`dot`] runs side by side: four registers of AVX-512 or eight of AVX2, which hide the latency of their additions.
const SIDE_BY_SIDE: usize = 64;

/// [`dot`], its sums in the same order whatever the instruction set; compiled again for each.
#[inline(always)]
fn partial_sums(a: &[f32], b: &[f32], multiply_add: impl Fn(f32, f32, f32) -> f32) -> f32 {
    let mut sums = [0.0f32; SIDE_BY_SIDE];
    let ((a, rest_a), (b, rest_b)) = (a.as_chunks::<SIDE_BY_SIDE>(), b.as_chunks::<SIDE_BY_SIDE>());
    for (a, b) in a.iter().zip(b) {
        for k in 0..SIDE_BY_SIDE {
            sums[k] = multiply_add(a[k], b[k], sums[k]);
        }
    }
    for ((sum, a), b) in sums.iter_mut().zip(rest_a).zip(rest_b) {
        *sum = multiply_add(*a, *b, *sum);
    }
    total(sums)
}

/// The sum of sums, by halves.
#[inline(always)]
fn total(mut sums: [f32; SIDE_BY_SIDE]) -> f32 {
    let mut half = SIDE_BY_SIDE / 2;
    while half > 0 {
        (0..half).for_each(|k| sums[k] += sums[k + half]);
        half /= 2;
    }
    sums[0]
}

/// [`dot`] of one row of halves with three vectors, each the same bits as alone; `room` is for the row as floats.
///
/// # Panics
/// When they are not of one length.
pub fn dots(isa: Isa, row: &[f16], vectors: [&[f32]; 3], room: &mut Vec<f32>) -> [f32; 3] {
    assert!(vectors.iter().all(|v| v.len() == row.len()), "vectors of one length");
    match isa.0 {
        #[cfg(target_arch = "x86_64")]
        // SAFETY: an `Isa` only comes from `available`; the lengths were checked above.
        Kind::Avx512 => unsafe { avx512::dots(row, vectors) },
        _ => {
            expand(isa, Block::Half(row), room);
            vectors.map(|v| dot(isa, room, v))
        }
    }
}

/// How many bytes ahead of its use a line is asked for: some 4 KiB covers DRAM latency at 10 to 20 GB/s a core.
#[cfg(target_arch = "x86_64")]
const PREFETCH_BYTES: usize = 4096;

#[cfg(target_arch = "x86_64")]
mod avx512 {
    use std::arch::x86_64::*;

    use half::f16;

    use super::{BLOCK_PIXELS, PREFETCH_BYTES, SIDE_BY_SIDE, Sums, TOGETHER, partial_sums, total};

    const LANES: usize = 16;
    /// Registers for the sums of a dot.
    const DOT_REGISTERS: usize = SIDE_BY_SIDE / LANES;
    const REGISTERS: usize = BLOCK_PIXELS / LANES;
    /// Two passes of half a block: 4 illuminations x 4 sums are 16 of the 32 registers.
    const HALF_REGISTERS: usize = REGISTERS / 2;

    /// # Safety
    /// The processor has AVX-512F; `t` holds 128 numbers a weight.
    #[target_feature(enable = "avx512f")]
    pub unsafe fn half(t: &[f16], weights: &[f32]) -> Sums {
        let mut acc = [_mm512_setzero_ps(); REGISTERS];
        let mut at = t.as_ptr().cast::<u8>();
        for &weight in weights {
            let w = _mm512_set1_ps(weight);
            for line in 0..4 {
                _mm_prefetch::<_MM_HINT_T0>(at.wrapping_add(PREFETCH_BYTES + line * 64).cast());
            }
            for (k, sum) in acc.iter_mut().enumerate() {
                // SAFETY: element `n` holds 128 halves = 256 bytes from `at`; k < 8, 32 bytes each.
                let halves = unsafe { _mm256_loadu_si256(at.add(k * 32).cast()) };
                *sum = _mm512_fmadd_ps(_mm512_cvtph_ps(halves), w, *sum);
            }
            at = at.wrapping_add(BLOCK_PIXELS * 2);
        }
        let mut sums = [0.0; BLOCK_PIXELS];
        store(&acc, &mut sums);
        sums
    }

    /// # Safety
    /// As [`half`].
    #[target_feature(enable = "avx512f")]
    pub unsafe fn float(t: &[f32], weights: &[f32]) -> Sums {
        let mut acc = [_mm512_setzero_ps(); REGISTERS];
        let mut at = t.as_ptr();
        for &weight in weights {
            let w = _mm512_set1_ps(weight);
            for line in 0..8 {
                _mm_prefetch::<_MM_HINT_T0>(at.wrapping_byte_add(PREFETCH_BYTES + line * 64).cast());
            }
            for (k, sum) in acc.iter_mut().enumerate() {
                // SAFETY: element `n` holds 128 floats from `at`; k < 8, 16 floats each.
                let numbers = unsafe { _mm512_loadu_ps(at.add(k * LANES)) };
                *sum = _mm512_fmadd_ps(numbers, w, *sum);
            }
            at = at.wrapping_add(BLOCK_PIXELS);
        }
        let mut sums = [0.0; BLOCK_PIXELS];
        store(&acc, &mut sums);
        sums
    }

    /// # Safety
    /// The processor has AVX-512F; `out` is as long as `t`.
    #[target_feature(enable = "avx512f")]
    pub unsafe fn expand(t: &[f16], out: &mut [f32]) {
        let (halves, rest) = t.as_chunks::<LANES>();
        let (floats, rest_out) = out.as_chunks_mut::<LANES>();
        for (halves, floats) in halves.iter().zip(floats) {
            _mm_prefetch::<_MM_HINT_T0>(halves.as_ptr().wrapping_byte_add(PREFETCH_BYTES).cast());
            // SAFETY: 16 halves are 32 bytes, 16 floats are 64.
            unsafe {
                let numbers = _mm512_cvtph_ps(_mm256_loadu_si256(halves.as_ptr().cast()));
                _mm512_storeu_ps(floats.as_mut_ptr(), numbers);
            }
        }
        rest.iter().zip(rest_out).for_each(|(half, float)| *float = half.to_f32());
    }

    /// # Safety
    /// As [`half`], for every set of weights. No prefetching: the block was just expanded and lies in cache.
    #[target_feature(enable = "avx512f")]
    pub unsafe fn together(t: &[f32], weights: [&[f32]; TOGETHER]) -> [Sums; TOGETHER] {
        let mut sums = [[0.0; BLOCK_PIXELS]; TOGETHER];
        for pass in 0..2 {
            let first = pass * HALF_REGISTERS * LANES;
            let mut acc = [[_mm512_setzero_ps(); HALF_REGISTERS]; TOGETHER];
            let mut at = t.as_ptr().wrapping_add(first);
            for element in 0..weights[0].len() {
                // SAFETY: from `at` this element has at least 64 floats; k < 4, 16 each.
                let numbers: [__m512; HALF_REGISTERS] =
                    std::array::from_fn(|k| unsafe { _mm512_loadu_ps(at.wrapping_add(k * LANES)) });
                for (acc, weights) in acc.iter_mut().zip(&weights) {
                    let w = _mm512_set1_ps(weights[element]);
                    for (sum, number) in acc.iter_mut().zip(numbers) {
                        *sum = _mm512_fmadd_ps(number, w, *sum);
                    }
                }
                at = at.wrapping_add(BLOCK_PIXELS);
            }
            for (sums, acc) in sums.iter_mut().zip(&acc) {
                store(acc, &mut sums[first..]);
            }
        }
        sums
    }

    #[target_feature(enable = "avx512f")]
    pub fn dot(a: &[f32], b: &[f32]) -> f32 {
        partial_sums(a, b, f32::mul_add)
    }

    /// # Safety
    /// The processor has AVX-512F; the vectors are as long as the row.
    #[target_feature(enable = "avx512f")]
    pub unsafe fn dots(row: &[f16], vectors: [&[f32]; 3]) -> [f32; 3] {
        let mut acc = [[_mm512_setzero_ps(); DOT_REGISTERS]; 3];
        let (whole, rest) = row.as_chunks::<SIDE_BY_SIDE>();
        for (n, chunk) in whole.iter().enumerate() {
            for line in 0..2 {
                _mm_prefetch::<_MM_HINT_T0>(chunk.as_ptr().wrapping_byte_add(PREFETCH_BYTES + line * 64).cast());
            }
            for k in 0..DOT_REGISTERS {
                // SAFETY: k < 4, 16 halves each of the 64 in the chunk; the vectors are as long as the row.
                unsafe {
                    let halves = _mm256_loadu_si256(chunk.as_ptr().add(k * LANES).cast());
                    let numbers = _mm512_cvtph_ps(halves);
                    for (acc, vector) in acc.iter_mut().zip(&vectors) {
                        let others = _mm512_loadu_ps(vector.as_ptr().add(n * SIDE_BY_SIDE + k * LANES));
                        acc[k] = _mm512_fmadd_ps(numbers, others, acc[k]);
                    }
                }
            }
        }
        let mut answers = [0.0; 3];
        for ((answer, acc), vector) in answers.iter_mut().zip(&acc).zip(vectors) {
            let mut sums = [0.0; SIDE_BY_SIDE];
            store(acc, &mut sums);
            for ((sum, half), other) in sums.iter_mut().zip(rest).zip(&vector[whole.len() * SIDE_BY_SIDE..]) {
                *sum = half.to_f32().mul_add(*other, *sum);
            }
            *answer = total(sums);
        }
        answers
    }

    #[target_feature(enable = "avx512f")]
    fn store(acc: &[__m512], out: &mut [f32]) {
        for (out, register) in out.chunks_exact_mut(LANES).zip(acc) {
            // SAFETY: `out` has room for 16 floats.
            unsafe { _mm512_storeu_ps(out.as_mut_ptr(), *register) };
        }
    }
}

#[cfg(target_arch = "x86_64")]
mod avx2 {
    use std::arch::x86_64::*;

    use half::f16;

    use super::{BLOCK_PIXELS, PREFETCH_BYTES, Sums, partial_sums};

    const LANES: usize = 8;
    /// Eight of sixteen registers: the other eight hold what is being loaded and converted.
    const REGISTERS: usize = 8;
    const PASS_PIXELS: usize = LANES * REGISTERS;

    /// # Safety
    /// The processor has AVX2, FMA and F16C; `t` holds 128 numbers a weight.
    #[target_feature(enable = "avx2,fma,f16c")]
    pub unsafe fn half(t: &[f16], weights: &[f32]) -> Sums {
        let mut sums = [0.0; BLOCK_PIXELS];
        for (pass, out) in sums.chunks_exact_mut(PASS_PIXELS).enumerate() {
            let mut acc = [_mm256_setzero_ps(); REGISTERS];
            let mut at = t.as_ptr().wrapping_add(pass * PASS_PIXELS);
            for &weight in weights {
                let w = _mm256_set1_ps(weight);
                _mm_prefetch::<_MM_HINT_T0>(at.wrapping_byte_add(PREFETCH_BYTES).cast());
                _mm_prefetch::<_MM_HINT_T0>(at.wrapping_byte_add(PREFETCH_BYTES + 64).cast());
                for (k, sum) in acc.iter_mut().enumerate() {
                    // SAFETY: from `at` this element has at least 64 halves; k < 8, 8 each.
                    let halves = unsafe { _mm_loadu_si128(at.add(k * LANES).cast()) };
                    *sum = _mm256_fmadd_ps(_mm256_cvtph_ps(halves), w, *sum);
                }
                at = at.wrapping_add(BLOCK_PIXELS);
            }
            store(&acc, out);
        }
        sums
    }

    /// # Safety
    /// As [`half`].
    #[target_feature(enable = "avx2,fma")]
    pub unsafe fn float(t: &[f32], weights: &[f32]) -> Sums {
        let mut sums = [0.0; BLOCK_PIXELS];
        for (pass, out) in sums.chunks_exact_mut(PASS_PIXELS).enumerate() {
            let mut acc = [_mm256_setzero_ps(); REGISTERS];
            let mut at = t.as_ptr().wrapping_add(pass * PASS_PIXELS);
            for &weight in weights {
                let w = _mm256_set1_ps(weight);
                for line in 0..4 {
                    _mm_prefetch::<_MM_HINT_T0>(at.wrapping_byte_add(PREFETCH_BYTES + line * 64).cast());
                }
                for (k, sum) in acc.iter_mut().enumerate() {
                    // SAFETY: from `at` this element has at least 64 floats; k < 8, 8 each.
                    let numbers = unsafe { _mm256_loadu_ps(at.add(k * LANES)) };
                    *sum = _mm256_fmadd_ps(numbers, w, *sum);
                }
                at = at.wrapping_add(BLOCK_PIXELS);
            }
            store(&acc, out);
        }
        sums
    }

    #[target_feature(enable = "avx2,fma")]
    pub fn dot(a: &[f32], b: &[f32]) -> f32 {
        partial_sums(a, b, f32::mul_add)
    }

    #[target_feature(enable = "avx2")]
    fn store(acc: &[__m256; REGISTERS], out: &mut [f32]) {
        for (out, register) in out.chunks_exact_mut(LANES).zip(acc) {
            // SAFETY: `out` has room for 8 floats.
            unsafe { _mm256_storeu_ps(out.as_mut_ptr(), *register) };
        }
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};

    use super::*;

    #[test]
    fn every_instruction_set_agrees_with_the_plain_loop() {
        let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(1);
        for elements in [0, 1, 2, 7, 253] {
            let weights: Vec<f32> = (0..elements).map(|_| rng.random_range(-1.0..1.0)).collect();
            let floats: Vec<f32> = (0..elements * BLOCK_PIXELS).map(|_| rng.random_range(-4.0..4.0)).collect();
            let halves: Vec<f16> = floats.iter().map(|&v| f16::from_f32(v)).collect();
            for isa in Isa::available() {
                let pairs = [
                    (block_sums(isa, Block::Half(&halves), &weights), plain_half(&halves, &weights)),
                    (block_sums(isa, Block::Float(&floats), &weights), plain_float(&floats, &weights)),
                ];
                for (fast, plain) in pairs {
                    for (a, b) in fast.iter().zip(&plain) {
                        // 253 roundings of numbers up to 4, of either sign.
                        assert!((a - b).abs() <= 2e-4, "{isa:?}, {elements} elements: {a} against {b}");
                    }
                }
                let sets: [Vec<f32>; TOGETHER] =
                    std::array::from_fn(|n| weights.iter().map(|w| w * (n as f32 - 1.5)).collect());
                let together = block_sums_together(isa, &floats, sets.each_ref().map(Vec::as_slice));
                for (sums, weights) in together.iter().zip(&sets) {
                    let plain = plain_float(&floats, weights);
                    assert!(
                        sums.iter().zip(&plain).all(|(a, b)| (a - b).abs() <= 4e-4),
                        "{isa:?}, {elements} elements"
                    );
                }
            }
        }
    }

    #[test]
    fn dots_agree_with_the_plain_loop() {
        let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(4);
        for length in [0, 1, 63, 64, 72, 253, 1280] {
            let mut numbers = || (0..length).map(|_| rng.random_range(-1.0f32..1.0)).collect::<Vec<f32>>();
            let (a, b) = (numbers(), numbers());
            let exact: f64 = a.iter().zip(&b).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum();
            for isa in Isa::available() {
                let sum = f64::from(dot(isa, &a, &b));
                assert!((sum - exact).abs() < 1e-5, "{isa:?}, {length} numbers: {sum} against {exact}");
                let (row, mut room) = (a.iter().map(|&v| f16::from_f32(v)).collect::<Vec<f16>>(), Vec::new());
                let expanded: Vec<f32> = row.iter().map(|v| v.to_f32()).collect();
                let three = dots(isa, &row, [&b, &a, &expanded], &mut room);
                assert_eq!(three, [&b, &a, &expanded].map(|v| dot(isa, &expanded, v)), "{isa:?}, {length} numbers");
            }
        }
    }

    /// A frame must have the same bytes alone and among others: the same roundings in the same order.
    #[test]
    fn company_changes_no_bit() {
        let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(2);
        let weights: Vec<f32> = (0..131).map(|_| rng.random_range(-1.0..1.0)).collect();
        let halves: Vec<f16> = (0..131 * BLOCK_PIXELS).map(|_| f16::from_f32(rng.random_range(-4.0..4.0))).collect();
        let others = vec![0.5; 131];
        for isa in Isa::available() {
            let (alone, mut floats) = (block_sums(isa, Block::Half(&halves), &weights), Vec::new());
            expand(isa, Block::Half(&halves), &mut floats);
            assert_eq!(block_sums(isa, Block::Float(&floats), &weights), alone, "{isa:?}");
            let together = block_sums_together(isa, &floats, [&others, &others, &weights, &others]);
            assert_eq!(together[2], alone, "{isa:?}");
        }
    }

    #[test]
    fn every_half_expands_exactly() {
        let halves: Vec<f16> = (0..=u16::MAX).map(f16::from_bits).collect();
        for isa in Isa::available() {
            let mut floats = Vec::new();
            expand(isa, Block::Half(&halves[..halves.len() - 5]), &mut floats);
            assert_eq!(floats.len(), halves.len() - 5);
            let same = |h: &f16, f: &f32| h.to_f32().to_bits() == f.to_bits() || h.is_nan() && f.is_nan();
            assert!(halves.iter().zip(&floats).all(|(h, f)| same(h, f)), "{isa:?}");
        }
    }
}
