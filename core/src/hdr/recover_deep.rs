//! The response of a camera whose codes are deeper than 8 bits, with a dark level.
//!
//! As in `recover` (Debevec and Malik 1997, eq. 3), pixel i of photograph j obeys `g(Z_ij) = ln E_i + ln s_j`, solved for g
//! and all `ln E_i` in the sense of least squares. What deep codes and a known sensor let us do better:
//!
//! - **Light above the dark level.** The camera codes `z = f(E s + d)`, and codes `b = f(d)` where there is no light. So
//!   `G(z) = f^-1(z) - f^-1(b) = E s` is a response of its own, exactly, and `g = ln G`, defined above b.
//! - **Mean light of patches** instead of light of pixels: `ln mean_k G(Z_ijk) = ln E_i + ln s_j` over the pixels k of a
//!   patch, whatever its texture. `G(Z)` is light plus the sensor's noise, so its mean is unbiased where a logarithm of one
//!   pixel is not. It is solved by Gauss and Newton: the derivative by `g(Z_ijk)` is the pixel's share of the light.
//! - **Codes between knots**: g is interpolated between 256 knots, linearly over `u = ln(z - b)`, in which every power of
//!   z - b is a straight line.
//! - **Weights** are the inverse variance of `ln E s` by the noise of the sensor ([`Noise`](super::Noise)), not a hat.
//! - **Smoothness** is a prior on the curvature of g over u, `d^2 g / du^2`: normal, deviation
//!   [`CURVATURE`] where curves are near a power law, growing towards white, where shoulders bend. (A cubic smoothing
//!   spline: G. Wahba, "Spline Models for Observational Data", 1990, section 1.3.)
//!
//! Weights and shares depend on g, so the solution is repeated from a power of 2.2 until it stands. What a patch must have
//! shown is judged by its `ln E` of the last round, in which its bright photographs weigh most, never by its own noisy code:
//! else of dim patches only those would count that noise made bright.
//!
//! What no prior mends: if all exposures are whole steps of one ratio r apart, g plus any ripple of period ln r obeys the
//! equations as well, each `ln E_i` taking its share. Of the virtual stage's still life (19 200 pixels, 12 bits, 30 000
//! electrons) nine steps that alternate between 2/3 and 1 stop leave a response within 0.5 % of the truth between 5 and 95 % of
//! the codes, nine equal steps of one stop 1.7 %: so [`doubt`] says it, and `series::for_response` takes uneven ones.

use nalgebra::{DMatrix, DVector};

use super::merge::Shot;
use super::noise::Noise;
use super::patches::{Codes, PIXELS, Patch, highest, mean};
use super::recover::{Recovered, RecoveryReport, check_exposures, check_residual, isotonic, undetermined};
use super::response::{ANCHOR, CODES, Response};
use crate::error::{Error, Result};

/// Deviation of the curvature of `ln light` over `ln code`, per square root of a unit of ln code. Simulated (600 patches, two
/// film curves, sRGB and linear): from 0.07 to 0.15 little changes; with 0.3 ripples grow by half, with 1 twofold.
const CURVATURE: f64 = 0.1;
/// Towards white the deviation grows by `1 + GROWTH z / (END - z)`, 70-fold at white: film curves bend that much more there.
const GROWTH: f64 = 2.0;
const END: f64 = 1.03;
/// Means are compared where one pixel has this signal to noise: the mean of nine then has 9, and its logarithm is too low by
/// 0.6 %, which is corrected as far as the sensor is known.
const LEAST_SNR: f64 = 3.0;
/// Noise takes a mean below the first knot where it lies within so many of its deviations: those that it leaves above
/// would all be too bright.
const CLEAR_SIGMAS: f64 = 3.0;
/// What is not noise: lamps and shutters that flicker, relative deviation. Keeps bright patches from ruling alone.
const FLICKER: f64 = 2e-3;
/// Rounds: the eighth changes nothing by more than 1e-4.
const ROUNDS: usize = 8;
/// At the dark level light is in proportion to the code above it, `dg/du = 1`, as of any smooth curve: over the first knots
/// the slope is that, to this deviation (1.04 one code above a dark level of 0.6 % under a gamma of 2.2). Without, what is
/// too dim for data is off by 20 %.
const TOE: f64 = 0.05;
/// A dark level of fewer codes of 8 bits than this is the foot of the curve itself, where slopes are any.
const LEAST_BLACK: f64 = 0.5;
/// Knots this near above the dark level, in codes of 8 bits, are left out: their logarithm runs away.
const LEAST_ABOVE: f64 = 0.25;
/// Fewer patches than this, seen well at two exposures, do not determine a curve.
const FEWEST_PATCHES: usize = 30;
/// They must span half of the codes above the dark level.
const LEAST_SPAN: f64 = 0.5;
/// What is known of a bracket and its camera.
#[derive(Debug, Clone)]
pub struct Known<'a> {
    /// The photographs, in the order of the patches' means.
    pub shots: &'a [Shot],
    /// Codes of each channel from here on are clipped.
    pub clip: [f32; 3],
    /// Code of no light, as [`Options::black`](super::Options::black).
    pub black: [f32; 3],
    /// The sensor.
    pub noise: Noise,
}

