//! From photographs to layers, through the command line: normals and albedo, white balance, lamps that failed, and pictures of
//! reflectance functions.

use std::fs;
use std::path::{Path, PathBuf};

use relume_core::image::{EncodeOptions, Encoding, Image, read, write};
use relume_core::math::{Vec3, angle_between};
use relume_tests::{shared_data, skipped};

use crate::cli::{info, refuse, run, succeed, text, tool};

const SIZE: (usize, usize) = (37, 21);
const ALBEDO: [f32; 3] = [0.7, 0.5, 0.3];

/// A folder with photographs of a bumpy Lambert surface.
struct Set {
    folder: tempfile::TempDir,
}

impl Set {
    fn new(lamps: usize) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let mut lp = format!("{lamps}\n");
        for (n, l) in lights(lamps).iter().enumerate() {
            // A white diffuser that faces the lamp photographs as 1.
            let lit = |x: usize, y: usize| ALBEDO.map(|a| a * normal(x, y).dot(l).max(0.0) as f32);
            write(
                &folder.path().join(format!("{n}.tif")),
                &Image::from_fn(SIZE.0, SIZE.1, lit),
                EncodeOptions::default(),
            )
            .unwrap();
            lp += &format!("{n}.tif {} {} {}\n", l.x, l.y, l.z);
        }
        fs::write(folder.path().join("dirs.lp"), lp).unwrap();
        Self { folder }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn import(&self, name: &str, options: &[&str]) -> PathBuf {
        let field = self.path(name);
        succeed(tool(&["import", "lp"]).arg(self.path("dirs.lp")).arg("-o").arg(&field).args(options));
        field
    }

    fn layer(&self, field: &Path, layer: &str, name: &str) -> Image {
        let output = self.path(name);
        succeed(tool(&["relight"]).arg(field).args(["--layer", layer, "-o"]).arg(&output));
        read(&output, Encoding::Linear).unwrap()
    }
}

/// Around the camera's axis, up to 55 degrees off it.
fn lights(count: usize) -> Vec<Vec3> {
    let light = |i: usize| {
        let (slant, turn) = (0.15 + 0.8 * (i as f64 + 0.5) / count as f64, 2.399_963 * i as f64);
        Vec3::new(slant.sin() * turn.cos(), slant.sin() * turn.sin(), slant.cos())
    };
    (0..count).map(light).collect()
}

fn normal(x: usize, y: usize) -> Vec3 {
    Vec3::new(0.3 * (x as f64 / 6.0).sin(), 0.3 * (y as f64 / 5.0).cos(), 1.0).normalize()
}

fn assert_normals(picture: &Image) {
    for (x, y) in (0..SIZE.1).flat_map(|y| (0..SIZE.0).map(move |x| (x, y))) {
        let found = Vec3::from_iterator(picture.pixel(x, y)[..3].iter().map(|v| f64::from(*v)));
        assert!((found.norm() - 1.0).abs() < 1e-3, "({x}, {y}): {found}");
        let off = angle_between(&found.normalize(), &normal(x, y)).to_degrees();
        assert!(off < 0.5, "({x}, {y}): {off} degrees");
    }
}

#[test]
fn normals_and_albedo_become_layers() {
    let set = Set::new(14);
    let bare = set.import("bare.rfield", &[]);
    let sheet = set.path("n.exr");
    refuse(
        tool(&["relight"]).arg(&bare).args(["--layer", "normals", "-o"]).arg(&sheet),
        &["normals", "relume surface"],
    );
    refuse(tool(&["relight"]).arg(&bare).args(["--layer", "ambient", "-o"]).arg(&sheet), &["ambient", "--black"]);
    let at_import = set.import("a.rfield", &["--normals"]);
    let later = set.path("b.rfield");
    let said = succeed(tool(&["surface"]).arg(&bare).arg("-o").arg(&later));
    assert!(said.contains("777 of 777 pixels"), "{said}");
    // And onto itself.
    succeed(tool(&["surface"]).arg(&later).arg("-o").arg(&later));
    for field in [&at_import, &later] {
        succeed(tool(&["verify"]).arg(field));
        let layers = info(field)["layers"].clone();
        assert!(layers["normals"] == "layers/normals.npy" && layers["albedo"] == "layers/albedo.npy", "{layers}");
        assert_normals(&set.layer(field, "normals", "n.exr"));
        let albedo = set.layer(field, "albedo", "a.exr");
        let off = albedo.data().chunks_exact(3).map(|p| (0..3).map(|c| (p[c] - ALBEDO[c]).abs()).fold(0.0, f32::max));
        assert!(off.fold(0.0, f32::max) < 0.01);
    }
    // A normal map as other programs know it: codes (n + 1) / 2, whatever the curve of the type.
    let mut map = set.layer(&later, "normals", "n.png");
    map.data_mut().iter_mut().for_each(|v| *v = 2.0 * *v - 1.0);
    assert_normals(&map);
    let files = fs::read_dir(set.folder.path()).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap());
    assert!(files.into_iter().all(|name| !name.starts_with(".relume")), "nothing else is left");
}

