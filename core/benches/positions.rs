//! Packing photographs of a projector position by position: time, memory, size and error.
//!
//! `cargo bench -p relume-core --bench positions` takes 2 positions of 16 x 16 squares, photographs of 640 x 480, made as they
//! are wanted: each pixel sees one square brightly and all others a little, with noise of 0.1 % of white. It prints milliseconds a
//! photograph, peak memory of the process, terms, the size of the container against samples as halves, the error of some pixels
//! against what the photographs would be without noise, and milliseconds a relit picture.
//!
//! Arguments: a number is that many positions (224: the thesis's 57344 photographs; wants 30 GB of disk beside the temporary folder's
//! container); `samples` spills and writes samples in place of terms.

#![allow(clippy::print_stdout, missing_docs)]

use std::path::Path;
use std::time::Instant;

use rayon::prelude::*;
use relume_core::Result;
use relume_core::acquire::{Photographs, PositionTerms, Reporting};
use relume_core::domain::{Domain, Filter, Gantry};
use relume_core::field::{Access, Asset, Contents, Precision, write, write_terms};
use relume_core::image::{ColourSpace, Image, Window};
use relume_core::math::Vec3;
use relume_core::relight::{Light, Look, Relighter};

const SIZE: (usize, usize) = (640, 480);
const SIDE: usize = 16;
const NOISE: f32 = 1e-3;

fn main() -> Result<()> {
    let args: Vec<String> = std::env::args().skip(1).filter(|arg| !arg.starts_with('-')).collect();
    let positions: usize = args.iter().find_map(|arg| arg.parse().ok()).unwrap_or(2);
    let samples = args.iter().any(|arg| arg == "samples");
    let folder = tempfile::tempdir().map_err(|source| relume_core::Error::io("create", Path::new("."), source))?;
    let path = folder.path().join("positions.rfield");
    let began = Instant::now();
    let lost = if samples { packed_samples(&path, positions)? } else { packed_terms(&path, positions)? };
    let seconds = began.elapsed().as_secs_f64();
    let photographs = positions * SIDE * SIDE;
    let asset = Asset::open(&path, Access::Mapped)?;
    let halves = (SIZE.0 * SIZE.1 * 3 * 2 * photographs) as f64;
    println!("{photographs} photographs of {} x {} from {positions} positions", SIZE.0, SIZE.1);
    println!("packing     {:.1} ms a photograph, {seconds:.0} s in all", 1e3 * seconds / photographs as f64);
    println!("memory      {} MB at most", peak_megabytes());
    println!(
        "container   {:.0} MB, samples as halves {:.0} MB: {:.1} x smaller",
        asset.file_len() as f64 / 1e6,
        halves / 1e6,
        halves / asset.file_len() as f64
    );
    if let Some((lost, terms)) = lost {
        let each = terms as f64 / (SIZE.0 * SIZE.1 * positions) as f64;
        println!(
            "terms       {each:.2} a pixel and position; {:.2} % of the norm left out, noise included",
            100.0 * lost
        );
        println!("error       {:.2} % of the answers of 64 pixels without noise", 100.0 * error(&asset, positions)?);
    }
    let relighter = Relighter::new(asset)?;
    let look = Look::default();
    let weights = relighter.weights(Light::Lamp(1), &look)?;
    let window = Window { x0: 0, y0: 0, x1: SIZE.0, y1: SIZE.1 };
    relighter.render(&weights, &look, window)?;
    let began = Instant::now();
    relighter.render(&weights, &look, window)?;
    println!("relighting  {:.0} ms a picture", 1e3 * began.elapsed().as_secs_f64());
    Ok(())
}

fn contents(positions: usize, largest: f32) -> Result<Contents> {
    let place = |n: usize| {
        let (turn, up) = (0.9 * n as f64, 0.2 + 0.6 * (n as f64 * 0.618).fract());
        Vec3::new(turn.sin(), up, turn.cos()).normalize() * 4.0
    };
    let places: Vec<Vec3> = (0..positions).map(place).collect();
    Ok(Contents {
        domain: Domain::from(Gantry::looking_at_origin(&places, SIDE, 0.6, Filter::Box)?),
        irradiance: vec![1.0; positions],
        width: SIZE.0,
        height: SIZE.1,
        colour_space: ColourSpace::default(),
        precision: Precision::Half,
        largest,
        ambient: None,
        alpha: None,
        reliability: None,
        provenance: serde_json::Value::Null,
    })
}

/// What is lost, and how many terms there are.
fn packed_terms(path: &Path, positions: usize) -> Result<Option<(f64, u64)>> {
    let folder = path.parent().unwrap_or(Path::new("."));
    let squares = relume_core::domain::Plane::new(SIDE, SIDE)?;
    let mut terms = PositionTerms::new(SIZE, (positions, squares), 0.01, path)?;
    for position in 0..positions {
        let mut photographs = Photographs::new(SIZE.0, SIZE.1, folder);
        let seen = seen(position);
        (0..SIDE * SIDE).try_for_each(|square| photographs.push(photograph(&seen, square)))?;
        terms.push(&mut photographs)?;
        if position % 16 == 15 {
            println!("position {:4}: {} MB at most", position + 1, peak_megabytes());
        }
    }
    let (basis, lost, count) = (terms.basis(), terms.lost(), terms.terms());
    write_terms(path, &contents(positions, terms.largest())?, (basis, None), &mut terms)?;
    Ok(Some((lost, count)))
}

