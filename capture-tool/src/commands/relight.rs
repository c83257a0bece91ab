//! `relume relight`: `C = T L + g S`, to a picture.

use std::path::{Path, PathBuf};

use anyhow::Context;
use clap::{Args, ValueEnum};
use relume_core::field::{Access, Asset};
use relume_core::illumination::{Beam, EnvMap, LightField};
use relume_core::image::{self, ColourSpace, Conversion, EncodeOptions, Image, Window};
use relume_core::matte::{Backdrop, Beyond, Place};
use relume_core::reconstruct::Outside;
use relume_core::relight::{Light, Look, Relighter, ScreenRelighter, Weights};
use relume_core::settings;

use super::layer::LayerChoice;
use super::light_flags::{GainFlags, LAT_LONG_FLAGS, LIGHT_FLAGS, MAP_FLAGS, MapFlags, TEXEL_FLAGS};
use super::{note, values};
use crate::progress::{self, Progress, Unit};

const EXAMPLES: &str = "\
Examples:
  relume relight vase.rfield --env park.hdr -o vase.exr
  relume relight vase.rfield --env park.exr --rotate -90 --exposure -1.5 --outside nearest -o vase.png
  relume relight vase.rfield --lighting three-point --rotate 20 -o vase.exr
  relume relight vase.rfield --env park.exr --pitch 20 --blur 10 --clamp 50 --tint 1,0.9,0.8 -o soft.exr
  relume relight vase.rfield --env aces.exr --map-space aces2065_1 --output-space acescg -o vase.exr
  relume relight vase.rfield --lamp 17 -o lamp17.exr
  relume relight glass.rfield --plane street.exr -o glass.exr
  relume relight chess.rfield --light4d venetian-blinds -o blinds.exr
  relume relight chess.rfield --light4d beams.toml --flat -o beams-2d.exr
  relume relight vase.rfield --layer normals -o normals.exr";

/// About how much of the field is streamed between two looks at Ctrl-C.
const BAND_BYTES: u64 = 256 << 20;
/// Bands of whole tiles, so that no tile is looked at twice.
const TILE_HEIGHT: u64 = 64;

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
    /// Take the light of --light4d everywhere as it is in the middle of the object, as an environment map of it would.
    #[arg(long, conflicts_with_all = ["env", "lighting", "lamp", "plane", "layer"])]
    flat: bool,
    #[arg(long, value_name = "FORM", help = settings::REPRESENTATION.hint,
          value_parser = values::choice(&settings::REPRESENTATION),
          default_value = values::neutral_option(&settings::REPRESENTATION))]
    representation: usize,
    #[arg(long, value_name = "METHOD", conflicts_with = "lamp", help = settings::RECONSTRUCTION.hint,
          value_parser = values::choice(&settings::RECONSTRUCTION),
          default_value = values::neutral_option(&settings::RECONSTRUCTION))]
    reconstruct: usize,
    #[command(flatten)]
    map: MapFlags,
    #[arg(long, value_name = "WHAT", conflicts_with = "lamp", help = settings::OUTSIDE.hint,
          value_parser = values::choice(&settings::OUTSIDE),
          default_value = values::neutral_option(&settings::OUTSIDE))]
    outside: usize,
    #[command(flatten)]
    gain: GainFlags,
    #[arg(long, value_name = "GAIN", help = settings::AMBIENT.hint,
          allow_negative_numbers = true, value_parser = values::number(&settings::AMBIENT),
          default_value_t = values::neutral(&settings::AMBIENT))]
    ambient: f64,
    /// Captured lamps to do without, counted from 1: those that failed. The reconstruction works around them.
    #[arg(long, value_name = "N,N", value_delimiter = ',', conflicts_with = "lamp")]
    exclude: Vec<usize>,
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
    /// The light: lamps, by a name of `relume lightings` or in a lighting file (.toml).
    #[arg(long, value_name = "NAME|FILE", conflicts_with_all = TEXEL_FLAGS)]
    lighting: Option<String>,
    /// Lights one captured lamp, counted from 1, as it was photographed.
    #[arg(long, value_name = "N", conflicts_with_all = MAP_FLAGS)]
    lamp: Option<usize>,
    /// The light of a screen's field: a picture that fills the screen, row 0 at its top, averaged over each texel; 1 is the
    /// white screen. (`relume matte` puts the object before a plate, and the plate where the screen was.)
    #[arg(long, value_name = "IMG", conflicts_with_all = LAT_LONG_FLAGS)]
    plane: Option<PathBuf>,
    /// The light: spots, slides, blinds, near lamps and grids of probes, which differ from point to point, in a light file (.toml) or by a
    /// name of `relume lightings`. For fields of a projector; --flat takes it to any other.
    #[arg(long, value_name = "NAME|FILE", conflicts_with_all = TEXEL_FLAGS)]
    light4d: Option<String>,
    /// In place of a light: a layer of the asset as it is. Normals are in the stage frame (+x right, +y up, +z to the camera);
    /// .png and .jpg, which hold nothing below zero, get (n + 1) / 2.
    #[arg(long, value_enum, value_name = "LAYER", conflicts_with_all = LIGHT_FLAGS)]
    layer: Option<LayerChoice>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum AccessChoice {
    Mapped,
    Read,
}

