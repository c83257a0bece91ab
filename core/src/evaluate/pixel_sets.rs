//! Sets of pixels alike in material and shadow, found from their reflectance functions (4.4.1, figure 4.16).
//!
//! Where a surface is diffuse and nothing is in the way, its reflectance function is one clamped cosine, `p_j = max(0, b .
//! w_j)`, b the albedo over pi times the normal. So b is fitted robustly to the samples r_j of a pixel (the mean of the
//! channels; highlights and shadows are outliers, as in photometric stereo), and what is told apart is how r leaves p:
//!
//! | trait | formula | high for |
//! |---|---|---|
//! | gloss | `||max(0, r - p)|| / ||r||`, the part above the cosine | highlights, mirrors, glass, caustics; also places that only a few lamps reach |
//! | shadow | the share of lamps facing the surface (p over 0.3 of its peak) with r under 0.3 p | cast shadows |
//! | misfit | `||r - p|| / ||r||` | anything but a diffuse unoccluded surface |

use std::collections::BTreeSet;

use nalgebra::Matrix3;
use rand::SeedableRng;
use rand::seq::index;
use rand_pcg::Pcg32;

use super::blocks::{Channels, Progress, map_pixels};
use crate::domain::Directions;
use crate::error::{Error, Result};
use crate::field::{BLOCK_PIXELS, Samples};
use crate::image::Image;
use crate::math::Vec3;

/// Pixels whose reflectance function has less than this part of the median norm are black: their relative errors are
/// noise over nothing.
const BLACK: f32 = 0.02;
/// Pixels that the object covers less than this are edges or background.
const COVERED: f32 = 0.5;
/// Above this gloss a pixel is glossy. On a path-traced toy car (see the test) nine tenths of the pixels of a glossy paint of
/// GGX width 0.25 are above, nine tenths of the diffuse ones below.
const GLOSSY: f32 = 0.20;
/// Above this share of shadowed lamps a pixel that is not glossy is shadowed.
const SHADOWED: f32 = 0.10;
/// A pixel in less shadow than this, with less misfit than [`DIFFUSE`], is diffuse and unoccluded.
const UNOCCLUDED: f32 = 0.04;
/// See [`UNOCCLUDED`]; shadows of a twentieth of the lamps and interreflection leave about as much.
const DIFFUSE: f32 = 0.15;

/// How a reflectance function differs from a clamped cosine.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Traits {
    /// Its mean, in the numbers of the field as stored.
    pub mean: f32,
    /// Its norm over the root of the number of lamps.
    pub energy: f32,
    /// What lies above the cosine, 0 to 1.
    pub gloss: f32,
    /// The share of facing lamps that are dark, 0 to 1.
    pub shadow: f32,
    /// What lies off the cosine.
    pub misfit: f32,
}

/// What makes pixels alike.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Kind {
    /// All of the object.
    All,
    /// Diffuse and unoccluded.
    Diffuse,
    /// Glossy and specular.
    Glossy,
    /// Diffuse in complex shadow.
    Shadowed,
}

impl Kind {
    /// All of them, in the order of figure 4.16.
    pub const ALL: [Self; 4] = [Self::All, Self::Diffuse, Self::Glossy, Self::Shadowed];

    /// The name of the set.
    pub fn name(self) -> &'static str {
        match self {
            Self::All => "all",
            Self::Diffuse => "diffuse",
            Self::Glossy => "glossy",
            Self::Shadowed => "shadowed",
        }
    }

    /// Does a pixel that is no background and not black belong here?
    fn takes(self, t: &Traits) -> bool {
        let glossy = t.gloss > GLOSSY;
        match self {
            Self::All => true,
            Self::Glossy => glossy,
            Self::Shadowed => !glossy && t.shadow > SHADOWED,
            Self::Diffuse => !glossy && t.shadow < UNOCCLUDED && t.misfit < DIFFUSE,
        }
    }
}

/// Pixels under a name.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct PixelSet {
    /// What it is called.
    pub name: String,
    /// Drawn by somebody, not found from the reflectance functions?
    pub from_mask: bool,
    /// Indices `y * width + x`, ascending.
    #[serde(skip)]
    pub pixels: Vec<u32>,
}

