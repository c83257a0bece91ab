//! The gantry: a projector that is carried to many positions about the bodies, and `T` by its squares (7.3).
//!
//! `T` is the answer to unit radiant intensity of one square from one position; element
//! `(position * n + row) * n + column`, rows and columns as the projector itself would see them. A surface answers
//! `f cos V / d^2`. The projector's lens is a small disc that evenly shines, so that shadows have its softness and mirrors and the
//! camera see it: its radiance is `I / (A cos)`, `A` its area and `cos` at it. Its picture is sharp at any distance.
//!
//! Light that comes over other surfaces is smooth over the squares and is kept by blocks of them. A pixel of [`Gantry::demo`] with
//! 24 positions and 16 x 16 squares has 250 bytes on average.

use rand::RngExt;
use rand_pcg::Pcg32;
use std::f32::consts::PI;

use crate::domain::{self, Filter};
use crate::error::{Error, Result};
use crate::math::Vec3;

use super::blocks::Blocks;
use super::camera::Camera;
use super::grids::Grids;
use super::lamps::gather;
use super::material::Rgb;
use super::monitor::trace_rows;
use super::rows::{Row, Rows};
use super::sampling::Spread;
use super::scene::Scene;
use super::shape::{Bundle, Ray};
use super::stage::{Quality, scramble};
use super::tracer::{Collector, Tracer, Vertex, times};
use super::{Progress, V3};

/// Blocks across and down the squares of one position for light over other surfaces, unless a rig says otherwise.
pub(super) const LATER_ACROSS: usize = 4;
/// What mirrors and glass throw on surfaces is gathered by a lens at least this wide, as a share of its distance: rays
/// that meet a smaller one by chance are too few, and caustics softer by 6 degrees are caustics still.
pub(super) const CAUSTIC: f32 = 0.1;

/// A projector at one position.
#[derive(Debug, Clone, Copy)]
pub(super) struct Stand {
    pub place: V3,
    /// To the origin, and to the right and the top of its picture.
    pub axis: V3,
    pub right: V3,
    pub up: V3,
}

impl Stand {
    pub fn new(place: V3) -> Self {
        let axis = -place.normalize();
        // From straight above or below, the top of the picture is away from the camera.
        let upright = if axis.y.abs() > 0.9999 { -V3::z() } else { V3::y() };
        let right = axis.cross(&upright).normalize();
        Self { place, axis, right, up: right.cross(&axis) }
    }

    /// Where a ray meets its lens of this radius from the front: the cosine there.
    fn hit(&self, ray: &Ray, radius: f32) -> Option<f32> {
        let cos = -ray.direction.dot(&self.axis);
        let t = (self.place - ray.origin).dot(&self.axis) / -cos;
        (cos > 0.0 && t > 0.0 && (ray.at(t) - self.place).norm_squared() < radius * radius).then_some(cos)
    }
}

/// A projector, its positions, the bodies, and the camera.
#[derive(Debug, Clone, PartialEq)]
pub struct Gantry {
    /// The bodies.
    pub scene: Scene,
    /// The camera.
    pub camera: Camera,
    /// Where the projector's lens comes to stand; it looks at the origin, the top of its picture towards +y.
    pub positions: Vec<V3>,
    /// Angle across its square picture, radians.
    pub view_rad: f32,
    /// n: its picture has n x n squares, equal on a plane.
    pub squares: usize,
    /// Radius of its lens, scene units.
    pub lens_radius: f32,
    /// Blocks across and down its squares for light over other surfaces, at most.
    pub blocks: usize,
}

impl Gantry {
    /// Its squares as grids.
    pub fn grids(&self) -> Grids {
        Grids { columns: self.squares, rows: self.squares, layers: self.positions.len() }
    }

    /// Its positions and squares as a field has them.
    ///
    /// # Errors
    /// As [`Self::check`].
    pub fn domain(&self) -> Result<domain::Gantry> {
        self.check("gantry")?;
        let places: Vec<Vec3> = self.positions.iter().map(|place| place.cast()).collect();
        domain::Gantry::looking_at_origin(&places, self.squares, f64::from(self.view_rad), Filter::Box)
    }

    /// Checks what it is made of; ask once, where the figures come in.
    ///
    /// # Errors
    /// [`Error::Invalid`] at `place`: no squares or positions or too many, no camera, a position in the origin, a view that no lens has,
    /// a lens without area.
    pub fn check(&self, place: &str) -> Result<()> {
        self.grids().check(&format!("{place}, squares"))?;
        self.camera.check(&format!("{place}, camera"))?;
        if !(self.view_rad > 0.0 && self.view_rad < 0.9 * PI) {
            let found = format!("{:.3} degrees", self.view_rad.to_degrees());
            return Err(Error::invalid(format!("{place}, view"), found, "more than 0 and less than 162 degrees"));
        }
        if !(self.lens_radius > 0.0 && self.lens_radius.is_finite()) {
            return Err(Error::invalid(format!("{place}, lens"), self.lens_radius.to_string(), "a radius above 0"));
        }
        for (n, position) in self.positions.iter().enumerate() {
            if !(position.norm().is_finite() && position.norm() > self.lens_radius) {
                let found = format!("{:?}", position.as_slice());
                let expected = "a place farther from the origin than the lens is wide";
                return Err(Error::invalid(format!("{place}, position {}", n + 1), found, expected));
            }
        }
        Ok(())
    }

