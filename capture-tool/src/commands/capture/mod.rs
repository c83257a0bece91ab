//! `relume capture`: a rig, a camera and an object -> a session folder.

mod devices;

use std::path::{Path, PathBuf};
use std::time::Duration;

use clap::{Args, ValueEnum};
use relume_core::Error;

use super::values;
use crate::capture::explicit::Explicit;
use crate::capture::patterns::{self, Samples, Sets};
use crate::capture::plan::Plan;
use crate::capture::run::{End, Limits, Outcome, run};
use crate::capture::{Listed, Sampler, Step, Times, scan};
use crate::devices::rehearsal::Fault;
use crate::devices::{Camera, Finding, Trouble};
use crate::new_folder;
use crate::pack::records::Records;
use crate::rigs::{Condition, Kind, Rig, RigFile, virtual_emitter, virtual_stage};
use crate::session::{CaptureDescription, Description, Role, Session, Source};
use crate::watchdog::Watchdog;

/// Steps from here on are pictures shown by `--reference`.
const PICTURES: u64 = 1 << 32;

const EXAMPLES: &str = "\
Examples:
  relume capture presets/rigs/virtual-stage.toml --session vase --plan
  relume capture presets/rigs/virtual-stage.toml --session vase
  relume capture --session vase --resume
  relume capture --session vase --resume --max-time 2h
  relume capture --session vase --resume --redo 37,52-60
  relume capture presets/rigs/virtual-monitor.toml --session glass --sampler noise --only calibration
  relume capture --session glass --resume --reference sunset.png
  relume capture presets/rigs/virtual-monitor.toml --session jar --sampler explicit --functions 600
  relume capture --session jar --resume --functions 1200 --threshold 0.002
  relume capture presets/rigs/virtual-monitor.toml --session bare --bare
  relume capture presets/rigs/virtual-gantry.toml --session toys --sampler separable --influence 4
  relume capture --session toys --resume --brute-force 7,12
  relume capture presets/rigs/stage-devices.toml --session bust
  relume capture stage.toml --session bust --resume

A rig file with a table [devices] drives real ones: `relume rig check` tries them first, `relume rig simulate` rehearses. Given again with
--resume, the file may name other ports than the session began with.
The scene of a virtual rig is computed once and kept in the cache folder (the variable RELUME_CACHE, or the system's).
Ctrl-C finishes the photograph in flight, switches the lamps off and says how to go on; a second one gives up the photograph in
flight. Whatever happens, the session keeps every finished photograph. Next: relume pack vase -o vase.rfield";

/// Raw flags.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    /// The rig file; those in presets/rigs explain every key. Not needed with --resume, unless devices are on other ports now.
    rig: Option<PathBuf>,
    /// The session folder: new, or one to go on with.
    #[arg(long, value_name = "DIR")]
    session: PathBuf,
    /// Which conditions, in which order [default: noise for a screen, else scan].
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
    /// With --sampler explicit: show so many basis functions at most [default: the rig file's].
    #[arg(long, value_name = "N", value_parser = values::at_least_one)]
    functions: Option<usize>,
    /// With --sampler explicit: places that weigh less than this share of the white screen get no finer functions; 0: all that
    /// are more than noise do [default: the rig file's].
    #[arg(long, value_name = "X", allow_negative_numbers = true, value_parser = values::share)]
    threshold: Option<f64>,
    /// With --sampler separable: light every so many squares of a line together [default: the rig file's].
    #[arg(long, value_name = "D", conflicts_with = "resume", value_parser = values::at_least_one)]
    influence: Option<usize>,
    /// With --sampler separable: photograph these positions square by square as well; `relume pack` says which need it.
    #[arg(long, value_name = "N,N-M", value_parser = values::numbers)]
    brute_force: Option<values::Numbers>,
    /// Photograph the bare screen, the object taken away: calibration patterns, black, white, and what --reference shows later.
    #[arg(long, conflicts_with_all = ["sampler", "functions", "threshold"])]
    bare: bool,
    /// Show this picture on the screen, photograph it, and nothing else: what a relit picture is to be held against (6.3).
    #[arg(long, value_name = "IMG", requires = "resume", conflicts_with_all = ["redo", "only"])]
    reference: Option<PathBuf>,
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
    /// Every lamp of a stage, every square of a screen or projector, one after another.
    Scan,
    /// Patterns of wavelet noise on a screen.
    Noise,
    /// Sets of every d-th square of a projector's rows and columns.
    Separable,
    /// Basis functions of a wavelet on a screen: what was seen of some decides which come next.
    Explicit,
    /// Of --bare.
    #[value(skip)]
    Bare,
}

