//! Basis functions that a screen showed, with their photographs: explicit sampling (6.6) -> `C_j = T psi_j`.

use std::collections::HashMap;
use std::path::Path;

use relume_core::acquire::explicit::Parts;
use relume_core::acquire::{Photographs, Reporting};
use relume_core::domain::patterns::{Element, PatternSet, Wavelets};
use relume_core::field::{self, BLOCK_HEIGHT, Contents};
use relume_core::files::folder_of;
use relume_core::image::Image;
use relume_core::wavelet::Wavelet;
use relume_core::{Error, Result};

use super::develop::Developer;
use super::records::Records;
use crate::capture::explicit::location;
use crate::rigs::Condition;
use crate::session::{Photograph, Role};

/// A function that was shown whole.
#[derive(Debug)]
pub struct Function<'a> {
    /// Where its coefficient lies.
    pub location: u32,
    /// A pattern of it; that of the positive part, where it has two.
    pub number: usize,
    /// Its photographs: one, or those of the positive and of the negative part.
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
            Some(last) if last.location == location => last.photographs.push(photograph),
            _ => functions.push(Function { location, number, photographs: vec![photograph] }),
        }
    }
    functions.retain(|function| function.photographs.len() == parts[&function.location]);
    if functions.is_empty() {
        let expected = "one at least: go on with `relume capture --session ... --resume`";
        return Err(Error::invalid("the session", "no basis function that was photographed whole", expected));
    }
    Ok(functions)
}

/// Everything that goes into the field beside the photographs.
pub struct ExplicitPack<'a> {
    /// The photographs.
    pub records: &'a Records,
    /// The camera.
    pub developer: &'a Developer,
    /// The patterns that were shown.
    pub set: &'a PatternSet,
    /// Their wavelet.
    pub wavelet: Wavelet,
    /// The black photograph and the white one, as light.
    pub plain: [&'a Image; 2],
    /// What the white screen, seen directly, photographs as: T is in units of it.
    pub unit: [f32; 3],
    /// What the camera sees of the screen itself, past the object, under a light of the texels, in the unit of the photographs.
    pub direct: &'a dyn Fn(&[f32]) -> Option<Image>,
}

impl ExplicitPack<'_> {
    /// Writes the container; `contents` comes with its size, domain and layers. `progress(steps done, steps)` may stop it.
    /// Returns the number of functions.
    ///
    /// # Errors
    /// No function; files that are gone or changed; no room.
    pub fn write(
        &self,
        output: &Path,
        mut contents: Contents,
        progress: &mut dyn FnMut(u64, u64) -> Result<()>,
    ) -> Result<usize> {
        let functions = functions(self.records, self.set)?;
        let wavelets = Wavelets::new(self.wavelet, self.set.plane())?;
        let total = (functions.len() + contents.height.div_ceil(BLOCK_HEIGHT)) as u64;
        let mut pictures = Photographs::new(contents.width, contents.height, folder_of(output));
        for function in &functions {
            let mut picture = self.picture(function)?;
            if let Some(direct) = (self.direct)(&wavelets.function(function.location)) {
                picture.data_mut().iter_mut().zip(direct.data()).for_each(|(v, seen)| *v -= seen);
            }
            let per = self.unit.map(|unit| 1.0 / unit);
            picture.data_mut().chunks_exact_mut(3).for_each(|p| (0..3).for_each(|c| p[c] *= per[c]));
            pictures.push(picture)?;
            progress(pictures.len() as u64, total)?;
        }
        contents.largest = pictures.largest();
        let locations: Vec<u32> = functions.iter().map(|function| function.location).collect();
        let mut bands = Reporting { photographs: &mut pictures, progress, total };
        field::write_explicit(output, &contents, (self.wavelet, &locations), &mut bands)?;
        Ok(functions.len())
    }

    /// `T psi`, in the unit of the photographs.
    fn picture(&self, function: &Function<'_>) -> Result<Image> {
        let develop = |photograph: &&Photograph| self.developer.picture(self.records, photograph);
        let lit = function.photographs.iter().map(develop).collect::<Result<Vec<_>>>()?;
        let shifted = matches!(self.set.element(function.number), Element::Shifted { .. });
        let parts = match (&lit[..], shifted) {
            ([one], true) => Parts::Shifted(one),
            ([one], false) => Parts::Positive(one),
            ([positive, negative, ..], _) => Parts::Split(positive, negative),
            ([], _) => return Err(Error::invalid("a function", "no photograph", "one at least")),
        };
        let [black, white] = self.plain;
        parts.picture(self.set.scale(function.number), black, white)
    }
}
