//! Explicit sampling (6.6) and the bare screen, from outside.

use std::fs;
use std::process::{Command, Stdio};
use std::time::Duration;

use relume_core::evaluate::explicit::{relative_error, smooth_lights};
use relume_core::field::{Access, Asset};
use relume_core::image::{Encoding, Image, read, write};
use relume_core::simulate::{Camera, Monitor, Quality};
use serde_json::Value;

use super::capture::{Capture, refuse, tool};
use super::cli::{run, succeed, text};

/// A screen of 16 x 16 texels behind glass, mirror and diffuse bodies.
const RIG: &str = r#"
version = 1
name = "Test screen"
kind = "monitor"
[monitor]
columns = 16
rows = 16
functions = 40
[camera]
times_s = [0.05, 0.8]
limits_s = [0.0005, 30.0]
megabytes = 0.01
[calibration]
dark_times_s = [0.001, 0.256, 1.024]
patterns = ["gray-code"]
[virtual]
width = 40
height = 30
samples = 4
irradiance = 800.0
[virtual.sensor]
full_well_e = 30000
read_e = 6
bits = 12
dark = 0.006
"#;
/// Before the first function: dark, Gray codes of 4 + 4 bits with inverses, black and white twice.
const OPENING: usize = 1 + 16 + 4;

/// Conditions and hashes: what two sessions must agree on.
fn essence(journal: &[Value]) -> Vec<(Value, Value)> {
    journal.iter().map(|p| (p["condition"].clone(), p["frames"][0]["blake3"].clone())).collect()
}

#[test]
fn functions_are_chosen_by_what_is_seen_and_a_resumed_capture_chooses_the_same() {
    let set = Capture::with(RIG);
    let explicit = &["--sampler", "explicit"];
    let plan = succeed(set.begin("whole", explicit).arg("--plan"));
    assert!(plan.contains("79  samples"), "{plan}");
    let said = succeed(&mut set.begin("whole", explicit));
    let steps = OPENING + 79;
    for words in [&format!("{steps} of {steps} photographs"), "function 40 of 40 by ", "the bound (6.7)", "relume pack"]
    {
        assert!(said.contains(words), "`{words}` not in: {said}");
    }
    let journal = set.journal("whole");
    assert_eq!(journal.len(), steps);
    let log = fs::read_to_string(set.path("whole/capture.log")).unwrap();
    let bounds: Vec<f64> =
        log.lines().filter_map(|line| line.split_once("bound (6.7) ")?.1.split_once(" %")?.0.parse().ok()).collect();
    assert!(bounds.len() == 40 && bounds.is_sorted_by(|a, b| a >= b) && bounds[39] < 90.0, "{bounds:?}");
    // What sees the screen itself does not count.
    let counted = said.split_once("by ").unwrap().1.split_once(" of 1200").unwrap().0.parse::<usize>().unwrap();
    assert!((300..900).contains(&counted), "{counted} pixels count");
    // Functions came by what they weigh, not in the order of the set.
    let numbers: Vec<u64> =
        journal[OPENING..].iter().map(|p| p["condition"]["pattern"]["number"].as_u64().unwrap()).collect();
    assert!(!numbers.is_sorted() && numbers[..7] == [0, 1, 2, 3, 4, 5, 6], "{numbers:?}");

    // Stopped within a function, within a place, and killed.
    succeed(set.begin("parts", explicit).args(["--max-photos", "30"]));
    succeed(&mut set.resume("parts", &["--max-photos", "5"]));
    let mut killed = set.resume("parts", &[]).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
    std::thread::sleep(Duration::from_millis(300));
    killed.kill().unwrap();
    killed.wait().unwrap();
    let said = succeed(&mut set.resume("parts", &[]));
    assert!(said.contains(&format!("{steps} of {steps}")), "{said}");
    assert_eq!(essence(&set.journal("parts")), essence(&journal));

    // Taken again, a photograph may weigh a little else: what was shown stays, and more can follow.
    let redo = (OPENING + 3).to_string();
    succeed(&mut set.resume("parts", &["--redo", &redo]));
    let said = succeed(&mut set.resume("parts", &["--functions", "52"]));
    assert!(said.contains("function 52 of 52"), "{said}");
    assert_eq!(essence(&set.journal("parts"))[OPENING + 3..steps], essence(&journal)[OPENING + 3..]);
    // A threshold ends it; the rig file is the one it was begun with, whatever its count of functions.
    let said = succeed(tool("capture").arg(set.path("rig.toml")).arg("--session").arg(set.path("parts")).args([
        "--resume",
        "--functions",
        "250",
        "--threshold",
        "0.5",
    ]));
    let shown: usize = said.split_once("function ").unwrap().1.split_once(" of 250").unwrap().0.parse().unwrap();
    assert!((52..250).contains(&shown), "{said}");
    // Calibration alone begins no function.
    succeed(set.begin("c", explicit).args(["--only", "calibration"]));
    assert_eq!(set.journal("c").len(), 17);
}

