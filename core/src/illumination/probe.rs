//! Probes: pictures of the surroundings in any projection, resampled into any other.
//!
//! A [`View`] is a picture with its projection, its place in the picture and the heading it was taken at. [`resample`]
//! turns views into one picture: each new texel is the mean radiance of the solid angle it covers, by sub-samples at a
//! third of the views' pixel pitch (so that nothing is skipped where the picture shrinks), each interpolated linearly
//! between pixel centres (so that nothing is blurred further where it grows). Sub-samples are weighted by the new
//! projection's Jacobian: irradiance is kept. Views of one place (Peers 2006, 2.2.1: the camera is removed by two
//! photographs of the ball from different positions) are blended with weights that fall smoothly to zero towards what a
//! view cannot tell: the camera's reflection in the middle of a ball, and its blind rim.

use std::f64::consts::PI;
use std::ops::Range;

use rayon::prelude::*;

use super::EnvMap;
use crate::error::{Error, Result};
use crate::image::Image;
use crate::math::projection::{Projection, face_coordinates, face_direction};
use crate::math::{Vec3, rotate_heading};

/// A circle in a picture, in pixels: (0, 0) is the picture's top left corner, pixel centres lie at +0.5.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Circle {
    /// Centre, to the right.
    pub x: f64,
    /// Centre, downwards.
    pub y: f64,
    /// Radius.
    pub radius: f64,
}

impl Circle {
    /// The largest circle in the middle of a picture.
    pub fn inscribed(width: usize, height: usize) -> Self {
        Self { x: 0.5 * width as f64, y: 0.5 * height as f64, radius: 0.5 * width.min(height) as f64 }
    }

    /// Refuses circles that are no outline of a ball in a `width` x `height` picture.
    ///
    /// # Errors
    /// A radius below two pixels or not finite; more than a pixel outside the picture.
    pub fn check_inside(&self, place: &str, width: usize, height: usize) -> Result<()> {
        let (w, h) = (width as f64, height as f64);
        let found = || format!("a ball at {:.1},{:.1} of radius {:.1}", self.x, self.y, self.radius);
        if !(self.x.is_finite() && self.y.is_finite() && self.radius >= 2.0 && self.radius.is_finite()) {
            return Err(Error::invalid(place, found(), "a circle of at least two pixels' radius"));
        }
        let out = [self.radius - self.x, self.radius - self.y, self.x + self.radius - w, self.y + self.radius - h];
        if out.iter().any(|beyond| *beyond > 1.0) {
            let expected = format!("a circle that lies wholly inside the picture of {width} x {height} pixels");
            return Err(Error::invalid(place, found(), expected));
        }
        Ok(())
    }
}

/// A picture of the surroundings.
#[derive(Debug, Clone, PartialEq)]
pub struct View {
    image: Image,
    projection: Projection,
    /// Left, top, width and height in pixels of the projection's unit square.
    square: [f64; 4],
    heading_rad: f64,
    camera_rad: f64,
    /// The largest angle from a ball's middle that its pixels tell.
    sight_rad: f64,
}

/// The picture to make.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Target {
    /// Its projection.
    pub projection: Projection,
    /// Columns; of a cube, of one face.
    pub width: usize,
    /// Turns the picture's own +z towards +x, radians.
    pub heading_rad: f64,
}

/// What [`resample`] made.
#[derive(Debug, Clone, PartialEq)]
pub struct Resampled {
    /// The picture, RGB; black where no view saw anything, and outside the disc of a round one.
    pub image: Image,
    /// Share of the new picture's solid angle that some view shows, 0..1.
    pub seen: f64,
}

