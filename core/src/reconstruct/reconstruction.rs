//! A method over one set of lamps: everything that does not depend on the light.

use std::sync::Arc;

use super::basis::{Basis, Fit};
use super::harmonics::{Harmonics, LeastSquares};
use super::inverse_distance::InverseDistance;
use super::linear::Linear;
use super::spline::{MultiLevel, SplineFunctions};
use super::wavelet_grid::WaveletGrid;
use super::zero_order::ZeroOrder;
use super::{Method, Outside};
use crate::domain::Directions;
use crate::error::{Error, Result};
use crate::illumination::Beam;
use crate::math::Vec3;

/// The structure of a method over a set of lamps: its kernels `U_j(w)`, which sum to one over the lamps everywhere in the
/// coverage. Build it once a set; sharing it is cheap.
///
/// ```
/// use relume_core::{domain::Directions, math::Vec3, reconstruct::{Method, Reconstruction}};
/// use std::sync::Arc;
///
/// let lamps = Arc::new(Directions::new(vec![Vec3::z(), Vec3::x(), Vec3::y()])?);
/// let linear = Reconstruction::new(lamps, Method::Linear)?;
/// let between = linear.values(&[0.0, 2.0, 0.0], &[Vec3::new(1.0, 0.0, 1.0).normalize()]);
/// assert!((between[0] - 1.0).abs() < 1e-6, "{between:?}");
/// # Ok::<(), relume_core::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct Reconstruction {
    domain: Arc<Directions>,
    method: Method,
    basis: Arc<dyn Basis>,
    fit: Option<Arc<dyn Fit>>,
}

impl Reconstruction {
    /// Builds the structure: at most about a second for some thousand lamps.
    ///
    /// # Errors
    /// A method that needs a grid, over lamps that are not one, and wavelets that cannot interpolate (D4, D8); the message
    /// names what would do.
    pub fn new(domain: Arc<Directions>, method: Method) -> Result<Self> {
        let (basis, fit): (Arc<dyn Basis>, Option<Arc<dyn Fit>>) = match method {
            Method::ZeroOrder => (Arc::new(ZeroOrder::new(domain.clone())), None),
            Method::Linear => (Arc::new(Linear::new(domain.clone())), None),
            Method::InverseDistance => (Arc::new(InverseDistance::new(domain.clone())), None),
            Method::Harmonics { bands } => {
                let bands = bands.max(1) as usize;
                (Arc::new(Harmonics::new(bands)), Some(Arc::new(LeastSquares::new(&domain, bands))))
            }
            Method::Wavelet(wavelet) => {
                let grid = WaveletGrid::new(domain.clone(), wavelet)?.ok_or_else(|| no_grid(method))?;
                (Arc::new(grid), None)
            }
            Method::BSpline => (Arc::new(SplineFunctions::new(&domain)), Some(Arc::new(MultiLevel::new(&domain)))),
        };
        Ok(Self { domain, method, basis, fit })
    }

    /// The lamps.
    pub fn domain(&self) -> &Arc<Directions> {
        &self.domain
    }

    /// The method.
    pub fn method(&self) -> Method {
        self.method
    }

    pub(super) fn basis(&self) -> &dyn Basis {
        &*self.basis
    }

    pub(super) fn fit(&self) -> Option<&Arc<dyn Fit>> {
        self.fit.as_ref()
    }

    /// `U_j(w)` of the lamps j where it is not zero: (lamp, share), lamps ascending. Shares sum to one; some are negative
    /// for methods that are not convex. The coverage is not looked at.
    pub fn at(&self, direction: &Vec3) -> Vec<(u32, f64)> {
        let mut values = Vec::new();
        self.basis.at(direction, &mut values);
        let shares = self.to_lamps(&self.shares_of_sites(&values));
        (0..).zip(shares).filter(|entry| entry.1 != 0.0).collect()
    }

    /// For each site its share of a direction, where the functions have `values`.
    pub(super) fn shares_of_sites(&self, values: &[(u32, f64)]) -> Vec<f64> {
        self.sites_of(&self.gathered(values))
    }

