//! Basis functions that a screen showed, with their photographs: explicit sampling (6.6) -> `C_j = T psi_j`.

use std::collections::HashMap;
use std::path::Path;

use rayon::prelude::*;
use relume_core::acquire::explicit::Parts;
use relume_core::acquire::{Photographs, Reporting};
use relume_core::domain::patterns::{Element, PatternSet};
use relume_core::field::{self, BLOCK_HEIGHT, Contents};
use relume_core::files::folder_of;
use relume_core::image::Image;
use relume_core::wavelet::Wavelet;
use relume_core::{Error, Result};

use super::records::Records;
use crate::capture::explicit::location;
use crate::rigs::Condition;
use crate::session::{Photograph, Role};

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

/// Everything that goes into the field beside the photographs' places and layers.
pub struct ExplicitPack<'a> {
    /// The functions, with their photographs.
    pub functions: &'a [Function<'a>],
    /// The patterns that were shown.
    pub set: &'a PatternSet,
    /// Their wavelet.
    pub wavelet: Wavelet,
    /// A photograph as light, the black one subtracted.
    pub lit: &'a (dyn Fn(&Photograph) -> Result<Image> + Sync),
    /// The white screen as light, the black one subtracted; shifted functions want it.
    pub white: Option<&'a Image>,
    /// What a pattern emitted: light of the texels.
    pub emitted: &'a (dyn Fn(usize) -> Vec<f32> + Sync),
    /// Takes the screen itself out of a picture under a light of the texels, and turns it to the unit of T.
    pub of_object: &'a (dyn Fn(&mut Image, &[f32]) + Sync),
}

impl ExplicitPack<'_> {
    /// Writes the container; `contents` comes with its size, domain and layers. `progress(steps done, steps)` may stop it.
    ///
    /// # Errors
    /// Files that are gone or changed; no room.
    pub fn write(
        &self,
        output: &Path,
        mut contents: Contents,
        progress: &mut dyn FnMut(u64, u64) -> Result<()>,
    ) -> Result<()> {
        let total = (self.functions.len() + contents.height.div_ceil(BLOCK_HEIGHT)) as u64;
        let mut pictures = Photographs::new(contents.width, contents.height, folder_of(output));
        // As many at a time as there are threads: their order stays, memory stays bounded.
        for group in self.functions.chunks(rayon::current_num_threads()) {
            let made: Vec<Result<Image>> = group.par_iter().map(|function| self.picture(function)).collect();
            for picture in made {
                pictures.push(picture?)?;
            }
            progress(pictures.len() as u64, total)?;
        }
        contents.largest = pictures.largest();
        let locations: Vec<u32> = self.functions.iter().map(|function| function.location).collect();
        let mut bands = Reporting { photographs: &mut pictures, progress, total };
        field::write_explicit(output, &contents, (self.wavelet, &locations), &mut bands)
    }

    /// `C = T psi` of the object, in the unit of T.
    fn picture(&self, function: &Function<'_>) -> Result<Image> {
        let lit = function.photographs.iter().map(|photograph| (self.lit)(photograph)).collect::<Result<Vec<_>>>()?;
        let shown: Vec<Vec<f32>> = function.numbers.iter().map(|number| (self.emitted)(*number)).collect();
        let Some((first, light)) = lit.first().zip(shown.first()) else {
            return Err(Error::invalid("a function", "no photograph", "one at least"));
        };
        let scale = self.set.scale(function.numbers[0]);
        let no_black = Image::new(first.width(), first.height(), first.channels());
        let shifted = matches!(self.set.element(function.numbers[0]), Element::Shifted { .. });
        let (parts, psi): (_, Vec<f32>) = match (lit.get(1).zip(shown.get(1)), shifted) {
            (_, true) => (Parts::Shifted(first), light.iter().map(|v| scale * (2.0 * v - 1.0)).collect()),
            (Some((second, less)), false) => {
                (Parts::Split(first, second), light.iter().zip(less).map(|(a, b)| scale * (a - b)).collect())
            }
            (None, false) => (Parts::Positive(first), light.iter().map(|v| scale * v).collect()),
        };
        let white = match (self.white, shifted) {
            (Some(white), _) => white,
            (None, false) => &no_black,
            (None, true) => {
                return Err(Error::invalid(
                    "the session",
                    "no photograph of the white screen",
                    "one: capture it again",
                ));
            }
        };
        let mut picture = parts.picture(scale, &no_black, white)?;
        (self.of_object)(&mut picture, &psi);
        Ok(picture)
    }
}
