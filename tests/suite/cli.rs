//! The command line from outside: the built tool, files in temporary folders, exit codes, and what it leaves behind.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use relume_core::image::{EncodeOptions, Encoding, Image, read, write};
use relume_tests::relume;
use serde_json::Value;

/// Photographs are 21 x 11: neither side is a multiple of a block's.
const SIZE: (usize, usize) = (21, 11);

/// A folder with photographs and a `.lp` file.
pub(crate) struct Set {
    folder: tempfile::TempDir,
    pub(crate) photographs: Vec<Image>,
}

impl Set {
    /// Photographs called `photo N.extension`, counted from 0, and `dirs.lp`.
    pub(crate) fn new(directions: &[[f64; 3]], size: (usize, usize), extension: &str) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let mut lp = format!("{}\n", directions.len());
        let mut photographs = Vec::new();
        for (n, [x, y, z]) in directions.iter().enumerate() {
            let picture = photograph(n, size);
            let name = format!("photo {n}.{extension}");
            write(&folder.path().join(&name), &picture, EncodeOptions::default()).unwrap();
            lp += &format!("{name} {x} {y} {z}\n");
            photographs.push(picture);
        }
        fs::write(folder.path().join("dirs.lp"), lp).unwrap();
        Self { folder, photographs }
    }

    /// Five lamps over the front hemisphere.
    pub(crate) fn small() -> Self {
        let s = 0.5f64.sqrt();
        Self::new(&[[0.0, 0.0, 1.0], [s, 0.0, s], [-s, 0.0, s], [0.0, s, s], [0.0, -s, s]], SIZE, "tif")
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// A folder for outputs alone, so that leftovers show.
    pub(crate) fn out(&self) -> PathBuf {
        let out = self.path("out");
        fs::create_dir_all(&out).unwrap();
        out
    }

    /// Imports to `out/a.rfield`.
    pub(crate) fn import(&self, options: &[&str]) -> PathBuf {
        let (lp, field) = (self.path("dirs.lp"), self.out().join("a.rfield"));
        succeed(Command::new(relume()).args(["import", "lp"]).arg(lp).arg("-o").arg(&field).args(options));
        field
    }
}

/// Different in every pixel, channel and lamp; 0.1 to 2.
pub(crate) fn photograph(lamp: usize, (w, h): (usize, usize)) -> Image {
    let wave = |phase: f32| 1.05 + 0.95 * phase.sin();
    Image::from_fn(w, h, |x, y| [0.7, 1.3, 2.1].map(|k| wave(k * (x + 3 * y) as f32 + lamp as f32)))
}

pub(crate) fn run(command: &mut Command) -> Output {
    command.output().unwrap_or_else(|error| panic!("{command:?}: {error}"))
}

pub(crate) fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// Runs and returns what was printed.
pub(crate) fn succeed(command: &mut Command) -> String {
    let output = run(command);
    assert_eq!(output.status.code(), Some(0), "{command:?}: {}", text(&output.stderr));
    text(&output.stdout)
}

/// Runs what must be refused with exit code 1 and one sentence, which must hold all `words`; returns it.
pub(crate) fn refuse(command: &mut Command, words: &[&str]) -> String {
    let output = run(command);
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{command:?}: {said}");
    assert!(said.starts_with("error: ") && said.trim_end().lines().count() == 1, "{command:?}: {said}");
    for word in words {
        assert!(said.contains(word), "{command:?}: no `{word}` in: {said}");
    }
    assert!(output.stdout.is_empty(), "{command:?} printed {}", text(&output.stdout));
    said
}

pub(crate) fn tool(arguments: &[&str]) -> Command {
    let mut command = Command::new(relume());
    command.args(arguments);
    command
}

pub(crate) fn relight(field: &Path, output: &Path, options: &[&str]) -> Image {
    succeed(tool(&["relight"]).arg(field).arg("-o").arg(output).args(options));
    read(output, Encoding::Auto).unwrap()
}

pub(crate) fn info(field: &Path) -> Value {
    serde_json::from_str(&succeed(tool(&["info", "--json"]).arg(field))).unwrap()
}

