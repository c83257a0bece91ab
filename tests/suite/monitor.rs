//! The monitor rig from outside: captured or imported, packed, in parts, relit, put before a plate; against the scene itself.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg32;
use relume_core::domain::patterns::{Kind, Noise, PatternSet};
use relume_core::domain::{Bits, Emitter, EmitterCurve, Plane};
use relume_core::field::{Access, Asset};
use relume_core::image::{EncodeOptions, Encoding, Image, read, write};
use relume_core::simulate::{Camera, Monitor, Quality, Rows};
use relume_core::wavelet::Wavelet;
use relume_tests::relume;

use super::capture::{Capture, refuse, tool};
use super::cli::succeed;

/// A screen of 32 x 32 texels behind glass, mirror, glossy and diffuse bodies.
const RIG: &str = r#"
version = 1
name = "Test screen"
kind = "monitor"
[monitor]
columns = 32
rows = 32
noise = 160
squares = 8
[camera]
limits_s = [0.02, 30.0]
step_stops = 3.0
megabytes = 0.1
response = "linear"
[calibration]
dark_times_s = [0.02, 0.25, 2.0]
patterns = ["ramp", "gray-code", "stripes"]
[virtual]
width = 80
height = 60
samples = 16
seed = 1
irradiance = 1500.0
[virtual.sensor]
full_well_e = 30000
read_e = 6
bits = 12
dark = 0.006
"#;
const SIZE: (usize, usize) = (80, 60);
const TEXELS: (usize, usize) = (32, 32);

/// The scene of [`RIG`], and the bare screen.
fn scene() -> &'static (Rows, Rows) {
    static SCENE: OnceLock<(Rows, Rows)> = OnceLock::new();
    SCENE.get_or_init(|| {
        let monitor = Monitor::demo(Camera::monitor(SIZE.0, SIZE.1), TEXELS);
        let quality = Quality { samples: 16, seed: 1, ..Quality::rig() };
        let trace = |monitor: &Monitor| monitor.trace(&quality, &mut |_, _| Ok(())).unwrap();
        (trace(&monitor), trace(&monitor.bare()))
    })
}

/// The session of [`RIG`], captured once, and its field.
fn captured() -> &'static (Capture, PathBuf) {
    static CAPTURED: OnceLock<(Capture, PathBuf)> = OnceLock::new();
    CAPTURED.get_or_init(|| {
        let set = Capture::with(RIG);
        succeed(&mut set.begin("glass", &["--sampler", "noise"]));
        let field = set.path("glass.rfield");
        succeed(tool("pack").arg(set.path("glass")).arg("-o").arg(&field).args(["--terms", "40"]));
        (set, field)
    })
}

/// A picture on the screen: soft, with an edge, coloured; 0 to 1.
fn backdrop() -> Image {
    Image::from_fn(TEXELS.0, TEXELS.1, |x, y| {
        let (u, v) = (x as f32 / TEXELS.0 as f32, y as f32 / TEXELS.1 as f32);
        let edge = if u + 0.3 * v > 0.7 { 0.45 } else { 0.0 };
        [0.1 + 0.4 * u + edge, 0.2 + 0.3 * v + edge, 0.5 - 0.3 * u * v]
    })
}

fn emitted(picture: &Image) -> Vec<[f32; 3]> {
    picture.data().chunks_exact(3).map(|p| [p[0], p[1], p[2]]).collect()
}

/// `||a - b|| / ||b||` over pixels that count.
fn relative(a: &Image, b: &Image, counts: impl Fn(usize) -> bool) -> f64 {
    let (mut off, mut all) = (0.0, 0.0);
    for pixel in (0..a.width() * a.height()).filter(|pixel| counts(*pixel)) {
        let at = |image: &Image, c: usize| f64::from(image.data()[image.channels() * pixel + c]);
        for c in 0..3 {
            off += (at(a, c) - at(b, c)).powi(2);
            all += at(b, c).powi(2);
        }
    }
    (off / all).sqrt()
}

