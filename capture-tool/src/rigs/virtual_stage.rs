//! A stage whose light is computed: `T` traced once, lamps of unequal brightness that drift, ambient light, a white ball.
//!
//! The picture under lamp j is `T_j E_j g + S`: `E_j` its irradiance, `g` the drift, `S` the ambient light. `T` is a field of
//! its own, kept in the cache folder under a name made of all that it depends on.

use std::path::{Path, PathBuf};
use std::sync::{Arc, PoisonError};

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg32;
use relume_core::calibrate::chart;
use relume_core::domain::Directions;
use relume_core::field::{self, Access, Asset, Contents, Precision};
use relume_core::image::{Image, Window as Rectangle};
use relume_core::math::Vec3;
use relume_core::relight::{Weights, apply};
use relume_core::simulate::{Camera, Card, FarLamp, Quality, Scene, Stage, WhiteBall, classes};
use relume_core::{Error, Result};

use super::cache;
use super::{Condition, Lamps, Rig, RigFile, StageRig};
use crate::capture::Step;
use crate::devices::cameras::virtual_camera::{View, Window};
use crate::devices::rehearsal::Fault;
use crate::devices::{Finding, Trouble};

/// Radius of the white ball in scene units: most of the picture's height.
const BALL_RADIUS: f32 = 1.0;
/// Half the sides of the white card, which fills the picture, and of the chart, scene units.
const CARD_HALF: [f32; 2] = [4.0; 2];
const CHART_HALF: [f32; 2] = [1.2, 0.8];
/// Reflectance of the white card.
const CARD_ALBEDO: f32 = 0.9;
/// How far a rehearsed bump shifts the picture, pixels.
pub const BUMP_PX: f32 = 2.0;

/// The stage.
#[derive(Debug)]
pub struct VirtualStage {
    stage: StageRig,
    rig: RigFile,
    directions: Vec<Vec3>,
    /// Irradiance of each physical lamp, RGB.
    irradiances: Vec<[f32; 3]>,
    transport: Asset,
    ambient: Image,
    /// Photographs of the scan: drift runs over them.
    scan: u64,
    window: Window,
    faults: Vec<Fault>,
    emitted: u64,
}

impl VirtualStage {
    /// Opens (or first traces) the scene. `progress(rows done, rows)` may stop it.
    ///
    /// # Errors
    /// A cache folder that cannot be written to; a request to stop.
    pub fn new(
        rig: &RigFile,
        scan: u64,
        window: Window,
        faults: &[Fault],
        progress: &mut dyn FnMut(u64, u64) -> Result<()>,
    ) -> Result<Self> {
        Self::in_file(rig, &cached(rig)?, scan, window, faults, progress)
    }

    /// As [`VirtualStage::new`], the scene kept in a file of its own.
    ///
    /// # Errors
    /// As [`VirtualStage::new`].
    pub fn in_file(
        rig: &RigFile,
        scene: &Path,
        scan: u64,
        window: Window,
        faults: &[Fault],
        progress: &mut dyn FnMut(u64, u64) -> Result<()>,
    ) -> Result<Self> {
        let Some(stage) = rig.stage.clone() else {
            return Err(Error::invalid("rig", "no [stage] table", "a stage"));
        };
        let transport = traced(rig, &stage.lamps, scene, progress)?;
        let directions = stage.lamps.directions();
        let irradiances = irradiances(rig, stage.lamps.per_stop());
        let radiance = (rig.simulation.irradiance * rig.simulation.ambient) as f32;
        let ambient = under_constant(&transport, radiance)?;
        Ok(Self {
            stage,
            rig: rig.clone(),
            directions,
            irradiances,
            transport,
            ambient,
            scan,
            window,
            faults: faults.to_vec(),
            emitted: 0,
        })
    }

