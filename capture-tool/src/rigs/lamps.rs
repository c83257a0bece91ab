//! Where the lamps of a stage stand.

use std::f64::consts::PI;
use std::path::{Path, PathBuf};

use relume_core::domain::{Directions, lp};
use relume_core::math::Vec3;
use relume_core::{Error, Result};
use serde::{Deserialize, Serialize};

/// More lamps than this are a slip of the finger.
const MOST: usize = 100_000;

/// Where lamps stand; `layout` says which.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "layout", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Lamps {
    /// Lamps on a quarter arc over a turntable (2.3): `latitudes` lamps, from the horizon up, each in the middle of its part of
    /// 90 degrees; `longitudes` stops of the turntable, from the camera's side (+z) towards +x. All latitudes of a stop come
    /// before the turntable moves.
    Arc {
        /// Lamps on the arc.
        latitudes: usize,
        /// Stops of the turntable.
        longitudes: usize,
        /// Azimuth of the first stop, degrees.
        #[serde(default, skip_serializing_if = "is_zero")]
        first_deg: f64,
        /// What the stops are spread over, evenly: less than a turn is a part of the hemisphere.
        #[serde(default = "whole_turn", skip_serializing_if = "is_whole_turn")]
        span_deg: f64,
    },
    /// A fixed dome: rings about +y.
    Rings {
        /// From the lowest up.
        rings: Vec<Ring>,
    },
    /// A fixed sphere, spread evenly (spherical Fibonacci lattice), from +y down.
    Sphere {
        /// Lamps.
        count: usize,
    },
    /// As a .lp file says; relative to the rig file.
    File {
        /// The .lp file.
        file: PathBuf,
    },
    /// As listed: unit vectors from the object to the lamps.
    List {
        /// x right, y up, z to the camera.
        directions: Vec<[f64; 3]>,
    },
}

fn is_zero(value: &f64) -> bool {
    *value == 0.0
}

fn whole_turn() -> f64 {
    360.0
}

fn is_whole_turn(value: &f64) -> bool {
    *value == whole_turn()
}

/// A ring of lamps.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Ring {
    /// Above the horizon.
    pub elevation_deg: f64,
    /// Lamps in it.
    pub count: usize,
    /// Azimuth of the first, from +z towards +x.
    #[serde(default)]
    pub first_deg: f64,
}

impl Lamps {
    /// Reads a .lp file into a list, so that a session does not depend on it. Other layouts stay.
    ///
    /// # Errors
    /// A bad .lp file.
    pub fn resolved(self, folder: &Path) -> Result<Self> {
        let Lamps::File { file } = self else { return Ok(self) };
        let lamps = lp::read(&folder.join(file), lp::Lengths::Unit)?;
        Ok(Lamps::List { directions: lamps.directions.iter().map(|d| [d.x, d.y, d.z]).collect() })
    }

    /// Refuses what is no stage. `place` names the file.
    ///
    /// # Errors
    /// No lamps, too many, angles that are none.
    pub fn check(&self, place: &str) -> Result<()> {
        let place = place.to_owned();
        if let Lamps::Rings { rings } = self
            && let Some(ring) = rings.iter().find(|r| r.elevation_deg.abs() > 90.0 || !r.first_deg.is_finite())
        {
            let found = format!("elevation_deg = {}, first_deg = {}", ring.elevation_deg, ring.first_deg);
            return Err(Error::invalid(place, found, "degrees from -90 to 90, and a finite first one"));
        }
        if let Lamps::Arc { first_deg, span_deg, .. } = self
            && !(first_deg.is_finite() && *span_deg > 0.0 && *span_deg <= whole_turn())
        {
            let found = format!("first_deg = {first_deg}, span_deg = {span_deg}");
            return Err(Error::invalid(
                place,
                found,
                "a finite first azimuth, and a span above 0 and up to 360 degrees",
            ));
        }
        let count = self.count();
        if !(1..=MOST).contains(&count) {
            return Err(Error::invalid(place, format!("{count} lamps"), format!("1 to {MOST}")));
        }
        Directions::new(self.directions()).map(|_| ())
    }

    /// Lamps in all: columns of `T`.
    pub fn count(&self) -> usize {
        match self {
            Lamps::Arc { latitudes, longitudes, .. } => latitudes.saturating_mul(*longitudes),
            Lamps::Rings { rings } => rings.iter().fold(0usize, |sum, ring| sum.saturating_add(ring.count)),
            Lamps::Sphere { count } => *count,
            Lamps::File { .. } => 0,
            Lamps::List { directions } => directions.len(),
        }
    }

    /// Stops of the turntable; lamp j is lit at stop `j / per_stop`.
    pub fn stops(&self) -> usize {
        if let Lamps::Arc { longitudes, .. } = self { *longitudes } else { 1 }
    }

    /// Lamps lit at each stop.
    pub fn per_stop(&self) -> usize {
        if let Lamps::Arc { latitudes, .. } = self { *latitudes } else { self.count() }
    }

    /// Where the turntable is at a stop, as the azimuth of the lamps over it; `None` of a fixed dome.
    pub fn turned_deg(&self, stop: usize) -> Option<f64> {
        match self {
            Lamps::Arc { longitudes, first_deg, span_deg, .. } => {
                Some(first_deg + span_deg * stop as f64 / *longitudes as f64)
            }
            _ => None,
        }
    }

    /// Which physical lamp lights as lamp j: on an arc the same one at every stop.
    pub fn bulb(&self, lamp: usize) -> usize {
        lamp % self.per_stop().max(1)
    }

