//! The dark level of a camera, and the ambient light, from black photographs: every controlled light off, or the cap on.
//!
//! A photograph of relative exposure s sees ambient light A on top of what the camera codes as nothing:
//!
//! `f^-1(z) = d + A s`
//!
//! with `f` the response, `z` the code, and `d` dark current, flare and the offset that keeps noise from being cut at zero.
//! Photographs at several exposures so lie on a line; its value at exposure 0 is the dark level, its slope the ambient
//! light. Every part of the picture has its own ambient light but the same dark level, so each part has a line of its
//! own and the level is the median over the parts. Dark current that grows with time counts as ambient light, and is
//! subtracted with it.
//!
//! Codes are averaged as light, because the mean of codes of a curved response is not the code of the mean. In a part
//! hot pixels are left out, and where noise is cut at code 0 the median is taken, which a cut of less than half the pixels
//! does not move.

use crate::error::{Error, Result};
use crate::hdr::Curve;
use crate::image::{Image, SampleType};

/// Parts across and down: some 800 pixels each in a picture of 640 x 480.
const PARTS: [usize; 2] = [24, 16];
/// Pixels looked at in a part: their mean is as sure as a hundredth of their noise.
const PIXELS: usize = 10_000;
/// Samples farther than this many standard deviations from the median of their part are hot or dead: one in 16,000 of
/// normal noise.
const HOT_SIGMAS: f64 = 4.0;
/// Standard deviations in a median absolute deviation of normal noise.
const SIGMA_PER_MAD: f64 = 1.4826;
/// From this share of samples at code 0 on the noise counts as cut there.
const CUT_SHARE: f64 = 0.005;
/// Parts brighter than this are lit by more than the room and may be clipped.
const BRIGHTEST: f64 = 0.9;
/// Exposures within this ratio (a quarter of a stop) of each other tell no slope.
const LEAST_RATIO: f64 = 1.19;
/// Ambient light above this share of white in the longest photograph is worth a sentence: subtracting it costs noise.
const MUCH_AMBIENT: f64 = 0.02;

/// What black photographs say.
#[derive(Debug, Clone, PartialEq)]
pub struct Black {
    /// The code (white = 1) of no light, each channel: [`hdr::Options::black`](crate::hdr::Options::black).
    pub level: [f32; 3],
    /// Its light, white = 1 (or in the scale of the response). Photographs tell light above the dark level only, so of a
    /// recovered response only differences of light mean something, and this does not.
    pub dark: [f64; 3],
    /// Ambient light, median over the parts of the picture: light per relative exposure, in the scale of merged pictures.
    pub ambient: [f64; 3],
    /// Standard deviation of one sample of the shortest photograph, in shares of the white code.
    pub noise: [f64; 3],
    /// What a person should know, a sentence each.
    pub doubts: Vec<String>,
}

/// Gathers black photographs; holds means, not pictures.
#[derive(Debug, Clone)]
pub struct Blacks {
    curve: Curve,
    sample_type: SampleType,
    photographs: Vec<Photograph>,
}

#[derive(Debug, Clone)]
struct Photograph {
    exposure: f64,
    size: (usize, usize),
    /// Light of each channel of each part; NaN where it is too bright.
    parts: Vec<[f64; 3]>,
    noise: [f64; 3],
    cut: bool,
}

impl Blacks {
    /// For photographs of one camera. Where its response is not known yet, [`Curve::Linear`] is right without ambient
    /// light, and near enough with little: the curve is straight over a few codes.
    pub fn new(curve: Curve, sample_type: SampleType) -> Self {
        Self { curve, sample_type, photographs: Vec::new() }
    }

    /// The next photograph, RGB codes with white at 1, of a relative exposure.
    ///
    /// # Errors
    /// [`Error::Invalid`] for an exposure that is not positive or another size than the first photograph's.
    pub fn add(&mut self, codes: &Image, exposure: f64) -> Result<()> {
        let place = || format!("black photograph {}", self.photographs.len() + 1);
        if !(exposure.is_normal() && exposure > 0.0) {
            return Err(Error::invalid(place(), format!("exposure {exposure}"), "a positive number"));
        }
        let size = self.photographs.first().map_or(codes.size(), |first| first.size);
        if codes.size() != size || codes.channels() != 3 || codes.data().is_empty() {
            let found = format!("{} x {} x {}", codes.width(), codes.height(), codes.channels());
            return Err(Error::invalid(place(), found, format!("{} x {} x 3", size.0, size.1)));
        }
        let mut photograph = Photograph { exposure, size, parts: Vec::new(), noise: [0.0; 3], cut: false };
        let mut deviations: [Vec<f64>; 3] = Default::default();
        for part in parts(size) {
            let lights = std::array::from_fn(|c| {
                let mut samples = samples(codes, &part, c);
                let centre = self.centre(c, &mut samples);
                deviations[c].push(centre.deviation);
                photograph.cut |= centre.cut;
                centre.light
            });
            photograph.parts.push(lights);
        }
        photograph.noise = deviations.map(|mut d| median(&mut d));
        self.photographs.push(photograph);
        Ok(())
    }

