//! A ball as a camera sees it: which way light came that is seen at a pixel of it.
//!
//! The frame is the stage's: +x right and +y up in the picture, +z towards the camera. The camera looks along -z
//! through the middle of the picture.

use crate::error::{Error, Result};
use crate::illumination::probe::Circle;
use crate::math::Vec3;

/// How the camera projects.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Lens {
    /// Parallel rays: a long lens far away.
    Far,
    /// A pinhole.
    Pinhole {
        /// From the pinhole to the picture, in pixels.
        focal_px: f64,
        /// Where the axis meets the picture, in pixels.
        centre: [f64; 2],
    },
}

impl Lens {
    /// A pinhole whose picture of `width` x `height` pixels spans `view_rad` from left to right.
    ///
    /// # Errors
    /// A view outside (0, pi).
    pub fn pinhole(width: usize, height: usize, view_rad: f64) -> Result<Self> {
        if !(view_rad > 0.0 && view_rad < std::f64::consts::PI) {
            let found = format!("{:.3} degrees", view_rad.to_degrees());
            return Err(Error::invalid("field of view", found, "more than 0 and less than 180 degrees"));
        }
        let focal_px = 0.5 * width as f64 / (0.5 * view_rad).tan();
        Ok(Self::Pinhole { focal_px, centre: [0.5 * width as f64, 0.5 * height as f64] })
    }

    /// Direction of flight of the ray seen at a pixel.
    pub fn flight(&self, x: f64, y: f64) -> Vec3 {
        match self {
            Self::Far => -Vec3::z(),
            Self::Pinhole { focal_px, centre } => Vec3::new(x - centre[0], centre[1] - y, -focal_px).normalize(),
        }
    }
}

/// A reflecting ball in a photograph; lengths in its radii, from its middle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ball {
    circle: Circle,
    lens: Lens,
    /// From the pinhole to the ball's middle.
    middle: Vec3,
}

/// Where a ray leaves the ball, and which way.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reflected {
    /// Point of the surface, unit distance from the ball's middle; also the normal.
    pub normal: Vec3,
    /// Unit direction towards where the light comes from.
    pub direction: Vec3,
}

impl Ball {
    /// A ball with this outline. Of a pinhole's picture the outline is an ellipse, whose ends along the line through
    /// the axis are taken to be the circle's: its middle, seen from the pinhole, halves the angle between the two.
    pub fn new(circle: Circle, lens: Lens) -> Self {
        let middle = match lens {
            Lens::Far => Vec3::zeros(),
            Lens::Pinhole { centre, .. } => {
                let (dx, dy) = (circle.x - centre[0], circle.y - centre[1]);
                let off = dx.hypot(dy);
                let (ux, uy) = if off > 1e-9 { (dx / off, dy / off) } else { (1.0, 0.0) };
                let end =
                    |side: f64| lens.flight(circle.x + side * circle.radius * ux, circle.y + side * circle.radius * uy);
                let (near, far) = (end(-1.0), end(1.0));
                // Half the angle between tangents to a unit ball has the sine 1 / distance; the chord is twice the
                // sine.
                (near + far).normalize() * (2.0 / (near - far).norm())
            }
        };
        Self { circle, lens, middle }
    }

    /// The outline.
    pub fn circle(&self) -> Circle {
        self.circle
    }

    /// From the pinhole to the ball's middle, in its radii; `None` of a far camera.
    pub fn from_pinhole(&self) -> Option<Vec3> {
        (self.lens != Lens::Far).then_some(self.middle)
    }

    /// The mirror's law at a pixel; `None` beside the ball.
    pub fn reflect(&self, x: f64, y: f64) -> Option<Reflected> {
        let flight = self.lens.flight(x, y);
        let normal = match self.lens {
            Lens::Far => {
                let (u, v) = ((x - self.circle.x) / self.circle.radius, (self.circle.y - y) / self.circle.radius);
                let depth2 = 1.0 - u * u - v * v;
                (depth2 >= 0.0).then(|| Vec3::new(u, v, depth2.sqrt()))?
            }
            Lens::Pinhole { .. } => {
                let along = flight.dot(&self.middle);
                let room = 1.0 - (self.middle - flight * along).norm_squared();
                (room >= 0.0).then(|| flight * (along - room.sqrt()) - self.middle)?
            }
        };
        Some(Reflected { normal, direction: flight - normal * (2.0 * flight.dot(&normal)) })
    }

    /// How far a pixel is from the middle of the outline, in radii.
    pub fn radius_at(&self, x: f64, y: f64) -> f64 {
        (x - self.circle.x).hypot(y - self.circle.y) / self.circle.radius
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::projection::Projection;

    #[test]
    fn a_ball_on_the_axis_is_the_mirror_ball_projection() {
        let circle = Circle { x: 320.0, y: 240.0, radius: 100.0 };
        let lens = Lens::pinhole(640, 480, 0.5).unwrap();
        let Lens::Pinhole { focal_px, .. } = lens else { panic!("a pinhole") };
        let distance = 1.0 / (100.0 / focal_px).atan().sin();
        for (lens, projection) in
            [(Lens::Far, Projection::Ball { distance: None }), (lens, Projection::Ball { distance: Some(distance) })]
        {
            let ball = Ball::new(circle, lens);
            for (x, y) in [(320.0, 240.0), (350.0, 200.0), (250.0, 300.0), (418.0, 241.0)] {
                let expected = projection.direction((x - 220.0) / 200.0, (y - 140.0) / 200.0).unwrap();
                let found = ball.reflect(x, y).unwrap().direction;
                assert!((found - expected).norm() < 1e-9, "{lens:?} ({x}, {y}): {found} is not {expected}");
            }
            assert!(ball.reflect(421.0, 240.0).is_none());
        }
    }

    #[test]
    fn a_ball_off_the_axis_has_its_middle_where_it_is() {
        let lens = Lens::pinhole(1000, 1000, 0.6).unwrap();
        let Lens::Pinhole { focal_px, .. } = lens else { panic!("a pinhole") };
        // In the plane of the axis the outline of a ball at 30 radii, 10 degrees off, spans 10 degrees +- asin(1 / 30).
        let (off, half) = (10f64.to_radians(), (1f64 / 30.0).asin());
        let (a, b) = (focal_px * (off - half).tan(), focal_px * (off + half).tan());
        let ball = Ball::new(Circle { x: 500.0 + 0.5 * (a + b), y: 500.0, radius: 0.5 * (b - a) }, lens);
        let expected = Vec3::new(off.sin(), 0.0, -off.cos()) * 30.0;
        assert!((ball.from_pinhole().unwrap() - expected).norm() < 1e-6);
    }

    #[test]
    fn views_must_be_angles() {
        assert!(Lens::pinhole(10, 10, 0.0).is_err() && Lens::pinhole(10, 10, 3.2).is_err());
    }
}
