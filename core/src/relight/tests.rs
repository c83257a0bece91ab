//! Relighting: linear, additive, the same by windows and by threads, and from the right side.

use std::path::PathBuf;
use std::sync::Arc;

use rand::{RngExt, SeedableRng};

use super::*;
use crate::acquire::Photographs;
use crate::domain::Directions;
use crate::field::{Access, Asset, Contents, Precision, write};
use crate::illumination::{EnvMap, MapCentre};
use crate::image::{ColourSpace, Conversion, Image, Window};
use crate::math::Vec3;
use crate::reconstruct::{Method, Operator, Outside, Reconstruction};

/// Radius of the ball in a picture of 40 x 40.
const RADIUS: f64 = 18.0;

/// A white diffuse ball, orthographic, under unit irradiance from `lamp`: T = max(0, n . l) / pi.
fn ball(lamp: &Vec3) -> Image {
    Image::from_fn(40, 40, |x, y| {
        let (nx, ny) = ((x as f64 + 0.5 - 20.0) / RADIUS, -(y as f64 + 0.5 - 20.0) / RADIUS);
        let nz2 = 1.0 - nx * nx - ny * ny;
        let t = if nz2 <= 0.0 { 0.0 } else { Vec3::new(nx, ny, nz2.sqrt()).dot(lamp).max(0.0) / std::f64::consts::PI };
        [t as f32; 3]
    })
}

fn sphere_of_lamps(n: usize) -> Vec<Vec3> {
    let golden = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    let lamp = |k: usize| {
        let y = 1.0 - (2 * k + 1) as f64 / n as f64;
        let (r, (s, c)) = ((1.0 - y * y).sqrt(), (golden * k as f64).sin_cos());
        Vec3::new(r * c, y, r * s)
    };
    (0..n).map(lamp).collect()
}

/// The ball under `n` lamps all around, E_j = 1 + j / n, as a container.
struct Ball {
    _folder: tempfile::TempDir,
    path: PathBuf,
    relighter: Relighter,
}

impl Ball {
    fn new(n: usize, precision: Precision) -> Self {
        Self::in_space(n, precision, ColourSpace::default())
    }

    fn in_space(n: usize, precision: Precision, colour_space: ColourSpace) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("ball.rfield");
        let lamps = sphere_of_lamps(n);
        let mut photographs = Photographs::new(40, 40, folder.path());
        lamps.iter().for_each(|lamp| photographs.push(ball(lamp)).unwrap());
        let contents = Contents {
            colour_space,
            domain: Directions::new(lamps).unwrap().into(),
            irradiance: (0..n).map(|j| 1.0 + j as f32 / n as f32).collect(),
            width: 40,
            height: 40,
            precision,
            largest: photographs.largest(),
            ambient: Some(Image::from_fn(40, 40, |_, _| [0.25, 0.5, 0.75])),
            alpha: None,
            reliability: None,
            provenance: serde_json::Value::Null,
        };
        write(&path, &contents, &mut photographs).unwrap();
        let relighter = Relighter::new(Asset::open(&path, Access::Mapped).unwrap()).unwrap();
        Self { _folder: folder, path, relighter }
    }

    fn picture(&self, light: Light<'_>, look: &Look) -> Image {
        let weights = self.relighter.weights(light, look).unwrap();
        self.relighter.render(&weights, look, Window::full(40, 40)).unwrap()
    }
}

fn random_map(seed: u64) -> EnvMap {
    let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(seed);
    EnvMap::from_fn(32, 16, |_| std::array::from_fn(|_| rng.random_range(0.0..2.0)))
}

fn close(a: &Image, b: &Image, tolerance: f32) {
    let worst = a.data().iter().zip(b.data()).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(worst <= tolerance, "differs by {worst}");
}

#[test]
fn a_lamp_gives_back_its_photograph() {
    let scene = Ball::new(60, Precision::Half);
    for n in [1, 17, 60] {
        let picture = scene.picture(Light::Lamp(n), &Look::default());
        let expected = ball(&sphere_of_lamps(60)[n - 1]);
        let e = 1.0 + (n - 1) as f32 / 60.0;
        for (out, t) in picture.data().chunks(4).zip(expected.data().chunks(3)) {
            assert!((out[0] - t[0] * e).abs() <= t[0] * e / 2048.0 + 1e-7, "lamp {n}: {} is not {}", out[0], t[0] * e);
            assert_eq!(out[3], 1.0);
        }
    }
    for n in [0, 61] {
        let message = scene.relighter.weights(Light::Lamp(n), &Look::default()).unwrap_err().to_string();
        assert!(message.contains("1 to 60"), "{message}");
    }
}

