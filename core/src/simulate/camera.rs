//! The pinhole camera of the stage: on +z, looking at the origin, +x right and +y up.

use crate::error::{Error, Result};

use super::V3;
use super::shape::Ray;

/// A pinhole on the +z axis with square pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Camera {
    /// Columns of the picture.
    pub width: usize,
    /// Rows of the picture.
    pub height: usize,
    /// From the origin to the pinhole, scene units.
    pub distance: f32,
    /// Vertical field of view, radians.
    pub view_rad: f32,
}

impl Camera {
    /// The view of [`Scene::demo`](super::Scene::demo).
    pub fn demo(width: usize, height: usize) -> Self {
        Self { width, height, distance: 6.5, view_rad: 22f32.to_radians() }
    }

    /// Checks the figures; ask once, where they come in.
    ///
    /// # Errors
    /// [`Error::Invalid`] at `place`: no pixels or more than 2^28, a distance or a view that no camera has.
    pub fn check(&self, place: &str) -> Result<()> {
        let refuse = |field: &str, found: String, expected: &str| {
            Err(Error::invalid(format!("{place}, {field}"), found, expected))
        };
        if !self.width.checked_mul(self.height).is_some_and(|pixels| (1..=1 << 28).contains(&pixels)) {
            return refuse("picture", format!("{} x {}", self.width, self.height), "1 to 268435456 pixels");
        }
        if !(self.distance.is_finite() && self.distance > 0.0) {
            return refuse("distance", self.distance.to_string(), "a number above 0");
        }
        if !(self.view_rad > 0.0 && self.view_rad < 3.0) {
            let found = format!("{:.3} degrees", self.view_rad.to_degrees());
            return refuse("view", found, "more than 0 and less than 171 degrees");
        }
        Ok(())
    }

    /// The ray through continuous picture coordinates: (0, 0) is the top left corner, pixel centres lie at +0.5.
    pub(super) fn ray(&self, x: f32, y: f32) -> Ray {
        let scale = 2.0 * (0.5 * self.view_rad).tan() / self.height as f32;
        let right = (x - 0.5 * self.width as f32) * scale;
        let up = (0.5 * self.height as f32 - y) * scale;
        Ray { origin: V3::new(0.0, 0.0, self.distance), direction: V3::new(right, up, -1.0).normalize() }
    }

    /// From the pinhole to the picture, in pixels.
    pub fn focal_px(&self) -> f64 {
        0.5 * self.height as f64 / (0.5 * f64::from(self.view_rad)).tan()
    }

    /// Where a point before the camera appears, in pixels: the inverse of the ray through a pixel.
    pub fn project(&self, point: &V3) -> [f64; 2] {
        let p = point.cast::<f64>();
        let scale = self.focal_px() / (f64::from(self.distance) - p.z);
        [0.5 * self.width as f64 + p.x * scale, 0.5 * self.height as f64 - p.y * scale]
    }
}
