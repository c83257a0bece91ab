//! The command line on whole sets: many lamps, odd arrangements, numpy's view of the arrays, and a real painting.

use std::f64::consts::PI;
use std::fs;
use std::path::Path;
use std::process::Command;
use std::sync::Arc;

use rand::seq::SliceRandom;
use rand::{RngExt, SeedableRng};
use relume_core::field::{Access, Asset, Block, BlockBuffer};
use relume_core::image::{EncodeOptions, Encoding, Image, read, write};
use relume_core::reconstruct::{Method, Operator, Outside, Reconstruction};
use relume_tests::{shared_data, skipped};
use serde_json::Value;

use crate::cli::{Set, difference, info, relight, run, succeed, text, tool};

/// `n` directions spread evenly over the cap of the sphere above `lowest` z: a Fibonacci lattice.
fn lattice(n: usize, lowest: f64) -> Vec<[f64; 3]> {
    let golden = PI * (3.0 - 5f64.sqrt());
    let direction = |k: usize| {
        let z = 1.0 - (1.0 - lowest) * (k as f64 + 0.5) / n as f64;
        let r = (1.0 - z * z).sqrt();
        [r * (golden * k as f64).cos(), r * (golden * k as f64).sin(), z]
    };
    (0..n).map(direction).collect()
}

/// Photographs of 16 x 8: one block.
const TINY: (usize, usize) = (16, 8);

/// Linear reconstruction over the asset's lamps, for maps of one size.
fn operator(asset: &Asset, w: usize, h: usize) -> Operator {
    let reconstruction = Reconstruction::new(asset.directions().unwrap().clone(), Method::Linear).unwrap();
    Operator::new(Arc::new(reconstruction), Outside::Drop, w, h)
}

/// A constant map of radiance 1 gives `sum_j Omega_j T_j`, by numbers that never met the tool's relighting: `T_j` are the
/// photographs over pi, `Omega_j` the operator's solid angles, which sum to the coverage.
fn constant_light_is_the_sum_over_lamps(set: &Set, field: &Path) {
    let (w, h) = (256, 128);
    write(&set.path("one.exr"), &Image::from_fn(w, h, |_, _| [1.0; 3]), EncodeOptions::default()).unwrap();
    let map = set.path("one.exr").display().to_string();
    let lit = relight(field, &set.out().join("one.tif"), &["--env", &map]);
    let asset = Asset::open(field, Access::Mapped).unwrap();
    let omega = operator(&asset, w, h).solid_angles();
    let covered: f64 = omega.iter().sum();
    assert!((covered / asset.directions().unwrap().covered_solid_angle() - 1.0).abs() < 1e-4, "covered {covered}");
    let (x, y) = lit.size();
    let expected = Image::from_fn(x, y, |x, y| {
        std::array::from_fn(|c| {
            let lamp = |(photo, omega): (&Image, &f64)| omega * f64::from(photo.pixel(x, y)[c]) / PI;
            set.photographs.iter().zip(&omega).map(lamp).sum::<f64>() as f32
        })
    });
    let off = difference(&lit, &expected);
    assert!(off < 1e-4, "off by {off}");
}

#[test]
fn sets_of_240_1280_and_5000_lamps_import() {
    for (count, lowest) in [(240, 0.0), (1280, -1.0), (5000, -1.0)] {
        let set = Set::new(&lattice(count, lowest), TINY, "tif");
        let field = set.import(&["--precision", "float"]);
        let told = info(&field);
        assert_eq!((&told["lamps"], &told["sites"]), (&count.into(), &count.into()));
        let kind = if lowest < 0.0 { "sphere" } else { "cap" };
        assert_eq!(told["coverage"]["kind"], kind, "{count} lamps");
        for number in [1, count / 2, count] {
            let lit = relight(&field, &set.out().join("lit.tif"), &["--lamp", &number.to_string()]);
            assert!(difference(&lit, &set.photographs[number - 1]) < 1e-6, "lamp {number} of {count}");
        }
        constant_light_is_the_sum_over_lamps(&set, &field);
    }
}

