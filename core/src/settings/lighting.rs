//! Lighting files: lamps in TOML, and the presets that ship.
//!
//! ```toml
//! title = "Key"                   # for lists
//! about = "One large softbox."    # a line on what it is for
//!
//! [[light]]
//! kind = "softbox"                # directional | disc | softbox | ring | dome
//! azimuth = 45                    # degrees: 0 from the camera, positive to the right of the picture
//! elevation = 35                  # degrees above the horizon
//! width = 1.2                     # softbox: any unit of length, the same for all three
//! height = 1.2
//! distance = 2
//! kelvin = 5600                   # or rgb = [1, 0.5, 0.2], linear Rec.709; white if neither
//! stops = 0                       # 0: a white diffuser facing the lamp becomes 1
//! ```
//!
//! | kind | its own keys |
//! |---|---|
//! | `directional` | none |
//! | `disc` | `radius` in degrees |
//! | `softbox` | `width`, `height`, `distance`; `turn` in degrees |
//! | `ring` | `inner`, `outer` in degrees from its middle |
//! | `dome` | `horizon_kelvin` or `horizon_rgb`, `horizon_stops` against the zenith, `ground` (albedo); no azimuth or elevation |

use std::path::{Path, PathBuf};

use super::table::{Bounds, Place, Table, nearest, read_text};
use crate::error::{Error, Result};
use crate::illumination::Lighting;
use crate::illumination::lighting::{Aim, Lamp, Shape, kelvin};

/// A lighting that ships.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Preset {
    /// Permanent name.
    pub id: &'static str,
    /// What hosts show; the file's title.
    pub label: &'static str,
    /// Its file.
    pub text: &'static str,
}

macro_rules! presets {
    ($(($id:literal, $label:literal)),* $(,)?) => {
        /// The lightings that ship, in permanent order: compositing projects store places in this list.
        pub const PRESETS: &[Preset] = &[$(Preset {
            id: $id, label: $label, text: include_str!(concat!("../../../presets/lighting/", $id, ".toml")),
        }),*];
        /// Choices of the plugin: none, then [`PRESETS`].
        pub const OPTIONS: &[(&str, &str)] = &[("none", "None"), $(($id, $label)),*];
    };
}

presets![
    ("key", "Key"),
    ("rim", "Rim"),
    ("three-point", "Three-point"),
    ("softbox-left", "Softbox left"),
    ("softbox-right", "Softbox right"),
    ("top", "Top"),
    ("ring", "Ring"),
    ("butterfly", "Butterfly"),
    ("rembrandt", "Rembrandt"),
    ("split", "Split"),
    ("clamshell", "Clamshell"),
    ("window", "Window"),
    ("high-key", "High key"),
    ("duotone", "Duotone"),
    ("daylight", "Daylight"),
    ("overcast", "Overcast"),
    ("sunset", "Sunset"),
    ("moonlight", "Moonlight"),
];

/// A lighting with what its file says of it.
#[derive(Debug, Clone, PartialEq)]
pub struct LightingFile {
    /// A name for lists; may be empty.
    pub title: String,
    /// A line on what it is for; may be empty.
    pub about: String,
    /// The lamps.
    pub lighting: Lighting,
}

/// The preset of a name.
pub fn preset(id: &str) -> Option<&'static Preset> {
    PRESETS.iter().find(|preset| preset.id == id)
}

impl Preset {
    /// Its lamps.
    ///
    /// # Errors
    /// None for the presets that ship: a test loads each.
    pub fn load(&self) -> Result<LightingFile> {
        parse(&format!("preset {}", self.id), self.text)
    }
}

/// The lighting of a preset's name, or of a file (relative to `folder`): what has a separator or an extension, or exists,
/// is a file.
///
/// # Errors
/// As [`load`]; a name that is neither, with the nearest preset.
pub fn find(name: &str, folder: &Path) -> Result<LightingFile> {
    if let Some(preset) = preset(name) {
        return preset.load();
    }
    let path = PathBuf::from(name);
    let file = folder.join(&path);
    if path.extension().is_some() || path.components().count() > 1 || file.is_file() {
        return load(&file);
    }
    let ids: Vec<&str> = PRESETS.iter().map(|preset| preset.id).collect();
    let meant = nearest(&ids, name).map_or_else(String::new, |id| format!("`{id}`: "));
    let expected = format!("{meant}a .toml file, or one of the presets {}", ids.join(", "));
    Err(Error::invalid("lighting", format!("`{name}`"), expected))
}

