//! A board with GRBL 1.1h: what `protocol.c`, `system.c` and `gcode.c` of gnea/grbl do with what a turntable needs.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use super::served::Board;
use super::world::{AXES, World};

/// What kind of board.
#[derive(Debug, Clone)]
pub struct Settings {
    /// Steps a unit, of all axes.
    pub steps: f64,
    /// Units a minute at G0.
    pub rate: f64,
    /// It restarts when its port is opened, as Arduinos do.
    pub restarts: bool,
    /// From a restart to its banner.
    pub boot: Duration,
    /// $22: it is locked until homed.
    pub homing: bool,
    /// $10: it reports machine positions, in place of work positions.
    pub machine: bool,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            steps: 80.0,
            // 60 units a second.
            rate: 3600.0,
            restarts: false,
            boot: Duration::from_millis(20),
            homing: false,
            machine: true,
        }
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Mode {
    Normal,
    Hold,
    Alarm,
}

/// The board.
pub struct Grbl {
    settings: Settings,
    world: World,
    /// Where in the world its machine zero is.
    origin: [f64; AXES],
    mode: Mode,
    /// Of G92.
    shift: [f64; AXES],
    relative: bool,
    rapid: bool,
    feed: f64,
    line: Vec<u8>,
    /// Lines that wait for a dwell or a homing to end.
    lines: VecDeque<String>,
    answers: VecDeque<String>,
    /// The answer to a line that takes its time, and when it is given.
    slow: Option<(Instant, String)>,
    homing: bool,
    /// The banner is said then; until then it hears nothing.
    boots: Option<Instant>,
    reports: u32,
}

impl Grbl {
    /// A board that moves this world, and has just been switched on.
    pub fn new(settings: Settings, world: World) -> Self {
        let mode = if settings.homing { Mode::Alarm } else { Mode::Normal };
        Self {
            origin: world.rest(),
            settings,
            world,
            mode,
            shift: [0.0; AXES],
            relative: false,
            rapid: true,
            feed: 0.0,
            line: Vec::new(),
            lines: VecDeque::new(),
            answers: VecDeque::new(),
            slow: None,
            homing: false,
            boots: None,
            reports: 0,
        }
    }

    fn say(&mut self, text: &str) {
        self.answers.push_back(format!("{text}\r\n"));
    }

    /// From power-up: steps are counted from here on.
    fn power_up(&mut self, now: Instant) {
        self.origin = self.world.stop();
        self.mode = if self.settings.homing { Mode::Alarm } else { Mode::Normal };
        self.forget();
        self.boots = Some(now + self.settings.boot);
    }

    /// What every reset clears.
    fn forget(&mut self) {
        self.shift = [0.0; AXES];
        (self.relative, self.rapid, self.feed, self.homing) = (false, true, 0.0, false);
        self.line.clear();
        self.lines.clear();
        self.answers.clear();
        self.slow = None;
        self.reports = 0;
    }

    fn banner(&mut self) {
        self.say("");
        self.say("Grbl 1.1h ['$' for help]");
        if self.mode == Mode::Alarm {
            self.say("[MSG:'$H'|'$X' to unlock]");
        }
    }

    /// 0x18. In motion steps are lost.
    fn soft_reset(&mut self) {
        let moving = self.world.seen().moving;
        self.world.stop();
        self.forget();
        if moving && self.mode != Mode::Hold {
            self.mode = Mode::Alarm;
            self.say("ALARM:3");
        } else if self.mode == Mode::Hold {
            self.mode = Mode::Normal;
        }
        self.banner();
    }

    fn report(&mut self) {
        let seen = self.world.seen();
        let word = match self.mode {
            Mode::Alarm => "Alarm",
            Mode::Hold => "Hold:0",
            Mode::Normal if seen.moving || self.slow.is_some() => "Run",
            Mode::Normal => "Idle",
        };
        if word == "Idle" {
            self.world.publish();
        }
        let step = |units: f64| (units * self.settings.steps).round() / self.settings.steps;
        let machine: [f64; AXES] = std::array::from_fn(|n| step(seen.at[n] - self.origin[n]));
        let words = |values: [f64; AXES]| {
            let three: Vec<String> = values[..3].iter().map(|v| format!("{v:.3}")).collect();
            three.join(",")
        };
        let position = match self.settings.machine {
            true => format!("MPos:{}", words(machine)),
            false => format!("WPos:{}", words(std::array::from_fn(|n| machine[n] - self.shift[n]))),
        };
        // REPORT_WCO_REFRESH_IDLE_COUNT
        let offset =
            if self.reports.is_multiple_of(10) { format!("|WCO:{}", words(self.shift)) } else { String::new() };
        self.reports += 1;
        self.say(&format!("<{word}|{position}|FS:0,0{offset}>"));
    }