#[test]
fn the_order_of_the_list_does_not_matter() {
    let sorted = Set::new(&lattice(60, 0.0), TINY, "tif");
    let lp = fs::read_to_string(sorted.path("dirs.lp")).unwrap();
    let mut lines: Vec<&str> = lp.lines().skip(1).collect();
    lines.shuffle(&mut rand_pcg::Pcg64Mcg::seed_from_u64(7));
    let field = sorted.import(&["--precision", "float"]);
    let mut noise = rand_pcg::Pcg64Mcg::seed_from_u64(8);
    let map = Image::from_fn(64, 32, |_, _| [noise.random(), noise.random(), noise.random()]);
    write(&sorted.path("noise.exr"), &map, EncodeOptions::default()).unwrap();
    let map = sorted.path("noise.exr").display().to_string();
    let expected = relight(&field, &sorted.out().join("lit.tif"), &["--env", &map]);
    fs::write(sorted.path("dirs.lp"), format!("60\n{}\n", lines.join("\n"))).unwrap();
    let shuffled = sorted.import(&["--precision", "float"]);
    let lit = relight(&shuffled, &sorted.out().join("lit.tif"), &["--env", &map]);
    // The same sums in another order.
    assert!(difference(&lit, &expected) < 1e-5);
}

#[test]
fn duplicates_are_told_and_share_their_light() {
    let mut directions = lattice(30, 0.0);
    directions.extend([directions[3], directions[3]]);
    let set = Set::new(&directions, TINY, "tif");
    let mut import = tool(&["import", "lp"]);
    let output = run(import.arg(set.path("dirs.lp")).arg("-o").arg(set.out().join("a.rfield")));
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "{said}");
    assert!(said.starts_with("note: 3 lamps share a direction (lamps 4, 31, 32)"), "{said}");
    let field = set.import(&["--precision", "float"]);
    let told = info(&field);
    assert_eq!((&told["lamps"], &told["sites"]), (&32.into(), &30.into()));
    constant_light_is_the_sum_over_lamps(&set, &field);
}

#[test]
fn vectors_of_other_lengths_are_scaled_on_request() {
    let s = 3.0;
    let set = Set::new(&[[0.0, 0.0, s], [s, 0.0, 0.0], [0.0, s, 0.0]], TINY, "tif");
    let field = set.import(&["--normalise-directions"]);
    assert_eq!(Asset::open(&field, Access::Read).unwrap().directions().unwrap().lamps()[1].x, 1.0);
}

/// Reads the transport out of a container with nothing but Python's own zipfile and numpy: shape and type as JSON, then
/// T of one pixel over all lamps, and its sum in f64.
const NUMPY: &str = "
import io, json, sys, zipfile, numpy
with zipfile.ZipFile(sys.argv[1]) as container:
    manifest = json.loads(container.read('manifest.json'))
    with container.open('transport/dense.npy') as entry:
        transport = numpy.load(entry)
    ambient = numpy.load(io.BytesIO(container.read('layers/ambient.npy')))
    with container.open('transport/dense.npy') as entry:
        version = numpy.lib.format.read_magic(entry)
scale = manifest['representations'][0]['scale']
print(json.dumps({
    'shape': transport.shape, 'dtype': transport.dtype.str, 'version': version,
    'pixel': (transport[1, 1, 2, :, 2, 4].astype('f8') * scale).tolist(),
    'sum': float(transport.astype('f8').sum() * scale),
    'ambient': ambient[10, 20].tolist(), 'ambient_shape': ambient.shape}))
";

#[test]
fn numpy_opens_the_arrays() {
    let numpy = Command::new("python3").args(["-c", "import numpy"]).output();
    if !numpy.is_ok_and(|output| output.status.success()) {
        return skipped("python3 with numpy");
    }
    // 21 x 11 pixels are 2 x 2 blocks.
    let set = Set::new(&lattice(7, 0.0), (21, 11), "tif");
    let black = Image::from_fn(21, 11, |x, y| [0.001 * x as f32, 0.002 * y as f32, 0.05]);
    write(&set.path("black.tif"), &black, EncodeOptions::default()).unwrap();
    let black_path = set.path("black.tif").display().to_string();
    for (precision, dtype) in [("half", "<f2"), ("float", "<f4")] {
        let field = set.import(&["--precision", precision, "--black", &black_path]);
        let told: Value =
            serde_json::from_str(&succeed(Command::new("python3").args(["-c", NUMPY]).arg(&field))).unwrap();
        assert_eq!(told["shape"], serde_json::json!([2, 2, 3, 7, 8, 16]));
        assert_eq!((&told["dtype"], &told["version"]), (&dtype.into(), &serde_json::json!([1, 0])));
        assert_eq!(told["ambient_shape"], serde_json::json!([11, 21, 3]));
        assert_eq!(told["ambient"], serde_json::json!(black.pixel(20, 10)));
        // Block (1, 1), row 2, column 4 is pixel (20, 10); channel 2 is blue.
        let (numbers, sum) = core_numbers(&field);
        assert_eq!(told["pixel"], serde_json::json!(numbers));
        assert!((told["sum"].as_f64().unwrap() / sum - 1.0).abs() < 1e-12);
        for (t, photo) in numbers.iter().zip(&set.photographs) {
            let expected = f64::from(photo.pixel(20, 10)[2] - black.pixel(20, 10)[2]) / PI;
            assert!((t / expected - 1.0).abs() < 1e-3, "{t} is not {expected}");
        }
    }
}

