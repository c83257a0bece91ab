//! Multi-level B-splines (4.3.6) over a paraboloid map of the lamps.
//!
//! The paraboloid map (Heidrich and Seidel 1998) takes a direction w to `(w.u, w.v) / (1 + w.axis)`: the pole to the
//! middle, the equator to the unit circle, with a ratio of solid angle to area that changes by four only. A set that reaches
//! far beyond the equator gets a second map from the other pole, and the two are blended across the equator.
//!
//! The splines fit deviations from the mean sample, so constants are met exactly, and where no lamp is near the function
//! falls back to the mean.

use std::f64::consts::{FRAC_PI_2, FRAC_PI_6};
use std::sync::Arc;

use super::basis::{Basis, Fit};
use super::lattice::{self, CONTROLS, Datum, LANES, Lanes, Lattices};
use crate::domain::{Axis, Coverage, Directions};
use crate::math::Vec3;

/// Up to this half-angle one map will do.
const ONE_MAP_RAD: f64 = FRAC_PI_2 + 0.2;
/// Two maps are blended where the sine of the latitude lies within this of the equator.
const BLEND: f64 = 0.2;
/// With two maps, each takes the lamps down to 30 degrees below its equator: the coarse levels need more than is shown.
const TWO_MAPS_REACH_RAD: f64 = FRAC_PI_2 + FRAC_PI_6;

/// A paraboloid map, scaled so that its reach fills the unit square.
#[derive(Debug)]
struct Paraboloid {
    pole: Vec3,
    u: Vec3,
    v: Vec3,
    /// Radius of the reach on the paraboloid map: tan of half its angle.
    radius: f64,
}

impl Paraboloid {
    fn new(pole: Vec3, reach_rad: f64) -> Self {
        let helper = if pole.x.abs() < 0.9 { Vec3::x() } else { Axis::Y.vector() };
        let u = pole.cross(&helper).normalize();
        Self { pole, u, v: pole.cross(&u), radius: (reach_rad / 2.0).tan() }
    }

    fn place(&self, direction: &Vec3) -> [f64; 2] {
        let depth = (1.0 + direction.dot(&self.pole)).max(1e-9) * self.radius;
        [direction.dot(&self.u), direction.dot(&self.v)].map(|x| 0.5 * (x / depth + 1.0))
    }
}

/// Where the maps lie, one or two.
#[derive(Debug)]
struct Maps {
    axis: Vec3,
    maps: Vec<(Paraboloid, f64)>,
}

impl Maps {
    fn new(domain: &Directions) -> Self {
        let axis = domain.axis().vector();
        let maps = match domain.coverage() {
            Coverage::Cap { half_angle_rad } if half_angle_rad <= ONE_MAP_RAD => {
                vec![(Paraboloid::new(axis, half_angle_rad), half_angle_rad)]
            }
            _ => [axis, -axis].map(|pole| (Paraboloid::new(pole, TWO_MAPS_REACH_RAD), TWO_MAPS_REACH_RAD)).into(),
        };
        Self { axis, maps }
    }

    /// How much of a direction each map answers for.
    fn shares(&self, direction: &Vec3) -> [f64; 2] {
        if self.maps.len() == 1 {
            return [1.0, 0.0];
        }
        let x = (0.5 + 0.5 * direction.dot(&self.axis) / BLEND).clamp(0.0, 1.0);
        let front = x * x * (3.0 - 2.0 * x);
        [front, 1.0 - front]
    }
}

/// Function 0 is the constant 1; then come the control points of each map, blended.
#[derive(Debug)]
pub(super) struct SplineFunctions {
    maps: Maps,
}

impl SplineFunctions {
    /// For a set of lamps.
    pub fn new(domain: &Directions) -> Self {
        Self { maps: Maps::new(domain) }
    }
}

impl Basis for SplineFunctions {
    fn len(&self) -> usize {
        1 + self.maps.maps.len() * CONTROLS
    }

