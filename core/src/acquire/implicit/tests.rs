use std::sync::Arc;

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg32;

use super::*;
use crate::domain::Plane;
use crate::domain::patterns::{Kind, Noise, Pattern, PatternSet};
use crate::wavelet::{Edge, Normalisation, Transform, Wavelet};

fn transform(wavelet: Wavelet, size: (usize, usize)) -> Transform {
    Transform::new(wavelet, size, (Edge::Mirrored, Edge::Mirrored), Normalisation::Energy).unwrap()
}

fn noise(size: (usize, usize), count: usize) -> Vec<Pattern> {
    let noise = Noise { wavelet: Wavelet::Haar, count, seed: 3, deviation: 0.2 };
    let set = PatternSet::new(Kind::Noise(noise), Plane::new(size.0, size.1).unwrap()).unwrap();
    (0..count).map(|n| set.pattern(n)).collect()
}

fn solver(wavelet: Wavelet, size: (usize, usize), patterns: &[Pattern], options: Options) -> Solver {
    let dictionary = Dictionary::new(&transform(wavelet, size), patterns).unwrap();
    Solver::new(Arc::new(dictionary), options).unwrap()
}

fn normal(rng: &mut Pcg32) -> f32 {
    (-2.0 * (1.0 - rng.random::<f32>()).ln()).sqrt() * (std::f32::consts::TAU * rng.random::<f32>()).cos()
}

/// What a function, RGB texel by texel, answers to patterns, channel by channel; with noise in proportion.
fn answers(function: &[[f32; 3]], patterns: &[Pattern], noise: f32, rng: &mut Pcg32) -> Vec<f32> {
    let answer = |pattern: &Pattern, c: usize| -> f64 {
        function.iter().zip(&pattern.values).map(|(t, l)| f64::from(t[c]) * f64::from(*l)).sum()
    };
    let mut all = Vec::new();
    for c in 0..3 {
        all.extend(patterns.iter().map(|pattern| answer(pattern, c) as f32 * (1.0 + noise * normal(rng))));
    }
    all
}

/// The function that terms stand for.
fn function(transform: &Transform, terms: &Terms) -> Vec<[f32; 3]> {
    let mut values = vec![0.0; 3 * transform.tree().len()];
    for (location, rgb) in terms.locations.iter().zip(&terms.coefficients) {
        values[3 * *location as usize..][..3].copy_from_slice(rgb);
    }
    transform.inverse(&mut values, 3);
    values.chunks_exact(3).map(|rgb| [rgb[0], rgb[1], rgb[2]]).collect()
}

fn error(found: &[[f32; 3]], wanted: &[[f32; 3]]) -> f32 {
    let square = |v: f32| v * v;
    let off: f32 = found.iter().flatten().zip(wanted.iter().flatten()).map(|(a, b)| square(a - b)).sum();
    (off / wanted.iter().flatten().map(|v| square(*v)).sum::<f32>()).sqrt()
}

/// A function of all groups of a tree grown by chance until it has some coefficients, coarse ones largest.
fn tree_function(transform: &Transform, coefficients: usize, rng: &mut Pcg32) -> (Vec<u32>, Vec<[f32; 3]>) {
    let tree = transform.tree();
    let mut open: Vec<u32> = tree.roots().collect();
    let mut terms = Terms::default();
    while terms.locations.len() + 3 <= coefficients && !open.is_empty() {
        let first = open.swap_remove(rng.random_range(0..open.len()));
        for location in tree.group(first) {
            let value = 0.7f32.powi(tree.level(location) as i32) * (0.5 + rng.random::<f32>());
            terms.locations.push(location);
            terms.coefficients.push([value, 0.5 * value, value * rng.random::<f32>()]);
        }
        open.extend(tree.groups_below(first));
    }
    let values = function(transform, &terms);
    terms.locations.sort_unstable();
    (terms.locations, values)
}

/// A smooth floor, a lobe and a refracted spot, by chance.
fn natural((columns, rows): (usize, usize), rng: &mut Pcg32) -> Vec<[f32; 3]> {
    let mut random = || rng.random::<f32>();
    let (lobe, spot, width) = ([random(), random()], [random(), random()], 0.02 + 0.1 * random());
    let (tint, slope) = ([1.0, 0.4 + 0.6 * random(), random()], [random() - 0.5, random() - 0.5]);
    let texel = |n: usize| {
        let at = [((n % columns) as f32 + 0.5) / columns as f32, ((n / columns) as f32 + 0.5) / rows as f32];
        let distance = |to: [f32; 2]| (at[0] - to[0]).hypot(at[1] - to[1]);
        let floor = 0.1 * (1.0 + slope[0] * at[0] + slope[1] * at[1]);
        let glossy = (-0.5 * (distance(lobe) / width).powi(2)).exp();
        let sharp = 4.0 * f32::from(u8::from(distance(spot) < 0.05));
        tint.map(|tint| floor + tint * glossy + sharp)
    };
    (0..columns * rows).map(texel).collect()
}

