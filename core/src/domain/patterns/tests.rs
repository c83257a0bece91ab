//! Patterns by what they are for: that the measurement they belong to can be read back from them.

use super::*;
use crate::wavelet::Normalisation;

const WAVELETS: [Wavelet; 3] = [Wavelet::Haar, Wavelet::LeGall53, Wavelet::Daubechies97];

fn set(kind: Kind, columns: usize, rows: usize) -> PatternSet {
    PatternSet::new(kind, Plane::new(columns, rows).unwrap()).unwrap()
}

fn noise(wavelet: Wavelet, seed: u64, deviation: f64) -> Kind {
    Kind::Noise(Noise { wavelet, count: 40, seed, deviation })
}

/// Of every kind one.
fn every_kind(columns: usize, rows: usize) -> Vec<PatternSet> {
    let side = columns.min(rows);
    let mut kinds = vec![
        Kind::Stripes(None),
        Kind::Stripes(Some(3)),
        Kind::GrayCode,
        Kind::Ramp,
        Kind::Squares { side, filter: Filter::Box },
        Kind::Crossed { side: side - 1, influence: 2, filter: Filter::Box },
        Kind::Squares { side: side / 2, filter: Filter::Tent },
        Kind::Crossed { side: side / 2, influence: (side / 2).min(3), filter: Filter::Gaussian },
    ];
    kinds.extend(WAVELETS.map(Kind::Wavelet));
    kinds.extend(WAVELETS.map(Kind::Shifted));
    kinds.extend(WAVELETS.map(|wavelet| noise(wavelet, 5, Noise::DEVIATION)));
    kinds.into_iter().map(|kind| set(kind, columns, rows)).collect()
}

#[test]
fn values_are_light_and_names_are_in_order() {
    for (columns, rows) in [(16, 16), (12, 8), (7, 5), (24, 16)] {
        for set in every_kind(columns, rows) {
            let names: Vec<String> = (0..set.len()).map(|n| set.name(n)).collect();
            assert!(names.is_sorted_by(|a, b| a < b), "{:?}: {names:?}", set.kind());
            assert!(names.iter().flat_map(|name| name.chars()).all(|c| c.is_ascii_alphanumeric() || c == '-'));
            for (n, name) in names.iter().enumerate() {
                let Pattern { columns: c, rows: r, values } = set.pattern(n);
                assert_eq!((c, r, values.len()), (columns, rows, columns * rows));
                assert!(values.iter().all(|v| (0.0..=1.0).contains(v)), "{:?} {n}", set.kind());
                let lit = values.iter().any(|v| *v > 0.01);
                assert!(lit || set.element(n) == Element::Ramp { code: 0 } || n < 3 && set.is_codes(), "{name}");
            }
        }
    }
}

/// Photographs under the patterns, combined by the coefficients `a = A L` of a light, are the photograph under that light:
/// here the screen itself is looked at, T = I.
#[test]
fn wavelet_patterns_add_up_to_any_light() {
    for (columns, rows) in [(16, 16), (12, 8), (7, 5), (24, 16), (8, 1)] {
        for wavelet in WAVELETS {
            let set = set(Kind::Wavelet(wavelet), columns, rows);
            let transform = set.plane().transform(wavelet).unwrap();
            assert_eq!(transform.normalisation(), Normalisation::Energy);
            let light: Vec<f32> = (0..columns * rows).map(|k| ((k * k + 3 * k) % 17) as f32 / 17.0 - 0.2).collect();
            let mut coefficients = light.clone();
            transform.forward(&mut coefficients, 1);
            let (mut sum, mut largest) = (vec![0.0; light.len()], vec![0.0f32; light.len()]);
            for n in 0..set.len() {
                let Element::Wavelet { location, negative, .. } = set.element(n) else { panic!("wavelets") };
                let values = set.pattern(n).values;
                let weight = coefficients[location as usize] * set.scale(n) * if negative { -1.0 } else { 1.0 };
                sum.iter_mut().zip(&values).for_each(|(sum, v)| *sum += weight * v);
                let peak = values.iter().fold(0.0f32, |m, v| m.max(*v));
                assert!(peak > 1e-3, "{wavelet:?} {columns} x {rows}: {} is dark", set.name(n));
                largest[location as usize] = largest[location as usize].max(peak);
            }
            let off = sum.iter().zip(&light).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            assert!(off < 2e-5, "{wavelet:?} {columns} x {rows}: off by {off}");
            assert!(largest.iter().all(|peak| (peak - 1.0).abs() < 1e-6), "one part of each fills the range");
        }
    }
}

