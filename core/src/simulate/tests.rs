//! The stage as a whole: energy, agreement of stage, truth and a naive path tracer, repeatability, handedness.

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg32;

use super::material::{Rgb, Scatter, fresnel, reflect, refract};
use super::shape::Ray;
use super::tracer::times;
use super::*;
use crate::domain::Directions;
use crate::field::{BLOCK_HEIGHT, BLOCK_WIDTH, Bands};
use crate::illumination::EnvMap;
use crate::image::Image;
use crate::math::Vec3;

const SMALL: Camera = Camera { width: 32, height: 24, distance: 6.5, view_rad: 0.384 };

fn quick() -> Quality {
    Quality { samples: 16, bounces: 4, stride: 4, cone_density: 400.0, depth: 6, seed: 3 }
}

/// All of T as `[lamp]` pictures.
fn photographs(scene: &Scene, camera: Camera, lamps: &Directions, quality: Quality) -> Vec<Image> {
    let stage = Stage::new(scene, camera, lamps, quality);
    let mut rows = Vec::new();
    let mut progress = |done: u64, total: u64| {
        rows.push((done, total));
        Ok(())
    };
    let mut bands = stage.bands(&mut progress);
    let (n, blocks) = (lamps.len(), camera.width.div_ceil(BLOCK_WIDTH));
    let mut pictures = vec![Image::new(camera.width, camera.height, 3); n];
    for by in 0..camera.height.div_ceil(BLOCK_HEIGHT) {
        let mut band = vec![0.0; blocks * 3 * n * 128];
        bands.fill(by, 0..blocks, &mut band).unwrap();
        for (at, value) in band.iter().enumerate() {
            let (pixel, element, channel, bx) = (at % 128, at / 128 % n, at / 128 / n % 3, at / 128 / n / 3);
            let (x, y) = (bx * BLOCK_WIDTH + pixel % BLOCK_WIDTH, by * BLOCK_HEIGHT + pixel / BLOCK_WIDTH);
            if x < camera.width && y < camera.height {
                pictures[element].pixel_mut(x, y)[channel] = *value;
            } else {
                assert_eq!(*value, 0.0, "past the edge of the picture");
            }
        }
    }
    assert_eq!(rows.last(), Some(&(camera.height as u64, camera.height as u64)));
    pictures
}

/// Light that is constant over every cell, relit by zero-order weights `L_j Omega_j`, and the same as a map.
fn relit(photographs: &[Image], lamps: &Directions, radiance: &[Rgb]) -> (Image, EnvMap) {
    let map = EnvMap::from_fn(1024, 512, |d| if lamps.covers(d) { radiance[lamps.nearest(d)] } else { [0.0; 3] });
    let mut solid_angle = vec![0.0; lamps.len()];
    for j in 0..512 {
        for i in 0..1024 {
            let d = crate::math::latlong::direction(i as f64 + 0.5, j as f64 + 0.5, 1024, 512);
            if lamps.covers(&d) {
                solid_angle[lamps.nearest(&d)] += crate::math::latlong::texel_solid_angle(j, 1024, 512);
            }
        }
    }
    let (w, h) = photographs[0].size();
    let picture = Image::from_fn(w, h, |x, y| {
        std::array::from_fn(|c| {
            (0..lamps.len()).map(|n| photographs[n].pixel(x, y)[c] * radiance[n][c] * solid_angle[n] as f32).sum()
        })
    });
    (picture, map)
}

pub(super) fn relative(a: &Image, b: &Image, pixels: &[usize]) -> f64 {
    let (mut error, mut norm) = (0.0, 0.0);
    for i in pixels.iter().flat_map(|p| 3 * p..3 * p + 3) {
        error += f64::from(a.data()[i] - b.data()[i]).powi(2);
        norm += f64::from(b.data()[i]).powi(2);
    }
    (error / norm).sqrt()
}

/// Glass, mirror and white paper in light of radiance 1 from everywhere: nothing may be darker or brighter than it.
#[test]
fn a_white_furnace_shows_one_everywhere() {
    let white = Material::Diffuse { albedo: [1.0; 3] };
    let ball =
        |x: f32, radius, material| Object { shape: Shape::Sphere { centre: V3::new(x, 0.0, 0.1), radius }, material };
    let ground = Shape::Disc { centre: V3::new(0.0, -0.5, 0.0), normal: V3::new(0.0, 0.96, 0.28), radius: 1.2 };
    let scene = Scene {
        objects: vec![
            Object { shape: ground, material: white },
            ball(-0.8, 0.35, Material::Mirror { reflectance: [1.0; 3] }),
            ball(0.0, 0.38, Material::Glass { index: 1.5 }),
            ball(0.75, 0.33, white),
        ],
    };
    let camera = Camera { width: 24, height: 12, distance: 6.5, view_rad: 0.25 };
    let lamps = Directions::with_coverage(
        demo_lamps(40).into_iter().flat_map(|d| [d, -d]).collect(),
        crate::domain::Axis::Y,
        crate::domain::Coverage::Sphere,
    )
    .unwrap();
    let quality = Quality { samples: 64, bounces: 2, depth: 60, ..quick() };
    let photographs = photographs(&scene, camera, &lamps, quality);
    let (picture, map) = relit(&photographs, &lamps, &[[1.0; 3]; 80]);
    let truth = &truth(&scene, &camera, std::slice::from_ref(&map), &lamps, &quality, &mut |_, _| Ok(())).unwrap()[0];
    let classes = classes(&scene, &camera);
    for (class, tolerance) in [(Class::Diffuse, 0.01), (Class::Mirror, 0.02), (Class::Glass, 0.02)] {
        let pixels = classes.pixels(&[class]);
        assert!(pixels.len() > 8, "{class:?} is not in view");
        for (name, image) in [("stage", &picture), ("truth", truth)] {
            let mean = pixels.iter().map(|p| image.data()[3 * p]).sum::<f32>() / pixels.len() as f32;
            assert!((mean - 1.0).abs() < tolerance, "{class:?} in the {name}: {mean}");
        }
    }
}

