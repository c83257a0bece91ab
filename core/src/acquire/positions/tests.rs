//! What comes back is what went in, up to the error asked for; spikes are cheap; bounds are kept.

use std::ops::Range;
use std::sync::Arc;

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg32;

use super::*;
use crate::domain::{Filter, Gantry, Pose};
use crate::field::{Access, Asset, Contents, Precision, write_terms};
use crate::image::ColourSpace;
use crate::math::Vec3;

const SIDE: usize = 8;
const SIZE: (usize, usize) = (37, 19);

/// `values(square, x, y, channel)` as a source.
struct Made<'a>(&'a dyn Fn(usize, usize, usize, usize) -> f32, usize);

impl Bands for Made<'_> {
    fn fill(&mut self, by: usize, columns: Range<usize>, blocks: &mut [f32]) -> Result<()> {
        let layout = Layout { width: SIZE.0, height: SIZE.1, elements: self.1 };
        for (n, block) in blocks.chunks_exact_mut(layout.block_len()).enumerate() {
            for (at, value) in block.iter_mut().enumerate() {
                let (square, k) = (at / BLOCK_PIXELS, at % BLOCK_PIXELS);
                let (x, y) = ((columns.start + n / 3) * 16 + k % 16, by * 8 + k / 16);
                if x < SIZE.0 && y < SIZE.1 {
                    *value = (self.0)(square, x, y, n % 3);
                }
            }
        }
        Ok(())
    }
}

/// A square that each pixel sees, and smooth light over all.
fn answer(position: usize, square: usize, x: usize, y: usize, c: usize) -> f32 {
    let seen = (x * SIDE / SIZE.0 + SIDE * (y * SIDE / SIZE.1) + position) % (SIDE * SIDE);
    let (column, row) = ((square % SIDE) as f32, (square / SIDE) as f32);
    let smooth = 0.01 * (1.0 + 0.3 * (0.2 * column + 0.1 * row + position as f32).sin());
    let spike = if square == seen { 1.0 + 0.2 * c as f32 } else { 0.0 };
    spike + smooth * (1.0 + 0.1 * c as f32)
}

fn gantry() -> Gantry {
    let poses = [Vec3::new(0.0, 0.0, 4.0), Vec3::new(2.0, 0.0, 3.0), Vec3::new(0.0, 3.0, 3.0)].map(Pose::at_origin);
    Gantry::new(poses.to_vec(), SIDE, 0.5, Filter::Box).unwrap()
}

fn written(error: f64, answer: &dyn Fn(usize, usize, usize, usize, usize) -> f32) -> (Asset, f64, u64) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.rfield");
    let gantry = gantry();
    let mut terms = PositionTerms::new(SIZE, (3, gantry.picture()), error, &path).unwrap();
    for position in 0..3 {
        let of_position = |square, x, y, c| answer(position, square, x, y, c);
        terms.push(&mut Made(&of_position, SIDE * SIDE)).unwrap();
    }
    let contents = Contents {
        domain: crate::domain::Domain::Gantry(Arc::new(gantry)),
        irradiance: vec![1.0; 3],
        width: SIZE.0,
        height: SIZE.1,
        colour_space: ColourSpace::default(),
        precision: Precision::Half,
        largest: terms.largest(),
        ambient: None,
        alpha: None,
        reliability: None,
        provenance: serde_json::Value::Null,
    };
    let (basis, lost, count) = (terms.basis(), terms.lost(), terms.terms());
    write_terms(&path, &contents, (basis, None), &mut terms).unwrap();
    (Asset::open(&path, Access::Read).unwrap(), lost, count)
}

#[test]
fn spikes_and_smooth_light_come_back_from_few_terms() {
    let (asset, lost, terms) = written(0.01, &answer);
    assert!(lost < 0.01, "{lost}");
    let pixels = (SIZE.0 * SIZE.1) as f64;
    assert!((terms as f64) < 3.0 * 5.0 * pixels, "{} terms a pixel", terms as f64 / pixels);
    let sparse = asset.sparse().unwrap();
    let (mut off, mut all) = (0.0f64, 0.0f64);
    for (x, y) in [(0, 0), (36, 18), (17, 9), (30, 4)] {
        let function = sparse.reflectance(x, y).unwrap();
        for (element, rgb) in function.iter().enumerate() {
            for (c, found) in rgb.iter().enumerate() {
                let expected = answer(element / 64, element % 64, x, y, c);
                off += f64::from(found - expected).powi(2);
                all += f64::from(expected).powi(2);
            }
        }
    }
    assert!((off / all).sqrt() < 0.012, "{}", (off / all).sqrt());
}

#[test]
fn even_light_is_kept_where_spikes_are_bright() {
    let (asset, ..) = written(0.02, &answer);
    let sparse = asset.sparse().unwrap();
    for (x, y) in [(3, 3), (20, 11), (36, 0)] {
        let expected: f32 = (0..192).map(|e| answer(e / 64, e % 64, x, y, 1)).sum();
        let found: f32 = sparse.reflectance(x, y).unwrap().iter().map(|rgb| rgb[1]).sum();
        assert!((found / expected - 1.0).abs() < 0.01, "{found} is not {expected}");
    }
}

#[test]
fn noise_is_left_out() {
    let mut rng = Pcg32::seed_from_u64(1);
    let noise: Vec<f32> = (0..3 * 64 * SIZE.0 * SIZE.1 * 3)
        .map(|_| 0.002 * ((0..12).map(|_| rng.random::<f32>()).sum::<f32>() - 6.0))
        .collect();
    let noisy = |position: usize, square: usize, x: usize, y: usize, c: usize| {
        let at = (((position * 64 + square) * SIZE.1 + y) * SIZE.0 + x) * 3 + c;
        answer(position, square, x, y, c) + noise[at]
    };
    let (clean, noisy) = (written(0.002, &answer), written(0.002, &noisy));
    assert!((noisy.2 as f64) < 1.3 * clean.2 as f64, "{} terms, {} without noise", noisy.2, clean.2);
}

#[test]
fn what_cannot_be_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.rfield");
    let squares = gantry().picture();
    assert!(PositionTerms::new(SIZE, (1, squares), 0.0, &path).is_err());
    let mut terms = PositionTerms::new(SIZE, (1, squares), 0.01, &path).unwrap();
    let early = terms.fill(0, 0, &mut BlockTerms::default()).unwrap_err().to_string();
    assert!(early.contains("0 of 1 positions"), "{early}");
    let black = |_, _, _, _| 0.0;
    terms.push(&mut Made(&black, 64)).unwrap();
    assert!(terms.push(&mut Made(&black, 64)).unwrap_err().to_string().contains("one position more"));
    terms.fill(0, 0, &mut BlockTerms::default()).unwrap();
    assert_eq!(terms.terms(), 0);
}
