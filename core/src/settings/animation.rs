//! Animation scripts: lights that turn, fade and change with the frame, in TOML.
//!
//! ```toml
//! rotation = { keys = [[1, 0], [49, 360]], between = "linear" }   # degrees, as relight --rotate
//! exposure = [[1, -2, "smooth"], [12, 0]]                         # a list is keys: [frame, value, between]
//! ambient = 0                                                     # a number stays
//!
//! [[light]]
//! env = "park.hdr"                      # a lat-long map; paths are relative to this file
//! gain = [[20, 1], [30, 0]]             # fades this light: 1 is as it is
//!
//! [[light]]
//! lighting = "three-point"              # a preset, or a lighting file
//! gain = [[20, 0], [30, 1]]
//! rotation = 0                          # a light's own takes the place of the one above
//! ```
//!
//! | key | where | meaning |
//! |---|---|---|
//! | `env`, `lighting`, `light4d`, `lamp` | light | one of them: a map, a lighting, a light field (for a projector's field), a captured lamp (its keys hold) |
//! | `gain` | light | linear factor, 1 if absent |
//! | `rotation`, `pitch`, `roll` | above, or light | degrees; not for captured lamps |
//! | `exposure`, `tint` | above, or light | stops; three factors |
//! | `blur`, `clamp` | above, or light with `env` | as the settings of those names; for maps alone |
//! | `map_centre`, `map_space` | light with `env` | as the settings of those names |
//! | `ambient` | above | gain of the ambient picture |
//! | `reconstruct`, `outside`, `output_space` | above | as the settings of those names; without keys |
//! | `title` | above | for people |
//!
//! Light adds: a frame's weights are the sum over its lights of gain times weights, so a cross-fade is exact.

use std::path::{Path, PathBuf};

pub use super::curve::{Between, Curve, Key};
use super::table::{Bounds, Place, Table, Value, read_text};
use super::{Kind, Setting, light4d, lighting};
use crate::error::{Error, Result};
use crate::illumination::{LightField, Lighting, MapCentre};
use crate::image::ColourSpace;
use crate::relight::Look;

/// A script, read and checked.
#[derive(Debug, Clone, PartialEq)]
pub struct Script {
    /// At least one.
    pub lights: Vec<ScriptLight>,
    /// g in `T L + g S`.
    ambient: Curve<1>,
    /// What does not change with the frame.
    still: Look,
}

/// One light of a script.
#[derive(Debug, Clone, PartialEq)]
pub struct ScriptLight {
    /// What shines.
    pub source: Source,
    gain: Curve<1>,
    turns: Turns,
    centre: MapCentre,
    map_space: ColourSpace,
}

/// What shines.
#[derive(Debug, Clone, PartialEq)]
pub enum Source {
    /// A lat-long map in a file that exists.
    Map(PathBuf),
    /// Lamps of a preset or a file.
    Lighting(Lighting),
    /// Light that varies in space, of a preset or a file.
    Field(LightField),
    /// A captured lamp, counted from 1, by frame.
    Lamp(Curve<1>),
}

/// What of a look can change with the frame.
#[derive(Debug, Clone, PartialEq)]
struct Turns {
    rotation: Curve<1>,
    pitch: Curve<1>,
    roll: Curve<1>,
    exposure: Curve<1>,
    tint: Curve<3>,
    blur: Curve<1>,
    clamp: Curve<1>,
}

const GAIN: Bounds = Bounds::new(0.0, 1e6, "");
const LAMP: Bounds = Bounds::new(1.0, 1e6, "");
const TURNS: [&str; 7] = ["rotation", "pitch", "roll", "exposure", "tint", "blur", "clamp"];

impl Script {
    /// Reads a script, and the lighting files that it names.
    ///
    /// # Errors
    /// A file that cannot be read, or that a light names and that is not there; as for [lighting files](lighting::parse),
    /// with file and line; keys out of order or twice at a frame.
    pub fn load(path: &Path) -> Result<Self> {
        let folder = crate::files::folder_of(path);
        Self::parse(&path.display().to_string(), &read_text(path)?, folder)
    }

