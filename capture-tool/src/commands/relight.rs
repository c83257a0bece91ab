//! `relume relight`: `C = T L + g S`, to a picture.

use std::path::{Path, PathBuf};

use anyhow::Context;
use clap::{Args, ValueEnum};
use relume_core::field::{Access, Asset, BLOCK_HEIGHT, Layout};
use relume_core::illumination::EnvMap;
use relume_core::image::{self, EncodeOptions, Image, Window};
use relume_core::math::latlong;
use relume_core::reconstruct::Outside;
use relume_core::relight::{Light, Look, Relighter, Weights};
use relume_core::settings;

use super::layer::LayerChoice;
use super::{note, values};
use crate::progress::{self, Progress, Unit};

const EXAMPLES: &str = "\
Examples:
  relume relight vase.rfield --env park.hdr -o vase.exr
  relume relight vase.rfield --env park.exr --rotate -90 --exposure -1.5 --outside nearest -o vase.png
  relume relight vase.rfield --lamp 17 -o lamp17.exr
  relume relight vase.rfield --layer normals -o normals.exr";

/// About how much of the field is streamed between two looks at Ctrl-C.
const BAND_BYTES: usize = 256 << 20;

/// Raw flags. Those that shape a map mean nothing beside `--lamp` and are refused there.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    /// The captured object: a .rfield file.
    asset: PathBuf,
    /// The picture to write; its extension chooses the type: .exr, .hdr and .tif hold linear floats, .png 16-bit sRGB, .jpg
    /// 8-bit sRGB. It has alpha if the field has and the type can.
    #[arg(short, long, value_name = "OUT")]
    output: PathBuf,
    #[command(flatten)]
    light: LightArguments,
    #[arg(long, value_name = "METHOD", conflicts_with = "lamp", help = settings::RECONSTRUCTION.hint,
          value_parser = values::choice(&settings::RECONSTRUCTION),
          default_value = values::neutral_option(&settings::RECONSTRUCTION))]
    reconstruct: usize,
    #[arg(long, value_name = "DEG", conflicts_with = "lamp", help = settings::ROTATION.hint,
          allow_negative_numbers = true, value_parser = values::number(&settings::ROTATION),
          default_value_t = values::neutral(&settings::ROTATION))]
    rotate: f64,
    #[arg(long, value_name = "SIDE", conflicts_with = "lamp", help = settings::MAP_CENTRE.hint,
          value_parser = values::choice(&settings::MAP_CENTRE),
          default_value = values::neutral_option(&settings::MAP_CENTRE))]
    map_centre: usize,
    #[arg(long, value_name = "WHAT", conflicts_with = "lamp", help = settings::OUTSIDE.hint,
          value_parser = values::choice(&settings::OUTSIDE),
          default_value = values::neutral_option(&settings::OUTSIDE))]
    outside: usize,
    #[arg(long, value_name = "EV", help = settings::EXPOSURE.hint,
          allow_negative_numbers = true, value_parser = values::number(&settings::EXPOSURE),
          default_value_t = values::neutral(&settings::EXPOSURE))]
    exposure: f64,
    #[arg(long, value_name = "GAIN", help = settings::AMBIENT.hint,
          allow_negative_numbers = true, value_parser = values::number(&settings::AMBIENT),
          default_value_t = values::neutral(&settings::AMBIENT))]
    ambient: f64,
    /// How the file is opened: memory-mapped, or read piece by piece, for network disks.
    #[arg(long, value_enum, default_value_t = AccessChoice::Mapped)]
    access: AccessChoice,
}

#[derive(Debug, Args)]
#[group(required = true, multiple = false)]
struct LightArguments {
    /// The light: a lat-long map (EXR, HDR, PNG, TIFF, JPEG) of radiance.
    #[arg(long, value_name = "MAP")]
    env: Option<PathBuf>,
    /// Lights one captured lamp, counted from 1, as it was photographed.
    #[arg(long, value_name = "N")]
    lamp: Option<usize>,
    /// In place of a light: a layer of the asset as it is. Normals are in the stage frame (+x right, +y up, +z to the camera);
    /// .png and .jpg, which hold nothing below zero, get (n + 1) / 2.
    #[arg(long, value_enum, value_name = "LAYER",
          conflicts_with_all = ["reconstruct", "rotate", "map_centre", "outside", "exposure", "ambient"])]
    layer: Option<LayerChoice>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum AccessChoice {
    Mapped,
    Read,
}

/// What is lit with.
#[derive(Debug, Clone, PartialEq)]
enum LightPlan {
    Map(PathBuf),
    Lamp(usize),
    Layer(LayerChoice),
}

/// Checked flags.
#[derive(Debug, Clone, PartialEq)]
struct Plan {
    asset: PathBuf,
    access: Access,
    output: PathBuf,
    light: LightPlan,
    look: Look,
}

