//! The direct render: closed forms, the other truth, and the gantry's own squares.

use std::f64::consts::PI;
use std::sync::Arc;

use super::tests::relative;
use super::*;
use crate::illumination::light_field::{Emitter, Frame, LightField, Lookup, Point, Slide, Source, Spot};
use crate::illumination::{EnvMap, lighting::Aim};
use crate::image::Image;
use crate::math::Vec3;

fn quick(samples: usize) -> Quality {
    Quality { samples, bounces: 2, stride: 1, cone_density: 100.0, depth: 4, seed: 5 }
}

fn render(scene: &Scene, camera: &Camera, light: &LightField, quality: &Quality) -> Image {
    lit(scene, camera, light, quality, &mut |_, _| Ok(())).unwrap()
}

fn field(emitter: Emitter) -> LightField {
    LightField::new(vec![Source::new("it", emitter)])
}

const ALBEDO: [f32; 3] = [0.8, 0.5, 0.2];

/// A wall through the origin that faces the camera.
fn wall() -> (Scene, Camera) {
    let shape = Shape::Disc { centre: V3::zeros(), normal: V3::z(), radius: 9.0 };
    let scene = Scene { objects: vec![Object { shape, material: Material::Diffuse { albedo: ALBEDO } }] };
    (scene, Camera { width: 16, height: 16, distance: 6.0, view_rad: 0.4 })
}

/// `albedo cos (d0 / d)^2`: a white diffuser at the aim that faces the lamp is 1.
#[test]
fn a_wall_under_a_lamp_follows_the_inverse_square_and_the_cosine() {
    let (scene, camera) = wall();
    let lamp = Vec3::new(0.7, 0.9, 1.1);
    let picture = render(&scene, &camera, &field(Emitter::Point(Point::new(lamp, Vec3::zeros()).unwrap())), &quick(64));
    for (x, y) in (0..16).flat_map(|y| (0..16).map(move |x| (x, y))) {
        let ray = camera.ray(x as f32 + 0.5, y as f32 + 0.5);
        let at: Vec3 = ray.at(6.0 / -ray.direction.z).cast();
        let to = lamp - at;
        for (c, albedo) in ALBEDO.into_iter().enumerate() {
            let expected = f64::from(albedo) * to.z / to.norm() * lamp.norm_squared() / to.norm_squared();
            let found = f64::from(picture.pixel(x, y)[c]);
            assert!((found / expected - 1.0).abs() < 0.01, "({x}, {y}): {found} is not {expected}");
        }
    }
    // Mirrors do not see it, bodies before it throw shadows.
    let mirror = Material::Mirror { reflectance: [1.0; 3] };
    let ball = |centre| Object { shape: Shape::Sphere { centre, radius: 0.2 }, material: mirror };
    let mut scene = scene;
    scene.objects.push(ball(V3::new(0.35, 0.45, 0.55)));
    let far = Camera { distance: 30.0, view_rad: 0.08, ..camera };
    let picture = render(&scene, &far, &field(Emitter::Point(Point::new(lamp, Vec3::zeros()).unwrap())), &quick(16));
    assert!(picture.pixel(7, 8)[0] < 0.02, "the origin is in the shadow");
    assert!(picture.pixel(2, 12)[0] > 0.1);
}

/// The other truth, which draws from maps, shows the same.
#[test]
fn maps_light_as_the_truth_of_the_stage_has_it() {
    let (mut scene, camera) = wall();
    let ball = Shape::Sphere { centre: V3::new(0.3, 0.2, 0.6), radius: 0.5 };
    scene.objects.push(Object { shape: ball, material: Material::Glossy { albedo: [0.3, 0.5, 0.2], alpha: 0.3 } });
    let map = lights::sky((64, 32));
    let everywhere = crate::domain::Directions::new(demo_lamps(40)).unwrap();
    let quality = Quality { samples: 256, ..quick(256) };
    // Light that both have: above the horizon, which the lamps cover.
    let expected = truth(&scene, &camera, std::slice::from_ref(&map), &everywhere, &quality, &mut |_, _| Ok(()))
        .unwrap()
        .remove(0);
    let found = render(&scene, &camera, &field(Emitter::Map(Arc::new(map))), &quality);
    let all: Vec<usize> = (0..256).collect();
    let error = relative(&found, &expected, &all);
    assert!(error < 0.02, "{error}");
    // White in a white furnace, beside what the ball hides.
    let white = field(Emitter::Map(Arc::new(EnvMap::from_fn(8, 4, |_| [1.0; 3]))));
    let (scene, camera) = wall();
    let furnace = render(&scene, &camera, &white, &quick(16));
    assert!((furnace.pixel(3, 3)[0] - 0.8).abs() < 1e-3, "{:?}", furnace.pixel(3, 3));
}