    /// The reconstructed function at some directions, from one sample a lamp. Lamps at one place count by their mean.
    ///
    /// # Panics
    /// When `samples` does not hold one number a lamp.
    pub fn values(&self, samples: &[f32], directions: &[Vec3]) -> Vec<f32> {
        let coefficients = self.coefficients(samples);
        let mut values = Vec::new();
        let mut at = |direction: &Vec3| {
            values.clear();
            self.basis.at(direction, &mut values);
            values.iter().map(|&(n, value)| coefficients[n as usize] * value).sum::<f64>() as f32
        };
        directions.iter().map(&mut at).collect()
    }

    /// Weights of the lamps under some beams: `w_j = sum over beams of U_j(direction) irradiance`, RGB. An area light is
    /// many beams, which makes this the integral of the kernels over it.
    pub fn project(&self, beams: &[Beam], outside: Outside) -> Vec<[f32; 3]> {
        let mut moments = vec![[0.0; 3]; self.basis.len()];
        let mut nearest = vec![[0.0; 3]; self.domain.sites().len()];
        let mut values = Vec::new();
        for beam in beams {
            if self.domain.covers(&beam.direction) {
                values.clear();
                self.basis.at(&beam.direction, &mut values);
                values.iter().for_each(|&(n, value)| add(&mut moments[n as usize], value, &beam.irradiance));
            } else if outside == Outside::Nearest {
                add(&mut nearest[self.domain.nearest_site(&beam.direction)], 1.0, &beam.irradiance);
            }
        }
        self.weights(&moments, Some(&nearest))
    }

    /// From moments (the integrals of the light times each function, RGB), and light given straight to sites, to weights
    /// of the lamps.
    pub(super) fn weights(&self, moments: &[[f64; 3]], direct: Option<&[[f64; 3]]>) -> Vec<[f32; 3]> {
        let channel = |c: usize| {
            let moments: Vec<f64> = moments.iter().map(|m| m[c]).collect();
            let mut sites = self.sites_of(&moments);
            if let Some(direct) = direct {
                sites.iter_mut().zip(direct).for_each(|(site, light)| *site += light[c]);
            }
            self.to_lamps(&sites)
        };
        let [red, green, blue] = [channel(0), channel(1), channel(2)];
        (0..red.len()).map(|n| [red[n] as f32, green[n] as f32, blue[n] as f32]).collect()
    }

    /// From one sample a lamp to one coefficient a function: the sites' samples themselves where functions are kernels, else
    /// what was fitted, such as spherical harmonics by number.
    ///
    /// # Panics
    /// When `samples` does not hold one number a lamp.
    pub fn coefficients(&self, samples: &[f32]) -> Vec<f64> {
        let sites = self.to_sites(samples);
        self.fit.as_ref().map_or_else(|| sites.clone(), |fit| fit.coefficients(&sites))
    }

    /// From one sample a lamp to one a site, their mean.
    pub(super) fn to_sites(&self, samples: &[f32]) -> Vec<f64> {
        assert_eq!(samples.len(), self.domain.len(), "one sample a lamp");
        let mean = |members: &Vec<u32>| {
            members.iter().map(|&n| f64::from(samples[n as usize])).sum::<f64>() / members.len() as f64
        };
        self.domain.members().iter().map(mean).collect()
    }

    /// From one number a function to one a site.
    fn sites_of(&self, moments: &[f64]) -> Vec<f64> {
        self.fit.as_ref().map_or_else(|| moments.to_vec(), |fit| fit.adjoint(moments))
    }

    /// A site's lamps share what it has equally.
    fn to_lamps(&self, sites: &[f64]) -> Vec<f64> {
        let mut lamps = vec![0.0; self.domain.len()];
        for (members, site) in self.domain.members().iter().zip(sites) {
            members.iter().for_each(|&lamp| lamps[lamp as usize] = site / members.len() as f64);
        }
        lamps
    }

    fn gathered(&self, values: &[(u32, f64)]) -> Vec<f64> {
        let mut all = vec![0.0; self.basis.len()];
        values.iter().for_each(|&(n, value)| all[n as usize] += value);
        all
    }
}

fn no_grid(method: Method) -> Error {
    Error::Unsupported {
        place: "the lamps".to_owned(),
        what: format!("`{}`, which needs a grid, on lamps that do not stand on rings of equal longitudes", method.id()),
        advice: "use linear, b-spline, inverse-distance, zero-order or harmonics".to_owned(),
    }
}

fn add(sum: &mut [f64; 3], value: f64, rgb: &[f64; 3]) {
    sum.iter_mut().zip(rgb).for_each(|(sum, channel)| *sum += value * channel);
}