/// Haar and others; one root, several roots, an odd side.
const GRIDS: [(Wavelet, (usize, usize)); 6] = [
    (Wavelet::Haar, (32, 32)),
    (Wavelet::LeGall53, (32, 32)),
    (Wavelet::Daubechies97, (32, 32)),
    (Wavelet::Haar, (64, 16)),
    (Wavelet::Daubechies97, (48, 32)),
    (Wavelet::Haar, (20, 15)),
];

#[test]
fn functions_of_few_coefficients_in_a_tree_are_found_exactly() {
    let mut rng = Pcg32::seed_from_u64(5);
    for (wavelet, size) in GRIDS {
        let patterns = noise(size, 96);
        let solver = solver(wavelet, size, &patterns, Options { terms: 32, ..Options::default() });
        let mut scratch = solver.scratch();
        for _ in 0..4 {
            let (locations, wanted) = tree_function(solver.dictionary().transform(), 13, &mut rng);
            let mut terms = Terms::default();
            solver.solve(&mut scratch, &answers(&wanted, &patterns, 0.0, &mut rng), None, &mut terms);
            let off = error(&function(solver.dictionary().transform(), &terms), &wanted);
            assert!(off < 1e-4, "{wavelet:?} {size:?}: {off}");
            // All that matters is there; what else is has no weight.
            assert!(locations.iter().all(|at| terms.locations.contains(at)), "{wavelet:?} {size:?}");
        }
    }
}

#[test]
fn the_fast_solver_finds_what_the_plain_one_finds() {
    let mut rng = Pcg32::seed_from_u64(6);
    let (mut pixels, mut same) = (0, 0);
    for (wavelet, size) in GRIDS {
        // 90 is no multiple of a vector's lanes.
        let patterns = noise(size, 90);
        for options in [Options { terms: 22, stop: Stop::Off }, Options { terms: 22, stop: Stop::On }] {
            let solver = solver(wavelet, size, &patterns, options);
            let mut scratch = solver.scratch();
            for _ in 0..3 {
                let response = answers(&natural(size, &mut rng), &patterns, 0.002, &mut rng);
                let mut fast = Terms::default();
                let count = solver.solve(&mut scratch, &response, None, &mut fast);
                assert!(count == fast.locations.len() && count <= 22);
                let plain = solve_plainly(solver.dictionary(), options, &response, None);
                pixels += 1;
                if fast.locations != plain.locations {
                    continue;
                }
                same += 1;
                let largest = plain.coefficients.iter().flatten().fold(0.0f32, |a, b| a.max(b.abs()));
                for (a, b) in fast.coefficients.iter().flatten().zip(plain.coefficients.iter().flatten()) {
                    assert!((a - b).abs() < 2e-5 * largest, "{wavelet:?} {size:?}: {a} and {b}");
                }
            }
        }
    }
    // Where two groups explain alike, rounding decides.
    assert!(same + 1 >= pixels, "{same} of {pixels} alike");
}

#[test]
fn noise_is_not_modelled() {
    let mut rng = Pcg32::seed_from_u64(7);
    let size = (32, 32);
    let patterns = noise(size, 128);
    let wanted = tree_function(&transform(Wavelet::Haar, size), 10, &mut rng).1;
    let errors = |options: Options, known: Option<f32>, rng: &mut Pcg32| {
        let solver = solver(Wavelet::Haar, size, &patterns, options);
        let (mut scratch, mut sum, mut count) = (solver.scratch(), 0.0, 0);
        for _ in 0..10 {
            let mut terms = Terms::default();
            let mut response = answers(&wanted, &patterns, 0.0, rng);
            response.iter_mut().for_each(|v| *v += 0.05 * normal(rng));
            count += solver.solve(&mut scratch, &response, known, &mut terms);
            sum += error(&function(solver.dictionary().transform(), &terms), &wanted);
        }
        (sum / 10.0, count / 10)
    };
    let options = Options { terms: 48, stop: Stop::Off };
    let off = errors(options, None, &mut rng);
    let on = errors(Options { stop: Stop::On, ..options }, None, &mut rng);
    let known = errors(Options { stop: Stop::On, ..options }, Some(0.05), &mut rng);
    assert!(on.0 < 0.6 * off.0 && on.1 < 24 && off.1 > 45, "{on:?} against {off:?}");
    assert!(known.0 < 0.6 * off.0 && known.1 < 24, "{known:?} against {off:?}");
}