/// Share of a fisheye's radius over which its weight falls to zero at the rim: lenses are worst there.
const FISHEYE_FALL: f64 = 0.15;
/// A ball's weight falls from one at 110 degrees from the camera's direction to zero at 165: beyond, a radius of 500
/// pixels spends less than five pixels on 15 degrees.
const BALL_FALL: (f64, f64) = (110.0 * PI / 180.0, 165.0 * PI / 180.0);
/// The weight of a view where it can tell least: it counts only where the others tell nothing.
const LEAST_WEIGHT: f64 = 1e-6;
/// Pixels that the outline of a disc crosses hold background. A pixel counts when its centre is this far inside: half a
/// diagonal.
const RIM: f64 = 0.71;
/// Sub-samples a side of a new texel at most: beyond (a 16k map onto a thumbnail) the mean is an estimate.
const MOST_SAMPLES: f64 = 128.0;

impl View {
    /// A lat-long map, cube map, or round picture inscribed in the image, or in `circle` of it.
    ///
    /// `heading_rad` is where the view's own +z points, turned right-handed about +y from the stage's +z; alpha is
    /// dropped.
    ///
    /// # Errors
    /// An empty picture; a cube that is not six faces high; a ball that reaches beyond the picture; a circle for a
    /// projection that is not round.
    pub fn new(image: Image, projection: Projection, circle: Option<Circle>, heading_rad: f64) -> Result<Self> {
        let (w, h) = image.size();
        if w == 0 || h == 0 {
            return Err(Error::invalid("probe", "a picture without pixels", "at least one"));
        }
        let square = match (projection.is_round(), circle) {
            (false, Some(_)) => return Err(Error::invalid("probe", "a circle", "none, as the picture is not round")),
            (false, None) => [0.0, 0.0, w as f64, h as f64],
            (true, circle) => {
                let circle = circle.unwrap_or(Circle::inscribed(w, h));
                if matches!(projection, Projection::Ball { .. }) {
                    circle.check_inside("probe", w, h)?;
                }
                let side = 2.0 * circle.radius;
                [circle.x - circle.radius, circle.y - circle.radius, side, side]
            }
        };
        if projection == Projection::Cube && h != 6 * w {
            let expected = format!("{w} x {} pixels: six square faces in a vertical strip", 6 * w);
            return Err(Error::invalid("cube map", format!("{w} x {h} pixels"), expected));
        }
        let r = 0.5 * square[2];
        let sight_rad = projection.angle_at((1.0 - rim_px(r) / r).max(0.0)).unwrap_or(PI);
        Ok(Self { image: image.into_rgb(), projection, square, heading_rad, camera_rad: 0.0, sight_rad })
    }

    /// Leaves out what the camera hides: a cone of this half-angle about the middle of a ball, softened over as much
    /// again. It takes effect where another view helps.
    #[must_use]
    pub fn hiding_camera(self, half_angle_rad: f64) -> Self {
        Self { camera_rad: half_angle_rad, ..self }
    }

    /// Where a direction lies in the picture, in pixels.
    fn place(&self, direction: &Vec3) -> Option<[f64; 2]> {
        let own = rotate_heading(direction, -self.heading_rad);
        let (u, v) = self.projection.coordinates(&own)?;
        Some([self.square[0] + u * self.square[2], self.square[1] + v * self.square[3]])
    }

    /// Radiance from a unit direction, linear between pixel centres; `None` where the picture shows nothing.
    ///
    /// The blind spot behind a ball is bridged: straight across from one side of the rim to the other.
    pub fn radiance(&self, direction: &Vec3) -> Option<[f32; 3]> {
        let own = rotate_heading(direction, -self.heading_rad);
        if matches!(self.projection, Projection::Ball { .. }) {
            let theta = own.x.hypot(own.y).atan2(own.z);
            if theta > self.sight_rad {
                return self.bridge(&own, (PI - theta) / (PI - self.sight_rad));
            }
        }
        self.at(self.place(direction)?)
    }

