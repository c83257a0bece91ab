//! Lamps at infinity: a set of directions with an axis and a coverage.

use crate::error::Result;
use crate::math::Vec3;

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

/// Where the lamps can stand for light.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Coverage {
    /// All directions.
    Sphere,
    /// A cap about the axis.
    Cap {
        /// From the axis to the rim, radians.
        half_angle_rad: f64,
    },
}

/// Lamp directions (unit, stage frame), their axis and coverage.
#[derive(Debug, Clone)]
pub struct Directions {
    lamps: Vec<Vec3>,
}

impl Directions {
    /// Takes directions in the order of the photographs.
    ///
    /// # Errors
    /// No lamp, or a vector that is not of unit length to 1e-3.
    pub fn new(lamps: Vec<Vec3>) -> Result<Self> {
        Ok(Self { lamps })
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

    /// The axis.
    pub fn axis(&self) -> Axis {
        todo!()
    }

    /// The coverage.
    pub fn coverage(&self) -> Coverage {
        todo!()
    }

    /// Solid angle of the coverage, steradians.
    pub fn covered_solid_angle(&self) -> f64 {
        todo!()
    }

    /// Is a direction inside the coverage?
    pub fn covers(&self, direction: &Vec3) -> bool {
        let _ = direction;
        todo!()
    }

    /// The lamp nearest to a direction; of duplicates the first.
    pub fn nearest(&self, direction: &Vec3) -> usize {
        let _ = direction;
        todo!()
    }
}
