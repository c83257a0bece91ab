//! A rig of real devices: axes, lamps and a screen, driven in the one order that is safe.
//!
//! Motion complete -> settled -> lamp or pattern confirmed -> settled: only then does [`Rig::emit`] return, so that a photograph shows
//! neither the condition before nor a table that still trembles.

use std::path::PathBuf;
use std::sync::Arc;

use relume_core::math::Vec3;
use relume_core::{Error, Result};

use super::{Condition, Rig, RigFile, Shown, StageRig};
use crate::capture::Step;
use crate::capture::patterns::Sets;
use crate::devices::{Axes, Display, Finding, Lights, Operator, Place, Trouble, axes, displays, lights};
use crate::progress::SwitchingOff;

/// What stands in the object's place.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Target {
    Object,
    WhiteBall,
    WhiteCard,
    Chart,
}

impl Target {
    /// What a condition wants there.
    fn of(condition: &Condition) -> Self {
        match condition {
            Condition::WhiteBall(_) => Self::WhiteBall,
            Condition::FlatField(_) => Self::WhiteCard,
            Condition::Chart => Self::Chart,
            _ => Self::Object,
        }
    }
}

/// The devices of a rig; those that it does not have are absent.
pub struct Parts {
    /// Turntable and arm.
    pub axes: Option<Box<dyn Axes>>,
    /// Lamps.
    pub lights: Option<Box<dyn Lights>>,
    /// A screen or projector, and what it shows.
    pub display: Option<(Box<dyn Display>, Shown)>,
    /// Who puts targets in place.
    pub operator: Arc<dyn Operator>,
}

impl Parts {
    /// Opens the devices of a rig file. `sets` are the patterns of its screen, `references` is where pictures to be shown lie.
    ///
    /// # Errors
    /// A device that is not there or does not answer.
    pub fn open(rig: &RigFile, sets: Sets, references: PathBuf, operator: &Arc<dyn Operator>) -> Result<Self, Trouble> {
        let found = rig.devices.as_ref();
        let axes = found.and_then(|found| found.axes.as_ref()).map(|axes| axes::open(axes, operator)).transpose()?;
        let lamps = found.and_then(|found| found.lamps.as_ref());
        let lights = lamps.map(|lamps| lights::open(lamps, rig.bulbs())).transpose()?;
        let display = match found.and_then(|found| found.screen.as_ref()) {
            None => None,
            Some(screen) => Some((displays::open(screen, rig.texels()?)?, Shown::new(rig, sets, references)?)),
        };
        Ok(Self { axes, lights, display, operator: operator.clone() })
    }

    /// Looks at every device; moves nothing, lights nothing.
    pub fn preflight(&mut self) -> Vec<Finding> {
        let axes = self.axes.as_mut().map_or_else(Vec::new, |axes| axes.preflight());
        let lights = self.lights.as_mut().map_or_else(Vec::new, |lights| lights.preflight());
        let display = self.display.as_mut().map_or_else(Vec::new, |(display, _)| display.preflight());
        axes.into_iter().chain(lights).chain(display).collect()
    }

    /// Lamps off, screen black, motors held. All devices are tried, whatever the others do.
    ///
    /// # Errors
    /// The operator must switch off by hand.
    pub fn dark(&mut self) -> Result<(), Trouble> {
        let _unhurried = SwitchingOff::begin();
        let lights = self.lights.as_mut().map_or(Ok(()), |lights| lights.dark());
        let display = self.display.as_mut().map_or(Ok(()), |(display, _)| display.dark());
        let axes = self.axes.as_mut().map_or(Ok(()), |axes| axes.hold());
        lights.and(display).and(axes)
    }
}

impl RigFile {
    /// Physical lamps of a stage.
    pub fn bulbs(&self) -> usize {
        self.stage.as_ref().map_or(0, |stage| stage.lamps.per_stop())
    }

    /// Where the axes have to be at each stop.
    pub fn stations(&self) -> Vec<Place> {
        let deg = |place: Vec3| Place {
            turntable_deg: Some(place.x.atan2(place.z).to_degrees()),
            arm_deg: Some(place.y.clamp(-1.0, 1.0).asin().to_degrees()),
        };
        match (&self.stage, &self.gantry) {
            (Some(StageRig { lamps, .. }), _) => {
                let place = |stop| Place { turntable_deg: lamps.turned_deg(stop), arm_deg: None };
                (0..lamps.stops()).map(place).collect()
            }
            (None, Some(gantry)) => gantry.positions.directions().into_iter().map(deg).collect(),
            (None, None) => Vec::new(),
        }
    }
}

