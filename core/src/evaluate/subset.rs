//! Which lamps to keep when a set is thinned, so that the others can judge what was filled in between.

use std::f64::consts::TAU;

use crate::domain::{Axis, Directions};
use crate::error::{Error, Result};
use crate::math::{Vec3, angle_between};

/// Fewer lamps than this span no solid.
pub const FEWEST_KEPT: usize = 4;
/// Lamps count as a grid when each is within this part of a step of its place: rigs are built to about a degree, and the
/// thinned set must look like the same grid.
const GRID_TOLERANCE: f64 = 0.05;

/// How many lamps to keep.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Keep {
    /// A part of them, such as 1/4.
    Share(f64),
    /// So many.
    Count(usize),
}

/// How the kept lamps were chosen.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case", tag = "rule")]
pub enum Rule {
    /// Of a longitude x latitude grid every n-th longitude of every m-th ring, the outermost ring first: "regularly
    /// selected" (4.3).
    Grid {
        /// Longitudes that are left.
        longitudes: usize,
        /// Rings that are left.
        rings: usize,
        /// n.
        every_longitude: usize,
        /// m.
        every_ring: usize,
    },
    /// Farthest points: each next lamp is the one farthest from those already kept.
    Spread,
}

/// The kept lamps of a set.
#[derive(Debug, Clone, PartialEq)]
pub struct Subset {
    /// Their numbers from 0, ascending.
    pub kept: Vec<u32>,
    /// How they were chosen.
    pub rule: Rule,
}

impl Subset {
    /// Thins a set. Of grids every second longitude of every second ring is kept for 1/4 (64 x 20 becomes 32 x 10, as in
    /// 4.4.1); where the rings cannot be cut so, or there is no grid, the farthest points are kept (Gonzalez 1985),
    /// beginning with the lamp nearest to the axis. No chance is involved. Time n x kept.
    ///
    /// # Errors
    /// Fewer than 4 lamps to keep, or all.
    pub fn new(domain: &Directions, keep: Keep) -> Result<Self> {
        let all = domain.len();
        let count = match keep {
            Keep::Share(share) => (share * all as f64).round() as usize,
            Keep::Count(count) => count,
        };
        if !(FEWEST_KEPT..all).contains(&count) {
            let expected = format!("at least {FEWEST_KEPT} lamps, and fewer than all");
            return Err(Error::invalid("lamps to keep", format!("{count} of {all}"), expected));
        }
        Ok(thinned_grid(domain, all as f64 / count as f64).unwrap_or_else(|| spread(domain, count)))
    }

    /// The kept lamps as a set of their own, with the axis and the coverage of the whole.
    ///
    /// # Errors
    /// None for a subset of that domain.
    pub fn domain(&self, whole: &Directions) -> Result<Directions> {
        let lamps = self.kept.iter().map(|&n| whole.lamps()[n as usize]).collect();
        Directions::with_coverage(lamps, whole.axis(), whole.coverage())
    }
}

/// Every a-th longitude of every b-th ring with `a b` = `factor`, the squarest such pair with a >= b that divides the
/// ring.
fn thinned_grid(domain: &Directions, factor: f64) -> Option<Subset> {
    let rings = [domain.axis(), Axis::Y].iter().find_map(|&axis| rings(domain, axis))?;
    let whole = factor.round() as usize;
    if (factor - whole as f64).abs() > GRID_TOLERANCE {
        return None;
    }
    let around = rings[0].len();
    let fits = |b: &usize| whole.is_multiple_of(*b) && b * b <= whole && around.is_multiple_of(whole / b);
    let b = (1..=whole).filter(fits).max()?;
    let a = whole / b;
    let mut kept: Vec<u32> = rings.iter().step_by(b).flat_map(|ring| ring.iter().step_by(a)).copied().collect();
    kept.sort_unstable();
    let (longitudes, left) = (around / a, rings.len().div_ceil(b));
    let rule = Rule::Grid { longitudes, rings: left, every_longitude: a, every_ring: b };
    (longitudes >= FEWEST_KEPT && left >= 2).then_some(Subset { kept, rule })
}

/// The lamps as rings about an axis, from the outermost inwards, each by longitude; `None` unless every ring has the same
/// evenly spaced longitudes.
fn rings(domain: &Directions, axis: Axis) -> Option<Vec<Vec<u32>>> {
    let place = |d: &Vec3| match axis {
        Axis::Y => (d.y.clamp(-1.0, 1.0).asin(), d.x.atan2(d.z).rem_euclid(TAU)),
        Axis::Z => (d.z.clamp(-1.0, 1.0).asin(), d.y.atan2(d.x).rem_euclid(TAU)),
    };
    let places: Vec<(f64, f64)> = domain.lamps().iter().map(place).collect();
    let mut order: Vec<u32> = (0..places.len() as u32).collect();
    order.sort_by(|&a, &b| places[a as usize].0.total_cmp(&places[b as usize].0));
    // Elevations of a ring agree far better than those of neighbours: cut where the next is a good part of a step away.
    let gap = GRID_TOLERANCE * domain.median_spacing();
    let mut rings: Vec<Vec<u32>> =
        order.chunk_by(|&a, &b| places[b as usize].0 - places[a as usize].0 < gap).map(<[u32]>::to_vec).collect();
    let around = rings[0].len();
    let step = TAU / around as f64;
    let first = places[rings[0][0] as usize].1;
    // The column of the grid that a lamp stands in, if it does.
    let column = |n: u32| {
        let columns = (places[n as usize].1 - first) / step;
        ((columns - columns.round()).abs() < GRID_TOLERANCE).then(|| (columns.round() as i64).rem_euclid(around as i64))
    };
    for ring in &mut rings {
        let mut columns = ring.iter().map(|&n| column(n).map(|c| (c, n))).collect::<Option<Vec<_>>>()?;
        columns.sort_unstable();
        if columns.len() != around || columns.iter().enumerate().any(|(i, c)| c.0 != i as i64) {
            return None;
        }
        *ring = columns.into_iter().map(|c| c.1).collect();
    }
    (rings.len() >= 2 && around >= FEWEST_KEPT).then_some(rings)
}

