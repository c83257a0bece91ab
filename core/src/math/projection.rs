//! How the sphere of directions is laid onto a picture: lat-long, cube, mirror ball, and fisheyes.
//!
//! A [`Projection`] speaks of the unit square: (0, 0) is the top left corner of the picture (or of the square about a
//! round picture), (1, 1) the bottom right one. What each shows, in the stage frame:
//!
//! | projection | centre | right of it | who sees it so |
//! |---|---|---|---|
//! | lat-long, cube, fisheyes | +z | -x | an observer at the object, looking at the camera |
//! | mirror ball | +z | +x | the camera, looking at the ball |
//!
//! The centre of a mirror ball shows the camera, its rim what lies behind the ball (-z). Turned by half a circle about
//! +y the observer's pictures have -z in their middle and +x on the right.

use std::f64::consts::PI;

use super::{Vec3, latlong};

/// A parametrisation of the sphere.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Projection {
    /// Longitude and latitude, as [`latlong`] says.
    LatLong,
    /// OpenEXR's cube (`ImfEnvmap`, `ENVMAP_CUBE`): six square faces in a vertical strip, from the top +x, -x, +y, -y,
    /// +z, -z, each as seen from within, but with texel centres half a texel inside the face (OpenEXR puts the
    /// outermost ones on its edge).
    Cube,
    /// A perfectly reflecting ball; its outline is the circle inscribed in the square.
    Ball {
        /// From the pinhole to the ball's middle, in radii of the ball, more than 1; `None` of an infinitely far
        /// camera.
        distance: Option<f64>,
    },
    /// Equidistant fisheye: the angle from the axis grows in proportion to the radius. The angular map (Debevec 1998)
    /// is the one of 360 degrees.
    Equidistant {
        /// Field of view across the circle, radians, at most 2 pi.
        view_rad: f64,
    },
    /// Equisolid fisheye: equal areas of the picture are equal solid angles, radius = sin(angle / 2) up to scale.
    Equisolid {
        /// Field of view across the circle, radians, at most 2 pi.
        view_rad: f64,
    },
}

/// Direction of a face's normal, to the right of it and downwards, as seen from within.
type Face = [[f64; 3]; 3];

/// +x, -x, +y, -y, +z, -z, from `CubeMap::pixelPosition` of OpenEXR.
const FACES: [Face; 6] = [
    [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]],
    [[-1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, -1.0, 0.0]],
    [[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]],
    [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]],
    [[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]],
    [[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]],
];

impl Projection {
    /// The angular map: the whole sphere, angle in proportion to radius.
    pub const ANGULAR: Self = Self::Equidistant { view_rad: 2.0 * PI };

    /// Is the picture a disc in its square?
    pub fn is_round(&self) -> bool {
        !matches!(self, Self::LatLong | Self::Cube)
    }

    /// Height of the picture over its width.
    pub fn aspect(&self) -> f64 {
        match self {
            Self::LatLong => 0.5,
            Self::Cube => 6.0,
            _ => 1.0,
        }
    }

    /// The unit direction at (u, v); `None` outside the disc of a round picture, or outside the square.
    pub fn direction(&self, u: f64, v: f64) -> Option<Vec3> {
        if !((0.0..=1.0).contains(&u) && (0.0..=1.0).contains(&v)) {
            return None;
        }
        match self {
            Self::LatLong => Some(latlong::direction(u, v, 1, 1)),
            Self::Cube => {
                let face = (v * 6.0).min(5.0).floor();
                Some(face_direction(face as usize, u, v * 6.0 - face))
            }
            _ => {
                let (x, y) = (2.0 * u - 1.0, 1.0 - 2.0 * v);
                let r = x.hypot(y);
                let theta = self.angle_at(r)?;
                let (across, along) = theta.sin_cos();
                let (x, y) = if r > 0.0 { (x / r, y / r) } else { (0.0, 0.0) };
                Some(Vec3::new(self.side() * x * across, y * across, along))
            }
        }
    }

