//! A first look at a bracket: where each channel clips, and pixels to recover a response from.

use std::collections::BTreeMap;

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg32;

use crate::image::{Image, SampleType};

/// Pixels looked at, spread over the picture; of these the useful ones become samples.
const CANDIDATES: usize = 16_384;
/// Samples are spread over so many parts of the picture, across and down, ...
const PARTS: [usize; 2] = [8, 6];
/// ... and over so many steps of brightness, ...
const BRIGHTNESSES: usize = 16;
/// ... so many from each: at most 1536, thirty times the fifty of Debevec and Malik's example.
const SAMPLES_EACH: usize = 2;
/// A code that falls by more than this while the exposure rises was not the same thing: something moved.
const FALL: u8 = 8;
/// JPEG spreads a clipped area over neighbouring codes. Of areas 3 to 11 stops too bright on real photographs (a camera of
/// 2006, quality about 90) 99 % lay within 4 codes of the one they pile up at; the rest is caught by the merge.
const JPEG_SPREAD: f32 = 4.0;

/// Looks at each photograph of a bracket once, in order of exposure.
#[derive(Debug)]
pub struct Survey {
    sample_type: SampleType,
    /// A count for each code; for floats only the ends of `largest` count.
    histogram: [Vec<u64>; 3],
    largest: [(f32, u64); 3],
    candidates: Vec<Candidate>,
    seen: u64,
}

#[derive(Debug)]
struct Candidate {
    x: usize,
    y: usize,
    part: usize,
    /// Summed largest differences to the eight neighbours.
    roughness: f32,
    codes: Vec<[u8; 3]>,
}

/// The codes of one pixel in each photograph, in order of exposure.
pub type Sample = Vec<[u8; 3]>;

impl Survey {
    /// For photographs of one size and type. Candidates are one random pixel in each cell of a regular grid, seeded, so
    /// that the same photographs give the same response.
    pub fn new(width: usize, height: usize, sample_type: SampleType) -> Self {
        let bins = sample_type.largest_code().map_or(0, |code| usize::from(code) + 1);
        let aspect = width as f64 / height.max(1) as f64;
        let across = ((CANDIDATES as f64 * aspect).sqrt() as usize).clamp(1, width.max(1));
        let down = (CANDIDATES / across).clamp(1, height.max(1));
        let mut rng = Pcg32::seed_from_u64(0);
        let mut within = |cell: usize, cells: usize, size: usize| {
            let (from, to) = (cell * size / cells, (cell + 1) * size / cells);
            rng.random_range(from..to.max(from + 1))
        };
        let mut candidates = Vec::with_capacity(across * down);
        for (j, i) in (0..down).flat_map(|j| (0..across).map(move |i| (j, i))) {
            let (x, y) = (within(i, across, width), within(j, down, height));
            let part = (y * PARTS[1] / height.max(1)) * PARTS[0] + x * PARTS[0] / width.max(1);
            candidates.push(Candidate { x, y, part, roughness: 0.0, codes: Vec::new() });
        }
        let histogram = std::array::from_fn(|_| vec![0; bins]);
        Self { sample_type, histogram, largest: [(f32::NEG_INFINITY, 0); 3], candidates, seen: 0 }
    }

    /// The next photograph, RGB codes with white at 1. Pixel (x, y) of the result lies at (x, y) + `offset` in it.
    pub fn add(&mut self, codes: &Image, offset: [i32; 2]) {
        self.seen += (codes.width() * codes.height()) as u64;
        self.count(codes);
        if matches!(self.sample_type, SampleType::Jpeg | SampleType::U8) {
            self.candidates.retain_mut(|candidate| candidate.add(codes, offset));
        }
    }

    fn count(&mut self, codes: &Image) {
        for pixel in codes.data().chunks_exact(codes.channels()) {
            for (c, &v) in pixel.iter().take(3).enumerate() {
                match self.sample_type.largest_code() {
                    Some(largest) => {
                        let code = (v * f32::from(largest)).round() as usize;
                        self.histogram[c][code.min(usize::from(largest))] += 1;
                    }
                    None if v > self.largest[c].0 => self.largest[c] = (v, 1),
                    None if v == self.largest[c].0 => self.largest[c].1 += 1,
                    None => {}
                }
            }
        }
    }

    /// Where each channel clips: from this sample on (white code = 1) a value says only "at least". Sensors and developing
    /// software clip where they please (a camera of the test data at code 251), so the level is read off the photographs:
    /// clipped values pile up at one number. `None` where nothing piles up: nothing is clipped.
    pub fn clip(&self) -> [Option<f32>; 3] {
        // Enough at exactly one number to be no coincidence, few enough to find a small lamp.
        let many = (self.seen / 100_000).max(16);
        std::array::from_fn(|c| match self.sample_type {
            SampleType::Float => (self.largest[c].1 >= many).then_some(self.largest[c].0),
            SampleType::U8 | SampleType::U16 => {
                let top = self.histogram[c].iter().rposition(|n| *n > 0)?;
                (self.histogram[c][top] >= many).then_some(top as f32 / (self.histogram[c].len() - 1) as f32)
            }
            SampleType::Jpeg => pile(&self.histogram[c], many).map(|code| (code as f32 - JPEG_SPREAD) / 255.0),
        })
    }

