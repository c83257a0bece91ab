//! Wavelet coefficients of each pixel: what is stored is what was rebuilt, up to what is said to be lost.

use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use relume_core::domain::{Directions, StageGrid};
use relume_core::field::compress::{Scheme, compress};
use relume_core::field::{Access, Asset, Contents, Kind, Precision, Sparse, TermBuffer, write};
use relume_core::illumination::EnvMap;
use relume_core::image::{Image, Window};
use relume_core::reconstruct::{Method, Outside, Reconstruction};
use relume_core::relight::{Light, Look, Relighter, Weights};
use relume_core::simulate::{Camera, Quality, Scene, Stage, grid_lamps};
use relume_core::wavelet::Wavelet;

use tempfile::TempDir;

use super::compact::maps;

/// Divisible by no side of a block.
const SIZE: (usize, usize) = (35, 21);
const GRID: (usize, usize) = (32, 16);
const TEXELS: usize = GRID.0 * GRID.1;
const WAVELETS: [Wavelet; 3] = [Wavelet::Haar, Wavelet::LeGall53, Wavelet::Daubechies97];

/// The demonstration's still life under 24 x 8 lamps, two of which stand there twice.
fn still_life(folder: &Path) -> PathBuf {
    let (width, height) = SIZE;
    let quality = Quality { samples: 8, bounces: 1, stride: 4, cone_density: 0.25, depth: 1, seed: 3 };
    let mut lamps = grid_lamps(24, 8);
    lamps.extend([lamps[5], lamps[100]]);
    let (scene, camera) = (Scene::demo(), Camera::demo(width, height));
    let domain = Directions::new(lamps).unwrap();
    let stage = Stage::new(&scene, camera, &domain, quality);
    let contents = Contents {
        colour_space: Default::default(),
        irradiance: (0..domain.len()).map(|j| 1.0 + j as f32 / 100.0).collect(),
        domain: domain.into(),
        width,
        height,
        precision: Precision::Half,
        largest: stage.largest(),
        ambient: None,
        alpha: None,
        reliability: None,
        provenance: serde_json::json!({"source": "virtual stage"}),
    };
    let path = folder.join("samples.rfield");
    write(&path, &contents, &mut stage.bands(&mut |_, _| Ok(()))).unwrap();
    path
}

/// The still life, photographed on the first call.
struct Made {
    _folder: tempfile::TempDir,
    source: Asset,
    /// `[pixel][channel][texel]`: what the functions are, rebuilt on the grid one by one.
    rebuilt: Vec<[Vec<f32>; 3]>,
}

impl Made {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let source = Asset::open(&still_life(folder.path()), Access::Mapped).unwrap();
        let reconstruction = Reconstruction::new(source.directions().unwrap().clone(), Method::BSpline).unwrap();
        let grid = StageGrid::new(source.directions().unwrap(), GRID).unwrap();
        let directions = grid.directions().unwrap().lamps();
        let samples = source.samples().unwrap();
        let function = |pixel: usize| {
            let rgb = samples.reflectance(pixel % SIZE.0, pixel / SIZE.0).unwrap();
            [0, 1, 2].map(|c| reconstruction.values(&rgb.iter().map(|rgb| rgb[c]).collect::<Vec<f32>>(), directions))
        };
        let rebuilt = (0..SIZE.0 * SIZE.1).map(function).collect();
        Self { _folder: folder, source, rebuilt }
    }

    fn shared() -> &'static Self {
        static MADE: OnceLock<Made> = OnceLock::new();
        MADE.get_or_init(Self::new)
    }

    fn compressed(&self, folder: &TempDir, wavelet: Wavelet, error: Option<f64>, terms: Option<usize>) -> Asset {
        let (scheme, path) = (scheme(wavelet, error, terms), path(folder));
        compress(&self.source, &path, &scheme, &[Kind::Dense], &mut |_, _, _| Ok(())).unwrap();
        Asset::open(&path, Access::Mapped).unwrap()
    }

    /// For each pixel and channel what the decoded function lacks, and the function's own norm.
    fn losses(&self, sparse: &Sparse) -> Vec<([f64; 3], f64)> {
        let loss = |(pixel, rebuilt): (usize, &[Vec<f32>; 3])| {
            let decoded = sparse.reflectance(pixel % SIZE.0, pixel / SIZE.0).unwrap();
            let lost = [0, 1, 2].map(|c| {
                let off = rebuilt[c].iter().zip(&decoded).map(|(t, d)| f64::from(t - d[c]).powi(2));
                off.sum::<f64>().sqrt()
            });
            (lost, rebuilt.iter().flatten().map(|t| f64::from(*t).powi(2)).sum::<f64>().sqrt())
        };
        self.rebuilt.iter().enumerate().map(loss).collect()
    }
}

