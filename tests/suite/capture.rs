//! Capturing from outside: the virtual stage, bad days, `kill -9`, and what is left on disk.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg32;
use relume_tests::{relume, target_dir};
use serde_json::Value;

use super::cli::{run, succeed, text};

/// A stage of 4 lamps at 6 stops, in the camera's smallest pictures.
pub(crate) const RIG: &str = r#"
version = 1
name = "Test stage"
kind = "stage"
[stage]
all_lit = true
reference_every = 6
[stage.lamps]
layout = "arc"
latitudes = 4
longitudes = 6
[camera]
times_s = [0.05, 0.4]
limits_s = [0.00025, 30.0]
megabytes = 0.01
patience_s = 0.2
[calibration]
dark_times_s = [0.001, 0.256, 1.024]
[virtual]
width = 40
height = 30
samples = 4
irradiance = 800.0
spread = 0.1
drift = -0.03
ambient = 1e-4
[virtual.sensor]
full_well_e = 30000
read_e = 6
bits = 12
dark = 0.006
"#;
/// Steps of [`RIG`]: the black series, six stops of black, all lit and 4 lamps, and five references.
const STEPS: usize = 1 + 6 * 6 + 5;

pub(crate) struct Capture {
    pub(crate) folder: tempfile::TempDir,
}

impl Capture {
    pub(crate) fn new() -> Self {
        Self::with(RIG)
    }

    pub(crate) fn with(rig: &str) -> Self {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("rig.toml"), rig).unwrap();
        Self { folder }
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// `relume capture rig.toml --session NAME`.
    pub(crate) fn begin(&self, session: &str, options: &[&str]) -> Command {
        let mut command = tool("capture");
        command.arg(self.path("rig.toml")).arg("--session").arg(self.path(session)).args(options);
        command
    }

    /// `relume capture --session NAME --resume`.
    pub(crate) fn resume(&self, session: &str, options: &[&str]) -> Command {
        let mut command = tool("capture");
        command.arg("--session").arg(self.path(session)).arg("--resume").args(options);
        command
    }

    /// The photographs of a session's journal.
    pub(crate) fn journal(&self, session: &str) -> Vec<Value> {
        let text = fs::read_to_string(self.path(session).join("journal.jsonl")).unwrap();
        let lines = text.lines().map(|line| serde_json::from_str::<Value>(line).unwrap());
        lines.filter_map(|mut line| Some(line.get_mut("photograph")?.take())).collect()
    }
}

/// The built tool, its traced scenes kept between tests.
pub(crate) fn tool(subcommand: &str) -> Command {
    let mut command = Command::new(relume());
    command.arg(subcommand).env("RELUME_CACHE", target_dir().join("tmp").join("relume-cache"));
    command
}

/// Runs; expects exit code 1 and all words in the message.
pub(crate) fn refuse(command: &mut Command, words: &[&str]) -> String {
    let output = run(command);
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{command:?}: {said}");
    words.iter().for_each(|word| assert!(said.contains(word), "{command:?}: `{word}` is not in: {said}"));
    said
}

fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<String> =
        fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

#[test]
fn a_plan_starts_nothing() {
    let set = Capture::new();
    let said = succeed(&mut set.begin("s", &["--plan"]));
    for words in
        ["24  samples", &format!("{STEPS}  photographs in all"), "85 exposures", "ok       disk", "virtual scene"]
    {
        assert!(said.contains(words), "{words}: {said}");
    }
    assert_eq!(names(set.folder.path()), ["rig.toml"]);
}

#[test]
fn a_capture_is_in_order_and_whole() {
    let set = Capture::new();
    let said = succeed(&mut set.begin("s", &[]));
    assert!(said.contains(&format!("{STEPS} of {STEPS} photographs")) && said.contains("relume pack"), "{said}");
    let journal = set.journal("s");
    assert_eq!(journal.len(), STEPS);
    for (n, photograph) in journal.iter().enumerate() {
        assert_eq!((photograph["number"].as_u64(), photograph["step"].as_u64()), (Some(n as u64 + 1), Some(n as u64)));
        for frame in photograph["frames"].as_array().unwrap() {
            let bytes = fs::read(set.path("s").join(frame["file"].as_str().unwrap())).unwrap();
            assert_eq!(frame["blake3"], blake3::hash(&bytes).to_hex().to_string());
        }
    }
    assert_eq!(names(&set.path("s").join("contact-sheets")), ["0001.png"]);
    assert!(fs::read_to_string(set.path("s").join("capture.log")).unwrap().contains("lamp 24, 1/20 s 0.4 s"));
    refuse(&mut set.begin("s", &[]), &["not empty", "add --resume"]);
    assert!(succeed(&mut set.resume("s", &[])).contains("(0 taken now)"));
}

