//! The scene lit directly by light that varies in space: what relighting a gantry's field is measured against.
//!
//! It shares scene, camera and paths with the gantry, not the light: no positions, no squares. Rays of points, suns and areas come with
//! a shadow ray from every surface that a path meets; the continuum is looked up along directions drawn from the scattering, and where
//! paths leave over mirrors and glass.
//!
//! Mirrors and glass show maps and probes, never points: these have no size. What they throw of points on surfaces is blurred by
//! [`CAUSTIC_RAD`], as the gantry has it. Sources stand farther from a surface than any body that shadows it: there is no body
//! behind a lamp.

use rand::RngExt;
use rand_pcg::Pcg32;
use rayon::prelude::*;

use crate::error::Result;
use crate::illumination::Incident;
use crate::image::Image;
use crate::math::Vec3;

use super::Progress;
use super::camera::Camera;
use super::material::Rgb;
use super::sampling::{Spread, Steps};
use super::scene::Scene;
use super::shape::Ray;
use super::stage::Quality;
use super::tracer::{Collector, Tracer, Vertex, times};

/// Directions into the continuum at a vertex that the camera sees; one at others.
const DRAWS: usize = 8;

/// Points have this radius, seen from where a path leaves a mirror or a glass that lights a surface: the share of its distance that
/// the gantry's lens has there.
const CAUSTIC_RAD: f64 = 0.1;

/// Collects the light of one pixel.
struct FieldCollector<'a> {
    light: &'a dyn Incident,
    continuum: bool,
    scatter: Spread,
    lobe: Steps,
    sum: Rgb,
}

impl FieldCollector<'_> {
    fn add(&mut self, light: &Rgb) {
        self.sum.iter_mut().zip(light).for_each(|(s, l)| *s += l);
    }

    /// Light of points: `f cos E`, where nothing is in between.
    fn rays(&mut self, scene: &Scene, vertex: &Vertex, weight: &Rgb) {
        let light = self.light;
        light.arriving(&vertex.point.cast(), &mut |towards, irradiance| {
            let direction = towards.cast();
            let scattered = vertex.scatter.towards(&direction);
            let light = times(&times(weight, &scattered, 1.0), &irradiance.map(|e| e as f32), 1.0);
            let ray = Ray { origin: vertex.point, direction };
            if light != [0.0; 3] && !scene.blocks(&ray, vertex.object) {
                self.add(&light);
            }
        });
    }

    /// One estimate of the continuum: `f cos L` over the density of the direction.
    fn draw(&mut self, scene: &Scene, vertex: &Vertex, weight: &Rgb, choice: f32, u: [f32; 2]) {
        let direction = vertex.scatter.draw(choice, u);
        let scattered = vertex.scatter.towards(&direction);
        let ray = Ray { origin: vertex.point, direction };
        if scattered == [0.0; 3] || scene.blocks(&ray, vertex.object) {
            return;
        }
        let radiance = self.light.radiance(&vertex.point.cast(), &direction.cast()).map(|l| l as f32);
        let density = vertex.scatter.density(&direction).max(f32::MIN_POSITIVE);
        self.add(&times(&times(weight, &scattered, 1.0 / density), &radiance, 1.0));
    }
}

impl Collector for FieldCollector<'_> {
    fn direct(&mut self, scene: &Scene, vertex: &Vertex, weight: &Rgb, first: bool, rng: &mut Pcg32) {
        self.rays(scene, vertex, weight);
        if !self.continuum {
            return;
        }
        if !first {
            return self.draw(scene, vertex, weight, rng.random(), rng.random());
        }
        for _ in 0..DRAWS {
            let (choice, u) = (self.lobe.next(), self.scatter.next());
            self.draw(scene, vertex, &weight.map(|w| w / DRAWS as f32), choice, u);
        }
    }

    fn leave(&mut self, ray: &Ray, weight: &Rgb, first: bool) {
        let (from, direction): (Vec3, Vec3) = (ray.origin.cast(), ray.direction.cast());
        let mut radiance = self.light.radiance(&from, &direction);
        if !first {
            // A disc of this radius and radiance `E / (pi r^2)`.
            let (rim, disc) = (CAUSTIC_RAD.cos(), std::f64::consts::PI * CAUSTIC_RAD * CAUSTIC_RAD);
            self.light.arriving(&from, &mut |towards, irradiance| {
                if towards.dot(&direction) > rim {
                    radiance.iter_mut().zip(irradiance).for_each(|(l, e)| *l += e / disc);
                }
            });
        }
        self.add(&times(weight, &radiance.map(|l| l as f32), 1.0));
    }
}

/// The scene lit by a light field: a picture in RGB, premultiplied, the light itself not seen behind the objects. `quality.stride` is
/// not used: every vertex asks for every ray, so large areas take time. The same whatever the number of threads.
///
/// # Errors
/// A camera that cannot be; what `progress` returns, to stop.
pub fn lit(
    scene: &Scene,
    camera: &Camera,
    light: &dyn Incident,
    quality: &Quality,
    progress: &mut Progress<'_>,
) -> Result<Image> {
    camera.check("camera")?;
    let tracer = Tracer::new(scene, quality.effort());
    let (w, h) = (camera.width, camera.height);
    let (mut picture, continuum) = (Image::new(w, h, 3), light.has_radiance());
    let pixel = |x: usize, y: usize| -> Rgb {
        let mut rng = Pcg32::new(quality.seed ^ 0x6c69_7400, (y * w + x) as u64);
        let (scatter, lobe) = (Spread::new(rng.random()), Steps::new(rng.random()));
        let mut collector = FieldCollector { light, continuum, scatter, lobe, sum: [0.0; 3] };
        tracer.pixel(camera, x, y, quality.seed ^ 0x6c69_7400, &mut collector);
        collector.sum.map(|s| s / quality.samples as f32)
    };
    for y in 0..h {
        let row: Vec<Rgb> = (0..w).into_par_iter().map(|x| pixel(x, y)).collect();
        row.iter().enumerate().for_each(|(x, rgb)| picture.pixel_mut(x, y).copy_from_slice(rgb));
        progress(y as u64 + 1, h as u64)?;
    }
    Ok(picture)
}
