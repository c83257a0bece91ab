//! 4D light onto the squares of a projector at many positions (7.2): the projection `w = U L`.
//!
//! The weight of square s of position j is the mean over what the square lights of
//! `|p_j - q|^2 * integral of U_j(x) dE(q)`: q a point of the focal plane, which goes through the origin and faces the
//! projector; dE the irradiance that arrives at q from a direction, on a patch that faces it; x where that ray comes through the
//! sphere of positions; `U_j` the kernel of position j. So a square gets the radiant intensity that gives its part of the object
//! what the light gives it. A light that stands where the projector stood is given back exactly, box-filtered; a
//! distant light is what a stage's lamps make of it. In terms of the sphere of positions it is the integral over the position's
//! cell and the square of `L cos(theta) dA`, the mean over the square taken where design and T ask for an intensity.
//!
//! Between positions light is blended, not moved: what lies on the focal plane stays where it is, what stands before or behind it
//! is lit from the neighbouring positions at once.

use std::sync::Arc;

use rayon::prelude::*;

use super::texels::{Entry, Texels};
use super::{Method, Outside, Reconstruction};
use crate::domain::Gantry;
use crate::error::{Error, Result};
use crate::illumination::Incident;
use crate::math::{Vec3, latlong};

/// Places along each side of a square where rays are looked at, by how many rays there are at a place: a spot's edge through a
/// square is right to 1/64, and a large light has its own many samples.
const LOOKS: [(usize, usize); 3] = [(2, 8), (16, 4), (usize::MAX, 2)];
/// Places along each side of a picture where radiance is integrated, for light that differs from point to point and for light that
/// does not: then only the parallax between the places counts, which is smooth.
const PLACES: [usize; 2] = [32, 8];
/// Places along each side of a picture where it is asked whether a position has any part in a light.
const PROBES: usize = 5;

/// A method over the positions of a gantry: everything that does not depend on the light.
#[derive(Debug)]
pub struct Squares {
    gantry: Arc<Gantry>,
    reconstruction: Reconstruction,
    /// The site of each position, and how many positions share it.
    sites: Vec<(u32, usize)>,
    outside: Outside,
    /// Of each position, the texels of its kernel: direction, and steradians times U_j.
    cells: Vec<Vec<(Vec3, f64)>>,
}

/// What comes to a square from a place of its picture.
type Rgb = [f64; 3];

impl Squares {
    /// Radiance is integrated over the sphere of positions in a map of so many columns: 1.4 degrees, a seventh of the cells of 224
    /// positions. Maps are to be averaged down to it.
    pub const COLUMNS: usize = 256;

    /// Builds the structure: about a tenth of a second.
    ///
    /// # Errors
    /// A method whose kernels reach over all positions; as [`Reconstruction::new`].
    pub fn new(gantry: Arc<Gantry>, method: Method, outside: Outside) -> Result<Self> {
        let reconstruction = Reconstruction::new(gantry.directions().clone(), method)?;
        if reconstruction.fit().is_some() {
            return Err(Error::Unsupported {
                place: "the positions of the projector".to_owned(),
                what: format!("`{}`, whose kernels reach over all positions,", method.id()),
                advice: "use linear, zero-order, inverse-distance or a wavelet".to_owned(),
            });
        }
        let mut sites = vec![(0, 1); gantry.poses().len()];
        for (members, site) in gantry.directions().members().iter().zip(0..) {
            members.iter().for_each(|&position| sites[position as usize] = (site, members.len()));
        }
        let mut squares = Self { gantry, reconstruction, sites, outside, cells: Vec::new() };
        squares.cells = squares.integrated();
        Ok(squares)
    }

