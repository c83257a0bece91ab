//! The gantry as a whole: against a naive path tracer, the inverse square, handedness, repeatability.

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg32;
use rayon::prelude::*;
use std::f32::consts::PI;

use super::material::Rgb;
use super::shape::Ray;
use super::tests::{naive, relative};
use super::*;
use crate::image::Image;

fn quick() -> Quality {
    Quality { samples: 16, bounces: 4, stride: 2, cone_density: 1000.0, depth: 6, seed: 3 }
}

fn trace(gantry: &Gantry, quality: Quality) -> Rows {
    gantry.trace(&quality, &mut |_, _| Ok(())).unwrap()
}

/// Some intensity for a square of a position, far from even.
fn intensity(position: usize, row: usize, column: usize) -> Rgb {
    let wave = |k: f32| 1.0 + (k * row as f32 + 2.0 * position as f32).sin() * (k * column as f32 + 1.0).cos();
    [wave(1.3), wave(0.5), 1.0]
}

/// T times the squares' light is what a tracer that meets the lenses by chance sees. Their lenses are wide here, or it never would.
#[test]
fn photographs_of_squares_agree_with_a_naive_path_tracer() {
    let (width, height) = (24, 18);
    let gantry = Gantry { lens_radius: 0.7, ..Gantry::demo(Camera::gantry(width, height), (3, 2), 8) };
    let rows = trace(&gantry, Quality { samples: 256, ..quick() });
    let emitted: Vec<Rgb> = (0..6 * 64).map(|e| intensity(e / 64, e / 8 % 8, e % 8)).collect();
    let picture = rows.photograph(&emitted).unwrap();
    let tangent = (0.5 * gantry.view_rad).tan();
    let light = |ray: &Ray| {
        let mut sum = [0.0; 3];
        for (n, place) in gantry.positions.iter().enumerate() {
            let axis = -place.normalize();
            let cos = -ray.direction.dot(&axis);
            let t = (place - ray.origin).dot(&-axis) / cos;
            // The square that lights where the ray comes from, by the frame of a camera at the projector.
            let right = axis.cross(&V3::y()).normalize();
            let from = ray.origin - place;
            let depth = from.dot(&axis) * tangent;
            let (u, v) = (from.dot(&right) / depth, from.dot(&axis.cross(&right)) / depth);
            if cos > 0.0 && t > 0.0 && (ray.at(t) - place).norm() < 0.7 && u.abs() < 1.0 && v.abs() < 1.0 {
                let at = |s: f32| ((0.5 + 0.5 * s) * 8.0) as usize;
                let radiance = 1.0 / (PI * 0.49 * cos);
                sum.iter_mut().zip(intensity(n, at(v), at(u))).for_each(|(s, i)| *s += i * radiance);
            }
        }
        sum
    };
    let classes = classes(&gantry.scene, &gantry.camera);
    let pixel = |at: usize| -> Rgb {
        let mut rng = Pcg32::seed_from_u64(at as u64);
        let n = if classes.class[at] == Class::Background { 1 } else { 8000 };
        let mut sum = [0.0; 3];
        for _ in 0..n {
            let (x, y) = ((at % width) as f32 + rng.random::<f32>(), (at / width) as f32 + rng.random::<f32>());
            let ray = gantry.camera.ray(x, y);
            if gantry.scene.hit(&ray).is_some() {
                let seen = naive(&gantry.scene, ray, &light, &mut rng);
                sum.iter_mut().zip(seen).for_each(|(s, l)| *s += l / n as f32);
            }
        }
        sum
    };
    let pixels: Vec<Rgb> = (0..width * height).into_par_iter().map(pixel).collect();
    let truth = Image::from_fn(width, height, |x, y| pixels[y * width + x]);
    for (class, noise, bias) in [
        (Class::Diffuse, 0.08, 0.02),
        (Class::Glossy, 0.12, 0.04),
        (Class::Mirror, 0.12, 0.04),
        (Class::Mixed, 0.12, 0.03),
    ] {
        let pixels = classes.pixels(&[class]);
        assert!(pixels.len() > 5, "{class:?}: {} pixels", pixels.len());
        let error = relative(&picture, &truth, &pixels);
        for c in 0..3 {
            let sum = |image: &Image| pixels.iter().map(|p| f64::from(image.data()[3 * p + c])).sum::<f64>();
            let ratio = sum(&picture) / sum(&truth);
            assert!(error < noise && (ratio - 1.0).abs() < bias, "{class:?} {c}: error {error}, ratio {ratio}");
        }
    }
}

/// A wall through the origin that faces the camera.
fn wall(positions: Vec<V3>) -> Gantry {
    let wall = Shape::Disc { centre: V3::zeros(), normal: V3::z(), radius: 9.0 };
    let material = Material::Diffuse { albedo: [0.8, 0.5, 0.2] };
    let camera = Camera { width: 24, height: 24, distance: 6.0, view_rad: 0.4 };
    let scene = Scene { objects: vec![Object { shape: wall, material }] };
    Gantry { scene, camera, positions, view_rad: 0.4, squares: 6, lens_radius: 0.05, blocks: 4 }
}

