//! From codes to a field of clear glass: one place of the screen a pixel, and what is left of its light (6.3; as the
//! environment matte of a purely refractive object, Zongker et al. 1999 with a point for an area).
//!
//! A pixel that sees the screen at texel (u, v) with share a of its light has `T = a` there and nothing elsewhere. Places are
//! rounded to texels and now and then wrong; so each pixel takes the place among its neighbours' that lies nearest to all of
//! theirs, and its light is spread over it and those of its neighbours near it, as what a pixel sees is an area.

use crate::calibrate::screen::Decoded;
use crate::domain::Correspondence;
use crate::error::{Error, Result};
use crate::field::{BLOCK_HEIGHT, BLOCK_PIXELS, BLOCK_WIDTH, BlockTerms, TermBands};
use crate::image::Window;
use crate::matte::alpha::Alpha;

/// Neighbours that must have places, a pixel among them, for it to have one.
const FEWEST: usize = 4;
/// Texels, of what the codes resolve, from a pixel's place to those of neighbours that are the same area: farther apart lies
/// an edge of the glass.
const NEAR: f32 = 6.0;
/// A pixel without one takes that of the nearest neighbours that have, so many pixels away at most: the rim of a glass, whose light
/// is little.
const REACH: usize = 6;
/// Pixels from the rim of the patterns within which their light is not that of their inside.
const RIM: f64 = 2.0;
/// Shares of a pixel and its neighbours, by rows and columns apart: the binomial filter.
const SHARES: [f32; 2] = [2.0, 1.0];

/// A field of one place a pixel.
#[derive(Debug, Clone)]
pub struct Refraction {
    /// The part of the photographs that it shows.
    pub window: Window,
    /// Coverage, row by row: 0 where the screen is seen directly, and beyond what the patterns filled.
    pub alpha: Vec<f32>,
    /// Where its pixels look past the object.
    pub correspondence: Correspondence,
    /// Pixels of the object that have no place, nor any near them: they stay black.
    pub lost: usize,
    /// The largest share of the light.
    pub largest: f32,
    columns: usize,
    rows: usize,
    /// Of each pixel, texels with shares that sum to one, and the light.
    pixels: Vec<Option<Pixel>>,
}

#[derive(Debug, Clone)]
struct Pixel {
    texels: Vec<(u32, f32)>,
    light: [f32; 3],
}

impl Refraction {
    /// From places and coverage of the same photographs, cropped to where the patterns are seen.
    ///
    /// # Errors
    /// A screen that is seen nowhere in the picture.
    pub fn new(decoded: &Decoded, alpha: &Alpha, correspondence: &Correspondence) -> Result<Self> {
        let window = outline(correspondence, decoded.size)?;
        let (columns, rows) = decoded.texels;
        let crop = correspondence.of_crop([window.x0 as f64, window.y0 as f64]);
        let mut field = Self {
            window,
            alpha: Vec::new(),
            correspondence: crop,
            lost: 0,
            largest: 1.0,
            columns,
            rows,
            pixels: Vec::new(),
        };
        let around = Neighbours { decoded, near: NEAR * decoded.resolution[0].max(decoded.resolution[1]) as f32 };
        for y in window.y0..window.y1 {
            for x in window.x0..window.x1 {
                let at = [x as f64 + 0.5, y as f64 + 0.5];
                let places = around.of(x, y);
                // Beyond the patterns, and at their rim, only what shows another place of them is known to be glass.
                let inside = |dx: f64, dy: f64| {
                    let seen = correspondence.screen_of([at[0] + dx, at[1] + dy]);
                    seen.iter().all(|s| (0.0..=1.0).contains(s))
                };
                let well_inside = [(-RIM, -RIM), (RIM, -RIM), (-RIM, RIM), (RIM, RIM)].iter().all(|d| inside(d.0, d.1));
                let [u, v] = correspondence.screen_of(at);
                let straight = [u * columns as f64, v * rows as f64].map(|at| at as f32);
                let bent = |places: &Vec<([f32; 2], f32)>| {
                    places.iter().any(|(place, _)| (0..2).any(|i| (place[i] - straight[i]).abs() > around.near))
                };
                let known = well_inside || places.as_ref().is_some_and(bent);
                let covered = if known { alpha.alpha[y * decoded.size.0 + x] } else { 0.0 };
                let places = places.or_else(|| around.nearest(x, y));
                let bare = alpha.bare.at(at);
                let seen = alpha.light.pixel(x, y);
                let light = [0, 1, 2].map(|c| (seen[c] / bare[c].max(f32::MIN_POSITIVE) - (1.0 - covered)).max(0.0));
                let pixel = places.filter(|_| covered > 0.0);
                field.lost += usize::from(covered > 0.5 && pixel.is_none());
                let pixel = pixel.map(|places| Pixel { texels: field.spread(&places), light });
                field.largest = light.into_iter().filter(|_| pixel.is_some()).fold(field.largest, f32::max);
                field.alpha.push(covered);
                field.pixels.push(pixel);
            }
        }
        Ok(field)
    }

