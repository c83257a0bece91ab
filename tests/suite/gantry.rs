//! A projector's session from capture to pictures under light that varies in space.

use std::fs;
use std::process::Command;

use relume_core::field::{Access, Asset, Kind};
use relume_core::image::{EncodeOptions, Encoding, Image, read, write};

use crate::capture::{Capture, RIG, refuse, tool};
use crate::cli::{difference, succeed};

/// 40 x 30 pixels; 8 positions of 8 x 8 squares.
const PROJECTOR: &str = "[gantry]\nsquares = 8\ninfluence = 3\ndistance = 4\nview_deg = 34\nlean_deg = 16\n\
                         [gantry.positions]\nlayout = \"arc\"\nlatitudes = 2\nlongitudes = 4\n";

fn rig() -> String {
    let (head, rest) = RIG.split_once("[stage]").unwrap();
    let rest = rest.split_once("[camera]").unwrap().1;
    // White of 12800 at a distance of 4 is as bright as the stage's lamps.
    let rest = rest.replace("irradiance = 800.0", "irradiance = 12800.0");
    format!("{}{PROJECTOR}[camera]{rest}", head.replace("\"stage\"", "\"gantry\""))
}

fn pack(set: &Capture, session: &str, asset: &str, options: &[&str]) -> Command {
    let mut command = tool("pack");
    command.arg(set.path(session)).arg("-o").arg(set.path(asset)).args(options);
    command
}

fn relight(set: &Capture, asset: &str, options: &[&str]) -> Command {
    let mut command = tool("relight");
    command.arg(set.path(asset)).arg("-o").arg(set.path("out.exr")).args(options);
    command
}

fn picture(set: &Capture, asset: &str, options: &[&str]) -> Image {
    succeed(&mut relight(set, asset, options));
    read(&set.path("out.exr"), Encoding::Auto).unwrap().into_rgb()
}

/// A spot where the projector stood, another between, a slide, blinds before a sun, and a map.
const LIGHTS: &str = "[[light]]\nkind = \"spot\"\nname = \"key\"\nposition = [2.2, 2.2, 2.2]\naim = [0, -0.2, 0]\nbeam = 20\nedge = 5\n\
                      [[light]]\nkind = \"slide\"\nposition = [-2.4, 3, 1.5]\nview = 30\nimage = \"slide.exr\"\nstops = -1\n\
                      [[light]]\nkind = \"sun\"\nazimuth = -20\nelevation = 50\nstops = -2\n\
                      [light.blinds]\nposition = [-0.5, 2.3, 1.8]\nwidth = 3\nheight = 3\nspacing = 0.6\nopen = 0.5\n";

#[test]
fn light_that_varies_in_space_lights_a_captured_scene() {
    let set = Capture::with(&rig());
    write(&set.path("slide.exr"), &Image::from_fn(8, 8, |x, _| [x as f32 / 8.0, 0.5, 0.2]), EncodeOptions::default())
        .unwrap();
    fs::write(set.path("lights.toml"), LIGHTS).unwrap();
    let lights = set.path("lights.toml").display().to_string();
    succeed(&mut set.begin("scan", &[]));
    let said = succeed(&mut set.begin("sets", &["--sampler", "separable", "--plan"]));
    // 2 d n + 1 a position.
    assert!(said.contains("384  samples") && said.contains("8  black photographs"), "{said}");
    succeed(&mut set.begin("sets", &["--sampler", "separable"]));
    succeed(&mut pack(&set, "scan", "scan.rfield", &[]));
    succeed(&mut pack(&set, "scan", "terms.rfield", &["--error", "0.01"]));
    let said = succeed(&mut pack(&set, "sets", "sets.rfield", &[]));
    assert!(said.contains("8 positions, 8 x 8 squares"), "{said}");
    succeed(tool("compress").arg(set.path("scan.rfield")).arg("-o").arg(set.path("tiles.rfield")).args([
        "--factored",
        "--error",
        "0.01",
    ]));
    let held = |asset: &str| Asset::open(&set.path(asset), Access::Read).unwrap().manifest().representations[0].kind();
    assert_eq!(["scan.rfield", "terms.rfield", "tiles.rfield"].map(held), [Kind::Dense, Kind::Wavelet, Kind::Factored]);

    let truth = picture(&set, "scan.rfield", &["--light4d", &lights]);
    let brightest = truth.data().iter().fold(0.0f32, |most, v| most.max(*v));
    assert!(brightest > 0.1, "{brightest}");
    // Noise of 512 photographs is left out of terms; sets of squares have their own.
    for (asset, most) in [("terms.rfield", 0.05), ("tiles.rfield", 0.03), ("sets.rfield", 0.08)] {
        let off = difference(&picture(&set, asset, &["--light4d", &lights]), &truth);
        assert!(off < most, "{asset}: {off}");
    }
    // Flat light is another picture; presets are found by name; far light and maps do too.
    assert!(difference(&picture(&set, "scan.rfield", &["--light4d", &lights, "--flat"]), &truth) > 0.1);
    let turned = picture(&set, "scan.rfield", &["--light4d", "desk-spot", "--rotate", "90"]);
    assert!(difference(&picture(&set, "scan.rfield", &["--light4d", "desk-spot"]), &turned) > 0.1);
    let lamp = picture(&set, "scan.rfield", &["--lighting", "key"]);
    assert!(difference(&picture(&set, "terms.rfield", &["--lighting", "key"]), &lamp) < 0.05);
    succeed(&mut relight(&set, "sets.rfield", &["--layer", "reliability"]));
    let reliability = read(&set.path("out.exr"), Encoding::Auto).unwrap();
    assert!(reliability.data().iter().all(|v| (0.0..=1.0).contains(v)));
    // An animation of a light field.
    fs::write(set.path("s.toml"), "[[light]]\nlight4d = \"two-lamps\"\nrotation = [[1, 0], [3, 40]]\n").unwrap();
    succeed(
        tool("animate")
            .arg(set.path("terms.rfield"))
            .arg(set.path("s.toml"))
            .args(["--frames", "1-3"])
            .arg("-o")
            .arg(set.path("f.#.exr")),
    );
    assert!((1..=3).all(|n| set.path(&format!("f.{n}.exr")).is_file()));
}

