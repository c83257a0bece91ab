//! The monitor rig: a screen behind or beside the bodies, and `T` by its texels (6.3).
//!
//! `T` is the answer to unit radiance of one texel. What the camera sees of the screen itself, by mirrors and through glass, is
//! collected texel by texel where paths meet the screen. Rough surfaces answer smoothly, so they are kept by blocks of
//! texels: `integral over the block of f cos V cos' / r^2 dA`, a point in each of some 16 x 16 blocks for each camera ray,
//! coarser blocks after the first bounce.
//!
//! A pixel has at most 341 blocks, the texels that 64 rays and 16 paths or so through glass and mirrors find: 700 bytes on average
//! of [`Monitor::demo`] with 512 x 512 texels, 450 with 256 x 160.

use rand::RngExt;
use rand_pcg::Pcg32;
use rayon::prelude::*;

use crate::error::{Error, Result};

use super::blocks::Blocks;
use super::camera::Camera;
use super::grids::{Grids, Node};
use super::lamps::gather;
use super::material::Rgb;
use super::rows::{Row, Rows};
use super::sampling::Spread;
use super::scene::Scene;
use super::shape::{Bundle, Ray};
use super::stage::{Quality, scramble};
use super::tracer::{Collector, Tracer, Vertex};
use super::{Progress, V3};

/// Blocks across and down the screen that rough surfaces see, unless a rig says otherwise: answers of our scenes change
/// little within one, and a glossy lobe of width 0.3 covers several.
pub(super) const ACROSS: usize = 16;
/// A point in each is looked at from every surface: more would never end.
const MOST_ACROSS: usize = 1024;
/// The same after a bounce.
const LATER_ACROSS: usize = 4;

/// A flat screen in the stage frame that shines to one side, evenly into all directions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ScreenPlane {
    /// Its middle.
    pub centre: V3,
    /// From the middle to the middle of its right edge, as one sees it who looks at it.
    pub right: V3,
    /// From the middle to the middle of its upper edge, at right angles to `right`.
    pub up: V3,
}

impl ScreenPlane {
    /// The unit normal, on the side that shines.
    pub fn normal(&self) -> V3 {
        self.right.cross(&self.up).normalize()
    }

    /// The point at shares of the width from the left and of the height from the top.
    pub fn point(&self, u: f32, v: f32) -> V3 {
        self.centre + self.right * (2.0 * u - 1.0) + self.up * (1.0 - 2.0 * v)
    }

    /// Its area.
    pub fn area(&self) -> f32 {
        4.0 * self.right.norm() * self.up.norm()
    }

    /// Where a ray meets the side that shines, as in [`Self::point`].
    pub(super) fn hit(&self, ray: &Ray) -> Option<(f32, f32)> {
        let normal = self.normal();
        let against = ray.direction.dot(&normal);
        let t = (self.centre - ray.origin).dot(&normal) / against;
        if !(against < 0.0 && t > 0.0) {
            return None;
        }
        let to = ray.at(t) - self.centre;
        let u = 0.5 + 0.5 * to.dot(&self.right) / self.right.norm_squared();
        let v = 0.5 - 0.5 * to.dot(&self.up) / self.up.norm_squared();
        ((0.0..1.0).contains(&u) && (0.0..1.0).contains(&v)).then_some((u, v))
    }
}

/// A screen, the bodies before it, and the camera.
#[derive(Debug, Clone, PartialEq)]
pub struct Monitor {
    /// The bodies, all on the side of the screen that shines.
    pub scene: Scene,
    /// The camera.
    pub camera: Camera,
    /// Where the screen is.
    pub screen: ScreenPlane,
    /// Texels across and down: columns from the left, rows from the top.
    pub texels: (usize, usize),
    /// Blocks across and down the screen that rough surfaces see; the work goes with their square.
    pub blocks: usize,
}

impl Monitor {
    /// The same without bodies: the bare screen.
    pub fn bare(&self) -> Self {
        Self { scene: Scene::default(), ..self.clone() }
    }

    /// Its texels as grids.
    pub fn grids(&self) -> Grids {
        Grids { columns: self.texels.0, rows: self.texels.1, layers: 1 }
    }

