//! Compact representations of the whole field: size, speed, and errors of relit pictures.

use std::path::Path;
use std::time::Instant;

use relume_core::Error;
use relume_core::evaluate::relit_against;
use relume_core::evaluate::sliver::{SLIVER_MAP, headings, sliver_map};
use relume_core::field::compress::{Scheme, Stage, compress};
use relume_core::field::{Access, Asset, Kind, Precision};
use relume_core::illumination::EnvMap;
use relume_core::image::Window;
use relume_core::relight::{Light, Look, Relighter, Weights};
use relume_core::wavelet::Wavelet;

use super::measure::{COUNT, Task};
use super::report::{NotMade, Representations, Row, THESIS_THRESHOLD, threshold};
use crate::commands::info::half_samples;
use crate::progress::{self, Progress, Unit};

/// Headings of the sliver: 30 degrees apart.
const POSITIONS: usize = 12;
/// Below this part of the most light that any heading gives, a heading counts as dark: a dome before the object has no
/// light from behind.
const DARK: f64 = 0.01;
/// Pictures whose times the median is taken of.
const TURNS: usize = 7;

/// What is tried, each with its name.
fn candidates(task: &Task) -> Vec<(String, Scheme)> {
    let factored = |error: f64| (format!("Factored, error {} %", threshold(error)), Scheme::Factored { error });
    let wavelet = |wavelet: Wavelet, error: Option<f64>, terms: Option<usize>| {
        let words = match (error, terms) {
            (Some(error), _) => format!("error {} %", threshold(error)),
            (None, terms) => format!("{} coefficients", terms.unwrap_or(0)),
        };
        let (grid, reconstruction) = (task.grid.size(), task.method);
        (format!("{} wavelet, {words}", wavelet.id()), Scheme::Wavelet { wavelet, grid, reconstruction, error, terms })
    };
    let harmonics = |functions: usize| (format!("{functions} spherical harmonics"), Scheme::Harmonics { functions });
    vec![
        factored(0.01),
        factored(0.02),
        factored(0.04),
        wavelet(Wavelet::Daubechies97, Some(THESIS_THRESHOLD.0), None),
        wavelet(Wavelet::Daubechies97, Some(0.01), None),
        wavelet(Wavelet::Daubechies97, Some(0.05), None),
        wavelet(Wavelet::Daubechies97, None, Some(COUNT)),
        harmonics(225),
        harmonics(25),
    ]
}

/// The lights that all representations are relit by.
struct Lights {
    /// Slivers, then maps.
    maps: Vec<EnvMap>,
    slivers: usize,
    /// By the samples.
    truths: Vec<Weights>,
}

/// Makes every representation in `folder`, one after another, and measures it beside the samples.
///
/// # Errors
/// A damaged field; a full disk; Ctrl-C.
pub fn measure(task: &Task, folder: &Path) -> anyhow::Result<Representations> {
    let reference = Relighter::new(Asset::open(task.asset.path(), Access::Mapped)?)?;
    let look = Look { representation: Some(Kind::Dense), method: task.method, ..Look::default() };
    let lights = Lights::new(task, &reference, &look)?;
    let mut measured = Representations {
        lights: std::iter::once(format!("a sliver of light at {} headings", lights.slivers))
            .chain(task.environments.iter().map(|(name, _)| name.clone()))
            .collect(),
        rows: Vec::new(),
        not_made: Vec::new(),
    };
    let candidates = candidates(task);
    let total = candidates.len() as u64;
    for (n, (name, scheme)) in candidates.into_iter().enumerate() {
        // Removed, with what is in it, before the next one is made.
        let room = tempfile::tempdir_in(folder)?;
        let path = room.path().join("compact.rfield");
        let mut bar = Progress::new("making compact representations", Unit::Steps);
        let made = compress(&task.asset, &path, &scheme, &[], &mut |stage, done, all| match stage {
            // Thousandths of one of them.
            Stage::Compressing => bar.step(n as u64 * 1000 + done * 1000 / all.max(1), total * 1000),
            _ => progress::check(),
        });
        match made {
            Ok(()) => {}
            Err(error @ (Error::Unsupported { .. } | Error::Invalid { .. })) => {
                measured.not_made.push(NotMade { name, reason: error.to_string() });
                continue;
            }
            Err(error) => return Err(error.into()),
        }
        drop(bar);
        let compact = Relighter::new(Asset::open(&path, Access::Mapped)?)?;
        let (samples, row) = row(task, name, (&reference, &look), &compact, &lights)?;
        if measured.rows.is_empty() {
            measured.rows.push(samples);
        }
        measured.rows.push(row);
    }
    Ok(measured)
}