    /// The dark level and the ambient light.
    ///
    /// # Errors
    /// [`Error::Invalid`] for no photograph, or photographs that are not black.
    pub fn finish(&self) -> Result<Black> {
        let exposures = || self.photographs.iter().map(|p| p.exposure);
        let (shortest, longest) = exposures().fold((f64::INFINITY, 0f64), |(l, h), s| (l.min(s), h.max(s)));
        let Some(first) = self.photographs.iter().min_by(|a, b| a.exposure.total_cmp(&b.exposure)) else {
            return Err(Error::invalid("the dark level", "no black photograph", "at least one, with all lights off"));
        };
        let sloped = longest / shortest >= LEAST_RATIO;
        let mut black =
            Black { level: [0.0; 3], dark: [0.0; 3], ambient: [0.0; 3], noise: first.noise, doubts: Vec::new() };
        for c in 0..3 {
            let lines: Vec<Line> = (0..first.parts.len()).filter_map(|k| self.line(k, c, sloped)).collect();
            if 2 * lines.len() <= first.parts.len() {
                return Err(Error::invalid(
                    "the black photographs",
                    "more than half of the picture as bright as white",
                    "photographs with every controlled light off; or shorter ones",
                ));
            }
            black.dark[c] = median(&mut lines.iter().map(|l| l.at_zero).collect::<Vec<_>>());
            black.ambient[c] = median(&mut lines.iter().map(|l| l.slope).collect::<Vec<_>>()).max(0.0);
            let code = self.curve.code(c, black.dark[c]);
            black.level[c] = if self.sample_type.largest_code().is_some() { code.max(0.0) } else { code } as f32;
        }
        self.doubt(&mut black, sloped, longest);
        Ok(black)
    }

    /// The line of one part and channel; level where exposures do not differ. `None` where fewer than two photographs (one,
    /// when level) are dark enough.
    fn line(&self, part: usize, c: usize, sloped: bool) -> Option<Line> {
        let seen = self.photographs.iter().map(|p| (p.exposure, p.parts[part][c]));
        let points: Vec<(f64, f64)> = seen.filter(|(_, light)| light.is_finite()).collect();
        let n = points.len() as f64;
        let (s, y) = points.iter().fold((0.0, 0.0), |(s, y), p| (s + p.0 / n, y + p.1 / n));
        if !sloped {
            return (!points.is_empty()).then_some(Line { at_zero: y, slope: 0.0 });
        }
        let (up, across) =
            points.iter().fold((0.0, 0.0), |(up, across), p| (up + (p.0 - s) * (p.1 - y), across + (p.0 - s).powi(2)));
        (across > 0.0).then(|| Line { at_zero: y - up / across * s, slope: up / across })
    }

    fn doubt(&self, black: &mut Black, sloped: bool, longest: f64) {
        if !sloped {
            black.doubts.push(
                "the black photographs are of one exposure: ambient light counts as dark level; photograph black at two \
                 exposures, the longest and the shortest, to tell them apart"
                    .to_owned(),
            );
        }
        if self.photographs.iter().any(|p| p.cut) {
            black.doubts.push(
                "the camera cuts noise at code 0: what is dark comes out a little too bright, and no dark level can mend it"
                    .to_owned(),
            );
        }
        let white: [f64; 3] = std::array::from_fn(|c| self.curve.light(c, 1.0));
        let share = (0..3).map(|c| black.ambient[c] * longest / white[c]).fold(0.0, f64::max);
        if share > MUCH_AMBIENT {
            black.doubts.push(format!(
                "ambient light fills {:.1} % of the range in the longest black photograph: a darker room gives less noise",
                100.0 * share
            ));
        }
    }

