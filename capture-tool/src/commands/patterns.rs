//! `relume patterns`: pattern sets as pictures, for whoever shows them on an emitter of their own.

use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use relume_core::domain::patterns::{Element, Kind, Noise, PatternSet};
use relume_core::domain::{Bits, Emitter, EmitterCurve, Filter, Plane};
use relume_core::image::write_grey;
use relume_core::wavelet::Wavelet;
use relume_core::{Error, files};
use serde::{Deserialize, Serialize};

use super::values;
use crate::new_folder::{self, NewFolder};
use crate::progress::{Progress, Unit};

const EXAMPLES: &str = "\
Examples:
  relume patterns noise -o noise --size 128x128 --count 512 --seed 7
  relume patterns wavelet -o haar --size 64x64 --wavelet haar --count 1000
  relume patterns gray-code -o codes --size 1920x1080
  relume patterns stripes -o stripes --size 1024x1024 --stripes 64
  relume patterns ramp -o ramp --size 16x16
  relume patterns hv -o hv --size 1024x768 --side 32 --influence 3
  relume patterns hv -o hv --size 768x768 --side 16 --filter gaussian --encode projector.txt
  relume patterns noise -o noise --encode measured-gamma.txt --texel 8

Each kind:
  wavelet    functions of a wavelet, coarse to fine, scaled to the range; the positive part of each,
             then the negative one (C = scale (C+ - C-); scales stand in patterns.toml)
  noise      wavelet noise: all functions at once with random weights, about one mean
  stripes    2, 4, 8... stripes, vertical ones, then horizontal ones, each followed by its inverse
  gray-code  the bits of column and row, each followed by its inverse
  ramp       the codes 0 to 255, for measuring the curve of the emitter
  squares    one square of the picture after another, row by row
  hv         every D-th square of a column, then of a row: any one square is what both have in common

Pictures are grey and their names sort in the order of the set. Show them one after another, and
photograph the object under each; photograph it under calibration/black.png too, for no emitter is
black where it shows black. A table for --encode has a line `code light` (or `code red green blue`)
for each code from 0 to 255.";

/// Raw flags.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    /// What the patterns are for.
    #[arg(value_enum)]
    kind: KindChoice,
    /// The folder to write: pictures, patterns.toml, and black and white pictures in calibration/.
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// Texels of the emitter.
    #[arg(long, value_name = "WxH", default_value = "128x128", value_parser = values::grid)]
    size: (usize, usize),
    /// Pixels along each side of a texel.
    #[arg(long, value_name = "PIXELS", default_value_t = 1, value_parser = values::at_least_one)]
    texel: usize,
    /// What the emitter makes of codes; patterns are light, and pictures what makes the emitter show it: linear, srgb, or a
    /// table of measured light.
    #[arg(long, value_name = "linear|srgb|TABLE", default_value = "srgb")]
    encode: String,
    /// Depth of the codes.
    #[arg(long, value_enum, default_value_t = BitsChoice::Eight)]
    bits: BitsChoice,
    /// For wavelet and noise: haar, 5/3 or 9/7 [default: haar].
    #[arg(long, value_name = "WAVELET", value_parser = values::wavelet)]
    wavelet: Option<Wavelet>,
    /// For noise: how many patterns [default: 256]. For wavelet: only the first of them [default: all].
    #[arg(long, value_name = "N", value_parser = values::at_least_one)]
    count: Option<usize>,
    /// For noise: chooses the patterns; the same number gives the same ones [default: 1].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(..=i64::MAX as u64))]
    seed: Option<u64>,
    /// For noise: standard deviation of a texel's light about 0.5; what leaves 0 to 1 is clipped [default: 0.2].
    #[arg(long, value_name = "D", allow_negative_numbers = true, value_parser = values::finite)]
    deviation: Option<f64>,
    /// For stripes: only so many of them [default: 2, 4, 8... to one texel each].
    #[arg(long, value_name = "N", value_parser = values::at_least_one)]
    stripes: Option<usize>,
    /// For squares and hv: squares along each side of the picture [default: 16].
    #[arg(long, value_name = "N", value_parser = values::at_least_one)]
    side: Option<usize>,
    /// For squares and hv: how each square falls off [default: box]; tent and gaussian want some texels a square, say four.
    #[arg(long, value_name = "box|tent|gaussian")]
    filter: Option<Filter>,
    /// For hv: squares from one that is lit to the next [default: 3].
    #[arg(long, value_name = "D", value_parser = values::at_least_one)]
    influence: Option<usize>,
}

