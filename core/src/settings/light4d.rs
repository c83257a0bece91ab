//! Light files: light that varies in space, in TOML, and the presets that ship.
//!
//! ```toml
//! title = "Desk lamp"             # for lists
//! about = "One lamp, near."       # a line on what it is for
//!
//! [[light]]
//! kind = "spot"                   # point | spot | area | slide | sun | map | probes, or a kind of a lighting file
//! name = "lamp"                   # what messages call it [its kind and number]
//! position = [-0.6, 3, 0.8]       # stage frame, in the units of the rig's positions: right, up, towards the camera
//! aim = [0, 0, 0]                 # where it points, and where stops count [the origin]
//! beam = 20                       # degrees across the even part
//! edge = 5                        # degrees beyond it over which light falls to nothing [0]
//! kelvin = 3200                   # or rgb = [1, 0.5, 0.2], linear Rec.709; white if neither
//! stops = 0                       # 0: a white diffuser at the aim that faces the light becomes 1 [0]
//!
//! [[light]]
//! kind = "sun"
//! azimuth = 35                    # as in lighting files
//! elevation = 35
//!
//! [light.blinds]                  # of the light above it: all of its light comes through a window
//! position = [1.4, 1.7, 2.0]      # the middle of the window
//! facing = [-0.57, 0, -0.82]      # where it faces, into the room [from its middle to the origin]
//! width = 3
//! height = 3
//! spacing = 0.5                   # from slat to slat; without it the window is open
//! slat = 0.5                      # width of a slat [the spacing]
//! tilt = 20                       # degrees: 0 edge-on, 90 shut; positive lets light from above in [0]
//! turn = 0                        # 90: vertical blinds [0]
//! # open = 0.5                    # in place of slat and tilt: flat strips, and this share open
//! ```
//!
//! | kind | its own keys |
//! |---|---|
//! | `point` | `position`, `aim` |
//! | `spot` | `position`, `aim`, `beam`, `edge` |
//! | `area` | `position`, `aim`, `up`, `turn`, `width`, `height`: a rectangle that shines towards its aim |
//! | `slide` | `position`, `aim`, `up`, `turn`, `view` (degrees across its picture), `image`, `lookup` ("smooth" or "squares") |
//! | `sun` | `azimuth`, `elevation`, `diameter` in degrees (0.53 if absent) |
//! | `map` | `file`: a lat-long map; `map_centre` and `rotation` as in animation scripts; stops 0 leaves it as it is |
//! | `probes` | `origin`, `across`, `down`, `deep` (from a probe to the next), `columns`, `rows`, `layers`; `files`, row after row, or `pattern` with `{column}`, `{row}` and `{layer}` (`{row:02}`: two digits), counted from `first` (0) |
//! | `directional`, `disc`, `softbox`, `ring`, `dome` | as in [lighting files](super::lighting) |
//!
//! Paths are relative to the file. Maps wider than 2048 texels and probes wider than 256 are averaged down to that: 1.4 degrees a
//! texel is a fourth of what lies between two positions of a dense gantry.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::lighting::{self, AZIMUTH, ELEVATION, LENGTH, STOPS, TURN};
use super::table::{Bounds, Place, Table, Value, nearest, read_text};
use crate::error::{Error, Result};
use crate::files::folder_of;
use crate::illumination::light_field::{
    Area, Blinds, Emitter, Far, Frame, Lookup, Point, Probes, ProbesAt, Slats, Slide, Source, Spot, far_lamp,
};
use crate::illumination::lighting::{Aim, Lamp};
use crate::illumination::{EnvMap, LightField, MapCentre};
use crate::image::{Encoding, read};
use crate::math::Vec3;

/// A light field that ships.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Preset {
    /// Permanent name.
    pub id: &'static str,
    /// What hosts show; the file's title.
    pub label: &'static str,
    /// Its file, which names no other.
    pub text: &'static str,
}

