//! Our lamp drivers against a program that is not ours: `olad`, the daemon of Open Lighting Architecture (Debian's `ola`).
//!
//! ```text
//! namespace A: relume capture -- Art-Net, sACN --> (veth) --> olad, its channels over HTTP      :namespace B
//! relume capture -- frames of a DMX USB Pro --> a tap --> the simulated widget
//!                                                |-> the same bytes as "received DMX" --> olad
//! olad -- frames of a DMX USB Pro --> the simulated widget --> the photograph of the virtual stage
//! ```
//!
//! Addresses exist inside the namespaces alone. sACN's multicast does not go over loopback, hence the pair of veth.

#![cfg(target_os = "linux")]

use std::fs;
use std::io::{BufRead, BufReader, Read, Write};
use std::os::unix::fs::{PermissionsExt, symlink};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use relume_tests::{relume, skipped, target_dir};
use serde_json::Value;
use serialport::{SerialPort, TTYPort};

/// The camera's and olad's addresses, in a block for documentation (RFC 5737).
const OURS: &str = "192.0.2.1";
const THEIRS: &str = "192.0.2.2";
/// Channels of the three lamps: the first one of a widget's frame, one inside, the last one.
const CHANNELS: [usize; 3] = [1, 6, 512];
/// Long enough to be seen by who asks several times a second, on a busy machine too.
const SETTLE_S: f64 = 1.0;
/// olad, and a machine that builds beside it, take their time.
const PATIENCE: Duration = Duration::from_secs(40);

/// Ends a program when it is dropped.
struct Running(Child);

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Two network namespaces with a cable between them.
struct Cable {
    ours: String,
    theirs: String,
}

impl Cable {
    /// `None` where this user may not make them.
    fn new() -> Option<Self> {
        let id = std::process::id();
        let cable = Self { ours: format!("relume-{id}-a"), theirs: format!("relume-{id}-b") };
        let ip =
            |line: &str| Command::new("ip").args(line.split_whitespace()).output().is_ok_and(|o| o.status.success());
        let Self { ours, theirs } = &cable;
        let made = ip(&format!("netns add {ours}"))
            && ip(&format!("netns add {theirs}"))
            && ip(&format!("link add veth-a netns {ours} type veth peer name veth-b netns {theirs}"))
            && ip(&format!("-n {ours} addr add {OURS}/24 dev veth-a"))
            && ip(&format!("-n {theirs} addr add {THEIRS}/24 dev veth-b"))
            && [(ours, "lo"), (theirs, "lo"), (ours, "veth-a"), (theirs, "veth-b")]
                .iter()
                .all(|(space, link)| ip(&format!("-n {space} link set {link} up")));
        made.then_some(cable)
    }

    fn inside(space: &str, program: impl AsRef<std::ffi::OsStr>) -> Command {
        let mut command = Command::new("ip");
        command.args(["netns", "exec", space]).arg(program);
        command
    }

    /// Asks olad, inside its namespace.
    fn ask(&self, request: &str) -> Option<Value> {
        let script = format!("exec 3<>/dev/tcp/127.0.0.1/9090; printf '{request}' >&3; cat <&3");
        // What olad is asked while it starts it never answers.
        let output = Self::inside(&self.theirs, "timeout").args(["2", "bash", "-c", &script]).output().ok()?;
        answer(&String::from_utf8_lossy(&output.stdout))
    }

    fn get(&self, path: &str) -> Option<Value> {
        self.ask(&format!("GET {path} HTTP/1.0\\r\\n\\r\\n"))
    }

    fn post(&self, path: &str, form: &str) -> Option<Value> {
        let head = "Content-Type: application/x-www-form-urlencoded";
        self.ask(&format!("POST {path} HTTP/1.0\\r\\n{head}\\r\\nContent-Length: {}\\r\\n\\r\\n{form}", form.len()))
    }
}

impl Drop for Cable {
    fn drop(&mut self) {
        for space in [&self.ours, &self.theirs] {
            let _ = Command::new("ip").args(["netns", "del", space]).output();
        }
    }
}

/// The JSON behind the head of an answer.
fn answer(text: &str) -> Option<Value> {
    serde_json::from_str(text.split_once("\r\n\r\n")?.1).ok()
}

