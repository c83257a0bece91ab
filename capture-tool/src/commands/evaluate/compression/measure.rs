//! The measuring: what wavelets lose of reflectance functions, by count, by threshold, over time, and by way of choosing.

use std::path::Path;

use relume_core::domain::StageGrid;
use relume_core::evaluate::compression::{
    Budget, Codec, Figures, Functions, OverTime, Sweep, approximations, errors, over_time,
};
use relume_core::evaluate::pixel_sets::{sampled, seen};
use relume_core::field::Asset;
use relume_core::illumination::EnvMap;
use relume_core::reconstruct::Method;
use relume_core::wavelet::{Approximation, Wavelet};

use super::report::{ByCount, ByError, Choice, OfWavelet, Report, Trees};
use super::representations;
use crate::progress::{Progress, Unit};

/// The wavelets of 5.4; those that a stage's rows, which are mirrored at both ends, allow.
pub const WAVELETS: [Wavelet; 3] = [Wavelet::Haar, Wavelet::LeGall53, Wavelet::Daubechies97];
/// Relative errors that functions are compressed to (figure 5.7).
pub const ERRORS: [f64; 7] = [0.0005, 0.001, 0.002, 0.005, 0.01, 0.02, 0.05];
/// What is shown over time: the threshold of figure 5.8, and one at which wavelets differ to the eye.
pub const SHOWN_ERRORS: [f64; 2] = [0.001, 0.05];
/// The count of figure 5.5 and of the numbers that the thesis gives.
pub const COUNT: usize = 256;
/// Headings of the sliver over time: 2 degrees each, less than half of its width.
const FRAMES: usize = 180;
/// Coefficients from which counts double.
const FEWEST: usize = 16;
/// Pixels that ways of choosing are compared on, and the largest number of coefficients there: the best tree takes a
/// tenth of a second for each.
const TREE_PIXELS: usize = 48;
const TREE_TERMS: usize = 2048;
/// Seed of the choice of pixels.
const SEED: u64 = 1;

/// What to measure; checked.
#[derive(Debug)]
pub struct Task {
    pub asset: Asset,
    pub grid: StageGrid,
    /// How functions are rebuilt, and light is projected.
    pub method: Method,
    /// The most pixels to measure.
    pub pixels: usize,
    pub column: usize,
    /// Names and maps.
    pub environments: Vec<(String, EnvMap)>,
    /// What repeats it.
    pub command: String,
}

/// What was measured, and the pictures of it.
#[derive(Debug)]
pub struct Measured {
    pub report: Report,
    /// By [`Task::shown`], for each wavelet.
    pub over_time: OverTime,
}

impl Task {
    /// Measures; `folder` is for files that come and go.
    ///
    /// # Errors
    /// A damaged field; a full disk; Ctrl-C.
    pub fn carry_out(&self, folder: &Path) -> anyhow::Result<Measured> {
        let asset = &self.asset;
        let mut bar = Progress::new("looking for pixels that are not black", Unit::Steps);
        let seen = seen(asset.samples()?, asset.alpha(), &mut |done, all| bar.step(done, all))?;
        anyhow::ensure!(
            !seen.is_empty(),
            "{} is black under every lamp: there is nothing to measure",
            asset.path().display()
        );
        let pixels = sampled(&seen, self.pixels, SEED);

        let functions = Functions::new(asset.samples()?, asset.directions()?, self.method, self.grid.clone())?;
        let sweep = Sweep::new(&self.grid, FRAMES)?;
        let codecs = WAVELETS.iter().map(|w| Codec::new(*w, &self.grid)).collect::<Result<Vec<_>, _>>()?;
        let wavelets = self.wavelets(&functions, &codecs, &sweep, &pixels)?;
        let mut bar = Progress::new("turning a sliver of light", Unit::Steps);
        let over_time =
            over_time(&functions, &codecs, &self.shown(), &sweep, self.column, &mut |done, all| bar.step(done, all))?;
        let trees = self.trees(&functions, &pixels)?;
        let representations = representations::measure(self, folder)?;
        let report = Report {
            tool: concat!("relume ", env!("CARGO_PKG_VERSION")),
            command: self.command.clone(),
            asset: asset.path().display().to_string(),
            size: [asset.width(), asset.height()],
            lamps: asset.directions()?.len(),
            grid: [self.grid.size().0, self.grid.size().1],
            reconstruction: self.method.id(),
            pixels_seen: seen.len(),
            pixels: pixels.len(),
            seed: SEED,
            wavelets,
            trees,
            representations,
        };
        Ok(Measured { report, over_time })
    }

