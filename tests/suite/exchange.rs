//! Fields to and from what other tools read: `.lp` folders and OpenEXR files with a picture a lamp.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use relume_core::field::{Access, Asset};
use relume_core::image::layers::{NewFile, NewPart, write as write_layers};
use relume_core::image::{ColourSpace, EncodeOptions, Image, write};
use relume_tests::skipped;
use serde_json::Value;

use crate::cli::{Set, difference, files_in, info, refuse, succeed, text, tool};

/// Photographs are 37 x 19: two block rows and a half, and two scan-line blocks.
const SIZE: (usize, usize) = (37, 19);

const DIRECTIONS: [[f64; 3]; 5] =
    [[0.0, 0.0, 1.0], [0.6, 0.0, 0.8], [-0.6, 0.0, 0.8], [0.0, 0.6, 0.8], [0.36, 0.48, 0.8]];

/// A set with black photograph, coverage and irradiances that differ, and its field.
fn full_field() -> (Set, PathBuf) {
    let set = Set::new(&DIRECTIONS, SIZE, "tif");
    let black = Image::from_fn(SIZE.0, SIZE.1, |x, y| [0.01 + 0.002 * x as f32, 0.03, 0.001 * y as f32]);
    write(&set.path("black.tif"), &black, EncodeOptions::default()).unwrap();
    let alpha = Image::from_fn(SIZE.0, SIZE.1, |x, y| [((x * y) % 5) as f32 / 4.0; 3]);
    write(&set.path("alpha.exr"), &alpha, EncodeOptions::default()).unwrap();
    let row = |n: usize| format!("photo {n}.tif\t{}\n", [3.0, 0.0005, 12.25, 0.7, 2.0][n]);
    let table: String = (0..5).map(row).collect();
    fs::write(set.path("lamps.tsv"), format!("photograph\tirradiance\n{table}")).unwrap();
    let path = |name: &str| set.path(name).display().to_string();
    let (black, alpha, lamps) = (path("black.tif"), path("alpha.exr"), path("lamps.tsv"));
    let field = set.import(&["--black", &black, "--alpha", &alpha, "--lamps", &lamps, "--colour-space", "acescg"]);
    (set, field)
}

/// `T` of every lamp.
fn transport(field: &Path) -> Vec<Image> {
    let asset = Asset::open(field, Access::Read).unwrap();
    asset.samples().unwrap().pictures(0..asset.directions().unwrap().len()).unwrap()
}

/// The same `T` to the rounding of halves, the same lamps and layers.
fn assert_same(again: &Path, field: &Path, alpha_tolerance: f32) {
    // Another half may be the nearer one after the round trip.
    const HALF: f32 = 1.0 / 1024.0;
    for (lamp, (a, b)) in transport(again).iter().zip(&transport(field)).enumerate() {
        let largest = b.data().iter().fold(0.0f32, |m, v| m.max(v.abs()));
        for (a, b) in a.data().iter().zip(b.data()) {
            assert!((a - b).abs() <= b.abs() * HALF + largest * 1e-6, "lamp {}: {a} is not {b}", lamp + 1);
        }
    }
    let (a, b) = (Asset::open(again, Access::Read).unwrap(), Asset::open(field, Access::Read).unwrap());
    assert_eq!((a.directions().unwrap().len(), a.colour_space()), (b.directions().unwrap().len(), b.colour_space()));
    for (a, b) in a.directions().unwrap().lamps().iter().zip(b.directions().unwrap().lamps()) {
        assert!((a - b).norm() < 1e-6);
    }
    for (a, b) in a.manifest().irradiance().iter().zip(b.manifest().irradiance()) {
        assert!((a / b - 1.0).abs() < 1e-6, "irradiance {a} is not {b}");
    }
    match (a.ambient(), b.ambient()) {
        (Some(a), Some(b)) => assert!(difference(a, b) < 1e-6),
        (a, b) => assert!(a.is_none() && b.is_none()),
    }
    let alphas = a.alpha().unwrap().iter().zip(b.alpha().unwrap());
    assert!(alphas.into_iter().all(|(a, b)| (a - b).abs() <= alpha_tolerance));
}