impl From<AccessChoice> for Access {
    fn from(choice: AccessChoice) -> Self {
        match choice {
            AccessChoice::Mapped => Access::Mapped,
            AccessChoice::Read => Access::Read,
        }
    }
}

impl LightArguments {
    /// The one that was given; the parser lets one through.
    fn plan(self, flat: bool) -> anyhow::Result<LightPlan> {
        let Self { env, lighting, lamp, plane, light4d, layer } = self;
        let from_lighting = |name: String| -> anyhow::Result<LightPlan> {
            let file = settings::lighting::find(&name, Path::new(""))?;
            Ok(LightPlan::Lighting(name, file.lighting.beams()))
        };
        let from_field = |name: String| -> anyhow::Result<LightPlan> {
            let file = settings::light4d::find(&name, Path::new(""))?;
            Ok(LightPlan::Field(name, file.light, flat))
        };
        let given = [
            env.map(|map| Ok(LightPlan::Map(map))),
            lighting.map(from_lighting),
            lamp.map(|number| Ok(LightPlan::Lamp(number))),
            plane.map(|picture| Ok(LightPlan::Plane(picture))),
            light4d.map(from_field),
            layer.map(|layer| Ok(LightPlan::Layer(layer))),
        ];
        let given = given.into_iter().flatten().next();
        given.unwrap_or_else(|| anyhow::bail!("give a light, such as --env MAP or --lighting NAME, or a --layer"))
    }
}

/// What is lit with.
#[derive(Debug, Clone, PartialEq)]
enum LightPlan {
    Map(PathBuf),
    /// What messages call it, and its beams.
    Lighting(String, Vec<Beam>),
    Lamp(usize),
    /// What messages call it, and whether it is taken as it is in the middle.
    Field(String, LightField, bool),
    /// A picture on the screen.
    Plane(PathBuf),
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
    exclude: Vec<usize>,
}

impl Arguments {
    /// Relights and writes.
    pub fn run(self) -> anyhow::Result<String> {
        self.plan()?.carry_out()
    }

    /// Refuses what can be known to fail before the work.
    fn plan(self) -> anyhow::Result<Plan> {
        image::check_output(&self.output)?;
        let light = self.light.plan(self.flat)?;
        let mut look = Look {
            representation: settings::representation(self.representation),
            method: settings::method(self.reconstruct),
            outside: settings::outside(self.outside),
            ambient: self.ambient,
            ..Look::default()
        };
        self.map.set(&mut look);
        self.gain.set(&mut look);
        Ok(Plan {
            asset: self.asset,
            access: self.access.into(),
            output: self.output,
            light,
            look,
            exclude: self.exclude,
        })
    }
}

impl Plan {
    fn carry_out(&self) -> anyhow::Result<String> {
        let asset = Asset::open(&self.asset, self.access)?;
        if let LightPlan::Layer(layer) = self.light {
            return layer.write(&asset, &self.output);
        }
        if self.look.ambient != 0.0 && asset.ambient().is_none() {
            note(&format!("{} has no ambient picture: --ambient adds nothing", self.asset.display()));
        }
        if let LightPlan::Plane(picture) = &self.light {
            return self.before_screen(asset, picture);
        }
        let relighter = match &self.exclude[..] {
            [] => Relighter::new(asset)?,
            excluded => Relighter::without(asset, excluded)?,
        };
        let weights = self.weights(&relighter)?;
        progress::check()?;
        let picture = render(relighter.asset(), |window| relighter.render(&weights, &self.look, window))?;
        self.written(picture, relighter.asset())
    }

    /// A field of a screen that shows a picture.
    fn before_screen(&self, asset: Asset, picture: &Path) -> anyhow::Result<String> {
        let relighter = ScreenRelighter::new(asset)?;
        let shown = image::read(picture, image::Encoding::Auto)?.into_rgb();
        let size = shown.size();
        let light =
            Backdrop::new((relighter.plane(), None), size, &Place::default(), size)?.light(&shown, Beyond::Stretch);
        let weights = relighter.weights(&light, &self.look)?;
        progress::check()?;
        let picture = render(relighter.asset(), |window| relighter.render(&weights, &self.look, window))?;
        self.written(picture, relighter.asset())
    }