/// Recovers the response from patches of a bracket of deep codes. It is that of light above the dark level: [`Decoder`
/// ](super::Decoder) with the same black gives light in proportion; below the dark level the curve is continued as a
/// straight line.
///
/// # Errors
/// [`Error::Invalid`] when the exposures are equal, or too few patches are seen well at two of them.
pub fn recover_deep(samples: &[Patch], known: &Known) -> Result<Recovered> {
    let exposures: Vec<f64> = known.shots.iter().map(|s| s.exposure).collect();
    check_exposures(&exposures)?;
    let mut light = [[0.0; CODES]; 3];
    let mut report = RecoveryReport {
        samples: samples.len(),
        lambda: CURVATURE,
        codes: [[0; 2]; 3],
        codes_made_monotone: [0; 3],
        residual_ev: [0.0; 3],
        doubts: doubt(&exposures).into_iter().collect(),
    };
    for (c, name) in ["red", "green", "blue"].into_iter().enumerate() {
        let knots = Knots::new(f64::from(known.black[c]));
        let patches = seen(samples, c, known, &knots);
        report.codes[c] = check_coverage(&patches, knots.black, name)?;
        let fit = Fit { knots: &knots, noise: known.noise };
        let (g, certainty, residual) = fit.solve(&patches)?;
        let (rising, raised) = isotonic(&g, &certainty);
        report.codes_made_monotone[c] = raised;
        report.residual_ev[c] = check_residual(residual / std::f64::consts::LN_2, name)?;
        light[c] = knots.table(&rising);
    }
    Ok(Recovered { response: Response::new("recovered response", light)?, report })
}

/// Steps from here on, in stops, leave a ripple that smoothness does not remove, ...
const COARSE_STOPS: f64 = 0.9;
/// ... when all are whole multiples of one, to within this many stops: an eighth of a third.
const EVEN_STOPS: f64 = 0.04;

/// A sentence where the exposures are whole multiples of one coarse step apart.
pub(super) fn doubt(exposures: &[f64]) -> Option<String> {
    let mut stops: Vec<f64> = exposures.iter().map(|s| s.log2()).collect();
    stops.sort_by(f64::total_cmp);
    let steps: Vec<f64> = stops.windows(2).map(|w| w[1] - w[0]).filter(|d| *d > EVEN_STOPS).collect();
    let least = steps.iter().copied().fold(f64::INFINITY, f64::min);
    let even = steps.iter().all(|d| (d - (d / least).round() * least).abs() <= EVEN_STOPS);
    (even && least.is_finite() && least >= COARSE_STOPS).then(|| {
        format!(
            "all exposures are {least:.1} stops apart or a multiple of it: a ripple with that period is not seen in them, and \
             the response may be wrong by a percent or more; steps that alternate between 2/3 and 1 stop tell it"
        )
    })
}

/// A patch in one photograph.
#[derive(Debug, Clone)]
struct Seen {
    ln_s: f64,
    iso: f64,
    /// Mean code above the dark level.
    above: f64,
    pixels: [Place; PIXELS],
}

/// Where the code of a pixel lies: between two knots, the lower one and the share of the upper; or below the first, and how
/// far above the dark level in units of that knot.
#[derive(Debug, Clone, Copy)]
enum Place {
    Between(usize, f64),
    Below(f64),
}

