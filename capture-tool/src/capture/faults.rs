//! Bad days by the thousand: the whole loop with real drivers over ptys against simulated boards that misbehave, and a camera that
//! misbehaves too. However a run ends, it says why, and goes on to the end; and no photograph shows anything but its condition.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use rand::seq::IndexedRandom;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg32;
use relume_core::image::{Image, encode_png16, read_codes};

use super::run::{End, Limits, run};
use super::{Listed, scan};
use crate::devices::operator::Willing;
use crate::devices::port::Port;
use crate::devices::{Axes, Camera, Delivered, Finding, Lights, Operator, Place, Trouble, axes, lights};
use crate::rigs::real::{Parts, RealRig};
use crate::rigs::{AxesDevice, Condition, LampsDevice, Rig, RigFile};
use crate::session::{CaptureDescription, Description, Exposure, Session, Source};
use crate::simulators::dmx_widget::DmxWidget;
use crate::simulators::grbl::{Grbl, Settings};
use crate::simulators::text_board::{Templates, TextBoard};
use crate::simulators::{Mischief, Seen, Served, Strike, World, serve};

/// Runs, and how many at a time: they mostly wait.
const RUNS: u64 = 1000;
const AT_A_TIME: usize = 64;
/// Lamps of the arc, and stops.
const LAMPS: usize = 2;
const STOPS: usize = 2;
/// A degree in codes of the picture, above a pedestal for positions below zero.
const CODES_PER_DEG: f64 = 100.0;
const PEDESTAL: f64 = 1000.0;

/// What the camera does wrong, at one of its exposures.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
enum Slip {
    /// Busy for three calls.
    Busy,
    /// Busy for good.
    Stuck,
    /// Takes another exposure time than it is told to.
    Misread,
    /// Somebody turns a dial between setting and exposing.
    Dial,
    /// The card is full.
    CardFull,
    /// It is unplugged.
    Gone,
    /// A mistake of ours shows.
    Panic,
}

/// Photographs the world: each picture tells where the axes stood, and the levels, at the beginning and at the end of the exposure.
struct Witness {
    world: World,
    slip: Option<(u64, Slip)>,
    struck: Arc<Mutex<Vec<Slip>>>,
    exposures: u64,
    busy: u32,
    setting: Exposure,
    seen: Option<[Seen; 2]>,
}

impl Witness {
    fn new(world: &World, slip: Option<(u64, Slip)>, struck: &Arc<Mutex<Vec<Slip>>>) -> Self {
        let setting = Exposure { time_s: 1.0, iso: None, f_number: None };
        Self { world: world.clone(), slip, struck: struck.clone(), exposures: 0, busy: 0, setting, seen: None }
    }

    fn slips(&self, slip: Slip) -> bool {
        let strikes = self.slip.is_some_and(|(at, known)| known == slip && self.exposures >= at);
        if strikes {
            self.struck.lock().unwrap().push(slip);
        }
        strikes
    }
}

impl Camera for Witness {
    fn preflight(&mut self) -> Vec<Finding> {
        Vec::new()
    }

    fn set(&mut self, wanted: &Exposure) -> Result<Exposure, Trouble> {
        if self.slips(Slip::Gone) {
            return Err(Trouble::stop("the camera does not answer", "check its cable"));
        }
        if (self.busy < 3 && self.slips(Slip::Busy)) || self.slips(Slip::Stuck) {
            self.busy += 1;
            return Err(Trouble::Busy("the camera is busy".to_owned()));
        }
        let factor = if self.slips(Slip::Misread) { 2.0 } else { 1.0 };
        self.setting = Exposure { time_s: wanted.time_s * factor, ..*wanted };
        Ok(self.setting)
    }

    fn setting(&mut self) -> Result<Option<Exposure>, Trouble> {
        Ok(Some(self.setting))
    }

    fn expose(&mut self) -> Result<(), Trouble> {
        assert!(!self.slips(Slip::Panic), "on purpose");
        if self.slips(Slip::CardFull) {
            return Err(Trouble::stop("the camera's card is full", "put another one in"));
        }
        if self.slips(Slip::Dial) {
            self.setting.time_s *= 2.0;
        }
        let begin = self.world.seen();
        std::thread::sleep(Duration::from_millis(1));
        self.seen = Some([begin, self.world.seen()]);
        self.exposures += 1;
        Ok(())
    }

