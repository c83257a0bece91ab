//! The same scene lit directly by maps: what relighting is measured against.
//!
//! It shares scene and paths with the stage, not the light: no lamps, no cells. Light is drawn from the map itself in proportion to
//! the power of its texels, and paths through mirrors and glass look the map up where they leave.

use rand::RngExt;
use rand_pcg::Pcg32;
use rayon::prelude::*;

use crate::domain::Directions;
use crate::error::{Error, Result};
use crate::illumination::EnvMap;
use crate::image::Image;
use crate::math::latlong;

use super::camera::Camera;
use super::material::Rgb;
use super::sampling::{Spread, Steps};
use super::scene::Scene;
use super::shape::Ray;
use super::stage::Quality;
use super::tracer::{Collector, Tracer, Vertex, times};
use super::{Progress, V3};

/// A map as a density of directions.
struct Source<'a> {
    map: &'a EnvMap,
    /// Power up to and including each row.
    rows: Vec<f64>,
    /// Power up to and including each texel of its row.
    texels: Vec<f64>,
}

impl<'a> Source<'a> {
    fn new(map: &'a EnvMap) -> Self {
        let (w, h) = map.image().size();
        let (mut rows, mut texels) = (Vec::with_capacity(h), Vec::with_capacity(w * h));
        let mut total = 0.0;
        for j in 0..h {
            let solid_angle = latlong::texel_solid_angle(j, w, h);
            let mut sum = 0.0;
            for pixel in map.image().row(j).chunks_exact(3) {
                sum += power(pixel) * solid_angle;
                texels.push(sum);
            }
            total += sum;
            rows.push(total);
        }
        Self { map, rows, texels }
    }

    /// A direction in proportion to the power that comes from it; `None` of a black map.
    fn draw(&self, u: [f32; 2]) -> Option<V3> {
        let (w, h) = self.map.image().size();
        let (j, across) = pick(&self.rows, f64::from(u[0]))?;
        let (i, along) = pick(&self.texels[j * w..(j + 1) * w], f64::from(u[1]))?;
        // Uniform in the texel: in longitude, and in the sine of latitude.
        let sine = |row: usize| (std::f64::consts::PI * (0.5 - row as f64 / h as f64)).sin();
        let y = sine(j) + across * (sine(j + 1) - sine(j));
        let equator = latlong::direction(i as f64 + along, h as f64 / 2.0, w, h);
        let sin = (1.0 - y * y).sqrt();
        Some(V3::new((equator.x * sin) as f32, y as f32, (equator.z * sin) as f32))
    }

    /// Density of [`Self::draw`] where the map has this radiance, per steradian.
    fn density(&self, radiance: &Rgb) -> f32 {
        match self.rows.last() {
            Some(total) if *total > 0.0 => (power(radiance) / total) as f32,
            _ => 0.0,
        }
    }
}

fn power(pixel: &[f32]) -> f64 {
    pixel.iter().map(|v| f64::from(v.max(0.0))).sum()
}

/// The bin of a running sum that holds the share `u`, and the place in it.
fn pick(sums: &[f64], u: f64) -> Option<(usize, f64)> {
    let target = u * sums.last().filter(|s| **s > 0.0)?;
    let at = sums.partition_point(|s| *s <= target).min(sums.len() - 1);
    let before = if at == 0 { 0.0 } else { sums[at - 1] };
    Some((at, ((target - before) / (sums[at] - before)).clamp(0.0, 1.0)))
}

/// Collects one pixel under several maps at once.
struct MapCollector<'a> {
    sources: &'a [Source<'a>],
    draws: Vec<Draws>,
    sums: Vec<Rgb>,
}

/// Well-spread numbers for one map at the vertices that the camera sees: light, scattering, and which lobe.
struct Draws {
    light: Spread,
    scatter: Spread,
    lobe: Steps,
}

impl Draws {
    fn new(rng: &mut Pcg32) -> Self {
        Self { light: Spread::new(rng.random()), scatter: Spread::new(rng.random()), lobe: Steps::new(rng.random()) }
    }
}

/// Light directions at a vertex that the camera sees.
const DRAWS: usize = 8;

