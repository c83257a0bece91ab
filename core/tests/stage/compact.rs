//! What compact representations promise: the error stored for each pixel bounds every picture.

use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use relume_core::domain::Directions;
use relume_core::evaluate::sliver::{SLIVER_MAP, headings};
use relume_core::field::compress::{Scheme, compress};
use relume_core::field::{Access, Asset, Contents, Kind, Precision, write};
use relume_core::illumination::EnvMap;
use relume_core::image::{Image, Window};
use relume_core::reconstruct::Outside;
use relume_core::relight::{Light, Look, Relighter, Weights};
use relume_core::simulate::{Camera, Quality, Scene, Stage, grid_lamps};

pub const SIZE: (usize, usize) = (74, 51);

/// The demonstration's still life under 32 x 10 lamps: mirror, glass, gold, shadows, and black around it. Photographed once.
pub fn still_life(folder: &Path) -> PathBuf {
    static BYTES: OnceLock<Vec<u8>> = OnceLock::new();
    let path = folder.join("samples.rfield");
    let bytes = BYTES.get_or_init(|| {
        photograph(&path);
        std::fs::read(&path).unwrap()
    });
    std::fs::write(&path, bytes).unwrap();
    path
}

fn photograph(path: &Path) {
    let (width, height) = SIZE;
    let quality = Quality { samples: 8, bounces: 2, stride: 4, cone_density: 0.25, depth: 1, seed: 3 };
    let (scene, camera) = (Scene::demo(), Camera::demo(width, height));
    let domain = Directions::new(grid_lamps(32, 10)).unwrap();
    let stage = Stage::new(&scene, camera, &domain, quality);
    let contents = Contents {
        colour_space: Default::default(),
        irradiance: (0..domain.len()).map(|j| 1.0 + j as f32 / 100.0).collect(),
        domain: domain.into(),
        width,
        height,
        precision: Precision::Half,
        largest: stage.largest(),
        ambient: None,
        alpha: None,
        reliability: None,
        provenance: serde_json::json!({"source": "virtual stage"}),
    };
    write(path, &contents, &mut stage.bands(&mut |_, _| Ok(()))).unwrap();
}

/// Random radiance; the sun in a dim sky; slivers of light at some headings.
pub fn maps() -> Vec<EnvMap> {
    let noise = |d: &relume_core::math::Vec3| {
        std::array::from_fn(|c| ((d.x * 7.1 + d.y * 5.3 * (c + 1) as f64).sin() * 43.0 + d.z * 17.0).sin().abs() as f32)
    };
    let towards = relume_core::math::Vec3::new(0.5, 0.6, 0.62).normalize();
    let sun = |d: &relume_core::math::Vec3| if d.dot(&towards) > 0.999 { [900.0, 800.0, 600.0] } else { [0.02; 3] };
    let sliver = |heading: f64| {
        move |d: &relume_core::math::Vec3| {
            let off = (d.x.atan2(d.z) - heading + std::f64::consts::PI).rem_euclid(std::f64::consts::TAU);
            [f32::from(u8::from((off - std::f64::consts::PI).abs() < 0.05)); 3]
        }
    };
    let (w, h) = SLIVER_MAP;
    let mut maps = vec![EnvMap::from_fn(w / 4, h / 4, noise), EnvMap::from_fn(w, h, sun)];
    maps.extend(headings(6).into_iter().map(|heading| EnvMap::from_fn(w, h, sliver(heading))));
    maps
}

fn lit(relighter: &Relighter, light: Light<'_>, look: &Look) -> (Weights, Image) {
    let weights = relighter.weights(light, look).unwrap();
    let picture = relighter.render(&weights, look, Window::full(SIZE.0, SIZE.1)).unwrap();
    (weights, picture)
}

