//! Containers, from outside: what was written is read back, and mistakes are named.

use std::io::Read;
use std::ops::Range;
use std::path::{Path, PathBuf};

use half::f16;

use super::*;
use crate::domain::Directions;
use crate::error::{Error, Result};
use crate::image::Image;
use crate::math::Vec3;

/// T(x, y, c, lamp), a different number everywhere.
fn transport(x: usize, y: usize, c: usize, lamp: usize) -> f32 {
    (x as f32 + 0.01 * y as f32 + 7.0 * c as f32) * (lamp as f32 - 1.5)
}

/// A source of [`transport`].
struct Formula(Layout);

impl Bands for Formula {
    fn fill(&mut self, by: usize, columns: Range<usize>, blocks: &mut [f32]) -> Result<()> {
        for (n, out) in blocks.iter_mut().enumerate() {
            let (k, rest) = (n % BLOCK_PIXELS, n / BLOCK_PIXELS);
            let (lamp, rest) = (rest % self.0.elements, rest / self.0.elements);
            let (c, bx) = (rest % 3, columns.start + rest / 3);
            let (x, y) = (bx * BLOCK_WIDTH + k % BLOCK_WIDTH, by * BLOCK_HEIGHT + k / BLOCK_WIDTH);
            if x < self.0.width && y < self.0.height {
                *out = transport(x, y, c, lamp);
            }
        }
        Ok(())
    }
}

fn contents(precision: Precision, width: usize, height: usize) -> Contents {
    Contents {
        colour_space: Default::default(),
        domain: Directions::new(vec![Vec3::z(), Vec3::x(), Vec3::y()]).unwrap().into(),
        irradiance: vec![1.0, 2.0, std::f32::consts::PI],
        width,
        height,
        precision,
        largest: 200.0,
        ambient: Some(Image::from_fn(width, height, |x, y| [x as f32, y as f32, 0.5])),
        alpha: Some((0..width * height).map(|n| (n % 3) as f32 / 2.0).collect()),
        reliability: None,
        provenance: serde_json::json!({"source": "formula"}),
    }
}

fn written(folder: &Path, precision: Precision) -> PathBuf {
    let path = folder.join("a.rfield");
    let contents = contents(precision, 37, 21);
    write(&path, &contents, &mut Formula(Layout { width: 37, height: 21, elements: 3 })).unwrap();
    path
}

fn no_progress(_: u64, _: u64) -> Result<()> {
    Ok(())
}

#[test]
fn what_was_written_is_read_back() {
    let folder = tempfile::tempdir().unwrap();
    for precision in [Precision::Half, Precision::Float] {
        let path = written(folder.path(), precision);
        for access in [Access::Mapped, Access::Read] {
            let asset = Asset::open(&path, access).unwrap();
            asset.verify(&mut no_progress).unwrap();
            assert_eq!((asset.width(), asset.height(), asset.directions().unwrap().len()), (37, 21, 3));
            assert_eq!(asset.manifest().irradiance(), contents(precision, 37, 21).irradiance);
            assert_eq!(asset.ambient(), contents(precision, 37, 21).ambient.as_ref());
            assert_eq!(asset.alpha(), contents(precision, 37, 21).alpha.as_deref());
            assert_eq!(
                asset.directions().unwrap().coverage(),
                contents(precision, 37, 21).domain.directions().unwrap().coverage()
            );
            let mut buffer = BlockBuffer::default();
            for (x, y, c, lamp) in [(0, 0, 0, 0), (36, 20, 2, 2), (17, 9, 1, 1), (15, 7, 0, 2), (16, 8, 2, 0)] {
                let block = asset.dense().unwrap().block(x / 16, y / 8, c, &mut buffer).unwrap();
                let at = lamp * BLOCK_PIXELS + (y % 8) * 16 + x % 16;
                let stored = match block {
                    Block::Half(t) => t[at].to_f32(),
                    Block::Float(t) => t[at],
                };
                let (found, expected) = (stored * asset.dense().unwrap().scale(), transport(x, y, c, lamp));
                let tolerance = if precision == Precision::Half { expected.abs() / 2048.0 } else { 0.0 };
                assert!((found - expected).abs() <= tolerance, "{found} is not {expected}");
            }
        }
    }
}

