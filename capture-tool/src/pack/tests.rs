//! What packing recovers from a virtual stage, held against what was put in.

use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use relume_core::simulate::{Sensor, SensorResponse};

use super::checks::Checks;
use super::develop::Developer;
use super::lamps::Irradiances;
use super::records::Records;
use crate::capture::run::{End, Limits, run};
use crate::capture::{Listed, scan};
use crate::devices::cameras::virtual_camera::{VirtualCamera, Window};
use crate::devices::rehearsal::Fault;
use crate::rigs::RigFile;
use crate::rigs::virtual_stage::{VirtualStage, irradiances};
use crate::session::{CaptureDescription, Description, Session, Source};

/// The sensor of [`RIG`].
const SENSOR: Sensor = Sensor {
    noise: relume_core::hdr::Noise { full_well_e: 30_000.0, read_e: 6.0 },
    bits: 12,
    dark: 0.006,
    response: SensorResponse::Film,
};

/// A stage of 5 lamps at 4 stops whose camera has a curve and whose lamps differ and fade. Times are given, to keep it short.
const RIG: &str = r#"
version = 1
name = "Test stage"
kind = "stage"
[stage]
reference_every = 7
[stage.lamps]
layout = "arc"
latitudes = 5
longitudes = 4
[camera]
times_s = [0.0005, 0.004, 0.032, 0.25, 1.0]
limits_s = [0.00025, 30.0]
response = "recover"
[calibration]
response_times_s = [0.001, 0.001587, 0.003175, 0.00504, 0.01008, 0.016, 0.032, 0.0508, 0.1016, 0.1613, 0.3225, 0.512, 1.024]
dark_times_s = [0.001, 0.016, 0.256, 1.024]
[calibration.white_ball]
albedo = 0.9
circle_px = [80.0, 60.0, 48.06]
focal_px = 308.67
[virtual]
width = 160
height = 120
samples = 4
irradiance = 800.0
spread = 0.12
drift = -0.03
ambient = 1e-4
[virtual.sensor]
full_well_e = 30000
read_e = 6
bits = 12
dark = 0.006
response = "film"
"#;

/// The traced scene, and [`RIG`] captured without faults, shared between tests.
struct Shared {
    folder: tempfile::TempDir,
    scene: PathBuf,
}

fn shared() -> &'static Shared {
    static SHARED: OnceLock<Shared> = OnceLock::new();
    SHARED.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        let scene = folder.path().join("scene.rfield");
        capture(folder.path(), &scene, &[]);
        Shared { folder, scene }
    })
}

fn rig() -> RigFile {
    RigFile::parse(RIG, Path::new("rig.toml")).unwrap()
}

/// The session without faults.
fn plain() -> (RigFile, Records) {
    (rig(), Records::read(&shared().folder.path().join("s")).unwrap())
}

/// Captures [`RIG`] into `folder/s`.
fn capture(folder: &Path, scene: &Path, faults: &[Fault]) -> Records {
    let rig = rig();
    let stage_rig = rig.stage.as_ref().unwrap();
    let steps = scan::steps(&rig, stage_rig);
    let window = Window::default();
    let scanned = scan::count(&steps);
    let mut stage = VirtualStage::in_file(&rig, scene, scanned, window.clone(), faults, &mut |_, _| Ok(())).unwrap();
    let mut camera = VirtualCamera::new(SENSOR, window, faults);
    let description = CaptureDescription { sampler: "scan".to_owned(), seed: 1, rig: rig.clone() };
    let root = folder.join("s");
    let mut session = Session::create(&root, Description::new(Source::Capture(Box::new(description)))).unwrap();
    let limits = Limits::default();
    let ended = run(&mut session, &rig, (&mut stage, &mut camera), &mut Listed::new(steps), &limits).unwrap();
    assert_eq!(ended.end, End::Complete);
    Records::read(&root).unwrap()
}

#[test]
fn camera_and_lamps_are_recovered_to_a_hundredth() {
    let (rig, records) = plain();
    let developer = Developer::new(&records, &rig.camera).unwrap();

    // The black level, in codes: f(dark).
    let truth = SENSOR.code_of(0.0);
    for level in developer.black.as_ref().unwrap().level {
        assert!((f64::from(level) / truth - 1.0).abs() < 0.01, "black level {level}, {truth} was put in");
    }

    // The response: light above black of every code; the scale is free. Up to 0.95 of white: beyond, little is told of
    // codes that clip in the next exposure (0.99 is off by 1.3 % of white), and a merge trusts them little.
    let codes: Vec<f64> = (0..=1000).map(|n| truth + (SENSOR.code_of(0.95) - truth) * f64::from(n) / 1000.0).collect();
    for c in 0..3 {
        let zero = developer.curve().light(c, truth);
        let found: Vec<f64> = codes.iter().map(|code| developer.curve().light(c, *code) - zero).collect();
        let true_light: Vec<f64> = codes.iter().map(|code| SENSOR.light_of(*code)).collect();
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let scale = dot(&found, &true_light) / dot(&found, &found);
        let off = |n: usize| scale * found[n] - true_light[n];
        let of_white = (0..codes.len()).map(|n| off(n).abs()).fold(0.0, f64::max);
        assert!(of_white < 0.01, "channel {c}: off by {of_white} of white");
        // Where light is not next to black, also in shares of itself.
        let relative = (50..950).map(|n| (off(n) / true_light[n]).abs()).fold(0.0, f64::max);
        assert!(relative < 0.01, "channel {c}: off by {relative} of the light");
    }

    // The lamps, up to the one scale that the response leaves free.
    let found = Irradiances::new(&records, &developer, &rig, rig.stage.as_ref().unwrap()).unwrap();
    let truth = irradiances(&rig, 5);
    let pairs = || found.bulbs.iter().zip(&truth).flat_map(|(a, b)| a.iter().zip(b));
    let scale = pairs().map(|(a, b)| a / b).sum::<f32>() / pairs().count() as f32;
    assert!(found.measured && pairs().count() == 15);
    for (a, b) in pairs() {
        assert!((a / b / scale - 1.0).abs() < 0.01, "{a} for {b}, scale {scale}");
    }
}

#[test]
fn drift_of_three_percent_is_told_and_corrected() {
    let (rig, records) = plain();
    let developer = Developer::new(&records, &rig.camera).unwrap();
    let checks = Checks::new(&records, &developer).unwrap();
    let said = checks.doubts();
    assert!(said.len() == 1 && said[0].contains("drifted by -3."), "{said:?}");
    let last = records.all().map(|p| p.number).max().unwrap();
    for gain in checks.gain(last) {
        assert!((gain - 0.97).abs() < 0.003, "{gain}");
    }
    assert_eq!(checks.gain(1), [1.0; 3]);
}

#[test]
fn a_bump_of_two_pixels_is_told() {
    let folder = tempfile::tempdir().unwrap();
    // Somewhere in the scan; calibration comes before.
    let (rig, records) = (rig(), capture(folder.path(), &shared().scene, &[Fault::Bump(25)]));
    let developer = Developer::new(&records, &rig.camera).unwrap();
    let checks = Checks::new(&records, &developer).unwrap();
    let said = checks.doubts();
    assert!(said.iter().any(|line| line.contains("moved by 2.0") || line.contains("moved by 1.9")), "{said:?}");
    assert!(checks.words().contains("pixels"), "{}", checks.words());
}
