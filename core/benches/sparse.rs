//! Wavelet coefficients of each pixel: how small, how good, how fast. The demonstration's still life under 64 x 20 lamps,
//! rebuilt on 256 x 64 by B-splines (thesis 5.4).
//!
//! `cargo bench -p relume-core --bench sparse` photographs it on the virtual stage in a temporary folder, and prints for some
//! wavelets and criteria:
//!
//! - the time to compress, a lit pixel and thread (three functions: rebuilding, transforms, choosing);
//! - terms a lit pixel, size against half samples, the error reached over the whole field;
//! - relative errors of reflectance functions, L2 and Sobolev H1 (`||v||^2 + ||grad v||^2`, forward differences along both
//!   axes of the grid, longitude cyclic), the three channels together, means over every 13th lit pixel;
//! - the time of a picture, alone and as one of four at once, against that of the samples, in turns in the same run.
//!
//! Arguments: columns and rows of the pictures, and a folder to keep some of them in.

#![allow(clippy::print_stdout, missing_docs)]

use std::path::Path;
use std::time::Instant;

use relume_core::Result;
use relume_core::domain::{Directions, StageGrid};
use relume_core::field::compress::{Scheme, WAVELET_GRID as GRID, compress};
use relume_core::field::{Access, Asset, Contents, Kind, Precision, Representation, write};
use relume_core::illumination::EnvMap;
use relume_core::image::{Image, Window};
use relume_core::reconstruct::{Method, Reconstruction, Resampling};
use relume_core::relight::{Light, Look, Relighter, Weights};
use relume_core::simulate::{Camera, Quality, Scene, Stage, grid_lamps};
use relume_core::wavelet::Wavelet;

const RUNS: usize = 9;
/// Every how many lit pixels one is looked at closely.
const STEP: usize = 13;

const CASES: [(Wavelet, Option<f64>, Option<usize>); 6] = [
    (Wavelet::Haar, None, Some(256)),
    (Wavelet::LeGall53, None, Some(256)),
    (Wavelet::Daubechies97, None, Some(256)),
    (Wavelet::Daubechies97, Some(0.002), None),
    (Wavelet::Daubechies97, Some(0.01), None),
    (Wavelet::Daubechies97, Some(0.05), None),
];

fn main() -> Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).filter(|arg| !arg.starts_with('-')).collect();
    let side = |n: usize, default| arguments.get(n).and_then(|arg| arg.parse().ok()).unwrap_or(default);
    let size = (side(0, 96), side(1, 72));
    let folder = tempfile::tempdir().map_err(|source| relume_core::Error::io("write", Path::new("."), source))?;
    let path = folder.path().join("samples.rfield");
    let (_, seconds) = timed(|| photograph(&path, size));
    let source = Asset::open(&path, Access::Mapped)?;
    let functions = Functions::new(&source)?;
    println!(
        "{} threads; {} x {} pixels, {} lit, 1280 lamps, photographed in {seconds:.0} s; rebuilding takes {:.1} us a function",
        rayon::current_num_threads(),
        size.0,
        size.1,
        functions.lit,
        functions.microseconds
    );
    println!(
        "{:16} {:>9} {:>7} {:>9} {:>8} {:>8} {:>8} | {:>9} {:>9} {:>7} {:>12}",
        "wavelet and limit",
        "us/pixel",
        "terms",
        "smaller",
        "reached",
        "L2",
        "H1",
        "dense ms",
        "sparse ms",
        "faster",
        "4 at once ms"
    );
    for (wavelet, error, terms) in CASES {
        measure(&source, &functions, (wavelet, error, terms), arguments.get(2).map(Path::new))?;
    }
    Ok(())
}

fn photograph(path: &Path, (width, height): (usize, usize)) -> Result<()> {
    let quality = Quality { samples: 64, bounces: 3, stride: 4, cone_density: 0.5, depth: 2, seed: 3 };
    let (scene, camera) = (Scene::demo(), Camera::demo(width, height));
    let domain = Directions::new(grid_lamps(64, 20))?;
    let stage = Stage::new(&scene, camera, &domain, quality);
    let contents = Contents {
        colour_space: Default::default(),
        irradiance: vec![1.0; domain.len()],
        domain,
        width,
        height,
        precision: Precision::Half,
        largest: stage.largest(),
        ambient: None,
        alpha: None,
        provenance: serde_json::json!({"source": "virtual stage"}),
    };
    write(path, &contents, &mut stage.bands(&mut |_, _| Ok(())))
}

/// Some functions as they were before they were compressed, `[texel][channel]`.
struct Functions {
    lit: usize,
    of_pixels: Vec<((usize, usize), Vec<f32>)>,
    microseconds: f64,
}

impl Functions {
    fn new(source: &Asset) -> Result<Self> {
        let grid = StageGrid::new(source.domain(), GRID)?;
        let reconstruction = Reconstruction::new(source.domain().clone(), Method::BSpline)?;
        let resampling = Resampling::new(&reconstruction, grid.directions()?.lamps());
        let samples = source.samples()?;
        let (mut lit, mut of_pixels) = (0, Vec::new());
        for n in 0..source.width() * source.height() {
            let (x, y) = (n % source.width(), n / source.width());
            let rgb = samples.reflectance(x, y)?;
            if rgb.iter().flatten().all(|t| *t == 0.0) {
                continue;
            }
            if lit % STEP == 0 {
                let mut function = vec![0.0; 3 * grid.texels()];
                resampling.apply(rgb.as_flattened(), &mut function);
                of_pixels.push(((x, y), function));
            }
            lit += 1;
        }
        let wide: Vec<f32> = (0..source.domain().len() * 16).map(|n| (n % 7) as f32).collect();
        let mut out = vec![0.0; 16 * grid.texels()];
        let times = (0..RUNS).map(|_| timed(|| resampling.apply(&wide, &mut out)).1).collect();
        Ok(Self { lit, of_pixels, microseconds: median(times) * 1e6 / 16.0 })
    }