#[test]
fn entries_are_stored_aligned_and_hashed() {
    let folder = tempfile::tempdir().unwrap();
    let path = written(folder.path(), Precision::Half);
    let mut zip = zip::ZipArchive::new(std::fs::File::open(&path).unwrap()).unwrap();
    let manifest = Asset::open(&path, Access::Read).unwrap().manifest().clone();
    assert_eq!(zip.len(), manifest.blake3.len() + 1);
    for n in 0..zip.len() {
        let mut entry = zip.by_index(n).unwrap();
        assert_eq!(entry.compression(), zip::CompressionMethod::Stored);
        assert_eq!(entry.data_start().unwrap() % 64, 0);
        let name = entry.name().unwrap().into_owned();
        let mut bytes = Vec::new();
        // Reading through checks the CRC as well.
        entry.read_to_end(&mut bytes).unwrap();
        if name != "manifest.json" {
            assert_eq!(manifest.blake3[&name], blake3::hash(&bytes).to_hex().to_string(), "{name}");
        }
        if name == "preview.png" {
            assert_eq!(image::load_from_memory(&bytes).unwrap().width(), 37);
        }
    }
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "nothing else is left");
}

#[test]
fn halves_are_scaled_by_a_power_of_two() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bright.rfield");
    let bright = Contents { largest: 3.0e6, ..contents(Precision::Half, 16, 8) };
    /// One number everywhere.
    struct Constant(f32);
    impl Bands for Constant {
        fn fill(&mut self, _: usize, _: Range<usize>, blocks: &mut [f32]) -> Result<()> {
            blocks.fill(self.0);
            Ok(())
        }
    }
    write(&path, &bright, &mut Constant(3.0e6)).unwrap();
    let asset = Asset::open(&path, Access::Mapped).unwrap();
    assert_eq!(asset.dense().unwrap().scale(), 256.0);
    let mut buffer = BlockBuffer::default();
    let Block::Half(t) = asset.dense().unwrap().block(0, 0, 0, &mut buffer).unwrap() else { panic!("halves") };
    assert_eq!(t[0], f16::from_f32(3.0e6 / 256.0));
    for bad in [f32::NAN, f32::INFINITY, 1e9] {
        let absent = folder.path().join("bad.rfield");
        assert!(write(&absent, &bright, &mut Constant(bad)).is_err(), "{bad}");
        assert!(!absent.exists());
    }
}

#[test]
fn a_source_that_fails_leaves_nothing() {
    /// Stops in the second row.
    struct Stops;
    impl Bands for Stops {
        fn fill(&mut self, by: usize, _: Range<usize>, _: &mut [f32]) -> Result<()> {
            if by == 0 { Ok(()) } else { Err(Error::Cancelled) }
        }
    }
    let folder = tempfile::tempdir().unwrap();
    let result = write(&folder.path().join("a.rfield"), &contents(Precision::Half, 37, 21), &mut Stops);
    assert!(matches!(result, Err(Error::Cancelled)));
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}

#[test]
fn layers_of_another_size_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.rfield");
    let good = contents(Precision::Half, 37, 21);
    let layout = Layout { width: 37, height: 21, elements: 3 };
    for bad in [
        Contents { ambient: Some(Image::new(21, 37, 3)), ..good.clone() },
        Contents { ambient: Some(Image::new(37, 21, 4)), ..good.clone() },
        Contents { alpha: Some(vec![1.0; 5]), ..good.clone() },
        Contents { width: 0, ambient: None, alpha: None, ..good.clone() },
    ] {
        assert!(write(&path, &bad, &mut Formula(layout)).is_err());
        assert!(!path.exists());
    }
}