#[test]
fn shifted_functions_take_one_photograph_each() {
    let set = Capture::with(&RIG.replace("functions = 40", "functions = 25\nparts = \"shifted\"\nwavelet = \"5/3\""));
    let said = succeed(&mut set.begin("s", &["--sampler", "explicit"]));
    let steps = OPENING + 25;
    assert!(said.contains(&format!("{steps} of {steps}")) && said.contains("function 25 of 25 by"), "{said}");
}

#[test]
fn the_bare_screen_is_a_session_of_its_own() {
    let set = Capture::with(RIG);
    let said = succeed(&mut set.begin("bare", &["--bare"]));
    let steps = 1 + 16 + 2;
    assert!(said.contains(&format!("{steps} of {steps} photographs of the bare screen")), "{said}");
    let picture = Image::from_fn(8, 8, |x, _| [x as f32 / 8.0, 0.2, 0.1]);
    write(&set.path("p.png"), &picture, Default::default()).unwrap();
    let shown = set.path("p.png").display().to_string();
    succeed(&mut set.resume("bare", &["--reference", &shown]));
    let journal = set.journal("bare");
    assert_eq!(journal.last().unwrap()["condition"]["picture"], "0001-p.png");
    // Nothing stands before it: the object's session sees less of the white screen.
    succeed(&mut set.begin("object", &["--sampler", "explicit", "--functions", "1"]));
    let light = |session: &str| {
        let merged = set.path(&format!("{session}-light"));
        succeed(tool("pack").arg(set.path(session)).arg("--merged").arg(&merged));
        let white = fs::read_dir(&merged).unwrap().map(|e| e.unwrap().path());
        let white = white.filter(|p| p.to_string_lossy().contains("white")).min().unwrap();
        read(&white, Encoding::Linear).unwrap()
    };
    let (bare, object) = (light("bare"), light("object"));
    let middle = |image: &Image| image.pixel(20, 15)[1];
    assert!(middle(&bare) > 1.05 * middle(&object), "{} and {}", middle(&bare), middle(&object));
    refuse(&mut set.resume("bare", &["--sampler", "noise"]), &["begun with --bare"]);
    refuse(&mut set.resume("object", &["--bare"]), &["begun with --sampler explicit"]);
}

#[test]
fn what_makes_no_sense_is_refused() {
    let set = Capture::with(RIG);
    refuse(&mut set.begin("s", &["--functions", "9"]), &["--functions", "--sampler explicit"]);
    for (options, words) in [
        (&["--sampler", "explicit", "--functions", "0"][..], "at least 1"),
        (&["--sampler", "explicit", "--threshold", "1.5"], "a share"),
        (&["--bare", "--sampler", "noise"], "cannot be used with"),
    ] {
        let output = run(&mut set.begin("s", options));
        assert!(!output.status.success() && text(&output.stderr).contains(words), "{}", text(&output.stderr));
    }
    // Exposures shorter than the screen's refresh; a screen of 240 Hz can be photographed faster.
    for (from, to, words) in [
        ("times_s = [0.05, 0.8]", "times_s = [0.01, 0.8]", Some("refresh_hz = 60")),
        ("times_s = [0.05, 0.8]", "times_s = [0.01, 0.8]", None),
        ("[calibration]", "[calibration]\nresponse_times_s = [0.002, 0.1]", Some("response_times_s")),
        ("functions = 40", "refresh_hz = 0.5", Some("refresh_hz")),
        ("functions = 40", "parts = \"halved\"", Some("line")),
        ("samples = 4", "scene = \"wet\"", Some("line")),
    ] {
        let mut rig = RIG.replace(from, to);
        if words.is_none() {
            rig = rig.replace("functions = 40", "refresh_hz = 240");
        }
        fs::write(set.path("rig.toml"), &rig).unwrap();
        let mut plan: Command = set.begin("s", &["--plan"]);
        match words {
            Some(words) => drop(refuse(&mut plan, &["rig.toml", words])),
            None => drop(succeed(&mut plan)),
        }
    }
    let stage = super::capture::RIG.replace("samples = 4", "samples = 4\nscene = \"diffuse\"");
    fs::write(set.path("rig.toml"), &stage).unwrap();
    refuse(&mut set.begin("s", &["--plan"]), &["scene", "is for a screen"]);
    fs::write(set.path("rig.toml"), super::capture::RIG).unwrap();
    refuse(&mut set.begin("s", &["--bare"]), &["--bare", "screen"]);
    refuse(&mut set.begin("s", &["--sampler", "explicit"]), &["a stage is scanned"]);
}

