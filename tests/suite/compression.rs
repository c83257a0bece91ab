//! `relume evaluate compression`: what it writes, that the numbers agree with each other, and what it refuses.

use std::fs;
use std::path::Path;

use relume_core::image::{EncodeOptions, Encoding, read, write};
use relume_core::simulate::{demo_lamps, grid_lamps, lights};
use serde_json::Value;

use super::cli::{files_in, refuse, run, succeed, text, tool};
use super::evaluate::{SIZE, field, stands_alone};

fn evaluate(field: &Path, out: &Path, options: &[&str]) -> std::process::Command {
    let mut command = tool(&["evaluate", "compression"]);
    command.arg(field).arg("-o").arg(out).args(options);
    command
}

#[test]
fn wavelets_and_representations_are_measured_on_one_page() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let field = field(folder.path(), "a <b>.rfield", grid_lamps(32, 10));
    write(&at("sky.exr"), lights::sky((64, 32)).image(), EncodeOptions::default()).unwrap();
    let (out, sky) = (at("out"), at("sky.exr").display().to_string());
    let options = ["--grid", "64x16", "--pixels", "20", "--column", "9", "--env", &sky];
    let said = succeed(&mut evaluate(&field, &out, &options));
    assert!(said.contains("20 of ") && said.contains("320 lamps, b-spline to 64 x 16"), "{said}");
    assert!(said.starts_with(&fs::read_to_string(out.join("compression.txt")).unwrap()));

    let report: Value = serde_json::from_slice(&fs::read(out.join("compression.json")).unwrap()).unwrap();
    let wavelets = report["wavelets"].as_array().unwrap();
    let ids: Vec<&str> = wavelets.iter().map(|wavelet| wavelet["id"].as_str().unwrap()).collect();
    assert_eq!(ids, ["haar", "5/3", "9/7"]);
    let mean = |value: &Value| value["mean"].as_f64().unwrap();
    for wavelet in wavelets {
        let counts = wavelet["by_count"].as_array().unwrap();
        // 16 to half of 1024, and errors that fall.
        assert_eq!((counts.len(), counts[5]["count"].as_u64()), (6, Some(512)));
        assert!(counts.windows(2).all(|pair| mean(&pair[0]["l2"]) > mean(&pair[1]["l2"])), "{wavelet}");
        for by in wavelet["by_error"].as_array().unwrap() {
            let (error, terms) = (by["error"].as_f64().unwrap(), mean(&by["terms"]));
            assert!(mean(&by["l2"]) <= error && terms < 1024.0, "{by}");
            assert!((by["ratio"].as_f64().unwrap() * terms / 1024.0 - 1.0).abs() < 1e-9, "{by}");
        }
    }
    let at_256 = |n: usize| mean(&wavelets[n]["by_count"][4]["h1"]);
    assert!(at_256(0) > at_256(1) && at_256(0) > at_256(2), "Haar is the worst");

    let rows = report["representations"]["rows"].as_array().unwrap();
    assert_eq!(rows[0]["kind"], "dense");
    for row in &rows[1..] {
        let relit: Vec<f64> = row["relit"].as_array().unwrap().iter().map(|error| error.as_f64().unwrap()).collect();
        assert_eq!(relit.len(), 2, "{row}");
        // A sky forgives more than a sliver of light.
        assert!(relit[1] > 0.0 && relit[1] < relit[0] && relit[0] < 1.0, "{row}");
        let number = |key: &str| row[key].as_f64().unwrap();
        assert!(number("reached") > 0.0 && number("relight_s") > 0.0 && number("bytes") > 0.0, "{row}");
    }
    let of = |functions: &str| rows.iter().find(|row| row["name"].as_str().unwrap().starts_with(functions)).unwrap();
    let halves = |name: &str| of(name)["bytes"].as_f64().unwrap();
    // Up to the header of an array.
    assert!((halves("225") / halves("25") / 9.0 - 1.0).abs() < 0.01);
    assert!(of("25 ")["reached"].as_f64() > of("225")["reached"].as_f64());

    stands_alone(&fs::read_to_string(out.join("index.html")).unwrap());
    let names = files_in(&out);
    for name in ["h1.svg", "choices.svg", "over-time-9-7-0.1-percent.png", "over-time-haar-256-coefficients.png"] {
        assert!(names.contains(&name.to_owned()), "no {name} among {names:?}");
    }
    assert_eq!(read(&out.join("over-time-rebuilt.png"), Encoding::Auto).unwrap().size(), (180, SIZE.1));
    assert_eq!(files_in(folder.path()), ["a <b>.rfield", "out", "sky.exr"]);
}

#[test]
fn bad_input_is_refused_in_a_sentence_and_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let field = field(folder.path(), "a.rfield", demo_lamps(40));
    let small = at("small.rfield");
    succeed(tool(&["compress"]).arg(&field).arg("-o").arg(&small).args(["--harmonic", "4"]));
    for (options, words) in [
        (&["--grid", "6x4"][..], &["grid", "6 x 4", "8 to 2048 columns"][..]),
        (&["--grid", "63x16"], &["63 x 16", "even"]),
        (&["--column", "36"], &["--column", "36", "0 to 35"]),
        (&["--reconstruct", "5/3"], &["5/3", "grid"]),
        (&["--env", "absent.exr"], &["absent.exr"]),
    ] {
        refuse(&mut evaluate(&field, &at("out"), options), words);
    }
    refuse(&mut evaluate(&small, &at("out"), &[]), &["small.rfield", "no longer holds", "made from"]);
    refuse(&mut evaluate(&field, &at("no/such/out"), &[]), &["does not exist"]);
    let output = run(&mut evaluate(&field, &at("out"), &["--pixels", "0"]));
    assert_eq!(output.status.code(), Some(2), "{}", text(&output.stderr));
    assert_eq!(files_in(folder.path()), ["a.rfield", "small.rfield"]);
}
