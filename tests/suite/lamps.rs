//! `relume calibrate lamps` and what `relume import lp` makes of it: photographs of a mirror ball and a grey card.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use relume_core::domain::lp::{Lengths, read as read_lp};
use relume_core::field::{Access, Asset};
use relume_core::image::{EncodeOptions, Encoding, Image, read, write};
use relume_core::math::{Vec3, angle_between};

use super::cli::{difference, refuse, relight, run, succeed, text, tool};

const SIZE: (usize, usize) = (220, 160);
/// Centre and radius of the ball.
const BALL: (f64, f64, f64) = (80.4, 80.2, 60.3);

/// A ball before grey under distant lamps of 3 degrees' radius, and at the right a card of reflectance 0.5 that faces
/// the camera.
fn photograph(lamps: &[(Vec3, f64)]) -> Image {
    let disc = 3f64.to_radians().cos();
    Image::from_fn(SIZE.0, SIZE.1, |x, y| {
        if x >= 170 {
            let lit: f64 = lamps.iter().map(|(d, e)| e * d.z.max(0.0)).sum();
            return [(0.5 * lit / std::f64::consts::PI) as f32; 3];
        }
        let ray = |k: usize| {
            let (px, py) = (x as f64 + ((k % 4) as f64 + 0.5) / 4.0, y as f64 + ((k / 4) as f64 + 0.5) / 4.0);
            let (u, v) = ((px - BALL.0) / BALL.2, (BALL.1 - py) / BALL.2);
            if u.hypot(v) >= 1.0 {
                return 0.2;
            }
            let n = Vec3::new(u, v, (1.0 - u * u - v * v).sqrt());
            let direction = n * (2.0 * n.z) - Vec3::z();
            0.02 + lamps.iter().filter(|(d, _)| d.dot(&direction) > disc).map(|(_, e)| 3.0 * e).sum::<f64>()
        };
        [((0..16).map(ray).sum::<f64>() / 16.0) as f32; 3]
    })
}

/// Eleven photographs; of `04` the lamp is dark, `08` shows two.
struct Set {
    folder: tempfile::TempDir,
    lamps: Vec<(Vec3, f64)>,
}

impl Set {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let lamp = |k: usize| {
            let (turn, lean) = (2.4 * k as f64, 0.25 + 0.09 * k as f64);
            (Vec3::new(lean.sin() * turn.cos(), lean.sin() * turn.sin(), lean.cos()), 1.0 + 0.1 * k as f64)
        };
        let lamps: Vec<(Vec3, f64)> = (0..11).map(lamp).collect();
        for k in 0..11 {
            let lit = match k {
                4 => vec![],
                8 => vec![lamps[8], (lamps[1].0, lamps[8].1)],
                _ => vec![lamps[k]],
            };
            write(&folder.path().join(name(k)), &photograph(&lit), EncodeOptions::default()).unwrap();
        }
        Self { folder, lamps }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn calibrate(&self, options: &[&str]) -> Command {
        let mut command = tool(&["calibrate", "lamps"]);
        command.args((0..11).map(|k| self.path(&name(k)))).arg("-o").arg(self.path("lights.lp")).args(options);
        command
    }
}

fn name(k: usize) -> String {
    format!("shot {k:02}.tif")
}

/// The lamp that a photograph of an .lp file shows.
fn number(path: &Path) -> usize {
    let stem = path.file_stem().unwrap().to_string_lossy().into_owned();
    stem.trim_start_matches("shot ").parse().unwrap()
}