    /// Light of a condition, before drift.
    fn light(&self, condition: &Condition) -> Result<Image> {
        let bulb = |lamp: usize| self.irradiances[self.stage.lamps.bulb(lamp)];
        match condition {
            Condition::Lamp(lamp) => {
                let dense =
                    self.transport.dense().ok_or_else(|| Error::invalid("virtual stage", "no samples", "samples"))?;
                let mut picture = dense.picture(*lamp)?;
                let e = bulb(*lamp);
                picture.data_mut().chunks_exact_mut(3).for_each(|p| (0..3).for_each(|c| p[c] *= e[c]));
                Ok(picture)
            }
            Condition::AllLamps { stop } => {
                let mut weights = vec![[0.0; 3]; self.directions.len()];
                let per_stop = self.stage.lamps.per_stop();
                (stop * per_stop..(stop + 1) * per_stop).for_each(|lamp| weights[lamp] = bulb(lamp));
                lit_by(&self.transport, weights)
            }
            Condition::WhiteBall(lamp) => {
                let setting = self.rig.calibration.white_ball.as_ref();
                let setting = setting.ok_or_else(|| Error::invalid("rig", "no white ball", "one"))?;
                let ball = WhiteBall { radius: BALL_RADIUS, albedo: [setting.albedo as f32; 3] };
                Ok(ball.photograph(
                    &self.camera(),
                    &FarLamp { direction: self.directions[*lamp], irradiance: bulb(*lamp) },
                ))
            }
            Condition::FlatField(lamp) => {
                let lamp = FarLamp { direction: self.directions[*lamp], irradiance: bulb(*lamp) };
                Ok(Card::plain(CARD_HALF, [CARD_ALBEDO; 3]).photograph(&self.camera(), &lamp))
            }
            Condition::Chart => {
                let chart = Card { half: CHART_HALF, grid: (6, 4), reflectances: chart::reflectances().to_vec() };
                Ok(chart.photograph(&self.camera(), &self.together()))
            }
            Condition::Black { .. } => Ok(Image::new(self.ambient.width(), self.ambient.height(), 3)),
            other => Err(Error::invalid(
                "virtual stage",
                other.to_string(),
                "a lamp, all lamps, black, a white ball, a card or a chart",
            )),
        }
    }

    /// Light at a stop under lamps of an arc that shine with these shares of their full brightness, ambient light included;
    /// without drift.
    ///
    /// # Errors
    /// The scene's file.
    pub fn under(&self, shares: &[f32], stop: usize) -> Result<Image> {
        let first = stop * self.stage.lamps.per_stop();
        let lit: Vec<usize> = (0..shares.len()).filter(|bulb| shares[*bulb] > 0.0).collect();
        let mut light = match lit[..] {
            [] => self.light(&Condition::Black { stop })?,
            [bulb] => {
                let mut light = self.light(&Condition::Lamp(first + bulb))?;
                light.data_mut().iter_mut().for_each(|v| *v *= shares[bulb]);
                light
            }
            _ => {
                let mut weights = vec![[0.0; 3]; self.directions.len()];
                lit.iter().for_each(|bulb| weights[first + bulb] = self.irradiances[*bulb].map(|e| e * shares[*bulb]));
                lit_by(&self.transport, weights)?
            }
        };
        light.data_mut().iter_mut().zip(self.ambient.data()).for_each(|(v, s)| *v += s);
        Ok(light)
    }

    fn camera(&self) -> Camera {
        Camera::demo(self.rig.simulation.width, self.rig.simulation.height)
    }

    /// All lamps of the first stop as one lamp before a card that faces the camera: there light adds up by its cosine.
    fn together(&self) -> FarLamp {
        let mut irradiance = [0.0; 3];
        for (direction, e) in self.directions.iter().zip(&self.irradiances) {
            let facing = direction.z.max(0.0) as f32;
            (0..3).for_each(|c| irradiance[c] += facing * e[c]);
        }
        FarLamp { direction: Vec3::z(), irradiance }
    }

    fn drift(&self, step: &Step) -> f32 {
        let share = step.scanned as f64 / self.scan.max(1) as f64;
        (1.0 + self.rig.simulation.drift * share) as f32
    }
}

impl Rig for VirtualStage {
    fn preflight(&mut self) -> Vec<Finding> {
        vec![Finding::fine(format!(
            "stage: virtual, {} lamps, {} stops",
            self.directions.len(),
            self.stage.lamps.stops()
        ))]
    }

    fn emit(&mut self, step: &Step) -> Result<(), Trouble> {
        self.emitted += 1;
        if let Condition::Lamp(lamp) = step.condition
            && self.faults.contains(&Fault::SilentLamp(lamp as u64 + 1))
        {
            return Err(Trouble::Stop {
                what: format!("lamp {} does not answer", lamp + 1),
                advice: "check its fuse and its wiring".to_owned(),
            });
        }
        let mut light = self.light(&step.condition)?;
        let drift = self.drift(step);
        // Targets stand before black cloth.
        let target = matches!(step.condition, Condition::WhiteBall(_) | Condition::FlatField(_) | Condition::Chart);
        let ambient = (!target).then_some(&self.ambient);
        light.data_mut().iter_mut().for_each(|v| *v *= drift);
        if let Some(ambient) = ambient {
            light.data_mut().iter_mut().zip(ambient.data()).for_each(|(v, s)| *v += s);
        }
        if self.faults.iter().any(|f| matches!(f, Fault::Bump(at) if self.emitted >= *at)) {
            light = shifted(&light, BUMP_PX);
        }
        let seed = noise_seed(&self.rig, step);
        *self.window.lock().unwrap_or_else(PoisonError::into_inner) = Some(View { light: Arc::new(light), seed });
        Ok(())
    }