#[test]
fn nothing_depends_on_what_was_solved_before_or_on_the_thread() {
    let mut rng = Pcg32::seed_from_u64(8);
    let size = (32, 32);
    let patterns = noise(size, 80);
    let solver = solver(Wavelet::Haar, size, &patterns, Options { terms: 20, ..Options::default() });
    let responses: Vec<Vec<f32>> =
        (0..6).map(|_| answers(&natural(size, &mut rng), &patterns, 0.002, &mut rng)).collect();
    let mut scratch = solver.scratch();
    let mut together = Terms::default();
    let counts: Vec<usize> =
        responses.iter().map(|response| solver.solve(&mut scratch, response, None, &mut together)).collect();
    let mut first = together.locations.len();
    for (response, count) in responses.iter().zip(&counts).rev() {
        let alone = std::thread::scope(|scope| {
            let work = || {
                let mut terms = Terms::default();
                solver.solve(&mut solver.scratch(), response, None, &mut terms);
                terms
            };
            scope.spawn(work).join().unwrap()
        });
        assert_eq!(alone.locations, together.locations[first - count..first]);
        assert_eq!(alone.coefficients, together.coefficients[first - count..first]);
        first -= count;
    }
    assert_eq!(first, 0);
}

#[test]
fn black_and_broken_pixels_have_no_terms() {
    let patterns = noise((16, 16), 40);
    let solver = solver(Wavelet::Haar, (16, 16), &patterns, Options { terms: 10, ..Options::default() });
    let (mut scratch, mut terms) = (solver.scratch(), Terms::default());
    let black = vec![0.0; 120];
    assert_eq!(solver.solve(&mut scratch, &black, None, &mut terms), 0);
    for broken in [f32::NAN, f32::INFINITY] {
        let mut response = black.clone();
        response[77] = broken;
        assert_eq!(solver.solve(&mut scratch, &response, None, &mut terms), 0);
        assert_eq!(solve_plainly(solver.dictionary(), solver.options(), &response, None), Terms::default());
    }
    assert_eq!(terms, Terms::default());
}

#[test]
fn patterns_and_numbers_that_cannot_be_solved_from_are_refused() {
    let good = noise((16, 16), 40);
    let changed = |change: &dyn Fn(&mut Vec<Pattern>)| {
        let mut patterns = good.clone();
        change(&mut patterns);
        patterns
    };
    let haar = transform(Wavelet::Haar, (16, 16));
    let other = noise((16, 8), 1).remove(0);
    for (patterns, words) in [
        (changed(&|p| p.truncate(1)), "two or more"),
        (changed(&|p| p.clear()), "two or more"),
        (changed(&|p| p[7] = other.clone()), "noise pattern 8: found 16 x 8 texels"),
        (changed(&|p| p[3].values.truncate(9)), "noise pattern 4"),
        (changed(&|p| p[5].values[18] = f32::NAN), "texel (2, 1)"),
        (changed(&|p| p[9].values.fill(0.5)), "noise pattern 10: found the same light, 0.5, everywhere"),
        (changed(&|p| p[9].values.fill(0.0)), "noise pattern 10"),
        (vec![good[0].clone(); 12], "12 times the same pattern"),
    ] {
        let message = Dictionary::new(&haar, &patterns).unwrap_err().to_string();
        assert!(message.contains(words), "`{words}` not in: {message}");
    }
    let dictionary = Arc::new(Dictionary::new(&haar, &good).unwrap());
    for (terms, words) in [(0, "at least one"), (40, "40 terms from 40 patterns"), (64, "fewer terms than patterns")] {
        let options = Options { terms, ..Options::default() };
        let message = Solver::new(dictionary.clone(), options).unwrap_err().to_string();
        assert!(message.contains(words), "`{words}` not in: {message}");
    }
    assert!(Solver::new(dictionary, Options { terms: 39, ..Options::default() }).is_ok());
    assert_eq!(("on".parse::<Stop>().unwrap(), "off".parse::<Stop>().unwrap()), (Stop::On, Stop::Off));
    assert!("maybe".parse::<Stop>().unwrap_err().to_string().contains("`on` or `off`"));
}
