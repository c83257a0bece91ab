//! Small patches of a bracket to recover a response of deep codes from: their means are surer than a pixel, and lie between
//! codes.

use std::collections::BTreeMap;

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg32;

use crate::image::Image;

/// Patches are so wide and high, in pixels: the mean of 9 strays by a third of a pixel's noise. Wider ones straddle more
/// texture, and of textured ones some pixel clips before the mean is near white: simulated with a texture of 20 %, 700 of
/// 5 x 5 leave 3 % of error at white, 2000 of 3 x 3 1.6 %, 6000 of 3 x 3 0.8 %.
const SIDE: usize = 3;
/// Patches looked at, spread over the picture.
const CANDIDATES: usize = 32_768;
/// Chosen ones are spread over so many parts of the picture, across and down, ...
const PARTS: [usize; 2] = [8, 6];
/// ... and over so many steps of brightness, ...
const BRIGHTNESSES: usize = 16;
/// ... the smoothest of each, until there are so many.
const MOST: usize = 6000;
/// A mean that falls by more than this share of white while the exposure rises was not the same thing: something moved.
const FALL: f32 = 0.02;

/// Pixels of a patch.
pub(super) const PIXELS: usize = SIDE * SIDE;

/// One patch in one photograph: the codes of its pixels, white = 1, a channel after the other.
pub type Codes = [[f32; PIXELS]; 3];

/// One patch in every photograph of a bracket, in order of exposure.
pub type Patch = Vec<Codes>;

pub(super) fn mean(codes: &[f32; PIXELS]) -> f32 {
    codes.iter().sum::<f32>() / PIXELS as f32
}

pub(super) fn highest(codes: &[f32; PIXELS]) -> f32 {
    codes.iter().copied().fold(0.0, f32::max)
}

/// Looks at each photograph of a bracket once, in order of exposure.
#[derive(Debug)]
pub struct Patches {
    candidates: Vec<Candidate>,
}

#[derive(Debug)]
struct Candidate {
    x: usize,
    y: usize,
    part: usize,
    /// Of each channel in the last photograph.
    last: [f32; 3],
    /// Summed over the photographs: means of all channels, and the spread of green.
    brightness: f32,
    roughness: f32,
    codes: Patch,
}

impl Patches {
    /// For photographs of one size. Patches lie at random in the cells of a regular grid, seeded, so that the same
    /// photographs give the same response.
    pub fn new(width: usize, height: usize) -> Self {
        let (w, h) = (width.saturating_sub(SIDE - 1), height.saturating_sub(SIDE - 1));
        // Cells no smaller than a patch, so that no pixel counts twice or more than twice.
        let most = (w / SIDE).max(1) * (h / SIDE).max(1);
        let aspect = w as f64 / h.max(1) as f64;
        let wanted = CANDIDATES.min(most) as f64;
        let across = ((wanted * aspect).sqrt() as usize).clamp(1, w.max(1));
        let down = ((wanted / across as f64) as usize).clamp(1, h.max(1));
        let mut rng = Pcg32::seed_from_u64(0);
        let mut within = |cell: usize, cells: usize, size: usize| {
            let (from, to) = (cell * size / cells, (cell + 1) * size / cells);
            rng.random_range(from..to.max(from + 1))
        };
        let mut candidates = Vec::new();
        for (j, i) in (0..down).flat_map(|j| (0..across).map(move |i| (j, i))).filter(|_| w > 0 && h > 0) {
            let (x, y) = (within(i, across, w), within(j, down, h));
            let part = (y * PARTS[1] / h) * PARTS[0] + x * PARTS[0] / w;
            candidates.push(Candidate {
                x,
                y,
                part,
                last: [0.0; 3],
                brightness: 0.0,
                roughness: 0.0,
                codes: Vec::new(),
            });
        }
        Self { candidates }
    }

    /// The next photograph, RGB codes with white at 1. Pixel (x, y) of the result lies at (x, y) + `offset` in it. Patches that
    /// lie outside, or grow darker as the exposure rises, are left out from here on.
    pub fn add(&mut self, codes: &Image, offset: [i32; 2]) {
        self.candidates.retain_mut(|candidate| candidate.add(codes, offset));
    }

    /// The smoothest patches of every part of the picture and every brightness.
    pub fn samples(&self) -> Vec<Patch> {
        let mut groups: BTreeMap<(usize, usize), Vec<&Candidate>> = BTreeMap::new();
        for candidate in &self.candidates {
            let share = candidate.brightness / (3 * candidate.codes.len().max(1)) as f32;
            let brightness = ((share * BRIGHTNESSES as f32) as usize).min(BRIGHTNESSES - 1);
            groups.entry((candidate.part, brightness)).or_default().push(candidate);
        }
        groups.values_mut().for_each(|group| group.sort_by(|a, b| a.roughness.total_cmp(&b.roughness)));
        let deepest = groups.values().map(Vec::len).max().unwrap_or(0);
        let in_turn = (0..deepest).flat_map(|k| groups.values().filter_map(move |group| group.get(k)));
        in_turn.take(MOST).map(|candidate| candidate.codes.clone()).collect()
    }
}

impl Candidate {
    /// Takes the codes; `false` when the patch does not lie inside this photograph, or something moved.
    fn add(&mut self, codes: &Image, offset: [i32; 2]) -> bool {
        let at = |p: usize, d: i32, size: usize| p.checked_add_signed(d as isize).filter(|p| p + SIDE <= size);
        let (Some(x), Some(y)) = (at(self.x, offset[0], codes.width()), at(self.y, offset[1], codes.height())) else {
            return false;
        };
        let pixel = |k: usize, c: usize| codes.pixel(x + k % SIDE, y + k / SIDE)[c];
        let seen: Codes = std::array::from_fn(|c| std::array::from_fn(|k| pixel(k, c)));
        let means = [0, 1, 2].map(|c| mean(&seen[c]));
        let steady = (0..3).all(|c| means[c] >= self.last[c] - FALL);
        self.last = means;
        self.brightness += means.iter().sum::<f32>();
        self.roughness += seen[1].iter().map(|v| (v - means[1]).powi(2)).sum::<f32>();
        self.codes.push(seen);
        steady
    }
}