/// `scale (2 psi' - 1)` is `scale (psi+ - psi-)`, with half the patterns.
#[test]
fn shifted_patterns_are_the_split_ones_about_mid_grey() {
    for (columns, rows) in [(16, 16), (24, 16), (7, 5)] {
        for wavelet in WAVELETS {
            let (split, shifted) =
                (set(Kind::Wavelet(wavelet), columns, rows), set(Kind::Shifted(wavelet), columns, rows));
            assert_eq!(shifted.len(), columns * rows);
            let mut parts = 0..split.len();
            for n in 0..shifted.len() {
                let positive = parts.next().unwrap();
                let values = shifted.pattern(n).values;
                let scale = shifted.scale(n);
                assert_eq!(scale, split.scale(positive));
                let up = split.pattern(positive).values;
                let Element::Shifted { location, .. } = shifted.element(n) else {
                    assert_eq!((shifted.element(n), values), (split.element(positive), up));
                    continue;
                };
                let negative = parts.next().unwrap();
                let down = split.pattern(negative).values;
                assert!(
                    matches!(split.element(negative), Element::Wavelet { location: l, negative: true, .. } if l == location)
                );
                let off = |k: usize| (2.0 * values[k] - 1.0 - (up[k] - down[k])).abs();
                assert!((0..values.len()).all(|k| off(k) < 1e-6), "{wavelet:?} {n}");
            }
            assert!(parts.next().is_none());
        }
    }
}

#[test]
fn wavelet_patterns_come_coarsest_first_with_all_orientations_of_a_place() {
    let set = set(Kind::Wavelet(Wavelet::Haar), 16, 16);
    assert_eq!(set.len(), 2 * 256 - 1, "Haar's scaling function is nowhere negative");
    assert_eq!(set.name(0), "0000-level0-scaling-x0-y0-positive");
    let names: Vec<String> = (1..7).map(|n| set.element(n).to_string()).collect();
    let expected = ["lh", "lh", "hl", "hl", "hh", "hh"].iter().zip(["positive", "negative"].iter().cycle());
    let expected: Vec<String> = expected.map(|(o, sign)| format!("level0-{o}-x0-y0-{sign}")).collect();
    assert_eq!(names, expected);
    // A.2: Haar's details are positive where the signal falls, so the left half of the finest HL is lit.
    let finest = (0..set.len()).rev().find(|n| set.name(*n).contains("hl-x0-y0-positive")).unwrap();
    assert_eq!(&set.pattern(finest).values[..4], [1.0, 0.0, 0.0, 0.0]);
}

#[test]
fn noise_has_its_mean_its_deviation_and_its_spectrum() {
    for wavelet in WAVELETS {
        let (columns, rows) = (32, 32);
        // Nothing is clipped at a twentieth of the range.
        let set = set(noise(wavelet, 3, 0.05), columns, rows);
        let transform = set.plane().transform(wavelet).unwrap();
        let tree = transform.tree();
        let mut levels = vec![(0.0, 0.0); tree.levels() as usize];
        let mut variance = 0.0;
        for n in 0..set.len() {
            let mut values = set.pattern(n).values;
            let mean = values.iter().map(|v| f64::from(*v)).sum::<f64>() / values.len() as f64;
            assert!((mean - 0.5).abs() < 1e-6, "{wavelet:?}: {mean}");
            variance += values.iter().map(|v| (f64::from(*v) - 0.5).powi(2)).sum::<f64>() / values.len() as f64;
            values.iter_mut().for_each(|v| *v = (*v - 0.5) * set.scale(n));
            transform.forward(&mut values, 1);
            for (location, weight) in (0..).zip(&values) {
                if tree.orientation(location).is_some() {
                    let (sum, count) = &mut levels[tree.level(location) as usize];
                    *sum += f64::from(*weight).powi(2);
                    *count += 1.0;
                }
            }
        }
        let found = (variance / set.len() as f64).sqrt();
        assert!((found / 0.05 - 1.0).abs() < 0.05, "{wavelet:?}: deviation {found}");
        for (level, (sum, count)) in (0..).zip(levels) {
            let off = (sum / count).sqrt() * f64::from(1u32 << level) - 1.0;
            // The relative error of a deviation from n samples is 1 / sqrt(2 n).
            assert!(off.abs() < 4.0 / (2.0f64 * count).sqrt(), "{wavelet:?}, level {level}: off by {off}");
        }
    }
}