#[test]
fn limits_end_a_run_and_resuming_goes_on() {
    let set = Capture::new();
    let said = succeed(&mut set.begin("s", &["--max-photos", "5"]));
    assert!(said.contains(&format!("5 of {STEPS}")) && said.contains("--resume"), "{said}");
    assert_eq!(set.journal("s").len(), 5);
    assert!(succeed(&mut set.resume("s", &["--max-time", "1h", "--max-photos", "7"])).contains("(7 taken now)"));
    assert!(succeed(&mut set.resume("s", &[])).contains(&format!("{STEPS} of {STEPS}")));
    // Calibration alone, in a session of its own.
    succeed(&mut set.begin("c", &["--only", "calibration"]));
    assert_eq!(set.journal("c").len(), 1);
}

#[test]
fn photographs_are_taken_again() {
    let set = Capture::new();
    succeed(&mut set.begin("s", &[]));
    succeed(&mut set.resume("s", &["--redo", "5,8-9"]));
    let journal = set.journal("s");
    assert_eq!(journal.len(), STEPS + 3);
    let redone: Vec<u64> = journal[STEPS..].iter().map(|p| p["redo_of"].as_u64().unwrap()).collect();
    assert_eq!(redone, [5, 8, 9]);
    assert_eq!(journal[STEPS]["condition"], journal[4]["condition"]);
    refuse(&mut set.resume("s", &["--redo", "99"]), &["number 99", "1 to 45"]);
    // A file that rotted is photographed again unasked.
    let file = set.path("s").join(journal[20]["frames"][0]["file"].as_str().unwrap());
    fs::write(&file, "rot").unwrap();
    let output = run(&mut set.resume("s", &[]));
    assert!(text(&output.stderr).contains("not as they were stored (21)"), "{}", text(&output.stderr));
    assert_eq!(set.journal("s").last().unwrap()["redo_of"], 21);
}

#[test]
fn bad_days_end_with_a_sentence_and_resume() {
    for (fault, words) in [
        ("unplug@9", &["the camera does not answer", "check its cable", "are safe", "--resume"][..]),
        ("silent-lamp@7", &["lamp 7 does not answer", "fuse", "--resume"]),
        ("misread@6", &["reads back", "manual mode", "--resume"]),
        ("stuck@4", &["the camera is busy, for 0.2 seconds", "--resume"]),
        ("full-disk@11", &["cannot write", "--resume"]),
    ] {
        let set = Capture::new();
        let said = refuse(&mut set.begin("s", &["--rehearse", fault]), words);
        assert_eq!(said.lines().count(), 1, "one sentence: {said}");
        let (taken, photos) = (set.journal("s").len(), names(&set.path("s").join("photos")));
        assert!(taken > 0 && taken < STEPS && photos.len() == taken, "{fault}: {taken}, {photos:?}");
        assert!(succeed(&mut set.resume("s", &[])).contains(&format!("{STEPS} of {STEPS}")), "{fault}");
        assert_eq!(set.journal("s").len(), STEPS, "{fault}");
    }
}

#[test]
fn passing_trouble_is_waited_for_and_written_down() {
    let set = Capture::new();
    let output = run(&mut set.begin("s", &["--rehearse", "busy@5", "--rehearse", "clock@9"]));
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let log = fs::read_to_string(set.path("s").join("capture.log")).unwrap();
    assert!(log.contains("a device was busy 3 times"), "{log}");
    assert!(text(&output.stderr).contains("clock was put back by 86400 s"), "{}", text(&output.stderr));
    assert_eq!(set.journal("s").len(), STEPS);
}

#[test]
fn a_camera_that_is_not_there_starts_nothing() {
    let set = Capture::new();
    refuse(&mut set.begin("s", &["--rehearse", "unplug@1"]), &["the camera does not answer", "nothing was started"]);
    assert_eq!(names(set.folder.path()), ["rig.toml"]);
}

