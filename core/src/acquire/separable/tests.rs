//! The scheme on transport that is made up: direct light alone, and light over other surfaces.

use rand::{RngExt, SeedableRng};
use rand_distr::StandardNormal;
use rand_pcg::Pcg32;

use super::*;
use crate::domain::patterns::{Kind, PatternSet};
use crate::domain::{Filter, Plane};

const SIDE: usize = 12;
const SIZE: (usize, usize) = (36, 30);

/// Pixel (x, y) is lit by a square of its own, and by all squares evenly with `indirect` of that in all.
fn answer(x: usize, y: usize, column: usize, row: usize, indirect: f32) -> [f32; 3] {
    let own = (x * SIDE / SIZE.0, y * SIDE / SIZE.1) == (column, row);
    let albedo = 0.4 + 0.3 * ((x * 7 + y * 3) % 5) as f32 / 5.0;
    let even = indirect / (SIDE * SIDE) as f32;
    [1.0, 0.7, 0.4].map(|c| c * albedo * (f32::from(u8::from(own)) + even))
}

/// Photographs under the patterns as they are shown, in their order; noise of a deviation, and black of the same.
fn photographs(influence: usize, indirect: impl Fn(usize) -> f32, noise: f32) -> Vec<Image> {
    let set =
        PatternSet::new(Kind::Crossed { side: SIDE, influence, filter: Filter::Box }, Plane::new(SIDE, SIDE).unwrap())
            .unwrap();
    let mut rng = Pcg32::seed_from_u64(9);
    let mut shot = |clean: Image| {
        let mut clean = clean;
        clean.data_mut().iter_mut().for_each(|v| *v += noise * rng.sample::<f32, _>(StandardNormal));
        clean
    };
    let black = shot(Image::new(SIZE.0, SIZE.1, 3));
    let lit = |n: usize| {
        let values = set.pattern(n).values;
        Image::from_fn(SIZE.0, SIZE.1, |x, y| {
            let mut sum = [0.0; 3];
            for (square, _) in values.iter().enumerate().filter(|(_, v)| **v > 0.0) {
                let light = answer(x, y, square % SIDE, square / SIDE, indirect(x));
                sum.iter_mut().zip(light).for_each(|(s, v)| *s += v);
            }
            sum
        })
    };
    let mut all: Vec<Image> = (0..set.len()).map(|n| shot(lit(n))).collect();
    all.iter_mut().for_each(|p| p.data_mut().iter_mut().zip(black.data()).for_each(|(v, b)| *v -= b));
    all
}

fn position(influence: usize, indirect: impl Fn(usize) -> f32, noise: f32) -> Position {
    Separable::new(SIDE, influence).unwrap().position("position 7", photographs(influence, indirect, noise)).unwrap()
}

#[test]
fn direct_light_comes_back_exactly_for_every_influence() {
    for influence in [1, 2, 3, 5, SIDE] {
        let position = position(influence, |_| 0.0, 0.0);
        assert_eq!(position.noise(), 0.0);
        for (column, row) in [(0, 0), (3, 7), (11, 4), (11, 11)] {
            let found = position.square(column, row);
            let wanted = Image::from_fn(SIZE.0, SIZE.1, |x, y| answer(x, y, column, row, 0.0));
            assert_eq!(found, wanted, "({column}, {row}), d = {influence}");
        }
        let (agreement, reliability) = (position.agreement(), position.reliability());
        assert!(agreement.holds() && agreement.difference < 1e-6);
        assert_eq!((reliability.affected(1e-3), reliability.judged()), (0.0, 1.0));
        assert!(position.remarks(Reliability::THRESHOLD).is_empty());
    }
}

/// `(a + n^2 (n / d) e) / (a + n^2 e)`, and an influence of n is brute force.
#[test]
fn light_over_other_surfaces_shows_as_the_excess_it_should() {
    for (influence, indirect) in [(3, 0.5f32), (3, 0.1), (4, 1.0), (SIDE, 1.0)] {
        let reliability = position(influence, |_| indirect, 0.0).reliability();
        let wanted = f64::from(indirect) * (SIDE as f64 / influence as f64 - 1.0) / (1.0 + f64::from(indirect));
        let found = reliability.excess(18, 15).unwrap();
        assert!((found - wanted).abs() < 1e-3 * wanted + 1e-5, "d = {influence}: {found}, not {wanted}");
    }
    // Half of the picture, and a larger d foretold.
    let half = |x: usize| if x < SIZE.0 / 2 { 0.12 } else { 0.0 };
    let there = position(2, half, 0.0);
    let affected = there.reliability().affected(0.2);
    assert!((affected - 0.5).abs() < 0.1, "{affected}");
    let (larger, left) = there.reliability().larger_influence(0.2).unwrap();
    assert!(larger == 5 && left == 0.0, "{larger}, {left}");
    let remarks = there.remarks(0.2);
    assert!(
        remarks.len() == 1 && remarks[0].contains("position 7") && remarks[0].contains("--influence 5"),
        "{remarks:?}"
    );
    assert!(position(larger, half, 0.0).remarks(0.2).is_empty());
    let strong = position(3, |_| 3.0, 0.0).remarks(0.1);
    assert!(strong[0].contains("100 %") && strong[0].contains("brute force"), "{strong:?}");
}

