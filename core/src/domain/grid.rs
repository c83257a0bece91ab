//! Lamps on a grid: rings about an axis, equal longitudes on every ring.

use std::f64::consts::{PI, TAU};

use super::{Axis, Directions};
use crate::math::Vec3;

/// Lamps that miss the grid by less than this are on it: 0.2 degrees, what a turntable and six decimals leave.
pub(super) const TOLERANCE_RAD: f64 = 3.5e-3;
/// Fewer longitudes than this are no ring.
const FEWEST_LONGITUDES: usize = 4;

/// What lies beyond the first or the last ring.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum End {
    /// The ring is a lamp at the pole; beyond it come the others again, half a turn on.
    Pole,
    /// The pole lies between the ring and itself half a turn on.
    Over,
    /// Nothing: the ring's own values go on.
    Edge,
}

/// Sites on `rings` x `longitudes` places; a lamp at a pole is a ring of its own whose places are all that site.
#[derive(Debug, Clone)]
pub struct LatLongGrid {
    axis: Axis,
    first_longitude_rad: f64,
    longitudes: usize,
    /// Angles from the axis, ascending.
    colatitudes_rad: Vec<f64>,
    /// `sites[ring * longitudes + k]`.
    sites: Vec<u32>,
    ends: [End; 2],
}

impl LatLongGrid {
    /// Finds the grid of a set, about its own axis or the other one; `None` where it is not one.
    pub fn find(domain: &Directions) -> Option<Self> {
        let other = if domain.axis() == Axis::Y { Axis::Z } else { Axis::Y };
        Self::about(domain.axis(), domain.sites()).or_else(|| Self::about(other, domain.sites()))
    }

    fn about(axis: Axis, sites: &[Vec3]) -> Option<Self> {
        let mut order: Vec<(f64, f64, u32)> =
            sites.iter().zip(0..).map(|(s, n)| (colatitude(axis, s), longitude(axis, s), n)).collect();
        order.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut rings = vec![Vec::new()];
        let mut start = order.first()?.0;
        for site in order {
            if site.0 - start > TOLERANCE_RAD {
                rings.push(Vec::new());
                start = site.0;
            }
            if let Some(ring) = rings.last_mut() {
                ring.push(site);
            }
        }
        let is_pole = |ring: &[(f64, f64, u32)]| ring.len() == 1 && ring[0].0.sin() < TOLERANCE_RAD;
        let longitudes = rings.iter().find(|ring| !is_pole(ring))?.len();
        if longitudes < FEWEST_LONGITUDES || rings.len() < 2 {
            return None;
        }
        let mut first_longitude_rad = None;
        let (mut places, mut colatitudes_rad) = (Vec::new(), Vec::new());
        for ring in &mut rings {
            if is_pole(ring) {
                places.extend(std::iter::repeat_n(ring[0].2, longitudes));
                colatitudes_rad.push(if ring[0].0 < 1.0 { 0.0 } else { PI });
                continue;
            }
            if ring.len() != longitudes {
                return None;
            }
            ring.sort_by(|a, b| a.1.total_cmp(&b.1));
            let first = *first_longitude_rad.get_or_insert(ring[0].1);
            places.extend(places_on(ring, first, longitudes)?);
            colatitudes_rad.push(ring.iter().map(|site| site.0).sum::<f64>() / longitudes as f64);
        }
        let ends = ends(&colatitudes_rad, longitudes);
        let first_longitude_rad = first_longitude_rad?;
        Some(Self { axis, first_longitude_rad, longitudes, colatitudes_rad, sites: places, ends })
    }

    /// How many longitudes.
    pub fn longitudes(&self) -> usize {
        self.longitudes
    }

    /// How many rings, lamps at poles included.
    pub fn rings(&self) -> usize {
        self.colatitudes_rad.len()
    }

    /// The sites, ring after ring from the axis on, `longitudes` each; a pole's site stands in all of its places.
    pub fn sites(&self) -> &[u32] {
        &self.sites
    }

