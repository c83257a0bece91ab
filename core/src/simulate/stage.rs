//! The stage: a scene, a camera and lamps, streamed as bands of `T`.

use std::ops::Range;

use rayon::prelude::*;

use crate::domain::Directions;
use crate::error::Result;
use crate::field::{BLOCK_HEIGHT, BLOCK_WIDTH, Bands};

use super::Progress;
use super::camera::Camera;
use super::lamps::{Cells, LampCollector};
use super::scene::Scene;
use super::tracer::{Effort, Tracer};

/// How much work goes into a pixel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Quality {
    /// Camera rays a pixel; each samples every lamp at the surface it meets. Powers of 4 stratify the cells best.
    pub samples: usize,
    /// Bounces towards other surfaces for each camera ray.
    pub bounces: usize,
    /// Later surfaces sample every k-th lamp of a stage, every k-th position of a gantry.
    pub stride: usize,
    /// Directions per steradian towards mirrors and glass, a pixel.
    pub cone_density: f32,
    /// Scattering events at most in a path.
    pub depth: usize,
    /// Start of the random numbers.
    pub seed: u64,
}

impl Default for Quality {
    /// What the demonstration uses.
    fn default() -> Self {
        Self { samples: 16, bounces: 16, stride: 2, cone_density: 10_000.0, depth: 6, seed: 1 }
    }
}

impl Quality {
    /// What the demonstration's [`truth`](super::truth) uses: more camera rays, and numbers of its own.
    pub fn truth() -> Self {
        Self { samples: 64, seed: 101, ..Self::default() }
    }

    /// What the virtual monitor and gantry use: a fraction of the default's work. Rows traced once are what these rigs are,
    /// so what noise there is in them is texture of the bodies, never an error of a photograph.
    pub fn rig() -> Self {
        Self { bounces: 8, stride: 4, cone_density: 2000.0, ..Self::default() }
    }

    pub(super) fn effort(&self) -> Effort {
        Effort { samples: self.samples, bounces: self.bounces, cone_density: self.cone_density, depth: self.depth }
    }
}

/// A scene under a set of lamps, each a distant light of uniform radiance that fills its Voronoi cell.
#[derive(Debug)]
pub struct Stage<'a> {
    scene: &'a Scene,
    camera: Camera,
    lamps: usize,
    cells: Cells,
    quality: Quality,
}

impl<'a> Stage<'a> {
    /// Sets up the cells: about half a second for 1500 lamps.
    pub fn new(scene: &'a Scene, camera: Camera, lamps: &Directions, quality: Quality) -> Self {
        let groups = quality.stride.clamp(1, lamps.sites().len());
        let cells = Cells::new(lamps, groups, quality.seed);
        Self { scene, camera, lamps: lamps.len(), cells, quality }
    }

    /// A bound on T for [`Contents::largest`](crate::field::Contents::largest): a pixel that shows the whole of one lamp
    /// has `1 / Omega_j`, no picture of a light of radiance 1 exceeds 1, and a factor of 4 is for noise. Larger values, should chance make one, are cut there.
    pub fn largest(&self) -> f32 {
        4.0 / self.cells.smallest()
    }

    /// The rows of `T`, for [`field::write`](crate::field::write).
    pub fn bands<'b>(&'b self, progress: &'b mut Progress<'b>) -> StageBands<'b> {
        StageBands { stage: self, progress }
    }

    /// `T` of the blocks from column `first` on in row `by`, laid out as [`Bands::fill`] says; the same whatever the number
    /// of threads.
    fn blocks(&self, by: usize, first: usize, blocks: &mut [f32]) {
        let tracer = Tracer::new(self.scene, self.quality.effort());
        let block = 3 * self.lamps * BLOCK_WIDTH * BLOCK_HEIGHT;
        blocks.par_chunks_mut(block).enumerate().for_each_init(
            || LampCollector::new(&self.cells),
            |collector, (n, out)| {
                let bx = first + n;
                for at in 0..BLOCK_WIDTH * BLOCK_HEIGHT {
                    let (x, y) = (bx * BLOCK_WIDTH + at % BLOCK_WIDTH, by * BLOCK_HEIGHT + at / BLOCK_WIDTH);
                    if x < self.camera.width && y < self.camera.height {
                        collector.begin(scramble(self.quality.seed, x, y));
                        tracer.pixel(&self.camera, x, y, self.quality.seed, collector);
                        self.store(collector, at, out);
                    }
                }
            },
        );
    }

    /// Puts a pixel into its block, `[channel][element][8][16]`.
    fn store(&self, collector: &LampCollector<'_>, at: usize, block: &mut [f32]) {
        let scale = 1.0 / self.quality.samples as f32;
        let largest = self.largest();
        for (channel, plane) in collector.sums().iter().enumerate() {
            for (site, &sum) in plane.iter().enumerate() {
                for &lamp in self.cells.lamps_of(site) {
                    let element = channel * self.lamps + lamp as usize;
                    block[element * BLOCK_WIDTH * BLOCK_HEIGHT + at] = (sum * scale).min(largest);
                }
            }
        }
    }
}

/// A number for a pixel that neighbours do not share.
pub(super) fn scramble(seed: u64, x: usize, y: usize) -> u64 {
    let mut h = seed ^ (x as u64) << 32 ^ y as u64;
    for _ in 0..2 {
        h = (h ^ h >> 31).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    }
    h >> 40
}

/// [`Stage`] as a source of bands. Memory: one band, given by the caller.
pub struct StageBands<'a> {
    stage: &'a Stage<'a>,
    progress: &'a mut Progress<'a>,
}

impl Bands for StageBands<'_> {
    fn fill(&mut self, by: usize, columns: Range<usize>, blocks: &mut [f32]) -> Result<()> {
        self.stage.blocks(by, columns.start, blocks);
        let (rows, across) = (self.stage.camera.height, self.stage.camera.width.div_ceil(BLOCK_WIDTH));
        if columns.end == across {
            (self.progress)(((by + 1) * BLOCK_HEIGHT).min(rows) as u64, rows as u64)?;
        }
        Ok(())
    }
}
