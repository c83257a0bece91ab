//! Spherical Delaunay triangulation: the convex hull of the sites, seen from the centre (4.3.2).
//!
//! Stereographic projection carries circles to circles, so the planar Delaunay triangulation of the projected sites is
//! the spherical one, but for the triangles whose circumcircle holds the centre of projection (Renka 1997 and others).
//! - A cap is projected from the far end of its axis. No triangle is wanted across the uncovered part, so the planar
//!   triangulation is all there is, and its hull is a rim of edges.
//! - A sphere is projected from one of its sites: no circumcircle may hold a site, so every triangle that does not touch
//!   that site comes out, and those that do are the edges of the planar hull joined to it. Nothing is missing.
//!
//! Rings of lamps are co-circular, which breaks naive in-circle tests; `spade`'s predicates are exact.

use std::collections::HashMap;

use spade::{DelaunayTriangulation, HasPosition, Point2, Triangulation};

use crate::domain::{Axis, Coverage, Directions};
use crate::math::Vec3;

/// A triangle thinner than this (volume of its tetrahedron with the centre, times six) has no usable barycentrics.
const SMALLEST_DETERMINANT: f64 = 1e-12;

/// Triangles over site numbers, counter-clockwise seen from outside, and the edges that belong to one triangle only.
#[derive(Debug)]
pub(super) struct Delaunay {
    /// Corners.
    pub triangles: Vec<[u32; 3]>,
    /// `neighbours[t][k]` lies across the edge opposite corner k; [`NONE`] at the rim.
    pub neighbours: Vec<[u32; 3]>,
    /// Edges at the rim; where there is no triangle at all (sites on one arc), every edge.
    pub rim: Vec<[u32; 2]>,
    /// A triangle at each site, or [`NONE`].
    pub triangle_at: Vec<u32>,
}

/// No triangle.
pub(super) const NONE: u32 = u32::MAX;

/// A projected site that remembers its number.
struct Projected {
    position: Point2<f64>,
    site: u32,
}

impl HasPosition for Projected {
    type Scalar = f64;
    fn position(&self) -> Point2<f64> {
        self.position
    }
}

impl Delaunay {
    /// Triangulates the sites of a set.
    pub fn new(domain: &Directions) -> Self {
        let sites = domain.sites();
        // On a sphere, project from site 0 itself and close over it below; three sites enclose nothing.
        let whole_sphere = domain.coverage() == Coverage::Sphere && sites.len() > 3;
        let pole = match domain.coverage() {
            Coverage::Sphere if whole_sphere => sites[0],
            Coverage::Sphere => away_from(sites),
            Coverage::Cap { .. } => -domain.axis().vector(),
        };
        let plane = triangulate_plane(sites, &pole, usize::from(whole_sphere));
        let mut triangles: Vec<[u32; 3]> =
            plane.inner_faces().map(|face| face.vertices().map(|vertex| vertex.data().site)).collect();
        if whole_sphere {
            triangles.extend(plane.convex_hull().map(|edge| [edge.from().data().site, edge.to().data().site, 0]));
        }
        triangles.retain_mut(|t| turn_outwards(t, sites));
        let mut rim = Vec::new();
        let neighbours = link(&triangles, &mut rim);
        if triangles.is_empty() {
            rim = plane.undirected_edges().map(|edge| edge.vertices().map(|vertex| vertex.data().site)).collect();
        }
        let mut triangle_at = vec![NONE; sites.len()];
        for (t, corners) in (0..).zip(&triangles) {
            corners.iter().for_each(|&site| triangle_at[site as usize] = t);
        }
        Self { triangles, neighbours, rim, triangle_at }
    }
}

/// A direction far from each of up to three sites.
fn away_from(sites: &[Vec3]) -> Vec3 {
    let sum: Vec3 = sites.iter().sum();
    let other = if sites[0].x.abs() < 0.5 { Vec3::x() } else { Vec3::y() };
    let normal = sites[0].cross(sites.get(1).unwrap_or(&other));
    // Sites that balance lie in a plane or face each other: off that plane, or off their line, is far from all.
    [-sum, normal, sites[0].cross(&other)].into_iter().find(|v| v.norm() > 1e-3).unwrap_or(other).normalize()
}

/// Planar Delaunay triangulation of the sites from number `first` on, projected stereographically from `pole`.
fn triangulate_plane(sites: &[Vec3], pole: &Vec3, first: usize) -> DelaunayTriangulation<Projected> {
    let helper = if pole.x.abs() < 0.9 { Vec3::x() } else { Axis::Y.vector() };
    let u = pole.cross(&helper).normalize();
    let v = pole.cross(&u);
    let mut plane = DelaunayTriangulation::new();
    for (site, number) in sites.iter().zip(0u32..).skip(first) {
        let depth = 1.0 - site.dot(pole);
        let position = Point2::new(site.dot(&u) / depth, site.dot(&v) / depth);
        // The only refusals are NaN and numbers spade calls too small or too large; a site exactly at the pole is one.
        // It stays without triangle and is then reached through its rim or its own cell.
        let _ = plane.insert(Projected { position: settle(position), site: number });
    }
    plane
}

/// Spade refuses coordinates below 2^-142; they mean zero here.
fn settle(position: Point2<f64>) -> Point2<f64> {
    let zeroed = |value: f64| if value.abs() < 1e-40 { 0.0 } else { value };
    Point2::new(zeroed(position.x), zeroed(position.y))
}

/// Orders corners counter-clockwise seen from outside; false for a degenerate triangle.
fn turn_outwards(corners: &mut [u32; 3], sites: &[Vec3]) -> bool {
    let [a, b, c] = corners.map(|n| sites[n as usize]);
    let determinant = a.dot(&b.cross(&c));
    if determinant < 0.0 {
        corners.swap(1, 2);
    }
    determinant.abs() > SMALLEST_DETERMINANT
}

/// Neighbours across each edge; edges met once go to `rim`.
fn link(triangles: &[[u32; 3]], rim: &mut Vec<[u32; 2]>) -> Vec<[u32; 3]> {
    let mut owner: HashMap<(u32, u32), u32> = HashMap::new();
    for (t, [a, b, c]) in (0..).zip(triangles) {
        owner.extend([((*b, *c), t), ((*c, *a), t), ((*a, *b), t)]);
    }
    let mut across = |a: u32, b: u32| {
        owner.get(&(b, a)).copied().unwrap_or_else(|| {
            rim.push([a, b]);
            NONE
        })
    };
    triangles.iter().map(|&[a, b, c]| [across(b, c), across(c, a), across(a, b)]).collect()
}
