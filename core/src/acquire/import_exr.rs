//! One OpenEXR file with a picture a lamp, as a part or a layer each -> a container.
//!
//! Such files are how light groups travel: pictures add up, so a lamp's picture holds what that lamp alone adds, and what was
//! there without lamps is a picture of its own, called `ambient`. Where each lamp stood is told by attributes of its part
//! (`relume export exr` writes them) or by a `.lp` file whose photographs are called as the layers.

use std::collections::{HashMap, HashSet};
use std::ffi::OsStr;
use std::path::{Path, PathBuf};

use rayon::prelude::*;

use super::Photographs;
use super::import_lp::Imported;
use super::photographs::Reporting;
use crate::calibrate::{Correction, lamp_table};
use crate::domain::{Directions, lp};
use crate::error::{Error, Result};
use crate::field::{BLOCK_HEIGHT, Contents, Precision, write};
use crate::files::{check_folder, folder_of};
use crate::image::layers::{Layer, Layers};
use crate::image::{ColourSpace, Encoding, Image, probe_size, read};
use crate::math::Vec3;

/// Pictures read together take about this; of layers in one part every pass over the file reads as many.
const GROUP_BYTES: usize = 512 << 20;
/// The layer of what is seen with every lamp off.
const AMBIENT: &str = "ambient";
/// The layer of the object's coverage.
const ALPHA: &str = "alpha";
/// Names that a message lists at most.
const LISTED: usize = 5;

/// What to import, and how.
#[derive(Debug, Clone)]
pub struct ImportExr {
    /// The file.
    pub exr: PathBuf,
    /// Where lamps stand, in place of what the file tells: the photographs of this `.lp` file are the layers, by name (with or
    /// without extension) or, where no name fits and their numbers are the same, in order.
    pub lp: Option<PathBuf>,
    /// What to do with vectors that are not of unit length.
    pub lengths: lp::Lengths,
    /// Irradiances, a row a layer ([`lamp_table`]); goes before what the file tells.
    pub lamps: Option<PathBuf>,
    /// E of every lamp; goes before what the file tells. Without any, pi.
    pub irradiance: Option<f32>,
    /// A photograph with every lamp off, subtracted from all and kept as ambient `S`: for pictures that are no light groups.
    pub black: Option<PathBuf>,
    /// The colours, in place of what the file tells; without either, linear Rec. 709.
    pub colour_space: Option<ColourSpace>,
    /// How `T` is stored.
    pub precision: Precision,
    /// White balance of every picture.
    pub correction: Option<Correction>,
}

/// What a look at the headers found.
#[derive(Debug)]
pub struct CheckedExr {
    layers: Layers,
    /// A layer a lamp.
    lamps: Vec<usize>,
    /// Where each stands.
    pub directions: Vec<Vec3>,
    irradiances: Vec<f32>,
    ambient: Option<usize>,
    alpha: Option<usize>,
    /// Names of layers that are no lamps, and nothing else that is known.
    pub left_out: Vec<String>,
    /// The layers were told apart by their order alone.
    pub by_order: bool,
}

impl ImportExr {
    /// Checks everything that headers and text files tell.
    ///
    /// # Errors
    /// As [`ImportExr::run`].
    pub fn check(&self) -> Result<CheckedExr> {
        if let Some(irradiance) = self.irradiance.filter(|e| !(e.is_finite() && *e > 0.0)) {
            return Err(Error::invalid("irradiance", irradiance.to_string(), "a positive number"));
        }
        let layers = Layers::open(&self.exr)?;
        let (lamps, directions, by_order) = match &self.lp {
            Some(path) => self.listed(&layers, &lp::read(path, self.lengths)?)?,
            None => self.told(&layers)?,
        };
        let is_lamp: HashSet<usize> = lamps.iter().copied().collect();
        let others = || (0..layers.layers().len()).filter(|n| !is_lamp.contains(n));
        let named = |wanted: &str| others().find(|&n| layers.layers()[n].name.eq_ignore_ascii_case(wanted));
        let (ambient, alpha) = (named(AMBIENT), named(ALPHA));
        let known = |n: &usize| Some(*n) == ambient || Some(*n) == alpha;
        let left_out = others().filter(|n| !known(n)).map(|n| layers.layers()[n].name.clone()).collect();
        if let Some(black) = &self.black {
            self.check_black(black, &layers, ambient)?;
        }
        let irradiances = self.irradiances(&layers, &lamps)?;
        Ok(CheckedExr { layers, lamps, directions, irradiances, ambient, alpha, left_out, by_order })
    }