fn written(path: &Path, image: &Image) {
    write(path, image, EncodeOptions::default()).unwrap();
}

#[test]
fn a_captured_screen_lights_and_composites_as_the_scene_does() {
    let (set, field) = captured();
    let (rows, bare) = scene();
    let asset = Asset::open(field, Access::Read).unwrap();
    let alpha = asset.alpha().expect("stripes give alpha").to_vec();
    assert!(asset.domain().correspondence().is_some());
    let shown = set.path("backdrop.exr");
    written(&shown, &backdrop());
    let lit = set.path("lit.exr");
    succeed(Command::new(relume()).arg("relight").arg(field).arg("--plane").arg(&shown).arg("-o").arg(&lit));
    let truth = rows.photograph(&emitted(&backdrop())).unwrap();
    let found = read(&lit, Encoding::Linear).unwrap();
    // T in units of the white screen, which is what the traced rows are in; 160 patterns for 1024 texels.
    let error = relative(&found, &truth, |pixel| alpha[pixel] > 0.999);
    assert!(error < 0.04, "{error}");

    // The bare screen's own picture as the plate gives the photograph back: 6.6.4 and soft edges.
    let plate = bare.photograph(&emitted(&backdrop())).unwrap();
    written(&set.path("plate.exr"), &plate);
    let composite = set.path("composite.exr");
    let matte = |options: &[&str], to: &Path| {
        let mut command = Command::new(relume());
        command.arg("matte").arg(field).arg("--plate").arg(set.path("plate.exr")).arg("-o").arg(to).args(options);
        succeed(&mut command);
        read(to, Encoding::Linear).unwrap()
    };
    let found = matte(&[], &composite);
    let error = relative(&found, &truth, |pixel| alpha[pixel] < 0.001);
    assert!(error < 0.005, "directly seen: {error}");
    // At the screen's own rim the bare picture is dimmer, as is what is seen of it: such a plate counts the rim twice.
    let white = bare.photograph(&vec![[1.0; 3]; TEXELS.0 * TEXELS.1]).unwrap();
    let soft = |pixel: usize| (0.001..0.999).contains(&alpha[pixel]) && white.data()[3 * pixel] > 0.999;
    let error = relative(&found, &truth, soft);
    // The camera sees the backdrop's step at one row a texel; smooth backdrops come to a third of this.
    assert!(error < 0.06, "soft edges: {error} of {}", (0..alpha.len()).filter(|pixel| soft(*pixel)).count());
    let element = matte(&["--output", "element"], &set.path("element.exr"));
    let coverage = matte(&["--output", "alpha"], &set.path("alpha.exr"));
    for pixel in 0..SIZE.0 * SIZE.1 {
        let through = 1.0 - coverage.data()[3 * pixel];
        for c in 0..3 {
            let sum = element.data()[4 * pixel + c] + through * plate.data()[3 * pixel + c];
            assert!((sum - found.data()[found.channels() * pixel + c]).abs() < 1e-5);
        }
    }
}