#[test]
fn a_changed_byte_is_found_by_verify() {
    let folder = tempfile::tempdir().unwrap();
    let path = written(folder.path(), Precision::Half);
    let mut bytes = std::fs::read(&path).unwrap();
    bytes[3000] ^= 1;
    std::fs::write(&path, bytes).unwrap();
    let message = Asset::open(&path, Access::Mapped).unwrap().verify(&mut no_progress).unwrap_err().to_string();
    assert!(message.contains("transport/dense.npy") && message.contains("changed"), "{message}");
}

/// Rewrites a container with the zip crate, entry by entry; `change` may rename, replace or drop (empty name) each.
fn rewritten(path: &Path, change: impl Fn(&str, Vec<u8>) -> (String, Vec<u8>)) -> PathBuf {
    let mut zip = zip::ZipArchive::new(std::fs::File::open(path).unwrap()).unwrap();
    let target = path.with_extension("changed.rfield");
    let mut out = zip::ZipWriter::new(std::fs::File::create(&target).unwrap());
    for n in 0..zip.len() {
        let mut entry = zip.by_index(n).unwrap();
        let mut bytes = Vec::new();
        entry.read_to_end(&mut bytes).unwrap();
        let (name, bytes) = change(&entry.name().unwrap(), bytes);
        if !name.is_empty() {
            let options = zip::write::SimpleFileOptions::default().with_alignment(64);
            out.start_file(name, options.compression_method(zip::CompressionMethod::Stored)).unwrap();
            std::io::Write::write_all(&mut out, &bytes).unwrap();
        }
    }
    out.finish().unwrap();
    target
}

#[test]
fn hostile_containers_get_a_sentence() {
    let folder = tempfile::tempdir().unwrap();
    let path = written(folder.path(), Precision::Half);
    let manifest = |from: &'static str, to: &'static str| {
        move |name: &str, bytes: Vec<u8>| {
            let bytes = if name == "manifest.json" {
                let text = String::from_utf8(bytes).unwrap();
                assert!(text.contains(from), "{from}");
                text.replace(from, to).into_bytes()
            } else {
                bytes
            };
            (name.to_owned(), bytes)
        }
    };
    type Change = Box<dyn Fn(&str, Vec<u8>) -> (String, Vec<u8>)>;
    let cases: Vec<(&str, Change)> = vec![
        ("names of letters", Box::new(|name, bytes| (name.replace("preview.png", "../preview.png"), bytes))),
        ("names of letters", Box::new(|name, bytes| (name.replace("preview.png", "/etc/passwd"), bytes))),
        ("no manifest.json", Box::new(|name, bytes| (name.replace("manifest.json", "manifest.txt"), bytes))),
        ("no such entry", Box::new(|name, bytes| (name.replace("dense", "dens"), bytes))),
        ("no such entry", Box::new(|name, bytes| (name.replace("layers/alpha.npy", ""), bytes))),
        ("container version 3.", Box::new(manifest("\"version\": [\n    2,", "\"version\": [\n    3,"))),
        ("no representation", Box::new(manifest_without_representations)),
        ("format `other`", Box::new(manifest("\"relume.rfield\"", "\"other\""))),
        ("picture of 0", Box::new(manifest("\"width\": 37", "\"width\": 0"))),
        ("picture of 18446744073709551615", Box::new(manifest("\"width\": 37", "\"width\": 18446744073709551615"))),
        ("header", Box::new(manifest("\"width\": 37", "\"width\": 131072"))),
        ("power of two", Box::new(manifest("\"scale\": 0.015625", "\"scale\": 0.3"))),
        ("unknown variant", Box::new(manifest("\"kind\": \"dense\"", "\"kind\": \"holographic\""))),
        ("colour space `lin_rec7O9`", Box::new(manifest("\"lin_rec709\"", "\"lin_rec7O9\""))),
        ("aces2065_1, lin_p3d65 (`lin_rec709` is near)", Box::new(manifest("\"lin_rec709\"", "\"lin_rec7O9\""))),
        ("irradiances", Box::new(manifest("\"irradiance\": [", "\"irradiance\": [ 1.0,"))),
        (
            "unit vector",
            Box::new(manifest("\"directions\": [\n      [\n        0.0", "\"directions\": [\n      [\n        9.0")),
        ),
        ("line", Box::new(manifest("{", "[["))),
        (
            "bytes",
            Box::new(|name, mut bytes| {
                if name.ends_with("dense.npy") {
                    bytes.pop();
                }
                (name.to_owned(), bytes)
            }),
        ),
        (
            "outside 0 to 1",
            Box::new(|name, mut bytes| {
                if name.ends_with("alpha.npy") {
                    let at = bytes.len() - 4;
                    bytes[at..].copy_from_slice(&7.0f32.to_le_bytes());
                }
                (name.to_owned(), bytes)
            }),
        ),
    ];
    for (part, change) in cases {
        let changed = rewritten(&path, change);
        for access in [Access::Mapped, Access::Read] {
            let message = Asset::open(&changed, access).unwrap_err().to_string();
            assert!(message.contains(part) && message.contains("changed.rfield"), "`{message}` lacks `{part}`");
        }
    }
    assert!(Asset::open(&rewritten(&path, |name, bytes| (name.to_owned(), bytes)), Access::Mapped).is_ok());
}

