//! `relume pack` of a projector's session (7.3, 7.5).

use std::fs;
use std::path::Path;

use clap::{Args, ValueEnum};
use relume_core::acquire::separable::Separable;
use relume_core::calibrate::white_patch;
use relume_core::field::{Access, Asset, Precision};
use relume_core::image::{EncodeOptions, Image, write};
use relume_core::{Error, Result as CoreResult};

use super::Arguments;
use super::screen::read_alpha;
use crate::commands::info::Info;
use crate::commands::{note, values};
use crate::pack::develop::Developer;
use crate::pack::gantry::{GantryPack, Packed, Scheme, Store};
use crate::pack::records::Records;
use crate::progress::{Progress, Unit};
use crate::rigs::{Condition, GantryRig};
use crate::session::{CaptureDescription, Role};

/// Fields beyond this are kept as terms unless samples are asked for: a position of 640 x 480 pixels and 16 x 16 squares has half
/// a gigabyte of samples.
const LARGE: u64 = 4 << 30;
/// The error of terms where none is given.
const ERROR: f64 = 0.01;
/// A share of a photograph that may be clipped without a word: glints.
const CLIPPED: f64 = 1e-3;

/// Flags of projectors.
#[derive(Debug, Args)]
#[command(next_help_heading = "Projectors")]
pub(super) struct GantryFlags {
    /// How a projector's field is kept: a picture a square, or few terms a pixel and position, some twenty times smaller [default:
    /// samples up to 4 GB, then terms].
    #[arg(long, value_enum, value_name = "FORM")]
    store: Option<StoreChoice>,
    /// The relative error that terms may have at each position [default: 0.01].
    #[arg(long, value_name = "E", value_parser = values::share)]
    error: Option<f64>,
    /// Radiant intensity of the projector's white in the camera's unit, if it is known [default: such that a white diffuser
    /// facing the projector photographs as 1].
    #[arg(long, value_name = "I", value_parser = values::positive)]
    intensity: Option<f32>,
    /// A white patch in the photographs of the first position, pixels from the top left: it is made neutral, so that the projector's
    /// white is (7.3).
    #[arg(long, value_name = "X,Y,W,H", value_parser = values::four_counts)]
    white_patch: Option<[usize; 4]>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum StoreChoice {
    Samples,
    Terms,
}

impl GantryFlags {
    /// Refuses flags of projectors for another rig.
    pub(super) fn refuse(&self, what: &str) -> anyhow::Result<()> {
        let Self { store, error, intensity, white_patch } = self;
        let given = [
            (store.is_some(), "--store"),
            (error.is_some(), "--error"),
            (intensity.is_some(), "--intensity"),
            (white_patch.is_some(), "--white-patch"),
        ];
        match given.iter().find(|(given, _)| *given) {
            Some((_, flag)) => anyhow::bail!("{flag} is for sessions of a projector; this makes {what}"),
            None => Ok(()),
        }
    }
}

/// A captured session.
pub(super) struct Captured<'a> {
    pub capture: &'a CaptureDescription,
    pub gantry: &'a GantryRig,
    pub records: &'a Records,
    pub developer: &'a Developer,
}

/// A captured session: the report.
pub(super) fn captured(arguments: &Arguments, captured: &Captured<'_>, output: &Path) -> anyhow::Result<String> {
    let Captured { capture, gantry, records, developer } = *captured;
    let flags = &arguments.gantry;
    let scheme = match capture.sampler.as_str() {
        "scan" => Scheme::Each,
        "separable" => Scheme::Crossed(Separable::new(gantry.squares, gantry.influence)?),
        other => anyhow::bail!(
            "{}: a session of --sampler {other}; of a projector, scan and separable make fields",
            arguments.session.display()
        ),
    };
    let mut pack = GantryPack {
        records,
        rig: gantry,
        developer,
        scheme,
        store: Store::Samples(Precision::Half),
        intensity: flags.intensity.map(f64::from),
        gains: [1.0; 3],
        alpha: None,
    };
    pack.store = store(arguments, pack.sample_bytes(arguments.precision.precision())?)?;
    pack.alpha = arguments.alpha.as_deref().map(|path| read_alpha(path, pack.size()?)).transpose()?;
    if let Some(patch) = flags.white_patch {
        let rows = *white_patch(&white(captured, scheme)?, patch, "position 1")?.rows();
        pack.gains = [0, 1, 2].map(|c| rows[c][c] as f32);
    }
    let provenance = serde_json::json!({
        "source": "capture",
        "rig": capture.rig.name,
        "session": arguments.session.file_name().map(|name| name.to_string_lossy()),
        "sampler": capture.sampler,
        "photographs": records.of(Role::Sample).count(),
        "influence": matches!(scheme, Scheme::Crossed(_)).then_some(gantry.influence),
        "intensity": if flags.intensity.is_some() { "given" } else { "assumed" },
        "white_gains": flags.white_patch.map(|_| pack.gains),
    });
    let mut progress = Progress::new("packing", Unit::Steps);
    let packed = pack.write(output, provenance, &mut |done, all| progress.step(done, all))?;
    drop(progress);
    packed.remarks.iter().for_each(|remark| note(remark));
    if packed.clipped > CLIPPED {
        note(&format!(
            "up to {:.1} % of a photograph is clipped in every exposure of it: shorter times are wanted",
            100.0 * packed.clipped
        ));
    }
    let asset = Asset::open(output, Access::Read)?;
    let report = format!("{}\n{}", Info::of(&asset).summary(), words(&pack, &packed));
    if let Err(error) = keep(&arguments.session, &packed) {
        note(&format!("what was found could not be written into the session: {error}"));
    }
    Ok(report)
}