/// Stage and truth under light that cells can carry exactly: what is left is noise.
#[test]
fn the_stage_agrees_with_the_truth_under_light_constant_over_cells() {
    let scene = Scene::demo();
    let lamps = Directions::new(demo_lamps(64)).unwrap();
    let quality = Quality { samples: 256, ..quick() };
    let mut rng = Pcg32::seed_from_u64(1);
    let radiance: Vec<Rgb> = (0..64).map(|_| std::array::from_fn(|_| rng.random())).collect();
    let (picture, map) = relit(&photographs(&scene, SMALL, &lamps, quality), &lamps, &radiance);
    let truth = &truth(&scene, &SMALL, std::slice::from_ref(&map), &lamps, &quality, &mut |_, _| Ok(())).unwrap()[0];
    let classes = classes(&scene, &SMALL);
    let all = |class: Class| classes.pixels(&[class]);
    for (class, noise, bias) in [
        (Class::Diffuse, 0.03, 0.01),
        (Class::Glossy, 0.04, 0.02),
        (Class::Mirror, 0.04, 0.03),
        (Class::Glass, 0.03, 0.03),
    ] {
        let pixels = all(class);
        let sum = |image: &Image| pixels.iter().map(|p| f64::from(image.data()[3 * p + 1])).sum::<f64>();
        let (error, ratio) = (relative(&picture, truth, &pixels), sum(&picture) / sum(truth));
        assert!(error < noise && (ratio - 1.0).abs() < bias, "{class:?}: error {error}, ratio {ratio}");
    }
}

/// The plainest estimator there is: follow the BSDF until the path leaves, and look up the light.
pub(super) fn naive(scene: &Scene, mut ray: Ray, light: &dyn Fn(&Ray) -> Rgb, rng: &mut Pcg32) -> Rgb {
    let mut weight = [1.0; 3];
    for _ in 0..12 {
        let Some(hit) = scene.hit(&ray) else { return times(&weight, &light(&ray), 1.0) };
        let against = if hit.normal.dot(&ray.direction) < 0.0 { hit.normal } else { -hit.normal };
        let cos = -against.dot(&ray.direction);
        let direction = match scene.objects[hit.object].material {
            Material::Mirror { reflectance } => {
                weight = times(&weight, &reflectance, 1.0);
                reflect(&ray.direction, &against)
            }
            Material::Glass { index } => {
                let index = if hit.normal.dot(&ray.direction) < 0.0 { index } else { 1.0 / index };
                let mirrored = rng.random::<f32>() < fresnel(cos, index);
                if mirrored { reflect(&ray.direction, &against) } else { refract(&ray.direction, &against, index) }
            }
            material => {
                let scatter = Scatter::new(&material, against, -ray.direction).unwrap();
                let direction = scatter.draw(rng.random(), rng.random());
                weight = times(&weight, &scatter.towards(&direction), 1.0 / scatter.density(&direction));
                direction
            }
        };
        ray = Ray { origin: hit.point, direction };
    }
    [0.0; 3]
}