impl Arguments {
    /// Relights and writes.
    pub fn run(self) -> anyhow::Result<String> {
        self.plan()?.carry_out()
    }

    /// Refuses what can be known to fail before the work.
    fn plan(self) -> anyhow::Result<Plan> {
        image::check_output(&self.output)?;
        let light = match (self.light.env, self.light.lamp, self.light.layer) {
            (Some(map), None, None) => LightPlan::Map(map),
            (None, Some(number), None) => LightPlan::Lamp(number),
            (None, None, Some(layer)) => LightPlan::Layer(layer),
            _ => anyhow::bail!("give one light: --env MAP or --lamp N, or a --layer"),
        };
        let look = Look {
            method: settings::method(self.reconstruct),
            outside: settings::outside(self.outside),
            centre: settings::map_centre(self.map_centre),
            heading_deg: self.rotate,
            exposure_ev: self.exposure,
            ambient: self.ambient,
        };
        let access = match self.access {
            AccessChoice::Mapped => Access::Mapped,
            AccessChoice::Read => Access::Read,
        };
        Ok(Plan { asset: self.asset, access, output: self.output, light, look })
    }
}

impl Plan {
    fn carry_out(&self) -> anyhow::Result<String> {
        let asset = Asset::open(&self.asset, self.access)?;
        if let LightPlan::Layer(layer) = self.light {
            return layer.write(&asset, &self.output);
        }
        let relighter = Relighter::new(asset);
        if self.look.ambient != 0.0 && relighter.asset().ambient().is_none() {
            note(&format!("{} has no ambient picture: --ambient adds nothing", self.asset.display()));
        }
        let weights = self.weights(&relighter)?;
        progress::check()?;
        let mut picture = render(&relighter, &weights, &self.look)?;
        if relighter.asset().alpha().is_none() {
            picture = picture.into_rgb();
        }
        progress::check()?;
        image::write(&self.output, &picture, EncodeOptions::default())?;
        Ok(format!("{}: {} x {} pixels\n", self.output.display(), picture.width(), picture.height()))
    }

    fn weights(&self, relighter: &Relighter) -> anyhow::Result<Weights> {
        match &self.light {
            LightPlan::Lamp(number) => Ok(relighter.weights(Light::Lamp(*number), &self.look)?),
            LightPlan::Layer(_) => anyhow::bail!("a layer has no light"),
            LightPlan::Map(path) => {
                let map = EnvMap::load(path).context("cannot use the environment map")?;
                let weights = relighter.weights(Light::Map(&map), &self.look)?;
                if self.look.outside == Outside::Drop {
                    tell_what_is_dropped(path, &map, &weights, &self.look);
                }
                Ok(weights)
            }
        }
    }
}

/// Says so when most of a map's light never reaches a lamp: a dark picture has its reason.
fn tell_what_is_dropped(path: &Path, map: &EnvMap, weights: &Weights, look: &Look) {
    let share = dropped_share(map, weights, look);
    if share > 0.5 {
        note(&format!(
            "{:.0} % of the light of {} comes from where no lamp was, and is dropped (--outside nearest keeps it)",
            100.0 * share,
            path.display()
        ));
    }
}

/// `1 - sum_j w_j / integral of L dw` over all channels, exposure taken out: kernels sum to one over the lamps, so what
/// the weights lack was dropped. 0 for a black map.
fn dropped_share(map: &EnvMap, weights: &Weights, look: &Look) -> f64 {
    let (w, h) = map.image().size();
    let row_sum = |y: usize| map.image().row(y).iter().map(|v| f64::from(*v)).sum::<f64>();
    let all: f64 = (0..h).map(|y| row_sum(y) * latlong::texel_solid_angle(y, w, h)).sum();
    let kept: f64 = weights.rgb.iter().flatten().map(|v| f64::from(*v)).sum::<f64>() / look.exposure_ev.exp2();
    if all > 0.0 { (1.0 - kept / all).clamp(0.0, 1.0) } else { 0.0 }
}

/// The whole picture, RGBA, some rows of blocks at a time.
fn render(relighter: &Relighter, weights: &Weights, look: &Look) -> relume_core::Result<Image> {
    let asset = relighter.asset();
    let (width, height) = (asset.width(), asset.height());
    let rows = band_rows(asset.dense().layout(), asset.dense().precision().bytes());
    let mut progress = Progress::new("relighting", Unit::Steps);
    let mut data = Vec::with_capacity(width * height * 4);
    for y0 in (0..height).step_by(rows) {
        let y1 = (y0 + rows).min(height);
        let band = relighter.render(weights, look, Window { x0: 0, y0, x1: width, y1 })?;
        data.extend_from_slice(band.data());
        progress.step(y1 as u64, height as u64)?;
    }
    Image::from_data(width, height, 4, data)
}

