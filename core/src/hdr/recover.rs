//! The response of a camera from photographs of one scene at several exposures.
//!
//! P. Debevec and J. Malik, "Recovering High Dynamic Range Radiance Maps from Photographs", SIGGRAPH 1997, section 2.1:
//! with `g(z) = ln f^-1(z)` the log light of code z, pixel i of photograph j obeys `g(Z_ij) = ln E_i + ln t_j`, solved for g
//! and all `ln E_i` in the sense of least squares with a smooth g (eq. 3):
//!
//! `O = sum_ij (w(Z_ij) [g(Z_ij) - ln E_i - ln t_j])^2 + lambda^2 sum_z (w(z) g''(z))^2`
//!
//! Each `ln E_i` occurs in the equations of its own pixel only, so it is eliminated first (it is the weighted mean of
//! `g(Z_ij) - ln t_j`); what remains are 256 normal equations whatever the number of samples.

use nalgebra::{DMatrix, DVector};
use serde::Serialize;

use super::response::{ANCHOR, CODES, Response};
use super::survey::Sample;
use crate::error::{Error, Result};

/// Smoothness that suits 8-bit photographs; larger is smoother. Defined for fifty samples, the number of Debevec and Malik's
/// example, and scaled to the actual number, so that its meaning does not change with it.
///
/// When all exposures are whole stops apart, as cameras bracket, a ripple of g with a period of one stop (some 50 codes)
/// leaves the data term alone; smoothness has to remove it. On real photographs a stop apart 20 leaves a ripple of 15 % in
/// the slope, 60 none, and the residual grows by 2 %; from 400 on the toe is cut off and the residual grows by 20 %.
pub const LAMBDA: f64 = 60.0;
const LAMBDA_SAMPLES: f64 = 50.0;
/// Exposures closer than this ratio (a quarter of a stop) tell rounding, not the curve.
const LEAST_RATIO: f64 = 1.19;
/// Fewer pixels than this, seen well at two exposures, do not determine a curve.
const FEWEST_SAMPLES: usize = 30;
/// They must span half the codes; smoothness is no substitute for data.
const LEAST_SPAN: u8 = 128;
/// Photographs that stray further than this from any curve, rms in stops, are not of one scene at these exposures; real ones
/// stray by 0.06.
const MOST_RESIDUAL_EV: f64 = 0.3;
/// Least rise of `ln light` from code to code: a tenth of the smallest of sRGB (2.2 / 255 at white). What is flatter than this
/// is no curve of a camera but noise, and light of two codes must differ.
const LEAST_RISE: f64 = 0.1 * 2.2 / 255.0;

/// A recovered response and how it came about.
#[derive(Debug, Clone)]
pub struct Recovered {
    /// The response.
    pub response: Response,
    /// Its story.
    pub report: RecoveryReport,
}

/// What a person wants to know about a recovered response.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RecoveryReport {
    /// Pixels used.
    pub samples: usize,
    /// Smoothness; of deep codes the deviation of the prior.
    pub lambda: f64,
    /// Lowest and highest code that the samples of each channel saw; beyond, the curve is continued.
    pub codes: [[u8; 2]; 3],
    /// Codes of each channel that least squares left falling or flat, raised by isotonic regression.
    pub codes_made_monotone: [usize; 3],
    /// Root mean square of `g - ln E - ln t` over the samples of each channel, in stops.
    pub residual_ev: [f64; 3],
    /// What a person should know, a sentence each.
    pub doubts: Vec<String>,
}