impl Lights {
    /// Maps are averaged down to the sliver's: 0.7 degrees, below any rig's cell.
    fn new(task: &Task, reference: &Relighter, look: &Look) -> anyhow::Result<Self> {
        let slivers = headings(POSITIONS).into_iter().map(sliver_map).collect::<Result<Vec<_>, _>>()?;
        let weights = |map: &EnvMap| reference.weights(Light::Map(map), look);
        let mut lit = Vec::new();
        for map in slivers {
            let weights = weights(&map)?;
            let light: f64 = weights.rgb.iter().map(|rgb| f64::from(rgb[0]).abs()).sum();
            lit.push((map, weights, light));
            progress::check()?;
        }
        let most = lit.iter().map(|entry| entry.2).fold(0.0, f64::max);
        lit.retain(|entry| entry.2 > DARK * most);
        let slivers = lit.len();
        let (mut maps, mut truths): (Vec<_>, Vec<_>) = lit.into_iter().map(|(map, weights, _)| (map, weights)).unzip();
        for (_, map) in &task.environments {
            let map = map.reduced(SLIVER_MAP.0).into_owned();
            truths.push(weights(&map)?);
            maps.push(map);
        }
        Ok(Self { maps, slivers, truths })
    }

    /// The map whose relighting is timed.
    fn timed(&self) -> usize {
        self.maps.len() - 1
    }
}

/// The row of the samples, and that of a compact representation measured beside them.
fn row(
    task: &Task,
    name: String,
    (reference, look): (&Relighter, &Look),
    compact: &Relighter,
    lights: &Lights,
) -> anyhow::Result<(Row, Row)> {
    let asset = compact.asset();
    let representation = &asset.manifest().representations[0];
    let kind = representation.kind();
    let compact_look = Look { representation: Some(kind), ..*look };
    let tries =
        lights.maps.iter().map(|map| compact.weights(Light::Map(map), &compact_look)).collect::<Result<Vec<_>, _>>()?;
    let mut bar = Progress::new("relighting", Unit::Steps);
    let errors = relit_against((reference, &lights.truths), (compact, &tries), &mut |done, all| bar.step(done, all))?;
    drop(bar);
    let window = Window::full(asset.width(), asset.height());
    let at = lights.timed();
    let (of_samples_s, relight_s) = in_turns(
        || reference.render(&lights.truths[at], look, window).map(drop),
        || compact.render(&tries[at], &compact_look, window).map(drop),
    )?;
    let map = &lights.maps[at];
    let (project_samples_s, project_s) = in_turns(
        || reference.weights(Light::Map(map), look).map(drop),
        || compact.weights(Light::Map(map), &compact_look).map(drop),
    )?;
    let (slivers, maps) = errors.split_at(lights.slivers);
    let mean = slivers.iter().sum::<f64>() / slivers.len().max(1) as f64;
    let halves = half_samples(&task.asset);
    let dense = task.asset.dense().map_or(Precision::Half, |dense| dense.precision());
    let samples = Row {
        name: if dense == Precision::Half { "Samples, halves" } else { "Samples, floats" }.to_owned(),
        kind: Kind::Dense,
        bytes: task.asset.bytes(Kind::Dense),
        smaller: halves as f64 / task.asset.bytes(Kind::Dense).max(1) as f64,
        reached: 0.0,
        relit: vec![0.0; 1 + maps.len()],
        project_s: project_samples_s,
        relight_s: of_samples_s,
        faster: 1.0,
    };
    let row = Row {
        name,
        kind,
        bytes: asset.bytes(kind),
        smaller: halves as f64 / asset.bytes(kind).max(1) as f64,
        reached: representation.loss().map_or(0.0, |loss| loss.reached),
        relit: std::iter::once(mean).chain(maps.iter().copied()).collect(),
        project_s,
        relight_s,
        faster: of_samples_s / relight_s.max(1e-9),
    };
    Ok((samples, row))
}

/// Median times of two things done in turns, in seconds, so that what else the machine does slows both; each once before,
/// to warm up.
fn in_turns(
    first: impl Fn() -> relume_core::Result<()>,
    second: impl Fn() -> relume_core::Result<()>,
) -> anyhow::Result<(f64, f64)> {
    let time = |what: &dyn Fn() -> relume_core::Result<()>| {
        let begun = Instant::now();
        what().map(|()| begun.elapsed().as_secs_f64())
    };
    let (mut a, mut b) = (Vec::new(), Vec::new());
    for turn in 0..=TURNS {
        let (of_first, of_second) = (time(&first)?, time(&second)?);
        if turn > 0 {
            a.push(of_first);
            b.push(of_second);
        }
        progress::check()?;
    }
    let median = |times: &mut Vec<f64>| *times.select_nth_unstable_by(TURNS / 2, f64::total_cmp).1;
    Ok((median(&mut a), median(&mut b)))
}