    /// What one part shows in one channel.
    fn centre(&self, c: usize, samples: &mut [f32]) -> Centre {
        samples.sort_unstable_by(f32::total_cmp);
        let middle = f64::from(samples[samples.len() / 2]);
        let mut far: Vec<f64> = samples.iter().map(|v| (f64::from(*v) - middle).abs()).collect();
        let spread = SIGMA_PER_MAD * median(&mut far);
        // Noise below one step of the codes shows as few codes, all of them sound.
        let step = samples.windows(2).map(|w| w[1] - w[0]).filter(|d| *d > 0.0).fold(f32::INFINITY, f32::min);
        let step = if step.is_finite() { f64::from(step) } else { 0.0 };
        let reach = HOT_SIGMAS * spread + 1.5 * step;
        let sound = || samples.iter().map(|v| f64::from(*v)).filter(|v| (v - middle).abs() <= reach);
        let count = sound().count() as f64;
        let mean = sound().sum::<f64>() / count;
        let deviation = (sound().map(|v| (v - mean).powi(2)).sum::<f64>() / count).sqrt();
        let at_zero = samples.partition_point(|v| *v <= 0.0) as f64 / samples.len() as f64;
        let cut = self.sample_type.largest_code().is_some() && at_zero > CUT_SHARE;
        let light = match cut {
            _ if self.sample_type.largest_code().is_some() && middle > BRIGHTEST => f64::NAN,
            true => self.curve.light(c, middle),
            false => sound().map(|v| self.curve.light(c, v)).sum::<f64>() / count,
        };
        Centre { light, deviation, cut }
    }
}

struct Line {
    at_zero: f64,
    slope: f64,
}

struct Centre {
    light: f64,
    deviation: f64,
    cut: bool,
}

/// Left, top, right, bottom.
fn parts((width, height): (usize, usize)) -> Vec<[usize; 4]> {
    let (across, down) = (PARTS[0].min(width), PARTS[1].min(height));
    let edge = |k: usize, parts: usize, size: usize| k * size / parts;
    let part = |i: usize, j: usize| {
        [edge(i, across, width), edge(j, down, height), edge(i + 1, across, width), edge(j + 1, down, height)]
    };
    (0..down).flat_map(|j| (0..across).map(move |i| (i, j))).map(|(i, j)| part(i, j)).collect()
}

/// Samples of channel `c` in a part, every so many of a large one.
fn samples(codes: &Image, [x0, y0, x1, y1]: &[usize; 4], c: usize) -> Vec<f32> {
    let stride = ((x1 - x0) * (y1 - y0)).div_ceil(PIXELS).max(1);
    let pixels = (*y0..*y1).flat_map(|y| (*x0..*x1).map(move |x| (x, y)));
    pixels.step_by(stride).map(|(x, y)| codes.pixel(x, y)[c]).collect()
}