#[test]
fn bad_usage_is_refused() {
    let set = Capture::new();
    for options in [
        &["--rehearse", "rain@3"][..],
        &["--max-time", "soon"],
        &["--max-photos", "0"],
        &["--redo", "3"],
        &["--only", "lunch"],
    ] {
        assert_eq!(run(&mut set.begin("s", options)).status.code(), Some(2), "{options:?}");
    }
    refuse(&mut set.resume("absent", &[]), &["absent", "session folder"]);
    refuse(tool("capture").arg("--session").arg(set.path("s")), &["no rig file"]);
    for (from, to, words) in [
        ("latitudes", "lattitudes", &["rig.toml", "lattitudes"][..]),
        ("latitudes = 4", "latitudes = 0", &["0 lamps"]),
        ("bits = 12", "bits = 60", &["bits", "60"]),
        ("times_s = [0.05, 0.4]", "times_s = [0.4, 0.05]", &["times_s", "short ones first"]),
        ("times_s = [0.05, 0.4]", "times_s = [90]", &["times_s", "limits_s"]),
        ("kind = \"stage\"", "kind = \"tent\"", &["tent"]),
        ("version = 1", "version = 7", &["version = 7"]),
        ("irradiance = 800.0", "irradiance = nan", &["irradiance"]),
        ("\"arc\"", "\"file\"\nfile = \"absent.lp\"", &["rig.toml"]),
        ("width = 40", "", &["rig.toml", "width"]),
        ("version = 1", "version = ", &["rig.toml, line 2"]),
    ] {
        let bad = Capture::with(&RIG.replacen(from, to, 1));
        refuse(&mut bad.begin("s", &[]), words);
        assert_eq!(names(bad.folder.path()), ["rig.toml"], "{to}");
    }
    succeed(&mut set.begin("s", &["--max-photos", "1"]));
    fs::write(set.path("other.toml"), RIG.replace("0.4]", "0.5]")).unwrap();
    let mut other = tool("capture");
    other.arg(set.path("other.toml")).arg("--session").arg(set.path("s")).arg("--resume");
    refuse(&mut other, &["not the rig"]);
}

/// Starts a capture that takes its time.
fn slow(set: &Capture, session: &str) -> Child {
    let mut command = set.begin(session, &["--rehearse", "slow@1"]);
    command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap()
}

/// Waits until a session has a photograph.
fn wait_for_photograph(set: &Capture, session: &str) {
    let begun = Instant::now();
    let journal = set.path(session).join("journal.jsonl");
    while fs::metadata(&journal).map_or(0, |m| m.len()) == 0 {
        assert!(begun.elapsed() < Duration::from_secs(60), "no photograph in a minute");
        std::thread::sleep(Duration::from_millis(1));
    }
}

#[test]
fn a_second_process_is_refused_with_the_first_ones_id() {
    let set = Capture::new();
    let mut first = slow(&set, "s");
    wait_for_photograph(&set, "s");
    refuse(&mut set.resume("s", &[]), &[&format!("process {} (started 20", first.id())]);
    first.kill().unwrap();
    first.wait().unwrap();
    succeed(&mut set.resume("s", &[]));
}

#[cfg(unix)]
#[test]
fn ctrl_c_finishes_the_photograph_and_says_how_to_go_on() {
    let set = Capture::new();
    let child = slow(&set, "s");
    wait_for_photograph(&set, "s");
    succeed(Command::new("kill").args(["-INT", &child.id().to_string()]));
    let output = child.wait_with_output().unwrap();
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(130), "{said}");
    assert!(said.contains("--resume"), "{said}");
    assert_eq!(names(&set.path("s").join("photos")).len(), set.journal("s").len());
    succeed(&mut set.resume("s", &[]));
    assert_eq!(set.journal("s").len(), STEPS);
}

/// Journals without what depends on the hour.
fn timeless(journal: Vec<Value>) -> Vec<Value> {
    let strip = |mut photograph: Value| {
        let fields = photograph.as_object_mut().unwrap();
        ["time", "seconds"].iter().for_each(|key| drop(fields.remove(*key)));
        photograph
    };
    journal.into_iter().map(strip).collect()
}