    fn written(&self, mut picture: Image, asset: &Asset) -> anyhow::Result<String> {
        if asset.alpha().is_none() {
            picture = picture.into_rgb();
        }
        progress::check()?;
        let options = EncodeOptions { colour_space: self.look.output_space, ..EncodeOptions::default() };
        image::write(&self.output, &picture, options)?;
        Ok(format!("{}: {} x {} pixels\n", self.output.display(), picture.width(), picture.height()))
    }

    fn weights(&self, relighter: &Relighter) -> anyhow::Result<Weights> {
        match &self.light {
            LightPlan::Lamp(number) => Ok(relighter.weights(Light::Lamp(*number), &self.look)?),
            LightPlan::Lighting(name, beams) => {
                let weights = relighter.weights(Light::Beams(beams), &self.look)?;
                if self.look.outside == Outside::Drop && relighter.gantry().is_none() {
                    let all = beams.iter().fold([0.0; 3], |sum, b| [0, 1, 2].map(|c| sum[c] + b.irradiance[c]));
                    let light = self.expected(all, ColourSpace::default(), relighter);
                    tell_what_is_dropped(name, light, &weights);
                }
                Ok(weights)
            }
            LightPlan::Layer(_) | LightPlan::Plane(_) => anyhow::bail!("no light of lamps"),
            LightPlan::Field(_, field, true) => Ok(relighter.weights(Light::Flat(field), &self.look)?),
            LightPlan::Field(name, field, false) => {
                let weights = relighter.weights(Light::Field(field), &self.look)?;
                if weights.rgb.iter().all(|rgb| *rgb == [0.0; 3]) {
                    note(&format!("no light of {name} falls on what the projector lit: the picture is black"));
                }
                Ok(weights)
            }
            LightPlan::Map(path) => {
                let map = EnvMap::load(path).context("cannot use the environment map")?;
                let weights = relighter.weights(Light::Map(&map), &self.look)?;
                if self.look.outside == Outside::Drop && relighter.gantry().is_none() {
                    let light = self.expected(map.clamped(self.look.clamp).integral(), self.look.map_space, relighter);
                    tell_what_is_dropped(&path.display().to_string(), light, &weights);
                }
                Ok(weights)
            }
        }
    }
}

impl Plan {
    /// What the weights of a light would sum to if nothing were dropped: turning and blurring keep integrals.
    fn expected(&self, light: [f64; 3], space: ColourSpace, relighter: &Relighter) -> [f64; 3] {
        let mut sum = Weights::of_lamps(vec![light.map(|v| v as f32)]);
        sum.convert(&Conversion::between(space, relighter.asset().colour_space()));
        sum.scale(self.look.gain());
        sum.rgb[0].map(f64::from)
    }
}

/// Says so when most of a light never reaches a lamp: a dark picture has its reason.
fn tell_what_is_dropped(name: &str, light: [f64; 3], weights: &Weights) {
    let share = dropped_share(light, weights);
    if share > 0.5 {
        note(&format!(
            "{:.0} % of the light of {name} comes from where no lamp was, and is dropped (--outside nearest keeps it)",
            100.0 * share
        ));
    }
}

/// `1 - sum_j w_j / integral of L dw` over all channels: kernels sum to one over the lamps, so what the weights lack of the
/// light was dropped. 0 for a black map.
fn dropped_share(light: [f64; 3], weights: &Weights) -> f64 {
    let all: f64 = light.iter().sum();
    let kept: f64 = weights.rgb.iter().flatten().map(|v| f64::from(*v)).sum();
    if all > 0.0 { (1.0 - kept / all).clamp(0.0, 1.0) } else { 0.0 }
}

/// The whole picture, RGBA, some rows of blocks at a time.
fn render(asset: &Asset, window: impl Fn(Window) -> relume_core::Result<Image>) -> relume_core::Result<Image> {
    let (width, height) = (asset.width(), asset.height());
    let rows = band_rows(asset);
    let mut progress = Progress::new("relighting", Unit::Steps);
    let mut data = Vec::with_capacity(width * height * 4);
    for y0 in (0..height).step_by(rows) {
        let y1 = (y0 + rows).min(height);
        let band = window(Window { x0: 0, y0, x1: width, y1 })?;
        data.extend_from_slice(band.data());
        progress.step(y1 as u64, height as u64)?;
    }
    Image::from_data(width, height, 4, data)
}