    /// Continuous column and row of a direction: whole numbers at the sites, rows linear in the angle from the axis between
    /// rings. Columns lie in 0 to `longitudes`, rows in -1/2 to `rings` - 1/2 or a pole's next row: half a row beyond an edge
    /// is where its mirrored rows begin, and what lies farther out is given the row there.
    pub fn coordinates(&self, direction: &Vec3) -> (f64, f64) {
        let turn = (longitude(self.axis, direction) - self.first_longitude_rad).rem_euclid(TAU) / TAU;
        (turn * self.longitudes as f64, self.row(colatitude(self.axis, direction)))
    }

    fn row(&self, colatitude_rad: f64) -> f64 {
        let rings = &self.colatitudes_rad;
        let last = rings.len() - 1;
        let after = rings.partition_point(|c| *c <= colatitude_rad);
        // The ring before and after; past an end, the one that would follow.
        let (low, high) = match after {
            0 => (self.beyond(0), rings[0]),
            n if n > last => (rings[last], self.beyond(1)),
            n => (rings[n - 1], rings[n]),
        };
        let row = after as f64 - 1.0 + (colatitude_rad - low) / (high - low);
        let first = if self.ends[0] == End::Edge { -0.5 } else { f64::MIN };
        let end = if self.ends[1] == End::Edge { last as f64 + 0.5 } else { f64::MAX };
        row.clamp(first, end)
    }

    /// The angle from the axis of the row beyond an end.
    fn beyond(&self, end: usize) -> f64 {
        let rings = &self.colatitudes_rad;
        let last = rings.len() - 1;
        let (ring, next, pole) = if end == 0 { (rings[0], rings[1], 0.0) } else { (rings[last], rings[last - 1], PI) };
        match self.ends[end] {
            End::Pole => 2.0 * pole - next,
            End::Over => 2.0 * pole - ring,
            End::Edge => 2.0 * ring - next,
        }
    }

    /// The site at a whole column and row, any of them: columns go round, rows beyond a pole come back half a turn on, rows
    /// beyond an edge are mirrored (the edge row twice).
    pub fn site(&self, column: i64, row: i64) -> u32 {
        let (rings, longitudes) = (self.rings() as i64, self.longitudes as i64);
        let (mut row, mut column) = (row, column);
        while !(0..rings).contains(&row) {
            let end = if row < 0 { 0 } else { 1 };
            let mirrored = if row < 0 { -1 - row } else { 2 * rings - 1 - row };
            let toward_end = if row < 0 { 1 } else { -1 };
            row = if self.ends[end] == End::Pole { mirrored + toward_end } else { mirrored };
            if self.ends[end] != End::Edge {
                column += longitudes / 2;
            }
        }
        self.sites[row as usize * self.longitudes + column.rem_euclid(longitudes) as usize]
    }
}

/// Angle from the axis.
fn colatitude(axis: Axis, direction: &Vec3) -> f64 {
    crate::math::angle_between(direction, &axis.vector())
}

/// Right-handed about the axis.
fn longitude(axis: Axis, direction: &Vec3) -> f64 {
    match axis {
        Axis::Y => direction.x.atan2(direction.z),
        Axis::Z => direction.y.atan2(direction.x),
    }
}

/// The sites of a ring in the order of the grid's longitudes, each exactly one place on.
fn places_on(ring: &[(f64, f64, u32)], first: f64, longitudes: usize) -> Option<Vec<u32>> {
    let step = TAU / longitudes as f64;
    let mut places = vec![None; longitudes];
    for &(colatitude_rad, longitude_rad, site) in ring {
        let place = (longitude_rad - first) / step;
        let nearest = place.round();
        if (place - nearest).abs() * step * colatitude_rad.sin() > TOLERANCE_RAD {
            return None;
        }
        let place = &mut places[nearest.rem_euclid(longitudes as f64) as usize % longitudes];
        if place.replace(site).is_some() {
            return None;
        }
    }
    places.into_iter().collect()
}

