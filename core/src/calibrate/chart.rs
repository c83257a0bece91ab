//! A colour matrix from a photograph of a ColorChecker Classic (24 patches).
//!
//! The published colours are X-Rite's CIE L*a*b* for D50 and the 2-degree observer ("New color specifications for ColorChecker
//! SG and Classic charts", charts made after November 2014). They are brought to linear Rec.709 with Bradford's adaptation to D65,
//! and the matrix is `argmin_M sum_i |M p_i - r_i|^2` over the patches.

use nalgebra::{Matrix3, SMatrix, SVector, Vector3};

use super::white::{Correction, DARK, mean_of};
use crate::error::{Error, Result};
use crate::image::Image;

/// Columns and rows of patches.
const GRID: (usize, usize) = (6, 4);

/// Names and L*a*b* (D50), row by row from dark skin.
const PATCHES: [(&str, [f64; 3]); 24] = [
    ("dark skin", [37.54, 14.37, 14.92]),
    ("light skin", [64.66, 19.27, 17.50]),
    ("blue sky", [49.32, -3.82, -22.54]),
    ("foliage", [43.46, -12.74, 22.72]),
    ("blue flower", [54.94, 9.61, -24.79]),
    ("bluish green", [70.48, -32.26, -0.37]),
    ("orange", [62.73, 35.83, 56.50]),
    ("purplish blue", [39.43, 10.75, -45.17]),
    ("moderate red", [50.57, 48.64, 16.67]),
    ("purple", [30.10, 22.54, -20.87]),
    ("yellow green", [71.77, -24.13, 58.19]),
    ("orange yellow", [71.51, 18.24, 67.37]),
    ("blue", [28.37, 15.42, -49.80]),
    ("green", [54.38, -39.72, 32.27]),
    ("red", [42.43, 51.05, 28.62]),
    ("yellow", [81.80, 2.67, 80.41]),
    ("magenta", [50.63, 51.28, -14.12]),
    ("cyan", [49.57, -29.71, -28.32]),
    ("white", [95.19, -1.03, 2.93]),
    ("neutral 8", [81.29, -0.57, 0.44]),
    ("neutral 6.5", [66.89, -0.75, -0.06]),
    ("neutral 5", [50.76, -0.13, 0.14]),
    ("neutral 3.5", [35.63, -0.46, -0.48]),
    ("black", [20.64, 0.07, -0.46]),
];
/// The grey patches but the lightest, which clips first, and the darkest, which flare lifts.
const GREYS: std::ops::Range<usize> = 19..23;
/// XYZ of D50, CIE 15 (2-degree observer).
const D50: [f64; 3] = [0.96422, 1.0, 0.82521];
/// Bradford's adaptation from D50 to D65 (Lindbloom).
const D50_TO_D65: Matrix3<f64> =
    Matrix3::new(0.9555766, -0.0230393, 0.0631636, -0.0282895, 1.0099416, 0.0210077, 0.0122982, -0.0204830, 1.3299098);
/// XYZ under D65 to linear Rec.709 (IEC 61966-2-1, more digits from Lindbloom).
const XYZ_TO_REC709: Matrix3<f64> =
    Matrix3::new(3.2404542, -1.5371385, -0.4985314, -0.9692660, 1.8760108, 0.0415560, 0.0556434, -0.2040259, 1.0572252);
/// Samples across a patch, and how far from its middle they go in spacings of the patches: patches fill about 0.8 of them.
const ACROSS: usize = 11;
const REACH: f64 = 0.22;

/// A point of a picture in pixels; (0, 0) is the top left corner.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point {
    /// To the right.
    pub x: f64,
    /// Down.
    pub y: f64,
}

/// What a chart says of a camera and its light.
#[derive(Debug, Clone, PartialEq)]
pub struct ChartFit {
    /// Photograph -> linear Rec.709 of a neutral light; greys keep the level that green has in the photograph.
    pub correction: Correction,
    /// Times this, the corrected numbers are reflectances.
    pub exposure: f64,
    /// CIE 1976 colour difference that is left, patch by patch, in L*a*b* units: 2 is just seen, 10 is plainly wrong.
    pub differences: [f64; 24],
}

impl ChartFit {
    /// The mean difference.
    pub fn mean_difference(&self) -> f64 {
        self.differences.iter().sum::<f64>() / 24.0
    }

