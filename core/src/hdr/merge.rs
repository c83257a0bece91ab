//! A bracket merged to one picture of light.
//!
//! A photograph of relative exposure `s` sees light `E` as `x = E s`, with variance `var(x)` by the sensor's [`Noise`] and the
//! rounding to codes. Each photograph so estimates `E` as `x / s` with variance `var(x) / s^2`; the estimate of least
//! variance weights them by the inverse, `w = s^2 / var(x)` (S. Hasinoff, F. Durand and W. Freeman, "Noise-optimal capture for
//! high dynamic range photography", CVPR 2010, eq. 6 and 7).
//!
//! The variance depends on the light. Taken from each photograph's own noisy value it would favour values that came out
//! too low, so there are two passes, as M. Granados et al. iterate ("Optimal HDR reconstruction with linear digital
//! cameras", CVPR 2010, section 4): the second takes the variance from the estimate of the first.
//!
//! A weight is multiplied by a *trust* between 0 and 1, which drops values near clipping and near black:
//!
//! - Bright: noise that is cut off at the clipping level biases the mean. 4 standard deviations below the level nothing is
//!   cut (3e-5); trust falls smoothly to zero from there to the level. What judges is the larger of the value itself and
//!   what the shorter photographs predict for it, so that JPEG's ringing in a clipped area does not pass for light.
//! - Dark: values that come out below code 0 are cut there, which biases again. Trust rises from 1 to 3 standard deviations
//!   above that cut. Where a dark level above zero is subtracted ([`Options::black`]) the cut lies below no light, and as
//!   soon as it lies 3 standard deviations below, everything is trusted: negative values are kept, and the mean of
//!   what is dark is right. Trust stays above a floor so small that it matters only where no photograph is brighter, and
//!   that falls so fast with exposure (sixth power) that then the longest decides.
//!
//! Dropping costs little. Where the best photograph has the most trust (near black), the merge is never noisier than that
//! photograph alone: with weights `w_i = r_i w*_i`, `r_i <= r_b`, its variance `sum r_i^2 w*_i / (sum r_i w*_i)^2` is at
//! most `r_b / sum r_i w*_i <= 1 / w*_b`. Near clipping the best has less trust `a` than the next ones: for steps of two
//! stops the variance is `(a^2 + 1/3) / (a + 1/3)^2` of its own, which exceeds 1.21 (10 % of deviation) only for `a < 0.23`,
//! nearer to the level than 1.3 standard deviations, where one value in ten is clipped already.

use std::sync::Arc;

use rayon::prelude::*;

use super::curve::{Curve, Decoder};
use super::noise::Noise;
use super::report::{Report, Tally, Use};
use crate::error::{Error, Result};
use crate::image::{Image, SampleType};

/// Trust falls over so many standard deviations below the clipping level.
const BRIGHT_SIGMAS: f32 = 4.0;
/// Trust rises between these many standard deviations above black.
const DARK_SIGMAS: [f32; 2] = [1.0, 3.0];
/// Trust that black keeps in the longest photograph.
const FLOOR: f32 = 1e-6;
/// How it falls with exposure: the next shorter photograph, at a third of a stop, counts for a quarter, at a stop for 1/64.
const FLOOR_POWER: i32 = 6;

/// One photograph of a bracket, without its pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shot {
    /// Relative exposure `s`, such as `t * (ISO / 100) / N^2`; positive.
    pub exposure: f64,
    /// ISO speed, for the noise; 100 where it is not known.
    pub iso: f64,
    /// Pixel (x, y) of the result lies at (x, y) + `offset` in this photograph.
    pub offset: [i32; 2],
}

/// What is known of the camera, and the scale of the result.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// From codes to light.
    pub curve: Curve,
    /// How the photographs hold their samples.
    pub sample_type: SampleType,
    /// Samples of each channel from here on (white code = 1) are clipped; infinity where nothing is.
    pub clip: [f32; 3],
    /// The sensor.
    pub noise: Noise,
    /// The dark level: the code (white = 1) of no light, each channel, as [`calibrate`](crate::calibrate) finds it in black
    /// photographs; zeros where codes have none. Its light is subtracted (see [`Decoder`]).
    pub black: [f32; 3],
    /// The relative exposure at which the pixel value of the result equals the light of the photograph, white code = 1:
    /// with 1, `E = x / s`.
    pub reference: f64,
}

impl Options {
    /// Nothing clipped, no dark level, a sensor of the usual kind, and `E = x / s`.
    pub fn new(curve: Curve, sample_type: SampleType) -> Self {
        let (clip, noise, black) = ([f32::INFINITY; 3], Noise::default(), [0.0; 3]);
        Self { curve, sample_type, clip, noise, black, reference: 1.0 }
    }
}

