//! Distant light as a lat-long map of radiance, piecewise constant over its texels.

use std::borrow::Cow;
use std::path::Path;

use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::image::{Conversion, Encoding, Image, read};
use crate::math::{Vec3, latlong};

/// What stands in the middle column of a map.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum MapCentre {
    /// +z, from the object towards the camera (OpenEXR's layout in the stage frame).
    #[default]
    Front,
    /// -z, as the camera sees the surroundings past the object (Nuke's habit).
    Behind,
}

/// Radiance from every direction: a lat-long map in linear RGB, laid out as [`latlong`] says.
#[derive(Debug, Clone, PartialEq)]
pub struct EnvMap {
    pub(super) image: Image,
}

impl EnvMap {
    /// Takes a lat-long picture; alpha is dropped.
    ///
    /// # Errors
    /// An empty picture, or NaN or infinity in it.
    pub fn new(image: Image) -> Result<Self> {
        let image = image.into_rgb();
        if image.width() == 0 || image.height() == 0 {
            return Err(Error::invalid("environment map", "no pixels", "at least one"));
        }
        if let Some(at) = image.data().iter().position(|v| !v.is_finite()) {
            let (pixel, channel) = (at / 3, ["red", "green", "blue"][at % 3]);
            let place =
                format!("environment map, pixel ({}, {}), {channel}", pixel % image.width(), pixel / image.width());
            return Err(Error::invalid(place, image.data()[at].to_string(), "a finite number"));
        }
        Ok(Self { image })
    }

    /// Reads a map from a file ([`read`] decides the encoding by its type).
    ///
    /// # Errors
    /// As [`read`].
    pub fn load(path: &Path) -> Result<Self> {
        Self::new(read(path, Encoding::Auto)?)
    }

    /// A map computed from directions at texel centres: `f(direction)` gives radiance.
    pub fn from_fn(width: usize, height: usize, mut f: impl FnMut(&Vec3) -> [f32; 3]) -> Self {
        let at = |i: usize, j: usize| latlong::direction(i as f64 + 0.5, j as f64 + 0.5, width, height);
        Self { image: Image::from_fn(width, height, |i, j| f(&at(i, j))) }
    }

    /// The six-pole chart: a disc of 30 degrees about each axis on black. +x red, -x cyan, +y green, -y magenta, +z
    /// (towards the camera) blue, -z yellow. `presets/charts/six-poles.png` holds it as a file.
    pub fn six_poles(width: usize, height: usize) -> Self {
        let poles = [
            (Vec3::x(), [1.0, 0.0, 0.0]),
            (-Vec3::x(), [0.0, 1.0, 1.0]),
            (Vec3::y(), [0.0, 1.0, 0.0]),
            (-Vec3::y(), [1.0, 0.0, 1.0]),
            (Vec3::z(), [0.0, 0.0, 1.0]),
            (-Vec3::z(), [1.0, 1.0, 0.0]),
        ];
        let inside = 15f64.to_radians().cos();
        Self::from_fn(width, height, |d| poles.iter().find(|(axis, _)| axis.dot(d) >= inside).map_or([0.0; 3], |p| p.1))
    }

    /// The picture, W x H x 3.
    pub fn image(&self) -> &Image {
        &self.image
    }

    /// Radiance of the texel that a unit direction falls in.
    pub fn radiance(&self, direction: &Vec3) -> [f32; 3] {
        let (w, h) = self.image.size();
        let (u, v) = latlong::coordinates(direction, w, h);
        let pixel = self.image.pixel((u as usize).min(w - 1), (v as usize).min(h - 1));
        [pixel[0], pixel[1], pixel[2]]
    }