macro_rules! presets {
    ($(($id:literal, $label:literal)),* $(,)?) => {
        /// The light fields that ship, in permanent order: compositing projects store places in this list.
        pub const PRESETS: &[Preset] = &[$(Preset {
            id: $id, label: $label, text: include_str!(concat!("../../../presets/light4d/", $id, ".toml")),
        }),*];
        /// Choices of the plugin: none, then [`PRESETS`].
        pub const OPTIONS: &[(&str, &str)] = &[("none", "None"), $(($id, $label)),*];
    };
}

presets![
    ("three-beams", "Three beams"),
    ("venetian-blinds", "Venetian blinds"),
    ("two-lamps", "Two lamps"),
    ("desk-spot", "Desk spot"),
];

/// A light field with what its file says of it.
#[derive(Debug, Clone, PartialEq)]
pub struct LightFile {
    /// A name for lists; may be empty.
    pub title: String,
    /// A line on what it is for; may be empty.
    pub about: String,
    /// The light.
    pub light: LightField,
    /// The pictures that were read for it, in order.
    pub pictures: Vec<PathBuf>,
}

/// The preset of a name.
pub fn preset(id: &str) -> Option<&'static Preset> {
    PRESETS.iter().find(|preset| preset.id == id)
}

impl Preset {
    /// Its light.
    ///
    /// # Errors
    /// None for the presets that ship: a test loads each.
    pub fn load(&self) -> Result<LightFile> {
        parse(&format!("preset {}", self.id), self.text, Path::new("."))
    }
}

/// The light field of a preset's name, or of a file (relative to `folder`): what has a separator or an extension, or exists, is
/// a file.
///
/// # Errors
/// As [`load`]; a name that is neither, with the nearest preset.
pub fn find(name: &str, folder: &Path) -> Result<LightFile> {
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
    Err(Error::invalid("light field", format!("`{name}`"), expected))
}

/// Reads a light file and the pictures that it names.
///
/// # Errors
/// A file that cannot be read; as [`parse`].
pub fn load(path: &Path) -> Result<LightFile> {
    parse(&path.display().to_string(), &read_text(path)?, folder_of(path))
}

/// Reads the text of a light file; `file` is how messages call it, `folder` where the paths in it start.
///
/// # Errors
/// As for [lighting files](lighting::parse), with file and line; a picture that cannot be read; a hole in a grid of probes, with
/// column and row; a light at its own aim, or in front of its own blinds.
pub fn parse(file: &str, text: &str, folder: &Path) -> Result<LightFile> {
    let place = Place::new(file, text);
    let table = place.parse()?;
    let root = Table::root(place, &table, "a light file");
    root.only(&["title", "about", "light"])?;
    let mut reader = Reader { folder, pictures: Vec::new() };
    let tables = root.tables("light")?;
    let sources =
        tables.iter().enumerate().map(|(n, table)| reader.source(table, n + 1)).collect::<Result<Vec<_>>>()?;
    if sources.is_empty() {
        return Err(root.refuse("no light", "at least one table that begins with `[[light]]`"));
    }
    let (title, about) = (root.text_or_empty("title")?.to_owned(), root.text_or_empty("about")?.to_owned());
    Ok(LightFile { title, about, light: LightField::new(sources), pictures: reader.pictures })
}

/// Coordinates; lengths have the same upper end.
const PLACE: Bounds = Bounds::new(-1e5, 1e5, "");
const DIRECTION: Bounds = Bounds::new(-1e5, 1e5, "");
/// From a needle of light to half of all directions.
const BEAM: Bounds = Bounds::new(0.01, 180.0, "degrees");
const EDGE: Bounds = Bounds::new(0.0, 90.0, "degrees");
/// Pictures are flat: none is as wide as half of all directions.
const VIEW: Bounds = Bounds::new(0.01, 170.0, "degrees");
const DIAMETER: Bounds = Bounds::new(0.0, 90.0, "degrees");
const TILT: Bounds = Bounds::new(-90.0, 90.0, "degrees");
const SHARE: Bounds = Bounds::new(0.0, 1.0, "");
const COUNT: Bounds = Bounds::new(1.0, 4096.0, "");
/// Maps of 256 x 128 texels then take 1.6 GB.
const MOST_PROBES: usize = 4096;
/// The sun's mean diameter in the sky.
const SUN_DEG: f64 = 0.53;
const WIDEST_MAP: usize = 2048;
const WIDEST_PROBE: usize = 256;

