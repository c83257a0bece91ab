//! What stands before the virtual monitor and under the virtual gantry.

use crate::math::Vec3;

use super::V3;
use super::camera::Camera;
use super::demo::{ball, grid_lamps, on_table};
use super::gantry::{Gantry, LATER_ACROSS};
use super::material::Material;
use super::monitor::{ACROSS, Monitor, ScreenPlane};
use super::scene::{Object, Scene};
use super::shape::Shape;

const fn diffuse(albedo: [f32; 3]) -> Material {
    Material::Diffuse { albedo }
}

fn block(right: f32, above: f32, near: f32, half: V3, turn: f32, material: Material) -> Object {
    let up = on_table(0.0, 1.0, 0.0) - on_table(0.0, 0.0, 0.0);
    Object { shape: Shape::block(on_table(right, above + half.y, near), half, up, turn), material }
}

impl Scene {
    /// Bodies on a floor before a screen: a glass ball on a stand, a mirror ball, a glossy ball and block, diffuse balls. The
    /// floor leans towards the camera by 16 degrees, as seen by a camera that looks down on it.
    pub fn monitor() -> Self {
        let floor = V3::new(1.4, 0.03, 1.1);
        Self {
            objects: vec![
                block(0.0, -0.06, 0.0, floor, 0.0, diffuse([0.42, 0.41, 0.40])),
                ball(-0.72, -0.30, 0.36, Material::Mirror { reflectance: [0.95, 0.95, 0.95] }),
                block(0.06, 0.002, -0.10, V3::new(0.09, 0.16, 0.09), 0.5, diffuse([0.62, 0.55, 0.42])),
                Object {
                    shape: Shape::Sphere { centre: on_table(0.06, 0.326 + 0.34, -0.10), radius: 0.34 },
                    material: Material::Glass { index: 1.5 },
                },
                ball(0.80, -0.25, 0.27, Material::Glossy { albedo: [0.58, 0.07, 0.05], alpha: 0.3 }),
                ball(-0.30, 0.62, 0.17, diffuse([0.20, 0.42, 0.55])),
                block(
                    0.58,
                    0.002,
                    0.52,
                    V3::new(0.14, 0.14, 0.14),
                    0.9,
                    Material::Glossy { albedo: [0.08, 0.30, 0.14], alpha: 0.2 },
                ),
            ],
        }
    }
}

impl Scene {
    /// Four coloured cubes on a pale floor before a screen, all diffuse: soft shadows and the light that faces give each other
    /// (figures 6.14 and 6.15). The floor is that of [`Scene::monitor`].
    pub fn cubes() -> Self {
        let floor = V3::new(1.4, 0.03, 1.1);
        let cube = |right, near, half: f32, turn, albedo| {
            block(right, 0.002, near, V3::new(half, half, half), turn, diffuse(albedo))
        };
        Self {
            objects: vec![
                block(0.0, -0.06, 0.0, floor, 0.0, diffuse([0.70, 0.69, 0.67])),
                cube(-0.62, -0.22, 0.20, 0.35, [0.62, 0.10, 0.08]),
                cube(0.02, -0.45, 0.17, 0.80, [0.12, 0.42, 0.16]),
                cube(0.60, -0.12, 0.22, 1.15, [0.10, 0.18, 0.55]),
                cube(-0.08, 0.34, 0.15, 0.55, [0.66, 0.52, 0.10]),
            ],
        }
    }
}

impl Scene {
    /// Bodies on a turntable under a projector: a mirror ball, a tall and a low block, glossy and diffuse balls, which throw shadows
    /// on each other. The table is 2.2 units wide, about the origin, and leans towards the camera as the floor of
    /// [`Scene::monitor`] does.
    pub fn gantry() -> Self {
        let up = on_table(0.0, 1.0, 0.0) - on_table(0.0, 0.0, 0.0);
        let table = Shape::Disc { centre: on_table(0.0, 0.0, 0.0), normal: up, radius: 1.1 };
        Self {
            objects: vec![
                Object { shape: table, material: diffuse([0.46, 0.45, 0.44]) },
                ball(-0.45, -0.25, 0.32, Material::Mirror { reflectance: [0.95, 0.95, 0.95] }),
                block(0.22, 0.002, -0.40, V3::new(0.13, 0.42, 0.13), 0.4, diffuse([0.62, 0.50, 0.34])),
                block(
                    0.55,
                    0.002,
                    0.25,
                    V3::new(0.18, 0.12, 0.18),
                    0.9,
                    Material::Glossy { albedo: [0.08, 0.30, 0.14], alpha: 0.3 },
                ),
                ball(0.02, 0.25, 0.20, Material::Glossy { albedo: [0.58, 0.07, 0.05], alpha: 0.3 }),
                ball(-0.42, 0.60, 0.16, diffuse([0.20, 0.42, 0.55])),
            ],
        }
    }
}

