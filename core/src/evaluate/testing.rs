//! The field that the tests of this module share: a toy car on a 64 x 20 grid of lamps, after the thesis's Formula One toy
//! car (4.4.1), small.

use std::path::Path;
use std::sync::OnceLock;

use super::blocks::map_pixels;
use crate::domain::Directions;
use crate::field::{Access, Asset, Contents, Precision, write};
use crate::math::Vec3;
use crate::simulate::{Camera, ClassMap, Material, Object, Quality, Scene, Shape, Stage, V3, classes, grid_lamps};

/// Columns and rows: divisible by no side of a block.
pub const SIZE: (usize, usize) = (42, 30);

/// An open field, and what its pixels show.
pub struct Field {
    pub asset: Asset,
    pub classes: ClassMap,
    _folder: tempfile::TempDir,
}

impl Field {
    /// All of T, `[channel and lamp][pixel]`.
    pub fn numbers(&self) -> Vec<Vec<f32>> {
        let samples = self.asset.samples().unwrap();
        let planes = 3 * samples.layout().elements;
        map_pixels(samples, planes, |channels| channels.concat(), &mut |_, _| Ok(())).unwrap()
    }
}

/// The view of the car.
pub fn camera((width, height): (usize, usize)) -> Camera {
    Camera { width, height, distance: 6.5, view_rad: 15f32.to_radians() }
}

/// Photographs a scene.
pub fn photograph(scene: &Scene, lamps: Vec<Vec3>, quality: Quality, (width, height): (usize, usize)) -> Field {
    let camera = camera((width, height));
    let lamps = Directions::new(lamps).unwrap();
    let stage = Stage::new(scene, camera, &lamps, quality);
    let classes = classes(scene, &camera);
    let contents = Contents {
        colour_space: Default::default(),
        irradiance: vec![1.0; lamps.len()],
        domain: lamps.clone().into(),
        width,
        height,
        precision: Precision::Half,
        largest: stage.largest(),
        ambient: None,
        alpha: Some(classes.alpha.clone()),
        reliability: None,
        provenance: serde_json::Value::Null,
    };
    let folder = tempfile::tempdir().unwrap();
    let path: &Path = &folder.path().join("stage.rfield");
    write(path, &contents, &mut stage.bands(&mut |_, _| Ok(()))).unwrap();
    Field { asset: Asset::open(path, Access::Mapped).unwrap(), classes, _folder: folder }
}

/// A glossy body and nose, a diffuse cabin, diffuse wheels and a diffuse wing on posts, a driver's helmet of rough metal; on a
/// diffuse ground that leans 16 degrees towards the camera. The ground is the first object.
pub fn toy_car() -> Scene {
    let (s, c) = 16f32.to_radians().sin_cos();
    let (up, front) = (V3::new(0.0, c, s), V3::new(0.0, -s, c));
    // Right, above the ground, towards the camera; the car is turned.
    let at = |right: f32, above: f32, near: f32| V3::new(right, 0.0, 0.0) + up * (above - 0.35) + front * near;
    let (ts, tc) = 0.45f32.sin_cos();
    let on_car = |along: f32, above: f32, across: f32| at(along * tc + across * ts, above, across * tc - along * ts);
    let block = |along, above, across, half: V3, material| Object {
        shape: Shape::block(on_car(along, above, across), half, up, 0.45),
        material,
    };
    let ball = |along, above, across, radius, material| Object {
        shape: Shape::Sphere { centre: on_car(along, above, across), radius },
        material,
    };
    let ground = Shape::Disc { centre: at(0.0, 0.0, 0.0), normal: up, radius: 1.7 };
    let grey = Material::Diffuse { albedo: [0.30, 0.30, 0.32] };
    let paint = Material::Glossy { albedo: [0.42, 0.04, 0.03], alpha: 0.25 };
    let mut objects = vec![
        Object { shape: ground, material: Material::Diffuse { albedo: [0.46, 0.45, 0.43] } },
        block(-0.1, 0.32, 0.0, V3::new(0.55, 0.16, 0.24), paint),
        block(0.72, 0.24, 0.0, V3::new(0.24, 0.08, 0.16), paint),
        block(-0.38, 0.60, 0.0, V3::new(0.18, 0.11, 0.16), Material::Diffuse { albedo: [0.55, 0.50, 0.20] }),
        block(-0.80, 0.70, 0.0, V3::new(0.12, 0.03, 0.40), Material::Diffuse { albedo: [0.20, 0.30, 0.50] }),
        ball(0.02, 0.60, 0.0, 0.15, Material::RoughMetal { f0: [0.95, 0.80, 0.50], alpha: 0.25 }),
    ];
    for (along, across) in [(-0.55, 0.40), (-0.55, -0.40), (0.62, 0.34), (0.62, -0.34)] {
        objects.push(ball(along, 0.162, across, 0.16, grey));
    }
    Scene { objects }
}

/// What keeps noise far below the differences between methods; see the test of figure 4.16.
pub fn quality() -> Quality {
    Quality { samples: 64, bounces: 4, stride: 4, cone_density: 1.0, depth: 2, seed: 5 }
}

/// The car under 1280 lamps, rendered on the first call.
pub fn car() -> &'static Field {
    static FIELD: OnceLock<Field> = OnceLock::new();
    FIELD.get_or_init(|| photograph(&toy_car(), grid_lamps(64, 20), quality(), SIZE))
}