    /// The light at `share` of the way from -z to the rim of the blind spot.
    fn bridge(&self, own: &Vec3, share: f64) -> Option<[f32; 3]> {
        let across = own.x.hypot(own.y);
        let (x, y) = if across > 0.0 { (own.x / across, own.y / across) } else { (1.0, 0.0) };
        let rim = |side: f64| {
            let [left, top, size, _] = self.square;
            self.at([left + (0.5 + 0.5 * side * x) * size, top + (0.5 - 0.5 * side * y) * size])
        };
        let (near, far) = (rim(1.0)?, rim(-1.0)?);
        let weight = (0.5 + 0.5 * share) as f32;
        Some(std::array::from_fn(|c| weight * near[c] + (1.0 - weight) * far[c]))
    }

    /// The picture at a place in pixels; of a round one no nearer to the rim than where pixels count.
    fn at(&self, [x, y]: [f64; 2]) -> Option<[f32; 3]> {
        if !self.projection.is_round() {
            return self.between(x, y);
        }
        let [left, top, size, _] = self.square;
        let (cx, cy, r) = (left + 0.5 * size, top + 0.5 * size, 0.5 * size);
        let (dx, dy) = (x - cx, y - cy);
        // At the first of these one of the four pixels counts, but for rounding.
        [0.0, 0.5, 1.0].into_iter().find_map(|further| {
            let shrink = ((r - rim_px(r) - further).max(0.0) / dx.hypot(dy)).min(1.0);
            self.between(cx + dx * shrink, cy + dy * shrink)
        })
    }

    /// Bilinear, over the pixels that count.
    fn between(&self, x: f64, y: f64) -> Option<[f32; 3]> {
        let (i, j) = ((x - 0.5).floor(), (y - 0.5).floor());
        let (a, b) = (x - 0.5 - i, y - 0.5 - j);
        let (mut sum, mut total) = ([0.0f64; 3], 0.0);
        let corners = [(0, 0, (1.0 - a) * (1.0 - b)), (1, 0, a * (1.0 - b)), (0, 1, (1.0 - a) * b), (1, 1, a * b)];
        for (di, dj, weight) in corners {
            let texel = self.texel(i as i64 + di, j as i64 + dj, y);
            if let Some((i, j)) = texel.filter(|_| weight > 0.0) {
                let pixel = self.image.pixel(i, j);
                (0..3).for_each(|c| sum[c] += weight * f64::from(pixel[c]));
                total += weight;
            }
        }
        (total > 0.0).then(|| sum.map(|s| (s / total) as f32))
    }

    /// The pixel that stands at column i, row j of the grid, carried over the edges of the map; `None` beyond the edge
    /// of a round picture. `y` is the row that was asked for: of a cube it tells the face.
    fn texel(&self, i: i64, j: i64, y: f64) -> Option<(usize, usize)> {
        let (w, h) = (self.image.width() as i64, self.image.height() as i64);
        match self.projection {
            Projection::LatLong => {
                // Over a pole lies the other half of the same row.
                let (i, j) = match j {
                    _ if j < 0 => (i + w / 2, -1 - j),
                    _ if j >= h => (i + w / 2, 2 * h - 1 - j),
                    _ => (i, j),
                };
                Some((i.rem_euclid(w) as usize, j.clamp(0, h - 1) as usize))
            }
            Projection::Cube => {
                let face = ((y / w as f64) as i64).clamp(0, 5);
                let row = j - face * w;
                if (0..w).contains(&i) && (0..w).contains(&row) {
                    return Some((i as usize, j as usize));
                }
                let centre = |k: i64| (k as f64 + 0.5) / w as f64;
                let (other, a, b) = face_coordinates(&face_direction(face as usize, centre(i), centre(row)));
                let inside = |t: f64| ((t * w as f64) as i64).clamp(0, w - 1);
                Some((inside(a) as usize, (other as i64 * w + inside(b)) as usize))
            }
            _ => {
                let [left, top, side, _] = self.square;
                let from_centre = (i as f64 + 0.5 - left - 0.5 * side).hypot(j as f64 + 0.5 - top - 0.5 * side);
                let inside = (0..w).contains(&i) && (0..h).contains(&j) && from_centre <= 0.5 * side - RIM;
                inside.then_some((i as usize, j as usize))
            }
        }
    }