/// Waits until something is there.
fn wait_for<T>(what: &str, mut look: impl FnMut() -> Option<T>) -> T {
    let end = Instant::now() + PATIENCE;
    loop {
        if let Some(found) = look() {
            return found;
        }
        assert!(Instant::now() < end, "{what}: not within {PATIENCE:?}");
        std::thread::sleep(Duration::from_millis(100));
    }
}

fn rig(lamps: &str) -> String {
    format!(
        r#"
version = 1
name = "Lamps and a peer"
kind = "stage"
[camera]
times_s = [0.05]
limits_s = [0.001, 1.0]
[stage.lamps]
layout = "rings"
rings = [{{ elevation_deg = 30.0, count = 3 }}]
[devices]
camera = {{ driver = "virtual" }}
[devices.lamps]
{lamps}
channel_of = {CHANNELS:?}
settle_s = {SETTLE_S}
[virtual]
width = 32
height = 24
samples = 4
irradiance = 4000.0
sensor = {{ full_well_e = 30000.0, read_e = 6.0, bits = 12, dark = 0.0 }}
"#
    )
}

fn with_cache(command: &mut Command) -> &mut Command {
    command.env("RELUME_CACHE", target_dir().join("test-scenes"))
}

/// `relume rig simulate` of a widget at `folder/lamps`.
fn widget(folder: &Path) -> Running {
    fs::create_dir_all(folder).unwrap();
    let file = folder.join("rig.toml");
    fs::write(&file, rig(&format!("driver = \"dmx-usb-pro\"\nport = \"{}\"", folder.join("lamps").display()))).unwrap();
    let mut command = Command::new(relume());
    command.args(["rig", "simulate"]).arg(&file).arg("--at").arg(folder).stdout(Stdio::piped());
    let mut running = Running(with_cache(&mut command).spawn().unwrap());
    let mut ready = String::new();
    BufReader::new(running.0.stdout.take().unwrap()).read_line(&mut ready).unwrap();
    assert!(ready.starts_with("ready: lamps at "), "{ready}");
    running
}

/// A port between a program and a simulated widget.
struct Tap {
    /// The program's end; kept open, so that the line does not hang up between two programs.
    theirs: TTYPort,
    ends: Arc<AtomicBool>,
    threads: Vec<std::thread::JoinHandle<()>>,
}

impl Tap {
    /// Passes everything on, both ways; what the program sends is shown to `sees` as well. Bytes that `injected` gives go to the program.
    fn new(
        widget: &Path,
        mut sees: impl FnMut(&[u8]) + Send + 'static,
        injected: std::sync::mpsc::Receiver<Vec<u8>>,
    ) -> Self {
        let (ours, theirs) = TTYPort::pair().unwrap();
        fs::set_permissions(theirs.name().unwrap(), fs::Permissions::from_mode(0o666)).unwrap();
        let target = fs::canonicalize(widget).unwrap();
        let line = serialport::new(target.to_string_lossy(), 57_600).timeout(Duration::from_millis(20));
        let mut board = TTYPort::open(&line).unwrap();
        let (mut to_program, mut from_program) = (ours.try_clone_native().unwrap(), ours);
        let (mut to_board, ends) = (board.try_clone_native().unwrap(), Arc::new(AtomicBool::new(false)));
        from_program.set_timeout(Duration::from_millis(20)).unwrap();
        board.set_timeout(Duration::from_millis(20)).unwrap();
        let (first, second) = (ends.clone(), ends.clone());
        let down = std::thread::spawn(move || {
            let mut bytes = [0; 2048];
            while !first.load(Ordering::Relaxed) {
                if let Ok(count) = from_program.read(&mut bytes) {
                    sees(&bytes[..count]);
                    to_board.write_all(&bytes[..count]).unwrap();
                }
            }
        });
        let up = std::thread::spawn(move || {
            let mut bytes = [0; 2048];
            while !second.load(Ordering::Relaxed) {
                if let Ok(count) = board.read(&mut bytes) {
                    to_program.write_all(&bytes[..count]).unwrap();
                }
                injected.try_iter().for_each(|more| to_program.write_all(&more).unwrap());
            }
        });
        Self { theirs, ends, threads: vec![down, up] }
    }
}

impl Drop for Tap {
    fn drop(&mut self) {
        self.ends.store(true, Ordering::Relaxed);
        self.threads.drain(..).for_each(|thread| thread.join().unwrap());
    }
}

