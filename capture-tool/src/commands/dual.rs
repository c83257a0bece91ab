//! `relume dual`: `C'' = T^T L''`, the scene from the side of the light (3.3.3).

use std::path::{Path, PathBuf};

use anyhow::bail;
use clap::Args;
use relume_core::Error;
use relume_core::field::{Access, Asset, Kind};
use relume_core::image::{self, EncodeOptions, Encoding, Image};
use relume_core::relight::Dual;
use relume_core::settings;

use super::relight::AccessChoice;
use super::{note, values};
use crate::frames::Pattern;
use crate::progress::{self, Progress, Unit};
use crate::sheet;

const EXAMPLES: &str = "\
Examples:
  relume dual monkeys.rfield --lit white --position 3 -o seen-from-3.exr
  relume dual monkeys.rfield --lit street.exr --position 3 --radiance -o street-on-monkeys.exr
  relume dual monkeys.rfield --lit white --position 3 --exposure 4 --scale 16 -o look.png
  relume dual monkeys.rfield --lit white --position all -o seen.####.exr
  relume dual glass.rfield --lit white -o light-on-screen.exr";

const LONG: &str = "\
The scene from the side of the light: T^T L, dual light transport.

Light can be turned round: what the camera saw of a projector's square, a camera at the projector would see of the pixel's light. So of \
a projector's field (a gantry) this is the scene as the projector at one of its positions would see it, a pixel a square, while each pixel of \
the camera throws what --lit gives it. Of a screen's field, which has no point to look from, it is the light that arrives at each texel.

The raw answer is sum_i T_ij c_i, so that under `white` it is the sum of the rows of T. c_i is the flux that pixel i throws; --radiance divides \
each square by its solid angle relative to those in the middle (squares are equal on a plane, so corners have less), which makes \
it what a camera at the projector would take: T_ij Omega_i = D_ji Omega_j.

Light that was seen with all lights off must not be turned round: the asset needs a black photograph, or --dark-room. Lamps are at \
infinity and each alone: their fields have no such picture.";

/// Raw flags.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES, long_about = LONG)]
pub struct Arguments {
    /// The captured object: a .rfield file of a projector or of a screen.
    asset: PathBuf,
    /// What the camera throws: `white`, or a picture of the asset's size (EXR, HDR, PNG, TIFF, JPEG), linear light in the asset's colours,
    /// what each pixel's ray carries. (A file called white is ./white.)
    #[arg(long, value_name = "white|IMAGE")]
    lit: String,
    /// The projector's position, counted from 1, or `all`; needed where there are several.
    #[arg(long, value_name = "Q", value_parser = position)]
    position: Option<Position>,
    /// The picture to write; its extension chooses the type: .exr, .hdr and .tif hold linear floats, .png 16-bit sRGB, .jpg 8-bit sRGB. For
    /// all positions a name with a place for the number, as in seen.####.exr.
    #[arg(short, long, value_name = "OUT")]
    output: PathBuf,
    /// Divide each square by its solid angle relative to those in the middle: what a camera at the projector would take.
    #[arg(long)]
    radiance: bool,
    /// Nothing was to be seen with all lights off: for an asset without a black photograph.
    #[arg(long)]
    dark_room: bool,
    /// Exposure of the picture, in stops.
    #[arg(long, value_name = "EV", allow_negative_numbers = true, value_parser = values::number(&settings::EXPOSURE),
          default_value_t = values::neutral(&settings::EXPOSURE))]
    exposure: f64,
    /// Show each square or texel as N x N pixels.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u16).range(1..=256))]
    scale: u16,
    #[arg(long, value_name = "FORM", help = settings::matte::REPRESENTATION.hint,
          value_parser = values::choice(&settings::matte::REPRESENTATION),
          default_value = values::neutral_option(&settings::matte::REPRESENTATION))]
    representation: usize,
    /// How the file is opened: memory-mapped, or read piece by piece, for network disks.
    #[arg(long, value_enum, default_value_t = AccessChoice::Mapped)]
    access: AccessChoice,
}

/// Which positions.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Position {
    /// From 1.
    One(usize),
    All,
}