/// Rows of pixels that come to about [`BAND_BYTES`] of a file.
pub fn band_rows(asset: &Asset) -> usize {
    rows_of(asset.file_len() / asset.height() as u64)
}

/// For so many bytes a row of pixels: whole rows of blocks and of tiles, and enough of them for all threads.
fn rows_of(bytes: u64) -> usize {
    /// Ample for any machine: threads take whole rows of blocks.
    const FEWEST: u64 = 256;
    (BAND_BYTES / bytes.max(1)).max(FEWEST).next_multiple_of(TILE_HEIGHT) as usize
}

#[cfg(test)]
mod tests {
    use relume_core::field::Kind;
    use relume_core::illumination::MapCentre;
    use relume_core::image::ColourSpace;
    use relume_core::reconstruct::Method;

    use super::*;
    use crate::commands::testing;

    fn parse(line: &str) -> Result<Arguments, clap::Error> {
        testing::parse(line)
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
                    --outside nearest --exposure=-1.5 --ambient 0.25 --access read --pitch -30 --roll 12.5 \
                    --tint 1,0.5,0.25 --blur 5 --clamp 10 --map-space acescg --output-space lin_rec2020 --representation factored";
        let plan = parse(line).unwrap().plan().unwrap();
        let look = Look {
            representation: Some(Kind::Factored),
            method: Method::ZeroOrder,
            outside: Outside::Nearest,
            centre: MapCentre::Behind,
            heading_deg: -90.0,
            exposure_ev: -1.5,
            ambient: 0.25,
            pitch_deg: -30.0,
            roll_deg: 12.5,
            tint: [1.0, 0.5, 0.25],
            blur_deg: 5.0,
            clamp: 10.0,
            map_space: ColourSpace::AcesCg,
            output_space: ColourSpace::LinRec2020,
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
            "relight a.rfield --env m.hdr --flat -o out.exr",
            "relight a.rfield --light4d key.toml --blur 3 -o out.exr",
            "relight a.rfield --lamp -1 -o out.exr",
            "relight a.rfield --lamp 1.5 -o out.exr",
            "relight a.rfield --lamp 1 --rotate 90 -o out.exr",
            "relight a.rfield --env m.hdr -o out.exr --rotate nan",
            "relight a.rfield --env m.hdr -o out.exr --exposure inf",
            "relight a.rfield --env m.hdr -o out.exr --exposure 41",
            "relight a.rfield --env m.hdr -o out.exr --ambient -0.5",
            "relight a.rfield --env m.hdr -o out.exr --reconstruct cubic",
            "relight a.rfield --env m.hdr -o out.exr --reconstruct 1",
            "relight a.rfield --env m.hdr -o out.exr --pitch up",
            "relight a.rfield --env m.hdr -o out.exr --roll nan",
            "relight a.rfield --env m.hdr -o out.exr --blur -1",
            "relight a.rfield --env m.hdr -o out.exr --blur 181",
            "relight a.rfield --env m.hdr -o out.exr --clamp -1",
            "relight a.rfield --env m.hdr -o out.exr --tint 1,2",
            "relight a.rfield --env m.hdr -o out.exr --tint 1,2,-3",
            "relight a.rfield --env m.hdr -o out.exr --map-space srgb",
            "relight a.rfield --env m.hdr -o out.exr --output-space aces",
            "relight a.rfield --lamp 1 --blur 3 -o out.exr",
            "relight a.rfield --lamp 1 --pitch 3 -o out.exr",
            "relight a.rfield --lamp 1 --map-space acescg -o out.exr",
            "relight a.rfield --plane a.exr --rotate 3 -o out.exr",
            "relight a.rfield --plane a.exr --reconstruct linear -o out.exr",
            "relight a.rfield --plane a.exr --env b.exr -o out.exr",
        ] {
            assert!(parse(line).is_err(), "{line}");
        }
        assert!(
            parse("relight a.rfield --lamp 1 --exposure 1 --ambient 1 --tint 1,0,0 --output-space acescg -o out.exr")
                .is_ok()
        );
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
        let weights = Weights::of_lamps(vec![[half_pi; 3]; 4]);
        let light = map.integral().map(|v| 2.0 * v);
        assert!((dropped_share(light, &weights) - 0.75).abs() < 1e-6);
        assert_eq!(dropped_share([0.0; 3], &Weights::dark(4)), 0.0);
    }

    #[test]
    fn bands_are_whole_rows_of_blocks() {
        assert!(rows_of(402 * 72 * 6) >= 395);
        assert_eq!(rows_of(8192 * 1280 * 12), 256);
    }
}