/// The mean of the middle two of an even number; 0 of none.
pub(super) fn median(values: &mut [f64]) -> f64 {
    let n = values.len();
    if n == 0 {
        return 0.0;
    }
    let (below, middle, _) = values.select_nth_unstable_by(n / 2, f64::total_cmp);
    let middle = *middle;
    if n % 2 == 1 { middle } else { 0.5 * (middle + below.iter().copied().fold(f64::NEG_INFINITY, f64::max)) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hdr::testing::{self, Sensor, inverse_film};
    use crate::hdr::{Noise, Response};

    const EXPOSURES: [f64; 4] = [0.01, 0.1, 1.0, 4.0];

    /// The room: a window on the left.
    fn room(bright: f32) -> Image {
        Image::from_fn(200, 150, |x, _| [bright * (1.5 - x as f32 / 200.0), bright, 0.5 * bright])
    }

    fn curve_of(sensor: &Sensor) -> Curve {
        if !sensor.film {
            return Curve::Linear;
        }
        let table = std::array::from_fn(|z| inverse_film(z as f64 / 255.0));
        Curve::Response(Response::new("film", [table; 3]).unwrap())
    }

    fn found(sensor: &Sensor, scene: &Image, exposures: &[f64], curve: Curve) -> Black {
        let mut blacks = Blacks::new(curve, SampleType::U16);
        for (n, s) in exposures.iter().enumerate() {
            let mut codes = sensor.photograph(scene, *s, n as u64);
            // One pixel in a hundred is hot.
            codes.data_mut().iter_mut().step_by(101).for_each(|v| *v = 0.7);
            blacks.add(&codes, *s).unwrap();
        }
        blacks.finish().unwrap()
    }

    #[test]
    fn level_and_ambient_light_are_within_a_hundredth() {
        for sensor in [testing::LINEAR, testing::FILM] {
            let curve = curve_of(&sensor);
            let scale = curve.light(0, 0.5) / sensor.light(0.5);
            let black = found(&sensor, &room(4e-4), &EXPOSURES, curve);
            for c in 0..3 {
                let (dark, ambient) = (black.dark[c] / scale, black.ambient[c] / scale);
                assert!((dark / sensor.dark - 1.0).abs() < 0.01, "film {}: {dark}", sensor.film);
                let code = sensor.code(sensor.dark);
                assert!((f64::from(black.level[c]) / code - 1.0).abs() < 0.005, "{:?} is not {code}", black.level);
                let truth = if c == 2 { 2e-4 } else { 4e-4 };
                assert!((ambient / truth - 1.0).abs() < 0.02, "film {}: {ambient} is not {truth}", sensor.film);
            }
            assert!(black.doubts.is_empty(), "{:?}", black.doubts);
        }
    }

    #[test]
    fn a_response_not_known_yet_does_no_harm_without_ambient_light() {
        let black = found(&testing::FILM, &room(0.0), &EXPOSURES, Curve::Linear);
        let code = testing::FILM.code(testing::DARK);
        assert!(black.level.iter().all(|level| (f64::from(*level) / code - 1.0).abs() < 0.005), "{black:?} {code}");
        let light = testing::FILM.light(f64::from(black.level[1]));
        assert!((light / testing::DARK - 1.0).abs() < 0.01, "{light}");
        // Noise of the dark level alone: 78 electrons of photons and 8 of reading, 12 of 20,000.
        let linear = found(&testing::LINEAR, &room(0.0), &EXPOSURES, Curve::Linear);
        assert!((linear.noise[1] / 5.97e-4 - 1.0).abs() < 0.1, "{:?}", linear.noise);
    }

    #[test]
    fn what_is_doubtful_is_said() {
        let one = found(&testing::LINEAR, &room(4e-4), &[1.0], Curve::Linear);
        assert!(one.doubts[0].contains("one exposure"), "{:?}", one.doubts);
        assert!(f64::from(one.level[1]) > testing::DARK + 3e-4, "ambient light counts as dark: {:?}", one.level);
        let cut = Sensor { dark: 0.0, ..testing::LINEAR };
        let cut = found(&cut, &room(0.0), &EXPOSURES, Curve::Linear);
        assert!(cut.doubts[0].contains("cuts noise"), "{:?}", cut.doubts);
        assert!(cut.level.iter().all(|level| *level < 1e-4), "half of the pixels are 0: {:?}", cut.level);
        let lit = found(&testing::LINEAR, &room(0.01), &EXPOSURES, Curve::Linear);
        assert!(lit.doubts[0].contains("ambient light fills"), "{:?}", lit.doubts);
        // Noise far below one code is no reason to doubt.
        let quiet = Sensor { noise: Noise { full_well_e: 1e9, read_e: 8.0 }, ..testing::LINEAR };
        let quiet = found(&quiet, &room(0.0), &EXPOSURES, Curve::Linear);
        assert!((f64::from(quiet.level[0]) - testing::DARK).abs() < 1e-5 && quiet.doubts.is_empty(), "{quiet:?}");
    }

    #[test]
    fn photographs_that_are_not_black_are_refused() {
        let mut blacks = Blacks::new(Curve::Linear, SampleType::U16);
        assert!(blacks.finish().unwrap_err().to_string().contains("no black photograph"));
        let white = Image::from_fn(48, 32, |_, _| [1.0; 3]);
        for s in [0.0, -1.0, f64::NAN] {
            assert!(blacks.add(&white, s).unwrap_err().to_string().contains("exposure"), "{s}");
        }
        blacks.add(&white, 1.0).unwrap();
        let message = blacks.finish().unwrap_err().to_string();
        assert!(message.contains("as bright as white"), "{message}");
        let message = blacks.add(&Image::new(4, 4, 3), 1.0).unwrap_err().to_string();
        assert!(message.contains("black photograph 2: found 4 x 4"), "{message}");
        let mut tiny = Blacks::new(Curve::Linear, SampleType::U16);
        tiny.add(&Image::new(1, 1, 3), 1.0).unwrap();
        assert_eq!(tiny.finish().unwrap().level, [0.0; 3]);
    }
}
