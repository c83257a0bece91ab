//! A screen, or a projector at many positions, whose light is computed.
//!
//! The picture under a pattern is `T L`: `L` what the display makes of the codes it is given ([`Screen`]: a gamma that the operator
//! may not know, a black that is not black), `T` traced once and kept in the cache folder.

use std::path::PathBuf;
use std::sync::{Arc, PoisonError};

use relume_core::image::Image;
use relume_core::simulate::{Camera, Gantry, Monitor, Progress, Quality, Rows, Scene, Screen};
use relume_core::{Error, Result};

use super::cache;
use super::{Condition, GantryRig, MonitorRig, Rig, RigFile, SceneChoice, Shown};
use crate::capture::Step;
use crate::capture::patterns::Sets;
use crate::devices::cameras::virtual_camera::{View, Window};
use crate::devices::rehearsal::Fault;
use crate::devices::{Finding, Trouble};

/// Light over other surfaces is kept square by square up to so many of them, 12 kB a pixel; beyond, by blocks, which a dual image would show as
/// haze.
const FEW_SQUARES: usize = 1200;
/// Radius of the virtual projector's lens, scene units: mirrors see it as a small disc.
const LENS_RADIUS: f32 = 0.08;

/// The display.
#[derive(Debug)]
pub struct VirtualEmitter {
    rig: RigFile,
    rows: Rows,
    display: Screen,
    shown: Shown,
    window: Window,
    faults: Vec<Fault>,
    emitted: u64,
}

impl VirtualEmitter {
    /// Opens (or first traces) the scene. `references` is where pictures to be shown lie; `bare` takes the bodies away.
    /// `progress(rows done, rows)` may stop it.
    ///
    /// # Errors
    /// A cache folder that cannot be written to; a request to stop.
    pub fn new(
        rig: &RigFile,
        bare: bool,
        sets: Sets,
        references: PathBuf,
        window: Window,
        faults: &[Fault],
        progress: &mut Progress<'_>,
    ) -> Result<Self> {
        let rows = traced(rig, bare, progress)?;
        let white = [rig.simulation.irradiance as f32; 3];
        let usual = if rig.monitor.is_some() { Screen::monitor() } else { Screen::projector() };
        let display = Screen { white, ..usual };
        let shown = Shown::new(rig, sets, references)?;
        let rig = rig.clone();
        Ok(Self { rig, rows, display, shown, window, faults: faults.to_vec(), emitted: 0 })
    }

    fn light(&self, condition: &Condition) -> Result<Image> {
        let grids = self.rows.grids();
        let here = grids.columns * grids.rows;
        let shown = self.shown.texels(condition)?;
        let first = condition.stop(1) * here;
        let mut emitted = vec![[0.0; 3]; grids.elements()];
        emitted[first..first + here].copy_from_slice(&self.display.emitted(&shown.codes, shown.white));
        self.rows.photograph(&emitted)
    }
}

impl Rig for VirtualEmitter {
    fn preflight(&mut self) -> Vec<Finding> {
        let grids = self.rows.grids();
        let text = match &self.rig.gantry {
            Some(GantryRig { squares, .. }) => {
                format!("projector: virtual, {} positions of {squares} x {squares} squares", grids.layers)
            }
            None => format!("screen: virtual, {} x {} texels", grids.columns, grids.rows),
        };
        vec![Finding::fine(text)]
    }

    fn emit(&mut self, step: &Step) -> Result<(), Trouble> {
        self.emitted += 1;
        let mut light = self.light(&step.condition)?;
        if self.faults.iter().any(|f| matches!(f, Fault::Bump(at) if self.emitted >= *at)) {
            light = super::virtual_stage::shifted(&light, super::virtual_stage::BUMP_PX);
        }
        let seed = super::virtual_stage::noise_seed(&self.rig, step);
        *self.window.lock().unwrap_or_else(PoisonError::into_inner) = Some(View { light: Arc::new(light), seed });
        Ok(())
    }

    fn dark(&mut self) -> Result<(), Trouble> {
        *self.window.lock().unwrap_or_else(PoisonError::into_inner) = None;
        Ok(())
    }
}

/// Where the traced scene of a rig lies.
///
/// # Errors
/// No home folder.
pub fn cached(rig: &RigFile, bare: bool) -> Result<PathBuf> {
    let scene = match rig.simulation.scene {
        SceneChoice::Mixed => String::new(),
        other => format!(" {}", other.id()),
    };
    let geometry = match (&rig.monitor, &rig.gantry) {
        (Some(monitor), _) => {
            let scene = if bare { " bare".to_owned() } else { scene };
            format!("monitor {} {}{scene}", monitor.columns, monitor.rows)
        }
        (None, Some(gantry)) => {
            let GantryRig { view_deg, .. } = gantry;
            format!("gantry 2 {} {view_deg} {:?}{scene}", gantry.pixels(), gantry.places())
        }
        (None, None) => String::new(),
    };
    cache::file(rig, &geometry, "rows")
}

fn traced(rig: &RigFile, bare: bool, progress: &mut Progress<'_>) -> Result<Rows> {
    let path = cached(rig, bare)?;
    if path.is_file() {
        return Rows::load(&path);
    }
    cache::make_room(&path)?;
    let simulation = &rig.simulation;
    let (width, height) = (simulation.width, simulation.height);
    let quality = Quality { samples: simulation.samples, seed: simulation.seed, ..Quality::rig() };
    let rows = match (&rig.monitor, &rig.gantry) {
        (Some(monitor), _) => {
            let there = virtual_monitor(monitor, rig.simulation.scene, Camera::monitor(width, height));
            if bare { there.bare() } else { there }.trace(&quality, progress)?
        }
        (None, Some(gantry)) => {
            virtual_gantry(gantry, simulation.scene, Camera::gantry(width, height)).trace(&quality, progress)?
        }
        (None, None) => return Err(Error::invalid("rig", "no screen and no projector", "one")),
    };
    rows.save(&path)?;
    Ok(rows)
}

fn virtual_monitor(rig: &MonitorRig, scene: SceneChoice, camera: Camera) -> Monitor {
    let texels = (rig.columns, rig.rows);
    match scene {
        SceneChoice::Diffuse => Monitor::cubes(camera, texels),
        _ => Monitor::demo(camera, texels),
    }
}

/// The projector of a rig before a scene.
pub fn virtual_gantry(rig: &GantryRig, scene: SceneChoice, camera: Camera) -> Gantry {
    let usual = Gantry::demo(camera, (1, 1), rig.pixels());
    let few = rig.places().len() * rig.pixels() * rig.pixels() <= FEW_SQUARES;
    let (scene, blocks) = match scene {
        SceneChoice::Convex => (Scene::convex(), usual.blocks),
        // By blocks of squares, sets of squares would seem to fail in the bowl where they do not.
        SceneChoice::Bowl => (Scene::bowl(), rig.pixels()),
        _ => (Scene::gantry(), if few { rig.pixels() } else { usual.blocks }),
    };
    Gantry {
        scene,
        blocks,
        positions: rig.places().iter().map(|place| place.cast()).collect(),
        view_rad: rig.view_deg.to_radians() as f32,
        lens_radius: LENS_RADIUS,
        ..usual
    }
}