#[test]
fn parts_make_the_same_field() {
    let (set, whole) = captured();
    let part = |tiles: &str| {
        let out = set.path("parts.rfield");
        succeed(tool("pack").arg(set.path("glass")).arg("-o").arg(out).args(["--terms", "40", "--tiles", tiles]));
        set.path(&format!("parts.rfield.part-{tiles}"))
    };
    let parts = [part("4-8"), part("1-3")];
    let merged = set.path("merged.rfield");
    succeed(Command::new(relume()).arg("merge").args(&parts).arg("-o").arg(&merged));
    let open = |path: &Path| Asset::open(path, Access::Read).unwrap();
    let (a, b) = (open(whole), open(&merged));
    let arrays = |asset: &Asset| -> Vec<(String, String)> {
        let all = asset.manifest().blake3.clone();
        all.into_iter().filter(|(name, _)| !name.starts_with("preview")).collect()
    };
    assert_eq!((arrays(&a), a.manifest().provenance.get("tiles")), (arrays(&b), None));
    let merge = |parts: &[&Path]| {
        let mut command = Command::new(relume());
        command.arg("merge").args(parts).arg("-o").arg(set.path("bad.rfield"));
        command
    };
    refuse(&mut merge(&[&parts[0]]), &["none with tile 1"]);
    refuse(&mut merge(&[&parts[0], &parts[0], &parts[1]]), &["tile 4", "no other part"]);
    refuse(&mut merge(&[whole]), &["a field that is whole"]);
    assert!(!set.path("bad.rfield").exists());
    let mut beyond = tool("pack");
    beyond.arg(set.path("glass")).arg("-o").arg(set.path("p.rfield")).args(["--tiles", "7-9"]);
    refuse(&mut beyond, &["7-9", "8 tiles"]);
    let mut bare = tool("pack");
    bare.arg(set.path("glass")).arg("-o").arg(set.path("p.rfield")).arg("--bare").arg(set.path("glass"));
    refuse(&mut bare, &["the object in it", "relume capture --bare"]);
}

#[test]
fn squares_make_a_field_as_well() {
    let set = Capture::with(RIG);
    succeed(&mut set.begin("scan", &["--sampler", "scan"]));
    let field = set.path("scan.rfield");
    succeed(tool("pack").arg(set.path("scan")).arg("-o").arg(&field));
    let asset = Asset::open(&field, Access::Read).unwrap();
    assert_eq!(asset.domain().plane().unwrap().size(), (8, 8));
    // Light that is constant over each square is no approximation.
    let steps = Image::from_fn(TEXELS.0, TEXELS.1, |x, y| [(x / 4) as f32 / 8.0, (y / 4) as f32 / 8.0, 0.3]);
    written(&set.path("steps.exr"), &steps);
    let lit = set.path("lit.exr");
    let mut command = Command::new(relume());
    succeed(command.arg("relight").arg(&field).arg("--plane").arg(set.path("steps.exr")).arg("-o").arg(&lit));
    let truth = scene().0.photograph(&emitted(&steps)).unwrap();
    let alpha = asset.alpha().unwrap();
    let error = relative(&read(&lit, Encoding::Linear).unwrap(), &truth, |pixel| alpha[pixel] > 0.999);
    assert!(error < 0.01, "{error}");
}

/// Pairs made elsewhere: codes of noise on a screen of a known curve, photographs with camera noise.
struct Pairs {
    folder: tempfile::TempDir,
}