/// Noise of a hundredth of what a pixel answers: measured, and without a bias that adds up.
#[test]
fn noise_is_measured_and_darkens_nothing() {
    let noisy = position(3, |x| if x < SIZE.0 / 2 { 0.6 } else { 0.0 }, 0.001);
    assert!((noisy.noise() / 0.001 - 1.0).abs() < 0.1, "{}", noisy.noise());
    let reliability = noisy.reliability();
    assert!(reliability.judged() > 0.99, "{}", reliability.judged());
    let mean = |x: std::ops::Range<usize>| {
        let pixels: Vec<f64> =
            x.flat_map(|x| (2..28).map(move |y| (x, y))).map(|(x, y)| reliability.excess(x, y).unwrap()).collect();
        pixels.iter().sum::<f64>() / pixels.len() as f64
    };
    let (good, bad) = (mean(22..34), mean(2..14));
    assert!(good.abs() < 0.02 && (bad - 1.125).abs() < 0.05, "{good}, {bad}");
    // A window reaches over the border by up to four of the 36 pixels.
    assert!((reliability.affected(0.1) - 0.5).abs() < 0.15);
    // The plain minimum: 0.56 deviations in each of the dark squares.
    let plain = noisy.plain().reliability();
    let lost = (22..34).map(|x| plain.excess(x, 15).unwrap()).sum::<f64>() / 12.0;
    assert!(lost < -0.03, "{lost}");
    // What is nothing but noise is not judged.
    let dark = Separable::new(SIDE, 3).unwrap();
    let photographs = photographs(3, |_| 0.0, 0.001).into_iter().map(|mut p| {
        p.data_mut().iter_mut().for_each(|v| *v = v.clamp(-0.004, 0.004));
        p
    });
    let dark = dark.position("position 1", photographs.collect()).unwrap().reliability();
    assert!(dark.judged() < 0.1, "{}", dark.judged());
}

#[test]
fn sets_that_disagree_are_told() {
    let scheme = Separable::new(SIDE, 3).unwrap();
    let mut changed = photographs(3, |_| 0.0, 0.0005);
    let count = changed.len();
    changed[count / 2..].iter_mut().for_each(|p| p.data_mut().iter_mut().for_each(|v| *v *= 1.05));
    let brighter = scheme.position("position 3", changed).unwrap();
    assert!((brighter.agreement().difference - 0.05).abs() < 0.01, "{:?}", brighter.agreement());
    let remark = &brighter.remarks(0.1)[0];
    assert!(
        remark.contains("position 3") && remark.contains("differ by 4.9 %") || remark.contains("5.0 %"),
        "{remark}"
    );
    assert!(scheme.position("position 3", photographs(3, |_| 0.3, 0.002)).unwrap().agreement().holds());
}

#[test]
fn photographs_that_are_missing_are_named() {
    let scheme = Separable::new(3, 2).unwrap();
    let picture = || Image::from_fn(4, 4, |_, _| [0.2; 3]);
    let gather = |black: bool, missing: usize| {
        let mut gathering = scheme.gather("position 4");
        (0..12).filter(|n| *n != missing).for_each(|n| gathering.photograph(n, picture()).unwrap());
        if black {
            gathering.black(Image::from_fn(4, 4, |_, _| [0.05; 3]));
        }
        gathering
    };
    let whole = gather(true, 99).complete().unwrap();
    assert!((whole.square(1, 1).pixel(2, 2)[0] - 0.15).abs() < 1e-6);
    for (bad, words) in [
        (gather(false, 99).complete(), "position 4: found no black photograph"),
        (gather(true, 7).complete(), "no photograph of hv 8 (1 are missing)"),
        (scheme.position("position 4", vec![picture(); 11]), "11 photographs, expected 12"),
        (scheme.position("position 4", vec![Image::from_fn(2, 2, |_, _| [f32::NAN; 3]); 12]), "not finite"),
    ] {
        let message = bad.unwrap_err().to_string();
        assert!(message.contains(words), "{message}");
    }
    let mut odd = gather(true, 3);
    odd.photograph(3, Image::new(5, 4, 3)).unwrap();
    assert!(odd.complete().unwrap_err().to_string().contains("5 x 4"));
    assert!(scheme.gather("position 4").photograph(12, picture()).is_err());
    for (side, influence) in [(4, 0), (4, 5)] {
        assert!(Separable::new(side, influence).unwrap_err().to_string().contains("1 to 4"));
    }
}
