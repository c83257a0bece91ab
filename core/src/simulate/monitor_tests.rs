//! The monitor rig as a whole: against a naive path tracer, handedness, what is seen directly, repeatability.

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg32;
use rayon::prelude::*;

use super::material::Rgb;
use super::tests::{naive, relative};
use super::*;
use crate::image::Image;

const SMALL: (usize, usize) = (28, 21);

fn quick() -> Quality {
    Quality { samples: 16, bounces: 8, stride: 1, cone_density: 1000.0, depth: 6, seed: 3 }
}

fn trace(monitor: &Monitor, quality: Quality) -> Rows {
    monitor.trace(&quality, &mut |_, _| Ok(())).unwrap()
}

/// What is shown: white in red, a slope with bars in green, an oblique wave in blue; as a function of shares of the screen.
fn pattern(u: f32, v: f32) -> Rgb {
    let bars = if ((u * 8.0) as usize).is_multiple_of(2) { 1.0 } else { 0.1 };
    [1.0, bars * (1.0 - 0.8 * v), 0.5 + 0.5 * (9.0 * u + 7.0 * v).sin()]
}

fn texels((columns, rows): (usize, usize), show: &dyn Fn(f32, f32) -> Rgb) -> Vec<Rgb> {
    let at = |n: usize| show((n % columns) as f32 + 0.5, (n / columns) as f32 + 0.5);
    (0..columns * rows).map(at).collect()
}

/// T times a picture on the screen is what a tracer that knows no texels, no blocks and no next-event estimation sees.
#[test]
fn photographs_of_patterns_agree_with_a_naive_path_tracer() {
    let camera = Camera::monitor(SMALL.0, SMALL.1);
    let monitor = Monitor::demo(camera, (128, 96));
    let rows = trace(&monitor, Quality { samples: 256, bounces: 4, ..quick() });
    let emitted = texels((128, 96), &|x, y| pattern(x / 128.0, y / 96.0));
    let picture = rows.photograph(&emitted).unwrap();
    let light = |ray: &shape::Ray| monitor.screen.hit(ray).map_or([0.0; 3], |(u, v)| pattern(u, v));
    let classes = classes(&monitor.scene, &camera);
    let pixel = |at: usize| -> Rgb {
        let mut rng = Pcg32::seed_from_u64(at as u64);
        // These are few pixels, and few of their paths find the screen.
        let n = match classes.class[at] {
            Class::Background => 200,
            Class::Glossy | Class::Mirror => 40_000,
            _ => 3000,
        };
        let mut sum = [0.0; 3];
        for _ in 0..n {
            let (x, y) = ((at % SMALL.0) as f32 + rng.random::<f32>(), (at / SMALL.0) as f32 + rng.random::<f32>());
            let seen = naive(&monitor.scene, camera.ray(x, y), &light, &mut rng);
            sum.iter_mut().zip(seen).for_each(|(s, l)| *s += l / n as f32);
        }
        sum
    };
    let pixels: Vec<Rgb> = (0..SMALL.0 * SMALL.1).into_par_iter().map(pixel).collect();
    let truth = Image::from_fn(SMALL.0, SMALL.1, |x, y| pixels[y * SMALL.0 + x]);
    for (class, noise, bias) in [
        (Class::Background, 0.03, 0.005),
        (Class::Diffuse, 0.07, 0.02),
        (Class::Glossy, 0.09, 0.03),
        // What the rays of a few pixels at the rim of the ball find is most of its light.
        (Class::Mirror, 0.12, 0.05),
        (Class::Glass, 0.06, 0.02),
        (Class::Mixed, 0.06, 0.02),
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

/// One body in the origin before an upright screen.
fn one(material: Material) -> Monitor {
    let screen =
        ScreenPlane { centre: V3::new(0.0, 0.0, -3.0), right: V3::new(1.6, 0.0, 0.0), up: V3::new(0.0, 1.2, 0.0) };
    let ball = Object { shape: Shape::Sphere { centre: V3::zeros(), radius: 0.5 }, material };
    let camera = Camera { width: 32, height: 24, distance: 6.5, view_rad: 18f32.to_radians() };
    Monitor { scene: Scene { objects: vec![ball] }, camera, screen, texels: (40, 30), blocks: 16 }
}

/// Middle of what is lit among some pixels, in pixels to the right and upwards from the picture's middle.
fn middle(picture: &Image, inside: &dyn Fn(f32) -> bool) -> Option<(f32, f32)> {
    let (w, h) = picture.size();
    let mut sum = (0.0, 0.0, 0.0);
    for (x, y) in (0..h).flat_map(|y| (0..w).map(move |x| (x, y))) {
        let (right, up) = (x as f32 + 0.5 - 0.5 * w as f32, 0.5 * h as f32 - y as f32 - 0.5);
        if inside(right.hypot(up)) {
            let v = picture.pixel(x, y)[1];
            sum = (sum.0 + v, sum.1 + v * right, sum.2 + v * up);
        }
    }
    (sum.0 > 0.0).then(|| (sum.1 / sum.0, sum.2 / sum.0))
}

#[test]
fn texels_appear_where_they_are_and_glass_turns_them_about() {
    let monitor = one(Material::Glass { index: 1.5 });
    let (bare, glass) = (trace(&monitor.bare(), quick()), trace(&monitor, quick()));
    // A texel is half a pixel wide, so what is lit lies up to half a pixel beside it. Column 8, row 21 of 40 x 30: left and low.
    let element = 21 * 40 + 8;
    let seen = middle(&bare.element(element).unwrap(), &|_| true).unwrap();
    let [x, y] = monitor.camera.project(&monitor.screen.point(8.5 / 40.0, 21.5 / 30.0));
    let (right, up) = (x as f32 - 16.0, 12.0 - y as f32);
    assert!((seen.0 - right).abs() < 0.35 && (seen.1 - up).abs() < 0.35, "{seen:?} is not {right}, {up}");
    assert!(right < -5.0 && up < -2.0);
    // The outline's radius is 0.5 / 6.5 of the focal length, 5.8 pixels.
    let through = middle(&glass.element(element).unwrap(), &|r| r < 4.5).unwrap();
    assert!(through.0 > 1.0 && through.1 > 0.4, "{through:?}");
    let beside = middle(&glass.element(element).unwrap(), &|r| r > 7.0).unwrap();
    assert!((beside.0 - right).abs() < 0.35 && (beside.1 - up).abs() < 0.35);
}

#[test]
fn a_mirror_ball_shows_the_screen_at_its_rim_only() {
    let rows = trace(&one(Material::Mirror { reflectance: [1.0; 3] }), quick());
    let white = rows.photograph(&vec![[1.0; 3]; 1200]).unwrap();
    let lit = |inside: &dyn Fn(f32) -> bool| middle(&white, inside).is_some();
    assert!(!lit(&|r| r < 3.8), "it shows what is behind it");
    assert!(lit(&|r| r > 4.6 && r < 5.2), "its rim looks past it at the screen");
    // The left of the screen is mirrored on the left.
    let left = texels((40, 30), &|x, _| if x < 10.0 { [1.0; 3] } else { [0.0; 3] });
    let left = middle(&rows.photograph(&left).unwrap(), &|r| r < 5.2).unwrap();
    assert!(left.0 < -3.0, "{left:?}");
}

#[test]
fn what_is_seen_directly_is_white_and_the_rest_is_not_counted() {
    let monitor = Monitor::demo(Camera::monitor(24, 18), (64, 64));
    let (bare, full) = (monitor.bare(), monitor.directly_seen());
    let (share, rows) = (bare.directly_seen(), trace(&bare, quick()));
    let white = rows.photograph(&vec![[1.0; 3]; 4096]).unwrap();
    for (at, share) in share.iter().enumerate() {
        assert!((white.data()[3 * at] - share).abs() < 1e-3, "pixel {at}: {} is not {share}", white.data()[3 * at]);
        assert!(full[at] <= *share && (full[at] == 0.0 || full[at] == 1.0 || *share > 0.0));
    }
    let alpha = classes(&monitor.scene, &monitor.camera).alpha;
    assert!((0..full.len()).all(|at| share[at] < 1.0 || (full[at] + alpha[at] - 1.0).abs() < 1e-6));
    assert!(full.iter().sum::<f32>() > 100.0 && rows.entries() > 0);
}

#[test]
fn rows_do_not_depend_on_the_number_of_threads_and_are_bounded() {
    let monitor = Monitor::demo(Camera::monitor(20, 15), (128, 128));
    let quality = Quality { samples: 4, bounces: 2, cone_density: 200.0, ..quick() };
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| trace(&monitor, quality))
    };
    let rows = with(1);
    assert!(rows == with(3), "1 and 3 threads differ");
    // At most all blocks, 256 and a third more, and some leaves of each camera ray.
    assert!(rows.bytes() < 300 * (10 * (342 + 4 * 12) + 12), "{} bytes", rows.bytes());
}

