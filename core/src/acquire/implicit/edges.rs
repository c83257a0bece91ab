//! Soft edges: pixels that see some of the screen itself, beside the object.
//!
//! Stripes tell how much that is to some percent, and not which part of a pixel's texels it is; what they leave of the screen in
//! a pixel's answers is as sharp as a texel, noise to few wavelets. So it is measured again, by all patterns: the pixel is
//! solved, and what its function leaves unexplained, or answers to the very texels that the pixel looks at (an object answers
//! to single texels there with next to nothing), is given to these texels by least squares, is taken out as well, and counts
//! as coverage that was missed; some times over.

use std::collections::HashMap;

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};
use rayon::prelude::*;

use super::{Scratch, Solver, Terms};
use crate::acquire::Photographs;
use crate::domain::patterns::Pattern;
use crate::error::Result;
use crate::field::{BLOCK_HEIGHT, BLOCK_PIXELS, BLOCK_WIDTH, Bands};

/// Each round finds most of what is left of the screen.
const ROUNDS: usize = 5;
/// Of the mean of the normal equations' diagonal: neighbouring texels are nearly alike in coarse patterns alone.
const RIDGE: f64 = 1e-5;

/// A pixel that sees some of the screen itself.
#[derive(Debug, Clone, PartialEq)]
pub struct Edge {
    /// Row x width + column.
    pub pixel: usize,
    /// The texels that it looks at, and how much of each it sees: as taken out of the photographs already.
    pub texels: Vec<(u32, f32)>,
    /// What it makes of the white screen, in the unit of the photographs.
    pub white: [f32; 3],
}

/// What more of the screen pixels see than was taken out.
#[derive(Debug, Clone, Default)]
pub struct Edges {
    of_pixel: HashMap<usize, Edge>,
    /// Light of a texel under each pattern.
    light: HashMap<u32, Vec<f32>>,
    /// The dictionary's row of each location.
    rows: Vec<u32>,
}

impl Edges {
    /// Measures again what `edges` see of the screen, in photographs of a size, width and height, under `patterns`; the solver's
    /// patterns, in their order. `progress(rows of blocks done, rows)` may stop it. Cost: five solutions a pixel.
    ///
    /// # Errors
    /// What reading the photographs meets.
    pub fn measured(
        solver: &Solver,
        photographs: &mut Photographs,
        size: (usize, usize),
        (edges, patterns): (Vec<Edge>, &[Pattern]),
        progress: &mut dyn FnMut(u64, u64) -> Result<()>,
    ) -> Result<Self> {
        let mut light: HashMap<u32, Vec<f32>> = HashMap::new();
        for (texel, _) in edges.iter().flat_map(|edge| &edge.texels) {
            let of = || patterns.iter().map(|pattern| pattern.values[*texel as usize]).collect();
            light.entry(*texel).or_insert_with(of);
        }
        let dictionary = solver.dictionary();
        let (width, height) = dictionary.transform().size();
        let mut row_of = vec![0; width * height];
        (0..row_of.len() as u32).for_each(|row| row_of[dictionary.location(row) as usize] = row);
        let mut measured = Self { of_pixel: HashMap::new(), light, rows: row_of };
        let mut of_row: HashMap<usize, Vec<Edge>> = HashMap::new();
        for edge in edges {
            of_row.entry(edge.pixel / size.0 / BLOCK_HEIGHT).or_default().push(edge);
        }
        let (columns, rows) = (size.0.div_ceil(BLOCK_WIDTH), size.1.div_ceil(BLOCK_HEIGHT));
        let of_block = 3 * patterns.len() * BLOCK_PIXELS;
        for by in 0..rows {
            progress(by as u64, rows as u64)?;
            let Some(edges) = of_row.remove(&by) else { continue };
            let mut responses = vec![0.0f32; columns * of_block];
            photographs.fill(by, 0..columns, &mut responses)?;
            let room = || (solver.scratch(), Terms::default());
            let again = |(scratch, terms): &mut (Scratch, Terms), edge: &Edge| {
                let (x, y) = (edge.pixel % size.0, edge.pixel / size.0);
                let k = y % BLOCK_HEIGHT * BLOCK_WIDTH + x % BLOCK_WIDTH;
                let own = &responses[x / BLOCK_WIDTH * of_block + k..][..of_block - k];
                let response: Vec<f32> = own.iter().copied().step_by(BLOCK_PIXELS).collect();
                measured.again(solver, (scratch, terms), edge, response)
            };
            let found: Vec<Edge> = edges.par_iter().map_init(room, again).collect();
            measured.of_pixel.extend(found.into_iter().map(|edge| (edge.pixel, edge)));
        }
        Ok(measured)
    }