    /// Columns and rows of its pictures.
    pub fn size(&self) -> (usize, usize) {
        (self.window.width(), self.window.height())
    }

    /// Places with shares as texels, linear between their centres.
    fn spread(&self, places: &[([f32; 2], f32)]) -> Vec<(u32, f32)> {
        let mut texels: Vec<(u32, f32)> = Vec::new();
        let along = |at: f32, side: usize| {
            let at = (at - 0.5).clamp(0.0, (side - 1) as f32);
            let low = at as usize;
            [(low, 1.0 - at.fract()), ((low + 1).min(side - 1), at.fract())]
        };
        for ([u, v], share) in places {
            for (column, s) in along(*u, self.columns) {
                for (row, t) in along(*v, self.rows) {
                    let (texel, share) = ((row * self.columns + column) as u32, share * s * t);
                    match texels.iter_mut().find(|(known, _)| *known == texel) {
                        _ if share <= 0.0 => {}
                        Some((_, sum)) => *sum += share,
                        None => texels.push((texel, share)),
                    }
                }
            }
        }
        texels.sort_unstable_by_key(|(texel, _)| *texel);
        texels
    }
}

impl TermBands for &Refraction {
    fn fill(&mut self, bx: usize, by: usize, block: &mut BlockTerms) -> Result<()> {
        let (width, height) = self.size();
        for k in 0..BLOCK_PIXELS {
            let (x, y) = (bx * BLOCK_WIDTH + k % BLOCK_WIDTH, by * BLOCK_HEIGHT + k / BLOCK_WIDTH);
            if x >= width || y >= height {
                continue;
            }
            let Some(pixel) = &self.pixels[y * width + x] else { continue };
            block.counts[k] = pixel.texels.len() as u32;
            for (texel, share) in &pixel.texels {
                block.locations.push(*texel);
                block.coefficients.push(pixel.light.map(|light| light * share));
            }
        }
        Ok(())
    }
}

/// The rectangle of the picture about the screen's corners.
fn outline(correspondence: &Correspondence, size: (usize, usize)) -> Result<Window> {
    let corners = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]].map(|corner| correspondence.pixel_of(corner));
    let side = |i: usize, side: usize| {
        let all = corners.iter().map(|corner| corner.map(|pixel| pixel[i]));
        let least = all.clone().map(|at| at.unwrap_or(0.0)).fold(f64::INFINITY, f64::min);
        let most = all.map(|at| at.unwrap_or(side as f64)).fold(f64::NEG_INFINITY, f64::max);
        (least.floor().clamp(0.0, side as f64) as usize, most.ceil().clamp(0.0, side as f64) as usize)
    };
    let ((x0, x1), (y0, y1)) = (side(0, size.0), side(1, size.1));
    let window = Window { x0, y0, x1, y1 };
    if window.is_empty() {
        let expected = "a correspondence that has it in the picture";
        return Err(Error::invalid("the screen", "outside of the picture", expected));
    }
    Ok(window)
}

/// Places about a pixel.
struct Neighbours<'a> {
    decoded: &'a Decoded,
    near: f32,
}

