//! Distant light from one direction.

use crate::math::Vec3;

/// A distant light, or a small part of a larger one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Beam {
    /// Unit vector from the object to the light, stage frame.
    pub direction: Vec3,
    /// What it gives a patch facing it, linear RGB: radiance times solid angle.
    pub irradiance: [f64; 3],
}
