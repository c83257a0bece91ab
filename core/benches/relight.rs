//! How fast relighting streams a field, against what the machine's memory can do in the same run.
//!
//! `cargo bench -p relume-core` makes fields in a temporary folder (`RELUME_BENCH_DIR` or the system's; the largest takes
//! 3.2 GB), maps them, and prints for each size:
//!
//! - `read limit`: all threads only read the same mapped bytes, in the fastest of several ways (prefetch distances);
//! - `relight`: one illumination, as GB/s of field read, and its ratio to that limit. The two take turns and both are medians,
//!   so that a machine whose speed drifts disturbs both alike;
//! - `matrix-vector`: the same product in f32, matrix in memory, by nalgebra on all threads, for the same field;
//! - `N at once`: several illuminations in one pass, as time per picture against one alone.
//!
//! Arguments: a part of a case's name runs that case alone.

#![allow(clippy::print_stdout, missing_docs)]

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::time::Instant;

use rayon::prelude::*;
use relume_core::Result;
use relume_core::domain::Directions;
use relume_core::field::{Access, Asset, Bands, Block, BlockBuffer, Contents, Dense, Precision, Samples, write};
use relume_core::image::Window;
use relume_core::math::Vec3;
use relume_core::relight::{Weights, apply};

/// Runs of each; medians count.
const RUNS: usize = 11;
/// Prefetch distances tried for the read limit, bytes.
const AHEAD: [usize; 4] = [0, 1024, 4096, 8192];

struct Case {
    name: &'static str,
    elements: usize,
    width: usize,
    height: usize,
    precision: Precision,
}

const CASES: [Case; 4] = [
    Case { name: "253-hd-half", elements: 253, width: 1920, height: 1080, precision: Precision::Half },
    Case { name: "253-quarter-half", elements: 253, width: 960, height: 540, precision: Precision::Half },
    Case { name: "253-quarter-float", elements: 253, width: 960, height: 540, precision: Precision::Float },
    Case { name: "1280-vga-half", elements: 1280, width: 640, height: 480, precision: Precision::Half },
];

fn main() -> Result<()> {
    let wanted: Vec<String> = std::env::args().skip(1).filter(|arg| !arg.starts_with('-')).collect();
    println!("{} threads; medians of {RUNS} runs", rayon::current_num_threads());
    for case in CASES.iter().filter(|case| wanted.is_empty() || wanted.iter().any(|part| case.name.contains(part))) {
        run(case)?;
    }
    Ok(())
}

fn run(case: &Case) -> Result<()> {
    let folder = std::env::var_os("RELUME_BENCH_DIR").map_or_else(std::env::temp_dir, PathBuf::from);
    let path = folder.join(format!("relume-bench-{}-{}.rfield", std::process::id(), case.name));
    let result = make(case, &path).and_then(|()| measure(case, &path));
    let _ = std::fs::remove_file(&path);
    result
}

fn measure(case: &Case, path: &Path) -> Result<()> {
    let asset = Asset::open(path, Access::Mapped)?;
    let Some(dense) = asset.dense() else { return Ok(()) };
    let samples = Samples::Dense(dense);
    let bytes = (dense.layout().len().unwrap_or(0) * dense.precision().bytes() as u64) as f64;
    println!("\n{}: {} lamps, {} x {}, {:.2} GB", case.name, case.elements, case.width, case.height, bytes / 1e9);

    let window = Window::full(case.width, case.height);
    let lights: Vec<Weights> = (0..16).map(|n| weights(case.elements, n)).collect();
    let relight = || apply(samples, &[&lights[0]], window).map(drop);
    let fastest = AHEAD.map(|ahead| (seconds(|| read(dense, ahead)).min(seconds(|| read(dense, ahead))), ahead));
    let ahead = fastest.into_iter().min_by(|a, b| a.0.total_cmp(&b.0)).map_or(0, |best| best.1);
    relight()?;
    let (mut limits, mut times) = (Vec::new(), Vec::new());
    for _ in 0..RUNS {
        limits.push(seconds(|| read(dense, ahead)));
        let start = Instant::now();
        relight()?;
        times.push(start.elapsed().as_secs_f64());
    }
    let (limit, one) = (middle(limits), middle(times));
    println!("  read limit      {:8.2} ms  {:6.2} GB/s", limit * 1e3, bytes / limit / 1e9);
    println!(
        "  relight         {:8.2} ms  {:6.2} GB/s  {:.3} of the read limit",
        one * 1e3,
        bytes / one / 1e9,
        limit / one
    );

    let product = matrix_vector(dense, &lights[0])?;
    println!(
        "  matrix-vector   {:8.2} ms  (f32, same product): {:.2} x the time of relight",
        product * 1e3,
        product / one
    );
    for n in [4, 16] {
        let several: Vec<&Weights> = lights[..n].iter().collect();
        let each = median(|| apply(samples, &several, window).map(drop))? / n as f64;
        println!("  {n:2} at once      {:8.2} ms a picture: {:.2} x the rate of one", each * 1e3, one / each);
    }
    Ok(())
}

fn weights(elements: usize, seed: usize) -> Weights {
    Weights::of_lamps((0..elements).map(|j| std::array::from_fn(|c| ((j * 7 + c + seed) % 11) as f32 / 11.0)).collect())
}

