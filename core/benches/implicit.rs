//! How long implicit sampling takes: 256 patterns, 64 terms, 64 x 64 and 128 x 128 texels, one thread.
//!
//! `cargo bench -p relume-core --bench implicit` prints for each grid: milliseconds a pixel on one core, the median of
//! several runs; the same of the plain twin in the same run, and their ratio. The pixels are mixtures of a smooth floor, a glossy
//! lobe and a refracted spot, with 0.2 % of noise.
//!
//! Arguments: a number is that many terms instead of 64; `WxH` is that grid alone.

#![allow(clippy::print_stdout, missing_docs)]

use std::sync::Arc;
use std::time::Instant;

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg32;
use relume_core::Result;
use relume_core::acquire::implicit::{Dictionary, Options, Solver, Terms, solve_plainly};
use relume_core::domain::Plane;
use relume_core::domain::patterns::{Kind, Noise, Pattern, PatternSet};
use relume_core::wavelet::{Edge, Normalisation, Transform, Wavelet};

const PATTERNS: usize = 256;
const PIXELS: usize = 400;
/// Of those, the plain twin solves so many a run.
const PLAIN: usize = 4;
const RUNS: usize = 9;

fn main() -> Result<()> {
    let args: Vec<String> = std::env::args().skip(1).filter(|arg| !arg.starts_with('-')).collect();
    let terms = args.iter().find_map(|arg| arg.parse().ok()).unwrap_or(Options::default().terms);
    let grid = |arg: &String| arg.split_once('x').and_then(|(w, h)| Some((w.parse().ok()?, h.parse().ok()?)));
    let grids: Vec<(usize, usize)> = args.iter().filter_map(grid).collect();
    let grids = if grids.is_empty() { vec![(64, 64), (128, 128)] } else { grids };
    println!("{PATTERNS} patterns, {terms} terms; medians of {RUNS} runs; milliseconds a pixel and core");
    println!("{:10} {:>8} {:>8} {:>14} {:>6}", "texels", "solver", "plain", "plain / solver", "terms");
    for size in grids {
        let (it, plain, found) = measured(size, terms)?;
        println!("{:10} {it:8.3} {plain:8.1} {:14.0} {found:6.1}", format!("{} x {}", size.0, size.1), plain / it);
    }
    Ok(())
}

/// Milliseconds a pixel: the solver, and its twin; and the terms it found.
fn measured(size: (usize, usize), terms: usize) -> Result<(f64, f64, f64)> {
    let noise = Noise { wavelet: Wavelet::Haar, count: PATTERNS, seed: 1, deviation: Noise::DEVIATION };
    let set = PatternSet::new(Kind::Noise(noise), Plane::new(size.0, size.1)?)?;
    let patterns: Vec<Pattern> = (0..set.len()).map(|n| set.pattern(n)).collect();
    let edges = (Edge::Mirrored, Edge::Mirrored);
    let transform = Transform::new(Wavelet::Haar, size, edges, Normalisation::Energy)?;
    let dictionary = Arc::new(Dictionary::new(&transform, &patterns)?);
    let options = Options { terms, ..Options::default() };
    let solver = Solver::new(dictionary.clone(), options)?;
    let mut rng = Pcg32::seed_from_u64(1);
    let responses: Vec<Vec<f32>> = (0..PIXELS).map(|_| response(size, &patterns, &mut rng)).collect();
    let (mut its, mut plains, mut found) = (Vec::new(), Vec::new(), Terms::default());
    let mut scratch = solver.scratch();
    // In turns, so that a machine whose speed drifts disturbs both alike.
    for run in 0..RUNS {
        found.clear();
        let solve = |response: &Vec<f32>| solver.solve(&mut scratch, response, None, &mut found);
        its.push(timed(|| responses.iter().map(solve).sum()) / PIXELS as f64);
        let some = responses.iter().skip(run * PLAIN % PIXELS).take(PLAIN);
        let solve = |response: &Vec<f32>| solve_plainly(&dictionary, options, response, None).locations.len();
        plains.push(timed(|| some.map(solve).sum()) / PLAIN as f64);
    }
    Ok((median(&mut its), median(&mut plains), found.locations.len() as f64 / PIXELS as f64))
}

/// What a pixel by chance answers to the patterns.
fn response((columns, rows): (usize, usize), patterns: &[Pattern], rng: &mut Pcg32) -> Vec<f32> {
    let mut random = || rng.random::<f32>();
    let (lobe, spot) = ([random(), random()], [random(), random()]);
    let (lobe_width, spot_width) = (0.02 + 0.1 * random(), 0.01 + 0.06 * random());
    let (floor, glossy, sharp) = (0.2 * random(), random(), 4.0 * random());
    let value = |n: usize| {
        let at = [((n % columns) as f32 + 0.5) / columns as f32, ((n / columns) as f32 + 0.5) / rows as f32];
        let distance = |to: [f32; 2]| (at[0] - to[0]).hypot(at[1] - to[1]);
        let lit = f32::from(u8::from(distance(spot) < spot_width));
        [floor * (0.5 + at[1]), glossy * (-0.5 * (distance(lobe) / lobe_width).powi(2)).exp(), sharp * lit]
    };
    let texels: Vec<[f32; 3]> = (0..columns * rows).map(value).collect();
    let mix = [[1.0, 1.0, 0.9], [1.0, 0.8, 0.9], [1.0, 0.3, 0.9]];
    let mut answers = Vec::with_capacity(3 * patterns.len());
    for mix in mix {
        for pattern in patterns {
            let parts = texels.iter().zip(&pattern.values).map(|(t, l)| l * (0..3).map(|k| mix[k] * t[k]).sum::<f32>());
            answers.push(parts.sum::<f32>());
        }
    }
    answers.iter_mut().for_each(|v| *v *= 1.0 + 0.002 * (12.0f32).sqrt() * (rng.random::<f32>() - 0.5));
    answers
}

/// Milliseconds; the sum keeps the work from being left out.
fn timed(work: impl FnOnce() -> usize) -> f64 {
    let start = Instant::now();
    std::hint::black_box(work());
    start.elapsed().as_secs_f64() * 1e3
}

fn median(times: &mut [f64]) -> f64 {
    times.sort_by(f64::total_cmp);
    times[times.len() / 2]
}
