//! Light collected by lamp cell: the Voronoi cells of a lamp set, points in them, and the collector.

use std::f64::consts::PI;

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg32;
use rayon::prelude::*;

use crate::domain::{Coverage, Directions};
use crate::math::{Vec3, latlong};

use super::V3;
use super::material::Rgb;
use super::scene::Scene;
use super::shape::{Bundle, Ray, Slices};
use super::tracer::{Collector, Vertex};

/// Sample points a lamp, in 8 x 8 strata of equal area.
const SETS: usize = 64;
/// Points of the dense equal-area lattice per lamp, from which solid angles and sample points come: the solid angle of a cell is
/// right to about the boundary over the area, 0.3 %.
const DENSITY: usize = 768;
/// Grid of the cell finder.
const GRID: (usize, usize) = (256, 128);

/// Finds the cell of a direction: a lat-long grid of candidate lists, each complete for its texel.
#[derive(Debug)]
struct Finder {
    sites: Vec<[f32; 3]>,
    candidates: Vec<Vec<u32>>,
}

impl Finder {
    fn new(sites: &[Vec3]) -> Self {
        let (w, h) = GRID;
        let of_texel = |at: usize| {
            let (i, j) = ((at % w) as f64, (at / w) as f64);
            let middle = latlong::direction(i + 0.5, j + 0.5, w, h);
            // No point of the texel is farther from its middle than half its diagonal at the equator.
            let reach = 0.5 * (PI / h as f64).hypot(2.0 * PI / w as f64);
            let nearest = sites.iter().map(|s| s.dot(&middle)).fold(-1.0, f64::max).min(1.0);
            // Triangle inequality, twice, and a little for rounding.
            let limit = (nearest.acos() + 2.0 * reach + 1e-4).min(PI).cos();
            (0..).zip(sites).filter(|(_, s)| s.dot(&middle) >= limit).map(|(n, _)| n).collect()
        };
        let candidates = (0..w * h).into_par_iter().map(of_texel).collect();
        Self { sites: sites.iter().map(|s| [s.x as f32, s.y as f32, s.z as f32]).collect(), candidates }
    }

    fn find(&self, d: &V3) -> usize {
        let (w, h) = GRID;
        let (u, v) = latlong::coordinates(&d.cast(), w, h);
        let list = &self.candidates[(v as usize).min(h - 1) * w + (u as usize).min(w - 1)];
        let cosine = |n: u32| self.sites[n as usize].iter().zip(d.iter()).map(|(a, b)| a * b).sum::<f32>();
        let mut best = (f32::NEG_INFINITY, 0);
        for &n in list {
            let c = cosine(n);
            best = if c > best.0 { (c, n) } else { best };
        }
        best.1 as usize
    }
}

/// The Voronoi cells of a lamp set inside its coverage. Lamps at one place share a cell.
///
/// Internally the sites are ordered in [`Cells::groups`] interleaved groups, so that every k-th site is one stretch of
/// memory.
#[derive(Debug)]
pub(super) struct Cells {
    finder: Finder,
    axis: V3,
    cos_rim: f32,
    /// Per ordered site, steradians.
    solid_angle: Vec<f32>,
    /// Sites in order -> lamps.
    members: Vec<Vec<u32>>,
    /// Stretches of sites.
    groups: Vec<std::ops::Range<usize>>,
    /// One point of every cell each; aligned runs of 4, 16 and 64 stratify each cell.
    sets: Vec<Bundle>,
}