/// The photographs in which a patch is not clipped and its mean lies above the first knot.
///
/// Cameras mix channels before they write codes (white balance, colour matrix), so one that is clipped bends the others: where
/// any channel is clipped only codes of c count that lie above all those seen whole, since a continued curve would be the
/// worse guess there.
fn seen(samples: &[Patch], c: usize, known: &Known, knots: &Knots) -> Vec<Vec<Seen>> {
    let unclipped = |codes: &Codes, c: usize| highest(&codes[c]) < known.clip[c].min(1.0);
    let whole = |codes: &Codes| (0..3).all(|c| unclipped(codes, c));
    let limit = samples.iter().flatten().filter(|p| whole(p)).map(|p| mean(&p[c])).fold(0.0, f32::max);
    let one = |(codes, shot): (&Codes, &Shot)| {
        let mean = mean(&codes[c]);
        let above = f64::from(mean) - knots.black;
        let counts = above > knots.above(knots.first) && unclipped(codes, c) && (whole(codes) || mean > limit);
        let pixels = codes[c].map(|code| knots.place(f64::from(code) - knots.black));
        counts.then_some(Seen { ln_s: shot.exposure.ln(), iso: shot.iso, above, pixels })
    };
    samples.iter().map(|patch| patch.iter().zip(known.shots).filter_map(one).collect()).collect()
}

fn check_coverage(patches: &[Vec<Seen>], black: f64, channel: &str) -> Result<[u8; 2]> {
    let twice = || patches.iter().filter(|p| p.len() > 1);
    let (low, high) = twice().flatten().fold((1.0f64, 0f64), |(l, h), s| (l.min(s.above), h.max(s.above)));
    let code = |above: f64| ((above + black) * 255.0).round() as u8;
    let count = twice().count();
    if count >= FEWEST_PATCHES && high - low >= LEAST_SPAN * (1.0 - black) {
        return Ok([code(low), code(high)]);
    }
    Err(Error::invalid(
        format!("the photographs, {channel}"),
        format!("{count} patches seen well at two exposures, over {:.0} % of the codes", 100.0 * (high - low).max(0.0)),
        format!(
            "at least {FEWEST_PATCHES} over half of the codes above the dark level to recover a response; photograph more \
             exposures, or give a response file"
        ),
    ))
}

/// Knots of g: the 8-bit codes above the dark level.
#[derive(Debug)]
struct Knots {
    black: f64,
    /// The first code.
    first: usize,
    /// ln(z - b), white = 1.
    u: Vec<f64>,
}

impl Knots {
    fn new(black: f64) -> Self {
        let last = (CODES - 1) as f64;
        let first = ((black * last + LEAST_ABOVE).ceil() as usize).max(1);
        let u = (first..CODES).map(|k| (k as f64 / last - black).ln()).collect();
        Self { black, first, u }
    }

    /// A code of 8 bits above the dark level, white = 1.
    fn above(&self, code: usize) -> f64 {
        code as f64 / (CODES - 1) as f64 - self.black
    }

    fn place(&self, above: f64) -> Place {
        let first = self.above(self.first);
        if above < first {
            return Place::Below(above / first);
        }
        let u = above.ln();
        let knot = self.u.partition_point(|v| *v <= u).saturating_sub(1).min(self.u.len() - 2);
        Place::Between(knot, ((u - self.u[knot]) / (self.u[knot + 1] - self.u[knot])).clamp(0.0, 1.0))
    }

    /// Deviation of the curvature at a knot.
    fn curvature(&self, i: usize) -> f64 {
        let z = self.u[i].exp() / (1.0 - self.black);
        CURVATURE * (1.0 + GROWTH * z / (END - z))
    }

    /// Adds the prior: `sum (g'' / deviation)^2 du`, second differences over uneven knots.
    fn smooth(&self, a: &mut DMatrix<f64>) {
        for i in 1..self.u.len() - 1 {
            let (before, after) = (self.u[i] - self.u[i - 1], self.u[i + 1] - self.u[i]);
            let du = 0.5 * (before + after);
            let w = du / self.curvature(i).powi(2);
            let row = [
                (i - 1, 1.0 / (before * du)),
                (i, -1.0 / (before * du) - 1.0 / (after * du)),
                (i + 1, 1.0 / (after * du)),
            ];
            row.iter().for_each(|(i, p)| row.iter().for_each(|(j, q)| a[(*i, *j)] += w * p * q));
        }
    }