/// A merged picture, RGB, linear, in the camera's colours.
#[derive(Debug, Clone)]
pub struct Merged {
    /// The picture.
    pub image: Image,
    /// What became of the photographs.
    pub report: Report,
}

/// Merges photographs that `load` gives by index, as codes (white = 1), RGB, all of one size; each is asked for twice, in
/// order of exposure, so that only one need be in memory. Beside it there are four numbers for each sample: 1.2 GB for 24
/// megapixels. An error of `load` (a damaged file, a request to stop) ends the merge.
///
/// Per channel, where every photograph is clipped the shortest gives the value; where all are dark the longest that is not
/// clipped. The report counts both.
///
/// # Errors
/// [`Error::Invalid`] for no photograph, an exposure that is not positive, or photographs of different sizes.
pub fn merge(shots: &[Shot], options: &Options, load: &mut dyn FnMut(usize) -> Result<Arc<Image>>) -> Result<Merged> {
    Merger::new(options.clone())?.merge(shots, load)
}

/// Merges many brackets of one camera: the tables from codes to light are made once.
#[derive(Debug, Clone)]
pub struct Merger {
    options: Options,
    decoder: Decoder,
}

impl Merger {
    /// Makes the tables.
    ///
    /// # Errors
    /// As [`Decoder::new`].
    pub fn new(options: Options) -> Result<Self> {
        let decoder = Decoder::new(&options.curve, options.sample_type, options.black)?;
        Ok(Self { options, decoder })
    }

    /// What it was made with.
    pub fn options(&self) -> &Options {
        &self.options
    }

    /// From codes to light.
    pub fn decoder(&self) -> &Decoder {
        &self.decoder
    }

    /// Light of the clipping level (where nothing clips, of the white code) above the dark level, in the channel that clips
    /// first.
    pub fn white(&self) -> f64 {
        let level = |c: usize| if self.options.clip[c].is_finite() { self.options.clip[c] } else { 1.0 };
        (0..3).map(|c| f64::from(self.decoder.value(c, level(c)))).fold(f64::INFINITY, f64::min)
    }

    /// As [`merge`].
    ///
    /// # Errors
    /// As [`merge`].
    pub fn merge(&self, shots: &[Shot], load: &mut dyn FnMut(usize) -> Result<Arc<Image>>) -> Result<Merged> {
        let frames = frames(shots, &self.options, &self.decoder)?;
        let Some(first) = frames.first() else {
            return Err(Error::invalid("the bracket", "no photograph", "at least one"));
        };
        let size = load(first.index)?.size();
        let mut sums = Sums::new(size);
        for frame in &frames {
            let image = checked(load(frame.index)?, size, frame.index)?;
            sums.visit(frame, &image, first_pass);
        }
        sums.begin_second_pass();
        let mut uses = vec![Use::default(); shots.len()];
        for frame in &frames {
            let image = checked(load(frame.index)?, size, frame.index)?;
            uses[frame.index] = sums.visit(frame, &image, second_pass).into_use();
        }
        // Sums are relative to the middle exposure.
        let middle = first.shot.exposure / f64::from(first.s);
        sums.finish(self.options.reference / middle, uses)
    }
}

fn checked(image: Arc<Image>, size: (usize, usize), index: usize) -> Result<Arc<Image>> {
    if image.size() == size && image.channels() == 3 {
        return Ok(image);
    }
    let found = format!("{} x {} x {}", image.width(), image.height(), image.channels());
    Err(Error::invalid(format!("photograph {}", index + 1), found, format!("{} x {} x 3", size.0, size.1)))
}

/// A photograph with all that is constant over it.
struct Frame<'a> {
    index: usize,
    shot: Shot,
    /// Exposure relative to the middle of the bracket, so that f32 is never strained.
    s: f32,
    lanes: [Lane; 3],
    decoder: &'a Decoder,
}

/// One channel of a photograph.
#[derive(Debug, Clone, Copy)]
struct Lane {
    /// Samples from here on are clipped.
    clip: f32,
    /// Photon variance per light, and variance of reading.
    photon: f32,
    read: f32,
    /// What is darker is as good as black.
    signal: f32,
    /// Where trust rises, and where it falls; in light.
    dark: [f32; 2],
    bright: [f32; 2],
    floor: f32,
    s: f32,
}

