//! Real camera drivers from outside: the built tool before the virtual PTP camera of libgphoto2's sources, and before folders that
//! scripts fill.

use std::fs;
use std::path::Path;
use std::process::Command;

use relume_core::image::{EncodeOptions, Image, write};
use relume_tests::camera::{Card, plugin};

use super::capture::{Capture, refuse, tool};
use super::cli::{succeed, text};

/// Five fixed lamps on a network that nobody listens on: nothing but the camera matters here.
const RIG: &str = r#"
version = 1
name = "Test stage"
kind = "stage"
[stage.lamps]
layout = "list"
directions = [[0, 0, 1], [0.6, 0, 0.8], [-0.6, 0, 0.8], [0, 0.6, 0.8], [0, -0.6, 0.8]]
[camera]
times_s = [0.01, 0.1]
limits_s = [0.0001, 30.0]
f_number = 8.0
patience_s = 2
megabytes = 0.1
response = "srgb"
[devices]
CAMERA
lamps = { driver = "art-net", host = "127.0.0.1", settle_s = 0.0 }
watchdog_s = 0
"#;
/// Steps of [`RIG`]: black and the lamps.
const STEPS: usize = 6;
const GPHOTO2: &str = r#"camera = { driver = "gphoto2" }"#;
/// Longer than any JPEG here.
const LENGTH: usize = 20_000;

fn rig(camera: &str) -> String {
    RIG.replace("CAMERA", camera)
}

/// A picture in grey.
fn jpeg(grey: f32) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.jpg");
    let picture = Image::from_fn(48, 32, |x, y| [grey, grey * x as f32 / 48.0, grey * y as f32 / 32.0]);
    write(&path, &picture, EncodeOptions::default()).unwrap();
    fs::read(path).unwrap()
}

/// The file of a photograph's frame.
fn bytes(set: &Capture, frame: &serde_json::Value) -> Vec<u8> {
    fs::read(set.path("s").join(frame["file"].as_str().unwrap())).unwrap()
}

/// With photographs of their own at both times.
fn card(set: &Capture) -> Option<Card> {
    let card = Card::new(set.folder.path(), LENGTH)?;
    card.offer(&jpeg(0.3));
    card.offer_at(0.01, &jpeg(0.1));
    card.offer_at(0.1, &jpeg(0.9));
    Some(card)
}

#[test]
fn photographs_come_through_ptp_as_the_camera_made_them() {
    let set = Capture::with(&rig(GPHOTO2));
    let Some(card) = card(&set) else { return };
    let said = succeed(card.plug_in(&mut set.begin("s", &[])));
    assert!(said.contains(&format!("{STEPS} of {STEPS} photographs")), "{said}");
    let journal = set.journal("s");
    assert_eq!(journal.len(), STEPS);
    let mut frames = 0;
    for frame in journal.iter().flat_map(|photograph| photograph["frames"].as_array().unwrap()) {
        // The camera took the time it was set to: the picture differs.
        let time_s = frame["exposure"]["time_s"].as_f64().unwrap();
        let expected = card.padded(&jpeg(if time_s == 0.01 { 0.1 } else { 0.9 }));
        assert!(bytes(&set, frame) == expected, "{frame}");
        assert_eq!(frame["exposure"]["f_number"], 8.0);
        assert!(frame["exposure"]["iso"].is_null(), "this camera has none: {frame}");
        frames += 1;
    }
    assert!(frames >= 2 * (STEPS - 1));
    // As many were taken, none twice, and each was deleted.
    let log = card.log();
    let named = |what: &str| -> Vec<String> {
        let lines = log.iter().filter(|line| line.starts_with(what));
        lines.map(|line| line.split(' ').nth(1).unwrap().to_owned()).collect()
    };
    assert_eq!(named("took").len(), frames);
    assert_eq!(named("took"), named("deleted"));
    assert!(log.contains(&"set f 800".to_owned()) && log.contains(&"set time 1000".to_owned()), "{log:?}");
}