pub(crate) fn files_in(folder: &Path) -> Vec<String> {
    let name = |entry: std::io::Result<fs::DirEntry>| entry.unwrap().file_name().to_string_lossy().into_owned();
    let mut names: Vec<String> = fs::read_dir(folder).unwrap().map(name).collect();
    names.sort();
    names
}

/// The largest |a - b| / largest |b|.
pub(crate) fn difference(a: &Image, b: &Image) -> f32 {
    assert_eq!((a.size(), a.channels()), (b.size(), b.channels()));
    let largest = b.data().iter().fold(0.0f32, |m, v| m.max(v.abs()));
    a.data().iter().zip(b.data()).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max) / largest
}

/// Checks every lamp's picture against its photograph, to `tolerance` of the largest number.
fn lamps_return(set: &Set, field: &Path, options: &[&str], tolerance: f32) {
    for (n, photograph) in set.photographs.iter().enumerate() {
        let number = (n + 1).to_string();
        let mut options = options.to_vec();
        options.extend(["--lamp", &number]);
        let lit = relight(field, &set.out().join("lit.tif"), &options);
        let off = difference(&lit, photograph);
        assert!(off <= tolerance, "lamp {number} {options:?}: off by {off}");
    }
}

/// Rounding to halves: half of 2^-10 of the number, the scale being a power of two.
const HALF: f32 = 0.5 / 1024.0;

#[test]
fn lamps_give_their_photographs_back() {
    let set = Set::small();
    let field = set.import(&[]);
    let told = info(&field);
    assert_eq!((&told["lamps"], &told["width"], &told["height"]), (&5.into(), &SIZE.0.into(), &SIZE.1.into()));
    assert_eq!((&told["precision"], &told["axis"]), (&"half".into(), &"+z".into()));
    assert_eq!(told["file_bytes"], fs::metadata(&field).unwrap().len());
    assert_eq!(told["coverage"]["kind"], "cap");
    // 45 degrees to the outermost lamp, plus half of the 45 degrees between neighbours.
    assert!((told["coverage"]["half_angle_deg"].as_f64().unwrap() - 67.5).abs() < 1e-6, "{told}");
    assert!((told["median_spacing_deg"].as_f64().unwrap() - 45.0).abs() < 1e-6, "{told}");
    assert!(succeed(tool(&["verify"]).arg(&field)).contains("OK  transport/dense.npy"));
    lamps_return(&set, &field, &[], HALF);
    lamps_return(&set, &field, &["--access", "read"], HALF);
    assert_eq!(files_in(&set.out()), ["a.rfield", "lit.tif"]);
}

#[test]
fn floats_are_exact_whatever_the_irradiance() {
    let set = Set::small();
    for options in [&["--precision", "float"][..], &["--precision", "float", "--irradiance", "2"]] {
        lamps_return(&set, &set.import(options), &[], 1e-6);
    }
    lamps_return(&set, &set.import(&["--irradiance", "2"]), &[], HALF);
    assert_eq!(info(&set.import(&["--irradiance", "2"]))["irradiance"], serde_json::json!([2.0, 2.0]));
    let twice = relight(&set.import(&[]), &set.out().join("a.exr"), &["--lamp", "3", "--exposure", "1"]);
    let expected =
        Image::from_fn(SIZE.0, SIZE.1, |x, y| std::array::from_fn(|c| 2.0 * set.photographs[2].pixel(x, y)[c]));
    assert!(difference(&twice, &expected) <= HALF);
}

#[test]
fn the_black_photograph_is_taken_off_and_can_be_added_again() {
    let mut set = Set::small();
    let black = Image::from_fn(SIZE.0, SIZE.1, |x, y| [0.01 * x as f32, 0.02 * y as f32, 0.05]);
    write(&set.path("black.exr"), &black, EncodeOptions::default()).unwrap();
    let path = set.path("black.exr").display().to_string();
    let field = set.import(&["--black", &path, "--precision", "float"]);
    assert_eq!(info(&field)["layers"]["ambient"], "layers/ambient.npy");
    lamps_return(&set, &field, &["--ambient", "1"], 1e-6);
    for photograph in &mut set.photographs {
        photograph.data_mut().iter_mut().zip(black.data()).for_each(|(p, s)| *p -= s);
    }
    lamps_return(&set, &field, &[], 1e-6);
}