/// Kinds, by their permanent names.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum KindChoice {
    Wavelet,
    Noise,
    Stripes,
    GrayCode,
    Ramp,
    Squares,
    Hv,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum BitsChoice {
    #[value(name = "8")]
    Eight,
    #[value(name = "16")]
    Sixteen,
}

/// Noise patterns if nothing is said: those of 6.7.5.
const NOISE_COUNT: usize = 256;
/// Squares along a side, and influence, if nothing is said: those of the thesis's first scene (7.4, 7.5).
const SIDE: usize = 16;
const INFLUENCE: usize = 3;
/// The longest side of a picture.
const LONGEST_SIDE: usize = 1 << 14;

/// Checked flags.
#[derive(Debug)]
struct Plan {
    output: PathBuf,
    set: PatternSet,
    /// The first so many.
    count: usize,
    texel: usize,
    encode: Encode,
    bits: Bits,
}

/// `--encode`, or `--emitted` on the way back.
#[derive(Debug, Clone, PartialEq)]
pub struct Encode {
    /// The curve.
    pub curve: EmitterCurve,
    /// Where it was read.
    pub table: Option<PathBuf>,
}

impl Encode {
    /// `linear`, `srgb`, or the path of a table.
    ///
    /// # Errors
    /// A table that cannot be read.
    pub fn parse(text: &str) -> anyhow::Result<Self> {
        Ok(match text {
            "linear" => Self { curve: EmitterCurve::Linear, table: None },
            "srgb" => Self { curve: EmitterCurve::Srgb, table: None },
            path => {
                let curve = EmitterCurve::read(Path::new(path)).map_err(|error| match error {
                    // Most likely a slip of the pen.
                    Error::Io { source, .. } if source.kind() == std::io::ErrorKind::NotFound => {
                        anyhow::anyhow!("`{path}` is neither linear nor srgb, nor a table: there is no such file")
                    }
                    other => other.into(),
                })?;
                Self { curve, table: Some(path.into()) }
            }
        })
    }

    /// What stands in `patterns.toml`.
    pub fn id(&self) -> &'static str {
        match self.curve {
            EmitterCurve::Linear => "linear",
            EmitterCurve::Srgb => "srgb",
            EmitterCurve::Table(_) => EMITTER_TABLE,
        }
    }
}

/// Version of the folder's layout.
const VERSION: u32 = 1;
/// The description of the folder.
pub const DESCRIPTION: &str = "patterns.toml";
/// Where a measured curve is kept, inside the folder.
const EMITTER_TABLE: &str = "calibration/emitter.txt";

/// `patterns.toml`.
#[derive(Debug, Serialize, Deserialize)]
pub struct Description {
    version: u32,
    tool: String,
    /// What the patterns are for.
    pub kind: String,
    /// Texels.
    columns: usize,
    rows: usize,
    /// Pixels along each side of a texel.
    pub texel: usize,
    /// How codes become light: `linear`, `srgb`, `codes` (there is no curve: the set measures it), or a table in this folder.
    pub encode: String,
    bits: u32,
    #[serde(skip_serializing_if = "Option::is_none")]
    wavelet: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    seed: Option<u64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    deviation: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    side: Option<usize>,
    #[serde(skip_serializing_if = "Option::is_none")]
    influence: Option<usize>,
    /// How squares fall off, unless they are boxes.
    #[serde(skip_serializing_if = "Option::is_none")]
    filter: Option<Filter>,
    /// One a picture, in order.
    #[serde(default, skip_deserializing)]
    pattern: Vec<Shown>,
}

