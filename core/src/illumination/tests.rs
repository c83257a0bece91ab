//! Probes against the path tracer, which knows nothing of projections: it shoots rays at a mirror.

use std::f64::consts::{FRAC_PI_2, PI};

use super::EnvMap;
use super::probe::{self, Circle, Resampled, Target, View, to_env_map};
use crate::domain::{Axis, Coverage, Directions};
use crate::image::Image;
use crate::math::projection::Projection;
use crate::math::{Vec3, angle_between, latlong, rotate_heading};
use crate::simulate::{Camera, Material, Object, Quality, Scene, Shape, V3, truth};

const ORTHOGRAPHIC: Projection = Projection::Ball { distance: None };

fn resample(views: &[View], target: &Target) -> crate::Result<Resampled> {
    probe::resample(views, target, &mut |_, _| Ok(()))
}

/// Smooth surroundings without symmetry, and a lamp 8 degrees wide.
fn surroundings(width: usize) -> EnvMap {
    let lamp = Vec3::new(0.6, 0.5, -0.3).normalize();
    EnvMap::from_fn(width, width / 2, |d| {
        let glow = 6.0 / (1.0 + (-(d.dot(&lamp) - 4f64.to_radians().cos()) * 4000.0).exp());
        let waves = [0.9 * d.x + 0.3 * (5.0 * d.y).sin(), d.y * d.z, 0.7 * d.z + 0.2 * (4.0 * d.x).cos()];
        waves.map(|wave| (1.2 + 0.8 * wave + glow) as f32)
    })
}

/// A mirror ball of radius 1 photographed by the path tracer from `distance`, its outline `radius` pixels.
fn photograph(map: &EnvMap, distance: f32, side: usize, radius: f64, reflectance: f32) -> (Image, Circle) {
    let ball = Object {
        shape: Shape::Sphere { centre: V3::zeros(), radius: 1.0 },
        material: Material::Mirror { reflectance: [reflectance; 3] },
    };
    let outline = (1.0 / f64::from(distance)).asin().tan();
    let view_rad = (2.0 * (0.5 * side as f64 * outline / radius).atan()) as f32;
    let camera = Camera { width: side, height: side, distance, view_rad };
    let lamps = Directions::with_coverage(vec![Vec3::z()], Axis::Z, Coverage::Sphere).unwrap();
    let quality = Quality { samples: 16, ..Quality::default() };
    let scene = Scene { objects: vec![ball] };
    let mut pictures = truth(&scene, &camera, std::slice::from_ref(map), &lamps, &quality, &mut |_, _| Ok(())).unwrap();
    (pictures.remove(0), Circle { x: 0.5 * side as f64, y: 0.5 * side as f64, radius })
}

/// Relative error (L2, by solid angle) of a map against another where `counts`.
fn error(found: &EnvMap, truth: &EnvMap, counts: impl Fn(&Vec3) -> bool) -> f64 {
    let (w, h) = found.image().size();
    let (mut off, mut all) = (0.0, 0.0);
    for j in 0..h {
        for i in 0..w {
            let d = latlong::direction(i as f64 + 0.5, j as f64 + 0.5, w, h);
            if counts(&d) {
                for (a, b) in found.image().pixel(i, j).iter().zip(truth.image().pixel(i, j)) {
                    off += f64::from(a - b).powi(2) * latlong::texel_solid_angle(j, w, h);
                    all += f64::from(*b).powi(2) * latlong::texel_solid_angle(j, w, h);
                }
            }
        }
    }
    (off / all).sqrt()
}

/// Farther than this from -z a ball of 100 pixels' radius is not blind: its last three pixels hold the rest.
fn in_sight(d: &Vec3) -> bool {
    angle_between(d, &-Vec3::z()) > 2.0 * (2.0 * 0.03f64).sqrt()
}

#[test]
fn a_rendered_ball_gives_its_surroundings_back() {
    let map = surroundings(512);
    let expected = map.reduced(256);
    for (distance, projection) in [
        (300.0, ORTHOGRAPHIC),
        (300.0, Projection::Ball { distance: Some(300.0) }),
        (4.0, Projection::Ball { distance: Some(4.0) }),
    ] {
        let (picture, circle) = photograph(&map, distance, 320, 140.0, 1.0);
        let view = View::new(picture, projection, Some(circle), 0.0).unwrap();
        let found = to_env_map(&[view], 256).unwrap();
        let reach = PI - projection.reach_rad();
        let off = error(&found, &expected, |d| in_sight(d) && angle_between(d, &-Vec3::z()) > reach + 0.25);
        assert!(off < 0.03, "camera at {distance}, {projection:?}: error {off}");
    }
}

#[test]
fn a_near_camera_read_as_a_far_one_is_wrong() {
    // The distance matters: without it a ball seen from 4 radii errs by degrees.
    let map = surroundings(256);
    let (picture, circle) = photograph(&map, 4.0, 200, 90.0, 1.0);
    let found = to_env_map(&[View::new(picture, ORTHOGRAPHIC, Some(circle), 0.0).unwrap()], 128).unwrap();
    assert!(error(&found, &map.reduced(128), in_sight) > 0.1);
}

