//! Irradiances of the lamps.

use std::f32::consts::PI;

use relume_core::calibrate::ball::find_ball;
use relume_core::calibrate::reflect::{Ball, Lens};
use relume_core::calibrate::white_ball::{Lamp, irradiance};
use relume_core::illumination::probe::Circle;
use relume_core::{Error, Result};

use super::develop::Developer;
use super::records::{Records, relative};
use crate::rigs::{Condition, RigFile, StageRig};
use crate::session::{Photograph, Role};

/// `E_j` in the camera's unit, and the unit of the field.
#[derive(Debug, Clone)]
pub struct Irradiances {
    /// Of each physical lamp, RGB, in the camera's unit.
    pub bulbs: Vec<[f32; 3]>,
    /// Were they measured?
    pub measured: bool,
    /// From the camera's unit to that of the field, in which the lamps' mean irradiance is pi: a white diffuser facing the mean
    /// lamp is 1.
    pub unit: f32,
    /// What a person should know, a sentence each.
    pub doubts: Vec<String>,
}

impl Irradiances {
    /// RGB of lamp j, in the camera's unit.
    pub fn rgb(&self, lamp: usize) -> [f32; 3] {
        self.bulbs[lamp % self.bulbs.len()]
    }

    /// The mean over the channels.
    pub fn mean(&self, lamp: usize) -> f32 {
        self.rgb(lamp).iter().sum::<f32>() / 3.0
    }
}

impl Irradiances {
    /// From the white ball, where it was photographed; else all lamps are taken as equal.
    ///
    /// # Errors
    /// A ball that is not found, or shows nothing.
    pub fn new(records: &Records, developer: &Developer, rig: &RigFile, stage: &StageRig) -> Result<Self> {
        let photographed: Vec<_> = records.of(Role::WhiteBall).collect();
        let (Some(setting), false) = (&rig.calibration.white_ball, photographed.is_empty()) else {
            return Self::equal(records, stage);
        };
        let (circle, (width, height)) = outline(&photographed, records, developer, setting.circle_px)?;
        let centre = [0.5 * width as f64, 0.5 * height as f64];
        let lens = setting.focal_px.map_or(Lens::Far, |focal_px| Lens::Pinhole { centre, focal_px });
        let ball = Ball::new(circle, lens);
        let directions = stage.lamps.directions();
        let mut found: Vec<Option<[f32; 3]>> = vec![None; stage.lamps.per_stop()];
        let mut doubts = Vec::new();
        for photograph in &photographed {
            let Condition::WhiteBall(lamp) = photograph.condition else { continue };
            let place = format!("white ball, lamp {}", lamp + 1);
            let Some(direction) = directions.get(lamp) else {
                return Err(Error::invalid(
                    place,
                    "no such lamp in the rig",
                    format!("lamps 1 to {}", directions.len()),
                ));
            };
            let at = Lamp { direction: *direction, distance: None };
            match irradiance(&developer.picture(records, photograph)?, &ball, [setting.albedo; 3], &at, &place) {
                Ok(measured) => {
                    found[stage.lamps.bulb(lamp)] = Some(measured.rgb.map(|e| e as f32));
                    doubts.extend(measured.doubts);
                }
                // A lamp behind the ball: the others say what is usual.
                Err(error) => doubts.push(format!("{error}; its irradiance is taken as the others' mean")),
            }
        }
        Self::completed(found, doubts)
    }

    fn completed(found: Vec<Option<[f32; 3]>>, doubts: Vec<String>) -> Result<Self> {
        let known: Vec<[f32; 3]> = found.iter().flatten().copied().collect();
        if known.is_empty() {
            return Err(Error::invalid("the white ball", "no lamp that could be measured", "at least one"));
        }
        let usual: [f32; 3] = std::array::from_fn(|c| known.iter().map(|e| e[c]).sum::<f32>() / known.len() as f32);
        let bulbs: Vec<[f32; 3]> = found.into_iter().map(|e| e.unwrap_or(usual)).collect();
        let mean = usual.iter().sum::<f32>() / 3.0;
        Ok(Self { bulbs, measured: true, unit: PI / mean, doubts })
    }

    /// White facing a lamp is taken as the white code of the middle exposure.
    fn equal(records: &Records, stage: &StageRig) -> Result<Self> {
        let frames = records.of(Role::Sample).next().map(|p| &p.frames);
        let middle = frames.and_then(|frames| frames.get(frames.len() / 2)?.exposure.as_ref()).map(relative);
        let exposure =
            middle.ok_or_else(|| Error::invalid("the session", "no exposure times", "photographs with them"))?;
        let per = exposure as f32;
        let doubts = vec![
            "the lamps' irradiances were not measured and are taken as equal: give the rig file a [calibration.white_ball]"
                .to_owned(),
        ];
        Ok(Self { bulbs: vec![[PI / per; 3]; stage.lamps.per_stop()], measured: false, unit: per, doubts })
    }

    /// For the report.
    pub fn words(&self) -> String {
        if !self.measured {
            return String::new();
        }
        let all: Vec<f32> = (0..self.bulbs.len()).map(|lamp| self.mean(lamp) * self.unit / PI).collect();
        let (low, high) = all.iter().fold((f32::INFINITY, 0f32), |(l, h), v| (l.min(*v), h.max(*v)));
        format!("lamps      {} measured, {:.0} to {:.0} % of their mean\n", all.len(), 100.0 * low, 100.0 * high)
    }
}

/// The ball's outline, as given or found in the mean of its photographs; and their size. One picture at a time is in memory.
fn outline(
    photographed: &[&Photograph],
    records: &Records,
    developer: &Developer,
    given: Option<[f64; 3]>,
) -> Result<(Circle, (usize, usize))> {
    let mut mean = developer.picture(records, photographed[0])?;
    if let Some([x, y, radius]) = given {
        return Ok((Circle { x, y, radius }, mean.size()));
    }
    for photograph in &photographed[1..] {
        let picture = developer.picture(records, photograph)?;
        mean.data_mut().iter_mut().zip(picture.data()).for_each(|(m, v)| *m += v);
    }
    let per = 1.0 / photographed.len() as f32;
    mean.data_mut().iter_mut().for_each(|m| *m *= per);
    Ok((find_ball(&mean, "the white ball")?, mean.size()))
}
