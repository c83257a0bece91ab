//! Which exposures to take: from a preview, and for a response; and whether a finished bracket holds what it should.
//!
//! A preview is a few photographs over all the camera can do, merged. Its brightest light E_top gives the shortest exposure,
//! `s = headroom * white / E_top`, so that (almost) nothing clips; its darkest light of interest E_low the longest, at
//! which a signal `y = E_low s / white` has the wanted signal to noise q by the sensor's [`Noise`]: `y^2 / q^2 =
//! y / F + (r / F)^2`. Between them exposures lie at most a step apart, and all are such that the camera can be set
//! to them.

use super::merge::{Merged, Merger};
use super::noise::Noise;
use super::report::Report;
use crate::error::{Error, Result};

/// What a bracket should hold.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wanted {
    /// Share of the pixels that may clip in the shortest photograph: hot pixels, the lamp's own glint.
    pub clipped: f64,
    /// Where in the range of the shortest photograph the brightest light lies; below 1 by what lamps differ and noise
    /// adds.
    pub headroom: f64,
    /// Signal to noise of the darkest light in the longest photograph.
    pub snr: f64,
    /// Share of the samples that may be darker than the darkest light of interest.
    pub buried: f64,
    /// Light this many stops below the brightest is of no interest: black background is not worth hours.
    pub stops: f64,
    /// From one exposure to the next, stops at most. Two stops leave every light at a signal of an eighth of white or more.
    pub step_stops: f64,
    /// Photographs at most.
    pub most: usize,
}

impl Default for Wanted {
    fn default() -> Self {
        Self { clipped: 1e-4, headroom: 0.7, snr: 10.0, buried: 0.05, stops: 12.0, step_stops: 2.0, most: 9 }
    }
}

/// How bright a scene is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Extent {
    /// Light that [`Wanted::clipped`] of the pixels exceed in some channel, in the scale of merged pictures.
    pub brightest: f64,
    /// More of the pixels than that are clipped in every photograph: `brightest` is too low.
    pub clips: bool,
    /// Light that [`Wanted::buried`] of the samples do not reach; may be 0.
    pub darkest: f64,
}

impl Extent {
    /// Of a merged preview.
    pub fn of(preview: &Merged, wanted: &Wanted) -> Self {
        let data = preview.image.data();
        let mut tops: Vec<f32> = data.chunks_exact(3).map(|p| p.iter().copied().fold(0.0, f32::max)).collect();
        let mut all = data.to_vec();
        Self {
            brightest: quantile(&mut tops, 1.0 - wanted.clipped),
            clips: preview.report.clipped_everywhere.any > wanted.clipped,
            darkest: quantile(&mut all, wanted.buried).max(0.0),
        }
    }

    /// Of several conditions photographed with one series: the brightest of all and the darkest of all.
    pub fn join(self, other: Self) -> Self {
        Self {
            brightest: self.brightest.max(other.brightest),
            clips: self.clips || other.clips,
            darkest: self.darkest.min(other.darkest),
        }
    }
}

fn quantile(values: &mut [f32], share: f64) -> f64 {
    let Some(last) = values.len().checked_sub(1) else { return 0.0 };
    f64::from(*values.select_nth_unstable_by((last as f64 * share).round() as usize, f32::total_cmp).1)
}

/// Exposures to take.
#[derive(Debug, Clone, PartialEq)]
pub struct Series {
    /// Relative exposures, shortest first.
    pub exposures: Vec<f64>,
    /// The preview itself was clipped: preview again from this exposure down, then choose again.
    pub preview_again: Option<f64>,
    /// What a person should know, a sentence each.
    pub doubts: Vec<String>,
}

