//! The scan of a stage (2.3): calibration, previews, then all lamps of a stop before the turntable moves.

use super::{Step, Times};
use crate::rigs::{Condition, Lamps, RigFile, StageRig};
use crate::session::Role;

/// Previews are taken at so many places of the scan.
const PREVIEWS: usize = 6;
/// Previews are this many stops apart from the shortest to the longest time the camera can do.
const PREVIEW_STOPS: f64 = 4.0;

/// The steps of a stage: calibration first.
pub fn steps(rig: &RigFile, stage: &StageRig) -> Vec<Step> {
    let mut list = List { steps: Vec::new(), scanned: 0 };
    calibration(rig, &stage.lamps, &mut list);
    let chosen = rig.camera.times_s.is_none();
    if chosen {
        for condition in spread(&stage.lamps) {
            list.add(condition, Role::Preview, Times::Fixed(preview_times(rig)));
        }
    }
    samples(stage, &mut list);
    list.steps
}

/// Samples in the scan of a stage.
pub fn count(steps: &[Step]) -> u64 {
    steps.iter().filter(|step| step.role == Role::Sample).count() as u64
}

struct List {
    steps: Vec<Step>,
    scanned: u64,
}

impl List {
    fn add(&mut self, condition: Condition, role: Role, times: Times) {
        let index = self.steps.len() as u64;
        self.steps.push(Step { index, condition, role, times, scanned: self.scanned });
        if role == Role::Sample {
            self.scanned += 1;
        }
    }
}

fn calibration(rig: &RigFile, lamps: &Lamps, list: &mut List) {
    let calibration = &rig.calibration;
    if !calibration.dark_times_s.is_empty() {
        list.add(Condition::Black { stop: 0 }, Role::Dark, Times::Fixed(calibration.dark_times_s.clone()));
    }
    // White ball, white card and chart before the object: each is put in place once.
    let white = || Times::Series { of: Role::WhiteBall, factor: 1.0 };
    let front = (lamps.per_stop() / 2).min(lamps.count().saturating_sub(1));
    let first_white = match (&calibration.white_ball, calibration.flat_field || calibration.chart) {
        (Some(_), _) => Some(Condition::WhiteBall(front)),
        (None, true) => Some(Condition::FlatField(front)),
        (None, false) => None,
    };
    if let Some(condition) = first_white.filter(|_| rig.camera.times_s.is_none()) {
        list.add(condition, Role::Preview, Times::Fixed(preview_times(rig)));
    }
    if calibration.white_ball.is_some() {
        (0..lamps.per_stop()).for_each(|lamp| list.add(Condition::WhiteBall(lamp), Role::WhiteBall, white()));
    }
    if calibration.flat_field {
        (0..lamps.count()).for_each(|lamp| list.add(Condition::FlatField(lamp), Role::FlatField, white()));
    }
    if calibration.chart {
        let together = Times::Series { of: Role::WhiteBall, factor: 1.0 / lamps.per_stop() as f64 };
        list.add(Condition::Chart, Role::Chart, together);
    }
    if !calibration.response_times_s.is_empty() {
        let times = Times::Fixed(calibration.response_times_s.clone());
        list.add(Condition::AllLamps { stop: 0 }, Role::Response, times);
    }
}

/// The times of previews: from the shortest to the longest of the camera.
pub fn preview_times(rig: &RigFile) -> Vec<f64> {
    let [fastest, slowest] = rig.exposure_limits();
    let stops = (slowest / fastest).log2();
    let count = (stops / PREVIEW_STOPS).ceil().max(1.0);
    (0..=count as u32).map(|n| fastest * (stops * f64::from(n) / count).exp2()).map(|t| t.min(slowest)).collect()
}

/// Lamps spread over the scan, by stops and by height: the darkest light; and all lamps of some stops together: their glints, each
/// as bright as alone.
fn spread(lamps: &Lamps) -> Vec<Condition> {
    let count = lamps.count();
    let shown = PREVIEWS.min(count);
    let at = |n: usize| (n * lamps.stops() / shown) * lamps.per_stop() + n * lamps.per_stop() / shown;
    let mut list: Vec<usize> = (0..shown).map(at).collect();
    list.sort_unstable();
    list.dedup();
    let together = PREVIEWS.min(lamps.stops());
    let stops = (0..together).map(|n| Condition::AllLamps { stop: n * lamps.stops() / together });
    list.into_iter().map(Condition::Lamp).chain(stops).collect()
}

