//! Lamps that failed on the virtual stage, and sets in which none did.

use std::ops::Range;
use std::path::Path;

use relume_core::Result;
use relume_core::calibrate::failed::{LampCheck, check_lamps};
use relume_core::domain::Directions;
use relume_core::field::{self, Access, Asset, Bands, Contents, Precision};
use relume_core::math::Vec3;
use relume_core::simulate::{Camera, Quality, Scene, Stage, demo_lamps};

/// Bands with some lamps dimmed.
struct Dimmed<'a> {
    bands: &'a mut dyn Bands,
    lamps: usize,
    /// Number from 1, and the share of its light that is left.
    dim: &'a [(usize, f32)],
}

impl Bands for Dimmed<'_> {
    fn fill(&mut self, by: usize, columns: Range<usize>, blocks: &mut [f32]) -> Result<()> {
        self.bands.fill(by, columns, blocks)?;
        for (n, element) in blocks.chunks_exact_mut(128).enumerate() {
            let number = n % self.lamps + 1;
            for (_, left) in self.dim.iter().filter(|(lamp, _)| *lamp == number) {
                element.iter_mut().for_each(|t| *t *= left);
            }
        }
        Ok(())
    }
}

fn check(lamps: &Directions, dim: &[(usize, f32)], folder: &Path) -> LampCheck {
    check_lamps(&asset(lamps, dim, folder), &mut |_, _| Ok(())).unwrap()
}

fn asset(lamps: &Directions, dim: &[(usize, f32)], folder: &Path) -> Asset {
    let (scene, camera) = (Scene::demo(), Camera::demo(64, 48));
    let quality = Quality { samples: 4, bounces: 4, stride: 4, cone_density: 300.0, depth: 4, seed: 2 };
    let stage = Stage::new(&scene, camera, lamps, quality);
    let contents = Contents {
        colour_space: Default::default(),
        domain: lamps.clone().into(),
        irradiance: vec![std::f32::consts::PI; lamps.len()],
        width: 64,
        height: 48,
        precision: Precision::Half,
        largest: stage.largest(),
        ambient: None,
        alpha: None,
        reliability: None,
        provenance: serde_json::Value::Null,
    };
    let path = folder.join("a.rfield");
    let mut progress = |_, _| Ok(());
    let mut bands = stage.bands(&mut progress);
    field::write(&path, &contents, &mut Dimmed { bands: &mut bands, lamps: lamps.len(), dim }).unwrap();
    Asset::open(&path, Access::Read).unwrap()
}

fn numbers(check: &LampCheck) -> Vec<usize> {
    let mut numbers: Vec<usize> = check.failed.iter().map(|failed| failed.lamp).collect();
    numbers.sort_unstable();
    numbers
}

/// Rings of lamps, the lowest 6 degrees above the horizon of a dome about +z.
fn rings() -> Vec<Vec3> {
    let ring = |elevation: f64, count: usize| {
        (0..count).map(move |i| {
            let ((s, c), (up, out)) =
                ((std::f64::consts::TAU * i as f64 / count as f64).sin_cos(), elevation.to_radians().sin_cos());
            Vec3::new(c * out, s * out, up)
        })
    };
    [(6.0, 24), (22.0, 22), (38.0, 18), (54.0, 12), (72.0, 6)].into_iter().flat_map(|(e, n)| ring(e, n)).collect()
}

/// Each set with nothing wrong, and with some lamps dark or dim: those are found, and no others.
#[test]
fn dark_and_dim_lamps_are_found_and_no_others() {
    let folder = tempfile::tempdir().unwrap();
    let arc: &[&[(usize, f32)]] = &[&[], &[(7, 0.0), (19, 0.5)], &[(7, 0.0), (8, 0.0), (113, 0.0)], &[(33, 2.0)]];
    let domes: &[&[(usize, f32)]] = &[&[], &[(7, 0.0), (31, 0.5)], &[(7, 0.0), (8, 0.0), (82, 0.3)]];
    // Lamps 25 degrees apart: only what is dark stands out.
    let few: &[&[(usize, f32)]] = &[&[], &[(7, 0.0)]];
    for (name, lamps, cases) in [("arc", demo_lamps(120), arc), ("rings", rings(), domes), ("few", demo_lamps(40), few)]
    {
        let lamps = Directions::new(lamps).unwrap();
        for dim in cases {
            let found = check(&lamps, dim, folder.path());
            let expected: Vec<usize> = dim.iter().map(|(lamp, _)| *lamp).collect();
            assert_eq!(numbers(&found), expected, "{name}: {found:?}");
            for failed in &found.failed {
                let (_, left) = dim.iter().find(|(lamp, _)| *lamp == failed.lamp).unwrap();
                assert_eq!(failed.off < 0.0, *left < 1.0, "{name}: {failed:?}");
            }
        }
    }
}

#[test]
fn too_few_lamps_cannot_tell() {
    let folder = tempfile::tempdir().unwrap();
    let lamps = Directions::new(demo_lamps(11)).unwrap();
    let path = asset(&lamps, &[], folder.path());
    let message = check_lamps(&path, &mut |_, _| Ok(())).unwrap_err().to_string();
    assert!(message.contains("11 directions") && message.contains("--lamp"), "{message}");
}
