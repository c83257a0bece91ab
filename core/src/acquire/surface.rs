//! Normals and albedo of what was photographed, from its reflectance functions.
//!
//! One pass over the field, block by block; each pixel on its own (`stereo`). Lamps count by the solid angle that they
//! stand for, so that a set that is dense on one side does not lean there.

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg32;
use rayon::prelude::*;

use super::stereo::{Estimator, Facet, Lamps, Room};
use crate::domain::Directions;
use crate::error::{Error, Result};
use crate::field::{Asset, BLOCK_HEIGHT, BLOCK_PIXELS, BLOCK_WIDTH, BlockBuffer, Samples};
use crate::image::Image;
use crate::math::Vec3;

/// Lamps that the search for a start looks at; the rest only refine it.
const SAMPLE: usize = 192;
/// Points a lamp of the lattice that measures solid angles: a cell is right to about its boundary over its area, 3 %, which is ample for
/// weights.
const POINTS_A_LAMP: usize = 64;
/// Start of the numbers that pick the sample.
const SEED: u64 = 0x51;

/// Normals and albedo of every pixel.
#[derive(Debug, Clone, PartialEq)]
pub struct Surface {
    /// Unit normals in the stage frame (+x right, +y up, +z to the camera); zero where unreliable.
    pub normals: Image,
    /// Diffuse albedo, linear RGB, 1 for a perfect white; not clamped, and zero where unreliable. A pixel that the object covers
    /// in part has its share of it: premultiplied.
    pub albedo: Image,
    /// Pixels of the object: all, or those with coverage.
    pub pixels: usize,
    /// Those of them with a normal.
    pub reliable: usize,
}

/// Photometric stereo over an asset; `progress(rows of blocks done, all)` may stop it. Memory: a block of floats a thread, and
/// the two pictures.
///
/// # Errors
/// Fewer than 4 lamp directions, or all of them in one plane; bytes that cannot be read; what `progress` returns.
pub fn surface(asset: &Asset, progress: &mut dyn FnMut(u64, u64) -> Result<()>) -> Result<Surface> {
    let place = || asset.path().display().to_string();
    let estimator =
        estimator(asset.directions()?).map_err(|(found, expected)| Error::invalid(place(), found, expected))?;
    let (width, height) = (asset.width(), asset.height());
    let mut surface =
        Surface { normals: Image::new(width, height, 3), albedo: Image::new(width, height, 3), pixels: 0, reliable: 0 };
    let samples = asset.samples()?;
    let layout = samples.layout();
    let inside = |x: usize, y: usize| asset.alpha().is_none_or(|alpha| alpha[y * width + x] > 0.0);
    surface.pixels = (0..width * height).filter(|i| inside(i % width, i / width)).count();
    for by in 0..layout.rows() {
        let row: Vec<Vec<Option<Facet>>> = (0..layout.columns())
            .into_par_iter()
            .map_init(Worker::default, |worker, bx| worker.block(&estimator, samples, (bx, by), &inside))
            .collect::<Result<_>>()?;
        for (bx, facets) in row.iter().enumerate() {
            for (k, facet) in facets.iter().enumerate() {
                let Some(facet) = facet else { continue };
                let (x, y) = (bx * BLOCK_WIDTH + k % BLOCK_WIDTH, by * BLOCK_HEIGHT + k / BLOCK_WIDTH);
                surface.normals.pixel_mut(x, y).copy_from_slice(&facet.normal);
                surface.albedo.pixel_mut(x, y).copy_from_slice(&facet.albedo);
                surface.reliable += 1;
            }
        }
        progress((by + 1) as u64, layout.rows() as u64)?;
    }
    Ok(surface)
}

