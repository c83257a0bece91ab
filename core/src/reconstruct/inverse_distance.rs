//! Distance-weighted interpolation (4.3.3): Shepard's method, `w_i = d_i^-r / sum_j d_j^-r` over the nearest sites, `r` = 2.

use std::sync::Arc;

use super::basis::Basis;
use crate::domain::Directions;
use crate::math::{Vec3, angle_between};

/// How many sites count (4.3.3).
const NEAREST: usize = 32;
/// Nearer than this a direction is the site's: squares of smaller angles lose their digits.
const AT_SITE_RAD: f64 = 1e-8;
/// Texels in a spacing of the lamps: the kernel is smooth, `1 - c d^2` about its site.
const TEXELS_A_SPACING: f64 = 6.0;

/// Shepard's weights, with the geodesic distance (the angle).
#[derive(Debug)]
pub(super) struct InverseDistance {
    domain: Arc<Directions>,
    finest_columns: usize,
}

impl InverseDistance {
    /// Over a set of lamps.
    pub fn new(domain: Arc<Directions>) -> Self {
        let texel = domain.median_spacing() / TEXELS_A_SPACING;
        let finest_columns = ((std::f64::consts::TAU / texel).ceil() as usize).next_power_of_two().clamp(128, 1024);
        Self { domain, finest_columns }
    }
}

impl Basis for InverseDistance {
    fn len(&self) -> usize {
        self.domain.sites().len()
    }

    fn at(&self, direction: &Vec3, values: &mut Vec<(u32, f64)>) -> u32 {
        let first = values.len();
        for site in self.domain.nearest_sites(direction).take(NEAREST) {
            let distance = angle_between(direction, &self.domain.sites()[site]);
            if distance < AT_SITE_RAD {
                values.truncate(first);
                values.push((site as u32, 1.0));
                return 0;
            }
            values.push((site as u32, distance.powi(-2)));
        }
        let sum: f64 = values[first..].iter().map(|v| v.1).sum();
        values[first..].iter_mut().for_each(|v| v.1 /= sum);
        0
    }

    /// Only the rim of the coverage is a place of change.
    fn refinement(&self) -> usize {
        1
    }

    fn finest_columns(&self) -> usize {
        self.finest_columns
    }
}
