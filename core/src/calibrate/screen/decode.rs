//! From photographs of binary patterns to the place of the screen that each pixel sees, directly, in a mirror or through glass.
//!
//! A bit is lit where `I > I'`, I' the photograph of the inverse; without one, where I is above the middle of white and
//! black. White and black are the photographs of these, if there are any, and else the brightest and the darkest that the
//! pixel was. The contrast `|I - I'| / (white - black)` tells how sure a bit is: patterns that are finer than the picture
//! resolves are left out, with all finer ones, and a pixel with many weak bits is not trusted: it sees the screen blurred.

use std::collections::HashSet;

use super::shown::{Along, Shown};
use super::tree::Tree;
use crate::error::{Error, Result};
use crate::image::Image;

/// A pixel sees the screen that is brighter by this share of what one pixel in a hundred is brighter by.
const LEAST_LIGHT: f32 = 0.03;
/// A pattern whose median contrast is less than that is not resolved. Halfway between stripes resolved and lost.
const RESOLVED: f32 = 0.25;
/// A bit of less contrast is weak: near the edge of a stripe, or blurred.
const WEAK: f32 = 0.2;
/// Weak bits that a pixel may have in each direction before a clear one: a place on the edge of one stripe of a Gray code is in
/// the middle of the others.
const MOST_WEAK: u8 = 1;
/// And after the last clear one, blurred by glass: the place is known to four times what the picture resolves.
const MOST_LOST: usize = 2;
/// Of white - black, what bits of a trusted pixel have on average.
const TRUSTED: f32 = 0.5;

/// Where one pixel looks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Place {
    /// Columns from the left and rows from the top: the middle of the texels that it could be.
    pub texel: [f32; 2],
    /// How sure its bits are: their mean contrast, 0 to 1.
    pub contrast: f32,
}

/// Where pixels look.
#[derive(Debug, Clone)]
pub struct Decoded {
    /// Columns and rows of the picture.
    pub size: (usize, usize),
    /// Columns and rows of the patterns.
    pub texels: (usize, usize),
    /// Of each pixel, row by row; none where it does not see the screen clearly.
    pub places: Vec<Option<Place>>,
    /// The photograph of white less that of black, RGB.
    pub light: Image,
    /// Texels that the finest patterns which are resolved leave together, across and down.
    pub resolution: [usize; 2],
    /// Numbers of the patterns that were too fine to tell anything.
    pub unresolved: Vec<usize>,
}

impl Decoded {
    /// The place of a pixel in shares of the screen.
    pub fn screen(&self, x: usize, y: usize) -> Option<[f64; 2]> {
        let place = self.places[y * self.size.0 + x]?;
        let [u, v] = place.texel.map(f64::from);
        Some([u / self.texels.0 as f64, v / self.texels.1 as f64])
    }
}

/// One bit: which pattern, and which is its inverse.
#[derive(Debug, Clone)]
struct Bit<'a> {
    number: usize,
    inverse: Option<usize>,
    lit: &'a [bool],
}