    /// The kernels over the texels of a map.
    fn integrated(&self) -> Vec<Vec<(Vec3, f64)>> {
        let (width, height) = (Self::COLUMNS, Self::COLUMNS / 2);
        let (domain, basis) = (self.gantry.directions(), self.reconstruction.basis());
        let texels = Texels { domain, basis, outside: self.outside, width, height, finest_rows: height };
        let mut of_sites = vec![Vec::new(); basis.len()];
        for Entry { texel, function, steradians } in texels.integrate() {
            let (i, j) = (texel as usize % width, texel as usize / width);
            let direction = latlong::direction(i as f64 + 0.5, j as f64 + 0.5, width, height);
            // What is given to the nearest site counts after the functions.
            of_sites[function as usize % basis.len()].push((direction, steradians));
        }
        let of_position = |&(site, shared): &(u32, usize)| -> Vec<(Vec3, f64)> {
            of_sites[site as usize].iter().map(|(direction, sr)| (*direction, sr / shared as f64)).collect()
        };
        self.sites.iter().map(of_position).collect()
    }

    /// Weights of the squares, RGB, one an element of the gantry.
    pub fn project(&self, light: &dyn Incident) -> Vec<[f32; 3]> {
        let squares = self.gantry.squares();
        let mut weights = vec![[0.0f32; 3]; self.gantry.len()];
        weights.par_chunks_mut(squares).enumerate().for_each(|(position, weights)| {
            let mut sums = vec![[0.0; 3]; squares];
            self.add_rays(position, light, &mut sums);
            if light.has_radiance() {
                self.add_radiance(position, light, &mut sums);
            }
            weights.iter_mut().zip(sums).for_each(|(weight, sum)| *weight = sum.map(|v| v as f32));
        });
        weights
    }

    /// The share of a light's rays at the object that come from where the projector stood; `None` for a light without rays
    /// there.
    pub fn covered(&self, light: &dyn Incident) -> Option<f64> {
        let (mut all, mut kept) = (0.0, 0.0);
        for position in 0..self.gantry.poses().len() {
            let radius = self.gantry.poses()[position].place.norm();
            for at in probes() {
                let q = self.gantry.at(position, at);
                light.arriving(&q, &mut |towards, irradiance| {
                    let energy: f64 = irradiance.iter().sum();
                    all += energy;
                    let inside = crossing(&q, &towards, radius).is_some_and(|x| self.gantry.directions().covers(&x));
                    kept += if inside { energy } else { 0.0 };
                });
            }
        }
        (all > 0.0).then(|| kept / all)
    }

    /// U_j(x).
    fn share(&self, position: usize, x: &Vec3, values: &mut Vec<(u32, f64)>) -> f64 {
        let (site, shared) = self.sites[position];
        if !self.gantry.directions().covers(x) {
            let own = self.outside == Outside::Nearest && self.gantry.directions().nearest_site(x) == site as usize;
            return if own { 1.0 / shared as f64 } else { 0.0 };
        }
        values.clear();
        self.reconstruction.basis().at(x, values);
        values.iter().filter(|value| value.0 == site).map(|value| value.1).sum::<f64>() / shared as f64
    }

    /// What rays give.
    fn add_rays(&self, position: usize, light: &dyn Incident, sums: &mut [Rgb]) {
        let place = self.gantry.poses()[position].place;
        let (radius, mut values) = (place.norm(), Vec::new());
        let mut rays = 0;
        let mut any = false;
        for at in probes() {
            let q = self.gantry.at(position, at);
            light.arriving(&q, &mut |towards, _| {
                rays += 1;
                any =
                    any || crossing(&q, &towards, radius).is_some_and(|x| self.share(position, &x, &mut values) != 0.0);
            });
        }
        if !any {
            return;
        }
        let rays = rays / (PROBES * PROBES);
        let looks = LOOKS.iter().find(|(most, _)| rays <= *most).map_or(2, |looks| looks.1);
        let (side, filter) = (self.gantry.side(), self.gantry.filter());
        let places = Places::new(filter, looks);
        for (n, sum) in sums.iter_mut().enumerate() {
            let (column, row) = ((n % side) as f64 + 0.5, (n / side) as f64 + 0.5);
            for &([across, down], weight) in &places.0 {
                let q = self.gantry.at(position, [(column + across) / side as f64, (row + down) / side as f64]);
                let square = (place - q).norm_squared();
                light.arriving(&q, &mut |towards, irradiance| {
                    if irradiance == [0.0; 3] {
                        return;
                    }
                    let Some(x) = crossing(&q, &towards, radius) else { return };
                    let factor = weight * square * self.share(position, &x, &mut values);
                    (0..3).for_each(|c| sum[c] += factor * irradiance[c]);
                });
            }
        }
    }

