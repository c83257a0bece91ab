//! The scene from a projector's side, lit by what the camera throws: what dual pictures are measured against.
//!
//! It shares scene and paths with the gantry, not the light: a pinhole camera stands where the projector's lens is, and the camera's pinhole
//! is a point that throws a picture, each pixel's light as flux, radiant intensity `c_i / O_i` within its solid angle `O_i`. Seen in mirrors, and
//! thrown on by them, it is a disc as wide as the projector's lens, since a point would be met by no ray.

use std::f32::consts::PI;

use rand_pcg::Pcg32;
use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::image::Image;

use super::gantry::{CAUSTIC, Gantry, Stand};
use super::material::Rgb;
use super::scene::Scene;
use super::shape::Ray;
use super::stage::Quality;
use super::tracer::{Collector, Tracer, Vertex, times};
use super::{Progress, V3};

/// So that random numbers are others than those of the gantry's photographs.
const SEED: u64 = 0x7265_7665_7273_6500;

impl Gantry {
    /// What a camera in place of the projector would see from a position, in `squares` x `squares` pixels, row 0 at the top as the
    /// projector sees it, while every pixel of the camera throws the flux that `lit` (of the camera's size, RGB) gives it. `quality.stride` is not
    /// used.
    ///
    /// # Errors
    /// As [`Self::check`]; no such position; a picture of another size; what `progress` returns, to stop.
    pub fn from_projector(
        &self,
        position: usize,
        lit: &Image,
        quality: &Quality,
        progress: &mut Progress<'_>,
    ) -> Result<Image> {
        self.check("gantry")?;
        let Some(&place) = self.positions.get(position) else {
            let expected = format!("1 to {}", self.positions.len());
            return Err(Error::invalid("gantry", format!("position {}", position + 1), expected));
        };
        let (width, height) = (self.camera.width, self.camera.height);
        if lit.size() != (width, height) || lit.channels() != 3 {
            let found = format!("{} x {} pixels of {} channels", lit.width(), lit.height(), lit.channels());
            return Err(Error::invalid(
                "the picture that the camera throws",
                found,
                format!("{width} x {height}, RGB"),
            ));
        }
        let (stand, n) = (Stand::new(place), self.squares);
        let reach = (0.5 * self.view_rad).tan();
        let ray = |x: f32, y: f32| {
            let (right, up) = (2.0 * x / n as f32 - 1.0, 1.0 - 2.0 * y / n as f32);
            let direction = stand.axis + (stand.right * right + stand.up * up) * reach;
            Ray { origin: place, direction: direction.normalize() }
        };
        let tracer = Tracer::new(&self.scene, quality.effort());
        let intensities = self.intensities(lit);
        let pixel = |x: usize, y: usize| -> Rgb {
            let mut thrown = Thrown { gantry: self, intensities: &intensities, sum: [0.0; 3] };
            tracer.rays(&ray, (x, y), quality.seed ^ SEED ^ (y * n + x) as u64, &mut thrown);
            thrown.sum.map(|s| s / quality.samples as f32)
        };
        let mut picture = Image::new(n, n, 3);
        for y in 0..n {
            let row: Vec<Rgb> = (0..n).into_par_iter().map(|x| pixel(x, y)).collect();
            row.iter().enumerate().for_each(|(x, rgb)| picture.pixel_mut(x, y).copy_from_slice(rgb));
            progress(y as u64 + 1, n as u64)?;
        }
        Ok(picture)
    }

    /// Radiant intensity within each pixel of the camera.
    fn intensities(&self, lit: &Image) -> Image {
        let (width, height) = lit.size();
        let focal = self.camera.focal_px() as f32;
        Image::from_fn(width, height, |x, y| {
            let (u, v) = (x as f32 + 0.5 - 0.5 * width as f32, y as f32 + 0.5 - 0.5 * height as f32);
            // O_i = cos^3 / focal^2 of a small pixel.
            let inverse = (focal * focal + u * u + v * v).powf(1.5) / focal;
            let pixel = lit.pixel(x, y);
            std::array::from_fn(|c| pixel[c] * inverse)
        })
    }
}

/// Collects the camera's light in one pixel of the projector.
struct Thrown<'a> {
    gantry: &'a Gantry,
    intensities: &'a Image,
    sum: Rgb,
}

