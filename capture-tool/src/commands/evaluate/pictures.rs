//! What is shown of measurements: exposure, false colours, sizes.

use relume_core::evaluate::pixel_sets::{PixelSet, Traits};
use relume_core::field::Asset;
use relume_core::image::{ColourSpace, Conversion, Image, encode_png8, srgb};

use crate::sheet;

/// The page shows pictures no wider than this: a dozen of them side by side need no more, and the page stays small.
const WIDEST: usize = 480;

/// An 8-bit PNG of a picture times a gain; what is below 0 or above 1 is cut, for display alone.
///
/// # Errors
/// As [`encode_png8`].
pub fn png(picture: &Image, gain: f32) -> relume_core::Result<Vec<u8>> {
    let mut shown = picture.clone();
    shown.data_mut().iter_mut().for_each(|v| *v *= gain);
    encode_png8(&shown)
}

/// The gain that shows a reference well; its rivals are shown with the same.
pub fn gain(reference: &Image) -> f32 {
    sheet::exposure(reference)
}

/// A picture of a field in the colours of pictures to look at.
pub fn for_display(asset: &Asset, mut picture: Image) -> Image {
    picture.convert(&Conversion::between(asset.colour_space(), ColourSpace::LinRec709));
    picture
}

/// A picture averaged down by a whole factor until the page can show it.
pub fn small(picture: &Image) -> Image {
    let factor = picture.width().div_ceil(WIDEST).max(1);
    let (w, h) = (picture.width().div_ceil(factor), picture.height().div_ceil(factor));
    Image::from_fn(w, h, |x, y| {
        let (x1, y1) = (((x + 1) * factor).min(picture.width()), ((y + 1) * factor).min(picture.height()));
        let mut sum = [0.0f32; 3];
        for pixel in (y * factor..y1).flat_map(|y| (x * factor..x1).map(move |x| picture.pixel(x, y))) {
            (0..3).for_each(|c| sum[c] += pixel[c]);
        }
        let count = ((x1 - x * factor) * (y1 - y * factor)) as f32;
        sum.map(|v| v / count)
    })
}

/// A set in colour over the object in grey, as in figure 4.16.
pub fn set_picture(set: &PixelSet, traits: &[Traits], width: usize) -> Image {
    let grey = Image::from_fn(width, traits.len() / width, |x, y| [traits[y * width + x].mean; 3]);
    let gain = gain(&grey);
    Image::from_fn(width, traits.len() / width, |x, y| {
        let level = (traits[y * width + x].mean * gain).clamp(0.0, 1.0);
        let inside = set.pixels.binary_search(&((y * width + x) as u32)).is_ok();
        // Orange at the object's own brightness, but never so dark that it cannot be told; outside half as bright.
        if inside { [1.0, 0.32, 0.02].map(|c| c * (0.25 + 0.75 * level)) } else { [0.5 * level; 3] }
    })
}

/// Numbers from 0 (black) to `white`, by the colours of a heated body: black, red, yellow, white.
pub fn heat(plane: &[f32], width: usize, white: f32) -> Image {
    Image::from_fn(width, plane.len() / width, |x, y| {
        let t = 3.0 * (plane[y * width + x] / white).clamp(0.0, 1.0);
        // Even steps on the screen, not in light.
        [t, t - 1.0, t - 2.0].map(|v| srgb::decode(v.clamp(0.0, 1.0)))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn small_pictures_keep_their_mean() {
        let picture = Image::from_fn(1000, 30, |x, y| [x as f32, y as f32, 1.0]);
        let small = small(&picture);
        assert_eq!(small.size(), (334, 10));
        let first = small.pixel(0, 0);
        assert_eq!((first[0], first[1], first[2]), (1.0, 1.0, 1.0));
        // The last column has one pixel of 1000 = 3 x 333 + 1.
        assert_eq!(small.pixel(333, 9)[0], 999.0);
        assert_eq!(super::small(&Image::new(480, 2, 3)).size(), (480, 2));
    }

    #[test]
    fn heat_goes_from_black_over_red_and_yellow_to_white() {
        let heat = heat(&[0.0, 0.2, 0.4, 0.6, 9.0], 5, 0.6);
        let near = |x: usize, rgb: [f32; 3]| {
            assert!(heat.pixel(x, 0).iter().zip(rgb).all(|(a, b)| (a - b).abs() < 1e-4), "{x}: {:?}", heat.pixel(x, 0));
        };
        near(0, [0.0, 0.0, 0.0]);
        near(1, [1.0, 0.0, 0.0]);
        near(2, [1.0, 1.0, 0.0]);
        near(3, [1.0, 1.0, 1.0]);
        near(4, [1.0, 1.0, 1.0]);
    }
}