impl MapCollector<'_> {
    /// One estimate of the light of map `n` at a vertex: a direction drawn from the map, and, `both`, one drawn from the
    /// scattering too, combined by the balance heuristic (Veach 1997, eq. 9.8).
    fn estimate(&self, n: usize, scene: &Scene, vertex: &Vertex, u: [f32; 2], both: Option<(f32, [f32; 2])>) -> Rgb {
        let source = &self.sources[n];
        let seen = |direction: &V3| {
            let radiance = source.map.radiance(&direction.cast());
            let scattered = vertex.scatter.towards(direction);
            let density = source.density(&radiance) + both.map_or(0.0, |_| vertex.scatter.density(direction));
            let ray = Ray { origin: vertex.point, direction: *direction };
            let light = times(&scattered, &radiance, 1.0 / density.max(f32::MIN_POSITIVE));
            if light == [0.0; 3] || scene.blocks(&ray, vertex.object) { [0.0; 3] } else { light }
        };
        let mut sum = source.draw(u).map_or([0.0; 3], |d| seen(&d));
        if let Some((choice, u)) = both {
            add(&mut sum, &seen(&vertex.scatter.draw(choice, u)));
        }
        sum
    }
}

impl Collector for MapCollector<'_> {
    fn direct(&mut self, scene: &Scene, vertex: &Vertex, weight: &Rgb, first: bool, rng: &mut Pcg32) {
        let draws = if first { DRAWS } else { 1 };
        for n in 0..self.sources.len() {
            for _ in 0..draws {
                let spread = &mut self.draws[n];
                let u = if first { spread.light.next() } else { rng.random() };
                let glossy = first && !vertex.scatter.is_diffuse();
                let both = glossy.then(|| (spread.lobe.next(), spread.scatter.next()));
                let light = self.estimate(n, scene, vertex, u, both);
                add(&mut self.sums[n], &times(weight, &light, 1.0 / draws as f32));
            }
        }
    }

    fn leave(&mut self, ray: &Ray, weight: &Rgb, _first: bool) {
        let Some(first) = self.sources.first() else { return };
        // Maps are of one size: where the ray leaves is found once for all.
        let (w, h) = first.map.image().size();
        let (u, v) = latlong::coordinates(&ray.direction.cast(), w, h);
        let (i, j) = ((u as usize).min(w - 1), (v as usize).min(h - 1));
        for (sum, source) in self.sums.iter_mut().zip(self.sources) {
            let radiance = source.map.image().pixel(i, j);
            add(sum, &times(weight, &[radiance[0], radiance[1], radiance[2]], 1.0));
        }
    }
}

fn add(sum: &mut Rgb, light: &Rgb) {
    sum.iter_mut().zip(light).for_each(|(s, l)| *s += l);
}

/// The scene lit by each of `maps` inside the coverage of `lamps` (light beyond is dropped): one picture a map, RGB,
/// premultiplied, the map itself not seen behind the objects. All maps share their camera paths, never their light
/// samples. Texels count by their middle. `quality.stride` is not used.
///
/// # Errors
/// Maps of different sizes; what `progress` returns, to stop.
pub fn truth(
    scene: &Scene,
    camera: &Camera,
    maps: &[EnvMap],
    lamps: &Directions,
    quality: &Quality,
    progress: &mut Progress<'_>,
) -> Result<Vec<Image>> {
    if let Some(other) = maps.iter().find(|m| m.image().size() != maps[0].image().size()) {
        let (found, expected) = (other.image().size(), maps[0].image().size());
        return Err(Error::invalid("environment maps", format!("sizes {expected:?} and {found:?}"), "one size"));
    }
    let covered: Vec<EnvMap> = maps.iter().map(|m| covered(m, lamps)).collect();
    let sources: Vec<Source<'_>> = covered.iter().map(Source::new).collect();
    let tracer = Tracer::new(scene, quality.effort());
    let (w, h) = (camera.width, camera.height);
    let mut pictures = vec![Image::new(w, h, 3); maps.len()];
    let pixel = |x: usize, y: usize| {
        let mut rng = Pcg32::new(quality.seed ^ 0x7274_7574_6800, (y * w + x) as u64);
        let draws = sources.iter().map(|_| Draws::new(&mut rng)).collect();
        let mut collector = MapCollector { sources: &sources, draws, sums: vec![[0.0; 3]; maps.len()] };
        tracer.pixel(camera, x, y, quality.seed ^ 0x7472_7574_6800, &mut collector);
        collector.sums
    };
    for y in 0..h {
        let row: Vec<Vec<Rgb>> = (0..w).into_par_iter().map(|x| pixel(x, y)).collect();
        for (x, sums) in row.iter().enumerate() {
            for (picture, sum) in pictures.iter_mut().zip(sums) {
                picture.pixel_mut(x, y).copy_from_slice(&sum.map(|s| s / quality.samples as f32));
            }
        }
        progress(y as u64 + 1, h as u64)?;
    }
    Ok(pictures)
}

/// A map, black outside the coverage.
fn covered(map: &EnvMap, lamps: &Directions) -> EnvMap {
    let (w, h) = map.image().size();
    EnvMap::from_fn(w, h, |d| if lamps.covers(d) { map.radiance(d) } else { [0.0; 3] })
}