    /// Traces `T`; the same for the same quality, whatever the number of threads.
    ///
    /// # Errors
    /// As [`Self::check`]; what `progress` returns, to stop.
    pub fn trace(&self, quality: &Quality, progress: &mut Progress<'_>) -> Result<Rows> {
        self.check("gantry")?;
        let tracer = Tracer::new(&self.scene, quality.effort());
        let pixel = |collector: &mut LensCollector<'_>, x: usize, y: usize| -> Row {
            collector.begin(scramble(quality.seed, x, y));
            tracer.pixel(&self.camera, x, y, quality.seed, collector);
            collector.blocks.row(1.0 / quality.samples as f32)
        };
        let stride = quality.stride.clamp(1, self.positions.len());
        trace_rows(&self.camera, self.grids(), || LensCollector::new(self, stride), pixel, progress)
    }
}

/// Collects the light of one pixel by position and square.
struct LensCollector<'a> {
    gantry: &'a Gantry,
    stands: Vec<Stand>,
    /// Half the width of the picture at distance 1.
    reach: f32,
    blocks: Blocks,
    level: usize,
    stride: usize,
    spread: Spread,
    /// Room for the directions to the lenses of a run of stands, and what comes from them.
    directions: Bundle,
    visible: Vec<f32>,
    light: [Vec<f32>; 3],
}

impl<'a> LensCollector<'a> {
    fn new(gantry: &'a Gantry, stride: usize) -> Self {
        let grids = gantry.grids();
        let level = grids.level_of(gantry.blocks.max(1));
        Self {
            gantry,
            stands: gantry.positions.iter().map(|place| Stand::new(*place)).collect(),
            reach: (0.5 * gantry.view_rad).tan(),
            blocks: Blocks::new(grids, level),
            level,
            stride,
            spread: Spread::new(0),
            directions: Bundle::default(),
            visible: Vec::new(),
            light: Default::default(),
        }
    }

    fn begin(&mut self, turn: u64) {
        self.blocks.clear();
        self.spread = Spread::new(turn.wrapping_mul(0x9e37_79b9_7f4a_7c15));
    }

    /// The square, column and row, in which a stand sees a point.
    fn square(&self, stand: usize, point: &V3) -> Option<(usize, usize)> {
        let Stand { place, axis, right, up } = &self.stands[stand];
        let to = point - place;
        let half = to.dot(axis) * self.reach;
        let (u, v) = (0.5 + 0.5 * to.dot(right) / half, 0.5 - 0.5 * to.dot(up) / half);
        if !(half > 0.0 && (0.0..1.0).contains(&u) && (0.0..1.0).contains(&v)) {
            return None;
        }
        let n = self.gantry.squares;
        Some((((u * n as f32) as usize).min(n - 1), ((v * n as f32) as usize).min(n - 1)))
    }

    /// Adds light of the square of a stand that lights `point`.
    fn add(&mut self, stand: usize, point: &V3, light: &Rgb, sharp: bool) {
        let Some((column, row)) = self.square(stand, point) else { return };
        let n = self.gantry.squares;
        if sharp {
            self.blocks.add_sharp(((stand * n + row) * n + column) as u32, *light);
        } else {
            self.blocks.add(self.level, [column, row, stand], light);
        }
    }

    /// Aims at the same place of the lens, polar, of every `step`-th stand from `first` on: directions, and `1 / d^2`.
    fn aim(&mut self, from: &V3, [radius, angle]: [f32; 2], stands: impl Iterator<Item = usize>) {
        self.directions = Bundle::default();
        self.visible.clear();
        let (sin, cos) = (2.0 * PI * angle).sin_cos();
        let out = self.gantry.lens_radius * radius.sqrt();
        for n in stands {
            let stand = &self.stands[n];
            let to = stand.place + stand.right * (out * cos) + stand.up * (out * sin) - from;
            let r2 = to.norm_squared();
            self.directions.push(to / r2.sqrt());
            self.visible.push(1.0 / r2);
        }
    }
}

impl Collector for LensCollector<'_> {
    fn direct(&mut self, scene: &Scene, vertex: &Vertex, weight: &Rgb, first: bool, rng: &mut Pcg32) {
        let (start, step, u) = if first {
            (0, 1, self.spread.next())
        } else {
            (rng.random_range(0..self.stride), self.stride, [rng.random(), rng.random()])
        };
        let count = self.stands.len();
        let stands = (start..count).step_by(step);
        self.aim(&vertex.point, u, stands.clone());
        let directions = self.directions.slice(0..self.visible.len());
        let factors = self.visible.clone();
        scene.visible(&vertex.point, vertex.object, directions, &mut self.visible);
        self.visible.iter_mut().zip(&factors).for_each(|(v, f)| *v *= f);
        let mut light = std::mem::take(&mut self.light);
        light.iter_mut().for_each(|plane| {
            plane.clear();
            plane.resize(factors.len(), 0.0);
        });
        let [r, g, b] = &mut light;
        gather(vertex, &weight.map(|w| w * step as f32), directions, &self.visible, [r, g, b]);
        for (n, stand) in stands.enumerate() {
            let colour = [light[0][n], light[1][n], light[2][n]];
            if colour != [0.0; 3] {
                self.add(stand, &vertex.point, &colour, first);
            }
        }
        self.light = light;
    }

    fn leave(&mut self, ray: &Ray, weight: &Rgb, first: bool) {
        for n in 0..self.stands.len() {
            let own = self.gantry.lens_radius;
            let radius = if first { own } else { own.max(CAUSTIC * self.stands[n].place.norm()) };
            if let Some(cos) = self.stands[n].hit(ray, radius) {
                let light = times(weight, &[1.0; 3], 1.0 / (PI * radius * radius * cos));
                self.add(n, &ray.origin, &light, first);
            }
        }
    }
}