#[test]
fn noise_is_repeatable_and_seeds_and_numbers_change_it() {
    let make = |seed| set(noise(Wavelet::Haar, seed, 0.2), 16, 8);
    let correlation = |a: &[f32], b: &[f32]| {
        let dot = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| (a - 0.5) * (b - 0.5)).sum::<f32>();
        dot(a, b) / (dot(a, a) * dot(b, b)).sqrt()
    };
    let (a, b) = (make(1), make(2));
    assert_eq!(a.pattern(7), make(1).pattern(7));
    let longer = Kind::Noise(Noise { wavelet: Wavelet::Haar, count: 4000, seed: 1, deviation: 0.2 });
    assert_eq!(set(longer, 16, 8).pattern(7), a.pattern(7));
    for n in 0..40 {
        let own = a.pattern(n).values;
        // Five deviations of a correlation over 127 independent numbers, of which the coarse ones weigh most.
        assert!(correlation(&own, &b.pattern(n).values).abs() < 0.7, "seeds");
        assert!(n == 0 || correlation(&own, &a.pattern(n - 1).values).abs() < 0.7, "numbers");
    }
}

/// Whoever holds photographs of seed 1 must get the same patterns from every later version.
#[test]
fn noise_of_a_seed_never_changes() {
    let set = set(noise(Wavelet::Haar, 1, 0.2), 4, 4);
    let codes = set.pattern(0).codes(&Emitter::new(&crate::domain::EmitterCurve::Linear, crate::domain::Bits::Eight));
    assert_eq!(codes, [62, 105, 152, 166, 220, 121, 120, 116, 85, 163, 164, 92, 61, 83, 163, 167]);
}

#[test]
fn stripes_and_their_inverses_cover_the_screen() {
    let progressive = set(Kind::Stripes(None), 16, 9);
    let shown: Vec<String> = (0..progressive.len()).map(|n| progressive.element(n).to_string()).collect();
    assert_eq!(shown.len(), 2 * (4 + 3));
    assert_eq!(&shown[..4], ["v2", "v2-inverse", "v4", "v4-inverse"]);
    assert_eq!(shown[shown.len() - 1], "h8-inverse");
    for set in [progressive, set(Kind::Stripes(Some(64)), 128, 96)] {
        for n in (0..set.len()).step_by(2) {
            let Element::Stripes { stripes, count, inverse: false } = set.element(n) else { panic!("stripes") };
            let (lit, inverse) = (set.pattern(n).values, set.pattern(n + 1).values);
            assert!(lit.iter().zip(&inverse).all(|(a, b)| a + b == 1.0));
            let (columns, rows) = set.plane().size();
            let along: Vec<f32> = match stripes {
                Direction::Vertical => lit[..columns].to_vec(),
                Direction::Horizontal => lit.iter().step_by(columns).copied().collect(),
            };
            assert_eq!((along[0], along.windows(2).filter(|w| w[0] != w[1]).count()), (1.0, count - 1));
            assert!(along.len() == if stripes == Direction::Vertical { columns } else { rows });
        }
    }
}

#[test]
fn gray_codes_tell_every_texel_and_neighbours_differ_in_one_bit() {
    for (columns, rows) in [(16, 8), (13, 21), (1, 2)] {
        let set = set(Kind::GrayCode, columns, rows);
        let patterns: Vec<(Element, Pattern)> = (0..set.len()).map(|n| (set.element(n), set.pattern(n))).collect();
        let bits = |texel: usize, along: Direction| -> usize {
            let of = |(element, pattern): &(Element, Pattern)| match element {
                Element::GrayCode { stripes, bit, inverse } if *stripes == along => {
                    let lit = pattern.values[texel] == 1.0;
                    Some(usize::from(lit && !inverse) << bit)
                }
                _ => None,
            };
            patterns.iter().filter_map(of).sum()
        };
        let decoded = |gray: usize| (0..usize::BITS).fold(0, |code, shift| code ^ (gray >> shift));
        for texel in 0..columns * rows {
            let (column, row) = set.plane().place(texel);
            let (x, y) = (bits(texel, Direction::Vertical), bits(texel, Direction::Horizontal));
            assert_eq!((decoded(x), decoded(y)), (column, row));
            if column > 0 {
                assert_eq!((x ^ bits(texel - 1, Direction::Vertical)).count_ones(), 1);
            }
        }
    }
}

#[test]
fn squares_light_everything_once() {
    for (side, columns, rows) in [(4, 16, 16), (5, 16, 13), (1, 3, 2)] {
        let set = set(Kind::Squares { side, filter: Filter::Box }, columns, rows);
        assert_eq!(set.len(), side * side);
        let mut sum = vec![0.0; columns * rows];
        (0..set.len()).for_each(|n| sum.iter_mut().zip(set.pattern(n).values).for_each(|(sum, v)| *sum += v));
        assert!(sum.iter().all(|v| *v == 1.0));
    }
}

