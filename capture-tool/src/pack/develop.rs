//! The camera: its black level, its response, and brackets as light.

use std::sync::Arc;

use relume_core::calibrate::black::{Black, Blacks};
use relume_core::hdr::{
    self, Curve, Known, Merged, Merger, Noise, Options, Patches, Recovered, RecoveryReport, Shot, Survey,
};
use relume_core::image::{Image, SampleType};
use relume_core::{Error, Result};

use super::records::{Records, relative, shot};
use crate::rigs::{CameraRig, ResponseChoice};
use crate::session::{Exposure, Photograph, Role};

/// Photographs that are looked at for the code at which the camera clips.
const SURVEYED: usize = 12;

/// Makes light of photographs: `E = x / s`, the unit of the camera (1: a photograph of relative exposure 1 is just white).
#[derive(Debug)]
pub struct Developer {
    merger: Merger,
    /// What the black series says, if there is one.
    pub black: Option<Black>,
    /// How the response was recovered, if it was.
    pub recovery: Option<RecoveryReport>,
}

impl Developer {
    /// From the calibration photographs of a session.
    ///
    /// # Errors
    /// No photograph at all; a series that tells nothing, with the reason.
    pub fn new(records: &Records, camera: &CameraRig) -> Result<Self> {
        let looked_at = [Role::Response, Role::Preview, Role::Sample];
        Self::with(records, camera.response, &looked_at)
    }

    /// For choosing exposures, before all calibration is there: a response that is not known yet is taken as sRGB, which is
    /// near enough. Samples are not looked at, so that a resumed capture comes to the same.
    ///
    /// # Errors
    /// As [`Developer::new`].
    pub fn for_previews(records: &Records, camera: &CameraRig) -> Result<Self> {
        let unknown = camera.response == ResponseChoice::Recover && records.of(Role::Response).next().is_none();
        let response = if unknown { ResponseChoice::Srgb } else { camera.response };
        Self::with(records, response, &[Role::Response, Role::Preview])
    }

    /// Where the camera clips is seen in photographs of the roles `looked_at`.
    fn with(records: &Records, response: ResponseChoice, looked_at: &[Role]) -> Result<Self> {
        let sample_type = sample_type(records)?;
        // A first level from codes as they are; a curved response wants the second, through its curve.
        let first = black(records, Curve::Linear, sample_type)?;
        let level = first.as_ref().map_or([0.0; 3], |black| black.level);
        let clip = clip(records, sample_type, looked_at)?;
        let (curve, recovery) = curve(records, response, sample_type, clip, level)?;
        let black = if curve == Curve::Linear { first } else { black(records, curve.clone(), sample_type)? };
        let level = black.as_ref().map_or([0.0; 3], |black| black.level);
        let options = Options { clip, black: level, ..Options::new(curve, sample_type) };
        Ok(Self { merger: Merger::new(options)?, black, recovery })
    }

    /// What merges brackets.
    pub fn merger(&self) -> &Merger {
        &self.merger
    }

    /// Merges codes that are in memory.
    ///
    /// # Errors
    /// Pictures of different sizes.
    pub fn merge(&self, exposures: &[Exposure], codes: &[Arc<Image>]) -> Result<Merged> {
        let shot = |e: &Exposure| Shot { exposure: relative(e), iso: e.iso.unwrap_or(100.0), offset: [0; 2] };
        let shots: Vec<Shot> = exposures.iter().map(shot).collect();
        self.merger.merge(&shots, &mut |index| Ok(codes[index].clone()))
    }

    /// What a person should know, a sentence each.
    pub fn doubts(&self) -> &[String] {
        self.black.as_ref().map_or(&[], |black| &black.doubts)
    }

    /// The curve from codes to light.
    pub fn curve(&self) -> &Curve {
        &self.merger.options().curve
    }

    /// A photograph as light.
    ///
    /// # Errors
    /// A file that is gone, changed or no picture.
    pub fn develop(&self, records: &Records, photograph: &Photograph) -> Result<Merged> {
        let shots = photograph.frames.iter().map(|frame| shot(photograph, frame)).collect::<Result<Vec<_>>>()?;
        let mut kept = vec![None; shots.len()];
        self.merger.merge(&shots, &mut |index| {
            if kept[index].is_none() {
                kept[index] = Some(records.codes(photograph, &photograph.frames[index])?.0);
            }
            kept[index].clone().ok_or_else(|| Error::invalid("bracket", "no picture", "one"))
        })
    }

