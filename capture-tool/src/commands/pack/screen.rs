//! `relume pack` of a screen's session: captured, or imported as pairs.

use std::fmt::Write as _;
use std::ops::Range;
use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use relume_core::acquire::coverage;
use relume_core::acquire::implicit::Stop;
use relume_core::domain::patterns::PatternSet;
use relume_core::domain::{Correspondence, EmitterCurve};
use relume_core::field::{Access, Asset};
use relume_core::image::{ColourSpace, Encoding, Image, probe_size};
use relume_core::matte::alpha;
use relume_core::wavelet::Wavelet;
use relume_core::{Error, Result as CoreResult};

use super::Arguments;
use crate::capture::patterns::{Samples, sets};
use crate::commands::info::Info;
use crate::commands::patterns::Encode;
use crate::commands::{note, values};
use crate::pack::develop::Developer;
use crate::pack::places::ScreenFile;
use crate::pack::records::Records;
use crate::pack::screen::emitted::{self, Emitted};
use crate::pack::screen::explicit::{self, ExplicitPack};
use crate::pack::screen::implicit::{ImplicitPack, Wanted};
use crate::pack::screen::photographs::Photographs;
use crate::pack::screen::scan::ScanPack;
use crate::pack::screen::view::{self, View};
use crate::progress::{Progress, Unit};
use crate::rigs::{Condition, MonitorRig};
use crate::session::{CaptureDescription, Description, ImportDescription, Photograph, Role, Source};

/// A share of a photograph that may be clipped without a word: glints.
const CLIPPED: f32 = 1e-3;

/// Flags of screens.
#[derive(Debug, Args)]
#[command(next_help_heading = "Screens")]
pub(super) struct ScreenFlags {
    /// Terms of a pixel, at most [default: 64].
    #[arg(long, value_name = "N", value_parser = values::at_least_one)]
    terms: Option<usize>,
    /// The wavelet of the terms: haar, 5/3 or 9/7 [default: that of the patterns, or haar]. Few terms of haar say most: see `relume
    /// evaluate implicit`.
    #[arg(long, value_name = "WAVELET", value_parser = values::wavelet)]
    basis: Option<Wavelet>,
    /// Whether a pixel gets fewer terms where more would model noise [default: on].
    #[arg(long, value_enum, value_name = "on|off")]
    stop: Option<StopChoice>,
    /// Solve these tiles alone (rows of 8 pixels, counted from 1), into A.rfield.part-A-B.
    #[arg(long, value_name = "A-B", value_parser = tiles)]
    tiles: Option<Range<usize>>,
    /// What the screen makes of codes: linear, srgb, or a table of `relume calibrate gamma` [default: measured from the session's
    /// ramp, or as the rig file or the import tells].
    #[arg(long, value_name = "linear|srgb|TABLE")]
    emitted: Option<String>,
    /// Where pixels look, as `relume calibrate screen` writes it [default: from the session's Gray codes].
    #[arg(long, value_name = "FILE")]
    correspondence: Option<PathBuf>,
    /// The session of the bare screen, photographed with the object away.
    #[arg(long, value_name = "SESSION")]
    bare: Option<PathBuf>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum StopChoice {
    On,
    Off,
}

impl ScreenFlags {
    /// Refuses flags of screens for another rig.
    pub(super) fn refuse(&self, what: &str) -> anyhow::Result<()> {
        let Self { terms, basis, stop, tiles, emitted, correspondence, bare } = self;
        let given = [
            (terms.is_some(), "--terms"),
            (basis.is_some(), "--basis"),
            (stop.is_some(), "--stop"),
            (tiles.is_some(), "--tiles"),
            (emitted.is_some(), "--emitted"),
            (correspondence.is_some(), "--correspondence"),
            (bare.is_some(), "--bare"),
        ];
        match given.iter().find(|(given, _)| *given) {
            Some((_, flag)) => anyhow::bail!("{flag} is for sessions of a screen; this makes {what}"),
            None => Ok(()),
        }
    }

    fn wanted(&self) -> Wanted {
        let stop = if self.stop == Some(StopChoice::Off) { Stop::Off } else { Stop::On };
        Wanted { terms: self.terms.unwrap_or(64), stop, basis: self.basis }
    }

    /// Where the pixels of photographs of a size look.
    fn looks(&self, size: (usize, usize)) -> CoreResult<Option<Correspondence>> {
        let read = |path: &PathBuf| Ok(ScreenFile::read(path, size)?.correspondence);
        self.correspondence.as_ref().map(read).transpose()
    }