const OWN: [&str; 7] = ["point", "spot", "area", "slide", "sun", "map", "probes"];
const CALLED: [&str; 7] = ["a point light", "a spot", "an area", "a slide", "a sun", "a map", "a grid of probes"];

/// Keys of every kind, then its own.
fn keys(kind: usize) -> Vec<&'static str> {
    if let Some(far) = kind.checked_sub(OWN.len()) {
        return [lighting::keys(far), vec!["blinds"]].concat();
    }
    let own: &[&str] = match kind {
        0 => &["position", "aim"],
        1 => &["position", "aim", "beam", "edge"],
        2 => &["position", "aim", "up", "turn", "width", "height"],
        3 => &["position", "aim", "up", "turn", "view", "image", "lookup"],
        4 => &["azimuth", "elevation", "diameter"],
        5 => &["file", "map_centre", "rotation"],
        _ => &["origin", "across", "down", "deep", "columns", "rows", "layers", "files", "pattern", "first"],
    };
    [&["kind", "name", "kelvin", "rgb", "stops", "blinds"], own].concat()
}

fn vector(table: &Table<'_>, key: &'static str) -> Result<Vec3> {
    table.need(key)?.numbers(PLACE).map(Vec3::from)
}

fn vector_or(table: &Table<'_>, key: &'static str, default: Vec3) -> Result<Vec3> {
    table.get(key).map_or(Ok(default), |value| value.numbers(PLACE).map(Vec3::from))
}

fn aim_of(table: &Table<'_>) -> Result<Aim> {
    Ok(Aim {
        azimuth_rad: table.need("azimuth")?.number(AZIMUTH)?.to_radians(),
        elevation_rad: table.need("elevation")?.number(ELEVATION)?.to_radians(),
    })
}

/// Position, aim, up and turn.
fn frame(table: &Table<'_>) -> Result<Frame> {
    let position = vector(table, "position")?;
    let up = vector_or(table, "up", Vec3::y())?;
    if up.norm() == 0.0 {
        return Err(table.need("up")?.refuse("[0, 0, 0]", "a direction, such as [0, 1, 0]"));
    }
    let frame = Frame::new(position, vector_or(table, "aim", Vec3::zeros())?, up);
    let frame = frame.ok_or_else(|| at_its_aim(table))?;
    Ok(frame.rolled(table.number_or("turn", TURN, 0.0)?.to_radians()))
}

fn at_its_aim(table: &Table<'_>) -> Error {
    table.refuse("a light whose `position` is its `aim` (the origin if it has none)", "two different points")
}

/// Reads lights, and the pictures they name.
struct Reader<'a> {
    folder: &'a Path,
    pictures: Vec<PathBuf>,
}