    fn take_line(&mut self, line: &str, now: Instant) {
        let line: String = line.chars().filter(|c| !c.is_whitespace()).collect::<String>().to_ascii_uppercase();
        let locked = self.mode == Mode::Alarm;
        let idle = self.mode != Mode::Hold && !self.world.seen().moving;
        match line.as_str() {
            "" => self.say("ok"),
            "$G" => {
                self.say("[GC:G0 G54 G17 G21 G90 G94 M5 M9 T0 F0 S0]");
                self.say("ok");
            }
            "$X" => {
                self.mode = Mode::Normal;
                self.say("[MSG:Caution: Unlocked]");
                self.say("ok");
            }
            "$$" | "$#" | "$I" | "$H" if !idle => self.say("error:8"),
            "$$" => self.list_settings(),
            "$#" => self.list_offsets(),
            "$I" => {
                self.say("[VER:1.1h.20190825:]");
                self.say("[OPT:V,15,128]");
                self.say("ok");
            }
            "$H" if !self.settings.homing => self.say("error:5"),
            "$H" => {
                // To the switches, which are where the world's zero is.
                self.mode = Mode::Normal;
                let ends =
                    self.world.plan([0.0; AXES], self.duration(self.world.rest(), [0.0; AXES], self.settings.rate));
                self.homing = true;
                self.slow = Some((ends.max(now), "ok".to_owned()));
            }
            _ if line.starts_with('$') => self.say("error:3"),
            _ if locked => self.say("error:9"),
            _ => self.g_code(&line),
        }
    }

    fn list_settings(&mut self) {
        let homing = u32::from(self.settings.homing);
        let steps = self.settings.steps;
        for (number, value) in [(0, 10.0), (1, 255.0), (10, f64::from(u32::from(self.settings.machine))), (13, 0.0)] {
            self.say(&format!("${number}={value}"));
        }
        self.say(&format!("$22={homing}"));
        (100..103).for_each(|number| self.say(&format!("${number}={steps:.3}")));
        self.say("ok");
    }

    fn list_offsets(&mut self) {
        for name in ["G54", "G55", "G56", "G57", "G58", "G59", "G28", "G30"] {
            self.say(&format!("[{name}:0.000,0.000,0.000]"));
        }
        let [x, y, z, _] = self.shift;
        self.say(&format!("[G92:{x:.3},{y:.3},{z:.3}]"));
        self.say("[TLO:0.000]");
        self.say("[PRB:0.000,0.000,0.000:0]");
        self.say("ok");
    }

    /// One block. Nothing is done of one that has a mistake.
    fn g_code(&mut self, line: &str) {
        let Some(words) = words(line) else { return self.say("error:2") };
        let (mut target, mut given) = ([0.0; AXES], [false; AXES]);
        let (mut machine, mut shifts, mut dwells, mut seconds) = (false, false, false, 0.0);
        let (mut relative, mut rapid, mut feed) = (self.relative, self.rapid, self.feed);
        for (letter, value) in words {
            match (letter, value) {
                ('G', v) if v == 0.0 || v == 1.0 => rapid = v == 0.0,
                ('G', 4.0) => dwells = true,
                ('G', 53.0) => machine = true,
                ('G', v) if v == 90.0 || v == 91.0 => relative = v == 91.0,
                ('G', 92.0) => shifts = true,
                ('G', v) if [17.0, 21.0, 54.0, 94.0].contains(&v) => {}
                ('F', v) if v > 0.0 => feed = v,
                ('P', v) if v >= 0.0 => seconds = v,
                ('X' | 'Y' | 'Z' | 'A', v) => {
                    let axis = ['X', 'Y', 'Z', 'A'].iter().position(|known| *known == letter).unwrap_or_default();
                    (target[axis], given[axis]) = (v, true);
                }
                ('G' | 'M', _) => return self.say("error:20"),
                _ => return self.say("error:33"),
            }
        }
        let moves = given.contains(&true) && !shifts;
        if moves && !rapid && feed == 0.0 {
            return self.say("error:22");
        }
        (self.relative, self.rapid, self.feed) = (relative, rapid, feed);
        let rest = self.world.rest();
        if shifts {
            for n in (0..AXES).filter(|n| given[*n]) {
                self.shift[n] = rest[n] - self.origin[n] - target[n];
            }
            self.reports = 0;
        } else if moves {
            let to: [f64; AXES] = std::array::from_fn(|n| match (given[n], relative, machine) {
                (false, ..) => rest[n],
                (true, true, _) => rest[n] + target[n],
                (true, false, true) => self.origin[n] + target[n],
                (true, false, false) => self.origin[n] + self.shift[n] + target[n],
            });
            let rate = if rapid { self.settings.rate } else { feed.min(self.settings.rate) };
            self.world.plan(to, self.duration(rest, to, rate));
        }
        if dwells {
            let ends = self.world.plan(self.world.rest(), Duration::try_from_secs_f64(seconds).unwrap_or_default());
            self.slow = Some((ends, "ok".to_owned()));
        } else {
            self.say("ok");
        }
    }

