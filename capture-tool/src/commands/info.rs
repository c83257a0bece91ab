//! `relume info`: what a container says of itself.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::PathBuf;

use clap::Args;
use relume_core::domain::{Axis, Coverage, Directions, Domain, Filter, Gantry};
use relume_core::field::{Access, Asset, Kind, Layout, Precision, Representation};
use serde::Serialize;

const EXAMPLES: &str = "\
Examples:
  relume info vase.rfield
  relume info vase.rfield --json";

/// Raw flags.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    /// The .rfield file.
    asset: PathBuf,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

impl Arguments {
    /// Opens and tells.
    pub fn run(self) -> anyhow::Result<String> {
        let asset = Asset::open(&self.asset, Access::Read)?;
        let info = Info::of(&asset);
        if self.json { Ok(serde_json::to_string_pretty(&info)? + "\n") } else { Ok(info.table()?) }
    }
}

/// What is told. Field names are those of the JSON: permanent.
#[derive(Debug, Serialize)]
pub(super) struct Info<'a> {
    file: String,
    file_bytes: u64,
    format: &'a str,
    version: [u32; 2],
    tool: &'a str,
    colour_space: &'a str,
    width: usize,
    height: usize,
    #[serde(flatten)]
    emits: Emits,
    /// Of the samples, where they are held as photographed.
    precision: Option<Precision>,
    /// The same; all digits: exact in double precision.
    scale: Option<f64>,
    /// Bytes of the samples at the lamps as halves, to compare with.
    half_samples_bytes: u64,
    representations: Vec<Held>,
    layers: &'a BTreeMap<String, String>,
    provenance: &'a serde_json::Value,
}

/// What the rig could emit.
#[derive(Debug, Serialize)]
#[serde(untagged)]
enum Emits {
    Lamps {
        lamps: usize,
        /// Distinct directions.
        sites: usize,
        axis: Axis,
        coverage: CoverageInfo,
        median_spacing_deg: f64,
        /// Smallest and largest E_j.
        irradiance: [f32; 2],
    },
    Screen {
        /// Columns and rows.
        texels: [usize; 2],
        /// Is it known where on the screen each pixel looks?
        correspondence: bool,
    },
    Projector {
        /// Where it stood.
        positions: usize,
        /// Along each side of its picture.
        squares: usize,
        /// Across its picture.
        view_deg: f64,
        /// How squares fall off.
        filter: Filter,
        /// From the object, the nearest and the farthest position, scene units.
        distance: [f64; 2],
        coverage: CoverageInfo,
    },
}

impl Emits {
    fn of(asset: &Asset) -> Self {
        let lamps = match asset.domain() {
            Domain::Directions(lamps) => lamps,
            Domain::Plane(plane, correspondence) => {
                let texels = [plane.columns(), plane.rows()];
                return Self::Screen { texels, correspondence: correspondence.is_some() };
            }
            Domain::Gantry(gantry) => return Self::of_gantry(gantry),
        };
        let extremes = |ends: [f32; 2], e: &f32| [ends[0].min(*e), ends[1].max(*e)];
        Self::Lamps {
            lamps: lamps.len(),
            sites: lamps.sites().len(),
            axis: lamps.axis(),
            coverage: CoverageInfo::of(lamps),
            median_spacing_deg: lamps.median_spacing().to_degrees(),
            irradiance: asset.manifest().irradiance().iter().fold([f32::INFINITY, 0.0], extremes),
        }
    }

    fn of_gantry(gantry: &Gantry) -> Self {
        let distances = gantry.poses().iter().map(|pose| pose.place.norm());
        Self::Projector {
            positions: gantry.poses().len(),
            squares: gantry.side(),
            view_deg: gantry.view_rad().to_degrees(),
            filter: gantry.filter(),
            distance: distances.fold([f64::INFINITY, 0.0], |ends, d| [ends[0].min(d), ends[1].max(d)]),
            coverage: CoverageInfo::of(gantry.directions()),
        }
    }

    /// How many, in a few words; and what they cover.
    fn words(&self) -> (String, String) {
        match self {
            Self::Lamps { lamps, coverage, .. } => (format!("{lamps} lamps"), coverage.words()),
            Self::Projector { positions, squares, coverage, .. } => {
                (format!("a projector at {positions} positions, {squares} x {squares} squares"), coverage.words())
            }
            Self::Screen { texels: [columns, rows], correspondence } => {
                let seen = if *correspondence { "known" } else { "unknown: taken to fill the picture" };
                (format!("a screen of {columns} x {rows} texels"), format!("its place in the picture {seen}"))
            }
        }
    }

