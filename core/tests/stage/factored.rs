//! Factored fields against plain products, and files that lie about them.

use std::io::Read;
use std::ops::Range;
use std::path::{Path, PathBuf};

use rand::{RngExt, SeedableRng};
use relume_core::Result;
use relume_core::domain::Directions;
use relume_core::field::compress::{Scheme, compress};
use relume_core::field::{Access, Asset, Bands, Block, BlockBuffer, Contents, Kind, Precision, Samples, write};
use relume_core::image::{Image, Window};
use relume_core::relight::{Weights, apply};
use relume_core::simulate::grid_lamps;

use super::compact::{SIZE, still_life};

fn made(source: &Path, name: &str, error: f64) -> PathBuf {
    let path = source.with_file_name(name);
    let source = Asset::open(source, Access::Mapped).unwrap();
    compress(&source, &path, &Scheme::Factored { error }, &[], &mut |_, _, _| Ok(())).unwrap();
    path
}

/// The still life and its factored form.
struct Pair {
    folder: tempfile::TempDir,
    samples: Asset,
    factored: Asset,
}

impl Pair {
    fn new(error: f64) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let source = still_life(folder.path());
        let factored = made(&source, "factored.rfield", error);
        let open = |path: &Path| Asset::open(path, Access::Mapped).unwrap();
        Self { samples: open(&source), factored: open(&factored), folder }
    }

    fn path(&self) -> &Path {
        self.factored.path()
    }
}

fn random_weights(lamps: usize, seed: u64) -> Weights {
    let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(seed);
    Weights::of_lamps((0..lamps).map(|_| std::array::from_fn(|_| rng.random_range(0.0..1.0))).collect())
}

/// All numbers of a field, `[pixel][channel][lamp]`, in f64.
fn numbers(samples: Samples<'_>) -> Vec<[Vec<f64>; 3]> {
    let layout = samples.layout();
    let mut all = vec![[const { Vec::new() }; 3]; layout.width * layout.height];
    let (mut room, mut numbers) = (BlockBuffer::default(), Vec::new());
    for (by, bx) in (0..layout.rows()).flat_map(|by| (0..layout.columns()).map(move |bx| (by, bx))) {
        for c in 0..3 {
            samples.read(bx, by, c, &mut room, &mut numbers).unwrap();
            let inside = (0..128).map(|at| (at, bx * 16 + at % 16, by * 8 + at / 16));
            for (at, x, y) in inside.filter(|(_, x, y)| *x < layout.width && *y < layout.height) {
                let of_pixel = numbers.iter().skip(at).step_by(128).map(|t| f64::from(t * samples.scale()));
                let pixel = &mut all[y * layout.width + x];
                pixel[c] = of_pixel.collect();
            }
        }
    }
    all
}

fn norm(numbers: impl Iterator<Item = f64>) -> f64 {
    numbers.map(|v| v * v).sum::<f64>().sqrt()
}

#[test]
fn what_is_decoded_is_the_product_of_what_is_stored() {
    let pair = Pair::new(0.04);
    let factored = pair.factored.factored().unwrap();
    let (layout, tiles) = (factored.layout(), factored.tiles());
    let (mut room, mut other, mut decoded) = (BlockBuffer::default(), BlockBuffer::default(), Vec::new());
    for (bx, by, c) in [(0, 0, 0), (2, 3, 1), (4, 6, 2), (1, 4, 0)] {
        let tile = by * 8 / tiles.size[1] * tiles.columns() + bx * 16 / tiles.size[0];
        let right = factored.right(tile, &mut room).unwrap();
        let Block::Half(left) = factored.block(bx, by, c, &mut other).unwrap() else { panic!("halves") };
        let rank = factored.ranks()[tile] as usize;
        assert_eq!((left.len(), right.len()), (rank * 128, rank * layout.elements));
        let mut expected = vec![0.0f64; layout.elements * 128];
        for (j, element) in expected.chunks_exact_mut(128).enumerate() {
            for r in 0..rank {
                let b = right[r * layout.elements + j].to_f64();
                element.iter_mut().zip(&left[r * 128..]).for_each(|(sum, a)| *sum += a.to_f64() * b);
            }
        }
        let mut room = BlockBuffer::default();
        Samples::Factored(factored).read(bx, by, c, &mut room, &mut decoded).unwrap();
        let largest = expected.iter().fold(1e-30f64, |most, v| most.max(v.abs()));
        assert!(decoded.iter().zip(&expected).all(|(d, e)| (f64::from(*d) - e).abs() < 1e-5 * largest));
    }
}