impl Description {
    /// What a folder tells of its patterns, if it does.
    ///
    /// # Errors
    /// A description that is not as this tool writes it, or by a newer one.
    pub fn of_folder(folder: &Path) -> relume_core::Result<Option<Self>> {
        let path = folder.join(DESCRIPTION);
        if !path.exists() {
            return Ok(None);
        }
        let text = std::fs::read_to_string(&path).map_err(|source| Error::io("read", &path, source))?;
        let expected = "a description as `relume patterns` writes it; without this file, say --emitted and --texel";
        let told: Self = toml::from_str(&text).map_err(|error| {
            Error::invalid(path.display().to_string(), error.message().replace('\n', " "), expected)
        })?;
        if told.version != VERSION {
            let found = format!("version {} (by {})", told.version, told.tool);
            return Err(Error::invalid(path.display().to_string(), found, format!("version {VERSION}")));
        }
        Ok(Some(told))
    }
}

/// A picture.
#[derive(Debug, Serialize)]
struct Shown {
    file: String,
    /// What turns light back into functions of the constant-energy normalisation.
    #[serde(skip_serializing_if = "Option::is_none")]
    scale: Option<f32>,
    #[serde(flatten)]
    element: Element,
}

impl Arguments {
    /// Writes the set.
    pub fn run(self) -> anyhow::Result<String> {
        self.plan()?.carry_out()
    }

    /// Refuses what can be known to fail before the work.
    fn plan(self) -> anyhow::Result<Plan> {
        new_folder::check(&self.output)?;
        self.check_options()?;
        let set = PatternSet::new(self.kind(), Plane::new(self.size.0, self.size.1)?)?;
        let longest = self.size.0.max(self.size.1);
        anyhow::ensure!(
            longest.checked_mul(self.texel).is_some_and(|pixels| pixels <= LONGEST_SIDE),
            "--texel {} makes pictures of more than {LONGEST_SIDE} pixels a side; texels must be smaller or fewer",
            self.texel
        );
        let count = self.count.map_or(set.len(), |count| count.min(set.len()));
        // The curve is not known yet: codes as they are.
        let encode = if set.is_codes() { "linear" } else { &self.encode };
        let bits = if self.bits == BitsChoice::Eight { Bits::Eight } else { Bits::Sixteen };
        Ok(Plan { output: self.output, set, count, texel: self.texel, encode: Encode::parse(encode)?, bits })
    }

    /// Options that mean nothing to the kind are a misunderstanding.
    fn check_options(&self) -> anyhow::Result<()> {
        use KindChoice::{Hv, Noise, Squares, Stripes, Wavelet};
        let given: [(&str, bool, &[KindChoice]); 8] = [
            ("--wavelet", self.wavelet.is_some(), &[Wavelet, Noise]),
            ("--count", self.count.is_some(), &[Wavelet, Noise]),
            ("--seed", self.seed.is_some(), &[Noise]),
            ("--deviation", self.deviation.is_some(), &[Noise]),
            ("--stripes", self.stripes.is_some(), &[Stripes]),
            ("--side", self.side.is_some(), &[Squares, Hv]),
            ("--filter", self.filter.is_some(), &[Squares, Hv]),
            ("--influence", self.influence.is_some(), &[Hv]),
        ];
        let name = |kind: &KindChoice| kind.to_possible_value().map_or_else(String::new, |v| v.get_name().to_owned());
        let misplaced = given.iter().find(|(_, set, kinds)| *set && !kinds.contains(&self.kind));
        if let Some((flag, _, kinds)) = misplaced {
            let kinds: Vec<String> = kinds.iter().map(name).collect();
            anyhow::bail!("{flag} is for {}, and has no meaning for {}", kinds.join(" and "), name(&self.kind));
        }
        let encoded = self.kind != KindChoice::Ramp || self.encode == "srgb" || self.encode == "linear";
        anyhow::ensure!(encoded, "--encode has no meaning for ramp, which shows every code as it is");
        Ok(())
    }

