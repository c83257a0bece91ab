//! What every pixel is explained by: the responses of all wavelets to all patterns, `W = S^T M`, and their tree.

use crate::domain::patterns::Pattern;
use crate::error::{Error, Result};
use crate::wavelet::{Transform, Tree};

/// Rows are padded with zeros to a multiple of this: the widest vectors of today's processors hold 16 floats.
pub(super) const LANES: usize = 16;

/// Fewer patterns tell nothing of how they differ.
const FEWEST: usize = 2;

/// Light of a pattern that varies by less, as a share of its largest value, is constant: an eighth of the smallest step of an
/// 8-bit emitter.
const FLAT: f32 = 1.0 / 2048.0;

/// What functions weigh at most to be unseen by the patterns, relative to the one they see best: the rounding of f32.
const UNSEEN: f32 = 1e-10;

/// Group of wavelets at one place: a scaling function, or the up to three details.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Group {
    /// Its first row in the dictionary.
    pub row: u32,
    /// Rows: one to three.
    pub count: u32,
    /// The first of the groups below it, which lie one after another.
    pub child: u32,
    /// How many groups lie below it: at most four.
    pub children: u32,
}

/// `W = S^T M` of a set of patterns M: row j holds what wavelet j answers to each pattern.
///
/// A photograph of a pixel with the reflectance function `t = S c` is `<t, M> = <c, W>` (6.7.2). M must be the light that was
/// emitted, less that of the black screen, and in linear units; then the photographs need no more than the black one
/// subtracted. Memory: 4 bytes a texel and pattern: 4 MB for 64 x 64 texels and 256 patterns, 16 MB for 128 x 128.
#[derive(Debug, Clone)]
pub struct Dictionary {
    transform: Transform,
    patterns: usize,
    stride: usize,
    roots: usize,
    groups: Vec<Group>,
    /// Where a row's coefficient lies in the transform.
    locations: Vec<u32>,
    /// Row by row; those of a group, and of the groups below one, follow one another.
    table: Vec<f32>,
    /// One over the squared length of each row about its mean; zero for what no pattern lights.
    weights: Vec<f32>,
}

impl Dictionary {
    /// The dictionary of patterns, in the order in which the photographs will come.
    ///
    /// # Errors
    /// Fewer than two patterns; a pattern of another size than the transform's; light that is not finite; a pattern without
    /// contrast (an all-grey frame is no noise: it was read from the wrong file, or the screen slept); patterns that are all
    /// the same.
    pub fn new(transform: &Transform, patterns: &[Pattern]) -> Result<Self> {
        check(transform.size(), patterns)?;
        let tree = transform.tree();
        let (groups, locations, roots) = numbered(&tree);
        let count = patterns.len();
        let stride = count.next_multiple_of(LANES);
        let table = rows(transform, patterns, &locations, stride);
        let weights = weights(&table, stride, count);
        Ok(Self { transform: transform.clone(), patterns: count, stride, roots, groups, locations, table, weights })
    }

    /// How many patterns.
    pub fn patterns(&self) -> usize {
        self.patterns
    }

    /// The transform whose coefficients are found.
    pub fn transform(&self) -> &Transform {
        &self.transform
    }

    /// Floats from a row to the next.
    pub(super) fn stride(&self) -> usize {
        self.stride
    }

    /// Groups of scaling functions; they come first.
    pub(super) fn roots(&self) -> u32 {
        self.roots as u32
    }

    pub(super) fn group(&self, number: u32) -> Group {
        self.groups[number as usize]
    }

    /// What wavelet a row is of.
    pub(super) fn location(&self, row: u32) -> u32 {
        self.locations[row as usize]
    }

    /// Rows, padded.
    pub(super) fn rows(&self, first: u32, count: u32) -> &[f32] {
        &self.table[first as usize * self.stride..][..count as usize * self.stride]
    }

    /// What a wavelet answers to each pattern.
    pub(super) fn patterns_of(&self, row: u32) -> &[f32] {
        &self.rows(row, 1)[..self.patterns]
    }

    /// See the field.
    pub(super) fn weights(&self, first: u32, count: u32) -> &[f32] {
        &self.weights[first as usize..][..count as usize]
    }
}

