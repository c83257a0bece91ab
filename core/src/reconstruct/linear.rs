//! Linear interpolation (4.3.2): barycentric weights in the spherical Delaunay triangle of a direction.
//!
//! The weights b solve `w = b_0 p_0 + b_1 p_1 + b_2 p_2` for the corners p of the triangle, scaled to sum to one: the
//! barycentrics of the point where the ray w pierces the flat triangle, so a function linear on each facet is met exactly.
//! Between the rim of the triangulation and the end of the coverage, a direction takes the value of the nearest point of
//! the rim, so the kernels stay continuous and sum to one.

use std::sync::Arc;

use nalgebra::Matrix3;

use super::basis::Basis;
use super::delaunay::{Delaunay, NONE};
use crate::domain::Directions;
use crate::math::Vec3;

/// Barycentrics a little below zero still count as inside: neighbours share the edge.
const EDGE_TOLERANCE: f64 = 1e-12;

/// Hat kernels over the spherical Delaunay triangulation.
#[derive(Debug)]
pub(super) struct Linear {
    domain: Arc<Directions>,
    mesh: Delaunay,
    /// For each triangle the inverse of the matrix with its corners as columns.
    inverses: Vec<Matrix3<f64>>,
}

impl Linear {
    /// Triangulates a set of lamps. Time is about n log n.
    pub fn new(domain: Arc<Directions>) -> Self {
        let mesh = Delaunay::new(&domain);
        let corners = |t: &[u32; 3]| Matrix3::from_columns(&t.map(|n| domain.sites()[n as usize]));
        // Degenerate triangles were left out, so every inverse exists.
        let inverses = mesh.triangles.iter().map(|t| corners(t).try_inverse().unwrap_or_default()).collect();
        Self { domain, mesh, inverses }
    }

    /// Spherical triangles, as triples of site numbers, counter-clockwise seen from outside.
    #[cfg(test)]
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.mesh.triangles
    }

    /// Walks from a triangle at the nearest site across the edge with the most negative barycentric, until none is. On
    /// Delaunay triangulations this visibility walk ends (Devillers, Pion, Teillaud 2002); a bound guards the degenerate.
    fn locate(&self, direction: &Vec3, nearest: usize) -> Option<(u32, Vec3)> {
        let mut triangle = self.mesh.triangle_at[nearest];
        for _ in 0..self.mesh.triangles.len() {
            if triangle == NONE {
                return None;
            }
            let b = self.inverses[triangle as usize] * direction;
            let lowest = b.imin();
            if b[lowest] >= -EDGE_TOLERANCE {
                return Some((triangle, b));
            }
            triangle = self.mesh.neighbours[triangle as usize][lowest];
        }
        None
    }

    /// The nearest point of the rim, as shares of its ends, and the number of its region.
    fn on_rim(&self, direction: &Vec3, nearest: usize, values: &mut Vec<(u32, f64)>) -> u32 {
        let sites = self.domain.sites();
        let mut closest = direction.dot(&sites[nearest]);
        let mut found = None;
        for (number, &[a, b]) in (0..).zip(&self.mesh.rim) {
            let (p, q) = (sites[a as usize], sites[b as usize]);
            // Solve for the point of the great circle nearest to w: w's projection on the plane of p and q.
            let cos = p.dot(&q);
            let (wp, wq) = (direction.dot(&p), direction.dot(&q));
            let sin2 = 1.0 - cos * cos;
            let (s, t) = ((wp - cos * wq) / sin2, (wq - cos * wp) / sin2);
            let closeness = (p * s + q * t).norm();
            if s > 0.0 && t > 0.0 && closeness > closest {
                closest = closeness;
                found = Some(([a, b], t / (s + t), number));
            }
        }
        let first_edge = self.mesh.triangles.len() as u32;
        match found {
            Some(([a, b], share, number)) => {
                values.extend([(a, 1.0 - share), (b, share)]);
                first_edge + number
            }
            None => {
                values.push((nearest as u32, 1.0));
                first_edge + self.mesh.rim.len() as u32
            }
        }
    }
}

impl Basis for Linear {
    fn len(&self) -> usize {
        self.domain.sites().len()
    }

    fn at(&self, direction: &Vec3, values: &mut Vec<(u32, f64)>) -> u32 {
        let nearest = self.domain.nearest_site(direction);
        let Some((triangle, b)) = self.locate(direction, nearest) else {
            return self.on_rim(direction, nearest, values);
        };
        let b = b.map(|share| share.max(0.0));
        let sum = b.sum();
        values.extend(self.mesh.triangles[triangle as usize].iter().zip(&b).map(|(&site, share)| (site, share / sum)));
        triangle
    }

    /// The function is continuous and only bends where triangles meet.
    fn refinement(&self) -> usize {
        4
    }
}