/// The truth against a tracer that samples no lights, no cones and counts no classes of directions: mean of the picture
/// and of each class.
#[test]
fn the_truth_agrees_with_a_naive_path_tracer() {
    let scene = Scene::demo();
    let camera = Camera { width: 16, height: 12, ..SMALL };
    let lamps = Directions::new(demo_lamps(64)).unwrap();
    let light = |d: &V3| if d.y >= 0.0 { (1.0 + d.x + 0.5 * d.z).max(0.0) } else { 0.0 };
    let map = EnvMap::from_fn(512, 256, |d| [light(&d.cast()); 3]);
    // Most of the difference is chance at the rims of objects, so both get more rays than elsewhere.
    let quality = Quality { samples: 256, depth: 12, ..quick() };
    let truth = &truth(&scene, &camera, std::slice::from_ref(&map), &lamps, &quality, &mut |_, _| Ok(())).unwrap()[0];
    let mut rng = Pcg32::seed_from_u64(8);
    let picture = Image::from_fn(16, 12, |x, y| {
        let n = 4000;
        let mut sum = [0.0; 3];
        for _ in 0..n {
            let ray = camera.ray(x as f32 + rng.random::<f32>(), y as f32 + rng.random::<f32>());
            if scene.hit(&ray).is_some() {
                let seen = naive(&scene, ray, &|ray| [light(&ray.direction); 3], &mut rng);
                sum.iter_mut().zip(seen).for_each(|(s, l)| *s += l / n as f32);
            }
        }
        sum
    });
    let all: Vec<usize> = (0..16 * 12).collect();
    let error = relative(truth, &picture, &all);
    let (a, b): (f32, f32) = (truth.data().iter().sum(), picture.data().iter().sum());
    assert!(error < 0.04, "difference {error}");
    assert!((a / b - 1.0).abs() < 0.01, "ratio of means {}", a / b);
}

#[test]
fn results_do_not_depend_on_the_number_of_threads() {
    let scene = Scene::demo();
    let lamps = Directions::new(demo_lamps(20)).unwrap();
    let camera = Camera { width: 40, height: 12, ..SMALL };
    let quality = Quality { samples: 2, ..quick() };
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| photographs(&scene, camera, &lamps, quality))
    };
    assert!(with(1) == with(3), "1 and 3 threads differ");
}

/// A plain ground under one lamp is plain: no sampling of the lamp's cell may show.
#[test]
fn the_photograph_of_one_lamp_is_clean() {
    let normal = V3::new(0.0, 0.8, 0.6);
    let ground = Shape::Disc { centre: V3::zeros(), normal, radius: 20.0 };
    let scene = Scene { objects: vec![Object { shape: ground, material: Material::Diffuse { albedo: [0.5; 3] } }] };
    let lamps = Directions::new(demo_lamps(64)).unwrap();
    let photographs = photographs(&scene, SMALL, &lamps, quick());
    let facing = |n: &usize| normal.dot(&lamps.lamps()[*n].cast()) > 0.6;
    for n in (0..64).filter(facing) {
        let data = photographs[n].data();
        let mean = data.iter().sum::<f32>() / data.len() as f32;
        let deviation = (data.iter().map(|v| (v - mean).powi(2)).sum::<f32>() / data.len() as f32).sqrt();
        let expected = 0.5 / std::f32::consts::PI * normal.dot(&lamps.lamps()[n].cast()).max(0.0);
        assert!(deviation < 0.03 * mean, "lamp {n}: {}", deviation / mean);
        // A cell is about 0.3 wide: its mean cosine differs from the lamp's by up to 3 %.
        assert!((mean / expected - 1.0).abs() < 0.03, "lamp {n}: {mean} is not {expected}");
    }
}

/// Light from +x lights the right side of the picture, light from +y the upper one; a mirror ball shows the lamp there too.
#[test]
fn light_comes_from_the_right_side() {
    let ball = |material| Scene {
        objects: vec![Object { shape: Shape::Sphere { centre: V3::zeros(), radius: 0.9 }, material }],
    };
    let lamps = Directions::new(demo_lamps(64)).unwrap();
    for material in [Material::Diffuse { albedo: [1.0; 3] }, Material::Mirror { reflectance: [1.0; 3] }] {
        let photographs = photographs(&ball(material), SMALL, &lamps, quick());
        let middle = |direction: Vec3| {
            let picture = &photographs[lamps.nearest(&direction)];
            let mut sum = (0.0, 0.0, 0.0);
            for y in 0..SMALL.height {
                for x in 0..SMALL.width {
                    let v = picture.pixel(x, y)[1];
                    sum = (sum.0 + v, sum.1 + v * (x as f32 + 0.5 - 16.0), sum.2 + v * (12.0 - y as f32 - 0.5));
                }
            }
            assert!(sum.0 > 0.0);
            (sum.1 / sum.0, sum.2 / sum.0)
        };
        assert!(middle(Vec3::new(0.8, 0.1, 0.59).normalize()).0 > 2.0);
        assert!(middle(Vec3::new(-0.8, 0.1, 0.59).normalize()).0 < -2.0);
        assert!(middle(Vec3::new(0.0, 0.95, 0.3).normalize()).1 > 2.0);
    }
}

#[test]
fn the_demo_shows_every_class_clearly() {
    let map = classes(&Scene::demo(), &Camera::demo(96, 72));
    for (class, least) in [
        (Class::Diffuse, 1500),
        (Class::Glossy, 300),
        (Class::Mirror, 150),
        (Class::Glass, 120),
        (Class::Background, 1500),
    ] {
        assert!(map.pixels(&[class]).len() > least, "{class:?}: {} pixels", map.pixels(&[class]).len());
    }
    assert!(map.alpha.iter().zip(&map.class).all(|(a, c)| match c {
        Class::Background => *a == 0.0,
        Class::Mixed => *a > 0.0,
        _ => *a == 1.0,
    }));
}
