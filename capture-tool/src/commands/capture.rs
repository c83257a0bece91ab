//! `relume capture`: a rig, a camera and an object -> a session folder.

use std::path::{Path, PathBuf};
use std::time::Duration;

use clap::{Args, ValueEnum};
use relume_core::Error;
use relume_core::hdr::Noise;
use relume_core::simulate::{Sensor, SensorResponse};

use super::values;
use crate::capture::plan::Plan;
use crate::capture::run::{End, Limits, Outcome, run};
use crate::capture::{Listed, Step, scan};
use crate::devices::rehearsal::Fault;
use crate::devices::virtual_camera::{VirtualCamera, Window};
use crate::devices::{Camera, Finding};
use crate::new_folder;
use crate::progress::{Progress, Unit};
use crate::rigs::virtual_stage::{self, VirtualStage};
use crate::rigs::{Rig, RigFile, SensorResponseChoice};
use crate::session::{CaptureDescription, Description, Session, Source};

const EXAMPLES: &str = "\
Examples:
  relume capture presets/rigs/virtual-stage.toml --session vase --plan
  relume capture presets/rigs/virtual-stage.toml --session vase
  relume capture --session vase --resume
  relume capture --session vase --resume --max-time 2h
  relume capture --session vase --resume --redo 37,52-60

Ctrl-C finishes the photograph in flight, switches the lamps off and says how to go on; a second one gives up the photograph in
flight. Whatever happens, the session keeps every finished photograph. Next: relume pack vase -o vase.rfield";