    /// Radiance between the centres of texels, linear, cyclic in longitude.
    pub fn between(&self, direction: &Vec3) -> [f64; 3] {
        let (w, h) = self.image.size();
        let (u, v) = latlong::coordinates(direction, w, h);
        let (x, y) = (u - 0.5, (v - 0.5).clamp(0.0, (h - 1) as f64));
        let (left, top) = (x.floor(), y.floor());
        let columns = [left.rem_euclid(w as f64) as usize % w, (left + 1.0).rem_euclid(w as f64) as usize % w];
        let rows = [top as usize, (top as usize + 1).min(h - 1)];
        let mut sum = [0.0; 3];
        for (row, down) in rows.into_iter().zip([1.0 - (y - top), y - top]) {
            for (column, across) in columns.into_iter().zip([1.0 - (x - left), x - left]) {
                let pixel = self.image.pixel(column, row);
                (0..3).for_each(|c| sum[c] += down * across * f64::from(pixel[c]));
            }
        }
        sum
    }

    /// The map averaged down to at most `widest` columns (and half as many rows), each new texel the mean radiance of what it
    /// covers, weighted by solid angle; energy is kept to rounding. A map that is small enough is borrowed.
    pub fn reduced(&self, widest: usize) -> Cow<'_, Self> {
        let (w, h) = self.image.size();
        self.averaged((w.min(widest), h.min((widest / 2).max(1))))
    }

    /// The map averaged to a size, as [`EnvMap::resized`] does; the map itself where it has that size.
    pub fn averaged(&self, (new_w, new_h): (usize, usize)) -> Cow<'_, Self> {
        if (new_w, new_h) == self.image.size() { Cow::Borrowed(self) } else { Cow::Owned(self.resized(new_w, new_h)) }
    }

    /// The map over another grid: each new texel the mean radiance of what it covers, weighted by solid angle, so that
    /// energy is kept to rounding. A finer grid shows the old texels.
    ///
    /// # Panics
    /// For a size of 0.
    pub fn resized(&self, new_w: usize, new_h: usize) -> Self {
        assert!(new_w > 0 && new_h > 0, "maps have at least one texel");
        let (columns, rows) = reduction(self.image.size(), (new_w, new_h));
        let mean = |i: usize, j: usize| {
            let mut sum = [0.0f64; 3];
            for &(y, row_share) in &rows[j] {
                for &(x, column_share) in &columns[i] {
                    let pixel = self.image.pixel(x, y);
                    (0..3).for_each(|c| sum[c] += row_share * column_share * f64::from(pixel[c]));
                }
            }
            sum.map(|v| v as f32)
        };
        let rows: Vec<Vec<[f32; 3]>> =
            (0..new_h).into_par_iter().map(|j| (0..new_w).map(|i| mean(i, j)).collect()).collect();
        Self { image: Image::from_fn(new_w, new_h, |i, j| rows[j][i]) }
    }

    /// The integral of radiance over the sphere, for each channel, in radiance times steradian.
    pub fn integral(&self) -> [f64; 3] {
        self.integral_of(|v| v)
    }

    /// The integral of a function of the radiance.
    pub(super) fn integral_of(&self, f: impl Fn(f64) -> f64) -> [f64; 3] {
        let (w, h) = self.image.size();
        let mut sum = [0.0; 3];
        for j in 0..h {
            let omega = latlong::texel_solid_angle(j, w, h);
            let row = self.image.row(j);
            (0..3).for_each(|c| sum[c] += omega * row.iter().skip(c).step_by(3).map(|&v| f(v.into())).sum::<f64>());
        }
        sum
    }

    /// Limits radiance: a texel whose brightest channel exceeds `most` is scaled down as a whole until it does not, so that it
    /// keeps its hue. A map that has no such texel is borrowed, and so is any for `most` of 0 or less, which is no limit.
    pub fn clamped(&self, most: f64) -> Cow<'_, Self> {
        let most = most as f32;
        let brightest = |p: &[f32]| p[0].max(p[1]).max(p[2]);
        if most.is_nan() || most <= 0.0 || self.image.data().chunks_exact(3).all(|p| brightest(p) <= most) {
            return Cow::Borrowed(self);
        }
        let mut map = self.clone();
        for pixel in map.image.data_mut().chunks_exact_mut(3) {
            let b = brightest(pixel);
            if b > most {
                pixel.iter_mut().for_each(|v| *v = if *v == b { most } else { *v / b * most });
            }
        }
        Cow::Owned(map)
    }

    /// Multiplies each channel.
    pub fn scaled(mut self, gain: [f32; 3]) -> Self {
        self.image.data_mut().chunks_exact_mut(3).for_each(|p| p.iter_mut().zip(gain).for_each(|(v, g)| *v *= g));
        self
    }

    /// The same light in another colour space.
    pub fn converted(mut self, conversion: &Conversion) -> Self {
        self.image.convert(conversion);
        self
    }

    /// The adjoint of [`EnvMap::averaged`] for one channel: numbers of an averaged map of size `from`, each spread over the
    /// texels of a map of size `to` that were averaged into it.
    pub fn spread(numbers: &[f64], from: (usize, usize), to: (usize, usize)) -> Vec<f64> {
        if from == to {
            return numbers.to_vec();
        }
        let (columns, rows) = reduction(to, from);
        let mut texels = vec![0.0; to.0 * to.1];
        for (j, row) in rows.iter().enumerate() {
            for &(y, row_share) in row {
                for (i, column) in columns.iter().enumerate() {
                    for &(x, column_share) in column {
                        texels[y * to.0 + x] += row_share * column_share * numbers[j * from.0 + i];
                    }
                }
            }
        }
        texels
    }

    /// The map in the stage frame: its centre column put where `centre` says, then turned by `heading_deg` about +y,
    /// right-handed (light from +z moves to +x).
    ///
    /// Turning carries a piecewise constant map onto another by averaging over the new texels: a shift of a whole number
    /// of columns, and for the rest a blend of two neighbours. Energy is kept exactly.
    pub fn oriented(&self, centre: MapCentre, heading_deg: f64) -> Self {
        let (w, h) = self.image.size();
        // Turning by +heading adds to lon, and lon falls with i: content moves to smaller i.
        let behind = if centre == MapCentre::Behind { 0.5 } else { 0.0 };
        let shift = ((heading_deg / 360.0 + behind) * w as f64).rem_euclid(w as f64);
        let (whole, part) = (shift.floor() as usize % w, (shift - shift.floor()) as f32);
        let image = Image::from_fn(w, h, |i, j| {
            let (a, b) = (self.image.pixel((i + whole) % w, j), self.image.pixel((i + whole + 1) % w, j));
            std::array::from_fn(|c| (1.0 - part) * a[c] + part * b[c])
        });
        Self { image }
    }
}