    /// Lines of the table.
    fn lines(&self) -> Vec<(&'static str, String)> {
        let (many, covered) = self.words();
        match self {
            Self::Lamps { lamps, sites, coverage, median_spacing_deg, irradiance: [least, most], .. } => {
                let count = if lamps == sites { lamps.to_string() } else { format!("{lamps} in {sites} directions") };
                let irradiance = if least == most { least.to_string() } else { format!("{least} to {most}") };
                vec![
                    ("lamps", count),
                    ("coverage", format!("{covered}, {:.3} sr", coverage.solid_angle_sr)),
                    ("spacing", format!("{median_spacing_deg:.2} degrees (median to the nearest lamp)")),
                    ("irradiance", irradiance),
                ]
            }
            Self::Screen { .. } => vec![("emitter", format!("{many}, {covered}"))],
            Self::Projector { view_deg, filter, distance: [near, far], coverage, .. } => {
                let distance = if near == far { format!("{near:.3}") } else { format!("{near:.3} to {far:.3}") };
                vec![
                    ("emitter", many),
                    ("coverage", format!("{covered}, {:.3} sr", coverage.solid_angle_sr)),
                    ("distance", format!("{distance} units from the object")),
                    ("squares", format!("{view_deg:.2} degrees across them all, {} filter", filter.id())),
                ]
            }
        }
    }
}

/// A representation.
#[derive(Debug, Serialize)]
struct Held {
    kind: Kind,
    bytes: u64,
    /// The relative error that was asked for.
    asked: Option<f64>,
    /// The relative error reached over the whole field; 0 for samples, nothing where there was nothing to compare with.
    error: Option<f64>,
    /// What it is, in words.
    words: String,
}

#[derive(Debug, Serialize)]
struct CoverageInfo {
    kind: &'static str,
    half_angle_deg: f64,
    solid_angle_sr: f64,
    #[serde(skip)]
    axis: Axis,
}

impl CoverageInfo {
    fn of(lamps: &Directions) -> Self {
        let (kind, half_angle_deg) = match lamps.coverage() {
            Coverage::Sphere => ("sphere", 180.0),
            Coverage::Cap { half_angle_rad } => ("cap", half_angle_rad.to_degrees()),
        };
        Self { kind, half_angle_deg, solid_angle_sr: lamps.covered_solid_angle(), axis: lamps.axis() }
    }

    fn words(&self) -> String {
        let axis = match self.axis {
            Axis::Z => "+z (towards the camera)",
            Axis::Y => "+y (up)",
        };
        match self.kind {
            "sphere" => "the full sphere".to_owned(),
            _ => format!("a cap of {:.1} degrees about {axis}", self.half_angle_deg),
        }
    }
}

impl<'a> Info<'a> {
    pub(super) fn of(asset: &'a Asset) -> Self {
        let manifest = asset.manifest();
        Self {
            file: asset.path().display().to_string(),
            file_bytes: asset.file_len(),
            format: &manifest.format,
            version: manifest.version,
            tool: &manifest.tool,
            colour_space: &manifest.colour_space,
            width: asset.width(),
            height: asset.height(),
            emits: Emits::of(asset),
            precision: asset.dense().map(|dense| dense.precision()),
            scale: asset.dense().map(|dense| f64::from(dense.scale())),
            half_samples_bytes: half_samples(asset),
            representations: manifest.representations.iter().map(|r| Held::of(asset, r)).collect(),
            layers: &manifest.layers,
            provenance: &manifest.provenance,
        }
    }

    /// One line: lamps, size, coverage, bytes.
    pub(super) fn summary(&self) -> String {
        let (emits, covered) = self.emits.words();
        format!(
            "{}: {emits}, {} x {} pixels, {covered}, {}, {}",
            self.file,
            self.width,
            self.height,
            self.representations.iter().map(|held| held.words.as_str()).collect::<Vec<_>>().join(" and "),
            megabytes(self.file_bytes)
        )
    }

    fn table(&self) -> Result<String, std::fmt::Error> {
        let mut out = String::new();
        let [major, minor] = self.version;
        let layers: Vec<&str> = self.layers.keys().map(String::as_str).collect();
        let layers = if layers.is_empty() { "none".to_owned() } else { layers.join(", ") };
        let mut lines = vec![
            ("file", self.file.clone()),
            ("bytes", format!("{} ({})", self.file_bytes, megabytes(self.file_bytes))),
            ("format", format!("{} {major}.{minor}, written by {}", self.format, self.tool)),
            ("size", format!("{} x {} pixels, {}", self.width, self.height, self.colour_space)),
        ];
        lines.extend(self.emits.lines());
        lines.push(("layers", layers));
        for (name, value) in lines {
            writeln!(out, "{name:<12}{value}")?;
        }
        out += &self.held();
        for (name, value) in self.provenance.as_object().into_iter().flatten() {
            writeln!(out, "{name:<12}{}", provenance_words(value))?;
        }
        Ok(out)
    }

