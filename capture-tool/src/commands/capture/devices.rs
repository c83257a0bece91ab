//! Opens what a rig file names: real devices, virtual ones, or real ones before a virtual camera.

use std::path::Path;
use std::sync::Arc;

use relume_core::hdr::Noise;
use relume_core::simulate::{Sensor, SensorResponse};

use crate::capture::patterns::Sets;
use crate::devices::cameras::virtual_camera::{VirtualCamera, Window};
use crate::devices::operator::AtTerminal;
use crate::devices::rehearsal::Fault;
use crate::devices::{Camera, Operator, cameras};
use crate::progress::{Progress, Unit};
use crate::rigs::real::{Parts, RealRig, Rehearsed};
use crate::rigs::virtual_emitter::VirtualEmitter;
use crate::rigs::virtual_stage::VirtualStage;
use crate::rigs::{Kind, Rig, RigFile, SensorResponseChoice};
use crate::session::{Journal, photographs};

/// The folder of a session with the pictures that `--reference` shows.
pub const REFERENCES: &str = "references";

/// What is to be opened, and for what.
pub struct Wanted<'a> {
    /// The rig.
    pub rig: &'a RigFile,
    /// Samples of the scan.
    pub scanned: u64,
    /// The object is away.
    pub bare: bool,
    /// Pattern sets of a screen or projector.
    pub sets: &'a Sets,
    /// The session's folder.
    pub session: &'a Path,
    /// What virtual devices do wrong.
    pub faults: &'a [Fault],
}

/// The rig and the camera.
///
/// # Errors
/// A device that is not there; a scene that cannot be traced.
pub fn open(wanted: &Wanted<'_>) -> anyhow::Result<(Box<dyn Rig>, Box<dyn Camera>)> {
    let rig = wanted.rig;
    let Some(found) = &rig.devices else { return virtual_devices(wanted) };
    let operator: Arc<dyn Operator> = Arc::new(AtTerminal);
    let parts = Parts::open(rig, wanted.sets.clone(), wanted.session.join(REFERENCES), &operator)?;
    let lines = if is_begun(wanted.session) { Journal::read(wanted.session)? } else { Vec::new() };
    let last = photographs(&lines).last().map(|photograph| &photograph.condition);
    let real = RealRig::new(rig, parts, last);
    if rig.is_virtual() {
        let (virtual_rig, camera) = virtual_devices(wanted)?;
        return Ok((Box::new(Rehearsed { real, virtual_rig }), camera));
    }
    Ok((Box::new(real), cameras::open(&found.camera, wanted.session, &operator)?))
}

fn is_begun(session: &Path) -> bool {
    session.join("session.toml").is_file()
}

fn virtual_devices(wanted: &Wanted<'_>) -> anyhow::Result<(Box<dyn Rig>, Box<dyn Camera>)> {
    let Wanted { rig, scanned, bare, faults, .. } = *wanted;
    let window = Window::default();
    let mut bar = Progress::new("tracing the virtual scene", Unit::Steps);
    let mut progress = |done, all| bar.step(done, all);
    let emitter: Box<dyn Rig> = match rig.kind {
        Kind::Stage => Box::new(VirtualStage::new(rig, scanned, window.clone(), faults, &mut progress)?),
        Kind::Monitor | Kind::Gantry => {
            let (sets, references) = (wanted.sets.clone(), wanted.session.join(REFERENCES));
            Box::new(VirtualEmitter::new(rig, bare, sets, references, window.clone(), faults, &mut progress)?)
        }
    };
    Ok((emitter, Box::new(VirtualCamera::new(sensor(rig), window, faults))))
}

/// The virtual camera's sensor.
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