    /// Reads the text of a script; `file` is how messages call it, paths in it are relative to `folder`.
    ///
    /// # Errors
    /// As [`Script::load`].
    pub fn parse(file: &str, text: &str, folder: &Path) -> Result<Self> {
        let place = Place::new(file, text);
        let table = place.parse()?;
        let root = Table::root(place, &table, "a script");
        let own = ["title", "light", "ambient", "reconstruct", "outside", "output_space"];
        root.only(&[&own[..], &TURNS[..]].concat())?;
        root.text_or_empty("title")?;
        let turns = Turns::read(&root, &Turns::still(&Look::default()))?;
        let lights = root.tables("light")?;
        let lights: Vec<_> =
            lights.iter().map(|light| ScriptLight::read(light, &turns, folder)).collect::<Result<_>>()?;
        if lights.is_empty() {
            return Err(root.refuse("no light", "at least one table that begins with `[[light]]`"));
        }
        let still = Look {
            method: choice(&root, "reconstruct", &super::RECONSTRUCTION).map(super::method)?,
            outside: choice(&root, "outside", &super::OUTSIDE).map(super::outside)?,
            output_space: choice(&root, "output_space", &super::OUTPUT_SPACE).map(super::colour_space)?,
            ..Look::default()
        };
        let ambient = curve(&root, "ambient", bounds(&super::AMBIENT, ""), &Curve::constant([still.ambient]))?;
        Ok(Self { lights, ambient, still })
    }

    /// The look of the picture at a frame: what holds for all lights.
    pub fn look(&self, frame: f64) -> Look {
        Look { ambient: self.ambient.at(frame)[0], ..self.still }
    }
}

impl ScriptLight {
    /// The look of this light at a frame.
    pub fn look(&self, script: &Script, frame: f64) -> Look {
        let t = &self.turns;
        Look {
            centre: self.centre,
            map_space: self.map_space,
            heading_deg: t.rotation.at(frame)[0],
            pitch_deg: t.pitch.at(frame)[0],
            roll_deg: t.roll.at(frame)[0],
            exposure_ev: t.exposure.at(frame)[0],
            tint: t.tint.at(frame),
            blur_deg: t.blur.at(frame)[0],
            clamp: t.clamp.at(frame)[0],
            ..script.still
        }
    }

    /// What its weights are multiplied by at a frame; 0 where it is off.
    pub fn gain(&self, frame: f64) -> f64 {
        self.gain.at(frame)[0]
    }

    fn read(table: &Table<'_>, above: &Turns, folder: &Path) -> Result<Self> {
        let table = table.called("a light");
        let sources = ["env", "lighting", "light4d", "lamp"];
        table.only(&[&sources[..], &["gain", "map_centre", "map_space"], &TURNS[..]].concat())?;
        let mut given = sources.into_iter().filter_map(|key| table.get(key));
        let source = match (given.next(), given.next()) {
            (Some(only), None) => Source::read(&only, folder)?,
            (Some(_), Some(second)) => return Err(second.refuse("a second source", "one source a light")),
            (None, _) => return Err(table.refuse("a light without a source", "`env`, `lighting`, `light4d` or `lamp`")),
        };
        let meaningless: &[&'static str] = match source {
            Source::Map(_) => &[],
            Source::Lighting(_) | Source::Field(_) => &["blur", "clamp", "map_centre", "map_space"],
            Source::Lamp(_) => &["rotation", "pitch", "roll", "blur", "clamp", "map_centre", "map_space"],
        };
        if let Some(value) = meaningless.iter().find_map(|key| table.get(key)) {
            let what = match source {
                Source::Lamp(_) => "a captured lamp",
                Source::Field(_) => "a light field",
                _ => "a lighting",
            };
            return Err(value.refuse(format!("a value for {what}"), "it only in lights that it can change"));
        }
        Ok(Self {
            source,
            gain: curve(&table, "gain", GAIN, &Curve::constant([1.0]))?,
            turns: Turns::read(&table, above)?,
            centre: choice(&table, "map_centre", &super::MAP_CENTRE).map(super::map_centre)?,
            map_space: choice(&table, "map_space", &super::MAP_SPACE).map(super::colour_space)?,
        })
    }
}

/// An error of a name, said at the script's line, where it can be mended; others as they are.
fn said(error: Error, value: &Value<'_>, named: &str, expected: &str) -> Error {
    match error {
        Error::Io { path, source, .. } => value.refuse(format!("{} ({source})", path.display()), expected),
        Error::Invalid { place, found, expected } if place == named => value.refuse(found, expected),
        other => other,
    }
}

