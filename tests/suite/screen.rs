//! Calibrating a screen from outside: a virtual one, whose truth is known, and real photographs where they are there.

use std::fs;
use std::path::Path;

use relume_core::domain::EmitterCurve;
use relume_core::image::{EncodeOptions, Encoding, Image, read, write};
use relume_core::simulate::{Camera, Monitor};
use relume_tests::{shared_data, skipped};
use serde_json::Value;

use crate::capture::{Capture, tool};
use crate::cli::{self, refuse, succeed};

/// A screen of 48 x 48 texels behind the demo's bodies, with noise.
const RIG: &str = r#"
version = 1
name = "Test screen"
kind = "monitor"
[monitor]
columns = 48
rows = 48
[camera]
limits_s = [0.02, 30.0]
step_stops = 3.0
megabytes = 0.01
[calibration]
dark_times_s = [0.05, 0.4]
patterns = ["ramp", "gray-code", "stripes"]
[virtual]
width = 96
height = 72
samples = 4
irradiance = 1500.0
[virtual.sensor]
full_well_e = 30000
read_e = 6
bits = 12
dark = 0.006
"#;
const SIZE: (usize, usize) = (96, 72);

fn number(text: &str, line: &str, before: &str) -> f64 {
    let line = text.lines().find(|l| l.starts_with(line)).unwrap_or_else(|| panic!("no `{line}` in: {text}"));
    let rest = &line[line.find(before).unwrap_or_else(|| panic!("no `{before}` in: {line}")) + before.len()..];
    let end = rest.trim_start().find(|c: char| !(c.is_ascii_digit() || c == '.')).unwrap_or(rest.trim_start().len());
    rest.trim_start()[..end].parse().unwrap()
}

#[test]
fn a_virtual_screen_is_calibrated() {
    let capture = Capture::with(RIG);
    succeed(&mut capture.begin("s", &["--only", "calibration"]));
    let (session, path) = (capture.path("s"), |name: &str| capture.path(name));

    // The curve: within 1 % of white at every code of the truth, a power of 2.2.
    let said = succeed(tool("calibrate").arg("gamma").arg(&session).arg("-o").arg(path("screen.txt")));
    assert!(said.contains("256 codes"), "{said}");
    let EmitterCurve::Table(table) = EmitterCurve::read(&path("screen.txt")).unwrap() else { panic!("a table") };
    for (code, light) in table.iter().enumerate() {
        let truth = (code as f64 / 255.0).powf(2.2);
        assert!((light - truth).abs() < 0.01, "code {code}: {light}, not {truth}");
    }

    // Places: half a pixel on stripes that were held out, by the tool's own measure, and to the truth.
    let said = succeed(tool("calibrate").arg("screen").arg(&session).arg("-o").arg(path("screen.json")));
    assert!(said.contains("edges of stripes") && number(&said, "held out", "median") < 0.5, "{said}");
    let file: Value = serde_json::from_str(&fs::read_to_string(path("screen.json")).unwrap()).unwrap();
    assert_eq!(file["picture"], serde_json::json!([96, 72]));
    let found: relume_core::domain::Correspondence = serde_json::from_value(file["correspondence"].clone()).unwrap();
    let monitor = Monitor::demo(Camera::monitor(SIZE.0, SIZE.1), (48, 48));
    for [u, v] in [[0.1, 0.1], [0.9, 0.15], [0.5, 0.2], [0.12, 0.6], [0.88, 0.6]] {
        let truth = monitor.camera.project(&monitor.screen.point(u, v));
        let [x, y] = found.pixel_of([f64::from(u), f64::from(v)]).unwrap();
        let off = (x - truth[0]).hypot(y - truth[1]);
        assert!(off < 0.5, "({u}, {v}): off by {off} pixels");
    }

    // Alpha: the share of the rays that miss every body.
    let said = succeed(
        tool("calibrate")
            .arg("alpha")
            .arg(&session)
            .arg("--screen")
            .arg(path("screen.json"))
            .arg("-o")
            .arg(path("a.exr")),
    );
    assert!(said.contains("from stripes"), "{said}");
    let alpha = read(&path("a.exr"), Encoding::Linear).unwrap();
    let seen = monitor.directly_seen();
    let mut off: Vec<f32> = seen.iter().enumerate().map(|(n, s)| (alpha.data()[3 * n] - (1.0 - s)).abs()).collect();
    off.sort_unstable_by(f32::total_cmp);
    let at = |share: f64| off[(share * (off.len() - 1) as f64) as usize];
    assert!(at(0.5) < 0.005 && at(0.9) < 0.03 && at(0.98) < 0.2, "{} {} {}", at(0.5), at(0.9), at(0.98));

    let absent = path("absent.json");
    refuse(
        tool("calibrate").arg("alpha").arg(&session).arg("--screen").arg(&absent).arg("-o").arg(path("b.exr")),
        &["absent.json"],
    );
    fs::write(&absent, fs::read_to_string(path("screen.json")).unwrap().replacen("96", "95", 1)).unwrap();
    refuse(
        tool("calibrate").arg("alpha").arg(&session).arg("--screen").arg(&absent).arg("-o").arg(path("b.exr")),
        &["95 x 72", "96 x 72"],
    );
    assert!(!path("b.exr").exists());
}

