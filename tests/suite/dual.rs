//! `relume dual` from outside: a virtual gantry, photographed and packed, a screen, and what has no dual picture.

use std::path::Path;
use std::process::Command;

use relume_core::field::{Access, Asset};
use relume_core::image::{EncodeOptions, Encoding, Image, read, write};

use crate::capture::{Capture, RIG, tool};
use crate::cli::{Set, difference, files_in, refuse, succeed};

/// 40 x 30 pixels; 2 positions of 4 x 4 squares, one to the left and one to the right of the camera.
fn rig(kind: &str, table: &str) -> String {
    let (head, rest) = RIG.split_once("[stage]").unwrap();
    let rest = rest.split_once("[camera]").unwrap().1;
    format!("{}{table}[camera]{rest}", head.replace("\"stage\"", &format!("\"{kind}\"")))
}

const PROJECTOR: &str = "[gantry]\nsquares = 4\ninfluence = 2\ndistance = 4\nview_deg = 34\n\
                         [gantry.positions]\nlayout = \"rings\"\nrings = [{ elevation_deg = 45, count = 2 }]\n";
const SCREEN: &str = "[monitor]\ncolumns = 8\nrows = 8\nnoise = 6\nsquares = 4\n";

fn dual(asset: &Path, output: &Path, options: &[&str]) -> Command {
    let mut command = tool("dual");
    command.arg(asset).arg("-o").arg(output).args(options);
    command
}

fn seen(asset: &Path, output: &Path, options: &[&str]) -> Image {
    succeed(&mut dual(asset, output, options));
    read(output, Encoding::Auto).unwrap().into_rgb()
}

/// For each element the sum over the pixels of its picture times `lit`.
fn sums(asset: &Path, lit: &Image) -> Vec<[f32; 3]> {
    let asset = Asset::open(asset, Access::Read).unwrap();
    let samples = asset.samples().unwrap();
    let pictures = samples.pictures(0..asset.domain().len()).unwrap();
    let sum = |picture: &Image| {
        let mut sum = [0.0f64; 3];
        for (t, c) in picture.data().chunks(3).zip(lit.data().chunks(3)) {
            (0..3).for_each(|k| sum[k] += f64::from(t[k]) * f64::from(c[k]));
        }
        sum.map(|v| v as f32)
    };
    pictures.iter().map(sum).collect()
}

#[test]
fn a_gantry_is_seen_from_its_projector() {
    let set = Capture::with(&rig("gantry", PROJECTOR));
    succeed(&mut set.begin("s", &[]));
    let asset = set.path("a.rfield");
    succeed(tool("pack").arg(set.path("s")).arg("-o").arg(&asset));
    let out = set.path("out");
    std::fs::create_dir(&out).unwrap();

    // Raw: the sums of rows, or of rows times the picture.
    let white = Image::from_fn(40, 30, |_, _| [1.0; 3]);
    let street = Image::from_fn(40, 30, |x, y| [x as f32 / 40.0, y as f32 / 30.0, if x > 20 { 2.0 } else { 0.0 }]);
    write(&set.path("street.exr"), &street, EncodeOptions::default()).unwrap();
    let street_file = set.path("street.exr").display().to_string();
    for (lit, name) in [(&white, "white"), (&street, &*street_file)] {
        let expected = sums(&asset, lit);
        for position in [1, 2] {
            let expected = Image::from_fn(4, 4, |x, y| expected[(position - 1) * 16 + y * 4 + x]);
            let number = position.to_string();
            let found = seen(&asset, &out.join("one.exr"), &["--lit", name, "--position", &number]);
            assert!(difference(&found, &expected) < 1e-5);
            let read = ["--lit", name, "--position", &number, "--access", "read"];
            assert_eq!(seen(&asset, &out.join("one.exr"), &read), found);
        }
    }
    // All positions; squares enlarged; radiance, which has brighter corners; a factored field.
    let first = seen(&asset, &out.join("one.exr"), &["--lit", "white", "--position", "1"]);
    std::fs::remove_file(out.join("one.exr")).unwrap();
    let said =
        succeed(&mut dual(&asset, &out.join("seen.##.exr"), &["--lit", "white", "--position", "all", "--scale", "3"]));
    assert!(said.contains("position 2 of 2") && said.contains("4 x 4 squares"), "{said}");
    assert_eq!(files_in(&out), ["seen.01.exr", "seen.02.exr"]);
    let larger = read(&out.join("seen.01.exr"), Encoding::Auto).unwrap();
    assert!((0..12).all(|y| (0..12).all(|x| larger.pixel(x, y) == first.pixel(x / 3, y / 3))));
    let radiance = seen(&asset, &out.join("r.exr"), &["--lit", "white", "--position", "1", "--radiance"]);
    let gain = |x: usize, y: usize| radiance.pixel(x, y)[1] / first.pixel(x, y)[1];
    assert!(gain(1, 2) == 1.0 && gain(1, 3) > 1.03 && gain(1, 3) < 1.1, "{} {}", gain(1, 2), gain(1, 3));
    let said = succeed(&mut dual(&asset, &out.join("look.png"), &["--lit", "white", "--position", "1"]));
    assert!(said.contains("--exposure"), "{said}");
    // What else is done to assets works, or says why it does not.
    let sheet = out.join("sheet.png");
    let said = succeed(tool("inspect").arg(&asset).args(["--pixel", "20,15", "--pixel", "3,4", "-o"]).arg(&sheet));
    assert!(said.contains("2 pixels") && said.contains("squares"), "{said}");
    assert!(read(&sheet, Encoding::Auto).unwrap().width() > 2 * 128);
    for (command, options) in [
        ("inspect", &["--pixel", "1,1", "--reconstruct", "linear", "-o", "x.png"][..]),
        ("compress", &["--wavelet", "9/7", "-o", "x.rfield"]),
        ("compress", &["--harmonic", "25", "-o", "x.rfield"]),
    ] {
        refuse(tool(command).arg(&asset).args(options).current_dir(&out), &[]);
    }
    for (group, command, options) in [
        ("export", "exr", &["-o", "x.exr"][..]),
        ("export", "lp", &["-o", "x"]),
        ("evaluate", "reconstruction", &["-o", "x"]),
        ("evaluate", "compression", &["-o", "x"]),
    ] {
        refuse(tool(group).arg(command).arg(&asset).args(options).current_dir(&out), &["projector", "relume dual"]);
    }
    refuse(tool("merge").arg(&asset).args(["-o", "x.rfield"]).current_dir(&out), &["whole"]);
    let tiles = set.path("tiles.rfield");
    succeed(tool("compress").arg(&asset).arg("-o").arg(&tiles).args(["--factored", "--error", "0.01"]));
    let of_tiles =
        seen(&tiles, &out.join("t.exr"), &["--lit", "white", "--position", "1", "--representation", "factored"]);
    assert!(difference(&of_tiles, &first) < 0.02);
}

