//! Alpha from stripes and codes (after Zongker, Werner, Curless and Salesin 1999, who tell covered pixels by their stripes).
//!
//! Pattern k on the bare screen would be seen at a pixel as `b_k`, from 1 (lit) to -1 (dark), its mean over the pixel's
//! footprint. A share c of the pixel sees it so; the rest sees the screen elsewhere, or blurred, or looks past it, and adds at
//! most what it adds under white. So with `x_k`, the photograph less that of the inverse over the light of the bare white
//! screen there, and w the same of the white photograph,
//!
//! ```text
//! x_k b_k = c + r_k,   |r_k| <= w - c        where |b_k| = 1
//! ```
//!
//! A diffuse body blurs fine stripes to nothing: `r_k = 0`. Glass shows them from elsewhere, where they are as often lit as not:
//! `r_k` is as often positive as negative, and of one size. Either way c is the middle of the least and the greatest `x_k b_k`
//! over the fine patterns, but by the bound on `r_k` at most `(w + x_k b_k) / 2` of any, fine or coarse (an eighth of them left
//! out at either end), and `alpha = 1 - c`. What is seen straight through, only darker, counts as seen directly.

use half::f16;
use rayon::prelude::*;

use super::bare::BareWhite;
use super::seen::{Footprint, Integral};
use crate::calibrate::screen::{Along, Shown, lines};
use crate::domain::Correspondence;
use crate::error::{Error, Result};
use crate::image::Image;

/// Patterns with so many edges at least are fine: matt bodies show a hundredth of them.
const FINE: usize = 7;
/// Patterns count whose stripe fills the footprint to this degree; failing that, to the next.
const CLEAR: [f64; 3] = [0.97, 0.7, 0.4];
/// So many of them at least.
const FEWEST: usize = 4;
/// One of so many is left out at either end: a stripe's edge that lies a little elsewhere.
const OUTLIERS: usize = 8;
/// Patterns of which the camera keeps less than this share of the contrast that it keeps of the clearest are too fine for it.
const RESOLVED: f64 = 0.5;
/// A pixel sees the bare screen, to begin with, whose contrasts are as expected to this share for stripes that fill so many
/// pixels about it, ...
const ALIKE: f64 = 0.2;
const ABOUT: f64 = 3.0;
/// ... and have this share of the white light.
const LEAST_CONTRAST: f64 = 0.5;
/// Widths of the blur that are tried, in pixels: the area of a pixel alone, and what lenses and demosaicking add.
const WIDTHS: [f64; 5] = [1.0, 1.5, 2.0, 2.5, 3.0];
/// Pixels that judge them.
const JUDGES: usize = 4000;
/// c is taken for 0 or 1 that is so many standard deviations of the noise from it.
const SURE: f64 = 3.0;

/// What stripes say.
#[derive(Debug, Clone)]
pub struct Alpha {
    /// Columns and rows of the picture.
    pub size: (usize, usize),
    /// Coverage of the object: 1 where nothing of the screen is seen directly, row by row.
    pub alpha: Vec<f32>,
    /// The light of the bare white screen, less black.
    pub bare: BareWhite,
    /// Standard deviation of c where the bare screen is seen.
    pub noise: f64,
    /// What a pixel is blurred over, in pixels.
    pub width_px: f64,
    /// White less black, as photographed, RGB.
    pub light: Image,
}

/// One pattern, as seen.
struct Seen {
    along: Along,
    integral: Integral,
    fine: bool,
    contrast: Vec<f16>,
}

