//! Bodies before the camera.

use super::V3;
use super::material::Material;
use super::shape::{Ray, Shape, Slices};

/// A shape of one material.
#[derive(Debug, Clone, PartialEq)]
pub struct Object {
    /// Its form and place.
    pub shape: Shape,
    /// What it is made of.
    pub material: Material,
}

/// What stands before the camera. Bodies may touch; they must not overlap when one of them is glass.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Scene {
    /// All bodies.
    pub objects: Vec<Object>,
}

/// Where a ray meets a body.
#[derive(Debug, Clone, Copy)]
pub(super) struct Hit {
    /// Index of the object.
    pub object: usize,
    pub point: V3,
    /// Outward unit normal.
    pub normal: V3,
}

impl Scene {
    /// The nearest hit.
    pub(super) fn hit(&self, ray: &Ray) -> Option<Hit> {
        let (mut nearest, mut object) = (f32::INFINITY, None);
        for (i, o) in self.objects.iter().enumerate() {
            if let Some(t) = o.shape.hit(ray).filter(|t| *t < nearest) {
                (nearest, object) = (t, Some(i));
            }
        }
        let point = ray.at(nearest);
        object.map(|object| Hit { object, point, normal: self.objects[object].shape.normal(&point) })
    }

    /// Does anything but `own` (the body whose surface the ray leaves outwards, if convex) block a ray?
    pub(super) fn blocks(&self, ray: &Ray, own: usize) -> bool {
        self.others(own).any(|o| o.shape.hit(ray).is_some())
    }

    /// What can stand in the light of a point of object `own`: that itself too, if it is concave.
    fn others(&self, own: usize) -> impl Iterator<Item = &Object> {
        let can = move |(i, o): &(usize, &Object)| *i != own || o.shape.is_concave();
        self.objects.iter().enumerate().filter(can).map(|(_, object)| object)
    }

    /// Which directions are free of bodies, seen from a point on the surface of object `own`: 1 free, 0 blocked.
    pub(super) fn visible(&self, point: &V3, own: usize, directions: Slices<'_>, visible: &mut [f32]) {
        visible.fill(1.0);
        for object in self.others(own) {
            object.shape.shade(point, directions, visible);
        }
    }

    /// The mirrors and glasses, as (index, middle, radius of a ball around them).
    pub(super) fn speculars(&self) -> Vec<(usize, V3, f32)> {
        let ball = |(i, o): (usize, &Object)| {
            let (centre, radius) = o.shape.bounds();
            o.material.is_specular().then_some((i, centre, radius))
        };
        self.objects.iter().enumerate().filter_map(ball).collect()
    }
}