    fn download(&mut self, folder: &Path, stem: &str) -> Result<Delivered, Trouble> {
        let seen = self.seen.take().ok_or_else(|| Trouble::Busy("nothing was exposed".to_owned()))?;
        let position = |seen: &Seen| (seen.at[0] * CODES_PER_DEG + PEDESTAL).round().clamp(0.0, 65535.0) as u16;
        let pixel = |seen: &Seen| {
            let others = seen.levels[LAMPS..].iter().any(|level| *level > 0);
            let levels = u16::from(seen.levels[0]) << 8 | u16::from(seen.levels[1]);
            [position(seen), levels, u16::from(others) << 1 | u16::from(seen.moving)]
        };
        let codes = [pixel(&seen[0]), pixel(&seen[1])].concat();
        let file = folder.join(format!("{stem}.png"));
        let bytes = encode_png16(2, 1, &codes)?;
        std::fs::write(&file, bytes).map_err(|source| relume_core::Error::io("write", &file, source))?;
        Ok(Delivered { files: vec![file], thumbnail: Some(Image::new(2, 1, 3)), exposure: None })
    }
}

/// Turns the table to its zero when asked to.
struct Strong(World);

impl Operator for Strong {
    fn ask(&self, _: &str) -> Result<(), Trouble> {
        self.0.put([0.0; 4]);
        Ok(())
    }
}