#[test]
fn impossible_monitors_are_refused() {
    let good = one(Material::Glass { index: 1.5 });
    assert!(good.check("rig.toml").is_ok());
    let at = |z: f32| ScreenPlane { centre: V3::new(0.0, 0.0, z), ..good.screen };
    let skew = ScreenPlane { up: V3::new(0.5, 1.0, 0.0), ..good.screen };
    for (bad, words) in [
        (Monitor { screen: at(-0.4), ..good.clone() }, "body 1"),
        (Monitor { screen: at(f32::NAN), ..good.clone() }, "right angles"),
        (Monitor { screen: skew, ..good.clone() }, "right angles"),
        (Monitor { texels: (0, 10), ..good.clone() }, "texels"),
        (Monitor { blocks: 0, ..good.clone() }, "blocks"),
        (Monitor { camera: Camera { width: 0, ..good.camera }, ..good.clone() }, "camera, picture"),
        (Monitor { camera: Camera { distance: f32::NAN, ..good.camera }, ..good.clone() }, "camera, distance"),
        (Monitor { camera: Camera { view_rad: 4.0, ..good.camera }, ..good.clone() }, "camera, view"),
    ] {
        let message = bad.check("rig.toml").unwrap_err().to_string();
        assert!(message.contains(words) && message.contains("rig.toml"), "{message}");
    }
    let stopped = good.trace(&quick(), &mut |_, _| Err(crate::Error::Cancelled));
    assert!(matches!(stopped, Err(crate::Error::Cancelled)));
}