/// Mean of a spot's intensity over each square of a projector's picture, as a picture of them; 16 x 16 looks a square.
fn squares(frame: &Frame, view_rad: f64, n: usize, spot: &Spot) -> Image {
    let (fine, reach) = (16 * n, (view_rad / 2.0).tan());
    let share = |i: usize, j: usize| {
        let at = |k: usize| ((2 * k + 1) as f64 / fine as f64 - 1.0) * reach;
        let towards = frame.axis + frame.right * at(i) - frame.up * at(j);
        spot.profile(crate::math::angle_between(&towards.normalize(), &spot.frame.axis))
    };
    Image::from_fn(n, n, |x, y| {
        let sum: f64 = (0..256).map(|k| share(16 * x + k % 16, 16 * y + k / 16)).sum();
        [(sum / 256.0) as f32; 3]
    })
}

/// A spot at a projector's place: the photograph of the squares that filter it, against the same squares thrown as a slide, and
/// against the spot itself.
#[test]
fn a_spot_at_a_projectors_place_is_what_its_squares_photograph() {
    let camera = Camera::gantry(64, 48);
    let place = Gantry::above_table(&[Aim { azimuth_rad: 0.6, elevation_rad: 0.8 }.direction()], 4.0);
    let quality = Quality { samples: 64, bounces: 4, stride: 1, cone_density: 500.0, depth: 5, seed: 7 };
    let mut gantry = Gantry { positions: place.clone(), ..Gantry::demo(camera, (1, 1), 12) };
    // What the mirror ball throws on the table is right in the mean, but noise at so few rays.
    gantry.scene.objects[1].material = Material::Diffuse { albedo: [0.5; 3] };
    let rows = gantry.trace(&quality, &mut |_, _| Ok(())).unwrap();
    let place: Vec3 = place[0].cast();
    let spot = Spot::new(
        Frame::new(place, Vec3::new(0.2, -0.1, 0.15), Vec3::y()).unwrap(),
        13f64.to_radians(),
        4f64.to_radians(),
    );
    // As the projector stands; its white is pi d^2, the spot's too.
    let stand = Frame::new(place, Vec3::zeros(), Vec3::y()).unwrap();
    let view = f64::from(gantry.view_rad);
    let slide = squares(&stand, view, 12, &spot);
    let white = (PI * stand.distance * stand.distance) as f32;
    let emitted: Vec<[f32; 3]> = slide.data().chunks_exact(3).map(|p| [p[0] * white; 3]).collect();
    let photograph = rows.photograph(&emitted).unwrap();
    let thrown = Slide::new(stand, view, slide, Lookup::Squares).unwrap();
    let other = Quality { seed: 8, ..quality };
    let filtered = render(&gantry.scene, &camera, &field(Emitter::Slide(thrown.clone())), &other);
    // Stops of the spot count at its own aim.
    let gain = (stand.distance / spot.frame.distance).powi(2);
    let sharp = LightField::new(vec![Source::new("it", Emitter::Spot(spot)).lit([gain; 3], 0.0)]);
    let sharp = render(&gantry.scene, &camera, &sharp, &other);
    let rough = classes(&gantry.scene, &camera).pixels(&[Class::Diffuse, Class::Glossy]);
    let (as_squares, as_spot) = (relative(&photograph, &filtered, &rough), relative(&photograph, &sharp, &rough));
    // Measured: 0.035, of which 0.024 is noise of the truth, and 0.19 for the spot that no square filters.
    assert!(as_squares < 0.05, "{as_squares}, {as_spot}");
    assert!(as_spot > as_squares && as_spot < 0.4, "{as_squares}, {as_spot}");
}