    fn curve(&self) -> anyhow::Result<Option<EmitterCurve>> {
        self.emitted.as_deref().map(|said| Ok(Encode::parse(said)?.curve)).transpose()
    }

    /// For patterns that are not solved.
    fn refuse_solving(&self, what: &str) -> anyhow::Result<()> {
        let given = [
            (self.terms.is_some(), "--terms"),
            (self.basis.is_some(), "--basis"),
            (self.stop.is_some(), "--stop"),
            (self.tiles.is_some(), "--tiles"),
        ];
        match given.iter().find(|(given, _)| *given) {
            Some((_, flag)) => anyhow::bail!("{flag} is for patterns of noise; this session has {what}"),
            None => Ok(()),
        }
    }
}

/// A captured session.
pub(super) struct Captured<'a> {
    pub capture: &'a CaptureDescription,
    pub monitor: &'a MonitorRig,
    pub records: &'a Records,
    pub developer: &'a Developer,
}

/// A captured session: the report.
pub(super) fn captured(arguments: &Arguments, captured: &Captured<'_>, output: &Path) -> anyhow::Result<String> {
    let Captured { capture, monitor, records, developer } = captured;
    let flags = &arguments.screen;
    let samples = match capture.sampler.as_str() {
        "noise" => Samples::Noise,
        "scan" => Samples::Squares,
        "explicit" => Samples::Functions,
        "bare" => anyhow::bail!(
            "{0}: the bare screen, without an object; name it beside the object's session: `relume pack SESSION --bare {0} -o A.rfield`",
            arguments.session.display()
        ),
        other => {
            anyhow::bail!(
                "{}: a session of --sampler {other}; noise, scan and explicit make fields",
                arguments.session.display()
            )
        }
    };
    let sets = sets(&capture.rig, samples, capture.seed)?;
    let photographs = Photographs::captured(records, developer)?;
    let (curve, mut report) = match flags.curve()? {
        Some(curve) => (curve, String::new()),
        None => emitted::measured(records, developer, &sets, &monitor.curve.curve()?)?,
    };
    let (view, white, words) = view_of(arguments, &photographs, captured)?;
    report += &words;
    let set = sets.get(samples.set()).ok_or_else(|| Error::invalid("the session", "no patterns", "some"))?;
    if samples == Samples::Functions {
        flags.refuse_solving("functions, a picture each")?;
        let ready = view.ready(photographs.size(), set.plane(), white)?;
        explicit(arguments, captured, (&photographs, &view, &ready), (set, &curve), output)?;
        return Ok(format!("{}\n{report}", Info::of(&Asset::open(output, Access::Read)?).summary()));
    }
    let emitted = Emitted::of_set(set, capture.rig.bits(), [&monitor.curve.curve()?, &curve]);
    let ready = view.ready(photographs.size(), emitted.plane, white)?;
    let list = in_order(records, samples.set(), emitted.patterns.len(), arguments)?;
    let provenance = serde_json::json!({
        "source": "capture",
        "rig": capture.rig.name,
        "session": arguments.session.file_name().map(|name| name.to_string_lossy()),
        "sampler": capture.sampler,
        "seed": capture.seed,
        "photographs": list.len(),
        "screen": format!("{} x {}", emitted.plane.columns(), emitted.plane.rows()),
    });
    let written = match samples {
        Samples::Squares => {
            flags.refuse_solving("squares")?;
            let (precision, side) = (arguments.precision.precision(), monitor.squares);
            let (photographs, list, view, ready, emitted) = (&photographs, &list[..], &view, &ready, &emitted);
            ScanPack { photographs, list, emitted, side, view, ready, precision }.write(output, provenance)?;
            output.to_owned()
        }
        _ => {
            let pack = ImplicitPack {
                photographs: &photographs,
                list: &list,
                emitted: &emitted,
                view: &view,
                ready: &ready,
                wanted: flags.wanted(),
            };
            pack.write(output, flags.tiles.clone(), keyed(provenance, records, &view, &emitted))?
        }
    };
    if photographs.clipped() > CLIPPED {
        note(&format!(
            "up to {:.1} % of a photograph is clipped in every exposure of it: shorter times are wanted",
            100.0 * photographs.clipped()
        ));
    }
    Ok(format!("{}\n{report}", Info::of(&Asset::open(&written, Access::Read)?).summary()))
}