/// Every texel by itself, a coloured picture on the screen, with the object and without: relit and photographed agree.
#[test]
fn a_relit_picture_is_held_against_its_photograph() {
    let rig = RIG
        .replace("= 48", "= 16")
        .replace("[camera]", "squares = 16\n[camera]")
        .replace("\"ramp\", ", "")
        .replace("width = 96\nheight = 72", "width = 144\nheight = 108");
    let capture = Capture::with(&rig);
    let picture = capture.path("colours.png");
    // Soft: the camera, which sees the screen at three pixels a texel, is what tells its light.
    let colours = Image::from_fn(16, 16, |x, y| {
        let wave = 0.5 + 0.4 * (0.4 * x as f32 + 0.3 * y as f32).sin();
        [0.1 + x as f32 / 20.0, 0.9 - y as f32 / 20.0, wave]
    });
    write(&picture, &colours, EncodeOptions::default()).unwrap();
    succeed(&mut capture.begin("s", &["--sampler", "scan"]));
    succeed(&mut capture.begin("bare", &["--bare"]));
    let report = |field: &str, output: &str| {
        let mut command = tool("evaluate");
        command.arg("reference").arg(capture.path("s")).arg("--bare").arg(capture.path("bare"));
        command.arg("--field").arg(capture.path(field)).arg("-o").arg(capture.path(output));
        command
    };
    succeed(tool("pack").arg(capture.path("s")).arg("-o").arg(capture.path("a.rfield")));
    refuse(&mut report("a.rfield", "r"), &["no photographs of pictures", "--reference"]);
    succeed(capture.resume("s", &["--reference"]).arg(&picture));
    refuse(&mut report("a.rfield", "r"), &["no photograph of picture", "with the object and without it"]);
    succeed(capture.resume("bare", &["--reference"]).arg(&picture));
    let said = succeed(&mut report("a.rfield", "r"));
    let rows: Value = serde_json::from_str(&fs::read_to_string(capture.path("r/errors.json")).unwrap()).unwrap();
    for (pixels, most) in [("object", 0.08), ("all", 0.04)] {
        let error = rows[0][pixels]["relative_l2"].as_f64().unwrap();
        assert!(error < most, "{pixels}: {error}: {said}");
    }
    for name in ["index.html", "1-photographed.png", "1-relit.png", "1-difference.png"] {
        assert!(capture.path("r").join(name).is_file(), "{name}");
    }
}