/// What the core reads where [`NUMPY`] looks: T of blue at pixel (20, 10), and the sum of all numbers.
fn core_numbers(field: &Path) -> (Vec<f64>, f64) {
    let asset = Asset::open(field, Access::Read).unwrap();
    let (dense, layout) = (asset.dense().unwrap(), asset.dense().unwrap().layout());
    let scale = f64::from(dense.scale());
    let mut buffer = BlockBuffer::default();
    let mut numbers = |bx: usize, by: usize, c: usize| -> Vec<f64> {
        match dense.block(bx, by, c, &mut buffer).unwrap() {
            Block::Half(block) => block.iter().map(|v| f64::from(v.to_f32()) * scale).collect(),
            Block::Float(block) => block.iter().map(|v| f64::from(*v) * scale).collect(),
        }
    };
    let pixel = numbers(1, 1, 2).chunks(128).map(|element| element[2 * 16 + 4]).collect();
    let mut sum = 0.0;
    for (by, bx, c) in
        (0..layout.rows()).flat_map(|by| (0..layout.columns()).flat_map(move |bx| (0..3).map(move |c| (by, bx, c))))
    {
        sum += numbers(bx, by, c).iter().sum::<f64>();
    }
    (pixel, sum)
}

#[test]
fn a_real_painting_is_relit() {
    let Some(data) = shared_data() else {
        return skipped("../shared/data");
    };
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let (lp, field) = (data.join("painting-72/dirs.lp"), path("p.rfield"));
    succeed(tool(&["import", "lp"]).arg(&lp).arg("-o").arg(&field));
    assert_eq!(info(&field)["lamps"], 72);
    let asset = Asset::open(&field, Access::Mapped).unwrap();
    let photograph = |number: usize| {
        read(&data.join(format!("painting-72/image{number:02}.jpg")), Encoding::Auto).unwrap().into_rgb()
    };
    for number in [1, 36, 72] {
        let lit = relight(&field, &path("lit.tif"), &["--lamp", &number.to_string()]);
        assert!(difference(&lit, &photograph(number)) <= 0.5 / 1024.0, "lamp {number}");
    }
    // Under a park: the sum over lamps, from the pictures the tool itself gives of each.
    let park = data.join("hdri/park.hdr").display().to_string();
    let lit = relight(&field, &path("park.tif"), &["--env", &park]);
    let map = relume_core::illumination::EnvMap::load(Path::new(&park)).unwrap();
    let (w, h) = map.image().size();
    let weights = operator(&asset, w, h).downsample(&map);
    let mut sum = Image::new(lit.width(), lit.height(), 3);
    for (n, weight) in weights.iter().enumerate() {
        let photo = photograph(n + 1);
        for (at, v) in sum.data_mut().iter_mut().enumerate() {
            *v += weight[at % 3] * photo.data()[at] / std::f32::consts::PI;
        }
    }
    let off = difference(&lit, &sum);
    // Errors of 72 roundings to halves partly cancel.
    assert!(off < 0.5 / 1024.0, "the sum over lamps is off by {off}");
    assert!(lit.data().iter().all(|v| *v >= 0.0) && lit.data().iter().any(|v| *v > 0.1), "implausible");
    linear_in_light(&path("brighter.exr"), map.image(), &field, &lit);
}

/// `relight(a L) = a relight(L)`: by a scaled map, and by `--exposure`.
fn linear_in_light(brighter: &Path, map: &Image, field: &Path, lit: &Image) {
    let scaled = |image: &Image, a: f32| {
        Image::from_fn(image.width(), image.height(), |x, y| std::array::from_fn(|c| a * image.pixel(x, y)[c]))
    };
    write(brighter, &scaled(map, 3.0), EncodeOptions::default()).unwrap();
    let output = brighter.with_extension("tif");
    let three = relight(field, &output, &["--env", &brighter.display().to_string()]);
    assert!(difference(&three, &scaled(lit, 3.0)) < 1e-5);
    let six = relight(field, &output, &["--env", &brighter.display().to_string(), "--exposure", "1"]);
    assert!(difference(&six, &scaled(lit, 6.0)) < 1e-5);
}