    /// What more of each texel a pixel sees; none for pixels that are no edges.
    pub fn more(&self, pixel: usize) -> &[(u32, f32)] {
        self.of_pixel.get(&pixel).map_or(&[], |edge| &edge.texels)
    }

    /// Takes it out of a pixel's answers, `[3][patterns]`.
    pub(super) fn take_out(&self, pixel: usize, response: &mut [f32]) {
        if let Some(edge) = self.of_pixel.get(&pixel) {
            self.subtract(edge, &edge.texels, response);
        }
    }

    fn subtract(&self, edge: &Edge, texels: &[(u32, f32)], response: &mut [f32]) {
        let patterns = response.len() / 3;
        for (channel, white) in response.chunks_exact_mut(patterns).zip(edge.white) {
            for (texel, share) in texels {
                let light = &self.light[texel];
                channel.iter_mut().zip(light).for_each(|(v, light)| *v -= share * white * light);
            }
        }
    }

    /// An edge with what was not taken out in place of what was.
    fn again(
        &self,
        solver: &Solver,
        (scratch, terms): (&mut Scratch, &mut Terms),
        edge: &Edge,
        mut response: Vec<f32>,
    ) -> Edge {
        let mut more: Vec<(u32, f32)> = edge.texels.iter().map(|(texel, _)| (*texel, 0.0)).collect();
        let Some(fit) = self.fit(edge) else { return Edge { texels: Vec::new(), ..edge.clone() } };
        for _ in 0..ROUNDS {
            terms.clear();
            solver.solve(scratch, &response, None, terms);
            // What the object does not explain, and what it is taken to answer to these texels.
            let (mut left, answers) = self.without_object(solver, edge, terms, &response);
            let back: Vec<(u32, f32)> = edge.texels.iter().zip(answers).map(|((texel, _), t)| (*texel, -t)).collect();
            self.subtract(edge, &back, &mut left);
            let found = fit.solve(&self.against(edge, &left));
            let mut step = Vec::with_capacity(more.len());
            for (((texel, taken), (_, so_far)), change) in edge.texels.iter().zip(&mut more).zip(found.iter()) {
                // Nothing is seen less than not at all.
                let change = (*change as f32).max(-(taken + *so_far));
                *so_far += change;
                step.push((*texel, change));
            }
            self.subtract(edge, &step, &mut response);
        }
        Edge { texels: more, ..edge.clone() }
    }

    /// Least squares for the shares of an edge's texels; none where it has none.
    fn fit(&self, edge: &Edge) -> Option<Cholesky<f64, Dyn>> {
        let weight: f64 = edge.white.iter().map(|white| f64::from(white * white)).sum();
        let column = |n: usize| &self.light[&edge.texels[n].0];
        let count = edge.texels.len();
        let mut normal = DMatrix::from_fn(count, count, |i, j| weight * dot(column(i), column(j)));
        let ridge = RIDGE * normal.trace() / count.max(1) as f64;
        (0..count).for_each(|n| normal[(n, n)] += ridge);
        if count == 0 { None } else { Cholesky::new(normal) }
    }

    fn against(&self, edge: &Edge, left: &[f32]) -> DVector<f64> {
        let patterns = left.len() / 3;
        let of = |(texel, _): &(u32, f32)| {
            let channels = left.chunks_exact(patterns).zip(edge.white);
            channels.map(|(channel, white)| f64::from(white) * dot(channel, &self.light[texel])).sum()
        };
        DVector::from_iterator(edge.texels.len(), edge.texels.iter().map(of))
    }