#[test]
fn mistakes_with_projectors_are_told() {
    let set = Capture::with(&rig());
    succeed(&mut set.begin("s", &["--sampler", "separable"]));
    succeed(&mut pack(&set, "s", "a.rfield", &[]));
    for (options, words) in [
        (&["--store", "samples", "--error", "0.1"][..], &["--error", "--store terms"][..]),
        (&["--store", "terms", "--precision", "float"], &["16-bit"]),
        (&["--store", "terms", "--error", "0"], &["0.0001 to 0.5"]),
        (&["--terms", "8"], &["--terms", "screen"]),
        (&["--partial"], &["--partial", "stages"]),
        (&["--white-patch", "38,10,8,4"], &["position 1", "40 x 30"]),
    ] {
        refuse(&mut pack(&set, "s", "b.rfield", options), words);
    }
    // The table is nearly white, and the projector is.
    let said = succeed(&mut pack(&set, "s", "w.rfield", &["--white-patch", "16,26,6,2", "--intensity", "12800"]));
    assert!(said.contains("white      red"), "{said}");
    let light = |name: &str, text: &str| {
        fs::write(set.path(name), text).unwrap();
        set.path(name).display().to_string()
    };
    let behind =
        light("behind.toml", "[[light]]\nkind = \"spot\"\nname = \"kicker\"\nposition = [0, -5, -2]\nbeam = 30\n");
    refuse(&mut relight(&set, "a.rfield", &["--light4d", &behind]), &["kicker", "never stood", "--outside nearest"]);
    succeed(&mut relight(&set, "a.rfield", &["--light4d", &behind, "--outside", "nearest"]));
    let hole = light(
        "hole.toml",
        "[[light]]\nkind = \"probes\"\norigin = [-1, 1, -1]\nacross = [1, 0, 0]\ndown = [0, 0, 1]\ncolumns = 2\nrows = 2\npattern = \"p{column}{row}.exr\"\n",
    );
    let map = Image::from_fn(8, 4, |_, _| [1.0; 3]);
    for name in ["p00.exr", "p10.exr", "p01.exr"] {
        write(&set.path(name), &map, EncodeOptions::default()).unwrap();
    }
    refuse(&mut relight(&set, "a.rfield", &["--light4d", &hole]), &["column 1", "row 1", "p11.exr"]);
    write(&set.path("p11.exr"), &map, EncodeOptions::default()).unwrap();
    succeed(&mut relight(&set, "a.rfield", &["--light4d", &hole]));
    refuse(
        &mut relight(&set, "a.rfield", &["--lighting", "key", "--reconstruct", "harmonics-25"]),
        &["harmonics-25", "linear"],
    );
    refuse(&mut relight(&set, "a.rfield", &["--lighting", "key", "--exclude", "2"]), &["projector"]);
    refuse(&mut relight(&set, "a.rfield", &["--lamp", "513"]), &["square 513", "1 to 512"]);
    refuse(&mut relight(&set, "a.rfield", &["--plane", "p00.exr"]), &["screen"]);
    refuse(&mut relight(&set, "a.rfield", &["--light4d", "three-beam"]), &["`three-beams`"]);
    // Near light on lamps that are far away.
    let stage = Capture::new();
    succeed(&mut stage.begin("s", &[]));
    succeed(&mut pack(&stage, "s", "a.rfield", &[]));
    refuse(&mut relight(&stage, "a.rfield", &["--light4d", "desk-spot"]), &["--flat"]);
    succeed(&mut relight(&stage, "a.rfield", &["--light4d", "desk-spot", "--flat"]));
    refuse(&mut pack(&stage, "s", "b.rfield", &["--error", "0.1"]), &["--error", "projector"]);
    // Influence that cannot be, and a position whose black photograph is gone.
    for (influence, words) in [("0", "influence"), ("9", "1 to 8")] {
        let text = rig().replace("influence = 3", &format!("influence = {influence}"));
        fs::write(set.path("bad.toml"), text).unwrap();
        refuse(tool("capture").arg(set.path("bad.toml")).arg("--session").arg(set.path("x")), &[words]);
    }
    let journal = fs::read_to_string(set.path("s/journal.jsonl")).unwrap();
    let moved = |line: &str| match line.contains("\"black\"") {
        true => line.replace("\"stop\":5", "\"stop\":0"),
        false => line.to_owned(),
    };
    let lines: Vec<String> = journal.lines().map(moved).collect();
    assert_eq!(lines.iter().zip(journal.lines()).filter(|(a, b)| a != b).count(), 1);
    fs::write(set.path("s/journal.jsonl"), lines.join("\n") + "\n").unwrap();
    refuse(&mut pack(&set, "s", "b.rfield", &[]), &["position 6", "no black photograph", "--resume"]);
}
