//! From a plate to the light of the screen's texels.

use rayon::prelude::*;

use super::place::{Mapping, Place};
use crate::domain::{Correspondence, Plane};
use crate::error::Result;
use crate::illumination::EnvMap;
use crate::image::Image;
use crate::math::Vec3;

/// A texel is looked at in so many places across and down, at most; the plate is averaged down so that these lie a pixel of
/// it apart.
const MOST_ACROSS: usize = 8;

/// The light of texels that the plate does not reach.
#[derive(Debug, Clone, Copy)]
pub enum Beyond<'a> {
    /// The plate's edge goes on.
    Stretch,
    /// A colour, RGB.
    Colour([f32; 3]),
    /// A lat-long map that stands around the camera, its -z behind the plate; the plate is as wide as this angle, degrees.
    Map(&'a EnvMap, f64),
}

/// Where each texel of a screen lies in a plate. What depends on the object, its place and the size of the plate, and not on
/// what the plate shows: keep it from frame to frame.
#[derive(Debug, Clone)]
pub struct Backdrop {
    plane: Plane,
    plate: (usize, usize),
    /// The corners of the texels in the plate, pixels: (columns + 1) x (rows + 1); none where nothing corresponds.
    corners: Vec<Option<[f64; 2]>>,
}

impl Backdrop {
    /// The texels of `plane`, seen in pictures of the size `object` through the correspondence (without one, the screen fills
    /// the picture), placed in plates of the size `plate`.
    ///
    /// # Errors
    /// What [`Place::check`] refuses.
    pub fn new(
        (plane, correspondence): (Plane, Option<&Correspondence>),
        object: (usize, usize),
        place: &Place,
        plate: (usize, usize),
    ) -> Result<Self> {
        place.check()?;
        let mapping = place.between(object, plate);
        let (columns, rows) = plane.size();
        let corner = |at: usize| {
            let (column, row) = (at % (columns + 1), at / (columns + 1));
            let on_screen = [column as f64 / columns as f64, row as f64 / rows as f64];
            corner(on_screen, correspondence, object, &mapping)
        };
        let corners = (0..(columns + 1) * (rows + 1)).into_par_iter().map(corner).collect();
        Ok(Self { plane, plate, corners })
    }

    /// The light of each texel: the mean of what the plate shows there, RGB, row 0 at the top. Where the plate shrinks it is
    /// averaged, where it grows it is linear between pixels.
    ///
    /// # Panics
    /// For a plate of another size.
    pub fn light(&self, plate: &Image, beyond: Beyond<'_>) -> Vec<[f32; 3]> {
        assert_eq!(plate.size(), self.plate, "a plate of the size that the backdrop was made for");
        let levels = Levels::new(plate, self.largest_texel());
        let columns = self.plane.columns();
        let texel = |at: usize| self.texel(at % columns, at / columns, &levels, beyond);
        (0..self.plane.len()).into_par_iter().map(texel).collect()
    }

    fn texel(&self, column: usize, row: usize, levels: &Levels<'_>, beyond: Beyond<'_>) -> [f32; 3] {
        let at = |dx: usize, dy: usize| self.corners[(row + dy) * (self.plane.columns() + 1) + column + dx];
        let corners = [at(0, 0), at(1, 0), at(0, 1), at(1, 1)];
        let [Some(a), Some(b), Some(c), Some(d)] = corners else { return nowhere(beyond) };
        let across = size_of([a, b, c, d]);
        let (level, count) = levels.of_texel(across);
        let (mut sum, share) = ([0.0f64; 3], 1.0 / (count * count) as f64);
        for n in 0..count * count {
            let [s, t] = [n % count, n / count].map(|k| (k as f64 + 0.5) / count as f64);
            let place =
                std::array::from_fn(|i| (1.0 - t) * ((1.0 - s) * a[i] + s * b[i]) + t * ((1.0 - s) * c[i] + s * d[i]));
            let rgb = levels.look(level, place, beyond);
            sum.iter_mut().zip(rgb).for_each(|(sum, v)| *sum += share * f64::from(v));
        }
        sum.map(|v| v as f32)
    }

    /// The largest side of a texel, pixels of the plate.
    fn largest_texel(&self) -> f64 {
        let columns = self.plane.columns();
        let corner = |n: usize| self.corners[n];
        let side = |n: usize| {
            let row = n / columns * (columns + 1) + n % columns;
            let [Some(a), Some(b), Some(c), Some(d)] =
                [corner(row), corner(row + 1), corner(row + columns + 1), corner(row + columns + 2)]
            else {
                return 0.0;
            };
            size_of([a, b, c, d])
        };
        (0..self.plane.len()).map(side).fold(0.0, f64::max)
    }
}

