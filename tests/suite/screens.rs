//! Screens from outside: the built tool before servers without a screen, whose pixels are looked at without the tool's help: Xvfb keeps them in a
//! file, and `xwd` reads those of Xorg.

use std::fs;
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use relume_core::domain::patterns::{Kind, Noise, PatternSet};
use relume_core::domain::{Bits, Emitter, EmitterCurve, Plane};
use relume_core::field::{Access, Asset};
use relume_core::image::{read_codes, write_grey};
use relume_core::wavelet::Wavelet;
use relume_tests::{relume, skipped};

use super::capture::{Capture, refuse, tool};
use super::cli::succeed;

/// A screen before the bodies of the virtual monitor.
const RIG: &str = r#"
version = 1
name = "Test screen"
kind = "monitor"
[monitor]
columns = 32
rows = 32
noise = 64
[camera]
limits_s = [0.02, 30.0]
times_s = [0.1]
megabytes = 0.1
response = "linear"
[virtual]
width = 80
height = 60
samples = 16
seed = 1
irradiance = 1500.0
[virtual.sensor]
full_well_e = 30000
read_e = 6
bits = 12
dark = 0.006
"#;

/// Each pixel's codes.
type Pixels = Vec<[u32; 3]>;

/// A server, and a folder for it.
struct Server {
    child: Child,
    display: String,
    folder: tempfile::TempDir,
}

impl Server {
    /// Xvfb with a screen such as "640x480x24"; none, and that is said, where it is not installed.
    fn xvfb(screen: &str) -> Option<Self> {
        let folder = tempfile::tempdir().unwrap();
        let mut command = Command::new("Xvfb");
        command.args(["-nolisten", "tcp", "-noreset", "-screen", "0", screen, "-fbdir"]).arg(folder.path());
        Self::start(command, folder)
    }

    /// Xorg without a card, with two monitors; it wants root.
    fn two_monitors() -> Option<Self> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("xorg.conf");
        fs::write(&path, TWO_MONITORS).unwrap();
        let mut command = Command::new("Xorg");
        command.args(["-nolisten", "tcp", "-noreset", "-novtswitch", "-sharevts", "-config"]).arg(&path);
        command.arg("-logfile").arg(folder.path().join("log"));
        let server = Self::start(command, folder)?;
        let set =
            |words: &str| server.client("xrandr").args(words.split(' ')).output().is_ok_and(|o| o.status.success());
        let two = set("--addmode DUMMY1 320x240") && set("--output DUMMY1 --mode 320x240 --right-of DUMMY0");
        if !two {
            skipped("xrandr, or a second monitor of Xorg's dummy driver,");
        }
        two.then_some(server)
    }

    fn start(mut command: Command, folder: tempfile::TempDir) -> Option<Self> {
        command.args(["-displayfd", "1"]).stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::null());
        let program = command.get_program().to_string_lossy().into_owned();
        let Ok(mut child) = command.spawn() else {
            skipped(&program);
            return None;
        };
        let mut number = String::new();
        BufReader::new(child.stdout.take().unwrap()).read_line(&mut number).unwrap();
        let Ok(number) = number.trim().parse::<u32>() else {
            let _ = (child.kill(), child.wait());
            skipped(&format!("a {program} that starts here"));
            return None;
        };
        Some(Self { child, display: format!(":{number}"), folder })
    }

    /// A program that uses it.
    fn client(&self, program: impl AsRef<std::ffi::OsStr>) -> Command {
        let mut command = Command::new(program);
        command.env("DISPLAY", &self.display).env_remove("WAYLAND_DISPLAY");
        command
    }

    /// The screen as Xvfb keeps it: its size, and pixels.
    fn screen(&self) -> ((usize, usize), Pixels) {
        xwd(&fs::read(self.folder.path().join("Xvfb_screen0")).unwrap())
    }

    /// `relume show`, until it is dropped.
    fn show(&self, words: &str) -> Shown {
        let mut command = self.client(relume());
        command.arg("show").args(words.split(' ')).current_dir(self.folder.path());
        let child = command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        Shown(child)
    }

    /// Waits until the screen is as expected.
    fn expect(&self, expected: &Pixels, what: &str) {
        let begun = Instant::now();
        while self.screen().1 != *expected {
            assert!(begun.elapsed() < Duration::from_secs(20), "{what} is not on the screen");
            sleep(Duration::from_millis(20));
        }
    }

    /// Waits until the screen is black, but for the server's own cursor: over pictures there is none.
    fn expect_nothing(&self) {
        let begun = Instant::now();
        while self.screen().1.iter().filter(|pixel| **pixel != [0; 3]).count() > 100 {
            assert!(begun.elapsed() < Duration::from_secs(20), "something stays on the screen");
            sleep(Duration::from_millis(20));
        }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// A chart as `--to` writes it.
    fn written(&self, chart: &str, (width, height): (usize, usize)) -> Pixels {
        let (to, size) = (self.path("chart.png"), format!("{width}x{height}"));
        succeed(tool("show").arg(chart).arg("--to").arg(&to).args(["--size", &size]));
        let (codes, _) = read_codes(&to).unwrap();
        assert_eq!(codes.size(), (width, height));
        codes.data().chunks_exact(3).map(|p| [0, 1, 2].map(|c| (p[c] * 255.0).round() as u32)).collect()
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        let _ = (self.child.kill(), self.child.wait());
    }
}

