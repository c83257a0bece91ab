//! `relume probe` from outside: real surroundings through a mirror ball and back, balls found and refused.

use std::fs;
use std::path::Path;

use relume_core::illumination::EnvMap;
use relume_core::image::{EncodeOptions, Encoding, Image, read, write};
use relume_core::math::{Vec3, angle_between, latlong};
use relume_tests::{shared_data, skipped};

use super::cli::{refuse, run, succeed, text, tool};

/// `integral of L cos over the hemisphere about a normal`, RGB.
fn irradiance(map: &Image, normal: &Vec3) -> [f64; 3] {
    let (w, h) = map.size();
    let mut sum = [0.0; 3];
    for j in 0..h {
        let area = latlong::texel_solid_angle(j, w, h);
        for i in 0..w {
            let cos = latlong::direction(i as f64 + 0.5, j as f64 + 0.5, w, h).dot(normal).max(0.0);
            (0..3).for_each(|c| sum[c] += area * cos * f64::from(map.pixel(i, j)[c]));
        }
    }
    sum
}

/// The brightest spot: the direction of most light within about two degrees.
fn brightest(map: &Image) -> Vec3 {
    let (w, h) = map.size();
    let at = |i: usize, j: usize| latlong::direction(i as f64 + 0.5, j as f64 + 0.5, w, h);
    let value = |k: &usize| map.pixel(k % w, k / w).iter().sum::<f32>();
    let top = (0..w * h).max_by(|a, b| value(a).total_cmp(&value(b))).unwrap();
    let near = at(top % w, top / w);
    let inside = (0..w * h).filter(|k| near.dot(&at(k % w, k / w)) > 2f64.to_radians().cos());
    inside
        .map(|k| at(k % w, k / w) * f64::from(value(&k)) * latlong::texel_solid_angle(k / w, w, h))
        .sum::<Vec3>()
        .normalize()
}

fn probe(from: &Path, to: &Path, options: &[&str]) -> String {
    succeed(tool(&["probe"]).arg(from).arg("-o").arg(to).args(options))
}

/// Largest relative error of irradiance over 26 normals and all channels, and the angle between the brightest spots.
fn kept(before: &Path, after: &Path) -> (f64, f64) {
    let [before, after] = [before, after].map(|path| read(path, Encoding::Auto).unwrap());
    let mut worst = 0.0f64;
    // The neighbours in a cube of three: axes, edges and corners.
    for k in (0..27).filter(|k| *k != 13) {
        let normal = Vec3::new((k % 3) as f64 - 1.0, (k / 3 % 3) as f64 - 1.0, (k / 9) as f64 - 1.0).normalize();
        let (a, b) = (irradiance(&before, &normal), irradiance(&after, &normal));
        (0..3).for_each(|c| worst = worst.max((b[c] / a[c] - 1.0).abs()));
    }
    (worst, angle_between(&brightest(&before), &brightest(&after)).to_degrees())
}

#[test]
fn real_surroundings_survive_a_mirror_ball() {
    let Some(data) = shared_data() else { return skipped("../shared/data") };
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let ball = |map: &Path, name: &str, size: &str, turn: &str| {
        probe(map, &path(name), &["--from", "latlong", "--to", "ball", "--size", size, "--turn", turn]);
    };
    // One ball: all but 0.3 % of the sphere, which lies behind it.
    let park = data.join("hdri/park.hdr");
    ball(&park, "ball.exr", "1024", "0");
    probe(&path("ball.exr"), &path("back.exr"), &["--circle", "inscribed", "--size", "1024"]);
    let (worst, off) = kept(&park, &path("back.exr"));
    assert!(worst < 0.02 && off < 1.0, "irradiance off by {worst}, brightest spot by {off} degrees");
    // At night a tree stands behind the ball before a bright horizon: that takes a second ball.
    let night = data.join("hdri/night.hdr");
    ball(&night, "a.exr", "512", "0");
    ball(&night, "b.exr", "512", "-90");
    let second = path("b.exr").display().to_string();
    probe(&path("a.exr"), &path("back.exr"), &["--second", &second, "--circle", "inscribed", "--size", "1024"]);
    let (worst, off) = kept(&night, &path("back.exr"));
    assert!(worst < 0.005 && off < 1.0, "irradiance off by {worst}, brightest spot by {off} degrees");
}

#[test]
fn a_ball_is_found_and_two_views_merge() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let surroundings = EnvMap::from_fn(256, 128, |d| [1.2 + d.x, 1.2 + d.y * d.z, 1.2 + 0.5 * d.z].map(|v| v as f32));
    write(&path("map.exr"), surroundings.image(), EncodeOptions::default()).unwrap();
    for (name, turn) in [("a.exr", "0"), ("b.exr", "-90")] {
        let options = ["--from", "latlong", "--to", "ball", "--size", "200", "--turn", turn];
        probe(&path("map.exr"), &path("ball.exr"), &options);
        // In a larger picture, before grey.
        let ball = read(&path("ball.exr"), Encoding::Auto).unwrap();
        let framed = Image::from_fn(360, 260, |x, y| {
            let (u, v) = (x as f64 - 150.0 + 0.5, y as f64 - 130.0 + 0.5);
            if u.hypot(v) > 99.9 { [0.3; 3] } else { std::array::from_fn(|c| ball.pixel(x - 50, y - 30)[c]) }
        });
        write(&path(name), &framed, EncodeOptions::default()).unwrap();
    }
    let second = path("b.exr").display().to_string();
    let said = probe(&path("a.exr"), &path("out.exr"), &["--second", &second, "--angle", "90", "--size", "256"]);
    assert_eq!(said.matches("outline found").count(), 2, "{said}");
    let found = read(&path("out.exr"), Encoding::Auto).unwrap();
    let worst = found.data().iter().zip(surroundings.image().data()).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(worst < 0.08, "off by {worst}");

    let outside = refuse(
        tool(&["probe"]).arg(path("a.exr")).arg("-o").arg(path("o.exr")).args(["--circle", "900,130,100"]),
        &["a.exr", "a ball at 900.0", "360 x 260"],
    );
    assert!(!outside.contains("panicked"));
    write(&path("flat.exr"), &Image::from_fn(90, 60, |_, _| [0.4; 3]), EncodeOptions::default()).unwrap();
    refuse(tool(&["probe"]).arg(path("flat.exr")).arg("-o").arg(path("o.exr")), &["flat.exr", "--circle X,Y,R"]);
    for bad in [["--angle", "ninety"], ["--circle", "1,2,three"], ["--fov", "NaN"]] {
        let mut command = tool(&["probe"]);
        let output = run(command.arg(path("a.exr")).arg("-o").arg(path("o.exr")).args(["--second", &second]).args(bad));
        assert_eq!(output.status.code(), Some(2), "{bad:?}: {}", text(&output.stderr));
    }
    let mut left: Vec<String> =
        fs::read_dir(folder.path()).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    left.sort();
    assert_eq!(left, ["a.exr", "b.exr", "ball.exr", "flat.exr", "map.exr", "out.exr"]);
}