fn position(text: &str) -> Result<Position, String> {
    match text.parse() {
        _ if text == "all" => Ok(Position::All),
        Ok(number) if number > 0 => Ok(Position::One(number)),
        _ => Err("no position; write a number from 1 on, or all".to_owned()),
    }
}

/// Where pictures go.
#[derive(Debug, Clone, PartialEq)]
enum Output {
    One(PathBuf),
    /// One a position.
    Numbered(Pattern),
}

/// Checked flags.
#[derive(Debug, Clone, PartialEq)]
struct Plan {
    asset: PathBuf,
    access: Access,
    /// None is white.
    lit: Option<PathBuf>,
    position: Option<Position>,
    output: Output,
    radiance: bool,
    dark_room: bool,
    gain: f32,
    scale: usize,
    kind: Option<Kind>,
}

impl Arguments {
    /// Turns light round and writes.
    pub fn run(self) -> anyhow::Result<String> {
        self.plan()?.carry_out()
    }

    /// Refuses what can be known to fail before the work.
    fn plan(self) -> anyhow::Result<Plan> {
        let output = match self.position {
            Some(Position::All) => {
                let name = self.output.display().to_string();
                let pattern: Pattern = name.parse().map_err(|error| anyhow::anyhow!("--position all: {error}"))?;
                image::check_output(&pattern.path(1))?;
                Output::Numbered(pattern)
            }
            _ => {
                image::check_output(&self.output)?;
                Output::One(self.output)
            }
        };
        Ok(Plan {
            asset: self.asset,
            access: self.access.into(),
            lit: (self.lit != "white").then(|| self.lit.into()),
            position: self.position,
            output,
            radiance: self.radiance,
            dark_room: self.dark_room,
            gain: self.exposure.exp2() as f32,
            scale: self.scale.into(),
            kind: settings::matte::representation(self.representation),
        })
    }
}

impl Plan {
    fn carry_out(&self) -> anyhow::Result<String> {
        let asset = Asset::open(&self.asset, self.access)?;
        let dual = Dual::new(&asset, self.dark_room)?;
        if self.dark_room && asset.ambient().is_some() {
            note(&format!("{} has a black photograph: --dark-room changes nothing", self.asset.display()));
        }
        if self.radiance && asset.domain().gantry().is_none() {
            bail!("--radiance: a screen has no point to look from; take what arrives at its texels as it is");
        }
        let views = self.views(&dual)?;
        let kind = dual.choose(self.kind)?;
        let lit = self.lit(&asset)?;
        let mut bar = Progress::new("turning light round", Unit::Steps);
        let first = views.start;
        let pictures = dual.pictures(&lit, kind, views, &mut |done, total| bar.step(done, total))?;
        let mut report = String::new();
        for (n, picture) in pictures.into_iter().enumerate() {
            progress::check()?;
            let picture = if self.radiance { dual.as_radiance(&picture)? } else { picture };
            report += &self.written(&asset, kind, first + n, picture)?;
        }
        Ok(report)
    }

    /// The positions asked for, from 0.
    fn views(&self, dual: &Dual<'_>) -> anyhow::Result<std::ops::Range<usize>> {
        let (count, file) = (dual.views(), self.asset.display());
        match self.position {
            Some(Position::All) => Ok(0..count),
            Some(Position::One(number)) if number <= count => Ok(number - 1..number),
            Some(Position::One(number)) => {
                Err(Error::invalid(file.to_string(), format!("no position {number}"), format!("1 to {count}")).into())
            }
            None if count == 1 => Ok(0..1),
            None => bail!("{file} has {count} positions of the projector: give --position 1 to {count}, or all"),
        }
    }

    /// What the camera throws.
    fn lit(&self, asset: &Asset) -> anyhow::Result<Image> {
        let (width, height) = (asset.width(), asset.height());
        let Some(path) = &self.lit else { return Ok(Image::from_fn(width, height, |_, _| [1.0; 3])) };
        let (w, h) = image::probe_size(path)?;
        if (w, h) != (width, height) {
            let expected = format!("{width} x {height}, as {}: a pixel throws what it saw by", self.asset.display());
            return Err(Error::invalid(path.display().to_string(), format!("{w} x {h} pixels"), expected).into());
        }
        Ok(image::read(path, Encoding::Auto)?.into_rgb())
    }