#[test]
fn alpha_reaches_the_output() {
    let set = Set::small();
    let coverage = Image::from_fn(SIZE.0, SIZE.1, |x, _| [if x < 10 { 1.0 } else { 0.25 }; 3]);
    write(&set.path("alpha.tif"), &coverage, EncodeOptions::default()).unwrap();
    let path = set.path("alpha.tif").display().to_string();
    let field = set.import(&["--alpha", &path]);
    let lit = relight(&field, &set.out().join("a.exr"), &["--lamp", "1"]);
    assert_eq!(lit.channels(), 4);
    assert_eq!((lit.pixel(9, 3)[3], lit.pixel(10, 3)[3]), (1.0, 0.25));
    assert_eq!(relight(&field, &set.out().join("a.jpg"), &["--lamp", "1"]).channels(), 3);
}

#[test]
fn unsuitable_photograph_lists_are_refused() {
    let set = Set::small();
    write(&set.path("large.tif"), &photograph(0, (22, 11)), EncodeOptions::default()).unwrap();
    fs::write(set.path("words.tif"), "not a picture").unwrap();
    let whole = fs::read(set.path("photo 0.tif")).unwrap();
    fs::write(set.path("cut.tif"), &whole[..whole.len() / 2]).unwrap();
    for (lp, words) in [
        ("3\nphoto 0.tif 0 0 1\nphoto 1.tif 1 0 0\n", &["bad.lp", "2 of them", "3 lines", "line 1"][..]),
        ("1\nphoto 0.tif 0,5 0,5 0,7\n", &["bad.lp, line 2", "`0,7`", "decimal dot"]),
        ("2\nphoto 0.tif 0 0 1\nphoto 1.tif 0 0 0\n", &["bad.lp, line 3", "(0, 0, 0)", "zero vector"]),
        ("2\nphoto 0.tif NaN 0 1\nphoto 1.tif 0 1 0\n", &["bad.lp, line 2", "NaN", "finite"]),
        ("1\nphoto 0.tif 0 0 2\n", &["bad.lp, line 2", "length 2", "--normalise-directions"]),
        ("photo 0.tif 0 0 1\n", &["bad.lp, line 1", "number of lights"]),
        ("", &["bad.lp", "empty"]),
        ("2\nphoto 0.tif 0 0 1\nphoto 9.tif 1 0 0\n", &["photo 9.tif"]),
        ("2\nphoto 0.tif 0 0 1\nlarge.tif 1 0 0\n", &["large.tif", "22 x 11", "21 x 11"]),
        ("2\nphoto 0.tif 0 0 1\nwords.tif 1 0 0\n", &["words.tif"]),
        ("2\nphoto 0.tif 0 0 1\ncut.tif 1 0 0\n", &["cut.tif"]),
    ] {
        fs::write(set.path("bad.lp"), lp).unwrap();
        let (session, field) = (set.out().join("session"), set.out().join("a.rfield"));
        refuse(tool(&["import", "lp"]).arg(set.path("bad.lp")).arg("-o").arg(&field), words);
        let mut both = tool(&["import", "lp"]);
        refuse(both.arg(set.path("bad.lp")).arg("-o").arg(&field).arg("--session").arg(session), words);
        assert!(files_in(&set.out()).is_empty(), "{lp}: {:?}", files_in(&set.out()));
    }
    refuse(tool(&["import", "lp", "absent.lp", "-o"]).arg(set.out().join("a.rfield")), &["absent.lp"]);
    let absent = set.out().join("absent").join("a.rfield");
    refuse(tool(&["import", "lp"]).arg(set.path("dirs.lp")).arg("-o").arg(absent), &["a.rfield", "does not exist"]);
    assert!(files_in(&set.out()).is_empty());
}