    /// The picture alone.
    ///
    /// # Errors
    /// As [`Developer::develop`].
    pub fn picture(&self, records: &Records, photograph: &Photograph) -> Result<Image> {
        Ok(self.develop(records, photograph)?.image)
    }
}

fn sample_type(records: &Records) -> Result<SampleType> {
    let Some(first) = records.all().next() else {
        return Err(Error::invalid("the session", "no photograph", "a session that was captured"));
    };
    Ok(records.codes(first, &first.frames[0])?.1)
}

fn black(records: &Records, curve: Curve, sample_type: SampleType) -> Result<Option<Black>> {
    let mut blacks = Blacks::new(curve, sample_type);
    let mut any = false;
    for photograph in records.of(Role::Dark) {
        for frame in &photograph.frames {
            let exposure = shot(photograph, frame)?.exposure;
            blacks.add(&records.codes(photograph, frame)?.0, exposure)?;
            any = true;
        }
    }
    if any { blacks.finish().map(Some) } else { Ok(None) }
}

/// Where codes pile up at the top, in the longest exposures.
fn clip(records: &Records, sample_type: SampleType, roles: &[Role]) -> Result<[f32; 3]> {
    let mut survey: Option<Survey> = None;
    let all: Vec<&Photograph> = roles.iter().flat_map(|role| records.of(*role)).collect();
    let step = all.len().div_ceil(SURVEYED).max(1);
    for photograph in all.into_iter().step_by(step) {
        if let Some(frame) = photograph.frames.last() {
            let codes = records.codes(photograph, frame)?.0;
            survey.get_or_insert_with(|| Survey::new(codes.width(), codes.height(), sample_type)).add(&codes, [0; 2]);
        }
    }
    // Where nothing was looked at or nothing piles up, integer codes end at white.
    let end = if sample_type == SampleType::Float { f32::INFINITY } else { 1.0 };
    Ok(survey.map_or([end; 3], |survey| survey.clip().map(|level| level.unwrap_or(end))))
}

fn curve(
    records: &Records,
    response: ResponseChoice,
    sample_type: SampleType,
    clip: [f32; 3],
    black: [f32; 3],
) -> Result<(Curve, Option<RecoveryReport>)> {
    match response {
        ResponseChoice::Linear => Ok((Curve::Linear, None)),
        ResponseChoice::Srgb => Ok((Curve::Srgb, None)),
        ResponseChoice::Recover => {
            let Some(series) = records.of(Role::Response).last() else {
                return Err(Error::invalid(
                    "the camera's response",
                    "no series of exposures in the session",
                    "one: capture with response_times_s in the rig file, or say response = \"linear\" there",
                ));
            };
            let recovered = match sample_type {
                SampleType::U16 => recover_deep(records, series, clip, black)?,
                _ => recover_shallow(records, series, clip, sample_type)?,
            };
            Ok((Curve::Response(recovered.response), Some(recovered.report)))
        }
    }
}

/// From codes of more than 8 bits.
fn recover_deep(records: &Records, series: &Photograph, clip: [f32; 3], black: [f32; 3]) -> Result<Recovered> {
    let shots = series.frames.iter().map(|frame| shot(series, frame)).collect::<Result<Vec<_>>>()?;
    let mut patches: Option<Patches> = None;
    for frame in &series.frames {
        let codes = records.codes(series, frame)?.0;
        patches.get_or_insert_with(|| Patches::new(codes.width(), codes.height())).add(&codes, [0; 2]);
    }
    let samples = patches.map(|patches| patches.samples()).unwrap_or_default();
    hdr::recover_deep(&samples, &Known { shots: &shots, clip, black, noise: Noise::default() })
}

/// From codes of 8 bits.
fn recover_shallow(
    records: &Records,
    series: &Photograph,
    clip: [f32; 3],
    sample_type: SampleType,
) -> Result<Recovered> {
    let mut survey: Option<Survey> = None;
    let mut exposures = Vec::new();
    for frame in &series.frames {
        let codes = records.codes(series, frame)?.0;
        survey.get_or_insert_with(|| Survey::new(codes.width(), codes.height(), sample_type)).add(&codes, [0; 2]);
        exposures.push(shot(series, frame)?.exposure);
    }
    let samples = survey.map(|survey| survey.samples()).unwrap_or_default();
    hdr::recover(&samples, &exposures, clip, hdr::LAMBDA)
}
