//! What compact representations save, and what they cost: bytes and time against the samples they stand for, in the same run.
//!
//! `cargo bench -p relume-core --bench compact` photographs the demonstration's still life under 1280 lamps in a temporary
//! folder (`RELUME_BENCH_DIR` or the system's; 400 MB), imports `painting-72` from `../shared/data` where that is there
//! (or from `RELUME_DATA`), compresses each, and prints for every representation:
//!
//! - how many times smaller it is than samples in halves, its relative error over the field, and how long it took to make;
//! - the relative L2 error of pictures relit under the four maps of `hdri`, against the samples;
//! - how many times faster it relights. The two take turns; medians, and the fastest of each, which other work on the machine
//!   disturbs least.
//!
//! `RELUME_BENCH_WIDTH=N` makes the still life N columns wide. `RELUME_BENCH_PICTURES=DIR` keeps the pictures and 20 times their differences. Arguments: a part of `case/representation`, such
//! as `painting` or `stage-1280/factored`, runs what it is a part of.

#![allow(clippy::print_stdout, missing_docs)]

use std::path::{Path, PathBuf};
use std::time::Instant;

use relume_core::Result;
use relume_core::acquire::{ImportLp, Measured};
use relume_core::domain::{Directions, lp::Lengths};
use relume_core::evaluate::compare;
use relume_core::field::compress::{Scheme, WAVELET_GRID, compress};
use relume_core::field::{Access, Asset, Contents, Kind, Precision, write};
use relume_core::illumination::EnvMap;
use relume_core::image::{self, ColourSpace, EncodeOptions, Encoding, Image, Window};
use relume_core::reconstruct::Method;
use relume_core::relight::{Light, Look, Relighter, Weights};
use relume_core::simulate::{Camera, Quality, Scene, Stage, grid_lamps};
use relume_core::wavelet::Wavelet;

/// Runs of each; medians count.
const RUNS: usize = 41;
/// Columns of the virtual pictures: 377 MB of samples, far beyond any cache.
const WIDTH: usize = 256;

/// [`WIDTH`], or what `RELUME_BENCH_WIDTH` says.
fn width() -> usize {
    std::env::var("RELUME_BENCH_WIDTH").ok().and_then(|text| text.parse().ok()).unwrap_or(WIDTH)
}

const MAPS: [&str; 4] = ["apartment", "city", "night", "park"];

/// A way to store the field.
struct Candidate {
    name: String,
    kind: Kind,
    scheme: Scheme,
}

fn factored(error: f64) -> Candidate {
    Candidate { name: format!("factored {error}"), kind: Kind::Factored, scheme: Scheme::Factored { error } }
}

/// Rebuilt by B-splines, which the samples are then lit by, too.
fn wavelets(error: Option<f64>, terms: Option<usize>) -> Candidate {
    let (wavelet, reconstruction) = (Wavelet::Daubechies97, Method::BSpline);
    Candidate {
        name: error.map_or(format!("9/7, {} terms", terms.unwrap_or(0)), |error| format!("9/7, {error}")),
        kind: Kind::Wavelet,
        scheme: Scheme::Wavelet { wavelet, grid: WAVELET_GRID, reconstruction, error, terms },
    }
}

fn harmonics(functions: usize) -> Candidate {
    Candidate { name: format!("harmonics {functions}"), kind: Kind::Harmonics, scheme: Scheme::Harmonics { functions } }
}

fn main() -> Result<()> {
    let wanted: Vec<String> = std::env::args().skip(1).filter(|arg| !arg.starts_with('-')).collect();
    let wants = |case: &str, candidate: &Candidate| {
        let name = format!("{case}/{}", candidate.name);
        wanted.is_empty() || wanted.iter().any(|part| name.contains(part))
    };
    let data = std::env::var_os("RELUME_DATA")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data"), PathBuf::from);
    if !data.is_dir() {
        println!("skipped: {} absent, and with it the maps to relight with", data.display());
        return Ok(());
    }
    let place = std::env::var_os("RELUME_BENCH_DIR").map_or_else(std::env::temp_dir, PathBuf::from);
    let folder = place.join(format!("relume-bench-{}", std::process::id()));
    std::fs::create_dir_all(&folder).map_err(|source| relume_core::Error::io("create", &folder, source))?;
    let result = run(&wants, &data, &folder);
    let _ = std::fs::remove_dir_all(&folder);
    result
}

