//! A rig of real devices: axes, lamps and a screen, driven in the one order that is safe.
//!
//! Motion complete -> settled -> lamp or pattern confirmed -> settled: only then does [`Rig::emit`] return, so that a photograph shows
//! neither the condition before nor a table that still trembles.

use std::sync::Arc;

use relume_core::{Error, Result};

use super::{Condition, Rig, RigFile, Shown};
use crate::capture::Step;
use crate::devices::{Axes, Display, Finding, Lights, Operator, Place, Trouble};

/// What stands in the object's place.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Target {
    Object,
    WhiteBall,
    WhiteCard,
    Chart,
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

/// The rig.
pub struct RealRig {
    parts: Parts,
    rig: RigFile,
    target: Target,
    homed: bool,
}

impl RealRig {
    /// Of devices that answered.
    pub fn new(rig: &RigFile, parts: Parts) -> Self {
        Self { parts, rig: rig.clone(), target: Target::Object, homed: false }
    }

    /// Where the axes have to be at a stop.
    fn place(&self, stop: usize) -> Place {
        match (&self.rig.stage, &self.rig.gantry) {
            (Some(stage), _) => Place { turntable_deg: stage.lamps.turned_deg(stop), arm_deg: None },
            (None, Some(gantry)) => {
                let direction = gantry.positions.directions().get(stop).copied();
                direction.map_or_else(Place::default, |d| Place {
                    turntable_deg: Some(d.x.atan2(d.z).to_degrees()),
                    arm_deg: Some(d.y.clamp(-1.0, 1.0).asin().to_degrees()),
                })
            }
            (None, None) => Place::default(),
        }
    }

    fn per_stop(&self) -> usize {
        self.rig.stage.as_ref().map_or(1, |stage| stage.lamps.per_stop())
    }

    /// Asks the operator for what a condition wants in the object's place.
    fn put_in_place(&mut self, condition: &Condition) -> Result<(), Trouble> {
        let wanted = match condition {
            Condition::WhiteBall(_) => Target::WhiteBall,
            Condition::FlatField(_) => Target::WhiteCard,
            Condition::Chart => Target::Chart,
            _ => Target::Object,
        };
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
        let to = self.place(stop);
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
        let parts = &mut self.parts;
        let axes = parts.axes.as_mut().map_or_else(Vec::new, |axes| axes.preflight());
        let lights = parts.lights.as_mut().map_or_else(Vec::new, |lights| lights.preflight());
        let display = parts.display.as_mut().map_or_else(Vec::new, |(display, _)| display.preflight());
        axes.into_iter().chain(lights).chain(display).collect()
    }

    fn emit(&mut self, step: &Step) -> Result<(), Trouble> {
        self.put_in_place(&step.condition)?;
        self.travel(step.condition.stop(self.per_stop()))?;
        self.light(&step.condition)
    }

    fn stayed(&mut self) -> Result<(), Trouble> {
        self.parts.display.as_mut().map_or(Ok(()), |(display, _)| display.stayed())
    }

    /// All devices are tried, whatever the others do.
    fn dark(&mut self) -> Result<(), Trouble> {
        let parts = &mut self.parts;
        let lights = parts.lights.as_mut().map_or(Ok(()), |lights| lights.dark());
        let display = parts.display.as_mut().map_or(Ok(()), |(display, _)| display.dark());
        let axes = parts.axes.as_mut().map_or(Ok(()), |axes| axes.hold());
        lights.and(display).and(axes)
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

    fn stayed(&mut self) -> Result<(), Trouble> {
        self.real.stayed()
    }

    fn dark(&mut self) -> Result<(), Trouble> {
        let real = self.real.dark();
        real.and(self.virtual_rig.dark())
    }
}
