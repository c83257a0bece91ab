//! `relume matte`: an object that was photographed before a screen, before another picture.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use relume_core::field::{Access, Asset, Kind};
use relume_core::illumination::EnvMap;
use relume_core::image::{self, ColourSpace, EncodeOptions, Encoding, Image, Window};
use relume_core::matte::{Backdrop, Beyond, Composite, Place, Show};
use relume_core::relight::{Look, ScreenRelighter};
use relume_core::settings;

use super::import::EncodingChoice;
use super::relight::AccessChoice;
use super::{note, values};
use crate::progress;

const EXAMPLES: &str = "\
Examples:
  relume matte glass.rfield --plate street.exr -o composite.exr
  relume matte glass.rfield --plate street.exr --place 200,-80,0.5,15 -o composite.png
  relume matte glass.rfield --plate street.exr --output element -o element.exr
  relume matte glass.rfield --plate street.exr --beyond 0.2,0.25,0.3 -o composite.exr
  relume matte glass.rfield --plate street.exr --beyond park.exr --view 40 -o composite.exr

What the camera saw of the screen is what it sees of the plate now: composite = T L + g S + (1 - alpha) plate, L what the plate
shows where each texel of the screen was seen.";

/// Raw flags.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    /// The captured object: a .rfield file of a screen.
    asset: PathBuf,
    /// The picture behind the object. The output has its size.
    #[arg(long, value_name = "IMG")]
    plate: PathBuf,
    /// The picture to write; its extension chooses the type.
    #[arg(short = 'o', value_name = "OUT")]
    to: PathBuf,
    /// Where the object stands: its middle to the right and downwards from the plate's, in pixels of the plate; pixels of the plate
    /// a pixel of the object; degrees counter-clockwise.
    #[arg(long, value_name = "X,Y,SCALE,ROTATE", allow_hyphen_values = true, value_parser = place, default_value = "0,0,1,0")]
    place: Place,
    /// What is written.
    #[arg(long, value_enum, default_value_t = OutputChoice::Composite)]
    output: OutputChoice,
    /// The light of texels that the plate does not reach: stretch (its edge goes on), a colour R,G,B, or a lat-long map with its
    /// -z behind the plate.
    #[arg(long, value_name = "stretch|R,G,B|MAP", allow_hyphen_values = true, default_value = "stretch")]
    beyond: String,
    /// Width of the plate as the camera sees it, degrees; for a map beyond it.
    #[arg(long, value_name = "DEG", value_parser = view, default_value_t = 40.0)]
    view: f64,
    /// The colour space of plate and output: lin_rec709, lin_rec2020, acescg, aces2065_1 or lin_p3d65.
    #[arg(long, value_name = "SPACE", value_parser = values::colour_space, default_value_t = ColourSpace::default())]
    plate_space: ColourSpace,
    /// How the plate's numbers become light [default: sRGB for 8 and 16 bits, linear for floats].
    #[arg(long, value_enum)]
    plate_encoding: Option<EncodingChoice>,
    #[arg(long, value_name = "EV", help = settings::EXPOSURE.hint,
          allow_negative_numbers = true, value_parser = values::number(&settings::EXPOSURE),
          default_value_t = values::neutral(&settings::EXPOSURE))]
    exposure: f64,
    #[arg(long, value_name = "R,G,B", help = settings::TINT.hint,
          allow_hyphen_values = true, value_parser = values::colour(&settings::TINT),
          default_value = "1,1,1")]
    tint: [f64; 3],
    #[arg(long, value_name = "GAIN", help = settings::AMBIENT.hint,
          allow_negative_numbers = true, value_parser = values::number(&settings::AMBIENT),
          default_value_t = values::neutral(&settings::AMBIENT))]
    ambient: f64,
    /// The representation, for fields that hold several.
    #[arg(long, value_enum, value_name = "FORM")]
    representation: Option<FormChoice>,
    /// How the file is opened: memory-mapped, or read piece by piece, for network disks.
    #[arg(long, value_enum, default_value_t = AccessChoice::Mapped)]
    access: AccessChoice,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum OutputChoice {
    /// The object over the plate.
    Composite,
    /// The object alone, premultiplied.
    Element,
    /// Its coverage, as grey.
    Alpha,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum FormChoice {
    /// Pictures of squares.
    Dense,
    /// Tiles of low rank.
    Factored,
    /// Wavelets of each pixel.
    Wavelet,
    /// Wavelets that the screen showed.
    Explicit,
}

impl FormChoice {
    fn kind(self) -> Kind {
        match self {
            Self::Dense => Kind::Dense,
            Self::Factored => Kind::Factored,
            Self::Wavelet => Kind::Wavelet,
            Self::Explicit => Kind::Explicit,
        }
    }
}

/// `--beyond`.
#[derive(Debug, Clone, PartialEq)]
enum BeyondPlan {
    Stretch,
    Colour([f32; 3]),
    Map(PathBuf),
}

/// Checked flags.
#[derive(Debug)]
struct Plan {
    asset: PathBuf,
    access: Access,
    plate: PathBuf,
    encoding: Encoding,
    to: PathBuf,
    place: Place,
    show: Show,
    beyond: BeyondPlan,
    view_deg: f64,
    look: Look,
}

impl Arguments {
    /// Composites and writes.
    ///
    /// # Errors
    /// A field of lamps; files that are gone; no room.
    pub fn run(self) -> anyhow::Result<String> {
        self.plan()?.carry_out()
    }

    /// Refuses what can be known to fail before the work.
    fn plan(self) -> anyhow::Result<Plan> {
        image::check_output(&self.to)?;
        let look = Look {
            representation: self.representation.map(FormChoice::kind),
            exposure_ev: self.exposure,
            tint: self.tint,
            ambient: self.ambient,
            map_space: self.plate_space,
            output_space: self.plate_space,
            ..Look::default()
        };
        let show = match self.output {
            OutputChoice::Composite => Show::Composite,
            OutputChoice::Element => Show::Element,
            OutputChoice::Alpha => Show::Alpha,
        };
        Ok(Plan {
            asset: self.asset,
            access: self.access.into(),
            plate: self.plate,
            encoding: EncodingChoice::of(self.plate_encoding),
            to: self.to,
            place: self.place,
            show,
            beyond: beyond(&self.beyond)?,
            view_deg: self.view,
            look,
        })
    }
}

impl Plan {
    fn carry_out(&self) -> anyhow::Result<String> {
        let relighter = ScreenRelighter::new(Asset::open(&self.asset, self.access)?)?;
        let plate = image::read(&self.plate, self.encoding)?;
        self.tell(&relighter);
        progress::check()?;
        let picture = self.picture(&relighter, &plate)?;
        progress::check()?;
        let options = EncodeOptions { colour_space: self.look.output_space, ..EncodeOptions::default() };
        image::write(&self.to, &picture, options)?;
        Ok(format!("{}: {} x {} pixels\n", self.to.display(), picture.width(), picture.height()))
    }

    /// What the picture will lack.
    fn tell(&self, relighter: &ScreenRelighter) {
        let (asset, name) = (relighter.asset(), self.asset.display());
        if self.look.ambient != 0.0 && asset.ambient().is_none() {
            note(&format!("{name} has no ambient picture: --ambient adds nothing"));
        }
        if asset.alpha().is_none() {
            note(&format!("{name} has no alpha: all of its picture covers the plate"));
        }
        if relighter.correspondence().is_none() {
            note(&format!("{name} does not know where its pixels look: the screen is taken to fill its picture"));
        }
    }

    fn picture(&self, relighter: &ScreenRelighter, plate: &Image) -> anyhow::Result<Image> {
        let asset = relighter.asset();
        let (object, size) = ((asset.width(), asset.height()), plate.size());
        let composite = Composite::new(object, &self.place, size)?;
        let weights = match self.show {
            Show::Alpha => relighter.weights(&vec![[0.0; 3]; relighter.plane().len()], &self.look)?,
            Show::Composite | Show::Element => {
                let of_screen = (relighter.plane(), relighter.correspondence());
                let backdrop = Backdrop::new(of_screen, object, &self.place, size)?;
                let map = match &self.beyond {
                    BeyondPlan::Map(path) => Some(EnvMap::load(path)?),
                    BeyondPlan::Stretch | BeyondPlan::Colour(_) => None,
                };
                let beyond = match (&self.beyond, &map) {
                    (BeyondPlan::Colour(rgb), _) => Beyond::Colour(*rgb),
                    (_, Some(map)) => Beyond::Map(map, self.view_deg),
                    _ => Beyond::Stretch,
                };
                relighter.weights(&backdrop.light(plate, beyond), &self.look)?
            }
        };
        let element = composite.element(relighter, (&weights, &self.look), Window::full(size.0, size.1))?;
        Ok(match self.show {
            Show::Composite => Composite::over(&element, plate),
            Show::Element => element,
            Show::Alpha => Image::from_fn(size.0, size.1, |x, y| [element.pixel(x, y)[3]; 3]),
        })
    }
}

/// `X,Y,SCALE,ROTATE`.
fn place(text: &str) -> Result<Place, String> {
    let [x, y, scale, rotate_deg] = values::list::<4>(text)?;
    let place = Place { shift: [x, y], scale, rotate_deg };
    place.check().map_err(|error| error.to_string())?;
    Ok(place)
}

fn view(text: &str) -> Result<f64, String> {
    let degrees = values::finite(text)?;
    if degrees > 0.0 && degrees < 180.0 {
        Ok(degrees)
    } else {
        Err("a width of more than 0 and less than 180 degrees".to_owned())
    }
}

fn beyond(text: &str) -> anyhow::Result<BeyondPlan> {
    if text == "stretch" {
        return Ok(BeyondPlan::Stretch);
    }
    if let Ok(rgb) = values::list::<3>(text) {
        return Ok(BeyondPlan::Colour(rgb.map(|v| v as f32)));
    }
    let path = PathBuf::from(text);
    if !path.is_file() {
        anyhow::bail!("--beyond: `{text}` is neither `stretch`, nor a colour R,G,B, nor a map: there is no such file");
    }
    Ok(BeyondPlan::Map(path))
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
        let line = "matte a.rfield --plate p.exr -o out.exr --place -20,10.5,0.5,-30 --output element --beyond 0.1,0.2,-0.3 \
                    --exposure -1 --ambient 1 --plate-space acescg --representation explicit";
        let plan = parse(line).unwrap().plan().unwrap();
        assert_eq!(plan.place, Place { shift: [-20.0, 10.5], scale: 0.5, rotate_deg: -30.0 });
        assert_eq!((plan.show, plan.beyond), (Show::Element, BeyondPlan::Colour([0.1, 0.2, -0.3])));
        assert_eq!((plan.look.representation, plan.look.map_space), (Some(Kind::Explicit), ColourSpace::AcesCg));
    }

    #[test]
    fn wrong_usage_is_refused() {
        for line in [
            "matte a.rfield -o out.exr",
            "matte a.rfield --plate p.exr",
            "matte a.rfield --plate p.exr -o out.exr --place 1,2,3",
            "matte a.rfield --plate p.exr -o out.exr --place 1,2,0,0",
            "matte a.rfield --plate p.exr -o out.exr --place 1,2,nan,0",
            "matte a.rfield --plate p.exr -o out.exr --output plate",
            "matte a.rfield --plate p.exr -o out.exr --view 180",
        ] {
            assert!(parse(line).is_err(), "{line}");
        }
        for (line, words) in [
            ("matte a.rfield --plate p.exr -o out.bmp", ".bmp"),
            ("matte a.rfield --plate p.exr -o out.exr --beyond strech", "neither"),
        ] {
            let message = parse(line).unwrap().plan().unwrap_err().to_string();
            assert!(message.contains(words), "{message}");
        }
    }
}
