//! Camera raw files (DNG, CR2, NEF, ARW...), unpacked by the `rawler` crate.
//!
//! What comes out are the camera's own colours, black at 0 and clipping at 1, before white balance: only there does a
//! clipped sample show as one. White balance and matrix are applied to the merged picture.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

use nalgebra::Matrix3;
use rawler::imgop::Rect;
use rawler::imgop::xyz::Illuminant;
use rawler::rawimage::{RawImage, RawPhotometricInterpretation};
use rayon::prelude::*;

use super::bracket::{Photograph, ToRec709};
use crate::error::{Error, Result};
use crate::image::{Image, SampleType};

/// Linear Rec. 709 to CIE XYZ (ITU-R BT.709 primaries, D65).
const XYZ_OF_REC709: [[f64; 3]; 3] =
    [[0.412_391, 0.357_584, 0.180_481], [0.212_639, 0.715_169, 0.072_192], [0.019_331, 0.119_195, 0.950_532]];

/// Reads a raw file: a Bayer mosaic or linear RGB.
///
/// # Errors
/// [`Error::Invalid`] for damaged files, [`Error::Unsupported`] for mosaics of other colours than R, G and B.
pub(super) fn read(path: &Path) -> Result<Photograph> {
    std::fs::metadata(path).map_err(|source| Error::io("read", path, source))?;
    let place = path.display().to_string();
    let damaged = |found: String| Error::invalid(&place, found, "a whole camera raw file");
    // The decoder asserts on some damaged files.
    let decoded = catch_unwind(AssertUnwindSafe(|| rawler::decode_file(path)));
    let raw = decoded.map_err(|_| damaged("data that the decoder gave up on".to_owned()))?;
    let raw = raw.map_err(|error| damaged(error.to_string()))?;
    if raw.data.as_f32().len() != raw.width * raw.height * raw.cpp || raw.data.as_f32().is_empty() {
        return Err(damaged(format!("{} samples of {} x {} pixels", raw.data.as_f32().len(), raw.width, raw.height)));
    }
    let codes = match (&raw.photometric, raw.cpp) {
        (RawPhotometricInterpretation::Cfa(config), 1) if config.cfa.is_rgb() && config.cfa.is_valid() => {
            demosaiced(&normalised(&raw), raw.width, picture_area(&raw), |row, column| {
                config.cfa.color_at(row, column)
            })?
        }
        (RawPhotometricInterpretation::LinearRaw, 3) => linear_rgb(&raw)?,
        _ => {
            return Err(Error::Unsupported {
                place,
                what: format!("a raw file of {} {} with this layout of colours", raw.make, raw.model),
                advice: "develop it to a linear 16-bit TIFF".to_owned(),
            });
        }
    };
    Ok(Photograph { codes, sample_type: SampleType::Float, to_rec709: Some(to_rec709(&raw)) })
}

/// What of the sensor is picture.
fn picture_area(raw: &RawImage) -> Rect {
    let whole = Rect::new(rawler::imgop::Point::zero(), rawler::imgop::Dim2::new(raw.width, raw.height));
    let inside = |r: &Rect| !r.is_empty() && r.x() + r.width() <= raw.width && r.y() + r.height() <= raw.height;
    raw.crop_area.or(raw.active_area).filter(inside).unwrap_or(whole)
}

/// All samples with black at 0 and white at 1, cut off at 1; what lies below black stays below 0.
fn normalised(raw: &RawImage) -> Vec<f32> {
    let black = &raw.blacklevel;
    let (levels, white) = (black.as_vec(), raw.whitelevel.as_vec());
    let (bw, bh) = (black.width.max(1), black.height.max(1));
    let samples = raw.data.as_f32();
    let row = |(y, row): (usize, &[f32])| -> Vec<f32> {
        let level = |i: usize| {
            let (x, plane) = (i / raw.cpp, i % raw.cpp);
            let at = ((y % bh) * bw + x % bw) * black.cpp + plane.min(black.cpp.saturating_sub(1));
            let low = levels.get(at).or(levels.first()).copied().unwrap_or(0.0);
            // White by plane; of a mosaic one number, or all the same.
            let high = white.get(plane).copied().unwrap_or(65_535.0);
            (low, high.max(low + 1.0))
        };
        row.iter()
            .enumerate()
            .map(|(i, v)| {
                let (low, high) = level(i);
                ((v - low) / (high - low)).min(1.0)
            })
            .collect()
    };
    samples.par_chunks_exact(raw.width * raw.cpp).enumerate().map(row).flatten_iter().collect()
}

/// A full picture from a mosaic: each missing colour is the mean of its samples among the eight neighbours (bilinear for a
/// Bayer mosaic). A pixel that draws on a clipped sample is clipped itself, so that a merge drops it. `colour` of a row and
/// column is 0 red, 1 green, 2 blue.
fn demosaiced(
    samples: &[f32],
    width: usize,
    area: Rect,
    colour: impl Fn(usize, usize) -> usize + Sync,
) -> Result<Image> {
    let (w, h, height) = (area.width(), area.height(), samples.len() / width);
    let pixel_at = |x: usize, y: usize| {
        let own = colour(y, x);
        let (mut sum, mut count, mut clipped) = ([0.0f32; 3], [0.0f32; 3], [false; 3]);
        for ny in y.saturating_sub(1)..(y + 2).min(height) {
            for nx in x.saturating_sub(1)..(x + 2).min(width) {
                let c = colour(ny, nx).min(2);
                if c == own && (nx, ny) != (x, y) {
                    continue;
                }
                let v = samples[ny * width + nx];
                sum[c] += v;
                count[c] += 1.0;
                clipped[c] |= v >= 1.0;
            }
        }
        [0, 1, 2].map(|c| if clipped[c] { 1.0 } else { sum[c] / count[c].max(1.0) })
    };
    let mut data = vec![0.0f32; w * h * 3];
    data.par_chunks_exact_mut(w * 3).enumerate().for_each(|(row, out)| {
        for (column, pixel) in out.chunks_exact_mut(3).enumerate() {
            pixel.copy_from_slice(&pixel_at(area.x() + column, area.y() + row));
        }
    });
    Image::from_data(w, h, 3, data)
}