/// A place of the screen in the plate.
fn corner(
    on_screen: [f64; 2],
    correspondence: Option<&Correspondence>,
    object: (usize, usize),
    mapping: &Mapping,
) -> Option<[f64; 2]> {
    let pixel = match correspondence {
        Some(correspondence) => correspondence.pixel_of(on_screen)?,
        None => [on_screen[0] * object.0 as f64, on_screen[1] * object.1 as f64],
    };
    Some(mapping.plate(pixel))
}

/// The longest side of a texel.
fn size_of([a, b, c, d]: [[f64; 2]; 4]) -> f64 {
    let side = |p: [f64; 2], q: [f64; 2]| (p[0] - q[0]).hypot(p[1] - q[1]);
    side(a, b).max(side(c, d)).max(side(a, c)).max(side(b, d))
}

/// What a texel sees that has no place in the plate.
fn nowhere(beyond: Beyond<'_>) -> [f32; 3] {
    match beyond {
        Beyond::Colour(rgb) => rgb,
        Beyond::Stretch | Beyond::Map(..) => [0.0; 3],
    }
}

/// The plate and its halves, and halves of these.
struct Levels<'a> {
    plate: &'a Image,
    smaller: Vec<Image>,
}

impl<'a> Levels<'a> {
    /// Down to where a texel of this side is looked at in [`MOST_ACROSS`] places a pixel apart.
    fn new(plate: &'a Image, largest_texel: f64) -> Self {
        let mut smaller: Vec<Image> = Vec::new();
        let mut texel = largest_texel;
        while texel > MOST_ACROSS as f64 {
            let last = smaller.last().unwrap_or(plate);
            if last.width() == 1 && last.height() == 1 {
                break;
            }
            let half = halved(last);
            smaller.push(half);
            texel /= 2.0;
        }
        Self { plate, smaller }
    }

    /// The level for a texel, and the places across.
    fn of_texel(&self, size: f64) -> (usize, usize) {
        let halvings = (size / MOST_ACROSS as f64).log2().ceil().max(0.0) as usize;
        let level = halvings.min(self.smaller.len());
        let across = (size / (1u64 << level) as f64).ceil() as usize;
        (level, across.clamp(1, MOST_ACROSS))
    }

    /// What is seen at a place of the plate.
    fn look(&self, level: usize, place: [f64; 2], beyond: Beyond<'_>) -> [f32; 3] {
        let (w, h) = (self.plate.width() as f64, self.plate.height() as f64);
        let inside = (0.0..=w).contains(&place[0]) && (0.0..=h).contains(&place[1]);
        match beyond {
            Beyond::Colour(rgb) if !inside => rgb,
            Beyond::Map(map, view_deg) if !inside => {
                let focal = 0.5 * w / (0.5 * view_deg.to_radians()).tan();
                let ray = Vec3::new((place[0] - 0.5 * w) / focal, (0.5 * h - place[1]) / focal, -1.0);
                map.radiance(&ray.normalize())
            }
            _ => {
                let image = if level == 0 { self.plate } else { &self.smaller[level - 1] };
                let at = [place[0] * image.width() as f64 / w, place[1] * image.height() as f64 / h];
                let mut rgb = [0.0; 3];
                super::composite::linear(image, at, &mut rgb);
                rgb
            }
        }
    }
}

/// Half the size, rounded up; each pixel the mean of what it covers.
fn halved(image: &Image) -> Image {
    let (w, h) = image.size();
    let (new_w, new_h) = (w.div_ceil(2), h.div_ceil(2));
    let channels = image.channels();
    let mut data = vec![0.0f32; new_w * new_h * channels];
    data.par_chunks_mut(new_w * channels).enumerate().for_each(|(y, row)| {
        let parts_y = parts(y, new_h, h);
        for (x, pixel) in row.chunks_exact_mut(channels).enumerate() {
            for (sx, wx) in parts(x, new_w, w) {
                for (sy, wy) in &parts_y {
                    let weight = wx * wy;
                    pixel.iter_mut().zip(image.pixel(sx, *sy)).for_each(|(sum, v)| *sum += weight * v);
                }
            }
        }
    });
    Image::from_data(new_w, new_h, channels, data).expect("as many numbers as pixels and channels")
}

/// The pixels of a longer line that one of a shorter line covers, with their shares.
fn parts(n: usize, short: usize, long: usize) -> Vec<(usize, f32)> {
    let step = long as f64 / short as f64;
    let (from, to) = (n as f64 * step, (n + 1) as f64 * step);
    let last = (to.ceil() as usize).min(long);
    let share = |k: usize| ((to.min(k as f64 + 1.0) - from.max(k as f64)) / step) as f32;
    (from as usize..last).map(|k| (k, share(k))).filter(|(_, share)| *share > 0.0).collect()
}