impl Reader<'_> {
    fn source(&mut self, table: &Table<'_>, number: usize) -> Result<Source> {
        let table = table.called("a light");
        let kinds = [&OWN[..], &lighting::KINDS].concat();
        let kind = match table.get("kind") {
            Some(kind) => kind.choice(&kinds)?,
            None => {
                let every: Vec<&str> = (0..kinds.len()).flat_map(keys).collect();
                table.only(&every)?;
                let expected = format!("`kind = \"...\"`, one of {}", kinds.join(", "));
                return Err(table.refuse("no `kind` in a light", expected));
            }
        };
        let called = CALLED.get(kind).or_else(|| lighting::CALLED.get(kind - OWN.len()));
        let table = table.called(called.copied().unwrap_or("a light"));
        table.only(&keys(kind))?;
        let colour = lighting::colour(&table, "kelvin", "rgb")?.unwrap_or([1.0; 3]);
        let stops = table.number_or("stops", STOPS, 0.0)?;
        let shadowed = table.get("blinds").is_some();
        let name = match table.text_or_empty("name")? {
            "" => format!("{} {number}", kinds[kind]),
            name => name.to_owned(),
        };
        let source = match kind.checked_sub(OWN.len()) {
            // A lamp has its colour and stops in its own beams.
            Some(far) => {
                let lamp = Lamp { shape: lighting::shape(&table, far, colour)?, colour, stops };
                Source::new(name, far_lamp(&lamp, shadowed))
            }
            None => Source::new(name, self.emitter(&table, kind, shadowed)?).lit(colour, stops),
        };
        match table.get("blinds") {
            Some(value) => Ok(source.clone().behind(blinds(&value, &source)?)),
            None => Ok(source),
        }
    }

    fn emitter(&mut self, table: &Table<'_>, kind: usize, shadowed: bool) -> Result<Emitter> {
        let need = |key: &'static str, bounds: Bounds| table.need(key)?.number(bounds);
        Ok(match kind {
            0 => {
                let (place, aim) = (vector(table, "position")?, vector_or(table, "aim", Vec3::zeros())?);
                Emitter::Point(Point::new(place, aim).ok_or_else(|| at_its_aim(table))?)
            }
            1 => {
                let edge = table.number_or("edge", EDGE, 0.0)?;
                Emitter::Spot(Spot::new(frame(table)?, need("beam", BEAM)?.to_radians(), edge.to_radians()))
            }
            2 => Emitter::Area(Area::new(frame(table)?, need("width", LENGTH)?, need("height", LENGTH)?)),
            3 => Emitter::Slide(self.slide(table)?),
            4 => {
                let diameter = table.number_or("diameter", DIAMETER, SUN_DEG)?;
                Emitter::Far(Far::sun(&aim_of(table)?, diameter.to_radians(), shadowed))
            }
            5 => Emitter::Map(Arc::new(self.map(table)?)),
            _ => Emitter::Probes(self.probes(table)?),
        })
    }

    /// The file of a path, as it was read.
    fn path(&mut self, path: &str) -> PathBuf {
        let path = self.folder.join(path);
        self.pictures.push(path.clone());
        path
    }

    fn slide(&mut self, table: &Table<'_>) -> Result<Slide> {
        let frame = frame(table)?;
        let view = table.need("view")?.number(VIEW)?.to_radians();
        let lookup = match table.get("lookup") {
            Some(value) => [Lookup::Smooth, Lookup::Squares][value.choice(&["smooth", "squares"])?],
            None => Lookup::default(),
        };
        let value = table.need("image")?;
        let picture = read(&self.path(value.text()?), Encoding::Auto).map_err(|error| unreadable(&value, &error))?;
        let size = format!("a picture of {} x {} pixels", picture.width(), picture.height());
        Slide::new(frame, view, picture, lookup).ok_or_else(|| value.refuse(size, "at least one pixel"))
    }

    fn map(&mut self, table: &Table<'_>) -> Result<EnvMap> {
        let value = table.need("file")?;
        let centre = match table.get("map_centre") {
            Some(value) => [MapCentre::Front, MapCentre::Behind][value.choice(&["front", "behind"])?],
            None => MapCentre::default(),
        };
        let heading = table.number_or("rotation", TURN, 0.0)?;
        let map = EnvMap::load(&self.path(value.text()?)).map_err(|error| unreadable(&value, &error))?;
        let map = map.reduced(WIDEST_MAP);
        Ok(if centre == MapCentre::Front && heading == 0.0 { map.into_owned() } else { map.oriented(centre, heading) })
    }

    fn probes(&mut self, table: &Table<'_>) -> Result<Probes> {
        let count = |key: &'static str, default: Option<f64>| match (table.get(key), default) {
            (Some(value), _) => value.whole(COUNT).map(|n| n as usize),
            (None, Some(default)) => Ok(default as usize),
            (None, None) => table.need(key).map(|_| 0),
        };
        let counts = [count("columns", None)?, count("rows", None)?, count("layers", Some(1.0))?];
        if counts.iter().product::<usize>() > MOST_PROBES {
            let found = format!("{} x {} x {} probes", counts[0], counts[1], counts[2]);
            return Err(table.need("columns")?.refuse(found, format!("at most {MOST_PROBES} in all")));
        }
        let step = |n: usize, key: &'static str| match counts[n] {
            1 => vector_or(table, key, Vec3::zeros()),
            _ => vector(table, key),
        };
        let (across, down, deep) = (step(0, "across")?, step(1, "down")?, step(2, "deep")?);
        let at = ProbesAt { origin: vector_or(table, "origin", Vec3::zeros())?, across, down, deep, counts };
        let names = probe_files(table, counts)?;
        let mut maps = Vec::with_capacity(names.len());
        for (n, (value, name)) in names.iter().enumerate() {
            let map = EnvMap::load(&self.path(name)).map_err(|error| hole(value, n, counts, &error))?;
            maps.push(map.reduced(WIDEST_PROBE).into_owned());
        }
        Probes::new(&at, maps).ok_or_else(|| {
            let found = "steps `across`, `down` and `deep` of which one is zero or along the others";
            table.refuse(found, "steps that span a grid")
        })
    }
}