    fn dark(&mut self) -> Result<(), Trouble> {
        *self.window.lock().unwrap_or_else(PoisonError::into_inner) = None;
        Ok(())
    }
}

/// Irradiance of every physical lamp: unequal in brightness, and a little in colour.
pub fn irradiances(rig: &RigFile, bulbs: usize) -> Vec<[f32; 3]> {
    let simulation = &rig.simulation;
    let mut rng = Pcg32::seed_from_u64(simulation.seed ^ 0x1a3f_5eed);
    // Uniform of the wanted standard deviation.
    let mut around = |spread: f64| 1.0 + spread * 3f64.sqrt() * (2.0 * rng.random::<f64>() - 1.0);
    (0..bulbs)
        .map(|_| {
            let brightness = simulation.irradiance * around(simulation.spread);
            std::array::from_fn(|_| (brightness * around(simulation.spread / 5.0)) as f32)
        })
        .collect()
}

/// The picture under lamps.
fn lit_by(transport: &Asset, irradiances: Vec<[f32; 3]>) -> Result<Image> {
    let weights = Weights::of_lamps(irradiances);
    let window = Rectangle::full(transport.width(), transport.height());
    let mut pictures = apply(transport.samples()?, &[&weights], window)?;
    pictures.pop().ok_or_else(|| Error::invalid("virtual stage", "no picture", "one"))
}

/// The picture under a constant map.
fn under_constant(transport: &Asset, radiance: f32) -> Result<Image> {
    let domain = transport.directions()?;
    // Equal parts of the covered solid angle: ambient light need not be exact, only smooth and known.
    let part = (domain.covered_solid_angle() / domain.len() as f64) as f32;
    lit_by(transport, vec![[radiance * part; 3]; domain.len()])
}

/// Where the traced scene of a rig lies.
///
/// # Errors
/// No home folder.
pub fn cached(rig: &RigFile) -> Result<PathBuf> {
    let lamps = rig.stage.as_ref().map(|stage| stage.lamps.directions());
    cache::file(rig, &format!("still-life {lamps:?}"), "rfield")
}

/// Start of a photograph's noise: the same whenever the step is photographed.
pub fn noise_seed(rig: &RigFile, step: &Step) -> u64 {
    rig.simulation.seed ^ (step.index + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15)
}

fn traced(
    rig: &RigFile,
    lamps: &Lamps,
    path: &Path,
    progress: &mut dyn FnMut(u64, u64) -> Result<()>,
) -> Result<Asset> {
    if !path.is_file() {
        cache::make_room(path)?;
        trace(rig, lamps, path, progress)?;
    }
    Asset::open(path, Access::Mapped)
}

fn trace(rig: &RigFile, lamps: &Lamps, path: &Path, progress: &mut dyn FnMut(u64, u64) -> Result<()>) -> Result<()> {
    let simulation = &rig.simulation;
    let scene = Scene::demo();
    let camera = Camera::demo(simulation.width, simulation.height);
    let domain = Directions::new(lamps.directions())?;
    let quality = Quality { samples: simulation.samples, seed: simulation.seed, ..Quality::default() };
    let stage = Stage::new(&scene, camera, &domain, quality);
    let contents = Contents {
        colour_space: Default::default(),
        irradiance: vec![std::f32::consts::PI; domain.len()],
        domain: domain.into(),
        width: camera.width,
        height: camera.height,
        precision: Precision::Half,
        largest: stage.largest(),
        ambient: None,
        alpha: Some(classes(&scene, &camera).alpha),
        reliability: None,
        provenance: serde_json::json!({ "source": "virtual stage", "samples": quality.samples, "seed": quality.seed }),
    };
    let mut progress = |done, all| progress(done, all);
    field::write(path, &contents, &mut stage.bands(&mut progress))
}

/// The picture moved to the right; what comes in at the left is its edge.
pub fn shifted(picture: &Image, by_px: f32) -> Image {
    let by = by_px.round() as usize;
    Image::from_fn(picture.width(), picture.height(), |x, y| {
        let pixel = picture.pixel(x.saturating_sub(by), y);
        [pixel[0], pixel[1], pixel[2]]
    })
}
