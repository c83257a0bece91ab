//! `relume hdr`: simulated brackets, real photographs where they are there, and bad input.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use relume_core::hdr::Response;
use relume_core::image::{EncodeOptions, Encoding, Image, read, srgb, write};
use relume_tests::{relume, shared_data, skipped};
use serde_json::Value;

use crate::cli::{files_in, refuse, succeed, tool};

/// Photographs of one scene at exposures two stops apart, 8-bit sRGB codes without noise, and the light of the scene.
struct Bracket {
    folder: tempfile::TempDir,
    truth: Image,
    photographs: Vec<PathBuf>,
}

const EXPOSURES: [f32; 5] = [0.0625, 0.25, 1.0, 4.0, 16.0];
const TIMES: &str = "1/16,1/4,1,4,16";

/// Light from 0.003 to 12, with texture that no shift maps onto itself, and fine enough to be aligned by.
fn light(x: i32, y: i32) -> [f32; 3] {
    let (x, y) = (x as f32, y as f32);
    let wave = (0.11 * x + 0.05 * y).sin() + (0.043 * x - 0.09 * y + 1.0).cos() + (0.013 * x * (1.0 + 0.01 * y)).sin();
    let wave = wave + 0.7 * (0.5 * x).sin() * (0.37 * y).cos();
    [1.0, 0.9, 1.2].map(|tint| 0.18 * tint * (1.1 * wave).exp())
}

impl Bracket {
    /// Photograph n shows the scene moved by `offsets[n]`.
    fn new(offsets: [[i32; 2]; 5]) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let (w, h) = (240, 180);
        let truth = Image::from_fn(w, h, |x, y| light(x as i32, y as i32));
        let mut photographs = Vec::new();
        for (n, ([dx, dy], s)) in offsets.into_iter().zip(EXPOSURES).enumerate() {
            let path = folder.path().join(format!("photo {n}.png"));
            let seen = Image::from_fn(w, h, |x, y| light(x as i32 - dx, y as i32 - dy).map(|v| v * s));
            write(&path, &seen, EncodeOptions { png8: true, ..Default::default() }).unwrap();
            photographs.push(path);
        }
        Self { folder, truth, photographs }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn command(&self, output: &str, options: &[&str]) -> Command {
        let mut command = Command::new(relume());
        command.arg("hdr").args(&self.photographs).arg("-o").arg(self.path(output)).args(options);
        command
    }

    fn merge(&self, output: &str, options: &[&str]) -> Image {
        succeed(&mut self.command(output, options));
        read(&self.path(output), Encoding::Auto).unwrap()
    }

    /// Median of |stops| between a picture and the truth times `scale`.
    fn error_ev(&self, picture: &Image, scale: f32) -> f32 {
        let mut ev: Vec<f32> =
            picture.data().iter().zip(self.truth.data()).map(|(a, b)| (a / (b * scale)).log2().abs()).collect();
        ev.sort_by(f32::total_cmp);
        ev[ev.len() / 2]
    }
}

fn json(path: &Path) -> Value {
    serde_json::from_str(&fs::read_to_string(path).unwrap()).unwrap()
}

/// A camera that writes 16 bits: a dark level, then a curve with a toe and a shoulder.
fn deep_code(x: f64) -> f32 {
    let root = |x: f64| (x + 0.003).powf(1.0 / 2.2);
    let t = (root((x + 0.0156).min(1.0)) - root(0.0)) / (root(1.0) - root(0.0));
    let s = |t: f64| 1.0 / (1.0 + (-3.0 * (t - 0.45)).exp());
    ((s(t) - s(0.0)) / (s(1.0) - s(0.0))) as f32
}

#[test]
fn a_deep_response_is_recovered_above_its_dark_level() {
    let folder = tempfile::tempdir().unwrap();
    let (w, h) = (240, 180);
    // Files hold codes: `write` puts light through the sRGB curve, so its inverse goes before.
    let save = |name: &str, s: f64| {
        let codes =
            Image::from_fn(w, h, |x, y| light(x as i32, y as i32).map(|v| srgb::decode(deep_code(f64::from(v) * s))));
        let path = folder.path().join(name);
        write(&path, &codes, EncodeOptions::default()).unwrap();
        path
    };
    // 2/3 and 1 stop apart in turn.
    let exposures: Vec<f64> =
        (0..9).map(|k| 2f64.powf(-4.0 + f64::from(k / 2) * 5.0 / 3.0 + f64::from(k % 2))).collect();
    let photographs: Vec<PathBuf> = (0..9).map(|k| save(&format!("{k}.png"), exposures[k])).collect();
    let cap = save("cap.png", 0.0);
    let times = exposures.iter().map(f64::to_string).collect::<Vec<_>>().join(",");
    // 90 % of the samples are this near to the light of the scene, but for one scale.
    let spread = |options: &[&str]| {
        let out = folder.path().join("out.exr");
        let mut command = Command::new(relume());
        command.arg("hdr").args(&photographs).arg("-o").arg(&out).args(["--times", &times]).args(options);
        let said = succeed(&mut command);
        let found = read(&out, Encoding::Auto).unwrap();
        let truth = Image::from_fn(w, h, |x, y| light(x as i32, y as i32));
        let mut ratios: Vec<f32> = found.data().iter().zip(truth.data()).map(|(a, b)| a / b).collect();
        ratios.sort_by(f32::total_cmp);
        let at = |share: f64| ratios[(ratios.len() as f64 * share) as usize];
        (0.5 * (at(0.95) - at(0.05)) / at(0.5), said)
    };
    let camera = folder.path().join("camera.txt");
    let camera = camera.to_str().unwrap();
    let black = ["--black", cap.to_str().unwrap()];
    let (error, said) = spread(&[&black[..], &["--recover-response", "--save-response", camera]].concat());
    assert!(error < 0.005 && said.contains("dark level subtracted"), "{error}: {said}");
    let (again, _) = spread(&[&black[..], &["--response", camera]].concat());
    assert!((again - error).abs() < 1e-4, "{again} is not {error}");
    let (without, _) = spread(&["--response", camera]);
    assert!(without > 2.0 * error.max(0.01), "{without}: the dark level matters");
}

