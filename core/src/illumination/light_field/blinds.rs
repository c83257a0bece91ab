//! A window with slats: Venetian blinds before a light (figure 7.1).
//!
//! The window is a rectangle in an opaque wall: light passes through it or not at all. Slats are thin, flat and black, at equal
//! steps from one side of the window to the other, each turned about its own long axis.
//!
//! In a section across the slats, n outwards and v across them, slat k is the segment `k s + t (cos a, sin a)`, `|t| <= w / 2`, in
//! (n, v): s the spacing, w the width, a the tilt. A ray that crosses the window at height v with slope `m = dv / dn` meets it where
//! `t (sin a - m cos a) = v - k s`, so it is stopped when `|v - k s| <= w / 2 |sin a - m cos a|` for the nearest k. A ray passes or
//! does not: softness is the light's own, and of those who average over directions and places.

use super::Frame;
use crate::math::Vec3;

/// A window with slats or without.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Blinds {
    /// The middle of the window, and where it faces: into the room.
    frame: Frame,
    /// Half of its width and height.
    half: [f64; 2],
    slats: Option<Cut>,
}

/// What hangs in a window.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Slats {
    /// From one slat to the next, scene units.
    pub spacing: f64,
    /// Of a slat, across, scene units.
    pub width: f64,
    /// 0: slats lie across the window and are seen edge-on; 90 degrees: they lie in it. Positive: the outer edge is up, so that
    /// light from above comes in.
    pub tilt_rad: f64,
    /// Turns the direction of the slats in the window; 0 is level, 90 degrees upright, as vertical blinds.
    pub turn_rad: f64,
}

/// Slats with what a ray needs of them.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Cut {
    /// Across the slats, in the window.
    across: Vec3,
    spacing: f64,
    half_width: f64,
    sin: f64,
    cos: f64,
}

impl Slats {
    /// Strips in the plane of the window, with this share open between them.
    pub fn strips(spacing: f64, open: f64, turn_rad: f64) -> Self {
        Self { spacing, width: (1.0 - open) * spacing, tilt_rad: std::f64::consts::FRAC_PI_2, turn_rad }
    }
}

impl Blinds {
    /// A window of this width and height whose frame's axis points into the room; `None` of slats is an open window. There is a gap in the
    /// middle of it.
    pub fn new(frame: Frame, width: f64, height: f64, slats: Option<Slats>) -> Self {
        let cut = |slats: Slats| {
            let ((s, c), (sin, cos)) = (slats.turn_rad.sin_cos(), slats.tilt_rad.sin_cos());
            let across = frame.up * c + frame.right * s;
            Cut { across, spacing: slats.spacing, half_width: slats.width / 2.0, sin, cos }
        };
        Self { frame, half: [width / 2.0, height / 2.0], slats: slats.map(cut) }
    }

    /// Does light from `distance` away, in the direction `towards`, come to `at` through the window and between the slats? Light that
    /// does not cross the window's plane from outside does not come through it.
    pub fn pass(&self, at: &Vec3, towards: &Vec3, distance: f64) -> bool {
        let out = -towards.dot(&self.frame.axis);
        let to = self.frame.place - at;
        let inside = -to.dot(&self.frame.axis);
        // At the window itself, or beyond it, one is not in the room.
        if out <= 0.0 || inside <= 0.0 || inside >= distance * out {
            return false;
        }
        let crossing = towards * (inside / out) - to;
        let within =
            crossing.dot(&self.frame.right).abs() <= self.half[0] && crossing.dot(&self.frame.up).abs() <= self.half[1];
        within && self.slats.as_ref().is_none_or(|cut| cut.pass(&crossing, towards, out))
    }

    /// Is a light in this direction, that far from the origin, beyond the window's plane, and the origin before it?
    pub fn shades(&self, towards: &Vec3, distance: f64) -> bool {
        let out = -towards.dot(&self.frame.axis);
        let inside = -self.frame.place.dot(&self.frame.axis);
        out > 0.0 && inside > 0.0 && inside < distance * out
    }
}

impl Cut {
    fn pass(&self, crossing: &Vec3, towards: &Vec3, out: f64) -> bool {
        let slope = towards.dot(&self.across) / out;
        let reach = self.half_width * (self.sin - slope * self.cos).abs();
        // Slats lie half a step from the middle.
        let from_gap = (crossing.dot(&self.across) / self.spacing).rem_euclid(1.0);
        (from_gap - 0.5).abs() * self.spacing > reach
    }
}