#[test]
fn light_adds_and_scales() {
    let scene = Ball::new(60, Precision::Float);
    let (a, b) = (random_map(1), random_map(2));
    let both = EnvMap::new(Image::from_fn(32, 16, |i, j| {
        std::array::from_fn(|c| 2.0 * a.image().pixel(i, j)[c] + b.image().pixel(i, j)[c])
    }))
    .unwrap();
    for method in [Method::ZeroOrder, Method::Linear] {
        let look = Look { method, ..Look::default() };
        let stop_up = scene.picture(Light::Map(&a), &Look { exposure_ev: 1.0, ..look });
        let (b, both) = (scene.picture(Light::Map(&b), &look), scene.picture(Light::Map(&both), &look));
        let sum = stop_up.data().iter().zip(b.data()).map(|(a, b)| a + b).collect();
        let mut sum = Image::from_data(40, 40, 4, sum).unwrap();
        sum.data_mut().iter_mut().skip(3).step_by(4).for_each(|alpha| *alpha = 1.0);
        close(&both, &sum, 3e-5);
    }
}

#[test]
fn a_map_is_the_weighted_sum_of_the_lamps() {
    let scene = Ball::new(24, Precision::Float);
    let map = random_map(3);
    let look = Look::default();
    let weights = scene.relighter.weights(Light::Map(&map), &look).unwrap();
    let mut sum = Image::new(40, 40, 4);
    for (n, w) in weights.rgb.iter().enumerate() {
        let photograph = scene.picture(Light::Lamp(n + 1), &look);
        let e = 1.0 + n as f32 / 24.0;
        for (out, p) in sum.data_mut().chunks_mut(4).zip(photograph.data().chunks(4)) {
            (0..3).for_each(|c| out[c] += p[c] / e * w[c]);
            out[3] = 1.0;
        }
    }
    close(&scene.picture(Light::Map(&map), &look), &sum, 1e-5);
}

/// Energy: a constant map of radiance 1 gives sum_j Omega_j T_j, with sum Omega_j the covered solid angle; on a white
/// diffuse ball seen all around that is 1 everywhere.
#[test]
fn a_white_furnace_is_white() {
    let scene = Ball::new(500, Precision::Float);
    let white = EnvMap::from_fn(64, 32, |_| [1.0; 3]);
    for method in [Method::ZeroOrder, Method::Linear] {
        let look = Look { method, ..Look::default() };
        let weights = scene.relighter.weights(Light::Map(&white), &look).unwrap();
        let total: f64 = weights.rgb.iter().map(|w| f64::from(w[0])).sum();
        let covered = scene.relighter.asset().directions().unwrap().covered_solid_angle();
        assert!((total / covered - 1.0).abs() < 1e-4, "{method:?}: {total} of {covered}");
        let domain = scene.relighter.asset().directions().unwrap().clone();
        let reconstruction = Arc::new(Reconstruction::new(domain, method).unwrap());
        let omega = Operator::new(reconstruction, Outside::Drop, 64, 32).solid_angles();
        assert!(omega.iter().zip(&weights.rgb).all(|(o, w)| (o / f64::from(w[2]) - 1.0).abs() < 1e-4));
        let centre = scene.picture(Light::Map(&white), &look).pixel(20, 20)[0];
        assert!((centre - 1.0).abs() < 0.01, "{method:?}: {centre}");
    }
}