/// The largest part of its bound that the difference of two pictures takes up.
fn used(compact: &Image, reference: &Image, errors: &[f32], weights: &Weights) -> f32 {
    let norm = |c: usize| weights.rgb.iter().map(|w| f64::from(w[c]).powi(2)).sum::<f64>().sqrt() as f32;
    let norms = [norm(0), norm(1), norm(2)];
    let mut most: f32 = 0.0;
    for (i, e) in errors.iter().enumerate() {
        for (c, norm) in norms.iter().enumerate() {
            let (a, b) = (compact.data()[4 * i + c], reference.data()[4 * i + c]);
            // Sums of some hundred products in single precision.
            let rounding = 1e-5 * (a.abs() + b.abs()) + 1e-7 * norm;
            let bound = e * norm + rounding;
            assert!((a - b).abs() <= bound, "pixel {i}, channel {c}: {a} against {b}, bound {bound}");
            if e * norm > 10.0 * rounding {
                most = most.max((a - b).abs() / (e * norm));
            }
        }
    }
    most
}

#[test]
fn the_error_of_a_pixel_bounds_its_pictures() {
    let folder = tempfile::tempdir().unwrap();
    let source = Asset::open(&still_life(folder.path()), Access::Mapped).unwrap();
    let schemes =
        [(Kind::Harmonics, Scheme::Harmonics { functions: 25 }), (Kind::Factored, Scheme::Factored { error: 0.04 })];
    for (kind, scheme) in schemes {
        let path = folder.path().join("compact.rfield");
        compress(&source, &path, &scheme, &[Kind::Dense], &mut |_, _, _| Ok(())).unwrap();
        let relighter = Relighter::new(Asset::open(&path, Access::Mapped).unwrap()).unwrap();
        let errors = relighter.asset().errors(kind).unwrap().unwrap();
        let exact = Look { representation: Some(Kind::Dense), outside: Outside::Nearest, ..Look::default() };
        let compact = Look { representation: Some(kind), ..exact };
        let maps = maps();
        let lights = maps.iter().map(Light::Map).chain([Light::Lamp(1), Light::Lamp(77), Light::Lamp(320)]);
        let mut most: f32 = 0.0;
        for light in lights {
            let (weights, picture) = lit(&relighter, light, &compact);
            let (_, reference) = lit(&relighter, light, &exact);
            most = most.max(used(&picture, &reference, &errors, &weights));
        }
        // A bound that nothing comes near would promise little.
        assert!(most > 0.3, "{kind:?}: at most {most} of the bound is used");
    }
}

/// Where the fit is what relighting by harmonics does, storing it changes nothing but the rounding.
#[test]
fn stored_harmonics_are_smooth_and_measured() {
    let folder = tempfile::tempdir().unwrap();
    let source = Asset::open(&still_life(folder.path()), Access::Mapped).unwrap();
    let path = folder.path().join("compact.rfield");
    let mut stages = Vec::new();
    compress(&source, &path, &Scheme::Harmonics { functions: 225 }, &[], &mut |stage, done, all| {
        assert!(done <= all);
        if stages.last() != Some(&stage) {
            stages.push(stage);
        }
        Ok(())
    })
    .unwrap();
    assert_eq!(stages.len(), 3, "{stages:?}");
    let made = Asset::open(&path, Access::Mapped).unwrap();
    made.verify(&mut |_, _| Ok(())).unwrap();
    assert!(made.dense().is_none());
    let message = made.samples().unwrap_err().to_string();
    assert!(message.contains("holds harmonics alone"), "{message}");
    // The reached error is that of the map, squared and summed over pixels, up to the worst of three channels.
    let errors = made.errors(Kind::Harmonics).unwrap().unwrap();
    let samples = source.samples().unwrap();
    let mut energy = 0.0;
    for (x, y) in (0..SIZE.1).flat_map(|y| (0..SIZE.0).map(move |x| (x, y))) {
        energy += samples.reflectance(x, y).unwrap().iter().flatten().map(|t| f64::from(*t).powi(2)).sum::<f64>();
    }
    let worst: f64 = errors.iter().map(|e| f64::from(*e).powi(2)).sum();
    let reached = made.manifest().representations[0].loss().unwrap().reached;
    let share = reached * reached * energy / worst;
    assert!((1.0..=3.0).contains(&share), "{share}");
}