    fn written(&self, asset: &Asset, kind: Kind, view: usize, mut picture: Image) -> anyhow::Result<String> {
        picture.data_mut().iter_mut().for_each(|v| *v *= self.gain);
        let path = match &self.output {
            Output::One(path) => path.clone(),
            Output::Numbered(pattern) => pattern.path(view as i64 + 1),
        };
        let advice = shown_by(&path, &picture)
            .map(|ev| format!("; --exposure {:.1} shows it", ev + f64::from(self.gain.log2())));
        let (w, h) = picture.size();
        let (scale, place) = (self.scale, &path);
        let larger = Image::from_fn(w * scale, h * scale, |x, y| {
            let pixel = picture.pixel(x / scale, y / scale);
            [pixel[0], pixel[1], pixel[2]]
        });
        image::write(place, &larger, EncodeOptions { colour_space: asset.colour_space(), ..EncodeOptions::default() })?;
        let of = match asset.domain().gantry() {
            Some(gantry) => format!("{w} x {h} squares, position {} of {}", view + 1, gantry.poses().len()),
            None => format!("{w} x {h} texels"),
        };
        Ok(format!("{}: {of}, from {}{}\n", path.display(), kind.id(), advice.unwrap_or_default()))
    }
}

/// The stops that bring a picture to white, where its file holds nothing beyond and it is far from it.
fn shown_by(path: &Path, picture: &Image) -> Option<f64> {
    let extension = path.extension()?.to_ascii_lowercase();
    let codes = ["png", "jpg", "jpeg"].iter().any(|known| extension == *known);
    let stops = f64::from(sheet::exposure(picture).log2());
    (codes && stops.is_finite() && stops.abs() > 1.0 && picture.data().iter().any(|v| *v > 0.0)).then_some(stops)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::commands::testing;

    fn parse(line: &str) -> Result<Arguments, clap::Error> {
        testing::parse(line)
    }

    #[test]
    fn flags_reach_the_plan() {
        let plan = parse("dual a.rfield --lit white -o b.exr").unwrap().plan().unwrap();
        let neutral = Plan {
            asset: "a.rfield".into(),
            access: Access::Mapped,
            lit: None,
            position: None,
            output: Output::One("b.exr".into()),
            radiance: false,
            dark_room: false,
            gain: 1.0,
            scale: 1,
            kind: None,
        };
        assert_eq!(plan, neutral);
        let line = "dual a.rfield --lit ./white --position all -o b.##.png --radiance --dark-room --exposure -1 --scale 8 \
                    --representation explicit --access read";
        let plan = parse(line).unwrap().plan().unwrap();
        let output = Output::Numbered("b.##.png".parse().unwrap());
        let given = Plan {
            access: Access::Read,
            lit: Some("./white".into()),
            position: Some(Position::All),
            output,
            radiance: true,
            dark_room: true,
            gain: 0.5,
            scale: 8,
            kind: Some(Kind::Explicit),
            ..neutral
        };
        assert_eq!(plan, given);
    }

    #[test]
    fn wrong_usage_is_refused() {
        for (options, word) in [
            ("--position 0", "from 1 on"),
            ("--position -1", "-1"),
            ("--position 1.5", "from 1 on"),
            ("--scale 0", "0"),
            ("--scale 257", "257"),
            ("--exposure nan", "nan"),
            ("--representation harmonics", "explicit"),
        ] {
            let message = parse(&format!("dual a.rfield --lit white -o b.exr {options}")).unwrap_err().to_string();
            assert!(message.contains(word), "{options}: no `{word}` in {message}");
        }
        assert!(parse("dual a.rfield -o b.exr").is_err() && parse("dual a.rfield --lit white").is_err());
        let all = parse("dual a.rfield --lit white --position all -o b.exr").unwrap();
        assert!(all.plan().unwrap_err().to_string().contains("####"));
    }
}