/// Chooses the exposures of a bracket. `camera` holds the relative exposures it can be set to, in any order; noise and white
/// are those of `merger`, ISO 100 unless `iso` says otherwise.
///
/// # Errors
/// [`Error::Invalid`] for a camera without exposures, a black preview, or wishes that make no sense.
pub fn choose(extent: &Extent, merger: &Merger, iso: f64, camera: &[f64], wanted: &Wanted) -> Result<Series> {
    let camera = settable(camera)?;
    wanted.check()?;
    if extent.brightest.is_nan() || extent.brightest <= 0.0 {
        let expected = "a picture with light in it; are the lamps on and the lens open?";
        return Err(Error::invalid("the preview", "nothing but black", expected));
    }
    let mut doubts = Vec::new();
    let white = merger.white();
    let (shortest, longest) = (camera[0], camera[camera.len() - 1]);
    let top = wanted.headroom * white / extent.brightest;
    let first = camera.iter().copied().rev().find(|s| *s <= top).unwrap_or_else(|| {
        doubts.push(format!(
            "the brightest light clips even at the camera's shortest exposure, by {:.1} stops: close the aperture or dim the lamps",
            (shortest / top).log2()
        ));
        shortest
    });
    let darkest = extent.darkest.max(extent.brightest * (-wanted.stops).exp2());
    let bottom = white * signal(&merger.options().noise, iso, wanted.snr) / darkest;
    let last = camera.iter().copied().find(|s| *s >= bottom).unwrap_or_else(|| {
        doubts.push(format!(
            "the darkest light stays noisy at the camera's longest exposure, {:.1} stops short: open the aperture or brighten the \
             lamps",
            (bottom / longest).log2()
        ));
        longest
    });
    let mut exposures = steps(&camera, first, last.max(first), wanted.step_stops);
    if exposures.len() > wanted.most {
        doubts.push(format!(
            "{} exposures would hold the scene, {} are allowed: its darkest parts will be noisy",
            exposures.len(),
            wanted.most
        ));
        exposures.truncate(wanted.most);
    }
    let gap = exposures.windows(2).map(|w| (w[1] / w[0]).log2()).fold(0.0, f64::max);
    if gap > wanted.step_stops + SLACK_STOPS {
        doubts.push(format!("the camera has no exposure in a gap of {gap:.1} stops"));
    }
    let preview_again = (extent.clips && first > shortest).then_some(first);
    Ok(Series { exposures, preview_again, doubts })
}

/// Nominal times are not quite thirds of stops: 1/60 for 1/64.
const SLACK_STOPS: f64 = 0.15;

/// The signal, in shares of white, whose ratio to noise is `snr`.
fn signal(noise: &Noise, iso: f64, snr: f64) -> f64 {
    let full = noise.electrons(iso);
    let (photon, read) = (1.0 / full, noise.read_e / full);
    // y^2 - q^2 y / F - q^2 (r / F)^2 = 0.
    0.5 * snr * (snr * photon + (snr * snr * photon * photon + 4.0 * read * read).sqrt())
}

/// From `first` to `last` by the longest steps that are allowed and that the camera has.
fn steps(camera: &[f64], first: f64, last: f64, step_stops: f64) -> Vec<f64> {
    let mut exposures = vec![first];
    let mut at = first;
    while at < last {
        let reach = (at * (step_stops + SLACK_STOPS).exp2()).min(last);
        let next = camera.iter().copied().rev().find(|s| *s > at && *s <= reach);
        let Some(next) = next.or_else(|| camera.iter().copied().find(|s| *s > at)) else { break };
        exposures.push(next);
        at = next;
    }
    exposures
}

impl Wanted {
    fn check(&self) -> Result<()> {
        let share = |v: f64| (0.0..1.0).contains(&v);
        let sound = share(self.clipped)
            && share(self.buried)
            && self.headroom > 0.0
            && self.headroom <= 1.0
            && (1.0..=1000.0).contains(&self.snr)
            && (0.0..=30.0).contains(&self.stops)
            && (0.3..=8.0).contains(&self.step_stops)
            && self.most > 0;
        if sound {
            return Ok(());
        }
        let expected =
            "shares below 1, headroom up to 1, a signal to noise of 1 to 1000, steps of 0.3 to 8 stops over 30 at most";
        Err(Error::invalid("the wanted bracket", format!("{self:?}"), expected))
    }
}

/// In order, each once.
fn settable(camera: &[f64]) -> Result<Vec<f64>> {
    let mut sorted = camera.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted.dedup();
    if sorted.is_empty() || sorted.iter().any(|s| !(s.is_normal() && *s > 0.0)) {
        return Err(Error::invalid("the camera's exposures", format!("{camera:?}"), "one or more positive numbers"));
    }
    Ok(sorted)
}

/// Stops between the photographs of a preview: merged, they hold all that the camera can, with a signal of 3 % of white or
/// more.
const PREVIEW_STOPS: f64 = 5.0;

/// Exposures of a preview: all the camera can do in steps of five stops.
///
/// # Errors
/// A camera without exposures.
pub fn preview(camera: &[f64]) -> Result<Vec<f64>> {
    let camera = settable(camera)?;
    Ok(steps(&camera, camera[0], camera[camera.len() - 1], PREVIEW_STOPS))
}