impl Neighbours<'_> {
    /// The area of the nearest pixel that has one, of several the first.
    fn nearest(&self, x: usize, y: usize) -> Option<Vec<([f32; 2], f32)>> {
        let (width, height) = self.decoded.size;
        let rows = y.saturating_sub(REACH)..(y + REACH + 1).min(height);
        let columns = x.saturating_sub(REACH)..(x + REACH + 1).min(width);
        let known = rows.flat_map(|row| columns.clone().map(move |column| (column, row)));
        let known = known.filter(|(column, row)| self.decoded.places[row * width + column].is_some());
        let mut by_distance: Vec<(usize, usize, usize)> =
            known.map(|(column, row)| (x.abs_diff(column).pow(2) + y.abs_diff(row).pow(2), column, row)).collect();
        by_distance.sort_unstable();
        by_distance.into_iter().find_map(|(_, column, row)| self.of(column, row))
    }

    /// The places that make the area of a pixel, in texels, with shares that sum to one.
    fn of(&self, x: usize, y: usize) -> Option<Vec<([f32; 2], f32)>> {
        let (width, height) = self.decoded.size;
        let mut known: Vec<([f32; 2], f32)> = Vec::with_capacity(9);
        for row in y.saturating_sub(1)..(y + 2).min(height) {
            for column in x.saturating_sub(1)..(x + 2).min(width) {
                if let Some(place) = self.decoded.places[row * width + column] {
                    known.push((place.texel, SHARES[x.abs_diff(column)] * SHARES[y.abs_diff(row)]));
                }
            }
        }
        let apart = |a: [f32; 2], b: [f32; 2]| (a[0] - b[0]).hypot(a[1] - b[1]);
        let far = |from: [f32; 2]| known.iter().map(|(place, share)| share * apart(*place, from)).sum::<f32>();
        let middle = known.iter().map(|(place, _)| *place).min_by(|a, b| far(*a).total_cmp(&far(*b)))?;
        if known.len() < FEWEST {
            return None;
        }
        known.retain(|(place, _)| apart(*place, middle) <= self.near);
        let sum: f32 = known.iter().map(|(_, share)| share).sum();
        known.iter_mut().for_each(|(_, share)| *share /= sum);
        Some(known)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibrate::screen::{Along, Shown};
    use crate::domain::patterns::{Kind, PatternSet};
    use crate::domain::{Area, Plane};
    use crate::image::Image;
    use crate::matte::alpha::from_stripes;

    const SIZE: (usize, usize) = (80, 60);
    const TEXELS: (usize, usize) = (64, 32);

    /// Where a pixel looks: a lens in the middle turns the screen, which fills 64 x 32 of the 80 x 60 pixels.
    fn look(x: usize, y: usize) -> Option<(usize, usize, f32)> {
        let (u, v) = (x.checked_sub(8)?, y.checked_sub(14)?);
        let inside = u < TEXELS.0 && v < TEXELS.1;
        let lens = (20..44).contains(&u) && (8..24).contains(&v);
        inside.then(|| if lens { (70 - u, 30 - v, 0.5) } else { (u, v, 1.0) })
    }

    fn photograph(light: &[f32]) -> Image {
        Image::from_fn(SIZE.0, SIZE.1, |x, y| {
            let seen = look(x, y).map_or(0.0, |(u, v, share)| share * light[v * TEXELS.0 + u]);
            [0.01 + seen, 0.01 + 0.8 * seen, 0.01 + 0.5 * seen]
        })
    }

    #[test]
    fn a_lens_shows_what_it_showed() {
        let plane = Plane::new(TEXELS.0, TEXELS.1).unwrap();
        let set = PatternSet::new(Kind::GrayCode, plane).unwrap();
        let mut shown: Vec<Shown> = (0..set.len()).map(|n| Shown::of(&set.pattern(n))).collect();
        assert!(matches!(shown[0], Shown::Stripes { along: Along::Columns, .. }));
        shown.extend([Shown::White, Shown::Black]);
        let mut picture = |n: usize| -> Result<Image> {
            Ok(match n.checked_sub(set.len()) {
                None => photograph(&set.pattern(n).values),
                Some(n) => photograph(&vec![if n == 0 { 1.0 } else { 0.0 }; plane.len()]),
            })
        };
        let decoded = crate::calibrate::screen::decode(&shown, &mut picture).unwrap();
        let homography = [[1.0 / 64.0, 0.0, -8.0 / 64.0], [0.0, 1.0 / 32.0, -14.0 / 32.0], [0.0, 0.0, 1.0]];
        let area = Area { from: [8.0, 14.0], to: [72.0, 46.0] };
        let correspondence = Correspondence::new(homography, area, None).unwrap();
        let alpha = from_stripes(&shown, &mut picture, &correspondence).unwrap();
        let field = Refraction::new(&decoded, &alpha, &correspondence).unwrap();
        assert_eq!((field.window, field.lost), (Window { x0: 8, y0: 14, x1: 72, y1: 46 }, 0));
        let texel = [0.5 / 64.0, 0.5 / 32.0];
        let seen = field.correspondence.screen_of([0.5, 0.5]);
        assert!((seen[0] - texel[0]).abs() < 1e-12 && (seen[1] - texel[1]).abs() < 1e-12);
        let (mut lens, mut kept) = (0, 0);
        for v in 1..31 {
            for u in 1..63 {
                let (column, row, share) = look(u + 8, v + 14).unwrap();
                let pixel = &field.pixels[v * 64 + u];
                if share == 1.0 {
                    assert!(pixel.is_none() && field.alpha[v * 64 + u] == 0.0, "{u} {v}");
                    continue;
                }
                let pixel = pixel.as_ref().unwrap();
                // Where the lens shows what is right behind it, it passes for the screen, only darker.
                lens += 1;
                kept += usize::from(pixel.light.iter().all(|light| (light - 0.5).abs() < 0.02));
                let sum: f32 = pixel.texels.iter().map(|(_, share)| share).sum();
                assert!((sum - 1.0).abs() < 1e-5);
                // The middle of what it sees, off the edge of the lens.
                if (21..43).contains(&u) && (9..23).contains(&v) {
                    let mean = |of: &dyn Fn(u32) -> f32| pixel.texels.iter().map(|(t, s)| s * of(*t)).sum::<f32>();
                    let at = [mean(&|t| (t % 64) as f32), mean(&|t| (t / 64) as f32)];
                    assert!((at[0] - column as f32).abs() < 1e-3 && (at[1] - row as f32).abs() < 1e-3, "{at:?}");
                }
            }
        }
        assert!(lens == 24 * 16 && kept > lens * 9 / 10, "{kept} of {lens}");
    }
}