fn linear_rgb(raw: &RawImage) -> Result<Image> {
    let samples = normalised(raw);
    let area = picture_area(raw);
    let row = |y: usize| {
        let from = ((area.y() + y) * raw.width + area.x()) * 3;
        samples[from..from + area.width() * 3].iter().copied()
    };
    Image::from_data(area.width(), area.height(), 3, (0..area.height()).flat_map(row).collect())
}

/// White balance as shot, then the inverse of the camera's matrix, normalised so that what the balance makes neutral is white
/// (DNG specification 1.6, chapter 6; the way of dcraw). Where the file has no matrix only the balance.
fn to_rec709(raw: &RawImage) -> ToRec709 {
    let wb = raw.wb_coeffs;
    let known = wb[..3].iter().all(|v| v.is_finite() && *v > 0.0);
    let balance = if known { [0, 1, 2].map(|c| f64::from(wb[c] / wb[1])) } else { [1.0; 3] };
    let from_camera = raw
        .color_matrix_find_first([Illuminant::D65, Illuminant::D55, Illuminant::D50, Illuminant::A])
        .map(|(_, matrix)| matrix)
        .or_else(|| raw.color_matrix.values().next().cloned())
        .filter(|m| m.len() >= 9)
        .and_then(|m| {
            let camera_of_xyz = Matrix3::from_fn(|r, c| f64::from(m[r * 3 + c]));
            let mut camera_of_rgb = camera_of_xyz * Matrix3::from_fn(|r, c| XYZ_OF_REC709[r][c]);
            for mut row in camera_of_rgb.row_iter_mut() {
                let sum = row.sum();
                row /= sum;
            }
            camera_of_rgb.try_inverse()
        })
        .filter(|m| m.iter().all(|v| v.is_finite()))
        .unwrap_or_else(Matrix3::identity);
    std::array::from_fn(|r| std::array::from_fn(|c| (from_camera[(r, c)] * balance[c]) as f32))
}

#[cfg(test)]
mod tests {
    use rawler::imgop::{Dim2, Point};

    use super::*;

    /// Red, green; green, blue.
    fn bayer(row: usize, column: usize) -> usize {
        row % 2 + column % 2
    }

    #[test]
    fn a_mosaic_becomes_a_picture_and_clipping_spreads() {
        let (w, h) = (12, 10);
        let mut samples: Vec<f32> = (0..w * h).map(|i| [0.1, 0.2, 0.4][bayer(i / w, i % w)]).collect();
        samples[4 * w + 6] = 1.0;
        let image = demosaiced(&samples, w, Rect::new(Point::new(1, 1), Dim2::new(w - 2, h - 2)), bayer).unwrap();
        assert_eq!(image.size(), (10, 8));
        for y in 0..8usize {
            for x in 0..10usize {
                // (6, 4) of the mosaic is red, and (5, 3) of the picture.
                let near = x.abs_diff(5) < 2 && y.abs_diff(3) < 2;
                let pixel = image.pixel(x, y);
                assert_eq!(pixel[0] >= 1.0, near, "({x}, {y})");
                assert!((pixel[1] - 0.2).abs() < 1e-6 && (pixel[2] - 0.4).abs() < 1e-6, "{pixel:?}");
            }
        }
    }

    #[test]
    fn a_real_file_is_read_and_its_neutral_is_white() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data/raw/colorchart.dng");
        if !path.is_file() {
            return;
        }
        let photograph = read(&path).unwrap();
        // The active area; the whole sensor has 1888 x 1182.
        assert_eq!(photograph.codes.size(), (1734, 1156));
        assert!(photograph.codes.data().iter().all(|v| (-0.5..=1.0).contains(v)));
        let mean = photograph.codes.data().iter().sum::<f32>() / photograph.codes.data().len() as f32;
        assert!(mean > 0.01 && mean < 0.9, "{mean}");
        // What the balance makes equal is grey: the rows of the matrix without the balance sum to one.
        let matrix = photograph.to_rec709.unwrap();
        let raw = rawler::decode_file(&path).unwrap();
        let neutral = [0, 1, 2].map(|c| raw.wb_coeffs[1] / raw.wb_coeffs[c]);
        for row in matrix {
            let sum: f32 = row.iter().zip(neutral).map(|(m, n)| m * n).sum();
            assert!((sum - 1.0).abs() < 1e-3, "{matrix:?}");
        }
    }

    #[test]
    fn damaged_files_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.dng");
        for bytes in [&b""[..], b"II*\0", b"II*\0\x08\0\0\0\xff\xff", b"no raw file at all"] {
            std::fs::write(&path, bytes).unwrap();
            let message = read(&path).unwrap_err().to_string();
            assert!(message.contains("a.dng"), "{message}");
        }
    }
}