/// A tool that shows something.
struct Shown(Child);

impl Shown {
    /// Enter.
    fn enter(mut self) -> String {
        self.0.stdin.take().unwrap().write_all(b"\n").unwrap();
        let mut said = String::new();
        std::io::Read::read_to_string(&mut self.0.stdout.take().unwrap(), &mut said).unwrap();
        assert!(self.0.wait().unwrap().success());
        said
    }
}

impl Drop for Shown {
    fn drop(&mut self) {
        let _ = (self.0.kill(), self.0.wait());
    }
}

const TWO_MONITORS: &str = r#"
Section "ServerFlags"
  Option "AutoAddDevices" "false"
  Option "DontVTSwitch" "true"
EndSection
Section "Device"
  Identifier "card"
  Driver "dummy"
  VideoRam 16000
EndSection
Section "Monitor"
  Identifier "monitor"
  HorizSync 5-1000
  VertRefresh 5-200
EndSection
Section "Screen"
  Identifier "screen"
  Device "card"
  Monitor "monitor"
  DefaultDepth 24
  SubSection "Display"
    Depth 24
    Modes "640x480"
    Virtual 960 480
  EndSubSection
EndSection
"#;

/// A dump of a window (X11's XWDFile.h): 25 words, most significant byte first, its name, its colours, its pixels.
fn xwd(bytes: &[u8]) -> ((usize, usize), Pixels) {
    let word = |n: usize| u32::from_be_bytes(bytes[4 * n..4 * n + 4].try_into().unwrap()) as usize;
    let (width, height, row, start) = (word(4), word(5), word(12), word(0) + 12 * word(19));
    assert_eq!((word(11), word(7)), (32, 0), "32 bits a pixel, the least significant byte first");
    let masks = [14, 15, 16].map(|n| word(n) as u32);
    let pixel = |at: usize| {
        let from = start + at / width * row + at % width * 4;
        let pixel = u32::from_le_bytes(bytes[from..from + 4].try_into().unwrap());
        masks.map(|mask| (pixel & mask) >> mask.trailing_zeros())
    };
    ((width, height), (0..width * height).map(pixel).collect())
}

/// Texels of `side` pixels in the middle of a screen.
fn laid((width, height): (usize, usize), texels: (usize, usize), side: usize, texel: impl Fn(usize) -> u32) -> Pixels {
    let corner = ((width - texels.0 * side) / 2, (height - texels.1 * side) / 2);
    let pixel = |at: usize| {
        let (x, y) = ((at % width).checked_sub(corner.0)?, (at / width).checked_sub(corner.1)?);
        let (x, y) = (x / side, y / side);
        (x < texels.0 && y < texels.1).then(|| [texel(y * texels.0 + x); 3])
    };
    (0..width * height).map(|at| pixel(at).unwrap_or_default()).collect()
}

fn with_screen(screen: &str) -> String {
    format!("{RIG}\n[devices]\ncamera = {{ driver = \"virtual\" }}\nscreen = {{ {screen} }}\n")
}

#[test]
fn a_rehearsal_before_a_server_makes_the_field_of_the_virtual_rig() {
    let Some(server) = Server::xvfb("150x100x24") else { return };
    let real =
        Capture::with(&with_screen(&format!("driver = \"x11\", display = \"{}\", settle_s = 0.0", server.display)));
    let begun = |set: &Capture| {
        succeed(&mut set.begin("s", &[]));
        succeed(tool("pack").arg(set.path("s")).arg("-o").arg(set.path("a.rfield")).args(["--terms", "16"]));
        let frames: Vec<_> = set.journal("s").iter().map(|photograph| photograph["frames"].clone()).collect();
        let asset = Asset::open(&set.path("a.rfield"), Access::Read).unwrap();
        (frames, asset.manifest().blake3.clone())
    };
    let (virtual_frames, virtual_field) = begun(&Capture::with(RIG));
    let (frames, field) = begun(&real);
    assert_eq!(frames.len(), 66, "black, white and 64 patterns");
    assert_eq!((frames, field), (virtual_frames, virtual_field), "the same bytes");
    server.expect_nothing();

    // Smaller than the patterns; no such output; no such server.
    let refused = |screen: &str, words: &[&str]| {
        let set = Capture::with(&with_screen(screen));
        refuse(&mut set.begin("s", &[]), words);
        assert!(!set.path("s").exists(), "no session");
    };
    let display = format!("display = \"{}\"", server.display);
    refused(&format!("driver = \"x11\", {display}, texel_px = 4"), &["150 x 100", "128 x 128", "texel_px"]);
    refused(&format!("driver = \"x11\", {display}, output = \"HDMI\""), &["\"HDMI\"", "\"screen\""]);
    refused(&format!("driver = \"x11\", {display}, bits = 10"), &["depth 24", "DefaultDepth 30"]);
    refused("driver = \"x11\", display = \":9999\"", &[":9999", "cannot be reached"]);
}