/// Functions that were shown one by one.
fn explicit(
    arguments: &Arguments,
    Captured { capture, monitor, records, .. }: &Captured<'_>,
    (photographs, view, ready): (&Photographs<'_>, &View, &view::Ready),
    (set, curve): (&PatternSet, &EmitterCurve),
    output: &Path,
) -> anyhow::Result<()> {
    let functions = explicit::functions(records, set)?;
    let white = records.find(Role::AllLit, &Condition::White { stop: 0 });
    let white = white.map(|white| photographs.lit(white)).transpose()?;
    let assumed = monitor.curve.curve()?;
    let pack = ExplicitPack {
        photographs,
        functions: &functions,
        set,
        bits: capture.rig.bits(),
        curves: [&assumed, curve],
        white: white.as_ref(),
        view,
        ready,
    };
    pack.doubts().iter().for_each(|doubt| note(doubt));
    let provenance = serde_json::json!({
        "source": "capture",
        "rig": capture.rig.name,
        "session": arguments.session.file_name().map(|name| name.to_string_lossy()),
        "sampler": capture.sampler,
        "seed": capture.seed,
        "photographs": functions.iter().map(|function| function.photographs.len()).sum::<usize>(),
        "screen": format!("{} x {}", set.plane().columns(), set.plane().rows()),
    });
    Ok(pack.write(output, provenance)?)
}

/// Pairs made elsewhere.
pub(super) fn imported(arguments: &Arguments, import: &ImportDescription, output: &Path) -> anyhow::Result<String> {
    let flags = &arguments.screen;
    if flags.bare.is_some() {
        anyhow::bail!("--bare is for captured sessions; give imported pairs a --correspondence and an --alpha");
    }
    let records = Records::read(&arguments.session)?;
    let encoding = match import.encoding.as_str() {
        "srgb" => Encoding::Srgb,
        "linear" => Encoding::Linear,
        _ => Encoding::Auto,
    };
    let photographs = Photographs::imported(&records, encoding, import.colour_space.parse::<ColourSpace>()?)?;
    let mut progress = Progress::new("reading patterns", Unit::Steps);
    let step = &mut |done, all| progress.step(done, all);
    let emitted = Emitted::imported(&arguments.session, import, flags.curve()?.as_ref(), step)?;
    drop(progress);
    let view = View {
        correspondence: flags.looks(photographs.size())?,
        alpha: arguments.alpha.as_deref().map(|path| read_alpha(path, photographs.size())).transpose()?,
        bare: None,
    };
    let white = records.find(Role::AllLit, &Condition::White { stop: 0 });
    let white = white.map(|white| photographs.lit(white)).transpose()?;
    let ready = view.ready(photographs.size(), emitted.plane, white.map(|white| (white, false)))?;
    let list: Vec<&Photograph> = records.of(Role::Sample).collect();
    let provenance = serde_json::json!({
        "source": "pairs",
        "session": arguments.session.file_name().map(|name| name.to_string_lossy()),
        "photographs": list.len(),
        "screen": format!("{} x {}", emitted.plane.columns(), emitted.plane.rows()),
    });
    let pack = ImplicitPack {
        photographs: &photographs,
        list: &list,
        emitted: &emitted,
        view: &view,
        ready: &ready,
        wanted: flags.wanted(),
    };
    let written = pack.write(output, flags.tiles.clone(), keyed(provenance, &records, &view, &emitted))?;
    Ok(format!("{}\n", Info::of(&Asset::open(&written, Access::Read)?).summary()))
}

/// A view, a photograph under white (and whether of the bare screen), and words for the report.
type Seen = (View, Option<(Image, bool)>, String);

/// Correspondence, coverage and the white screen, from flags or from the session; and what is said of them.
fn view_of(arguments: &Arguments, photographs: &Photographs<'_>, captured: &Captured<'_>) -> anyhow::Result<Seen> {
    let Captured { capture, records, developer, .. } = captured;
    let flags = &arguments.screen;
    let given = flags.looks(photographs.size())?;
    let matte = arguments.alpha.as_deref().map(|path| read_alpha(path, photographs.size())).transpose()?;
    let bare = flags.bare.as_deref().map(bare_white).transpose()?;
    if let Some(bare) = bare.as_ref().filter(|bare| bare.size() != photographs.size()) {
        let found = format!("pictures of {} x {} pixels", bare.width(), bare.height());
        let (w, h) = photographs.size();
        return Err(Error::invalid("the bare screen", found, format!("{w} x {h}, as the photographs")).into());
    }
    let (view, mut words) = view::of_session(&capture.rig, records, developer, (given, matte))?;
    if view.alpha.is_none() {
        note(
            "how much of the screen is seen past the object is not known: all of every pixel counts as the object, and T stays in \
             the camera's units; photograph gray-code and stripes as well ([calibration] patterns)",
        );
    } else if view.correspondence.is_some() {
        let seen = view.alpha.iter().flatten().filter(|a| **a < 1.0).count();
        let _ = writeln!(words, "alpha      {seen} pixels see the screen past the object");
    }
    if let Some(bare) = bare {
        return Ok((view, Some((bare, true)), words));
    }
    let white = records.find(Role::AllLit, &Condition::White { stop: 0 });
    let white = white.map(|white| photographs.lit(white)).transpose()?;
    Ok((view, white.map(|white| (white, false)), words))
}

/// The bare white screen less the bare black one.
fn bare_white(session: &Path) -> anyhow::Result<Image> {
    let place = session.display().to_string();
    let Source::Capture(capture) = Description::read(session)?.source else {
        anyhow::bail!("{place}: an import; --bare wants a session of `relume capture --bare`");
    };
    capture.check_bare(session)?;
    let records = Records::read(session)?;
    let developer = Developer::new(&records, &capture.rig.camera)?;
    let photographs = Photographs::captured(&records, &developer)?;
    let Some(white) = records.find(Role::AllLit, &Condition::White { stop: 0 }) else {
        return Err(Error::invalid(place, "no photograph of the white screen", "one: `relume capture --bare`").into());
    };
    Ok(photographs.lit(white)?)
}

/// The photographs of the patterns, in their order.
fn in_order<'a>(
    records: &'a Records,
    set: &str,
    count: usize,
    arguments: &Arguments,
) -> anyhow::Result<Vec<&'a Photograph>> {
    let mut found = vec![None; count];
    for photograph in records.of(Role::Sample) {
        if let Condition::Pattern { set: of, number, .. } = &photograph.condition
            && of == set
            && let Some(place) = found.get_mut(*number)
        {
            *place = Some(photograph);
        }
    }
    let list: Vec<&Photograph> = found.iter().copied().flatten().collect();
    if list.len() != count {
        let missing = found.iter().position(Option::is_none).unwrap_or_default() + 1;
        let found = format!("photographs of {} of {count} patterns (the first one missing is {missing})", list.len());
        let expected = "all of them: go on with `relume capture --resume`";
        return Err(Error::invalid(arguments.session.display().to_string(), found, expected).into());
    }
    Ok(list)
}

