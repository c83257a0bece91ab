//! `manifest.json`: what a container holds. Additive changes keep the major version; readers refuse a newer one.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::domain::{self, Axis, Correspondence, Coverage, Directions, Filter, Gantry, Plane, Pose};
use crate::error::{Error, Result};
use crate::image::ColourSpace;
use crate::math::Vec3;

/// The `format` field of every manifest.
pub const FORMAT: &str = "relume.rfield";
/// Major and minor version that this library writes. 2: several representations; 1, with one, is read too. 2.1: screens. 2.2: projectors.
pub const VERSION: [u32; 2] = [2, 2];
/// The first major version.
const OLDEST: u32 = 1;
/// Rows or columns beyond this are taken for corruption: no camera comes near.
const LARGEST_SIDE: usize = 1 << 17;
/// Lamps, texels of a screen, or squares of a projector at all positions, beyond this are taken for corruption.
pub const MOST_ELEMENTS: usize = 1 << 20;

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
    /// How `T` is represented: at least once, each kind at most once.
    #[serde(alias = "representation", deserialize_with = "one_or_several")]
    pub representations: Vec<Representation>,
    /// Layer name -> entry: `ambient`, `alpha`, `reliability`, `normals`, `albedo`.
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
    /// The texels of a screen; T is the answer to radiance 1 of a texel, that of the white screen.
    Plane {
        /// Texels in a row.
        columns: usize,
        /// Texels in a column.
        rows: usize,
        /// Where on the screen each pixel of the camera looks, if that is known.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        correspondence: Option<Box<Correspondence>>,
    },
    /// The squares of a projector at many positions: element (position x squares + row) x squares + column. T is the answer to
    /// radiant intensity 1 of a square.
    Gantry {
        /// The axis of the positions.
        axis: Axis,
        /// Where the positions can stand for light.
        coverage: Coverage,
        /// Where the projector stood, and how it looked.
        positions: Vec<Stand>,
        /// I_p: radiant intensity of the white that each position showed; T_j = photo_j / I_p.
        intensity: Vec<f32>,
        /// Squares along each side of its picture.
        squares: usize,
        /// Angle across its picture, radians.
        view_rad: f64,
        /// How squares fall off.
        filter: Filter,
    },
}

/// Where a projector stood, in the stage frame and scene units.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Stand {
    /// Its lens.
    pub place: [f64; 3],
    /// To the right of what it sees, unit.
    pub right: [f64; 3],
    /// To the top of what it sees, unit.
    pub up: [f64; 3],
}

impl From<&Pose> for Stand {
    fn from(pose: &Pose) -> Self {
        Self { place: pose.place.into(), right: pose.right.into(), up: pose.up.into() }
    }
}

impl From<&Stand> for Pose {
    fn from(stand: &Stand) -> Self {
        Self { place: stand.place.into(), right: stand.right.into(), up: stand.up.into() }
    }
}

impl Domain {
    fn check(&self, place: &str) -> Result<()> {
        let refuse = |found: String, expected: &str| Err(Error::invalid(place, found, expected));
        match self {
            Domain::Directions { directions, irradiance, .. } => {
                if !(1..=MOST_ELEMENTS).contains(&directions.len()) {
                    return refuse(format!("{} lamps", directions.len()), "1 to 1048576");
                }
                if irradiance.len() != directions.len() || irradiance.iter().any(|e| !(e.is_finite() && *e > 0.0)) {
                    return refuse(format!("{} irradiances", irradiance.len()), "one positive number a lamp");
                }
                Ok(())
            }
            Domain::Plane { columns, rows, .. } => match columns.checked_mul(*rows) {
                Some(1..=MOST_ELEMENTS) => Ok(()),
                _ => refuse(format!("{columns} x {rows} texels"), "1 to 1048576"),
            },
            Domain::Gantry { positions, intensity, squares, .. } => {
                let elements = squares.checked_mul(*squares).and_then(|of_one| of_one.checked_mul(positions.len()));
                if !elements.is_some_and(|elements| (1..=MOST_ELEMENTS).contains(&elements)) {
                    let found = format!("{} positions of {squares} x {squares} squares", positions.len());
                    return refuse(found, "1 to 1048576 squares in all");
                }
                if intensity.len() != positions.len() || intensity.iter().any(|i| !(i.is_finite() && *i > 0.0)) {
                    return refuse(format!("{} intensities", intensity.len()), "one positive number a position");
                }
                Ok(())
            }
        }
    }
}