impl SamplerChoice {
    const ALL: [Self; 5] = [Self::Scan, Self::Noise, Self::Separable, Self::Explicit, Self::Bare];

    /// The id in session files.
    fn id(self) -> &'static str {
        match self {
            Self::Scan => "scan",
            Self::Noise => "noise",
            Self::Separable => "separable",
            Self::Explicit => "explicit",
            Self::Bare => "bare",
        }
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Part {
    /// Response, black level, lamps' irradiances.
    Calibration,
}

/// Checked flags.
struct Job {
    rig: RigFile,
    sampler: SamplerChoice,
    /// Pattern sets of a screen or projector.
    sets: Sets,
    /// Known steps; of explicit sampling those before the first function.
    steps: Vec<Step>,
    limits: Limits,
    /// The picture to be shown and photographed, with its name in the session.
    picture: Option<(PathBuf, String)>,
}

impl Arguments {
    /// Plans, or captures.
    ///
    /// # Errors
    /// A bad rig file; a session that is there already, or is not; what is missing; what devices cannot do.
    pub fn run(self) -> anyhow::Result<String> {
        let job = self.job()?;
        if self.plan { self.told(&job) } else { self.carry_out(&job) }
    }

    fn job(&self) -> anyhow::Result<Job> {
        let (rig, sampler) = self.rig_and_sampler()?;
        anyhow::ensure!(
            self.rehearse.is_empty() || rig.is_virtual(),
            "--rehearse is for virtual devices; `relume rig simulate` rehearses with real drivers"
        );
        let (mut sets, mut steps) = steps(&rig, sampler)?;
        if let Some(positions) = &self.brute_force {
            anyhow::ensure!(
                sampler == SamplerChoice::Separable,
                "--brute-force is for --sampler separable; --sampler {} lights nothing in sets of squares",
                sampler.id()
            );
            steps.extend(patterns::one_by_one(&rig, &positions.0, &mut sets)?);
        }
        let picture = self.picture(&rig)?;
        if let Some((_, name)) = &picture {
            steps = vec![self.picture_step(name)?];
        }
        let limits = Limits {
            max_time: self.max_time,
            max_photos: self.max_photos,
            only_calibration: self.only == Some(Part::Calibration),
            redo: self.redo.clone().unwrap_or_default().0,
            faults: self.rehearse.clone(),
        };
        Ok(Job { rig, sampler, sets, steps, limits, picture })
    }

    /// `--reference`: a picture that can be shown, on a rig that can show it.
    fn picture(&self, rig: &RigFile) -> anyhow::Result<Option<(PathBuf, String)>> {
        let Some(path) = &self.reference else { return Ok(None) };
        anyhow::ensure!(rig.monitor.is_some(), "--reference {}: only a screen shows pictures", path.display());
        relume_core::image::probe_size(path)?;
        // Numbered, so that a second picture of one name does not take the place of the first.
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        Ok(Some((path.clone(), format!("{:04}-{name}", self.pictures()? + 1))))
    }

    /// Pictures that were shown and photographed so far.
    fn pictures(&self) -> anyhow::Result<u64> {
        Ok(Records::read(&self.session)?.of(Role::Picture).count() as u64)
    }