    /// The patch that fits worst, and its difference.
    pub fn worst(&self) -> (&'static str, f64) {
        let worst = (0..24).max_by(|a, b| self.differences[*a].total_cmp(&self.differences[*b])).unwrap_or_default();
        (PATCHES[worst].0, self.differences[worst])
    }
}

/// Fits a matrix to a linear photograph of a chart. `corners` are the middles of the corner patches, clockwise from dark
/// skin: dark skin, bluish green, black, white. `place` names the photograph.
///
/// # Errors
/// Corners that span no chart; a patch (named) outside the picture, clipped, or black; patches of one colour.
pub fn fit(photograph: &Image, corners: [Point; 4], place: &str) -> Result<ChartFit> {
    let map = homography(corners).filter(|_| is_convex(&corners)).ok_or_else(|| {
        let found = format!("corners at {}", corners.map(|p| format!("{},{}", p.x, p.y)).join(" "));
        Error::invalid(
            place,
            found,
            "the middles of dark skin, bluish green, black and white, in this order around the chart",
        )
    })?;
    let mut seen = [Vector3::zeros(); 24];
    for (n, seen) in seen.iter_mut().enumerate() {
        *seen = measure(photograph, &map, n).map_err(|found| {
            Error::invalid(
                format!("{place}, patch `{}`", PATCHES[n].0),
                found,
                "a patch inside the picture, neither clipped nor black",
            )
        })?;
    }
    let wanted = PATCHES.map(|(_, lab)| rec709(lab));
    let a: Matrix3<f64> = seen.iter().map(|p| p * p.transpose()).sum();
    let b: Matrix3<f64> = seen.iter().zip(&wanted).map(|(p, r)| r * p.transpose()).sum();
    let inverse = a
        .try_inverse()
        .filter(|_| a.determinant() > 1e-9 * a.trace().powi(3))
        .ok_or_else(|| Error::invalid(place, "patches of one colour", "a colour chart within the corners"))?;
    let matrix = b * inverse;
    let level = |pick: &dyn Fn(usize) -> f64| GREYS.map(pick).sum::<f64>();
    let exposure = level(&|n| (matrix * seen[n]).y) / level(&|n| seen[n].y);
    let scaled = matrix / exposure;
    let correction = Correction::matrix(std::array::from_fn(|i| std::array::from_fn(|j| scaled[(i, j)])))?;
    let differences = std::array::from_fn(|n| (lab(&(matrix * seen[n])) - Vector3::from(PATCHES[n].1)).norm());
    Ok(ChartFit { correction, exposure, differences })
}

/// The published reflectances in linear Rec.709, row by row from dark skin; some lie a little outside 0 to 1, the gamut.
pub fn reflectances() -> [[f32; 3]; 24] {
    PATCHES.map(|(_, lab)| {
        let colour = rec709(lab);
        std::array::from_fn(|c| colour[c] as f32)
    })
}

/// Linear Rec.709 of a published colour.
fn rec709([l, a, b]: [f64; 3]) -> Vector3<f64> {
    let fy = (l + 16.0) / 116.0;
    let f = [fy + a / 500.0, fy, fy - b / 200.0];
    // The inverse of the CIE's cube root with its linear foot.
    let back = |t: f64| if t > 6.0 / 29.0 { t.powi(3) } else { 3.0 * (6.0f64 / 29.0).powi(2) * (t - 4.0 / 29.0) };
    XYZ_TO_REC709 * D50_TO_D65 * Vector3::from_fn(|i, _| back(f[i]) * D50[i])
}

/// L*a*b* (D50) of a linear Rec.709 colour.
fn lab(rgb: &Vector3<f64>) -> Vector3<f64> {
    let to_xyz = (XYZ_TO_REC709 * D50_TO_D65).try_inverse().unwrap_or_default();
    let xyz = to_xyz * rgb;
    let f = |i: usize| {
        let t = xyz[i] / D50[i];
        let knee = 6.0f64 / 29.0;
        if t > knee.powi(3) { t.cbrt() } else { t / (3.0 * knee * knee) + 4.0 / 29.0 }
    };
    let (fx, fy, fz) = (f(0), f(1), f(2));
    Vector3::new(116.0 * fy - 16.0, 500.0 * (fx - fy), 200.0 * (fy - fz))
}