#[test]
fn windows_threads_access_and_company_change_nothing() {
    let scene = Ball::new(60, Precision::Half);
    let look = Look { ambient: 0.5, heading_deg: 20.0, ..Look::default() };
    let weights: Vec<Weights> =
        (0..6).map(|seed| scene.relighter.weights(Light::Map(&random_map(seed)), &look).unwrap()).collect();
    let whole = scene.relighter.render(&weights[0], &look, Window::full(40, 40)).unwrap();

    for window in [(0, 0, 1, 1), (3, 5, 29, 31), (16, 8, 32, 16), (39, 39, 40, 40), (7, 0, 7, 9)] {
        let window = Window { x0: window.0, y0: window.1, x1: window.2, y1: window.3 };
        let part = scene.relighter.render(&weights[0], &look, window).unwrap();
        assert_eq!(part.size(), (window.width(), window.height()));
        for y in 0..window.height() {
            for x in 0..window.width() {
                assert_eq!(part.pixel(x, y), whole.pixel(window.x0 + x, window.y0 + y), "{window:?} at {x}, {y}");
            }
        }
    }
    let outside = Window { x0: 0, y0: 0, x1: 41, y1: 40 };
    assert!(scene.relighter.render(&weights[0], &look, outside).is_err());

    for threads in [1, 3] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        assert_eq!(pool.install(|| scene.relighter.render(&weights[0], &look, Window::full(40, 40))).unwrap(), whole);
    }
    let read = Relighter::new(Asset::open(&scene.path, Access::Read).unwrap()).unwrap();
    assert_eq!(read.render(&weights[0], &look, Window::full(40, 40)).unwrap(), whole);

    let lights: Vec<(&Weights, &Look)> = weights.iter().map(|w| (w, &look)).collect();
    let together = scene.relighter.render_many(&lights, Window::full(40, 40)).unwrap();
    for (w, picture) in weights.iter().zip(&together) {
        close(picture, &scene.relighter.render(w, &look, Window::full(40, 40)).unwrap(), 1e-5);
    }
}

#[test]
fn ambient_is_added_unexposed() {
    let scene = Ball::new(24, Precision::Float);
    let dark = EnvMap::from_fn(8, 4, |_| [0.0; 3]);
    let look = Look { ambient: 2.0, exposure_ev: 3.0, ..Look::default() };
    assert_eq!(scene.picture(Light::Map(&dark), &look).pixel(3, 3), [0.5, 1.0, 1.5, 1.0]);
}

/// Which side of the ball (right, left, top, bottom, middle) shows which pole of the chart.
#[test]
fn the_six_pole_chart_lights_the_right_sides() {
    let scene = Ball::new(400, Precision::Half);
    let chart = EnvMap::six_poles(128, 64);
    let (right, left, top, bottom, middle) = ((37, 20), (2, 20), (20, 2), (20, 37), (20, 20));
    let [red, cyan, green, magenta, blue, yellow] = [[1, 0, 0], [0, 1, 1], [0, 1, 0], [1, 0, 1], [0, 0, 1], [1, 1, 0]];
    let cases = [
        (Look::default(), [(right, red), (left, cyan), (top, green), (bottom, magenta), (middle, blue)]),
        // Light from +z moves to +x.
        (
            Look { heading_deg: 90.0, ..Look::default() },
            [(right, blue), (left, yellow), (top, green), (bottom, magenta), (middle, cyan)],
        ),
        (
            Look { centre: MapCentre::Behind, ..Look::default() },
            [(right, cyan), (left, red), (top, green), (bottom, magenta), (middle, yellow)],
        ),
    ];
    for (look, sides) in cases {
        let picture = scene.picture(Light::Map(&chart), &look);
        for ((x, y), colour) in sides {
            let pixel = picture.pixel(x, y);
            let brightest = pixel[..3].iter().copied().fold(0.0, f32::max);
            for c in 0..3 {
                // The chart's discs are narrow, so another pole adds little at grazing angles.
                let lit = pixel[c] > 0.5 * brightest;
                assert_eq!(lit, colour[c] == 1, "{look:?}: pixel ({x}, {y}) is {pixel:?}, expected {colour:?}");
            }
        }
    }
}