    /// Where a unit direction lies; `None` where the picture does not show it. Inverse of [`Self::direction`].
    pub fn coordinates(&self, direction: &Vec3) -> Option<(f64, f64)> {
        match self {
            Self::LatLong => Some(latlong::coordinates(direction, 1, 1)),
            Self::Cube => {
                let (face, a, b) = face_coordinates(direction);
                Some((a, (face as f64 + b) / 6.0))
            }
            _ => {
                let across = direction.x.hypot(direction.y);
                let r = self.radius_at(across.atan2(direction.z))?;
                let (x, y) = if across > 0.0 { (direction.x / across, direction.y / across) } else { (1.0, 0.0) };
                Some((0.5 + 0.5 * r * self.side() * x, 0.5 - 0.5 * r * y))
            }
        }
    }

    /// Solid angle per unit of the square's area at (u, v), steradians; 0 outside the disc.
    pub fn density(&self, u: f64, v: f64) -> f64 {
        match self {
            Self::LatLong => 2.0 * PI * PI * (PI * (0.5 - v)).cos().max(0.0),
            Self::Cube => {
                let (a, b) = (2.0 * u - 1.0, 2.0 * (v * 6.0).fract() - 1.0);
                // A face has area 1/6 of the square here, and 4 at distance 1 of the object.
                24.0 * (1.0 + a * a + b * b).powf(-1.5)
            }
            _ => {
                let r = (2.0 * u - 1.0).hypot(1.0 - 2.0 * v).max(1e-9);
                let Some(theta) = self.angle_at(r) else { return 0.0 };
                // sin(theta) dtheta dphi over r dr dphi; the square has area 4 in units of the radius.
                4.0 * theta.sin() * self.slope_at(r) / r
            }
        }
    }

    /// The largest angle from the centre that the picture shows, radians.
    pub fn reach_rad(&self) -> f64 {
        match self {
            Self::Ball { distance: Some(d) } => PI - (1.0 / d).asin(),
            Self::Equidistant { view_rad } | Self::Equisolid { view_rad } => 0.5 * view_rad,
            _ => PI,
        }
    }

    /// The angle from +z of the direction that a round picture shows at radius 0..1 of its circle; `None` beyond, and
    /// of other pictures.
    pub fn angle_at(&self, r: f64) -> Option<f64> {
        if r > 1.0 {
            return None;
        }
        Some(match self {
            Self::Ball { distance: None } => 2.0 * r.asin(),
            Self::Ball { distance: Some(d) } => {
                // The ray leaves the pinhole at angle a and meets the ball where its normal has the angle b from +z:
                // sin(a + b) = d sin a; reflection sends it to 2 b + a.
                let a = (r * (1.0 / d).asin().tan()).atan();
                let b = (d * a.sin()).min(1.0).asin() - a;
                2.0 * b + a
            }
            Self::Equidistant { view_rad } => 0.5 * view_rad * r,
            Self::Equisolid { view_rad } => 2.0 * (r * (0.25 * view_rad).sin()).min(1.0).asin(),
            Self::LatLong | Self::Cube => return None,
        })
    }

    /// Inverse of [`Self::angle_at`].
    fn radius_at(&self, theta: f64) -> Option<f64> {
        if theta > self.reach_rad() + 1e-12 {
            return None;
        }
        Some(match self {
            Self::Ball { distance: None } => (0.5 * theta).sin(),
            Self::Ball { distance: Some(d) } => {
                // theta(b) = 2 b + a(b) with tan a = sin b / (d - cos b) is smooth and rises with slope between 2 and 2
                // + 1/(d-1): Newton from the far camera's b = theta / 2 converges in a few steps.
                let mut b = 0.5 * theta;
                for _ in 0..20 {
                    let a = b.sin().atan2(d - b.cos());
                    let slope = 2.0 + (d * b.cos() - 1.0) / (d * d - 2.0 * d * b.cos() + 1.0);
                    let step = (2.0 * b + a - theta) / slope;
                    b = (b - step).clamp(0.0, (1.0 / d).acos());
                    if step.abs() < 1e-13 {
                        break;
                    }
                }
                let a = b.sin().atan2(d - b.cos());
                (a.tan() / (1.0 / d).asin().tan()).min(1.0)
            }
            Self::Equidistant { view_rad } => (theta / (0.5 * view_rad)).min(1.0),
            Self::Equisolid { view_rad } => ((0.5 * theta).sin() / (0.25 * view_rad).sin()).min(1.0),
            Self::LatLong | Self::Cube => return None,
        })
    }