/// Finds alpha. `shown[n]` is what `picture(n)` photographs with the object in place, as for
/// [`decode`](crate::calibrate::screen::decode). Memory: two bytes a pixel and pattern.
///
/// # Errors
/// As [`lines`]; a screen that is not seen directly anywhere.
pub fn from_stripes(
    shown: &[Shown],
    picture: &mut dyn FnMut(usize) -> Result<Image>,
    correspondence: &Correspondence,
) -> Result<Alpha> {
    let mut seen = Vec::new();
    let light = lines(shown, picture, &mut |_, line| {
        let edges = line.lit.windows(2).filter(|pair| pair[0] != pair[1]).count();
        let contrast = line.contrast.iter().map(|v| f16::from_f32(*v)).collect();
        seen.push(Seen { along: line.along, integral: Integral::new(line.lit), fine: edges >= FINE, contrast });
        Ok(())
    })?;
    // Coarse patterns alone are better than none.
    if seen.iter().filter(|line| line.fine).count() < FEWEST {
        seen.iter_mut().for_each(|line| line.fine = true);
    }
    let unseen = || {
        let expected = "some of the screen seen past the object, where the correspondence says";
        Error::invalid("the photographs of stripes", "no pixel that sees the screen directly", expected)
    };
    let matcher = Matcher { seen: &seen, correspondence, size: light.size() };
    let direct: Vec<bool> = (0..matcher.pixels()).into_par_iter().map(|pixel| matcher.alike(pixel)).collect();
    let judges: Vec<usize> = (0..direct.len()).filter(|pixel| direct[*pixel]).collect();
    let judges: Vec<usize> = judges.iter().copied().step_by(judges.len().div_ceil(JUDGES).max(1)).collect();
    let Some((width_px, scales)) = matcher.blur(&judges) else { return Err(unseen()) };
    let bare = BareWhite::fit(&light, |pixel| direct[pixel]).ok_or_else(unseen)?;
    let share = |pixel: usize| matcher.share(pixel, (width_px, &scales), relative(&light, &bare, pixel));
    let mut shares: Vec<f64> = (0..matcher.pixels()).into_par_iter().map(share).collect();
    fill(&mut shares, light.width());
    let noise = noise(&judges, &shares);
    for share in &mut shares {
        *share = match *share {
            c if c < SURE * noise => 0.0,
            c if c > 1.0 - SURE * noise => 1.0,
            c => c.clamp(0.0, 1.0),
        };
    }
    let alpha = shares.into_iter().map(|c| (1.0 - c) as f32).collect();
    Ok(Alpha { size: light.size(), alpha, bare, noise, width_px, light })
}

/// w: white light of a pixel over that of the bare screen there.
fn relative(light: &Image, bare: &BareWhite, pixel: usize) -> f64 {
    let (x, y) = (pixel % light.width(), pixel / light.width());
    let expected: f32 = bare.at([x as f64 + 0.5, y as f64 + 0.5]).iter().sum();
    let seen: f32 = light.pixel(x, y).iter().sum();
    f64::from(seen / expected.max(f32::MIN_POSITIVE))
}

/// Where edges of all stripes meet (those of 2, 4, 8... stripes do), a pixel takes the mean of its neighbours.
fn fill(shares: &mut [f64], width: usize) {
    let before = shares.to_vec();
    for (pixel, share) in shares.iter_mut().enumerate().filter(|(_, share)| share.is_nan()) {
        let (x, y) = (pixel % width, pixel / width);
        let rows = y.saturating_sub(1)..(y + 2).min(before.len() / width);
        let near = rows.flat_map(|row| before[row * width..][x.saturating_sub(1)..(x + 2).min(width)].iter());
        let known: Vec<f64> = near.copied().filter(|share| !share.is_nan()).collect();
        *share = known.iter().sum::<f64>() / known.len().max(1) as f64;
    }
}

/// The least and the greatest, outliers left out.
fn ends(values: &mut [f64]) -> [f64; 2] {
    values.sort_unstable_by(f64::total_cmp);
    let outside = values.len() / OUTLIERS;
    [values[outside], values[values.len() - 1 - outside]]
}

/// Of the bare screen, by the median: few of these pixels see something else.
fn noise(judges: &[usize], shares: &[f64]) -> f64 {
    let mut off: Vec<f64> = judges.iter().map(|pixel| (shares[*pixel] - 1.0).abs()).collect();
    let middle = off.len() / 2;
    // The median of |normal| is 0.674 of its deviation.
    off.select_nth_unstable_by(middle, f64::total_cmp).1.min(0.05) / 0.674
}

/// Compares what was seen with what the bare screen would show.
struct Matcher<'a> {
    seen: &'a [Seen],
    correspondence: &'a Correspondence,
    size: (usize, usize),
}

