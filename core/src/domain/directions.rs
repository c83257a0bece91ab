//! Lamps at infinity: a set of directions with an axis and a coverage.

use std::f64::consts::{FRAC_PI_2, PI};

use rstar::RTree;
use rstar::primitives::GeomWithData;

use crate::error::{Error, Result};
use crate::math::{Vec3, angle_between};

/// Lamps nearer than this are one site: far below any rig's precision, far above the rounding of a text file.
const SAME_SITE_RAD: f64 = 1e-6;
/// A lamp this little beyond the equator is on it (six decimals in a `.lp` file cannot tell).
const EQUATOR_TOLERANCE_RAD: f64 = 1e-3;

/// The axis a set is arranged about.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub enum Axis {
    /// +z: a dome before the object.
    #[serde(rename = "+z")]
    Z,
    /// +y: an arc over a turntable.
    #[serde(rename = "+y")]
    Y,
}

impl Axis {
    /// The unit vector.
    pub fn vector(self) -> Vec3 {
        match self {
            Axis::Z => Vec3::z(),
            Axis::Y => Vec3::y(),
        }
    }
}

/// Where the lamps can stand for light.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Coverage {
    /// All directions.
    Sphere,
    /// A cap about the axis.
    Cap {
        /// From the axis to the rim, radians.
        half_angle_rad: f64,
    },
}

/// A hole at the far end of the axis that is narrower than this many spacings is a gap between lamps, not an end of the
/// coverage. Uniformly random sets leave a wider one only once in sixteen: P(no lamp within 2 spacings) = 2^-4.
const GAP_SPACINGS: f64 = 2.0;

/// A node of the search tree: a site's coordinates and its number.
type SitePoint = GeomWithData<[f64; 3], u32>;

/// Lamp directions (unit, stage frame) in the order of the photographs, their axis and coverage.
///
/// Lamps at the same place share a *site*; kernels are made for sites, and a site's lamps share its weight equally.
///
/// ```
/// use relume_core::{domain::Directions, math::Vec3};
/// let lamps = Directions::new(vec![Vec3::z(), Vec3::x(), Vec3::y()])?;
/// assert_eq!(lamps.nearest(&Vec3::new(0.9, 0.1, 0.2).normalize()), 1);
/// # Ok::<(), relume_core::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct Directions {
    lamps: Vec<Vec3>,
    sites: Vec<Vec3>,
    members: Vec<Vec<u32>>,
    tree: RTree<SitePoint>,
    axis: Axis,
    coverage: Coverage,
}

impl Directions {
    /// Takes unit directions in the order of the photographs, and finds axis and coverage: of +z and +y the axis that
    /// needs the smaller cap, and a cap whose half-angle is the outermost lamp's plus half the median spacing, at most 90
    /// degrees unless lamps lie beyond; a cap whose hole is narrower than two spacings is the sphere.
    ///
    /// # Errors
    /// No lamp, or a vector that is not of unit length to 1e-3 (such as zero or NaN), named by its number from 1.
    pub fn new(lamps: Vec<Vec3>) -> Result<Self> {
        let mut set = Self::with_coverage(lamps, Axis::Z, Coverage::Sphere)?;
        let spacing = set.median_spacing();
        let outermost = |axis: Axis| set.sites.iter().map(|s| angle_between(s, &axis.vector())).fold(0.0, f64::max);
        let (about_z, about_y) = (outermost(Axis::Z), outermost(Axis::Y));
        // Half a spacing of advantage is chance; +z is where most sets are arranged.
        let (axis, outer) = if about_y + spacing / 2.0 < about_z { (Axis::Y, about_y) } else { (Axis::Z, about_z) };
        let reach = outer + spacing / 2.0;
        set.axis = axis;
        set.coverage = if outer + GAP_SPACINGS * spacing >= PI {
            Coverage::Sphere
        } else if outer > FRAC_PI_2 + EQUATOR_TOLERANCE_RAD {
            Coverage::Cap { half_angle_rad: reach.min(PI) }
        } else {
            Coverage::Cap { half_angle_rad: reach.min(FRAC_PI_2) }
        };
        Ok(set)
    }