/// In order of exposure.
fn frames<'a>(shots: &[Shot], options: &Options, decoder: &'a Decoder) -> Result<Vec<Frame<'a>>> {
    for (n, shot) in shots.iter().enumerate() {
        if !(shot.exposure.is_normal() && shot.exposure > 0.0 && shot.iso.is_normal() && shot.iso > 0.0) {
            let found = format!("exposure {}, ISO {}", shot.exposure, shot.iso);
            return Err(Error::invalid(format!("photograph {}", n + 1), found, "positive numbers"));
        }
    }
    let middle = (shots.iter().map(|s| s.exposure.ln()).sum::<f64>() / shots.len().max(1) as f64).exp();
    let longest = shots.iter().map(|s| s.exposure).fold(0.0, f64::max);
    let mut order: Vec<usize> = (0..shots.len()).collect();
    order.sort_by(|a, b| shots[*a].exposure.total_cmp(&shots[*b].exposure));
    let frame = |index: usize| {
        let shot = shots[index];
        let floor = FLOOR * ((shot.exposure / longest) as f32).powi(FLOOR_POWER);
        let s = (shot.exposure / middle) as f32;
        let lane = |c: usize| Lane::new(decoder, c, options.clip[c], &options.noise, shot.iso, s, floor);
        Frame { index, shot, s, lanes: [0, 1, 2].map(lane), decoder }
    };
    Ok(order.into_iter().map(frame).collect())
}

impl Lane {
    fn new(decoder: &Decoder, c: usize, clip: f32, noise: &Noise, iso: f64, s: f32, floor: f32) -> Self {
        // The light at which the sensor is full; where nothing clips, that of the white code.
        let (white, coarse) = decoder.light(c, if clip.is_finite() { clip } else { 1.0 });
        let (black, fine) = decoder.light(c, decoder.black(c));
        let cut = decoder.light(c, 0.0).0;
        let read = white * white * noise.variance(0.0, iso) as f32;
        let photon = white * (noise.variance(1.0, iso) - noise.variance(0.0, iso)) as f32;
        let at_white = (photon * white + read + coarse).sqrt();
        let at_black = (read + fine).sqrt();
        let level = if clip.is_finite() { white } else { f32::INFINITY };
        Self {
            clip,
            photon,
            read,
            signal: black + DARK_SIGMAS[0] * at_black,
            dark: DARK_SIGMAS.map(|sigmas| cut + sigmas * at_black),
            bright: [level - BRIGHT_SIGMAS * at_white, level],
            floor,
            s,
        }
    }

    /// Trust in light `x`, and whether it is in range: neither clipped nor as good as black.
    fn trust(&self, x: f32) -> (f32, bool) {
        let rise = smoothstep(self.dark, x);
        let fall = if x < self.bright[0] { 1.0 } else { 1.0 - smoothstep(self.bright, x) };
        (rise.max(self.floor) * fall, x > self.signal && rise > self.floor && fall > 0.0)
    }

    /// `s^2 / var(x)`.
    fn inverse_variance(&self, x: f32, rounding: f32) -> f32 {
        self.s * self.s / (self.photon * x.max(0.0) + self.read + rounding)
    }
}