/// The manifest as JSON, changed.
fn manifest_with(name: &str, bytes: Vec<u8>, change: impl Fn(&mut serde_json::Value)) -> (String, Vec<u8>) {
    if name != "manifest.json" {
        return (name.to_owned(), bytes);
    }
    let mut json = serde_json::from_slice(&bytes).unwrap();
    change(&mut json);
    (name.to_owned(), serde_json::to_vec(&json).unwrap())
}

fn manifest_without_representations(name: &str, bytes: Vec<u8>) -> (String, Vec<u8>) {
    manifest_with(name, bytes, |json| json["representations"] = serde_json::json!([]))
}

/// Version 1 had `representation`, one.
#[test]
fn containers_of_version_1_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = written(folder.path(), Precision::Half);
    let old = rewritten(&path, |name, bytes| {
        manifest_with(name, bytes, |json| {
            let one = json["representations"][0].take();
            json.as_object_mut().unwrap().remove("representations");
            json["representation"] = one;
            json["version"] = serde_json::json!([1, 0]);
        })
    });
    let (old, new) = (Asset::open(&old, Access::Mapped).unwrap(), Asset::open(&path, Access::Mapped).unwrap());
    assert_eq!(old.manifest().representations, new.manifest().representations);
    assert!(old.dense().is_some());
}

#[test]
fn what_is_no_container_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = written(folder.path(), Precision::Half);
    let whole = std::fs::read(&path).unwrap();
    let other = folder.path().join("other.rfield");
    for bytes in
        [&b""[..], b"PK", b"a text file, not a container", &whole[..whole.len() / 2], &whole[..whole.len() - 1]]
    {
        std::fs::write(&other, bytes).unwrap();
        let message = Asset::open(&other, Access::Mapped).unwrap_err().to_string();
        assert!(message.contains("other.rfield"), "{message}");
    }
    assert!(matches!(Asset::open(&folder.path().join("absent"), Access::Mapped), Err(Error::Io { .. })));
    assert!(Asset::open(folder.path(), Access::Mapped).is_err(), "a folder");
}

/// Every byte of the transport's array.
fn transport_bytes(path: &Path) -> Vec<u8> {
    let mut zip = zip::ZipArchive::new(std::fs::File::open(path).unwrap()).unwrap();
    let mut bytes = Vec::new();
    zip.by_name("transport/dense.npy").unwrap().read_to_end(&mut bytes).unwrap();
    bytes
}