fn run(wants: &dyn Fn(&str, &Candidate) -> bool, data: &Path, folder: &Path) -> Result<()> {
    println!("{} threads; medians of {RUNS} runs", rayon::current_num_threads());
    let on_stage = vec![
        factored(0.04),
        factored(0.02),
        wavelets(None, Some(256)),
        wavelets(Some(0.01), None),
        harmonics(25),
        harmonics(225),
    ];
    let of_painting = vec![factored(0.02), factored(0.04), harmonics(25)];
    for (name, mut candidates) in [("stage-1280", on_stage), ("painting-72", of_painting)] {
        candidates.retain(|candidate| wants(name, candidate));
        if candidates.is_empty() {
            continue;
        }
        let path = folder.join(format!("{name}.rfield"));
        if name == "stage-1280" {
            stage(&path)?
        } else {
            painting(data, &path)?
        }
        case(name, &path, data, &candidates)?;
    }
    Ok(())
}

/// Mirror, glass, gold, glossy and diffuse things on a table, under 64 x 20 lamps.
fn stage(path: &Path) -> Result<()> {
    let (scene, camera) = (Scene::demo(), Camera::demo(width(), width() * 3 / 4));
    let domain = Directions::new(grid_lamps(64, 20))?;
    let stage = Stage::new(&scene, camera, &domain, Quality::default());
    let contents = Contents {
        colour_space: ColourSpace::default(),
        irradiance: vec![std::f32::consts::PI; domain.len()],
        domain: domain.into(),
        width: camera.width,
        height: camera.height,
        precision: Precision::Half,
        largest: stage.largest(),
        ambient: None,
        alpha: None,
        reliability: None,
        provenance: serde_json::json!({"source": "virtual stage"}),
    };
    write(path, &contents, &mut stage.bands(&mut |_, _| Ok(())))
}

/// Photographs, with their noise and the blocks of JPEG.
fn painting(data: &Path, path: &Path) -> Result<()> {
    let import = ImportLp {
        lp: data.join("painting-72/dirs.lp"),
        encoding: Encoding::Auto,
        colour_space: ColourSpace::default(),
        black: None,
        alpha: None,
        irradiance: std::f32::consts::PI,
        measured: Measured::default(),
        precision: Precision::Half,
        lengths: Lengths::Unit,
        exclude: Vec::new(),
        correction: None,
    };
    import.run(path, &mut |_, _| Ok(())).map(drop)
}

/// All representations of one field.
fn case(name: &str, source: &Path, data: &Path, candidates: &[Candidate]) -> Result<()> {
    let dense = Relighter::new(Asset::open(source, Access::Mapped)?)?;
    let maps: Vec<EnvMap> =
        MAPS.iter().map(|map| EnvMap::load(&data.join(format!("hdri/{map}.hdr")))).collect::<Result<_>>()?;
    let (w, h) = (dense.asset().width(), dense.asset().height());
    let bytes = dense.asset().bytes(Kind::Dense);
    println!("\n{name}: {} lamps, {w} x {h}, {:.1} MB", dense.asset().directions()?.len(), bytes as f64 / 1e6);
    println!(
        "  {:16} {:>8} {:>8} {:>8}  {:>8} ({})  {:>9} {:>9} {:>7} {:>7}",
        "",
        "smaller",
        "error",
        "made in",
        "relit",
        MAPS.join(", "),
        "samples",
        "it",
        "faster",
        "at best"
    );
    for candidate in candidates {
        let path = source.with_extension("compact.rfield");
        let start = Instant::now();
        compress(dense.asset(), &path, &candidate.scheme, &[], &mut |_, _, _| Ok(()))?;
        let made = start.elapsed().as_secs_f64();
        let compact = Relighter::new(Asset::open(&path, Access::Mapped)?)?;
        let errors = relit(&dense, &compact, candidate, &maps, name)?;
        let [samples, it] = times(&dense, &compact, &maps[3])?;
        let held = compact.asset().bytes(candidate.kind);
        let reached = compact.asset().manifest().representations[0].loss().map_or(0.0, |loss| loss.reached);
        let each: Vec<String> = errors.iter().map(|e| format!("{:.2}", 100.0 * e)).collect();
        println!(
            "  {:16} {:7.2}x {:6.2} % {made:6.1} s  {:6.2} % ({:>26})  {:6.2} ms {:6.2} ms {:6.2}x {:6.2}x",
            candidate.name,
            bytes as f64 / held as f64,
            100.0 * reached,
            100.0 * errors.iter().sum::<f64>() / errors.len() as f64,
            each.join(", "),
            samples.0 * 1e3,
            it.0 * 1e3,
            samples.0 / it.0,
            samples.1 / it.1
        );
        words(compact.asset());
    }
    Ok(())
}