/// Stops between the photographs of a series for the response, in turn: uneven, so that no ripple hides between them (see
/// [`recover_deep`](super::recover_deep)).
const RESPONSE_STOPS: [f64; 2] = [2.0 / 3.0, 1.0];

/// Exposures to recover a response from: `count` about `middle`, 2/3 and 1 stop apart in turn, as near as the camera can be
/// set. Nine span 6 2/3 stops.
///
/// # Errors
/// A camera without exposures, or with fewer than three about there.
pub fn for_response(camera: &[f64], middle: f64, count: usize) -> Result<Vec<f64>> {
    let camera = settable(camera)?;
    let span: f64 = (1..count).map(|k| RESPONSE_STOPS[k % 2]).sum();
    let mut at = middle.log2() - 0.5 * span;
    let mut found: Vec<f64> = Vec::with_capacity(count);
    for k in 0..count {
        let distance = |s: &f64| (s.log2() - at).abs();
        let nearest = camera.iter().copied().min_by(|a, b| distance(a).total_cmp(&distance(b)));
        found.extend(nearest.filter(|s| found.last().is_none_or(|last| s > last)));
        at += RESPONSE_STOPS[(k + 1) % 2];
    }
    if found.len() < 3 {
        let expected = "at least three exposures to recover a response from";
        return Err(Error::invalid("the camera's exposures", format!("{} near {middle:.4}", found.len()), expected));
    }
    Ok(found)
}

/// What a merged bracket lacks, a sentence each; none where it holds the scene.
pub fn check(report: &Report, wanted: &Wanted) -> Vec<String> {
    let mut doubts = Vec::new();
    let percent = |share: f64| 100.0 * share;
    if report.clipped_everywhere.any > wanted.clipped {
        doubts.push(format!(
            "the top clips: {:.3} % of the pixels are clipped in every photograph; add a shorter exposure",
            percent(report.clipped_everywhere.any)
        ));
    }
    let dark = report.dark_everywhere.rgb.iter().sum::<f64>() / 3.0;
    let noisy = report.noise[0] > 0.0 && f64::from(report.noise[0]) > 1.0 / wanted.snr;
    if noisy || dark > DARK_SHARE {
        doubts.push(format!(
            "the bottom is noise: {:.1} % of the samples are as good as black and half of the others stray by {:.1} % or more; add \
             a longer exposure",
            percent(dark),
            percent(f64::from(report.noise[0]))
        ));
    }
    doubts
}