    /// How much this view has to say about a direction, beside others.
    fn weight(&self, direction: &Vec3) -> f64 {
        let own = rotate_heading(direction, -self.heading_rad);
        let theta = own.x.hypot(own.y).atan2(own.z);
        let weight = match self.projection {
            Projection::Ball { .. } => {
                let end = BALL_FALL.1.min(self.projection.reach_rad());
                let camera =
                    if self.camera_rad > 0.0 { smooth((theta - self.camera_rad) / self.camera_rad) } else { 1.0 };
                camera * smooth((end - theta) / (end - BALL_FALL.0).max(0.1))
            }
            Projection::Equidistant { .. } | Projection::Equisolid { .. } => {
                let reach = self.projection.reach_rad();
                smooth((reach - theta) / (FISHEYE_FALL * reach))
            }
            Projection::LatLong | Projection::Cube => 1.0,
        };
        weight.max(LEAST_WEIGHT)
    }
}

/// How far inside the outline of `r` pixels at least one of the four pixels about a point counts: of four about a point
/// one lies no farther out, save for the curvature of the circle.
fn rim_px(r: f64) -> f64 {
    RIM + 0.5 / r
}

/// 0 below 0, 1 above 1, with continuous slope.
fn smooth(t: f64) -> f64 {
    let t = t.clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

impl Target {
    /// Rows of the picture.
    pub fn height(&self) -> usize {
        ((self.width as f64 * self.projection.aspect()).round() as usize).max(1)
    }

    fn direction(&self, x: f64, y: f64) -> Option<Vec3> {
        let own = self.projection.direction(x / self.width as f64, y / self.height() as f64)?;
        Some(rotate_heading(&own, self.heading_rad))
    }
}

/// Texels of a row that share their number of sub-samples.
const RUN: usize = 4;
/// Rows between two looks at whether to stop.
const BAND: usize = 32;

/// Resamples views of one place into one picture. `progress(rows done, all)` may stop it with an error. Cost: about
/// nine look-ups for each pixel of a view, and at least four for each new one; in parallel, and independent of the
/// number of threads.
///
/// # Errors
/// No view, or a picture without columns; what `progress` returns.
pub fn resample(
    views: &[View],
    target: &Target,
    progress: &mut dyn FnMut(u64, u64) -> Result<()>,
) -> Result<Resampled> {
    if views.is_empty() || target.width == 0 {
        return Err(Error::invalid("probe", "nothing to resample", "at least one view and one column"));
    }
    let (w, h) = (target.width, target.height());
    let mut image = Image::new(w, h, 3);
    let (mut seen, mut solid_angle) = (0.0, 0.0);
    for (n, band) in image.data_mut().chunks_mut(BAND * w * 3).enumerate() {
        let row = |(y, row): (usize, &mut [f32])| {
            let mut sums = [0.0; 2];
            for (run, pixels) in row.chunks_mut(3 * RUN).enumerate() {
                let (first, y) = (run * RUN, n * BAND + y);
                let counts = samples(views, target, first..first + pixels.len() / 3, y);
                for (x, pixel) in (first..).zip(pixels.chunks_exact_mut(3)) {
                    let texel = texel(views, target, x, y, counts);
                    pixel.copy_from_slice(&texel.rgb);
                    sums = [sums[0] + texel.seen, sums[1] + texel.solid_angle];
                }
            }
            sums
        };
        // Rows are summed in their order, so that the figure does not depend on the number of threads.
        let sums: Vec<[f64; 2]> = band.par_chunks_mut(w * 3).enumerate().map(row).collect();
        seen += sums.iter().map(|s| s[0]).sum::<f64>();
        solid_angle += sums.iter().map(|s| s[1]).sum::<f64>();
        progress(((n + 1) * BAND).min(h) as u64, h as u64)?;
    }
    Ok(Resampled { image, seen: seen / solid_angle.max(f64::MIN_POSITIVE) })
}

/// Resamples views into a lat-long map of the stage frame.
///
/// # Errors
/// As [`resample`].
pub fn to_env_map(views: &[View], width: usize) -> Result<EnvMap> {
    let target = Target { projection: Projection::LatLong, width, heading_rad: 0.0 };
    EnvMap::new(resample(views, &target, &mut |_, _| Ok(()))?.image)
}

/// One new texel, and what of it was seen.
#[derive(Debug, Clone, Copy)]
struct Texel {
    rgb: [f32; 3],
    solid_angle: f64,
    seen: f64,
}

fn texel(views: &[View], target: &Target, x: usize, y: usize, [nx, ny]: [usize; 2]) -> Texel {
    let (w, h) = (target.width as f64, target.height() as f64);
    let (mut sum, mut solid_angle, mut seen, mut inside) = ([0.0f64; 3], 0.0, 0.0, 0usize);
    for k in 0..nx * ny {
        let px = x as f64 + ((k % nx) as f64 + 0.5) / nx as f64;
        let py = y as f64 + ((k / nx) as f64 + 0.5) / ny as f64;
        let Some(direction) = target.direction(px, py) else { continue };
        let density = target.projection.density(px / w, py / h);
        inside += 1;
        solid_angle += density;
        if let Some(rgb) = blend(views, &direction) {
            seen += density;
            (0..3).for_each(|c| sum[c] += density * rgb[c]);
        }
    }
    // Over the solid angle inside the picture, times the share of the texel that is inside.
    let scale = inside as f64 / (nx * ny) as f64 / solid_angle.max(f64::MIN_POSITIVE);
    let per_sample = 1.0 / (nx * ny) as f64;
    Texel { rgb: sum.map(|s| (s * scale) as f32), solid_angle: solid_angle * per_sample, seen: seen * per_sample }
}

/// The views' radiances, by their weights.
fn blend(views: &[View], direction: &Vec3) -> Option<[f64; 3]> {
    if let [view] = views {
        return view.radiance(direction).map(|rgb| rgb.map(f64::from));
    }
    let (mut sum, mut total) = ([0.0; 3], 0.0);
    for view in views {
        if let Some(rgb) = view.radiance(direction) {
            let weight = view.weight(direction);
            (0..3).for_each(|c| sum[c] += weight * f64::from(rgb[c]));
            total += weight;
        }
    }
    (total > 0.0).then(|| sum.map(|s| s / total))
}

/// Sub-samples across and down each new texel of a run: three for each of the views' pixels that it spans, and at least
/// two, from differences over a sixteenth of a texel at the middle of the run and near its corners. A seam of a map
/// shows as a leap on one side only, so the smaller difference counts.
fn samples(views: &[View], target: &Target, run: Range<usize>, y: usize) -> [usize; 2] {
    const STEP: f64 = 1.0 / 16.0;
    let (left, right) = (run.start as f64 + 0.1, run.end as f64 - 0.1);
    let middle = 0.5 * (left + right);
    let mut span = [0.5f64; 2];
    for view in views {
        for (x, b) in [(middle, 0.5), (left, 0.1), (right, 0.1), (left, 0.9), (right, 0.9)] {
            let at = |dx: f64, dy: f64| view.place(&target.direction(x + dx, y as f64 + b + dy)?);
            let Some(here) = at(0.0, 0.0) else { continue };
            let leap = |there: Option<[f64; 2]>| there.map_or(0.0, |t| (t[0] - here[0]).hypot(t[1] - here[1]));
            span[0] = span[0].max(leap(at(STEP, 0.0)).min(leap(at(-STEP, 0.0))) / STEP);
            span[1] = span[1].max(leap(at(0.0, STEP)).min(leap(at(0.0, -STEP))) / STEP);
        }
    }
    span.map(|s| (3.0 * s).ceil().min(MOST_SAMPLES) as usize)
}
