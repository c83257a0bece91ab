//! Reference photographs (6.3): a picture on the screen, photographed with the object and without it, against the field relit.
//!
//! What the screen emits is not what its picture's numbers say: its colours mix, its light falls off with the angle. So the
//! photograph of the bare screen, over that of the bare white screen, is the light, taken to the texels through the
//! correspondence; and the same photograph is the plate, for it is what stands where the object does not cover it.

use crate::domain::{Correspondence, Plane};
use crate::error::{Error, Result};
use crate::image::{Image, Window};
use crate::matte::{Backdrop, Behind, Beyond, Composite, Place};
use crate::relight::{Look, ScreenRelighter};

/// Where the white screen has less than this share of its light, a pixel looks past it.
const BESIDE: f32 = 0.25;
/// Pixels beside the screen that take their neighbours' light: as far as a texel at its edge reaches out of it.
const REACH: usize = 4;

/// The bare screen, photographed.
#[derive(Debug)]
pub struct BareScreen {
    white: Image,
    /// Per channel, the light of the white screen: the unit of fields.
    unit: [f32; 3],
    backdrop: Backdrop,
}

impl BareScreen {
    /// From the photograph of the bare white screen, black subtracted, where pixels look, and the texels.
    ///
    /// # Errors
    /// A screen that is not seen.
    pub fn new(white: Image, correspondence: &Correspondence, plane: Plane) -> Result<Self> {
        let (size, white) = (white.size(), white.into_rgb());
        let unit = Behind::new(&vec![0.0; size.0 * size.1], size, correspondence, plane).white(&white)?;
        let backdrop = Backdrop::new((plane, Some(correspondence)), size, &Place::default(), size)?;
        Ok(Self { white, unit, backdrop })
    }

    /// The light of each texel under a picture, 1 as under white, from the photograph of the bare screen, black subtracted.
    ///
    /// # Errors
    /// A photograph of another size.
    pub fn light(&self, photograph: &Image) -> Result<Vec<[f32; 3]>> {
        self.check(photograph, "the photograph of the bare screen")?;
        Ok(self.backdrop.light(&filled(&self.shares(photograph)), Beyond::Stretch))
    }

    /// A photograph, black subtracted, in the unit of fields.
    ///
    /// # Errors
    /// A photograph of another size.
    pub fn in_units(&self, photograph: &Image) -> Result<Image> {
        self.check(photograph, "a photograph")?;
        let mut out = photograph.clone().into_rgb();
        for pixel in out.data_mut().chunks_exact_mut(3) {
            pixel.iter_mut().zip(self.unit).for_each(|(v, unit)| *v /= unit);
        }
        Ok(out)
    }

    /// What the field shows under the light of a photograph of the bare screen, over that photograph, RGB, in the unit of fields,
    /// without ambient light.
    ///
    /// # Errors
    /// A photograph of another size; a field that cannot be read.
    pub fn relit(&self, field: &ScreenRelighter, photograph: &Image) -> Result<Image> {
        let (asset, look) = (field.asset(), Look { ambient: 0.0, ..Look::default() });
        let look = Look { map_space: asset.colour_space(), output_space: asset.colour_space(), ..look };
        let weights = field.weights(&self.light(photograph)?, &look)?;
        let element = field.render(&weights, &look, Window::full(asset.width(), asset.height()))?;
        let plate = self.in_units(photograph)?;
        if plate.size() != element.size() {
            return Err(Error::invalid("the field", sizes(&element), format!("{}, as the photographs", sizes(&plate))));
        }
        Ok(Composite::over(&element, &plate).into_rgb())
    }

    fn check(&self, photograph: &Image, place: &str) -> Result<()> {
        if photograph.size() == self.white.size() {
            return Ok(());
        }
        let expected = format!("{}, as the white screen's", sizes(&self.white));
        Err(Error::invalid(place, sizes(photograph), expected))
    }

    /// The photograph over that of white; negative where there is no screen.
    fn shares(&self, photograph: &Image) -> Image {
        let mut shares = photograph.clone().into_rgb();
        for (share, white) in shares.data_mut().chunks_exact_mut(3).zip(self.white.data().chunks_exact(3)) {
            let seen = (0..3).all(|c| white[c] >= BESIDE * self.unit[c]);
            for c in 0..3 {
                share[c] = if seen { (share[c] / white[c]).max(0.0) } else { -1.0 };
            }
        }
        shares
    }
}

fn sizes(image: &Image) -> String {
    format!("{} x {} pixels", image.width(), image.height())
}

/// Pixels beside the screen (negative) take the mean of their neighbours on it; beyond their reach they are black.
fn filled(shares: &Image) -> Image {
    let (width, height) = shares.size();
    let mut now = shares.clone();
    for _ in 0..REACH {
        let before = now.clone();
        for y in 0..height {
            for x in 0..width {
                if before.pixel(x, y)[0] >= 0.0 {
                    continue;
                }
                let (mut sum, mut count) = ([0.0; 3], 0.0);
                for row in y.saturating_sub(1)..(y + 2).min(height) {
                    for column in x.saturating_sub(1)..(x + 2).min(width) {
                        let near = before.pixel(column, row);
                        if near[0] >= 0.0 {
                            (0..3).for_each(|c| sum[c] += near[c]);
                            count += 1.0;
                        }
                    }
                }
                if count > 0.0 {
                    now.pixel_mut(x, y).copy_from_slice(&sum.map(|v| v / count));
                }
            }
        }
    }
    now.data_mut().iter_mut().for_each(|v| *v = v.max(0.0));
    now
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::domain::Area;

    /// Colours that mix and light that falls off cancel: the light is that of the picture as white makes it.
    #[test]
    fn the_light_of_texels_comes_back() {
        let (width, height, plane) = (90, 70, Plane::new(16, 8).unwrap());
        // The screen fills 80 x 64 pixels from (5, 3): texels of 5 x 8.
        let homography = [[1.0 / 80.0, 0.0, -5.0 / 80.0], [0.0, 1.0 / 64.0, -3.0 / 64.0], [0.0, 0.0, 1.0]];
        let area = Area { from: [5.0, 3.0], to: [85.0, 67.0] };
        let correspondence = Correspondence::new(homography, area, None).unwrap();
        let texel = |column: usize, row: usize| [0.1 + 0.05 * column as f32, 0.1 * row as f32, 0.5];
        let photograph = |light: &dyn Fn(usize, usize) -> [f32; 3]| {
            Image::from_fn(width, height, |x, y| {
                let inside = (5..85).contains(&x) && (3..67).contains(&y);
                let rgb = if inside { light((x - 5) / 5, (y - 3) / 8) } else { [0.0; 3] };
                let gain = 3.0 - 0.01 * x as f32;
                [0.9, 1.0, 0.7]
                    .map(|g: f32| g * gain)
                    .iter()
                    .zip(rgb)
                    .map(|(g, v)| g * v)
                    .collect::<Vec<_>>()
                    .try_into()
                    .unwrap()
            })
        };
        let bare = BareScreen::new(photograph(&|_, _| [1.0; 3]), &correspondence, plane).unwrap();
        let light = bare.light(&photograph(&texel)).unwrap();
        for (n, found) in light.iter().enumerate() {
            let expected = texel(n % 16, n / 16);
            // Linear between pixels: at the edges of a texel its neighbours are seen.
            for c in 0..3 {
                assert!((found[c] - expected[c]).abs() < 0.012, "texel {n}: {found:?}, not {expected:?}");
            }
        }
        assert!(bare.light(&Image::new(9, 9, 3)).unwrap_err().to_string().contains("90 x 70"));
    }
}
