//! Calibration targets before the virtual camera: a white ball, a white card, a colour chart. What a photograph of them shows
//! is known in closed form, so that what is recovered from it can be held against the truth.
//!
//! All are Lambert: radiance `rho / pi * E * max(n.l, 0)`, with `E` the irradiance that the lamp gives a patch facing it and
//! `l` the direction to it. The lamp is far away.

use std::f32::consts::PI;

use rayon::prelude::*;

use crate::illumination::probe::Circle;
use crate::image::Image;
use crate::math::Vec3;

use super::V3;
use super::camera::Camera;
use super::shape::Shape;

/// A far lamp.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FarLamp {
    /// Unit vector from the object to the lamp.
    pub direction: Vec3,
    /// Irradiance of a patch that faces it, RGB.
    pub irradiance: [f32; 3],
}

/// A Lambert ball in the origin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WhiteBall {
    /// Scene units.
    pub radius: f32,
    /// Reflectance, RGB.
    pub albedo: [f32; 3],
}

impl WhiteBall {
    /// Its light in the camera: radiance, black beside it.
    pub fn photograph(&self, camera: &Camera, lamp: &FarLamp) -> Image {
        let ball = Shape::Sphere { centre: V3::zeros(), radius: self.radius };
        let to_lamp: V3 = lamp.direction.cast();
        picture(camera, |x, y| {
            let ray = camera.ray(x, y);
            let cos = ball.hit(&ray).map(|t| ball.normal(&ray.at(t)).dot(&to_lamp).max(0.0))?;
            Some(std::array::from_fn(|c| self.albedo[c] / PI * lamp.irradiance[c] * cos))
        })
    }

    /// Its outline in the picture: on the camera's axis, so a circle.
    pub fn outline(&self, camera: &Camera) -> Circle {
        let (radius, distance) = (f64::from(self.radius), f64::from(camera.distance));
        // The tangent of the angle between the axis and a ray that grazes the ball.
        let tangent = radius / (distance * distance - radius * radius).sqrt();
        let (width, height) = (camera.width as f64, camera.height as f64);
        Circle { x: 0.5 * width, y: 0.5 * height, radius: tangent * camera.focal_px() }
    }
}

/// A flat Lambert card about the origin that faces the camera, of patches that touch; one patch makes it plain.
#[derive(Debug, Clone, PartialEq)]
pub struct Card {
    /// Half its width and height, scene units.
    pub half: [f32; 2],
    /// Columns and rows of patches.
    pub grid: (usize, usize),
    /// Reflectances, row by row from the top left; a patch without one is black.
    pub reflectances: Vec<[f32; 3]>,
}

impl Card {
    /// A plain card.
    pub fn plain(half: [f32; 2], albedo: [f32; 3]) -> Self {
        Self { half, grid: (1, 1), reflectances: vec![albedo] }
    }

    /// Its light in the camera: radiance, black beside it.
    pub fn photograph(&self, camera: &Camera, lamp: &FarLamp) -> Image {
        let facing = lamp.direction.z.max(0.0) as f32;
        let (columns, rows) = self.grid;
        picture(camera, |x, y| {
            let ray = camera.ray(x, y);
            let point = ray.at(-ray.origin.z / ray.direction.z);
            let (u, v) = (0.5 + 0.5 * point.x / self.half[0], 0.5 - 0.5 * point.y / self.half[1]);
            if !((0.0..1.0).contains(&u) && (0.0..1.0).contains(&v)) {
                return None;
            }
            let (i, j) = ((u * columns as f32) as usize, (v * rows as f32) as usize);
            let albedo =
                self.reflectances.get(j.min(rows.saturating_sub(1)) * columns + i.min(columns.saturating_sub(1)))?;
            Some(std::array::from_fn(|c| albedo[c] / PI * lamp.irradiance[c] * facing))
        })
    }

    /// The middle of a patch in the picture, pixels.
    pub fn middle(&self, camera: &Camera, column: usize, row: usize) -> [f64; 2] {
        let at = |k: usize, of: usize| (k as f32 + 0.5) / of as f32 * 2.0 - 1.0;
        let (x, y) = (at(column, self.grid.0) * self.half[0], -at(row, self.grid.1) * self.half[1]);
        camera.project(&V3::new(x, y, 0.0))
    }
}

/// Rays across a pixel: rims to 1/64.
const ACROSS: usize = 8;

/// Means over pixels of what rays see; nothing is black.
fn picture(camera: &Camera, seen: impl Fn(f32, f32) -> Option<[f32; 3]> + Sync) -> Image {
    let (width, height) = (camera.width, camera.height);
    let pixel = |at: usize| -> [f32; 3] {
        let sub = |k: usize| (k as f32 + 0.5) / ACROSS as f32;
        let mut sum = [0.0; 3];
        for k in 0..ACROSS * ACROSS {
            let (x, y) = ((at % width) as f32 + sub(k % ACROSS), (at / width) as f32 + sub(k / ACROSS));
            let light = seen(x, y).unwrap_or_default();
            sum.iter_mut().zip(light).for_each(|(s, l)| *s += l);
        }
        sum.map(|s| s / (ACROSS * ACROSS) as f32)
    };
    let pixels: Vec<[f32; 3]> = (0..width * height).into_par_iter().map(pixel).collect();
    Image::from_fn(width, height, |x, y| pixels[y * width + x])
}