#[test]
fn a_field_returns_from_photographs() {
    let (set, field) = full_field();
    for format in ["exr", "tif"] {
        let folder = set.out().join(format);
        let said = succeed(tool(&["export", "lp", "--format", format]).arg(&field).arg("-o").arg(&folder));
        // The tool says how to import them again.
        let line = said.lines().find_map(|line| line.strip_prefix("To import them again: relume ")).unwrap();
        let again = set.out().join(format!("{format}.rfield"));
        let words = line
            .split_whitespace()
            .map(|word| if word == "A.rfield" { again.display().to_string() } else { word.into() });
        succeed(&mut {
            let mut command = tool(&[]);
            command.args(words);
            command
        });
        assert_same(&again, &field, 0.0);
        let mut expected: Vec<String> = (1..=5).map(|n| format!("lamp000{n}.{format}")).collect();
        expected.extend([
            "alpha.exr".to_owned(),
            format!("black.{format}"),
            "lights.lamps.tsv".into(),
            "lights.lp".into(),
        ]);
        expected.sort();
        assert_eq!(files_in(&folder), expected);
    }
    assert_eq!(files_in(&set.out()), ["a.rfield", "exr", "exr.rfield", "tif", "tif.rfield"]);
}

#[test]
fn a_field_returns_from_one_file_of_many_parts() {
    let (set, field) = full_field();
    let (exr, again) = (set.out().join("a.exr"), set.out().join("again.rfield"));
    succeed(tool(&["export", "exr"]).arg(&field).arg("-o").arg(&exr));
    let whole = fs::read(&exr).unwrap();
    succeed(tool(&["export", "exr"]).arg(&field).arg("-o").arg(&exr));
    assert_eq!(whole, fs::read(&exr).unwrap(), "the same bytes every time");
    succeed(tool(&["import", "exr"]).arg(&exr).arg("-o").arg(&again));
    assert_same(&again, &field, 0.0);
    let provenance = &info(&again)["provenance"];
    assert_eq!((&provenance["source"], &provenance["photographs"][4]), (&"import exr".into(), &"lamp0005".into()));
    succeed(tool(&["export", "exr", "--half"]).arg(&field).arg("-o").arg(&exr));
    succeed(tool(&["import", "exr"]).arg(&exr).arg("-o").arg(&again));
    // Ambient and coverage are rounded too.
    let (a, b) = (transport(&again), transport(&field));
    assert!(a.iter().zip(&b).all(|(a, b)| difference(a, b) < 1.0 / 1024.0));
    assert_eq!(files_in(&set.out()), ["a.exr", "a.rfield", "again.rfield"]);
}

/// Prints what OpenEXR's own reader finds, and writes photographs as another tool would: no attributes of ours, halves, PIZ.
const OPENEXR: &str = r#"
import sys, json, numpy, OpenEXR
parts = OpenEXR.File(sys.argv[1], separate_channels=True).parts
def told(part):
    header = part.header
    return {
        "name": header["name"],
        "direction": [float(v) for v in header["relumeDirection"]] if "relumeDirection" in header else None,
        "irradiance": header.get("relumeIrradiance"),
        "channels": {name: float(channel.pixels[18, 36]) for name, channel in part.channels.items()},
    }
print(json.dumps([told(part) for part in parts]))
def picture(n):
    y, x, c = numpy.mgrid[0:19, 0:37, 0:3]
    return (0.5 + (x + 2 * y + 3 * c + 4 * n) / 128.0).astype(numpy.float16)
def channels(n, prefix=""):
    return {prefix + name: numpy.ascontiguousarray(picture(n)[:, :, c]) for c, name in enumerate("RGB")}
header = lambda: {"compression": OpenEXR.PIZ_COMPRESSION, "type": OpenEXR.scanlineimage}
parts = [OpenEXR.Part(header(), channels(n), "key%d" % n) for n in range(5)]
OpenEXR.File(parts).write(sys.argv[2])
merged = channels(7)
for n in range(5):
    merged.update(channels(n, "key%d." % n))