/// Recovers the response. `samples` hold a code for each photograph in the order of `exposures` (any unit); codes of
/// channel c from `clip[c]` (0..1) on are not looked at.
///
/// The solution is made strictly increasing by isotonic regression, weighted by how well each code is determined: least
/// squares alone does not promise it where samples are few and noisy.
///
/// # Errors
/// [`Error::Invalid`] when the exposures are equal, or too few pixels are seen well at two of them.
pub fn recover(samples: &[Sample], exposures: &[f64], clip: [f32; 3], lambda: f64) -> Result<Recovered> {
    check_exposures(exposures)?;
    let ln_t: Vec<f64> = exposures.iter().map(|t| t.ln()).collect();
    // The last code of each channel that is surely not clipped.
    let limits = clip.map(|level| ((level * 255.0).ceil() as i32 - 1).clamp(2, 255) as u8);
    let mut light = [[0.0; CODES]; 3];
    let mut report = RecoveryReport {
        samples: samples.len(),
        lambda,
        codes: [[0; 2]; 3],
        codes_made_monotone: [0; 3],
        residual_ev: [0.0; 3],
        doubts: Vec::new(),
    };
    for (c, name) in ["red", "green", "blue"].into_iter().enumerate() {
        let highest = limits[c];
        let pixels: Vec<Vec<(u8, f64)>> = samples.iter().map(|s| seen(s, c, &ln_t, limits)).collect();
        let pixels: Vec<Vec<(u8, f64)>> = pixels.into_iter().filter(|p| p.len() > 1).collect();
        report.codes[c] = check_coverage(&pixels, name)?;
        let hat = Hat { highest };
        let (g, certainty) = solve(&pixels, hat, lambda)?;
        let (rising, raised) = isotonic(&g, &certainty);
        report.codes_made_monotone[c] = raised;
        report.residual_ev[c] = check_residual(residual(&pixels, hat, &rising) / std::f64::consts::LN_2, name)?;
        light[c] = std::array::from_fn(|z| (rising[z] - rising[ANCHOR]).exp());
    }
    Ok(Recovered { response: Response::new("recovered response", light)?, report })
}

pub(super) fn check_exposures(exposures: &[f64]) -> Result<()> {
    let (low, high) = exposures.iter().fold((f64::INFINITY, 0f64), |(l, h), t| (l.min(*t), h.max(*t)));
    if high / low >= LEAST_RATIO {
        return Ok(());
    }
    Err(Error::invalid(
        "the photographs",
        "exposures that are all equal",
        "different ones, to recover a response from; give a response file or the encoding instead",
    ))
}

/// Codes of channel `c` that are not black, in photographs where no channel is clipped, with the log exposures they were
/// seen at. Cameras mix channels (white balance, colour matrix) before they write codes, so one that is clipped bends the
/// others.
fn seen(sample: &Sample, c: usize, ln_t: &[f64], limits: [u8; 3]) -> Vec<(u8, f64)> {
    let whole = |z: &[u8; 3]| z[c] > 0 && (0..3).all(|c| z[c] <= limits[c]);
    sample.iter().zip(ln_t).filter(|(z, _)| whole(z)).map(|(z, t)| (z[c], *t)).collect()
}

fn check_coverage(pixels: &[Vec<(u8, f64)>], channel: &str) -> Result<[u8; 2]> {
    let codes = || pixels.iter().flatten().map(|(z, _)| *z);
    let (low, high) = (codes().min().unwrap_or(0), codes().max().unwrap_or(0));
    if pixels.len() >= FEWEST_SAMPLES && high - low >= LEAST_SPAN {
        return Ok([low, high]);
    }
    Err(Error::invalid(
        format!("the photographs, {channel}"),
        format!("{} pixels seen well at two exposures, codes {low} to {high}", pixels.len()),
        format!(
            "at least {FEWEST_SAMPLES} over {LEAST_SPAN} codes to recover a response; photograph more exposures, or give a \
             response file"
        ),
    ))
}

pub(super) fn check_residual(ev: f64, channel: &str) -> Result<f64> {
    if ev <= MOST_RESIDUAL_EV {
        return Ok(ev);
    }
    Err(Error::invalid(
        format!("the photographs, {channel}"),
        format!("codes that stray by {ev:.2} stops from any response"),
        "one unmoving scene, and the right exposure times, to recover a response from",
    ))
}

/// The weights of eq. 4: codes in the middle are known best.
#[derive(Clone, Copy)]
struct Hat {
    highest: u8,
}

impl Hat {
    fn weight(self, z: usize) -> f64 {
        let (z, highest) = (z as f64, f64::from(self.highest) + 1.0);
        z.min(highest - z).max(0.0)
    }

    /// Weight of smoothness, at least 1: beyond the last seen code the curve is continued, not left open.
    fn smoothness(self, z: usize) -> f64 {
        self.weight(z).max(1.0)
    }
}