    /// Means of the relative errors, L2 and H1.
    fn errors(&self, made: &Asset) -> Result<[f64; 2]> {
        let mut sums = [0.0; 2];
        let Some(sparse) = made.sparse() else { return Ok(sums) };
        for ((x, y), function) in &self.of_pixels {
            let decoded = sparse.reflectance(*x, *y)?;
            let off: Vec<f32> = function.iter().zip(decoded.as_flattened()).map(|(t, d)| t - d).collect();
            let (off, all) = (norms(&off), norms(function));
            (0..2).for_each(|n| sums[n] += (off[n] / all[n]).sqrt());
        }
        Ok(sums.map(|sum| sum / self.of_pixels.len() as f64))
    }
}

/// Squares of the L2 and the H1 norm of three functions side by side.
fn norms(functions: &[f32]) -> [f64; 2] {
    let at = |x: usize, y: usize, c: usize| functions[3 * (y * GRID.0 + x % GRID.0) + c];
    let mut sums = [0.0; 2];
    for (n, value) in functions.iter().enumerate() {
        let (x, y, c) = (n / 3 % GRID.0, n / 3 / GRID.0, n % 3);
        let square = f64::from(*value).powi(2);
        let along = f64::from(at(x + 1, y, c) - value).powi(2);
        let across = if y + 1 < GRID.1 { f64::from(at(x, y + 1, c) - value).powi(2) } else { 0.0 };
        sums[0] += square;
        sums[1] += square + along + across;
    }
    sums
}

fn measure(
    source: &Asset,
    functions: &Functions,
    (wavelet, error, terms): (Wavelet, Option<f64>, Option<usize>),
    pictures: Option<&Path>,
) -> Result<()> {
    let folder = tempfile::tempdir().map_err(|source| relume_core::Error::io("write", Path::new("."), source))?;
    let path = folder.path().join("compact.rfield");
    let scheme = Scheme::Wavelet { wavelet, grid: GRID, reconstruction: Method::BSpline, error, terms };
    let (done, seconds) = timed(|| compress(source, &path, &scheme, &[Kind::Dense], &mut |_, _, _| Ok(())));
    done?;
    let relighter = Relighter::new(Asset::open(&path, Access::Mapped)?);
    let made = relighter.asset();
    let window = Window::full(made.width(), made.height());
    let map = EnvMap::from_fn(256, 128, |d| {
        [2.0, 4.0, 8.0].map(|k: f64| (k * (0.5 * d.x + 0.6 * d.y + 0.62 * d.z - 1.0)).exp() as f32)
    });
    let looks = [Kind::Dense, Kind::Wavelet].map(|kind| Look {
        representation: Some(kind),
        method: Method::BSpline,
        ..Look::default()
    });
    let lit: Vec<Weights> =
        looks.iter().map(|look| relighter.weights(Light::Map(&map), look)).collect::<Result<_>>()?;
    let (mut dense, mut sparse, mut four) = (Vec::new(), Vec::new(), Vec::new());
    for _ in 0..RUNS {
        dense.push(timed(|| relighter.render(&lit[0], &looks[0], window)).1);
        sparse.push(timed(|| relighter.render(&lit[1], &looks[1], window)).1);
        four.push(timed(|| relighter.render_many(&[(&lit[1], &looks[1]); 4], window)).1 / 4.0);
    }
    let (dense, sparse, four) = (median(dense), median(sparse), median(four));
    let [l2, h1] = functions.errors(made)?;
    let stored = made.sparse().map_or(0, |sparse| sparse.terms());
    let reached =
        made.manifest().representation(Kind::Wavelet).and_then(Representation::loss).map_or(0.0, |l| l.reached);
    let name = format!("{} {}", wavelet.id(), error.map_or(format!("{}", terms.unwrap_or(0)), |e| format!("{e}")));
    println!(
        "{name:16} {:9.0} {:7.1} {:9.1} {reached:8.4} {l2:8.4} {h1:8.4} | {:9.2} {:9.2} {:7.1} {:12.2}",
        seconds * 1e6 * rayon::current_num_threads() as f64 / functions.lit as f64,
        stored as f64 / functions.lit as f64,
        made.bytes(Kind::Dense) as f64 / made.bytes(Kind::Wavelet) as f64,
        dense * 1e3,
        sparse * 1e3,
        dense / sparse,
        four * 1e3,
    );
    let Some(folder) = pictures else { return Ok(()) };
    let name = name.replace('/', "").replace(' ', "-");
    let mut shown: Vec<Image> = Vec::new();
    for (look, weights) in looks.iter().zip(&lit) {
        shown.push(relighter.render(weights, look, window)?);
    }
    let off = Image::from_fn(window.width(), window.height(), |x, y| {
        std::array::from_fn::<_, 3, _>(|c| 10.0 * (shown[0].pixel(x, y)[c] - shown[1].pixel(x, y)[c]).abs())
    });
    for (kind, picture) in ["samples", "wavelets", "ten-times-off"].iter().zip(shown.iter().chain([&off])) {
        relume_core::image::write(&folder.join(format!("{name}-{kind}.png")), picture, Default::default())?;
    }
    Ok(())
}

/// The result, and seconds.
fn timed<T>(work: impl FnOnce() -> T) -> (T, f64) {
    let start = Instant::now();
    let result = work();
    (result, start.elapsed().as_secs_f64())
}

fn median(mut times: Vec<f64>) -> f64 {
    times.sort_by(f64::total_cmp);
    times[times.len() / 2]
}