/// Equation 7.1 where it is exact: on the patterns themselves.
#[test]
fn the_smaller_of_both_crossed_patterns_is_the_square() {
    for (filter, columns, rows) in
        [(Filter::Box, 16, 15), (Filter::Tent, 28, 28), (Filter::Gaussian, 28, 28), (Filter::Gaussian, 33, 20)]
    {
        crossed_patterns_hold(filter, columns, rows);
    }
}

/// Light of a square does not depend on which others are lit, so sets add up to the same white.
fn crossed_patterns_hold(filter: Filter, columns: usize, rows: usize) {
    let (side, influence) = (7, 3);
    let single = set(Kind::Squares { side, filter }, columns, rows);
    let both = set(Kind::Crossed { side, influence, filter }, columns, rows);
    assert_eq!(both.len(), 2 * side * influence);
    let find = |wanted: Element| (0..both.len()).find(|n| both.element(*n) == wanted).map(|n| both.pattern(n).values);
    for y in 0..side {
        for x in 0..side {
            let h = find(Element::Horizontal { column: x, offset: y % influence }).unwrap();
            let v = find(Element::Vertical { row: y, offset: x % influence }).unwrap();
            let smaller: Vec<f32> = h.iter().zip(&v).map(|(h, v)| h.min(*v)).collect();
            let alone = single.pattern(y * side + x).values;
            let off = smaller.iter().zip(&alone).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            assert!(off < 1e-6, "square ({x}, {y}), {filter:?}");
        }
    }
    let half = side * influence;
    for range in [0..half, half..2 * half] {
        let mut sum = vec![0.0f32; columns * rows];
        range.for_each(|n| sum.iter_mut().zip(both.pattern(n).values).for_each(|(sum, v)| *sum += v));
        // Away from the rim, where squares beyond it are missing.
        let middle = sum[rows / 2 * columns + columns / 2];
        let wanted = filter.sum().powi(2) as f32;
        assert!((middle / wanted - 1.0).abs() < 0.03, "{filter:?}: {middle}, not {wanted}");
    }
}

#[test]
fn ramps_are_codes_whatever_the_curve() {
    let set = set(Kind::Ramp, 3, 2);
    assert!(set.is_codes() && set.len() == 256);
    let linear = Emitter::new(&crate::domain::EmitterCurve::Linear, crate::domain::Bits::Eight);
    assert!((0..256).all(|n| set.pattern(n).codes(&linear) == [n as u16; 6]));
}

#[test]
fn what_makes_no_set_is_refused() {
    let refuse = |kind: Kind, columns: usize, rows: usize| {
        PatternSet::new(kind, Plane::new(columns, rows).unwrap()).unwrap_err().to_string()
    };
    let none = Noise { wavelet: Wavelet::Haar, count: 0, seed: 1, deviation: 0.2 };
    for (kind, size, words) in [
        (Kind::Wavelet(Wavelet::Daubechies4), (8, 8), "use haar, 5/3 or 9/7"),
        (Kind::Noise(none), (8, 8), "at least one"),
        (Kind::Noise(Noise { count: 1, deviation: 0.6, ..none }), (8, 8), "at most 0.5"),
        (Kind::Noise(Noise { count: 1, deviation: f64::NAN, ..none }), (8, 8), "at most 0.5"),
        (Kind::Noise(Noise { count: 1, ..none }), (1, 1), "two texels"),
        (Kind::Stripes(Some(1)), (8, 8), "two or more"),
        (Kind::Stripes(Some(9)), (16, 8), "1 to 8"),
        (Kind::Stripes(None), (1, 1), "a grid that has some"),
        (Kind::GrayCode, (1, 1), "a grid that has some"),
        (Kind::Squares { side: 0, filter: Filter::Box }, (8, 8), "1 to 8"),
        (Kind::Squares { side: 9, filter: Filter::Box }, (8, 16), "1 to 8"),
        (Kind::Crossed { side: 4, influence: 0, filter: Filter::Box }, (8, 8), "1 to 4"),
        (Kind::Crossed { side: 4, influence: 5, filter: Filter::Box }, (8, 8), "1 to 4"),
        (Kind::Squares { side: 8, filter: Filter::Tent }, (8, 8), "16 texels or more"),
        (Kind::Crossed { side: 8, influence: 1, filter: Filter::Tent }, (32, 32), "2 to 8"),
        (Kind::Crossed { side: 8, influence: 2, filter: Filter::Gaussian }, (32, 32), "reach into their neighbours"),
    ] {
        let message = refuse(kind, size.0, size.1);
        assert!(message.contains(words), "{kind:?}: `{words}` not in: {message}");
    }
}
