//! A board with GRBL 1.1 on a serial port: turntable and arm.
//!
//! **Arrived** is more than `ok`, which says that a line was taken. After each move come `G4 P0`, which is answered when motion has
//! ended, `$#`, whose answer has a shape of its own, and two reports that say Idle at the position asked for. Only then does the
//! settling time begin. Moves are absolute, so that whatever answer was lost or damaged, the same may be asked again.
//!
//! **Known positions.** GRBL counts steps from wherever it was started: a restart in mid-session (a brown-out, a bumped cable) looks
//! like any other position. So when positions are made known, an axis that the rig does not use is given an offset by `G92`, which
//! every restart and reset clears; it is looked for before and after each move, also where the banner of the restart was lost. A
//! board that still has the mark when a session is resumed (one that does not restart when its port is opened) is believed.
//! With `home = true` the limit switches say where zero is, in machine coordinates (`G53`); without, the operator puts the axes at
//! their zero, and `G92` makes that the zero of work coordinates.
//!
//! The shortest way is never taken, since cables wind up: 350 degrees is not -10.
//!
//! | part | what it holds |
//! |---|---|
//! | `report` | what a line means |
//! | `board` | commands and their answers, and what comes between |
//! | `words` | alarms and errors in words |

mod board;
mod report;
mod words;

#[cfg(all(test, unix))]
mod tests;

use std::collections::HashMap;
use std::sync::Arc;
use std::time::Duration;

use board::{Board, Patience, Upset};
use report::{Said, State};

use super::{Axes, Place};
use crate::devices::port::{Port, pause, seconds};
use crate::devices::{Finding, Operator, Trouble};
use crate::rigs::{AxesDevice, Axis};

/// Work position given to the unused axis: a number that nobody chooses, within what boards accept.
const MARK: f64 = 92.714;
/// Numbers are told with three decimals.
const ROUNDING: f64 = 0.0015;
/// The same is asked so often before a person is.
const ATTEMPTS: usize = 4;
/// Letters of axes, in the order of reports.
const LETTERS: [char; 4] = ['X', 'Y', 'Z', 'A'];
/// Settings of GRBL that are looked at.
const IDLE_LOCK: u32 = 1;
const INCHES: u32 = 13;
const HOMING: u32 = 22;
const STEPS: u32 = 100;

/// The board, and the axes on it.
pub struct Grbl {
    board: Board,
    operator: Arc<dyn Operator>,
    home: bool,
    turntable: Option<Geared>,
    arm: Option<Geared>,
    settle: Duration,
    move_limit: Duration,
    settings: HashMap<u32, f64>,
    /// Positions are known, as far as this run has seen.
    known: bool,
    /// It was sent somewhere and has not been seen at rest since.
    moving: bool,
    /// It looks for its switches.
    homing: bool,
    /// It moved since it last settled.
    unsettled: bool,
}

/// An axis and its place on the board.
struct Geared {
    axis: Axis,
    /// As in "the turntable".
    name: &'static str,
    /// Its place in reports.
    at: usize,
    /// Its last motion was upwards: its play is taken up.
    from_below: bool,
}

impl Geared {
    fn new(axis: &Axis, name: &'static str) -> Result<Self, Trouble> {
        let at = LETTERS.iter().position(|letter| letter.eq_ignore_ascii_case(&axis.letter)).ok_or_else(|| {
            Trouble::stop(format!("{name} has the letter {}", axis.letter), "write X, Y, Z or A in the rig file")
        })?;
        Ok(Self { axis: axis.clone(), name, at, from_below: false })
    }

    fn units(&self, deg: f64) -> f64 {
        self.axis.zero + deg * self.axis.per_deg
    }

    fn degrees(&self, units: f64) -> f64 {
        (units - self.axis.zero) / self.axis.per_deg
    }

