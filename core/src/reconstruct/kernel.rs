//! What a reconstruction answers for one direction.

use crate::math::Vec3;

/// Up to three sites and their shares, which sum to one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stencil {
    /// Site numbers; unused places repeat a used one with share 0.
    pub sites: [u32; 3],
    /// Shares, none negative.
    pub shares: [f64; 3],
    /// Equal for directions between which the shares vary smoothly (the same cell, triangle or edge).
    pub region: u32,
}

impl Stencil {
    /// All of it to one site.
    pub fn one(site: usize, region: u32) -> Self {
        Self { sites: [site as u32; 3], shares: [1.0, 0.0, 0.0], region }
    }
}

/// The kernels `U_j(w)` of a method over one set of lamps.
///
/// For every unit direction the shares sum to one and are not negative, and at a site that site has all of it.
pub trait Kernel: Sync {
    /// `U_j(w)` for the sites j where it is not zero.
    fn at(&self, direction: &Vec3) -> Stencil;

    /// Into how many parts a side of a texel is cut where regions meet in it.
    fn refinement(&self) -> usize;
}