    /// Errors by count and by threshold, on some pixels.
    fn wavelets(
        &self,
        functions: &Functions<'_>,
        codecs: &[Codec],
        sweep: &Sweep,
        pixels: &[u32],
    ) -> anyhow::Result<Vec<OfWavelet>> {
        let counts = self.counts();
        let budgets: Vec<Budget> = counts.iter().map(|&n| Budget::Terms(n)).chain(ERRORS.map(Budget::Error)).collect();
        let mut bar = Progress::new("compressing reflectance functions", Unit::Steps);
        let found = errors(functions, codecs, &budgets, sweep, pixels, &mut |done, all| bar.step(done, all))?;
        let texels = self.grid.texels() as f64;
        let of_codec = |(codec, figures): (&Codec, &Vec<Figures>)| {
            let (by_count, by_error) = figures.split_at(counts.len());
            let count = |(&count, &figures): (&usize, &Figures)| ByCount { count, figures };
            let error = |(&error, &figures): (&f64, &Figures)| ByError {
                error,
                ratio: texels / figures.terms.mean.max(1.0),
                figures,
            };
            OfWavelet {
                id: codec.wavelet().id(),
                label: label(codec.wavelet()),
                by_count: counts.iter().zip(by_count).map(count).collect(),
                by_error: ERRORS.iter().zip(by_error).map(error).collect(),
            }
        };
        Ok(codecs.iter().zip(&found).map(of_codec).collect())
    }

    /// 16, 32, ... to half of the coefficients.
    fn counts(&self) -> Vec<usize> {
        std::iter::successors(Some(FEWEST), |n| Some(2 * n)).take_while(|n| 2 * n <= self.grid.texels()).collect()
    }

    /// What is shown over time.
    pub fn shown(&self) -> Vec<Budget> {
        SHOWN_ERRORS.map(Budget::Error).into_iter().chain([Budget::Terms(COUNT)]).collect()
    }

    /// Ways of choosing, with the 9/7.
    fn trees(&self, functions: &Functions<'_>, pixels: &[u32]) -> anyhow::Result<Trees> {
        let codec = Codec::new(Wavelet::Daubechies97, &self.grid)?;
        let counts: Vec<usize> = self.counts().into_iter().filter(|n| *n <= TREE_TERMS).collect();
        let pixels = sampled(pixels, TREE_PIXELS, SEED);
        let mut bar = Progress::new("growing trees", Unit::Steps);
        let found = approximations(functions, &codec, &counts, &pixels, &mut |done, all| bar.step(done, all))?;
        let choice = |(how, errors): (&Approximation, Vec<_>)| Choice { label: choice_label(*how), errors };
        Ok(Trees {
            wavelet: codec.wavelet().id(),
            pixels: pixels.len(),
            choices: Approximation::ALL.iter().zip(found).map(choice).collect(),
            counts,
        })
    }
}

fn label(wavelet: Wavelet) -> &'static str {
    match wavelet {
        Wavelet::Haar => "Haar",
        Wavelet::LeGall53 => "5/3 LeGall",
        Wavelet::Daubechies97 => "9/7 Daubechies",
        Wavelet::Daubechies4 => "D4",
        Wavelet::Daubechies8 => "D8",
    }
}

fn choice_label(how: Approximation) -> &'static str {
    match how {
        Approximation::Linear => "Linear",
        Approximation::NonLinear => "Non-linear",
        Approximation::BestTree => "Best tree",
        Approximation::GreedyTree => "Greedy progressive tree",
        Approximation::OptimalTree => "Optimal progressive tree",
    }
}