    /// Adds the prior of the toe: `((g_1 - g_0) / (u_1 - u_0) - 1)^2 / deviation^2`.
    fn toe(&self, a: &mut DMatrix<f64>, b: &mut DVector<f64>) {
        if self.black * ((CODES - 1) as f64) < LEAST_BLACK {
            return;
        }
        let du = self.u[1] - self.u[0];
        let w = (du * TOE).powi(-2);
        [(0, 0, 1.0), (1, 1, 1.0), (0, 1, -1.0), (1, 0, -1.0)].iter().for_each(|(i, j, sign)| a[(*i, *j)] += w * sign);
        b[1] += w * du;
        b[0] -= w * du;
    }

    /// Light of all 256 codes. Below the first knot a straight line through no light at the dark level; all is raised so
    /// that code 0 is 0, which the subtraction of the dark level takes off again.
    fn table(&self, g: &[f64]) -> [f64; CODES] {
        let anchor = g[ANCHOR.saturating_sub(self.first)];
        let light = |i: usize| (g[i] - anchor).exp();
        let rise = light(0) / self.above(self.first);
        let raise = rise * self.black;
        let of = |z: usize| if z < self.first { rise * self.above(z) } else { light(z - self.first) };
        std::array::from_fn(|z| if z == 0 { 0.0 } else { of(z) + raise })
    }
}

struct Fit<'a> {
    knots: &'a Knots,
    noise: Noise,
}

/// The light of a patch in a photograph by some g: its logarithm, and the derivative of that by g at the knots.
struct Light {
    ln: f64,
    row: Vec<(usize, f64)>,
}

impl Light {
    /// `None` where noise leaves none.
    fn new(seen: &Seen, g: &[f64]) -> Option<Self> {
        let mut row: Vec<(usize, f64)> = Vec::with_capacity(4);
        let mut add = |knot: usize, share: f64| match row.iter_mut().find(|(k, _)| *k == knot) {
            Some((_, sum)) => *sum += share,
            None => row.push((knot, share)),
        };
        let mut sum = 0.0;
        for place in &seen.pixels {
            sum += match place {
                Place::Between(knot, share) => {
                    let light = (g[*knot] + share * (g[knot + 1] - g[*knot])).exp();
                    add(*knot, light * (1.0 - share));
                    add(knot + 1, light * share);
                    light
                }
                Place::Below(part) => {
                    let light = g[0].exp() * part;
                    add(0, light);
                    light
                }
            };
        }
        row.iter_mut().for_each(|(_, share)| *share /= sum);
        (sum > 0.0).then(|| Self { ln: (sum / PIXELS as f64).ln(), row })
    }
}

/// One equation, linear about the last g: `row . g - ln E = right`, and its weight. `left` is what the last g makes of
/// `ln light - ln s`.
struct Equation {
    weight: f64,
    right: f64,
    left: f64,
    row: Vec<(usize, f64)>,
}

impl Fit<'_> {
    /// g at the knots, the weight of the data behind each, and the root mean square of what the equations leave.
    fn solve(&self, patches: &[Vec<Seen>]) -> Result<(Vec<f64>, Vec<f64>, f64)> {
        let u = &self.knots.u;
        let n = u.len();
        let mut g: Vec<f64> = u.iter().map(|u| 2.2 * (u - u_last(self.knots))).collect();
        let (mut certainty, mut residual) = (vec![1e-6; n], 0.0);
        let mut ln_e = vec![None; patches.len()];
        for _ in 0..ROUNDS {
            let (mut a, mut b) = (DMatrix::<f64>::zeros(n, n), DVector::<f64>::zeros(n));
            certainty.fill(1e-6);
            let (mut left, mut total) = (0.0, 0.0);
            for (patch, ln_e) in patches.iter().zip(&mut ln_e) {
                let equations: Vec<Equation> = patch.iter().filter_map(|s| self.equation(s, &g, *ln_e)).collect();
                if equations.len() > 1 {
                    let mean = add(&equations, &mut a, &mut b, &mut certainty);
                    left += equations.iter().map(|e| e.weight * (e.left - mean).powi(2)).sum::<f64>();
                    total += equations.iter().map(|e| e.weight).sum::<f64>();
                    *ln_e = Some(mean);
                }
            }
            residual = (left / f64::max(total, 1e-300)).sqrt();
            self.knots.smooth(&mut a);
            self.knots.toe(&mut a, &mut b);
            // The scale is free: g(white) = 0, as strong as the data so that the matrix stays well scaled.
            a[(n - 1, n - 1)] += certainty.iter().copied().fold(1.0, f64::max);
            let solution = a.cholesky().ok_or_else(undetermined)?.solve(&b);
            g.iter_mut().zip(solution.iter()).for_each(|(g, s)| *g = s - solution[n - 1]);
            if g.iter().any(|v| !v.is_finite()) {
                return Err(undetermined());
            }
        }
        Ok((g, certainty, residual))
    }

    /// The equation of a patch in a photograph by the g and, once known, the `ln E` of the last round; `None` where it is
    /// mostly noise.
    fn equation(&self, seen: &Seen, g: &[f64], ln_e: Option<f64>) -> Option<Equation> {
        let Light { ln, row } = Light::new(seen, g)?;
        let x = ln_e.map_or(ln, |ln_e| ln_e + seen.ln_s).exp();
        let pixel = self.noise.variance(x, seen.iso) / (x * x);
        let variance = pixel / PIXELS as f64;
        let clear = x * (1.0 - CLEAR_SIGMAS * variance.sqrt()) > g[0].exp();
        if pixel > LEAST_SNR.powi(-2) || !clear {
            return None;
        }
        let by_row: f64 = row.iter().map(|(k, v)| v * g[*k]).sum();
        // The mean of a logarithm lies below the logarithm of the mean by half the variance.
        let ln = ln + 0.5 * variance;
        let weight = 1.0 / (variance + FLICKER * FLICKER);
        Some(Equation { weight, right: seen.ln_s - ln + by_row, left: ln - seen.ln_s, row })
    }
}