#[test]
fn a_projector_beside_the_camera_lights_what_the_camera_sees_there() {
    let gantry = wall(vec![V3::new(0.0, 0.0, 6.0), V3::new(3.0, 0.0, 3.0)]);
    let rows = trace(&gantry, quick());
    // Row 1, column 4 of the first position: pixels 4 to 8 from the top, 16 to 20 from the left.
    let picture = rows.element(6 + 4).unwrap();
    for (x, y) in (0..24).flat_map(|y| (0..24).map(move |x| (x, y))) {
        let ray = gantry.camera.ray(x as f32 + 0.5, y as f32 + 0.5);
        let to = ray.at(6.0 / -ray.direction.z) - V3::new(0.0, 0.0, 6.0);
        // f cos / d^2, f = albedo / pi.
        let inside = (4..8).contains(&y) && (16..20).contains(&x);
        let expected = if inside { 0.8 / PI * -ray.direction.z / to.norm_squared() } else { 0.0 };
        let found = picture.pixel(x, y)[0];
        assert!((found - expected).abs() < 0.01 * expected + 1e-6, "({x}, {y}): {found} is not {expected}");
    }
    // All squares of the second, which stands to the right and nearer: the inverse square and the cosine of 45 degrees.
    let mut emitted = vec![[0.0; 3]; 72];
    emitted[36..].fill([1.0; 3]);
    let picture = rows.photograph(&emitted).unwrap();
    let expected = 0.5 / PI * 0.5f32.sqrt() / 18.0;
    let found = 0.5 * (picture.pixel(11, 12)[1] + picture.pixel(12, 12)[1]);
    assert!((found / expected - 1.0).abs() < 0.02, "{found} is not {expected}");
    // The left half of its picture is the camera's left half, where light is weaker: it is farther away.
    let column = |c: usize| rows.element(36 + 3 * 6 + c).unwrap();
    let middle = |picture: &Image| {
        let (mut sum, mut moment) = (0.0, 0.0);
        for (x, v) in picture.row(12).iter().step_by(3).enumerate() {
            (sum, moment) = (sum + v, moment + v * x as f32);
        }
        moment / sum
    };
    assert!(middle(&column(1)) < 10.0 && middle(&column(4)) > 13.0);
}

#[test]
fn a_body_throws_a_shadow_away_from_the_projector() {
    let mut gantry = wall(vec![V3::new(4.0, 0.0, 4.0)]);
    let ball = Shape::Sphere { centre: V3::new(0.0, 0.0, 0.4), radius: 0.2 };
    gantry.scene.objects.push(Object { shape: ball, material: Material::Mirror { reflectance: [1.0; 3] } });
    let rows = trace(&gantry, quick());
    let picture = rows.photograph(&vec![[1.0; 3]; 36]).unwrap();
    // The shadow lies 0.4 to the left of the middle: 4 pixels.
    assert!(picture.pixel(7, 12)[1] < 0.25 * picture.pixel(17, 12)[1], "no shadow");
}

#[test]
fn a_mirror_ball_shows_the_lens_where_it_is() {
    let ball = Shape::Sphere { centre: V3::zeros(), radius: 1.0 };
    let scene = Scene { objects: vec![Object { shape: ball, material: Material::Mirror { reflectance: [1.0; 3] } }] };
    let gantry = Gantry { scene, lens_radius: 0.5, ..wall(vec![V3::new(4.0, 3.0, 4.0)]) };
    let quality = Quality { samples: 256, ..quick() };
    let picture = trace(&gantry, quality).photograph(&vec![[1.0; 3]; 36]).unwrap();
    let (mut sum, mut right, mut up) = (0.0, 0.0, 0.0);
    for (x, y) in (0..24).flat_map(|y| (0..24).map(move |x| (x, y))) {
        let v = picture.pixel(x, y)[1];
        (sum, right, up) = (sum + v, right + v * (x as f32 - 11.5), up + v * (11.5 - y as f32));
    }
    // From 3600 rays a pixel by another program: the law of reflection, and 1 / (A cos) where they meet the disc.
    assert!((sum / 0.782 - 1.0).abs() < 0.1, "{sum}");
    assert!((right / sum - 4.0).abs() < 0.15 && (up / sum - 3.0).abs() < 0.15, "{}, {}", right / sum, up / sum);
}

#[test]
fn rows_do_not_depend_on_the_number_of_threads() {
    let gantry = Gantry::demo(Camera::gantry(20, 15), (4, 2), 8);
    let quality = Quality { samples: 2, bounces: 2, cone_density: 200.0, ..quick() };
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| trace(&gantry, quality))
    };
    assert!(with(1) == with(3), "1 and 3 threads differ");
}

#[test]
fn impossible_gantries_are_refused() {
    let good = wall(vec![V3::new(0.0, 3.0, 0.0)]);
    assert!(good.check("rig.toml").is_ok());
    for (bad, words) in [
        (Gantry { positions: vec![], ..good.clone() }, "squares"),
        (Gantry { positions: vec![V3::z(), V3::zeros()], ..good.clone() }, "position 2"),
        (Gantry { view_rad: f32::NAN, ..good.clone() }, "view"),
        (Gantry { lens_radius: 0.0, ..good.clone() }, "lens"),
        (Gantry { squares: 0, ..good.clone() }, "squares"),
    ] {
        let message = bad.check("rig.toml").unwrap_err().to_string();
        assert!(message.contains(words) && message.contains("rig.toml"), "{message}");
    }
}

#[test]
fn the_arm_goes_about_the_table() {
    let Shape::Disc { normal, .. } = Scene::gantry().objects[0].shape else { panic!("the table comes first") };
    let places = Gantry::above_table(&grid_lamps(8, 3), 4.0);
    assert!(places.iter().all(|p| p.dot(&normal) > 0.9 && (p.norm() - 4.0).abs() < 1e-4));
    let axes = Gantry::above_table(&[crate::math::Vec3::x(), crate::math::Vec3::y(), crate::math::Vec3::z()], 2.0);
    assert!((axes[0] - V3::x() * 2.0).norm() < 1e-5 && (axes[1] - normal * 2.0).norm() < 1e-5 && axes[2].z > 1.8);
}