    /// Lamps by the attributes of their parts.
    fn told(&self, layers: &Layers) -> Result<(Vec<usize>, Vec<Vec3>, bool)> {
        let (mut lamps, mut directions) = (Vec::new(), Vec::new());
        for (n, layer) in layers.layers().iter().enumerate() {
            let Some(direction) = layer.direction else { continue };
            let vector = Vec3::from(direction.map(f64::from));
            // Also refuses NaN.
            if !(0.999..=1.001).contains(&vector.norm()) {
                let place = format!("{}, {}", self.exr.display(), layer.name);
                return Err(Error::invalid(place, format!("the direction {direction:?}"), "a unit vector"));
            }
            lamps.push(n);
            directions.push(vector.normalize());
        }
        if lamps.is_empty() {
            let found = format!("{} pictures ({}), none with a direction", layers.layers().len(), names(layers));
            let expected = "parts with the attribute relumeDirection, as `relume export exr` writes, or directions in a .lp \
                            file (--lp) whose photographs are called as the layers";
            return Err(Error::invalid(self.exr.display().to_string(), found, expected));
        }
        Ok((lamps, directions, false))
    }

    /// Lamps by a `.lp` file.
    fn listed(&self, layers: &Layers, lp: &lp::Lp) -> Result<(Vec<usize>, Vec<Vec3>, bool)> {
        // Of layers of one name the first.
        let named: HashMap<&OsStr, usize> =
            layers.layers().iter().enumerate().rev().map(|(n, layer)| (OsStr::new(&layer.name), n)).collect();
        let find = |name: Option<&OsStr>| named.get(name?).copied();
        let by_name: Vec<Option<usize>> =
            lp.photographs.iter().map(|path| find(path.file_name()).or_else(|| find(path.file_stem()))).collect();
        let place = || format!("{} for {}", self.lp.as_deref().unwrap_or(Path::new("")).display(), self.exr.display());
        if let Some(lamps) = by_name.iter().copied().collect::<Option<Vec<usize>>>() {
            let mut sorted = lamps.clone();
            sorted.sort_unstable();
            if let Some(twice) = sorted.windows(2).find(|pair| pair[0] == pair[1]) {
                let found = format!("the layer {} twice", layers.layers()[twice[0]].name);
                return Err(Error::invalid(place(), found, "each layer once"));
            }
            return Ok((lamps, lp.directions.clone(), false));
        }
        let is_lamp = |layer: &Layer| ![AMBIENT, ALPHA].iter().any(|name| layer.name.eq_ignore_ascii_case(name));
        let lamps: Vec<usize> = (0..layers.layers().len()).filter(|&n| is_lamp(&layers.layers()[n])).collect();
        if by_name.iter().all(Option::is_none) && lamps.len() == lp.photographs.len() {
            return Ok((lamps, lp.directions.clone(), true));
        }
        let missing = by_name.iter().position(Option::is_none).unwrap_or_default();
        let name = lp.photographs[missing].file_name().unwrap_or_default().to_string_lossy().into_owned();
        let found = format!("no layer called `{name}` (there are {}: {})", layers.layers().len(), names(layers));
        let expected = "a layer for every photograph of the list, by name, or as many layers in the same order";
        Err(Error::invalid(place(), found, expected))
    }

    fn check_black(&self, black: &Path, layers: &Layers, ambient: Option<usize>) -> Result<()> {
        let place = black.display().to_string();
        if ambient.is_some() {
            let found = format!("a black photograph beside the layer {AMBIENT} of {}", self.exr.display());
            return Err(Error::invalid(place, found, "one of them: a light group's layer is not subtracted"));
        }
        let (size, found) = (layers.size(), probe_size(black)?);
        if found != size {
            let expected = format!("{} x {} pixels, as {} has", size.0, size.1, self.exr.display());
            return Err(Error::invalid(place, format!("{} x {} pixels", found.0, found.1), expected));
        }
        Ok(())
    }

    /// By the table, the option, the file, or pi.
    fn irradiances(&self, layers: &Layers, lamps: &[usize]) -> Result<Vec<f32>> {
        let layer = |&n: &usize| &layers.layers()[n];
        if let Some(table) = &self.lamps {
            let named: Vec<PathBuf> = lamps.iter().map(|n| PathBuf::from(&layer(n).name)).collect();
            return Ok(lamp_table::read(table, &named)?.iter().map(|row| row.irradiance as f32).collect());
        }
        let of = |layer: &Layer| {
            let irradiance = self.irradiance.or(layer.irradiance).unwrap_or(std::f32::consts::PI);
            if irradiance.is_normal() && irradiance > 0.0 {
                return Ok(irradiance);
            }
            let place = format!("{}, {}", self.exr.display(), layer.name);
            Err(Error::invalid(place, format!("an irradiance of {irradiance}"), "a positive number"))
        };
        lamps.iter().map(layer).map(of).collect()
    }