/// "Done when" 2: killed sixty times, ends as if nothing had happened.
#[test]
fn sixty_kills_change_nothing() {
    // More photographs than sixty runs come to before they are killed.
    let set = Capture::with(&RIG.replace("longitudes = 6", "longitudes = 24"));
    succeed(&mut set.begin("whole", &[]));
    succeed(tool("pack").arg(set.path("whole")).arg("-o").arg(set.path("whole.rfield")));

    // How long two photographs take here and now, the start included.
    let begun = Instant::now();
    succeed(&mut set.begin("two", &["--rehearse", "slow@1", "--max-photos", "2"]));
    let two = begun.elapsed();

    let mut rng = Pcg32::seed_from_u64(60);
    let (mut in_flight, mut lines) = (0, 0);
    for n in 0..60 {
        let mut command = if set.path("s").exists() {
            set.resume("s", &["--rehearse", "slow@1"])
        } else {
            set.begin("s", &["--rehearse", "slow@1"])
        };
        let mut child = command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
        std::thread::sleep(two.mul_f64(rng.random()));
        child.kill().unwrap();
        child.wait().unwrap();
        if !set.path("s").exists() {
            continue;
        }
        // What is in the journal is there, whole, and none twice.
        let journal = whole_lines(&set.path("s"));
        assert!(journal.len() >= lines, "kill {n}: photographs were lost");
        lines = journal.len();
        for (k, photograph) in journal.iter().enumerate() {
            assert_eq!(photograph["number"].as_u64(), Some(k as u64 + 1));
            for frame in photograph["frames"].as_array().unwrap() {
                let bytes = fs::read(set.path("s").join(frame["file"].as_str().unwrap())).unwrap();
                assert_eq!(frame["blake3"], blake3::hash(&bytes).to_hex().to_string(), "kill {n}");
            }
        }
        let parts = names(&set.path("s").join("photos")).iter().filter(|name| name.ends_with(".part")).count();
        in_flight += usize::from(parts > 0);
    }
    assert!(in_flight >= 10, "only {in_flight} of 60 kills fell into the writing of a photograph");
    assert!(lines > 5, "{lines} photographs came about between the kills");
    assert!(lines < set.journal("whole").len(), "the kills were to fall before the end");
    let mut last = if set.path("s").exists() { set.resume("s", &[]) } else { set.begin("s", &[]) };
    succeed(&mut last);

    let (killed, whole) = (timeless(set.journal("s")), timeless(set.journal("whole")));
    assert_eq!(killed.len(), whole.len());
    killed.iter().zip(&whole).for_each(|(a, b)| assert_eq!(a, b));
    assert_eq!(names(&set.path("s").join("photos")), names(&set.path("whole").join("photos")));
    succeed(tool("pack").arg(set.path("s")).arg("-o").arg(set.path("s.rfield")));
    assert_eq!(manifest(&set.path("s.rfield")), manifest(&set.path("whole.rfield")));
}

/// Whole lines of a journal that may end in half a line.
fn whole_lines(session: &Path) -> Vec<Value> {
    let text = fs::read_to_string(session.join("journal.jsonl")).unwrap_or_default();
    let whole = text.rfind('\n').map_or("", |end| &text[..=end]);
    let lines = whole.lines().map(|line| serde_json::from_str::<Value>(line).unwrap());
    lines.filter_map(|mut line| Some(line.get_mut("photograph")?.take())).collect()
}

/// The manifest of a container without its provenance block; it holds the hashes of all other entries, which are checked here
/// against the bytes.
pub(crate) fn manifest(path: &Path) -> Value {
    let asset = relume_core::field::Asset::open(path, relume_core::field::Access::Read).unwrap();
    asset.verify(&mut |_, _| Ok(())).unwrap();
    let mut manifest = serde_json::to_value(asset.manifest()).unwrap();
    assert!(manifest.as_object_mut().unwrap().remove("provenance").is_some());
    manifest
}