    /// Refuses what it must not be moved to, before anything is sent.
    fn check(&self, deg: f64) -> Result<(), Trouble> {
        let Axis { limits_deg: [low, high], backlash_deg, .. } = self.axis;
        // Not a number is outside as well.
        if !(low..=high).contains(&deg) {
            let what = format!("{} is to go to {deg:.2} degrees, outside {low} to {high}", self.name);
            return Err(Trouble::stop(what, "correct limits_deg or the positions in the rig file"));
        }
        if deg - backlash_deg < low {
            let what = format!(
                "{} comes to {deg:.2} degrees from backlash_deg = {backlash_deg} below, outside {low} to {high}",
                self.name
            );
            return Err(Trouble::stop(what, "leave room below the lowest position in limits_deg"));
        }
        Ok(())
    }
}

impl Grbl {
    /// Opens the board of a rig file's axes and reads its settings.
    ///
    /// # Errors
    /// No such port; a board that does not answer as GRBL 1.1 does, or reports inches.
    pub fn open(device: &AxesDevice, operator: &Arc<dyn Operator>) -> Result<Self, Trouble> {
        let AxesDevice::Grbl { port, baud, .. } = device else {
            return Err(Trouble::stop("axes without a board were to be opened as one", "this is a mistake in relume"));
        };
        Self::over(Port::open(port, *baud)?, device, operator)
    }

    /// Over a port that is open.
    pub fn over(port: Port, device: &AxesDevice, operator: &Arc<dyn Operator>) -> Result<Self, Trouble> {
        let AxesDevice::Grbl { home, turntable, arm, settle_s, reply_s, move_limit_s, .. } = device else {
            return Err(Trouble::stop("axes without a board were to be opened as one", "this is a mistake in relume"));
        };
        let geared = |axis: &Option<Axis>, name| axis.as_ref().map(|axis| Geared::new(axis, name)).transpose();
        let name = port.name().to_owned();
        let board = Board::open(port, seconds(*reply_s)).map_err(|upset| upset.told(&name))?;
        let mut axes = Self {
            board,
            operator: operator.clone(),
            home: *home,
            turntable: geared(turntable, "the turntable")?,
            arm: geared(arm, "the arm")?,
            settle: seconds(*settle_s),
            move_limit: seconds(*move_limit_s),
            settings: HashMap::new(),
            known: false,
            moving: false,
            homing: false,
            unsettled: false,
        };
        axes.settings = axes.stubbornly(Self::read_settings)?;
        if axes.settings.get(&INCHES).is_some_and(|inches| *inches != 0.0) {
            let what = format!("the board at {name} reports inches ($13=1)");
            return Err(Trouble::stop(what, "send it $13=0, with its own tool"));
        }
        Ok(axes)
    }

    fn geared(&self) -> impl Iterator<Item = &Geared> {
        self.turntable.iter().chain(&self.arm)
    }

    /// Does it again where noise may have been at work.
    fn stubbornly<T>(&mut self, mut ask: impl FnMut(&mut Self) -> Result<T, Upset>) -> Result<T, Trouble> {
        let mut attempt = 1;
        loop {
            match ask(self) {
                Ok(answer) => return Ok(answer),
                Err(upset) if upset.may_pass() && attempt < ATTEMPTS => attempt += 1,
                Err(upset) => {
                    if matches!(upset, Upset::Restarted | Upset::Alarm(_)) {
                        self.known = false;
                    }
                    return Err(upset.told(self.board.name()));
                }
            }
        }
    }

    fn read_settings(&mut self) -> Result<HashMap<u32, f64>, Upset> {
        // A restart is no accident yet.
        let state = match self.board.status() {
            Err(Upset::Restarted) => self.board.status()?.state,
            other => other?.state,
        };
        // Held, or in motion, it takes no lines: what is still queued from an earlier run is stopped and forgotten.
        if !matches!(state, State::Idle | State::Alarm) {
            self.board.hold()?;
            self.board.reset()?;
        }
        let heard = match self.board.command("$$", Patience::Reply) {
            Err(Upset::Restarted) => self.board.command("$$", Patience::Reply)?,
            other => other?,
        };
        let settings: HashMap<u32, f64> = heard
            .iter()
            .filter_map(|said| if let Said::Setting(n, v) = said { Some((*n, *v)) } else { None })
            .collect();
        let needed = self.geared().map(|axis| STEPS + axis.at as u32);
        if needed.chain([INCHES]).any(|n| !settings.contains_key(&n)) {
            return Err(Upset::Silent);
        }
        Ok(settings)
    }