/// An object before black cloth leaves less of the picture black than this.
const DARK_SHARE: f64 = 0.95;

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::hdr::testing::{self, NOISE};
    use crate::hdr::{Curve, Options, Shot};
    use crate::image::{Image, SampleType};

    /// Thirds of stops from 1/8000 s to 30 s.
    fn camera() -> Vec<f64> {
        (0..54).map(|k| 30.0 * 2f64.powf(-f64::from(k) / 3.0)).collect()
    }

    fn merger() -> Merger {
        let black = [testing::DARK as f32; 3];
        Merger::new(Options { black, clip: [1.0; 3], noise: NOISE, ..Options::new(Curve::Linear, SampleType::U16) })
            .unwrap()
    }

    /// Light over a range, with a glint on a few pixels and a quarter of black background.
    fn scene(low: f32, high: f32) -> Image {
        Image::from_fn(200, 100, |x, y| {
            let share = y as f32 / 99.0;
            if x < 5 { [0.0; 3] } else { [low * (high / low).powf(share); 3] }
        })
    }

    fn photographed(scene: &Image, exposures: &[f64]) -> Merged {
        let frames: Vec<Arc<Image>> =
            (1..).zip(exposures).map(|(n, s)| Arc::new(testing::LINEAR.photograph(scene, *s, n))).collect();
        let shots: Vec<Shot> = exposures.iter().map(|s| Shot { exposure: *s, iso: 100.0, offset: [0, 0] }).collect();
        merger().merge(&shots, &mut |i| Ok(frames[i].clone())).unwrap()
    }

    #[test]
    fn a_preview_gives_a_bracket_that_holds_the_scene() {
        let wanted = Wanted::default();
        for (low, high) in [(0.01f32, 3.0f32), (0.5, 400.0), (1.0, 2.0)] {
            let scene = scene(low, high);
            let looked = photographed(&scene, &preview(&camera()).unwrap());
            let extent = Extent::of(&looked, &wanted);
            let series = choose(&extent, &merger(), 100.0, &camera(), &wanted).unwrap();
            assert!(series.doubts.is_empty() && series.preview_again.is_none(), "{series:?}");
            let (first, last) = (series.exposures[0], *series.exposures.last().unwrap());
            // The brightest at 0.35 to 0.7 of white, the darkest at 10 to 1 or just better.
            let white = 1.0 - testing::DARK;
            let top = f64::from(high) * first / white;
            assert!((0.5..0.71).contains(&top), "{low}..{high}: {top} of white, {series:?}");
            let y = f64::from(low) * last / white;
            let snr = y / NOISE.variance(y, 100.0).sqrt();
            assert!(snr > 10.0 && (snr < 18.0 || series.exposures.len() == 1), "{low}..{high}: {snr}, {series:?}");
            assert!(series.exposures.windows(2).all(|w| w[1] > w[0] && (w[1] / w[0]).log2() < 2.16), "{series:?}");
            // No photograph more than the range needs.
            assert!(series.exposures.len() as f64 <= (last / first).log2() / 2.0 + 2.01, "{series:?}");
            let taken = photographed(&scene, &series.exposures);
            assert!(check(&taken.report, &wanted).is_empty(), "{:?}", taken.report);
        }
    }

    #[test]
    fn limits_of_the_camera_are_told() {
        let extent = Extent { brightest: 1.0, clips: false, darkest: 1e-3 };
        let of = |camera: &[f64], wanted: &Wanted| choose(&extent, &merger(), 100.0, camera, wanted).unwrap();
        let (bright, dim) = (of(&[2.0, 4.0, 16.0], &Wanted::default()), of(&[0.1, 0.4], &Wanted::default()));
        assert!(bright.doubts[0].contains("clips even at"), "{bright:?}");
        assert!(dim.doubts[0].contains("stays noisy") && dim.exposures == [0.4], "{dim:?}");
        let gap = of(&[0.1, 30.0], &Wanted::default());
        assert!(gap.doubts.iter().any(|d| d.contains("gap of 8.2 stops")) && gap.exposures == [0.1, 30.0], "{gap:?}");
        let few = of(&camera(), &Wanted { most: 2, ..Wanted::default() });
        assert!(few.doubts[0].contains("2 are allowed") && few.exposures.len() == 2, "{few:?}");
        let clipped =
            choose(&Extent { clips: true, ..extent }, &merger(), 100.0, &camera(), &Wanted::default()).unwrap();
        assert_eq!(clipped.preview_again, Some(clipped.exposures[0]));
        let refuse = |extent: Extent, camera: &[f64], wanted: Wanted| {
            choose(&extent, &merger(), 100.0, camera, &wanted).unwrap_err().to_string()
        };
        assert!(refuse(Extent { brightest: 0.0, ..extent }, &[1.0], Wanted::default()).contains("nothing but black"));
        assert!(refuse(extent, &[], Wanted::default()).contains("positive numbers"));
        assert!(refuse(extent, &[1.0, f64::NAN], Wanted::default()).contains("positive numbers"));
        assert!(refuse(extent, &[1.0], Wanted { snr: 0.0, ..Wanted::default() }).contains("signal to noise"));
    }

    #[test]
    fn brackets_that_clip_or_drown_are_told() {
        let scene = scene(0.01, 3.0);
        let clipped = check(&photographed(&scene, &[4.0, 16.0]).report, &Wanted::default());
        assert!(clipped[0].contains("top clips") && clipped.len() == 1, "{clipped:?}");
        let drowned = check(&photographed(&scene, &[1e-3]).report, &Wanted::default());
        assert!(drowned[0].contains("bottom is noise") && drowned.len() == 1, "{drowned:?}");
    }

    #[test]
    fn exposures_for_a_response_are_uneven() {
        let found = for_response(&camera(), 0.1, 9).unwrap();
        let stops: Vec<f64> = found.windows(2).map(|w| (w[1] / w[0]).log2()).collect();
        assert_eq!(found.len(), 9);
        assert!(stops.iter().enumerate().all(|(k, s)| (s - RESPONSE_STOPS[(k + 1) % 2]).abs() < 1e-6), "{stops:?}");
        assert!(super::super::recover_deep::doubt(&found).is_none());
        assert!(for_response(&[1.0, 2.0], 1.0, 9).is_err());
    }
}