/// How `T` is represented.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum Representation {
    /// One coefficient picture per lamp, texel of a screen, or square of a projector.
    Dense {
        /// The entry.
        array: String,
        /// The projection whose elements these are: `lamps`, `texels` or `squares`.
        basis: String,
        /// How numbers are stored.
        precision: Precision,
        /// A power of two: T = stored x scale. Written with all its digits, so that readers in double precision get it
        /// exactly.
        #[serde(serialize_with = "exactly")]
        scale: f32,
    },
    /// One coefficient picture per spherical harmonic, halves, laid out as dense ones.
    Harmonics {
        /// The entry.
        array: String,
        /// How many functions, all those of whole bands: 25, 225.
        functions: usize,
        /// A power of two: coefficient = stored x scale.
        #[serde(serialize_with = "exactly")]
        scale: f32,
        /// What was lost.
        loss: Loss,
    },
    /// Tiles of low rank: `T = A B` in each.
    Factored {
        /// Columns and rows of a tile, in pixels; whole blocks.
        tile: [usize; 2],
        /// Rank of each tile, `[tile row, tile column]`, `<u4`.
        ranks: String,
        /// A of every tile, halves.
        left: String,
        /// B of every tile, `[rank, lamp]`, halves.
        right: String,
        /// A power of two: A = stored x scale.
        #[serde(serialize_with = "exactly")]
        scale: f32,
        /// What was lost.
        loss: Loss,
    },
    /// For each pixel a set of wavelet coefficients of its reflectance function: rebuilt on a grid from samples at lamps, or found
    /// from what a screen or a projector showed.
    Wavelet {
        /// Id of the [`Wavelet`](crate::wavelet::Wavelet), in the constant-energy normalisation: cyclic in longitude and mirrored at both ends of
        /// the other axis; on a screen, and on the picture of each position of a projector, mirrored at all edges. On a screen `texel`
        /// stands for no wavelet: terms are texels.
        wavelet: String,
        /// Locations from the texels' number on are single texels, beside the wavelet's functions.
        #[serde(default, skip_serializing_if = "std::ops::Not::not")]
        with_texels: bool,
        /// Longitudes about the axis of the domain x angles from it, over its coverage; the texels of a screen; the squares of all
        /// positions, one picture below the other.
        grid: [usize; 2],
        /// Id of the [`Method`](crate::reconstruct::Method) that the functions were rebuilt by from samples at lamps.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        reconstruction: Option<String>,
        /// First term of each pixel, and their number.
        offsets: String,
        /// Place of each term.
        locations: String,
        /// `[term, 3]`, halves.
        coefficients: String,
        /// A power of two: coefficient = stored x scale.
        #[serde(serialize_with = "exactly")]
        scale: f32,
        /// The most terms that a pixel was allowed.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        most_terms: Option<usize>,
        /// What was lost, where there were samples to compare with.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        loss: Option<Loss>,
    },
    /// One coefficient picture for each wavelet that a screen showed (6.6), halves, laid out as dense ones: the answer to a column of S.
    Explicit {
        /// The entry.
        array: String,
        /// Id of the [`Wavelet`](crate::wavelet::Wavelet), in the constant-energy normalisation, mirrored at all edges.
        wavelet: String,
        /// Entry with the location of each function, `<u4`.
        locations: String,
        /// How many functions.
        functions: usize,
        /// A power of two: coefficient = stored x scale.
        #[serde(serialize_with = "exactly")]
        scale: f32,
    },
}

/// How far a compact representation is from what it stands for: the samples, or the functions rebuilt from them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Loss {
    /// The relative error that was asked for, if any was.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub asked: Option<f64>,
    /// The relative error reached over the whole field, of what is stored: `||T - T'|| / ||T||`, Frobenius.
    pub reached: f64,
    /// Entry with `e_p`, `[height, width]`, halves: the largest over the channels of the absolute error of the reflectance
    /// function of pixel p, so that a picture is off by at most `e_p ||w||` there.
    pub errors: String,
    /// A power of two: e_p = stored x scale.
    #[serde(serialize_with = "exactly")]
    pub scale: f32,
}

/// The kinds of representations.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// Samples at the lamps.
    Dense,
    /// Tiles of low rank.
    Factored,
    /// Wavelet coefficients of each pixel.
    Wavelet,
    /// Spherical harmonics.
    Harmonics,
    /// Wavelets that a screen showed.
    Explicit,
}