fn spread(domain: &Directions, count: usize) -> Subset {
    let lamps = domain.lamps();
    let mut next = domain.nearest(&domain.axis().vector());
    let mut distance = vec![f64::INFINITY; lamps.len()];
    let mut kept = Vec::with_capacity(count);
    for _ in 0..count {
        kept.push(next as u32);
        // Below every distance, so that it is not taken again.
        distance[next] = -1.0;
        let mut farthest = (-1.0, 0);
        for (n, lamp) in lamps.iter().enumerate() {
            if distance[n] >= 0.0 {
                distance[n] = distance[n].min(angle_between(lamp, &lamps[next]));
                farthest = if distance[n] > farthest.0 { (distance[n], n) } else { farthest };
            }
        }
        next = farthest.1;
    }
    kept.sort_unstable();
    Subset { kept, rule: Rule::Spread }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulate::{demo_lamps, grid_lamps};

    fn grid(longitudes: usize, latitudes: usize) -> Directions {
        Directions::new(grid_lamps(longitudes, latitudes)).unwrap()
    }

    #[test]
    fn a_quarter_of_a_grid_is_every_second_longitude_of_every_second_ring() {
        let whole = grid(64, 20);
        let subset = Subset::new(&whole, Keep::Share(0.25)).unwrap();
        let rule = Rule::Grid { longitudes: 32, rings: 10, every_longitude: 2, every_ring: 2 };
        assert_eq!((subset.kept.len(), subset.rule), (320, rule));
        let thin = subset.domain(&whole).unwrap();
        assert_eq!((thin.axis(), thin.coverage()), (whole.axis(), whole.coverage()));
        // Rings 9 degrees apart from 2.25 degrees up, 32 lamps each.
        for (k, ring) in (0..10).map(|k| (k, 2.25 + 9.0 * f64::from(k))) {
            let on = thin.lamps().iter().filter(|d| (d.y.asin().to_degrees() - ring).abs() < 1e-6).count();
            assert_eq!(on, 32, "ring {k}");
        }
        assert_eq!(Subset::new(&whole, Keep::Count(320)).unwrap(), subset);
    }

    #[test]
    fn other_parts_of_a_grid() {
        let whole = grid(64, 20);
        for (share, a, b) in [(0.5, 2, 1), (1.0 / 8.0, 4, 2), (1.0 / 16.0, 4, 4)] {
            let Rule::Grid { every_longitude, every_ring, .. } = Subset::new(&whole, Keep::Share(share)).unwrap().rule
            else {
                panic!("{share} of a grid is a grid")
            };
            assert_eq!((every_longitude, every_ring), (a, b), "{share}");
        }
        // 64 is no multiple of 3, and 1000 of 1280 is no stride.
        assert_eq!(Subset::new(&whole, Keep::Share(1.0 / 3.0)).unwrap().rule, Rule::Spread);
        assert_eq!(Subset::new(&whole, Keep::Count(1000)).unwrap().kept.len(), 1000);
    }

    #[test]
    fn the_order_of_the_lamps_and_a_degree_of_error_do_not_matter() {
        let mut lamps = grid_lamps(32, 8);
        lamps.reverse();
        lamps.swap(3, 77);
        lamps[40] = (lamps[40] + Vec3::new(0.0, 0.002, 0.002)).normalize();
        let rule = Subset::new(&Directions::new(lamps.clone()).unwrap(), Keep::Share(0.25)).unwrap().rule;
        assert!(matches!(rule, Rule::Grid { longitudes: 16, rings: 4, .. }), "{rule:?}");
        lamps.pop();
        let rule = Subset::new(&Directions::new(lamps).unwrap(), Keep::Share(0.25)).unwrap().rule;
        assert_eq!(rule, Rule::Spread, "a lamp is missing");
    }

    #[test]
    fn other_sets_are_spread_well() {
        let whole = Directions::new(demo_lamps(600)).unwrap();
        let subset = Subset::new(&whole, Keep::Share(0.25)).unwrap();
        assert_eq!((subset.kept.len(), subset.rule), (150, Rule::Spread));
        assert!(subset.kept.windows(2).all(|pair| pair[0] < pair[1]), "each once, in order");
        let thin = subset.domain(&whole).unwrap();
        // Every lamp has a kept one within the spacing of 150 evenly spread lamps, sqrt(2 pi / 150) = 0.2, and a third.
        for lamp in whole.lamps() {
            let near = thin.lamps()[thin.nearest(lamp)];
            assert!(angle_between(lamp, &near) < 0.27, "{lamp} has a hole about it");
        }
        // As farthest points go: no two kept lamps are nearer than the widest hole was.
        assert!(thin.median_spacing() > 0.13);
    }

    #[test]
    fn too_few_and_too_many_are_refused() {
        let whole = grid(16, 4);
        for keep in
            [Keep::Count(0), Keep::Count(3), Keep::Count(64), Keep::Count(65), Keep::Share(0.02), Keep::Share(2.0)]
        {
            let message = Subset::new(&whole, keep).unwrap_err().to_string();
            assert!(message.contains("of 64") && message.contains("fewer than all"), "{message}");
        }
    }
}