fn path(folder: &TempDir) -> PathBuf {
    folder.path().join("compact.rfield")
}

fn scheme(wavelet: Wavelet, error: Option<f64>, terms: Option<usize>) -> Scheme {
    Scheme::Wavelet { wavelet, grid: GRID, reconstruction: Method::BSpline, error, terms }
}

fn total(lost: &[f64; 3]) -> f64 {
    lost.iter().map(|l| l * l).sum::<f64>().sqrt()
}

/// Terms of every pixel.
fn counts(sparse: &Sparse) -> Vec<usize> {
    let mut locations = Vec::new();
    let mut count = |pixel: usize| {
        let (x, y) = (pixel % SIZE.0, pixel / SIZE.0);
        let mut buffer = TermBuffer::default();
        let terms = sparse.block(x / 16, y / 8, &mut buffer).unwrap();
        let coefficients = terms.of_pixel(y % 8 * 16 + x % 16, &mut locations);
        assert_eq!(coefficients.len(), 3 * locations.len());
        assert!(locations.windows(2).all(|pair| pair[0] < pair[1]), "locations ascend");
        locations.len()
    };
    (0..SIZE.0 * SIZE.1).map(&mut count).collect()
}

#[test]
fn all_terms_give_the_rebuilt_functions_back() {
    let (made, folder) = (Made::shared(), TempDir::new().unwrap());
    for wavelet in WAVELETS {
        let asset = made.compressed(&folder, wavelet, None, Some(TEXELS));
        asset.verify(&mut |_, _| Ok(())).unwrap();
        for (pixel, (lost, norm)) in made.losses(asset.sparse().unwrap()).iter().enumerate() {
            // A half is right to 2^-11 of each coefficient; the 5/3's functions overlap.
            assert!(total(lost) <= 1e-3 * norm, "{wavelet:?}, pixel {pixel}: {} of {norm}", total(lost));
        }
        assert!(asset.manifest().representation(Kind::Wavelet).unwrap().loss().unwrap().reached < 5e-4);
    }
}

#[test]
fn sets_are_chosen_by_error_by_count_and_by_both() {
    let (made, folder) = (Made::shared(), TempDir::new().unwrap());
    let (error, most) = (0.03, 40);
    for wavelet in WAVELETS {
        let by_error = made.compressed(&folder, wavelet, Some(error), None);
        let losses = made.losses(by_error.sparse().unwrap());
        let lit: Vec<f64> = losses.iter().filter(|l| l.1 > 0.0).map(|(lost, norm)| total(lost) / norm).collect();
        let mean = lit.iter().sum::<f64>() / lit.len() as f64;
        let worst = lit.iter().copied().fold(0.0, f64::max);
        assert!(worst <= error * 1.0001 && mean > 0.85 * error, "{wavelet:?}: {worst}, mean {mean}");
        let of_error = counts(by_error.sparse().unwrap());
        assert_eq!(of_error.iter().sum::<usize>() as u64, by_error.sparse().unwrap().terms());
        for (count, (_, norm)) in of_error.iter().zip(&losses) {
            assert_eq!(*norm == 0.0, *count == 0, "black pixels alone have no terms");
        }
        let by_count = counts(made.compressed(&folder, wavelet, None, Some(most)).sparse().unwrap());
        assert!(by_count.iter().all(|&count| count <= most) && by_count.contains(&most));
        let both = made.compressed(&folder, wavelet, Some(error), Some(most));
        let of_both = counts(both.sparse().unwrap());
        for ((n, count), (lost, norm)) in of_both.iter().enumerate().zip(made.losses(both.sparse().unwrap())) {
            assert_eq!(*count, of_error[n].min(most), "{wavelet:?}, pixel {n}");
            assert!(*count == most || total(&lost) <= error * 1.0001 * norm, "{wavelet:?}, pixel {n}");
        }
        let Some(relume_core::field::Representation::Wavelet { most_terms, loss, .. }) =
            both.manifest().representation(Kind::Wavelet)
        else {
            panic!("a wavelet representation")
        };
        assert_eq!((*most_terms, loss.as_ref().unwrap().asked), (Some(most), Some(error)));
    }
}

