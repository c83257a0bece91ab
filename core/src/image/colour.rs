//! Colour spaces by name, and the 3 x 3 matrices between them.
//!
//! All are linear and scene-referred; they differ in primaries and white. The matrix from RGB to CIE XYZ follows from the
//! chromaticities alone (SMPTE RP 177-1993); between two whites colours are adapted by Bradford's matrix (Lam 1985, as in
//! ICC.1:2022 annex E), so that white, (1, 1, 1), is white in every space. Computed in double precision.

use std::fmt;
use std::str::FromStr;

use nalgebra::{Matrix3, Vector3};

use super::Image;
use crate::error::{Error, Result};

/// A linear RGB space. Ids are permanent: containers and projects store them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum ColourSpace {
    /// `lin_rec709`: primaries of ITU-R BT.709 (and sRGB), white D65.
    #[default]
    LinRec709,
    /// `lin_rec2020`: primaries of ITU-R BT.2020, white D65.
    LinRec2020,
    /// `acescg`: AP1 of the Academy (S-2014-004), the ACES white of about 6000 K.
    AcesCg,
    /// `aces2065_1`: AP0 of the Academy (SMPTE ST 2065-1), the ACES white.
    Aces2065_1,
    /// `lin_p3d65`: primaries of SMPTE RP 431-2 (DCI-P3), white D65 (SMPTE EG 432-1).
    LinP3D65,
}

/// CIE 1931 xy of what makes a space.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Primaries {
    /// x, y of red.
    pub red: [f64; 2],
    /// x, y of green.
    pub green: [f64; 2],
    /// x, y of blue.
    pub blue: [f64; 2],
    /// x, y of white.
    pub white: [f64; 2],
}

/// CIE D65 as the video standards round it.
const D65: [f64; 2] = [0.3127, 0.3290];
/// The white of ACES (S-2014-004 and ST 2065-1).
const ACES_WHITE: [f64; 2] = [0.32168, 0.33767];
/// From XYZ to the sharpened cone responses in which Bradford's adaptation scales (ICC.1:2022, annex E).
const BRADFORD: [[f64; 3]; 3] = [[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]];

impl ColourSpace {
    /// All, in permanent order.
    pub const ALL: [Self; 5] = [Self::LinRec709, Self::LinRec2020, Self::AcesCg, Self::Aces2065_1, Self::LinP3D65];

    /// The permanent id.
    pub const fn id(self) -> &'static str {
        match self {
            Self::LinRec709 => "lin_rec709",
            Self::LinRec2020 => "lin_rec2020",
            Self::AcesCg => "acescg",
            Self::Aces2065_1 => "aces2065_1",
            Self::LinP3D65 => "lin_p3d65",
        }
    }

    /// What hosts show.
    pub const fn label(self) -> &'static str {
        match self {
            Self::LinRec709 => "Linear Rec.709",
            Self::LinRec2020 => "Linear Rec.2020",
            Self::AcesCg => "ACEScg",
            Self::Aces2065_1 => "ACES2065-1",
            Self::LinP3D65 => "Linear P3-D65",
        }
    }

    /// Chromaticities, as the standard of each space gives them.
    pub const fn primaries(self) -> Primaries {
        let (red, green, blue, white) = match self {
            Self::LinRec709 => ([0.640, 0.330], [0.300, 0.600], [0.150, 0.060], D65),
            Self::LinRec2020 => ([0.708, 0.292], [0.170, 0.797], [0.131, 0.046], D65),
            Self::AcesCg => ([0.713, 0.293], [0.165, 0.830], [0.128, 0.044], ACES_WHITE),
            Self::Aces2065_1 => ([0.7347, 0.2653], [0.0, 1.0], [0.0001, -0.0770], ACES_WHITE),
            Self::LinP3D65 => ([0.680, 0.320], [0.265, 0.690], [0.150, 0.060], D65),
        };
        Primaries { red, green, blue, white }
    }

    /// RGB of this space to CIE XYZ, white at Y = 1. RP 177: the columns are the primaries, scaled so that their sum is the
    /// white.
    fn to_xyz(self) -> Matrix3<f64> {
        let Primaries { red, green, blue, white } = self.primaries();
        let columns = Matrix3::from_columns(&[xyz(red), xyz(green), xyz(blue)]);
        // The primaries of a space span XYZ.
        let amounts = inverse(&columns) * xyz(white);
        columns * Matrix3::from_diagonal(&amounts)
    }

    /// The matrix that carries RGB of this space to RGB of another: `to = M from`, columns of numbers.
    pub fn matrix_to(self, to: Self) -> Matrix3<f64> {
        if self == to {
            return Matrix3::identity();
        }
        inverse(&to.to_xyz()) * adaptation(self.primaries().white, to.primaries().white) * self.to_xyz()
    }
}