    /// How far off a position may be: a step, and what is lost when it is told.
    fn tolerance(&self, axis: &Geared) -> f64 {
        let steps = self.settings.get(&(STEPS + axis.at as u32)).copied().unwrap_or_default();
        if steps > 0.0 { 1.0 / steps + ROUNDING } else { 0.01 }
    }

    /// The axis that carries the mark: one that the rig does not use.
    fn marked(&self) -> usize {
        (0..3).find(|at| self.geared().all(|axis| axis.at != *at)).unwrap_or(2)
    }

    /// Is the mark there? If not, the board was restarted or reset since positions were made known.
    fn has_mark(&mut self) -> Result<bool, Upset> {
        let marked = self.marked();
        // Seen twice: a damaged number is no restart.
        for _ in 0..2 {
            let heard = self.board.command("$#", Patience::Reply)?;
            let offset = heard.iter().find_map(|said| match said {
                Said::Offset(name, values) if name == "G92" => values.get(marked).copied(),
                _ => None,
            });
            // Machine less work coordinate; the unused axis stands at what the other offsets say, mostly zero.
            let Some(offset) = offset else { return Err(Upset::Silent) };
            if offset != 0.0 {
                return Ok(true);
            }
        }
        Ok(false)
    }

    fn need_mark(&mut self) -> Result<(), Upset> {
        if self.has_mark()? { Ok(()) } else { Err(Upset::Restarted) }
    }

    /// State and positions: reported twice alike, so that no damaged number is believed.
    fn look(&mut self) -> Result<(State, Vec<f64>), Upset> {
        let mut last = self.board.position(self.home)?;
        for _ in 0..ATTEMPTS {
            let next = self.board.position(self.home)?;
            if next == last {
                return Ok(next);
            }
            last = next;
        }
        Err(Upset::Silent)
    }

    /// State and positions, at rest.
    fn look_at_rest(&mut self) -> Result<Vec<f64>, Upset> {
        match self.look()? {
            (State::Idle, at) => Ok(at),
            (State::Alarm, _) => Err(Upset::Alarm(None)),
            (state @ (State::Hold(_) | State::Door | State::Sleep | State::Check), _) => Err(Upset::Resting(state)),
            // Of an earlier attempt: waited for.
            (State::Run | State::Jog | State::Home, _) => {
                self.board.command("G4 P0", Patience::Motion(self.move_limit))?;
                match self.look()? {
                    (State::Idle, at) => Ok(at),
                    _ => Err(Upset::Elsewhere),
                }
            }
        }
    }

    /// Sends the axes to positions in the board's units, and waits until they are there.
    fn run_to(&mut self, goals: &[(usize, f64)]) -> Result<(), Upset> {
        let speeds =
            self.geared().filter_map(|axis| axis.axis.speed_deg_s.map(|speed| speed * axis.axis.per_deg.abs()));
        // The feed of a line of two axes is that of neither: none exceeds the least.
        let feed = speeds.fold(None, |least: Option<f64>, speed| Some(least.map_or(speed, |least| least.min(speed))));
        let mut line =
            format!("G21G90G94{}{}", if self.home { "G53" } else { "" }, if feed.is_some() { "G1" } else { "G0" });
        goals.iter().for_each(|(at, units)| line += &format!("{}{units:.3}", LETTERS[*at]));
        feed.iter().for_each(|speed| line += &format!("F{:.1}", speed * 60.0));
        (self.moving, self.unsettled) = (true, true);
        self.board.command(&line, Patience::Reply)?;
        self.board.command("G4 P0", Patience::Motion(self.move_limit))?;
        self.need_mark()?;
        let at = self.look_at_rest()?;
        if !self.is_at(goals, &at) {
            return Err(Upset::Elsewhere);
        }
        self.moving = false;
        Ok(())
    }

    fn is_at(&self, goals: &[(usize, f64)], at: &[f64]) -> bool {
        goals.iter().all(|(axis, units)| {
            let tolerance = self.geared().find(|geared| geared.at == *axis).map_or(ROUNDING, |g| self.tolerance(g));
            at.get(*axis).is_some_and(|at| (at - units).abs() <= tolerance)
        })
    }