/// Adds a patch to the normal equations with its `ln E` eliminated: it is the weighted mean of `row . g - right`, by the last
/// g that of `left`, which is given.
fn add(equations: &[Equation], a: &mut DMatrix<f64>, b: &mut DVector<f64>, certainty: &mut [f64]) -> f64 {
    let sum: f64 = equations.iter().map(|e| e.weight).sum();
    let mean = |f: fn(&Equation) -> f64| equations.iter().map(|e| e.weight * f(e)).sum::<f64>() / sum;
    let right = mean(|e| e.right);
    // The row of the mean: knots and their weights.
    let mut all: Vec<(usize, f64)> =
        equations.iter().flat_map(|e| e.row.iter().map(|(k, v)| (*k, v * e.weight))).collect();
    all.sort_by_key(|(k, _)| *k);
    all.dedup_by(|next, kept| {
        let same = next.0 == kept.0;
        kept.1 += if same { next.1 } else { 0.0 };
        same
    });
    for Equation { weight, right: own, row, .. } in equations {
        for (k, v) in row {
            certainty[*k] += v.abs() * weight;
            b[*k] += v * weight * (own - right);
            row.iter().for_each(|(j, w)| a[(*k, *j)] += weight * v * w);
        }
    }
    all.iter().for_each(|(k, v)| all.iter().for_each(|(j, w)| a[(*k, *j)] -= v * w / sum));
    mean(|e| e.left)
}

