//! Normals and albedo of rendered spheres against the geometry they were rendered from, and against least squares that
//! rejects nothing.

use std::path::Path;

use relume_core::acquire::surface;
use relume_core::domain::Directions;
use relume_core::field::{self, Access, Asset, Block, BlockBuffer, Contents, Precision};
use relume_core::math::{Vec3, angle_between};
use relume_core::simulate::{Camera, Material, Object, Quality, Scene, Shape, Stage, V3, demo_lamps};

const CAMERA: Camera = Camera { width: 48, height: 40, distance: 6.0, view_rad: 0.36 };
const BALL: (V3, f32) = (V3::new(0.0, 0.0, 0.0), 0.9);

fn quality() -> Quality {
    Quality { samples: 16, bounces: 4, stride: 2, cone_density: 100.0, depth: 4, seed: 5 }
}

/// `count` lamps, evenly over the hemisphere before the object.
fn dome(count: usize) -> Directions {
    Directions::new(demo_lamps(count).into_iter().map(|d| Vec3::new(d.x, -d.z, d.y)).collect()).unwrap()
}

fn ball(material: Material) -> Object {
    Object { shape: Shape::Sphere { centre: BALL.0, radius: BALL.1 }, material }
}

fn photograph(scene: &Scene, lamps: &Directions, path: &Path) -> Asset {
    let stage = Stage::new(scene, CAMERA, lamps, quality());
    let contents = Contents {
        colour_space: Default::default(),
        domain: lamps.clone().into(),
        irradiance: vec![std::f32::consts::PI; lamps.len()],
        width: CAMERA.width,
        height: CAMERA.height,
        precision: Precision::Half,
        largest: stage.largest(),
        ambient: None,
        alpha: None,
        reliability: None,
        provenance: serde_json::json!({"source": "sphere"}),
    };
    field::write(path, &contents, &mut stage.bands(&mut |_, _| Ok(()))).unwrap();
    Asset::open(path, Access::Read).unwrap()
}

/// The normal where the ray through the middle of a pixel meets the ball, if the pixel is well inside it.
fn truth(x: usize, y: usize) -> Option<Vec3> {
    let scale = 2.0 * (0.5 * f64::from(CAMERA.view_rad)).tan() / CAMERA.height as f64;
    let right = (x as f64 + 0.5 - 0.5 * CAMERA.width as f64) * scale;
    let up = (0.5 * CAMERA.height as f64 - y as f64 - 0.5) * scale;
    let (origin, d) = (Vec3::new(0.0, 0.0, f64::from(CAMERA.distance)), Vec3::new(right, up, -1.0).normalize());
    let (b, c) = (origin.dot(&d), origin.norm_squared() - f64::from(BALL.1).powi(2));
    let root = (b * b - c).max(0.0).sqrt();
    let n = (origin - d * (b + root)).normalize();
    // Pixels on the outline see the normals of a wide range, and what lies behind.
    (b * b > c && n.dot(&-d) > 0.2).then_some(n)
}

/// All of a pixel's answers, mean over the channels.
fn answers(asset: &Asset, x: usize, y: usize) -> Vec<f64> {
    let mut sums = vec![0.0; asset.directions().unwrap().len()];
    for c in 0..3 {
        let mut buffer = BlockBuffer::default();
        let block = asset.dense().unwrap().block(x / 16, y / 8, c, &mut buffer).unwrap();
        for (lamp, sum) in sums.iter_mut().enumerate() {
            let at = lamp * 128 + (y % 8) * 16 + x % 16;
            *sum += match block {
                Block::Half(t) => f64::from(t[at].to_f32()),
                Block::Float(t) => f64::from(t[at]),
            } * f64::from(asset.dense().unwrap().scale())
                / 3.0;
        }
    }
    sums
}

/// The normal by least squares over every lamp that answers at all.
fn plain(asset: &Asset, x: usize, y: usize) -> Vec3 {
    let (mut a, mut b) = (nalgebra::Matrix3::zeros(), Vec3::zeros());
    for (l, t) in asset.directions().unwrap().lamps().iter().zip(answers(asset, x, y)).filter(|(_, t)| *t > 0.0) {
        a += l * l.transpose();
        b += l * t;
    }
    a.try_inverse().map(|inverse| (inverse * b).normalize()).unwrap_or_default()
}

/// Errors in degrees, sorted, of the robust and of the plain normals; pixels that were given up are not among them.
struct Errors {
    robust: Vec<f64>,
    plain: Vec<f64>,
    pixels: usize,
}