impl Pairs {
    fn new(count: usize) -> Self {
        let pairs = Self { folder: tempfile::tempdir().unwrap() };
        for name in ["patterns", "photos"] {
            fs::create_dir(pairs.path(name)).unwrap();
        }
        let (emitter, rows) = (Emitter::new(&EmitterCurve::Srgb, Bits::Eight), &scene().0);
        let noise = Noise { wavelet: Wavelet::Haar, count, seed: 5, deviation: Noise::DEVIATION };
        let set = PatternSet::new(Kind::Noise(noise), Plane::new(TEXELS.0, TEXELS.1).unwrap()).unwrap();
        let mut random = Pcg32::seed_from_u64(2);
        for n in 0..count {
            let codes = set.pattern(n).codes(&emitter);
            let name = format!("{n:04}");
            relume_core::image::write_grey(&pairs.path(&format!("patterns/{name}.png")), TEXELS, &codes, true).unwrap();
            let light: Vec<[f32; 3]> = codes.iter().map(|code| [emitter.light(*code); 3]).collect();
            let mut photograph = rows.photograph(&light).unwrap();
            // About normal: the sum of four uniform numbers, deviation 0.2 %.
            let mut normal = || (0..4).map(|_| random.random::<f32>() - 0.5).sum::<f32>() * 1.732;
            photograph.data_mut().iter_mut().for_each(|v| *v *= 1.0 + 0.002 * normal());
            written(&pairs.path(&format!("photos/{name}.exr")), &photograph);
        }
        pairs
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn import(&self, session: &str) {
        let mut command = Command::new(relume());
        command.args(["import", "pairs", "--patterns"]).arg(self.path("patterns")).arg("--photos");
        succeed(command.arg(self.path("photos")).arg("--session").arg(self.path(session)));
    }

    fn pack(&self, session: &str, options: &[&str]) -> Command {
        let mut command = Command::new(relume());
        command.arg("pack").arg(self.path(session)).arg("-o").arg(self.path("a.rfield")).args(options);
        command
    }
}

#[test]
fn imported_pairs_are_solved_and_what_cannot_be_is_told() {
    let pairs = Pairs::new(128);
    pairs.import("s");
    succeed(&mut pairs.pack("s", &["--terms", "40"]));
    written(&pairs.path("shown.exr"), &backdrop());
    let mut command = Command::new(relume());
    command.arg("relight").arg(pairs.path("a.rfield")).arg("--plane").arg(pairs.path("shown.exr"));
    succeed(command.arg("-o").arg(pairs.path("lit.exr")));
    let truth = scene().0.photograph(&emitted(&backdrop())).unwrap();
    let error = relative(&read(&pairs.path("lit.exr"), Encoding::Linear).unwrap(), &truth, |_| true);
    assert!(error < 0.05, "{error}");

    refuse(&mut pairs.pack("s", &["--terms", "128"]), &["128"]);
    refuse(&mut pairs.pack("s", &["--terms", "40", "--bare", "x"]), &["--bare"]);
    let covers = |name: &str, value: f32| {
        written(&pairs.path(name), &Image::from_fn(SIZE.0, SIZE.1, |_, _| [value; 3]));
        pairs.path(name).to_string_lossy().into_owned()
    };
    refuse(&mut pairs.pack("s", &["--alpha", &covers("all.exr", 1.0)]), &["all.exr", "everything"]);
    refuse(&mut pairs.pack("s", &["--alpha", &covers("none.exr", 0.0)]), &["none.exr", "nothing"]);
    fs::write(pairs.path("bad.json"), "{}").unwrap();
    let bad = pairs.path("bad.json").to_string_lossy().into_owned();
    refuse(&mut pairs.pack("s", &["--correspondence", &bad]), &["bad.json", "calibrate screen"]);

    // Light from all round, and lamps, mean nothing here.
    let mut command = Command::new(relume());
    command.arg("relight").arg(pairs.path("a.rfield")).args(["--lamp", "1", "-o"]).arg(pairs.path("x.exr"));
    refuse(&mut command, &["a field of a screen", "relume matte"]);

    // A pattern that went missing, one of another size, and patterns without contrast.
    let import = |session: &str| {
        let mut command = Command::new(relume());
        command.args(["import", "pairs", "--patterns"]).arg(pairs.path("patterns")).arg("--photos");
        command.arg(pairs.path("photos")).arg("--session").arg(pairs.path(session));
        command
    };
    fs::rename(pairs.path("photos/0007.exr"), pairs.path("0007.exr")).unwrap();
    refuse(&mut import("t"), &["127 photographs", "128 patterns"]);
    fs::rename(pairs.path("0007.exr"), pairs.path("photos/0007.exr")).unwrap();
    let pattern = pairs.path("patterns/0009.png");
    relume_core::image::write_grey(&pattern, (16, 16), &[128; 256], true).unwrap();
    refuse(&mut import("t"), &["0009.png", "16 x 16"]);
    for n in 0..128 {
        let path = pairs.path(&format!("patterns/{n:04}.png"));
        relume_core::image::write_grey(&path, TEXELS, &[128; TEXELS.0 * TEXELS.1], true).unwrap();
    }
    succeed(&mut import("flat"));
    refuse(&mut pairs.pack("flat", &["--terms", "40"]), &["pattern 1", "the same light", "everywhere"]);
}
