//! What the screen showed: the light of the texels under each pattern, less that of code 0.

use std::path::Path;

use relume_core::calibrate::emitter::Ramp;
use relume_core::domain::patterns::Element;
use relume_core::domain::patterns::{self, Kind, Pattern, PatternSet};
use relume_core::domain::{Bits, Emitter, EmitterCurve, Plane};
use relume_core::wavelet::Wavelet;
use relume_core::{Error, Result};

use crate::capture::patterns::Sets;
use crate::pack::develop::Developer;
use crate::pack::records::Records;
use crate::rigs::Condition;
use crate::session::{ImportDescription, Photograph, Role};

/// Patterns as they were emitted.
#[derive(Debug)]
pub struct Emitted {
    /// The texels.
    pub plane: Plane,
    /// One a photograph, in order.
    pub patterns: Vec<Pattern>,
    /// The wavelet that the patterns were made of, if that is known.
    pub wavelet: Option<Wavelet>,
}

impl Emitted {
    /// A set that was shown through the curve `assumed`, as codes of so many bits, on a screen whose curve is `measured`.
    pub fn of_set(set: &PatternSet, bits: Bits, [assumed, measured]: [&EmitterCurve; 2]) -> Self {
        let (assumed, measured) = (Emitter::new(assumed, bits), Emitter::new(measured, bits));
        let shown = |n: usize| {
            let mut pattern = set.pattern(n);
            pattern.values.iter_mut().for_each(|light| *light = measured.light(assumed.code(*light)));
            pattern
        };
        let wavelet = match set.kind() {
            Kind::Noise(noise) => Some(noise.wavelet),
            Kind::Wavelet(wavelet) => Some(wavelet),
            _ => None,
        };
        Self { plane: set.plane(), patterns: (0..set.len()).map(shown).collect(), wavelet }
    }

    /// Pictures that were imported, `curve` in place of what the import says of them if there is one; told the steps done.
    ///
    /// # Errors
    /// Pictures that are gone, coloured or of another size; settings that are not as `import pairs` writes them.
    pub fn imported(
        root: &Path,
        import: &ImportDescription,
        curve: Option<&EmitterCurve>,
        progress: &mut dyn FnMut(u64, u64) -> Result<()>,
    ) -> Result<Self> {
        let bad = |name: &str| {
            let place = root.join("session.toml").display().to_string();
            Error::invalid(place, format!("no usable `{name}`"), "a session as `relume import pairs` makes it")
        };
        let number = |name: &str| {
            let found = import.settings.get(name).and_then(toml::Value::as_integer);
            found.and_then(|n| usize::try_from(n).ok()).ok_or_else(|| bad(name))
        };
        let plane = Plane::new(number("columns")?, number("rows")?)?;
        let said = import.settings.get("emitted").and_then(toml::Value::as_str).ok_or_else(|| bad("emitted"))?;
        let curve = match (curve, said) {
            (Some(curve), _) => curve.clone(),
            (None, "linear") => EmitterCurve::Linear,
            (None, "srgb") => EmitterCurve::Srgb,
            (None, table) => EmitterCurve::read(&root.join(table))?,
        };
        let texel = number("texel")?;
        let files = import.settings.get("patterns").and_then(toml::Value::as_array).ok_or_else(|| bad("patterns"))?;
        let mut shown = Vec::with_capacity(files.len());
        for file in files {
            let path = root.join(file.as_str().ok_or_else(|| bad("patterns"))?);
            let pattern = patterns::emitted(&path, &curve, texel)?;
            if (pattern.columns, pattern.rows) != plane.size() {
                let found = format!("{} x {} texels", pattern.columns, pattern.rows);
                let expected = format!("{} x {}, as the others", plane.columns(), plane.rows());
                return Err(Error::invalid(path.display().to_string(), found, expected));
            }
            shown.push(pattern);
            progress(shown.len() as u64, files.len() as u64)?;
        }
        Ok(Self { plane, patterns: shown, wavelet: None })
    }
}

/// The curve of the screen from a session's ramp, or the one that was `assumed`; and words for the report.
///
/// # Errors
/// Files that are gone or changed; a ramp that does not rise.
pub fn measured(
    records: &Records,
    developer: &Developer,
    sets: &Sets,
    assumed: &EmitterCurve,
) -> Result<(EmitterCurve, String)> {
    let mut codes: Vec<(u8, &Photograph)> = Vec::new();
    for photograph in records.of(Role::Calibration) {
        let Condition::Pattern { set, number, .. } = &photograph.condition else { continue };
        if let Some(set) = sets.get(set).filter(|set| *number < set.len())
            && let Element::Ramp { code } = set.element(*number)
        {
            codes.push((code, photograph));
        }
    }
    let find = |wanted: u8| codes.iter().find(|(code, _)| *code == wanted);
    let (Some((_, black)), Some((_, white))) = (find(0), find(255)) else {
        let words = "emitter    its curve was not measured: taken as assumed ([calibration] patterns: ramp)\n";
        return Ok((assumed.clone(), words.to_owned()));
    };
    let mut ramp = Ramp::new(&developer.picture(records, black)?, &developer.picture(records, white)?)?;
    for (code, photograph) in &codes {
        ramp.add(*code, &developer.picture(records, photograph)?)?;
    }
    let measured = ramp.finish()?;
    let words =
        format!("emitter    measured from {} codes: about a gamma of {:.2}\n", measured.codes.len(), measured.gamma());
    Ok((measured.curve()?, words))
}