    /// What radiance gives: integrated at some places of the picture, linear between them.
    fn add_radiance(&self, position: usize, light: &dyn Incident, sums: &mut [Rgb]) {
        let place = self.gantry.poses()[position].place;
        let (side, radius) = (self.gantry.side(), place.norm());
        let across = PLACES[usize::from(!light.varies())].min(side);
        let irradiance = |n: usize| -> Rgb {
            let share = |k: usize| (k as f64 + 0.5) / across as f64;
            let q = self.gantry.at(position, [share(n % across), share(n / across)]);
            let mut sum = [0.0; 3];
            for (direction, steradians) in &self.cells[position] {
                let to = direction * radius - q;
                let distance = to.norm();
                let towards = to / distance;
                // Steradians seen from q.
                let seen = steradians * radius * radius * direction.dot(&towards).max(0.0) / (distance * distance);
                let radiance = light.radiance(&q, &towards);
                (0..3).for_each(|c| sum[c] += seen * radiance[c]);
            }
            sum
        };
        let irradiances: Vec<Rgb> = (0..across * across).map(irradiance).collect();
        let normal = 1.0 / self.gantry.filter().sum().powi(2);
        for (n, sum) in sums.iter_mut().enumerate() {
            let at = |k: usize| ((k as f64 + 0.5) / side as f64 * across as f64 - 0.5).clamp(0.0, (across - 1) as f64);
            let (x, y) = (at(n % side), at(n / side));
            let q = self
                .gantry
                .at(position, [((n % side) as f64 + 0.5) / side as f64, ((n / side) as f64 + 0.5) / side as f64]);
            let square = (place - q).norm_squared() * normal;
            for (row, down) in [(y.floor(), 1.0 - y.fract()), ((y.floor() + 1.0).min((across - 1) as f64), y.fract())] {
                for (column, along) in
                    [(x.floor(), 1.0 - x.fract()), ((x.floor() + 1.0).min((across - 1) as f64), x.fract())]
                {
                    let near = irradiances[row as usize * across + column as usize];
                    (0..3).for_each(|c| sum[c] += square * down * along * near[c]);
                }
            }
        }
    }
}

/// Places over a picture.
fn probes() -> impl Iterator<Item = [f64; 2]> {
    let share = |n: usize| n as f64 / (PROBES - 1) as f64;
    (0..PROBES * PROBES).map(move |n| [share(n % PROBES), share(n / PROBES)])
}

/// The direction from the origin of where a ray from a point leaves the sphere of positions; none from outside of it.
fn crossing(q: &Vec3, towards: &Vec3, radius: f64) -> Option<Vec3> {
    let along = q.dot(towards);
    let root = along * along - q.norm_squared() + radius * radius;
    let t = -along + root.max(0.0).sqrt();
    (root > 0.0 && t > 0.0).then(|| (q + towards * t) / radius)
}

/// Places over a square and its filter's neighbours: offsets in squares, and weights that sum to the share of light that one square
/// carries.
struct Places(Vec<([f64; 2], f64)>);

impl Places {
    fn new(filter: crate::domain::Filter, looks: usize) -> Self {
        let reach = filter.reach();
        let count = (2.0 * reach * looks as f64).round() as usize;
        let line: Vec<(f64, f64)> = (0..count)
            .map(|n| reach * (2.0 * (n as f64 + 0.5) / count as f64 - 1.0))
            .map(|offset| (offset, filter.at(offset)))
            .collect();
        let all: f64 = line.iter().map(|place| place.1).sum::<f64>() * filter.sum();
        let cross =
            |&(y, v): &(f64, f64)| line.iter().map(move |&(x, u)| ([x, y], u * v / (all * all))).collect::<Vec<_>>();
        Self(line.iter().flat_map(cross).collect())
    }
}