/// From (column, row) of the patches to pixels: the projective map that takes the corner patches to the corners.
fn homography(corners: [Point; 4]) -> Option<Matrix3<f64>> {
    let (right, down) = ((GRID.0 - 1) as f64, (GRID.1 - 1) as f64);
    let grid = [(0.0, 0.0), (right, 0.0), (right, down), (0.0, down)];
    let mut a = SMatrix::<f64, 8, 8>::zeros();
    let mut b = SVector::<f64, 8>::zeros();
    for (n, ((u, v), Point { x, y })) in grid.into_iter().zip(corners).enumerate() {
        a.row_mut(2 * n).copy_from_slice(&[u, v, 1.0, 0.0, 0.0, 0.0, -u * x, -v * x]);
        a.row_mut(2 * n + 1).copy_from_slice(&[0.0, 0.0, 0.0, u, v, 1.0, -u * y, -v * y]);
        (b[2 * n], b[2 * n + 1]) = (x, y);
    }
    let h = a.lu().solve(&b)?;
    h.iter().all(|v| v.is_finite()).then(|| Matrix3::new(h[0], h[1], h[2], h[3], h[4], h[5], h[6], h[7], 1.0))
}

/// Four corners in order around a convex figure, whichever way round: a mirrored chart is a mirrored photograph.
fn is_convex(corners: &[Point; 4]) -> bool {
    let turn = |n: usize| {
        let [a, b, c] = [0, 1, 2].map(|k| corners[(n + k) % 4]);
        (b.x - a.x) * (c.y - b.y) - (b.y - a.y) * (c.x - b.x)
    };
    let turns: Vec<f64> = (0..4).map(turn).collect();
    turns.iter().all(|t| *t > 1.0) || turns.iter().all(|t| *t < -1.0)
}