#[test]
fn what_cannot_be_turned_round_is_refused_with_the_reason() {
    let set = Capture::with(&rig("gantry", PROJECTOR));
    succeed(&mut set.begin("s", &[]));
    let (asset, out) = (set.path("a.rfield"), set.path("out.exr"));
    succeed(tool("pack").arg(set.path("s")).arg("-o").arg(&asset));
    write(&set.path("small.png"), &Image::new(30, 40, 3), EncodeOptions::default()).unwrap();
    let small = set.path("small.png").display().to_string();
    for (options, words) in [
        (&["--lit", "white"][..], &["2 positions", "--position 1 to 2"][..]),
        (&["--lit", "white", "--position", "3"], &["no position 3", "1 to 2"]),
        (&["--lit", &small, "--position", "1"], &["small.png", "30 x 40", "40 x 30"]),
        (&["--lit", "absent.exr", "--position", "1"], &["absent.exr"]),
        (
            &["--lit", "white", "--position", "1", "--representation", "wavelet"],
            &["no `wavelet` representation", "dense"],
        ),
        (&["--lit", "white", "--position", "all"], &["####"]),
    ] {
        refuse(&mut dual(&asset, &out, options), words);
    }
    // Lamps, with advice; black photograph or not.
    let lamps = Set::small();
    let stage = lamps.import(&[]);
    refuse(&mut dual(&stage, &out, &["--lit", "white"]), &["lamps at infinity", "gantry"]);
    assert!(!out.exists());
}

#[test]
fn a_screen_gets_the_light_that_arrives_at_its_texels() {
    let set = Capture::with(&rig("monitor", SCREEN));
    succeed(&mut set.begin("s", &["--sampler", "scan"]));
    let asset = set.path("a.rfield");
    succeed(tool("pack").arg(set.path("s")).arg("-o").arg(&asset));
    let out = set.path("out.exr");
    let found = seen(&asset, &out, &["--lit", "white"]);
    let expected = sums(&asset, &Image::from_fn(40, 30, |_, _| [1.0; 3]));
    assert!(difference(&found, &Image::from_fn(4, 4, |x, y| expected[y * 4 + x])) < 1e-5);
    refuse(&mut dual(&asset, &out, &["--lit", "white", "--radiance"]), &["no point to look from"]);
    refuse(&mut dual(&asset, &out, &["--lit", "white", "--position", "2"]), &["no position 2"]);
}
