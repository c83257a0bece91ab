//! Highlights on a ball in one photograph.

use super::reflect::Ball;
use crate::image::{Image, Window};
use crate::math::Vec3;

/// Spots end where the light falls below this share of the peak. Half would split what noise or clipping makes ragged;
/// a tenth would take in the halo of a lens.
const EDGE: f32 = 0.3;
/// Peaks below this many deviations of the noise are none: a ball of 10^5 pixels has no such peak by chance (p = 1e-9
/// each).
const NOISE: f32 = 6.0;
/// Light this far beyond a spot's edge, in pixels, still counts towards its middle.
const SKIRT: usize = 2;
/// Highlights are sought up to this share of the outline's radius; beyond, pixels hold background.
const OUTERMOST: f64 = 0.99;
/// Codes this near the largest one are clipped, whatever the curve.
const CLIPPED: f32 = 0.995;
/// Spots beside the brightest one that carry less than this share of its light are reflections in the room, not lamps.
const FAINT_SPOT: f64 = 0.15;

/// The part of a photograph that holds a ball: luminance, row by row.
#[derive(Debug, Clone, PartialEq)]
pub struct Crop {
    /// Where in the photograph.
    pub window: Window,
    /// Luminance (Rec. 709).
    pub values: Vec<f32>,
    /// Is some channel at the top of its range? Only meaningful of integer files, whose white is 1.
    pub clipped: Vec<bool>,
}

impl Crop {
    /// The pixels about a ball.
    pub fn of(image: &Image, ball: &Ball) -> Self {
        let c = ball.circle();
        let low = |v: f64| (v - c.radius - 2.0).floor().max(0.0) as usize;
        let high = |v: f64| (v + c.radius + 2.0).ceil().max(0.0) as usize;
        let window =
            Window { x0: low(c.x), y0: low(c.y), x1: high(c.x), y1: high(c.y) }.clipped(image.width(), image.height());
        let pixels = || (window.y0..window.y1).flat_map(|y| (window.x0..window.x1).map(move |x| image.pixel(x, y)));
        Self {
            window,
            values: pixels().map(luminance).collect(),
            clipped: pixels().map(|p| p[..3].iter().any(|v| *v >= CLIPPED)).collect(),
        }
    }
}

/// Rec. 709 luminance of linear RGB.
pub fn luminance(pixel: &[f32]) -> f32 {
    0.2126 * pixel[0] + 0.7152 * pixel[1] + 0.0722 * pixel[2]
}

/// One highlight.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spot {
    /// Its middle in the photograph, pixels.
    pub x: f64,
    /// Downwards.
    pub y: f64,
    /// Mean direction of the light, the surface point it left averaged too.
    pub direction: Vec3,
    /// The point of the ball (in radii from its middle) that shows it.
    pub normal: Vec3,
    /// Sum of its light.
    pub power: f64,
    /// Pixels above the edge.
    pub area: usize,
    /// Of them clipped.
    pub clipped: usize,
    /// From the middle of the ball, in radii.
    pub radius: f64,
}

/// What a ball shows in one photograph.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Spots {
    /// Highlights that may be a lamp, the strongest first; none where nothing stands above the noise.
    pub spots: Vec<Spot>,
    /// The brightest value, smoothed.
    pub peak: f32,
}

/// Median of crops, pixel by pixel: what stands still while lamps change. `None` of fewer than five, where a lamp may
/// stand still too.
pub fn still(crops: &[Crop]) -> Option<Vec<f32>> {
    if crops.len() < 5 {
        return None;
    }
    let mut column = vec![0.0; crops.len()];
    let mut median = |k: usize| {
        column.iter_mut().zip(crops).for_each(|(v, crop)| *v = crop.values[k]);
        let middle = crops.len() / 2;
        *column.select_nth_unstable_by(middle, f32::total_cmp).1
    };
    Some((0..crops[0].values.len()).map(&mut median).collect())
}

/// Finds the highlights on a ball; `still` is subtracted first.
pub fn find(crop: &Crop, ball: &Ball, still: Option<&[f32]>) -> Spots {
    let (w, h) = (crop.window.width(), crop.window.height());
    if w < 3 || h < 3 {
        return Spots::default();
    }
    let base = |k: usize| still.map_or(0.0, |s| s[k]);
    let light: Vec<f32> = (0..w * h).map(|k| crop.values[k] - base(k)).collect();
    let centre = |k: usize| ((crop.window.x0 + k % w) as f64 + 0.5, (crop.window.y0 + k / w) as f64 + 0.5);
    let inside: Vec<bool> = (0..w * h).map(|k| ball.radius_at(centre(k).0, centre(k).1) < OUTERMOST).collect();
    let smooth = smoothed(&light, w, h);
    let (level, noise) = level_and_noise(&smooth, &inside);
    let peak = (0..w * h).filter(|&k| inside[k]).map(|k| smooth[k] - level).fold(0.0, f32::max);
    let threshold = (EDGE * peak).max(NOISE * noise);
    if peak <= threshold || peak <= 0.0 {
        return Spots { spots: Vec::new(), peak };
    }
    let bright: Vec<bool> = (0..w * h).map(|k| inside[k] && smooth[k] - level > threshold).collect();
    let mut spots: Vec<Spot> = groups(&bright, w, h)
        .iter()
        .filter_map(|group| {
            let skirt = grown(group, w, h, SKIRT);
            let weigh = |k: usize| f64::from((light[k] - level).max(0.0));
            let lit = skirt.iter().filter(|&&k| inside[k]).map(|&k| (centre(k), weigh(k)));
            let clipped = group.iter().filter(|&&k| crop.clipped[k]).count();
            measure(lit, ball, group.len(), clipped)
        })
        .collect();
    spots.sort_by(|a, b| b.power.total_cmp(&a.power));
    let strongest = spots.first().map_or(0.0, |s| s.power);
    spots.retain(|s| s.power > FAINT_SPOT * strongest);
    Spots { spots, peak }
}