impl Kind {
    /// All, in permanent order.
    pub const ALL: [Kind; 5] = [Kind::Dense, Kind::Factored, Kind::Wavelet, Kind::Harmonics, Kind::Explicit];
    /// Those that a field of lamps can have.
    pub const OF_LAMPS: [Kind; 4] = [Kind::Dense, Kind::Factored, Kind::Wavelet, Kind::Harmonics];
    /// Those that a field of a screen can have.
    pub const OF_SCREENS: [Kind; 4] = [Kind::Dense, Kind::Factored, Kind::Wavelet, Kind::Explicit];
    /// Those that a field of a projector can have.
    pub const OF_GANTRIES: [Kind; 3] = [Kind::Dense, Kind::Factored, Kind::Wavelet];

    /// Permanent id.
    pub const fn id(self) -> &'static str {
        match self {
            Kind::Dense => "dense",
            Kind::Factored => "factored",
            Kind::Wavelet => "wavelet",
            Kind::Harmonics => "harmonics",
            Kind::Explicit => "explicit",
        }
    }
}

impl Representation {
    /// Its kind.
    pub fn kind(&self) -> Kind {
        match self {
            Representation::Dense { .. } => Kind::Dense,
            Representation::Harmonics { .. } => Kind::Harmonics,
            Representation::Factored { .. } => Kind::Factored,
            Representation::Wavelet { .. } => Kind::Wavelet,
            Representation::Explicit { .. } => Kind::Explicit,
        }
    }

    /// What was lost; nothing where what was photographed is stored itself, or there was nothing to compare with.
    pub fn loss(&self) -> Option<&Loss> {
        match self {
            Representation::Dense { .. } | Representation::Explicit { .. } => None,
            Representation::Harmonics { loss, .. } | Representation::Factored { loss, .. } => Some(loss),
            Representation::Wavelet { loss, .. } => loss.as_ref(),
        }
    }

    /// The entries that belong to it.
    pub fn entries(&self) -> Vec<&str> {
        let own: Vec<&String> = match self {
            Representation::Dense { array, .. } | Representation::Harmonics { array, .. } => vec![array],
            Representation::Factored { ranks, left, right, .. } => vec![ranks, left, right],
            Representation::Wavelet { offsets, locations, coefficients, .. } => vec![offsets, locations, coefficients],
            Representation::Explicit { array, locations, .. } => vec![array, locations],
        };
        own.into_iter().chain(self.loss().map(|loss| &loss.errors)).map(String::as_str).collect()
    }

    fn check(&self, place: &str, domain: &Domain) -> Result<()> {
        let refuse = |found: String, expected: &str| Err(Error::invalid(place, found, expected));
        let (elements, kinds) = match domain {
            Domain::Directions { .. } => ("lamps", &Kind::OF_LAMPS[..]),
            Domain::Plane { .. } => ("texels", &Kind::OF_SCREENS[..]),
            Domain::Gantry { .. } => ("squares", &Kind::OF_GANTRIES[..]),
        };
        if !kinds.contains(&self.kind()) {
            let found = format!("the representation `{}` of a field of another rig", self.kind().id());
            return refuse(found, "lamps with harmonics, screens with explicit wavelets");
        }
        if let Some(loss) = self.loss() {
            if !(loss.reached.is_finite() && loss.reached >= 0.0) {
                return refuse(format!("an error of {}", loss.reached), "a finite one, not negative");
            }
            check_scale(loss.scale, place)?;
        }
        match self {
            Representation::Dense { basis, .. } if basis != elements => {
                refuse(format!("basis `{basis}`"), &format!("`{elements}`"))
            }
            Representation::Explicit { functions, .. } if !(1..=MOST_ELEMENTS).contains(functions) => {
                refuse(format!("{functions} functions"), "1 to 1048576")
            }
            Representation::Harmonics { functions, .. } if bands_of(*functions).is_none() => {
                refuse(format!("{functions} spherical harmonics"), "a square number from 4 to 625: whole bands")
            }
            Representation::Dense { scale, .. }
            | Representation::Harmonics { scale, .. }
            | Representation::Factored { scale, .. }
            | Representation::Wavelet { scale, .. }
            | Representation::Explicit { scale, .. } => check_scale(*scale, place),
        }
    }
}