#[test]
fn a_look_is_its_operations_one_after_another() {
    let scene = Ball::new(60, Precision::Float);
    let map = random_map(4);
    let look = Look {
        heading_deg: 30.0,
        pitch_deg: -50.0,
        roll_deg: 110.0,
        centre: MapCentre::Behind,
        clamp: 1.25,
        blur_deg: 9.0,
        exposure_ev: 1.0,
        tint: [0.5, 1.0, 3.0],
        ..Look::default()
    };
    let by_hand = map.clamped(1.25).blurred(9.0).turned(MapCentre::Behind, &look.orientation()).scaled([1.0, 2.0, 6.0]);
    let neutral = Look::default();
    let (a, b) = (scene.picture(Light::Map(&map), &look), scene.picture(Light::Map(&by_hand), &neutral));
    close(&a, &b, 1e-5);
    // A lamp is tinted and exposed, and nothing else is done to it.
    let (lamp, tinted) = (scene.picture(Light::Lamp(7), &neutral), scene.picture(Light::Lamp(7), &look));
    for (lamp, tinted) in lamp.data().chunks(4).zip(tinted.data().chunks(4)) {
        assert!((0..3).all(|c| (tinted[c] - lamp[c] * [1.0, 2.0, 6.0][c]).abs() < 1e-6));
    }
}

/// `out = M_out (T (M_in L) + g S)`.
#[test]
fn colours_are_carried_to_the_asset_and_from_it() {
    let scene = Ball::in_space(60, Precision::Float, ColourSpace::AcesCg);
    assert_eq!(scene.relighter.asset().colour_space(), ColourSpace::AcesCg);
    let map = random_map(6);
    let look = Look {
        map_space: ColourSpace::LinRec709,
        output_space: ColourSpace::LinP3D65,
        ambient: 0.5,
        tint: [1.0, 0.5, 2.0],
        ..Look::default()
    };
    let inside = Look { map_space: ColourSpace::AcesCg, output_space: ColourSpace::AcesCg, ..look };
    let carried = map.clone().converted(&Conversion::between(ColourSpace::LinRec709, ColourSpace::AcesCg));
    let mut expected = scene.picture(Light::Map(&carried), &inside);
    expected.convert(&Conversion::between(ColourSpace::AcesCg, ColourSpace::LinP3D65));
    close(&scene.picture(Light::Map(&map), &look), &expected, 1e-5);
    // White light on a white ball is white in every space; E of a lamp has no colour to convert.
    let lamp = scene.picture(Light::Lamp(1), &Look { map_space: ColourSpace::LinRec2020, ..Look::default() });
    assert!(lamp.data().chunks(4).all(|p| (p[0] - p[1]).abs() < 1e-6 && (p[2] - p[1]).abs() < 1e-6));
}

#[test]
fn projections_are_kept_and_bounded() {
    let scene = Ball::new(24, Precision::Half);
    let map = random_map(1);
    let first = scene.relighter.weights(Light::Map(&map), &Look::default()).unwrap();
    for method in [Method::ZeroOrder, Method::Linear] {
        for outside in [Outside::Drop, Outside::Nearest] {
            for size in [8, 16] {
                let map = EnvMap::from_fn(size, size / 2, |_| [1.0; 3]);
                let look = Look { method, outside, ..Look::default() };
                scene.relighter.weights(Light::Map(&map), &look).unwrap();
            }
        }
    }
    assert_eq!(scene.relighter.weights(Light::Map(&map), &Look::default()).unwrap(), first);
}

#[test]
fn lamps_left_out_are_worked_around() {
    let scene = Ball::new(60, Precision::Float);
    let asset = Asset::open(&scene.path, Access::Mapped).unwrap();
    let without = Relighter::without(asset, &[3, 60]).unwrap();
    let map = EnvMap::from_fn(64, 32, |_| [1.0; 3]);
    for method in [Method::Linear, Method::BSpline] {
        let look = Look { method, ..Look::default() };
        let weights = without.weights(Light::Map(&map), &look).unwrap();
        assert_eq!((weights.rgb[2], weights.rgb[59]), ([0.0; 3], [0.0; 3]));
        let sum: f32 = weights.rgb.iter().map(|w| w[1]).sum();
        assert!((sum / (4.0 * std::f32::consts::PI) - 1.0).abs() < 1e-4, "the others take their place: {sum}");
    }
    assert_ne!(without.weights(Light::Lamp(3), &Look::default()).unwrap().rgb[2], [0.0; 3]);
    for (bad, what) in [(vec![0], "lamp 0"), (vec![61], "lamp 61"), ((1..=60).collect(), "all of them")] {
        let asset = Asset::open(&scene.path, Access::Mapped).unwrap();
        let message = Relighter::without(asset, &bad).unwrap_err().to_string();
        assert!(message.contains(what), "{message}");
    }
}