/// XYZ of a chromaticity at Y = 1; for blue of AP0, whose y is negative, up to a scale that cancels.
fn xyz([x, y]: [f64; 2]) -> Vector3<f64> {
    Vector3::new(x / y, 1.0, (1.0 - x - y) / y)
}

/// Bradford's adaptation from one white to another: scaling in cone responses.
fn adaptation(from: [f64; 2], to: [f64; 2]) -> Matrix3<f64> {
    if from == to {
        return Matrix3::identity();
    }
    let cones = Matrix3::from_fn(|row, column| BRADFORD[row][column]);
    let gains = (cones * xyz(to)).component_div(&(cones * xyz(from)));
    inverse(&cones) * Matrix3::from_diagonal(&gains) * cones
}

/// The inverse of a matrix of this file, none of which is singular.
fn inverse(matrix: &Matrix3<f64>) -> Matrix3<f64> {
    matrix.try_inverse().unwrap_or_else(Matrix3::zeros)
}

impl fmt::Display for ColourSpace {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.id())
    }
}

impl FromStr for ColourSpace {
    type Err = Error;

    /// From an id; an unknown one is refused with all known ones, and the nearest if it looks like a slip.
    fn from_str(id: &str) -> Result<Self> {
        /// Below this (of 1) names have little in common; strsim's documentation gives 0.8 and more for slips of one or two letters.
        const ALIKE: f64 = 0.8;
        if let Some(space) = Self::ALL.into_iter().find(|space| space.id() == id) {
            return Ok(space);
        }
        let likeness = |space: &Self| strsim::jaro_winkler(&id.to_lowercase().replace('-', "_"), space.id());
        let nearest = Self::ALL.into_iter().max_by(|a, b| likeness(a).total_cmp(&likeness(b)));
        let hint = nearest.filter(|space| likeness(space) > ALIKE).map(|s| format!(" (`{s}` is near)"));
        let known = Self::ALL.map(Self::id).join(", ");
        Err(Error::invalid("colour space", format!("`{id}`"), format!("one of {known}{}", hint.unwrap_or_default())))
    }
}

/// A change from one space to another, made once and applied to many colours.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Conversion {
    /// `None` where nothing changes, so that nothing is rounded.
    matrix: Option<Matrix3<f64>>,
}

impl Conversion {
    /// From one space to another.
    pub fn between(from: ColourSpace, to: ColourSpace) -> Self {
        Self { matrix: (from != to).then(|| from.matrix_to(to)) }
    }

    /// Are both spaces the same?
    pub fn is_identity(&self) -> bool {
        self.matrix.is_none()
    }

    /// One colour. What a smaller space cannot hold becomes negative and stays so.
    pub fn apply(&self, rgb: [f32; 3]) -> [f32; 3] {
        let Some(m) = &self.matrix else { return rgb };
        let v = m * Vector3::from(rgb.map(f64::from));
        [v.x as f32, v.y as f32, v.z as f32]
    }
}