/// The provenance with one number for everything that is solved from: parts of other photographs are not taken for these.
fn keyed(
    provenance: serde_json::Value,
    records: &Records,
    view: &View,
    emitted: &Emitted,
) -> serde_json::Map<String, serde_json::Value> {
    let mut hasher = blake3::Hasher::new();
    hasher.update(records.hash().as_bytes());
    let mut numbers = |values: &[f32]| {
        values.iter().for_each(|v| {
            hasher.update(&v.to_le_bytes());
        });
    };
    emitted.patterns.iter().for_each(|pattern| numbers(&pattern.values));
    view.alpha.iter().for_each(|alpha| numbers(alpha));
    hasher.update(serde_json::to_string(&view.correspondence).unwrap_or_default().as_bytes());
    let mut map = match provenance {
        serde_json::Value::Object(map) => map,
        _ => serde_json::Map::new(),
    };
    map.insert("solved_from_blake3".to_owned(), hasher.finalize().to_hex().to_string().into());
    map
}

/// The coverage in a picture of this size.
pub(super) fn read_alpha(path: &Path, size: (usize, usize)) -> CoreResult<Vec<f32>> {
    let place = path.display().to_string();
    let found = probe_size(path)?;
    if found != size {
        let expected = format!("{} x {}, as the photographs have", size.0, size.1);
        return Err(Error::invalid(place, format!("{} x {} pixels", found.0, found.1), expected));
    }
    let read = coverage(path)?;
    alpha::check(&read, size, &place)?;
    Ok(read)
}

/// `A-B`, counted from 1, as a range from 0.
fn tiles(text: &str) -> Result<Range<usize>, String> {
    let expected = || format!("`{text}` is no range of tiles: say the first and the last, such as 1-32");
    let (first, last) = text.split_once('-').ok_or_else(expected)?;
    let number = |text: &str| text.trim().parse::<usize>().ok().filter(|n| *n >= 1);
    match (number(first), number(last)) {
        (Some(first), Some(last)) if first <= last => Ok(first - 1..last),
        _ => Err(expected()),
    }
}
