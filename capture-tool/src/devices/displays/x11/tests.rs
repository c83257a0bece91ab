//! Against a server without a screen (Xvfb): exact pixels, confirmation, and what may happen in mid-session. A camera of these tests looks
//! at the server's own pixels at the instant of the exposure.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::thread;
use std::time::Duration;

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg32;
use relume_core::image::{encode_png16, read_codes};
use x11rb::connection::Connection as _;
use x11rb::protocol::randr::{ConnectionExt as _, Rotation};
use x11rb::protocol::xproto::{
    ConfigureWindowAux, ConnectionExt as _, CreateWindowAux, ImageFormat, StackMode, WindowClass,
};

use super::super::{Display, Layout, OnPanel, Panel, Texels};
use super::link::Link;
use super::outputs::{Output, Place};
use super::panel::X11Panel;
use super::surface;
use crate::capture::patterns::{Samples, Sets, sets, steps};
use crate::capture::run::{End, Limits, run};
use crate::capture::{Listed, Step};
use crate::devices::operator::Willing;
use crate::devices::{Camera, Delivered, Finding, Trouble};
use crate::rigs::real::{Parts, RealRig};
use crate::rigs::{RigFile, ScreenLook, Shown};
use crate::session::{CaptureDescription, Description, Exposure, Session, Source};

/// A server of our own.
struct Xvfb {
    child: Child,
    number: u32,
}

impl Xvfb {
    /// With a screen such as "640x480x24"; none where the server is not installed, and that is said.
    fn start(screen: &str, options: &[&str]) -> Option<Self> {
        let mut command = Command::new("Xvfb");
        command.args(["-displayfd", "1", "-nolisten", "tcp", "-noreset", "-screen", "0", screen]).args(options);
        let Ok(mut child) = command.stdout(Stdio::piped()).stderr(Stdio::null()).spawn() else {
            crate::complain("skipped: Xvfb absent");
            return None;
        };
        let mut line = String::new();
        BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
        Some(Self { child, number: line.trim().parse().expect("the server tells its number") })
    }

    fn name(&self) -> String {
        format!(":{}", self.number)
    }

    fn link(&self) -> Link {
        Link::connect(Some(&self.name())).unwrap()
    }

    fn panel(&self, look: &ScreenLook) -> X11Panel {
        X11Panel::open(Some(&self.name()), look).unwrap()
    }

    fn signal(&self, signal: &str) {
        let done = Command::new("kill").args([signal, &self.child.id().to_string()]).status().unwrap();
        assert!(done.success());
    }
}

impl Drop for Xvfb {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// A server that is slow: everything to and from it waits for a while that is drawn at random.
struct Slow {
    name: String,
    _folder: tempfile::TempDir,
}

impl Slow {
    fn before(server: &Xvfb, seed: u64, longest: Duration) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("slow");
        let door = UnixListener::bind(&path).unwrap();
        let server = format!("/tmp/.X11-unix/X{}", server.number);
        // Ends with the test's process.
        thread::spawn(move || {
            for (n, client) in door.incoming().flatten().enumerate() {
                let server = UnixStream::connect(&server).unwrap();
                let (from, to) = (client.try_clone().unwrap(), server.try_clone().unwrap());
                let seed = seed + 2 * n as u64;
                thread::spawn(move || delayed(from, to, Pcg32::seed_from_u64(seed), longest));
                thread::spawn(move || delayed(server, client, Pcg32::seed_from_u64(seed + 1), longest));
            }
        });
        Self { name: path.to_string_lossy().into_owned(), _folder: folder }
    }
}

fn delayed(mut from: impl Read, mut to: impl Write, mut random: Pcg32, longest: Duration) {
    let mut piece = vec![0; 1 << 16];
    while let Ok(count @ 1..) = from.read(&mut piece) {
        thread::sleep(longest.mul_f64(random.random::<f64>().powi(2)));
        if to.write_all(&piece[..count]).is_err() {
            return;
        }
    }
}