    /// A line for each representation.
    pub(super) fn held(&self) -> String {
        let mut out = String::new();
        for held in &self.representations {
            let lost = match held.kind {
                Kind::Dense | Kind::Explicit => String::new(),
                _ if held.error.is_none() => String::new(),
                _ => format!(
                    ", 1:{:.1} of half samples, error {:.3} %{}",
                    self.half_samples_bytes as f64 / held.bytes.max(1) as f64,
                    100.0 * held.error.unwrap_or_default(),
                    held.asked.map(|asked| format!(" ({:.3} % asked)", 100.0 * asked)).unwrap_or_default()
                ),
            };
            out += &format!("{:<12}{}, {}{lost}\n", held.kind.id(), held.words, megabytes(held.bytes));
        }
        out
    }
}

/// A value of the provenance in a line; long lists by their ends.
fn provenance_words(value: &serde_json::Value) -> String {
    match value {
        serde_json::Value::Null => "none".to_owned(),
        serde_json::Value::String(text) => text.clone(),
        serde_json::Value::Array(items) if items.len() > 2 => {
            let end = |item: Option<&serde_json::Value>| item.map(provenance_words).unwrap_or_default();
            format!("{} ... {} ({})", end(items.first()), end(items.last()), items.len())
        }
        other => other.to_string(),
    }
}

/// Bytes of the samples as halves.
pub(super) fn half_samples(asset: &Asset) -> u64 {
    let layout = Layout { width: asset.width(), height: asset.height(), elements: asset.domain().len() };
    layout.len().unwrap_or(u64::MAX).saturating_mul(Precision::Half.bytes() as u64)
}

impl Held {
    fn of(asset: &Asset, representation: &Representation) -> Self {
        let (kind, loss) = (representation.kind(), representation.loss());
        let words = match representation {
            Representation::Dense { precision, .. } => precision_word(*precision).to_owned(),
            Representation::Harmonics { functions, .. } => format!("{functions} spherical harmonics"),
            Representation::Factored { tile: [w, h], .. } => {
                let ranks = asset.factored().map(|factored| factored.ranks()).unwrap_or_default();
                let (least, most) = (ranks.iter().min().unwrap_or(&0), ranks.iter().max().unwrap_or(&0));
                let mean = ranks.iter().map(|&rank| f64::from(rank)).sum::<f64>() / ranks.len().max(1) as f64;
                format!("tiles of {w} x {h} of ranks {least} to {most}, {mean:.1} on average")
            }
            Representation::Wavelet { wavelet, grid: [w, h], reconstruction, .. } => {
                let terms = asset.sparse().map_or(0, |sparse| sparse.terms()) as f64;
                let each = terms / (asset.width() * asset.height()) as f64;
                let rebuilt = reconstruction.as_ref().map(|r| format!(", rebuilt by {r}")).unwrap_or_default();
                format!("{wavelet} on {w} x {h}{rebuilt}, {each:.1} terms a pixel")
            }
            Representation::Explicit { wavelet, functions, .. } => format!("{functions} functions of {wavelet}"),
        };
        Self {
            kind,
            bytes: asset.bytes(kind),
            asked: loss.and_then(|loss| loss.asked),
            error: loss.map(|loss| loss.reached).or((kind == Kind::Dense).then_some(0.0)),
            words,
        }
    }
}

fn precision_word(precision: Precision) -> &'static str {
    match precision {
        Precision::Half => "half",
        Precision::Float => "float",
    }
}

/// Bytes for people, in units of 1000.
pub(super) fn megabytes(bytes: u64) -> String {
    match bytes as f64 {
        b if b >= 1e9 => format!("{:.2} GB", b / 1e9),
        b if b >= 1e6 => format!("{:.1} MB", b / 1e6),
        b => format!("{:.1} kB", b / 1e3),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_read_well() {
        assert_eq!(megabytes(999), "1.0 kB");
        assert_eq!(megabytes(68_812_345), "68.8 MB");
        assert_eq!(megabytes(3_145_000_000), "3.15 GB");
    }

    #[test]
    fn lists_show_their_ends() {
        assert_eq!(provenance_words(&serde_json::json!(["a", "b", "c"])), "a ... c (3)");
        assert_eq!(provenance_words(&serde_json::json!(null)), "none");
    }
}