/// Beyond a ring that is no farther from the pole than from the next ring, the sphere goes on over the pole. An odd number
/// of longitudes has no opposite column.
fn ends(colatitudes_rad: &[f64], longitudes: usize) -> [End; 2] {
    let last = colatitudes_rad.len() - 1;
    let end = |to_pole: f64, to_next: f64| match to_pole {
        _ if longitudes % 2 == 1 => End::Edge,
        d if d < TOLERANCE_RAD => End::Pole,
        d if d <= to_next => End::Over,
        _ => End::Edge,
    };
    [
        end(colatitudes_rad[0], colatitudes_rad[1] - colatitudes_rad[0]),
        end(PI - colatitudes_rad[last], colatitudes_rad[last] - colatitudes_rad[last - 1]),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `rings` angles from +y, `longitudes` each, turned by `offset`.
    fn grid(colatitudes: &[f64], longitudes: usize, offset: f64) -> Vec<Vec3> {
        let at = |c: f64, k: usize| {
            let (s, l) = (c.sin(), offset + TAU * k as f64 / longitudes as f64);
            Vec3::new(s * l.sin(), c.cos(), s * l.cos())
        };
        colatitudes.iter().flat_map(|&c| (0..longitudes).map(move |k| at(c, k))).collect()
    }

    #[test]
    fn grids_are_found_whatever_their_order() {
        let colatitudes: Vec<f64> = (0..10).map(|i| (f64::from(i) + 0.5) * 0.15).collect();
        let mut lamps = grid(&colatitudes, 32, 0.7);
        lamps.swap(3, 200);
        lamps.push(Vec3::y());
        let domain = Directions::new(lamps).unwrap();
        let found = LatLongGrid::find(&domain).unwrap();
        assert_eq!((found.rings(), found.longitudes()), (11, 32));
        for (row, ring) in found.sites().chunks(32).enumerate().skip(1) {
            for (column, &site) in ring.iter().enumerate() {
                let (c, r) = found.coordinates(&domain.sites()[site as usize]);
                let off = (c - column as f64).abs();
                assert!(off.min(32.0 - off) < 1e-9 && (r - row as f64).abs() < 1e-9, "({c}, {r}) at ({column}, {row})");
                assert_eq!(found.site(column as i64, row as i64), site);
            }
        }
    }

    #[test]
    fn rows_go_on_over_the_pole_half_a_turn_on() {
        let domain = Directions::new(grid(&[0.1, 0.3, 0.5], 8, 0.0)).unwrap();
        let found = LatLongGrid::find(&domain).unwrap();
        assert_eq!(found.coordinates(&Vec3::y()).1, -0.5);
        assert_eq!(found.site(1, -1), found.site(5, 0));
        assert_eq!(found.site(1, -2), found.site(5, 1));
        assert_eq!(found.site(-3, 3), found.site(5, 2), "an edge repeats its row");
        let mut with_pole = grid(&[0.2, 0.4], 8, 0.0);
        with_pole.push(Vec3::y());
        let found = LatLongGrid::find(&Directions::new(with_pole).unwrap()).unwrap();
        assert_eq!(found.coordinates(&Vec3::y()).1, 0.0);
        assert_eq!(found.site(1, -1), found.site(5, 1));
    }

    /// A stage without lamps overhead: the hole takes the innermost ring, not rows mirrored from far out.
    #[test]
    fn beyond_an_edge_the_edge_goes_on() {
        let domain = Directions::new(grid(&[0.9, 1.0, 1.1, 1.2, 1.3], 8, 0.0)).unwrap();
        let found = LatLongGrid::find(&domain).unwrap();
        for (direction, row) in [(Vec3::y(), -0.5), (Vec3::new(0.0, 0.95, 0.3).normalize(), -0.5), (-Vec3::y(), 4.5)] {
            assert_eq!(found.coordinates(&direction).1, row, "{direction}");
        }
    }

    #[test]
    fn scattered_lamps_are_no_grid() {
        let mut lamps = grid(&[0.2, 0.4, 0.6], 8, 0.0);
        lamps[11] = Vec3::new(0.5, 0.6, 0.3).normalize();
        assert!(LatLongGrid::find(&Directions::new(lamps.clone()).unwrap()).is_none());
        lamps.pop();
        assert!(LatLongGrid::find(&Directions::new(lamps).unwrap()).is_none());
        assert!(LatLongGrid::find(&Directions::new(vec![Vec3::z(), Vec3::x()]).unwrap()).is_none());
    }
}
