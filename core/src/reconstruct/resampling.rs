//! Many reflectance functions rebuilt at the same directions: `Phi F S t`, side by side.
//!
//! `S` takes the mean of the lamps at each site, `F` makes coefficients of samples, and a row of `Phi` holds what the
//! method's functions are worth at one direction. Functions lie in *lanes*, `[lamp][lane]`, so that every number of a
//! matrix is read once for all of them.

use std::sync::Arc;

use nalgebra::{DMatrix, DMatrixView, DMatrixViewMut};
use rayon::prelude::*;

use super::Reconstruction;
use super::basis::Fit;
use super::lattice::{LANES, Lanes};
use crate::domain::Directions;
use crate::math::Vec3;

/// What a multiplication inside a matrix product costs, against one of a sparse row (measured for 128 lanes: 0.37 to 0.44;
/// less for more). Above this density a plain matrix product is faster than skipping zeros.
pub(super) const DENSE_SHARE: f64 = 0.4;

/// The reconstructed functions at some directions, as one linear map of the samples.
///
/// ```
/// use relume_core::{domain::Directions, math::Vec3, reconstruct::{Method, Reconstruction, Resampling}};
/// use std::sync::Arc;
///
/// let lamps = Arc::new(Directions::new(vec![Vec3::z(), Vec3::x(), Vec3::y()])?);
/// let linear = Reconstruction::new(lamps, Method::Linear)?;
/// let between = Resampling::new(&linear, &[Vec3::new(1.0, 0.0, 1.0).normalize()]);
/// // Two functions; their samples under lamp 1, lamp 2, lamp 3.
/// let mut values = [0.0; 2];
/// between.apply(&[0.0, 1.0, 2.0, 1.0, 0.0, 1.0], &mut values);
/// assert!((values[0] - 1.0).abs() < 1e-6 && (values[1] - 1.0).abs() < 1e-6);
/// # Ok::<(), relume_core::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct Resampling {
    domain: Arc<Directions>,
    directions: usize,
    /// `F`; `None` where the rows take from sites.
    fit: Option<Arc<dyn Fit>>,
    rows: Rows,
}

/// A matrix directions x inputs; inputs are sites, or functions.
#[derive(Debug, Clone)]
enum Rows {
    /// Row n is `entries[starts[n]..starts[n + 1]]`: (input, number).
    Sparse { starts: Vec<usize>, entries: Vec<(u32, f32)> },
    /// Inputs x directions: a row is a column of it.
    Dense(DMatrix<f32>),
}

impl Resampling {
    /// Looks at the method's functions at the directions. `Phi` and `F` stay apart, or become one matrix where that is
    /// less work.
    pub fn new(reconstruction: &Reconstruction, directions: &[Vec3]) -> Self {
        let basis = reconstruction.basis();
        let row = |direction: &Vec3| {
            let mut values = Vec::new();
            basis.at(direction, &mut values);
            values
        };
        let values: Vec<Vec<(u32, f64)>> = directions.par_iter().map(row).collect();
        let sites = reconstruction.domain().sites().len();
        let (fit, rows) = match reconstruction.fit() {
            None => (None, Rows::new(values, sites)),
            Some(fit) => {
                let apart = Rows::new(values.clone(), basis.len());
                let whole = (sites * directions.len()) as f64 * DENSE_SHARE;
                if apart.cost() + (fit.cost() as f64) < whole {
                    (Some(fit.clone()), apart)
                } else {
                    let shares = |values: &Vec<(u32, f64)>| (0..).zip(reconstruction.shares_of_sites(values)).collect();
                    (None, Rows::new(values.par_iter().map(shares).collect(), sites))
                }
            }
        };
        Self { domain: reconstruction.domain().clone(), directions: directions.len(), fit, rows }
    }

    /// How many directions.
    pub fn directions(&self) -> usize {
        self.directions
    }

    /// From samples `[lamp][lane]` to values `[direction][lane]`, any number of lanes; fastest with multiples of 16.
    /// Equal to [`Reconstruction::values`] but for rounding to f32.
    ///
    /// # Panics
    /// When `samples` does not hold a whole number of lanes, or `out` not as many.
    pub fn apply(&self, samples: &[f32], out: &mut [f32]) {
        let lanes = samples.len() / self.domain.len();
        assert_eq!(samples.len(), lanes * self.domain.len(), "one sample a lamp and lane");
        assert_eq!(out.len(), lanes * self.directions, "room for one value a direction and lane");
        if lanes == 0 {
            return;
        }
        let of_sites = self.to_sites(samples, lanes);
        let inputs = of_sites.as_deref().unwrap_or(samples);
        match &self.fit {
            Some(fit) => self.rows.times(&fit.coefficients_of_lanes(inputs, lanes), lanes, out),
            None => self.rows.times(inputs, lanes, out),
        }
    }

