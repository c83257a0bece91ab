//! `relume map`: the operations of relighting on a lat-long map, to a map.

use std::path::PathBuf;

use anyhow::Context;
use clap::Args;
use relume_core::illumination::EnvMap;
use relume_core::image::{self, Conversion, EncodeOptions};
use relume_core::relight::Look;

use super::light_flags::{GainFlags, MapFlags};
use crate::progress;

const EXAMPLES: &str = "\
Examples:
  relume map park.hdr -o park-blurred.exr --blur 10
  relume map park.hdr -o park-aces.exr --output-space aces2065_1
  relume map nuke.exr -o turned.exr --map-centre behind --rotate 90 --pitch -15 --roll 5
  relume map park.hdr -o small.hdr --size 256 --clamp 100 --exposure=-1";

/// Raw flags.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    /// The lat-long map (EXR, HDR, PNG, TIFF, JPEG) of radiance.
    map: PathBuf,
    /// The map to write; its extension chooses the type: .exr, .hdr and .tif hold linear floats, .png 16-bit sRGB, .jpg 8-bit
    /// sRGB. Its middle column is the side of the camera.
    #[arg(short, long, value_name = "OUT")]
    output: PathBuf,
    #[command(flatten)]
    operations: MapFlags,
    #[command(flatten)]
    gain: GainFlags,
    /// Columns of the output; it gets half as many rows. Energy is kept; a finer grid shows the old texels [default: as the
    /// input].
    #[arg(long, value_name = "COLUMNS", value_parser = clap::value_parser!(u32).range(2..=LARGEST_SIZE))]
    size: Option<u32>,
}

/// Wider maps are of no use as light, and take gigabytes.
const LARGEST_SIZE: i64 = 32768;

/// Checked flags.
#[derive(Debug, Clone, PartialEq)]
struct Plan {
    map: PathBuf,
    output: PathBuf,
    look: Look,
    size: Option<usize>,
}

impl Arguments {
    /// Changes and writes.
    pub fn run(self) -> anyhow::Result<String> {
        self.plan()?.carry_out()
    }

    /// Refuses what can be known to fail before the work.
    fn plan(self) -> anyhow::Result<Plan> {
        image::check_output(&self.output)?;
        let mut look = Look::default();
        self.operations.set(&mut look);
        self.gain.set(&mut look);
        Ok(Plan { map: self.map, output: self.output, look, size: self.size.map(|columns| columns as usize) })
    }
}

impl Plan {
    /// In the order of relighting: clamp, blur, turn, colours, tint and exposure; the size last.
    fn carry_out(&self) -> anyhow::Result<String> {
        let look = &self.look;
        let map = EnvMap::load(&self.map).context("cannot use the environment map")?;
        let map = map.clamped(look.clamp).into_owned();
        progress::check()?;
        let map = map.blurred(look.blur_deg).into_owned();
        progress::check()?;
        let map = map.turned(look.centre, &look.orientation());
        let map = map.converted(&Conversion::between(look.map_space, look.output_space)).scaled(look.gain());
        let map = match self.size {
            Some(columns) => map.resized(columns, columns / 2),
            None => map,
        };
        progress::check()?;
        let options = EncodeOptions { colour_space: look.output_space, ..EncodeOptions::default() };
        image::write(&self.output, map.image(), options)?;
        let (width, height) = map.image().size();
        Ok(format!("{}: {width} x {height} pixels, {}\n", self.output.display(), look.output_space))
    }
}

#[cfg(test)]
mod tests {
    use relume_core::illumination::MapCentre;
    use relume_core::image::ColourSpace;

    use super::*;
    use crate::commands::testing;

    fn parse(line: &str) -> Result<Arguments, clap::Error> {
        testing::parse(line)
    }

    #[test]
    fn flags_reach_the_plan() {
        let plan = parse("map a.hdr -o b.exr").unwrap().plan().unwrap();
        assert_eq!((plan.look, plan.size), (Look::default(), None));
        let line = "map a.hdr -o b.exr --rotate 10 --pitch 20 --roll -30 --map-centre behind --blur 3 --clamp 4 \
                    --map-space acescg --output-space lin_p3d65 --tint 1,2,3 --exposure 1 --size 64";
        let plan = parse(line).unwrap().plan().unwrap();
        let look = Look {
            heading_deg: 10.0,
            pitch_deg: 20.0,
            roll_deg: -30.0,
            centre: MapCentre::Behind,
            blur_deg: 3.0,
            clamp: 4.0,
            map_space: ColourSpace::AcesCg,
            output_space: ColourSpace::LinP3D65,
            tint: [1.0, 2.0, 3.0],
            exposure_ev: 1.0,
            ..Look::default()
        };
        assert_eq!((plan.look, plan.size), (look, Some(64)));
    }

    #[test]
    fn wrong_usage_is_refused() {
        for bad in ["--size 0", "--size 1", "--size 40000", "--size x", "--blur -1", "--tint 1,2", "--ambient 1"] {
            assert!(parse(&format!("map a.hdr -o b.exr {bad}")).is_err(), "{bad}");
        }
        assert!(parse("map a.hdr").is_err() && parse("map -o b.exr").is_err());
    }
}