/// The mean colour of a patch, or what is wrong with it.
fn measure(photograph: &Image, map: &Matrix3<f64>, patch: usize) -> std::result::Result<Vector3<f64>, String> {
    let (column, row) = ((patch % GRID.0) as f64, (patch / GRID.0) as f64);
    let mut samples = Vec::with_capacity(ACROSS * ACROSS);
    for k in 0..ACROSS * ACROSS {
        let offset = |i: usize| (2.0 * i as f64 / (ACROSS - 1) as f64 - 1.0) * REACH;
        let p = map * Vector3::new(column + offset(k % ACROSS), row + offset(k / ACROSS), 1.0);
        let (x, y) = (p.x / p.z, p.y / p.z);
        let inside = x >= 0.0 && y >= 0.0 && x < photograph.width() as f64 && y < photograph.height() as f64;
        if !inside {
            return Err(format!(
                "pixel {x:.0},{y:.0} of a picture of {} x {}",
                photograph.width(),
                photograph.height()
            ));
        }
        let pixel = photograph.pixel(x as usize, y as usize);
        samples.push([pixel[0], pixel[1], pixel[2]]);
    }
    let mean = mean_of(photograph, &samples).ok_or("a patch that is clipped")?;
    // Strong colours may be dark in one channel, but not in all.
    if mean.iter().any(|v| *v >= DARK) { Ok(Vector3::from(mean)) } else { Err("a patch that is black".to_owned()) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::srgb;

    /// X-Rite's own 8-bit sRGB values for the chart, published with the L*a*b* of older charts, and rounded into the gamut: yellow
    /// and blue are 16 codes off, the others fewer. Patches in another order would be off by much more.
    const SRGB: [[u8; 3]; 24] = [
        [115, 82, 68],
        [194, 150, 130],
        [98, 122, 157],
        [87, 108, 67],
        [133, 128, 177],
        [103, 189, 170],
        [214, 126, 44],
        [80, 91, 166],
        [193, 90, 99],
        [94, 60, 108],
        [157, 188, 64],
        [224, 163, 46],
        [56, 61, 150],
        [70, 148, 73],
        [175, 54, 60],
        [231, 199, 31],
        [187, 86, 149],
        [8, 133, 161],
        [243, 243, 242],
        [200, 200, 200],
        [160, 160, 160],
        [122, 122, 121],
        [85, 85, 85],
        [52, 52, 52],
    ];

    #[test]
    fn published_lab_and_published_srgb_agree() {
        let mut sum = 0.0;
        for ((name, lab), codes) in PATCHES.iter().zip(SRGB) {
            let found = rec709(*lab).map(|v| 255.0 * f64::from(srgb::encode(v.clamp(0.0, 1.0) as f32)));
            for (a, b) in found.iter().zip(codes) {
                let off = (a - f64::from(b)).abs();
                assert!(off < 17.0, "{name}: {found} is not {codes:?}");
                sum += off / 72.0;
            }
        }
        assert!(sum < 5.0, "{sum} codes on average");
    }

    #[test]
    fn lab_inverts() {
        for (name, published) in PATCHES {
            assert!((lab(&rec709(published)) - Vector3::from(published)).norm() < 1e-9, "{name}");
        }
    }

    /// A chart seen in perspective by a camera that mixes channels under a warm light.
    fn photographed(camera: &Matrix3<f64>, corners: [Point; 4]) -> Image {
        let to_grid = homography(corners).unwrap().try_inverse().unwrap();
        Image::from_fn(160, 120, |x, y| {
            let p = to_grid * Vector3::new(x as f64 + 0.5, y as f64 + 0.5, 1.0);
            let (u, v) = (p.x / p.z, p.y / p.z);
            let (column, row) = (u.round(), v.round());
            let on_patch = (0.0..6.0).contains(&column)
                && (0.0..4.0).contains(&row)
                && (u - column).abs().max((v - row).abs()) < 0.4;
            let colour =
                if on_patch { rec709(PATCHES[(row * 6.0 + column) as usize].1) } else { Vector3::repeat(0.03) };
            (camera * colour).map(|v| v.max(0.0) as f32).into()
        })
    }

    const CORNERS: [Point; 4] = [
        Point { x: 20.0, y: 22.0 },
        Point { x: 140.0, y: 14.0 },
        Point { x: 132.0, y: 104.0 },
        Point { x: 28.0, y: 92.0 },
    ];

    #[test]
    fn a_camera_that_mixes_channels_is_undone() {
        // 0.3 leaves the red of the lightest patch below 1.
        let camera = Matrix3::new(0.9, 0.15, 0.05, 0.1, 0.8, 0.1, 0.02, 0.2, 0.5) * 0.7;
        let fit = fit(&photographed(&camera, CORNERS), CORNERS, "chart.exr").unwrap();
        assert!(fit.mean_difference() < 0.5, "{:?}", fit.differences);
        let product = Matrix3::from_fn(|i, j| fit.correction.rows()[i][j]) * camera * fit.exposure;
        assert!((product - Matrix3::identity()).norm() < 0.02, "{product}");
        // Greys keep the level of green.
        let grey = camera * Vector3::repeat(0.4);
        let found = fit.correction.colour(grey.into());
        assert!(found.iter().all(|v| (v - grey.y).abs() < 0.02 * grey.y), "{found:?} is not {}", grey.y);
    }

    #[test]
    fn mistakes_are_named() {
        let picture = photographed(&Matrix3::identity(), CORNERS);
        let message =
            |corners: [Point; 4], picture: &Image| fit(picture, corners, "chart.png").unwrap_err().to_string();
        let mut outside = CORNERS;
        outside[1].x = 200.0;
        assert!(message(outside, &picture).contains("a patch inside the picture"), "{}", message(outside, &picture));
        let crossed = [CORNERS[0], CORNERS[2], CORNERS[1], CORNERS[3]];
        assert!(message(crossed, &picture).contains("in this order"));
        assert!(message([CORNERS[0]; 4], &picture).contains("in this order"));
        let bright = photographed(&(Matrix3::identity() * 5.0).map(|v| v), CORNERS);
        let clipped = Image::from_fn(160, 120, |x, y| {
            let p = bright.pixel(x, y);
            [p[0].min(1.0), p[1].min(1.0), p[2].min(1.0)]
        });
        assert!(message(CORNERS, &clipped).contains("clipped"));
        let grey = Image::from_fn(160, 120, |_, _| [0.5; 3]);
        assert!(message(CORNERS, &grey).contains("one colour"));
        // Turned by half a turn the fit is poor, and says so.
        let turned = [CORNERS[2], CORNERS[3], CORNERS[0], CORNERS[1]];
        assert!(fit(&picture, turned, "chart.png").unwrap().mean_difference() > 15.0);
    }
}
