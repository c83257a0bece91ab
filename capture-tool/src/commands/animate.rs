//! `relume animate`: lights that turn, fade and change, a picture a frame.
//!
//! A frame depends on the script, the asset and its number alone: frames share a pass over the field, but each sum runs in
//! the same order whatever its company, so a farm may split a range as it likes and gets the same bytes.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use anyhow::Context;
use clap::Args;
use relume_core::field::{Access, Asset, Kind};
use relume_core::illumination::{Beam, EnvMap};
use relume_core::image::{self, EncodeOptions, Image, Window, probe_size};
use relume_core::relight::{Light, Look, Relighter, WIDEST_MAP, Weights};
use relume_core::settings;
use relume_core::settings::animation::{Script, ScriptLight, Source};

use super::relight::{AccessChoice, band_rows};
use super::{note, values};
use crate::frames::{Frames, Pattern};
use crate::progress::{self, Progress, Unit};

const EXAMPLES: &str = "\
Examples:
  relume animate vase.rfield turn.toml --frames 1-48 -o out.####.exr
  relume animate vase.rfield turn.toml --frames 1-10,20,30-48x2 -o frames/out.%04d.png --overwrite

A script holds lights, and values that stay or have keys:

  rotation = [[1, 0], [49, 360]]            # keys [frame, value]: a turn in 48 frames
  exposure = [[1, -2, \"smooth\"], [12, 0]]   # linear (if nothing is said), smooth, or hold
  tint = { keys = [[1, [1, 1, 1]], [48, [1, 0.8, 0.6]]], between = \"smooth\" }

  [[light]]
  env = \"park.hdr\"                          # a lat-long map; paths are relative to the script
  gain = [[20, 1], [30, 0]]                 # light adds: this and the next cross-fade exactly

  [[light]]
  lighting = \"three-point\"                  # a name of `relume lightings`, or a lighting file; light4d = for light fields
  gain = [[20, 0], [30, 1]]
  rotation = 0                              # a light's own takes the place of the one above

Smooth keys ease and never overshoot. A third kind of light is a captured lamp: lamp = 17, or with
keys, which hold. Above the lights stand rotation, pitch, roll, exposure, tint, blur, clamp (a light
can have its own), ambient, reconstruct, outside and output_space; a map also takes map_centre and
map_space. They mean what the options of `relume relight` mean; blur and clamp are for maps alone.

Frames that are there already, whole and of the right size, are left; so a stopped or split run goes
on where it was. Change a script, and --overwrite renders its frames again.";

/// Frames that share a pass over the field: the arithmetic of more is no cheaper.
const TOGETHER: usize = 16;
/// Memory for the pictures of a pass.
const PICTURE_BYTES: usize = 1 << 30;

/// Raw flags.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    /// The captured object: a .rfield file.
    asset: PathBuf,
    /// The script: a .toml file.
    script: PathBuf,
    /// The frames to render: 5, 1-48, 1-48x2 (every second), 1-10,20.
    #[arg(long, value_name = "RANGE", allow_hyphen_values = true)]
    frames: Frames,
    /// Where frames go: #### or %04d stands for the number; the extension chooses the type, as in `relume relight`.
    #[arg(short, long, value_name = "OUT")]
    output: Pattern,
    /// Render frames again that are there already.
    #[arg(long)]
    overwrite: bool,
    #[arg(long, value_name = "FORM", help = settings::REPRESENTATION.hint,
          value_parser = values::choice(&settings::REPRESENTATION),
          default_value = values::neutral_option(&settings::REPRESENTATION))]
    representation: usize,
    /// How the asset is opened: memory-mapped, or read piece by piece, for network disks.
    #[arg(long, value_enum, default_value_t = AccessChoice::Mapped)]
    access: AccessChoice,
}

impl Arguments {
    /// Renders what is missing.
    pub fn run(self) -> anyhow::Result<String> {
        self.plan()?.carry_out()
    }

    fn plan(self) -> anyhow::Result<Plan> {
        if let Some(first) = self.frames.numbers().first() {
            image::check_output(&self.output.path(*first))?;
        }
        let script = Script::load(&self.script)?;
        Ok(Plan {
            asset: self.asset,
            access: self.access.into(),
            script,
            frames: self.frames,
            output: self.output,
            overwrite: self.overwrite,
            representation: settings::representation(self.representation),
        })
    }
}

/// Checked flags.
#[derive(Debug)]
struct Plan {
    asset: PathBuf,
    access: Access,
    script: Script,
    frames: Frames,
    output: Pattern,
    overwrite: bool,
    representation: Option<Kind>,
}