    /// d angle / d radius.
    fn slope_at(&self, r: f64) -> f64 {
        match self {
            Self::Ball { distance: None } => 2.0 / (1.0 - r * r).max(1e-12).sqrt(),
            Self::Ball { distance: Some(d) } => {
                let t = (1.0 / d).asin().tan();
                let a = (r * t).atan();
                let da = t / (1.0 + (r * t).powi(2));
                let db = d * a.cos() / (1.0 - (d * a.sin()).powi(2)).max(1e-12).sqrt() - 1.0;
                (2.0 * db + 1.0) * da
            }
            Self::Equidistant { view_rad } => 0.5 * view_rad,
            Self::Equisolid { view_rad } => {
                let s = (0.25 * view_rad).sin();
                2.0 * s / (1.0 - (r * s).powi(2)).max(1e-12).sqrt()
            }
            Self::LatLong | Self::Cube => 0.0,
        }
    }

    /// +1 where +x lies right of the centre, -1 where it lies left.
    fn side(&self) -> f64 {
        if matches!(self, Self::Ball { .. }) { 1.0 } else { -1.0 }
    }
}

/// The unit direction through a point of a cube's face; (0, 0) is the face's top left corner, (1, 1) its bottom right,
/// and points beyond lie in the plane of the face.
pub fn face_direction(face: usize, a: f64, b: f64) -> Vec3 {
    let [forward, right, down] = FACES[face.min(5)].map(Vec3::from);
    (forward + right * (2.0 * a - 1.0) + down * (2.0 * b - 1.0)).normalize()
}