/// Finds where each pixel looks. `shown[n]` is what `picture(n)` photographs, as light (any unit, black need not be taken off);
/// each picture is asked for once, or twice if there is none of white.
///
/// # Errors
/// Patterns that do not tell columns and rows; pictures of different sizes; no pixel that sees the patterns; what `picture`
/// returns.
pub fn decode(shown: &[Shown], picture: &mut dyn FnMut(usize) -> Result<Image>) -> Result<Decoded> {
    let bits = [bits(shown, Along::Columns)?, bits(shown, Along::Rows)?];
    let texels = [bits[0][0].lit.len(), bits[1][0].lit.len()];
    let range = Range::new(shown, &bits, picture)?;
    let pixels = range.width * range.height;
    let mut axes = Vec::with_capacity(2);
    for bits in &bits {
        axes.push(Axis::read(bits, &range, picture)?);
    }
    let trees = [0, 1].map(|n| {
        let kept: Vec<&[bool]> = bits[n][..axes[n].resolved].iter().map(|bit| bit.lit).collect();
        Tree::new(&kept, texels[n])
    });
    let [across, down] = trees;
    let (across, down) = (across?, down?);
    let place = |pixel: usize| -> Option<Place> {
        let contrast = 0.5 * (axes[0].contrast(pixel)? + axes[1].contrast(pixel)?);
        let middle = |tree: &Tree, axis: &Axis| {
            let run = tree.find(|bit| axis.bit(pixel, bit));
            0.5 * (run.start + run.end) as f32
        };
        (range.sees(pixel) && contrast >= TRUSTED)
            .then(|| Place { texel: [middle(&across, &axes[0]), middle(&down, &axes[1])], contrast })
    };
    let places: Vec<Option<Place>> = (0..pixels).map(place).collect();
    if places.iter().all(Option::is_none) {
        return Err(Error::invalid(
            "the photographs of the patterns",
            "no pixel that tells a place of the screen",
            "a screen that the camera sees, sharp enough for its stripes, and photographs in the order of the patterns",
        ));
    }
    let unresolved = bits.iter().zip(&axes).flat_map(|(bits, axis)| &bits[axis.resolved..]);
    Ok(Decoded {
        size: (range.width, range.height),
        texels: (texels[0], texels[1]),
        places,
        unresolved: unresolved.flat_map(|bit| [Some(bit.number), bit.inverse]).flatten().collect(),
        resolution: [across.widest(), down.widest()],
        light: range.light,
    })
}

/// A pattern of columns or rows as it was seen.
#[derive(Debug)]
pub struct Line<'a> {
    /// What it changes along.
    pub along: Along,
    /// Of each column or row, whether it is lit.
    pub lit: &'a [bool],
    /// Photograph less that of the inverse, as shares of white less black, -1 to 1 but for noise; 0 where the pixel sees no
    /// light. Row by row, the mean of the channels.
    pub contrast: &'a [f32],
}

/// Goes through all patterns of columns, coarse to fine, then of rows, as [`decode`] sees them; gives white less black, RGB.
/// `each` is also told that.
///
/// # Errors
/// As [`decode`].
pub fn lines(
    shown: &[Shown],
    picture: &mut dyn FnMut(usize) -> Result<Image>,
    each: &mut dyn FnMut(&Image, Line<'_>) -> Result<()>,
) -> Result<Image> {
    let bits = [bits(shown, Along::Columns)?, bits(shown, Along::Rows)?];
    let range = Range::new(shown, &bits, picture)?;
    for (along, bits) in [Along::Columns, Along::Rows].into_iter().zip(&bits) {
        for bit in bits {
            let contrast = range.contrast(bit, picture)?;
            each(&range.light, Line { along, lit: bit.lit, contrast: &contrast })?;
        }
    }
    Ok(range.light)
}

/// The bits of a direction, coarse to fine, each with its inverse if that was shown.
fn bits(shown: &[Shown], direction: Along) -> Result<Vec<Bit<'_>>> {
    let lines = shown.iter().enumerate().filter_map(|(number, shown)| match shown {
        Shown::Stripes { along, lit } if *along == direction => Some((number, lit.as_slice())),
        _ => None,
    });
    let lines: Vec<(usize, &[bool])> = lines.collect();
    let inverse_of = |a: &[bool], b: &[bool]| a.len() == b.len() && a.iter().zip(b).all(|(a, b)| a != b);
    let (mut bits, mut used, mut known) = (Vec::<Bit>::new(), HashSet::new(), HashSet::new());
    for (n, (number, lit)) in lines.iter().enumerate() {
        // A pattern that comes again (two stripes are the first bit of a code) tells nothing new.
        if used.contains(number) || known.contains(lit) {
            continue;
        }
        let inverse = lines[n + 1..].iter().find(|(other, b)| !used.contains(other) && inverse_of(lit, b));
        known.insert(lit);
        if let Some((other, b)) = inverse {
            used.insert(*other);
            known.insert(b);
        }
        bits.push(Bit { number: *number, inverse: inverse.map(|(other, _)| *other), lit });
    }
    bits.sort_by_key(|bit| bit.lit.windows(2).filter(|pair| pair[0] != pair[1]).count());
    let what = if direction == Along::Columns { "columns" } else { "rows" };
    let found =
        |found: &str| Err(Error::invalid("the patterns", found, format!("black-and-white codes of the {what}")));
    match bits.first() {
        None => found(&format!("none that tells {what} apart")),
        Some(first) if bits.iter().any(|bit| bit.lit.len() != first.lit.len()) => found("patterns of several sizes"),
        Some(_) if bits.len() > 32 => found("more than 32 codes"),
        Some(_) => Ok(bits),
    }
}