impl Plan {
    fn carry_out(&self) -> anyhow::Result<String> {
        let relighter = Relighter::new(Asset::open(&self.asset, self.access)?)?;
        let size = (relighter.asset().width(), relighter.asset().height());
        let all = self.frames.numbers();
        let missing: Vec<i64> =
            all.iter().copied().filter(|&f| self.overwrite || !is_whole(&self.output.path(f), size)).collect();
        if missing.is_empty() {
            return Ok(self.report(0));
        }
        let mut lights = Lights::load(&self.script, &relighter, self.representation)?;
        if let Some(ambient) = all.iter().map(|&f| self.script.look(f as f64).ambient).find(|a| *a != 0.0)
            && relighter.asset().ambient().is_none()
        {
            note(&format!("{} has no ambient picture: ambient = {ambient} adds nothing", self.asset.display()));
        }
        let rows = size.1 as u64;
        let mut progress = Progress::new("rendering", Unit::Steps);
        let mut step = |done: usize, row: u64| progress.step(done as u64 * rows + row, missing.len() as u64 * rows);
        for (n, frames) in missing.chunks(together(size)).enumerate() {
            let before = n * together(size);
            let weights = frames.iter().map(|&f| lights.weights(f as f64)).collect::<anyhow::Result<Vec<_>>>()?;
            let looks: Vec<Look> = frames.iter().map(|&f| self.script.look(f as f64)).collect();
            let lit: Vec<(&Weights, &Look)> = weights.iter().zip(&looks).collect();
            let pictures = render(&relighter, &lit, &mut |row| step(before, row * frames.len() as u64))?;
            for ((&frame, picture), look) in frames.iter().zip(pictures).zip(&looks) {
                progress::check()?;
                let options = EncodeOptions { colour_space: look.output_space, ..EncodeOptions::default() };
                image::write(&self.output.path(frame), &picture, options)?;
            }
        }
        Ok(self.report(missing.len()))
    }

    fn report(&self, rendered: usize) -> String {
        let left = self.frames.numbers().len() - rendered;
        let frames = |n: usize| format!("{n} frame{}", if n == 1 { "" } else { "s" });
        let kept = match left {
            0 => String::new(),
            _ => format!(", {} there already (--overwrite renders them again)", frames(left)),
        };
        format!("{}: {} rendered{kept}\n", self.output.shown(), frames(rendered))
    }
}

/// Is a frame there? Frames appear whole, so a header of the right size is enough.
fn is_whole(path: &Path, size: (usize, usize)) -> bool {
    path.is_file() && probe_size(path).is_ok_and(|found| found == size)
}

/// Frames in a pass, so that their pictures fit into [`PICTURE_BYTES`].
fn together((width, height): (usize, usize)) -> usize {
    const BYTES_A_PIXEL: usize = 4 * size_of::<f32>();
    (PICTURE_BYTES / (width * height * BYTES_A_PIXEL).max(1)).clamp(1, TOGETHER)
}

/// Several pictures, RGBA or RGB as the asset has alpha or not, some rows of blocks at a time.
fn render(
    relighter: &Relighter,
    lit: &[(&Weights, &Look)],
    step: &mut dyn FnMut(u64) -> relume_core::Result<()>,
) -> relume_core::Result<Vec<Image>> {
    let asset = relighter.asset();
    let (width, height) = (asset.width(), asset.height());
    let rows = band_rows(asset);
    let mut data: Vec<Vec<f32>> = lit.iter().map(|_| Vec::with_capacity(width * height * 4)).collect();
    for y0 in (0..height).step_by(rows) {
        let y1 = (y0 + rows).min(height);
        let bands = relighter.render_many(lit, Window { x0: 0, y0, x1: width, y1 })?;
        data.iter_mut().zip(&bands).for_each(|(data, band)| data.extend_from_slice(band.data()));
        step(y1 as u64)?;
    }
    let picture = |data| {
        let picture = Image::from_data(width, height, 4, data)?;
        Ok(if asset.alpha().is_some() { picture } else { picture.into_rgb() })
    };
    data.into_iter().map(picture).collect()
}

/// The lights of a script, loaded.
struct Lights<'a> {
    script: &'a Script,
    relighter: &'a Relighter,
    kind: Kind,
    maps: HashMap<&'a Path, EnvMap>,
    /// For each light its map as it was last clamped and blurred.
    blurred: Vec<Option<(f64, f64, EnvMap)>>,
    beams: Vec<Vec<Beam>>,
    /// For each light the look it was last projected with, its lamp's number, and the weights: what stays is projected once.
    last: Vec<Option<(Look, usize, Weights)>>,
}

