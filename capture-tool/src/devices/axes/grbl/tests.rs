//! The driver against simulated boards on ptys, good and bad ones.

use std::time::Instant;

use serialport::SerialPort;

use super::*;
use crate::devices::operator::Willing;
use crate::simulators::grbl::{Grbl as Simulated, Settings};
use crate::simulators::{Mischief, Served, Strike, World, serve};

/// Puts the world's axes where it is asked to.
struct Strong(World, Willing);

impl Operator for Strong {
    fn ask(&self, request: &str) -> Result<(), Trouble> {
        self.0.put([0.0; 4]);
        self.1.ask(request)
    }
}

struct Bench {
    world: World,
    board: Served,
    device: AxesDevice,
    operator: Arc<dyn Operator>,
}

fn axis(letter: char) -> Axis {
    Axis { letter, per_deg: 1.0, zero: 0.0, limits_deg: [-720.0, 720.0], backlash_deg: 0.0, speed_deg_s: None }
}

/// 360 units in 20 ms.
fn fast() -> Settings {
    Settings { rate: 360.0 * 60.0 * 50.0, ..Settings::default() }
}

fn bench(settings: Settings, home: bool, turntable: Axis, strikes: Vec<(u32, Strike)>) -> Bench {
    let world = World::default();
    let board = serve(Simulated::new(settings, world.clone()), Mischief::new(strikes, 7)).unwrap();
    let device = AxesDevice::Grbl {
        port: board.path().display().to_string(),
        baud: 115_200,
        home,
        turntable: Some(turntable),
        arm: Some(axis('Y')),
        settle_s: 0.0,
        reply_s: 0.1,
        move_limit_s: 5.0,
    };
    let operator: Arc<dyn Operator> = Arc::new(Strong(world.clone(), Willing::default()));
    Bench { world, board, device, operator }
}

impl Bench {
    fn open(&self) -> Grbl {
        Grbl::open(&self.device, &self.operator).unwrap()
    }

    /// Goes there; the world must agree.
    fn go(&self, grbl: &mut Grbl, turntable: f64, arm: f64) -> Result<(), Trouble> {
        grbl.go(Place { turntable_deg: Some(turntable), arm_deg: Some(arm) })?;
        let seen = self.world.seen();
        assert!(!seen.moving && (seen.at[0] - turntable).abs() < 0.02 && (seen.at[1] - arm).abs() < 0.02, "{seen:?}");
        Ok(())
    }
}

#[test]
fn axes_arrive_before_the_call_returns() {
    for (settings, home) in [
        (fast(), false),
        (Settings { machine: false, ..fast() }, false),
        (Settings { restarts: true, ..fast() }, false),
        (Settings { homing: true, ..fast() }, true),
        (Settings { homing: true, machine: false, restarts: true, ..fast() }, true),
    ] {
        let bench = bench(settings.clone(), home, axis('x'), Vec::new());
        bench.world.put([33.0, -5.0, 0.0, 0.0]);
        let mut grbl = bench.open();
        assert!(grbl.preflight().iter().all(|finding| finding.fine), "{settings:?}: {:?}", grbl.preflight());
        assert!(grbl.go(Place { turntable_deg: Some(1.0), arm_deg: None }).is_err(), "positions are not known yet");
        grbl.home().unwrap();
        for (turntable, arm) in [(0.0, 0.0), (90.0, 15.0), (350.0, 0.0), (350.0, 0.0), (-10.0, 80.0)] {
            bench.go(&mut grbl, turntable, arm).unwrap();
        }
        let place = grbl.place().unwrap();
        assert!((place.turntable_deg.unwrap() + 10.0).abs() < 0.02 && (place.arm_deg.unwrap() - 80.0).abs() < 0.02);
        grbl.hold().unwrap();
    }
}

