//! Normals and albedo of rendered spheres against the geometry they were rendered from, and against least squares that
//! rejects nothing.

use std::f64::consts::PI;
use std::path::Path;

use relume_core::acquire::surface;
use relume_core::domain::Directions;
use relume_core::field::{self, Access, Asset, Block, BlockBuffer, Contents, NewLayer, Precision, add_layers};
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
        domain: lamps.clone(),
        irradiance: vec![std::f32::consts::PI; lamps.len()],
        width: CAMERA.width,
        height: CAMERA.height,
        precision: Precision::Half,
        largest: stage.largest(),
        ambient: None,
        alpha: None,
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
    let mut sums = vec![0.0; asset.domain().len()];
    for c in 0..3 {
        let mut buffer = BlockBuffer::default();
        let block = asset.dense().block(x / 16, y / 8, c, &mut buffer).unwrap();
        for (lamp, sum) in sums.iter_mut().enumerate() {
            let at = lamp * 128 + (y % 8) * 16 + x % 16;
            *sum += match block {
                Block::Half(t) => f64::from(t[at].to_f32()),
                Block::Float(t) => f64::from(t[at]),
            } * f64::from(asset.dense().scale())
                / 3.0;
        }
    }
    sums
}

/// The normal by least squares over every lamp that answers at all.
fn plain(asset: &Asset, x: usize, y: usize) -> Vec3 {
    let (mut a, mut b) = (nalgebra::Matrix3::zeros(), Vec3::zeros());
    for (l, t) in asset.domain().lamps().iter().zip(answers(asset, x, y)).filter(|(_, t)| *t > 0.0) {
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

fn print(name: &str, e: &Errors) {
    println!(
        "{name}: {} of {} pixels; robust median {:.3}, 95 % {:.3}; plain median {:.3}, 95 % {:.3} degrees",
        e.robust.len(),
        e.pixels,
        at(&e.robust, 0.5),
        at(&e.robust, 0.95),
        at(&e.plain, 0.5),
        at(&e.plain, 0.95)
    );
}

#[test]
fn a_diffuse_sphere() {
    let folder = tempfile::tempdir().unwrap();
    let scene = Scene { objects: vec![ball(Material::Diffuse { albedo: [0.6, 0.4, 0.2] })] };
    for (name, lamps) in
        [("dome", dome(120)), ("arc", Directions::new(demo_lamps(120)).unwrap()), ("dome of 24", dome(24))]
    {
        let asset = photograph(&scene, &lamps, &folder.path().join("a.rfield"));
        let e = errors(&asset);
        print(name, &e);
        let found = surface(&asset, &mut |_, _| Ok(())).unwrap();
        let (x, y) = (CAMERA.width / 2, CAMERA.height / 2 - 6);
        println!(
            "albedo {:?} normal {:?} truth {:?}",
            found.albedo.pixel(x, y),
            found.normals.pixel(x, y),
            truth(x, y)
        );
    }
}

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
    for (name, objects) in [
        ("glossy", vec![ball(gloss)]),
        ("shadowed", vec![ball(diffuse), post(1.6), post(-1.6)]),
        ("both", vec![ball(gloss), post(1.6), post(-1.6)]),
        ("metal", vec![ball(Material::RoughMetal { f0: [0.96, 0.74, 0.38], alpha: 0.3 })]),
    ] {
        let asset = photograph(&Scene { objects }, &lamps, &folder.path().join("a.rfield"));
        print(name, &errors(&asset));
    }
}