/// Our frames as a widget passes them on that receives DMX: label 6 ("send") becomes 5 ("received"), with a status byte before the start
/// code. Length, data and end are as our driver wrote them, so that olad judges those.
fn received(bytes: &mut Vec<u8>) -> Vec<Vec<u8>> {
    let mut frames = Vec::new();
    while let &[0x7e, label, low, high, ..] = &bytes[..] {
        let end = 4 + usize::from(u16::from_le_bytes([low, high]));
        if bytes.len() <= end {
            break;
        }
        let message: Vec<u8> = bytes.drain(..=end).collect();
        if label == 6 {
            let [low, high] = ((end - 3) as u16).to_le_bytes();
            frames.push([&[0x7e, 5, low, high, 0], &message[4..]].concat());
        }
    }
    frames
}

/// olad with three ways in: Art-Net, sACN, and a widget among `devices`.
fn olad(cable: &Cable, folder: &Path, devices: &Path) -> Running {
    let conf = folder.join("conf");
    fs::create_dir_all(&conf).unwrap();
    let all = [
        "dummy",
        "espnet",
        "ftdidmx",
        "gpio",
        "karate",
        "kinet",
        "milinst",
        "opendmx",
        "openpixelcontrol",
        "osc",
        "pathport",
        "renard",
        "sandnet",
        "shownet",
        "spi",
        "spidmx",
        "stageprofi",
        "uartdmx",
        "usbdmx",
    ];
    all.iter().for_each(|name| fs::write(conf.join(format!("ola-{name}.conf")), "enabled = false\n").unwrap());
    let write = |name: &str, text: String| fs::write(conf.join(format!("ola-{name}.conf")), text).unwrap();
    write("artnet", format!("enabled = true\nip = {THEIRS}\nshort_name = a peer\n"));
    write("e131", format!("enabled = true\nip = {THEIRS}\ninput_ports = 1\n"));
    write("usbserial", format!("enabled = true\ndevice_dir = {}\ndevice_prefix = lamps\n", devices.display()));
    // It will not run as root.
    for path in [folder, devices, &conf] {
        fs::set_permissions(path, fs::Permissions::from_mode(0o777)).unwrap();
    }
    fs::read_dir(&conf).unwrap().for_each(|file| {
        fs::set_permissions(file.unwrap().path(), fs::Permissions::from_mode(0o666)).unwrap();
    });
    let user = ["--reuid=nobody", "--regid=nogroup", "--clear-groups", "olad", "--no-register-with-dns-sd", "-c"];
    let log = fs::File::create(folder.join("olad.log")).unwrap();
    let mut command = Cable::inside(&cable.theirs, "setpriv");
    command.args(user).arg(&conf).stdout(log.try_clone().unwrap()).stderr(log);
    Running(command.spawn().unwrap())
}

/// The id of a device's first port.
fn port(ports: &Value, device: &str, output: bool) -> Option<String> {
    let ports = ports.as_array()?;
    let found = ports.iter().find(|port| {
        port["device"].as_str().is_some_and(|name| name.starts_with(device)) && port["is_output"] == Value::Bool(output)
    });
    Some(found?["id"].as_str()?.to_owned())
}

/// Channels that are not 0, whenever they changed, while a capture runs.
fn seen_during(cable: &Cable, universe: u32, capture: &mut Command) -> Vec<Vec<(usize, u64)>> {
    let script = format!(
        "while :; do exec 3<>/dev/tcp/127.0.0.1/9090; printf 'GET /get_dmx?u={universe} HTTP/1.0\\r\\n\\r\\n' >&3; timeout 2 cat <&3; printf '\\f'; \
         sleep 0.05; done"
    );
    let mut watch = Cable::inside(&cable.theirs, "bash");
    let mut watch = Running(watch.args(["-c", &script]).stdout(Stdio::piped()).stderr(Stdio::null()).spawn().unwrap());
    let mut out = watch.0.stdout.take().unwrap();
    let heard = std::thread::spawn(move || {
        let mut text = String::new();
        let _ = out.read_to_string(&mut text);
        text
    });
    let output = capture.output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    std::thread::sleep(Duration::from_millis(500));
    drop(watch);
    let text = heard.join().unwrap();
    let lit = |answer: Value| -> Vec<(usize, u64)> {
        let levels = answer["dmx"].as_array().cloned().unwrap_or_default();
        let levels = levels.iter().enumerate().map(|(n, level)| (n + 1, level.as_u64().unwrap_or_default()));
        levels.filter(|(_, level)| *level > 0).collect()
    };
    let mut states: Vec<_> = text.split('\x0c').filter_map(answer).map(lit).collect();
    states.dedup();
    states
}