fn unreadable(value: &Value<'_>, error: &Error) -> Error {
    value.refuse(format!("a picture that cannot be used ({error})"), "a picture, named relative to this file")
}

fn hole(value: &Value<'_>, n: usize, [columns, rows, layers]: [usize; 3], error: &Error) -> Error {
    let layer = if layers > 1 { format!(", layer {}", n / (columns * rows)) } else { String::new() };
    let (column, row) = (n % columns, n / columns % rows);
    let found = format!("a hole in the grid at column {column}, row {row}{layer}, counted from 0 ({error})");
    value.refuse(found, "a map that can be read for every probe")
}

/// The names of all maps of a grid, each with the value that names it.
fn probe_files<'a>(table: &Table<'a>, counts: [usize; 3]) -> Result<Vec<(Value<'a>, String)>> {
    let all: usize = counts.iter().product();
    match (table.get("files"), table.get("pattern")) {
        (Some(_), Some(pattern)) => Err(pattern.refuse("a second list", "either `files` or `pattern`")),
        (None, None) => Err(table.refuse("neither `files` nor `pattern` in a grid of probes", "one of them")),
        (Some(files), None) => {
            let expected = format!("a list of {all} names, row after row, {} a row", counts[0]);
            let items = files.list().ok_or_else(|| files.refuse("no list", expected.clone()))?;
            if items.len() != all {
                return Err(files.refuse(format!("a list of {}", items.len()), expected));
            }
            items.into_iter().map(|item| item.text().map(|text| (item, text.to_owned()))).collect()
        }
        (None, Some(pattern)) => {
            let first = table.number_or("first", Bounds::new(0.0, 1e6, ""), 0.0)? as usize;
            let name = |n: usize| {
                let at = [n % counts[0], n / counts[0] % counts[1], n / (counts[0] * counts[1])];
                filled(&pattern, at.map(|n| n + first), counts).map(|name| (pattern, name))
            };
            (0..all).map(name).collect()
        }
    }
}