impl Cells {
    /// Cuts the coverage into cells; `groups` is the k of "every k-th lamp".
    pub fn new(lamps: &Directions, groups: usize, seed: u64) -> Self {
        let count = lamps.sites().len();
        let order: Vec<usize> = (0..groups).flat_map(|g| (g..count).step_by(groups)).collect();
        let sites: Vec<Vec3> = order.iter().map(|&s| lamps.sites()[s]).collect();
        let starts: Vec<usize> = (0..groups).map(|g| (0..g).map(|b| (b..count).step_by(groups).len()).sum()).collect();
        let ends = starts.iter().copied().skip(1).chain([count]);
        let finder = Finder::new(&sites);
        let cos_rim = match lamps.coverage() {
            Coverage::Sphere => -2.0,
            Coverage::Cap { half_angle_rad } => half_angle_rad.cos() as f32,
        };
        let axis: V3 = lamps.axis().vector().cast();
        let lattice = (count * DENSITY) as f64 * 4.0 * PI / lamps.covered_solid_angle();
        let lattice = (lattice as usize).max(200_000);
        let points = bin(&finder, count, lattice, &axis, cos_rim);
        let solid_angle = points.iter().map(|p| (p.len() as f64 * 4.0 * PI / lattice as f64) as f32).collect();
        let sets = sample_sets(&sites, &points, seed);
        let members = order.iter().map(|&s| lamps.members()[s].clone()).collect();
        let groups = starts.iter().copied().zip(ends).map(|(a, b)| a..b).collect();
        Self { finder, axis, cos_rim, solid_angle, members, groups, sets }
    }

    /// The smallest cell, steradians.
    pub fn smallest(&self) -> f32 {
        self.solid_angle.iter().copied().filter(|s| *s > 0.0).fold(f32::MAX, f32::min)
    }

    /// How many sites.
    pub fn len(&self) -> usize {
        self.members.len()
    }

    /// The lamps of an ordered site.
    pub fn lamps_of(&self, site: usize) -> &[u32] {
        &self.members[site]
    }
}

/// The points of an equal-area Fibonacci lattice of `lattice` points inside a cap, by cell.
fn bin(finder: &Finder, count: usize, lattice: usize, axis: &V3, cos_rim: f32) -> Vec<Vec<V3>> {
    let golden = PI * (3.0 - 5f64.sqrt());
    let point = |i: usize| {
        let y = 1.0 - (2 * i + 1) as f64 / lattice as f64;
        let (sin, phi) = ((1.0 - y * y).sqrt(), (golden * i as f64) % (2.0 * PI));
        let d = V3::new((sin * phi.sin()) as f32, y as f32, (sin * phi.cos()) as f32);
        (d.dot(axis) >= cos_rim).then(|| (finder.find(&d), d))
    };
    let found: Vec<_> = (0..lattice).into_par_iter().filter_map(point).collect();
    let mut cells = vec![Vec::new(); count];
    for (cell, d) in found {
        cells[cell].push(d);
    }
    cells
}

/// [`SETS`] points of every cell, one from each of 8 x 8 strata of equal numbers of points, in an order whose aligned runs of 4
/// and 16 are stratified themselves; an empty cell (a lamp outside the coverage) gives its lamp.
fn sample_sets(sites: &[Vec3], points: &[Vec<V3>], seed: u64) -> Vec<Bundle> {
    let per_cell: Vec<Vec<V3>> = (0..sites.len())
        .into_par_iter()
        .map(|n| {
            let mut rng = Pcg32::seed_from_u64(seed ^ ((n as u64 + 1) << 20));
            let turn: usize = rng.random_range(0..SETS);
            let strata = stratify(&sites[n].cast(), &points[n]);
            (0..SETS)
                .map(|i| {
                    let stratum = &strata[interleave(i ^ turn)];
                    if stratum.is_empty() { sites[n].cast() } else { stratum[rng.random_range(0..stratum.len())] }
                })
                .collect()
        })
        .collect();
    let set = |i: usize| {
        let mut bundle = Bundle::default();
        per_cell.iter().for_each(|cell| bundle.push(cell[i]));
        bundle
    };
    (0..SETS).map(set).collect()
}

