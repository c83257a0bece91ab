//! Contact sheets.

use relume_core::image::Image;

/// How much differences are brightened to be seen.
const DIFFERENCE_GAIN: f32 = 4.0;

/// A row for each pair: the picture, its reference, and what differs, times four; each row exposed so that its reference's
/// 98th percentile is white. All pictures are RGB and of one size.
pub fn contact_sheet(pictures: &[Image], references: &[Image]) -> Image {
    let (w, h) = references.first().map_or((1, 1), Image::size);
    let exposures: Vec<f32> = references.iter().map(exposure).collect();
    Image::from_fn(3 * w, pictures.len().max(1) * h, |x, y| {
        let (row, x0, y0) = (y / h, x % w, y % h);
        let (Some(picture), Some(reference)) = (pictures.get(row), references.get(row)) else { return [0.0; 3] };
        let (a, b) = (picture.pixel(x0, y0), reference.pixel(x0, y0));
        std::array::from_fn(|c| {
            let shown = match x / w {
                0 => a[c],
                1 => b[c],
                _ => (a[c] - b[c]).abs() * DIFFERENCE_GAIN,
            };
            shown * exposures[row]
        })
    })
}

/// What brings the 98th percentile of what is lit at all to white.
pub fn exposure(picture: &Image) -> f32 {
    let mut lit: Vec<f32> = picture.data().iter().copied().filter(|v| *v > 0.0).collect();
    if lit.is_empty() {
        return 1.0;
    }
    let at = (lit.len() - 1) * 98 / 100;
    1.0 / *lit.select_nth_unstable_by(at, f32::total_cmp).1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_row_shows_picture_reference_and_difference() {
        let reference = Image::from_fn(4, 2, |_, _| [2.0; 3]);
        let picture = Image::from_fn(4, 2, |x, _| [2.0 + x as f32 * 0.1; 3]);
        let sheet = contact_sheet(&[picture], std::slice::from_ref(&reference));
        assert_eq!(sheet.size(), (12, 2));
        assert!((sheet.pixel(2, 1)[0] - 1.1).abs() < 1e-6);
        assert_eq!(sheet.pixel(6, 0)[1], 1.0);
        assert!((sheet.pixel(11, 1)[2] - 0.6).abs() < 1e-6);
        assert_eq!(contact_sheet(&[], &[]).size(), (3, 1));
    }
}