/// How bright each pixel can be.
struct Range {
    width: usize,
    height: usize,
    /// White less black, RGB.
    light: Image,
    /// Of the grey pictures.
    black: Vec<f32>,
    range: Vec<f32>,
    least: f32,
}

impl Range {
    fn new(shown: &[Shown], bits: &[Vec<Bit<'_>>; 2], picture: &mut dyn FnMut(usize) -> Result<Image>) -> Result<Self> {
        let find = |wanted: &Shown| shown.iter().position(|s| s == wanted);
        let white = find(&Shown::White).map(&mut *picture).transpose()?;
        let black = find(&Shown::Black).map(&mut *picture).transpose()?;
        let (white, black) = match (white, black) {
            (Some(white), Some(black)) => (white.into_rgb(), black.into_rgb()),
            (white, black) => {
                let (brightest, darkest) = extremes(bits, picture)?;
                (white.map_or(brightest, Image::into_rgb), black.map_or(darkest, Image::into_rgb))
            }
        };
        check_size(&white, &black)?;
        let mut light = white;
        light.data_mut().iter_mut().zip(black.data()).for_each(|(w, b)| *w -= b);
        let range = grey(&light);
        let mut sorted = range.clone();
        let bright = sorted.len() - 1 - sorted.len() / 100;
        let (_, bright, _) = sorted.select_nth_unstable_by(bright, f32::total_cmp);
        let least = (LEAST_LIGHT * *bright).max(f32::MIN_POSITIVE);
        let (width, height) = light.size();
        Ok(Self { width, height, light, black: grey(&black), range, least })
    }

    fn sees(&self, pixel: usize) -> bool {
        self.range[pixel] >= self.least
    }

    /// See [`Line::contrast`].
    fn contrast(&self, bit: &Bit<'_>, picture: &mut dyn FnMut(usize) -> Result<Image>) -> Result<Vec<f32>> {
        let mut pictured = |number: usize| -> Result<Vec<f32>> {
            let picture = picture(number)?.into_rgb();
            check_size(&self.light, &picture)?;
            Ok(grey(&picture))
        };
        let lit = pictured(bit.number)?;
        let dark = bit.inverse.map(pictured).transpose()?;
        let contrast = |pixel: usize| {
            let difference = match &dark {
                Some(dark) => lit[pixel] - dark[pixel],
                None => 2.0 * (lit[pixel] - self.black[pixel]) - self.range[pixel],
            };
            if self.sees(pixel) { (difference / self.range[pixel]).clamp(-2.0, 2.0) } else { 0.0 }
        };
        Ok((0..lit.len()).map(contrast).collect())
    }
}

/// The brightest and the darkest that each pixel was under the patterns.
fn extremes(bits: &[Vec<Bit<'_>>; 2], picture: &mut dyn FnMut(usize) -> Result<Image>) -> Result<(Image, Image)> {
    let mut found: Option<(Image, Image)> = None;
    for number in bits.iter().flatten().flat_map(|bit| [Some(bit.number), bit.inverse]).flatten() {
        let picture = picture(number)?.into_rgb();
        let (high, low) = found.get_or_insert_with(|| (picture.clone(), picture.clone()));
        check_size(high, &picture)?;
        high.data_mut().iter_mut().zip(picture.data()).for_each(|(h, v)| *h = h.max(*v));
        low.data_mut().iter_mut().zip(picture.data()).for_each(|(l, v)| *l = l.min(*v));
    }
    found.ok_or_else(|| Error::invalid("the patterns", "none", "codes of columns and rows"))
}

/// The bits of all pixels in one direction.
struct Axis {
    words: Vec<u32>,
    /// Of each pixel: how many bits there are up to its last clear one, how many of these are weak, and the sum of their
    /// contrasts.
    depths: Vec<u8>,
    weak: Vec<u8>,
    sums: Vec<f32>,
    /// The sum since the last clear one.
    pending: Vec<f32>,
    resolved: usize,
}

impl Axis {
    fn read(bits: &[Bit<'_>], range: &Range, picture: &mut dyn FnMut(usize) -> Result<Image>) -> Result<Self> {
        let pixels = range.width * range.height;
        let (none, zero) = (vec![0; pixels], vec![0.0; pixels]);
        let mut axis = Self {
            words: vec![0; pixels],
            depths: none.clone(),
            weak: none,
            sums: zero.clone(),
            pending: zero,
            resolved: 0,
        };
        for (n, bit) in bits.iter().enumerate() {
            let contrasts = range.contrast(bit, picture)?;
            if !axis.resolves(&contrasts) {
                break;
            }
            axis.add(n, &contrasts);
        }
        Ok(axis)
    }

    fn add(&mut self, n: usize, contrasts: &[f32]) {
        for (pixel, contrast) in contrasts.iter().enumerate() {
            self.words[pixel] |= u32::from(*contrast > 0.0) << n;
            self.pending[pixel] += contrast.abs().min(1.0);
            if contrast.abs() >= WEAK {
                self.weak[pixel] += n as u8 - self.depths[pixel];
                self.depths[pixel] = n as u8 + 1;
                self.sums[pixel] += std::mem::take(&mut self.pending[pixel]);
            }
        }
        self.resolved = n + 1;
    }

    /// Whether the next bit tells something where the coarser ones did: matt bodies show no stripes, however wide.
    fn resolves(&self, contrasts: &[f32]) -> bool {
        let clear = |pixel: usize| match self.resolved {
            0 => contrasts[pixel].abs() >= TRUSTED,
            n => self.sums[pixel] >= TRUSTED * n as f32 && self.weak[pixel] <= MOST_WEAK,
        };
        let mut seen: Vec<f32> = (0..contrasts.len()).filter(|p| clear(*p)).map(|p| contrasts[p].abs()).collect();
        let middle = seen.len() / 2;
        !seen.is_empty() && *seen.select_nth_unstable_by(middle, f32::total_cmp).1 >= RESOLVED
    }

    /// The mean contrast of a pixel up to its last clear bit, if few are weak.
    fn contrast(&self, pixel: usize) -> Option<f32> {
        let depth = usize::from(self.depths[pixel]);
        let trusted = depth > 0 && self.weak[pixel] <= MOST_WEAK && self.resolved - depth <= MOST_LOST;
        trusted.then(|| self.sums[pixel] / depth as f32)
    }

    /// Whether a bit is lit; none that comes after the last clear one.
    fn bit(&self, pixel: usize, bit: usize) -> Option<bool> {
        (bit < usize::from(self.depths[pixel])).then(|| self.words[pixel] >> bit & 1 == 1)
    }
}

fn grey(picture: &Image) -> Vec<f32> {
    picture.data().chunks_exact(picture.channels()).map(|p| (p[0] + p[1] + p[2]) / 3.0).collect()
}

fn check_size(a: &Image, b: &Image) -> Result<()> {
    if a.size() == b.size() {
        return Ok(());
    }
    let found = format!("one of {} x {} pixels", b.width(), b.height());
    let expected = format!("all of {} x {}", a.width(), a.height());
    Err(Error::invalid("the photographs of the patterns", found, expected))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::domain::Plane;
    use crate::domain::patterns::{Kind, Pattern, PatternSet};

    /// A camera of 40 x 30 pixels that sees texel (x / 2 + 3, y / 3), half as bright on the right.
    fn photographed(pattern: &Pattern, inverted: bool) -> Image {
        Image::from_fn(40, 30, |x, y| {
            let light = pattern.values[y / 3 * pattern.columns + x / 2 + 3];
            let gain = if x < 20 { 1.0 } else { 0.5 };
            [0.02 + gain * if inverted { 1.0 - light } else { light }; 3]
        })
    }

    fn codes() -> PatternSet {
        PatternSet::new(Kind::GrayCode, Plane::new(32, 16).unwrap()).unwrap()
    }

    fn check(shown: &[Shown], pictures: &[Image]) {
        let decoded = decode(shown, &mut |n| Ok(pictures[n].clone())).unwrap();
        assert_eq!((decoded.texels, decoded.resolution), ((32, 16), [1, 1]));
        for y in 0..30 {
            for x in 0..40 {
                let place = decoded.places[y * 40 + x].unwrap();
                assert_eq!(place.texel, [(x / 2) as f32 + 3.5, (y / 3) as f32 + 0.5]);
                assert!(place.contrast > 0.99);
            }
        }
        assert!((decoded.light.pixel(30, 5)[1] - 0.5).abs() < 1e-6);
    }

    #[test]
    fn places_with_inverses_and_without_in_any_order() {
        let set = codes();
        let order: Vec<usize> = (0..set.len()).rev().collect();
        let all: Vec<Shown> = order.iter().map(|n| Shown::of(&set.pattern(*n))).collect();
        let pictures: Vec<Image> = order.iter().map(|n| photographed(&set.pattern(*n), false)).collect();
        check(&all, &pictures);
        let (alone, theirs): (Vec<Shown>, Vec<Image>) = all.into_iter().zip(pictures).step_by(2).unzip();
        check(&alone, &theirs);
        let white = |light: f32| photographed(&Pattern { columns: 32, rows: 16, values: vec![light; 512] }, false);
        let shown = [vec![Shown::White, Shown::Black], alone].concat();
        check(&shown, &[vec![white(1.0), white(0.0)], theirs].concat());
    }

    #[test]
    fn stripes_tell_places_too() {
        let set = PatternSet::new(Kind::Stripes(None), Plane::new(32, 16).unwrap()).unwrap();
        let shown: Vec<Shown> = (0..set.len()).map(|n| Shown::of(&set.pattern(n))).collect();
        let pictures: Vec<Image> = (0..set.len()).map(|n| photographed(&set.pattern(n), false)).collect();
        check(&shown, &pictures);
    }

    #[test]
    fn what_is_blurred_or_dark_has_no_place_and_lost_bits_widen() {
        let set = codes();
        let shown: Vec<Shown> = (0..set.len()).map(|n| Shown::of(&set.pattern(n))).collect();
        // The finest bit of the columns, patterns 8 and 9, is grey everywhere; a corner is dark, another grey in all.
        let picture = |n: usize| {
            let mut picture = photographed(&set.pattern(n), false);
            if n == 8 || n == 9 {
                picture.data_mut().fill(0.27);
            }
            let even = if n == 0 || n == 1 { None } else { Some([0.52; 3]) };
            for y in 0..6 {
                for x in 0..6 {
                    let at = 3 * (y * 40 + x);
                    picture.data_mut()[at..at + 3].fill(0.02);
                    let at = 3 * (y * 40 + x + 20);
                    if let Some(even) = even {
                        picture.data_mut()[at..at + 3].copy_from_slice(&even);
                    }
                }
            }
            picture
        };
        let decoded = decode(&shown, &mut |n| Ok(picture(n))).unwrap();
        assert_eq!((decoded.resolution, decoded.unresolved.as_slice()), ([2, 1], [8, 9].as_slice()));
        for (x, y) in [(0, 0), (5, 5), (20, 0), (25, 5)] {
            assert_eq!(decoded.places[y * 40 + x], None, "{x} {y}");
        }
        let place = decoded.places[20 * 40 + 10].unwrap();
        assert!((place.texel[0] - 8.5).abs() <= 0.5 && place.texel[1] == 6.5, "{place:?}");
    }

    #[test]
    fn what_cannot_be_decoded_is_said() {
        let set = codes();
        let shown: Vec<Shown> = (0..set.len()).map(|n| Shown::of(&set.pattern(n))).collect();
        let refused = |shown: &[Shown], picture: &mut dyn FnMut(usize) -> Result<Image>, words: &str| {
            let message = decode(shown, picture).unwrap_err().to_string();
            assert!(message.contains(words), "{message}");
        };
        refused(&shown[..10], &mut |_| Ok(Image::new(4, 4, 3)), "none that tells rows");
        refused(&shown, &mut |_| Ok(Image::new(4, 4, 3)), "no pixel");
        refused(&shown, &mut |n| Ok(Image::new(4 + n, 4, 3)), "pixels");
    }
}