#[test]
fn a_bracket_gives_its_light_back() {
    let bracket = Bracket::new([[0; 2]; 5]);
    let report = bracket.path("report.json");
    let plain = bracket.merge("a.exr", &["--times", TIMES, "--encoding", "srgb", "--report", report.to_str().unwrap()]);
    let error = bracket.error_ev(&plain, 1.0);
    assert!(error < 0.02, "{error} EV");
    let said = json(&report);
    assert_eq!(said["photographs"].as_array().unwrap().len(), 5);
    assert_eq!((said["exposures"].as_str(), said["curve"].as_str()), (Some("list"), Some("srgb")));
    assert_eq!(said["clipped_everywhere"]["any"], 0.0);

    // Scaled to the middle exposure, which is 1 here, and to the first.
    assert_eq!(bracket.merge("b.exr", &["--times", TIMES, "--encoding", "srgb", "--reference", "middle"]), plain);
    let first = bracket.merge("c.exr", &["--times", TIMES, "--encoding", "srgb", "--reference", "1"]);
    assert!((first.pixel(7, 9)[1] / plain.pixel(7, 9)[1] * 16.0 - 1.0).abs() < 1e-5);

    // Recovered, saved, and read back: the same picture up to the digits of the file.
    let (camera, names) = (bracket.path("camera.txt"), bracket.path("times.txt"));
    let camera = camera.to_str().unwrap();
    let mut lines: Vec<String> = TIMES.split(',').enumerate().map(|(n, t)| format!("photo {n}.png {t}")).collect();
    lines.reverse();
    fs::write(&names, lines.join("\n")).unwrap();
    let names = names.to_str().unwrap();
    let recovered = bracket.merge("d.exr", &["--times", names, "--recover-response", "--save-response", camera]);
    let error = bracket.error_ev(&recovered, 1.0);
    assert!(error < 0.02, "recovered: {error} EV");
    let again = bracket.merge("e.exr", &["--times", TIMES, "--response", camera]);
    let worst = recovered.data().iter().zip(again.data()).map(|(a, b)| (a / b - 1.0).abs()).fold(0.0, f32::max);
    assert!(worst < 1e-5, "{worst}");
    let curve = Response::read(Path::new(camera)).unwrap();
    let off = |z: usize| (curve.channel(0)[z] as f32 / srgb::decode(z as f32 / 255.0)).log2().abs();
    assert!((20..250).map(off).fold(0.0, f32::max) < 0.05);
}

#[test]
fn a_handheld_bracket_is_aligned() {
    let offsets = [[0, 0], [3, -2], [-1, 4], [6, 5], [-5, 1]];
    let bracket = Bracket::new(offsets);
    let report = bracket.path("report.json");
    let options = ["--times", TIMES, "--encoding", "srgb", "--align", "--reference", "3", "--report"];
    let picture = bracket.merge("a.exr", &[&options[..], &[report.to_str().unwrap()]].concat());
    for (n, photograph) in json(&report)["photographs"].as_array().unwrap().iter().enumerate() {
        let found = [0, 1].map(|i| photograph["offset"][i].as_i64().unwrap() as i32);
        assert_eq!(found, [offsets[n][0] + 1, offsets[n][1] - 4], "photograph {n}");
    }
    // Inside the common area it is the scene as photograph 3 shows it.
    for (x, y) in [(30, 30), (200, 150), (120, 90)] {
        let expected = light(x + 1, y - 4)[1];
        let found = picture.pixel(x as usize, y as usize)[1];
        assert!((found / expected).log2().abs() < 0.05, "({x}, {y}): {found}, not {expected}");
    }
}

