//! Light sets of every kind and size through the command line, and numpy on what comes out.

use std::path::{Path, PathBuf};
use std::process::Command;

use rand::seq::SliceRandom;
use rand::{RngExt, SeedableRng};
use relume_core::domain::Coverage;
use relume_core::field::{Access, Asset, Block, BlockBuffer};
use relume_core::illumination::EnvMap;
use relume_core::image::{Image, Window, encode_png8};
use relume_core::reconstruct::{Method, Outside};
use relume_core::relight::{Light, Look, Relighter};
use relume_tests::{relume, skipped};

const SIZE: (usize, usize) = (16, 8);

/// `n` directions spread over the part of the sphere with z >= `lowest`.
fn spread(n: usize, lowest: f64) -> Vec<[f64; 3]> {
    let golden = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    let direction = |k: usize| {
        let z = 1.0 - (k as f64 + 0.5) / n as f64 * (1.0 - lowest);
        let (r, (s, c)) = ((1.0 - z * z).sqrt(), (golden * k as f64).sin_cos());
        [r * c, r * s, z]
    };
    (0..n).map(direction).collect()
}

/// Imports a set whose photographs are white where lamp `n` lights from the camera's side: photograph = max(0, z).
fn imported(folder: &Path, directions: &[[f64; 3]]) -> PathBuf {
    let mut lp = format!("{}\n", directions.len());
    for (n, [x, y, z]) in directions.iter().enumerate() {
        let picture = Image::from_fn(SIZE.0, SIZE.1, |_, _| [z.max(0.0) as f32; 3]);
        // Not by our writer: it waits for the disk, once a file.
        std::fs::write(folder.join(format!("{n}.png")), encode_png8(&picture).unwrap()).unwrap();
        lp += &format!("{n}.png {x:.6} {y:.6} {z:.6}\n");
    }
    std::fs::write(folder.join("dirs.lp"), lp).unwrap();
    let asset = folder.join("a.rfield");
    let output =
        Command::new(relume()).args(["import", "lp"]).arg(folder.join("dirs.lp")).arg("-o").arg(&asset).output();
    let output = output.unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    asset
}

/// A pixel that faces the camera answers max(0, z) / pi to a lamp, so under radiance 1 all over it is 1 if the lamps cover the
/// front, whatever their number and order.
fn white_under_white(asset: &Path, tolerance: f32) {
    let relighter = Relighter::new(Asset::open(asset, Access::Mapped).unwrap());
    let white = EnvMap::from_fn(64, 32, |_| [1.0; 3]);
    for method in [Method::ZeroOrder, Method::Linear] {
        for outside in [Outside::Drop, Outside::Nearest] {
            let look = Look { method, outside, ..Look::default() };
            let weights = relighter.weights(Light::Map(&white), &look).unwrap();
            let value = relighter.render(&weights, &look, Window::full(SIZE.0, SIZE.1)).unwrap().pixel(7, 3)[0];
            assert!((value - 1.0).abs() < tolerance, "{method:?}, {outside:?}: {value}");
        }
    }
}

#[test]
fn small_and_large_full_spheres_import() {
    for (n, tolerance) in [(240, 0.02), (1280, 0.005), (5000, 0.002)] {
        let folder = tempfile::tempdir().unwrap();
        let asset = imported(folder.path(), &spread(n, -1.0));
        let opened = Asset::open(&asset, Access::Mapped).unwrap();
        assert_eq!((opened.domain().len(), opened.domain().coverage()), (n, Coverage::Sphere));
        white_under_white(&asset, tolerance);
    }
}

#[test]
fn unsorted_sets_with_duplicates_are_weighed_alike() {
    let folder = tempfile::tempdir().unwrap();
    let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(4);
    let mut directions = spread(300, -1.0);
    for _ in 0..60 {
        let copy = directions[rng.random_range(0..directions.len())];
        directions.push(copy);
    }
    directions.shuffle(&mut rng);
    let asset = imported(folder.path(), &directions);
    let domain = Asset::open(&asset, Access::Mapped).unwrap().domain().clone();
    assert_eq!((domain.len(), domain.sites().len()), (360, 300));
    white_under_white(&asset, 0.02);
}

#[test]
fn a_part_of_a_hemisphere_covers_its_cap() {
    let folder = tempfile::tempdir().unwrap();
    let asset = imported(folder.path(), &spread(240, 0.5));
    let opened = Asset::open(&asset, Access::Mapped).unwrap();
    let Coverage::Cap { half_angle_rad } = opened.domain().coverage() else { panic!("not a cap") };
    let outermost = (1.0 - 239.5 / 240.0 * 0.5f64).acos();
    assert!(half_angle_rad > outermost && half_angle_rad < outermost + 0.1, "{half_angle_rad} for {outermost}");
    let white = EnvMap::from_fn(64, 32, |_| [1.0; 3]);
    let covered = opened.domain().covered_solid_angle();
    let weights = Relighter::new(opened).weights(Light::Map(&white), &Look::default()).unwrap();
    let total: f64 = weights.rgb.iter().map(|w| f64::from(w[0])).sum();
    assert!((total / covered - 1.0).abs() < 1e-4, "{total} of {covered}");
}

#[test]
fn numpy_opens_the_arrays() {
    let folder = tempfile::tempdir().unwrap();
    let asset = imported(folder.path(), &spread(5, 0.2));
    let script = "import io, sys, zipfile, numpy\n\
                  z = zipfile.ZipFile(sys.argv[1])\n\
                  assert z.testzip() is None\n\
                  a = numpy.load(io.BytesIO(z.read('transport/dense.npy')))\n\
                  i = z.getinfo('transport/dense.npy')\n\
                  m = numpy.memmap(sys.argv[1], mode='r')\n\
                  print(a.dtype.str, a.shape, a.flags['C_CONTIGUOUS'], *[float(v) for v in a[0, 0, 1, :, 3, 9]])\n";
    let has_numpy = Command::new("python3").args(["-c", "import numpy"]).output().is_ok_and(|o| o.status.success());
    if !has_numpy {
        return skipped("numpy");
    }
    let output = Command::new("python3").args(["-c", script]).arg(&asset).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let opened = Asset::open(&asset, Access::Read).unwrap();
    let mut buffer = BlockBuffer::default();
    let Block::Half(t) = opened.dense().block(0, 0, 1, &mut buffer).unwrap() else { panic!("halves") };
    let numbers: Vec<String> = (0..5).map(|lamp| format!("{:?}", t[lamp * 128 + 3 * 16 + 9].to_f64())).collect();
    let expected = format!("<f2 (1, 1, 3, 5, 8, 16) True {}\n", numbers.join(" "));
    assert_eq!(String::from_utf8_lossy(&output.stdout), expected);
}