fn look() -> ScreenLook {
    ScreenLook { output: None, texel_px: None, bits: 8, settle_s: 0.0, any_gamma: false }
}

/// The pixels of a part of the screen as the server has them now.
fn seen(link: &Link, place: Place) -> Vec<[u16; 3]> {
    let Place { x, y, width, height } = place;
    let (server, root) = (&link.server, link.screen().root);
    let image = server.get_image(ImageFormat::Z_PIXMAP, root, x, y, width, height, u32::MAX).unwrap().reply().unwrap();
    let (_, format) = surface::format(link, 8).unwrap();
    format.unpack(&image.data, (width.into(), height.into()))
}

/// What texels are on an output.
fn laid(texels: &Texels, layout: &Layout) -> Vec<[u16; 3]> {
    let (width, height) = layout.output;
    let pixel =
        |at: usize| layout.texel(at % width, at / width).map_or([0; 3], |(x, y)| texels.codes[y * texels.columns + x]);
    (0..width * height).map(pixel).collect()
}

fn noise(size: (usize, usize), white: u16, seed: u64) -> Texels {
    let mut random = Pcg32::seed_from_u64(seed);
    let codes = (0..size.0 * size.1).map(|_| [(); 3].map(|()| random.random_range(0..=white))).collect();
    Texels { columns: size.0, rows: size.1, white, codes }
}

/// Photographs are what the server has on the screen.
struct Screenshots {
    link: Link,
    place: Place,
    taken: Option<Vec<[u16; 3]>>,
    setting: Option<Exposure>,
    exposures: usize,
    /// At this exposure somebody opens a window.
    disturbed_at: Option<usize>,
}

impl Screenshots {
    fn of(server: &Xvfb) -> Self {
        let link = server.link();
        let place = Output::all(&link).unwrap()[0].place;
        Self { link, place, taken: None, setting: None, exposures: 0, disturbed_at: None }
    }
}

impl Camera for Screenshots {
    fn preflight(&mut self) -> Vec<Finding> {
        Vec::new()
    }

    fn set(&mut self, wanted: &Exposure) -> Result<Exposure, Trouble> {
        self.setting = Some(*wanted);
        Ok(*wanted)
    }

    fn setting(&mut self) -> Result<Option<Exposure>, Trouble> {
        Ok(self.setting)
    }

    fn expose(&mut self) -> Result<(), Trouble> {
        self.exposures += 1;
        if self.disturbed_at == Some(self.exposures) {
            opened(&self.link);
        }
        self.taken = Some(seen(&self.link, self.place));
        Ok(())
    }

    fn download(&mut self, folder: &Path, stem: &str) -> Result<Delivered, Trouble> {
        let path = folder.join(format!("{stem}.png"));
        let codes: Vec<u16> = self.taken.take().unwrap().as_flattened().iter().map(|code| code * 257).collect();
        let bytes = encode_png16(self.place.width.into(), self.place.height.into(), &codes)?;
        std::fs::write(&path, bytes).unwrap();
        Ok(Delivered { files: vec![path], thumbnail: None, exposure: None })
    }
}

const RIG: &str = r#"
version = 1
name = "Screen of a test"
kind = "monitor"
[monitor]
columns = 32
rows = 16
noise = 64
[camera]
limits_s = [0.02, 30.0]
times_s = [0.1]
[devices]
camera = { driver = "virtual" }
screen = { driver = "x11", settle_s = 0.0 }
"#;

/// A capture of wavelet noise.
struct Job<'a> {
    server: &'a Xvfb,
    /// What the driver connects to.
    display: &'a str,
    patterns: usize,
    hasty: bool,
    disturbed_at: Option<usize>,
}