/// "Done when" 1 in small: noisy camera, curve, unequal and fading lamps, exposures from previews, against the field without noise.
#[test]
fn a_captured_field_relights_as_the_one_without_noise() {
    let rig = RIG
        .replace("times_s = [0.05, 0.4]\n", "step_stops = 3\nresponse = \"recover\"\n")
        .replace(
            "[calibration]\n",
            "[calibration]\nresponse_times_s = [0.001, 0.001587, 0.003175, 0.00504, 0.01008, 0.016, 0.032, 0.0508, 0.1016, \
             0.1613, 0.3225, 0.512]\n",
        )
        .replace(
            "[virtual]\nwidth = 40\nheight = 30\n",
            "[calibration.white_ball]\nalbedo = 0.9\ncircle_px = [64.0, 48.0, 38.45]\nfocal_px = 246.94\n\
             [virtual]\nwidth = 128\nheight = 96\n",
        )
        .replace("dark = 0.006\n", "dark = 0.006\nresponse = \"film\"\n");
    let set = Capture::with(&rig);
    let truth = set.path("truth.rfield");
    succeed(set.begin("s", &["--truth"]).arg(&truth));
    let said = succeed(tool("pack").arg(set.path("s")).arg("-o").arg(set.path("a.rfield")));
    for words in ["black level", "response   recovered", "4 measured", "drift", "-3.", "linearity"] {
        assert!(said.contains(words), "{words}: {said}");
    }
    assert_eq!(names(&set.path("s").join("calibration")), ["irradiances.tsv", "report.txt", "response.txt"]);
    let lit = |asset: &Path, name: &str| {
        let mut relight = tool("relight");
        relight.arg(asset).args(["--lighting", "three-point", "-o"]).arg(set.path(name));
        succeed(&mut relight);
    };
    lit(&set.path("a.rfield"), "a.exr");
    lit(&truth, "truth.exr");
    let mut compare = tool("compare");
    compare.arg(set.path("a.exr")).arg(set.path("truth.exr")).arg("--json");
    let figures: Value = serde_json::from_str(&succeed(&mut compare)).unwrap();
    let error = figures["relative_l2"].as_f64().unwrap();
    assert!(error < 0.015, "relative L2 {error}");
}

#[test]
fn packing_says_what_is_missing_or_damaged() {
    let set = Capture::new();
    succeed(&mut set.begin("s", &["--max-photos", "20"]));
    let pack = |options: &[&str]| {
        let mut command = tool("pack");
        command.arg(set.path("s")).arg("-o").arg(set.path("a.rfield")).args(options);
        command
    };
    refuse(&mut pack(&[]), &["of 24 lamps", "--resume", "--partial"]);
    let output = run(&mut pack(&["--partial"]));
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    assert!(text(&output.stderr).contains("of 24 lamps are in the field"), "{}", text(&output.stderr));
    succeed(&mut set.resume("s", &[]));
    let said = run(&mut pack(&[]));
    assert!(text(&said.stderr).contains("were not measured"), "{}", text(&said.stderr));
    // With a matte; of another size it is refused.
    for (size, good) in [((40, 30), true), ((30, 40), false)] {
        let half = relume_core::image::Image::from_fn(size.0, size.1, |x, _| [if x < 20 { 1.0 } else { 0.0 }; 3]);
        let matte = set.path("matte.png");
        relume_core::image::write(&matte, &half, Default::default()).unwrap();
        let output = run(pack(&["--alpha"]).arg(&matte));
        assert_eq!(output.status.success(), good, "{}", text(&output.stderr));
    }
    assert!(manifest(&set.path("a.rfield"))["layers"]["alpha"].is_string());
    let merged = set.path("merged");
    succeed(tool("pack").arg(set.path("s")).arg("--merged").arg(&merged));
    // All but the series of dark photographs.
    assert_eq!(names(&merged).len(), STEPS - 1);
    let sample = set.journal("s").iter().find(|p| p["role"] == "sample").cloned().unwrap();
    let file = set.path("s").join(sample["frames"][0]["file"].as_str().unwrap());
    let mut bytes = fs::read(&file).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    fs::write(&file, bytes).unwrap();
    let number = sample["number"].to_string();
    refuse(&mut pack(&[]), &["other bytes than the journal's hash", &format!("--redo {number}")]);
    for absent in ["absent", "."] {
        refuse(tool("pack").arg(set.path(absent)).arg("-o").arg(set.path("b.rfield")), &["session"]);
    }
}