/// Solves eq. 3 with `ln E_i` eliminated. Gives g, with g(128) = 0, and for each code the weight of the data behind it.
fn solve(pixels: &[Vec<(u8, f64)>], hat: Hat, lambda: f64) -> Result<([f64; CODES], [f64; CODES])> {
    let mut a = DMatrix::<f64>::zeros(CODES, CODES);
    let mut b = DVector::<f64>::zeros(CODES);
    let mut certainty = [1e-6; CODES];
    for pixel in pixels {
        let weights: Vec<f64> = pixel.iter().map(|(z, _)| hat.weight(usize::from(*z)).powi(2)).collect();
        let sum: f64 = weights.iter().sum();
        let mean: f64 = pixel.iter().zip(&weights).map(|((_, t), w)| w * t).sum::<f64>() / sum;
        for ((z, t), w) in pixel.iter().zip(&weights) {
            let z = usize::from(*z);
            a[(z, z)] += w;
            b[z] += w * (t - mean);
            certainty[z] += w;
            pixel.iter().zip(&weights).for_each(|((other, _), v)| a[(z, usize::from(*other))] -= w * v / sum);
        }
    }
    let lambda2 = lambda * lambda * (pixels.len() as f64 / LAMBDA_SAMPLES);
    for z in 1..CODES - 1 {
        let w = lambda2 * hat.smoothness(z).powi(2);
        let row = [(z - 1, 1.0), (z, -2.0), (z + 1, 1.0)];
        row.iter().for_each(|(i, p)| row.iter().for_each(|(j, q)| a[(*i, *j)] += w * p * q));
    }
    // The scale: g(128) = 0, weighted as the data so that the matrix stays well scaled.
    a[(ANCHOR, ANCHOR)] += certainty.iter().copied().fold(1.0, f64::max);
    let g = a.cholesky().ok_or_else(undetermined)?.solve(&b);
    let anchor = g[ANCHOR];
    Ok((std::array::from_fn(|z| g[z] - anchor), certainty))
}

pub(super) fn undetermined() -> Error {
    Error::invalid("the photographs", "a response they do not determine", "more exposures")
}

/// The nearest curve, in the weighted sense, that rises by [`LEAST_RISE`] at least: pool adjacent violators (R. Barlow et
/// al., "Statistical Inference under Order Restrictions", 1972) on g less that rise. Also says how many codes changed.
pub(super) fn isotonic(g: &[f64], certainty: &[f64]) -> (Vec<f64>, usize) {
    // Blocks of mean, weight, count.
    let mut blocks: Vec<(f64, f64, usize)> = Vec::with_capacity(g.len());
    for z in 0..g.len() {
        let mut block = (g[z] - LEAST_RISE * z as f64, certainty[z], 1);
        while let Some(last) = blocks.pop_if(|last| last.0 > block.0) {
            let weight = last.1 + block.1;
            block = ((last.0 * last.1 + block.0 * block.1) / weight, weight, last.2 + block.2);
        }
        blocks.push(block);
    }
    let raised = blocks.iter().filter(|b| b.2 > 1).map(|b| b.2).sum();
    let means = blocks.iter().flat_map(|b| std::iter::repeat_n(b.0, b.2));
    (means.enumerate().map(|(z, mean)| mean + LEAST_RISE * z as f64).collect(), raised)
}