impl Source {
    fn read(value: &Value<'_>, folder: &Path) -> Result<Self> {
        match value.key() {
            "env" => {
                let path = folder.join(value.text()?);
                if path.is_file() {
                    return Ok(Self::Map(path));
                }
                Err(value
                    .refuse(format!("{}, which is not there", path.display()), "a map's file, relative to the script"))
            }
            "lighting" => match lighting::find(value.text()?, folder) {
                Ok(file) => Ok(Self::Lighting(file.lighting)),
                Err(error) => Err(said(error, value, "lighting", "a preset or a lighting file")),
            },
            "light4d" => match light4d::find(value.text()?, folder) {
                Ok(file) => Ok(Self::Field(file.light)),
                Err(error) => Err(said(error, value, "light field", "a preset or a light file")),
            },
            _ => {
                let numbers = Curve::read(value, LAMP, true)?;
                // Lamps have no order in which one could stand between two.
                if !numbers.holds() {
                    return Err(value.refuse("keys that do not hold", "`\"hold\"`, or no word, for lamps"));
                }
                Ok(Self::Lamp(numbers))
            }
        }
    }
}

impl Turns {
    /// A look that stays.
    fn still(look: &Look) -> Self {
        let one = |value: f64| Curve::constant([value]);
        Self {
            rotation: one(look.heading_deg),
            pitch: one(look.pitch_deg),
            roll: one(look.roll_deg),
            exposure: one(look.exposure_ev),
            tint: Curve::constant(look.tint),
            blur: one(look.blur_deg),
            clamp: one(look.clamp),
        }
    }

    /// What a table says, and for the rest `otherwise`.
    fn read(table: &Table<'_>, otherwise: &Self) -> Result<Self> {
        Ok(Self {
            rotation: curve(table, "rotation", bounds(&super::ROTATION, "degrees"), &otherwise.rotation)?,
            pitch: curve(table, "pitch", bounds(&super::PITCH, "degrees"), &otherwise.pitch)?,
            roll: curve(table, "roll", bounds(&super::ROLL, "degrees"), &otherwise.roll)?,
            exposure: curve(table, "exposure", bounds(&super::EXPOSURE, "stops"), &otherwise.exposure)?,
            tint: curve(table, "tint", bounds(&super::TINT, ""), &otherwise.tint)?,
            blur: curve(table, "blur", bounds(&super::BLUR, "degrees"), &otherwise.blur)?,
            clamp: curve(table, "clamp", bounds(&super::CLAMP, ""), &otherwise.clamp)?,
        })
    }
}

/// The hard bounds of a setting.
fn bounds(setting: &Setting, unit: &'static str) -> Bounds {
    match setting.kind {
        Kind::Number { hard, .. } | Kind::Colour { hard, .. } => Bounds::new(hard.0, hard.1, unit),
        Kind::Integer { hard, .. } => Bounds::new(f64::from(hard.0), f64::from(hard.1), unit),
        Kind::Choice { .. } | Kind::File => Bounds::new(f64::MIN, f64::MAX, unit),
    }
}

fn curve<const N: usize>(
    table: &Table<'_>,
    key: &'static str,
    bounds: Bounds,
    otherwise: &Curve<N>,
) -> Result<Curve<N>> {
    table.get(key).map_or_else(|| Ok(otherwise.clone()), |value| Curve::read(&value, bounds, false))
}

