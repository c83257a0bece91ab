//! Points in squares, and directions from them.

use super::V3;
use std::f32::consts::PI;

/// A two-dimensional low-discrepancy sequence (M. Roberts' R2: multiples of 1/g and 1/g^2, g the plastic number), shifted
/// by a random start, so that each point alone is uniform and any run of them is spread out.
#[derive(Debug, Clone, Copy)]
pub(super) struct Spread {
    state: [u32; 2],
}

impl Spread {
    /// Starts at a random shift.
    pub fn new(shift: u64) -> Self {
        Self { state: [shift as u32, (shift >> 32) as u32] }
    }

    /// The next point of the unit square, `[0, 1)` each.
    pub fn next(&mut self) -> [f32; 2] {
        // 2^32 / g and 2^32 / g^2.
        self.state[0] = self.state[0].wrapping_add(3_242_174_889);
        self.state[1] = self.state[1].wrapping_add(2_447_445_414);
        self.state.map(unit)
    }
}

/// A one-dimensional low-discrepancy sequence, multiples of the golden ratio from a random start; it goes with a [`Spread`]
/// as the third dimension.
#[derive(Debug, Clone, Copy)]
pub(super) struct Steps(u32);

impl Steps {
    /// Starts at a random shift.
    pub fn new(shift: u32) -> Self {
        Self(shift)
    }

    /// The next number, `[0, 1)`.
    pub fn next(&mut self) -> f32 {
        // 2^32 over the golden ratio.
        self.0 = self.0.wrapping_add(2_654_435_769);
        unit(self.0)
    }
}

/// 24 bits of an integer as a number in `[0, 1)`.
pub(super) fn unit(bits: u32) -> f32 {
    (bits >> 8) as f32 * (1.0 / (1 << 24) as f32)
}

/// Two unit vectors that complete a unit normal to a right-handed frame (Duff et al., "Building an Orthonormal Basis,
/// Revisited", JCGT 2017).
pub(super) fn frame(n: &V3) -> (V3, V3) {
    let sign = 1f32.copysign(n.z);
    let a = -1.0 / (sign + n.z);
    let b = n.x * n.y * a;
    (V3::new(1.0 + sign * n.x * n.x * a, sign * b, -sign * n.x), V3::new(b, sign + n.y * n.y * a, -n.y))
}

/// Uniform in the cone of `cos_rim` about `axis`; its density is `1 / (2 pi (1 - cos_rim))`.
pub(super) fn cone(axis: &V3, one_minus_cos_rim: f32, u: [f32; 2]) -> V3 {
    let below = u[0] * one_minus_cos_rim;
    let (sin, phi) = ((below * (2.0 - below)).max(0.0).sqrt(), 2.0 * PI * u[1]);
    let (s, t) = frame(axis);
    s * (sin * phi.cos()) + t * (sin * phi.sin()) + axis * (1.0 - below)
}

/// With density cos / pi about a normal.
pub(super) fn cosine(normal: &V3, u: [f32; 2]) -> V3 {
    let (radius, phi) = (u[0].sqrt(), 2.0 * PI * u[1]);
    let (s, t) = frame(normal);
    s * (radius * phi.cos()) + t * (radius * phi.sin()) + normal * (1.0 - u[0]).max(0.0).sqrt()
}
