//! `relume evaluate`: what it writes, that the page stands alone, and what it refuses.

use std::fs;
use std::path::{Path, PathBuf};

use relume_core::domain::Directions;
use relume_core::field::{Contents, Precision, write as write_field};
use relume_core::image::{EncodeOptions, Encoding, Image, read, write};
use relume_core::math::Vec3;
use relume_core::simulate::{Camera, Quality, Scene, Stage, classes, demo_lamps, grid_lamps, lights};
use serde_json::Value;

use super::cli::{files_in, refuse, run, succeed, text, tool};

pub const SIZE: (usize, usize) = (36, 27);

/// The still life under some lamps, quickly.
pub fn field(folder: &Path, name: &str, lamps: Vec<Vec3>) -> PathBuf {
    let (scene, camera) = (Scene::demo(), Camera::demo(SIZE.0, SIZE.1));
    let lamps = Directions::new(lamps).unwrap();
    let quality = Quality { samples: 4, bounces: 1, stride: 4, cone_density: 100.0, depth: 3, seed: 1 };
    let stage = Stage::new(&scene, camera, &lamps, quality);
    let contents = Contents {
        irradiance: vec![std::f32::consts::PI; lamps.len()],
        domain: lamps.clone().into(),
        width: SIZE.0,
        height: SIZE.1,
        precision: Precision::Half,
        largest: stage.largest(),
        ambient: None,
        alpha: Some(classes(&scene, &camera).alpha),
        reliability: None,
        provenance: Value::Null,
        colour_space: Default::default(),
    };
    let path = folder.join(name);
    write_field(&path, &contents, &mut stage.bands(&mut |_, _| Ok(()))).unwrap();
    path
}

fn evaluate(field: &Path, out: &Path, options: &[&str]) -> std::process::Command {
    let mut command = tool(&["evaluate", "reconstruction"]);
    command.arg(field).arg("-o").arg(out).args(options);
    command
}

#[test]
fn a_grid_is_measured_on_one_page() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let field = field(folder.path(), "a <b>.rfield", grid_lamps(16, 8));
    write(&at("sky.exr"), lights::sky((64, 32)).image(), EncodeOptions::default()).unwrap();
    let left = Image::from_fn(SIZE.0, SIZE.1, |x, _| [if x < 18 { 1.0 } else { 0.0 }; 3]);
    write(&at("left.png"), &left, EncodeOptions::default()).unwrap();
    let (mask, sky) = (format!("<i>&left={}", at("left.png").display()), at("sky.exr").display().to_string());
    let out = at("out");
    // The two largest sets of harmonics and two wavelets less: quicker, and nothing else would be shown.
    let methods = "zero-order,linear,inverse-distance,harmonics-25,5/3,b-spline";
    let options = ["--mask", &mask, "--env", &sky, "--column", "9", "--methods", methods];
    let said = succeed(&mut evaluate(&field, &out, &options));
    assert!(said.contains("32 of 128 lamps") && said.contains("8 longitudes x 4 rings"), "{said}");

    let report: Value = serde_json::from_slice(&fs::read(out.join("errors.json")).unwrap()).unwrap();
    let sets: Vec<&str> = report["sets"].as_array().unwrap().iter().map(|set| set["name"].as_str().unwrap()).collect();
    assert_eq!((sets[0], *sets.last().unwrap()), ("all", "<i>&left"));
    assert_eq!(report["sets"][sets.len() - 1]["count"], 18 * 27);
    let methods = report["methods"].as_array().unwrap();
    assert_eq!((methods.len(), report["refused"].as_array().unwrap().len()), (6, 0));
    for method in methods {
        for set in 0..sets.len() {
            let numbers = [&method["errors"][set], &method["relit"][0][set], &method["relit"][1][set]];
            let means = numbers.map(|summary| summary["mean"].as_f64().unwrap());
            assert!(means.iter().all(|mean| *mean > 0.0 && *mean < 2.0), "{}: {means:?}", method["id"]);
            // A soft sky forgives more than a sliver of light does.
            assert!(means[2] < means[1], "{}: {means:?}", method["id"]);
        }
    }
    // The table says the same.
    let table = fs::read_to_string(out.join("errors.txt")).unwrap();
    let linear = &methods[1]["errors"][0];
    let shown = |key: &str| format!("{:.1}", 100.0 * linear[key].as_f64().unwrap());
    assert!(table.contains(&format!("{} ± {}", shown("mean"), shown("deviation"))), "{table}");
    assert!(said.starts_with(&table));

    page_stands_alone(&fs::read_to_string(out.join("index.html")).unwrap());
    let svg = fs::read_to_string(out.join("errors.svg")).unwrap();
    for words in ["Multi-level B-spline", "5/3 wavelet", "&lt;i&gt;&amp;left (486 pixels)"] {
        assert!(svg.contains(words), "no {words} in the chart");
    }
    let names = files_in(&out);
    for name in [
        "over-time-5-3.png",
        "over-time-all-lamps-linear.png",
        "sliver-all-lamps.png",
        "env-1-b-spline.png",
        "set-1.png",
    ] {
        assert!(names.contains(&name.to_owned()), "no {name} among {names:?}");
    }
    let time = read(&out.join("over-time-linear.png"), Encoding::Auto).unwrap();
    assert_eq!(time.size(), (180, SIZE.1));
    assert_eq!(read(&out.join("sliver-linear.png"), Encoding::Auto).unwrap().size(), SIZE);
    assert_eq!(files_in(folder.path()), ["a <b>.rfield", "left.png", "out", "sky.exr"]);
}

