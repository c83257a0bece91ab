//! Weights x field -> picture.

use crate::error::Result;
use crate::field::Asset;
use crate::illumination::{EnvMap, MapCentre};
use crate::image::{Image, Window};
use crate::reconstruct::{Method, Outside};

/// The light of a picture.
#[derive(Debug, Clone, Copy)]
pub enum Light<'a> {
    /// A lat-long map.
    Map(&'a EnvMap),
    /// Captured lamp N, counted from 1, at the intensity of the capture.
    Lamp(usize),
}

/// What a user can turn, with neutral defaults.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Look {
    /// How the reflectance function is filled in.
    pub method: Method,
    /// What becomes of light outside the coverage.
    pub outside: Outside,
    /// What stands in the middle column of the map.
    pub centre: MapCentre,
    /// Heading of the light in degrees about +y, right-handed.
    pub heading_deg: f64,
    /// Exposure of the light in stops; the ambient is not scaled.
    pub exposure_ev: f64,
    /// g in `T L + g S`.
    pub ambient: f64,
}

impl Default for Look {
    fn default() -> Self {
        Self {
            method: Method::default(),
            outside: Outside::default(),
            centre: MapCentre::default(),
            heading_deg: 0.0,
            exposure_ev: 0.0,
            ambient: 0.0,
        }
    }
}

/// Weights of every lamp, RGB, for one picture.
#[derive(Debug, Clone, PartialEq)]
pub struct Weights {
    /// One RGB triple a lamp.
    pub rgb: Vec<[f32; 3]>,
}

/// An asset with what relighting keeps between frames. Share it behind an `Arc`; all methods take `&self`.
#[derive(Debug)]
pub struct Relighter {
    asset: Asset,
}

impl Relighter {
    /// Takes an open asset.
    pub fn new(asset: Asset) -> Self {
        Self { asset }
    }

    /// The asset.
    pub fn asset(&self) -> &Asset {
        &self.asset
    }

    /// Projects a light onto the lamps: exposure and solid angle included. Once a picture, not per window.
    ///
    /// # Errors
    /// A lamp that is not in the set.
    pub fn weights(&self, light: Light<'_>, look: &Look) -> Result<Weights> {
        let _ = (light, look);
        todo!()
    }

    /// The element `T L + g S`, RGBA premultiplied (alpha 1 where the asset has none), of the window alone (so the
    /// picture has the window's size).
    ///
    /// # Errors
    /// Bytes that cannot be read, NaN in the field.
    pub fn render(&self, weights: &Weights, look: &Look, window: Window) -> Result<Image> {
        let _ = (weights, look, window);
        todo!()
    }
}