#[test]
fn opaque_objects_by_triangulation() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    for name in ["with", "without", "one"] {
        fs::create_dir(path(name)).unwrap();
    }
    let alpha = |x: usize| (x as f32 / 15.0).min(1.0);
    for (n, behind) in [[0.8, 0.1, 0.2], [0.1, 0.7, 0.3]].into_iter().enumerate() {
        let save = |name: &str, picture: &Image| write(&path(name), picture, EncodeOptions::default()).unwrap();
        save(&format!("without/{n}.exr"), &Image::from_fn(20, 9, |_, _| behind));
        let with = |x: usize| [0, 1, 2].map(|c| alpha(x) * 0.4 + (1.0 - alpha(x)) * behind[c]);
        save(&format!("with/{n}.exr"), &Image::from_fn(20, 9, |x, _| with(x)));
        save("one/0.exr", &Image::from_fn(20, 9, |x, _| with(x)));
    }
    let command = |with: &str| {
        let mut command = cli::tool(&["calibrate", "alpha", "--photos"]);
        command.arg(path(with)).arg("--bare").arg(path("without")).arg("-o").arg(path("a.exr"));
        command
    };
    assert!(succeed(&mut command("with")).contains("triangulation of 2 backdrops"));
    let found = read(&path("a.exr"), Encoding::Linear).unwrap();
    for x in 0..20 {
        assert!((found.pixel(x, 4)[0] - alpha(x)).abs() < 2e-3, "{x}");
    }
    refuse(&mut command("one"), &["1 photographs with the object and 2 without"]);
    refuse(&mut command("without"), &["covers nothing"]);
}

/// Codes of others, with inverses and without, and the real glass.
#[test]
fn real_codes_are_decoded() {
    let Some(data) = shared_data() else { return skipped("../shared/data") };
    let folder = tempfile::tempdir().unwrap();
    let screen = |name: &str| -> String {
        let mut command = cli::tool(&["calibrate", "screen", "--patterns"]);
        command.arg(data.join(name).join("patterns")).arg("--photos").arg(data.join(name).join("photos"));
        succeed(&mut command)
    };
    // A board before a wall, a little bent, by a projector with a lens: rounding to texels of 1.7 pixels alone makes 0.7.
    let board = screen("procam-graycode");
    assert!(number(&board, "held out", "median") < 1.6, "{board}");
    let glass = screen("glass-graycode");
    assert!(number(&glass, "held out", "median") < 1.0, "{glass}");

    let (field, plate) = (folder.path().join("glass.rfield"), folder.path().join("plate.exr"));
    let mut command = cli::tool(&["import", "graycode", "--patterns"]);
    command.arg(data.join("glass-graycode/patterns")).arg("--photos").arg(data.join("glass-graycode/photos"));
    succeed(command.arg("-o").arg(&field));
    composited(&field, &plate);
}

/// Before a white plate the glass is grey to white everywhere, and beside it the plate is untouched.
fn composited(field: &Path, plate: &Path) {
    write(plate, &Image::from_fn(300, 300, |_, _| [1.0; 3]), EncodeOptions::default()).unwrap();
    let out = plate.with_file_name("out.exr");
    succeed(cli::tool(&["matte"]).arg(field).arg("--plate").arg(plate).arg("-o").arg(&out));
    let picture = read(&out, Encoding::Linear).unwrap();
    let values = |keep: &dyn Fn(usize, usize) -> bool| -> Vec<f32> {
        let all = (0..300).flat_map(|y| (0..300).map(move |x| (x, y)));
        all.filter(|(x, y)| keep(*x, *y)).map(|(x, y)| picture.pixel(x, y)[1]).collect()
    };
    let mut beside = values(&|x, y| x < 80 && y < 150);
    beside.sort_unstable_by(f32::total_cmp);
    assert!((beside[beside.len() / 2] - 1.0).abs() < 0.02 && beside[beside.len() / 50] > 0.85);
    // The glass stands in the middle of what the patterns filled, its rim in the upper half.
    let glass = values(&|x, y| (115..165).contains(&x) && (170..260).contains(&y));
    let mean = glass.iter().sum::<f32>() / glass.len() as f32;
    assert!((0.25..0.98).contains(&mean), "{mean}");
}