/// A pattern with the numbers of a probe in place of `{column}`, `{row}`, `{layer}`.
fn filled(pattern: &Value<'_>, numbers: [usize; 3], counts: [usize; 3]) -> Result<String> {
    const NAMES: [&str; 3] = ["column", "row", "layer"];
    let expected = "names such as \"probe_{column:02}_{row:02}.exr\"";
    let (mut out, mut rest, mut used) = (String::new(), pattern.text()?, [false; 3]);
    while let Some(open) = rest.find('{') {
        out.push_str(&rest[..open]);
        let Some(close) = rest[open..].find('}') else { return Err(pattern.refuse("a `{` without `}`", expected)) };
        let inside = &rest[open + 1..open + close];
        let (name, width) = inside.split_once(':').unwrap_or((inside, "0"));
        let digits = width.parse::<usize>().ok().filter(|digits| *digits <= 9);
        match (NAMES.iter().position(|known| *known == name), digits) {
            (Some(n), Some(digits)) => {
                used[n] = true;
                out.push_str(&format!("{:0digits$}", numbers[n]));
            }
            _ => return Err(pattern.refuse(format!("`{{{inside}}}`"), expected)),
        }
        rest = &rest[open + close + 1..];
    }
    out.push_str(rest);
    match (0..3).find(|n| counts[*n] > 1 && !used[*n]) {
        Some(n) => Err(pattern.refuse(format!("no `{{{}}}`", NAMES[n]), expected)),
        None => Ok(out),
    }
}

/// What stands before a source.
fn blinds(value: &Value<'_>, source: &Source) -> Result<Blinds> {
    let table = value.table().ok_or_else(|| value.refuse("no table", "a table that begins with `[light.blinds]`"))?;
    let table = table.called("blinds");
    table.only(&["position", "facing", "width", "height", "spacing", "slat", "tilt", "open", "turn"])?;
    let position = vector(&table, "position")?;
    let facing = match table.get("facing") {
        Some(facing) => Vec3::from(facing.numbers(DIRECTION)?),
        None => -position,
    };
    let frame = Frame::new(position, position + facing, Vec3::y());
    let frame = frame.ok_or_else(|| table.refuse("blinds that face nowhere", "`facing = [x, y, z]`, into the room"))?;
    let size = |key: &'static str| table.need(key)?.number(LENGTH);
    let blinds = Blinds::new(frame, size("width")?, size("height")?, slats(&table)?);
    let (towards, distance) = match (&source.emitter, source.emitter.place()) {
        (_, Some(place)) => (place.try_normalize(0.0).unwrap_or(-frame.axis), place.norm()),
        (Emitter::Far(far), None) => (far.beams.first().map_or(-frame.axis, |beam| beam.direction), f64::INFINITY),
        (_, None) => (-frame.axis, f64::INFINITY),
    };
    if blinds.shades(&towards, distance) {
        return Ok(blinds);
    }
    let found = format!("blinds that are not between the origin and `{}`", source.name);
    Err(table.refuse(found, "a window that faces the origin, with the light behind it"))
}

fn slats(table: &Table<'_>) -> Result<Option<Slats>> {
    let Some(spacing) = table.get("spacing") else {
        let stray = ["slat", "tilt", "open", "turn"].into_iter().find_map(|key| table.get(key));
        return stray.map_or(Ok(None), |value| Err(value.refuse("slats", "`spacing` beside it, from slat to slat")));
    };
    let spacing = spacing.number(LENGTH)?;
    let turn_rad = table.number_or("turn", TURN, 0.0)?.to_radians();
    if let Some(open) = table.get("open") {
        if table.get("slat").or(table.get("tilt")).is_some() {
            return Err(open.refuse("strips and slats", "either `open`, or `slat` and `tilt`"));
        }
        return Ok(Some(Slats::strips(spacing, open.number(SHARE)?, turn_rad)));
    }
    let width = table.number_or("slat", LENGTH, spacing)?;
    Ok(Some(Slats { spacing, width, tilt_rad: table.number_or("tilt", TILT, 0.0)?.to_radians(), turn_rad }))
}

#[cfg(test)]
mod tests;
