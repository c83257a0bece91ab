//! Patterns out of the tool, and photographs under them into a session.

use std::fs;
use std::path::Path;

use relume_core::domain::patterns::{Kind, Noise, PatternSet, emitted};
use relume_core::domain::{EmitterCurve, Plane};
use relume_core::image::{EncodeOptions, Image, write};
use relume_core::wavelet::Wavelet;

use crate::cli::{files_in, refuse, succeed, text, tool};

/// Photographs `shot1.exr`, `shot2.exr`... and a black one, of a camera that sees the sum of the pattern.
fn photograph(folder: &Path, count: usize) {
    fs::create_dir_all(folder.join("shots")).unwrap();
    for n in 1..=count {
        let picture = Image::from_fn(5, 4, |x, y| [(n + x + y) as f32, 1.0, 0.5]);
        write(&folder.join(format!("shots/shot{n}.exr")), &picture, EncodeOptions::default()).unwrap();
    }
    write(&folder.join("black.exr"), &Image::new(5, 4, 3), EncodeOptions::default()).unwrap();
}

#[test]
fn patterns_come_back_as_the_light_that_was_emitted() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let table: String = (0..256).map(|z| format!("{z} {}\n", 3.0 + 70.0 * (f64::from(z) / 255.0).powf(2.4))).collect();
    fs::write(path("gamma.txt"), table).unwrap();
    let options = "--size 16x8 --count 12 --seed 5 --texel 3 --wavelet 5/3 --encode";
    let mut command = tool(&["patterns", "noise", "-o"]);
    succeed(command.arg(path("shown")).args(options.split(' ')).arg(path("gamma.txt")));
    let expected =
        (0..12).map(|n| format!("{n:04}-noise.png")).chain(["calibration".to_owned(), "patterns.toml".to_owned()]);
    assert_eq!(files_in(&path("shown")), expected.collect::<Vec<_>>());
    assert_eq!(files_in(&path("shown/calibration")), ["black.png", "emitter.txt", "white.png"]);
    let noise = Noise { wavelet: Wavelet::LeGall53, count: 12, seed: 5, deviation: Noise::DEVIATION };
    let set = PatternSet::new(Kind::Noise(noise), Plane::new(16, 8).unwrap()).unwrap();
    let curve = EmitterCurve::read(&path("gamma.txt")).unwrap();
    let described: toml::Table = fs::read_to_string(path("shown/patterns.toml")).unwrap().parse().unwrap();
    for n in 0..12 {
        let shown = &described["pattern"][n];
        assert_eq!(shown["number"].as_integer(), Some(n as i64));
        assert!((shown["scale"].as_float().unwrap() / f64::from(set.scale(n)) - 1.0).abs() < 1e-6);
        let back = emitted(&path("shown").join(shown["file"].as_str().unwrap()), &curve, 3).unwrap();
        let wanted = set.pattern(n);
        assert_eq!((back.columns, back.rows), (16, 8));
        // Half a code where the curve is steepest, 2.4 at white.
        assert!(back.values.iter().zip(&wanted.values).all(|(a, b)| (a - b).abs() <= 0.5 * 2.4 / 255.0), "pattern {n}");
    }

    photograph(folder.path(), 12);
    let mut import = tool(&["import", "pairs", "--patterns"]);
    import.arg(path("shown")).arg("--photos").arg(path("shots")).arg("--black").arg(path("black.exr"));
    let said = succeed(import.arg("--session").arg(path("session")));
    assert!(said.contains("12 photographs of 5 x 4 pixels under 12 patterns of 16 x 8 texels"), "{said}");
    let session: toml::Table = fs::read_to_string(path("session/session.toml")).unwrap().parse().unwrap();
    let settings = &session["source"]["import"]["settings"];
    assert_eq!((settings["set"].as_str(), settings["texel"].as_integer()), (Some("noise"), Some(3)));
    // All that is needed to know the light is inside.
    let curve = EmitterCurve::read(&path("session").join(settings["emitted"].as_str().unwrap())).unwrap();
    let shown = path("session").join(settings["patterns"][9].as_str().unwrap());
    assert_eq!(emitted(&shown, &curve, 3).unwrap(), emitted(&path("shown/0009-noise.png"), &curve, 3).unwrap());
    // The tenth photograph is shot10, not the one that sorts tenth by letters.
    assert_eq!(files_in(&path("session/photos/000010")), ["shot10.exr"]);
    assert_eq!(files_in(&path("session/photos/000013")), ["black.exr"]);
    let again = fs::read(path("shown/0003-noise.png")).unwrap();
    succeed(tool(&["patterns", "noise", "-o"]).arg(path("again")).args(options.split(' ')).arg(path("gamma.txt")));
    assert_eq!(fs::read(path("again/0003-noise.png")).unwrap(), again, "the same every time");
}