    /// Pictures come after all steps of the plan, numbered by how many there are: the same one may be shown again.
    fn picture_step(&self, name: &str) -> anyhow::Result<Step> {
        Ok(Step {
            index: PICTURES + self.pictures()?,
            condition: Condition::Picture(name.to_owned()),
            role: Role::Picture,
            times: Times::Series { of: Role::Sample, factor: 1.0 },
            scanned: 0,
        })
    }

    /// The rig and the sampler as flags, or the session to go on with, say.
    fn rig_and_sampler(&self) -> anyhow::Result<(RigFile, SamplerChoice)> {
        if !self.resume {
            let Some(path) = &self.rig else {
                anyhow::bail!(
                    "no rig file: give one, as in `relume capture presets/rigs/virtual-stage.toml`, or --resume"
                );
            };
            let rig = RigFile::read(path)?;
            if let Err(error) = new_folder::check(&self.session)
                && !self.plan
            {
                let is_session = self.session.join("session.toml").is_file();
                let advice = if is_session { "; to go on with it, add --resume" } else { "" };
                anyhow::bail!("{error}{advice}");
            }
            let usual = match (self.bare, rig.kind) {
                (true, Kind::Monitor) => SamplerChoice::Bare,
                (true, _) => anyhow::bail!("--bare: only a rig with a screen has a bare screen"),
                (false, Kind::Monitor) => SamplerChoice::Noise,
                (false, _) => SamplerChoice::Scan,
            };
            let sampler = self.sampler.unwrap_or(usual);
            return Ok((self.with_flags(rig, sampler)?, sampler));
        }
        let found = Description::read(&self.session)?;
        let place = self.session.display();
        let Source::Capture(mut capture) = found.source else {
            anyhow::bail!("{place}: a session of imported photographs; `relume pack` makes a field of it");
        };
        if let Some(path) = &self.rig {
            let mut rig = RigFile::read(path)?;
            // How far explicit sampling goes is no part of what the rig is; nor is the port that a board is plugged into today.
            if let (Some(asked), Some(begun)) = (&mut rig.monitor, &capture.rig.monitor) {
                (asked.functions, asked.threshold) = (begun.functions, begun.threshold);
            }
            let same_light = rig.same_light(&capture.rig);
            capture.rig.devices = rig.devices.clone();
            anyhow::ensure!(
                rig == capture.rig && same_light,
                "{}: not the rig that {place} was begun with; leave it out to go on, or begin a new session",
                path.display()
            );
        }
        let begun = SamplerChoice::ALL.iter().find(|known| known.id() == capture.sampler);
        let Some(begun) = begun else { anyhow::bail!("{place}: a sampler called `{}` is not known", capture.sampler) };
        let asked = if self.bare { SamplerChoice::Bare } else { self.sampler.unwrap_or(*begun) };
        let with = |choice: SamplerChoice| match choice {
            SamplerChoice::Bare => "--bare".to_owned(),
            other => format!("--sampler {}", other.id()),
        };
        anyhow::ensure!(asked == *begun, "{place}: begun with {}; begin a new session for another", with(*begun));
        Ok((self.with_flags(capture.rig, asked)?, asked))
    }

    /// The rig, with what flags say of explicit sampling and of sets of squares.
    fn with_flags(&self, mut rig: RigFile, sampler: SamplerChoice) -> anyhow::Result<RigFile> {
        if let Some(influence) = self.influence {
            let separable = sampler == SamplerChoice::Separable;
            let Some(gantry) = rig.gantry.as_mut().filter(|_| separable) else {
                anyhow::bail!("--influence is for --sampler separable with a projector");
            };
            gantry.influence = influence;
            gantry.check_squares("--influence")?;
        }
        if self.functions.is_none() && self.threshold.is_none() {
            return Ok(rig);
        }
        let explicit = sampler == SamplerChoice::Explicit;
        let Some(monitor) = rig.monitor.as_mut().filter(|_| explicit) else {
            anyhow::bail!("--functions and --threshold are for --sampler explicit on a screen");
        };
        monitor.functions = self.functions.unwrap_or(monitor.functions);
        monitor.threshold = self.threshold.unwrap_or(monitor.threshold);
        Ok(rig)
    }