/// The oracle: the decoded samples, multiplied plainly.
#[test]
fn it_relights_as_its_decoded_samples_do() {
    let pair = Pair::new(0.04);
    let samples = pair.factored.samples().unwrap();
    assert_eq!(samples.kind(), Kind::Factored);
    let all = numbers(samples);
    let lamps = pair.factored.directions().unwrap().len();
    let weights: Vec<Weights> = (0..6).map(|seed| random_weights(lamps, seed)).collect();
    let full = Window::full(SIZE.0, SIZE.1);
    let alone: Vec<Image> = weights.iter().map(|w| apply(samples, &[w], full).unwrap().remove(0)).collect();
    for (picture, w) in alone.iter().zip(&weights) {
        for (pixel, functions) in picture.data().chunks(3).zip(&all) {
            for c in 0..3 {
                let expected: f64 = functions[c].iter().zip(&w.rgb).map(|(t, w)| t * f64::from(w[c])).sum();
                let reach: f64 = functions[c].iter().map(|t| t.abs()).sum();
                assert!(
                    (f64::from(pixel[c]) - expected).abs() <= 2e-5 * reach + 1e-7,
                    "{} is not {expected}",
                    pixel[c]
                );
            }
        }
    }
    // Company, threads, access and windows change no bit.
    let together: Vec<&Weights> = weights.iter().collect();
    assert_eq!(apply(samples, &together, full).unwrap(), alone);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(3).build().unwrap();
    assert_eq!(pool.install(|| apply(samples, &[&weights[0]], full)).unwrap()[0], alone[0]);
    let read = Asset::open(pair.path(), Access::Read).unwrap();
    assert_eq!(apply(read.samples().unwrap(), &[&weights[0]], full).unwrap()[0], alone[0]);
    for (x0, y0, x1, y1) in [(0, 0, 1, 1), (15, 7, 49, 41), (64, 32, 74, 51), (33, 0, 34, 51)] {
        let window = Window { x0, y0, x1, y1 };
        let part = apply(samples, &[&weights[1]], window).unwrap().remove(0);
        for (x, y) in (y0..y1).flat_map(|y| (x0..x1).map(move |x| (x, y))) {
            assert_eq!(part.pixel(x - x0, y - y0), alone[1].pixel(x, y), "{window:?} at {x}, {y}");
        }
    }
    assert!(apply(samples, &[&weights[0]], Window::full(SIZE.0 + 1, SIZE.1)).is_err());
    assert!(apply(samples, &[&random_weights(3, 1)], full).is_err());
}

#[test]
fn the_error_asked_for_is_kept_and_measured() {
    let folder = tempfile::tempdir().unwrap();
    let source = still_life(folder.path());
    let exact = numbers(Asset::open(&source, Access::Mapped).unwrap().samples().unwrap());
    let energy = norm(exact.iter().flatten().flatten().copied());
    let mut bytes = u64::MAX;
    for error in [0.002, 0.3] {
        let asset = Asset::open(&made(&source, "factored.rfield", error), Access::Mapped).unwrap();
        asset.verify(&mut |_, _| Ok(())).unwrap();
        let decoded = numbers(asset.samples().unwrap());
        let loss = asset.manifest().representation(Kind::Factored).unwrap().loss().unwrap().clone();
        assert_eq!(loss.asked, Some(error));
        assert!(loss.reached <= error, "{} for {error}", loss.reached);
        let lost = |p: usize, c: usize| norm(exact[p][c].iter().zip(&decoded[p][c]).map(|(t, d)| t - d));
        let reached =
            norm((0..exact.len()).flat_map(|p| (0..3).map(move |c| (p, c))).map(|(p, c)| lost(p, c))) / energy;
        assert!((reached / loss.reached - 1.0).abs() < 1e-3, "{reached} against {}", loss.reached);
        // e_p is the error of the worst channel, and no more than rounding up makes of it: a light shaped as the error itself
        // uses all of the bound.
        for (p, e) in asset.errors(Kind::Factored).unwrap().unwrap().into_iter().enumerate() {
            let worst = (0..3).map(|c| lost(p, c)).fold(0.0, f64::max);
            let (e, least) = (f64::from(e), f64::from(loss.scale) * 2f64.powi(-24));
            assert!(
                e >= worst * (1.0 - 1e-4) - 1e-6 && e <= worst * 1.0015 + least + 1e-6,
                "pixel {p}: {e} for {worst}"
            );
        }
        // Less is asked for, less is stored.
        assert!(asset.bytes(Kind::Factored) < bytes);
        bytes = asset.bytes(Kind::Factored);
    }
}

#[test]
fn black_tiles_have_rank_0_and_stay_black() {
    let pair = Pair::new(0.04);
    let factored = pair.factored.factored().unwrap();
    // The still life stands on a round table; the corners of the picture show nothing.
    assert_eq!(factored.ranks()[0], 0);
    let window = Window { x0: 0, y0: 0, x1: 16, y1: 8 };
    let weights = random_weights(pair.samples.directions().unwrap().len(), 1);
    let picture = apply(Samples::Factored(factored), &[&weights], window).unwrap().remove(0);
    assert!(picture.data().iter().all(|v| *v == 0.0));
    assert!(factored.ranks().iter().any(|&rank| rank > 20));
}