impl PixelSet {
    /// The pixels where the mean of a mask's channels exceeds 0.5, as in [`compare`](super::compare).
    ///
    /// # Errors
    /// A mask of another size, or without such a pixel.
    pub fn from_mask(name: &str, mask: &Image, size: (usize, usize)) -> Result<Self> {
        let place = || format!("the mask {name}");
        if mask.size() != size {
            let show = |(w, h): (usize, usize)| format!("{w} x {h} pixels");
            return Err(Error::invalid(place(), show(mask.size()), format!("{}, as the field has", show(size))));
        }
        let chosen = |i: &u32| mask.pixel(*i as usize % size.0, *i as usize / size.0)[..3].iter().sum::<f32>() > 1.5;
        let pixels: Vec<u32> = (0..(size.0 * size.1) as u32).filter(chosen).collect();
        if pixels.is_empty() {
            return Err(Error::invalid(place(), "no pixel whose mean exceeds 0.5", "at least one"));
        }
        Ok(Self { name: name.to_owned(), from_mask: true, pixels })
    }
}

/// The traits of every pixel: width x height, row 0 at the top. One pass over the field.
///
/// # Errors
/// Bytes that cannot be read, numbers that are not finite, what `progress` returns.
pub fn traits(samples: Samples<'_>, lamps: &Directions, progress: &mut Progress<'_>) -> Result<Vec<Traits>> {
    let work = |channels: &Channels| {
        let mean =
            |j: usize, at: usize| channels.iter().map(|c| f64::from(c[j * BLOCK_PIXELS + at])).sum::<f64>() / 3.0;
        let of_pixel = |at: usize| {
            let samples: Vec<f64> = (0..lamps.len()).map(|j| mean(j, at)).collect();
            traits_of(lamps.lamps(), &samples)
        };
        (0..BLOCK_PIXELS).map(of_pixel).collect()
    };
    Ok(map_pixels(samples, 1, work, progress)?.pop().unwrap_or_default())
}

/// The sets of figure 4.16 among pixels of these traits; where there is coverage, only among those that the object covers.
/// A pixel may be in none but `all`: in half shadow, or rougher than a diffuse and duller than a glossy one. Empty sets are
/// left out.
pub fn find(traits: &[Traits], alpha: Option<&[f32]>) -> Vec<PixelSet> {
    let energies: Vec<f32> = traits.iter().map(|t| t.energy).collect();
    let seen = not_black(&energies, alpha);
    let of_kind = |kind: Kind| {
        let pixels = seen.iter().copied().filter(|i| kind.takes(&traits[*i as usize])).collect();
        PixelSet { name: kind.name().to_owned(), from_mask: false, pixels }
    };
    Kind::ALL.map(of_kind).into_iter().filter(|set| !set.pixels.is_empty()).collect()
}

/// The pixels of the object that are not black, as those of the set `all`, but without looking for what they show: black is
/// less than a fiftieth of the median norm of the functions, three channels together. One pass over the field.
///
/// # Errors
/// As [`traits`].
pub fn seen(samples: Samples<'_>, alpha: Option<&[f32]>, progress: &mut Progress<'_>) -> Result<Vec<u32>> {
    let work = |channels: &Channels| {
        let mut energies = vec![0.0f32; BLOCK_PIXELS];
        for element in channels.iter().flat_map(|channel| channel.chunks_exact(BLOCK_PIXELS)) {
            energies.iter_mut().zip(element).for_each(|(sum, t)| *sum += t * t);
        }
        energies.iter().map(|energy| energy.sqrt()).collect()
    };
    Ok(not_black(&map_pixels(samples, 1, work, progress)?.pop().unwrap_or_default(), alpha))
}

/// Pixels of the object whose function has a norm above [`BLACK`].
fn not_black(norms: &[f32], alpha: Option<&[f32]>) -> Vec<u32> {
    let covered = |i: &u32| alpha.is_none_or(|alpha| alpha[*i as usize] >= COVERED);
    let object: Vec<u32> = (0..norms.len() as u32).filter(covered).collect();
    let mut lit: Vec<f32> = object.iter().map(|&i| norms[i as usize]).filter(|norm| *norm > 0.0).collect();
    if lit.is_empty() {
        return Vec::new();
    }
    let middle = lit.len() / 2;
    let black = BLACK * *lit.select_nth_unstable_by(middle, f32::total_cmp).1;
    object.into_iter().filter(|&i| norms[i as usize] > black).collect()
}

/// `count` of some pixels by chance, or all where there are no more; ascending. The same seed gives the same.
pub fn sampled(pixels: &[u32], count: usize, seed: u64) -> Vec<u32> {
    if count >= pixels.len() {
        return pixels.to_vec();
    }
    let mut rng = Pcg32::seed_from_u64(seed);
    let mut chosen: Vec<u32> = index::sample(&mut rng, pixels.len(), count).iter().map(|n| pixels[n]).collect();
    chosen.sort_unstable();
    chosen
}

