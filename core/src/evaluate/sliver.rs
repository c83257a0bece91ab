//! A sliver of light that turns about the object (4.4.1, figures 4.17 and 4.18).
//!
//! The sliver lies along a meridian of the lat-long map and is shifted along longitude: fine in one direction, so that
//! highlights and the edges of shadows show, long in the other. Seen over time, a pixel under it shows its reflectance
//! function smoothed along meridians; a method that is not smooth shows as steps.

use std::f64::consts::{PI, TAU};

use super::blocks::read;
use crate::error::{Error, Result};
use crate::field::{BLOCK_HEIGHT, BLOCK_PIXELS, BLOCK_WIDTH, Samples};
use crate::illumination::EnvMap;
use crate::image::Image;
use crate::reconstruct::Operator;
use crate::relight::Weights;

/// Columns and rows of the sliver's map: 0.7 degrees a texel; edges are averaged exactly.
pub const SLIVER_MAP: (usize, usize) = (512, 256);
/// Width in longitude: below the step of 64 lamps a turn, above that of the map.
pub const SLIVER_RAD: f64 = 5.0 * PI / 180.0;

/// `count` headings over one turn, from behind the object over its left (as +x is right, from -180 degrees) round to
/// behind again, the middles of equal parts.
pub fn headings(count: usize) -> Vec<f64> {
    (0..count).map(|k| -PI + TAU * (k as f64 + 0.5) / count as f64).collect()
}

/// Weights of the lamps under slivers of radiance 1 at some headings (about +y, 0 from +z, +90 degrees from +x): one
/// weight a lamp each.
///
/// # Panics
/// When the operator is not for maps of [`SLIVER_MAP`].
pub fn sliver_weights(operator: &Operator, headings: &[f64]) -> Vec<Vec<f32>> {
    // Channels are independent: three headings share a map.
    let three = |headings: &[f64]| {
        let columns: [Vec<f32>; 3] = std::array::from_fn(|c| headings.get(c).map_or_else(dark, |h| sliver(*h)));
        let map = Image::from_fn(SLIVER_MAP.0, SLIVER_MAP.1, |i, _| [0, 1, 2].map(|c| columns[c][i]));
        let rgb = EnvMap::new(map).map(|map| operator.downsample(&map)).unwrap_or_default();
        (0..headings.len()).map(|c| rgb.iter().map(|w| w[c]).collect()).collect::<Vec<_>>()
    };
    headings.chunks(3).flat_map(three).collect()
}

/// The map of a white sliver of radiance 1 at a heading, of [`SLIVER_MAP`].
///
/// # Errors
/// None for a finite heading.
pub fn sliver_map(heading: f64) -> Result<EnvMap> {
    let columns = sliver(heading);
    EnvMap::new(Image::from_fn(SLIVER_MAP.0, SLIVER_MAP.1, |i, _| [columns[i]; 3]))
}

fn dark() -> Vec<f32> {
    vec![0.0; SLIVER_MAP.0]
}

/// The part of each column of the map that a sliver covers.
fn sliver(heading: f64) -> Vec<f32> {
    let columns = SLIVER_MAP.0 as f64;
    // lon = pi - 2 pi u / W.
    let (middle, half) = ((PI - heading) / TAU * columns, SLIVER_RAD / TAU * columns / 2.0);
    let covered = |i: usize| {
        // The nearest copy of the column.
        let from = i as f64 + columns * ((middle - i as f64 - 0.5) / columns).round();
        ((from + 1.0).min(middle + half) - from.max(middle - half)).max(0.0) as f32
    };
    (0..SLIVER_MAP.0).map(covered).collect()
}

/// White light from one weight a lamp: numbers of `kept` lamps, put among all.
pub fn spread_weights(weights: &[f32], kept: Option<&[u32]>, lamps: usize) -> Weights {
    let mut all = Weights::dark(lamps);
    match kept {
        Some(kept) => kept.iter().zip(weights).for_each(|(&n, &w)| all.rgb[n as usize] = [w; 3]),
        None => all.rgb.iter_mut().zip(weights).for_each(|(rgb, &w)| *rgb = [w; 3]),
    }
    all
}

