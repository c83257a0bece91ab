//! A regular grid of light probes: Unger's light fields (2.2.3; Unger, Wenger, Hawkins, Gardner, Debevec, "Capturing and
//! Rendering with Incident Light Fields", EGSR 2003).
//!
//! The probes of a plane hold the radiance of every line that crosses it, and radiance does not change along a line through empty
//! space. So for a ray the line is cut with the plane, and what the four probes about the cut saw *in the ray's direction* is
//! interpolated bilinearly. Beyond the outermost probes these are held. A line along the plane, and any line where probes lie along
//! one row only, has no cut: there the point itself is looked up, at its foot on the grid. So it is in a grid of several layers,
//! which knows what arrives at any point in it (trilinear).

use std::sync::Arc;

use crate::illumination::EnvMap;
use crate::math::{Mat3, Vec3};

/// Lines within about 0.06 degrees of the plane run along it.
const ALONG: f64 = 1e-3;

/// Where the probes of a grid stood.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ProbesAt {
    /// The probe of column 0, row 0, layer 0.
    pub origin: Vec3,
    /// From a column to the next.
    pub across: Vec3,
    /// From a row to the next.
    pub down: Vec3,
    /// From a layer to the next.
    pub deep: Vec3,
    /// Columns, rows, layers.
    pub counts: [usize; 3],
}

/// A grid of probes.
#[derive(Debug, Clone, PartialEq)]
pub struct Probes {
    origin: Vec3,
    /// From places to steps across, down and deep. The third step of a single layer is its unit normal.
    to_steps: Mat3,
    counts: [usize; 3],
    /// Lines are cut with the plane.
    is_plane: bool,
    /// Column by column, row by row, layer by layer.
    maps: Arc<[EnvMap]>,
}

impl Probes {
    /// A grid with its maps, `(layer * rows + row) * columns + column`. Steps along which there is one probe only are not used.
    /// `None` where steps lie along one another or are zero, or the number of maps is not that of the places.
    pub fn new(at: &ProbesAt, maps: Vec<EnvMap>) -> Option<Self> {
        let counts = at.counts;
        if counts.contains(&0) || counts.iter().try_fold(1usize, |all, n| all.checked_mul(*n)) != Some(maps.len()) {
            return None;
        }
        let given = [at.across, at.down, at.deep];
        let used = |n: usize| (counts[n] > 1).then_some(given[n]);
        let steps = completed(&[used(0), used(1), used(2)])?;
        let to_steps = Mat3::from_columns(&steps).try_inverse().filter(|m| m.iter().all(|v| v.is_finite()))?;
        let is_plane = counts[0] > 1 && counts[1] > 1 && counts[2] == 1;
        Some(Self { origin: at.origin, to_steps, counts, is_plane, maps: maps.into() })
    }

    /// Radiance that arrives at a point from a direction.
    pub fn radiance(&self, at: &Vec3, towards: &Vec3) -> [f64; 3] {
        let [x, y, z] = self.corners(at, towards);
        let mut sum = [0.0; 3];
        for (layer, deep) in z {
            for (row, down) in y {
                for (column, across) in x {
                    let share = across * down * deep;
                    if share > 0.0 {
                        let map = &self.maps[(layer * self.counts[1] + row) * self.counts[0] + column];
                        let radiance = map.between(towards);
                        (0..3).for_each(|c| sum[c] += share * radiance[c]);
                    }
                }
            }
        }
        sum
    }

    /// For each axis of the grid the two probes about the place that is looked up, and their shares.
    fn corners(&self, at: &Vec3, towards: &Vec3) -> [[(usize, f64); 2]; 3] {
        let mut steps = self.to_steps * (at - self.origin);
        if self.is_plane {
            // The third step is the unit normal, so its component is the sine of the angle to the plane.
            let flight = self.to_steps * towards;
            if flight.z.abs() > ALONG {
                steps -= flight * (steps.z / flight.z);
            }
        }
        std::array::from_fn(|n| {
            let last = (self.counts[n] - 1) as f64;
            let held = steps[n].clamp(0.0, last);
            let low = held as usize;
            [(low, 1.0 - (held - low as f64)), ((low + 1).min(self.counts[n] - 1), held - low as f64)]
        })
    }
}

/// Three steps, those that are missing made unit vectors perpendicular to the others; `None` where given ones do not span what
/// they should.
fn completed(steps: &[Option<Vec3>; 3]) -> Option<[Vec3; 3]> {
    let given: Vec<Vec3> = steps.iter().flatten().copied().collect();
    let mut all = given.clone();
    for axis in [Vec3::x(), Vec3::y(), Vec3::z()] {
        // The axes that are least along what is there, one after another.
        if all.len() < 3 {
            let rest = match all[..] {
                [a, b] => a.cross(&b),
                [a] => a.cross(&axis),
                _ => axis,
            };
            all.extend(rest.try_normalize(1e-9 * all.iter().map(Vec3::norm).fold(1e-9, f64::max)));
        }
    }
    let mut spare = all.get(given.len()..)?.iter();
    let mut out = [Vec3::zeros(); 3];
    for (out, step) in out.iter_mut().zip(steps) {
        *out = step.or_else(|| spare.next().copied())?;
    }
    let volume = Mat3::from_columns(&out).determinant().abs();
    let sides: f64 = out.iter().map(Vec3::norm).product();
    // Steps within about a tenth of a degree of one another are a slip.
    (volume.is_finite() && volume > 2e-3 * sides).then_some(out)
}
