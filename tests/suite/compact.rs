//! Compact fields through the tool: made, looked at, relit, animated, and what is refused.

use std::fs;
use std::path::PathBuf;

use super::cli::{Set, difference, files_in, info, refuse, relight, succeed, tool};

/// Lamps all around: a Fibonacci lattice.
fn around(count: usize) -> Vec<[f64; 3]> {
    let golden = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    let lamp = |n: usize| {
        let y = 1.0 - (2 * n + 1) as f64 / count as f64;
        let (r, (s, c)) = ((1.0 - y * y).sqrt(), (golden * n as f64).sin_cos());
        [r * c, y, r * s]
    };
    (0..count).map(lamp).collect()
}

/// A field of 40 lamps.
fn set() -> (Set, PathBuf) {
    let set = Set::new(&around(40), (70, 21), "tif");
    let field = set.import(&[]);
    (set, field)
}

/// Photographs of the set are sines of the lamp's number plus a phase: of rank three.
#[test]
fn a_factored_field_is_small_and_is_what_lights() {
    let (set, field) = set();
    let both = set.out().join("both.rfield");
    let line =
        succeed(tool(&["compress", "--factored", "--error", "0.01", "--keep", "dense", "-o"]).arg(&both).arg(&field));
    assert!(
        line.contains("factored    tiles of")
            && line.contains("of ranks")
            && line.contains("of half samples")
            && line.contains("1.000 % asked"),
        "{line}"
    );
    let told = info(&both);
    let of = |kind: &str| {
        let held = told["representations"].as_array().unwrap().iter().find(|held| held["kind"] == kind);
        held.unwrap_or_else(|| panic!("no {kind} in {told}")).clone()
    };
    let (factored, half) = (of("factored"), told["half_samples_bytes"].as_f64().unwrap());
    assert!(factored["error"].as_f64().unwrap() <= 0.01, "{factored}");
    assert!(factored["bytes"].as_f64().unwrap() < half / 5.0, "{factored} of {half}");
    assert_eq!(of("dense")["error"], 0.0);
    succeed(tool(&["verify"]).arg(&both));

    let picture = |options: &[&str]| relight(&both, &set.out().join("lit.exr"), options);
    let soft = ["--lighting", "key"];
    let (chosen, told) = (picture(&soft), picture(&[&soft[..], &["--representation", "factored"]].concat()));
    let exact = picture(&[&soft[..], &["--representation", "dense"]].concat());
    assert_eq!(chosen, told);
    let off = difference(&chosen, &exact);
    assert!(off > 0.0 && off < 0.02, "{off}");
    // A captured lamp is a photograph, and the samples are there.
    assert_eq!(picture(&["--lamp", "7"]), picture(&["--lamp", "7", "--representation", "dense"]));
    // Alone it answers for the lamps too.
    let alone = set.out().join("alone.rfield");
    succeed(tool(&["compress", "--factored", "--error", "0.01", "-o"]).arg(&alone).arg(&field));
    let lamp = relight(&alone, &set.out().join("lit.exr"), &["--lamp", "7"]);
    assert!(difference(&lamp, &picture(&["--lamp", "7"])) < 0.05);
    assert!(fs::metadata(&alone).unwrap().len() < fs::metadata(&field).unwrap().len() / 3);
}

#[test]
fn wavelets_are_rebuilt_once_and_relight_as_the_method_does() {
    let (set, field) = set();
    let small = set.out().join("small.rfield");
    let options = ["compress", "--wavelet", "9/7", "--grid", "64x32", "--error", "0.005", "--keep", "dense", "-o"];
    let line = succeed(tool(&options).arg(&small).arg(&field));
    assert!(line.contains("9/7 on 64 x 32, rebuilt by b-spline"), "{line}");
    let picture = |options: &[&str]| relight(&small, &set.out().join("lit.exr"), options);
    let soft = ["--lighting", "overcast"];
    let wavelet = picture(&[&soft[..], &["--representation", "wavelet"]].concat());
    let spline = picture(&[&soft[..], &["--reconstruct", "b-spline"]].concat());
    let off = difference(&wavelet, &spline);
    assert!(off > 0.0 && off < 0.02, "{off}");
}