    fn at(&self, direction: &Vec3, values: &mut Vec<(u32, f64)>) -> u32 {
        values.push((0, 1.0));
        let shares = self.maps.shares(direction);
        for (n, ((map, _), share)) in self.maps.maps.iter().zip(shares).enumerate().filter(|map| map.1.1 > 0.0) {
            let first = (1 + n * CONTROLS) as u32;
            values.extend(lattice::finest(map.place(direction)).map(|(control, w)| (first + control, share * w)));
        }
        0
    }

    /// Twice continuously differentiable: there is no place of change.
    fn refinement(&self) -> usize {
        1
    }

    /// Cells of 1.8 degrees and more, of a cubic: 2.5 texels each.
    fn finest_columns(&self) -> usize {
        512
    }
}

/// The sites of one map that its splines are fitted to.
#[derive(Debug)]
struct Part {
    sites: Vec<u32>,
    lattices: Lattices,
}

/// The multi-level approximation on every map.
#[derive(Debug)]
pub(super) struct MultiLevel {
    sites: usize,
    parts: Vec<Part>,
}

impl MultiLevel {
    /// For a set of lamps.
    pub fn new(domain: &Arc<Directions>) -> Self {
        let part = |(map, reach_rad): (Paraboloid, f64)| {
            let lowest = reach_rad.cos() - 1e-9;
            let inside = |n: &u32| domain.sites()[*n as usize].dot(&map.pole) >= lowest;
            let sites: Vec<u32> = (0..domain.sites().len() as u32).filter(inside).collect();
            let places: Vec<[f64; 2]> = sites.iter().map(|n| map.place(&domain.sites()[*n as usize])).collect();
            Part { sites, lattices: Lattices::new(&places) }
        };
        let parts = Maps::new(domain).maps.into_iter().map(part).collect();
        Self { sites: domain.sites().len(), parts }
    }
}

impl MultiLevel {
    /// The mean sample, and the control points of each map.
    fn fit<T: Datum>(&self, samples: &[T]) -> Vec<T> {
        let mut mean = T::default();
        samples.iter().for_each(|sample| mean.add(1.0 / self.sites as f64, sample));
        let mut coefficients = vec![mean];
        for part in &self.parts {
            let deviation = |n: &u32| {
                let mut deviation = samples[*n as usize];
                deviation.add(-1.0, &mean);
                deviation
            };
            let deviations: Vec<T> = part.sites.iter().map(deviation).collect();
            coefficients.extend(part.lattices.fit(&deviations));
        }
        coefficients
    }
}

impl Fit for MultiLevel {
    fn coefficients(&self, samples: &[f64]) -> Vec<f64> {
        self.fit(samples)
    }

    /// The algorithm itself, on [`LANES`] functions side by side: its steps have a tenth of the matrix's numbers or less.
    fn coefficients_of_lanes(&self, samples: &[f32], lanes: usize) -> Vec<f32> {
        let functions = 1 + self.parts.len() * CONTROLS;
        let mut coefficients = vec![0.0; functions * lanes];
        let mut group: Vec<Lanes> = vec![[0.0; LANES]; self.sites];
        for first in (0..lanes).step_by(LANES) {
            let own = first..(first + LANES).min(lanes);
            for (group, samples) in group.iter_mut().zip(samples.chunks_exact(lanes)) {
                group[..own.len()].copy_from_slice(&samples[own.clone()]);
            }
            for (fitted, out) in self.fit(&group).iter().zip(coefficients.chunks_exact_mut(lanes)) {
                out[own.clone()].copy_from_slice(&fitted[..own.len()]);
            }
        }
        coefficients
    }

    fn cost(&self) -> usize {
        self.parts.iter().map(|part| part.lattices.cost()).sum()
    }

    fn adjoint(&self, moments: &[f64]) -> Vec<f64> {
        let mut sites = vec![0.0; self.sites];
        let mut of_mean = moments[0];
        for (part, controls) in self.parts.iter().zip(moments[1..].chunks_exact(CONTROLS)) {
            for (site, moment) in part.sites.iter().zip(part.lattices.fit_transposed(controls)) {
                sites[*site as usize] += moment;
                of_mean -= moment;
            }
        }
        sites.iter_mut().for_each(|site| *site += of_mean / self.sites as f64);
        sites
    }
}