fn smoothstep([from, to]: [f32; 2], x: f32) -> f32 {
    let t = ((x - from) / (to - from)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// What is known of one sample of the result.
struct Cell<'a> {
    /// Sum of weights times estimates, and of weights.
    weighted: &'a mut f32,
    weights: &'a mut f32,
    /// First pass: the shortest photograph's value. Second: the first pass's estimate.
    estimate: &'a mut f32,
    marks: &'a mut u8,
}

/// A photograph shows this pixel; one of them is not clipped; one of them is neither clipped nor dark.
const COVERED: u8 = 1;
const UNCLIPPED: u8 = 2;
const IN_RANGE: u8 = 4;

/// A sample of a photograph: the code, its light, the variance of rounding.
#[derive(Clone, Copy)]
struct Seen {
    code: f32,
    x: f32,
    rounding: f32,
}

/// Weights from the photograph's own value, trust by what shorter ones predict.
fn first_pass(lane: &Lane, seen: Seen, cell: &mut Cell, _: &mut Tally) {
    if *cell.marks & COVERED == 0 {
        *cell.marks |= COVERED;
        *cell.estimate = seen.x / lane.s;
    }
    if seen.code >= lane.clip {
        return;
    }
    let mut judged = seen.x;
    if *cell.weights > 0.0 {
        // Two standard deviations below the prediction: noise in a short photograph condemns no long one.
        let predicted = (*cell.weighted / *cell.weights - 2.0 / cell.weights.sqrt()) * lane.s;
        judged = judged.max(predicted);
    }
    let weight = lane.trust(judged).0 * lane.inverse_variance(seen.x, seen.rounding);
    *cell.weighted += weight * (seen.x / lane.s);
    *cell.weights += weight;
}

/// Weights and trust from the first pass's estimate.
fn second_pass(lane: &Lane, seen: Seen, cell: &mut Cell, tally: &mut Tally) {
    let expected = *cell.estimate * lane.s;
    let clipped = seen.code >= lane.clip || expected >= lane.bright[1];
    tally.samples += 1;
    if clipped {
        tally.clipped += 1;
        return;
    }
    let (trust, in_range) = lane.trust(expected);
    *cell.marks |= UNCLIPPED | if in_range { IN_RANGE } else { 0 };
    if in_range {
        tally.used += 1;
        tally.compare(seen.x, expected);
    } else {
        tally.dark += 1;
    }
    let weight = trust * lane.inverse_variance(expected, seen.rounding);
    *cell.weighted += weight * (seen.x / lane.s);
    *cell.weights += weight;
}

/// Running sums over the photographs; interleaved RGB.
struct Sums {
    width: usize,
    height: usize,
    weighted: Vec<f32>,
    weights: Vec<f32>,
    estimate: Vec<f32>,
    marks: Vec<u8>,
}

impl Sums {
    fn new((width, height): (usize, usize)) -> Self {
        let zeros = || vec![0.0; width * height * 3];
        let marks = vec![0; width * height * 3];
        Self { width, height, weighted: zeros(), weights: zeros(), estimate: zeros(), marks }
    }

    /// Shows a photograph to every sample it covers.
    fn visit(
        &mut self,
        frame: &Frame<'_>,
        image: &Image,
        pass: impl Fn(&Lane, Seen, &mut Cell, &mut Tally) + Sync,
    ) -> Tally {
        let n = self.width * 3;
        let rows = self.weighted.par_chunks_mut(n).zip(self.weights.par_chunks_mut(n));
        let rows = rows.zip(self.estimate.par_chunks_mut(n)).zip(self.marks.par_chunks_mut(n));
        let [dx, dy] = frame.shot.offset.map(|d| d as isize);
        let tallies = rows.enumerate().map(|(y, (((weighted, weights), estimate), marks))| {
            let mut tally = Tally::of_row(y);
            let Some(source) = y.checked_add_signed(dy).filter(|y| *y < image.height()).map(|y| image.row(y)) else {
                return tally;
            };
            for x in 0..self.width {
                let Some(from) = x.checked_add_signed(dx).filter(|x| *x < self.width) else { continue };
                for c in 0..3 {
                    let code = source[from * 3 + c];
                    let (light, rounding) = frame.decoder.light(c, code);
                    let i = x * 3 + c;
                    let mut cell = Cell {
                        weighted: &mut weighted[i],
                        weights: &mut weights[i],
                        estimate: &mut estimate[i],
                        marks: &mut marks[i],
                    };
                    pass(&frame.lanes[c], Seen { code, x: light, rounding }, &mut cell, &mut tally);
                }
            }
            tally
        });
        tallies.reduce(Tally::default, Tally::join)
    }

    fn begin_second_pass(&mut self) {
        let sums = self.weighted.par_iter_mut().zip(&mut self.weights);
        sums.zip(&mut self.estimate).for_each(|((weighted, weights), estimate)| {
            if *weights > 0.0 {
                *estimate = *weighted / *weights;
            }
            (*weighted, *weights) = (0.0, 0.0);
        });
    }

    /// `scale` takes sums to the wanted unit.
    fn finish(mut self, scale: f64, photographs: Vec<Use>) -> Result<Merged> {
        let scale = scale as f32;
        self.estimate.par_iter_mut().zip(&self.weighted).zip(&self.weights).for_each(|((out, weighted), weights)| {
            if *weights > 0.0 {
                *out = weighted / weights;
            }
        });
        let is_clipped = |marks: &u8| marks & (COVERED | UNCLIPPED) == COVERED;
        let is_dark = |marks: &u8| marks & (UNCLIPPED | IN_RANGE) == UNCLIPPED;
        let mut report = Report { photographs, ..Report::default() };
        report.clipped_everywhere.count(&self.marks, is_clipped);
        report.dark_everywhere.count(&self.marks, is_dark);
        report.measure_noise(&self.estimate, &self.weights, |i| self.marks[i] & IN_RANGE != 0);
        self.estimate.par_iter_mut().for_each(|v| *v *= scale);
        Ok(Merged { image: Image::from_data(self.width, self.height, 3, self.estimate)?, report })
    }
}