#[test]
fn a_layer_takes_no_light_and_few_lamps_no_surface() {
    let set = Set::new(3);
    let field = set.import("a.rfield", &[]);
    refuse(tool(&["surface"]).arg(&field).arg("-o").arg(set.path("b.rfield")), &["3 lamp directions", "at least 4"]);
    refuse(
        tool(&["import", "lp"]).arg(set.path("dirs.lp")).arg("--normals").arg("-o").arg(set.path("c.rfield")),
        &["3 lamp directions"],
    );
    assert!(!set.path("b.rfield").exists() && !set.path("c.rfield").exists());
    for wrong in [&["--lamp", "1"][..], &["--exposure", "1"], &["--rotate", "9"]] {
        let output = run(tool(&["relight"]).arg(&field).args(["--layer", "alpha", "-o", "x.exr"]).args(wrong));
        assert_eq!(output.status.code(), Some(2), "{wrong:?}: {}", text(&output.stderr));
    }
}

#[test]
fn lamps_are_left_out_by_number() {
    let set = Set::new(5);
    let field = set.import("a.rfield", &["--exclude", "4,2,4"]);
    let told = info(&field);
    assert_eq!(told["lamps"], 3);
    assert_eq!(told["provenance"]["excluded"], serde_json::json!([2, 4]));
    assert_eq!(told["provenance"]["photographs"], serde_json::json!(["0.tif", "2.tif", "4.tif"]));
    let output = set.path("lit.exr");
    succeed(tool(&["relight"]).arg(&field).args(["--lamp", "2", "-o"]).arg(&output));
    let (lit, photograph) = (read(&output, Encoding::Auto).unwrap(), read(&set.path("2.tif"), Encoding::Auto).unwrap());
    let close = |(a, b): (&f32, &f32)| (a - b).abs() < 1e-3;
    assert!(lit.data().iter().zip(photograph.data()).all(close), "the second lamp is now the third of the list");
    for (numbers, words) in [
        ("0", &["number 0", "1 to 5"][..]),
        ("6", &["number 6", "1 to 5"]),
        ("1,2,3,4,5", &["all 5 of them", "at least one"]),
    ] {
        let other = set.path("b.rfield");
        let mut command = tool(&["import", "lp"]);
        refuse(command.arg(set.path("dirs.lp")).arg("-o").arg(&other).args(["--exclude", numbers]), words);
        assert!(!other.exists());
    }
    let mut command = tool(&["import", "lp"]);
    let output = run(command.arg(set.path("dirs.lp")).args(["-o", "x.rfield", "--exclude", "1,two"]));
    assert_eq!(output.status.code(), Some(2));
}

#[test]
fn white_is_measured_and_applied() {
    let set = Set::new(4);
    let card = set.path("card.tif");
    let tint = [0.8, 0.5, 0.2];
    write(&card, &Image::from_fn(40, 30, |x, _| if x < 20 { tint } else { [0.0; 3] }), EncodeOptions::default())
        .unwrap();
    let file = set.path("white.toml");
    let said = succeed(tool(&["calibrate", "white"]).arg(&card).args(["--patch", "2,3,10,10", "-o"]).arg(&file));
    assert!(said.contains("gains 0.62500,1.00000,2.50000"), "{said}");
    let lit = |white: &str| {
        let field = set.import("w.rfield", &["--precision", "float", "--white-balance", white]);
        let output = set.path("lit.exr");
        succeed(tool(&["relight"]).arg(&field).args(["--lamp", "3", "-o"]).arg(&output));
        assert!(info(&field)["provenance"]["white_balance"].is_array());
        read(&output, Encoding::Auto).unwrap()
    };
    let photograph = read(&set.path("2.tif"), Encoding::Auto).unwrap();
    for picture in [lit(file.to_str().unwrap()), lit("0.625,1,2.5")] {
        for (a, b) in picture.data().chunks_exact(3).zip(photograph.data().chunks_exact(3)) {
            let off = (0..3).map(|c| (a[c] - b[c] * [0.625, 1.0, 2.5][c]).abs()).fold(0.0, f32::max);
            assert!(off < 1e-5, "{a:?} {b:?}");
        }
    }
    let white = |options: &[&str], words: &[&str]| {
        refuse(tool(&["calibrate", "white"]).arg(&card).args(options), words);
    };
    white(&["--patch", "25,3,10,10"], &["card.tif", "black"]);
    white(&["--patch", "35,3,10,10"], &["inside 40 x 30"]);
    white(&["--chart", "1,1,1,1,1,1,1,1"], &["dark skin"]);
    white(&["--chart", "2,2,90,2,90,28,2,28"], &["patch `", "inside the picture"]);
    for (wrong, words) in [
        ("1,2", "found 2 numbers"),
        ("1,0,1", "0.001"),
        ("absent.toml", "absent.toml"),
        (card.to_str().unwrap(), "card.tif"),
    ] {
        let mut command = tool(&["import", "lp"]);
        refuse(
            command.arg(set.path("dirs.lp")).arg("-o").arg(set.path("x.rfield")).args(["--white-balance", wrong]),
            &[words],
        );
    }
}