OpenEXR.File(header(), merged).write(sys.argv[3])
"#;

#[test]
fn openexr_itself_reads_ours_and_is_read() {
    let found = Command::new("python3").args(["-c", "import numpy, OpenEXR; OpenEXR.Part"]).output();
    if !found.is_ok_and(|output| output.status.success()) {
        return skipped("python3 with numpy and OpenEXR 3");
    }
    let (set, field) = full_field();
    let path = |name: &str| set.out().join(name);
    succeed(tool(&["export", "exr"]).arg(&field).arg("-o").arg(path("a.exr")));
    let mut python = Command::new("python3");
    python.args(["-c", OPENEXR]).args([path("a.exr"), path("parts.exr"), path("layers.exr")]);
    let told: Value = serde_json::from_str(&succeed(&mut python)).unwrap();
    let (asset, transport) = (Asset::open(&field, Access::Read).unwrap(), transport(&field));
    let irradiances = asset.manifest().irradiance();
    for lamp in 0..5 {
        assert_eq!(told[lamp]["name"], format!("lamp000{}", lamp + 1));
        assert_eq!(told[lamp]["irradiance"].as_f64().unwrap() as f32, irradiances[lamp]);
        for axis in 0..3 {
            let found = told[lamp]["direction"][axis].as_f64().unwrap();
            assert!((found - asset.directions().unwrap().lamps()[lamp][axis]).abs() < 1e-6);
        }
        for (c, name) in ["R", "G", "B"].iter().enumerate() {
            let expected = transport[lamp].pixel(36, 18)[c] * irradiances[lamp];
            assert_eq!(told[lamp]["channels"][name].as_f64().unwrap() as f32, expected);
        }
    }
    assert_eq!((&told[5]["name"], &told[6]["name"]), (&"ambient".into(), &"alpha".into()));
    assert_eq!(told[5]["direction"], Value::Null);

    // The list is in another order than the file, and names one layer less: the rest is left out.
    let lp = "4\nkey3.exr 0 0.6 0.8\nkey0.exr 0 0 1\nkey1.exr 0.6 0 0.8\nkey2.exr -0.6 0 0.8\n";
    fs::write(set.path("keys.lp"), lp).unwrap();
    for file in ["parts.exr", "layers.exr"] {
        let again = path("again.rfield");
        let mut import = tool(&["import", "exr", "--irradiance", "2", "--lp"]);
        import.arg(set.path("keys.lp")).arg(path(file)).arg("-o").arg(&again);
        let output = import.output().unwrap();
        let said = text(&output.stderr);
        assert!(output.status.success() && said.contains("left out: ") && said.contains("key4"), "{file}: {said}");
        for (picture, n) in crate::exchange::transport(&again).iter().zip([3, 0, 1, 2]) {
            let expected = Image::from_fn(SIZE.0, SIZE.1, |x, y| {
                [0, 1, 2].map(|c| (0.5 + (x + 2 * y + 3 * c + 4 * n) as f32 / 128.0) / 2.0)
            });
            assert_eq!(*picture, expected, "{file}, lamp {n}");
        }
    }
}

/// A file of five plain layers, without directions.
fn plain_layers(path: &Path, name: impl Fn(usize) -> String) {
    let part = |n| NewPart { name: name(n), grey: false, direction: None, irradiance: None };
    let parts = (0..5).map(part).collect();
    let file = NewFile { size: SIZE, colour_space: ColourSpace::default(), half: false, parts };
    write_layers(path, &file, &mut |n| Ok(crate::cli::photograph(n, SIZE))).unwrap();
}