/// Rows of pixels whose blocks come to about [`BAND_BYTES`]: whole rows of blocks, and enough of them for all threads.
fn band_rows(layout: Layout, bytes_a_number: usize) -> usize {
    /// Ample for any machine: threads take whole rows of blocks.
    const FEWEST_BLOCK_ROWS: usize = 32;
    let block_row = layout.columns() * 3 * layout.block_len() * bytes_a_number;
    (BAND_BYTES / block_row.max(1)).max(FEWEST_BLOCK_ROWS) * BLOCK_HEIGHT
}

#[cfg(test)]
mod tests {
    use clap::Parser;
    use relume_core::illumination::MapCentre;
    use relume_core::reconstruct::Method;

    use super::*;

    #[derive(Debug, Parser)]
    struct Line {
        #[command(flatten)]
        arguments: Arguments,
    }

    fn parse(line: &str) -> Result<Arguments, clap::Error> {
        Line::try_parse_from(line.split_whitespace()).map(|line| line.arguments)
    }

    #[test]
    fn defaults_are_the_neutral_look() {
        let plan = parse("relight a.rfield --env m.hdr -o out.exr").unwrap().plan().unwrap();
        assert_eq!(plan.look, Look::default());
        assert_eq!(plan.access, Access::Mapped);
        assert_eq!(plan.light, LightPlan::Map("m.hdr".into()));
    }

    #[test]
    fn flags_reach_the_plan() {
        let line = "relight a.rfield --env m.hdr -o out.png --reconstruct zero-order --rotate -90 --map-centre behind \
                    --outside nearest --exposure=-1.5 --ambient 0.25 --access read";
        let plan = parse(line).unwrap().plan().unwrap();
        let look = Look {
            method: Method::ZeroOrder,
            outside: Outside::Nearest,
            centre: MapCentre::Behind,
            heading_deg: -90.0,
            exposure_ev: -1.5,
            ambient: 0.25,
        };
        assert_eq!((plan.look, plan.access), (look, Access::Read));
    }

    #[test]
    fn wrong_usage_is_refused_by_the_parser() {
        for line in [
            "relight a.rfield -o out.exr",
            "relight a.rfield --env m.hdr --lamp 1 -o out.exr",
            "relight a.rfield --env m.hdr",
            "relight --env m.hdr -o out.exr",
            "relight a.rfield --lamp -1 -o out.exr",
            "relight a.rfield --lamp 1.5 -o out.exr",
            "relight a.rfield --lamp 1 --rotate 90 -o out.exr",
            "relight a.rfield --env m.hdr -o out.exr --rotate nan",
            "relight a.rfield --env m.hdr -o out.exr --exposure inf",
            "relight a.rfield --env m.hdr -o out.exr --exposure 41",
            "relight a.rfield --env m.hdr -o out.exr --ambient -0.5",
            "relight a.rfield --env m.hdr -o out.exr --reconstruct cubic",
            "relight a.rfield --env m.hdr -o out.exr --reconstruct 1",
        ] {
            assert!(parse(line).is_err(), "{line}");
        }
        assert!(parse("relight a.rfield --lamp 1 --exposure 1 --ambient 1 -o out.exr").is_ok());
    }

    #[test]
    fn outputs_are_checked_before_the_work() {
        for (line, words) in [
            ("relight a.rfield --lamp 1 -o out.bmp", ".bmp"),
            ("relight a.rfield --lamp 1 -o absent/out.exr", "does not exist"),
        ] {
            let message = parse(line).unwrap().plan().unwrap_err().to_string();
            assert!(message.contains(words), "{message}");
        }
    }

    #[test]
    fn the_dropped_share_is_what_the_weights_lack() {
        let map = EnvMap::from_fn(64, 32, |d| if d.z > 0.0 { [1.0; 3] } else { [3.0; 3] });
        // The front hemisphere, 2 pi sr, holds a quarter of the light; one stop up.
        let half_pi = std::f32::consts::TAU * 2.0 / 4.0;
        let weights = Weights { rgb: vec![[half_pi; 3]; 4] };
        let look = Look { exposure_ev: 1.0, ..Look::default() };
        assert!((dropped_share(&map, &weights, &look) - 0.75).abs() < 1e-6);
        let black = EnvMap::from_fn(4, 2, |_| [0.0; 3]);
        assert_eq!(dropped_share(&black, &Weights::dark(4), &look), 0.0);
    }

    #[test]
    fn bands_are_whole_rows_of_blocks() {
        let small = Layout { width: 402, height: 395, elements: 72 };
        assert!(band_rows(small, 2) >= 395);
        let large = Layout { width: 8192, height: 8192, elements: 1280 };
        assert_eq!(band_rows(large, 4), 32 * BLOCK_HEIGHT);
    }
}