#[test]
fn reflectance_functions_are_drawn() {
    let set = Set::new(14);
    let field = set.import("a.rfield", &[]);
    let sheet = |options: &[&str]| {
        let output = set.path("sheet.png");
        succeed(tool(&["inspect"]).arg(&field).args(options).arg("-o").arg(&output));
        read(&output, Encoding::Linear).unwrap()
    };
    let one = sheet(&["--pixel", "12,7"]);
    let two = sheet(&["--pixel", "12,7", "--pixel", "0,20", "--reconstruct", "zero-order", "--reconstruct", "linear"]);
    assert!(two.width() > one.width() && two.height() > one.height());
    assert_ne!(sheet(&["--pixel", "12,7", "--on", "latlong"]).size(), one.size());
    let inspect = |options: &[&str]| {
        let mut command = tool(&["inspect"]);
        command.arg(&field).args(options);
        command
    };
    let output = set.path("x.png");
    let output = output.to_str().unwrap();
    refuse(&mut inspect(&["--pixel", "37,0", "-o", output]), &["pixel 37,0", "0,0 to 36,20"]);
    refuse(&mut inspect(&["--pixel", "1,1", "--pixel", "0,21", "-o", output]), &["pixel 0,21"]);
    refuse(&mut inspect(&["--pixel", "1,1", "-o", "x.bmp"]), &[".bmp"]);
    for wrong in [&["--pixel", "1"][..], &["--pixel", "-1,2"], &["--pixel", "1,2", "--reconstruct", "cubic"], &[]] {
        assert_eq!(run(inspect(wrong).args(["-o", output])).status.code(), Some(2), "{wrong:?}");
    }
}

#[test]
fn a_real_painting_has_a_surface_and_sound_lamps() {
    let Some(data) = shared_data() else { return skipped("../shared/data") };
    let folder = tempfile::tempdir().unwrap();
    let field = folder.path().join("p.rfield");
    let lp = data.join("painting-72/dirs.lp");
    succeed(tool(&["import", "lp"]).arg(&lp).arg("-o").arg(&field));
    let check: serde_json::Value =
        serde_json::from_str(&succeed(tool(&["calibrate", "failed", "--json"]).arg(&field))).unwrap();
    assert_eq!(check["failed"], serde_json::json!([]), "{check}");
    // Lamp 30 held back: a dark photograph in its place.
    let mut list = fs::read_to_string(&lp).unwrap().replace("image", data.join("painting-72/image").to_str().unwrap());
    let line = list.lines().nth(30).unwrap().to_owned();
    let name = line.split_whitespace().next().unwrap().to_owned();
    let dark = folder.path().join("dark.png");
    write(&dark, &Image::new(402, 395, 3), EncodeOptions::default()).unwrap();
    list = list.replace(&line, &line.replace(&name, "dark.png"));
    fs::write(folder.path().join("dirs.lp"), list).unwrap();
    let other = folder.path().join("q.rfield");
    succeed(tool(&["import", "lp"]).arg(folder.path().join("dirs.lp")).arg("-o").arg(&other));
    let said = succeed(tool(&["calibrate", "failed"]).arg(&other));
    assert!(said.contains("lamp 30 (") && said.contains("dark.png: 100 % darker"), "{said}");
    assert!(said.contains("--exclude 30\n"), "{said}");
}
