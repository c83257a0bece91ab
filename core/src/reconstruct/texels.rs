//! Functions of direction integrated over the texels of lat-long maps.

use rayon::prelude::*;

use super::Outside;
use super::basis::Basis;
use crate::domain::Directions;
use crate::math::{Vec3, latlong};

/// Fine enough for any rig's cells: 0.35 degrees.
pub(super) const FINEST_ROWS: usize = 512;
/// Into how many parts a side is cut at the rim of the coverage, whose solid angle must be right to 1e-4.
const RIM_REFINEMENT: usize = 16;
/// No region: outside the coverage.
const OUTSIDE_REGION: u32 = u32::MAX;

/// An integral over a texel that is not zero.
#[derive(Debug, Clone, Copy)]
pub(super) struct Entry {
    /// `j * width + i`.
    pub texel: u32,
    /// Number of the function; beyond the functions, `len() + site` for light that is given to the nearest site.
    pub function: u32,
    /// The integral, steradians.
    pub steradians: f64,
}

/// What is integrated over the texels of one map size.
pub(super) struct Texels<'a> {
    pub domain: &'a Directions,
    pub basis: &'a dyn Basis,
    pub outside: Outside,
    pub width: usize,
    pub height: usize,
    /// Texels are cut until there are this many rows, if the functions are worth it.
    pub finest_rows: usize,
}

/// (function, steradians) of one texel, unmerged.
type Shares = Vec<(u32, f64)>;

/// What stands at a direction: the values begin at some place of a shared list.
struct Look {
    region: u32,
    values: Vec<(u32, f64)>,
}

impl Texels<'_> {
    /// All integrals, texel after texel, functions ascending.
    ///
    /// Inside a texel where all corners fall in one region a function is taken at the centre; where regions meet, the
    /// texel is cut ([`Basis::refinement`]). With [`Outside::Drop`] everything is scaled (by some 1e-4 at most) so that
    /// the texels' parts in the coverage come to its exact solid angle.
    pub fn integrate(&self) -> Vec<Entry> {
        let rows: Vec<(Vec<Entry>, f64)> = (0..self.height).into_par_iter().map(|j| self.row(j)).collect();
        let total: f64 = rows.iter().map(|row| row.1).sum();
        let scale = match self.outside {
            Outside::Drop if total > 0.0 => self.domain.covered_solid_angle() / total,
            _ => 1.0,
        };
        let scaled = |entry: Entry| Entry { steradians: entry.steradians * scale, ..entry };
        rows.into_iter().flat_map(|row| row.0).map(scaled).collect()
    }

    /// Each texel is cut into this many by this many patches to begin with.
    fn cut(&self) -> usize {
        (self.basis.finest_columns() / 2).min(self.finest_rows).div_ceil(self.height).max(1)
    }

    /// The entries of row `j`, and the solid angle that somebody answers for.
    fn row(&self, j: usize) -> (Vec<Entry>, f64) {
        let cut = self.cut();
        let (columns, side) = (self.width * cut, 1.0 / cut as f64);
        let mut shares: Vec<Shares> = vec![Vec::new(); self.width];
        let mut looked = Look { region: 0, values: Vec::new() };
        let mut covered = 0.0;
        let regions_at = |v: f64, looked: &mut Look| -> Vec<u32> {
            (0..columns).map(|i| self.region(i as f64 * side, v, looked)).collect()
        };
        let mut upper = regions_at(j as f64, &mut looked);
        for k in 0..cut {
            let v = j as f64 + k as f64 * side;
            let lower = regions_at(v + side, &mut looked);
            for i in 0..columns {
                let next = (i + 1) % columns;
                let corners = [upper[i], upper[next], lower[i], lower[next]];
                covered += self.patch((i as f64 * side, v, side), corners, &mut looked, &mut shares[i / cut]);
            }
            upper = lower;
        }
        let mut entries = Vec::with_capacity(self.width * 2);
        for (i, texel) in shares.iter_mut().enumerate() {
            texel.sort_unstable_by_key(|share| share.0);
            for run in texel.chunk_by(|a, b| a.0 == b.0) {
                let steradians = run.iter().map(|share| share.1).sum();
                entries.push(Entry { texel: (j * self.width + i) as u32, function: run[0].0, steradians });
            }
        }
        (entries, covered)
    }

    /// Adds the integrals over the square patch (left, top, side), and returns the solid angle that somebody answers for.
    fn patch(&self, (u, v, side): (f64, f64, f64), corners: [u32; 4], looked: &mut Look, shares: &mut Shares) -> f64 {
        self.look(&self.direction(u + side / 2.0, v + side / 2.0), looked);
        if corners.iter().all(|&corner| corner == looked.region) {
            return add(looked, self.steradians(v, side), shares);
        }
        let rim = corners.contains(&OUTSIDE_REGION) || looked.region == OUTSIDE_REGION;
        let parts = if rim { RIM_REFINEMENT } else { self.basis.refinement() };
        let step = side / parts as f64;
        let mut covered = 0.0;
        for b in 0..parts {
            let top = v + b as f64 * step;
            let steradians = self.steradians(top, step);
            for a in 0..parts {
                self.look(&self.direction(u + (a as f64 + 0.5) * step, top + step / 2.0), looked);
                covered += add(looked, steradians, shares);
            }
        }
        covered
    }

    /// Who answers for a direction; nobody outside the coverage where that light is dropped. The region differs where the
    /// functions may jump or bend.
    fn look(&self, direction: &Vec3, looked: &mut Look) {
        looked.values.clear();
        looked.region = if self.domain.covers(direction) {
            self.basis.at(direction, &mut looked.values)
        } else if self.outside == Outside::Nearest {
            let site = self.domain.nearest_site(direction) as u32;
            looked.values.push((self.basis.len() as u32 + site, 1.0));
            // The methods' regions stay below.
            OUTSIDE_REGION / 2 + site
        } else {
            OUTSIDE_REGION
        };
    }

    fn region(&self, u: f64, v: f64, looked: &mut Look) -> u32 {
        self.look(&self.direction(u, v), looked);
        looked.region
    }

    /// Solid angle of the square patch of side `side` whose upper edge is at `v`.
    fn steradians(&self, v: f64, side: f64) -> f64 {
        latlong::band_solid_angle(v, v + side, self.height) * side / self.width as f64
    }

    fn direction(&self, u: f64, v: f64) -> Vec3 {
        latlong::direction(u, v.clamp(0.0, self.height as f64), self.width, self.height)
    }
}

fn add(looked: &Look, steradians: f64, shares: &mut Shares) -> f64 {
    if looked.region == OUTSIDE_REGION {
        return 0.0;
    }
    shares.extend(looked.values.iter().filter(|v| v.1 != 0.0).map(|&(n, value)| (n, value * steradians)));
    steradians
}