    fn duration(&self, from: [f64; AXES], to: [f64; AXES], per_minute: f64) -> Duration {
        let length = from.iter().zip(to).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
        Duration::try_from_secs_f64(length / per_minute * 60.0).unwrap_or_default()
    }

    /// What time has brought about.
    fn tick(&mut self, now: Instant) {
        if self.boots.is_some_and(|at| at <= now) {
            self.boots = None;
            self.banner();
        }
        if self.boots.is_some() || self.mode == Mode::Hold {
            return;
        }
        loop {
            if let Some((at, answer)) = self.slow.take() {
                if at > now {
                    self.slow = Some((at, answer));
                    return;
                }
                if std::mem::take(&mut self.homing) {
                    self.origin = self.world.rest();
                }
                self.world.publish();
                self.say(&answer);
            }
            let Some(line) = self.lines.pop_front() else { return };
            self.take_line(&line, now);
        }
    }
}

/// As in `G90G1X-1.5F600`: letters with their numbers.
fn words(line: &str) -> Option<Vec<(char, f64)>> {
    let mut words = Vec::new();
    let mut rest = line;
    while let Some(letter) = rest.chars().next() {
        if !letter.is_ascii_uppercase() {
            return None;
        }
        rest = &rest[1..];
        let end = rest.find(|c: char| !(c.is_ascii_digit() || c == '.' || c == '-')).unwrap_or(rest.len());
        words.push((letter, rest[..end].parse().ok()?));
        rest = &rest[end..];
    }
    Some(words)
}

impl Board for Grbl {
    fn opened(&mut self) {
        if self.settings.restarts {
            self.power_up(Instant::now());
        }
    }

    fn take(&mut self, bytes: &[u8]) {
        for byte in bytes {
            let now = Instant::now();
            self.tick(now);
            if self.boots.is_some() {
                continue;
            }
            match byte {
                // Homing hears nothing but a reset.
                0x18 => self.soft_reset(),
                b'?' if !self.homing => self.report(),
                b'!' if self.mode == Mode::Normal && !self.homing => {
                    self.world.stop();
                    self.mode = Mode::Hold;
                }
                // What was held is not resumed: relume resets.
                b'~' | b'?' | b'!' => {}
                b'\n' | b'\r' => {
                    let line = String::from_utf8_lossy(&std::mem::take(&mut self.line)).into_owned();
                    // An empty line is answered too; \r\n is one end.
                    if *byte == b'\n' {
                        self.lines.push_back(line);
                    } else {
                        self.line = line.into_bytes();
                    }
                }
                _ if self.line.len() < 256 => self.line.push(*byte),
                _ => {}
            }
        }
    }

    fn answer(&mut self) -> Option<Vec<u8>> {
        self.tick(Instant::now());
        self.answers.pop_front().map(String::into_bytes)
    }

    fn wakes(&self) -> Option<Instant> {
        self.boots.or(self.slow.as_ref().map(|(at, _)| *at)).filter(|_| self.mode != Mode::Hold)
    }

    fn works(&self) -> bool {
        self.world.seen().moving
    }

    fn restart(&mut self) {
        self.power_up(Instant::now());
    }

    fn alarm(&mut self) {
        self.world.stop();
        self.mode = Mode::Alarm;
        self.lines.clear();
        self.slow = None;
        self.say("ALARM:1");
        self.say("[MSG:Reset to continue]");
    }
}