#[test]
fn pairs_that_do_not_fit_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    photograph(folder.path(), 6);
    fs::create_dir(path("empty")).unwrap();
    succeed(tool(&["patterns", "stripes", "--size", "8x4", "-o"]).arg(path("stripes")));
    succeed(tool(&["patterns", "noise", "--size", "8x4", "--count", "6", "-o"]).arg(path("six")));
    succeed(tool(&["patterns", "ramp", "--size", "2x2", "-o"]).arg(path("ramp")));
    fs::create_dir(path("colour")).unwrap();
    for n in 0..6 {
        let picture = Image::from_fn(8, 4, |_, _| [1.0, 0.5, if n == 4 { 0.0 } else { 0.5 }]);
        write(&path(&format!("colour/{n}.png")), &picture, EncodeOptions::default()).unwrap();
    }
    let import = |shown: &str, options: &[&str], words: &[&str]| {
        let mut command = tool(&["import", "pairs", "--photos"]);
        command.arg(path("shots")).arg("--patterns").arg(path(shown)).arg("--session").arg(path("s"));
        refuse(command.args(options), words);
    };
    let file = |name: &str| path(name).display().to_string();
    import("stripes", &[], &["6 photographs for the 10 patterns", "one a pattern"]);
    import("absent", &[], &["absent"]);
    import("empty", &[], &["no pictures", ".png"]);
    import("colour", &[], &["0.png, pixel (0, 0)", "a grey pattern"]);
    import("six", &["--texel", "3"], &["8 x 4 pixels", "a texel's 3 pixels"]);
    import("six", &["--emitted", "gama"], &["`gama` is neither linear nor srgb"]);
    import("six", &["--black", &file("six/0001-noise.png")], &["0001-noise.png", "8 x 4", "5 x 4"]);
    fs::rename(path("shots"), path("kept")).unwrap();
    fs::create_dir(path("shots")).unwrap();
    for n in 0..256 {
        fs::copy(path("kept/shot1.exr"), path(&format!("shots/{n}.exr"))).unwrap();
    }
    import("ramp", &[], &["measure the emitter's curve", "--emitted"]);
    fs::write(path("six/patterns.toml"), "version = 9\n").unwrap();
    import("six", &[], &["256 photographs"]);
    fs::remove_dir_all(path("shots")).unwrap();
    fs::rename(path("kept"), path("shots")).unwrap();
    import("six", &[], &["patterns.toml", "--emitted and --texel"]);
    assert!(!path("s").exists());

    // A folder of somebody else's: sRGB, if nothing is said; no black photograph is worth a word.
    fs::remove_file(path("six/patterns.toml")).unwrap();
    let mut command = tool(&["import", "pairs", "--photos"]);
    let output =
        command.arg(path("shots")).arg("--patterns").arg(path("six")).arg("--session").arg(path("s")).output().unwrap();
    assert!(output.status.success() && text(&output.stderr).contains("no --black"), "{}", text(&output.stderr));
    refuse(tool(&["patterns", "noise", "-o"]).arg(path("six")), &["not empty"]);
}