/// 350 degrees and -10 look alike and are a turn of cable apart: the long way is taken.
#[test]
fn per_degree_zero_and_limits_count() {
    let odd = Axis { letter: 'Z', per_deg: -2.0, zero: 10.0, limits_deg: [-5.0, 400.0], ..axis('Z') };
    let bench = bench(Settings { homing: true, ..fast() }, true, odd, Vec::new());
    let mut grbl = bench.open();
    grbl.home().unwrap();
    grbl.go(Place { turntable_deg: Some(370.0), arm_deg: None }).unwrap();
    assert!((bench.world.seen().at[2] - (10.0 - 740.0)).abs() < 0.02, "{:?}", bench.world.seen());
    for wrong in [-5.1, 400.1, f64::NAN] {
        let message = grbl.go(Place { turntable_deg: Some(wrong), arm_deg: None }).unwrap_err().to_string();
        assert!(message.contains("outside -5 to 400") && message.contains("limits_deg"), "{message}");
    }
    assert!((bench.world.seen().at[2] + 730.0).abs() < 0.02, "nothing was sent");
}

/// Wherever it comes from, its last motion is upwards and at least as long as the play.
#[test]
fn positions_are_come_to_from_below() {
    let played = Axis { backlash_deg: 3.0, limits_deg: [-10.0, 360.0], speed_deg_s: Some(2000.0), ..axis('X') };
    let bench = bench(Settings { homing: true, ..fast() }, true, played, Vec::new());
    let mut grbl = bench.open();
    grbl.home().unwrap();
    let lowest = Arc::new(std::sync::Mutex::new(f64::MAX));
    let (seen, world) = (lowest.clone(), bench.world.clone());
    let watch = std::thread::spawn(move || {
        for _ in 0..4000 {
            let mut lowest = seen.lock().unwrap();
            *lowest = lowest.min(world.seen().at[0]);
            drop(lowest);
            std::thread::sleep(Duration::from_micros(100));
        }
    });
    let mut from = |to: f64, reached: f64| {
        *lowest.lock().unwrap() = f64::MAX;
        bench.go(&mut grbl, to, 0.0).unwrap();
        let lowest = *lowest.lock().unwrap();
        assert!((lowest - reached).abs() < 0.6, "to {to}: came down to {lowest}, expected {reached}");
    };
    from(0.0, -3.0);
    from(100.0, 0.0);
    from(50.0, 47.0);
    watch.join().unwrap();
    let message = grbl.go(Place { turntable_deg: Some(-8.0), arm_deg: None }).unwrap_err().to_string();
    assert!(message.contains("leave room below"), "{message}");
}

/// Each of these costs an attempt, and nothing else.
#[test]
fn noise_and_lost_or_late_answers_are_got_over() {
    let kinds = [
        Strike::Garbage,
        Strike::HalfLine,
        Strike::LostReply,
        Strike::LostCommand,
        Strike::Late(Duration::from_millis(160)),
    ];
    for (n, kind) in kinds.into_iter().enumerate() {
        for after in [1, 9 + n as u32, 21] {
            let bench = bench(fast(), false, axis('X'), vec![(after, kind)]);
            let mut grbl = bench.open();
            grbl.home().unwrap();
            for turntable in [0.0, 90.0, 180.0] {
                bench
                    .go(&mut grbl, turntable, 0.0)
                    .unwrap_or_else(|trouble| panic!("{kind:?} after {after}: {trouble}"));
            }
            assert_eq!(bench.board.struck(), [kind]);
        }
    }
}

#[test]
fn what_needs_a_person_is_said() {
    for (strike, said) in [
        (Strike::Reset, "restarted, and its position is lost; check its power; resume makes positions known again"),
        (Strike::Alarm, "stopped with an alarm: a limit switch was hit (ALARM:1)"),
        (Strike::HangUp, "was lost ("),
    ] {
        let bench = bench(fast(), false, axis('X'), vec![(60, strike)]);
        let mut grbl = bench.open();
        grbl.home().unwrap();
        let message = (0..100).find_map(|n| bench.go(&mut grbl, f64::from(n) * 7.0, 0.0).err()).unwrap().to_string();
        assert!(message.contains(said), "{strike:?}: {message}");
        assert_eq!(grbl.hold().is_err(), strike == Strike::HangUp, "{strike:?}");
        if strike != Strike::HangUp {
            let mut again = {
                drop(grbl);
                bench.open()
            };
            again.home().unwrap();
            bench.go(&mut again, 45.0, 0.0).unwrap();
        }
    }
}