#[test]
fn lamps_are_found_and_failures_are_named() {
    let set = Set::new();
    let said = succeed(&mut set.calibrate(&["--find-balls", "--patch", "180,60,20,20", "--patch-reflectance", "0.5"]));
    for expected in [
        "outline found: --ball 80.",
        "shot 04.tif: left out: no highlight on ball 1",
        "shot 08.tif: left out: 2 highlights on ball 1",
        "9 lamps from 11",
    ] {
        assert!(said.contains(expected), "no `{expected}` in:\n{said}");
    }
    assert_eq!(said.matches("left out").count() + said.matches("kept").count(), 2, "{said}");
    let lp = read_lp(&set.path("lights.lp"), Lengths::Unit).unwrap();
    for (photograph, found) in lp.photographs.iter().zip(&lp.directions) {
        let off = angle_between(found, &set.lamps[number(photograph)].0).to_degrees();
        assert!(off < 0.5, "{}: off by {off} degrees", photograph.display());
    }
    let table = fs::read_to_string(set.path("lights.lamps.tsv")).unwrap();
    for line in table.lines().skip(1) {
        let columns: Vec<&str> = line.split('\t').collect();
        let (found, truth): (f64, f64) = (columns[1].parse().unwrap(), set.lamps[number(Path::new(columns[0]))].1);
        assert!((found / truth - 1.0).abs() < 0.02, "{line}: {truth}");
    }

    // By the table each lamp's T is its photograph over its own irradiance.
    let field = set.path("a.rfield");
    let import = |options: &[&str]| {
        let mut command = tool(&["import", "lp"]);
        command.arg(set.path("lights.lp")).arg("-o").arg(&field).args(options);
        command
    };
    let lamps = set.path("lights.lamps.tsv").display().to_string();
    succeed(&mut import(&["--lamps", &lamps, "--precision", "float"]));
    let asset = Asset::open(&field, Access::Read).unwrap();
    assert!((f64::from(asset.manifest().irradiance()[0]) / set.lamps[0].1 - 1.0).abs() < 0.02);
    let back = relight(&field, &set.path("x.exr"), &["--lamp", "1"]);
    assert!(difference(&back, &read(&set.path(&name(0)), Encoding::Auto).unwrap()) < 1e-5);
}

#[test]
fn a_person_has_the_last_word() {
    let set = Set::new();
    let direction = set.lamps[4].0;
    // Where the true lamp of 08 shows: half way between it and the camera.
    let n = (set.lamps[8].0 + Vec3::z()).normalize();
    let (x, y) = (BALL.0 + BALL.2 * n.x, BALL.1 - BALL.2 * n.y);
    let lines = format!(
        "# by hand\nshot 04.tif dir {} {} {}\nshot 08.tif {x:.2} {y:.2}\nshot 00.tif skip\n",
        direction.x, direction.y, direction.z
    );
    fs::write(set.path("by hand.txt"), lines).unwrap();
    let by_hand = set.path("by hand.txt").display().to_string();
    let ball = format!("{},{},{}", BALL.0, BALL.1, BALL.2);
    let said = succeed(&mut set.calibrate(&["--ball", &ball, "--override", &by_hand]));
    assert!(
        said.contains("shot 00.tif: left out: as the override says") && said.contains("10 lamps from 11"),
        "{said}"
    );
    let lp = read_lp(&set.path("lights.lp"), Lengths::Unit).unwrap();
    for (photograph, found) in lp.photographs.iter().zip(&lp.directions) {
        assert!(angle_between(found, &set.lamps[number(photograph)].0).to_degrees() < 0.3, "{}", photograph.display());
    }
    assert!(!set.path("lights.lamps.tsv").exists());
    fs::write(set.path("by hand.txt"), "shot 04.tif up 3\n").unwrap();
    refuse(&mut set.calibrate(&["--ball", &ball, "--override", &by_hand]), &["by hand.txt, line 1", "`up`"]);
    fs::write(set.path("by hand.txt"), "shot 04.tif 215 3\n").unwrap();
    refuse(&mut set.calibrate(&["--ball", &ball, "--override", &by_hand]), &["shot 04.tif", "lies on no ball"]);
}

#[test]
fn bad_input_gets_a_sentence() {
    let set = Set::new();
    refuse(&mut set.calibrate(&["--ball", "200,80,60"]), &["a ball at 200.0,80.0", "220 x 160"]);
    refuse(&mut set.calibrate(&["--ball", "80,80,60", "--patch", "200,0,50,20"]), &["patch", "220 x 160"]);
    refuse(&mut set.calibrate(&["--find-balls=3"]), &["one ball only", "--ball X,Y,R"]);
    // A ball that shows no lamp at all: the card.
    refuse(&mut set.calibrate(&["--ball", "195,80,20"]), &["no photograph tells", "no highlight", "--override"]);
    for bad in [["--ball", "left,80,60"], ["--view", "wide"], ["--agree", "3deg"]] {
        let output = run(&mut set.calibrate(&bad));
        assert_eq!(output.status.code(), Some(2), "{bad:?}: {}", text(&output.stderr));
    }
    write(&set.path(&name(5)), &Image::new(100, 160, 3), EncodeOptions::default()).unwrap();
    refuse(&mut set.calibrate(&["--ball", "80,80,60"]), &["shot 05.tif", "100 x 160", "220 x 160", "shot 00.tif"]);
    fs::remove_file(set.path(&name(5))).unwrap();
    refuse(&mut set.calibrate(&["--ball", "80,80,60"]), &["cannot read", "shot 05.tif"]);
    assert!(!set.path("lights.lp").exists());
}