/// The rig.
pub struct RealRig {
    parts: Parts,
    rig: RigFile,
    stations: Vec<Place>,
    target: Target,
    homed: bool,
}

impl RealRig {
    /// Of devices that answered. `last` is what was photographed last, if anything: a ball may still stand where the object belongs.
    pub fn new(rig: &RigFile, parts: Parts, last: Option<&Condition>) -> Self {
        let target = last.map_or(Target::Object, Target::of);
        Self { parts, rig: rig.clone(), stations: rig.stations(), target, homed: false }
    }

    fn per_stop(&self) -> usize {
        self.rig.stage.as_ref().map_or(1, |stage| stage.lamps.per_stop())
    }

    /// Asks the operator for what a condition wants in the object's place.
    fn put_in_place(&mut self, condition: &Condition) -> Result<(), Trouble> {
        let wanted = Target::of(condition);
        if wanted == self.target {
            return Ok(());
        }
        self.parts.operator.ask(match wanted {
            Target::Object => "put the object back in its place",
            Target::WhiteBall => "put the white ball in the object's place",
            Target::WhiteCard => "put the white card in the object's place, facing the camera",
            Target::Chart => "put the colour chart in the object's place, facing the camera",
        })?;
        self.target = wanted;
        Ok(())
    }

    fn travel(&mut self, stop: usize) -> Result<(), Trouble> {
        let to = self.stations.get(stop).copied().unwrap_or_default();
        let Some(axes) = &mut self.parts.axes else { return Ok(()) };
        if to == Place::default() {
            return Ok(());
        }
        if !self.homed {
            axes.home()?;
            self.homed = true;
        }
        axes.go(to)
    }

    fn light(&mut self, condition: &Condition) -> Result<(), Trouble> {
        if let Some((display, shown)) = &mut self.parts.display {
            return display.show(&shown.texels(condition)?);
        }
        let Some(stage) = &self.rig.stage else { return Ok(()) };
        let Some(lights) = &mut self.parts.lights else { return Ok(()) };
        let bulbs = stage.lamps.per_stop();
        let mut levels = vec![0; bulbs];
        let on = self.rig.devices.as_ref().and_then(|d| d.lamps.as_ref()).map_or(u8::MAX, |l| l.wiring().level);
        match condition {
            Condition::Lamp(lamp) | Condition::WhiteBall(lamp) | Condition::FlatField(lamp) => {
                levels[stage.lamps.bulb(*lamp)] = on;
            }
            Condition::AllLamps { .. } | Condition::Chart => levels.fill(on),
            Condition::Black { .. } => {}
            other => {
                let expected = "a lamp, all lamps, black, a white ball, a card or a chart";
                return Err(Error::invalid("a stage", other.to_string(), expected).into());
            }
        }
        lights.show(&levels)
    }
}

impl Rig for RealRig {
    fn preflight(&mut self) -> Vec<Finding> {
        self.parts.preflight()
    }

    fn emit(&mut self, step: &Step) -> Result<(), Trouble> {
        self.put_in_place(&step.condition)?;
        self.travel(step.condition.stop(self.per_stop()))?;
        self.light(&step.condition)
    }

    fn confirm(&mut self) -> Result<(), Trouble> {
        let parts = &mut self.parts;
        if self.homed {
            parts.axes.as_mut().map_or(Ok(()), |axes| axes.confirm())?;
        }
        parts.lights.as_mut().map_or(Ok(()), |lights| lights.confirm())?;
        parts.display.as_mut().map_or(Ok(()), |(display, _)| display.confirm())
    }

    fn dark(&mut self) -> Result<(), Trouble> {
        self.parts.dark()
    }
}

/// Real devices driven beside a virtual rig, whose light a virtual camera photographs: a rehearsal.
pub struct Rehearsed {
    /// Driven.
    pub real: RealRig,
    /// Photographed.
    pub virtual_rig: Box<dyn Rig>,
}

impl Rig for Rehearsed {
    fn preflight(&mut self) -> Vec<Finding> {
        self.real.preflight().into_iter().chain(self.virtual_rig.preflight()).collect()
    }

    fn emit(&mut self, step: &Step) -> Result<(), Trouble> {
        self.real.emit(step)?;
        self.virtual_rig.emit(step)
    }

    fn confirm(&mut self) -> Result<(), Trouble> {
        self.real.confirm()
    }