/// A restart whose banner nobody heard is seen all the same.
#[test]
fn a_silent_restart_is_seen_by_the_mark() {
    let bench =
        bench(Settings { boot: Duration::from_millis(5), ..fast() }, false, axis('X'), vec![(0, Strike::LostCommand)]);
    let mut grbl = bench.open();
    grbl.home().unwrap();
    bench.go(&mut grbl, 90.0, 0.0).unwrap();
    // What a brown-out leaves: offsets and position at zero, no word of it.
    let name = bench.board.path().display().to_string();
    drop(grbl);
    let mut other = Port::open(&name, 115_200).unwrap();
    other.send(&[0x18]).unwrap();
    other.drain(Duration::from_millis(30)).unwrap();
    drop(other);
    let mut grbl = bench.open();
    (grbl.known, grbl.home) = (true, false);
    let message = grbl.go(Place { turntable_deg: Some(90.0), arm_deg: None }).unwrap_err().to_string();
    assert!(message.contains("restarted"), "{message}");
}

/// A board that kept its position is believed when a session is resumed; one that restarted is not.
#[test]
fn the_operator_is_asked_only_where_positions_are_lost() {
    for (restarts, asked) in [(false, 1), (true, 2)] {
        let bench = bench(Settings { restarts, ..fast() }, false, axis('X'), Vec::new());
        let willing = Arc::new(Willing::default());
        let operator: Arc<dyn Operator> = willing.clone();
        for deg in [0.0, 30.0] {
            let mut grbl = Grbl::open(&bench.device, &operator).unwrap();
            grbl.home().unwrap();
            grbl.go(Place { turntable_deg: Some(deg), arm_deg: None }).unwrap();
        }
        let requests = willing.asked.lock().unwrap().clone();
        assert_eq!(requests.len(), asked, "{requests:?}");
        assert!(requests[0].contains("put the turntable and the arm at 0 degrees"), "{requests:?}");
    }
}

#[test]
fn a_move_that_is_given_up_stops() {
    let slow = Settings { rate: 600.0, ..Settings::default() };
    let bench = bench(slow, false, axis('X'), Vec::new());
    let mut grbl = bench.open();
    grbl.home().unwrap();
    grbl.move_limit = Duration::from_millis(150);
    let begun = Instant::now();
    let message = grbl.go(Place { turntable_deg: Some(100.0), arm_deg: None }).unwrap_err().to_string();
    assert!(message.contains("move_limit_s") && begun.elapsed() < Duration::from_secs(2), "{message}");
    grbl.hold().unwrap();
    let first = bench.world.seen();
    std::thread::sleep(Duration::from_millis(20));
    assert_eq!((first.moving, bench.world.seen().at), (false, first.at));
}

#[test]
fn nudges_need_no_zero() {
    let bench = bench(fast(), false, axis('X'), Vec::new());
    bench.world.put([5.0, 0.0, 0.0, 0.0]);
    let mut grbl = bench.open();
    grbl.nudge(Place { turntable_deg: Some(-5.0), arm_deg: Some(2.5) }).unwrap();
    let at = bench.world.seen().at;
    assert!(at[0].abs() < 0.02 && (at[1] - 2.5).abs() < 0.02, "{at:?}");
}

/// A board that is none, or talks at another speed.
#[test]
fn a_port_that_talks_nonsense_is_no_board() {
    let (mut board, pty) = serialport::TTYPort::pair().unwrap();
    let name = pty.name().unwrap();
    drop(pty);
    let talk = std::thread::spawn(move || {
        let end = Instant::now() + Duration::from_millis(4500);
        while Instant::now() < end {
            // Nobody listens before the driver has opened it, and after.
            let _ = std::io::Write::write_all(&mut board, b"\xfe\x00\xe0x");
            std::thread::sleep(Duration::from_millis(5));
        }
    });
    let device = match bench(fast(), false, axis('X'), Vec::new()).device {
        AxesDevice::Grbl { baud, home, turntable, arm, settle_s, reply_s, move_limit_s, .. } => {
            AxesDevice::Grbl { port: name, baud, home, turntable, arm, settle_s, reply_s, move_limit_s }
        }
        other => other,
    };
    let operator: Arc<dyn Operator> = Arc::new(Willing::default());
    let message = Grbl::open(&device, &operator).err().unwrap().to_string();
    assert!(message.contains("does not answer as GRBL 1.1 does"), "{message}");
    talk.join().unwrap();
}
