//! The main job on real photographs: `../shared/data`, where it is there.

use std::path::{Path, PathBuf};
use std::process::Command;

use relume_core::field::{Access, Asset};
use relume_core::illumination::EnvMap;
use relume_core::image::{EncodeOptions, Encoding, Image, Window, read, write};
use relume_core::relight::{Light, Look, Relighter, Weights};
use relume_tests::host::{Context, Host, Options, RenderArgs, TestImage};
use relume_tests::{relume, shared_data, skipped};

/// The painting as an asset, and a map to light it with.
struct Painting {
    folder: tempfile::TempDir,
    data: PathBuf,
    asset: PathBuf,
}

impl Painting {
    fn new() -> Option<Self> {
        let Some(data) = shared_data() else {
            skipped("../shared/data");
            return None;
        };
        let folder = tempfile::tempdir().unwrap();
        let asset = folder.path().join("p.rfield");
        let lp = data.join("painting-72/dirs.lp");
        tool(Command::new(relume()).args(["import", "lp"]).arg(lp).arg("-o").arg(&asset));
        Some(Self { folder, data, asset })
    }

    fn park(&self) -> PathBuf {
        self.data.join("hdri/park.hdr")
    }

    fn relighter(&self) -> Relighter {
        Relighter::new(Asset::open(&self.asset, Access::Mapped).unwrap()).unwrap()
    }

    /// The command line's picture.
    fn picture(&self, options: &[&str]) -> Image {
        let output = self.folder.path().join("x.exr");
        tool(Command::new(relume()).arg("relight").arg(&self.asset).arg("-o").arg(&output).args(options));
        read(&output, Encoding::Auto).unwrap()
    }
}

fn tool(command: &mut Command) {
    let output = command.output().unwrap();
    assert!(output.status.success(), "{command:?}: {}", String::from_utf8_lossy(&output.stderr));
}

fn path(of: &Path) -> &str {
    of.to_str().unwrap()
}

/// Largest difference, relative to the largest value of `b`.
fn difference(a: &Image, b: &Image) -> f32 {
    assert_eq!((a.size(), a.channels()), (b.size(), b.channels()));
    let largest = b.data().iter().fold(0.0f32, |m, v| m.max(v.abs()));
    a.data().iter().zip(b.data()).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max) / largest
}

#[test]
fn every_lamp_returns_its_photograph_to_half_precision() {
    let Some(painting) = Painting::new() else { return };
    let relighter = painting.relighter();
    let window = Window::full(relighter.asset().width(), relighter.asset().height());
    for n in 1..=72 {
        let weights = relighter.weights(Light::Lamp(n), &Look::default()).unwrap();
        let picture = relighter.render(&weights, &Look::default(), window).unwrap().into_rgb();
        let photograph = read(&painting.data.join(format!("painting-72/image{n:02}.jpg")), Encoding::Auto).unwrap();
        let worst =
            picture.data().iter().zip(photograph.data()).map(|(a, b)| (a - b).abs() / b.max(1e-3)).fold(0.0, f32::max);
        // Half of 2^-10, and the rounding of photo / pi x pi.
        assert!(worst < 0.5 / 1024.0 * 1.01, "lamp {n}: off by {worst} of the photograph");
    }
}

#[test]
fn relighting_is_linear_in_light_and_the_sum_over_lamps() {
    let Some(painting) = Painting::new() else { return };
    let park = path(&painting.park()).to_owned();
    let one = painting.picture(&["--env", &park]);
    let up = painting.picture(&["--env", &park, "--exposure", "3"]);
    let scaled = Image::from_data(one.width(), one.height(), 3, one.data().iter().map(|v| v * 8.0).collect()).unwrap();
    assert!(difference(&up, &scaled) < 1e-6, "three stops are not eight times");

    let relighter = painting.relighter();
    let map = EnvMap::load(&painting.park()).unwrap();
    let weights = relighter.weights(Light::Map(&map), &Look::default()).unwrap();
    let window = Window::full(one.width(), one.height());
    let mut sum = Image::new(one.width(), one.height(), 3);
    for (n, rgb) in weights.rgb.iter().enumerate() {
        let mut alone = Weights::dark(72);
        alone.rgb[n] = *rgb;
        let lit = relighter.render(&alone, &Look::default(), window).unwrap().into_rgb();
        sum.data_mut().iter_mut().zip(lit.data()).for_each(|(s, l)| *s += l);
    }
    assert!(difference(&one, &sum) < 1e-5, "not the sum over the lamps");
}