    /// Checks what it is made of; ask once, where the figures come in.
    ///
    /// # Errors
    /// [`Error::Invalid`] at `place`: no texels or too many, no camera, a screen without area or with a skew corner, a body that
    /// reaches through the screen.
    pub fn check(&self, place: &str) -> Result<()> {
        self.grids().check(&format!("{place}, texels"))?;
        self.camera.check(&format!("{place}, camera"))?;
        if !(1..=MOST_ACROSS).contains(&self.blocks) {
            let expected = format!("1 to {MOST_ACROSS} across the screen");
            return Err(Error::invalid(format!("{place}, blocks"), self.blocks.to_string(), expected));
        }
        let ScreenPlane { centre, right, up } = &self.screen;
        let sides = right.norm() * up.norm();
        let finite = [centre, right, up].iter().all(|v| v.iter().all(|x| x.is_finite()));
        if !(finite && sides > 0.0 && right.dot(up).abs() < 1e-4 * sides) {
            let found = format!("right {:?}, up {:?}", right.as_slice(), up.as_slice());
            return Err(Error::invalid(format!("{place}, screen"), found, "two sides at right angles, neither zero"));
        }
        let normal = self.screen.normal();
        for (n, object) in self.scene.objects.iter().enumerate() {
            let depth = object.shape.reach(&-normal) + centre.dot(&normal);
            if depth > 0.0 {
                let found = format!("it reaches {depth} behind the screen");
                return Err(Error::invalid(format!("{place}, body {}", n + 1), found, "bodies before the screen"));
            }
        }
        Ok(())
    }

    /// Traces `T`; the same for the same quality, whatever the number of threads. `quality.stride` is not used.
    ///
    /// # Errors
    /// As [`Self::check`]; what `progress` returns, to stop.
    pub fn trace(&self, quality: &Quality, progress: &mut Progress<'_>) -> Result<Rows> {
        self.check("monitor")?;
        let tracer = Tracer::new(&self.scene, quality.effort());
        let pixel = |collector: &mut ScreenCollector<'_>, x: usize, y: usize| -> Row {
            collector.begin(scramble(quality.seed, x, y));
            tracer.pixel(&self.camera, x, y, quality.seed, collector);
            let weight = quality.samples as f32 / RAYS as f32;
            self.direct_rays(x, y).for_each(|ray| collector.sharp(&ray, [weight; 3]));
            collector.blocks.row(1.0 / quality.samples as f32)
        };
        trace_rows(&self.camera, self.grids(), || ScreenCollector::new(self), pixel, progress)
    }

    /// Share of each pixel that shows the screen itself, from the same rays as in [`Self::trace`]; row 0 at the top.
    pub fn directly_seen(&self) -> Vec<f32> {
        let (width, height) = (self.camera.width, self.camera.height);
        let meets = |ray: &Ray| self.screen.hit(ray).is_some();
        let share = |at: usize| self.direct_rays(at % width, at / width).filter(meets).count() as f32 / RAYS as f32;
        (0..width * height).into_par_iter().map(share).collect()
    }

    /// Those of a pixel's rays, evenly spread, that meet no body. They are not the tracer's, of which a few do: an edge of
    /// the screen is sharper than anything that bodies show.
    fn direct_rays(&self, x: usize, y: usize) -> impl Iterator<Item = Ray> {
        let sub = |k: usize| (k as f32 + 0.5) / ACROSS_PIXEL as f32;
        let ray = move |k| self.camera.ray(x as f32 + sub(k % ACROSS_PIXEL), y as f32 + sub(k / ACROSS_PIXEL));
        (0..RAYS).map(ray).filter(|ray| self.scene.hit(ray).is_none())
    }
}

/// Rays across a pixel, and in it, that look for the screen itself.
const ACROSS_PIXEL: usize = 8;
const RAYS: usize = ACROSS_PIXEL * ACROSS_PIXEL;

/// Rows of pixels traced before progress is told.
const BAND: usize = 4;

/// Traces all pixels of a picture; `collector` makes the state of a thread.
pub(super) fn trace_rows<C: Send>(
    camera: &Camera,
    grids: Grids,
    collector: impl Fn() -> C + Sync + Send,
    pixel: impl Fn(&mut C, usize, usize) -> Row + Sync + Send,
    progress: &mut Progress<'_>,
) -> Result<Rows> {
    let (width, height) = (camera.width, camera.height);
    let mut rows = Rows::new(width, height, grids);
    for top in (0..height).step_by(BAND) {
        let band = width * top..width * (top + BAND).min(height);
        let traced: Vec<Row> =
            band.into_par_iter().map_init(&collector, |state, at| pixel(state, at % width, at / width)).collect();
        traced.iter().for_each(|row| rows.push(row));
        progress((top + BAND).min(height) as u64, height as u64)?;
    }
    Ok(rows)
}

/// A level of the screen's blocks as surfaces see it.
#[derive(Debug)]
struct Tiling {
    level: usize,
    columns: usize,
    rows: usize,
    /// Where blocks start and end across and down, in shares of the screen.
    across: Vec<(f32, f32)>,
    down: Vec<(f32, f32)>,
    /// Room for the directions from a vertex to all blocks, and what a point of the block counts.
    directions: Bundle,
    visible: Vec<f32>,
    factors: Vec<f32>,
}

