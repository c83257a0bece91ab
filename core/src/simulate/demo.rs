//! The scene and the lamps of the demonstration.

use std::f64::consts::PI;

use crate::math::Vec3;

use super::V3;
use super::material::Material;
use super::scene::{Object, Scene};
use super::shape::Shape;

/// The table leans towards the camera, so that its top is seen: the stage frame has the camera on +z exactly.
const LEAN_RAD: f32 = 16.0 * std::f32::consts::PI / 180.0;
/// The table passes this far below the origin.
const DEPTH: f32 = 0.42;

/// A point at (right, above the table, towards the camera along the table).
pub(super) fn on_table(right: f32, above: f32, near: f32) -> V3 {
    let (s, c) = LEAN_RAD.sin_cos();
    let (up, front) = (V3::new(0.0, c, s), V3::new(0.0, -s, c));
    V3::new(right, 0.0, 0.0) + up * (above - DEPTH) + front * near
}

pub(super) fn ball(right: f32, near: f32, radius: f32, material: Material) -> Object {
    Object { shape: Shape::Sphere { centre: on_table(right, radius + 2e-3, near), radius }, material }
}

impl Scene {
    /// A still life on a round table: a mirror ball, a glass ball on a stand, a gold ball of rough metal, glossy and diffuse
    /// balls and boxes. The table is 3.2 units wide, about the origin, and all of it is in
    /// [`Camera::demo`](super::Camera::demo)'s view.
    pub fn demo() -> Self {
        let up = on_table(0.0, 1.0, 0.0) - on_table(0.0, 0.0, 0.0);
        let block = |right, near, half: V3, turn: f32, material| Object {
            shape: Shape::block(on_table(right, half.y + 2e-3, near), half, up, turn),
            material,
        };
        let table = Object {
            shape: Shape::Disc { centre: on_table(0.0, 0.0, 0.0), normal: up, radius: 1.6 },
            material: Material::Diffuse { albedo: [0.48, 0.46, 0.43] },
        };
        let stand =
            block(0.10, -0.10, V3::new(0.10, 0.26, 0.10), 0.5, Material::Diffuse { albedo: [0.62, 0.55, 0.42] });
        let glass = Object {
            shape: Shape::Sphere { centre: on_table(0.10, 0.52 + 0.004 + 0.33, -0.10), radius: 0.33 },
            material: Material::Glass { index: 1.5 },
        };
        let glossy = |albedo| Material::Glossy { albedo, alpha: 0.3 };
        Self {
            objects: vec![
                table,
                ball(-0.80, -0.45, 0.44, Material::Mirror { reflectance: [0.95, 0.95, 0.95] }),
                // Its focus lies 1.5 radii behind its middle: raised on a slender stand, it spreads light again before the
                // table, as an object on a stage should: a focus on a surface is finer than any lamp's cell (4.2).
                glass,
                ball(0.92, -0.40, 0.36, Material::RoughMetal { f0: [0.96, 0.74, 0.38], alpha: 0.3 }),
                ball(-0.38, 0.60, 0.25, glossy([0.58, 0.07, 0.05])),
                ball(-0.98, 0.40, 0.22, Material::Diffuse { albedo: [0.20, 0.42, 0.55] }),
                stand,
                block(0.88, 0.50, V3::new(0.18, 0.18, 0.18), 0.9, glossy([0.08, 0.30, 0.14])),
            ],
        }
    }
}

/// `count` lamps spread evenly over the hemisphere about +y: a spherical Fibonacci lattice, equal areas, golden angle
/// between neighbours (Gonzalez 2010, cut at the equator). Unit vectors, the pole first.
pub fn demo_lamps(count: usize) -> Vec<Vec3> {
    let golden = PI * (3.0 - 5f64.sqrt());
    (0..count)
        .map(|i| {
            let y = 1.0 - (i as f64 + 0.5) / count as f64;
            let (sin, phi) = ((1.0 - y * y).sqrt(), golden * i as f64);
            Vec3::new(sin * phi.sin(), y, sin * phi.cos())
        })
        .collect()
}

/// Lamps on a longitude x latitude grid over the hemisphere about +y, as an arc of lamps above a turntable gives them (the
/// thesis's Light Stage: 64 x 20, 4.4.1): ring after ring from the horizon up, each elevation in the middle of one of
/// `latitudes` equal parts of 90 degrees, longitudes from +z towards +x.
pub fn grid_lamps(longitudes: usize, latitudes: usize) -> Vec<Vec3> {
    let at = |i: usize| {
        let (ring, column) = (i / longitudes, i % longitudes);
        let (sin, cos) = (PI / 2.0 * (ring as f64 + 0.5) / latitudes as f64).sin_cos();
        let (x, z) = (2.0 * PI * column as f64 / longitudes as f64).sin_cos();
        Vec3::new(x * cos, sin, z * cos)
    };
    (0..longitudes * latitudes).map(at).collect()
}