impl Image {
    /// Carries every pixel from one space to another; premultiplied colour stays so, and alpha as it is.
    pub fn convert(&mut self, conversion: &Conversion) {
        if conversion.is_identity() {
            return;
        }
        let channels = self.channels();
        for pixel in self.data_mut().chunks_exact_mut(channels) {
            let rgb = conversion.apply([pixel[0], pixel[1], pixel[2]]);
            pixel[..3].copy_from_slice(&rgb);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::ColourSpace::*;
    use super::*;

    fn assert_close(found: &Matrix3<f64>, expected: [[f64; 3]; 3], tolerance: f64, what: &str) {
        let worst = (found - Matrix3::from_fn(|r, c| expected[r][c])).amax();
        assert!(worst < tolerance, "{what}: {found} is off by {worst}");
    }

    #[test]
    fn published_matrices() {
        // ITU-R BT.2087-0, annex 1, M2.
        let bt2087 = [[0.6274, 0.3293, 0.0433], [0.0691, 0.9195, 0.0114], [0.0164, 0.0880, 0.8956]];
        assert_close(&LinRec709.matrix_to(LinRec2020), bt2087, 1e-4, "BT.2087");
        // Academy S-2014-004 (TRA_1): AP0 to AP1.
        let ap0_to_ap1 = [
            [1.4514393161, -0.2365107469, -0.2149285693],
            [-0.0765537734, 1.1762296998, -0.0996759264],
            [0.0083161484, -0.0060324498, 0.9977163014],
        ];
        assert_close(&Aces2065_1.matrix_to(AcesCg), ap0_to_ap1, 1e-9, "AP0 to AP1");
        // IEC 61966-2-1: linear sRGB to XYZ.
        let srgb = [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]];
        assert_close(&LinRec709.to_xyz(), srgb, 1e-4, "sRGB");
    }

    /// From colour-science 0.4 (`matrix_RGB_to_RGB`, derived matrices, Bradford).
    #[test]
    fn another_library_finds_the_same() {
        for (from, to, expected) in [
            (
                LinRec709,
                AcesCg,
                [
                    [0.6130974024011873, 0.33952314618410573, 0.0473794514147067],
                    [0.07019372246958172, 0.9163538790573439, 0.01345239847307408],
                    [0.02061559288222692, 0.10956977293813543, 0.8698146341796373],
                ],
            ),
            (
                AcesCg,
                LinRec709,
                [
                    [1.7050509926579844, -0.6217921206570046, -0.0832588720009786],
                    [-0.1302564175070437, 1.1408047365754013, -0.010548319068358044],
                    [-0.024003356804618025, -0.12896897606497057, 1.152972332869589],
                ],
            ),
            (
                LinRec709,
                LinP3D65,
                [
                    [0.8224619687143623, 0.17753803128563775, 0.0],
                    [0.033194198850961615, 0.9668058011490379, 0.0],
                    [0.01708263072112004, 0.07239744066396342, 0.9105199286149166],
                ],
            ),
            (
                LinP3D65,
                Aces2065_1,
                [
                    [0.5189334875979805, 0.2862565863866899, 0.19480992601532918],
                    [0.0738593830470599, 0.8198451639369855, 0.10629545301595439],
                    [-0.00030701136844663924, 0.043807050253622346, 0.9564999611148243],
                ],
            ),
            (
                LinRec2020,
                AcesCg,
                [
                    [0.9748949779244186, 0.019599108637005196, 0.005505913438576243],
                    [0.0021795627977038677, 0.9955354688932208, 0.0022849683090751284],
                    [0.004797239683772724, 0.024532016634589468, 0.9706707436816376],
                ],
            ),
        ] {
            assert_close(&from.matrix_to(to), expected, 1e-8, &format!("{from} to {to}"));
        }
    }

    #[test]
    fn white_is_white_and_every_way_leads_back() {
        for (a, b) in ColourSpace::ALL.into_iter().flat_map(|a| ColourSpace::ALL.map(|b| (a, b))) {
            let white = a.matrix_to(b) * Vector3::repeat(1.0);
            assert!((white - Vector3::repeat(1.0)).amax() < 1e-12, "{a} to {b}: {white}");
            let back = b.matrix_to(a) * a.matrix_to(b);
            assert!((back - Matrix3::identity()).amax() < 1e-12, "{a} to {b} and back");
            for c in ColourSpace::ALL {
                let around = b.matrix_to(c) * a.matrix_to(b);
                // By way of another white: Bradford's gains multiply.
                assert!((around - a.matrix_to(c)).amax() < 1e-12, "{a} to {b} to {c}");
            }
        }
    }

    #[test]
    fn pictures_are_converted_in_place_and_alpha_stays() {
        let mut image = Image::from_data(1, 1, 4, vec![0.25, 0.5, -1.0, 0.5]).unwrap();
        image.convert(&Conversion::between(LinRec709, AcesCg));
        let m = LinRec709.matrix_to(AcesCg);
        let expected = m * Vector3::new(0.25, 0.5, -1.0);
        assert!((0..3).all(|c| (f64::from(image.data()[c]) - expected[c]).abs() < 1e-7));
        assert_eq!(image.data()[3], 0.5);
        let untouched = Conversion::between(AcesCg, AcesCg);
        assert!(untouched.is_identity());
        assert_eq!(untouched.apply([0.1, 0.2, 0.3]), [0.1, 0.2, 0.3]);
    }

    #[test]
    fn ids_are_read_and_slips_are_told() {
        assert!(ColourSpace::ALL.into_iter().all(|space| space.id().parse::<ColourSpace>().unwrap() == space));
        for (slip, near) in [("acescgg", "`acescg`"), ("lin-rec2020", "`lin_rec2020`"), ("ACES2065-1", "`aces2065_1`")]
        {
            let message = slip.parse::<ColourSpace>().unwrap_err().to_string();
            assert!(message.contains(slip) && message.contains(&format!("({near} is near)")), "{message}");
        }
        let message = "xyz".parse::<ColourSpace>().unwrap_err().to_string();
        assert!(message.contains("lin_rec709, lin_rec2020, acescg") && !message.contains("near"), "{message}");
    }
}
