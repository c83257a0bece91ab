//! Basis functions that a screen showed one by one: explicit sampling (6.6) -> `C_j = T psi_j`.

use std::collections::HashMap;
use std::path::Path;

use rayon::prelude::*;
use relume_core::acquire::explicit::Parts;
use relume_core::acquire::{self, Reporting};
use relume_core::domain::patterns::{Element, Kind, PatternSet};
use relume_core::domain::{Bits, Emitter, EmitterCurve};
use relume_core::field::{self, BLOCK_HEIGHT, Contents, Precision};
use relume_core::files::folder_of;
use relume_core::image::Image;
use relume_core::wavelet::Wavelet;
use relume_core::{Error, Result};

use super::photographs::Photographs;
use super::view::{Ready, View};
use crate::capture::explicit::location;
use crate::pack::records::Records;
use crate::progress::{Progress, Unit};
use crate::rigs::Condition;
use crate::session::{Photograph, Role};

/// Functions that strayed by more than this share of the range are told of: 8-bit codes alone stray by 1 % of sRGB's slope.
const STRAYS: f32 = 0.02;

/// A function that was shown whole.
#[derive(Debug)]
pub struct Function<'a> {
    /// Where its coefficient lies.
    pub location: u32,
    /// Its patterns: one, or those of the positive and of the negative part.
    pub numbers: Vec<usize>,
    /// Their photographs.
    pub photographs: Vec<&'a Photograph>,
}

/// The functions of a session, in the order in which they were shown. One whose second part is missing is left out.
///
/// # Errors
/// None at all; patterns that are not the set's.
pub fn functions<'a>(records: &'a Records, set: &PatternSet) -> Result<Vec<Function<'a>>> {
    let mut parts: HashMap<u32, usize> = HashMap::new();
    for number in 0..set.len() {
        *parts.entry(location(set, number)?).or_default() += 1;
    }
    let mut functions: Vec<Function<'_>> = Vec::new();
    for photograph in records.of(Role::Sample) {
        let Condition::Pattern { number, .. } = photograph.condition else { continue };
        if number >= set.len() {
            let found = format!("function {number} in photograph {}", photograph.number);
            return Err(Error::invalid("the session", found, format!("{} of the rig's", set.len())));
        }
        let location = location(set, number)?;
        match functions.last_mut() {
            Some(last) if last.location == location => {
                last.numbers.push(number);
                last.photographs.push(photograph);
            }
            _ => functions.push(Function { location, numbers: vec![number], photographs: vec![photograph] }),
        }
    }
    functions.retain(|function| function.photographs.len() == parts[&function.location]);
    if functions.is_empty() {
        let expected = "one at least: go on with `relume capture --session ... --resume`";
        return Err(Error::invalid("the session", "no basis function that was photographed whole", expected));
    }
    Ok(functions)
}

/// Everything that goes into the field.
pub struct ExplicitPack<'a> {
    /// The photographs.
    pub photographs: &'a Photographs<'a>,
    /// The functions, with theirs.
    pub functions: &'a [Function<'a>],
    /// The patterns that were shown.
    pub set: &'a PatternSet,
    /// How deep its codes were.
    pub bits: Bits,
    /// The screen's curve as it was taken for, and as it is.
    pub curves: [&'a EmitterCurve; 2],
    /// The white screen as light, the black one subtracted; shifted functions want it.
    pub white: Option<&'a Image>,
    /// Where pixels look.
    pub view: &'a View,
    /// The same, ready.
    pub ready: &'a Ready,
}

