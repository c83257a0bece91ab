//! A kernel integrated over the texels of a map: the matrix `U` of eq. 4.6, sparse, texels x lamps.

use rayon::prelude::*;

use super::{Kernel, Method, Outside, Stencil};
use crate::domain::Directions;
use crate::illumination::EnvMap;
use crate::math::{Vec3, latlong};

/// Texels are cut until the kernel is looked at on at least this many rows: 0.35 degrees, a small part of any rig's cell.
const FINEST_ROWS: usize = 512;
/// Into how many parts a side is cut at the rim of the coverage, whose solid angle must be right to 1e-4.
const RIM_REFINEMENT: usize = 16;
/// No region: outside the coverage.
const OUTSIDE_REGION: u32 = u32::MAX;

/// `U[j, texel]`, the integral over a texel of lamp j's kernel, in steradians.
///
/// Stored by lamp, so that a lamp's weight is one gather in a fixed order: results do not depend on threads.
#[derive(Debug, Clone)]
pub struct Operator {
    width: usize,
    height: usize,
    /// `entries[starts[j]..starts[j + 1]]` belong to lamp j.
    starts: Vec<usize>,
    /// (texel `j * width + i`, steradians).
    entries: Vec<(u32, f32)>,
}

impl Operator {
    /// Integrates a method's kernels over the texels of `width` x `height` lat-long maps.
    ///
    /// Inside a texel where all corners fall in one region the kernel is taken at the centre; where regions meet, the
    /// texel is cut ([`Kernel::refinement`]). With [`Outside::Drop`] the total is scaled (by some 1e-4 at most) to the
    /// exact solid angle of the coverage.
    pub fn new(domain: &Directions, method: Method, outside: Outside, width: usize, height: usize) -> Self {
        let kernel = method.kernel(domain);
        let grid = Grid { domain, kernel: &*kernel, outside, width, height, cut: FINEST_ROWS.div_ceil(height).max(1) };
        let rows: Vec<Vec<(u32, u32, f64)>> = (0..height).into_par_iter().map(|j| grid.row(j)).collect();
        Self::by_lamp(domain, outside, width, height, &rows)
    }

    /// Sorts (texel, site, steradians) by lamp.
    fn by_lamp(
        domain: &Directions,
        outside: Outside,
        width: usize,
        height: usize,
        rows: &[Vec<(u32, u32, f64)>],
    ) -> Self {
        let total: f64 = rows.iter().map(|row| row.iter().map(|entry| entry.2).sum::<f64>()).sum();
        let scale = match outside {
            Outside::Drop if total > 0.0 => domain.covered_solid_angle() / total,
            _ => 1.0,
        };
        let mut by_site: Vec<Vec<(u32, f32)>> = vec![Vec::new(); domain.sites().len()];
        for &(texel, site, steradians) in rows.iter().flatten() {
            by_site[site as usize].push((texel, (steradians * scale) as f32));
        }
        let mut lamps: Vec<&[(u32, f32)]> = vec![&[]; domain.len()];
        let mut shares = vec![1.0f32; domain.len()];
        for (members, entries) in domain.members().iter().zip(&by_site) {
            for &lamp in members {
                lamps[lamp as usize] = entries;
                shares[lamp as usize] = 1.0 / members.len() as f32;
            }
        }
        let (mut starts, mut entries) = (vec![0], Vec::new());
        for (lamp, share) in lamps.iter().zip(shares) {
            entries.extend(lamp.iter().map(|&(texel, steradians)| (texel, steradians * share)));
            starts.push(entries.len());
        }
        Self { width, height, starts, entries }
    }

    /// Columns and rows of the maps it takes.
    pub fn size(&self) -> (usize, usize) {
        (self.width, self.height)
    }

    /// How many lamps.
    pub fn lamps(&self) -> usize {
        self.starts.len() - 1
    }

    fn entries_of(&self, lamp: usize) -> &[(u32, f32)] {
        &self.entries[self.starts[lamp]..self.starts[lamp + 1]]
    }

    /// `U L'` (eq. 4.7): for each lamp the integral of its kernel times the radiance, RGB. Sums run in f64.
    ///
    /// # Panics
    /// When the map is not of [`Operator::size`].
    pub fn downsample(&self, map: &EnvMap) -> Vec<[f32; 3]> {
        assert_eq!(map.image().size(), self.size(), "the operator was made for another map size");
        let radiance = map.image().data();
        let weight = |lamp: usize| {
            let mut sum = [0.0f64; 3];
            for &(texel, steradians) in self.entries_of(lamp) {
                let rgb = &radiance[texel as usize * 3..][..3];
                for c in 0..3 {
                    sum[c] += f64::from(rgb[c]) * f64::from(steradians);
                }
            }
            sum.map(|v| v as f32)
        };
        (0..self.lamps()).into_par_iter().map(weight).collect()
    }