/// What is stored is a least-squares fit: a soft light relights as by the samples.
#[test]
fn soft_light_is_what_harmonics_are_for() {
    let folder = tempfile::tempdir().unwrap();
    let source = Asset::open(&still_life(folder.path()), Access::Mapped).unwrap();
    let path = folder.path().join("compact.rfield");
    compress(&source, &path, &Scheme::Harmonics { functions: 225 }, &[Kind::Dense], &mut |_, _, _| Ok(())).unwrap();
    let relighter = Relighter::new(Asset::open(&path, Access::Mapped).unwrap()).unwrap();
    let map = EnvMap::from_fn(64, 32, |d| [0.6 + 0.4 * d.y as f32, 0.5 + 0.5 * d.x as f32, 0.5]);
    let (_, reference) = lit(&relighter, Light::Map(&map), &Look::default());
    let (_, picture) =
        lit(&relighter, Light::Map(&map), &Look { representation: Some(Kind::Harmonics), ..Look::default() });
    let off: f64 = picture.data().iter().zip(reference.data()).map(|(a, b)| f64::from(a - b).powi(2)).sum();
    let all: f64 = reference.data().iter().map(|b| f64::from(*b).powi(2)).sum();
    // What is lost of the functions themselves is some 20 times as much.
    let reached = relighter.asset().manifest().representation(Kind::Harmonics).unwrap().loss().unwrap().reached;
    assert!((off / all).sqrt() < 0.02 && reached > 0.2, "{} of {reached}", (off / all).sqrt());
}

#[test]
fn an_asset_holds_several_and_is_told_which_to_use() {
    let folder = tempfile::tempdir().unwrap();
    let source = still_life(folder.path());
    let (both, alone) = (folder.path().join("both.rfield"), folder.path().join("alone.rfield"));
    let scheme = Scheme::Harmonics { functions: 25 };
    let open = |path: &Path| Asset::open(path, Access::Mapped).unwrap();
    compress(&open(&source), &both, &scheme, &[Kind::Dense], &mut |_, _, _| Ok(())).unwrap();
    compress(&open(&both), &alone, &scheme, &[], &mut |_, _, _| Ok(())).unwrap();
    let (both, alone) = (Relighter::new(open(&both)).unwrap(), Relighter::new(open(&alone)).unwrap());
    assert_eq!(both.choose(None, false).unwrap(), Kind::Dense);
    assert_eq!(both.choose(Some(Kind::Harmonics), true).unwrap(), Kind::Harmonics);
    for captured_lamp in [false, true] {
        assert_eq!(alone.choose(None, captured_lamp).unwrap(), Kind::Harmonics);
    }
    let message = alone.choose(Some(Kind::Dense), false).unwrap_err().to_string();
    assert!(message.contains("no `dense` representation"), "{message}");
    // The samples are gone, and errors against them can no longer be measured.
    let message = compress(alone.asset(), &source, &scheme, &[], &mut |_, _, _| Ok(())).unwrap_err().to_string();
    assert!(message.contains("no longer holds its samples"), "{message}");
}

#[test]
fn what_cannot_be_done_leaves_no_file() {
    let folder = tempfile::tempdir().unwrap();
    let source = Asset::open(&still_life(folder.path()), Access::Mapped).unwrap();
    let path = folder.path().join("compact.rfield");
    let before = std::fs::read_dir(folder.path()).unwrap().count();
    for functions in [0, 1, 24, 626, 676] {
        let message = compress(&source, &path, &Scheme::Harmonics { functions }, &[], &mut |_, _, _| Ok(()))
            .unwrap_err()
            .to_string();
        assert!(message.contains("a square number from 4 to 625"), "{message}");
    }
    // Stopped in the middle of each stage.
    for stop in 0..3 {
        let mut stages = Vec::new();
        let stopped = compress(&source, &path, &Scheme::Harmonics { functions: 25 }, &[], &mut |stage, _, _| {
            if stages.last() != Some(&stage) {
                stages.push(stage);
            }
            if stages.len() > stop { Err(relume_core::Error::Cancelled) } else { Ok(()) }
        });
        assert!(matches!(stopped, Err(relume_core::Error::Cancelled)));
    }
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), before);
}