/// The face (0..6) that a direction passes through, and where.
pub fn face_coordinates(direction: &Vec3) -> (usize, f64, f64) {
    let axis = direction.iamax();
    let face = 2 * axis + usize::from(direction[axis] < 0.0);
    let [forward, right, down] = FACES[face].map(Vec3::from);
    let depth = direction.dot(&forward);
    let place = |along: Vec3| (0.5 + 0.5 * direction.dot(&along) / depth).clamp(0.0, 1.0);
    (face, place(right), place(down))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn all() -> Vec<Projection> {
        vec![
            Projection::LatLong,
            Projection::Cube,
            Projection::Ball { distance: None },
            Projection::Ball { distance: Some(1.5) },
            Projection::Ball { distance: Some(12.0) },
            Projection::ANGULAR,
            Projection::Equidistant { view_rad: PI },
            Projection::Equisolid { view_rad: 1.1 * PI },
            Projection::Equisolid { view_rad: 2.0 * PI },
        ]
    }

    #[test]
    fn coordinates_invert_direction() {
        for projection in all() {
            let mut seen = 0;
            for k in 0..2000 {
                let (u, v) = ((k as f64 * 0.618_034).fract(), (k as f64 + 0.5) / 2000.0);
                let Some(d) = projection.direction(u, v) else { continue };
                seen += 1;
                assert!((d.norm() - 1.0).abs() < 1e-12);
                let (u2, v2) = projection.coordinates(&d).unwrap();
                // At the rim of a ball the angle changes fast: radii are known less well than angles.
                assert!(
                    (u - u2).abs() < 1e-7 && (v - v2).abs() < 1e-7,
                    "{projection:?}: ({u}, {v}) became ({u2}, {v2})"
                );
            }
            assert!(seen > 1500 - 500 * usize::from(projection.is_round()));
        }
    }

    #[test]
    fn the_density_sums_to_the_solid_angle_shown() {
        for projection in all() {
            let n = 300;
            let sum: f64 = (0..n * n)
                .map(|k| projection.density(((k % n) as f64 + 0.5) / n as f64, ((k / n) as f64 + 0.5) / n as f64))
                .sum();
            let expected = 2.0 * PI * (1.0 - projection.reach_rad().cos());
            let found = sum / (n * n) as f64;
            // The rim of the far camera's ball holds a cusp; the sum of a disc by squares errs by 1 / n.
            assert!((found / expected - 1.0).abs() < 6e-3, "{projection:?}: {found} is not {expected}");
        }
    }

    #[test]
    fn a_ball_shows_what_reflection_says() {
        for distance in [None, Some(1.7), Some(30.0)] {
            let ball = Projection::Ball { distance };
            for (x, y) in [(0.3, 0.4), (-0.7, 0.1), (0.0, -0.95), (0.6, 0.79)] {
                // From scratch: a ray of the camera, the nearer point where it meets the unit ball, the mirror law.
                let (origin, flight) = match distance {
                    None => (Vec3::new(x, y, 5.0), -Vec3::z()),
                    Some(d) => {
                        let t = (1.0f64 / d).asin().tan();
                        (Vec3::new(0.0, 0.0, d), Vec3::new(x * t, y * t, -1.0).normalize())
                    }
                };
                let along = -origin.dot(&flight);
                let normal = origin + flight * (along - (along * along - origin.norm_squared() + 1.0).sqrt());
                let expected = flight - normal * (2.0 * flight.dot(&normal));
                let found = ball.direction(0.5 + 0.5 * x, 0.5 - 0.5 * y).unwrap();
                assert!((found - expected).norm() < 1e-9, "{distance:?} ({x}, {y}): {found} is not {expected}");
            }
        }
    }

    #[test]
    fn handedness() {
        let close = |p: Projection, u: f64, v: f64, expected: Vec3| {
            let found = p.direction(u, v).unwrap();
            assert!((found - expected).norm() < 1e-6, "{p:?} at ({u}, {v}): {found}");
        };
        let side = 0.5 + 0.5 * 0.25f64.sqrt() * 2f64.sqrt();
        close(Projection::Ball { distance: None }, 0.5, 0.5, Vec3::z());
        close(Projection::Ball { distance: None }, side, 0.5, Vec3::x());
        close(Projection::Ball { distance: None }, 0.5, 1.0 - side, Vec3::y());
        close(Projection::ANGULAR, 0.25, 0.5, Vec3::x());
        close(Projection::ANGULAR, 0.5, 0.25, Vec3::y());
        close(Projection::Equisolid { view_rad: PI }, 1.0, 0.5, -Vec3::x());
        close(Projection::LatLong, 0.25, 0.5, Vec3::x());
        for (face, axis) in [Vec3::x(), -Vec3::x(), Vec3::y(), -Vec3::y(), Vec3::z(), -Vec3::z()].iter().enumerate() {
            close(Projection::Cube, 0.5, (face as f64 + 0.5) / 6.0, *axis);
        }
        // Right in the +x face is +z; the lower edge of +y touches the upper edge of -z.
        assert!(face_direction(0, 0.9, 0.5).z > 0.3);
        assert!((face_direction(2, 0.3, 1.0) - face_direction(5, 0.3, 0.0)).norm() < 1e-12);
    }

    #[test]
    fn what_is_not_shown_has_no_place() {
        assert!(Projection::Equidistant { view_rad: PI }.coordinates(&Vec3::new(0.0, 0.6, -0.8)).is_none());
        assert!(Projection::Ball { distance: Some(3.0) }.coordinates(&-Vec3::z()).is_none());
        assert!(Projection::Ball { distance: None }.direction(0.01, 0.01).is_none());
        assert!(Projection::LatLong.direction(1.2, 0.5).is_none());
    }
}
