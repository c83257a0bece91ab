//! Shapes -> directions and solid angles that sum to the shape's exactly.

use std::f64::consts::{PI, TAU};

use super::Aim;
use crate::math::Vec3;

/// Beams of a stage's lamps lie about this far apart: half a degree, a sixth of the cells of a dome of 2560 lamps.
pub const SPACING_RAD: f64 = 0.5 * PI / 180.0;
/// Beams of one shape at most. A whole hemisphere then has 0.8 degrees between beams, 12 of them in a cell of 2560 lamps.
const MOST: f64 = 32768.0;

/// A direction that stands for a small solid angle.
#[derive(Debug, Clone, Copy)]
pub struct Patch {
    /// Unit vector.
    pub direction: Vec3,
    /// What it stands for.
    pub steradians: f64,
}

/// What lies between two angles from a direction, in patches of equal solid angle: a spherical Fibonacci lattice
/// (Gonzalez 2010), equal steps of the cosine and golden angles about the axis. The golden ratio is the number that
/// fractions meet worst, so the points stay well apart however narrow the annulus is.
pub fn annulus(aim: &Aim, inner_rad: f64, outer_rad: f64, spacing_rad: f64) -> Vec<Patch> {
    let golden = PI * (3.0 - 5f64.sqrt());
    let (axis, right) = (aim.direction(), aim.right());
    let up = axis.cross(&right);
    // cos a - cos b as a product keeps its digits when both angles are small.
    let height = 2.0 * ((outer_rad + inner_rad) / 2.0).sin() * ((outer_rad - inner_rad) / 2.0).sin();
    let solid_angle = TAU * height;
    let count = (solid_angle / spacing_rad.powi(2)).ceil().clamp(1.0, MOST);
    let patch = |i: usize| {
        let below = inner_rad.cos() - height * (i as f64 + 0.5) / count;
        let (sin, (s, c)) = ((1.0 - below * below).max(0.0).sqrt(), (golden * i as f64).sin_cos());
        let direction = axis * below + (right * c + up * s) * sin;
        Patch { direction: direction.normalize(), steradians: solid_angle / count }
    };
    (0..count as usize).map(patch).collect()
}

/// Unit vectors along the width and the height of a rectangle that faces the origin.
pub fn sides(aim: &Aim, turn_rad: f64) -> [Vec3; 2] {
    let (s, c) = turn_rad.sin_cos();
    let (level, rise) = (aim.right(), aim.direction().cross(&aim.right()));
    [level * c + rise * s, rise * c - level * s]
}

/// A rectangle at distance 1 that faces the origin, cut at equal steps of the angles `atan x` and `atan y`; a cell has its
/// exact solid angle.
///
/// The part of the plane between the foot of the perpendicular and the point (x, y) is seen under
/// `W(x, y) = atan(x y / sqrt(1 + x^2 + y^2))`, so a cell has `W(x1, y1) - W(x0, y1) - W(x1, y0) + W(x0, y0)`.
pub fn rectangle(aim: &Aim, turn_rad: f64, [width, height]: [f64; 2], spacing_rad: f64) -> Vec<Patch> {
    let axis = aim.direction();
    let [across, along] = sides(aim, turn_rad);
    let (half_x, half_y) = ((width / 2.0).atan(), (height / 2.0).atan());
    let coarser = (4.0 * half_x * half_y / spacing_rad.powi(2) / MOST).sqrt().max(1.0);
    let cuts = |half: f64| (2.0 * half / (spacing_rad * coarser)).ceil().max(1.0);
    let (columns, rows) = (cuts(half_x), cuts(half_y));
    let x = |i: f64| (half_x * (2.0 * i / columns - 1.0)).tan();
    let y = |j: f64| (half_y * (2.0 * j / rows - 1.0)).tan();
    let seen = |x: f64, y: f64| (x * y / (1.0 + x * x + y * y).sqrt()).atan();
    let mut patches = Vec::with_capacity((columns * rows) as usize);
    for j in (0..rows as usize).map(|j| j as f64) {
        for i in (0..columns as usize).map(|i| i as f64) {
            let (x0, x1, y0, y1) = (x(i), x(i + 1.0), y(j), y(j + 1.0));
            let steradians = seen(x1, y1) - seen(x0, y1) - seen(x1, y0) + seen(x0, y0);
            let middle = axis + across * x(i + 0.5) + along * y(j + 0.5);
            patches.push(Patch { direction: middle.normalize(), steradians: steradians.max(0.0) });
        }
    }
    patches
}