#[test]
fn settings_that_a_camera_does_not_have_are_refused_by_what_it_reads_back() {
    let set = Capture::with(&rig(GPHOTO2).replace("[0.01, 0.1]", "[0.01, 8.0]"));
    let Some(card) = card(&set) else { return };
    refuse(card.plug_in(&mut set.begin("s", &[])), &["set to 8 s", "reads back 1 s", "manual mode", "--resume"]);
    // An aperture that it has not.
    let set = Capture::with(&rig(GPHOTO2).replace("f_number = 8.0", "f_number = 1.4"));
    refuse(card.plug_in(&mut set.begin("s", &[])), &["f/1.4", "reads back", "f/2.8"]);
    // A format, where there is none to set.
    let set = Capture::with(&rig(r#"camera = { driver = "gphoto2", format = "RAW" }"#));
    refuse(card.plug_in(&mut set.begin("s", &[])), &["no image format to set", "leave format out"]);
    let set = Capture::with(&rig(r#"camera = { driver = "gphoto2", model = "Canon" }"#));
    refuse(card.plug_in(&mut set.begin("s", &[])), &["no camera \"Canon\" is connected", "Nikon DSC D750"]);
}

#[test]
fn a_full_card_ends_a_capture_which_resumes() {
    let set = Capture::with(&rig(GPHOTO2));
    let Some(card) = card(&set) else { return };
    let words = ["the card of the Nikon DSC D750", "is full", "empty it", "--resume"];
    refuse(card.plug_in(&mut set.begin("s", &[])).env("VCAMERALIMIT", "5"), &words);
    let before = set.journal("s").len();
    assert!((1..STEPS).contains(&before), "{before}");
    let said = succeed(card.plug_in(&mut set.resume("s", &[])));
    assert!(said.contains(&format!("{STEPS} of {STEPS} photographs")), "{said}");
    assert_eq!(set.journal("s").len(), STEPS);
}

#[test]
fn photographs_stay_on_the_card_where_that_is_asked_for() {
    let set = Capture::with(&rig(r#"camera = { driver = "gphoto2", keep_on_card = true }"#));
    let Some(card) = card(&set) else { return };
    // This camera has no card to choose, and says so by what it reads back; or it has one, and keeps the photographs.
    let output = card.plug_in(&mut set.begin("s", &["--max-photos", "2"])).output().unwrap();
    let said = text(&output.stderr);
    assert!(output.status.success() || said.contains("reads back \"Internal RAM\""), "{said}");
    assert!(!card.log().iter().any(|line| line.starts_with("deleted")));
}

#[test]
fn devices_are_listed_with_what_they_can_do() {
    let set = Capture::with(&rig(GPHOTO2));
    let Some(card) = card(&set) else { return };
    let said = succeed(card.plug_in(&mut tool("devices")));
    for words in [
        "Nikon DSC D750, port usb:001,001",
        "1/8000 s to 1 s",
        "no ISO to set",
        "f/2.8 to f/22",
        "battery 50 %",
        "MB free",
    ] {
        assert!(said.contains(words), "{words}: {said}");
    }
    // No plug-in at all: no camera.
    let empty = tempfile::tempdir().unwrap();
    assert!(plugin().is_some());
    let said = succeed(tool("devices").env("IOLIBS", empty.path()));
    assert!(said.contains("none is connected") || said.contains("camera over USB"), "{said}");
    let mut alone = set.begin("t", &[]);
    refuse(alone.env("IOLIBS", empty.path()), &["camera"]);
}

/// A rig whose camera is the folder `inbox`, triggered by a script.
fn with_folder(script: &str, more: &str) -> Capture {
    let set = Capture::new();
    let root = set.folder.path().display().to_string();
    fs::create_dir(set.path("inbox")).unwrap();
    fs::write(set.path("bright.jpg"), jpeg(0.9)).unwrap();
    fs::write(set.path("dark.jpg"), jpeg(0.1)).unwrap();
    fs::write(set.path("snap.sh"), script).unwrap();
    let trigger = format!("[\"sh\", \"{root}/snap.sh\", \"{root}\", \"{{time_s}}\"]");
    let camera =
        format!("camera = {{ driver = \"folder\", path = \"inbox\", trigger = {trigger}, within_s = 2{more} }}");
    fs::write(set.path("rig.toml"), rig(&camera).replace("[0.01, 0.1]", "[0.1]")).unwrap();
    set
}

/// Counts in a file, and puts a picture into the folder.
const SNAP: &str = r#"
cd "$1"; n=$(cat n 2>/dev/null || echo 0); n=$((n + 1)); echo $n > n
case $n in 3) [ -e healed ] || { touch healed; echo "no battery" >&2; exit 7; };; esac
cp bright.jpg inbox/.writing; mv inbox/.writing inbox/$n.jpg; cp dark.jpg inbox/$n.txt
"#;

#[cfg(unix)]
#[test]
fn a_folder_is_a_camera() {
    for more in ["", ", poll_s = 0.05"] {
        let set = with_folder(SNAP, more);
        let said = refuse(&mut set.begin("s", &[]), &["exit status: 7", "no battery", "--resume"]);
        assert_eq!(said.lines().count(), 1, "{said}");
        let before = set.journal("s").len();
        assert_eq!(before, 2, "{more}");
        succeed(&mut set.resume("s", &[]));
        let journal = set.journal("s");
        assert_eq!(journal.len(), STEPS);
        for frame in journal.iter().flat_map(|photograph| photograph["frames"].as_array().unwrap()) {
            assert!(bytes(&set, frame) == jpeg(0.9), "{frame}");
        }
    }
}

/// A JPEG whose EXIF data say how long it was exposed.
fn exposed_jpeg(time: (u32, u32)) -> Vec<u8> {
    let entry = |tag: u16, kind: u16, value: u32| {
        [&tag.to_le_bytes()[..], &kind.to_le_bytes(), &1u32.to_le_bytes(), &value.to_le_bytes()].concat()
    };
    let mut exif = b"Exif\0\0II*\0\x08\0\0\0\x01\0".to_vec();
    exif.extend(entry(0x8769, 4, 26));
    exif.extend([0; 4]);
    exif.extend(1u16.to_le_bytes());
    exif.extend(entry(0x829a, 5, 44));
    exif.extend([0; 4]);
    exif.extend([time.0.to_le_bytes(), time.1.to_le_bytes()].concat());
    let plain = jpeg(0.5);
    let mut bytes = plain[..2].to_vec();
    bytes.extend([0xff, 0xe1]);
    bytes.extend((exif.len() as u16 + 2).to_be_bytes());
    bytes.extend(exif);
    bytes.extend(&plain[2..]);
    bytes
}

#[cfg(unix)]
#[test]
fn a_file_that_was_exposed_otherwise_ends_a_capture() {
    let set = with_folder(SNAP, "");
    fs::write(set.path("bright.jpg"), exposed_jpeg((1, 10))).unwrap();
    succeed(&mut set.begin("s", &["--max-photos", "2"]));
    fs::write(set.path("bright.jpg"), exposed_jpeg((1, 60))).unwrap();
    fs::write(set.path("healed"), "").unwrap();
    refuse(&mut set.resume("s", &[]), &["its file says 1/60 s", "--resume"]);
    assert_eq!(set.journal("s").len(), 2);
    fs::write(set.path("bright.jpg"), exposed_jpeg((1, 10))).unwrap();
    succeed(&mut set.resume("s", &[]));
    assert_eq!(set.journal("s").len(), STEPS);
}

/// The library is of the system; where it is missing the tool says what to install.
#[test]
fn cameras_are_looked_for_without_any_library_too() {
    let nowhere = Path::new("/nonexistent");
    let output = Command::new(relume_tests::relume()).arg("devices").env("IOLIBS", nowhere).output().unwrap();
    assert!(output.status.success(), "{}", text(&output.stderr));
    assert!(text(&output.stdout).contains("camera"), "{}", text(&output.stdout));
}