    /// Reads, checks and writes. `progress(steps done, all)` may stop it with an error; a step is a picture read or a row of
    /// blocks written. Memory: about 3 GB, beyond which pictures are spilled beside `output`.
    ///
    /// # Errors
    /// Each names the file: no OpenEXR, layers without directions, a bad `.lp` file, NaN, a folder that is absent or full.
    /// Nothing is left behind.
    pub fn run(&self, output: &Path, progress: &mut dyn FnMut(u64, u64) -> Result<()>) -> Result<Imported> {
        check_folder(output)?;
        let CheckedExr { layers, lamps, directions, irradiances, ambient, alpha, .. } = self.check()?;
        let (width, height) = layers.size();
        let black = self.black.as_deref().map(|path| read(path, Encoding::Auto)).transpose()?;
        let black = black.map(|picture| self.balanced(picture.into_rgb()));
        let ambient = match (&black, ambient) {
            (Some(black), _) => Some(black.clone()),
            (None, Some(n)) => layers.read(&[n])?.pop().map(|picture| self.balanced(picture)),
            (None, None) => None,
        };
        let alpha = alpha.map(|n| coverage(&layers, n)).transpose()?;
        let mut photographs = Photographs::new(width, height, folder_of(output));
        let total = (lamps.len() + height.div_ceil(BLOCK_HEIGHT)) as u64;
        let group = (GROUP_BYTES / (width * height * 3 * size_of::<f32>())).max(1);
        for first in (0..lamps.len()).step_by(group) {
            let range = first..(first + group).min(lamps.len());
            let pictures = layers.read(&lamps[range.clone()])?;
            let transport = |(picture, e): (Image, &f32)| self.transport(picture, *e, black.as_ref());
            let pictures: Vec<Image> = pictures.into_par_iter().zip(&irradiances[range]).map(transport).collect();
            for picture in pictures {
                photographs.push(picture)?;
                progress(photographs.len() as u64, total)?;
            }
        }
        let contents = Contents {
            irradiance: irradiances,
            domain: Directions::new(directions)?.into(),
            width,
            height,
            colour_space: self.colour_space.or(layers.colour_space()).unwrap_or_default(),
            precision: self.precision,
            largest: photographs.largest(),
            ambient,
            alpha,
            reliability: None,
            provenance: self.provenance(&layers, &lamps),
        };
        write(output, &contents, &mut Reporting { photographs: &mut photographs, progress, total })?;
        Ok(Imported { lamps: photographs.len(), width, height })
    }

    fn balanced(&self, mut picture: Image) -> Image {
        if let Some(correction) = &self.correction {
            correction.apply(&mut picture);
        }
        picture
    }

    /// `(picture - black) / E`.
    fn transport(&self, picture: Image, irradiance: f32, black: Option<&Image>) -> Image {
        let mut picture = self.balanced(picture);
        if let Some(black) = black {
            picture.data_mut().iter_mut().zip(black.data()).for_each(|(t, s)| *t -= s);
        }
        let per_irradiance = 1.0 / irradiance;
        picture.data_mut().iter_mut().for_each(|t| *t *= per_irradiance);
        picture
    }

    fn provenance(&self, layers: &Layers, lamps: &[usize]) -> serde_json::Value {
        let name = |path: &Path| path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        serde_json::json!({
            "source": "import exr",
            "exr": name(&self.exr),
            "lp": self.lp.as_deref().map(name),
            "lamps": self.lamps.as_deref().map(name),
            "black": self.black.as_deref().map(name),
            "white_balance": self.correction.map(|correction| *correction.rows()),
            "photographs": lamps.iter().map(|&n| layers.layers()[n].name.clone()).collect::<Vec<_>>(),
        })
    }
}

/// The first few names.
fn names(layers: &Layers) -> String {
    let all = layers.layers();
    let more = if all.len() > LISTED { ", ..." } else { "" };
    let named: Vec<&str> = all.iter().take(LISTED).map(|layer| layer.name.as_str()).collect();
    format!("{}{more}", named.join(", "))
}

/// The mean over the channels, clamped to 0..1.
fn coverage(layers: &Layers, n: usize) -> Result<Vec<f32>> {
    let mut pictures = layers.read(&[n])?;
    let picture = pictures.pop().unwrap_or_else(|| Image::new(0, 0, 3));
    let mean = |pixel: &[f32]| (pixel.iter().sum::<f32>() / 3.0).clamp(0.0, 1.0);
    Ok(picture.data().chunks_exact(3).map(mean).collect())
}