/// 12 JPEGs of a window, a stop apart, times in EXIF.
#[test]
fn real_photographs_merge_and_agree() {
    let Some(data) = shared_data() else {
        skipped("../shared/data");
        return;
    };
    let window = data.join("window-bracket");
    let mut photographs: Vec<PathBuf> = fs::read_dir(window).unwrap().map(|e| e.unwrap().path()).collect();
    photographs.retain(|path| path.extension().is_some_and(|e| e == "jpg"));
    photographs.sort();
    let folder = tempfile::tempdir().unwrap();
    let out = |name: &str| folder.path().join(name);
    let text = succeed(
        tool(&["hdr", "--recover-response", "--reference", "middle"])
            .args(&photographs)
            .args(["-o".into(), out("w.exr")])
            .args(["--save-response".into(), out("camera.txt")])
            .args(["--report".into(), out("w.json")]),
    );
    assert!(text.contains("EXIF") && text.contains("clipped everywhere"), "{text}");
    let response = Response::read(&out("camera.txt")).unwrap();
    for c in 0..3 {
        assert!(response.channel(c).windows(2).all(|w| w[1] > w[0]), "channel {c} does not rise");
    }
    let said = json(&out("w.json"));
    assert!(said["clipped_everywhere"]["any"].as_f64().unwrap() < 0.001);
    assert!(said["noise_median"].as_f64().unwrap() < 0.02);
    for photograph in said["photographs"].as_array().unwrap() {
        let off = photograph["deviation_ev"].as_f64().unwrap();
        assert!(off.abs() < 0.15, "{photograph}");
    }
    // The middle photograph, where it is well exposed, through the response is the picture.
    let picture = read(&out("w.exr"), Encoding::Auto).unwrap();
    let middle = read(&photographs[6], Encoding::Linear).unwrap();
    let mut ev: Vec<f32> = Vec::new();
    for (code, value) in middle.data().iter().zip(picture.data()).skip(1).step_by(101 * 3) {
        let code = (code * 255.0).round() as usize;
        if (60..200).contains(&code) {
            ev.push((value / response.channel(1)[code] as f32).log2().abs());
        }
    }
    ev.sort_by(f32::total_cmp);
    assert!(ev.len() > 500 && ev[ev.len() / 2] < 0.1, "{} pixels, {} EV", ev.len(), ev[ev.len() / 2]);
    let (low, high) = picture.data().iter().fold((f32::MAX, 0f32), |(l, h), v| (l.min(*v), h.max(*v)));
    assert!(low > 0.0 && (high / low).log2() > 11.0, "{low} to {high}");
}

#[test]
fn bad_brackets_get_a_sentence_and_leave_nothing() {
    let bracket = Bracket::new([[0; 2]; 5]);
    let out = bracket.path("out");
    fs::create_dir(&out).unwrap();
    let check = |images: &[&str], options: &[&str], words: &[&str]| {
        let images = images.iter().map(|name| bracket.path(name));
        refuse(tool(&["hdr"]).args(images).arg("-o").arg(out.join("a.exr")).args(options), words);
    };
    let (a, b) = ("photo 0.png", "photo 1.png");
    fs::write(bracket.path("a.dng"), b"II*\0").unwrap();
    fs::write(bracket.path("notes.txt"), "no picture").unwrap();
    fs::write(bracket.path("bad.txt"), "0 1 1 1\n2 2 2 2\n").unwrap();
    write(&bracket.path("small.png"), &Image::new(5, 5, 3), EncodeOptions { png8: true, ..Default::default() })
        .unwrap();
    write(&bracket.path("float.exr"), &Image::new(240, 180, 3), EncodeOptions::default()).unwrap();
    let bad_response = bracket.path("bad.txt");

    check(&[a, b], &[], &["photo 0.png", "no exposure time", "--times"]);
    check(&[a], &["--times", "1"], &["photo 0.png is one photograph", "at least two"]);
    check(&[a, b], &["--times", "1,1", "--recover-response"], &["all equal", "response file"]);
    check(&[a, b], &["--times", "1"], &["1 times for 2 photographs"]);
    for time in ["0", "-2", "NaN", "inf"] {
        check(&[a, b], &["--times", &format!("1,{time}")], &[&format!("`{time}` is not a positive time")]);
    }
    check(&[a, "small.png"], &["--times", "1,2"], &["small.png: found 5 x 5", "240 x 180", a]);
    check(&[a, "float.exr"], &["--times", "1,2", "--encoding", "srgb"], &["float.exr: found float samples", a]);
    check(&[a, "notes.txt"], &["--times", "1,2"], &["notes.txt", "OpenEXR, Radiance HDR, PNG, TIFF or JPEG"]);
    check(&[a, "absent.png"], &["--times", "1,2"], &["absent.png"]);
    check(&["a.dng", a], &["--times", "1,2"], &["a.dng", "raw"]);
    check(
        &["float.exr", "float.exr"],
        &["--times", "1,2", "--recover-response"],
        &["float.exr", "integer codes", "--encoding"],
    );
    check(&[a, b], &["--times", "1,4", "--response", bad_response.to_str().unwrap()], &["bad.txt, line 2"]);
    check(&[a, b], &["--times", "1,4", "--reference", "3"], &["there are 2 photographs"]);
    // The same photograph under two times.
    check(&[a, a], &["--times", "1,2", "--recover-response"], &["stray by", "right exposure times"]);
    assert_eq!(files_in(&out), Vec::<String>::new());
}