const RIG: &str = "
version = 1
name = \"bad days\"
kind = \"stage\"
camera = { times_s = [0.001], limits_s = [0.0005, 1.0], patience_s = 0.15 }
stage = { lamps = { layout = \"arc\", latitudes = 2, longitudes = 2, first_deg = 30.0 } }
[devices]
camera = { driver = \"folder\", path = \".\" }
axes = { driver = \"grbl\", port = \"axes\", turntable = { letter = \"X\" } }
lamps = { driver = \"dmx-usb-pro\", port = \"lamps\" }
";

/// A rig, and the world that its boards move and light.
struct Set {
    rig: RigFile,
    world: World,
    axes: (Settings, Option<Served>),
    /// DMX, or one of two boards of text.
    lamps: (Option<Templates>, Option<Served>),
    /// Patience with boards, seconds.
    reply_s: f64,
    /// Where ports are, under names of their own: a driver that looks for its lost port finds nobody else's.
    ports: PathBuf,
}

impl Set {
    fn new(rng: &mut Pcg32, strikes: [Vec<(u32, Strike)>; 2], ports: PathBuf) -> Self {
        std::fs::create_dir_all(&ports).unwrap();
        let world = World::default();
        // 180 degrees in 5 ms.
        let settings = Settings {
            rate: 180.0 * 60.0 * 200.0,
            restarts: rng.random(),
            homing: rng.random(),
            machine: rng.random(),
            boot: Duration::from_millis(5),
            ..Settings::default()
        };
        let templates = |off: bool, reply: &str| Templates {
            on: "<{lamp},{level}>".to_owned(),
            off: off.then(|| "<{lamp},0>".to_owned()),
            all_off: "<off>".to_owned(),
            reply: Some(reply.to_owned()),
            ends: "\n".to_owned(),
        };
        let lamps = match rng.random_range(0..4) {
            0 => Some(templates(true, "+{lamp}")),
            1 => Some(templates(false, "ok")),
            _ => None,
        };
        let rig = RigFile::parse(RIG, Path::new("rig.toml")).unwrap();
        let mut set = Self { rig, world, axes: (settings, None), lamps: (lamps, None), reply_s: 0.25, ports };
        let [of_axes, of_lamps] = strikes;
        set.plug_axes(Mischief::new(of_axes, rng.random()));
        set.plug_lamps(Mischief::new(of_lamps, rng.random()));
        set
    }

    fn plug_axes(&mut self, mischief: Mischief) {
        let board = serve(Grbl::new(self.axes.0.clone(), self.world.clone()), mischief).unwrap();
        // The old one first: its link has the same name.
        self.axes.1 = None;
        self.axes.1 = Some(board.link_at(&self.ports.join("axes")).unwrap());
    }

    fn plug_lamps(&mut self, mischief: Mischief) {
        let board = match &self.lamps.0 {
            None => serve(DmxWidget::new(self.world.clone()), mischief).unwrap(),
            Some(templates) => serve(TextBoard::new(templates.clone(), self.world.clone()), mischief).unwrap(),
        };
        self.lamps.1 = None;
        self.lamps.1 = Some(board.link_at(&self.ports.join("lamps")).unwrap());
    }

    fn struck(&self) -> [Vec<Strike>; 2] {
        [&self.axes.1, &self.lamps.1].map(|board| board.as_ref().map_or_else(Vec::new, Served::struck))
    }

    /// From now on all goes well; pulled cables are in again.
    fn repair(&mut self) {
        let [axes, lamps] = self.struck().map(|struck| struck.contains(&Strike::HangUp));
        [&self.axes.1, &self.lamps.1].into_iter().flatten().for_each(Served::calm);
        if axes {
            self.plug_axes(Mischief::default());
        }
        if lamps {
            self.plug_lamps(Mischief::default());
        }
        // Nothing is lost any more, so that nothing is waited for; a machine with much to do is slow.
        self.reply_s = 2.0;
    }

    fn axes_device(&self) -> AxesDevice {
        let text = format!(
            "driver = \"grbl\"\nport = \"{}\"\nhome = {}\nsettle_s = 0.0\nreply_s = {}\nmove_limit_s = 3.0\nturntable = {{ letter = \"X\" }}",
            self.ports.join("axes").display(),
            self.axes.0.homing,
            self.reply_s
        );
        toml::from_str(&text).unwrap()
    }

    fn lamps_device(&self) -> LampsDevice {
        let port = self.ports.join("lamps").display().to_string();
        let common = format!("port = \"{port}\"\nreply_s = {}\nsettle_s = 0.0\n", self.reply_s);
        let text = match &self.lamps.0 {
            None => format!("driver = \"dmx-usb-pro\"\n{common}"),
            Some(Templates { on, off, all_off, reply, .. }) => {
                let off = off.as_ref().map_or_else(String::new, |off| format!("off = \"{off}\"\n"));
                let reply = reply.clone().unwrap_or_default();
                format!("driver = \"text\"\non = \"{on}\"\n{off}all_off = \"{all_off}\"\nreply = \"{reply}\"\n{common}")
            }
        };
        toml::from_str(&text).unwrap()
    }

    /// As the command opens and begins.
    fn capture(&mut self, session: &mut Session, camera: &mut Witness) -> Result<End, Trouble> {
        let operator: Arc<dyn Operator> = Arc::new(Strong(self.world.clone()));
        let axes = axes::open(&self.axes_device(), &operator)?;
        let lights = lights::open(&self.lamps_device(), LAMPS)?;
        self.capture_with(session, camera, axes, lights)
    }

    fn capture_with(
        &mut self,
        session: &mut Session,
        camera: &mut Witness,
        axes: Box<dyn Axes>,
        lights: Box<dyn Lights>,
    ) -> Result<End, Trouble> {
        let operator: Arc<dyn Operator> = Arc::new(Willing::default());
        let parts = Parts { axes: Some(axes), lights: Some(lights), display: None, operator };
        let mut rig = RealRig::new(&self.rig, parts, None);
        if let Some(missing) = rig.preflight().into_iter().find(|finding| !finding.fine) {
            return Err(Trouble::stop(missing.text, "nothing was started"));
        }
        let stage = self.rig.stage.as_ref().unwrap();
        let mut sampler = Listed::new(scan::steps(&self.rig, stage));
        run(session, &self.rig, (&mut rig, camera), &mut sampler, &Limits::default()).map(|outcome| outcome.end)
    }

    fn session(&self, root: &Path) -> Session {
        let capture = CaptureDescription { sampler: "scan".to_owned(), seed: 1, rig: self.rig.clone() };
        Session::create(root, Description::new(Source::Capture(Box::new(capture)))).unwrap()
    }
}

/// Photographs of a session that do not show their condition.
fn wrong(session: &Session) -> Vec<String> {
    let shown = |photograph: &crate::session::Photograph| {
        let (codes, _) = read_codes(&session.root().join(&photograph.frames[0].file)).unwrap();
        let code = |x: usize, c: usize| (codes.pixel(x, 0)[c] * 65535.0).round() as u16;
        let stop = photograph.condition.stop(LAMPS);
        let deg = 30.0 + 180.0 * stop as f64;
        let levels = match photograph.condition {
            Condition::Lamp(lamp) => 255u16 << (8 * (LAMPS - 1 - lamp % LAMPS)),
            _ => 0,
        };
        (0..2).all(|x| {
            let off = (f64::from(code(x, 0)) - PEDESTAL) / CODES_PER_DEG - deg;
            off.abs() < 0.05 && code(x, 1) == levels && code(x, 2) == 0
        })
    };
    let wrong = session.photographs().filter(|photograph| !shown(photograph));
    wrong.map(|photograph| format!("photograph {} of {}", photograph.number, photograph.condition)).collect()
}

/// What happens to the axes' board and to the lamps', and when.
type Strikes = [Vec<(u32, Strike)>; 2];

/// Bad luck of a seed: what happens to the boards and the camera.
fn luck(rng: &mut Pcg32) -> (Strikes, Option<(u64, Slip)>) {
    let late = Strike::Late(Duration::from_millis(rng.random_range(100..400)));
    let of_axes = [
        Strike::Garbage,
        Strike::HalfLine,
        late,
        Strike::LostReply,
        Strike::LostCommand,
        Strike::Reset,
        Strike::Alarm,
        Strike::HangUp,
    ];
    let of_lamps = [
        Strike::Garbage,
        Strike::HalfLine,
        late,
        Strike::LostReply,
        Strike::LostCommand,
        Strike::Reset,
        Strike::HangUp,
    ];
    let mut strikes = |known: &[Strike], answers: u32| -> Vec<(u32, Strike)> {
        let count = [0, 1, 1, 2].choose(rng).copied().unwrap_or_default();
        (0..count).map(|_| (rng.random_range(0..answers), known.choose(rng).copied().unwrap())).collect()
    };
    let strikes = [strikes(&of_axes, 120), strikes(&of_lamps, 14)];
    let slips = [Slip::Busy, Slip::Stuck, Slip::Misread, Slip::Dial, Slip::CardFull, Slip::Gone];
    let slip = rng.random_bool(0.3).then(|| (rng.random_range(0..6), slips.choose(rng).copied().unwrap()));
    (strikes, slip)
}

/// What a run came to.
struct Told {
    struck: Vec<String>,
    ending: String,
}

/// A bad day, and the good one after it.
fn bad_day(seed: u64, folder: &Path) -> Result<Told, String> {
    let mut rng = Pcg32::seed_from_u64(seed);
    let (strikes, slip) = luck(&mut rng);
    let slipped = Arc::default();
    let root = folder.join(seed.to_string());
    let ports = folder.join(format!("{seed}-ports"));
    let mut set = Set::new(&mut rng, strikes, ports.clone());
    let mut session = set.session(&root);
    let ended = set.capture(&mut session, &mut Witness::new(&set.world, slip, &slipped));
    let ending = match &ended {
        Ok(end) => format!("{end:?}"),
        Err(trouble) => kind(&trouble.to_string())?,
    };
    let [of_axes, of_lamps] = set.struck();
    let lost = of_lamps.contains(&Strike::HangUp);
    let seen = set.world.seen();
    if !lost && seen.levels.iter().any(|level| *level > 0) && session.photographs().count() > 0 {
        let log = std::fs::read_to_string(root.join("capture.log")).unwrap_or_default();
        let last: Vec<&str> = log.lines().rev().take(3).collect();
        return Err(format!("lamps stayed on: {ended:?}; {:?}; {of_lamps:?}; {last:?}", set.lamps.0));
    }
    drop(session);
    set.repair();
    let mut session = Session::open(&root).map_err(|error| error.to_string())?;
    let again = set.capture(&mut session, &mut Witness::new(&set.world, None, &slipped));
    match again {
        Ok(End::Complete) => {}
        other => return Err(format!("first {ended:?}, and then did not go on: {other:?}")),
    }
    if session.photographs().count() != STOPS * (LAMPS + 1) {
        return Err(format!("{} photographs", session.photographs().count()));
    }
    if let Some(wrong) = wrong(&session).first() {
        return Err(format!("{wrong} does not show it; {of_axes:?}, {of_lamps:?}"));
    }
    let name = |board: &str, strike: &Strike| match strike {
        Strike::Late(_) => format!("{board} late"),
        other => format!("{board} {other:?}"),
    };
    let slips = slipped.lock().unwrap().iter().map(|slip| format!("camera {slip:?}")).collect::<Vec<_>>();
    let strikes = of_axes.iter().map(|s| name("axes", s)).chain(of_lamps.iter().map(|s| name("lamps", s)));
    drop((session, set));
    let _ = std::fs::remove_dir_all(&root);
    let _ = std::fs::remove_dir_all(&ports);
    Ok(Told { struck: strikes.chain(slips).collect(), ending })
}

/// The kind of a sentence, which has to be one: what happened, and what to do.
fn kind(sentence: &str) -> Result<String, String> {
    let kinds = [
        "was lost (",
        "restarted, and its position is lost",
        "stopped with an alarm",
        "is locked by an alarm",
        "does not answer as GRBL",
        "DMX widget",
        "lamp ",
        "the camera is busy",
        "reads back",
        "after the exposure the camera says",
        "card is full",
        "the camera does not answer",
        "no serial port",
        "refused a command",
        "do not come to where they are sent",
    ];
    let known = kinds.iter().find(|kind| sentence.contains(**kind) && sentence.contains("; "));
    known.map(|kind| (*kind).to_owned()).ok_or_else(|| format!("an unknown sentence: {sentence}"))
}

/// Memory, where there is a disk of it: a session is synced with each photograph.
fn folder() -> tempfile::TempDir {
    let memory = Path::new("/dev/shm");
    if memory.is_dir() { tempfile::tempdir_in(memory).unwrap() } else { tempfile::tempdir().unwrap() }
}

#[test]
fn bad_days_end_with_a_sentence_and_go_on() {
    let folder = folder();
    let next = AtomicU64::new(0);
    let told = Mutex::new((BTreeMap::<String, u64>::new(), Vec::new()));
    std::thread::scope(|scope| {
        for _ in 0..AT_A_TIME {
            scope.spawn(|| {
                loop {
                    let seed = next.fetch_add(1, Ordering::Relaxed);
                    if seed >= RUNS {
                        return;
                    }
                    let result = bad_day(seed, folder.path());
                    let mut told = told.lock().unwrap();
                    match result {
                        Ok(Told { struck, ending }) => struck
                            .into_iter()
                            .collect::<std::collections::BTreeSet<_>>()
                            .into_iter()
                            .chain([format!("ended: {ending}")])
                            .for_each(|kind| *told.0.entry(kind).or_default() += 1),
                        Err(wrong) => told.1.push(format!("seed {seed}: {wrong}")),
                    }
                }
            });
        }
    });
    let (counts, wrong) = told.into_inner().unwrap();
    assert!(wrong.is_empty(), "{} of {RUNS} runs:\n{}\n{counts:#?}", wrong.len(), wrong.join("\n"));
    let boards = ["Garbage", "HalfLine", "late", "LostReply", "LostCommand", "Reset", "HangUp"];
    let camera = ["Busy", "Stuck", "Misread", "Dial", "CardFull", "Gone"];
    let mut expected: Vec<String> =
        boards.iter().flat_map(|kind| [format!("axes {kind}"), format!("lamps {kind}")]).collect();
    expected.push("axes Alarm".to_owned());
    expected.extend(camera.iter().map(|kind| format!("camera {kind}")));
    expected.push("ended: Complete".to_owned());
    for ending in [
        "was lost (",
        "restarted, and its position is lost",
        "stopped with an alarm",
        "the camera is busy",
        "reads back",
        "after the exposure the camera says",
        "card is full",
        "the camera does not answer",
    ] {
        expected.push(format!("ended: {ending}"));
    }
    let missing: Vec<&String> = expected.iter().filter(|kind| !counts.contains_key(*kind)).collect();
    assert!(missing.is_empty(), "never happened: {missing:?}\n{counts:#?}");
}

#[test]
fn lamps_go_out_when_the_loop_panics() {
    let folder = folder();
    let ports = folder.path().join("ports");
    let mut set = Set::new(&mut Pcg32::seed_from_u64(5), [Vec::new(), Vec::new()], ports);
    let mut session = set.session(&folder.path().join("s"));
    // The second photograph is of a lamp that is lit.
    let mut camera = Witness::new(&set.world, Some((1, Slip::Panic)), &Arc::default());
    let panicked = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| set.capture(&mut session, &mut camera)));
    assert!(panicked.is_err());
    assert_eq!((session.photographs().count(), set.world.seen().levels.iter().max()), (1, Some(&0)));
}

/// Takes `ok` for an arrival.
struct Hasty(Port);

impl Axes for Hasty {
    fn preflight(&mut self) -> Vec<Finding> {
        Vec::new()
    }

    fn home(&mut self) -> Result<(), Trouble> {
        self.0.drain(Duration::from_millis(20))?;
        Ok(())
    }

    fn go(&mut self, to: Place) -> Result<(), Trouble> {
        let deg = to.turntable_deg.unwrap_or_default();
        self.0.send(format!("G90G0X{deg:.3}\n").as_bytes())?;
        while self.0.line(std::time::Instant::now() + Duration::from_secs(2))?.as_deref() != Some("ok") {}
        Ok(())
    }

    fn place(&mut self) -> Result<Place, Trouble> {
        Ok(Place::default())
    }

    fn hold(&mut self) -> Result<(), Trouble> {
        Ok(())
    }
}

/// Lights a lamp a little after it said so.
struct Early(World, Vec<std::thread::JoinHandle<()>>);

impl Lights for Early {
    fn preflight(&mut self) -> Vec<Finding> {
        Vec::new()
    }

    fn show(&mut self, levels: &[u8]) -> Result<(), Trouble> {
        let (world, levels) = (self.0.clone(), levels.to_vec());
        self.1.push(std::thread::spawn(move || {
            std::thread::sleep(Duration::from_micros(500));
            world.light(&levels);
        }));
        Ok(())
    }

    fn dark(&mut self) -> Result<(), Trouble> {
        self.1.drain(..).for_each(|thread| drop(thread.join()));
        Ok(())
    }
}

/// What the runs rely on: photographs taken too early are found by their content.
#[test]
fn photographs_of_hasty_drivers_are_found_out() {
    let folder = folder();
    let operator: Arc<dyn Operator> = Arc::new(Willing::default());
    for hasty_axes in [true, false] {
        let mut rng = Pcg32::seed_from_u64(5);
        let ports = folder.path().join(format!("{hasty_axes}-ports"));
        let mut set = Set::new(&mut rng, Default::default(), ports);
        set.axes.0 = Settings { rate: 180.0 * 60.0 * 20.0, ..Settings::default() };
        set.plug_axes(Mischief::default());
        set.reply_s = 2.0;
        let mut session = set.session(&folder.path().join(hasty_axes.to_string()));
        let (axes, lights): (Box<dyn Axes>, Box<dyn Lights>) = if hasty_axes {
            let port = Port::open(&set.ports.join("axes").display().to_string(), 115_200).unwrap();
            (Box::new(Hasty(port)), lights::open(&set.lamps_device(), LAMPS).unwrap())
        } else {
            (axes::open(&set.axes_device(), &operator).unwrap(), Box::new(Early(set.world.clone(), Vec::new())))
        };
        let mut camera = Witness::new(&set.world, None, &Arc::default());
        assert_eq!(set.capture_with(&mut session, &mut camera, axes, lights).unwrap(), End::Complete);
        assert!(!wrong(&session).is_empty(), "hasty axes: {hasty_axes}");
    }
}