/// The middle of a spot. Directions are averaged, not pixels: a round lamp is a crescent near the rim, but the far
/// camera's mirror ball keeps areas, so the mean over its pixels is the mean over its solid angle.
fn measure(lit: impl Iterator<Item = ((f64, f64), f64)>, ball: &Ball, area: usize, clipped: usize) -> Option<Spot> {
    let (mut power, mut x, mut y) = (0.0, 0.0, 0.0);
    let (mut direction, mut normal) = (Vec3::zeros(), Vec3::zeros());
    for ((px, py), weight) in lit {
        if let Some(reflected) = ball.reflect(px, py) {
            power += weight;
            (x, y) = (x + weight * px, y + weight * py);
            direction += reflected.direction * weight;
            normal += reflected.normal * weight;
        }
    }
    if power <= 0.0 {
        return None;
    }
    let (x, y) = (x / power, y / power);
    let (direction, normal) = (direction.try_normalize(1e-9)?, normal.try_normalize(1e-9)?);
    Some(Spot { x, y, direction, normal, power, area, clipped, radius: ball.radius_at(x, y) })
}

/// 1 2 1 in both directions.
fn smoothed(values: &[f32], w: usize, h: usize) -> Vec<f32> {
    let pass = |values: &[f32], step: usize, along: &dyn Fn(usize) -> (usize, usize)| -> Vec<f32> {
        let one = |k: usize| {
            let (at, n) = along(k);
            let before = if at > 0 { values[k - step] } else { values[k] };
            let after = if at + 1 < n { values[k + step] } else { values[k] };
            0.25 * before + 0.5 * values[k] + 0.25 * after
        };
        (0..values.len()).map(one).collect()
    };
    let rows = pass(values, 1, &|k| (k % w, w));
    pass(&rows, w, &|k| (k / w, h))
}

/// Median, and deviation of the noise from the median absolute deviation (1.4826 of a normal distribution).
fn level_and_noise(values: &[f32], inside: &[bool]) -> (f32, f32) {
    let mut sample: Vec<f32> = values.iter().zip(inside).filter(|(_, inside)| **inside).map(|(v, _)| *v).collect();
    if sample.is_empty() {
        return (0.0, 0.0);
    }
    let middle = sample.len() / 2;
    let level = *sample.select_nth_unstable_by(middle, f32::total_cmp).1;
    sample.iter_mut().for_each(|v| *v = (*v - level).abs());
    (level, 1.4826 * *sample.select_nth_unstable_by(middle, f32::total_cmp).1)
}

/// Connected groups (eight neighbours) of marked pixels, those two pixels apart joined.
fn groups(marked: &[bool], w: usize, h: usize) -> Vec<Vec<usize>> {
    let all: Vec<usize> = (0..w * h).filter(|&k| marked[k]).collect();
    let mut free = vec![false; w * h];
    grown(&all, w, h, 1).into_iter().for_each(|k| free[k] = true);
    let mut groups = Vec::new();
    for start in all {
        if !free[start] {
            continue;
        }
        free[start] = false;
        let (mut stack, mut group) = (vec![start], Vec::new());
        while let Some(k) = stack.pop() {
            if marked[k] {
                group.push(k);
            }
            for n in neighbours(k, w, h, 1) {
                if std::mem::take(&mut free[n]) {
                    stack.push(n);
                }
            }
        }
        groups.push(group);
    }
    groups
}

/// The pixels within a square of `reach` about each of a group, each once.
fn grown(group: &[usize], w: usize, h: usize, reach: usize) -> Vec<usize> {
    let mut all: Vec<usize> = group.iter().flat_map(|&k| neighbours(k, w, h, reach)).collect();
    all.sort_unstable();
    all.dedup();
    all
}

fn neighbours(k: usize, w: usize, h: usize, reach: usize) -> impl Iterator<Item = usize> {
    let (x, y) = (k % w, k / w);
    let (x1, y1) = ((x + reach + 1).min(w), (y + reach + 1).min(h));
    (y.saturating_sub(reach)..y1).flat_map(move |y| (x.saturating_sub(reach)..x1).map(move |x| y * w + x))
}