fn samples(stage: &StageRig, list: &mut List) {
    let lamps = &stage.lamps;
    let usual = || Times::Series { of: Role::Sample, factor: 1.0 };
    // Together they are brighter; shorter times keep the same codes.
    let together = || Times::Series { of: Role::Sample, factor: 1.0 / lamps.per_stop() as f64 };
    let reference = Condition::AllLamps { stop: 0 };
    for stop in 0..lamps.stops() {
        list.add(Condition::Black { stop }, Role::Black, usual());
        if stage.all_lit {
            list.add(Condition::AllLamps { stop }, Role::AllLit, together());
        }
        for lamp in stop * lamps.per_stop()..(stop + 1) * lamps.per_stop() {
            if stage.reference_every > 0 && lamp.is_multiple_of(stage.reference_every) {
                list.add(reference.clone(), Role::Reference, together());
            }
            list.add(Condition::Lamp(lamp), Role::Sample, usual());
        }
    }
    if stage.reference_every > 0 {
        list.add(reference, Role::Reference, together());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rig(stage: &str, rest: &str) -> RigFile {
        let text = format!(
            "version = 1\nname = \"t\"\nkind = \"stage\"\n[camera]\nlimits_s = [0.001, 16]\n{rest}\n[stage]\n{stage}\n\
             [stage.lamps]\nlayout = \"arc\"\nlatitudes = 3\nlongitudes = 4\n\
             [virtual]\nwidth = 8\nheight = 8\nirradiance = 1\n\
             [virtual.sensor]\nfull_well_e = 1e4\nread_e = 5\nbits = 12\ndark = 0\nresponse = \"linear\"\n"
        );
        RigFile::parse(&text, std::path::Path::new("rig.toml")).unwrap()
    }

    fn all(rig: &RigFile) -> Vec<Step> {
        steps(rig, rig.stage.as_ref().unwrap())
    }

    #[test]
    fn all_lamps_of_a_stop_come_before_the_next() {
        let steps = all(&rig("all_lit = true", "times_s = [0.1]"));
        let stops: Vec<usize> = steps.iter().map(|step| step.condition.stop(3)).collect();
        assert!(stops.is_sorted(), "{stops:?}");
        assert_eq!((steps.len(), count(&steps)), (4 * (1 + 1 + 3), 12));
        assert!(steps.iter().enumerate().all(|(n, step)| step.index == n as u64));
        let AllLit { factor } = all_lit(&steps);
        assert!((factor - 1.0 / 3.0).abs() < 1e-12);
        let lamps: Vec<u64> = steps.iter().filter(|s| s.role == Role::Sample).map(|s| s.scanned).collect();
        assert_eq!(lamps, (0..12).collect::<Vec<u64>>());
    }

    struct AllLit {
        factor: f64,
    }

    fn all_lit(steps: &[Step]) -> AllLit {
        let step = steps.iter().find(|step| step.role == Role::AllLit).unwrap();
        let Times::Series { factor, .. } = step.times else { panic!("{step:?}") };
        AllLit { factor }
    }

    #[test]
    fn references_come_every_so_often_and_at_both_ends() {
        let steps = all(&rig("reference_every = 5", "times_s = [0.1]"));
        let before: Vec<u64> = steps.iter().filter(|s| s.role == Role::Reference).map(|s| s.scanned).collect();
        assert_eq!(before, [0, 5, 10, 12]);
        assert!(all(&rig("", "times_s = [0.1]")).iter().all(|s| s.role != Role::Reference));
    }

    #[test]
    fn previews_span_the_camera() {
        let steps = all(&rig("", ""));
        let preview: Vec<&Step> = steps.iter().filter(|step| step.role == Role::Preview).collect();
        let seen: std::collections::HashSet<&Condition> = preview.iter().map(|step| &step.condition).collect();
        assert!((4 + 4..=6 + 4).contains(&seen.len()) && seen.len() == preview.len(), "{seen:?}");
        let Times::Fixed(times) = &preview[0].times else { panic!() };
        assert!((times[0] - 0.001).abs() < 1e-12 && (times[times.len() - 1] - 16.0).abs() < 1e-9, "{times:?}");
        assert!(times.windows(2).all(|pair| pair[1] / pair[0] < 16.01));
        assert!(all(&rig("", "times_s = [0.1]")).iter().all(|step| step.role != Role::Preview));
    }
}