    /// One attempt to be at a place.
    fn attempt(&mut self, to: Place) -> Result<(), Upset> {
        self.need_mark()?;
        let at = self.look_at_rest()?;
        let wanted = [(&self.turntable, to.turntable_deg), (&self.arm, to.arm_deg)];
        let wanted: Vec<(&Geared, f64)> = wanted.into_iter().filter_map(|(axis, deg)| axis.as_ref().zip(deg)).collect();
        let goals: Vec<(usize, f64)> = wanted.iter().map(|(axis, deg)| (axis.at, axis.units(*deg))).collect();
        // From above, or from who knows where: first to below.
        let below: Vec<(usize, f64)> = wanted
            .iter()
            .filter(|(axis, deg)| {
                let now = at.get(axis.at).map_or(f64::NAN, |units| axis.degrees(*units));
                let rises = now <= deg + self.tolerance(axis) / axis.axis.per_deg.abs();
                axis.axis.backlash_deg > 0.0 && !(rises && axis.from_below)
            })
            .map(|(axis, deg)| (axis.at, axis.units(deg - axis.axis.backlash_deg)))
            .collect();
        if below.is_empty() && self.is_at(&goals, &at) {
            self.moving = false;
            return Ok(());
        }
        if !below.is_empty() {
            self.run_to(&below)?;
        }
        self.run_to(&goals)?;
        for axis in self.turntable.iter_mut().chain(&mut self.arm) {
            axis.from_below |= goals.iter().any(|(at, _)| *at == axis.at);
        }
        Ok(())
    }

    /// By the limit switches.
    fn find_switches(&mut self) -> Result<(), Upset> {
        if self.board.status()?.state != State::Idle {
            self.board.reset()?;
        }
        (self.moving, self.unsettled, self.homing) = (true, true, true);
        self.board.command("$H", Patience::Deaf(self.move_limit))?;
        self.homing = false;
        self.mark(&[])
    }

    /// Where the axes stand now is zero degrees.
    fn declare_zero(&mut self) -> Result<(), Upset> {
        self.board.left_alone();
        match self.board.status()?.state {
            State::Idle => {}
            State::Alarm => {
                // The operator has just seen to it that nothing is in the way.
                self.board.reset()?;
                if self.board.status()?.state == State::Alarm {
                    self.board.command("$X", Patience::Reply)?;
                }
            }
            _ => self.board.reset()?,
        }
        let zeros: Vec<(usize, f64)> = self.geared().map(|axis| (axis.at, axis.axis.zero)).collect();
        self.mark(&zeros)?;
        let at = self.look_at_rest()?;
        if self.is_at(&zeros, &at) { Ok(()) } else { Err(Upset::Elsewhere) }
    }

    /// Gives the unused axis its mark, and these axes their work positions.
    fn mark(&mut self, positions: &[(usize, f64)]) -> Result<(), Upset> {
        let mut line = format!("G21G92{}{MARK:.3}", LETTERS[self.marked()]);
        positions.iter().for_each(|(at, units)| line += &format!("{}{units:.3}", LETTERS[*at]));
        self.board.offset = None;
        self.board.command(&line, Patience::Reply)?;
        self.need_mark()
    }

    fn names(&self) -> String {
        let names: Vec<&str> = self.geared().map(|axis| axis.name).collect();
        names.join(" and ")
    }

    fn place_of(&self, at: &[f64]) -> Place {
        let degrees = |axis: &Option<Geared>| axis.as_ref().and_then(|axis| at.get(axis.at).map(|u| axis.degrees(*u)));
        Place { turntable_deg: degrees(&self.turntable), arm_deg: degrees(&self.arm) }
    }