/// Refuses patterns that cannot be solved from.
fn check((columns, rows): (usize, usize), patterns: &[Pattern]) -> Result<()> {
    if patterns.len() < FEWEST {
        let found = format!("{} of them", patterns.len());
        return Err(Error::invalid("the noise patterns", found, "two or more, each with its photograph"));
    }
    for (n, pattern) in patterns.iter().enumerate() {
        let place = || format!("noise pattern {}", n + 1);
        if (pattern.columns, pattern.rows) != (columns, rows) || pattern.values.len() != columns * rows {
            let found = format!("{} x {} texels", pattern.columns, pattern.rows);
            return Err(Error::invalid(place(), found, format!("{columns} x {rows} texels, as the others")));
        }
        if let Some(texel) = pattern.values.iter().position(|light| !light.is_finite()) {
            let found =
                format!("light of {} at texel ({}, {})", pattern.values[texel], texel % columns, texel / columns);
            return Err(Error::invalid(place(), found, "numbers that are finite"));
        }
        let (low, high) = pattern.values.iter().fold((f32::MAX, f32::MIN), |(a, b), v| (a.min(*v), b.max(*v)));
        if high - low <= FLAT * high.abs() {
            let found = format!("the same light, {high}, everywhere");
            return Err(Error::invalid(place(), found, "wavelet noise, as `relume patterns noise` makes it"));
        }
    }
    if patterns.iter().skip(1).all(|pattern| pattern.values == patterns[0].values) {
        let found = format!("{} times the same pattern", patterns.len());
        return Err(Error::invalid("the noise patterns", found, "patterns that differ"));
    }
    Ok(())
}

/// Numbers all groups level by level, so that those below one follow one another; and their members' locations.
fn numbered(tree: &Tree) -> (Vec<Group>, Vec<u32>, usize) {
    let mut firsts: Vec<u32> = tree.roots().collect();
    let roots = firsts.len();
    let (mut groups, mut locations) = (Vec::with_capacity(tree.len() / 3 + 1), Vec::with_capacity(tree.len()));
    let mut number = 0;
    while number < firsts.len() {
        let (row, child) = (locations.len() as u32, firsts.len() as u32);
        locations.extend(tree.group(firsts[number]));
        firsts.extend(tree.groups_below(firsts[number]));
        let (count, children) = (locations.len() as u32 - row, firsts.len() as u32 - child);
        groups.push(Group { row, count, child, children });
        number += 1;
    }
    (groups, locations, roots)
}

/// The table: `S^T` of the patterns, LANES of them at once, transposed.
fn rows(transform: &Transform, patterns: &[Pattern], locations: &[u32], stride: usize) -> Vec<f32> {
    let mut table = vec![0.0; locations.len() * stride];
    let mut together = vec![0.0; locations.len() * LANES];
    for (block, patterns) in patterns.chunks(LANES).enumerate() {
        together.fill(0.0);
        for (lane, pattern) in patterns.iter().enumerate() {
            together.iter_mut().skip(lane).step_by(LANES).zip(&pattern.values).for_each(|(to, v)| *to = *v);
        }
        transform.inverse_adjoint(&mut together, LANES);
        for (row, location) in table.chunks_exact_mut(stride).zip(locations) {
            row[block * LANES..][..LANES].copy_from_slice(&together[*location as usize * LANES..][..LANES]);
        }
    }
    table
}

/// One over what a row varies about its mean: all patterns share one mean, which the first term explains.
fn weights(table: &[f32], stride: usize, patterns: usize) -> Vec<f32> {
    let variation = |row: &[f32]| {
        let row = &row[..patterns];
        let mean = row.iter().map(|w| f64::from(*w)).sum::<f64>() / patterns as f64;
        row.iter().map(|w| (f64::from(*w) - mean).powi(2)).sum::<f64>() as f32
    };
    let variations: Vec<f32> = table.chunks_exact(stride).map(variation).collect();
    let least = UNSEEN * variations.iter().copied().fold(0.0, f32::max);
    variations.into_iter().map(|v| if v > least { v.recip() } else { 0.0 }).collect()
}