    fn kind(&self) -> Kind {
        let wavelet = self.wavelet.unwrap_or(Wavelet::Haar);
        let (side, filter) = (self.side.unwrap_or(SIDE), self.filter.unwrap_or_default());
        match self.kind {
            KindChoice::Wavelet => Kind::Wavelet(wavelet),
            KindChoice::Noise => Kind::Noise(Noise {
                wavelet,
                count: self.count.unwrap_or(NOISE_COUNT),
                seed: self.seed.unwrap_or(1),
                deviation: self.deviation.unwrap_or(Noise::DEVIATION),
            }),
            KindChoice::Stripes => Kind::Stripes(self.stripes),
            KindChoice::GrayCode => Kind::GrayCode,
            KindChoice::Ramp => Kind::Ramp,
            KindChoice::Squares => Kind::Squares { side, filter },
            KindChoice::Hv => Kind::Crossed { side, influence: self.influence.unwrap_or(INFLUENCE), filter },
        }
    }
}

impl Plan {
    /// The folder takes its name last.
    fn carry_out(&self) -> anyhow::Result<String> {
        let folder = NewFolder::begin(&self.output)?;
        let emitter = Emitter::new(&self.encode.curve, self.bits);
        let mut shown = Vec::with_capacity(self.count);
        let mut progress = Progress::new("writing patterns", Unit::Steps);
        for n in 0..self.count {
            let file = format!("{}.png", self.set.name(n));
            self.write(&folder.path().join(&file), &self.set.pattern(n).codes(&emitter))?;
            let scale = matches!(self.set.kind(), Kind::Wavelet(_) | Kind::Noise(_)).then(|| self.set.scale(n));
            shown.push(Shown { file, scale, element: self.set.element(n) });
            progress.step(n as u64 + 1, self.count as u64)?;
        }
        drop(progress);
        self.write_calibration(folder.path())?;
        let path = folder.path().join(DESCRIPTION);
        let text = toml::to_string(&self.description(shown))?;
        files::write_whole(&path, |file| {
            std::io::Write::write_all(file, text.as_bytes()).map_err(|source| Error::io("write", &path, source))
        })?;
        let folder = folder.commit()?;
        let (columns, rows) = self.set.plane().size();
        let pixels = match self.texel {
            1 => String::new(),
            texel => format!(", {texel} x {texel} pixels each"),
        };
        let (count, kind) = (self.count, self.set.kind().id());
        Ok(format!("{}: {count} patterns of kind {kind}, {columns} x {rows} texels{pixels}\n", folder.display()))
    }

    /// Black and white, and the emitter's table.
    fn write_calibration(&self, folder: &Path) -> anyhow::Result<()> {
        let calibration = folder.join("calibration");
        std::fs::create_dir(&calibration).map_err(|source| Error::io("create", &calibration, source))?;
        for (name, code) in [("black.png", 0), ("white.png", self.bits.largest())] {
            self.write(&calibration.join(name), &vec![code; self.set.plane().len()])?;
        }
        if let Some(table) = &self.encode.table {
            let to = folder.join(EMITTER_TABLE);
            std::fs::copy(table, &to).map_err(|source| Error::io("write", &to, source))?;
        }
        Ok(())
    }

    /// Every texel as so many pixels.
    fn write(&self, path: &Path, codes: &[u16]) -> relume_core::Result<()> {
        let ((columns, rows), texel) = (self.set.plane().size(), self.texel);
        let eight_bits = self.bits == Bits::Eight;
        if texel == 1 {
            return write_grey(path, (columns, rows), codes, eight_bits);
        }
        let line =
            |row: &[u16]| -> Vec<u16> { row.iter().flat_map(|code| std::iter::repeat_n(*code, texel)).collect() };
        let pixels: Vec<u16> = codes.chunks_exact(columns).flat_map(|row| line(row).repeat(texel)).collect();
        write_grey(path, (columns * texel, rows * texel), &pixels, eight_bits)
    }