/// How many photographs there are, how many of them are of another pattern than their own, and how it ended.
fn capture(job: &Job<'_>) -> (usize, usize, Result<End, Trouble>) {
    let Job { server, display, patterns, hasty, disturbed_at } = *job;
    let folder = tempfile::tempdir().unwrap();
    let mut rig = RigFile::parse(RIG, Path::new("rig.toml")).unwrap();
    rig.monitor.as_mut().unwrap().noise = patterns;
    let sets: Sets = sets(&rig, Samples::Noise, 1).unwrap();
    let all: Vec<Step> = steps(&rig, &sets, Samples::Noise);
    let mut panel = X11Panel::open(Some(display), &look()).unwrap();
    panel.hasty = hasty;
    let texels = rig.texels().unwrap();
    let layout = Layout::new("", texels, panel.size(), None).unwrap();
    let on_panel: Box<dyn Display> = Box::new(OnPanel::new(Box::new(panel), &look(), texels).unwrap());
    let shown = || Shown::new(&rig, sets.clone(), folder.path().to_owned()).unwrap();
    let operator = Arc::new(Willing::default());
    let parts = Parts { axes: None, lights: None, display: Some((on_panel, shown())), operator };
    let mut real = RealRig::new(&rig, parts, None);
    let description = CaptureDescription { sampler: "noise".to_owned(), seed: 1, rig: rig.clone() };
    let description = Description::new(Source::Capture(Box::new(description)));
    let mut session = Session::create(&folder.path().join("s"), description).unwrap();
    let mut camera = Screenshots { disturbed_at, ..Screenshots::of(server) };
    let mut sampler = Listed::new(all.clone());
    let ended = run(&mut session, &rig, (&mut real, &mut camera), &mut sampler, &Limits::default());
    let (mut count, mut wrong) = (0, 0);
    for photograph in session.photographs() {
        let (codes, _) = read_codes(&session.root().join(&photograph.frames[0].file)).unwrap();
        let expected = laid(&shown().texels(&photograph.condition).unwrap(), &layout);
        let found = codes.data().iter().map(|v| (v * 255.0).round() as u16);
        count += 1;
        wrong += usize::from(!found.eq(expected.as_flattened().iter().copied()));
    }
    (count, wrong, ended.map(|outcome| outcome.end))
}

#[test]
fn a_capture_on_a_slow_server_photographs_every_pattern_as_it_is() {
    let Some(server) = Xvfb::start("150x80x24", &[]) else { return };
    let slow = Slow::before(&server, 3, Duration::from_millis(10));
    let job = Job { server: &server, display: &slow.name, patterns: 64, hasty: false, disturbed_at: None };
    let (count, wrong, ended) = capture(&job);
    assert_eq!((count, wrong, ended.unwrap()), (66, 0, End::Complete), "black, white and 64 patterns");
    // The same camera sees what a driver does that waits for nothing.
    let (count, wrong, _) = capture(&Job { patterns: 16, hasty: true, ..job });
    assert!(wrong > 8, "{wrong} of {count} photographs before their pattern");
}

#[test]
fn a_photograph_of_something_that_came_over_the_pattern_is_not_kept() {
    let Some(server) = Xvfb::start("150x80x24", &[]) else { return };
    let display = server.name();
    let job = Job { server: &server, display: &display, patterns: 8, hasty: false, disturbed_at: Some(5) };
    let (count, wrong, ended) = capture(&job);
    let said = ended.unwrap_err().to_string();
    assert!((count, wrong) == (4, 0) && said.contains("lies over the patterns"), "{count} {wrong} {said}");
}

#[test]
fn pixels_are_exact_in_pieces_and_with_ten_bits() {
    // Requests of a megabyte: a picture of 2.4 is sent in three.
    let servers = [("900x700x24", 255, &["-maxbigreqsize", "1"][..]), ("300x200x30", 1023, &[])];
    for (screen, white, options) in servers {
        let Some(server) = Xvfb::start(screen, options) else { return };
        let deep = ScreenLook { bits: if white > 255 { 10 } else { 8 }, ..look() };
        let mut panel = server.panel(&deep);
        let (link, place) = (server.link(), Output::all(&server.link()).unwrap()[0].place);
        for (n, texels) in [(panel.size().0, panel.size().1), (7, 5), (1, 1)].into_iter().enumerate() {
            let layout = Layout::new("", texels, panel.size(), None).unwrap();
            let picture = noise(texels, white, n as u64);
            panel.put(&picture, &layout).unwrap();
            assert!(seen(&link, place) == laid(&picture, &layout), "{screen}, {texels:?}");
        }
        // Codes of 8 bits on a deeper server keep their shares of white.
        let layout = Layout::new("", (2, 1), panel.size(), None).unwrap();
        let picture = Texels { columns: 2, rows: 1, white: 255, codes: vec![[255, 51, 0], [0, 204, 255]] };
        panel.put(&picture, &layout).unwrap();
        // 51 and 204 of 255 are a fifth and four of white.
        let share = |code: u16| ((u32::from(code) * white as u32 * 2 + 255) / 510) as u16;
        let expected: Vec<[u16; 3]> = laid(&picture, &layout).iter().map(|codes| codes.map(share)).collect();
        assert!(seen(&link, place) == expected, "{screen}");
    }
}