impl Tiling {
    fn new(grids: Grids, across: usize) -> Self {
        let level = grids.level_of(across);
        let (columns, rows) = grids.size(level);
        let shares = |count: usize, of: usize, take: &dyn Fn(usize) -> std::ops::Range<usize>| -> Vec<(f32, f32)> {
            (0..count).map(take).map(|r| (r.start as f32 / of as f32, r.end as f32 / of as f32)).collect()
        };
        let node = |column: usize, row: usize| grids.covered(Node { level, layer: 0, column, row });
        let zeros = vec![0.0; columns * rows];
        let directions = Bundle { x: zeros.clone(), y: zeros.clone(), z: zeros.clone() };
        Self {
            level,
            columns,
            rows,
            across: shares(columns, grids.columns, &|n| node(n, 0)[0].clone()),
            down: shares(rows, grids.rows, &|n| node(0, n)[1].clone()),
            directions,
            visible: zeros.clone(),
            factors: zeros,
        }
    }

    /// Aims at the same place `u` of every block: directions, and `cos' / r^2` times the block's area.
    fn aim(&mut self, screen: &ScreenPlane, from: &V3, u: [f32; 2]) {
        let (normal, area) = (screen.normal(), screen.area());
        for (row, (top, bottom)) in self.down.iter().enumerate() {
            let left = screen.point(0.0, top + (bottom - top) * u[1]) - from;
            for (column, (west, east)) in self.across.iter().enumerate() {
                let to = left + screen.right * (2.0 * (west + (east - west) * u[0]));
                let r2 = to.norm_squared();
                let direction = to / r2.sqrt();
                let at = row * self.columns + column;
                (self.directions.x[at], self.directions.y[at], self.directions.z[at]) =
                    (direction.x, direction.y, direction.z);
                let share = (bottom - top) * (east - west);
                self.factors[at] = (-normal.dot(&direction)).max(0.0) / r2 * area * share;
            }
        }
    }
}

/// Collects the light of one pixel by texel.
struct ScreenCollector<'a> {
    monitor: &'a Monitor,
    blocks: Blocks,
    first: Tiling,
    later: Tiling,
    spread: Spread,
}

impl<'a> ScreenCollector<'a> {
    fn new(monitor: &'a Monitor) -> Self {
        let grids = monitor.grids();
        let (first, later) = (Tiling::new(grids, monitor.blocks), Tiling::new(grids, LATER_ACROSS.min(monitor.blocks)));
        Self { monitor, blocks: Blocks::new(grids, first.level), first, later, spread: Spread::new(0) }
    }

    fn begin(&mut self, turn: u64) {
        self.blocks.clear();
        self.spread = Spread::new(turn.wrapping_mul(0x9e37_79b9_7f4a_7c15));
    }

    /// The texel that a ray meets.
    fn texel(&self, ray: &Ray) -> Option<(usize, usize)> {
        let (u, v) = self.monitor.screen.hit(ray)?;
        let (columns, rows) = self.monitor.texels;
        let (column, row) = ((u * columns as f32) as usize, (v * rows as f32) as usize);
        Some((column.min(columns - 1), row.min(rows - 1)))
    }

    fn sharp(&mut self, ray: &Ray, weight: Rgb) {
        if let Some((column, row)) = self.texel(ray) {
            self.blocks.add_sharp((row * self.monitor.texels.0 + column) as u32, weight);
        }
    }
}

impl Collector for ScreenCollector<'_> {
    fn direct(&mut self, scene: &Scene, vertex: &Vertex, weight: &Rgb, first: bool, rng: &mut Pcg32) {
        let screen = &self.monitor.screen;
        // A surface sees nothing of a screen whose corners lie below its horizon.
        let above = |u, v| vertex.scatter.normal().dot(&(screen.point(u, v) - vertex.point)) > 0.0;
        if ![(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)].iter().any(|(u, v)| above(*u, *v)) {
            return;
        }
        let (tiling, u) =
            if first { (&mut self.first, self.spread.next()) } else { (&mut self.later, [rng.random(), rng.random()]) };
        tiling.aim(screen, &vertex.point, u);
        let directions = tiling.directions.slice(0..tiling.columns * tiling.rows);
        scene.visible(&vertex.point, vertex.object, directions, &mut tiling.visible);
        tiling.visible.iter_mut().zip(&tiling.factors).for_each(|(v, f)| *v *= f);
        gather(vertex, weight, directions, &tiling.visible, self.blocks.planes(tiling.level));
    }

    fn leave(&mut self, ray: &Ray, weight: &Rgb, first: bool) {
        if first {
            self.sharp(ray, *weight);
        } else if let Some((column, row)) = self.texel(ray) {
            self.blocks.add(self.first.level, [column, row, 0], weight);
        }
    }
}