/// Darkness, each lamp alone at its full level, darkness.
fn one_lamp_at_a_time() -> Vec<Vec<(usize, u64)>> {
    let lamps = CHANNELS.iter().map(|channel| vec![(*channel, 255)]);
    [Vec::new()].into_iter().chain(lamps).chain([Vec::new()]).collect()
}

#[test]
fn a_peer_understands_our_lamps() {
    if !Path::new("/usr/bin/olad").is_file() {
        return skipped("olad (Debian's package ola), a peer for Art-Net, sACN and DMX USB Pro, is");
    }
    let Some(cable) = Cable::new() else {
        return skipped("the right to make network namespaces (ip netns add), which the peer olad runs in, is");
    };
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| -> PathBuf { folder.path().join(name) };
    let capture = |name: &str, lamps: &str| {
        let file = path(&format!("{name}.toml"));
        fs::write(&file, rig(lamps)).unwrap();
        let mut command = Cable::inside(&cable.ours, relume());
        with_cache(&mut command).arg("capture").arg(file).arg("--session").arg(path(name));
        command
    };

    // olad's widget, and ours.
    let (_theirs, _ours) = (widget(&path("theirs")), widget(&path("ours")));
    let photograph = path("theirs/camera/DCIM/100/0001.JPG");
    let (inject, injected) = std::sync::mpsc::channel();
    let to_olad = Tap::new(&path("theirs/lamps"), |_| {}, injected);
    let mut pending = Vec::new();
    let tapped = move |bytes: &[u8]| {
        pending.extend_from_slice(bytes);
        received(&mut pending).into_iter().for_each(|frame| inject.send(frame).unwrap());
    };
    let to_ours = Tap::new(&path("ours/lamps"), tapped, std::sync::mpsc::channel().1);
    let devices = path("devices");
    fs::create_dir(&devices).unwrap();
    symlink(to_olad.theirs.name().unwrap(), devices.join("lamps")).unwrap();
    let _olad = olad(&cable, folder.path(), &devices);

    // It takes the simulated widget for a real one. What it is asked over HTTP before all of it runs it never answers, nor anything after.
    wait_for("olad's word of a widget", || {
        fs::read_to_string(path("olad.log")).ok().filter(|log| log.contains("Usb Pro device"))
    });
    std::thread::sleep(Duration::from_secs(2));
    let ports = wait_for("olad with the widget", || {
        cable.get("/json/get_ports").filter(|ports| port(ports, "Enttec Usb Pro Device", false).is_some())
    });
    let found =
        |device: &str, output: bool| port(&ports, device, output).unwrap_or_else(|| panic!("{device}: {ports:#}"));
    for (universe, device, output) in
        [(3, "ArtNet", false), (7, "E1.31", false), (9, "Enttec", false), (11, "Enttec", true)]
    {
        let form = format!("id={universe}&name=u{universe}&add_ports={}", found(device, output));
        let answer = cable.post("/new_universe", &form).unwrap();
        assert_eq!(answer["ok"], Value::Bool(true), "{device}: {answer:#}");
    }

    // Its frames light the simulated lamps.
    let dark = fs::read(&photograph).unwrap();
    let send = |levels: &str| cable.post("/set_dmx", &format!("u=11&d={levels}"));
    send("255,0,0,0,0,255");
    wait_for("a photograph under olad's light", || (fs::read(&photograph).unwrap() != dark).then_some(()));
    send("0,0,0,0,0,0");
    wait_for("a photograph in the dark", || (fs::read(&photograph).unwrap() == dark).then_some(()));

    // It shows what our drivers send, by each of three ways.
    let ways = [
        ("art-net", 3, format!("driver = \"art-net\"\nhost = \"{THEIRS}\"\nuniverse = 3")),
        ("sacn", 7, format!("driver = \"sacn\"\nuniverse = 7\nfrom = \"{OURS}\"")),
        ("dmx", 9, format!("driver = \"dmx-usb-pro\"\nport = \"{}\"", to_ours.theirs.name().unwrap())),
    ];
    for (name, universe, lamps) in &ways {
        let mut seen = seen_during(&cable, *universe, &mut capture(name, lamps));
        // Before the first packet it knows of no channels at all.
        seen.dedup();
        assert_eq!(seen, one_lamp_at_a_time(), "{name}");
    }
}