    fn description(&self, pattern: Vec<Shown>) -> Description {
        let (columns, rows) = self.set.plane().size();
        let (mut wavelet, mut seed, mut deviation, mut side, mut influence, mut filter) =
            (None, None, None, None, None, None);
        match self.set.kind() {
            Kind::Wavelet(w) | Kind::Shifted(w) => wavelet = Some(w.id().to_owned()),
            Kind::Noise(noise) => {
                wavelet = Some(noise.wavelet.id().to_owned());
                seed = Some(noise.seed);
                deviation = Some(noise.deviation);
            }
            Kind::Squares { side: n, filter: f } => (side, filter) = (Some(n), Some(f)),
            Kind::Crossed { side: n, influence: d, filter: f } => {
                (side, influence, filter) = (Some(n), Some(d), Some(f));
            }
            Kind::Stripes(_) | Kind::GrayCode | Kind::Ramp => {}
        }
        Description {
            version: VERSION,
            tool: concat!("relume ", env!("CARGO_PKG_VERSION")).to_owned(),
            kind: self.set.kind().id().to_owned(),
            columns,
            rows,
            texel: self.texel,
            encode: if self.set.is_codes() { "codes" } else { self.encode.id() }.to_owned(),
            bits: if self.bits == Bits::Eight { 8 } else { 16 },
            wavelet,
            seed,
            deviation,
            side,
            influence,
            filter: filter.filter(|f| *f != Filter::Box),
            pattern,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::commands::testing;

    fn parse(line: &str) -> Result<Arguments, clap::Error> {
        testing::parse(&format!("patterns {line} -o no-such-folder"))
    }

    #[test]
    fn flags_reach_the_plan() {
        let plan = parse("noise").unwrap().plan().unwrap();
        let noise = Noise { wavelet: Wavelet::Haar, count: 256, seed: 1, deviation: 0.2 };
        assert_eq!((plan.set.kind(), plan.count, plan.texel), (Kind::Noise(noise), 256, 1));
        assert_eq!(
            (plan.encode.curve, plan.bits, plan.set.plane().size()),
            (EmitterCurve::Srgb, Bits::Eight, (128, 128))
        );
        let line =
            "noise --size 64x32 --texel 4 --encode linear --bits 16 --wavelet 5/3 --count 9 --seed 3 --deviation 0.1";
        let plan = parse(line).unwrap().plan().unwrap();
        let noise = Noise { wavelet: Wavelet::LeGall53, count: 9, seed: 3, deviation: 0.1 };
        assert_eq!((plan.set.kind(), plan.count, plan.texel), (Kind::Noise(noise), 9, 4));
        assert_eq!(
            (plan.encode.curve, plan.bits, plan.set.plane().size()),
            (EmitterCurve::Linear, Bits::Sixteen, (64, 32))
        );
        let kind = |line: &str| parse(line).unwrap().plan().unwrap().set.kind();
        assert_eq!(kind("hv --side 8 --influence 4"), Kind::Crossed { side: 8, influence: 4, filter: Filter::Box });
        assert_eq!(kind("squares"), Kind::Squares { side: 16, filter: Filter::Box });
        let gaussian = Kind::Crossed { side: 16, influence: 3, filter: Filter::Gaussian };
        assert_eq!(kind("hv --filter gaussian"), gaussian);
        assert_eq!(kind("stripes --stripes 64"), Kind::Stripes(Some(64)));
        let plan = parse("wavelet --count 100000 --size 8x8").unwrap().plan().unwrap();
        assert_eq!(plan.count, plan.set.len());
    }

    #[test]
    fn options_of_other_kinds_are_refused() {
        for (line, words) in [
            ("stripes --seed 3", "--seed is for noise, and has no meaning for stripes"),
            ("gray-code --count 3", "--count is for wavelet and noise"),
            ("squares --influence 3", "--influence is for hv"),
            ("noise --filter tent", "--filter is for squares and hv"),
            ("hv --filter tent --influence 1", "2 to 16"),
            ("squares --filter tent --size 16x16", "32 texels or more"),
            ("ramp --encode gamma.txt", "shows every code as it is"),
            ("noise --encode gama", "neither linear nor srgb"),
            ("noise --deviation 0.7", "at most 0.5"),
            ("noise --texel 200", "16384 pixels"),
            ("noise --size 20000x4", "16384 texels"),
        ] {
            let message = parse(line).unwrap().plan().unwrap_err().to_string();
            assert!(message.contains(words), "{line}: `{words}` not in: {message}");
        }
        for line in [
            "plaid",
            "noise --count 0",
            "noise --size 64",
            "noise --bits 10",
            "noise --seed -1",
            "noise --wavelet x",
            "wavelet --wavelet d4",
        ] {
            assert!(parse(line).is_err(), "{line}");
        }
    }
}