/// The picture under weights of the grid's texels, from functions: the oracle.
fn lit_by(functions: impl Fn(usize, usize, usize) -> f32, weights: &Weights) -> Image {
    Image::from_fn(SIZE.0, SIZE.1, |x, y| {
        std::array::from_fn(|c| {
            let product =
                |(texel, w): (usize, &[f32; 3])| f64::from(functions(y * SIZE.0 + x, c, texel)) * f64::from(w[c]);
            weights.rgb.iter().enumerate().map(product).sum::<f64>() as f32
        })
    })
}

/// The light goes through the adjoint of the synthesis, which the 9/7 and the 5/3 tell from everything else, and what a
/// pixel lost bounds its pictures.
#[test]
fn pictures_are_those_of_the_decoded_functions_and_within_the_errors() {
    let (made, folder) = (Made::shared(), TempDir::new().unwrap());
    for wavelet in WAVELETS {
        let relighter = Relighter::new(made.compressed(&folder, wavelet, Some(0.05), None)).unwrap();
        let errors = relighter.asset().errors(Kind::Wavelet).unwrap().unwrap();
        let sparse = relighter.asset().sparse().unwrap();
        for (e, (lost, norm)) in errors.iter().zip(made.losses(sparse)) {
            let worst = lost.iter().copied().fold(0.0, f64::max);
            let off = (f64::from(*e) - worst).abs();
            assert!(off <= 2e-3 * worst + 1e-6 * norm, "{wavelet:?}: {e}, not {worst}");
        }
        let decoded: Vec<Vec<[f32; 3]>> =
            (0..errors.len()).map(|n| sparse.reflectance(n % SIZE.0, n / SIZE.0).unwrap()).collect();
        let look = Look {
            representation: Some(Kind::Wavelet),
            outside: Outside::Nearest,
            exposure_ev: 0.5,
            ..Look::default()
        };
        let maps = maps();
        let lights = maps.iter().map(Light::Map).chain([Light::Lamp(1), Light::Lamp(77), Light::Lamp(194)]);
        let mut used: f32 = 0.0;
        for light in lights {
            let weights = relighter.weights(light, &look).unwrap();
            let picture = relighter.render(&weights, &look, Window::full(SIZE.0, SIZE.1)).unwrap();
            let oracle = lit_by(|pixel, c, texel| decoded[pixel][texel][c], &weights);
            let reference = lit_by(|pixel, c, texel| made.rebuilt[pixel][c][texel], &weights);
            let norms: [f32; 3] = std::array::from_fn(|c| weights.rgb.iter().map(|w| w[c] * w[c]).sum::<f32>().sqrt());
            for (n, e) in errors.iter().enumerate() {
                for (c, norm) in norms.iter().enumerate() {
                    let [lit, expected, exact] =
                        [picture.data()[4 * n + c], oracle.data()[3 * n + c], reference.data()[3 * n + c]];
                    // Sums in single precision of terms of either sign.
                    let length = made.rebuilt[n][c].iter().map(|t| t * t).sum::<f32>().sqrt();
                    let rounding = 3e-6 * length * norm;
                    assert!((lit - expected).abs() <= rounding, "{wavelet:?}, pixel {n}: {lit}, not {expected}");
                    assert!((lit - exact).abs() <= e * norm + rounding, "{wavelet:?}, pixel {n}: {lit} of {exact}");
                    if e * norm > 10.0 * rounding {
                        used = used.max((lit - exact).abs() / (e * norm));
                    }
                }
            }
        }
        // A bound that nothing comes near would promise little.
        assert!(used > 0.3, "{wavelet:?}: at most {used} of the bound is used");
    }
}