/// Cuts the points of a cell into 8 strips along one tangent, and each into 8 along the other.
fn stratify(site: &V3, points: &[V3]) -> Vec<Vec<V3>> {
    let (s, t) = super::sampling::frame(site);
    let mut sorted = points.to_vec();
    sorted.sort_by(|a, b| a.dot(&s).total_cmp(&b.dot(&s)));
    let cut = |list: &[V3], k: usize| (list.len() * k / 8, list.len() * (k + 1) / 8);
    let mut strata = Vec::with_capacity(SETS);
    for a in 0..8 {
        let (from, to) = cut(&sorted, a);
        let mut strip = sorted[from..to].to_vec();
        strip.sort_by(|a, b| a.dot(&t).total_cmp(&b.dot(&t)));
        strata.extend((0..8).map(|b| {
            let (from, to) = cut(&strip, b);
            strip[from..to].to_vec()
        }));
    }
    strata
}

/// Set number to stratum `8 a + b`: even bits, reversed, are a, odd bits b.
fn interleave(i: usize) -> usize {
    let bit = |n: usize| (i >> n) & 1;
    let (a, b) = (bit(0) << 2 | bit(2) << 1 | bit(4), bit(1) << 2 | bit(3) << 1 | bit(5));
    8 * a + b
}

/// Collects the light of one pixel by cell.
#[derive(Debug)]
pub(super) struct LampCollector<'a> {
    cells: &'a Cells,
    /// Sums of `t` averaged over the cell, three planes over the ordered sites.
    sums: [Vec<f32>; 3],
    visible: Vec<f32>,
    turn: usize,
    drawn: usize,
    /// Whose turn it is among the groups.
    group: usize,
}

impl<'a> LampCollector<'a> {
    pub fn new(cells: &'a Cells) -> Self {
        let zeros = || vec![0.0; cells.len()];
        Self { cells, sums: std::array::from_fn(|_| zeros()), visible: zeros(), turn: 0, drawn: 0, group: 0 }
    }

    /// Clears the sums; `turn` scrambles the order of sample points.
    pub fn begin(&mut self, turn: u64) {
        self.sums.iter_mut().for_each(|plane| plane.fill(0.0));
        (self.turn, self.drawn) = ((turn % SETS as u64) as usize, 0);
        self.group = (turn >> 8) as usize % self.cells.groups.len();
    }

    /// The sums, RGB planes over the ordered sites.
    pub fn sums(&self) -> &[Vec<f32>; 3] {
        &self.sums
    }
}

impl Collector for LampCollector<'_> {
    fn direct(&mut self, scene: &Scene, vertex: &Vertex, weight: &Rgb, first: bool, rng: &mut Pcg32) {
        let (set, range, scale) = if first {
            self.drawn += 1;
            (((self.drawn - 1) ^ self.turn) % SETS, 0..self.cells.len(), 1.0)
        } else {
            let groups = &self.cells.groups;
            // In turn from a random start: each group is as likely, and all come up equally often.
            self.group = (self.group + 1) % groups.len();
            let group = groups[self.group].clone();
            (rng.random_range(0..SETS), group, groups.len() as f32)
        };
        let directions = self.cells.sets[set].slice(range.clone());
        let visible = &mut self.visible[range.clone()];
        scene.visible(&vertex.point, vertex.object, directions, visible);
        let [r, g, b] = &mut self.sums;
        let sums = [&mut r[range.clone()], &mut g[range.clone()], &mut b[range]];
        gather(vertex, &weight.map(|w| w * scale), directions, visible, sums);
    }

    fn leave(&mut self, ray: &Ray, weight: &Rgb, _first: bool) {
        if ray.direction.dot(&self.cells.axis) < self.cells.cos_rim {
            return;
        }
        let site = self.cells.finder.find(&ray.direction);
        // A cell that the lattice missed altogether is below 1/768 of the mean: its light is dropped.
        if self.cells.solid_angle[site] > 0.0 {
            for (plane, w) in self.sums.iter_mut().zip(weight) {
                plane[site] += w / self.cells.solid_angle[site];
            }
        }
    }
}

