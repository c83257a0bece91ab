//! An asset and its cached projections.

use std::sync::{Arc, Mutex, PoisonError};

use super::{Look, Weights, apply, prepared};
use crate::error::{Error, Result};
use crate::field::Asset;
use crate::illumination::EnvMap;
use crate::image::{Conversion, Image, Window};
use crate::reconstruct::{Method, Operator, Outside};

/// Maps wider than this are averaged down before projection: 0.18 degrees a texel is far below any rig's cell, and the
/// operator of a larger map would take hundreds of megabytes. Whoever keeps a map for many pictures may [reduce](EnvMap::reduced) it
/// to this once.
pub const WIDEST_MAP: usize = 2048;
/// Projections kept. A user switches between two methods and two maps.
const KEPT_OPERATORS: usize = 4;

/// The light of a picture.
#[derive(Debug, Clone, Copy)]
pub enum Light<'a> {
    /// A lat-long map.
    Map(&'a EnvMap),
    /// Captured lamp N, counted from 1, at the intensity of the capture.
    Lamp(usize),
}

/// What an operator depends on, beside the asset.
type Key = (Method, Outside, usize, usize);

/// An asset with what relighting keeps between frames. Share it behind an `Arc`; all methods take `&self`.
#[derive(Debug)]
pub struct Relighter {
    asset: Asset,
    /// Most recently used first.
    operators: Mutex<Vec<(Key, Arc<Operator>)>>,
}

impl Relighter {
    /// Takes an open asset.
    pub fn new(asset: Asset) -> Self {
        Self { asset, operators: Mutex::default() }
    }

    /// The asset.
    pub fn asset(&self) -> &Asset {
        &self.asset
    }

    /// Projects a light onto the lamps: `w_j = 2^EV tint * integral of U_j(w) L(w) dw`, in units of radiance times
    /// steradian and the asset's colours, or 2^EV tint E_N for a lamp. L is the map [as the look has it](prepared). Once a picture, not per window. The first call for a method and map size builds the projection
    /// (about a second); later ones take milliseconds.
    ///
    /// # Errors
    /// A lamp that is not in the set.
    pub fn weights(&self, light: Light<'_>, look: &Look) -> Result<Weights> {
        let mut weights = match light {
            Light::Map(map) => {
                let map = prepared(map, look);
                let (w, h) = map.image().size();
                let mut weights = Weights { rgb: self.operator((look.method, look.outside, w, h)).downsample(&map) };
                // Colours of the sums in place of those of all texels: projection treats channels alike.
                weights.convert(&Conversion::between(look.map_space, self.asset.colour_space()));
                weights
            }
            Light::Lamp(number) => self.lamp(number)?,
        };
        weights.scale(look.gain());
        Ok(weights)
    }

    fn lamp(&self, number: usize) -> Result<Weights> {
        let irradiance = self.asset.manifest().irradiance();
        let Some(&e) = number.checked_sub(1).and_then(|n| irradiance.get(n)) else {
            let expected = format!("1 to {}", irradiance.len());
            return Err(Error::invalid(self.asset.path().display().to_string(), format!("lamp {number}"), expected));
        };
        let mut weights = Weights::dark(irradiance.len());
        weights.rgb[number - 1] = [e; 3];
        Ok(weights)
    }

    /// The projection for a key, built on first use. Two threads that miss at once both build it; the result is the same.
    fn operator(&self, key: Key) -> Arc<Operator> {
        let take = |kept: &mut Vec<(Key, Arc<Operator>)>| {
            let at = kept.iter().position(|entry| entry.0 == key)?;
            kept[..=at].rotate_right(1);
            Some(kept[0].1.clone())
        };
        // A poisoned lock only means that another thread panicked between two harmless steps.
        let lock = || self.operators.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(found) = take(&mut lock()) {
            return found;
        }
        let (method, outside, w, h) = key;
        let built = Arc::new(Operator::new(self.asset.domain(), method, outside, w, h));
        let mut kept = lock();
        kept.insert(0, (key, built.clone()));
        kept.truncate(KEPT_OPERATORS);
        built
    }

    /// The element `T L + g S`, RGBA premultiplied (alpha 1 where the asset has none), of the window alone: the picture
    /// has the window's size.
    ///
    /// # Errors
    /// As [`apply`].
    pub fn render(&self, weights: &Weights, look: &Look, window: Window) -> Result<Image> {
        let mut pictures = self.render_many(&[(weights, look)], window)?;
        pictures.pop().ok_or_else(|| Error::invalid("illumination", "none", "one"))
    }

    /// [`Relighter::render`] for several lights in one pass over the field.
    ///
    /// # Errors
    /// As [`apply`].
    pub fn render_many(&self, lights: &[(&Weights, &Look)], window: Window) -> Result<Vec<Image>> {
        let weights: Vec<&Weights> = lights.iter().map(|light| light.0).collect();
        let lit = apply(self.asset.dense(), &weights, window)?;
        Ok(lit.iter().zip(lights).map(|(picture, (_, look))| self.finish(picture, look, window)).collect())
    }

    /// Adds `g S` and alpha, in the colours asked for.
    fn finish(&self, lit: &Image, look: &Look, window: Window) -> Image {
        let mut element = Image::new(window.width(), window.height(), 4);
        let colours = Conversion::between(self.asset.colour_space(), look.output_space);
        let ambient = self.asset.ambient().filter(|_| look.ambient != 0.0);
        for y in 0..window.height() {
            for x in 0..window.width() {
                let (sx, sy) = (window.x0 + x, window.y0 + y);
                let rgb = lit.pixel(x, y);
                let out = element.pixel_mut(x, y);
                for c in 0..3 {
                    let s = ambient.map_or(0.0, |s| s.pixel(sx, sy)[c]);
                    out[c] = rgb[c] + look.ambient as f32 * s;
                }
                let rgb = colours.apply([out[0], out[1], out[2]]);
                out[..3].copy_from_slice(&rgb);
                out[3] = self.asset.alpha().map_or(1.0, |alpha| alpha[sy * self.asset.width() + sx]);
            }
        }
        element
    }
}