/// One of the old parts that a new one is made of, and its share.
type Overlap = (usize, f64);

/// How the texels of a map of size `from` average into those of size `to`: for columns, and, by solid angle, for rows.
fn reduction(from: (usize, usize), to: (usize, usize)) -> (Vec<Vec<Overlap>>, Vec<Vec<Overlap>>) {
    let columns = overlaps(from.0, to.0, |u| u / from.0 as f64);
    let rows = overlaps(from.1, to.1, |v| -latlong::band_solid_angle(v, from.1 as f64, from.1));
    (columns, rows)
}

/// For each of `new` equal parts of 0..`old`: the old parts it overlaps, and their shares of it, which sum to one.
/// `measure(position)` grows with the size of what lies before a position.
fn overlaps(old: usize, new: usize, measure: impl Fn(f64) -> f64) -> Vec<Vec<Overlap>> {
    let edge = |n: usize| n as f64 * old as f64 / new as f64;
    let part = |n: usize| {
        let (start, end) = (edge(n), edge(n + 1));
        let whole = measure(end) - measure(start);
        let share = |k: usize| (measure(end.min(k as f64 + 1.0)) - measure(start.max(k as f64))) / whole;
        (start as usize..(end.ceil() as usize).min(old)).map(|k| (k, share(k))).collect()
    };
    (0..new).map(part).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::rotate_heading;

    #[test]
    fn a_quarter_turn_carries_the_blue_pole_to_the_right() {
        let map = EnvMap::six_poles(64, 32);
        let turned = map.oriented(MapCentre::Front, 90.0);
        assert_eq!(turned.radiance(&Vec3::x()), [0.0, 0.0, 1.0]);
        assert_eq!(turned.radiance(&-Vec3::z()), [1.0, 0.0, 0.0]);
        assert_eq!(turned.radiance(&Vec3::y()), [0.0, 1.0, 0.0]);
        let behind = map.oriented(MapCentre::Behind, 0.0);
        assert_eq!(behind.radiance(&-Vec3::z()), [0.0, 0.0, 1.0]);
        assert_eq!(behind.radiance(&-Vec3::x()), [1.0, 0.0, 0.0]);
    }

    #[test]
    fn turning_agrees_with_turning_directions() {
        let map = EnvMap::from_fn(360, 180, |d| [(d.x + 1.5) as f32, (d.y + 1.5) as f32, (d.z + 1.5) as f32]);
        let turned = map.oriented(MapCentre::Front, 33.37);
        for d in [Vec3::new(0.3, 0.2, 0.7), Vec3::new(-0.5, -0.6, 0.1), Vec3::new(0.2, 0.9, -0.9)] {
            let d = d.normalize();
            let (a, b) = (turned.radiance(&rotate_heading(&d, 33.37f64.to_radians())), map.radiance(&d));
            for c in 0..3 {
                assert!((a[c] - b[c]).abs() < 0.02, "{a:?} is not {b:?}");
            }
        }
    }

    #[test]
    fn reducing_keeps_energy() {
        let map = EnvMap::from_fn(300, 151, |d| [(1.0 + d.x * d.y) as f32, d.z.abs() as f32, (d.y > 0.9) as u8 as f32]);
        let small = map.reduced(64);
        assert_eq!(small.image().size(), (64, 32));
        for other in [small.into_owned(), map.resized(431, 200)] {
            for c in 0..3 {
                assert!((other.integral()[c] / map.integral()[c] - 1.0).abs() < 1e-6);
            }
        }
        assert_eq!(map.reduced(300).image().size(), (300, 150));
    }

    #[test]
    fn clamping_keeps_hue() {
        let map = EnvMap::new(Image::from_data(2, 1, 3, vec![8.0, 4.0, -2.0, 0.5, 1.0, 0.25]).unwrap()).unwrap();
        assert_eq!(map.clamped(2.0).image().data(), [2.0, 1.0, -0.5, 0.5, 1.0, 0.25]);
        for unlimited in [0.0, 8.0, -1.0, f64::NAN] {
            assert!(matches!(map.clamped(unlimited), Cow::Borrowed(_)), "{unlimited}");
        }
    }

    #[test]
    fn the_integral_of_one_is_the_sphere() {
        let integral = EnvMap::from_fn(37, 18, |_| [1.0, 0.0, -0.5]).integral();
        let sphere = 4.0 * std::f64::consts::PI;
        assert!((integral[0] - sphere).abs() < 1e-9 && integral[1] == 0.0 && (integral[2] + sphere / 2.0).abs() < 1e-9);
    }

    #[test]
    fn the_chart_that_ships_is_the_chart() {
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../presets/charts/six-poles.png");
        assert_eq!(EnvMap::load(&file).unwrap(), EnvMap::six_poles(512, 256));
    }

    #[test]
    fn nan_is_refused_with_its_pixel() {
        let mut image = Image::new(4, 2, 3);
        image.pixel_mut(2, 1)[1] = f32::NAN;
        let message = EnvMap::new(image).unwrap_err().to_string();
        assert!(message.contains("(2, 1)") && message.contains("green"), "{message}");
    }
}
