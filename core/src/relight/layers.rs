//! Pictures of an asset that no light makes: coverage, normals, albedo, ambient.

use crate::error::{Error, Result};
use crate::field::Asset;
use crate::image::{Image, Window, srgb};

/// A layer of an asset, as a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Layer {
    /// Coverage in all four channels; 1 where the asset has none.
    Alpha,
    /// Unit normals in the stage frame (+x right, +y up, +z to the camera) times coverage: red, green and blue hold x, y and z.
    Normals,
    /// Diffuse albedo, linear RGB.
    Albedo,
    /// What is seen with every lamp off.
    Ambient,
    /// How far `T` can be trusted, grey: 1 where what was told apart adds up to what was photographed together (7.5).
    Reliability,
}

impl Layer {
    /// Permanent name.
    pub fn id(self) -> &'static str {
        match self {
            Self::Alpha => "alpha",
            Self::Normals => "normals",
            Self::Albedo => "albedo",
            Self::Ambient => "ambient",
            Self::Reliability => "reliability",
        }
    }

    /// The window of the layer, RGBA premultiplied, of the window's size.
    ///
    /// # Errors
    /// An asset without the layer; a layer that cannot be read; a window outside the picture.
    pub fn picture(self, asset: &Asset, window: Window) -> Result<Image> {
        let (width, height) = (asset.width(), asset.height());
        if window.x1 > width || window.y1 > height {
            return Err(Error::invalid("window", format!("{window:?}"), format!("one inside {width} x {height}")));
        }
        let source = match self {
            Self::Alpha => None,
            Self::Normals => Some(self.of(asset, asset.normals()?)?),
            Self::Albedo => Some(self.of(asset, asset.albedo()?)?),
            Self::Ambient => Some(self.of(asset, asset.ambient())?),
            Self::Reliability => None,
        };
        let reliability = (self == Self::Reliability).then(|| self.of(asset, asset.reliability())).transpose()?;
        let mut picture = Image::new(window.width(), window.height(), 4);
        for (y, x) in (0..window.height()).flat_map(|y| (0..window.width()).map(move |x| (y, x))) {
            let (sx, sy) = (window.x0 + x, window.y0 + y);
            let alpha = asset.alpha().map_or(1.0, |alpha| alpha[sy * width + sx]);
            // Albedo and ambient come from photographs, where the edges hold their share of the object already.
            let scale = if self == Self::Normals { alpha } else { 1.0 };
            let even = reliability.map_or(alpha, |reliability| reliability[sy * width + sx]);
            let [r, g, b] = source.map_or([even; 3], |s| {
                let pixel = s.pixel(sx, sy);
                [pixel[0] * scale, pixel[1] * scale, pixel[2] * scale]
            });
            picture.pixel_mut(x, y).copy_from_slice(&[r, g, b, alpha]);
        }
        Ok(picture)
    }

    fn of<T>(self, asset: &Asset, layer: Option<T>) -> Result<T> {
        layer.ok_or_else(|| {
            let advice = match self {
                Self::Ambient => "an asset that was imported with --black",
                Self::Reliability => "an asset of a projector that was captured with `--sampler separable`",
                _ => "an asset that has them (`relume surface A.rfield -o B.rfield` makes normals and albedo)",
            };
            Error::invalid(asset.path().display().to_string(), format!("no layer `{}`", self.id()), advice)
        })
    }
}

/// Normals (RGBA premultiplied) for types that hold nothing below zero and are written through the sRGB curve: the stored
/// code becomes `(n + 1) / 2`, as normal maps have it, and transparent pixels stay black.
pub fn displayed_normals(picture: &mut Image) {
    for pixel in picture.data_mut().chunks_exact_mut(4) {
        let alpha = pixel[3];
        for n in &mut pixel[..3] {
            // Writers divide by alpha before the curve, and multiply nothing after it.
            *n = if alpha > 0.0 { alpha * srgb::decode((*n / alpha).mul_add(0.5, 0.5)) } else { 0.0 };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn normals_are_shown_as_normal_maps_have_them() {
        // Premultiplied: half covered, and not at all.
        let mut picture =
            Image::from_data(3, 1, 4, vec![0.6, -0.8, 0.0, 1.0, 0.0, -0.4, 0.3, 0.5, 0.0, 0.0, 0.0, 0.0]).unwrap();
        displayed_normals(&mut picture);
        let code = |x: usize, c: usize| {
            let pixel = picture.pixel(x, 0);
            srgb::encode(pixel[c] / pixel[3])
        };
        for (x, c, n) in [(0, 0, 0.6), (0, 1, -0.8), (0, 2, 0.0), (1, 0, 0.0), (1, 1, -0.8), (1, 2, 0.6)] {
            assert!((code(x, c) - (n + 1.0) / 2.0).abs() < 1e-5, "pixel {x}, channel {c}: {}", code(x, c));
        }
        assert_eq!(picture.pixel(2, 0), [0.0; 4]);
    }
}
