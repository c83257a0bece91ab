//! Directions and the maps that hold them.
//!
//! The stage frame is right-handed, object at the origin: +x right and +y up in the camera image, +z from the object
//! towards the camera. A light direction is a unit vector from the object to the light. Angles are radians unless a
//! name says `_deg`.

pub mod harmonics;
pub mod latlong;
pub mod low_rank;
mod orientation;
pub mod projection;

pub use orientation::Orientation;

/// A vector or point in the stage frame.
pub type Vec3 = nalgebra::Vector3<f64>;

/// A 3 x 3 matrix, as of a rotation.
pub type Mat3 = nalgebra::Matrix3<f64>;

/// The angle between two unit vectors, exact also near 0 and pi (Kahan's two-argument form).
pub fn angle_between(a: &Vec3, b: &Vec3) -> f64 {
    2.0 * (a - b).norm().atan2((a + b).norm())
}

/// Rotates about +y, right-handed: a positive heading carries +z towards +x.
pub fn rotate_heading(direction: &Vec3, heading_rad: f64) -> Vec3 {
    let (s, c) = heading_rad.sin_cos();
    Vec3::new(c * direction.x + s * direction.z, direction.y, c * direction.z - s * direction.x)
}