    fn findings(&mut self) -> Result<Vec<Finding>, Trouble> {
        let name = self.board.name().to_owned();
        let state = self.stubbornly(|axes| axes.board.status())?.state;
        let known = state == State::Idle && self.stubbornly(Self::has_mark)?;
        let how = match (self.home, known) {
            (true, _) => "looks for its limit switches first",
            (false, true) => "knows its position",
            (false, false) => "the operator is asked to put the axes at zero",
        };
        let mut findings = match (state, self.home, self.settings.get(&HOMING)) {
            (State::Door, ..) => vec![Finding::missing(Upset::Resting(State::Door).told(&name).to_string())],
            (_, true, Some(0.0)) => vec![Finding::missing(format!(
                "axes: home = true, but the board at {name} has homing switched off ($22=0)"
            ))],
            _ => vec![Finding::fine(format!("axes: GRBL at {name}, {how}"))],
        };
        if self.settings.get(&IDLE_LOCK).is_some_and(|ms| *ms != 255.0) {
            findings.push(Finding::fine(format!(
                "axes: motors at {name} go slack {} ms after each move; $1=255 keeps them still",
                self.settings[&IDLE_LOCK]
            )));
        }
        Ok(findings)
    }
}

impl Axes for Grbl {
    fn preflight(&mut self) -> Vec<Finding> {
        self.findings().unwrap_or_else(|trouble| vec![Finding::missing(format!("axes: {trouble}"))])
    }

    fn home(&mut self) -> Result<(), Trouble> {
        self.turntable.iter_mut().chain(&mut self.arm).for_each(|axis| axis.from_below = false);
        if self.home {
            self.stubbornly(Self::find_switches)?;
        } else {
            let marked = |axes: &mut Self| match axes.board.status()?.state {
                State::Idle => axes.has_mark(),
                _ => Ok(false),
            };
            if !self.stubbornly(marked)? {
                let names = self.names();
                self.operator.ask(&format!("put {names} at 0 degrees, and see that nothing is in the way"))?;
                self.stubbornly(Self::declare_zero)?;
            }
        }
        (self.known, self.moving) = (true, false);
        Ok(())
    }

    fn go(&mut self, to: Place) -> Result<(), Trouble> {
        for (axis, deg) in [(&self.turntable, to.turntable_deg), (&self.arm, to.arm_deg)] {
            match (axis, deg) {
                (Some(axis), Some(deg)) => axis.check(deg)?,
                (None, Some(deg)) if deg != 0.0 => {
                    let what = format!("an axis is to go to {deg} degrees, and the rig file has none for it");
                    return Err(Trouble::stop(what, "add the turntable or the arm to [devices.axes]"));
                }
                _ => {}
            }
        }
        if !self.known {
            let what = "the axes are to move, and where they stand is not known";
            return Err(Trouble::stop(what, "resume makes positions known again"));
        }
        self.stubbornly(|axes| axes.attempt(to))?;
        if self.unsettled {
            pause(self.settle)?;
            self.unsettled = false;
        }
        Ok(())
    }

    fn nudge(&mut self, by: Place) -> Result<(), Trouble> {
        let moves = [(&self.turntable, by.turntable_deg), (&self.arm, by.arm_deg)];
        let mut line = "G21G91G0".to_owned();
        for (axis, deg) in moves.into_iter().filter_map(|(axis, deg)| axis.as_ref().zip(deg)) {
            line += &format!("{}{:.3}", LETTERS[axis.at], deg * axis.axis.per_deg);
        }
        (self.moving, self.unsettled) = (true, true);
        self.turntable.iter_mut().chain(&mut self.arm).for_each(|axis| axis.from_below = false);
        // Relative, so it is not sent twice.
        let moved = self.board.command(&line, Patience::Reply);
        let moved = moved.and_then(|_| self.board.command("G4 P0", Patience::Motion(self.move_limit)));
        moved.map_err(|upset| upset.told(self.board.name()))?;
        self.moving = false;
        Ok(())
    }

    fn place(&mut self) -> Result<Place, Trouble> {
        let at = self.stubbornly(|axes| {
            axes.need_mark()?;
            axes.look_at_rest()
        })?;
        Ok(self.place_of(&at))
    }

    fn hold(&mut self) -> Result<(), Trouble> {
        if !self.moving {
            return Ok(());
        }
        self.known = false;
        let held = if self.homing { self.board.abort().map(|()| true) } else { self.board.hold() };
        match held {
            Ok(true) => {
                self.moving = false;
                Ok(())
            }
            Ok(false) | Err(_) => {
                let what = format!("the axes at {} may still move: their board does not answer", self.board.name());
                Err(Trouble::stop(what, "switch the motors off by hand"))
            }
        }
    }
}
