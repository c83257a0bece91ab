//! `relume export`: a field -> what other tools read.

mod exr;
mod lp;

use clap::Subcommand;
use relume_core::field::{Asset, Samples};
use relume_core::image::Image;

/// Kinds of export.
#[derive(Debug, Subcommand)]
pub enum Target {
    /// A folder with a photograph a lamp and their .lp file, for RTI and photometric-stereo tools.
    Lp(lp::Arguments),
    /// One OpenEXR file with a part a lamp, as light groups for compositing packages.
    Exr(exr::Arguments),
}

impl Target {
    /// Exports.
    pub fn run(self) -> anyhow::Result<String> {
        match self {
            Target::Lp(arguments) => arguments.run(),
            Target::Exr(arguments) => arguments.run(),
        }
    }
}

/// Pictures held in memory take about this.
const GROUP_BYTES: usize = 512 << 20;

/// Photographs of an asset, one after another, read some at a time.
struct Photographs<'a> {
    asset: &'a Asset,
    samples: Samples<'a>,
    irradiances: Vec<f32>,
    /// The first lamp of those that are held.
    first: usize,
    held: Vec<Image>,
}

impl<'a> Photographs<'a> {
    fn new(asset: &'a Asset) -> anyhow::Result<Self> {
        asset.directions()?;
        let irradiances = asset.manifest().irradiance().to_vec();
        Ok(Self { asset, samples: asset.samples()?, irradiances, first: 0, held: Vec::new() })
    }

    fn len(&self) -> usize {
        self.irradiances.len()
    }

    /// `T_j E_j`: what the lamp alone adds.
    fn get(&mut self, lamp: usize) -> relume_core::Result<Image> {
        if !(self.first..self.first + self.held.len()).contains(&lamp) {
            let bytes = self.asset.width() * self.asset.height() * 3 * size_of::<f32>();
            let group = (GROUP_BYTES / bytes).max(1);
            self.held = Vec::new();
            self.held = self.samples.pictures(lamp..(lamp + group).min(self.len()))?;
            self.first = lamp;
        }
        let mut picture = self.held[lamp - self.first].clone();
        let irradiance = self.irradiances[lamp];
        picture.data_mut().iter_mut().for_each(|v| *v *= irradiance);
        Ok(picture)
    }
}

/// `lamp0001`, with as many digits as the last one needs.
fn name(lamp: usize, count: usize) -> String {
    let digits = count.to_string().len().max(4);
    format!("lamp{:0digits$}", lamp + 1)
}

/// Layers that neither target carries.
fn left_behind(asset: &Asset) -> relume_core::Result<Option<String>> {
    let layers = [(asset.normals()?.is_some(), "normals"), (asset.albedo()?.is_some(), "albedo")];
    let names: Vec<&str> = layers.iter().filter(|(held, _)| *held).map(|(_, name)| *name).collect();
    Ok((!names.is_empty())
        .then(|| format!("{} stay behind; `relume relight --layer NAME` writes them", names.join(" and "))))
}