/// Puts masks in the place of the found sets of the same name, and others behind them.
///
/// # Errors
/// Two masks of one name.
pub fn with_masks(mut found: Vec<PixelSet>, masks: Vec<PixelSet>) -> Result<Vec<PixelSet>> {
    let mut names = BTreeSet::new();
    for mask in masks {
        if !names.insert(mask.name.clone()) {
            return Err(Error::invalid("masks", format!("two that are called {}", mask.name), "a name for each"));
        }
        match found.iter_mut().find(|set| set.name == mask.name) {
            Some(set) => *set = mask,
            None => found.push(mask),
        }
    }
    Ok(found)
}

/// A lamp faces the surface where the cosine exceeds this part of its largest: below, shadow and grazing light are alike.
const FACING: f64 = 0.3;
/// A facing lamp is shadowed where the sample is under this part of the cosine; interreflection fills some of a shadow.
const DARK: f64 = 0.3;

fn traits_of(lamps: &[Vec3], samples: &[f64]) -> Traits {
    let count = samples.len() as f64;
    let energy: f64 = samples.iter().map(|r| r * r).sum();
    let mut traits = Traits {
        mean: (samples.iter().sum::<f64>() / count) as f32,
        energy: (energy / count).sqrt() as f32,
        ..Traits::default()
    };
    if energy == 0.0 {
        return traits;
    }
    let b = lambert(lamps, samples);
    let cosines: Vec<f64> = lamps.iter().map(|w| b.dot(w).max(0.0)).collect();
    let peak = cosines.iter().copied().fold(0.0, f64::max);
    let (mut above, mut off, mut facing, mut dark) = (0.0, 0.0, 0u32, 0u32);
    for (r, p) in samples.iter().zip(&cosines) {
        above += (r - p).max(0.0).powi(2);
        off += (r - p).powi(2);
        if *p > FACING * peak {
            facing += 1;
            dark += u32::from(*r < DARK * p);
        }
    }
    traits.gloss = (above / energy).sqrt() as f32;
    traits.misfit = (off / energy).sqrt() as f32;
    traits.shadow = dark as f32 / facing.max(1) as f32;
    traits
}

/// Rounds of fitting; the set of inliers has settled by then.
const ROUNDS: usize = 8;
/// Samples within this part of the cosine belong to it.
const INLIER: f64 = 0.25;
/// Fits begin with the samples between two percentiles: neither shadows nor highlights for a surface that sees most lamps,
/// half of them, or a few.
const STARTS: [(usize, usize); 3] = [(40, 90), (70, 95), (85, 99)];

/// b of the clamped cosine that explains most light: of the fits from all [`STARTS`] the one whose inliers sum to most.
fn lambert(lamps: &[Vec3], samples: &[f64]) -> Vec3 {
    let mut sorted = samples.to_vec();
    sorted.sort_by(f64::total_cmp);
    let quantile = |percent: usize| sorted[(sorted.len() - 1) * percent / 100];
    let mut best = (f64::NEG_INFINITY, Vec3::zeros());
    for (low, high) in STARTS {
        let range = quantile(low)..=quantile(high);
        let b = settle(lamps, samples, |r| r > 0.0 && range.contains(&r));
        let explained = lamps.iter().zip(samples).filter(|(w, r)| fits(**r, b.dot(w))).map(|entry| entry.1).sum();
        best = if explained > best.0 { (explained, b) } else { best };
    }
    best.1
}

/// Least squares over the samples that the fit before explained, from a first choice.
fn settle(lamps: &[Vec3], samples: &[f64], first: impl Fn(f64) -> bool) -> Vec3 {
    let mut inliers: Vec<bool> = samples.iter().map(|r| first(*r)).collect();
    let mut b = Vec3::zeros();
    for _ in 0..ROUNDS {
        let (mut normal, mut right) = (Matrix3::zeros(), Vec3::zeros());
        for ((w, r), _) in lamps.iter().zip(samples).zip(&inliers).filter(|entry| *entry.1) {
            normal += w * w.transpose();
            right += w * *r;
        }
        // Fewer than three inliers, or all in a plane: what was found before stands.
        let Some(solved) = normal.cholesky().map(|c| c.solve(&right)) else { break };
        b = solved;
        inliers = lamps.iter().zip(samples).map(|(w, r)| fits(*r, b.dot(w))).collect();
    }
    b
}

fn fits(r: f64, p: f64) -> bool {
    p > 0.0 && (r - p).abs() < INLIER * p
}

#[cfg(test)]
mod tests;