/// What is particular to a representation.
fn words(asset: &Asset) {
    if let Some(sparse) = asset.sparse() {
        let pixels = asset.width() * asset.height();
        println!("  {:16} {:.1} terms a pixel", "", sparse.terms() as f64 / pixels as f64);
    }
    if let Some(factored) = asset.factored() {
        let (tiles, ranks) = (factored.tiles(), factored.ranks());
        let sum: usize = ranks.iter().map(|&rank| rank as usize).sum();
        let left: usize = ranks.iter().enumerate().map(|(tile, &rank)| rank as usize * tiles.matrix_rows(tile)).sum();
        println!(
            "  {:16} tiles of {} x {}, ranks {} to {}, mean {:.1}, {} of {} black; B is {:.2} of A",
            "",
            tiles.size[0],
            tiles.size[1],
            ranks.iter().min().unwrap_or(&0),
            ranks.iter().max().unwrap_or(&0),
            sum as f64 / ranks.len() as f64,
            ranks.iter().filter(|&&rank| rank == 0).count(),
            ranks.len(),
            (sum * tiles.layout.elements) as f64 / left as f64
        );
    }
}

/// Relative L2 errors of the pictures, map after map.
fn relit(
    dense: &Relighter,
    compact: &Relighter,
    candidate: &Candidate,
    maps: &[EnvMap],
    name: &str,
) -> Result<Vec<f64>> {
    let mut errors = Vec::new();
    let mut look = Look::default();
    if let Scheme::Wavelet { reconstruction, .. } = &candidate.scheme {
        look.method = *reconstruction;
    }
    for (map, map_name) in maps.iter().zip(MAPS) {
        let [reference, picture] = [dense, compact].map(|relighter| {
            let weights = relighter.weights(Light::Map(map), &look)?;
            relighter.render(&weights, &look, full(relighter)).map(Image::into_rgb)
        });
        let (reference, picture) = (reference?, picture?);
        errors.push(compare(&picture, &reference, None)?.relative_l2);
        if let Some(folder) = std::env::var_os("RELUME_BENCH_PICTURES") {
            let stem = format!("{name}-{}-{map_name}", candidate.name.replace([' ', '/', ','], "-"));
            keep(Path::new(&folder), &stem, &picture, &reference)?;
        }
    }
    Ok(errors)
}

/// The picture and, about a middle grey, 20 times its difference; both with the 98th percentile of the reference as white.
fn keep(folder: &Path, stem: &str, picture: &Image, reference: &Image) -> Result<()> {
    let mut levels = reference.data().to_vec();
    levels.sort_by(f32::total_cmp);
    let white = levels[levels.len() * 98 / 100].max(f32::MIN_POSITIVE);
    let shown = |of: &dyn Fn(f32, f32) -> f32| {
        let data = picture.data().iter().zip(reference.data()).map(|(p, r)| of(p / white, r / white)).collect();
        Image::from_data(picture.width(), picture.height(), 3, data)
    };
    let options = EncodeOptions { png8: true, ..EncodeOptions::default() };
    image::write(&folder.join(format!("{stem}.png")), &shown(&|p, _| p)?, options)?;
    image::write(&folder.join(format!("{stem}-20x.png")), &shown(&|p, r| 0.2 + 20.0 * (p - r))?, options)
}

/// Seconds to relight a frame once its weights are there: by the samples, and by the compact form: median, fastest.
fn times(dense: &Relighter, compact: &Relighter, map: &EnvMap) -> Result<[(f64, f64); 2]> {
    let look = Look::default();
    let both: [(&Relighter, Weights); 2] =
        [(dense, dense.weights(Light::Map(map), &look)?), (compact, compact.weights(Light::Map(map), &look)?)];
    let mut times = [Vec::new(), Vec::new()];
    for run in 0..=RUNS {
        for ((relighter, weights), times) in both.iter().zip(&mut times) {
            let start = Instant::now();
            std::hint::black_box(relighter.render(weights, &look, full(relighter))?);
            // The first brings the file into memory.
            if run > 0 {
                times.push(start.elapsed().as_secs_f64());
            }
        }
    }
    Ok(times.map(|mut times| {
        times.sort_by(f64::total_cmp);
        (times[times.len() / 2], times[0])
    }))
}

fn full(relighter: &Relighter) -> Window {
    Window::full(relighter.asset().width(), relighter.asset().height())
}
