//! The measuring on the virtual monitor.

use relume_core::acquire::implicit::{Options, Stop};
use relume_core::domain::Plane;
use relume_core::domain::patterns::Noise;
use relume_core::evaluate::implicit::{Backdrop, Outcome, Photographed, Setup, Trial};
use relume_core::simulate::{Camera, Monitor, Quality, Screen};
use relume_core::wavelet::Wavelet;

use super::report::{Line, Report};
use crate::progress::{Progress, Unit};

/// Terms of the line over terms, at so many patterns (the red graph of figure 6.30).
const TERMS: [usize; 9] = [16, 24, 32, 48, 64, 80, 96, 112, 128];
const AT_PATTERNS: usize = 256;
/// Patterns of the lines over patterns, at so many terms (its green and black graphs).
const PATTERNS: [usize; 6] = [96, 128, 192, 256, 384, 512];
const AT_TERMS: [usize; 2] = [64, 128];
/// Camera rays of a pixel: its reflectance function is that of its area, not of some points in it.
const SAMPLES: usize = 64;

/// What to measure; checked.
#[derive(Debug)]
pub struct Task {
    pub plane: Plane,
    /// Of the photographs.
    pub size: (usize, usize),
    pub basis: Wavelet,
    /// Where the white screen is seen, as a share of it.
    pub noise: f32,
    pub seed: u64,
    /// Names and light.
    pub backdrops: Vec<(String, Backdrop)>,
    /// What repeats it.
    pub command: String,
}

impl Task {
    /// Measures.
    ///
    /// # Errors
    /// A picture too small for any pixel to be covered; Ctrl-C.
    pub fn carry_out(&self) -> anyhow::Result<Report> {
        let photographed = self.photographed()?;
        let trials = trials();
        let all = trials.iter().map(|line| line.1.len() as u64).sum();
        let (mut bar, mut done) = (Progress::new("solving", Unit::Steps), 0);
        let mut lines = Vec::new();
        for (label, trials, over_terms) in &trials {
            let mut outcomes: Vec<Outcome> = Vec::new();
            for trial in trials {
                outcomes.push(photographed.measure(*trial)?);
                done += 1;
                bar.step(done, all)?;
            }
            lines.push(Line { label: label.clone(), over_terms: *over_terms, outcomes });
        }
        Ok(Report {
            tool: concat!("relume ", env!("CARGO_PKG_VERSION")),
            command: self.command.clone(),
            texels: self.plane.size(),
            size: self.size,
            basis: self.basis.id(),
            noise: self.noise,
            pixels: photographed.pixels(),
            backdrops: self.backdrops.iter().map(|backdrop| backdrop.0.clone()).collect(),
            lines,
        })
    }

    fn photographed(&self) -> anyhow::Result<Photographed> {
        let monitor = Monitor::demo(Camera::monitor(self.size.0, self.size.1), self.plane.size());
        let quality = Quality { samples: SAMPLES, ..Quality::rig() };
        let mut bar = Progress::new("tracing the virtual monitor", Unit::Steps);
        let rows = monitor.trace(&quality, &mut |done, all| bar.step(done, all))?;
        let most = PATTERNS[PATTERNS.len() - 1];
        let setup = Setup {
            rows: &rows,
            directly_seen: &monitor.directly_seen(),
            screen: &Screen::monitor(),
            // Haar, whatever the basis: one set of photographs serves every basis.
            patterns: Noise { wavelet: Wavelet::Haar, count: most, seed: self.seed, deviation: Noise::DEVIATION },
            basis: self.basis,
            noise: self.noise,
        };
        let backdrops: Vec<Backdrop> = self.backdrops.iter().map(|backdrop| backdrop.1.clone()).collect();
        let mut bar = Progress::new("photographing", Unit::Steps);
        Ok(Photographed::new(&setup, &backdrops, &mut |done, all| bar.step(done, all))?)
    }
}

/// The lines of the chart: label, trials, and whether they go over terms (or patterns).
fn trials() -> Vec<(String, Vec<Trial>, bool)> {
    let trial = |patterns: usize, terms: usize, stop: Stop| Trial { patterns, options: Options { terms, stop } };
    let mut lines = Vec::new();
    for stop in [Stop::Off, Stop::On] {
        let over_terms = TERMS.map(|terms| trial(AT_PATTERNS, terms, stop)).to_vec();
        lines.push((format!("{AT_PATTERNS} patterns, stop {}", stop.id()), over_terms, true));
    }
    for terms in AT_TERMS {
        for stop in [Stop::Off, Stop::On] {
            let determined = PATTERNS.iter().filter(|patterns| **patterns > terms);
            let over_patterns = determined.map(|patterns| trial(*patterns, terms, stop)).collect();
            lines.push((format!("{terms} terms, stop {}", stop.id()), over_patterns, false));
        }
    }
    lines
}