impl<'a> Lights<'a> {
    fn load(script: &'a Script, relighter: &'a Relighter, wanted: Option<Kind>) -> anyhow::Result<Self> {
        // One for all lights and frames: weights add up, and no frame differs from the next in how it was made.
        let captured_lamp = script.lights.iter().any(|light| matches!(light.source, Source::Lamp(_)));
        let kind = relighter.choose(wanted, captured_lamp)?;
        let (mut maps, mut beams) = (HashMap::new(), Vec::new());
        for light in &script.lights {
            beams.push(match &light.source {
                Source::Lighting(lighting) => lighting.beams(),
                _ => Vec::new(),
            });
            if let Source::Map(path) = &light.source
                && !maps.contains_key(path.as_path())
            {
                progress::check()?;
                let map = EnvMap::load(path).context("cannot use the environment map")?;
                maps.insert(path.as_path(), map.reduced(WIDEST_MAP).into_owned());
            }
        }
        let (last, blurred) = script.lights.iter().map(|_| (None, None)).unzip();
        Ok(Self { script, relighter, kind, maps, blurred, beams, last })
    }

    /// The sum over the lights of gain times weights.
    fn weights(&mut self, frame: f64) -> anyhow::Result<Weights> {
        let mut sum = self.relighter.dark(self.kind);
        for (n, light) in self.script.lights.iter().enumerate() {
            let gain = light.gain(frame);
            if gain == 0.0 {
                continue;
            }
            let weights = self.light(n, light, frame).with_context(|| format!("frame {frame}"))?;
            sum.add(gain, weights);
        }
        Ok(sum)
    }

    /// The weights of one light.
    fn light(&mut self, n: usize, light: &'a ScriptLight, frame: f64) -> relume_core::Result<&Weights> {
        let look = Look { representation: Some(self.kind), ..light.look(self.script, frame) };
        let number = match &light.source {
            Source::Lamp(numbers) => numbers.at(frame)[0] as usize,
            _ => 0,
        };
        let kept = self.last[n].take().filter(|last| last.0 == look && last.1 == number);
        let projected = match kept {
            Some(kept) => kept,
            None => {
                progress::check()?;
                let mut still = look;
                let source = match &light.source {
                    Source::Map(path) => {
                        let map = soft(&self.maps[path.as_path()], &look, &mut self.blurred[n]);
                        still = Look { clamp: 0.0, blur_deg: 0.0, ..look };
                        Light::Map(map)
                    }
                    Source::Lighting(_) => Light::Beams(&self.beams[n]),
                    Source::Field(field) => Light::Field(field),
                    Source::Lamp(_) => Light::Lamp(number),
                };
                (look, number, self.relighter.weights(source, &still)?)
            }
        };
        Ok(&self.last[n].insert(projected).2)
    }
}

/// The map of a light clamped and blurred, once for all frames that turn it.
fn soft<'m>(map: &'m EnvMap, look: &Look, kept: &'m mut Option<(f64, f64, EnvMap)>) -> &'m EnvMap {
    if look.clamp == 0.0 && look.blur_deg == 0.0 {
        return map;
    }
    let fits = kept.take().filter(|kept| kept.0 == look.clamp && kept.1 == look.blur_deg);
    let made = || (look.clamp, look.blur_deg, map.clamped(look.clamp).blurred(look.blur_deg).into_owned());
    &kept.insert(fits.unwrap_or_else(made)).2
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::commands::testing;

    fn parse(line: &str) -> Result<Arguments, clap::Error> {
        testing::parse(line)
    }

    #[test]
    fn ranges_and_names_are_checked_by_the_parser() {
        let given = parse("animate a.rfield s.toml --frames -3-8x2 -o out.####.exr").unwrap();
        assert_eq!(given.frames.numbers().len(), 6);
        for (line, word) in [
            ("animate a.rfield s.toml --frames 8-1 -o out.####.exr", "1-8"),
            ("animate a.rfield s.toml --frames one -o out.####.exr", "`one`"),
            ("animate a.rfield s.toml --frames 1-8 -o out.exr", "####"),
            ("animate a.rfield s.toml -o out.####.exr", "--frames"),
            ("animate a.rfield --frames 1-8 -o out.####.exr", "SCRIPT"),
        ] {
            let message = parse(line).unwrap_err().to_string();
            assert!(message.contains(word), "{message}");
        }
    }

    #[test]
    fn pictures_of_a_pass_fit_into_memory() {
        assert_eq!(together((192, 144)), TOGETHER);
        assert_eq!(together((8192, 8192)), 1);
        assert_eq!(together((4096, 2160)), 7);
    }

    #[test]
    fn a_frame_is_there_when_its_header_says_so() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.exr");
        assert!(!is_whole(&path, (3, 2)));
        image::write(&path, &Image::new(3, 2, 3), EncodeOptions::default()).unwrap();
        assert!(is_whole(&path, (3, 2)) && !is_whole(&path, (2, 3)));
        std::fs::write(&path, b"half a picture").unwrap();
        assert!(!is_whole(&path, (3, 2)));
    }
}