#[test]
fn what_a_server_lacks_is_said() {
    let Some(server) = Xvfb::start("320x200x24", &[]) else { return };
    let open = |look: &ScreenLook| X11Panel::open(Some(&server.name()), look).map(|_| ()).unwrap_err().to_string();
    let said = open(&ScreenLook { bits: 10, ..look() });
    assert!(said.contains("depth 24") && said.contains("DefaultDepth 30"), "{said}");
    let said = open(&ScreenLook { output: Some("HDMI".to_owned()), ..look() });
    assert!(said.contains("\"HDMI\"") && said.contains("\"screen\""), "{said}");
    let said = X11Panel::open(Some(":9999"), &look()).map(|_| ()).unwrap_err().to_string();
    assert!(said.contains(":9999") && said.contains("cannot be reached"), "{said}");
    let too_many =
        OnPanel::new(Box::new(server.panel(&look())), &look(), (128, 256)).map(|_| ()).unwrap_err().to_string();
    assert!(too_many.contains("320 x 200") && too_many.contains("128 x 256"), "{too_many}");
}

#[test]
fn a_gamma_table_that_changes_stops_and_says_who_may_have_done_it() {
    let Some(server) = Xvfb::start("320x200x24", &[]) else { return };
    let (link, picture) = (server.link(), noise((32, 20), 255, 1));
    let mut screen = OnPanel::new(Box::new(server.panel(&look())), &look(), (32, 20)).unwrap();
    assert!(screen.preflight().iter().all(|finding| finding.fine), "{:?}", screen.preflight());
    screen.show(&picture).unwrap();
    let output = &Output::all(&link).unwrap()[0];
    let line: Vec<u16> = (0..output.gamma.len() as u32).map(|n| (n * 257) as u16).collect();
    let dimmed: Vec<u16> = line.iter().map(|v| v / 10 * 8).collect();
    link.server.randr_set_crtc_gamma(output.crtc, &line, &line, &dimmed).unwrap().check().unwrap();
    let said = screen.show(&picture).unwrap_err();
    assert!(matches!(said, Trouble::Stop { .. }) && said.to_string().contains("night light"), "{said}");
    assert!(screen.preflight().iter().any(|finding| !finding.fine && finding.text.contains("redshift")));
    screen.dark().unwrap();
    assert!(seen(&link, output.place).iter().all(|pixel| *pixel == [0; 3]), "it goes dark all the same");
    let any = ScreenLook { any_gamma: true, ..look() };
    OnPanel::new(Box::new(server.panel(&any)), &any, (32, 20)).unwrap().show(&picture).unwrap();
}

/// A window of somebody else's, over the right end of the screen.
fn opened(link: &Link) -> u32 {
    let window = link.server.generate_id().unwrap();
    let looks = CreateWindowAux::new().background_pixel(0x00ff_00ff).override_redirect(1);
    let (screen, class) = (link.screen(), WindowClass::INPUT_OUTPUT);
    let at = (screen.width_in_pixels as i16 - 20, screen.height_in_pixels as i16 - 20);
    let made = link.server.create_window(0, window, screen.root, at.0, at.1, 50, 50, 0, class, 0, &looks);
    made.unwrap().check().unwrap();
    link.server.map_window(window).unwrap().check().unwrap();
    window
}

