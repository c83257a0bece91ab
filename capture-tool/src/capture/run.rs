//! The loop.

use std::collections::HashMap;
use std::time::{Duration, Instant};

use relume_core::image::{Image, read_codes};
use relume_core::{Error, Result};
use std::sync::Arc;

use super::contact::ContactSheet;
use super::exposures::Exposures;
use super::log::Log;
use super::shoot::{Set, Shot, seconds};
use super::{Sampler, Step};
use crate::devices::rehearsal::Fault;
use crate::devices::{Camera, Trouble};
use crate::progress::{DevicesOn, Progress, Unit};
use crate::rigs::{Rig, RigFile};
use crate::session::{Photograph, Session};

/// The clock and the time that has passed may differ by so much before it is said.
const CLOCK_TOLERANCE_S: f64 = 5.0;

/// What ends a run early, and what it leaves out.
#[derive(Debug, Clone, Default)]
pub struct Limits {
    /// Stop after this time.
    pub max_time: Option<Duration>,
    /// Stop after so many photographs.
    pub max_photos: Option<u64>,
    /// Calibration alone.
    pub only_calibration: bool,
    /// Numbers of photographs to take again.
    pub redo: Vec<u64>,
    /// What virtual devices do wrong.
    pub faults: Vec<Fault>,
}

/// How a run ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum End {
    /// Every step has its photograph.
    Complete,
    /// `--max-time`.
    Time,
    /// `--max-photos`.
    Photos,
    /// Ctrl-C.
    Asked,
}

/// What a run did.
#[derive(Debug, Clone, Copy)]
pub struct Outcome {
    /// Photographs taken in this run.
    pub taken: u64,
    /// Why it ended.
    pub end: End,
}

/// Lights that go out, however the loop is left.
struct Powered<'a> {
    rig: &'a mut dyn Rig,
    log: Log,
}

impl Drop for Powered<'_> {
    fn drop(&mut self) {
        if let Err(trouble) = self.rig.dark() {
            let said = format!("the rig could not be switched off as it should: {trouble}");
            self.log.line(&said);
            crate::complain(&format!("warning: {said}; switch off by hand what is still on"));
        }
    }
}

/// Photographs what the sampler asks for and the session does not have yet.
///
/// # Errors
/// What a device cannot do, a full disk. The session then holds all photographs before.
pub fn run(
    session: &mut Session,
    rig_file: &RigFile,
    devices: (&mut dyn Rig, &mut dyn Camera),
    sampler: &mut dyn Sampler,
    limits: &Limits,
) -> Result<Outcome, Trouble> {
    let _devices_on = DevicesOn::begin();
    let root = session.root().to_owned();
    let powered = Powered { rig: devices.0, log: Log::open(&root)? };
    let mut run = Run {
        exposures: Exposures::new(rig_file, session),
        sheet: ContactSheet::new(&root)?,
        log: Log::open(&root)?,
        clock: Clock::new(),
        progress: Progress::new("capturing", Unit::Steps),
        patience: Duration::from_secs_f64(rig_file.camera.patience_s),
        taken: 0,
        begun: Instant::now(),
        limits,
        told: None,
    };
    let ended = run.steps(session, &mut *powered.rig, devices.1, sampler);
    // On a full disk the first error is the one to tell.
    let flushed = run.sheet.flush();
    run.log.line(&match &ended {
        Ok(end) => format!("ended ({end:?}) after {} photographs", run.taken),
        Err(trouble) => format!("ended after {} photographs: {trouble}", run.taken),
    });
    let end = ended?;
    flushed?;
    Ok(Outcome { taken: run.taken, end })
}

struct Run<'a> {
    exposures: Exposures<'a>,
    sheet: ContactSheet,
    log: Log,
    clock: Clock,
    progress: Progress,
    patience: Duration,
    taken: u64,
    begun: Instant,
    limits: &'a Limits,
    /// What the sampler said last.
    told: Option<String>,
}

