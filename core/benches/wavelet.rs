//! How long the wavelet transform takes, for every wavelet: 256 x 64 and 1024 x 1024 values, 16 functions at once, one
//! thread.
//!
//! `cargo bench -p relume-core --bench wavelet` prints for each wavelet, size and operator (forward A, inverse S, and their
//! adjoints): microseconds for each function on one core, the median of several runs; and how often the same numbers could
//! have been copied in that time, by a plain copy in the same run.
//!
//! Arguments: a wavelet's name runs that wavelet alone; a number is that many lanes instead of 16.

#![allow(clippy::print_stdout, missing_docs)]

use std::time::Instant;

use relume_core::Result;
use relume_core::wavelet::{Edge, Normalisation, Transform, Wavelet};

const SIZES: [(usize, usize); 2] = [(256, 64), (1024, 1024)];
const RUNS: usize = 31;

type Operator = fn(&Transform, &mut [f32], usize);

const OPERATORS: [(&str, Operator); 4] = [
    ("forward", Transform::forward),
    ("inverse", Transform::inverse),
    ("forward adjoint", Transform::forward_adjoint),
    ("inverse adjoint", Transform::inverse_adjoint),
];

fn main() -> Result<()> {
    let args: Vec<String> = std::env::args().skip(1).filter(|arg| !arg.starts_with('-')).collect();
    let lanes = args.iter().find_map(|arg| arg.parse().ok()).unwrap_or(16);
    let wanted: Vec<Wavelet> = args.iter().filter_map(|arg| arg.parse().ok()).collect();
    println!("{lanes} functions at once; medians of {RUNS} runs; microseconds a function and core");
    println!("{:8} {:11} {:16} {:>9} {:>9} {:>13}", "wavelet", "size", "operator", "transform", "copy", "it / copying");
    for size in SIZES {
        for wavelet in Wavelet::ALL.iter().filter(|wavelet| wanted.is_empty() || wanted.contains(wavelet)) {
            let vertical = if wavelet.is_symmetric() { Edge::Mirrored } else { Edge::Cyclic };
            let transform = Transform::new(*wavelet, size, (Edge::Cyclic, vertical), Normalisation::Energy)?;
            for (name, operator) in OPERATORS {
                let (it, copy) = measured(&transform, operator, lanes);
                let size = format!("{} x {}", size.0, size.1);
                println!("{:8} {size:11} {name:16} {it:9.2} {copy:9.2} {:13.2}", wavelet.id(), it / copy);
            }
        }
    }
    Ok(())
}

/// Microseconds a function: the operator, and copying its numbers.
fn measured(transform: &Transform, operator: Operator, lanes: usize) -> (f64, f64) {
    let (width, height) = transform.size();
    let source: Vec<f32> = (0..width * height * lanes).map(|n| (n % 1013) as f32 / 1013.0 - 0.5).collect();
    let mut data = source.clone();
    // In turns, so that a machine whose speed drifts disturbs both alike; and the operator always meets the same numbers.
    let (mut its, mut copies) = (Vec::new(), Vec::new());
    for _ in 0..RUNS {
        copies.push(timed(|| data.copy_from_slice(std::hint::black_box(&source))));
        its.push(timed(|| operator(transform, std::hint::black_box(&mut data), lanes)));
    }
    let each = 1e6 / lanes as f64;
    (median(&mut its) * each, median(&mut copies) * each)
}

/// Seconds.
fn timed(work: impl FnOnce()) -> f64 {
    let start = Instant::now();
    work();
    start.elapsed().as_secs_f64()
}

fn median(times: &mut [f64]) -> f64 {
    times.sort_by(f64::total_cmp);
    times[times.len() / 2]
}