/// Root mean square of what the data term of eq. 3 leaves, in natural logarithms.
fn residual(pixels: &[Vec<(u8, f64)>], hat: Hat, g: &[f64]) -> f64 {
    let (mut sum, mut total) = (0.0, 0.0);
    for pixel in pixels {
        let terms = || pixel.iter().map(|(z, t)| (hat.weight(usize::from(*z)).powi(2), g[usize::from(*z)] - t));
        let weight: f64 = terms().map(|(w, _)| w).sum();
        let ln_e = terms().map(|(w, v)| w * v).sum::<f64>() / weight;
        sum += terms().map(|(w, v)| w * (v - ln_e).powi(2)).sum::<f64>();
        total += weight;
    }
    (sum / total).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Noiseless codes of a camera whose light is `x = f^-1(z / 255)`.
    fn samples(forward: impl Fn(f64) -> f64, exposures: &[f64]) -> Vec<Sample> {
        let code = |x: f64| (forward(x.min(1.0)) * 255.0).round() as u8;
        (0..400)
            .map(|i| 1e-4 * 10f64.powf(i as f64 / 80.0))
            .map(|e| exposures.iter().map(|t| [code(e * t); 3]).collect())
            .collect()
    }

    const STOPS: [f64; 7] = [0.125, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0];

    #[test]
    fn a_known_curve_is_found_from_its_codes() {
        // A plain gamma, and a curve with toe and shoulder.
        let shoulder = |x: f64| (1.0 - (-3.0 * x).exp()).powf(0.6) / (1.0 - (-3f64).exp()).powf(0.6);
        let inverse = |v: f64| -(1.0 - v.powf(1.0 / 0.6) * (1.0 - (-3f64).exp())).ln() / 3.0;
        type Pair<'a> = (&'a dyn Fn(f64) -> f64, &'a dyn Fn(f64) -> f64);
        let curves: [Pair; 2] = [(&|x| x.powf(1.0 / 2.2), &|v| v.powf(2.2)), (&shoulder, &inverse)];
        for (forward, inverse) in curves {
            let found = recover(&samples(forward, &STOPS), &STOPS, [1.0; 3], LAMBDA).unwrap();
            let table = found.response.channel(1);
            let ev =
                |z: usize| ((table[z] / table[ANCHOR]) / (inverse(z as f64 / 255.0) / inverse(128.0 / 255.0))).log2();
            let worst = (16..=245).map(|z| ev(z).abs()).fold(0.0, f64::max);
            // Smoothness bends the ends: 0.027 at code 16, 0.038 at code 245 of the shoulder.
            assert!(worst < 0.05, "{worst} EV");
            assert!(found.report.residual_ev[1] < 0.05, "{:?}", found.report);
        }
    }

    #[test]
    fn elimination_gives_what_the_full_system_gives() {
        let data = samples(|x| x.powf(0.45), &STOPS[..3]);
        let ln_t: Vec<f64> = STOPS[..3].iter().map(|t| t.ln()).collect();
        let hat = Hat { highest: 254 };
        let pixels: Vec<_> = data.iter().map(|s| seen(s, 0, &ln_t, [254; 3])).filter(|p| p.len() > 1).collect();
        let (g, _) = solve(&pixels, hat, 5.0).unwrap();
        // Debevec and Malik's own layout: 256 + n unknowns, one row an equation, by singular values.
        let (n, rows) = (pixels.len(), pixels.iter().map(Vec::len).sum::<usize>() + CODES - 1);
        let (mut a, mut b) = (DMatrix::<f64>::zeros(rows, CODES + n), DVector::<f64>::zeros(rows));
        let mut row = 0;
        for (i, pixel) in pixels.iter().enumerate() {
            for (z, t) in pixel {
                let w = hat.weight(usize::from(*z));
                (a[(row, usize::from(*z))], a[(row, CODES + i)], b[row]) = (w, -w, w * t);
                row += 1;
            }
        }
        for z in 1..CODES - 1 {
            let w = 5.0 * (n as f64 / LAMBDA_SAMPLES).sqrt() * hat.smoothness(z);
            (a[(row, z - 1)], a[(row, z)], a[(row, z + 1)]) = (w, -2.0 * w, w);
            row += 1;
        }
        a[(row, ANCHOR)] = 1.0;
        let full = (a.transpose() * &a).cholesky().unwrap().solve(&(a.transpose() * b));
        let worst = (0..CODES).map(|z| (full[z] - full[ANCHOR] - g[z]).abs()).fold(0.0, f64::max);
        assert!(worst < 1e-4, "{worst}");
    }

    #[test]
    fn isotonic_regression_rises_and_keeps_what_rises() {
        let rising: [f64; CODES] = std::array::from_fn(|z| z as f64 * 0.01);
        let kept = isotonic(&rising, &[1.0; CODES]);
        assert!(kept.1 == 0 && kept.0.iter().zip(&rising).all(|(a, b)| (a - b).abs() < 1e-12));
        let mut dented = rising;
        (dented[40], dented[41]) = (0.5, 0.3);
        let (out, raised) = isotonic(&dented, &[1.0; CODES]);
        assert!(out.windows(2).all(|w| w[1] > w[0]) && raised >= 2, "{raised}");
        assert_eq!(out[200], rising[200]);
        // The pool keeps the weighted mean: the well known code hardly moves.
        let mut weights = [1.0; CODES];
        weights[41] = 1e6;
        assert!((isotonic(&dented, &weights).0[41] - 0.3).abs() < 0.01);
    }

    #[test]
    fn what_cannot_be_recovered_is_refused() {
        let equal = recover(&samples(|x| x.sqrt(), &[1.0, 1.0]), &[1.0, 1.0], [1.0; 3], LAMBDA);
        assert!(equal.unwrap_err().to_string().contains("all equal"));
        let flat: Vec<Sample> = vec![vec![[100; 3], [140; 3]]; 500];
        let message = recover(&flat, &[1.0, 2.0], [1.0; 3], LAMBDA).unwrap_err().to_string();
        assert!(message.contains("codes 100 to 140") && message.contains("red"), "{message}");
        let black: Vec<Sample> = vec![vec![[0; 3], [0; 3]]; 500];
        assert!(recover(&black, &[1.0, 2.0], [1.0; 3], LAMBDA).unwrap_err().to_string().contains("0 pixels"));
    }
}