fn store(arguments: &Arguments, bytes: u64) -> anyhow::Result<Store> {
    let flags = &arguments.gantry;
    let precision = arguments.precision.precision();
    let form = match (flags.store, flags.error) {
        (Some(form), _) => form,
        (None, Some(_)) => StoreChoice::Terms,
        (None, None) if bytes > LARGE => StoreChoice::Terms,
        (None, None) => StoreChoice::Samples,
    };
    match (form, flags.error) {
        (StoreChoice::Samples, Some(_)) => anyhow::bail!("--error is for --store terms; samples are kept as they are"),
        (StoreChoice::Samples, None) => Ok(Store::Samples(precision)),
        (StoreChoice::Terms, _) if precision != Precision::Half => {
            anyhow::bail!("terms are kept as 16-bit floats; --precision float goes with --store samples")
        }
        (StoreChoice::Terms, error) => Ok(Store::Terms(error.unwrap_or(ERROR))),
    }
}

/// The first position under all squares, its black subtracted.
fn white(captured: &Captured<'_>, scheme: Scheme) -> anyhow::Result<Image> {
    let Captured { gantry, records, developer, .. } = *captured;
    let absent = |what: &str| Error::invalid("position 1", format!("no {what} photograph"), "a complete session");
    let black = records.find(Role::Black, &Condition::Black { stop: 0 }).ok_or_else(|| absent("black"))?;
    let black = developer.picture(records, black)?;
    let mut sum = Image::new(black.width(), black.height(), 3);
    let mut add = |photograph| -> CoreResult<()> {
        let picture = developer.picture(records, photograph)?;
        let lit = picture.data().iter().zip(black.data()).map(|(v, black)| v - black);
        sum.data_mut().iter_mut().zip(lit).for_each(|(sum, v)| *sum += v);
        Ok(())
    };
    match (scheme, records.find(Role::AllLit, &Condition::White { stop: 0 })) {
        (Scheme::Each, Some(white)) => add(white)?,
        _ => {
            // Squares one by one, or the horizontal set alone, are all of them.
            let count = if scheme == Scheme::Each { gantry.squares } else { gantry.influence } * gantry.squares;
            let first = |number: &usize| {
                let of = |set: &str| Condition::Pattern { set: set.to_owned(), number: *number, stop: 0 };
                records.find(Role::Sample, &of("hv")).or_else(|| records.find(Role::Sample, &of("squares")))
            };
            for number in 0..count {
                add(first(&number).ok_or_else(|| absent("pattern's"))?)?;
            }
        }
    }
    Ok(sum)
}

fn words(pack: &GantryPack<'_>, packed: &Packed) -> String {
    let mut text = String::new();
    if let Some(lost) = packed.lost {
        text += &format!("terms      {:.2} % of the samples' norm is left out, noise included\n", 100.0 * lost);
    }
    if pack.gains != [1.0; 3] {
        let [r, g, b] = pack.gains;
        text += &format!("white      red, green and blue times {r:.3}, {g:.3}, {b:.3}\n");
    }
    if matches!(pack.scheme, Scheme::Crossed(_)) {
        let bad = packed.unreliable.len();
        text += &match bad {
            0 => format!("squares    told apart well at all {} positions\n", packed.positions),
            _ => format!("squares    not told apart well at {bad} of {} positions; see the notes\n", packed.positions),
        };
    }
    text
}

/// Pictures of what could not be told apart, in the session's `calibration/reliability/`.
fn keep(session: &Path, packed: &Packed) -> CoreResult<()> {
    if packed.unreliable.is_empty() {
        return Ok(());
    }
    let folder = session.join("calibration").join("reliability");
    fs::create_dir_all(&folder).map_err(|source| Error::io("create", &folder, source))?;
    for (stop, picture) in &packed.unreliable {
        write(&folder.join(format!("position-{:03}.png", stop + 1)), picture, EncodeOptions::default())?;
    }
    Ok(())
}