/// What was found and what was expected.
type Complaint = (String, &'static str);

fn estimator(domain: &Directions) -> std::result::Result<Estimator, Complaint> {
    if domain.sites().len() < 4 {
        let found = format!("{} lamp directions", domain.sites().len());
        return Err((found, "at least 4: three determine a normal, one more tells whether to believe it"));
    }
    let gram: nalgebra::Matrix3<f64> = domain.sites().iter().map(|d| d * d.transpose()).sum();
    let third = gram.trace() / 3.0;
    // A plane to within a degree or so: the smallest eigenvalue is about the mean squared distance from it.
    if gram.determinant() < 1e-4 * third.powi(3) {
        return Err((
            "lamps that lie in one plane with the object".to_owned(),
            "lamps that surround it from the front",
        ));
    }
    let directions = domain.lamps().iter().map(|d| d.cast::<f32>());
    let all = Lamps::new(directions, &shares(domain));
    let sample = sample(all.len());
    Ok(Estimator::new(all, sample))
}

/// The share of the coverage that is nearest to each lamp; lamps at one place divide theirs.
fn shares(domain: &Directions) -> Vec<f32> {
    let sites = domain.sites().len();
    let mut counts = vec![0u32; sites];
    for point in lattice(POINTS_A_LAMP * sites) {
        if domain.covers(&point) {
            counts[domain.nearest_site(&point)] += 1;
        }
    }
    let mut shares = vec![0.0; domain.len()];
    for (members, count) in domain.members().iter().zip(counts) {
        // A cell that falls between the points of the lattice still has a lamp in it.
        let share = count.max(1) as f32 / members.len() as f32;
        members.iter().for_each(|lamp| shares[*lamp as usize] = share);
    }
    shares
}

/// A spherical Fibonacci lattice: equal areas (Gonzalez 2010).
fn lattice(count: usize) -> impl Iterator<Item = Vec3> {
    let golden = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    (0..count).map(move |i| {
        let z = 1.0 - (2 * i + 1) as f64 / count as f64;
        let (r, (sin, cos)) = ((1.0 - z * z).sqrt(), (golden * i as f64).sin_cos());
        Vec3::new(r * cos, r * sin, z)
    })
}

/// Numbers of [`SAMPLE`] lamps, drawn without regard to their order: lamps are listed ring by ring, and every k-th would be a
/// meridian.
fn sample(lamps: usize) -> Vec<u32> {
    let mut numbers: Vec<u32> = (0..lamps as u32).collect();
    if lamps > SAMPLE {
        let mut random = Pcg32::seed_from_u64(SEED);
        for i in 0..SAMPLE {
            numbers.swap(i, random.random_range(i..lamps));
        }
        numbers.truncate(SAMPLE);
        numbers.sort_unstable();
    }
    numbers
}

/// A thread's buffers.
#[derive(Default)]
struct Worker {
    buffer: BlockBuffer,
    channels: [Vec<f32>; 3],
    answers: [Vec<f32>; 3],
    room: Room,
}

impl Worker {
    /// The facets of a block's pixels; `None` outside the picture or the object, and where unreliable.
    fn block(
        &mut self,
        estimator: &Estimator,
        samples: Samples<'_>,
        (bx, by): (usize, usize),
        inside: &(impl Fn(usize, usize) -> bool + Sync),
    ) -> Result<Vec<Option<Facet>>> {
        let layout = samples.layout();
        for (c, floats) in self.channels.iter_mut().enumerate() {
            samples.read(bx, by, c, &mut self.buffer, floats)?;
        }
        self.answers.iter_mut().for_each(|answers| answers.resize(estimator.padded(), 0.0));
        let facet = |k: usize| {
            let (x, y) = (bx * BLOCK_WIDTH + k % BLOCK_WIDTH, by * BLOCK_HEIGHT + k / BLOCK_WIDTH);
            if x >= layout.width || y >= layout.height || !inside(x, y) {
                return None;
            }
            for (answers, floats) in self.answers.iter_mut().zip(&self.channels) {
                let of_pixel = floats.iter().skip(k).step_by(BLOCK_PIXELS);
                answers.iter_mut().zip(of_pixel).for_each(|(out, t)| *out = t * samples.scale());
            }
            let [r, g, b] = &self.answers;
            estimator.facet([r, g, b], &mut self.room)
        };
        Ok((0..BLOCK_PIXELS).map(facet).collect())
    }
}