    /// Takes directions with a known axis and coverage, as a container stores them.
    ///
    /// # Errors
    /// As [`Directions::new`]; a half-angle outside (0, pi].
    pub fn with_coverage(lamps: Vec<Vec3>, axis: Axis, coverage: Coverage) -> Result<Self> {
        if lamps.is_empty() {
            return Err(Error::invalid("light directions", "none", "at least one"));
        }
        if let Some(n) = lamps.iter().position(|d| !(0.999..=1.001).contains(&d.norm())) {
            let found = format!("({}, {}, {})", lamps[n].x, lamps[n].y, lamps[n].z);
            return Err(Error::invalid(format!("light direction {}", n + 1), found, "a unit vector"));
        }
        if let Coverage::Cap { half_angle_rad } = coverage
            && !(half_angle_rad > 0.0 && half_angle_rad <= PI)
        {
            return Err(Error::invalid("coverage", format!("a half-angle of {half_angle_rad}"), "0 to pi radians"));
        }
        let lamps: Vec<Vec3> = lamps.into_iter().map(|d| d.normalize()).collect();
        let (sites, members) = sites_of(&lamps);
        let tree = RTree::bulk_load(sites.iter().zip(0..).map(|(s, n)| SitePoint::new([s.x, s.y, s.z], n)).collect());
        Ok(Self { lamps, sites, members, tree, axis, coverage })
    }

    /// The lamps, in the order of the photographs.
    pub fn lamps(&self) -> &[Vec3] {
        &self.lamps
    }

    /// How many lamps.
    pub fn len(&self) -> usize {
        self.lamps.len()
    }

    /// Never true of a constructed set.
    pub fn is_empty(&self) -> bool {
        self.lamps.is_empty()
    }

    /// Distinct directions.
    pub fn sites(&self) -> &[Vec3] {
        &self.sites
    }

    /// The lamps at each site, in ascending order.
    pub fn members(&self) -> &[Vec<u32>] {
        &self.members
    }

    /// The axis.
    pub fn axis(&self) -> Axis {
        self.axis
    }

    /// The coverage.
    pub fn coverage(&self) -> Coverage {
        self.coverage
    }

    /// Solid angle of the coverage, steradians: `2 pi (1 - cos half_angle)`, or 4 pi.
    pub fn covered_solid_angle(&self) -> f64 {
        match self.coverage {
            Coverage::Sphere => 4.0 * PI,
            Coverage::Cap { half_angle_rad } => 2.0 * PI * (1.0 - half_angle_rad.cos()),
        }
    }

    /// Is a direction inside the coverage?
    pub fn covers(&self, direction: &Vec3) -> bool {
        match self.coverage {
            Coverage::Sphere => true,
            Coverage::Cap { half_angle_rad } => direction.dot(&self.axis.vector()) >= half_angle_rad.cos(),
        }
    }

    /// The lamp nearest to a direction; where several stand at one place, the first of them.
    pub fn nearest(&self, direction: &Vec3) -> usize {
        self.members[self.nearest_site(direction)][0] as usize
    }

    /// The site nearest to a direction. On the unit sphere the nearest by chord is the nearest by angle.
    pub fn nearest_site(&self, direction: &Vec3) -> usize {
        self.tree.nearest_neighbor([direction.x, direction.y, direction.z]).map_or(0, |site| site.data as usize)
    }

    /// The sites, nearest first.
    pub fn nearest_sites(&self, direction: &Vec3) -> impl Iterator<Item = usize> {
        self.tree.nearest_neighbor_iter([direction.x, direction.y, direction.z]).map(|site| site.data as usize)
    }

    /// Median over the sites of the angle to the nearest other site; a lone site has a right angle to itself.
    pub fn median_spacing(&self) -> f64 {
        let nearest_other = |s: &Vec3| {
            let other = self.tree.nearest_neighbor_iter([s.x, s.y, s.z]).nth(1);
            other.map_or(FRAC_PI_2, |o| angle_between(s, &self.sites[o.data as usize]))
        };
        let mut spacings: Vec<f64> = self.sites.iter().map(nearest_other).collect();
        let middle = spacings.len() / 2;
        *spacings.select_nth_unstable_by(middle, f64::total_cmp).1
    }
}

