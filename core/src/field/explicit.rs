//! Answers to the wavelets that a screen showed: explicit sampling (6.6).
//!
//! Picture j is `C_j = T s_j`, `s_j` a column of S. Light is expanded, `a = A L`, and what was shown of it answers:
//! `T L ~ sum_j a_j C_j`. (A field compressed to wavelets is lit by `S^T L` instead.)

use std::ops::Range;

use super::asset::Opening;
use super::dense::{CHANNELS, Dense};
use super::store::Scratch;
use crate::domain::Domain;
use crate::error::{Error, Result};
use crate::wavelet::Transform;

/// Pictures under explicit wavelets in an open container.
#[derive(Debug)]
pub struct Explicit {
    pictures: Dense,
    transform: Transform,
    locations: Vec<u32>,
}

impl Explicit {
    /// Checks the locations. Nothing where the domain is no screen.
    pub(super) fn open(
        open: &Opening<'_>,
        pictures: Dense,
        domain: &Domain,
        wavelet: &str,
        locations: Range<u64>,
    ) -> Result<Option<Self>> {
        let Some(plane) = domain.plane() else { return Ok(None) };
        let named = |error: Error| Error::invalid(open.place, error.to_string(), "usable wavelets");
        let transform = wavelet.parse().and_then(|wavelet| plane.transform(wavelet)).map_err(named)?;
        let mut scratch = Scratch::default();
        let bytes = open.store.get(locations.start, (locations.end - locations.start) as usize, &mut scratch)?;
        let locations: Vec<u32> = bytes.chunks_exact(4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect();
        let mut shown = vec![false; plane.len()];
        for &location in &locations {
            match shown.get_mut(location as usize) {
                Some(shown) if !*shown => *shown = true,
                _ => {
                    let expected = format!("each below {}, once", plane.len());
                    return Err(Error::invalid(open.place, format!("a wavelet at location {location}"), expected));
                }
            }
        }
        Ok(Some(Self { pictures, transform, locations }))
    }

    /// One picture a function.
    pub fn pictures(&self) -> &Dense {
        &self.pictures
    }

    /// The transform that the functions belong to.
    pub fn transform(&self) -> &Transform {
        &self.transform
    }

    /// The location of each function.
    pub fn locations(&self) -> &[u32] {
        &self.locations
    }

    /// `a = A L` of the functions that were shown, from RGB light of the texels.
    ///
    /// # Panics
    /// When there is not one triple a texel.
    pub fn expanded(&self, light: &[[f32; 3]]) -> Vec<[f32; 3]> {
        let mut all = light.to_vec();
        self.transform.forward(all.as_flattened_mut(), CHANNELS);
        self.locations.iter().map(|&location| all[location as usize]).collect()
    }

    /// `A^T m`, the adjoint of [`Explicit::expanded`]: one RGB triple a texel from one a function.
    ///
    /// # Panics
    /// When there is not one triple a function.
    pub fn expanded_adjoint(&self, sums: &[[f32; 3]]) -> Vec<[f32; 3]> {
        assert_eq!(sums.len(), self.locations.len(), "one triple a function");
        let (width, height) = self.transform.size();
        let mut all = vec![[0.0; CHANNELS]; width * height];
        self.locations.iter().zip(sums).for_each(|(&location, sum)| all[location as usize] = *sum);
        self.transform.forward_adjoint(all.as_flattened_mut(), CHANNELS);
        all
    }
}