    /// What `--plan` prints. Starts nothing, writes nothing.
    fn told(&self, job: &Job) -> anyhow::Result<String> {
        let all = job.planned();
        let wanted = all.iter().filter(|step| !job.limits.only_calibration || step.is_calibration());
        let told = Plan::new(&job.rig, wanted);
        let mut findings = vec![told.room(&self.session)];
        if job.rig.is_virtual() {
            findings.push(virtual_scene(&job.rig, job.sampler)?);
        }
        if job.rig.devices.is_some() {
            findings.push(Finding::fine("devices: not asked by a plan; `relume rig check` tries them"));
        }
        if !self.resume {
            findings.extend(new_folder::check(&self.session).err().map(|error| Finding::missing(error.to_string())));
        }
        Ok(told.text(&job.rig, &findings))
    }

    fn carry_out(&self, job: &Job) -> anyhow::Result<String> {
        let rig = &job.rig;
        let room = Plan::new(rig, job.planned().iter()).room(&self.session);
        anyhow::ensure!(room.fine || self.resume, "{}; make room first, or see --plan", room.text);
        let (mut emitter, mut camera) = self.devices(job)?;
        let findings: Vec<Finding> = emitter.preflight().into_iter().chain(camera.preflight()).collect();
        if let Some(missing) = findings.iter().find(|finding| !finding.fine) {
            anyhow::bail!("{}; nothing was started", missing.text);
        }
        if let Some(truth) = &self.truth {
            let known = rig.stage.is_some() && rig.is_virtual();
            anyhow::ensure!(known, "--truth: only a virtual stage has a field to compare with");
            copy_whole(&virtual_stage::cached(rig)?, truth)?;
        }
        let mut session = self.session(job)?;
        if let Some((path, name)) = &job.picture {
            let folder = self.session.join(devices::REFERENCES);
            std::fs::create_dir_all(&folder).map_err(|source| Error::io("create", &folder, source))?;
            copy_whole(path, &folder.join(name))?;
        }
        let mut sampler = self.sampler(job)?;
        let _watchdog = Watchdog::start(rig)?;
        let ended = run(&mut session, rig, (&mut *emitter, &mut *camera), &mut *sampler, &job.limits);
        self.report(&session, job, &*sampler, ended)
    }

    fn sampler(&self, job: &Job) -> anyhow::Result<Box<dyn Sampler>> {
        Ok(match job.chooses() {
            true => Box::new(Explicit::new(&self.session, &job.rig, job.steps.clone(), &job.sets)?),
            false => Box::new(Listed::new(job.steps.clone())),
        })
    }

    fn devices(&self, job: &Job) -> anyhow::Result<(Box<dyn Rig>, Box<dyn Camera>)> {
        devices::open(&devices::Wanted {
            rig: &job.rig,
            scanned: scan::count(&job.steps),
            bare: job.sampler == SamplerChoice::Bare,
            sets: &job.sets,
            session: &self.session,
            faults: &self.rehearse,
        })
    }

    fn session(&self, job: &Job) -> anyhow::Result<Session> {
        if self.resume {
            let session = Session::open(&self.session)?;
            let damaged = session.damaged();
            if !damaged.is_empty() {
                let numbers: Vec<String> = damaged.iter().take(10).map(|p| p.number.to_string()).collect();
                super::note(&format!(
                    "{} photographs are not as they were stored ({}); they are taken again",
                    damaged.len(),
                    numbers.join(", ")
                ));
            }
            return Ok(session);
        }
        let rig = job.rig.clone();
        let capture = CaptureDescription { sampler: job.sampler.id().to_owned(), seed: rig.simulation.seed, rig };
        Ok(Session::create(&self.session, Description::new(Source::Capture(Box::new(capture))))?)
    }