/// A constant map of radiance 1 gives `sum_j Omega_j T_j`, with `sum_j Omega_j` the covered solid angle.
#[test]
fn a_constant_map_keeps_energy() {
    let Some(painting) = Painting::new() else { return };
    let map = painting.folder.path().join("one.exr");
    write(&map, &Image::from_fn(64, 32, |_, _| [1.0; 3]), EncodeOptions::default()).unwrap();
    let relighter = painting.relighter();
    let ones = EnvMap::load(&map).unwrap();
    for method in ["zero-order", "linear"] {
        let look = Look { method: relume_core::settings::method(usize::from(method == "linear")), ..Look::default() };
        let omega = relighter.weights(Light::Map(&ones), &look).unwrap();
        let total: f64 = omega.rgb.iter().map(|w| f64::from(w[1])).sum();
        let covered = relighter.asset().directions().unwrap().covered_solid_angle();
        assert!((total / covered - 1.0).abs() < 1e-4, "{method}: {total} of {covered}");

        let picture = painting.picture(&["--env", path(&map), "--reconstruct", method]);
        let mut sum = vec![0.0f64; picture.data().len()];
        let window = Window::full(picture.width(), picture.height());
        for (n, w) in omega.rgb.iter().enumerate() {
            let lamp = relighter.weights(Light::Lamp(n + 1), &Look::default()).unwrap();
            let t = relighter.render(&lamp, &Look::default(), window).unwrap().into_rgb();
            let scale = f64::from(w[0]) / std::f64::consts::PI;
            sum.iter_mut().zip(t.data()).for_each(|(s, t)| *s += f64::from(*t) * scale);
        }
        let largest = sum.iter().copied().fold(0.0, f64::max);
        let worst = picture.data().iter().zip(&sum).map(|(a, b)| (f64::from(*a) - b).abs()).fold(0.0, f64::max);
        assert!(worst / largest < 1e-4, "{method}: off by {}", worst / largest);
    }
}

/// The bundle's element equals the command line's picture, whole and window by window, in all three contexts, while four
/// threads ask for different frames.
#[test]
fn the_bundle_and_the_command_line_agree() {
    let Some(painting) = Painting::new() else { return };
    let park = path(&painting.park()).to_owned();
    let expected: Vec<TestImage> = (0..4)
        .map(|frame| TestImage::from(&painting.picture(&["--env", &park, "--rotate", &(40 * frame).to_string()])))
        .collect();
    for context in [Context::Generator, Context::Filter, Context::General] {
        let host = Host::new(Options::default());
        let effect = host.load(&relume_tests::bundle()).unwrap();
        let instance = effect.create(context).unwrap();
        instance.set_string("asset", path(&painting.asset));
        instance.set_string("environment", &park);
        instance.animate("rotation", |time| 40.0 * time);
        if context != Context::Generator {
            let (w, h) = (expected[0].width(), expected[0].height());
            instance.clip("Source").connect(TestImage::constant(w, h, [0.25, 0.5, 0.75, 1.0]));
        }
        let frames: Vec<RenderArgs> =
            (0..8).map(|n| RenderArgs { time: f64::from(n % 4), ..RenderArgs::default() }).collect();
        for (n, rendered) in instance.render_from_threads(&frames, 4).into_iter().enumerate() {
            let off = rendered.unwrap().largest_difference(&expected[n % 4]);
            assert!(off < 1e-5, "{context:?}, frame {}: off by {off}", n % 4);
        }
        let tiles = instance.render_tiles(&RenderArgs { time: 1.0, ..RenderArgs::default() }, 100);
        let off = tiles.largest_difference(&expected[1]);
        assert!(off < 1e-5, "{context:?}, in windows: off by {off}");
    }
}