/// Nothing from elsewhere, names escaped, everything shown.
fn page_stands_alone(page: &str) {
    stands_alone(page);
    assert!(page.contains("&lt;i&gt;&amp;left") && !page.contains("<i>"), "the name of the mask");
    assert!(page.contains("Column 9 of the picture"));
}

/// A page of an asset called `a <b>.rfield` and the map `sky.exr`, with charts.
pub fn stands_alone(page: &str) {
    for outside in ["http:", "https:", "<script", "<link", "@import", "url("] {
        // The namespace of an SVG is a name, not an address.
        assert!(!page.replace("http://www.w3.org/2000/svg", "").contains(outside), "{outside} in the page");
    }
    assert_eq!(page.matches("<img ").count(), page.matches("src=\"data:image/png;base64,").count());
    assert!(page.contains("a &lt;b&gt;.rfield") && !page.contains("a <b>"), "the name of the asset");
    assert!(page.contains("<svg ") && page.contains("sky.exr"));
}

#[test]
fn without_a_grid_the_methods_that_need_one_say_so() {
    let folder = tempfile::tempdir().unwrap();
    let field = field(folder.path(), "a.rfield", demo_lamps(60));
    let out = folder.path().join("out");
    let said = succeed(&mut evaluate(&field, &out, &["--keep", "20", "--methods", "b-spline,5/3,linear,linear"]));
    assert!(said.contains("20 of 60 lamps") && said.contains("well spread"), "{said}");
    let report: Value = serde_json::from_slice(&fs::read(out.join("errors.json")).unwrap()).unwrap();
    let ids: Vec<&Value> = report["methods"].as_array().unwrap().iter().map(|method| &method["id"]).collect();
    assert_eq!(ids, ["b-spline", "linear"]);
    assert_eq!(report["refused"][0]["id"], "5/3");
    let reason = report["refused"][0]["reason"].as_str().unwrap();
    assert!(reason.contains("grid") && said.contains(reason), "{reason}");
    assert!(fs::read_to_string(out.join("index.html")).unwrap().contains("Not measured"));
    refuse(
        &mut evaluate(&field, &folder.path().join("none"), &["--methods", "haar"]),
        &["none that these lamps allow", "grid"],
    );
}

#[test]
fn bad_input_is_refused_in_a_sentence_and_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let field = field(folder.path(), "a.rfield", grid_lamps(8, 2));
    write(&at("small.png"), &Image::from_fn(4, 4, |_, _| [1.0; 3]), EncodeOptions::default()).unwrap();
    write(&at("dark.png"), &Image::new(SIZE.0, SIZE.1, 3), EncodeOptions::default()).unwrap();
    fs::create_dir(at("full")).unwrap();
    fs::write(at("full/a.txt"), "a").unwrap();
    let mask = |name: &str| format!("x={}", at(name).display());
    let absent = at("absent.exr").display().to_string();
    for (options, words) in [
        (&["--keep", "16"][..], &["16 of 16", "fewer than all"][..]),
        (&["--keep", "1000"], &["1000 of 16", "fewer than all"]),
        (&["--keep", "1/8"], &["2 of 16", "at least 4"]),
        (&["--column", "36"], &["--column", "36", "0 to 35"]),
        (&["--mask", &mask("small.png")], &["the mask x", "4 x 4", "36 x 27"]),
        (&["--mask", &mask("dark.png")], &["the mask x", "no pixel"]),
        (&["--mask", &mask("absent.png")], &["absent.png"]),
        (&["--env", &absent], &["absent.exr"]),
    ] {
        refuse(&mut evaluate(&field, &at("out"), options), words);
    }
    refuse(&mut evaluate(&field, &at("full"), &[]), &["full", "not empty"]);
    refuse(&mut evaluate(&field, &field, &[]), &["a.rfield", "found a file"]);
    refuse(&mut evaluate(&at("small.png"), &at("out"), &[]), &["small.png"]);
    refuse(&mut evaluate(&field, &at("no/such/out"), &[]), &["does not exist"]);
    for wrong in [["--keep", "0"], ["--keep", "1/0"], ["--methods", "cubic"], ["--mask", "paint.png"]] {
        let output = run(&mut evaluate(&field, &at("out"), &wrong));
        assert_eq!(output.status.code(), Some(2), "{wrong:?}: {}", text(&output.stderr));
    }
    assert_eq!(files_in(folder.path()), ["a.rfield", "dark.png", "full", "small.png"]);
}