/// Adds `weight * f cos * visible` for every direction; `visible` may be any factor.
pub(super) fn gather(vertex: &Vertex, weight: &Rgb, directions: Slices<'_>, visible: &[f32], sums: [&mut [f32]; 3]) {
    let n = visible.len();
    let (x, y, z) = (&directions.x[..n], &directions.y[..n], &directions.z[..n]);
    let [r, g, b] = sums;
    let (r, g, b) = (&mut r[..n], &mut g[..n], &mut b[..n]);
    let scatter = vertex.scatter;
    let (normal, view) = (*scatter.normal(), *scatter.view());
    if scatter.is_diffuse() {
        let base = scatter.base();
        let k: Rgb = std::array::from_fn(|c| weight[c] * base[c]);
        for j in 0..n {
            let s = visible[j] * (normal.x * x[j] + normal.y * y[j] + normal.z * z[j]).max(0.0);
            r[j] += k[0] * s;
            g[j] += k[1] * s;
            b[j] += k[2] * s;
        }
        return;
    }
    for j in 0..n {
        let cos = normal.x * x[j] + normal.y * y[j] + normal.z * z[j];
        let f = scatter.lobes(cos, view.x * x[j] + view.y * y[j] + view.z * z[j]);
        r[j] += weight[0] * visible[j] * f[0];
        g[j] += weight[1] * visible[j] * f[1];
        b[j] += weight[2] * visible[j] * f[2];
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulate::demo_lamps;

    #[test]
    fn cells_are_those_of_the_nearest_lamp_and_fill_the_coverage() {
        let lamps = Directions::new(demo_lamps(150)).unwrap();
        let cells = Cells::new(&lamps, 8, 1);
        let mut rng = Pcg32::seed_from_u64(9);
        for _ in 0..3000 {
            let d = super::super::sampling::cone(&V3::y(), 1.0, rng.random());
            let (found, nearest) = (cells.lamps_of(cells.finder.find(&d))[0] as usize, lamps.nearest(&d.cast()));
            let cosine = |n: usize| lamps.lamps()[n].dot(&d.cast());
            assert!(found == nearest || (cosine(found) - cosine(nearest)).abs() < 1e-6);
        }
        let sum: f64 = cells.solid_angle.iter().map(|s| f64::from(*s)).sum();
        assert!((sum / lamps.covered_solid_angle() - 1.0).abs() < 1e-4);
        let mut seen: Vec<u32> = (0..cells.len()).flat_map(|s| cells.lamps_of(s).to_vec()).collect();
        seen.sort_unstable();
        assert_eq!(seen, (0..150).collect::<Vec<u32>>());
    }

    #[test]
    fn sample_points_lie_in_their_cells_and_average_to_the_middle() {
        let lamps = Directions::new(demo_lamps(150)).unwrap();
        let cells = Cells::new(&lamps, 4, 1);
        let point = |set: usize, site: usize| {
            let b = &cells.sets[set];
            V3::new(b.x[site], b.y[site], b.z[site])
        };
        for site in 0..cells.len() {
            (0..SETS).for_each(|set| assert_eq!(cells.finder.find(&point(set, site)), site));
            // Aligned runs of 16 are stratified: their mean is that of all 64 to a fraction of the cell (about 0.2 wide).
            let mean = |from: usize, n: usize| (from..from + n).map(|s| point(s, site)).sum::<V3>() / n as f32;
            for run in 0..4 {
                assert!((mean(16 * run, 16) - mean(0, 64)).norm() < 0.04, "cell {site}, run {run}");
            }
        }
    }

    #[test]
    fn lamps_at_one_place_share_a_cell() {
        let mut list = demo_lamps(40);
        list.push(list[7]);
        let cells = Cells::new(&Directions::new(list).unwrap(), 8, 1);
        assert_eq!(cells.len(), 40);
        assert!((0..40).any(|s| cells.lamps_of(s) == [7, 40]));
    }
}