#[test]
fn layers_are_added_and_all_else_stays() {
    let folder = tempfile::tempdir().unwrap();
    let path = written(folder.path(), Precision::Half);
    let before = Asset::open(&path, Access::Read).unwrap();
    assert!(before.normals().unwrap().is_none() && before.albedo().unwrap().is_none());
    let normals = Image::from_fn(37, 21, |x, _| if x % 2 == 0 { [0.6, 0.0, 0.8] } else { [0.0; 3] });
    let albedo = Image::from_fn(37, 21, |x, y| [x as f32, y as f32, 0.25]);
    let layers = [NewLayer { name: "normals", picture: &normals }, NewLayer { name: "albedo", picture: &albedo }];
    let note = || ("surface", serde_json::json!({"reliable": 7}));
    let bytes = transport_bytes(&path);
    // To another file, then onto the file itself, where layers are replaced.
    let other = folder.path().join("b.rfield");
    add_layers(&before, &other, &layers, note(), &mut no_progress).unwrap();
    add_layers(&before, &path, &layers[..1], note(), &mut no_progress).unwrap();
    add_layers(&Asset::open(&path, Access::Read).unwrap(), &path, &layers, note(), &mut no_progress).unwrap();
    for path in [&other, &path] {
        let after = Asset::open(path, Access::Mapped).unwrap();
        after.verify(&mut no_progress).unwrap();
        assert_eq!((after.normals().unwrap(), after.albedo().unwrap()), (Some(&normals), Some(&albedo)));
        assert_eq!((after.ambient(), after.alpha()), (before.ambient(), before.alpha()));
        assert_eq!(after.manifest().domain, before.manifest().domain);
        assert_eq!(after.manifest().provenance["source"], "formula");
        assert_eq!(after.manifest().provenance["surface"]["reliable"], 7);
        assert_eq!(transport_bytes(path), bytes);
    }
}

#[test]
fn unsuitable_layers_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = written(folder.path(), Precision::Half);
    let asset = Asset::open(&path, Access::Read).unwrap();
    let output = folder.path().join("b.rfield");
    let add = |name: &str, picture: &Image| {
        add_layers(&asset, &output, &[NewLayer { name, picture }], ("x", serde_json::Value::Null), &mut no_progress)
    };
    let message = add("normals", &Image::new(36, 21, 3)).unwrap_err().to_string();
    assert!(message.contains("normals") && message.contains("37 x 21"), "{message}");
    assert!(!output.exists());
    // Read back, a layer must be what it says.
    let pixel = |bad: [f32; 3]| Image::from_fn(37, 21, |x, y| if (x, y) == (5, 3) { bad } else { [0.0; 3] });
    for (name, bad) in [("normals", [0.5, 0.0, 0.0]), ("normals", [f32::NAN; 3]), ("albedo", [0.1, -0.1, 0.0])] {
        add(name, &pixel(bad)).unwrap();
        let opened = Asset::open(&output, Access::Read).unwrap();
        let result = if name == "normals" { opened.normals().map(|_| ()) } else { opened.albedo().map(|_| ()) };
        let message = result.unwrap_err().to_string();
        let place = if bad[0].is_nan() { "number 348" } else { "pixel (5, 3)" };
        assert!(message.contains(name) && message.contains(place), "{message}");
    }
    // Bytes that are no longer those that were written are not passed on under a new hash.
    let mut bytes = std::fs::read(&path).unwrap();
    bytes[4096] ^= 1;
    let damaged = folder.path().join("c.rfield");
    std::fs::write(&damaged, bytes).unwrap();
    let asset = Asset::open(&damaged, Access::Read).unwrap();
    let layer = [NewLayer { name: "albedo", picture: &Image::new(37, 21, 3) }];
    let message =
        add_layers(&asset, &output, &layer, ("x", serde_json::Value::Null), &mut no_progress).unwrap_err().to_string();
    assert!(message.contains("the bytes have changed"), "{message}");
}