impl Thrown<'_> {
    fn pinhole(&self) -> V3 {
        V3::new(0.0, 0.0, self.gantry.camera.distance)
    }

    /// What the camera throws towards a point.
    fn towards(&self, point: &V3) -> Rgb {
        let [x, y] = self.gantry.camera.project(point);
        let (width, height) = self.intensities.size();
        if point.z >= self.gantry.camera.distance || x < 0.0 || y < 0.0 || x >= width as f64 || y >= height as f64 {
            return [0.0; 3];
        }
        let pixel = self.intensities.pixel(x as usize, y as usize);
        [pixel[0], pixel[1], pixel[2]]
    }

    fn add(&mut self, light: &Rgb) {
        self.sum.iter_mut().zip(light).for_each(|(s, l)| *s += l);
    }
}

impl Collector for Thrown<'_> {
    fn direct(&mut self, scene: &Scene, vertex: &Vertex, weight: &Rgb, _first: bool, _rng: &mut Pcg32) {
        let to = self.pinhole() - vertex.point;
        let ray = Ray { origin: vertex.point, direction: to.normalize() };
        let scattered = vertex.scatter.towards(&ray.direction);
        let light = times(&times(weight, &scattered, 1.0), &self.towards(&vertex.point), 1.0 / to.norm_squared());
        if light != [0.0; 3] && !scene.blocks(&ray, vertex.object) {
            self.add(&light);
        }
    }

    fn leave(&mut self, ray: &Ray, weight: &Rgb, first: bool) {
        let own = self.gantry.lens_radius;
        let radius = if first { own } else { own.max(CAUSTIC * self.gantry.camera.distance) };
        let cos = ray.direction.z;
        let t = (self.gantry.camera.distance - ray.origin.z) / cos;
        if cos > 0.0 && t > 0.0 && (ray.at(t) - self.pinhole()).norm_squared() < radius * radius {
            self.add(&times(weight, &self.towards(&ray.origin), 1.0 / (PI * radius * radius * cos)));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::relative;
    use super::super::{Camera, Material, Object, Shape};
    use super::*;
    use crate::acquire::Photographs;
    use crate::field::{Access, Asset, Contents, Kind, Precision, write};
    use crate::relight::Dual;

    /// The asset of a gantry's rows, half floats, with a black photograph.
    fn asset(gantry: &Gantry, folder: &std::path::Path) -> Asset {
        let quality = Quality { samples: 64, bounces: 4, stride: 1, cone_density: 1000.0, depth: 6, seed: 3 };
        let rows = gantry.trace(&quality, &mut |_, _| Ok(())).unwrap();
        let (width, height) = rows.size();
        let mut photographs = Photographs::new(width, height, folder);
        (0..rows.grids().elements()).for_each(|e| photographs.push(rows.element(e).unwrap()).unwrap());
        let contents = Contents {
            irradiance: vec![1.0; gantry.positions.len()],
            domain: gantry.domain().unwrap().into(),
            width,
            height,
            colour_space: Default::default(),
            precision: Precision::Half,
            largest: photographs.largest(),
            ambient: Some(Image::new(width, height, 3)),
            alpha: None,
            reliability: None,
            provenance: serde_json::Value::Null,
        };
        let path = folder.join("gantry.rfield");
        write(&path, &contents, &mut photographs).unwrap();
        Asset::open(&path, Access::Mapped).unwrap()
    }

    /// What the camera throws: white; its right half; bands of colours, finer to the right.
    fn thrown(camera: &Camera) -> [Image; 3] {
        let (w, h) = (camera.width, camera.height);
        let bands = |x: usize, y: usize| {
            let (x, y) = (x as f32 / w as f32, y as f32 / h as f32);
            [0.5 + 0.5 * (30.0 * x * x).sin(), y, 0.5 + 0.5 * (9.0 * y + 4.0 * x).cos()]
        };
        [
            Image::from_fn(w, h, |_, _| [1.0; 3]),
            Image::from_fn(w, h, |x, _| [if x >= w / 2 { 1.0 } else { 0.0 }; 3]),
            Image::from_fn(w, h, bands),
        ]
    }

    /// From a position at the left and one at the right, under three lights, against the scene seen from the projector and lit by the
    /// camera. Not even a scale is left free. The mirror ball is of rough metal here: chance decides whether a ray from a mirror meets
    /// a lens, and one that does outshines the picture.
    #[test]
    fn dual_pictures_are_what_a_camera_at_the_projector_sees() {
        let mut gantry = Gantry::demo(Camera::gantry(96, 72), (6, 2), 16);
        gantry.positions = vec![gantry.positions[1], gantry.positions[4]];
        // Light over other surfaces by squares too: in blocks it would leave its block in the picture.
        gantry.blocks = 16;
        for object in gantry.scene.objects.iter_mut().filter(|object| object.material.is_specular()) {
            object.material = Material::RoughMetal { f0: [0.95; 3], alpha: 0.3 };
        }
        let folder = tempfile::tempdir().unwrap();
        let asset = asset(&gantry, folder.path());
        let dual = Dual::new(&asset, false).unwrap();
        // Radiance is relative to the squares in the middle.
        let middle = asset.domain().gantry().unwrap().steradians(8, 8) as f32;
        let quality = Quality { samples: 256, bounces: 4, stride: 1, cone_density: 1.0, depth: 6, seed: 9 };
        let all: Vec<usize> = (0..256).collect();
        for position in 0..2 {
            for (name, lit) in ["white", "half", "bands"].into_iter().zip(thrown(&gantry.camera)) {
                let found = dual.pictures(&lit, Kind::Dense, position..position + 1, &mut |_, _| Ok(())).unwrap();
                let mut found = dual.as_radiance(&found[0]).unwrap();
                found.data_mut().iter_mut().for_each(|v| *v /= middle);
                let truth = gantry.from_projector(position, &lit, &quality, &mut |_, _| Ok(())).unwrap();
                let error = relative(&found, &truth, &all);
                assert!(error < 0.05, "position {position}, {name}: off by {error}");
                // Any other way round is far off.
                for (way, flip) in [("left for right", [true, false]), ("upside down", [false, true])] {
                    let other = Image::from_fn(16, 16, |x, y| {
                        let at = |n: usize, flip: bool| if flip { 15 - n } else { n };
                        found.pixel(at(x, flip[0]), at(y, flip[1])).try_into().unwrap()
                    });
                    let error = relative(&other, &truth, &all);
                    assert!(error > 0.2, "position {position}, {name}, {way}: only {error} off");
                }
            }
        }
    }

    /// A wall that faces both, the projector right of the camera: in closed form.
    #[test]
    fn a_wall_lit_by_the_camera_is_known() {
        let wall = Shape::Disc { centre: V3::zeros(), normal: V3::z(), radius: 9.0 };
        let material = Material::Diffuse { albedo: [0.8, 0.5, 0.2] };
        let camera = Camera { width: 32, height: 24, distance: 6.0, view_rad: 0.4 };
        let scene = Scene { objects: vec![Object { shape: wall, material }] };
        let positions = vec![V3::new(3.0, 0.0, 4.0)];
        let gantry = Gantry { scene, camera, positions, view_rad: 0.2, squares: 5, lens_radius: 0.05, blocks: 4 };
        let quality = Quality { samples: 64, bounces: 1, stride: 1, cone_density: 1.0, depth: 2, seed: 1 };
        let white = Image::from_fn(32, 24, |_, _| [1.0; 3]);
        let seen = gantry.from_projector(0, &white, &quality, &mut |_, _| Ok(())).unwrap();
        // In the middle: intensity focal^2, f = albedo / pi, 1 / 36.
        let focal = 12.0 / 0.2f32.tan();
        let expected = 0.5 / PI * focal * focal / 36.0;
        let found = seen.pixel(2, 2)[1];
        assert!((found / expected - 1.0).abs() < 0.02, "{found} is not {expected}");
        // The camera's right half: beyond x = 0, which is the projector's right half too.
        let half = Image::from_fn(32, 24, |x, _| [if x >= 16 { 1.0 } else { 0.0 }; 3]);
        let seen = gantry.from_projector(0, &half, &quality, &mut |_, _| Ok(())).unwrap();
        assert!(seen.pixel(1, 2)[1] == 0.0 && seen.pixel(3, 2)[1] > 0.9 * expected);
        assert!(gantry.from_projector(1, &white, &quality, &mut |_, _| Ok(())).is_err());
        assert!(gantry.from_projector(0, &Image::new(24, 32, 3), &quality, &mut |_, _| Ok(())).is_err());
    }
}
