//! `relume relight --layer`: pictures of an asset that no light makes.

use std::path::Path;

use clap::ValueEnum;
use relume_core::field::Asset;
use relume_core::image::{self, EncodeOptions, Window};
use relume_core::relight::{Layer, displayed_normals};

use super::note;

/// A layer, as the command line calls it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum LayerChoice {
    /// Coverage.
    Alpha,
    /// Unit normals in the stage frame.
    Normals,
    /// Diffuse albedo.
    Albedo,
    /// What is seen with every lamp off.
    Ambient,
    /// Where squares that a projector showed together could be told apart: 1 is well.
    Reliability,
}

impl LayerChoice {
    fn layer(self) -> Layer {
        match self {
            Self::Alpha => Layer::Alpha,
            Self::Normals => Layer::Normals,
            Self::Albedo => Layer::Albedo,
            Self::Ambient => Layer::Ambient,
            Self::Reliability => Layer::Reliability,
        }
    }

    /// Writes the layer; it has alpha if the asset has, but for alpha itself, which is grey.
    pub(super) fn write(self, asset: &Asset, output: &Path) -> anyhow::Result<String> {
        let mut picture = self.layer().picture(asset, Window::full(asset.width(), asset.height()))?;
        if self == Self::Alpha && asset.alpha().is_none() {
            note(&format!("{} has no coverage: alpha is 1 everywhere", asset.path().display()));
        }
        if self == Self::Normals && !holds_negatives(output) {
            displayed_normals(&mut picture);
        }
        if self == Self::Alpha || asset.alpha().is_none() {
            picture = picture.into_rgb();
        }
        image::write(output, &picture, EncodeOptions::default())?;
        Ok(format!("{}: {}, {} x {} pixels\n", output.display(), self.layer().id(), picture.width(), picture.height()))
    }
}

/// Does a type hold numbers below zero, without a curve? Radiance HDR holds none, but no codes either.
fn holds_negatives(output: &Path) -> bool {
    let extension = output.extension().map(|e| e.to_ascii_lowercase()).unwrap_or_default();
    extension == "exr" || extension == "tif" || extension == "tiff"
}
