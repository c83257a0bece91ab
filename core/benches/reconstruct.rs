//! How long a map takes to become weights, for every reconstruction: 1024 x 512 texels, 1280 lamps as 64 longitudes x 20
//! latitudes.
//!
//! `cargo bench -p relume-core --bench reconstruct` prints for each method: the time to build its structure (lamps alone) and
//! its operator (for this map size), both once; the time to downsample, the median of several runs; the bytes that it reads;
//! and how that compares with merely reading as many bytes in the same run.
//!
//! Arguments: a part of a method's name runs that method alone.

#![allow(clippy::print_stdout, missing_docs)]

use std::f64::consts::PI;
use std::sync::Arc;
use std::time::Instant;

use rayon::prelude::*;
use relume_core::Result;
use relume_core::domain::Directions;
use relume_core::illumination::EnvMap;
use relume_core::math::Vec3;
use relume_core::reconstruct::{Method, Operator, Outside, Reconstruction};

const SIZE: (usize, usize) = (1024, 512);
const RUNS: usize = 15;

fn main() -> Result<()> {
    let wanted: Vec<String> = std::env::args().skip(1).filter(|arg| !arg.starts_with('-')).collect();
    let domain = Arc::new(Directions::new((0..1280).map(lamp).collect())?);
    let map = EnvMap::from_fn(SIZE.0, SIZE.1, |d| [(1.0 + d.x) as f32, (1.0 + d.y * d.z) as f32, d.z.abs() as f32]);
    println!("{} threads; medians of {RUNS} runs; ms, MB", rayon::current_num_threads());
    println!(
        "{:18} {:>10} {:>10} {:>11} {:>8} {:>14}",
        "method", "structure", "operator", "downsample", "reads", "reading / it"
    );
    for method in Method::ALL.iter().filter(|m| wanted.is_empty() || wanted.iter().any(|part| m.id().contains(part))) {
        let (reconstruction, structure) = timed(|| Reconstruction::new(domain.clone(), *method));
        let reconstruction = Arc::new(reconstruction?);
        let (operator, build) = timed(|| Operator::new(reconstruction, Outside::Drop, SIZE.0, SIZE.1));
        let bytes = operator.bytes() + size_of_val(map.image().data());
        let buffer = vec![1u64; bytes / size_of::<u64>()];
        // In turns, so that a machine whose speed drifts disturbs both alike.
        let (mut down, mut read) = (Vec::new(), Vec::new());
        for _ in 0..RUNS {
            down.push(timed(|| std::hint::black_box(operator.downsample(&map))).1);
            read.push(timed(|| std::hint::black_box(sum(&buffer))).1);
        }
        let (down, read) = (median(&mut down), median(&mut read));
        let megabytes = bytes as f64 / 1e6;
        println!("{:18} {structure:10.0} {build:10.0} {down:11.1} {megabytes:8.1} {:14.2}", method.id(), read / down);
    }
    Ok(())
}

fn lamp(n: usize) -> Vec3 {
    let (colatitude, longitude) = (((n / 64) as f64 + 0.5) * PI / 40.0, (n % 64) as f64 * PI / 32.0);
    let ((s, c), (sl, cl)) = (colatitude.sin_cos(), longitude.sin_cos());
    Vec3::new(s * sl, c, s * cl)
}

fn sum(buffer: &[u64]) -> u64 {
    buffer.par_chunks(1 << 16).map(|part| part.iter().fold(0, |sum: u64, n| sum.wrapping_add(*n))).sum()
}

/// The result, and milliseconds.
fn timed<T>(work: impl FnOnce() -> T) -> (T, f64) {
    let start = Instant::now();
    let result = work();
    (result, start.elapsed().as_secs_f64() * 1e3)
}

fn median(times: &mut [f64]) -> f64 {
    times.sort_by(f64::total_cmp);
    times[times.len() / 2]
}