/// Raw flags.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    /// The rig file; those in presets/rigs explain every key. Not needed with --resume.
    rig: Option<PathBuf>,
    /// The session folder: new, or one to go on with.
    #[arg(long, value_name = "DIR")]
    session: PathBuf,
    /// Which conditions, in which order [default: scan].
    #[arg(long, value_enum)]
    sampler: Option<SamplerChoice>,
    /// Print the number of photographs, the time, the disk space and what is missing; start nothing.
    #[arg(long)]
    plan: bool,
    /// Go on with a session.
    #[arg(long)]
    resume: bool,
    /// Stop after this time, between two photographs: 90s, 45m, 2h, 1h30m.
    #[arg(long, value_name = "TIME", value_parser = values::duration)]
    max_time: Option<Duration>,
    /// Stop after so many photographs.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    max_photos: Option<u64>,
    /// Take a part of the photographs alone.
    #[arg(long, value_enum)]
    only: Option<Part>,
    /// Photograph these again, by their numbers (on the contact sheet, in the log, in photos/); the new ones count.
    #[arg(long, value_name = "N,N-M", requires = "resume", value_parser = values::numbers)]
    redo: Option<values::Numbers>,
    /// Rehearse a bad day with virtual devices, as in unplug@30: at exposure 30 the camera is unplugged. Kinds: unplug, busy, stuck,
    /// misread, silent-lamp (at lamp N), full-disk, clock, slow, bump. May be given several times.
    #[arg(long, value_name = "KIND@N")]
    rehearse: Vec<Fault>,
    /// Also write the field of a virtual rig without noise, to compare with.
    #[arg(long, value_name = "A.rfield")]
    truth: Option<PathBuf>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum SamplerChoice {
    /// Every lamp, all of a stop before the turntable moves.
    Scan,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Part {
    /// Response, black level, lamps' irradiances.
    Calibration,
}

/// Checked flags.
struct Job {
    rig: RigFile,
    steps: Vec<Step>,
    limits: Limits,
}

impl Arguments {
    /// Plans, or captures.
    ///
    /// # Errors
    /// A bad rig file; a session that is there already, or is not; what is missing; what devices cannot do.
    pub fn run(self) -> anyhow::Result<String> {
        let rig = self.rig_file()?;
        let Some(stage) = &rig.stage else { anyhow::bail!("{}: no [stage] table", rig.name) };
        let _ = self.sampler;
        let steps = scan::steps(&rig, stage);
        let limits = Limits {
            max_time: self.max_time,
            max_photos: self.max_photos,
            only_calibration: self.only == Some(Part::Calibration),
            redo: self.redo.clone().unwrap_or_default().0,
            faults: self.rehearse.clone(),
        };
        let plan_ = Job { rig, steps, limits };
        if self.plan { self.told(&plan_) } else { self.carry_out(&plan_) }
    }

    /// The rig as the file, or the session to go on with, says.
    fn rig_file(&self) -> anyhow::Result<RigFile> {
        if !self.resume {
            let Some(path) = &self.rig else {
                anyhow::bail!("no rig file: give one, as in `relume capture presets/rigs/virtual-stage.toml`, or --resume");
            };
            let rig = RigFile::read(path)?;
            if let Err(error) = new_folder::check(&self.session)
                && !self.plan
            {
                let is_session = self.session.join("session.toml").is_file();
                let advice = if is_session { "; to go on with it, add --resume" } else { "" };
                anyhow::bail!("{error}{advice}");
            }
            return Ok(rig);
        }
        let found = Description::read(&self.session)?;
        let Source::Capture(capture) = found.source else {
            anyhow::bail!("{}: a session of imported photographs; `relume pack` makes a field of it", self.session.display());
        };
        if let Some(path) = &self.rig {
            anyhow::ensure!(
                RigFile::read(path)? == capture.rig,
                "{}: not the rig that {} was begun with; leave it out to go on, or begin a new session",
                path.display(),
                self.session.display()
            );
        }
        Ok(capture.rig)
    }

    /// What `--plan` prints. Starts nothing, writes nothing.
    fn told(&self, plan: &Job) -> anyhow::Result<String> {
        let wanted = plan.steps.iter().filter(|step| !plan.limits.only_calibration || step.role.is_calibration());
        let told = Plan::new(&plan.rig, wanted);
        let findings = [told.room(&self.session), virtual_scene(&plan.rig)?];
        Ok(told.text(&plan.rig, &findings))
    }

    fn carry_out(&self, plan: &Job) -> anyhow::Result<String> {
        let rig = &plan.rig;
        let room = Plan::new(rig, plan.steps.iter()).room(&self.session);
        anyhow::ensure!(room.fine || self.resume, "{}; make room first, or see --plan", room.text);
        let (mut stage, mut camera) = self.devices(plan)?;
        let findings: Vec<Finding> = stage.preflight().into_iter().chain(camera.preflight()).collect();
        if let Some(missing) = findings.iter().find(|finding| !finding.fine) {
            anyhow::bail!("{}; nothing was started", missing.text);
        }
        if let Some(truth) = &self.truth {
            copy_whole(stage.transport(), truth)?;
        }
        let mut session = self.session(rig)?;
        let mut sampler = Listed::new(plan.steps.clone());
        let ended = run(&mut session, rig, (&mut stage, &mut camera), &mut sampler, &plan.limits);
        self.report(&session, plan, ended.map_err(anyhow::Error::new))
    }

    fn devices(&self, plan: &Job) -> anyhow::Result<(VirtualStage, VirtualCamera)> {
        let rig = &plan.rig;
        let window = Window::default();
        let mut progress = Progress::new("tracing the virtual scene", Unit::Steps);
        let scanned = scan::count(&plan.steps);
        let stage =
            VirtualStage::new(rig, scanned, window.clone(), &self.rehearse, &mut |done, all| progress.step(done, all))?;
        let camera = VirtualCamera::new(sensor(rig), window, &self.rehearse);
        Ok((stage, camera))
    }

    fn session(&self, rig: &RigFile) -> anyhow::Result<Session> {
        if self.resume {
            let session = Session::open(&self.session)?;
            let damaged = session.damaged();
            if !damaged.is_empty() {
                let numbers: Vec<String> = damaged.iter().take(10).map(u64::to_string).collect();
                super::note(&format!(
                    "{} photographs are not as they were stored ({}); they are taken again",
                    damaged.len(),
                    numbers.join(", ")
                ));
            }
            return Ok(session);
        }
        let capture = CaptureDescription { sampler: "scan".to_owned(), seed: rig.simulation.seed, rig: rig.clone() };
        Ok(Session::create(&self.session, Description::new(Source::Capture(Box::new(capture))))?)
    }

    /// How it ended, and what to do next.
    fn report(&self, session: &Session, plan: &Job, ended: anyhow::Result<Outcome>) -> anyhow::Result<String> {
        let place = self.session.display();
        let answered = plan.steps.iter().filter(|step| session.answer(step.index).is_some()).count();
        let state = format!("{place}: {answered} of {} photographs", plan.steps.len());
        let resume = format!("go on with: relume capture --session {place} --resume");
        match ended {
            Err(error) => Err(error.context(format!("capture stopped; {state} are safe; {resume}"))),
            Ok(Outcome { end: End::Asked, .. }) => {
                super::note(&format!("{state}; {resume}"));
                Err(Error::Cancelled.into())
            }
            Ok(Outcome { end: End::Complete, taken }) if plan.limits.only_calibration => {
                Ok(format!("{state} ({taken} taken now); calibration is complete; {resume}\n"))
            }
            Ok(Outcome { end: End::Complete, taken }) => {
                Ok(format!("{state} ({taken} taken now)\nnext: relume pack {place} -o {place}.rfield\n"))
            }
            Ok(Outcome { end: End::Time | End::Photos, taken }) => Ok(format!("{state} ({taken} taken now); {resume}\n")),
        }
    }
}

/// The camera's sensor.
fn sensor(rig: &RigFile) -> Sensor {
    let settings = &rig.simulation.sensor;
    Sensor {
        noise: Noise { full_well_e: settings.full_well_e, read_e: settings.read_e },
        bits: settings.bits,
        dark: settings.dark,
        response: match settings.response {
            SensorResponseChoice::Linear => SensorResponse::Linear,
            SensorResponseChoice::Film => SensorResponse::Film,
        },
    }
}

fn virtual_scene(rig: &RigFile) -> anyhow::Result<Finding> {
    let path = virtual_stage::cached(rig)?;
    Ok(Finding::fine(if path.is_file() {
        format!("virtual scene: traced, {}", path.display())
    } else {
        format!("virtual scene: to be traced first, into {}", path.display())
    }))
}

/// Copies a file; it appears whole or not at all.
fn copy_whole(from: &Path, to: &Path) -> relume_core::Result<()> {
    relume_core::files::write_whole(to, |out| {
        let copied = std::fs::File::open(from).and_then(|mut file| std::io::copy(&mut file, out));
        copied.map(|_| ()).map_err(|source| Error::io("copy to", to, source))
    })
}