/// Bands of a number of spherical harmonics: 2 to 25, in whole bands.
pub fn bands_of(functions: usize) -> Option<usize> {
    (2..=25).find(|bands| bands * bands == functions)
}

/// Powers of two and their reciprocals only: scaling must not round.
fn check_scale(scale: f32, place: &str) -> Result<()> {
    if scale.is_normal() && scale > 0.0 && scale.to_bits() & 0x007f_ffff == 0 {
        return Ok(());
    }
    Err(Error::invalid(place, format!("scale {scale}"), "a power of two"))
}

/// Version 1 had one representation, no list.
fn one_or_several<'de, D: serde::Deserializer<'de>>(deserializer: D) -> Result<Vec<Representation>, D::Error> {
    use serde::de::Error as _;
    let value = match serde_json::Value::deserialize(deserializer)? {
        several @ serde_json::Value::Array(_) => several,
        one => serde_json::Value::Array(vec![one]),
    };
    serde_json::from_value(value).map_err(D::Error::custom)
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
        if !(OLDEST..=VERSION[0]).contains(&header.version[0]) {
            return Err(Error::Unsupported {
                place,
                what: format!("container version {}.{}", header.version[0], header.version[1]),
                advice: format!("this Relume reads versions {OLDEST} to {}; use a newer one", VERSION[0]),
            });
        }
        let manifest: Self = serde_json::from_slice(bytes).map_err(invalid)?;
        manifest.check(&place)?;
        Ok(manifest)
    }

    fn check(&self, place: &str) -> Result<()> {
        let refuse = |found: String, expected: &str| Err(Error::invalid(place, found, expected));
        if !(1..=LARGEST_SIDE).contains(&self.width) || !(1..=LARGEST_SIDE).contains(&self.height) {
            return refuse(format!("a picture of {} x {}", self.width, self.height), "1 to 131072 pixels a side");
        }
        self.domain.check(place)?;
        let known: Result<ColourSpace> = self.colour_space.parse();
        if let Err(Error::Invalid { found, expected, .. }) = known {
            return refuse(format!("colour space {found}"), &expected);
        }
        if self.representations.is_empty() {
            return refuse("no representation".to_owned(), "at least one");
        }
        for (n, representation) in self.representations.iter().enumerate() {
            let kind = representation.kind();
            if self.representations[..n].iter().any(|other| other.kind() == kind) {
                return refuse(format!("two representations of kind `{}`", kind.id()), "one at most");
            }
            representation.check(place, &self.domain)?;
        }
        Ok(())
    }

    /// What the rig could emit, ready for use.
    ///
    /// # Errors
    /// Vectors that are no directions; a grid of texels that no screen has.
    pub fn emitter(&self) -> Result<domain::Domain> {
        match &self.domain {
            Domain::Directions { axis, coverage, directions, .. } => {
                let directions = directions.iter().map(|d| Vec3::from(*d)).collect();
                Ok(Directions::with_coverage(directions, *axis, *coverage)?.into())
            }
            Domain::Plane { columns, rows, correspondence } => {
                let plane = Plane::new(*columns, *rows)?;
                Ok(domain::Domain::Plane(plane, correspondence.clone()))
            }
            Domain::Gantry { axis, coverage, positions, squares, view_rad, filter, .. } => {
                let poses = positions.iter().map(Pose::from).collect();
                Ok(Gantry::with_coverage(poses, (*axis, *coverage), (*squares, *view_rad, *filter))?.into())
            }
        }
    }

    /// The representation of a kind, if there is one.
    pub fn representation(&self, kind: Kind) -> Option<&Representation> {
        self.representations.iter().find(|representation| representation.kind() == kind)
    }

    /// The colours of transport and layers.
    ///
    /// # Errors
    /// An id that is not known; [`Manifest::parse`] has refused it already.
    pub fn colours(&self) -> Result<ColourSpace> {
        self.colour_space.parse()
    }

    /// E_j of each lamp; none of a screen or a projector.
    pub fn irradiance(&self) -> &[f32] {
        match &self.domain {
            Domain::Directions { irradiance, .. } => irradiance,
            Domain::Plane { .. } | Domain::Gantry { .. } => &[],
        }
    }

    /// I_p of each position of a projector; none of other rigs.
    pub fn intensity(&self) -> &[f32] {
        match &self.domain {
            Domain::Gantry { intensity, .. } => intensity,
            Domain::Directions { .. } | Domain::Plane { .. } => &[],
        }
    }
}