fn u_last(knots: &Knots) -> f64 {
    knots.u[knots.u.len() - 1]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hdr::testing::{self, NOISE, Sensor};
    use crate::hdr::{Curve, Decoder, Patches, Survey};
    use crate::image::{Image, SampleType};

    /// Columns of light over twelve stops, in rows of three colours, brighter downwards by a few percent.
    fn scene() -> Image {
        let (w, h) = (240, 160);
        Image::from_fn(w, h, |x, y| {
            let light = 4.0 * 2f32.powf(-12.0 * x as f32 / w as f32) * (1.0 + 0.3 * y as f32 / h as f32);
            [[1.0, 0.8, 0.6], [0.7, 1.0, 0.8], [0.5, 0.7, 1.0]][y * 3 / h].map(|tint| tint * light)
        })
    }

    fn stops(steps: &[f64]) -> Vec<f64> {
        let mut at = -3.0;
        let next = steps.iter().map(|step| {
            at += step;
            2f64.powf(at)
        });
        std::iter::once(0.125).chain(next).collect()
    }

    fn recovered(sensor: &Sensor, exposures: &[f64], black: [f32; 3]) -> Result<Recovered> {
        let (mut patches, mut survey) = (Patches::new(240, 160), Survey::new(240, 160, SampleType::U16));
        for (n, s) in exposures.iter().enumerate() {
            let codes = sensor.photograph(&scene(), *s, n as u64);
            patches.add(&codes, [0, 0]);
            survey.add(&codes, [0, 0]);
        }
        let shots: Vec<Shot> = exposures.iter().map(|s| Shot { exposure: *s, iso: 100.0, offset: [0, 0] }).collect();
        let clip = survey.clip().map(|c| c.unwrap());
        recover_deep(&patches.samples(), &Known { shots: &shots, clip, black, noise: NOISE })
    }

    /// Largest relative error of light between two shares of the codes above the dark level, its root mean square, and the
    /// largest error anywhere in shares of white; the scale is that of code 128.
    fn errors(found: &Recovered, sensor: &Sensor, black: [f32; 3], [low, high]: [f64; 2]) -> (f64, f64, f64) {
        let decoder = Decoder::new(&Curve::Response(found.response.clone()), SampleType::U16, black).unwrap();
        let b = sensor.code(sensor.dark);
        let (mut worst, mut squares, mut count, mut of_white) = (0.0f64, 0.0, 0.0, 0.0f64);
        for c in 0..3 {
            let truth = |code: f64| sensor.light(code) - sensor.dark;
            let ratio = |code: f64| f64::from(decoder.value(c, code as f32)) / truth(code);
            let scale = ratio(128.0 / 255.0);
            for k in 1..=1000 {
                let share = f64::from(k) / 1000.0;
                let code = b + share * (1.0 - b);
                let error = ratio(code) / scale - 1.0;
                of_white = of_white.max((error * truth(code) / truth(1.0)).abs());
                if (low..=high).contains(&share) {
                    worst = worst.max(error.abs());
                    squares += error * error;
                    count += 1.0;
                }
            }
        }
        (worst, f64::sqrt(squares / count), of_white)
    }

    const ALTERNATING: [f64; 8] = [2.0 / 3.0, 1.0, 2.0 / 3.0, 1.0, 2.0 / 3.0, 1.0, 2.0 / 3.0, 1.0];

    #[test]
    fn nine_exposures_of_one_scene_give_the_response_to_a_hundredth() {
        for sensor in [testing::FILM, testing::LINEAR, Sensor { dark: 1.0 / 64.0, ..testing::FILM }] {
            let black = [sensor.code(sensor.dark) as f32; 3];
            let found = recovered(&sensor, &stops(&ALTERNATING), black).unwrap();
            let (worst, rms, of_white) = errors(&found, &sensor, black, [0.05, 0.95]);
            let text = format!(
                "film {}, dark {:.4}: {worst:.4}, rms {rms:.4}, {of_white:.4} of white",
                sensor.film, sensor.dark
            );
            assert!(worst < 0.01 && rms < 0.003, "{text}");
            // White itself lies beyond the last code that is surely not clipped: the curve is continued there.
            assert!(of_white < 0.02, "{text}");
            assert!(found.report.doubts.is_empty() && found.report.residual_ev.iter().all(|r| *r < 0.02), "{found:?}");
        }
    }

    #[test]
    fn whole_steps_are_doubted() {
        let even = recovered(&testing::FILM, &stops(&[2.0; 5]), [testing::FILM.code(testing::DARK) as f32; 3]).unwrap();
        assert!(even.report.doubts[0].contains("2.0 stops apart"), "{:?}", even.report.doubts);
        assert!(doubt(&stops(&[1.0, 2.0, 1.0])).is_some() && doubt(&stops(&[0.5; 6])).is_none());
        assert!(doubt(&stops(&ALTERNATING)).is_none() && doubt(&stops(&[2.0, 5.0 / 3.0, 2.0])).is_none());
    }

    #[test]
    fn what_cannot_be_recovered_is_refused() {
        let black = [testing::DARK as f32; 3];
        let equal = recovered(&testing::LINEAR, &[1.0, 1.0], black).unwrap_err().to_string();
        assert!(equal.contains("all equal"), "{equal}");
        let shots = [0.5, 1.0].map(|exposure| Shot { exposure, iso: 100.0, offset: [0, 0] });
        let known = Known { shots: &shots, clip: [1.0; 3], black, noise: NOISE };
        let mut dim = Patches::new(60, 40);
        (0..2).for_each(|_| dim.add(&Image::new(60, 40, 3), [0, 0]));
        let message = recover_deep(&dim.samples(), &known).unwrap_err().to_string();
        assert!(message.contains("0 patches") && message.contains("red"), "{message}");
    }
}