impl Matcher<'_> {
    fn pixels(&self) -> usize {
        self.size.0 * self.size.1
    }

    fn footprint(&self, pixel: usize, width: f64) -> Footprint {
        let at = [(pixel % self.size.0) as f64 + 0.5, (pixel / self.size.0) as f64 + 0.5];
        Footprint::new(self.correspondence, at, width)
    }

    /// b_k, and the contrast q_k = x_k / w, of the patterns.
    fn pairs(&self, pixel: usize, footprint: Footprint) -> impl Iterator<Item = (f64, f64, bool)> {
        self.seen
            .iter()
            .map(move |line| (footprint.seen(line.along, &line.integral), line.contrast[pixel].to_f64(), line.fine))
    }

    /// Does a pixel see what the bare screen shows, as far as its own light goes?
    fn alike(&self, pixel: usize) -> bool {
        let footprint = self.footprint(pixel, ABOUT);
        let clear: Vec<(f64, f64, bool)> =
            self.pairs(pixel, footprint).filter(|(b, _, _)| b.abs() >= CLEAR[0]).collect();
        let scale = clear.iter().map(|(b, q, _)| b * q).sum::<f64>() / clear.len() as f64;
        let alike = |(b, q, _): &(f64, f64, bool)| (b * q - scale).abs() <= ALIKE * scale;
        footprint.inside() && clear.len() >= FEWEST && scale >= LEAST_CONTRAST && clear.iter().all(alike)
    }

    /// The width of the blur that explains all patterns best, and the contrast that the camera keeps of each: stray light and
    /// the lens take some. None where that is too little.
    fn blur(&self, judges: &[usize]) -> Option<(f64, Vec<Option<f64>>)> {
        let fit = |width: f64| {
            let mut sums = vec![[0.0; 3]; self.seen.len()];
            for pixel in judges {
                let pairs = self.pairs(*pixel, self.footprint(*pixel, width));
                for ([bb, bq, qq], (b, q, _)) in sums.iter_mut().zip(pairs) {
                    (*bb, *bq, *qq) = (*bb + b * b, *bq + b * q, *qq + q * q);
                }
            }
            let left: f64 = sums.iter().map(|[bb, bq, qq]| qq - bq * bq / bb.max(1e-9)).sum();
            (left, sums.iter().map(|[bb, bq, _]| bq / bb.max(1e-9)).collect::<Vec<f64>>())
        };
        let found = WIDTHS.map(|width| (width, fit(width)));
        let (width, (_, scales)) = found.iter().min_by(|a, b| a.1.0.total_cmp(&b.1.0))?;
        let most = scales.iter().copied().fold(0.0, f64::max);
        let scales = scales.iter().map(|scale| (*scale > RESOLVED * most).then_some(*scale)).collect();
        (!judges.is_empty() && most > 0.0).then_some((*width, scales))
    }

    /// c of a pixel; noise may bring it below 0 or above 1. NaN where too many edges meet to tell.
    fn share(&self, pixel: usize, (width, scales): (f64, &[Option<f64>]), white: f64) -> f64 {
        let footprint = self.footprint(pixel, width);
        let (mut fine, mut all) = (Vec::with_capacity(self.seen.len()), Vec::with_capacity(self.seen.len()));
        for clear in CLEAR {
            fine.clear();
            all.clear();
            for ((b, q, is_fine), scale) in self.pairs(pixel, footprint).zip(scales) {
                let Some(scale) = scale.filter(|_| b.abs() >= clear) else { continue };
                let x = white * q / (scale * b);
                all.push(x);
                if is_fine {
                    fine.push(x);
                }
            }
            if fine.len() >= FEWEST {
                let ([least, most], [lowest, _]) = (ends(&mut fine), ends(&mut all));
                return (0.5 * (least + most)).min(0.5 * (white + lowest));
            }
        }
        let beside = self.pairs(pixel, footprint).all(|(b, _, _)| b == 0.0);
        if beside { 0.0 } else { f64::NAN }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::domain::patterns::{Kind, PatternSet};
    use crate::domain::{Area, Plane};

    const SIZE: (usize, usize) = (96, 64);

    /// What covers the screen: c, and how the rest of the pixel sees it.
    fn covered(x: usize) -> f64 {
        match x {
            0..30 => 1.0,
            // A soft edge.
            30..40 => 1.0 - (x - 30) as f64 / 10.0,
            _ => 0.0,
        }
    }

    /// A flat screen of 64 x 32 texels behind glass that turns it upside down, larger and darker, above, and a body that sees
    /// all of it evenly, below.
    fn photograph(values: &[f32]) -> Image {
        let mean = values.iter().sum::<f32>() / values.len() as f32;
        let texel = |x: f64, y: f64| f64::from(values[(y * 32.0) as usize * 64 + (x * 64.0) as usize]);
        Image::from_fn(SIZE.0, SIZE.1, |x, y| {
            let seen = |flip: bool| {
                let mut sum = 0.0;
                for n in 0..16 {
                    let u = (x as f64 + (f64::from(n % 4) + 0.5) / 4.0) / SIZE.0 as f64;
                    let v = (y as f64 + (f64::from(n / 4) + 0.5) / 4.0) / SIZE.1 as f64;
                    sum += if flip { texel(0.93 - 0.8 * u, 0.97 - 0.9 * v) } else { texel(u, v) } / 16.0;
                }
                sum
            };
            let rest = if y < 32 { 0.8 * seen(true) } else { 0.3 * f64::from(mean) };
            let c = covered(x);
            let light = 0.01 + c * seen(false) + (1.0 - c) * rest;
            [1.0, 0.9, 0.8].map(|channel: f64| (channel * light * (1.0 - 0.001 * x as f64)) as f32)
        })
    }

    #[test]
    fn soft_edges_of_glass_and_of_matt_bodies() {
        let plane = Plane::new(64, 32).unwrap();
        for kinds in [vec![Kind::Stripes(None)], vec![Kind::Stripes(None), Kind::GrayCode]] {
            let sets: Vec<PatternSet> = kinds.iter().map(|kind| PatternSet::new(*kind, plane).unwrap()).collect();
            let patterns: Vec<_> = sets.iter().flat_map(|set| (0..set.len()).map(|n| set.pattern(n))).collect();
            let mut shown: Vec<Shown> = patterns.iter().map(Shown::of).collect();
            shown.extend([Shown::White, Shown::Black]);
            let mut picture = |n: usize| {
                Ok(match patterns.get(n) {
                    Some(pattern) => photograph(&pattern.values),
                    None => photograph(&vec![if n == patterns.len() { 1.0 } else { 0.0 }; 64 * 32]),
                })
            };
            let area = Area { from: [0.0; 2], to: [SIZE.0 as f64, SIZE.1 as f64] };
            let homography = [[1.0 / SIZE.0 as f64, 0.0, 0.0], [0.0, 1.0 / SIZE.1 as f64, 0.0], [0.0, 0.0, 1.0]];
            let correspondence = Correspondence::new(homography, area, None).unwrap();
            let found = from_stripes(&shown, &mut picture, &correspondence).unwrap();
            assert_eq!((found.size, found.width_px), (SIZE, 1.0));
            let mut off: Vec<f64> =
                (0..SIZE.0 * SIZE.1).map(|n| (f64::from(found.alpha[n]) - (1.0 - covered(n % SIZE.0))).abs()).collect();
            off.sort_unstable_by(f64::total_cmp);
            let at = |share: f64| off[(share * (off.len() - 1) as f64) as usize];
            // A tenth of the pixels are soft edges; where all stripes that glass shows chance to agree, these are off.
            assert!(at(0.5) < 1e-3 && at(0.9) < 0.02 && at(0.99) < 0.25, "{} {} {}", at(0.5), at(0.9), at(0.99));
            super::super::check(&found.alpha, SIZE, "alpha").unwrap();
            let bare = found.bare.at([80.5, 30.5]);
            // Where it was last seen, at column 30, it was 0.97.
            assert!((bare[0] - 0.97).abs() < 0.02, "{bare:?}");
        }
    }

    #[test]
    fn a_screen_that_is_not_seen_is_said() {
        let set = PatternSet::new(Kind::Stripes(None), Plane::new(64, 32).unwrap()).unwrap();
        let shown: Vec<Shown> = (0..set.len()).map(|n| Shown::of(&set.pattern(n))).collect();
        let area = Area { from: [0.0; 2], to: [SIZE.0 as f64, SIZE.1 as f64] };
        let homography = [[1.0 / SIZE.0 as f64, 0.0, 0.0], [0.0, 1.0 / SIZE.1 as f64, 0.0], [0.0, 0.0, 1.0]];
        let correspondence = Correspondence::new(homography, area, None).unwrap();
        // A matt body that fills the picture and has the first pattern's left half before it.
        let matt = |n: usize| Image::from_fn(SIZE.0, SIZE.1, |_, _| [if n == 0 { 1.0 } else { 0.5 }; 3]);
        let message = from_stripes(&shown, &mut |n| Ok(matt(n)), &correspondence).err().unwrap().to_string();
        assert!(message.contains("sees the screen directly"), "{message}");
    }
}