/// All reflectance functions of one column of the picture.
#[derive(Debug, Clone)]
pub struct Column {
    height: usize,
    lamps: usize,
    /// `[channel][row][lamp]`.
    numbers: Vec<f32>,
}

impl Column {
    /// Reads column `x`. Memory: height x lamps x 12 bytes.
    ///
    /// # Errors
    /// A column outside the picture; bytes that cannot be read, numbers that are not finite.
    pub fn read(samples: Samples<'_>, x: usize) -> Result<Self> {
        let layout = samples.layout();
        if x >= layout.width {
            let expected = format!("0 to {}", layout.width - 1);
            return Err(Error::invalid(samples.path().display().to_string(), format!("column {x}"), expected));
        }
        let (height, lamps) = (layout.height, layout.elements);
        let mut numbers = vec![0.0; 3 * height * lamps];
        for by in 0..layout.rows() {
            let channels = read(samples, x / BLOCK_WIDTH, by)?;
            for (c, floats) in channels.iter().enumerate() {
                for y in by * BLOCK_HEIGHT..((by + 1) * BLOCK_HEIGHT).min(height) {
                    let at = (y % BLOCK_HEIGHT) * BLOCK_WIDTH + x % BLOCK_WIDTH;
                    let row = &mut numbers[(c * height + y) * lamps..][..lamps];
                    row.iter_mut().enumerate().for_each(|(j, t)| *t = floats[j * BLOCK_PIXELS + at] * samples.scale());
                }
            }
        }
        Ok(Self { height, lamps, numbers })
    }

    /// The column under some lights, one column of the result each (figure 4.18): a row is a pixel over time. Weights are
    /// one a lamp; of `kept` lamps alone where given.
    pub fn over_time(&self, lights: &[Vec<f32>], kept: Option<&[u32]>) -> Image {
        let lit = |c: usize, y: usize, weights: &[f32]| {
            let row = &self.numbers[(c * self.height + y) * self.lamps..][..self.lamps];
            match kept {
                Some(kept) => kept.iter().zip(weights).map(|(&n, w)| row[n as usize] * w).sum::<f32>(),
                None => row.iter().zip(weights).map(|(t, w)| t * w).sum(),
            }
        };
        Image::from_fn(lights.len(), self.height, |x, y| std::array::from_fn(|c| lit(c, y, &lights[x])))
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::domain::Directions;
    use crate::math::{Vec3, angle_between};
    use crate::reconstruct::{Method, Outside, Reconstruction};
    use crate::simulate::grid_lamps;

    #[test]
    fn a_sliver_has_its_width_and_stands_at_its_heading() {
        for heading in headings(37) {
            let columns = sliver(heading);
            let sum: f32 = columns.iter().sum();
            assert!((f64::from(sum) * TAU / SLIVER_MAP.0 as f64 - SLIVER_RAD).abs() < 1e-5, "{heading}");
            let mean = (0..SLIVER_MAP.0).fold(Vec3::zeros(), |mean, i| {
                let towards = crate::math::latlong::direction(i as f64 + 0.5, 128.0, SLIVER_MAP.0, SLIVER_MAP.1);
                mean + towards * f64::from(columns[i])
            });
            let expected = Vec3::new(heading.sin(), 0.0, heading.cos());
            // Columns count by their middle: right to a part of a column, which is 0.012.
            assert!(angle_between(&mean.normalize(), &expected) < 0.002, "{heading}");
        }
    }

    #[test]
    fn a_whole_turn_of_slivers_is_light_from_everywhere() {
        let lamps = Arc::new(Directions::new(grid_lamps(16, 4)).unwrap());
        let reconstruction = Arc::new(Reconstruction::new(lamps.clone(), Method::Linear).unwrap());
        let operator = Operator::new(reconstruction, Outside::Drop, SLIVER_MAP.0, SLIVER_MAP.1);
        // 72 slivers of 5 degrees fill the circle.
        let weights = sliver_weights(&operator, &headings(72));
        assert_eq!((weights.len(), weights[0].len()), (72, 64));
        for (j, omega) in operator.solid_angles().iter().enumerate() {
            let sum: f64 = weights.iter().map(|w| f64::from(w[j])).sum();
            assert!((sum / omega - 1.0).abs() < 1e-4, "lamp {j}: {sum} of {omega}");
        }
    }
}
