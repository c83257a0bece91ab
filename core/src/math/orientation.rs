//! How the light is turned: heading, pitch and roll.

use super::{Mat3, Vec3};

/// Three angles in degrees, each right-handed about its axis of the stage frame, applied roll first and heading last:
/// `R = R_y(heading) R_x(pitch) R_z(roll)`.
///
/// What is seen from the camera: a positive heading carries light from the camera to the right of the picture; a positive
/// pitch carries light from the top towards the camera, and from the camera to the bottom; a positive roll carries light from the
/// right to the top, counter-clockwise. Roll is about the camera's own axis only while heading and pitch are zero.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Orientation {
    /// About +y.
    pub heading_deg: f64,
    /// About +x.
    pub pitch_deg: f64,
    /// About +z.
    pub roll_deg: f64,
}

impl Orientation {
    /// Is it a turn about the vertical axis alone?
    pub fn is_heading(&self) -> bool {
        self.pitch_deg == 0.0 && self.roll_deg == 0.0
    }

    /// The rotation matrix.
    pub fn matrix(&self) -> Mat3 {
        let about = |axis, angle_deg: f64| nalgebra::Rotation3::from_axis_angle(&axis, angle_deg.to_radians());
        let (x, y, z) = (Vec3::x_axis(), Vec3::y_axis(), Vec3::z_axis());
        (about(y, self.heading_deg) * about(x, self.pitch_deg) * about(z, self.roll_deg)).into_inner()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::rotate_heading;

    #[test]
    fn each_angle_turns_as_it_says() {
        let turn = |heading_deg, pitch_deg, roll_deg| Orientation { heading_deg, pitch_deg, roll_deg }.matrix();
        let close = |a: Vec3, b: Vec3| assert!((a - b).norm() < 1e-12, "{a} is not {b}");
        close(turn(90.0, 0.0, 0.0) * Vec3::z(), Vec3::x());
        close(turn(0.0, 90.0, 0.0) * Vec3::y(), Vec3::z());
        close(turn(0.0, 90.0, 0.0) * Vec3::z(), -Vec3::y());
        close(turn(0.0, 0.0, 90.0) * Vec3::x(), Vec3::y());
        // Roll carries x to y, pitch y to z, heading z to x.
        close(turn(90.0, 90.0, 90.0) * Vec3::x(), Vec3::x());
        let d = Vec3::new(0.2, -0.3, 0.7);
        close(turn(31.0, 0.0, 0.0) * d, rotate_heading(&d, f64::to_radians(31.0)));
    }
}