#[test]
fn unsuitable_fields_are_refused() {
    let set = Set::small();
    let bytes = fs::read(set.import(&[])).unwrap();
    let out = set.path("out2");
    fs::create_dir(&out).unwrap();
    let bad = set.path("bad.rfield");
    let mut damaged = bytes.clone();
    damaged[bytes.len() / 3] ^= 1;
    for (content, only_verify) in [
        (&bytes[..bytes.len() - 100], false),
        (&bytes[..200], false),
        (&[], false),
        (b"2\nfoto", false),
        (&damaged, true),
    ] {
        fs::write(&bad, content).unwrap();
        refuse(tool(&["verify"]).arg(&bad), &["bad.rfield"]);
        if !only_verify {
            refuse(tool(&["info"]).arg(&bad), &["bad.rfield"]);
            refuse(tool(&["relight", "--lamp", "1"]).arg(&bad).arg("-o").arg(out.join("a.exr")), &["bad.rfield"]);
        }
    }
    refuse(&mut tool(&["info", "absent.rfield"]), &["absent.rfield"]);
    refuse(tool(&["info"]).arg(&out), &["out2"]);
    assert!(files_in(&out).is_empty());
}

#[test]
fn unsuitable_lights_and_outputs_are_refused() {
    let set = Set::small();
    let field = set.import(&[]);
    let out = set.path("out2");
    fs::create_dir(&out).unwrap();
    let refuse_light = |options: &[&str], words: &[&str]| {
        refuse(tool(&["relight"]).arg(&field).arg("-o").arg(out.join("a.exr")).args(options), words);
    };
    let map = set.path("nan.exr").display().to_string();
    write_exr_with_nan(Path::new(&map));
    refuse_light(&["--env", &map], &["nan.exr", "(5, 2)"]);
    refuse_light(&["--env", "absent.hdr"], &["absent.hdr"]);
    refuse_light(&["--env", &set.path("dirs.lp").display().to_string()], &["dirs.lp"]);
    refuse_light(&["--lamp", "0"], &["a.rfield", "lamp 0", "1 to 5"]);
    refuse_light(&["--lamp", "6"], &["a.rfield", "lamp 6", "1 to 5"]);
    for (name, words) in
        [("a.bmp", [".bmp", ".exr"]), ("a", ["no extension", ".exr"]), ("no/a.exr", ["a.exr", "does not exist"])]
    {
        refuse(tool(&["relight", "--lamp", "1"]).arg(&field).arg("-o").arg(out.join(name)), &words);
    }
    assert!(files_in(&out).is_empty(), "{:?}", files_in(&out));
}

/// A 16 x 8 map, black but for NaN in the green of pixel (5, 2). Our own writer refuses NaN, so it is put into the bytes
/// of an uncompressed scanline file: each row is 8 bytes of header, then channels B, G, R of 16 floats.
fn write_exr_with_nan(path: &Path) {
    use std::io::Write;
    let mut file = vec![0x76, 0x2f, 0x31, 0x01, 2, 0, 0, 0];
    let mut attribute = |name: &str, kind: &str, value: &[u8]| {
        file.extend(name.bytes().chain([0]).chain(kind.bytes()).chain([0]));
        file.extend((value.len() as u32).to_le_bytes());
        file.extend(value);
    };
    let words = |words: &[u32]| words.iter().flat_map(|w| w.to_le_bytes()).collect::<Vec<u8>>();
    // Name, zero, float (2), linear and reserved (0), sampling 1 x 1.
    let channel = |name: u8| [vec![name, 0], words(&[2, 0, 1, 1])].concat();
    attribute("channels", "chlist", &[channel(b'B'), channel(b'G'), channel(b'R'), vec![0]].concat());
    attribute("compression", "compression", &[0]);
    attribute("dataWindow", "box2i", &words(&[0, 0, 15, 7]));
    attribute("displayWindow", "box2i", &words(&[0, 0, 15, 7]));
    attribute("lineOrder", "lineOrder", &[0]);
    attribute("pixelAspectRatio", "float", &1f32.to_le_bytes());
    attribute("screenWindowCenter", "v2f", &words(&[0, 0]));
    attribute("screenWindowWidth", "float", &1f32.to_le_bytes());
    file.push(0);
    let (row, table) = (8 + 3 * 16 * 4, file.len());
    (0..8).for_each(|y| file.extend(((table + 8 * 8 + y * row) as u64).to_le_bytes()));
    for y in 0..8u32 {
        file.extend(words(&[y, 3 * 16 * 4]));
        for n in 0..3 * 16 {
            let value = if (y, n) == (2, 16 + 5) { f32::NAN } else { 0.0 };
            file.extend(value.to_le_bytes());
        }
    }
    fs::File::create(path).unwrap().write_all(&file).unwrap();
}