#[test]
fn near_lamps_are_evened_out() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    // A plane of reflectance 1 at z = 0, 1 mm a pixel, lit from 8 cm: the law, written out here.
    let lamps = [Vec3::new(0.02, 0.01, 0.08), Vec3::new(-0.03, 0.02, 0.07)];
    let lit = |lamp: &Vec3, albedo: f64| {
        Image::from_fn(40, 30, |x, y| {
            let point = Vec3::new((x as f64 - 19.5) * 1e-3, (14.5 - y as f64) * 1e-3, 0.0);
            let to = lamp - point;
            [(albedo * 0.01 * to.normalize().z / to.norm_squared()) as f32; 3]
        })
    };
    fs::create_dir(path("cards")).unwrap();
    let mut lp = format!("{}\n", lamps.len());
    let mut table = String::from("photograph\tirradiance\tx_m\ty_m\tz_m\n");
    for (k, lamp) in lamps.iter().enumerate() {
        let name = format!("{k}.tif");
        write(&path(&name), &lit(lamp, 0.6), EncodeOptions::default()).unwrap();
        write(&path("cards").join(&name), &lit(lamp, 0.9), EncodeOptions::default()).unwrap();
        let d = lamp.normalize();
        lp += &format!("{name} {} {} {}\n", d.x, d.y, d.z);
        table += &format!("{name}\t1.5\t{}\t{}\t{}\n", lamp.x, lamp.y, lamp.z);
    }
    fs::write(path("l.lp"), lp).unwrap();
    fs::write(path("l.tsv"), table).unwrap();
    let field = path("a.rfield");
    let import = |options: &[&str]| {
        let mut command = tool(&["import", "lp"]);
        command.arg(path("l.lp")).arg("-o").arg(&field).args(["--precision", "float"]).args(options);
        command
    };
    let (tsv, cards) = (path("l.tsv").display().to_string(), path("cards").display().to_string());
    let places = ["--lamps", &tsv, "--flat-field", "places", "--metres-per-pixel", "0.001"];
    for (options, tolerance) in [(&places[..], 1e-4), (&["--flat-field", &cards][..], 0.02)] {
        succeed(&mut import(options));
        let even = relight(&field, &path("x.exr"), &["--lamp", "2"]);
        let (low, high) = even.data().iter().fold((f32::MAX, 0.0f32), |(l, h), v| (l.min(*v), h.max(*v)));
        assert!(high / low - 1.0 < tolerance, "{options:?}: {low} to {high}");
    }
    let uneven = lit(&lamps[1], 0.6);
    let spread =
        uneven.data().iter().copied().fold(0.0, f32::max) / uneven.data().iter().copied().fold(f32::MAX, f32::min);
    assert!(spread > 1.5, "the test is too easy: {spread}");

    fs::write(path("l.tsv"), "photograph\tirradiance\n0.tif\t1\n1.tif\t1\n").unwrap();
    refuse(&mut import(&places), &["l.tsv", "no place", "0.tif"]);
    fs::write(path("l.tsv"), "photograph\tirradiance\n0.tif\tbright\n").unwrap();
    refuse(&mut import(&places[..2]), &["l.tsv, line 2", "bright"]);
    fs::remove_file(path("cards").join("1.tif")).unwrap();
    refuse(&mut import(&["--flat-field", &cards]), &["cannot read", "1.tif"]);
    // An .lp line that names a photograph which is not there.
    fs::remove_file(path("1.tif")).unwrap();
    refuse(&mut import(&[]), &["cannot read", "1.tif"]);
}