    /// Pixels to recover a response from: the flattest ones (where neither JPEG nor a trembling tripod changes the code) of
    /// every part of the picture and every brightness. Pixels that grow darker as the exposure rises are left out.
    pub fn samples(&self) -> Vec<Sample> {
        let mut groups: BTreeMap<(usize, usize), Vec<&Candidate>> = BTreeMap::new();
        let steady = |s: &[[u8; 3]]| s.windows(2).all(|w| (0..3).all(|c| w[1][c] >= w[0][c].saturating_sub(FALL)));
        for candidate in self.candidates.iter().filter(|c| steady(&c.codes)) {
            let sum: usize = candidate.codes.iter().flatten().map(|z| usize::from(*z)).sum();
            let brightness = sum * BRIGHTNESSES / (256 * 3 * candidate.codes.len().max(1));
            groups.entry((candidate.part, brightness)).or_default().push(candidate);
        }
        let mut samples = Vec::new();
        for group in groups.values_mut() {
            group.sort_by(|a, b| a.roughness.total_cmp(&b.roughness));
            samples.extend(group.iter().take(SAMPLES_EACH).map(|c| c.codes.clone()));
        }
        samples
    }
}

impl Candidate {
    /// Takes the codes; `false` when the pixel lies outside this photograph.
    fn add(&mut self, codes: &Image, offset: [i32; 2]) -> bool {
        let at = |p: usize, d: i32, size: usize| p.checked_add_signed(d as isize).filter(|p| *p < size);
        let (Some(x), Some(y)) = (at(self.x, offset[0], codes.width()), at(self.y, offset[1], codes.height())) else {
            return false;
        };
        let code = |c: usize| (codes.pixel(x, y)[c] * 255.0).round() as u8;
        self.codes.push([code(0), code(1), code(2)]);
        let (xs, ys) = (x.saturating_sub(1)..=x + 1, y.saturating_sub(1)..=y + 1);
        let inside = |(x, y): &(usize, usize)| *x < codes.width() && *y < codes.height();
        let neighbours = ys.flat_map(|y| xs.clone().map(move |x| (x, y))).filter(inside);
        let green = codes.pixel(x, y)[1];
        self.roughness += neighbours.map(|(x, y)| (codes.pixel(x, y)[1] - green).abs()).fold(0.0, f32::max);
        true
    }
}

/// The code at which clipped values of a JPEG pile up: the most frequent of the 16 highest, when it stands out from the 16
/// below those.
fn pile(histogram: &[u64], many: u64) -> Option<usize> {
    let total: u64 = histogram.iter().sum();
    let top = histogram.iter().rposition(|n| *n > total / 1_000_000)?;
    let high = top.saturating_sub(15)..=top;
    let code = high.clone().max_by_key(|z| histogram[*z])?;
    let below: u64 = histogram[top.saturating_sub(31)..*high.start()].iter().sum();
    (histogram[code] >= many && histogram[code] * 16 > 3 * below).then_some(code)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_level_of_clipping_is_where_values_pile_up() {
        let clip = |sample_type, f: &dyn Fn(usize) -> f32| {
            let mut survey = Survey::new(400, 100, sample_type);
            survey.add(&Image::from_fn(400, 100, |x, y| [f(x * 100 + y), 0.0, 0.5 * f(x * 100 + y)]), [0, 0]);
            survey.clip()
        };
        let ramp = |i: usize| i as f32 / 39_999.0;
        // 8 bits: codes 0 to 240 evenly, then many at 240.
        let at_240 = |i: usize| (ramp(i) * 300.0).round().min(240.0) / 255.0;
        assert_eq!(clip(SampleType::U8, &at_240)[0], Some(240.0 / 255.0));
        assert_eq!(clip(SampleType::Jpeg, &at_240)[0], Some(236.0 / 255.0));
        assert_eq!(clip(SampleType::Jpeg, &|i| (ramp(i) * 200.0).round() / 255.0)[0], None);
        assert_eq!(clip(SampleType::Float, &|i| (7.0 * ramp(i)).min(6.9))[0], Some(6.9));
        assert_eq!(clip(SampleType::Float, &ramp)[0], None);
        let fourteen_bits = |i: usize| (ramp(i) * 20_000.0).round().min(16_383.0) / 65_535.0;
        assert_eq!(clip(SampleType::U16, &fourteen_bits)[0], Some(16_383.0 / 65_535.0));
    }

    #[test]
    fn samples_cover_the_picture_and_skip_what_moves() {
        let (w, h) = (160, 120);
        let mut survey = Survey::new(w, h, SampleType::U8);
        for k in 0..4 {
            // A ramp that doubles; the lower right quarter flickers.
            let gain = 2f32.powi(k);
            let flicker = |x: usize, y: usize| x > w / 2 && y > h / 2 && k == 2;
            let frame = Image::from_fn(w, h, |x, y| {
                let v = (0.2 * gain * x as f32 / w as f32).min(1.0);
                [if flicker(x, y) { 0.0 } else { (v * 255.0).round() / 255.0 }; 3]
            });
            survey.add(&frame, [0, 0]);
        }
        let samples = survey.samples();
        assert!(samples.len() > 100 && samples.iter().all(|s| s.len() == 4), "{}", samples.len());
        let brightest = samples.iter().map(|s| s[3][1]).max().unwrap();
        assert!(brightest > 240, "the bright half is there: {brightest}");
        assert!(samples.iter().all(|s| s[2][1] + FALL >= s[1][1]));
    }
}