#[test]
fn frames_of_an_animation_are_made_of_one_representation() {
    let (set, field) = set();
    let both = set.out().join("both.rfield");
    succeed(tool(&["compress", "--harmonic", "9", "--keep", "all", "-o"]).arg(&both).arg(&field));
    let script = set.path("turn.toml");
    // A captured lamp that is dark for the first frame still counts in the choice.
    let lights = "[[light]]\nlighting = \"key\"\n[[light]]\nlamp = 3\ngain = [[1, 0], [2, 1]]\n";
    fs::write(&script, lights).unwrap();
    let out = set.out().join("f.####.exr");
    let mut animate = tool(&["animate", "--frames", "1-2", "--representation", "harmonics", "-o"]);
    succeed(animate.arg(&out).arg(&both).arg(&script));
    let frame = |n: u32| {
        let path = set.out().join(format!("f.{n:04}.exr"));
        relume_core::image::read(&path, relume_core::image::Encoding::Auto).unwrap()
    };
    let alone = relight(&both, &set.out().join("lit.exr"), &["--lighting", "key", "--representation", "harmonics"]);
    assert!(difference(&frame(1), &alone) < 1e-5);
    let lamp = relight(&both, &set.out().join("lit.exr"), &["--lamp", "3", "--representation", "harmonics"]);
    let sum: Vec<f32> = alone.data().iter().zip(lamp.data()).map(|(a, b)| a + b).collect();
    let sum = relume_core::image::Image::from_data(70, 21, 3, sum).unwrap();
    assert!(difference(&frame(2), &sum) < 1e-5);
}

#[test]
fn what_cannot_be_compressed_gets_a_sentence_and_leaves_nothing() {
    let (set, field) = set();
    let out = set.out().join("b.rfield");
    let before = files_in(&set.out());
    for (options, words) in [
        (&["--harmonic", "24"][..], &["24", "square"][..]),
        (&["--factored", "--error", "0"], &["0", "error"]),
        (&["--factored", "--error", "1.5"], &["1.5"]),
        (&["--factored", "--error", "2%"], &["2%"]),
        (&["--factored", "--terms", "12"], &["--terms"]),
        (&["--harmonic", "25", "--error", "0.1"], &["--error"]),
        (&["--wavelet", "9/7", "--terms", "0"], &["0"]),
        (&["--wavelet", "9/7", "--grid", "2x2"], &["2", "grid"]),
        (&["--wavelet", "9/7", "--grid", "63x32"], &["63"]),
        (&["--wavelet", "d4", "--error", "0.1"], &["d4", "symmetric"]),
        (&["--wavelet", "10/8", "--error", "0.1"], &["10/8"]),
        (&["--wavelet", "9/7", "--reconstruct", "haar", "--error", "0.1"], &["haar", "grid"]),
        (&["--wavelet", "9/7", "--factored"], &["--factored"]),
        (&[], &["--factored"]),
    ] {
        let mut command = tool(&["compress"]);
        let output = command.args(options).arg("-o").arg(&out).arg(&field).output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(matches!(output.status.code(), Some(1 | 2)), "{options:?}: {said}");
        assert!(said.starts_with("error: "), "{options:?}: {said}");
        words.iter().for_each(|word| assert!(said.contains(word), "{options:?}: no `{word}` in: {said}"));
        assert_eq!(files_in(&set.out()), before, "{options:?}");
    }
    // Compact fields alone have no samples to look at.
    let soft = set.out().join("soft.rfield");
    succeed(tool(&["compress", "--harmonic", "9", "-o"]).arg(&soft).arg(&field));
    refuse(tool(&["compress", "--factored", "--error", "0.1", "-o"]).arg(&out).arg(&soft), &["soft.rfield", "samples"]);
    let picture = set.out().join("x.png");
    refuse(tool(&["inspect", "--pixel", "1,1", "-o"]).arg(&picture).arg(&soft), &["soft.rfield", "harmonics alone"]);
    refuse(tool(&["calibrate", "failed"]).arg(&soft), &["soft.rfield", "harmonics alone"]);
    let wanted = ["relight", "--lighting", "key", "--representation", "wavelet", "-o"];
    refuse(tool(&wanted).arg(&picture).arg(&soft), &["no `wavelet` representation", "harmonics"]);
}