/// Merges lamps that stand at one place: sites in order of first appearance, and the lamps of each.
fn sites_of(lamps: &[Vec3]) -> (Vec<Vec3>, Vec<Vec<u32>>) {
    let mut tree: RTree<SitePoint> = RTree::new();
    let (mut sites, mut members): (Vec<Vec3>, Vec<Vec<u32>>) = (Vec::new(), Vec::new());
    for (lamp, n) in lamps.iter().zip(0u32..) {
        let at = [lamp.x, lamp.y, lamp.z];
        match tree.nearest_neighbor(at) {
            Some(site) if angle_between(lamp, &sites[site.data as usize]) < SAME_SITE_RAD => {
                members[site.data as usize].push(n);
            }
            _ => {
                tree.insert(SitePoint::new(at, sites.len() as u32));
                sites.push(*lamp);
                members.push(vec![n]);
            }
        }
    }
    (sites, members)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Spherical Fibonacci points with `dot(axis) >= lowest`.
    fn fibonacci(n: usize, axis: Axis, lowest: f64) -> Vec<Vec3> {
        let golden = PI * (3.0 - 5f64.sqrt());
        let point = |k: usize| {
            let h = 1.0 - (k as f64 + 0.5) / n as f64 * (1.0 - lowest);
            let (r, (s, c)) = ((1.0 - h * h).sqrt(), (golden * k as f64).sin_cos());
            match axis {
                Axis::Z => Vec3::new(r * c, r * s, h),
                Axis::Y => Vec3::new(r * s, h, r * c),
            }
        };
        (0..n).map(point).collect()
    }

    #[test]
    fn domes_arcs_and_spheres_are_told_apart() {
        let dome = Directions::new(fibonacci(300, Axis::Z, 0.2)).unwrap();
        assert_eq!(dome.axis(), Axis::Z);
        let Coverage::Cap { half_angle_rad } = dome.coverage() else { panic!("a dome is a cap") };
        let expected = 0.2f64.acos() + dome.median_spacing() / 2.0;
        assert!((half_angle_rad - expected).abs() < 0.02, "{half_angle_rad} is not about {expected}");

        let arc = Directions::new(fibonacci(300, Axis::Y, 0.0)).unwrap();
        assert_eq!((arc.axis(), arc.coverage()), (Axis::Y, Coverage::Cap { half_angle_rad: FRAC_PI_2 }));

        let below = Directions::new(fibonacci(300, Axis::Y, -0.5)).unwrap();
        assert!(matches!(below.coverage(), Coverage::Cap { half_angle_rad } if half_angle_rad > 2.0944));

        for n in [6, 20, 331, 2000] {
            let sphere = Directions::new(fibonacci(n, Axis::Z, -1.0)).unwrap();
            assert_eq!(sphere.coverage(), Coverage::Sphere, "{n} lamps");
        }
    }

    #[test]
    fn duplicates_share_a_site() {
        let set = Directions::new(vec![Vec3::z(), Vec3::x(), Vec3::z(), Vec3::y(), Vec3::x()]).unwrap();
        assert_eq!(set.members(), [vec![0, 2], vec![1, 4], vec![3]]);
        assert_eq!(set.nearest(&Vec3::z()), 0);
        assert!((set.median_spacing() - FRAC_PI_2).abs() < 1e-12);
        assert!(Directions::new(vec![Vec3::z(); 4]).is_ok(), "one site alone");
    }

    #[test]
    fn nearest_agrees_with_a_plain_search() {
        let set = Directions::new(fibonacci(500, Axis::Z, -1.0)).unwrap();
        for query in fibonacci(2000, Axis::Y, -1.0) {
            let plain =
                (0..500).max_by(|&a, &b| query.dot(&set.lamps[a]).total_cmp(&query.dot(&set.lamps[b]))).unwrap();
            let (d, e) = (query.dot(&set.lamps[set.nearest(&query)]), query.dot(&set.lamps[plain]));
            assert!((d - e).abs() < 1e-14);
        }
    }

    #[test]
    fn vectors_that_are_no_directions_are_refused() {
        for bad in [Vec3::zeros(), Vec3::new(f64::NAN, 0.0, 1.0), Vec3::new(0.0, 0.0, 2.0)] {
            let message = Directions::new(vec![Vec3::z(), bad]).unwrap_err().to_string();
            assert!(message.contains("direction 2"), "{message}");
        }
        assert!(Directions::new(vec![]).is_err());
    }
}