fn packed_samples(path: &Path, positions: usize) -> Result<Option<(f64, u64)>> {
    let mut photographs = Photographs::new(SIZE.0, SIZE.1, path.parent().unwrap_or(Path::new(".")));
    for position in 0..positions {
        let seen = seen(position);
        (0..SIDE * SIDE).try_for_each(|square| photographs.push(photograph(&seen, square)))?;
    }
    let contents = contents(positions, photographs.largest())?;
    let mut bands = Reporting { photographs: &mut photographs, progress: &mut |_, _| Ok(()), total: 0 };
    write(path, &contents, &mut bands)?;
    Ok(None)
}

/// What pixels see of a position, in squares from the left and the top; negative in a shadow.
fn seen(position: usize) -> Vec<[f32; 2]> {
    let p = position as f32;
    let at = |n: usize| {
        let (u, v) = ((n % SIZE.0) as f32 / SIZE.0 as f32, (n / SIZE.0) as f32 / SIZE.1 as f32);
        let (across, down) = (u + 0.1 * (3.0 * v + p).sin(), v + 0.1 * (4.0 * u + 0.7 * p).cos());
        let shadow = (7.0 * u + p).sin() * (5.0 * v - p).cos() > 0.6;
        let square = |s: f32| (s * SIDE as f32).rem_euclid(SIDE as f32);
        if shadow { [-1.0 - square(across), square(down)] } else { [square(across), square(down)] }
    };
    (0..SIZE.0 * SIZE.1).into_par_iter().map(at).collect()
}

fn albedo(n: usize) -> [f32; 3] {
    let (u, v) = ((n % SIZE.0) as f32 / SIZE.0 as f32, (n / SIZE.0) as f32 / SIZE.1 as f32);
    [0.6 + 0.3 * (u - 0.5), 0.5, 0.4 + 0.2 * (v - 0.5)]
}

/// Light of a pixel under a square, RGB: direct where the pixel sees the square, and a little over other surfaces.
fn answer([across, down]: [f32; 2], square: usize, n: usize) -> [f32; 3] {
    let (column, row) = (square % SIDE, square / SIDE);
    let direct = if across >= 0.0 && (across as usize, down as usize) == (column, row) { 1.0 } else { 0.0 };
    let lies = if across < 0.0 { -1.0 - across } else { across };
    let near = |a: f32, b: usize| 1.0 - (a - b as f32).abs() / SIDE as f32;
    let indirect = 6e-4 * near(lies, column) * near(down, row);
    albedo(n).map(|albedo| albedo * (direct + indirect))
}

/// A picture of them, with noise.
fn photograph(seen: &[[f32; 2]], square: usize) -> Image {
    let mut data = vec![0.0f32; SIZE.0 * SIZE.1 * 3];
    data.par_chunks_mut(3 * SIZE.0).enumerate().for_each(|(y, line)| {
        let mut state = (square * 1_000_003 + y) as u64 + u64::from(seen[0][0].to_bits()) * 977;
        for (x, rgb) in line.as_chunks_mut::<3>().0.iter_mut().enumerate() {
            let n = y * SIZE.0 + x;
            *rgb = answer(seen[n], square, n).map(|light| {
                // The sum of four even numbers is near enough to a normal one; its variance is a third.
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                let even = |shift: u32| f32::from((state >> shift) as u16) / 65536.0 - 0.5;
                light + NOISE * 3f32.sqrt() * (even(0) + even(16) + even(32) + even(48))
            });
        }
    });
    Image::from_data(SIZE.0, SIZE.1, 3, data).unwrap_or_else(|_| Image::new(SIZE.0, SIZE.1, 3))
}

/// Relative, of some pixels, over all squares.
fn error(asset: &Asset, positions: usize) -> Result<f64> {
    let Some(sparse) = asset.sparse() else { return Ok(0.0) };
    let (mut off, mut all) = (0.0f64, 0.0f64);
    let seen: Vec<Vec<[f32; 2]>> = (0..positions).map(seen).collect();
    for n in 0..64 {
        let (x, y) = (n * 37 % SIZE.0, n * 53 % SIZE.1);
        let pixel = y * SIZE.0 + x;
        for (element, found) in sparse.reflectance(x, y)?.iter().enumerate() {
            let truth = answer(seen[element / (SIDE * SIDE)][pixel], element % (SIDE * SIDE), pixel);
            for c in 0..3 {
                off += f64::from(found[c] - truth[c]).powi(2);
                all += f64::from(truth[c]).powi(2);
            }
        }
    }
    Ok((off / all).sqrt())
}

/// Of this process, where the system tells it.
fn peak_megabytes() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find(|line| line.starts_with("VmHWM:")).unwrap_or_default();
    line.split_whitespace().nth(1).and_then(|kilobytes| kilobytes.parse::<u64>().ok()).unwrap_or_default() / 1000
}