#[test]
fn what_is_shown_is_what_was_asked_for_pixel_by_pixel() {
    let Some(server) = Server::xvfb("240x180x24") else { return };
    let size = (240, 180);
    write_grey(&server.path("small.png"), (3, 2), &[0, 50, 100, 150, 200, 250], true).unwrap();
    let small = laid(size, (3, 2), 80, |at| [0, 50, 100, 150, 200, 250][at]);
    for driver in ["x11", "window"] {
        let grid = server.written("grid:17", size);
        assert_eq!((grid[2 * 240 + 2], grid[2 * 240 + 237]), ([255, 0, 0], [0, 255, 0]), "red left, green right");
        let shown = server.show(&format!("grid:17 --driver {driver}"));
        server.expect(&grid, &format!("grid, {driver}"));
        assert!(shown.enter().contains("240 x 180"));
        let _shown = server.show(&format!("small.png --driver {driver}"));
        server.expect(&small, &format!("a picture, {driver}"));
    }
    server.expect_nothing();
    fs::write(server.path("rig.toml"), with_screen("driver = \"x11\", texel_px = 5")).unwrap();
    let _shown = server.show("noise:12 --rig rig.toml");
    server.expect(&noise(size, 11, Bits::Eight), "noise 12");
}

#[test]
fn ten_bits_reach_a_server_that_has_them() {
    let Some(server) = Server::xvfb("200x180x30") else { return };
    fs::write(server.path("rig.toml"), with_screen("driver = \"x11\", texel_px = 5, bits = 10")).unwrap();
    let _shown = server.show("noise:3 --rig rig.toml");
    server.expect(&noise((200, 180), 2, Bits::Ten), "noise 3");
}

/// A pattern of [`RIG`] on a screen, five pixels a texel.
fn noise(size: (usize, usize), number: usize, bits: Bits) -> Pixels {
    let noise = Noise { wavelet: Wavelet::Haar, count: 64, seed: 1, deviation: Noise::DEVIATION };
    let set = PatternSet::new(Kind::Noise(noise), Plane::new(32, 32).unwrap()).unwrap();
    let codes = set.pattern(number).codes(&Emitter::new(&EmitterCurve::Srgb, bits));
    laid(size, (32, 32), 5, |at| codes[at].into())
}

#[test]
fn the_second_of_two_monitors_alone_shows_it_with_and_without_a_window_manager() {
    let Some(server) = Server::two_monitors() else { return };
    let dump = |server: &Server| {
        let dumped = server.client("xwd").arg("-root").output().ok().filter(|output| output.status.success());
        dumped.map(|output| xwd(&output.stdout))
    };
    let Some((screen, _)) = dump(&server) else { return skipped("xwd") };
    assert_eq!(screen, (960, 480));
    let chart = server.written("grid", (320, 240));
    let right = |pixels: &Pixels| -> (Pixels, bool) {
        let inside = |at: &usize| at % 960 >= 640 && at / 960 < 240;
        let part = (0..960 * 480).filter(inside).map(|at| pixels[at]).collect();
        (part, (0..960 * 480).filter(|at| !inside(at)).all(|at| pixels[at] == [0; 3]))
    };
    refuse(server.client(relume()).args(["show", "grid", "--driver", "x11"]), &["2 outputs", "\"DUMMY0\", \"DUMMY1\""]);
    let mut manager: Option<Shown> = None;
    for round in 0..2 {
        for driver in ["x11", "window"] {
            let _shown = server.show(&format!("grid --output DUMMY1 --driver {driver}"));
            let begun = Instant::now();
            while dump(&server).map(|(_, pixels)| right(&pixels)) != Some((chart.clone(), true)) {
                assert!(begun.elapsed() < Duration::from_secs(20), "{driver}, round {round}");
                sleep(Duration::from_millis(30));
            }
        }
        if manager.is_none() {
            let started = server.client("openbox").stdout(Stdio::null()).stderr(Stdio::null()).spawn();
            let Ok(started) = started else { return skipped("openbox") };
            manager = Some(Shown(started));
            sleep(Duration::from_millis(300));
        }
    }
}

#[test]
fn without_a_server_it_is_said_what_to_do() {
    let show = |driver: &str| {
        let mut command = tool("show");
        command.args(["grid", "--driver", driver]).env_remove("DISPLAY").env_remove("WAYLAND_DISPLAY");
        command.env_remove("WAYLAND_SOCKET");
        command
    };
    if cfg!(target_os = "linux") {
        refuse(&mut show("x11"), &["DISPLAY is not set"]);
        refuse(&mut show("window"), &["no window can be opened"]);
    }
    let missing = Path::new("no rig.toml");
    refuse(tool("show").arg("noise:1").arg("--rig").arg(missing), &["no rig.toml"]);
    refuse(tool("show").args(["noise:1", "--to", "a.png"]), &["--rig"]);
}