#[test]
fn layers_without_names_are_taken_in_order_and_black_is_taken_off() {
    let set = Set::new(&DIRECTIONS, SIZE, "tif");
    let (exr, field) = (set.path("five.exr"), set.out().join("a.rfield"));
    plain_layers(&exr, |n| format!("light group {n}"));
    let black = Image::from_fn(SIZE.0, SIZE.1, |_, _| [0.05, 0.06, 0.07]);
    write(&set.path("black.exr"), &black, EncodeOptions::default()).unwrap();
    let mut import = tool(&["import", "exr", "--precision", "float", "--irradiance", "1"]);
    import
        .arg(&exr)
        .arg("-o")
        .arg(&field)
        .arg("--lp")
        .arg(set.path("dirs.lp"))
        .arg("--black")
        .arg(set.path("black.exr"));
    let output = import.output().unwrap();
    let said = text(&output.stderr);
    assert!(output.status.success() && said.contains("taken in their order"), "{said}");
    for (picture, photograph) in transport(&field).iter().zip(&set.photographs) {
        let expected =
            Image::from_fn(SIZE.0, SIZE.1, |x, y| [0, 1, 2].map(|c| photograph.pixel(x, y)[c] - [0.05, 0.06, 0.07][c]));
        assert!(difference(picture, &expected) < 1e-6);
    }
    assert!(difference(Asset::open(&field, Access::Read).unwrap().ambient().unwrap(), &black) == 0.0);
}

#[test]
fn unsuitable_exchange_files_are_refused() {
    let (set, field) = full_field();
    let (exr, out) = (set.path("five.exr"), set.out().join("b.rfield"));
    plain_layers(&exr, |n| format!("group{n}"));
    fs::write(set.path("not.exr"), "text").unwrap();
    fs::write(set.path("four.lp"), "2\ngroup1.exr 0 0 1\ngroup9.exr 0 0 1\n").unwrap();
    fs::write(set.path("twice.lp"), "2\ngroup1.exr 0 0 1\ngroup1.tif 0 0 1\n").unwrap();
    write(&set.path("small.exr"), &Image::new(3, 2, 3), EncodeOptions::default()).unwrap();
    let own = set.path("own.exr");
    succeed(tool(&["export", "exr"]).arg(&field).arg("-o").arg(&own));
    let import = |file: &Path, options: &[&str], words: &[&str]| {
        let mut command = tool(&["import", "exr"]);
        command.arg(file).arg("-o").arg(&out);
        for option in options {
            let is_file = option.contains('.');
            command.arg(if is_file { set.path(option) } else { PathBuf::from(option) });
        }
        refuse(&mut command, words);
    };
    import(&set.path("absent.exr"), &[], &["absent.exr"]);
    import(&set.path("not.exr"), &[], &["not.exr", "OpenEXR"]);
    import(&exr, &[], &["5 pictures", "group0", "none with a direction", "--lp"]);
    import(&exr, &["--lp", "four.lp"], &["no layer called `group9.exr`", "group0"]);
    import(&exr, &["--lp", "twice.lp"], &["group1 twice"]);
    import(&exr, &["--lp", "dirs.lp", "--black", "small.exr"], &["small.exr", "3 x 2", "37 x 19"]);
    import(&own, &["--black", "black.tif"], &["black.tif", "beside the layer ambient"]);
    import(&own, &["--lamps", "lamps.tsv"], &["lamps.tsv", "lamp0001"]);
    let bytes = fs::read(&own).unwrap();
    fs::write(set.path("cut.exr"), &bytes[..bytes.len() * 2 / 3]).unwrap();
    import(&set.path("cut.exr"), &[], &["cut.exr"]);

    let export = |arguments: &[&str], to: &Path, words: &[&str]| {
        refuse(tool(&["export"]).args(arguments).arg(&field).arg("-o").arg(to), words);
    };
    export(&["exr"], &set.out().join("a.tif"), &["a.tif", ".exr"]);
    export(&["exr"], &set.path("absent/a.exr"), &["does not exist"]);
    export(&["lp"], &set.out(), &["not empty"]);
    export(&["lp", "--half", "--format", "png"], &set.out().join("p"), &["--half"]);
    let compact = set.path("compact.rfield");
    succeed(tool(&["compress"]).arg(&field).arg("-o").arg(&compact).args(["--harmonic", "4"]));
    refuse(
        tool(&["export", "exr"]).arg(&compact).arg("-o").arg(set.out().join("c.exr")),
        &["harmonics", "compressed from"],
    );
    assert_eq!(files_in(&set.out()), ["a.rfield"]);
}
