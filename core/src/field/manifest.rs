//! `manifest.json`: what a container holds. Additive changes keep the major version; readers refuse a newer one.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::domain::{Axis, Coverage, Directions};
use crate::error::{Error, Result};
use crate::image::ColourSpace;
use crate::math::Vec3;

/// The `format` field of every manifest.
pub const FORMAT: &str = "relume.rfield";
/// Major and minor version that this library writes.
pub const VERSION: [u32; 2] = [1, 0];
/// Rows or columns beyond this are taken for corruption: no camera comes near.
const LARGEST_SIDE: usize = 1 << 17;
/// Lamps beyond this are taken for corruption.
const MOST_ELEMENTS: usize = 1 << 20;

/// How numbers of `T` are stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Precision {
    /// 16-bit, with a power-of-two scale in the manifest.
    #[default]
    Half,
    /// 32-bit.
    Float,
}

impl Precision {
    /// Bytes a number.
    pub fn bytes(self) -> usize {
        match self {
            Precision::Half => 2,
            Precision::Float => 4,
        }
    }

    /// numpy's name of the type.
    pub(super) fn descr(self) -> &'static str {
        match self {
            Precision::Half => "<f2",
            Precision::Float => "<f4",
        }
    }
}

/// Everything about a container but its arrays.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Manifest {
    /// [`FORMAT`].
    pub format: String,
    /// Major, minor.
    pub version: [u32; 2],
    /// Program and version that wrote it.
    pub tool: String,
    /// Id of the [`ColourSpace`] of all colours; `lin_rec709` unless said otherwise.
    pub colour_space: String,
    /// Columns of the pictures.
    pub width: usize,
    /// Rows of the pictures.
    pub height: usize,
    /// What the rig could emit.
    pub domain: Domain,
    /// How `T` is represented.
    pub representation: Representation,
    /// Layer name -> entry: `ambient`, `alpha`, `normals`, `albedo`.
    pub layers: BTreeMap<String, String>,
    /// Where the field came from; free form, for people.
    pub provenance: serde_json::Value,
    /// Entry -> BLAKE3 of its bytes, hexadecimal, for every entry but this one.
    pub blake3: BTreeMap<String, String>,
}

/// What the rig could emit.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum Domain {
    /// Lamps at infinity.
    Directions {
        /// The axis of the set.
        axis: Axis,
        /// Where the lamps can stand for light.
        coverage: Coverage,
        /// Unit vectors from the object to each lamp, stage frame.
        directions: Vec<[f64; 3]>,
        /// E_j: irradiance of lamp j on a patch facing it; T_j = photo_j / E_j.
        irradiance: Vec<f32>,
    },
}

/// How `T` is represented.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum Representation {
    /// One coefficient picture per element.
    Dense {
        /// The entry.
        array: String,
        /// The projection whose elements these are: `lamps`.
        basis: String,
        /// How numbers are stored.
        precision: Precision,
        /// A power of two: T = stored x scale. Written with all its digits, so that readers in double precision get it
        /// exactly.
        #[serde(serialize_with = "exactly")]
        scale: f32,
    },
}

/// The shortest decimals that give an f32 back are not the same number in double precision; those of the f64 are.
fn exactly<S: serde::Serializer>(number: &f32, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_f64(f64::from(*number))
}

impl Manifest {
    /// Parses and checks a manifest; `place` names the file in messages.
    ///
    /// # Errors
    /// Not JSON, another format, a newer major version, sizes that no rig has.
    pub fn parse(bytes: &[u8], place: &str) -> Result<Self> {
        let place = format!("{place}, manifest.json");
        /// The part that every version has.
        #[derive(Deserialize)]
        struct Header {
            format: String,
            version: [u32; 2],
        }
        let invalid = |e: serde_json::Error| {
            Error::invalid(format!("{place}, line {}", e.line()), e.to_string(), "a Relume manifest")
        };
        let header: Header = serde_json::from_slice(bytes).map_err(invalid)?;
        if header.format != FORMAT {
            return Err(Error::invalid(place, format!("format `{}`", header.format), format!("`{FORMAT}`")));
        }
        if header.version[0] != VERSION[0] {
            return Err(Error::Unsupported {
                place,
                what: format!("container version {}.{}", header.version[0], header.version[1]),
                advice: format!("this Relume reads version {}; use a newer one", VERSION[0]),
            });
        }
        let manifest: Self = serde_json::from_slice(bytes).map_err(invalid)?;
        manifest.check(&place)?;
        Ok(manifest)
    }

    fn check(&self, place: &str) -> Result<()> {
        let refuse = |found: String, expected: &str| Err(Error::invalid(place, found, expected));
        let Domain::Directions { directions, irradiance, .. } = &self.domain;
        let Representation::Dense { basis, scale, .. } = &self.representation;
        if !(1..=LARGEST_SIDE).contains(&self.width) || !(1..=LARGEST_SIDE).contains(&self.height) {
            return refuse(format!("a picture of {} x {}", self.width, self.height), "1 to 131072 pixels a side");
        }
        if !(1..=MOST_ELEMENTS).contains(&directions.len()) {
            return refuse(format!("{} lamps", directions.len()), "1 to 1048576");
        }
        if irradiance.len() != directions.len() || irradiance.iter().any(|e| !(e.is_finite() && *e > 0.0)) {
            return refuse(format!("{} irradiances", irradiance.len()), "one positive number a lamp");
        }
        let known: Result<ColourSpace> = self.colour_space.parse();
        if let Err(Error::Invalid { found, expected, .. }) = known {
            return refuse(format!("colour space {found}"), &expected);
        }
        if basis != "lamps" {
            return refuse(format!("basis `{basis}`"), "`lamps`");
        }
        // Powers of two and their reciprocals only: scaling must not round.
        if !(scale.is_normal() && *scale > 0.0 && scale.to_bits() & 0x007f_ffff == 0) {
            return refuse(format!("scale {scale}"), "a power of two");
        }
        Ok(())
    }

    /// The colours of transport and layers.
    ///
    /// # Errors
    /// An id that is not known; [`Manifest::parse`] has refused it already.
    pub fn colours(&self) -> Result<ColourSpace> {
        self.colour_space.parse()
    }

    /// The lamps.
    ///
    /// # Errors
    /// Vectors that are no directions.
    pub fn directions(&self) -> Result<Directions> {
        let Domain::Directions { axis, coverage, directions, .. } = &self.domain;
        Directions::with_coverage(directions.iter().map(|d| Vec3::from(*d)).collect(), *axis, *coverage)
    }

    /// E_j of each lamp.
    pub fn irradiance(&self) -> &[f32] {
        let Domain::Directions { irradiance, .. } = &self.domain;
        irradiance
    }
}