/// Reads a lighting file.
///
/// # Errors
/// A file that cannot be read; as [`parse`].
pub fn load(path: &Path) -> Result<LightingFile> {
    parse(&path.display().to_string(), &read_text(path)?)
}

/// Reads the text of a lighting file; `file` is how messages call it.
///
/// # Errors
/// Broken TOML, an unknown key (with the nearest known one), a missing one, a number that is none or out of bounds; with
/// file and line.
pub fn parse(file: &str, text: &str) -> Result<LightingFile> {
    let place = Place::new(file, text);
    let table = place.parse()?;
    let root = Table::root(place, &table, "a lighting file");
    root.only(&["title", "about", "light"])?;
    let lamps = root.tables("light")?.iter().map(lamp).collect::<Result<Vec<_>>>()?;
    if lamps.is_empty() {
        return Err(root.refuse("no light", "at least one table that begins with `[[light]]`"));
    }
    let (title, about) = (root.text_or_empty("title")?.to_owned(), root.text_or_empty("about")?.to_owned());
    Ok(LightingFile { title, about, lighting: Lighting { lamps } })
}

pub(super) const AZIMUTH: Bounds = Bounds::new(-360.0, 360.0, "degrees");
pub(super) const ELEVATION: Bounds = Bounds::new(-90.0, 90.0, "degrees");
pub(super) const TURN: Bounds = Bounds::new(-360.0, 360.0, "degrees");
/// A hundredth of a degree, far below any lamp, to the whole sphere.
const RADIUS: Bounds = Bounds::new(0.01, 180.0, "degrees");
const INNER: Bounds = Bounds::new(0.0, 179.99, "degrees");
/// Ratios of these stay far from the ends of what a float holds.
pub(super) const LENGTH: Bounds = Bounds::new(1e-3, 1e5, "");
pub(super) const STOPS: Bounds = Bounds::new(-40.0, 40.0, "stops");
const KELVIN: Bounds = Bounds::new(kelvin::RANGE.0, kelvin::RANGE.1, "kelvin");
const COLOUR: Bounds = Bounds::new(0.0, 1000.0, "");
const ALBEDO: Bounds = Bounds::new(0.0, 1.0, "");

/// Words for `kind`.
pub(super) const KINDS: [&str; 5] = ["directional", "disc", "softbox", "ring", "dome"];
/// What messages call each.
pub(super) const CALLED: [&str; 5] = ["a directional light", "a disc", "a softbox", "a ring", "a dome"];

/// Keys of every kind, then its own.
pub(super) fn keys(kind: usize) -> Vec<&'static str> {
    let aim = ["azimuth", "elevation"];
    let own: &[&str] = match kind {
        1 => &["radius"],
        2 => &["width", "height", "distance", "turn"],
        3 => &["inner", "outer"],
        4 => &["horizon_kelvin", "horizon_rgb", "horizon_stops", "ground"],
        _ => &[],
    };
    let aim = if kind == 4 { &[][..] } else { &aim[..] };
    [&["kind", "name", "kelvin", "rgb", "stops"], aim, own].concat()
}

fn lamp(table: &Table<'_>) -> Result<Lamp> {
    let table = table.called("a light");
    let kind = match table.get("kind") {
        Some(kind) => kind.choice(&KINDS)?,
        None => {
            let every: Vec<&str> = (0..KINDS.len()).flat_map(keys).collect();
            table.only(&every)?;
            return Err(table.refuse("no `kind` in a light", format!("`kind = \"...\"`, one of {}", KINDS.join(", "))));
        }
    };
    let table = table.called(CALLED[kind]);
    table.only(&keys(kind))?;
    table.text_or_empty("name")?;
    let colour = colour(&table, "kelvin", "rgb")?.unwrap_or([1.0; 3]);
    let stops = table.number_or("stops", STOPS, 0.0)?;
    Ok(Lamp { shape: shape(&table, kind, colour)?, colour, stops })
}