/// The option of a setting's choice.
fn choice(table: &Table<'_>, key: &'static str, setting: &Setting) -> Result<usize> {
    let Kind::Choice { default, options } = setting.kind else { return Ok(0) };
    let ids: Vec<&str> = options.iter().map(|option| option.0).collect();
    table.get(key).map_or(Ok(default), |value| value.choice(&ids))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reconstruct::{Method, Outside};

    fn folder() -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("park.hdr"), "a map").unwrap();
        std::fs::write(folder.path().join("mine.toml"), lighting::PRESETS[0].text).unwrap();
        std::fs::write(folder.path().join("bad.toml"), "[[light]]\nkind = \"disc\"\nazimut = 1\n").unwrap();
        folder
    }

    #[test]
    fn a_script_says_what_each_frame_looks_like() {
        let folder = folder();
        let text = "
            rotation = { keys = [[1, 0], [11, 100]] }
            exposure = [[1, -2, \"hold\"], [5, 0]]
            tint = [[1, [1, 1, 1]], [3, [0, 1, 3]]]
            ambient = 0.5
            reconstruct = \"zero-order\"
            outside = \"nearest\"
            [[light]]
            env = \"park.hdr\"
            gain = { keys = [[1, 1], [11, 0]], between = \"smooth\" }
            map_centre = \"behind\"
            blur = 3
            [[light]]
            lighting = \"key\"
            rotation = -20
            [[light]]
            lighting = \"mine.toml\"
            [[light]]
            lamp = [[1, 4], [3, 7]]";
        let script = Script::parse("s.toml", text, folder.path()).unwrap();
        assert_eq!(
            script.look(2.0),
            Look { ambient: 0.5, method: Method::ZeroOrder, outside: Outside::Nearest, ..Look::default() }
        );
        let [park, key, mine, lamp] = &script.lights[..] else { panic!("four lights") };
        assert_eq!(park.source, Source::Map(folder.path().join("park.hdr")));
        assert_eq!((park.gain(1.0), park.gain(6.0), park.gain(20.0)), (1.0, 0.5, 0.0));
        let look = park.look(&script, 2.0);
        assert_eq!((look.heading_deg, look.exposure_ev, look.blur_deg), (10.0, -2.0, 3.0));
        assert_eq!((look.tint, look.centre, look.method), ([0.5, 1.0, 2.0], MapCentre::Behind, Method::ZeroOrder));
        assert_eq!((key.look(&script, 2.0).heading_deg, mine.look(&script, 2.0).heading_deg), (-20.0, 10.0));
        assert_eq!(key.source, mine.source);
        let Source::Lamp(numbers) = &lamp.source else { panic!("a lamp") };
        assert_eq!((numbers.at(2.9), numbers.at(3.0)), ([4.0], [7.0]));
    }

    #[test]
    fn mistakes_are_told() {
        let folder = folder();
        let env = "[[light]]\nenv = \"park.hdr\"\n";
        for (text, words) in [
            (format!("rotaton = 3\n{env}"), &["s.toml, line 1", "`rotaton`", "`rotation`"][..]),
            (format!("rotation = \"45deg\"\n{env}"), &["line 1", "45deg", "rotation = 45", "degrees"]),
            (format!("rotation = [[1, 0], [1, 5]]\n{env}"), &["line 1", "second key at frame 1", "rotation"]),
            (format!("rotation = [\n[5, 0],\n[1, 5]]\n{env}"), &["line 3", "frame 1 after one at frame 5", "grow"]),
            (format!("rotation = []\n{env}"), &["line 1", "no keys"]),
            (format!("rotation = [[1]]\n{env}"), &["line 1", "[frame, value]"]),
            (format!("rotation = [[1, 2, \"smoth\"]]\n{env}"), &["line 1", "smoth", "`smooth`"]),
            (
                format!("rotation = {{ keys = [[1, 2]], betwen = \"hold\" }}\n{env}"),
                &["line 1", "`betwen`", "`between`"],
            ),
            (format!("exposure = 99\n{env}"), &["line 1", "99", "-40 to 40 stops"]),
            (format!("tint = 2\n{env}"), &["line 1", "a list of 3"]),
            (format!("reconstruct = \"liner\"\n{env}"), &["line 1", "liner", "`linear`"]),
            ("[[light]]\nenv = \"absent.hdr\"\n".to_owned(), &["line 2", "absent.hdr", "not there"]),
            ("[[light]]\nlighting = \"absent.toml\"\n".to_owned(), &["s.toml, line 2", "absent.toml"]),
            ("[[light]]\nlighting = \"thre-point\"\n".to_owned(), &["s.toml, line 2", "`three-point`"]),
            ("[[light]]\nlight4d = \"tree-beams\"\n".to_owned(), &["s.toml, line 2", "`three-beams`"]),
            ("[[light]]\nlight4d = \"desk-spot\"\nblur = 3\n".to_owned(), &["s.toml, line 3", "a light field"]),
            ("[[light]]\nlighting = \"bad.toml\"\n".to_owned(), &["bad.toml, line 3", "`azimut`", "`azimuth`"]),
            ("[[light]]\nlamp = 0\n".to_owned(), &["line 2", "lamp", "1 to"]),
            ("[[light]]\nlamp = 1.5\n".to_owned(), &["line 2", "whole"]),
            ("[[light]]\nlamp = [[1, 1, \"smooth\"], [2, 5]]\n".to_owned(), &["line 2", "hold"]),
            ("[[light]]\nlamp = 3\nrotation = 4\n".to_owned(), &["line 3", "rotation", "captured lamp"]),
            (format!("{env}lamp = 3\n"), &["line 3", "one source"]),
            ("[[light]]\ngain = 1\n".to_owned(), &["line 1", "without a source", "`env`"]),
            (format!("{env}gain = -1\n"), &["line 3", "gain", "-1"]),
            (String::new(), &["no light"]),
        ] {
            let message = Script::parse("s.toml", &text, folder.path()).unwrap_err().to_string();
            for word in words {
                assert!(message.contains(word), "no `{word}` in: {message}");
            }
            assert!(!message.contains('\n'), "{message}");
        }
    }
}