fn errors(asset: &Asset) -> Errors {
    let found = surface(asset, &mut |_, _| Ok(())).unwrap();
    let mut errors = Errors { robust: Vec::new(), plain: Vec::new(), pixels: 0 };
    for (x, y) in (0..CAMERA.height).flat_map(|y| (0..CAMERA.width).map(move |x| (x, y))) {
        let Some(n) = truth(x, y) else { continue };
        errors.pixels += 1;
        errors.plain.push(angle_between(&plain(asset, x, y), &n).to_degrees());
        let robust = Vec3::from_iterator(found.normals.pixel(x, y).iter().map(|v| f64::from(*v)));
        if robust.norm() > 0.5 {
            errors.robust.push(angle_between(&robust.normalize(), &n).to_degrees());
        }
    }
    errors.robust.sort_by(f64::total_cmp);
    errors.plain.sort_by(f64::total_cmp);
    errors
}

fn at(sorted: &[f64], share: f64) -> f64 {
    sorted[((sorted.len() - 1) as f64 * share) as usize]
}

#[test]
fn a_diffuse_sphere_is_met() {
    let folder = tempfile::tempdir().unwrap();
    let albedo = [0.6, 0.4, 0.2];
    let scene = Scene { objects: vec![ball(Material::Diffuse { albedo })] };
    // Medians found: 0.3, 0.4 and 1.0 degrees. Lamps fill their cells here, which are 12 and 26 degrees wide.
    for (name, lamps, limit) in [
        ("dome", dome(120), 0.6),
        ("arc", Directions::new(demo_lamps(120)).unwrap(), 0.7),
        ("dome of 24", dome(24), 1.5),
    ] {
        let asset = photograph(&scene, &lamps, &folder.path().join("a.rfield"));
        let errors = errors(&asset);
        let median = at(&errors.robust, 0.5);
        assert!(median < limit, "{name}: median {median} degrees");
        assert!(errors.robust.len() * 20 > errors.pixels * 19, "{name}: {} of {}", errors.robust.len(), errors.pixels);
        let found = surface(&asset, &mut |_, _| Ok(())).unwrap();
        let middle = found.albedo.pixel(CAMERA.width / 2, CAMERA.height / 2);
        assert!(middle.iter().zip(albedo).all(|(a, b)| (a / b - 1.0).abs() < 0.05), "{name}: {middle:?}");
        assert_eq!(found.normals.pixel(0, 0), [0.0; 3], "nothing is there");
        assert_eq!(found.albedo.pixel(0, 0), [0.0; 3], "nothing is there");
    }
}

/// What is plainly worse without rejection: the gloss's base is no Lambert surface either (its coat lets less in at grazing
/// angles), which leaves two degrees.
#[test]
fn highlights_and_cast_shadows_are_rejected() {
    let folder = tempfile::tempdir().unwrap();
    let lamps = dome(160);
    let gloss = Material::Glossy { albedo: [0.5, 0.1, 0.08], alpha: 0.2 };
    let post = |x: f32| Object {
        shape: Shape::Sphere { centre: V3::new(x, 0.5, 2.2), radius: 0.45 },
        material: Material::Diffuse { albedo: [0.02; 3] },
    };
    let diffuse = Material::Diffuse { albedo: [0.5; 3] };
    for (name, objects, limits) in [
        ("glossy", vec![ball(gloss)], (2.5, 4.0)),
        ("shadowed", vec![ball(diffuse), post(1.6), post(-1.6)], (0.6, 1.5)),
        ("glossy and shadowed", vec![ball(gloss), post(1.6), post(-1.6)], (2.5, 4.0)),
    ] {
        let asset = photograph(&Scene { objects }, &lamps, &folder.path().join("a.rfield"));
        let errors = errors(&asset);
        let (median, most) = (at(&errors.robust, 0.5), at(&errors.robust, 0.95));
        assert!(median < limits.0 && most < limits.1, "{name}: median {median}, 95 % within {most} degrees");
        assert!(at(&errors.plain, 0.5) > 1.5 * median, "{name}: plain median {}", at(&errors.plain, 0.5));
        assert!(at(&errors.plain, 0.95) > 2.5 * most, "{name}: plain 95 % {}", at(&errors.plain, 0.95));
        assert!(errors.robust.len() * 20 > errors.pixels * 19, "{name}: {} of {}", errors.robust.len(), errors.pixels);
    }
}

#[test]
fn lamps_that_cannot_tell_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let scene = Scene { objects: vec![ball(Material::Diffuse { albedo: [0.5; 3] })] };
    let slanted = |a: f64, b: f64| Vec3::new(a, b, 1.0).normalize();
    for (lamps, words) in [
        (vec![slanted(0.3, 0.0), slanted(0.0, 0.3), slanted(-0.3, 0.0)], "3 lamp directions"),
        ((0..6).map(|i| slanted(0.4 * f64::from(i) - 1.0, 0.0)).collect(), "one plane"),
    ] {
        let asset = photograph(&scene, &Directions::new(lamps).unwrap(), &folder.path().join("a.rfield"));
        let message = surface(&asset, &mut |_, _| Ok(())).unwrap_err().to_string();
        assert!(message.contains(words) && message.contains("a.rfield"), "{message}");
    }
}