/// What `relume calibrate gamma` writes is taken out before patterns are shown, and the session keeps it.
#[test]
fn a_measured_curve_is_inverted() {
    let rig = RIG.replace("functions = 40", "functions = 3\nwavelet = \"5/3\"\ncurve = { file = \"screen.txt\" }");
    let set = Capture::with(&rig);
    refuse(&mut set.begin("s", &["--sampler", "explicit"]), &["screen.txt"]);
    let table = |gamma: f64| -> String {
        (0..256).map(|code| format!("{code} {}\n", (f64::from(code) / 255.0).powf(gamma))).collect()
    };
    let mean = |gamma: f64, name: &str| {
        fs::write(set.path("screen.txt"), table(gamma)).unwrap();
        succeed(&mut set.begin(name, &["--sampler", "explicit"]));
        let merged = set.path(&format!("{name}-light"));
        succeed(tool("pack").arg(set.path(name)).arg("--merged").arg(&merged));
        let last = fs::read_dir(&merged).unwrap().map(|e| e.unwrap().path()).max().unwrap();
        let image = read(&last, Encoding::Linear).unwrap();
        image.data().iter().map(|v| f64::from(*v)).sum::<f64>()
    };
    let (right, wrong) = (mean(2.2, "right"), mean(1.0, "wrong"));
    // Taken for linear, the mid tones of a function are shown too dark.
    assert!(wrong < 0.85 * right, "{wrong} and {right}");
    assert!(fs::read_to_string(set.path("right/session.toml")).unwrap().contains("measured"));
    fs::remove_file(set.path("screen.txt")).unwrap();
    succeed(&mut set.resume("right", &["--functions", "4"]));
}

/// From patterns to a relit picture: a session of functions, packed and lit by a picture on the screen, shows what the traced scene
/// shows (figure 6.14); split in two parts, or shifted, through the screen's measured curve.
#[test]
fn a_field_of_functions_shows_what_the_scene_shows() {
    const SIZE: (usize, usize) = (80, 60);
    const TEXELS: (usize, usize) = (32, 32);
    let rig = |more: &str| {
        RIG.replace("columns = 16\nrows = 16\nfunctions = 40", &format!("columns = 32\nrows = 32\n{more}"))
            .replace("[\"gray-code\"]", "[\"gray-code\", \"stripes\"]")
            .replace(
                "width = 40\nheight = 30\nsamples = 4",
                "width = 80\nheight = 60\nsamples = 16\nscene = \"diffuse\"",
            )
            .replace("times_s = [0.05, 0.8]", "times_s = [0.05, 0.4, 3.2]")
    };
    let quality = Quality { samples: 16, seed: 1, ..Quality::rig() };
    let rows = Monitor::cubes(Camera::monitor(SIZE.0, SIZE.1), TEXELS).trace(&quality, &mut |_, _| Ok(())).unwrap();
    let light = &smooth_lights(TEXELS)[0];
    let truth = rows.photograph(light).unwrap();
    for (more, functions, most) in [
        ("functions = 100", 100, 0.03),
        ("functions = 60\nwavelet = \"9/7\"\nparts = \"shifted\"\ncurve = { file = \"screen.txt\" }", 60, 0.06),
    ] {
        let set = Capture::with(&rig(more));
        let table: String = (0..256).map(|c| format!("{c} {}\n", (f64::from(c) / 255.0).powf(2.2))).collect();
        fs::write(set.path("screen.txt"), table).unwrap();
        succeed(&mut set.begin("s", &["--sampler", "explicit"]));
        let (field, lit) = (set.path("a.rfield"), set.path("lit.exr"));
        let said = succeed(tool("pack").arg(set.path("s")).arg("-o").arg(&field));
        assert!(said.contains(&format!("{functions} functions")), "{said}");
        write(
            &set.path("plane.exr"),
            &Image::from_fn(TEXELS.0, TEXELS.1, |x, y| light[y * TEXELS.0 + x]),
            Default::default(),
        )
        .unwrap();
        succeed(tool("relight").arg(&field).arg("--plane").arg(set.path("plane.exr")).arg("-o").arg(&lit));
        let asset = Asset::open(&field, Access::Read).unwrap();
        let alpha = asset.alpha().expect("stripes give alpha");
        let covered: Vec<usize> = (0..alpha.len()).filter(|pixel| alpha[*pixel] > 0.999).collect();
        assert!(covered.len() > 500, "{} pixels are the object's", covered.len());
        let lit = read(&lit, Encoding::Linear).unwrap().into_rgb();
        let error = relative_error(&lit, &truth, &covered);
        assert!(error < most, "{more}: {error}");
        // What cannot be meant is told.
        refuse(tool("pack").arg(set.path("s")).arg("-o").arg(&field).args(["--terms", "9"]), &["--terms", "noise"]);
    }
    let set = Capture::with(RIG);
    succeed(&mut set.begin("bare", &["--bare"]));
    refuse(tool("pack").arg(set.path("bare")).arg("-o").arg(set.path("a.rfield")), &["the bare screen", "--bare"]);
}