    /// `U^T t`: for each texel the integral over it of the reconstructed reflectance function, steradians included, so that
    /// `<U^T t, L'> = <t, U L'>`. Divide by the texel's solid angle for the function's mean there.
    ///
    /// # Panics
    /// When `samples` does not hold one number a lamp.
    pub fn upsample(&self, samples: &[f32]) -> Vec<f32> {
        assert_eq!(samples.len(), self.lamps(), "one sample a lamp");
        let mut texels = vec![0.0f64; self.width * self.height];
        for (lamp, &sample) in samples.iter().enumerate() {
            for &(texel, steradians) in self.entries_of(lamp) {
                texels[texel as usize] += f64::from(steradians) * f64::from(sample);
            }
        }
        texels.into_iter().map(|v| v as f32).collect()
    }

    /// Omega_j, the solid angle of each lamp's kernel: `U` applied to a constant map of radiance 1.
    pub fn solid_angles(&self) -> Vec<f64> {
        (0..self.lamps()).map(|lamp| self.entries_of(lamp).iter().map(|e| f64::from(e.1)).sum()).collect()
    }
}

/// (site, steradians) of one texel, unmerged.
type Shares = Vec<(u32, f64)>;

fn add(stencil: Option<Stencil>, steradians: f64, shares: &mut Shares) {
    let Some(stencil) = stencil else { return };
    let parts = stencil.sites.iter().zip(&stencil.shares).filter(|part| *part.1 > 0.0);
    shares.extend(parts.map(|(&site, &share)| (site, share * steradians)));
}

/// Integration over the texels of one map size.
struct Grid<'a> {
    domain: &'a Directions,
    kernel: &'a dyn Kernel,
    outside: Outside,
    width: usize,
    height: usize,
    /// Each texel is cut into `cut` x `cut` patches to begin with.
    cut: usize,
}

impl Grid<'_> {
    /// (texel, site, steradians) of row `j`, merged per texel and site.
    fn row(&self, j: usize) -> Vec<(u32, u32, f64)> {
        let (columns, side) = (self.width * self.cut, 1.0 / self.cut as f64);
        let mut entries = Vec::with_capacity(self.width * 2);
        let mut shares: Vec<Shares> = vec![Vec::new(); self.width];
        let regions_at = |v: f64| -> Vec<u32> { (0..columns).map(|i| self.region(i as f64 * side, v)).collect() };
        let mut upper = regions_at(j as f64);
        for k in 0..self.cut {
            let v = j as f64 + k as f64 * side;
            let lower = regions_at(v + side);
            for i in 0..columns {
                let next = (i + 1) % columns;
                let corners = [upper[i], upper[next], lower[i], lower[next]];
                self.patch(i as f64 * side, v, side, corners, &mut shares[i / self.cut]);
            }
            upper = lower;
        }
        for (i, texel) in shares.iter_mut().enumerate() {
            texel.sort_unstable_by_key(|share| share.0);
            for run in texel.chunk_by(|a, b| a.0 == b.0) {
                entries.push(((j * self.width + i) as u32, run[0].0, run.iter().map(|share| share.1).sum()));
            }
        }
        entries
    }

    /// Adds (site, steradians) of the square patch with its top left corner at (u, v).
    fn patch(&self, u: f64, v: f64, side: f64, corners: [u32; 4], shares: &mut Shares) {
        let middle = self.look(&self.direction(u + side / 2.0, v + side / 2.0));
        let region = middle.map_or(OUTSIDE_REGION, |stencil| stencil.region);
        if corners.iter().all(|&corner| corner == region) {
            return add(middle, self.steradians(v, side), shares);
        }
        let rim = corners.contains(&OUTSIDE_REGION) || middle.is_none();
        let parts = if rim { RIM_REFINEMENT } else { self.kernel.refinement() };
        let step = side / parts as f64;
        for b in 0..parts {
            let top = v + b as f64 * step;
            let steradians = self.steradians(top, step);
            for a in 0..parts {
                let direction = self.direction(u + (a as f64 + 0.5) * step, top + step / 2.0);
                add(self.look(&direction), steradians, shares);
            }
        }
    }

    /// Who answers for a direction; nobody outside the coverage where that light is dropped. The stencil's region differs
    /// where the integrand may jump or bend.
    fn look(&self, direction: &Vec3) -> Option<Stencil> {
        if self.domain.covers(direction) {
            Some(self.kernel.at(direction))
        } else if self.outside == Outside::Nearest {
            // Regions number sites, triangles or edges: the upper half of the numbers is free.
            let site = self.domain.nearest_site(direction);
            Some(Stencil::one(site, OUTSIDE_REGION / 2 + site as u32))
        } else {
            None
        }
    }

    fn region(&self, u: f64, v: f64) -> u32 {
        self.look(&self.direction(u, v)).map_or(OUTSIDE_REGION, |stencil| stencil.region)
    }

    /// Solid angle of the square patch of side `side` whose upper edge is at `v`.
    fn steradians(&self, v: f64, side: f64) -> f64 {
        latlong::band_solid_angle(v, v + side, self.height) * side / self.width as f64
    }

    fn direction(&self, u: f64, v: f64) -> Vec3 {
        latlong::direction(u, v.clamp(0.0, self.height as f64), self.width, self.height)
    }
}