impl Scene {
    /// A diffuse ball and nothing else: no light goes over other surfaces (7.5).
    pub fn convex() -> Self {
        Self { objects: vec![pale_ball(V3::zeros(), 0.7)] }
    }

    /// A diffuse bowl, open towards the camera and the arm, and a ball beside it. Half a hollow ball of albedo 0.85 in which light goes to
    /// and fro: with even light, half of the light of each point comes over others (for a part `f` of a ball, `a f` of it all,
    /// `a` the albedo).
    pub fn bowl() -> Self {
        let axis = V3::new(0.15, 0.45, 0.88).normalize();
        let shape = Shape::Bowl { centre: V3::new(-0.46, -0.02, 0.0), radius: 0.6, axis, rim: 0.0 };
        let bowl = Object { shape, material: diffuse([0.85, 0.83, 0.80]) };
        Self { objects: vec![bowl, pale_ball(V3::new(0.66, -0.05, 0.0), 0.4)] }
    }
}

fn pale_ball(centre: V3, radius: f32) -> Object {
    Object { shape: Shape::Sphere { centre, radius }, material: diffuse([0.70, 0.64, 0.55]) }
}

impl Gantry {
    /// [`Scene::gantry`] under an arm that stops at `longitudes` x `latitudes` places above the turntable (see
    /// [`grid_lamps`]), 4 units from its middle, the projector showing `squares` x `squares` squares.
    pub fn demo(camera: Camera, (longitudes, latitudes): (usize, usize), squares: usize) -> Self {
        let positions = Self::above_table(&grid_lamps(longitudes, latitudes), 4.0);
        // All of the table, wherever from.
        let view_rad = 34f32.to_radians();
        Self { scene: Scene::gantry(), camera, positions, view_rad, squares, lens_radius: 0.08, blocks: LATER_ACROSS }
    }

    /// Positions in the stage frame from directions in the frame of [`Scene::gantry`]'s table, +y its normal, which leans
    /// towards the camera: what lies above the horizon there is above the table.
    pub fn above_table(directions: &[Vec3], distance: f32) -> Vec<V3> {
        let origin = on_table(0.0, 0.0, 0.0);
        let [right, up, near] =
            [on_table(1.0, 0.0, 0.0), on_table(0.0, 1.0, 0.0), on_table(0.0, 0.0, 1.0)].map(|p| p - origin);
        let place = |d: &Vec3| (right * d.x as f32 + up * d.y as f32 + near * d.z as f32) * distance;
        directions.iter().map(place).collect()
    }
}

impl Camera {
    /// The view of [`Scene::gantry`].
    pub fn gantry(width: usize, height: usize) -> Self {
        Self { width, height, distance: 6.5, view_rad: 16f32.to_radians() }
    }

    /// The view of [`Scene::monitor`].
    pub fn monitor(width: usize, height: usize) -> Self {
        Self { width, height, distance: 6.5, view_rad: 18f32.to_radians() }
    }
}

impl Monitor {
    /// [`Scene::monitor`] before a screen that stands upright behind its floor and fills most of the view.
    pub fn demo(camera: Camera, texels: (usize, usize)) -> Self {
        let (low, high, near) = (-0.10, 1.45, -1.25);
        let up = (on_table(0.0, high, near) - on_table(0.0, low, near)) * 0.5;
        let centre = on_table(0.0, 0.5 * (low + high), near);
        let screen = ScreenPlane { centre, right: V3::new(1.45, 0.0, 0.0), up };
        Self { scene: Scene::monitor(), camera, screen, texels, blocks: ACROSS }
    }

    /// [`Scene::cubes`] before the same screen. Twice as many blocks: an answer of diffuse bodies that were constant by
    /// 16 x 16 of them would be known entirely after 256 Haar functions.
    pub fn cubes(camera: Camera, texels: (usize, usize)) -> Self {
        Self { scene: Scene::cubes(), blocks: 2 * ACROSS, ..Self::demo(camera, texels) }
    }
}