    fn dark(&mut self) -> Result<(), Trouble> {
        let real = self.real.dark();
        real.and(self.virtual_rig.dark())
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Mutex;

    use super::*;
    use crate::capture::Times;
    use crate::devices::operator::Willing;
    use crate::session::Role;

    type Diary = Arc<Mutex<Vec<String>>>;

    /// Writes down what it is asked, and is broken if asked to be.
    struct Recorder {
        diary: Diary,
        broken: bool,
    }

    impl Recorder {
        fn note(&self, what: String) -> Result<(), Trouble> {
            self.diary.lock().unwrap().push(what);
            if self.broken { Err(Trouble::stop("broken", "mend it")) } else { Ok(()) }
        }
    }

    impl Axes for Recorder {
        fn preflight(&mut self) -> Vec<Finding> {
            Vec::new()
        }

        fn home(&mut self) -> Result<(), Trouble> {
            self.note("home".to_owned())
        }

        fn go(&mut self, to: Place) -> Result<(), Trouble> {
            self.note(format!("go {:?}", to.turntable_deg))
        }

        fn place(&mut self) -> Result<Place, Trouble> {
            Ok(Place::default())
        }

        fn hold(&mut self) -> Result<(), Trouble> {
            self.note("hold".to_owned())
        }
    }

    impl Lights for Recorder {
        fn preflight(&mut self) -> Vec<Finding> {
            Vec::new()
        }

        fn show(&mut self, levels: &[u8]) -> Result<(), Trouble> {
            self.note(format!("show {levels:?}"))
        }

        fn dark(&mut self) -> Result<(), Trouble> {
            self.note("dark".to_owned())
        }
    }

    const RIG: &str = r#"
version = 1
name = "Stage"
kind = "stage"
[camera]
limits_s = [0.001, 30.0]
[stage.lamps]
layout = "arc"
latitudes = 2
longitudes = 4
"#;

    fn rig(last: Option<&Condition>, broken: bool) -> (RealRig, Diary, Arc<Willing>) {
        let (diary, operator) = (Diary::default(), Arc::new(Willing::default()));
        let file = RigFile::parse(RIG, std::path::Path::new("rig.toml")).unwrap();
        let recorder = || Recorder { diary: diary.clone(), broken };
        let parts = Parts {
            axes: Some(Box::new(recorder())),
            lights: Some(Box::new(recorder())),
            display: None,
            operator: operator.clone(),
        };
        (RealRig::new(&file, parts, last), diary, operator)
    }

    fn step(condition: Condition) -> Step {
        Step { index: 0, condition, role: Role::Sample, times: Times::Fixed(vec![1.0]), scanned: 0 }
    }

    #[test]
    fn axes_arrive_before_lamps_are_lit() {
        let (mut rig, diary, operator) = rig(None, false);
        rig.emit(&step(Condition::Lamp(5))).unwrap();
        rig.emit(&step(Condition::AllLamps { stop: 3 })).unwrap();
        rig.emit(&step(Condition::Black { stop: 3 })).unwrap();
        let wanted = [
            "home",
            "go Some(180.0)",
            "show [0, 255]",
            "go Some(270.0)",
            "show [255, 255]",
            "go Some(270.0)",
            "show [0, 0]",
        ];
        assert_eq!(*diary.lock().unwrap(), wanted);
        assert!(operator.asked.lock().unwrap().is_empty());
    }

    #[test]
    fn targets_are_put_in_place_once_and_taken_away_again() {
        let (mut there, _, operator) = rig(None, false);
        for condition in [Condition::WhiteBall(0), Condition::WhiteBall(1), Condition::Chart, Condition::Lamp(0)] {
            there.emit(&step(condition)).unwrap();
        }
        let asked = operator.asked.lock().unwrap().clone();
        assert_eq!(asked.len(), 3, "{asked:?}");
        assert!(asked[0].contains("white ball") && asked[1].contains("chart") && asked[2].contains("object back"));
        // A resumed session whose last photograph was of the ball: it still stands there.
        let (mut resumed, _, operator) = rig(Some(&Condition::WhiteBall(1)), false);
        resumed.emit(&step(Condition::Lamp(0))).unwrap();
        assert_eq!(operator.asked.lock().unwrap().len(), 1);
    }

    #[test]
    fn every_device_is_switched_off_though_one_is_broken() {
        let (mut rig, diary, _) = rig(None, true);
        assert!(rig.dark().is_err());
        assert_eq!(*diary.lock().unwrap(), ["dark", "hold"]);
    }
}