#[test]
fn a_window_above_is_named_and_the_next_picture_is_above_it() {
    let Some(server) = Xvfb::start("320x200x24", &[]) else { return };
    let (link, picture) = (server.link(), noise((32, 20), 255, 1));
    let mut panel = server.panel(&look());
    let layout = Layout::new("", (32, 20), panel.size(), None).unwrap();
    panel.put(&picture, &layout).unwrap();
    panel.still().unwrap();
    let window = opened(&link);
    let said = panel.still().unwrap_err();
    assert!(matches!(&said, Trouble::Busy(what) if what.contains("lies over the patterns")), "{said}");
    panel.put(&picture, &layout).unwrap();
    panel.still().unwrap();
    assert!(seen(&link, Output::all(&link).unwrap()[0].place) == laid(&picture, &layout));
    // One that insists ends the capture.
    let above = ConfigureWindowAux::new().stack_mode(StackMode::ABOVE);
    let insist = || {
        link.server.configure_window(window, &above).unwrap().check().unwrap();
        panel.still().unwrap_err()
    };
    let last = std::iter::repeat_with(insist).take(5).last().unwrap();
    assert!(matches!(last, Trouble::Stop { .. }), "{last}");
}

#[test]
fn an_output_that_is_switched_off_stops() {
    let Some(server) = Xvfb::start("320x200x24", &[]) else { return };
    let link = server.link();
    let mut screen = OnPanel::new(Box::new(server.panel(&look())), &look(), (32, 20)).unwrap();
    screen.show(&noise((32, 20), 255, 1)).unwrap();
    let crtc = Output::all(&link).unwrap()[0].crtc;
    link.server.randr_set_crtc_config(crtc, 0, 0, 0, 0, 0, Rotation::ROTATE0, &[]).unwrap().reply().unwrap();
    let said = screen.show(&noise((32, 20), 255, 2)).unwrap_err();
    assert!(matches!(said, Trouble::Stop { .. }) && said.to_string().contains("switched off"), "{said}");
}

#[test]
fn a_server_that_stands_still_is_waited_for_and_one_that_dies_ends_it() {
    // Small: a picture fits what the system keeps for a reader that does not read.
    let Some(mut server) = Xvfb::start("64x48x24", &[]) else { return };
    let (link, mut panel) = (server.link(), server.panel(&look()));
    panel.patience = Duration::from_millis(150);
    let layout = Layout::new("", (4, 2), panel.size(), None).unwrap();
    let picture = |n| noise((4, 2), 255, n);
    panel.put(&picture(1), &layout).unwrap();
    server.signal("-STOP");
    for n in 2..4 {
        let said = panel.put(&picture(n), &layout).unwrap_err();
        assert!(matches!(&said, Trouble::Busy(what) if what.contains("not confirmed")), "{said}");
    }
    server.signal("-CONT");
    panel.patience = Duration::from_secs(5);
    // The answers to the pictures before come now, and are none to this one.
    panel.put(&picture(4), &layout).unwrap();
    let place = Output::all(&link).unwrap()[0].place;
    assert!(seen(&link, place) == laid(&picture(4), &layout));
    server.child.kill().unwrap();
    server.child.wait().unwrap();
    let said = panel.put(&picture(5), &layout).unwrap_err();
    assert!(matches!(said, Trouble::Stop { .. }) && said.to_string().contains("is lost"), "{said}");
}

#[test]
fn nobody_listens_where_a_stream_ends() {
    let door = TcpListener::bind("127.0.0.1:0").unwrap();
    let number = door.local_addr().unwrap().port().checked_sub(6000);
    thread::spawn(move || door.incoming().flatten().for_each(|client: TcpStream| drop(client)));
    let Some(number) = number else { return };
    let said = X11Panel::open(Some(&format!("127.0.0.1:{number}")), &look()).map(|_| ()).unwrap_err().to_string();
    assert!(said.contains("cannot be reached"), "{said}");
}