#[test]
fn errors_that_halves_cannot_keep_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let source = Asset::open(&still_life(folder.path()), Access::Mapped).unwrap();
    let output = folder.path().join("x.rfield");
    for error in [0.0, -0.1, 0.0009, 1.0, f64::NAN, f64::INFINITY] {
        let scheme = Scheme::Factored { error };
        let message = compress(&source, &output, &scheme, &[], &mut |_, _, _| Ok(())).unwrap_err().to_string();
        assert!(message.contains("0.001 to 1"), "{message}");
    }
    // Stopped while the energy is measured, and while sizes of tiles are tried.
    for stop in [1, 8] {
        let mut steps = 0;
        let stopped = compress(&source, &output, &Scheme::Factored { error: 0.1 }, &[], &mut |_, _, _| {
            steps += 1;
            if steps >= stop { Err(relume_core::Error::Cancelled) } else { Ok(()) }
        });
        assert!(matches!(stopped, Err(relume_core::Error::Cancelled)));
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "something is left of a stop at {stop}");
    }
}

/// `T = f(tile, lamp) (1 + x + 2 y + c)`, one function for each square of `side` pixels.
struct Patches {
    side: usize,
    functions: Vec<Vec<f32>>,
}

impl Bands for Patches {
    fn fill(&mut self, by: usize, columns: Range<usize>, blocks: &mut [f32]) -> Result<()> {
        let lamps = self.functions[0].len();
        for (n, number) in blocks.iter_mut().enumerate() {
            let (at, lamp, c) = (n % 128, n / 128 % lamps, n / (128 * lamps) % 3);
            let (x, y) = ((columns.start + n / (3 * 128 * lamps)) * 16 + at % 16, by * 8 + at / 16);
            let function = &self.functions[x / self.side * 7 + y / self.side];
            *number = function[lamp] * (1 + x + 2 * y + c) as f32 / 500.0;
        }
        Ok(())
    }
}

#[test]
fn tiles_are_as_large_as_functions_are_alike() {
    let folder = tempfile::tempdir().unwrap();
    let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(7);
    let domain = Directions::new(grid_lamps(12, 8)).unwrap();
    for side in [128, 32, 16] {
        let path = folder.path().join("patches.rfield");
        let contents = Contents {
            colour_space: Default::default(),
            irradiance: vec![1.0; domain.len()],
            domain: domain.clone().into(),
            width: 128,
            height: 128,
            precision: Precision::Half,
            largest: 1.0,
            ambient: None,
            alpha: None,
            reliability: None,
            provenance: serde_json::Value::Null,
        };
        let functions = (0..64).map(|_| (0..domain.len()).map(|_| rng.random_range(0.0..1.0)).collect()).collect();
        write(&path, &contents, &mut Patches { side, functions }).unwrap();
        let asset = Asset::open(&made(&path, "factored.rfield", 0.01), Access::Mapped).unwrap();
        let factored = asset.factored().unwrap();
        assert_eq!(factored.tiles().size, [side.min(64); 2], "patches of {side}");
        assert!(factored.ranks().iter().all(|&rank| rank == 1), "{:?}", factored.ranks());
    }
}

/// Byte of the file at which an entry starts.
fn start_of(path: &Path, entry: &str) -> usize {
    let mut zip = zip::ZipArchive::new(std::fs::File::open(path).unwrap()).unwrap();
    let entry = zip.by_name(entry).unwrap();
    entry.data_start().unwrap() as usize
}

#[test]
fn files_that_lie_are_refused_with_a_sentence() {
    let pair = Pair::new(0.04);
    let mut good = Vec::new();
    std::fs::File::open(pair.path()).unwrap().read_to_end(&mut good).unwrap();
    // Numbers start after the header, 128 bytes for these short shapes.
    let [ranks, left, right] =
        ["ranks", "left", "right"].map(|name| start_of(pair.path(), &format!("transport/factored-{name}.npy")) + 128);
    let bad = pair.folder.path().join("bad.rfield");
    let changed = |at: usize, bytes: &[u8]| {
        let mut file = good.clone();
        file[at..at + bytes.len()].copy_from_slice(bytes);
        std::fs::write(&bad, file).unwrap();
        Asset::open(&bad, Access::Mapped)
    };
    let most = pair.factored.directions().unwrap().len() as u32;
    for (rank, what) in [(u32::MAX, "rank 4294967295"), (most + 1, "at most 320"), (1, "factored-left.npy")] {
        let message = changed(ranks, &rank.to_le_bytes()).unwrap_err().to_string();
        assert!(message.contains(what) && message.contains("bad.rfield"), "{message}");
    }
    let weights = random_weights(pair.samples.directions().unwrap().len(), 1);
    for at in [left, right] {
        let asset = changed(at, &0x7e00u16.to_le_bytes()).unwrap();
        let samples = asset.samples().unwrap();
        let message = apply(samples, &[&weights], Window::full(SIZE.0, SIZE.1)).unwrap_err().to_string();
        assert!(message.contains("not finite") && message.contains("bad.rfield"), "{message}");
        let read = |(bx, by)| samples.read(bx, by, 0, &mut BlockBuffer::default(), &mut Vec::new());
        let places = (0..7).flat_map(|by| (0..5).map(move |bx| (bx, by)));
        let refused: Vec<String> = places.filter_map(|place| read(place).err()).map(|e| e.to_string()).collect();
        assert!(!refused.is_empty() && refused.iter().all(|m| m.contains("lamp")), "{refused:?}");
    }
}
