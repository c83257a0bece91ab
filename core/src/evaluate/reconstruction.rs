//! How well reflectance functions are rebuilt from a part of their samples (4.4.1).
//!
//! The reflectance function of pixel i is known at all lamps, `T'_i`. From the kept lamps alone, `T_i`, each method U fills
//! in all of them, and the error is
//!
//! `e_i = ||U(T_i) - T'_i||_2 / ||T'_i||_2`
//!
//! over all lamps and the three channels together; the division takes albedo out. Nothing is clamped. A pixel that is
//! black under every lamp has no error: 0.

use std::sync::Arc;

use super::blocks::{Channels, Progress, map_pixels};
use super::subset::{Keep, Subset};
use crate::domain::Directions;
use crate::error::{Error, Result};
use crate::field::{BLOCK_PIXELS, Samples};
use crate::reconstruct::{Method, Reconstruction, Resampling};

/// A thinned set of lamps, and the methods that can rebuild it.
#[derive(Debug, Clone)]
pub struct Thinned {
    /// Which lamps are left.
    pub subset: Subset,
    /// They alone, with the axis and coverage of all.
    pub domain: Arc<Directions>,
    /// One for each method that can be used, over [`Thinned::domain`].
    pub methods: Vec<Arc<Reconstruction>>,
    /// The methods that cannot, and why: grid methods over lamps that form none.
    pub refused: Vec<(Method, String)>,
}

impl Thinned {
    /// Thins a set and builds the methods over what is left.
    ///
    /// # Errors
    /// As [`Subset::new`]; what a method cannot do but for the kind of the lamp set; no method left.
    pub fn new(whole: &Directions, keep: Keep, methods: &[Method]) -> Result<Self> {
        let subset = Subset::new(whole, keep)?;
        let domain = Arc::new(subset.domain(whole)?);
        let (methods, refused) = build(&domain, methods)?;
        Ok(Self { subset, domain, methods, refused })
    }
}

/// The methods that a set of lamps allows, and those that it does not.
///
/// # Errors
/// Other failures than [`Error::Unsupported`]; no method left.
#[expect(clippy::type_complexity, reason = "two lists, named where they are received")]
pub fn build(
    domain: &Arc<Directions>,
    methods: &[Method],
) -> Result<(Vec<Arc<Reconstruction>>, Vec<(Method, String)>)> {
    let (mut built, mut refused) = (Vec::new(), Vec::new());
    for &method in methods {
        match Reconstruction::new(domain.clone(), method) {
            Ok(reconstruction) => built.push(Arc::new(reconstruction)),
            Err(error @ Error::Unsupported { .. }) => refused.push((method, error.to_string())),
            Err(error) => return Err(error),
        }
    }
    match (built.is_empty(), refused.first()) {
        (true, Some((_, reason))) => {
            Err(Error::invalid("methods", format!("none that these lamps allow ({reason})"), "at least one"))
        }
        _ => Ok((built, refused)),
    }
}

/// `e_i` of every pixel: one plane of width x height for each of [`Thinned::methods`], row 0 at the top. One pass over the
/// field for all methods. Cost: lamps x kept lamps multiplications a pixel, channel and dense method.
///
/// # Errors
/// A field of other lamps than `whole`; bytes that cannot be read, numbers that are not finite, what `progress` returns.
pub fn relative_errors(
    samples: Samples<'_>,
    whole: &Directions,
    thinned: &Thinned,
    progress: &mut Progress<'_>,
) -> Result<Vec<Vec<f32>>> {
    if samples.layout().elements != whole.len() {
        let found = format!("{} lamps", whole.len());
        return Err(Error::invalid("lamps", found, format!("{}, as the field has", samples.layout().elements)));
    }
    // `U` at all lamps: what a method makes of one sample a kept lamp (eq. 4.6, at the places of the reference).
    let upsamplings: Vec<Resampling> =
        thinned.methods.iter().map(|method| Resampling::new(method, whole.lamps())).collect();
    let work = |channels: &Channels| block_errors(channels, &thinned.subset.kept, &upsamplings, whole.len());
    map_pixels(samples, upsamplings.len(), work, progress)
}

/// `e_i` of one block: `[method][8][16]`.
fn block_errors(channels: &Channels, kept: &[u32], upsamplings: &[Resampling], lamps: usize) -> Vec<f32> {
    let mut errors = vec![0.0f64; upsamplings.len() * BLOCK_PIXELS];
    let mut energies = [0.0f64; BLOCK_PIXELS];
    let mut rebuilt = vec![0.0; BLOCK_PIXELS * lamps];
    for reference in channels {
        for lamp in reference.chunks_exact(BLOCK_PIXELS) {
            energies.iter_mut().zip(lamp).for_each(|(sum, t)| *sum += f64::from(t * t));
        }
        let of = |&n: &u32| &reference[n as usize * BLOCK_PIXELS..][..BLOCK_PIXELS];
        let samples: Vec<f32> = kept.iter().flat_map(of).copied().collect();
        for (upsampling, errors) in upsamplings.iter().zip(errors.chunks_exact_mut(BLOCK_PIXELS)) {
            upsampling.apply(&samples, &mut rebuilt);
            let lamps = rebuilt.chunks_exact(BLOCK_PIXELS).zip(reference.chunks_exact(BLOCK_PIXELS));
            for (rebuilt, reference) in lamps {
                for ((sum, u), t) in errors.iter_mut().zip(rebuilt).zip(reference) {
                    *sum += f64::from((u - t) * (u - t));
                }
            }
        }
    }
    let relative = |(at, sum): (usize, &f64)| match energies[at % BLOCK_PIXELS] {
        0.0 => 0.0,
        energy => (sum / energy).sqrt() as f32,
    };
    errors.iter().enumerate().map(relative).collect()
}

/// Mean and standard deviation (of the whole population).
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Summary {
    /// The mean.
    pub mean: f64,
    /// The standard deviation about it.
    pub deviation: f64,
}

impl Summary {
    /// Of some numbers; zeros of none.
    pub fn of(numbers: impl Iterator<Item = f64> + Clone) -> Self {
        let count = numbers.clone().count().max(1) as f64;
        let mean = numbers.clone().sum::<f64>() / count;
        let deviation = (numbers.map(|v| (v - mean) * (v - mean)).sum::<f64>() / count).sqrt();
        Self { mean, deviation }
    }

    /// Of one plane of numbers over a set of pixels.
    pub fn over(plane: &[f32], pixels: &[u32]) -> Self {
        Self::of(pixels.iter().map(|&i| f64::from(plane[i as usize])))
    }
}

#[cfg(test)]
mod tests;
