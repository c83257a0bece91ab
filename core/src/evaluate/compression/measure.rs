//! Errors by count, by threshold and by way of choosing; pictures over time.

use super::super::blocks::Progress;
use super::super::reconstruction::Summary;
use super::codec::{Budget, Codec};
use super::functions::{CHANNELS, Functions};
use super::norms::{relative, squares, subtract};
use super::sweep::Sweep;
use crate::error::Result;
use crate::image::Image;
use crate::wavelet::Approximation;

/// What one wavelet does with one budget, over some pixels.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Figures {
    /// Coefficients a function.
    pub terms: Summary,
    /// Relative L2 error of the decoded function.
    pub l2: Summary,
    /// Relative H1 error of it.
    pub h1: Summary,
    /// Relative H1 error of the pixel over time, under the turning sliver.
    pub h1_over_time: Summary,
}

/// Numbers of [`Figures`] for one pixel.
type Numbers = [f64; 4];

/// Sums for means and deviations.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    count: f64,
    sum: f64,
    squares: f64,
}

impl Sums {
    fn add(&mut self, number: f64) {
        self.count += 1.0;
        self.sum += number;
        self.squares += number * number;
    }

    fn summary(&self) -> Summary {
        let count = self.count.max(1.0);
        let mean = self.sum / count;
        Summary { mean, deviation: (self.squares / count - mean * mean).max(0.0).sqrt() }
    }
}

/// Errors of the non-linear approximation, `[codec][budget]`, over the functions of some pixels. One pass over their
/// blocks. Cost: some milliseconds a pixel, codec and ten budgets at 256 x 64.
///
/// # Errors
/// As [`Functions::visit`].
pub fn errors(
    functions: &Functions<'_>,
    codecs: &[Codec],
    budgets: &[Budget],
    sweep: &Sweep,
    pixels: &[u32],
    progress: &mut Progress<'_>,
) -> Result<Vec<Vec<Figures>>> {
    let mut sums = vec![vec![[Sums::default(); 4]; budgets.len()]; codecs.len()];
    let work = |function: &[f32]| -> Vec<Vec<Numbers>> {
        let whole = squares(function, functions.grid().size(), CHANNELS, CHANNELS)[0];
        let lit = sweep.lit(function, CHANNELS);
        let of_codec = |codec: &Codec| {
            let (terms, mut decoded) = compressed(codec, function, budgets);
            let lanes = budgets.len() * CHANNELS;
            let mut over_time = sweep.lit(&decoded, lanes);
            subtract(&mut decoded, lanes, function, CHANNELS);
            subtract(&mut over_time, lanes, &lit, CHANNELS);
            let off = squares(&decoded, functions.grid().size(), lanes, CHANNELS);
            let off_over_time = squares(&over_time, (sweep.frames(), 1), lanes, CHANNELS);
            let of_time = squares(&lit, (sweep.frames(), 1), CHANNELS, CHANNELS)[0];
            let numbers = |n: usize| {
                [
                    terms[n] as f64,
                    relative(off[n].l2, whole.l2),
                    relative(off[n].h1(), whole.h1()),
                    relative(off_over_time[n].h1(), of_time.h1()),
                ]
            };
            (0..budgets.len()).map(numbers).collect()
        };
        codecs.iter().map(of_codec).collect()
    };
    let take = |_: usize, numbers: Vec<Vec<Numbers>>| {
        for (sums, numbers) in sums.iter_mut().flatten().zip(numbers.iter().flatten()) {
            sums.iter_mut().zip(numbers).for_each(|(sum, number)| sum.add(*number));
        }
    };
    functions.visit(pixels, work, take, progress)?;
    let figures = |sums: &[Sums; 4]| {
        let [terms, l2, h1, h1_over_time] = sums.map(|sums| sums.summary());
        Figures { terms, l2, h1, h1_over_time }
    };
    Ok(sums.iter().map(|budgets| budgets.iter().map(figures).collect()).collect())
}