/// A screen of 16 x 16 texels, and a projector at two positions.
#[test]
fn screens_and_projectors_go_through_the_same_loop() {
    let (head, rest) = RIG.split_once("[stage]").unwrap();
    let rest = rest.split_once("[camera]").unwrap().1;
    let screen = "[monitor]\ncolumns = 16\nrows = 16\nnoise = 6\nsquares = 4\n";
    let projector = "[gantry]\nsquares = 4\ninfluence = 2\ndistance = 4\nview_deg = 34\n\
                     [gantry.positions]\nlayout = \"rings\"\nrings = [{ elevation_deg = 45, count = 2 }]\n";
    let rig = |kind: &str, table: &str, patterns: &str| {
        let rest = rest.replace("[calibration]\n", &format!("[calibration]\npatterns = [{patterns}]\n"));
        format!("{}{table}[camera]{rest}", head.replace("\"stage\"", &format!("\"{kind}\"")))
    };
    let with = |line: &str| projector.replace("influence = 2", line);
    // Dark, Gray codes of 4 + 4 bits with inverses, black, white, and the samples.
    for (rig, options, steps) in [
        (rig("monitor", screen, "\"gray-code\""), &[][..], 1 + 16 + 2 + 6),
        (rig("monitor", screen, ""), &["--sampler", "scan"], 1 + 2 + 16),
        (rig("gantry", projector, ""), &[], 1 + 2 * (2 + 16)),
        (rig("gantry", projector, ""), &["--sampler", "separable"], 1 + 2 * (1 + 16)),
        (
            rig("gantry", &with("influence = 2\nfilter = \"tent\"\ntexels = 2"), ""),
            &["--sampler", "separable"],
            1 + 2 * (1 + 16),
        ),
    ] {
        let set = Capture::with(&rig);
        succeed(set.begin("s", options).args(["--max-photos", "9"]));
        assert!(succeed(&mut set.resume("s", &[])).contains(&format!("{steps} of {steps}")), "{options:?}");
        succeed(tool("pack").arg(set.path("s")).arg("--merged").arg(set.path("m")));
        let mut pack = tool("pack");
        pack.arg(set.path("s")).arg("-o").arg(set.path("a.rfield"));
        match (rig.contains("[monitor]"), options) {
            (false, _) | (true, ["--sampler", "scan"]) => drop(succeed(&mut pack)),
            // Six patterns tell no 64 terms.
            (true, _) => drop(refuse(&mut pack, &["expected"])),
        }
        if options == ["--sampler", "separable"] {
            // 2 d n + 1 a position, and no white but the previews'.
            for stop in 0..2 {
                let here = |p: &&Value| {
                    let condition = &p["condition"];
                    ["black", "pattern", "white"].iter().any(|kind| condition[kind]["stop"] == stop)
                };
                let roles: Vec<&str> = set
                    .journal("s")
                    .iter()
                    .filter(here)
                    .map(|p| p["role"].as_str().unwrap().to_owned().leak() as &str)
                    .collect();
                let count = |role: &str| roles.iter().filter(|r| **r == role).count();
                assert_eq!((count("black"), count("sample"), count("all-lit")), (1, 16, 0), "{roles:?}");
            }
            refuse(&mut set.resume("s", &["--brute-force", "3"]), &["position 3", "1 to 2"]);
            let said = succeed(&mut set.resume("s", &["--brute-force", "2"]));
            assert!(said.contains(&format!("{} of {}", steps + 17, steps + 17)), "{said}");
            let last = set.journal("s").pop().unwrap();
            assert_eq!(
                (&last["condition"]["pattern"]["set"], &last["condition"]["pattern"]["stop"]),
                (&"squares".into(), &1.into())
            );
            succeed(tool("pack").arg(set.path("s")).arg("-o").arg(set.path("b.rfield")));
        }
        if rig.contains("[monitor]") {
            let picture = relume_core::image::Image::from_fn(8, 8, |x, _| [x as f32 / 8.0, 0.2, 0.1]);
            relume_core::image::write(&set.path("p.png"), &picture, Default::default()).unwrap();
            let shown = set.path("p.png").display().to_string();
            succeed(&mut set.resume("s", &["--reference", &shown]));
            // Another picture of the same name does not take the place of the first.
            let first = fs::read(set.path("p.png")).unwrap();
            let other = relume_core::image::Image::from_fn(8, 8, |_, y| [0.1, y as f32 / 8.0, 0.3]);
            relume_core::image::write(&set.path("p.png"), &other, Default::default()).unwrap();
            succeed(&mut set.resume("s", &["--reference", &shown]));
            let journal = set.journal("s");
            let names = journal[journal.len() - 2..].iter().map(|p| p["condition"]["picture"].as_str().unwrap());
            assert_eq!(names.collect::<Vec<_>>(), ["0001-p.png", "0002-p.png"]);
            assert_eq!(fs::read(set.path("s/references/0001-p.png")).unwrap(), first);
        } else {
            refuse(&mut set.resume("s", &["--sampler", "noise"]), &["begun with --sampler"]);
        }
    }
    for (line, words) in [
        ("influence = 0", "influence: found 0, expected 1 to 4"),
        ("influence = 5", "influence: found 5, expected 1 to 4"),
        ("influence = 2\nfilter = \"gaussian\"\ntexels = 4", "3 or more"),
        ("influence = 2\nfilter = \"tent\"", "texels: found 1, expected 2 or more"),
        ("influence = 2\nfilter = \"disc\"", "gaussian"),
    ] {
        refuse(&mut Capture::with(&rig("gantry", &with(line), "")).begin("s", &[]), &[words]);
    }
    let other = Capture::with(&rig("gantry", projector, ""));
    refuse(&mut other.begin("s", &["--influence", "2"]), &["--influence is for --sampler separable"]);
    refuse(&mut other.begin("s", &["--sampler", "separable", "--influence", "5"]), &["--influence", "1 to 4"]);
}