    /// How it ended, and what to do next.
    fn report(
        &self,
        session: &Session,
        job: &Job,
        sampler: &dyn Sampler,
        ended: Result<Outcome, Trouble>,
    ) -> anyhow::Result<String> {
        let place = self.session.display();
        let steps: Vec<u64> = match job.chooses() {
            true => (0..sampler.expected()).collect(),
            false => job.steps.iter().map(|step| step.index).collect(),
        };
        let answered = steps.iter().filter(|step| session.answer(**step).is_some()).count();
        let state = format!("{place}: {answered} of {} photographs", steps.len());
        let said = sampler.said().map_or_else(String::new, |said| format!("{said}\n"));
        let resume = format!("go on with: relume capture --session {place} --resume");
        match ended {
            Err(trouble) => Err(anyhow::anyhow!("{trouble}; {state} are safe; {resume}")),
            Ok(Outcome { end: End::Asked, .. }) => {
                super::note(&format!("{state}; {resume}"));
                Err(Error::Cancelled.into())
            }
            Ok(Outcome { end: End::Complete, taken }) if job.limits.only_calibration => {
                Ok(format!("{state} ({taken} taken now); calibration is complete; {resume}\n"))
            }
            Ok(Outcome { end: End::Complete, taken }) if job.sampler == SamplerChoice::Bare => {
                Ok(format!("{state} of the bare screen ({taken} taken now); pictures: {resume} --reference IMG\n"))
            }
            Ok(Outcome { end: End::Complete, taken }) => {
                Ok(format!("{state} ({taken} taken now)\n{said}next: relume pack {place} -o {place}.rfield\n"))
            }
            Ok(Outcome { end: End::Time | End::Photos, taken }) => {
                Ok(format!("{state} ({taken} taken now)\n{said}{resume}\n"))
            }
        }
    }
}

impl Job {
    /// Are steps chosen by what is seen?
    fn chooses(&self) -> bool {
        self.sampler == SamplerChoice::Explicit && self.picture.is_none()
    }

    /// All steps, as many as there may be.
    fn planned(&self) -> Vec<Step> {
        let mut steps = self.steps.clone();
        let functions = self.rig.monitor.as_ref().map_or(0, |monitor| monitor.functions);
        if let Some(set) = self.sets.get(Samples::Functions.set()).filter(|_| self.chooses()) {
            steps.extend(patterns::functions(set, functions, self.steps.len() as u64));
        }
        steps
    }
}

/// The steps of a rig, and the pattern sets they name.
fn steps(rig: &RigFile, sampler: SamplerChoice) -> anyhow::Result<(Sets, Vec<Step>)> {
    let samples = match (rig.kind, sampler) {
        (Kind::Stage, SamplerChoice::Scan) => {
            let stage = rig.stage.as_ref().ok_or_else(|| anyhow::anyhow!("{}: no [stage] table", rig.name))?;
            return Ok((Sets::new(), scan::steps(rig, stage)));
        }
        (Kind::Monitor | Kind::Gantry, SamplerChoice::Scan) => Samples::Squares,
        (Kind::Monitor, SamplerChoice::Noise) => Samples::Noise,
        (Kind::Gantry, SamplerChoice::Separable) => Samples::Crossed,
        (Kind::Monitor, SamplerChoice::Explicit) => Samples::Functions,
        (Kind::Monitor, SamplerChoice::Bare) => Samples::Bare,
        (Kind::Stage, _) => anyhow::bail!("--sampler {}: a stage is scanned", sampler.id()),
        (Kind::Monitor, _) => anyhow::bail!("--sampler {}: a screen takes scan, noise or explicit", sampler.id()),
        (Kind::Gantry, _) => anyhow::bail!("--sampler {}: a projector takes scan or separable", sampler.id()),
    };
    let sets = patterns::sets(rig, samples, rig.simulation.seed)?;
    let steps = patterns::steps(rig, &sets, samples);
    Ok((sets, steps))
}

fn virtual_scene(rig: &RigFile, sampler: SamplerChoice) -> anyhow::Result<Finding> {
    let path = match rig.kind {
        Kind::Stage => virtual_stage::cached(rig)?,
        Kind::Monitor | Kind::Gantry => virtual_emitter::cached(rig, sampler == SamplerChoice::Bare)?,
    };
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
