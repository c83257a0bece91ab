//! Which exposure times a photograph gets, and what is said of its exposure.

use std::collections::HashMap;
use std::sync::Arc;

use relume_core::hdr::series::{self, Extent, Wanted};
use relume_core::image::Image;
use relume_core::{Error, Result};

use super::log::Log;
use super::shoot::Shot;
use super::{Step, Times};
use crate::pack::develop::Developer;
use crate::pack::records::{Records, relative};
use crate::rigs::{CameraRig, Condition, RigFile};
use crate::session::{Exposure, Line, Photograph, Role, Session};

/// Cameras step by thirds of a stop.
const STEPS_PER_STOP: f64 = 3.0;

/// Times that are known so far.
pub struct Exposures<'a> {
    rig: &'a RigFile,
    chosen: HashMap<Role, Vec<f64>>,
    /// Made when the first sample comes, from the calibration before it; `None` within where that tells nothing.
    developer: Option<Option<Developer>>,
}

impl<'a> Exposures<'a> {
    /// From the journal, where an earlier run chose some.
    pub fn new(rig: &'a RigFile, session: &Session) -> Self {
        let series = session.lines().iter().filter_map(|line| match line {
            Line::Series { of, times_s } => Some((*of, times_s.clone())),
            Line::Photograph(_) => None,
        });
        Self { rig, chosen: series.collect(), developer: None }
    }

    /// The settings of a step. Where they are to be chosen from previews and are not yet, they are chosen, and written down.
    ///
    /// # Errors
    /// Previews that show nothing but black.
    pub fn settings(&mut self, step: &Step, session: &mut Session, log: &mut Log) -> Result<Vec<Exposure>> {
        let camera = &self.rig.camera;
        let times = match &step.times {
            Times::Fixed(times) => times.clone(),
            Times::Series { of, factor } => {
                let series = match (&camera.times_s, self.chosen.get(of)) {
                    (Some(times), _) | (None, Some(times)) => times.clone(),
                    (None, None) => self.choose(*of, session, log)?,
                };
                scaled(&series, *factor, self.rig.exposure_limits())
            }
        };
        Ok(times.into_iter().map(|time_s| setting(camera, time_s)).collect())
    }

    fn choose(&mut self, of: Role, session: &mut Session, log: &mut Log) -> Result<Vec<f64>> {
        let camera = &self.rig.camera;
        let records = Records::read(session.root())?;
        let shows_ball = |p: &Photograph| matches!(p.condition, Condition::WhiteBall(_) | Condition::FlatField(_));
        let wanted = wanted(camera, of);
        let developer = Developer::for_previews(&records, camera)?;
        let mut extent: Option<Extent> = None;
        for preview in records.of(Role::Preview).filter(|p| shows_ball(p) == (of == Role::WhiteBall)) {
            let seen = Extent::of(&developer.develop(&records, preview)?, &wanted);
            extent = Some(extent.map_or(seen, |extent| extent.join(seen)));
        }
        let Some(extent) = extent else {
            let expected = "previews, which come before; or times_s in the rig file";
            return Err(Error::invalid("the exposure times", "no preview to choose them from", expected));
        };
        let can = settable(self.rig.exposure_limits());
        let exposures: Vec<f64> = can.iter().map(|time_s| relative(&setting(camera, *time_s))).collect();
        let chosen = series::choose(&extent, developer.merger(), camera.iso, &exposures, &wanted)?;
        let time_of = |exposure: &f64| can[exposures.iter().position(|known| known == exposure).unwrap_or_default()];
        let times_s: Vec<f64> = chosen.exposures.iter().map(time_of).collect();
        let what = if of == Role::WhiteBall { "white ball" } else { "object" };
        for doubt in &chosen.doubts {
            log.line(&format!("exposures, {what}: {doubt}"));
            crate::complain(&format!("note: exposures, {what}: {doubt}"));
        }
        let words: Vec<String> = times_s.iter().map(|time_s| super::shoot::seconds(*time_s)).collect();
        log.line(&format!("exposures, {what}: {}", words.join(" ")));
        session.append(Line::Series { of, times_s: times_s.clone() })?;
        self.chosen.insert(of, times_s.clone());
        Ok(times_s)
    }

    /// What the operator should know of a sample's exposure: is its top clipped, is its bottom noise? `thumbnails` are codes.
    pub fn remarks(
        &mut self,
        step: &Step,
        session: &Session,
        shots: &[Shot],
        thumbnails: &[Arc<Image>],
    ) -> Vec<String> {
        if !matches!(step.role, Role::Sample | Role::AllLit | Role::Reference) {
            return Vec::new();
        }
        let camera = &self.rig.camera;
        let developer = self.developer.get_or_insert_with(|| {
            Records::read(session.root()).and_then(|records| Developer::for_previews(&records, camera)).ok()
        });
        let exposures: Vec<Exposure> = shots.iter().map(|shot| shot.exposure).collect();
        // Remarks are a convenience: what cannot be told is not said.
        let merged = developer.as_ref().and_then(|developer| developer.merge(&exposures, thumbnails).ok());
        let wanted = wanted(camera, Role::Sample);
        merged.map_or_else(Vec::new, |merged| series::check(&merged.report, &wanted))
    }
}

/// What brackets should hold. Glints of single lamps on mirrors are few pixels and much of the light: they must not clip. They
/// are 9 stops and more above white paper under the same lamp (a lamp's cell of 0.005 sr against pi), whose shades are
/// wanted over another 6.
fn wanted(camera: &CameraRig, of: Role) -> Wanted {
    // Of the ball the lit side alone counts.
    let stops = if of == Role::WhiteBall { 6.0 } else { 15.0 };
    Wanted { step_stops: camera.step_stops, clipped: 1e-5, stops, ..Wanted::default() }
}

fn setting(camera: &CameraRig, time_s: f64) -> Exposure {
    Exposure { time_s, iso: Some(camera.iso), f_number: Some(camera.f_number) }
}

/// The times that a camera can be set to.
fn settable([fastest, slowest]: [f64; 2]) -> Vec<f64> {
    let count = ((slowest / fastest).log2() * STEPS_PER_STOP).floor() as i32;
    (0..=count).map(|n| fastest * (f64::from(n) / STEPS_PER_STOP).exp2()).collect()
}

/// A series times a factor, within what the camera can do; times that fall together count once.
fn scaled(series: &[f64], factor: f64, [fastest, slowest]: [f64; 2]) -> Vec<f64> {
    let mut times: Vec<f64> = series.iter().map(|t| (t * factor).clamp(fastest, slowest)).collect();
    times.dedup();
    times
}