/// Light falls on the grid as it falls on the lamps: the same picture, but for how functions are filled in.
#[test]
fn pictures_are_about_those_of_the_samples() {
    let (made, folder) = (Made::shared(), TempDir::new().unwrap());
    let relighter = Relighter::new(made.compressed(&folder, Wavelet::Daubechies97, Some(0.02), None)).unwrap();
    let look = Look { outside: Outside::Drop, method: Method::BSpline, heading_deg: 30.0, ..Look::default() };
    let map = EnvMap::from_fn(64, 32, |d| {
        [1.0, 2.0, 4.0].map(|sharp: f64| (sharp * (d.x * 0.4 + d.y * 0.5 + d.z * 0.7 - 1.0)).exp() as f32)
    });
    let picture = |light, kind| {
        let look = Look { representation: Some(kind), ..look };
        let weights = relighter.weights(light, &look).unwrap();
        assert_eq!(weights.kind(), kind);
        relighter.render(&weights, &look, Window::full(SIZE.0, SIZE.1)).unwrap()
    };
    let relative = |a: &Image, b: &Image| {
        let square = |f: &dyn Fn(f32, f32) -> f32| {
            a.data().iter().zip(b.data()).map(|(a, b)| f64::from(f(*a, *b)).powi(2)).sum::<f64>()
        };
        (square(&|a, b| a - b) / square(&|_, b| b)).sqrt()
    };
    let of_map = relative(&picture(Light::Map(&map), Kind::Wavelet), &picture(Light::Map(&map), Kind::Dense));
    assert!(of_map < 0.03, "{of_map}");
    // Highlights of one lamp are wider on the grid; no photograph of a lamp from another side is as near.
    let lamps = [30, 36, 42, 48, 150];
    let photographs = lamps.map(|lamp| picture(Light::Lamp(lamp), Kind::Dense));
    for (n, lamp) in lamps.into_iter().enumerate() {
        let lit = picture(Light::Lamp(lamp), Kind::Wavelet);
        let off = photographs.each_ref().map(|photograph| relative(&lit, photograph));
        let nearest = (0..lamps.len()).min_by(|&a, &b| off[a].total_cmp(&off[b]));
        assert!(nearest == Some(n) && off[n] < 0.5, "lamp {lamp}: {off:?}");
    }
}

#[test]
fn windows_threads_and_company_change_nothing() {
    let (made, folder) = (Made::shared(), TempDir::new().unwrap());
    let relighter = Relighter::new(made.compressed(&folder, Wavelet::LeGall53, None, Some(20))).unwrap();
    let look = Look { representation: Some(Kind::Wavelet), ..Look::default() };
    let maps = maps();
    let weights: Vec<Weights> =
        maps.iter().take(3).map(|map| relighter.weights(Light::Map(map), &look).unwrap()).collect();
    let full = Window::full(SIZE.0, SIZE.1);
    let whole: Vec<Image> = weights.iter().map(|w| relighter.render(w, &look, full).unwrap()).collect();
    for window in [full, Window { x0: 3, y0: 5, x1: 18, y1: 17 }, Window { x0: 33, y0: 20, x1: 35, y1: 21 }] {
        let lights: Vec<(&Weights, &Look)> = weights.iter().map(|w| (w, &look)).collect();
        for (part, whole) in relighter.render_many(&lights, window).unwrap().iter().zip(&whole) {
            for (y, x) in (0..window.height()).flat_map(|y| (0..window.width()).map(move |x| (y, x))) {
                assert_eq!(part.pixel(x, y), whole.pixel(window.x0 + x, window.y0 + y));
            }
        }
    }
    assert_eq!(relighter.dark(Kind::Wavelet).rgb.len(), TEXELS);
    let other = folder.path().join("other.rfield");
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let scheme = scheme(Wavelet::LeGall53, None, Some(20));
    pool.install(|| compress(&made.source, &other, &scheme, &[Kind::Dense], &mut |_, _, _| Ok(()))).unwrap();
    let other = Asset::open(&other, Access::Read).unwrap();
    assert_eq!(other.manifest().blake3, relighter.asset().manifest().blake3);
    let read = Relighter::new(other).unwrap();
    assert_eq!(read.render(&weights[0], &look, full).unwrap().data(), whole[0].data());
}

/// Where the numbers of an array start in the bytes of a container.
fn numbers_of(bytes: &[u8], entry: &str) -> usize {
    let find = |what: &[u8], from: usize| from + bytes[from..].windows(what.len()).position(|w| w == what).unwrap();
    let start = find(b"\x93NUMPY", find(entry.as_bytes(), 0));
    start + 10 + usize::from(u16::from_le_bytes([bytes[start + 8], bytes[start + 9]]))
}