    /// The means of the lamps at each site; `None` where each lamp is a site.
    fn to_sites(&self, samples: &[f32], lanes: usize) -> Option<Vec<f32>> {
        let members = self.domain.members();
        if members.len() == self.domain.len() {
            return None;
        }
        let mut sites = vec![0.0; members.len() * lanes];
        for (members, site) in members.iter().zip(sites.chunks_exact_mut(lanes)) {
            for &lamp in members {
                let sample = &samples[lamp as usize * lanes..][..lanes];
                site.iter_mut().zip(sample).for_each(|(mean, t)| *mean += t / members.len() as f32);
            }
        }
        Some(sites)
    }
}

impl Rows {
    fn new(rows: Vec<Vec<(u32, f64)>>, inputs: usize) -> Self {
        let numbers: usize = rows.iter().map(Vec::len).sum();
        if numbers as f64 > DENSE_SHARE * (inputs * rows.len()) as f64 {
            let mut matrix = DMatrix::zeros(inputs, rows.len());
            for (mut column, row) in matrix.column_iter_mut().zip(rows) {
                row.into_iter().for_each(|(n, value)| column[n as usize] += value as f32);
            }
            return Self::Dense(matrix);
        }
        let (mut starts, mut entries) = (vec![0], Vec::with_capacity(numbers));
        for row in rows {
            entries.extend(row.into_iter().map(|(n, value)| (n, value as f32)));
            starts.push(entries.len());
        }
        Self::Sparse { starts, entries }
    }

    /// Multiplications a lane, as [`Fit::cost`] counts them.
    fn cost(&self) -> f64 {
        match self {
            Self::Sparse { entries, .. } => entries.len() as f64,
            Self::Dense(matrix) => matrix.len() as f64 * DENSE_SHARE,
        }
    }

    /// From `[input][lane]` to `[direction][lane]`.
    fn times(&self, inputs: &[f32], lanes: usize, out: &mut [f32]) {
        match self {
            // Lanes lie in columns, input after input, as nalgebra's matrices do.
            Self::Dense(matrix) => {
                let inputs = DMatrixView::from_slice(inputs, lanes, matrix.nrows());
                DMatrixViewMut::from_slice(out, lanes, matrix.ncols()).gemm(1.0, &inputs, matrix, 0.0);
            }
            Self::Sparse { starts, entries } => {
                let whole = lanes - lanes % LANES;
                // The inputs of one group of lanes stay in the cache, their sums in registers.
                for first in (0..whole).step_by(LANES) {
                    for (ends, out) in starts.windows(2).zip(out.chunks_exact_mut(lanes)) {
                        let sums = weighted_sum(&entries[ends[0]..ends[1]], inputs, lanes, first);
                        out[first..first + LANES].copy_from_slice(&sums);
                    }
                }
                if whole < lanes {
                    let rest = padded(inputs, lanes, whole);
                    for (ends, out) in starts.windows(2).zip(out.chunks_exact_mut(lanes)) {
                        let sums = weighted_sum(&entries[ends[0]..ends[1]], &rest, LANES, 0);
                        out[whole..].copy_from_slice(&sums[..lanes - whole]);
                    }
                }
            }
        }
    }
}

/// The lanes from `first` on, fewer than [`LANES`], filled up with zeros.
fn padded(inputs: &[f32], lanes: usize, first: usize) -> Vec<f32> {
    let pad = |input: &[f32]| -> Lanes { std::array::from_fn(|k| input.get(first + k).copied().unwrap_or(0.0)) };
    inputs.chunks_exact(lanes).flat_map(pad).collect()
}

/// `sum of number x input` of the group of lanes at `first`. Written so that the sums stay in registers.
fn weighted_sum(row: &[(u32, f32)], inputs: &[f32], lanes: usize, first: usize) -> Lanes {
    let mut sums = [0.0; LANES];
    for &(n, number) in row {
        let at = n as usize * lanes + first;
        // There always is a whole group.
        let group = inputs[at..at + LANES].first_chunk::<LANES>().unwrap_or(&[0.0; LANES]);
        sums.iter_mut().zip(group).for_each(|(sum, lane)| *sum += number * lane);
    }
    sums
}
