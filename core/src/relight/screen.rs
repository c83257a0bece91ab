//! An asset of a screen, lit by what the screen would show.

use super::choice::absent;
use super::{Look, Weights, element};
use crate::domain::{Correspondence, Plane};
use crate::error::{Error, Result};
use crate::field::{Asset, Kind};
use crate::image::{Conversion, Image, Window};

/// An asset of a screen. Share it behind an `Arc`; all methods take `&self`.
#[derive(Debug)]
pub struct ScreenRelighter {
    asset: Asset,
    plane: Plane,
}

impl ScreenRelighter {
    /// Takes an open asset.
    ///
    /// # Errors
    /// A field of lamps; see [`Relighter`](super::Relighter).
    pub fn new(asset: Asset) -> Result<Self> {
        let Some(&plane) = asset.domain().plane() else {
            return Err(Error::Unsupported {
                place: asset.path().display().to_string(),
                what: "a screen's picture on a field that no screen made".to_owned(),
                advice: "light it from all round: `relume relight --env`, or Relume Relight".to_owned(),
            });
        };
        Ok(Self { asset, plane })
    }

    /// The asset.
    pub fn asset(&self) -> &Asset {
        &self.asset
    }

    /// The texels that light is given for.
    pub fn plane(&self) -> Plane {
        self.plane
    }

    /// Where on the screen each pixel of the camera looks, if that is known.
    pub fn correspondence(&self) -> Option<&Correspondence> {
        self.asset.domain().correspondence()
    }

    /// The representation that is used: the one `wanted`, or the first there is of samples, factored, wavelets of each pixel,
    /// explicit wavelets.
    ///
    /// # Errors
    /// One that the asset does not hold.
    pub fn choose(&self, wanted: Option<Kind>) -> Result<Kind> {
        let held = |kind: &Kind| self.asset.manifest().representation(*kind).is_some();
        match wanted {
            Some(kind) if held(&kind) => Ok(kind),
            Some(kind) => Err(absent(&self.asset, kind)),
            // A manifest holds one at least.
            None => Ok(Kind::ALL.into_iter().find(held).unwrap_or(Kind::Dense)),
        }
    }

    /// Weights of a picture on the screen: RGB radiance of each texel, row 0 at the top, 1 that of the white screen, in the
    /// colours `look.map_space`. Of the look only representation, exposure, tint and colours count.
    ///
    /// # Errors
    /// Not one triple a texel; a representation that the asset does not hold.
    pub fn weights(&self, light: &[[f32; 3]], look: &Look) -> Result<Weights> {
        if light.len() != self.plane.len() {
            let expected = format!("{} x {} texels", self.plane.columns(), self.plane.rows());
            return Err(Error::invalid("the picture on the screen", format!("{} texels", light.len()), expected));
        }
        let kind = self.choose(look.representation)?;
        let conversion = Conversion::between(look.map_space, self.asset.colour_space());
        let gain = look.gain();
        let lit = |rgb: &[f32; 3]| {
            let [r, g, b] = conversion.apply(*rgb);
            [r * gain[0], g * gain[1], b * gain[2]]
        };
        let rgb: Vec<[f32; 3]> = light.iter().map(lit).collect();
        let coefficients = match kind {
            Kind::Wavelet => self.asset.sparse().map(|sparse| sparse.transformed(&rgb)),
            Kind::Explicit => self.asset.explicit().map(|explicit| explicit.expanded(&rgb)),
            Kind::Dense | Kind::Factored | Kind::Harmonics => None,
        };
        Ok(Weights { rgb, kind, coefficients })
    }

    /// The element `T L + g S`, RGBA premultiplied (alpha 1 where the asset has none), of the window alone: the picture
    /// has the window's size.
    ///
    /// # Errors
    /// As [`apply`](super::apply).
    pub fn render(&self, weights: &Weights, look: &Look, window: Window) -> Result<Image> {
        let mut pictures = element::many(&self.asset, &[(weights, look)], window)?;
        pictures.pop().ok_or_else(|| Error::invalid("illumination", "none", "one"))
    }
}