#[cfg(test)]
mod tests {
    use super::*;

    const CAMERA: Camera = Camera { width: 96, height: 72, distance: 6.5, view_rad: 0.384 };

    #[test]
    fn a_ball_facing_its_lamp_shows_the_cosine_inside_its_outline() {
        let ball = WhiteBall { radius: 0.9, albedo: [0.8, 0.6, 0.9] };
        let lamp = FarLamp { direction: Vec3::z(), irradiance: [PI, 2.0 * PI, 0.5 * PI] };
        let picture = ball.photograph(&CAMERA, &lamp);
        let middle = picture.pixel(48, 36);
        assert!(middle.iter().zip([0.8, 1.2, 0.45]).all(|(a, b)| (a - b).abs() < 2e-3), "{middle:?}");
        let outline = ball.outline(&CAMERA);
        let covered = picture.data().iter().step_by(3).filter(|v| **v > 0.0).count() as f64;
        let area = std::f64::consts::PI * outline.radius.powi(2);
        // Every pixel that the rim crosses counts as covered here: half a pixel more about the circle.
        let wider = std::f64::consts::PI * (outline.radius + 0.5).powi(2);
        assert!(covered > area && covered < wider + 0.02 * area, "{covered} pixels, outline of {area}");
        for (x, y) in [(30, 36), (48, 20), (60, 45)] {
            // An independent way to the normal: a far camera's, corrected by the distance.
            let ray = CAMERA.ray(x as f32 + 0.5, y as f32 + 0.5);
            let b = ray.direction.dot(&ray.origin);
            let t = -b - (b * b - ray.origin.norm_squared() + 0.81).sqrt();
            let cos = ray.at(t).z / 0.9;
            assert!((picture.pixel(x, y)[0] - 0.8 * cos).abs() < 3e-3);
        }
    }

    #[test]
    fn light_from_the_right_lights_the_right_and_from_above_the_top() {
        let ball = WhiteBall { radius: 0.9, albedo: [1.0; 3] };
        let lit = |x: f64, y: f64| {
            let direction = Vec3::new(x, y, 0.2).normalize();
            ball.photograph(&CAMERA, &FarLamp { direction, irradiance: [1.0; 3] })
        };
        let (right, above) = (lit(1.0, 0.0), lit(0.0, 1.0));
        assert!(right.pixel(60, 36)[0] > 3.0 * right.pixel(36, 36)[0]);
        assert!(above.pixel(48, 24)[0] > 3.0 * above.pixel(48, 48)[0]);
        let back = FarLamp { direction: -Vec3::z(), irradiance: [1.0; 3] };
        assert_eq!(ball.photograph(&CAMERA, &back).data().iter().copied().fold(0.0, f32::max), 0.0);
    }

    #[test]
    fn a_chart_photographed_by_a_strange_camera_is_understood() {
        let chart =
            Card { half: [0.9, 0.6], grid: (6, 4), reflectances: crate::calibrate::chart::reflectances().to_vec() };
        let lamp = FarLamp { direction: Vec3::new(0.6, 0.0, 0.8), irradiance: [2.0, 3.0, 1.0] };
        let picture = chart.photograph(&CAMERA, &lamp);
        let corners = [(0, 0), (5, 0), (5, 3), (0, 3)].map(|(column, row)| {
            let [x, y] = chart.middle(&CAMERA, column, row);
            crate::calibrate::chart::Point { x, y }
        });
        let fit = crate::calibrate::chart::fit(&picture, corners, "chart").unwrap();
        assert!(fit.worst().1 < 0.5, "{:?}", fit.worst());
        // Radiance of the white patch, by hand.
        let [x, y] = chart.middle(&CAMERA, 0, 3);
        let white = chart.reflectances[18][1] / PI * 3.0 * 0.8;
        assert!((picture.pixel(x as usize, y as usize)[1] / white - 1.0).abs() < 1e-3);
        assert_eq!(picture.pixel(0, 0), [0.0; 3]);
    }

    #[test]
    fn points_project_to_the_pixels_whose_rays_meet_them() {
        let camera = Camera { distance: 4.0, ..CAMERA };
        for (x, y) in [(3.5, 70.2), (48.0, 36.0), (90.1, 10.7)] {
            let [u, v] = camera.project(&camera.ray(x, y).at(3.1));
            assert!((u - f64::from(x)).abs() < 1e-3 && (v - f64::from(y)).abs() < 1e-3, "{u}, {v}");
        }
    }
}