#[test]
fn two_views_make_the_camera_and_the_blind_spot_vanish() {
    let map = surroundings(512);
    // The second camera stands on +x: for it the surroundings are turned the other way.
    let second = EnvMap::from_fn(512, 256, |d| map.radiance(&rotate_heading(d, FRAC_PI_2)));
    let shot = |surroundings: &EnvMap| {
        // A black camera, 8 degrees wide in half, in front of each.
        let cone = 8f64.to_radians();
        let with_camera = EnvMap::from_fn(512, 256, |d| {
            if angle_between(d, &Vec3::z()) < cone { [0.0; 3] } else { surroundings.radiance(d) }
        });
        photograph(&with_camera, 300.0, 240, 110.0, 0.8)
    };
    let view = |(picture, circle): (Image, Circle), heading: f64| {
        let brighter = Image::from_fn(240, 240, |x, y| std::array::from_fn(|c| picture.pixel(x, y)[c] / 0.8));
        View::new(brighter, ORTHOGRAPHIC, Some(circle), heading).unwrap().hiding_camera(10f64.to_radians())
    };
    let views = [view(shot(&map), 0.0), view(shot(&second), FRAC_PI_2)];
    let expected = map.reduced(192);
    let everywhere = error(&to_env_map(&views, 192).unwrap(), &expected, |_| true);
    let alone = error(&to_env_map(&views[..1], 192).unwrap(), &expected, |_| true);
    assert!(everywhere < 0.03 && alone > 0.05, "two views {everywhere}, one {alone}");
}

#[test]
fn a_constant_stays_constant_in_every_projection() {
    let views = [
        (ORTHOGRAPHIC, 1),
        (Projection::Ball { distance: Some(5.0) }, 1),
        (Projection::ANGULAR, 1),
        (Projection::Equisolid { view_rad: PI }, 1),
        (Projection::LatLong, 1),
        (Projection::Cube, 6),
    ];
    for (from, tall) in views {
        let view = View::new(Image::from_fn(40, 40 * tall, |_, _| [0.25, 1.0, 7.0]), from, None, 0.3).unwrap();
        for (to, _) in views {
            let Resampled { image, seen } =
                resample(std::slice::from_ref(&view), &Target { projection: to, width: 24, heading_rad: 1.0 }).unwrap();
            let pixel = image.pixel(12, image.height() / 2);
            if from.reach_rad() > 3.0 {
                assert!((pixel[2] - 7.0).abs() < 1e-5, "{from:?} to {to:?}: {pixel:?}");
            }
            let all = if from == (Projection::Equisolid { view_rad: PI }) { seen < 0.99 } else { seen > 0.999 };
            assert!(all || to == from, "{from:?} to {to:?}: saw {seen}");
        }
    }
}

/// Any to any and back: what is left is what the coarser picture could not hold.
#[test]
fn maps_survive_every_projection() {
    let map = surroundings(256);
    let view = View::new(map.image().clone(), Projection::LatLong, None, 0.0).unwrap();
    let targets = [
        (ORTHOGRAPHIC, 256),
        (Projection::ANGULAR, 320),
        (Projection::Cube, 80),
        (Projection::Equisolid { view_rad: 2.0 * PI }, 256),
    ];
    for (projection, width) in targets {
        let there = resample(std::slice::from_ref(&view), &Target { projection, width, heading_rad: 0.7 }).unwrap();
        let back = View::new(there.image, projection, None, 0.7).unwrap();
        let off = error(&to_env_map(&[back], 256).unwrap(), &map, in_sight);
        assert!(off < 0.03, "{projection:?}: error {off}");
    }
}

/// Away from the last two pixels at the rim of a ball, where a pixel's worth of interpolation is half the light.
#[test]
fn a_single_bright_texel_keeps_its_energy() {
    for sun in [(150, 20), (25, 50), (128, 64)] {
        let map =
            EnvMap::new(Image::from_fn(256, 128, |i, j| if (i, j) == sun { [1e4; 3] } else { [0.0; 3] })).unwrap();
        let view = View::new(map.image().clone(), Projection::LatLong, None, 0.0).unwrap();
        let power = |map: &EnvMap| -> f64 {
            let row = |j: usize| map.image().row(j).iter().step_by(3).map(|v| f64::from(*v)).sum::<f64>();
            (0..128).map(|j| row(j) * latlong::texel_solid_angle(j, 256, 128)).sum()
        };
        for projection in [ORTHOGRAPHIC, Projection::ANGULAR, Projection::Cube] {
            let width = if projection == Projection::Cube { 64 } else { 256 };
            let there = resample(std::slice::from_ref(&view), &Target { projection, width, heading_rad: 0.0 }).unwrap();
            let back = to_env_map(&[View::new(there.image, projection, None, 0.0).unwrap()], 256).unwrap();
            let ratio = power(&back) / power(&map);
            // A tent one pixel wide sampled at 1/3 of it errs by 2 sinc^2(3.5) = 1.7 % at worst, on each axis.
            assert!((ratio - 1.0).abs() < 0.034, "{projection:?}, sun at {sun:?}: {ratio} of its power");
        }
    }
}

#[test]
fn balls_outside_the_picture_are_refused() {
    let image = Image::new(100, 80, 3);
    for circle in [
        Circle { x: 20.0, y: 40.0, radius: 30.0 },
        Circle { x: 150.0, y: 40.0, radius: 10.0 },
        Circle { x: 50.0, y: 40.0, radius: f64::NAN },
        Circle { x: 50.0, y: 40.0, radius: 0.5 },
    ] {
        let message = View::new(image.clone(), ORTHOGRAPHIC, Some(circle), 0.0).unwrap_err().to_string();
        assert!(message.contains("a ball at") && message.contains("a circle"), "{message}");
    }
    let message = View::new(image, Projection::Cube, None, 0.0).unwrap_err().to_string();
    assert!(message.contains("100 x 600"), "{message}");
}