/// Every rig that ships loads, and its plan stands.
#[test]
fn every_rig_that_ships_loads() {
    let folder = relume_tests::workspace_root().join("presets").join("rigs");
    let elsewhere = tempfile::tempdir().unwrap();
    let rigs = names(&folder);
    assert!(rigs.len() >= 6, "{rigs:?}");
    let samples = |name: &str| match name {
        "virtual-stage.toml" => 320,
        "stage-devices.toml" => 288,
        "virtual-monitor.toml" | "monitor-devices.toml" => 256,
        "virtual-gantry.toml" => 24 * 144,
        "thesis-gantry-224.toml" | "thesis-gantry-56.toml" | "gantry-devices.toml" => 57344,
        "thesis-arc.toml" => 1280,
        "home-dome-49.toml" => 49,
        "full-sphere-331.toml" => 331,
        other => panic!("{other} is not known to this test"),
    };
    for rig in &rigs {
        let mut plan = tool("capture");
        plan.arg(folder.join(rig)).arg("--session").arg(elsewhere.path().join("s")).arg("--plan");
        let said = succeed(&mut plan);
        assert!(said.contains(&format!("{}  samples", samples(rig))), "{rig}: {said}");
    }
    // 2 d n photographs a position, and the black one; no white (7.5).
    for (rig, positions, sets) in [("thesis-gantry-224.toml", 224, 96), ("thesis-gantry-56.toml", 56, 192)] {
        let mut plan = tool("capture");
        plan.arg(folder.join(rig)).arg("--session").arg(elsewhere.path().join("s"));
        let said = succeed(plan.args(["--sampler", "separable", "--plan"]));
        assert!(said.contains(&format!("{}  samples", positions * sets)), "{rig}: {said}");
        assert!(
            said.contains(&format!("{positions}  black photographs")) && !said.contains("all white"),
            "{rig}: {said}"
        );
    }
}

/// Cards and charts are photographed, told apart, and a card under far lamps, which is lit evenly, changes little.
#[test]
fn cards_and_charts_are_taken_in_their_turn() {
    let rig = RIG.replace("[calibration]\n", "[calibration]\nflat_field = true\nchart = true\n");
    let set = Capture::with(&rig);
    succeed(&mut set.begin("s", &[]));
    let journal = set.journal("s");
    let roles: Vec<&str> = journal.iter().map(|p| p["role"].as_str().unwrap()).collect();
    assert_eq!((roles[0], &roles[1..25], roles[25]), ("dark", &["flat-field"; 24][..], "chart"));
    let pack = |session: &str, field: &str| {
        succeed(tool("pack").arg(set.path(session)).arg("-o").arg(set.path(field)));
    };
    pack("s", "a.rfield");
    fs::write(set.path("rig.toml"), RIG).unwrap();
    succeed(&mut set.begin("plain", &[]));
    pack("plain", "b.rfield");
    for name in ["a", "b"] {
        let mut relight = tool("relight");
        relight.arg(set.path(&format!("{name}.rfield"))).args(["--lamp", "2", "-o"]);
        succeed(relight.arg(set.path(&format!("{name}.exr"))));
    }
    let mut compare = tool("compare");
    compare.arg(set.path("a.exr")).arg(set.path("b.exr")).arg("--json");
    let figures: Value = serde_json::from_str(&succeed(&mut compare)).unwrap();
    // Other noise, and that of the smoothed card.
    let error = figures["relative_l2"].as_f64().unwrap();
    assert!(error > 0.0 && error < 0.02, "{error}");
}
