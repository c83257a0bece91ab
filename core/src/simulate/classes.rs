//! What each pixel shows first.

use super::camera::Camera;
use super::material::Material;
use super::scene::Scene;

/// What the rays of a pixel meet first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Class {
    /// Nothing.
    Background,
    /// A Lambert surface.
    Diffuse,
    /// A glossy surface or rough metal.
    Glossy,
    /// A mirror.
    Mirror,
    /// Glass.
    Glass,
    /// More than one of these.
    Mixed,
}

/// Class and coverage of every pixel.
#[derive(Debug, Clone, PartialEq)]
pub struct ClassMap {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// The class that all rays of a pixel agree on, or [`Class::Mixed`]; row 0 at the top.
    pub class: Vec<Class>,
    /// Share of a pixel that the objects cover, 0 to 1; row 0 at the top.
    pub alpha: Vec<f32>,
}

impl ClassMap {
    /// The pixels of some classes, as indices `y * width + x`.
    pub fn pixels(&self, classes: &[Class]) -> Vec<usize> {
        (0..self.class.len()).filter(|&i| classes.contains(&self.class[i])).collect()
    }
}

/// Rays across a pixel.
const ACROSS: usize = 8;

/// Classes and coverage from 8 x 8 camera rays a pixel.
pub fn classes(scene: &Scene, camera: &Camera) -> ClassMap {
    let (width, height) = (camera.width, camera.height);
    let at = |x: usize, y: usize| {
        let sub = |k: usize| (k as f32 + 0.5) / ACROSS as f32;
        let ray = |k: usize| camera.ray(x as f32 + sub(k % ACROSS), y as f32 + sub(k / ACROSS));
        let seen: Vec<Class> = (0..ACROSS * ACROSS)
            .map(|k| scene.hit(&ray(k)).map_or(Class::Background, |h| class_of(&scene.objects[h.object].material)))
            .collect();
        let covered = seen.iter().filter(|c| **c != Class::Background).count();
        let class = if seen.iter().all(|c| *c == seen[0]) { seen[0] } else { Class::Mixed };
        (class, covered as f32 / (ACROSS * ACROSS) as f32)
    };
    let (class, alpha) = (0..width * height).map(|i| at(i % width, i / width)).unzip();
    ClassMap { width, height, class, alpha }
}

fn class_of(material: &Material) -> Class {
    match material {
        Material::Diffuse { .. } => Class::Diffuse,
        Material::Glossy { .. } | Material::RoughMetal { .. } => Class::Glossy,
        Material::Mirror { .. } => Class::Mirror,
        Material::Glass { .. } => Class::Glass,
    }
}