/// A colour by temperature or as such; `None` where neither is given.
pub(super) fn colour(table: &Table<'_>, kelvin_key: &'static str, rgb_key: &'static str) -> Result<Option<[f64; 3]>> {
    match (table.get(kelvin_key), table.get(rgb_key)) {
        (Some(_), Some(rgb)) => Err(rgb.refuse("a second colour", format!("either `{kelvin_key}` or `{rgb_key}`"))),
        (Some(temperature), None) => Ok(Some(kelvin::rgb(temperature.number(KELVIN)?))),
        (None, Some(rgb)) => rgb.numbers(COLOUR).map(Some),
        (None, None) => Ok(None),
    }
}

/// The form of a lamp of a kind.
pub(super) fn shape(table: &Table<'_>, kind: usize, colour_of_zenith: [f64; 3]) -> Result<Shape> {
    let need = |key: &'static str, bounds: Bounds| table.need(key)?.number(bounds);
    if kind == 4 {
        let horizon = colour(table, "horizon_kelvin", "horizon_rgb")?.unwrap_or(colour_of_zenith);
        let horizon_stops = table.number_or("horizon_stops", STOPS, 0.0)?;
        return Ok(Shape::Dome { horizon, horizon_stops, ground: table.number_or("ground", ALBEDO, 0.0)? });
    }
    let aim = Aim {
        azimuth_rad: need("azimuth", AZIMUTH)?.to_radians(),
        elevation_rad: need("elevation", ELEVATION)?.to_radians(),
    };
    Ok(match kind {
        0 => Shape::Directional { aim },
        1 => Shape::Disc { aim, radius_rad: need("radius", RADIUS)?.to_radians() },
        2 => Shape::Softbox {
            aim,
            width: need("width", LENGTH)?,
            height: need("height", LENGTH)?,
            distance: need("distance", LENGTH)?,
            turn_rad: table.number_or("turn", TURN, 0.0)?.to_radians(),
        },
        _ => {
            let (inner, outer) = (need("inner", INNER)?, need("outer", RADIUS)?);
            if outer <= inner {
                let expected = format!("more than `inner`, which is {inner}");
                return Err(table.need("outer")?.refuse(outer.to_string(), expected));
            }
            Shape::Ring { aim, inner_rad: inner.to_radians(), outer_rad: outer.to_radians() }
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_preset_loads_under_its_title_and_gives_light() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../presets/lighting");
        let mut files: Vec<String> = std::fs::read_dir(&folder)
            .unwrap()
            .map(|entry| entry.unwrap().path().file_stem().unwrap().to_string_lossy().into_owned())
            .collect();
        files.sort();
        let mut ids: Vec<&str> = PRESETS.iter().map(|preset| preset.id).collect();
        ids.sort_unstable();
        assert_eq!(files, ids, "every file is a preset");
        for preset in PRESETS {
            let file = find(preset.id, Path::new(".")).unwrap();
            assert_eq!(file.title, preset.label);
            assert!(!file.about.is_empty(), "{}", preset.id);
            let beams = file.lighting.beams();
            assert!(!beams.is_empty() && beams.iter().all(|b| (b.direction.norm() - 1.0).abs() < 1e-9));
            assert!(beams.iter().flat_map(|b| b.irradiance).all(|e| e.is_finite() && e >= 0.0), "{}", preset.id);
            let green: f64 = beams.iter().map(|b| b.irradiance[1]).sum();
            // From moonlight to a white studio, within a few stops of a white diffuser at 1.
            assert!((0.05..40.0).contains(&green), "{}: {green}", preset.id);
        }
        assert!(OPTIONS[1..].iter().zip(PRESETS).all(|(option, p)| *option == (p.id, p.label)));
    }

    #[test]
    fn what_is_written_is_what_is_lit() {
        let text = "[[light]]\nkind = \"ring\"\nazimuth = 10\nelevation = -5\ninner = 1\nouter = 2.5\nkelvin = 3200\nstops = -1\n\
                    [[light]]\nkind = \"dome\"\nrgb = [0.1, 0.2, 0.3]\nhorizon_stops = 1\n";
        let lamps = parse("a", text).unwrap().lighting.lamps;
        let aim = Aim { azimuth_rad: 10f64.to_radians(), elevation_rad: -5f64.to_radians() };
        let ring = Shape::Ring { aim, inner_rad: 1f64.to_radians(), outer_rad: 2.5f64.to_radians() };
        assert_eq!(lamps[0], Lamp { shape: ring, colour: kelvin::rgb(3200.0), stops: -1.0 });
        let colour = [0.1, 0.2, 0.3];
        let dome = Shape::Dome { horizon: colour, horizon_stops: 1.0, ground: 0.0 };
        assert_eq!(lamps[1], Lamp { shape: dome, colour, stops: 0.0 });
    }

    /// Each mistake is told with file, line, what is there and what should be.
    #[test]
    fn mistakes_are_told() {
        let disc = "[[light]]\nkind = \"disc\"\nazimuth = 1\nelevation = 2\nradius = 3\n";
        for (text, words) in [
            (disc.replace("azimuth", "azimut"), &["a.toml, line 3", "`azimut`", "`azimuth`", "a disc takes"][..]),
            (disc.replace("radius", "width"), &["line 5", "`width`", "radius"]),
            (disc.replace("[[light]]", "[[lights]]"), &["line 1", "`lights`", "`light`"]),
            (disc.replace("disc", "disk"), &["line 2", "disk", "`disc`"]),
            (disc.replace("disc", "laser"), &["line 2", "laser", "softbox"]),
            (disc.replace("kind = \"disc\"\n", ""), &["line 1", "no `kind`", "softbox"]),
            (disc.replace("azimuth = 1\n", ""), &["line 1", "no `azimuth` in a disc"]),
            (disc.replace("= 1", "= \"45deg\""), &["line 3", "45deg", "degrees", "azimuth = 45"]),
            (disc.replace("= 1", "= 45deg"), &["line 3", "45deg", "numbers bare"]),
            (disc.replace("= 1", "= 1,5"), &["line 3", "1,5"]),
            (disc.replace("= 1", "= 361"), &["line 3", "361", "-360 to 360 degrees"]),
            (disc.replace("= 1", "= nan"), &["line 3", "nan", "azimuth"]),
            (disc.replace("= 2", "= -91"), &["line 4", "-91", "-90 to 90"]),
            (disc.replace("= 3", "= 0"), &["line 5", "radius", "0.01 to 180"]),
            (disc.replace("= 3", "= [3]"), &["line 5", "a list of 1", "a number"]),
            (format!("{disc}kelvin = 900\n"), &["line 6", "900", "1000 to 40000 kelvin"]),
            (format!("{disc}kelvin = 3000\nrgb = [1, 1, 1]\n"), &["line 7", "`kelvin` or `rgb`"]),
            (format!("{disc}rgb = [1, 1]\n"), &["line 6", "a list of 2", "3 numbers"]),
            (format!("{disc}rgb = [1, 1, -1]\n"), &["line 6", "-1", "0 to 1000"]),
            (format!("{disc}radius = 4\n"), &["line 6", "duplicate key"]),
            (format!("{disc}stops = inf\n"), &["line 6", "inf", "stops"]),
            (
                "[[light]]\nkind = \"ring\"\nazimuth = 0\nelevation = 0\ninner = 5\nouter = 5\n".to_owned(),
                &["line 6", "`outer`", "`inner`"],
            ),
            (String::new(), &["a.toml", "no light", "[[light]]"]),
            ("light = 3\n".to_owned(), &["line 1", "[[light]]"]),
        ] {
            let message = parse("a.toml", &text).unwrap_err().to_string();
            for word in words {
                assert!(message.contains(word), "no `{word}` in: {message}");
            }
            assert!(!message.contains('\n'), "{message}");
        }
    }

    #[test]
    fn names_are_presets_or_files() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("mine"), PRESETS[0].text).unwrap();
        std::fs::write(folder.path().join("bad.toml"), [0xff, 0xfe]).unwrap();
        assert_eq!(find("mine", folder.path()).unwrap().title, "Key");
        for (name, words) in [
            ("threepoint", &["`threepoint`", "`three-point`"][..]),
            ("zzz", &["`zzz`", "presets key, rim"]),
            ("absent.toml", &["absent.toml", "cannot read"]),
            ("./key", &["cannot read"]),
            ("bad.toml", &["bad.toml", "UTF-8"]),
        ] {
            let message = find(name, folder.path()).unwrap_err().to_string();
            assert!(words.iter().all(|word| message.contains(word)), "{message}");
        }
    }
}