/// A file that may not grow past one block (512 or 1024 bytes, as shells differ) is a full disk that needs no rights.
#[cfg(unix)]
#[test]
fn a_full_disk_leaves_nothing() {
    let set = Set::new(&[[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], (64, 64), "tif");
    let field = set.import(&[]);
    let out = set.path("out2");
    fs::create_dir(&out).unwrap();
    let limited = |arguments: &[&std::ffi::OsStr]| {
        let mut command = Command::new("sh");
        command.args(["-c", "ulimit -f 1; trap '' XFSZ; exec \"$0\" \"$@\""]).arg(relume()).args(arguments);
        command
    };
    let (lp, session, new) = (set.path("dirs.lp"), out.join("session"), out.join("b.rfield"));
    let os = std::ffi::OsStr::new;
    refuse(&mut limited(&[os("import"), os("lp"), lp.as_os_str(), os("-o"), new.as_os_str()]), &["b.rfield"]);
    let into_session = [os("import"), os("lp"), lp.as_os_str(), os("--session"), session.as_os_str()];
    refuse(&mut limited(&into_session), &["photo 0.tif"]);
    for name in ["a.exr", "a.tif", "a.png", "a.hdr"] {
        let output = out.join(name);
        let arguments = [os("relight"), field.as_os_str(), os("--lamp"), os("1"), os("-o"), output.as_os_str()];
        refuse(&mut limited(&arguments), &[name]);
    }
    assert!(files_in(&out).is_empty(), "{:?}", files_in(&out));
}

#[test]
fn wrong_usage_exits_with_2() {
    for arguments in [
        &[][..],
        &["frobnicate"],
        &["import", "lp", "a.lp"],
        &["import", "lp", "a.lp", "-o", "a.rfield", "--irradiance", "NaN"],
        &["relight", "a.rfield", "-o", "a.exr"],
        &["relight", "a.rfield", "-o", "a.exr", "--env", "m.hdr", "--lamp", "1"],
        &["relight", "a.rfield", "-o", "a.exr", "--env", "m.hdr", "--exposure", "inf"],
        &["relight", "a.rfield", "-o", "a.exr", "--env", "m.hdr", "--rotate", "north"],
        &["compare", "a.exr"],
        &["info"],
        &["verify", "--quickly", "a.rfield"],
    ] {
        let output = run(&mut tool(arguments));
        assert_eq!(output.status.code(), Some(2), "{arguments:?}");
    }
    for arguments in [&["--help"][..], &["relight", "--help"], &["import", "lp", "--help"], &["--version"]] {
        assert!(!succeed(&mut tool(arguments)).is_empty());
    }
}

#[test]
fn negative_numbers_parse_and_turn_the_light() {
    let set = Set::small();
    let field = set.import(&["--precision", "float"]);
    // Light from +x only: lamp 2. Turned by -90 degrees it comes from +z: lamp 1.
    let at_x =
        Image::from_fn(128, 64, |x, y| [if (28..36).contains(&x) && (28..36).contains(&y) { 1.0 } else { 0.0 }; 3]);
    let map = set.path("x.exr");
    write(&map, &at_x, EncodeOptions::default()).unwrap();
    let map = map.display().to_string();
    let lit = |options: &[&str]| relight(&field, &set.out().join("a.exr"), &[&["--env", &map][..], options].concat());
    let turned = lit(&["--rotate", "-90", "--reconstruct", "zero-order"]);
    let ratio = |c: usize| turned.pixel(7, 5)[c] / set.photographs[0].pixel(7, 5)[c];
    assert!(ratio(0) > 0.0 && (ratio(1) / ratio(0) - 1.0).abs() < 1e-4 && (ratio(2) / ratio(0) - 1.0).abs() < 1e-4);
    let darker = lit(&["--rotate=-90", "--reconstruct", "zero-order", "--exposure", "-1"]);
    assert!((darker.pixel(3, 3)[1] / turned.pixel(3, 3)[1] - 0.5).abs() < 1e-5);
    let behind = lit(&["--rotate", "90", "--map-centre", "behind", "--reconstruct", "zero-order"]);
    assert!(difference(&behind, &turned) < 1e-5);
}

#[test]
fn light_from_nowhere_is_mentioned() {
    let set = Set::small();
    let field = set.import(&[]);
    let back = Image::from_fn(64, 32, |x, _| [if (16..48).contains(&x) { 0.0 } else { 1.0 }; 3]);
    write(&set.path("back.exr"), &back, EncodeOptions::default()).unwrap();
    let mut command = tool(&["relight"]);
    command.arg(&field).arg("-o").arg(set.out().join("a.exr")).arg("--env").arg(set.path("back.exr"));
    let said = text(&run(&mut command).stderr);
    assert!(said.starts_with("note: 100 % of the light") && said.contains("back.exr"), "{said}");
    let output = run(command.args(["--outside", "nearest"]));
    assert_eq!((output.status.code(), text(&output.stderr)), (Some(0), String::new()));
}

#[test]
fn sessions_are_whole() {
    let set = Set::small();
    let session = set.out().join("session");
    let import = || {
        let mut command = tool(&["import", "lp"]);
        command.arg(set.path("dirs.lp")).arg("--session").arg(&session);
        command
    };
    assert!(succeed(&mut import()).contains("5 photographs"));
    assert_eq!(files_in(&session), ["calibration", "journal.jsonl", "lights.lp", "photos", "session.toml"]);
    assert_eq!(files_in(&session.join("photos")).len(), 5);
    let journal = fs::read_to_string(session.join("journal.jsonl")).unwrap();
    for (n, line) in journal.lines().enumerate() {
        let entry: Value = serde_json::from_str::<Value>(line).unwrap()["photograph"].take();
        let copy = session.join(entry["frames"][0]["file"].as_str().unwrap());
        assert_eq!(entry["number"], n + 1);
        assert_eq!(fs::read(copy).unwrap(), fs::read(set.path(&format!("photo {n}.tif"))).unwrap());
    }
    refuse(&mut import(), &["session", "not empty"]);
    assert_eq!(files_in(&set.out()), ["session"]);
    // Packed, it is the field that a direct import makes.
    let (packed, imported) = (set.out().join("packed.rfield"), set.import(&[]));
    succeed(tool(&["pack"]).arg(&session).arg("-o").arg(&packed));
    let dense = |path: &Path| super::capture::manifest(path)["blake3"]["transport/dense.npy"].clone();
    assert!(dense(&packed).is_string() && dense(&packed) == dense(&imported));
}

#[test]
fn compare_tells_where() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let reference = Image::from_fn(12, 7, |_, _| [1.0; 3]);
    let mut other = reference.clone();
    other.pixel_mut(4, 2)[1] = 1.5;
    let mask = Image::from_fn(12, 7, |x, _| [if x == 4 { 0.0 } else { 1.0 }; 3]);
    for (name, image) in [("a.exr", &other), ("b.exr", &reference), ("m.png", &mask)] {
        write(&path(name), image, EncodeOptions::default()).unwrap();
    }
    let compare = |options: &[&str]| {
        let mut command = tool(&["compare"]);
        command.arg(path("a.exr")).arg(path("b.exr")).args(options);
        command
    };
    let figures: Value = serde_json::from_str(&succeed(&mut compare(&["--json"]))).unwrap();
    assert_eq!((&figures["largest_difference"], &figures["at"]), (&0.5.into(), &serde_json::json!([4, 2, 1])));
    assert!((figures["relative_l2"].as_f64().unwrap() - (0.25f64 / 252.0).sqrt()).abs() < 1e-9);
    assert!(succeed(&mut compare(&[])).contains("at pixel (4, 2), channel G"));
    let mask = path("m.png").display().to_string();
    let masked: Value = serde_json::from_str(&succeed(&mut compare(&["--json", "--mask", &mask]))).unwrap();
    assert_eq!((&masked["largest_difference"], &masked["pixels"]), (&0.0.into(), &77.into()));
    write(&path("small.exr"), &Image::new(3, 3, 3), EncodeOptions::default()).unwrap();
    refuse(tool(&["compare"]).arg(path("a.exr")).arg(path("small.exr")), &["a.exr", "small.exr", "3 x 3", "12 x 7"]);
    refuse(tool(&["compare"]).arg(path("a.exr")).arg(path("absent.exr")), &["absent.exr"]);
}