#[test]
fn damaged_sets_are_refused_with_a_sentence() {
    let (made, folder) = (Made::shared(), TempDir::new().unwrap());
    drop(made.compressed(&folder, Wavelet::Daubechies97, None, Some(12)));
    let bytes = std::fs::read(path(&folder)).unwrap();
    let [offsets, locations, coefficients] = ["offsets", "locations", "coefficients"]
        .map(|array| numbers_of(&bytes, &format!("transport/wavelet-{array}.npy")));
    let pixels = SIZE.0.div_ceil(16) * SIZE.1.div_ceil(8) * 128;
    let attack = |at: usize, with: &[u8]| {
        let mut bytes = bytes.clone();
        bytes[at..at + with.len()].copy_from_slice(with);
        let path = folder.path().join("damaged.rfield");
        std::fs::write(&path, bytes).unwrap();
        let try_it = |access| {
            let relighter = Relighter::new(Asset::open(&path, access)?)?;
            let look = Look { representation: Some(Kind::Wavelet), ..Look::default() };
            let weights = relighter.weights(Light::Lamp(3), &look)?;
            relighter.render(&weights, &look, Window::full(SIZE.0, SIZE.1)).map(drop)
        };
        let [mapped, read] = [Access::Mapped, Access::Read].map(|access| try_it(access).unwrap_err().to_string());
        assert_eq!(mapped, read);
        mapped
    };
    for (entry, value) in [(130, u64::MAX), (130, 1 << 40), (1, 0x8000), (200, 0), (500, u64::MAX - 3)] {
        let message = attack(offsets + 8 * entry, &value.to_le_bytes());
        assert!(message.contains("offsets of terms that cannot be"), "{message}");
    }
    for last in [0, 1, u64::MAX, u64::MAX / 6, 1 << 33] {
        let message = attack(offsets + 8 * pixels, &last.to_le_bytes());
        assert!(message.contains("wavelet-locations.npy"), "{message}");
    }
    for location in [TEXELS as u16, u16::MAX] {
        let message = attack(locations + 2 * 700, &location.to_le_bytes());
        assert!(message.contains("a location outside of the grid"), "{message}");
    }
    let message = attack(coefficients + 6 * 700, &half::f16::NAN.to_le_bytes());
    assert!(message.contains("not finite"), "{message}");
}

#[test]
fn what_wavelets_cannot_do_is_a_sentence_and_no_file() {
    let (made, folder) = (Made::shared(), TempDir::new().unwrap());
    let before = std::fs::read_dir(folder.path()).unwrap().count();
    let refused = |wavelet, grid, error, terms| {
        let scheme = Scheme::Wavelet { wavelet, grid, reconstruction: Method::BSpline, error, terms };
        compress(&made.source, &path(&folder), &scheme, &[], &mut |_, _, _| Ok(())).unwrap_err().to_string()
    };
    for error in [0.0, 0.0009, -1.0, 1.0, f64::NAN, f64::INFINITY] {
        let message = refused(Wavelet::Haar, GRID, Some(error), None);
        assert!(message.contains("0.001 to 1"), "{message}");
    }
    let message = refused(Wavelet::Haar, GRID, Some(0.1), Some(0));
    assert!(message.contains("at least 1 a pixel"), "{message}");
    let message = refused(Wavelet::Haar, GRID, None, None);
    assert!(message.contains("neither an error nor a number of terms"), "{message}");
    for size in [(4, 4), (7, 4), (32, 2), (0, 0), (32, 100_000)] {
        let message = refused(Wavelet::Haar, size, Some(0.1), None);
        assert!(message.contains("columns and 4 to"), "{message}");
    }
    let message = refused(Wavelet::Daubechies4, GRID, Some(0.1), None);
    assert!(message.contains("use cyclic edges, or haar"), "{message}");
    let good = scheme(Wavelet::Haar, Some(0.1), None);
    let mut rows = 0;
    let stopped = compress(&made.source, &path(&folder), &good, &[], &mut |stage, done, _| {
        rows += usize::from(stage == relume_core::field::compress::Stage::Compressing);
        if rows == 2 && done == 2 { Err(relume_core::Error::Cancelled) } else { Ok(()) }
    });
    assert!(matches!(stopped, Err(relume_core::Error::Cancelled)));
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), before);
}
