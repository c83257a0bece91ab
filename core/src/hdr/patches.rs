//! Small patches of a bracket to recover a response of deep codes from: their means are surer than a pixel, and lie between
//! codes.

use std::collections::BTreeMap;

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg32;

use crate::image::Image;

/// Patches are so wide and high, in pixels: the mean of 25 strays by a fifth of a pixel's noise.
const SIDE: usize = 5;
/// Patches looked at, spread over the picture.
const CANDIDATES: usize = 16_384;
/// Chosen ones are spread over so many parts of the picture, across and down, ...
const PARTS: [usize; 2] = [8, 6];
/// ... and over so many steps of brightness, ...
const BRIGHTNESSES: usize = 16;
/// ... the smoothest of each, until there are so many.
const MOST: usize = 1536;
/// A mean that falls by more than this share of white while the exposure rises was not the same thing: something moved.
const FALL: f32 = 0.02;

/// One patch in one photograph, RGB, white = 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mean {
    /// Mean code.
    pub code: [f32; 3],
    /// Variance of the codes: noise, and texture of the scene.
    pub variance: [f32; 3],
    /// The highest code.
    pub highest: [f32; 3],
}

/// Pixels behind a [`Mean`].
pub(super) const PIXELS: f64 = (SIDE * SIDE) as f64;

/// One patch in every photograph of a bracket, in order of exposure.
pub type Patch = Vec<Mean>;

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
    means: Patch,
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
            candidates.push(Candidate { x, y, part, means: Vec::new() });
        }
        Self { candidates }
    }

    /// The next photograph, RGB codes with white at 1. Pixel (x, y) of the result lies at (x, y) + `offset` in it.
    pub fn add(&mut self, codes: &Image, offset: [i32; 2]) {
        self.candidates.retain_mut(|candidate| candidate.add(codes, offset));
    }

    /// The smoothest patches of every part of the picture and every brightness; those that grow darker as the exposure
    /// rises are left out.
    pub fn samples(&self) -> Vec<Patch> {
        let mut groups: BTreeMap<(usize, usize), Vec<(f32, &Patch)>> = BTreeMap::new();
        let steady = |p: &Patch| p.windows(2).all(|w| (0..3).all(|c| w[1].code[c] >= w[0].code[c] - FALL));
        for candidate in self.candidates.iter().filter(|c| steady(&c.means)) {
            let sum: f32 = candidate.means.iter().flat_map(|m| m.code).sum();
            let share = sum / (3 * candidate.means.len().max(1)) as f32;
            let brightness = ((share * BRIGHTNESSES as f32) as usize).min(BRIGHTNESSES - 1);
            let roughness = candidate.means.iter().map(|m| m.variance[1]).sum();
            groups.entry((candidate.part, brightness)).or_default().push((roughness, &candidate.means));
        }
        groups.values_mut().for_each(|group| group.sort_by(|a, b| a.0.total_cmp(&b.0)));
        let deepest = groups.values().map(Vec::len).max().unwrap_or(0);
        let in_turn = (0..deepest).flat_map(|k| groups.values().filter_map(move |group| group.get(k)));
        in_turn.take(MOST).map(|(_, means)| (*means).clone()).collect()
    }
}

impl Candidate {
    /// Takes the codes; `false` when the patch does not lie inside this photograph.
    fn add(&mut self, codes: &Image, offset: [i32; 2]) -> bool {
        let at = |p: usize, d: i32, size: usize| p.checked_add_signed(d as isize).filter(|p| p + SIDE <= size);
        let (Some(x), Some(y)) = (at(self.x, offset[0], codes.width()), at(self.y, offset[1], codes.height())) else {
            return false;
        };
        let mut mean = Mean { code: [0.0; 3], variance: [0.0; 3], highest: [0.0; 3] };
        for c in 0..3 {
            let pixels = || (y..y + SIDE).flat_map(|y| (x..x + SIDE).map(move |x| codes.pixel(x, y)[c]));
            let middle = pixels().map(f64::from).sum::<f64>() / PIXELS;
            let spread = pixels().map(|v| (f64::from(v) - middle).powi(2)).sum::<f64>() / (PIXELS - 1.0);
            mean.code[c] = middle as f32;
            mean.variance[c] = spread as f32;
            mean.highest[c] = pixels().fold(0.0, f32::max);
        }
        self.means.push(mean);
        true
    }
}