impl ExplicitPack<'_> {
    /// Writes the field.
    ///
    /// # Errors
    /// Files that are gone or changed; no room.
    pub fn write(&self, output: &Path, provenance: serde_json::Value) -> Result<()> {
        let size = self.photographs.size();
        let total = (self.functions.len() + size.1.div_ceil(BLOCK_HEIGHT)) as u64;
        let mut progress = Progress::new("packing", Unit::Steps);
        let mut pictures = acquire::Photographs::new(size.0, size.1, folder_of(output));
        let shown = Shown::new(self.set, self.bits, self.curves);
        // As many at a time as there are threads: their order stays, memory stays bounded.
        for group in self.functions.chunks(rayon::current_num_threads()) {
            let made: Vec<Result<Image>> = group.par_iter().map(|function| self.picture(function, &shown)).collect();
            for picture in made {
                pictures.push(picture?)?;
            }
            progress.step(pictures.len() as u64, total)?;
        }
        let mut ambient = self.photographs.black().cloned();
        ambient.iter_mut().for_each(|ambient| self.ready.in_units(ambient));
        let contents = Contents {
            domain: self.view.domain(self.set.plane()),
            irradiance: Vec::new(),
            width: size.0,
            height: size.1,
            colour_space: self.photographs.colour_space(),
            precision: Precision::Half,
            largest: pictures.largest(),
            ambient,
            alpha: self.view.alpha.clone(),
            reliability: None,
            provenance,
        };
        let locations: Vec<u32> = self.functions.iter().map(|function| function.location).collect();
        let step = &mut |done, all| progress.step(done, all);
        let mut bands = Reporting { photographs: &mut pictures, progress: step, total };
        field::write_explicit(output, &contents, (self.wavelet()?, &locations), &mut bands)
    }

    /// What a person should know: functions that were shown through another curve than the screen's are other functions.
    pub fn doubts(&self) -> Option<String> {
        let two_levels =
            self.wavelet().is_ok_and(|wavelet| wavelet == Wavelet::Haar) && matches!(self.set.kind(), Kind::Wavelet(_));
        let shown = Shown::new(self.set, self.bits, self.curves);
        let off = |n: u16| (shown.light(f32::from(n) / 255.0) - f32::from(n) / 255.0).abs();
        let worst = (0..=255).map(off).fold(0.0, f32::max);
        (worst > STRAYS && !two_levels).then(|| {
            format!(
                "the functions were shown through another curve than the screen's, and their light strayed by up to {:.0} %: \
                 measure it with `relume calibrate gamma`, name it in the rig file ([monitor] curve), and capture again",
                100.0 * worst
            )
        })
    }

    fn wavelet(&self) -> Result<Wavelet> {
        match self.set.kind() {
            Kind::Wavelet(wavelet) | Kind::Shifted(wavelet) => Ok(wavelet),
            other => Err(Error::invalid("explicit sampling", format!("patterns of {}", other.id()), "wavelets")),
        }
    }

    /// `C = T psi` of the object, in units of the white screen.
    fn picture(&self, function: &Function<'_>, shown: &Shown<'_>) -> Result<Image> {
        let lit = function.photographs.iter().map(|p| self.photographs.lit(p)).collect::<Result<Vec<_>>>()?;
        let light: Vec<Vec<f32>> = function.numbers.iter().map(|number| shown.pattern(*number)).collect();
        let (Some(first), Some(number)) = (lit.first(), function.numbers.first()) else {
            return Err(Error::invalid("a function", "no photograph", "one at least"));
        };
        let scale = self.set.scale(*number);
        // Black is subtracted already.
        let black = Image::new(first.width(), first.height(), first.channels());
        let shifted = matches!(self.set.element(*number), Element::Shifted { .. });
        let texels =
            |value: &dyn Fn(usize) -> f32| -> Vec<f32> { (0..light[0].len()).map(|n| scale * value(n)).collect() };
        let (parts, psi) = match (lit.get(1), shifted) {
            (_, true) => (Parts::Shifted(first), texels(&|n| 2.0 * light[0][n] - 1.0)),
            (Some(second), false) => (Parts::Split(first, second), texels(&|n| light[0][n] - light[1][n])),
            (None, false) => (Parts::Positive(first), texels(&|n| light[0][n])),
        };
        let white = match (self.white, shifted) {
            (Some(white), _) => white,
            (None, false) => &black,
            (None, true) => {
                return Err(Error::invalid(
                    "the session",
                    "no photograph of the white screen",
                    "one: capture it again",
                ));
            }
        };
        let mut picture = parts.picture(scale, &black, white)?;
        self.ready.of_object(&mut picture, &psi);
        Ok(picture)
    }
}

/// Patterns as they were emitted.
struct Shown<'a> {
    set: &'a PatternSet,
    assumed: Emitter,
    screen: Emitter,
}

impl<'a> Shown<'a> {
    fn new(set: &'a PatternSet, bits: Bits, [assumed, screen]: [&EmitterCurve; 2]) -> Self {
        Self { set, assumed: Emitter::new(assumed, bits), screen: Emitter::new(screen, bits) }
    }

    fn light(&self, wanted: f32) -> f32 {
        self.screen.light(self.assumed.code(wanted))
    }

    fn pattern(&self, number: usize) -> Vec<f32> {
        self.set.pattern(number).values.into_iter().map(|wanted| self.light(wanted)).collect()
    }
}