/// The number of coefficients that each budget takes of a function, and what they decode to, `[texel][budget][channel]`.
fn compressed(codec: &Codec, function: &[f32], budgets: &[Budget]) -> (Vec<usize>, Vec<f32>) {
    let coefficients = codec.analyse(function);
    let order = codec.choose(Approximation::NonLinear, &coefficients, usize::MAX);
    let terms = codec.terms(function, &coefficients, &order, budgets);
    let sets: Vec<&[u32]> = terms.iter().map(|terms| &order[..*terms]).collect();
    let decoded = codec.decode(&coefficients, &sets);
    (terms, decoded)
}

/// One column of the picture under the turning sliver: time runs to the right, a row is a pixel.
#[derive(Debug)]
pub struct OverTime {
    /// By the functions as rebuilt.
    pub rebuilt: Image,
    /// By what they were compressed to, `[codec][budget]`.
    pub compressed: Vec<Vec<Image>>,
}

/// The pictures of figure 5.8 for column `x`. Memory: those of the pictures.
///
/// # Errors
/// As [`Functions::visit`].
pub fn over_time(
    functions: &Functions<'_>,
    codecs: &[Codec],
    budgets: &[Budget],
    sweep: &Sweep,
    x: usize,
    progress: &mut Progress<'_>,
) -> Result<OverTime> {
    let layout = functions.samples().layout();
    let pixels: Vec<u32> = (0..layout.height).map(|y| (y * layout.width + x) as u32).collect();
    let picture = || Image::new(sweep.frames(), layout.height, CHANNELS);
    let mut pictures = OverTime {
        rebuilt: picture(),
        compressed: codecs.iter().map(|_| budgets.iter().map(|_| picture()).collect()).collect(),
    };
    let work = |function: &[f32]| -> (Vec<f32>, Vec<Vec<f32>>) {
        let lit = |codec: &Codec| sweep.lit(&compressed(codec, function, budgets).1, budgets.len() * CHANNELS);
        (sweep.lit(function, CHANNELS), codecs.iter().map(lit).collect())
    };
    let take = |y: usize, (rebuilt, compressed): (Vec<f32>, Vec<Vec<f32>>)| {
        let put = |picture: &mut Image, values: &[f32], lanes: usize, n: usize| {
            for (frame, lanes) in values.chunks_exact(lanes).enumerate() {
                picture.pixel_mut(frame, y).copy_from_slice(&lanes[n * CHANNELS..][..CHANNELS]);
            }
        };
        put(&mut pictures.rebuilt, &rebuilt, CHANNELS, 0);
        for (pictures, values) in pictures.compressed.iter_mut().zip(&compressed) {
            for (n, picture) in pictures.iter_mut().enumerate() {
                put(picture, values, budgets.len() * CHANNELS, n);
            }
        }
    };
    functions.visit(&pixels, work, take, progress)?;
    Ok(pictures)
}

/// Relative L2 errors `[approximation][count]`, in the order of [`Approximation::ALL`], over the functions of some pixels
/// (6.4, 6.5). The best tree takes some tenths of a second a pixel at 256 x 64.
///
/// # Errors
/// As [`Functions::visit`].
pub fn approximations(
    functions: &Functions<'_>,
    codec: &Codec,
    counts: &[usize],
    pixels: &[u32],
    progress: &mut Progress<'_>,
) -> Result<Vec<Vec<Summary>>> {
    let mut sums = vec![vec![Sums::default(); counts.len()]; Approximation::ALL.len()];
    let work = |function: &[f32]| -> Vec<Vec<f64>> {
        let coefficients = codec.analyse(function);
        let errors = |how: &Approximation| {
            let sets: Vec<Vec<u32>> = counts.iter().map(|&terms| codec.choose(*how, &coefficients, terms)).collect();
            let sets: Vec<&[u32]> = sets.iter().map(Vec::as_slice).collect();
            codec.relative_errors(function, &coefficients, &sets)
        };
        Approximation::ALL.iter().map(errors).collect()
    };
    let take = |_: usize, errors: Vec<Vec<f64>>| {
        sums.iter_mut().flatten().zip(errors.iter().flatten()).for_each(|(sums, error)| sums.add(*error));
    };
    functions.visit(pixels, work, take, progress)?;
    Ok(sums.iter().map(|counts| counts.iter().map(Sums::summary).collect()).collect())
}