impl Run<'_> {
    fn steps(
        &mut self,
        session: &mut Session,
        rig: &mut dyn Rig,
        camera: &mut dyn Camera,
        sampler: &mut dyn Sampler,
    ) -> Result<End, Trouble> {
        let redo = Redo::new(session, &self.limits.redo)?;
        while let Some(step) = sampler.next()? {
            if self.limits.only_calibration && !step.is_calibration() {
                continue;
            }
            let replaced = redo.replaced(&step);
            if let Some(answer) = session.answer(step.index) {
                check_same(&step, answer)?;
                if replaced.is_none() {
                    if self.progress.step(step.index, sampler.expected()).is_err() {
                        return Ok(End::Asked);
                    }
                    sampler.observe(&step, answer)?;
                    continue;
                }
            }
            if let Some(end) = self.wants_to_end(step.index, sampler.expected()) {
                return Ok(end);
            }
            let mut set = Set { rig, camera, patience: self.patience, waited: 0 };
            match self.photograph(session, &mut set, &step, replaced) {
                Err(Trouble::Failed(Error::Cancelled)) => return Ok(End::Asked),
                other => other?,
            }
            if let Some(answer) = session.answer(step.index) {
                sampler.observe(&step, answer)?;
                self.tell(sampler);
            }
        }
        Ok(End::Complete)
    }

    /// What the sampler makes of it, once.
    fn tell(&mut self, sampler: &dyn Sampler) {
        if let Some(said) = sampler.said().filter(|said| self.told.as_ref() != Some(said)) {
            self.progress.say(&said);
            self.log.line(&said);
            self.told = Some(said);
        }
    }

    fn wants_to_end(&mut self, done: u64, expected: u64) -> Option<End> {
        if self.progress.step(done, expected).is_err() {
            return Some(End::Asked);
        }
        if self.limits.max_photos.is_some_and(|most| self.taken >= most) {
            return Some(End::Photos);
        }
        self.limits.max_time.is_some_and(|most| self.begun.elapsed() >= most).then_some(End::Time)
    }

    fn photograph(
        &mut self,
        session: &mut Session,
        set: &mut Set<'_>,
        step: &Step,
        redo_of: Option<u64>,
    ) -> Result<(), Trouble> {
        let begun = Instant::now();
        let settings = self.exposures.settings(step, session, &mut self.log)?;
        let folder = session.begin()?;
        let number = folder.number();
        let shots = set.photograph(step, &settings, &folder)?;
        let thumbnails = shots.iter().map(thumbnail).collect::<Result<Vec<_>>>()?;
        let remarks = self.exposures.remarks(step, session, &shots, &thumbnails);
        let (time, jumped) = self.clock.now(self.taken + 1, &self.limits.faults);
        let photograph = Photograph {
            number,
            step: step.index,
            condition: step.condition.clone(),
            role: step.role,
            redo_of,
            frames: Vec::new(),
            beside: Vec::new(),
            time,
            seconds: (begun.elapsed().as_secs_f64() * 1e4).round() / 1e4,
            remarks: remarks.clone(),
        };
        let files: Vec<_> = shots.iter().map(|shot| (shot.file.clone(), shot.exposure)).collect();
        let beside: Vec<_> = shots.iter().flat_map(|shot| shot.beside.iter().cloned()).collect();
        session.finish(folder, &files, &beside, photograph)?;
        self.taken += 1;
        let times: Vec<String> = shots.iter().map(|shot| seconds(shot.exposure.time_s)).collect();
        let mut line = format!("{number:6}  {}, {}", step.condition, times.join(" "));
        if set.waited > 0 {
            line += &format!("; a device was busy {} times", set.waited);
        }
        remarks.iter().for_each(|remark| line += &format!("; {remark}"));
        self.log.line(&line);
        if let Some(jump) = jumped {
            self.log.line(&jump);
            crate::complain(&format!("note: {jump}"));
        }
        if let Some(shown) = super::contact::best(&thumbnails) {
            self.sheet.add(number, shown, &step.condition.to_string())?;
        }
        Ok(())
    }
}

/// The camera's thumbnail, or the file.
fn thumbnail(shot: &Shot) -> Result<Arc<Image>> {
    match &shot.thumbnail {
        Some(thumbnail) => Ok(thumbnail.clone()),
        None => read_codes(&shot.file).map(|(codes, _)| Arc::new(codes.into_rgb())),
    }
}

/// The same session, another plan: somebody edited `session.toml`, or the tool changed.
fn check_same(step: &Step, answer: &Photograph) -> Result<()> {
    if (&answer.condition, answer.role) == (&step.condition, step.role) {
        return Ok(());
    }
    let found = format!("photograph {} of {}", answer.number, answer.condition);
    let expected = format!("{}, the plan's step {}; begin a new session", step.condition, step.index + 1);
    Err(Error::invalid("the session", found, expected))
}

/// Steps to be photographed though the journal has an answer, with the photographs they replace.
struct Redo(HashMap<u64, u64>);

impl Redo {
    /// Those asked for, and those whose files are damaged.
    fn new(session: &Session, asked: &[u64]) -> Result<Self> {
        let last = session.photographs().count() as u64;
        if let Some(wrong) = asked.iter().find(|number| !(1..=last).contains(*number)) {
            let expected = format!("numbers from 1 to {last}, as on the contact sheet");
            return Err(Error::invalid("photographs to take again", format!("number {wrong}"), expected));
        }
        let asked = session.photographs().filter(|p| asked.contains(&p.number));
        Ok(Self(asked.chain(session.damaged()).map(|p| (p.step, p.number)).collect()))
    }

    /// The photograph that a step's new one replaces.
    fn replaced(&self, step: &Step) -> Option<u64> {
        self.0.get(&step.index).copied()
    }
}

/// Timestamps for people; nothing is measured with them.
struct Clock {
    started: (jiff::Timestamp, Instant),
}

impl Clock {
    fn new() -> Self {
        Self { started: (jiff::Timestamp::now(), Instant::now()) }
    }

    /// Now, and a sentence where the clock was changed since the last time.
    fn now(&mut self, exposure: u64, faults: &[Fault]) -> (String, Option<String>) {
        let mut now = jiff::Timestamp::now();
        if faults.iter().any(|fault| matches!(fault, Fault::Clock(at) if exposure >= *at)) {
            now = now.checked_sub(jiff::SignedDuration::from_hours(24)).unwrap_or(now);
        }
        let passed = self.started.1.elapsed().as_secs_f64();
        let jump = now.duration_since(self.started.0).as_secs_f64() - passed;
        let said = (jump.abs() > CLOCK_TOLERANCE_S).then(|| {
            self.started = (now, Instant::now());
            let way = if jump > 0.0 { "forward" } else { "back" };
            format!(
                "the computer's clock was put {way} by {:.0} s; times in the journal jump, nothing else changes",
                jump.abs()
            )
        });
        (now.strftime("%Y-%m-%dT%H:%M:%S%.3fZ").to_string(), said)
    }
}