    /// The answers less those of some terms, and the terms' answer to each of the edge's texels, in units of white.
    fn without_object(&self, solver: &Solver, edge: &Edge, terms: &Terms, response: &[f32]) -> (Vec<f32>, Vec<f32>) {
        let dictionary = solver.dictionary();
        let mut left = response.to_vec();
        let patterns = left.len() / 3;
        let mut function = vec![0.0f32; 3 * self.rows.len()];
        for (location, rgb) in terms.locations.iter().zip(&terms.coefficients) {
            function[3 * *location as usize..][..3].copy_from_slice(rgb);
            let row = &dictionary.rows(self.rows[*location as usize], 1)[..patterns];
            for (channel, c) in left.chunks_exact_mut(patterns).zip(rgb) {
                channel.iter_mut().zip(row).for_each(|(v, w)| *v -= c * w);
            }
        }
        dictionary.transform().inverse(&mut function, 3);
        let answer = |(texel, _): &(u32, f32)| {
            let rgb = &function[3 * *texel as usize..][..3];
            rgb.iter().zip(edge.white).map(|(t, white)| t / white.max(f32::MIN_POSITIVE)).sum::<f32>() / 3.0
        };
        let answers = edge.texels.iter().map(answer).collect();
        (left, answers)
    }
}

fn dot(a: &[f32], b: &[f32]) -> f64 {
    a.iter().zip(b).map(|(a, b)| f64::from(a * b)).sum()
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::acquire::implicit::{Dictionary, Options};
    use crate::domain::Plane;
    use crate::domain::patterns::{Kind, Noise, PatternSet};
    use crate::image::Image;
    use crate::wavelet::Wavelet;

    /// A pixel that sees 0.35 and 0.1 of two texels beside a smooth answer of the object; stripes had told 0.2 and 0.2.
    #[test]
    fn what_stripes_missed_of_the_screen_is_found() {
        let (plane, size, pixel) = (Plane::new(16, 16).unwrap(), (16, 8), (3, 2));
        let noise = Noise { wavelet: Wavelet::Haar, count: 128, seed: 3, deviation: Noise::DEVIATION };
        let set = PatternSet::new(Kind::Noise(noise), plane).unwrap();
        let patterns: Vec<Pattern> = (0..set.len()).map(|n| set.pattern(n)).collect();
        let dictionary = Dictionary::new(&plane.transform(Wavelet::Haar).unwrap(), &patterns).unwrap();
        let solver = Solver::new(Arc::new(dictionary), Options { terms: 24, ..Options::default() }).unwrap();
        let smooth = |texel: usize| 0.002 * (1.0 + plane.place(texel).0 as f32 / 16.0);
        let (seen, told) = ([(37, 0.35), (38, 0.1)], [(37, 0.2), (38, 0.2)]);
        let white = [1.0, 0.9, 0.8];
        let mut photographs = Photographs::new(size.0, size.1, std::path::Path::new("."));
        for pattern in &patterns {
            let object: f32 = pattern.values.iter().enumerate().map(|(texel, light)| smooth(texel) * light).sum();
            let screen: f32 = (0..2).map(|n| (seen[n].1 - told[n].1) * pattern.values[seen[n].0 as usize]).sum();
            let answer = white.map(|white| object + white * screen);
            let picture = Image::from_fn(size.0, size.1, |x, y| if (x, y) == pixel { answer } else { [0.0; 3] });
            photographs.push(picture).unwrap();
        }
        let edge = Edge { pixel: pixel.1 * size.0 + pixel.0, texels: told.to_vec(), white };
        let at = edge.pixel;
        let told_of = &mut |_, _| Ok(());
        let edges = Edges::measured(&solver, &mut photographs, size, (vec![edge], &patterns), told_of).unwrap();
        for ((_, more), (seen, told)) in edges.more(at).iter().zip(seen.iter().zip(&told)) {
            assert!((more - (seen.1 - told.1)).abs() < 0.01, "{more} more of {} where {} was told", seen.1, told.1);
        }
        assert_eq!((edges.more(at).len(), edges.more(at + 1).len()), (2, 0));
    }
}