fn median(mut body: impl FnMut() -> Result<()>) -> Result<f64> {
    body()?;
    let mut times = Vec::new();
    for _ in 0..RUNS {
        let start = Instant::now();
        body()?;
        times.push(start.elapsed().as_secs_f64());
    }
    Ok(middle(times))
}

fn middle(mut times: Vec<f64>) -> f64 {
    times.sort_by(f64::total_cmp);
    times[times.len() / 2]
}

fn seconds(mut body: impl FnMut() -> u64) -> f64 {
    let start = Instant::now();
    std::hint::black_box(body());
    start.elapsed().as_secs_f64()
}

/// All threads read every byte of the field, asking for lines `ahead` bytes before their use.
fn read(dense: &Dense, ahead: usize) -> u64 {
    let layout = dense.layout();
    let row = |by: usize| -> u64 {
        let mut buffer = BlockBuffer::default();
        let mut sum = 0u64;
        for bx in 0..layout.columns() {
            for c in 0..3 {
                let words: &[u64] = match dense.block(bx, by, c, &mut buffer) {
                    Ok(Block::Half(t)) => bytemuck::cast_slice(t),
                    Ok(Block::Float(t)) => bytemuck::cast_slice(t),
                    Err(_) => &[],
                };
                sum = sum.wrapping_add(sum_words(words, ahead));
            }
        }
        sum
    };
    (0..layout.rows()).into_par_iter().map(row).reduce(|| 0, u64::wrapping_add)
}

/// Wrapping sum with 32 independent sums, which vectorises; a cache line is 8 words.
fn sum_words(words: &[u64], ahead: usize) -> u64 {
    let mut sums = [0u64; 32];
    for chunk in words.chunks_exact(32) {
        #[cfg(target_arch = "x86_64")]
        if ahead > 0 {
            use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
            for line in 0..4 {
                // SAFETY: a prefetch never faults, whatever the address.
                #[allow(unused_unsafe)]
                unsafe {
                    _mm_prefetch::<_MM_HINT_T0>(chunk.as_ptr().wrapping_byte_add(ahead + line * 64).cast());
                }
            }
        }
        sums.iter_mut().zip(chunk).for_each(|(sum, word)| *sum = sum.wrapping_add(*word));
    }
    sums.iter().fold(0, |a, b| a.wrapping_add(*b))
}

/// Median time of the same product in f32: for each channel, (pixels x lamps) times weights, rows spread over the threads.
fn matrix_vector(dense: &Dense, weights: &Weights) -> Result<f64> {
    use nalgebra::{DMatrixView, DVector};
    let layout = dense.layout();
    let (n, pixels) = (layout.elements, layout.width * layout.height);
    // Row-major pixels x lamps is column-major lamps x pixels; every number of it is touched, its value does not matter.
    let matrix: Vec<f32> = (0..3 * pixels * n).into_par_iter().map(|k| (k % 977) as f32).collect();
    let vectors: [DVector<f32>; 3] =
        std::array::from_fn(|c| DVector::from_iterator(n, weights.rgb.iter().map(|w| w[c])));
    let mut out = vec![0.0f32; 3 * pixels];
    let rows = 4096;
    median(|| {
        for (c, vector) in vectors.iter().enumerate() {
            let matrix = &matrix[c * pixels * n..(c + 1) * pixels * n];
            let out = &mut out[c * pixels..(c + 1) * pixels];
            out.par_chunks_mut(rows).zip(matrix.par_chunks(rows * n)).for_each(|(out, part)| {
                let view = DMatrixView::from_slice(part, n, out.len());
                out.copy_from_slice(view.tr_mul(vector).as_slice());
            });
        }
        std::hint::black_box(&mut out);
        Ok(())
    })
}

/// Numbers between 0 and 1 that differ everywhere.
struct Noise;

impl Bands for Noise {
    fn fill(&mut self, by: usize, columns: Range<usize>, blocks: &mut [f32]) -> Result<()> {
        let seed = (by * 7919 + columns.start) as u32;
        blocks.par_iter_mut().enumerate().for_each(|(n, out)| {
            *out = ((n as u32).wrapping_add(seed).wrapping_mul(2_654_435_761) >> 8) as f32 / (1 << 24) as f32;
        });
        Ok(())
    }
}

fn make(case: &Case, path: &Path) -> Result<()> {
    let lamp = |k: usize| {
        let y = 1.0 - (k as f64 + 0.5) / case.elements as f64;
        let (s, c) = (2.399_963 * k as f64).sin_cos();
        Vec3::new((1.0 - y * y).sqrt() * s, y, (1.0 - y * y).sqrt() * c)
    };
    let contents = Contents {
        colour_space: Default::default(),
        domain: Directions::new((0..case.elements).map(lamp).collect())?.into(),
        irradiance: vec![1.0; case.elements],
        width: case.width,
        height: case.height,
        precision: case.precision,
        largest: 1.0,
        ambient: None,
        alpha: None,
        reliability: None,
        provenance: serde_json::Value::Null,
    };
    write(path, &contents, &mut Noise)
}