    /// Unit vectors from the object to the lamps, in order.
    pub fn directions(&self) -> Vec<Vec3> {
        match self {
            Lamps::Arc { latitudes, longitudes, .. } => {
                let at = |lamp: usize| {
                    let (stop, bulb) = (lamp / latitudes, lamp % latitudes);
                    let elevation = PI / 2.0 * (bulb as f64 + 0.5) / *latitudes as f64;
                    direction(elevation, self.turned_deg(stop).unwrap_or_default().to_radians())
                };
                (0..latitudes * longitudes).map(at).collect()
            }
            Lamps::Rings { rings } => rings.iter().flat_map(Ring::directions).collect(),
            Lamps::Sphere { count } => {
                let golden = PI * (3.0 - 5f64.sqrt());
                let elevation = |i: usize| (1.0 - (2 * i + 1) as f64 / *count as f64).asin();
                (0..*count).map(|i| direction(elevation(i), (golden * i as f64) % (2.0 * PI))).collect()
            }
            Lamps::File { .. } => Vec::new(),
            Lamps::List { directions } => directions.iter().map(|d| Vec3::from(*d)).collect(),
        }
    }
}

impl Ring {
    fn directions(&self) -> impl Iterator<Item = Vec3> + use<> {
        let Ring { elevation_deg, count, first_deg } = *self;
        (0..count).map(move |n| {
            let azimuth = first_deg.to_radians() + 2.0 * PI * n as f64 / count as f64;
            direction(elevation_deg.to_radians(), azimuth)
        })
    }
}

/// From angles: elevation above the horizon, azimuth from +z towards +x.
fn direction(elevation_rad: f64, azimuth_rad: f64) -> Vec3 {
    let ((up, out), (x, z)) = (elevation_rad.sin_cos(), azimuth_rad.sin_cos());
    Vec3::new(x * out, up, z * out)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn arc(latitudes: usize, longitudes: usize) -> Lamps {
        Lamps::Arc { latitudes, longitudes, first_deg: 0.0, span_deg: 360.0 }
    }

    /// Eight stops over a quarter turn, each in the middle of its part.
    #[test]
    fn a_part_of_the_hemisphere_can_be_said() {
        let text = "layout = \"arc\"\nlatitudes = 7\nlongitudes = 8\nfirst_deg = 5.625\nspan_deg = 90.0\n";
        let quarter: Lamps = toml::from_str(text).unwrap();
        quarter.check("rig.toml").unwrap();
        let directions = quarter.directions();
        assert_eq!((directions.len(), quarter.stops(), quarter.per_stop()), (56, 8, 7));
        let azimuths: Vec<f64> = directions.iter().map(|d| d.x.atan2(d.z).to_degrees()).collect();
        let (low, high) = azimuths.iter().fold((360.0f64, 0.0f64), |(low, high), a| (low.min(*a), high.max(*a)));
        assert!((low - 5.625).abs() < 1e-9 && (high - 84.375).abs() < 1e-9, "{low}, {high}");
        assert_eq!(toml::to_string(&arc(7, 8)).unwrap(), "layout = \"arc\"\nlatitudes = 7\nlongitudes = 8\n");
    }

    #[test]
    fn an_arc_does_all_latitudes_of_a_stop_first() {
        let arc = arc(3, 4);
        assert_eq!((arc.count(), arc.stops(), arc.per_stop()), (12, 4, 3));
        let d = arc.directions();
        assert!((d[0] - Vec3::new(0.0, 15f64.to_radians().sin(), 15f64.to_radians().cos())).norm() < 1e-12);
        assert!(d[1].y > d[0].y && d[2].y > d[1].y, "the arc from the horizon up");
        assert!(d[3].x > 0.9 && d[3].z.abs() < 1e-9, "the next stop: from +z towards +x");
        assert_eq!((arc.bulb(1), arc.bulb(4)), (1, 1));
    }

    #[test]
    fn layouts_have_their_counts_and_are_unit_vectors() {
        let ring = |elevation_deg, count| Ring { elevation_deg, count, first_deg: 0.0 };
        let dome = Lamps::Rings { rings: vec![ring(15.0, 18), ring(45.0, 12), ring(90.0, 1)] };
        for (lamps, count) in [(dome, 31), (Lamps::Sphere { count: 331 }, 331)] {
            let d = lamps.directions();
            assert_eq!((d.len(), lamps.count(), lamps.stops(), lamps.per_stop()), (count, count, 1, count));
            assert!(d.iter().all(|d| (d.norm() - 1.0).abs() < 1e-12));
            lamps.check("rig.toml").unwrap();
        }
        let sphere = Directions::new(Lamps::Sphere { count: 331 }.directions()).unwrap();
        assert!((sphere.covered_solid_angle() - 4.0 * PI).abs() < 1e-9);
    }

    #[test]
    fn what_is_no_stage_is_refused() {
        for lamps in [
            Lamps::Sphere { count: 0 },
            Lamps::Sphere { count: 1 << 40 },
            arc(usize::MAX, 3),
            Lamps::Arc { latitudes: 2, longitudes: 3, first_deg: f64::NAN, span_deg: 90.0 },
            Lamps::Arc { latitudes: 2, longitudes: 3, first_deg: 0.0, span_deg: 0.0 },
            Lamps::Rings { rings: vec![Ring { elevation_deg: 91.0, count: 3, first_deg: 0.0 }] },
            Lamps::Rings { rings: vec![Ring { elevation_deg: f64::NAN, count: 3, first_deg: 0.0 }] },
            Lamps::List { directions: vec![[0.0, 0.0, 2.0]] },
        ] {
            let message = lamps.check("rig.toml").unwrap_err().to_string();
            assert!(!message.is_empty(), "{lamps:?}");
        }
    }
}
