//! Properties that every method must have, on every kind of set.

use std::f64::consts::PI;
use std::sync::Arc;

use proptest::prelude::*;
use rand::{RngExt, SeedableRng};

use super::linear::Linear;
use super::*;
use crate::domain::{Axis, Coverage, Directions, LatLongGrid};
use crate::illumination::{Beam, EnvMap};
use crate::image::Image;
use crate::math::{Vec3, angle_between, latlong};
use crate::wavelet::Wavelet;

/// The methods that interpolate and are convex: shares are not negative, and a site has all of itself.
const CONVEX: [Method; 3] = [Method::ZeroOrder, Method::Linear, Method::InverseDistance];

/// The methods that a set allows; 625 functions, which take a second each time, only where that is worth it.
fn methods(set: &Directions) -> Vec<Method> {
    let grid = LatLongGrid::find(set).is_some();
    let allowed = |method: &Method| match method {
        Method::Wavelet(_) => grid,
        Method::Harmonics { bands } => *bands < 25 || set.len() > 1000,
        _ => true,
    };
    Method::ALL.iter().copied().filter(allowed).collect()
}

fn reconstruction(set: &Directions, method: Method) -> Arc<Reconstruction> {
    Arc::new(Reconstruction::new(Arc::new(set.clone()), method).unwrap())
}

fn operator(set: &Directions, method: Method, outside: Outside, w: usize, h: usize) -> Operator {
    Operator::new(reconstruction(set, method), outside, w, h)
}

fn random_direction(rng: &mut impl rand::Rng) -> Vec3 {
    loop {
        let v = Vec3::from_fn(|_, _| rng.random_range(-1.0..1.0));
        if v.norm() < 1.0 && v.norm() > 1e-3 {
            return v.normalize();
        }
    }
}

fn random_set(n: usize, seed: u64, keep: impl Fn(&Vec3) -> bool) -> Directions {
    let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(seed);
    let lamps = std::iter::repeat_with(|| random_direction(&mut rng)).filter(keep).take(n).collect();
    Directions::new(lamps).unwrap()
}

/// Rings of lamps about +y as on an arc over a turntable, with the pole: co-circular everywhere.
fn arc(rings: usize, longitudes: usize) -> Directions {
    let mut lamps = vec![Vec3::y()];
    for r in 1..rings {
        let (sin, cos) = (r as f64 / (rings - 1) as f64 * PI / 2.0).sin_cos();
        lamps.extend((0..longitudes).map(|k| {
            let (s, c) = (2.0 * PI * k as f64 / longitudes as f64).sin_cos();
            Vec3::new(sin * s, cos, sin * c)
        }));
    }
    Directions::new(lamps).unwrap()
}

fn sets() -> Vec<(&'static str, Directions)> {
    vec![
        ("arc", arc(6, 16)),
        ("dome", random_set(80, 1, |d| d.z > 0.2)),
        ("sphere", random_set(331, 2, |_| true)),
        (
            "small sphere",
            Directions::new([Vec3::x(), Vec3::y(), Vec3::z()].into_iter().flat_map(|d| [d, -d]).collect()).unwrap(),
        ),
        ("quarter", random_set(40, 3, |d| d.z > 0.0 && d.x > 0.0)),
        ("one", Directions::new(vec![Vec3::z()]).unwrap()),
        ("two", Directions::new(vec![Vec3::z(), Vec3::x()]).unwrap()),
        (
            "an arc alone",
            Directions::new(
                (0..9).map(|k| Vec3::new((f64::from(k) * 0.15).sin(), 0.0, (f64::from(k) * 0.15).cos())).collect(),
            )
            .unwrap(),
        ),
        ("duplicates", Directions::new([Vec3::z(), Vec3::x(), Vec3::y(), Vec3::x(), -Vec3::x()].to_vec()).unwrap()),
    ]
}

#[test]
fn kernels_sum_to_one_and_own_their_sites() {
    let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(5);
    for (name, set) in sets() {
        for method in CONVEX {
            let reconstruction = reconstruction(&set, method);
            for _ in 0..2000 {
                let shares = reconstruction.at(&random_direction(&mut rng));
                let sum: f64 = shares.iter().map(|share| share.1).sum();
                assert!((sum - 1.0).abs() < 1e-12, "{name}, {method:?}: shares sum to {sum}");
                assert!(shares.iter().all(|s| s.1 >= 0.0), "{name}, {method:?}: {shares:?}");
            }
            for (site, members) in set.sites().iter().zip(set.members()) {
                let shares = reconstruction.at(site);
                let own: f64 = shares.iter().filter(|s| members.contains(&s.0)).map(|s| s.1).sum();
                assert!((own - 1.0).abs() < 1e-6, "{name}, {method:?}: {site} has {own} of itself");
            }
        }
    }
}

#[test]
fn linear_kernels_are_continuous() {
    let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(6);
    for (name, set) in sets().into_iter().filter(|s| s.1.sites().len() > 20) {
        let samples: Vec<f32> = set.lamps().iter().map(|s| (1.0 + s.x + 0.5 * s.y * s.z) as f32).collect();
        let linear = reconstruction(&set, Method::Linear);
        for _ in 0..5000 {
            let a = random_direction(&mut rng);
            if !set.covers(&a) || name == "quarter" {
                continue;
            }
            let b = (a + random_direction(&mut rng) * 1e-5).normalize();
            let values = linear.values(&samples, &[a, b]);
            let jump = (values[0] - values[1]).abs();
            assert!(jump < 0.01, "{name}: a jump of {jump} at {a}");
        }
    }
}

/// Three lamps: the first one once had no triangle.
#[test]
fn few_lamps_all_take_part() {
    for lamps in [
        vec![Vec3::z(), Vec3::x(), Vec3::y()],
        vec![Vec3::z(), Vec3::x()],
        vec![Vec3::z(), -Vec3::z()],
        [0.0, 2.0, 4.0].map(|k: f64| Vec3::new((k * PI / 3.0).sin(), 0.0, (k * PI / 3.0).cos())).into(),
    ] {
        let set = Directions::new(lamps).unwrap();
        let linear = reconstruction(&set, Method::Linear);
        for (n, site) in set.sites().iter().enumerate() {
            let next = set.sites()[(n + 1) % set.sites().len()];
            let Some(between) = (site + next * 0.99).try_normalize(0.1) else { continue };
            let shares = linear.at(&between);
            let own = shares.iter().find(|share| share.0 as usize == n).map_or(0.0, |share| share.1);
            assert!((0.4..0.6).contains(&own), "lamp {n} has {own} of what lies between it and the next: {shares:?}");
        }
    }
}

#[test]
fn linear_meets_a_linear_function_on_a_fine_sphere() {
    let set = random_set(2000, 7, |_| true);
    let linear = reconstruction(&set, Method::Linear);
    let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(8);
    let f = |d: &Vec3| (d.x - 2.0 * d.y + 0.5 * d.z) as f32;
    let samples: Vec<f32> = set.lamps().iter().map(f).collect();
    let directions: Vec<Vec3> = (0..4000).map(|_| random_direction(&mut rng)).collect();
    let values = linear.values(&samples, &directions);
    let worst = values.iter().zip(&directions).map(|(v, d)| (v - f(d)).abs()).fold(0.0, f32::max);
    // A chord of about 6 degrees sags by 0.14 %; random sets have triangles three times wider.
    assert!(worst < 0.03, "off by {worst}");
}

#[test]
fn spheres_are_closed_by_euler_and_empty_circumcircles() {
    for (name, set) in sets().into_iter().filter(|s| s.0.contains("sphere")) {
        assert_eq!(set.coverage(), Coverage::Sphere, "{name}");
        let linear = Linear::new(Arc::new(set.clone()));
        let n = set.sites().len();
        assert_eq!(linear.triangles().len(), 2 * n - 4, "{name}: a closed triangulation has 2 n - 4 triangles");
        for t in linear.triangles() {
            let [a, b, c] = t.map(|k| set.sites()[k as usize]);
            let normal = (b - a).cross(&(c - a)).normalize();
            let reach = normal.dot(&a);
            let inside = set.sites().iter().filter(|s| normal.dot(s) > reach + 1e-9).count();
            assert_eq!(inside, 0, "{name}: {t:?} is not Delaunay");
        }
    }
}

#[test]
fn constant_light_gives_the_covered_solid_angle() {
    for (name, set) in sets() {
        for method in methods(&set) {
            for (w, h) in [(64, 32), (7, 5)].into_iter().take(if name == "arc" { 2 } else { 1 }) {
                let drop = operator(&set, method, Outside::Drop, w, h);
                let sum: f64 = drop.solid_angles().iter().sum();
                let covered = set.covered_solid_angle();
                assert!((sum / covered - 1.0).abs() < 1e-5, "{name}, {method:?}: {sum} of {covered}");
                let nearest = operator(&set, method, Outside::Nearest, w, h);
                let sum: f64 = nearest.solid_angles().iter().sum();
                assert!((sum / (4.0 * PI) - 1.0).abs() < 1e-5, "{name}, {method:?}: {sum} of the sphere");
            }
        }
    }
}

/// Every method, everywhere in the coverage, also at the poles, across longitude 0 and at the horizon.
#[test]
fn constants_are_met_everywhere() {
    let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(21);
    for (name, set) in sets() {
        let mut directions = vec![Vec3::y(), -Vec3::y(), Vec3::z(), -Vec3::z(), Vec3::x(), -Vec3::x()];
        directions.extend((0..300).map(|_| random_direction(&mut rng)));
        for method in methods(&set) {
            let reconstruction = reconstruction(&set, method);
            let values = reconstruction.values(&vec![2.5; set.len()], &directions);
            for (value, d) in values.iter().zip(&directions) {
                assert!((value - 2.5).abs() < 1e-5, "{name}, {method:?}: {value} at {d}");
            }
        }
    }
}

/// The thesis's 64 x 20 over the hemisphere about +y.
fn thesis_grid() -> Directions {
    let lamp = |n: usize| {
        let (colatitude, longitude) = (((n / 64) as f64 + 0.5) * PI / 40.0, (n % 64) as f64 * PI / 32.0);
        let ((s, c), (sl, cl)) = (colatitude.sin_cos(), longitude.sin_cos());
        Vec3::new(s * sl, c, s * cl)
    };
    Directions::new((0..1280).map(lamp).collect()).unwrap()
}

/// How far each method may be from a smooth function on the thesis's grid: at the pole, across longitude 0 and 180, at the
/// horizon, and elsewhere. A spacing is 5.6 degrees in longitude, 4.5 in latitude; zero-order is off by half a spacing of
/// the steepest slope, 25 harmonics have the function but for what mirroring does to it.
#[test]
fn smooth_functions_are_met_at_the_pole_the_seam_and_the_horizon() {
    let set = thesis_grid();
    let f = |d: &Vec3| (2.0 + d.x - 0.5 * d.y * d.y + d.x * d.z) as f32;
    let samples: Vec<f32> = set.lamps().iter().map(f).collect();
    let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(22);
    let near = |d: Vec3, rng: &mut rand_pcg::Pcg64Mcg| (d + random_direction(rng) * 0.03).normalize();
    let mut places: Vec<(&str, Vec3)> = Vec::new();
    for _ in 0..200 {
        let (height, turn): (f64, f64) = (rng.random_range(0.0..1.0), rng.random_range(0.0..2.0 * PI));
        let ring = (1.0 - height * height).sqrt();
        places.push(("pole", near(Vec3::y(), &mut rng)));
        places.push(("seam", Vec3::new(1e-4 * rng.random_range(-1.0..1.0), height, ring).normalize()));
        places.push(("seam", Vec3::new(1e-4 * rng.random_range(-1.0..1.0), height, -ring).normalize()));
        places.push(("horizon", Vec3::new(turn.sin(), 1e-3, turn.cos()).normalize()));
        places.push(("elsewhere", Vec3::new(ring * turn.sin(), height, ring * turn.cos())));
    }
    let directions: Vec<Vec3> = places.iter().map(|place| place.1).collect();
    let bounds = [0.12, 0.02, 0.1, 0.02, 0.02, 0.02, 0.12, 0.02, 0.04, 0.03];
    for (&method, bound) in Method::ALL.iter().zip(bounds) {
        let values = reconstruction(&set, method).values(&samples, &directions);
        for place in ["pole", "seam", "horizon", "elsewhere"] {
            let off = values.iter().zip(&places).filter(|v| v.1.0 == place);
            let worst = off.map(|(v, (_, d))| (v - f(d)).abs()).fold(0.0, f32::max);
            assert!(worst < bound, "{method:?}: off by {worst} at the {place}");
        }
    }
}

/// Lamps on rings with a wide hole overhead: what fills it stays near the ring about it, whatever rings farther out hold.
#[test]
fn a_hole_overhead_is_filled_from_its_rim() {
    let ring = |n: usize| {
        let (c, l) = (0.8 + 0.1 * (n / 16) as f64, (n % 16) as f64 * PI / 8.0);
        Vec3::new(c.sin() * l.sin(), c.cos(), c.sin() * l.cos())
    };
    let set = Directions::new((0..16 * 8).map(ring).collect()).unwrap();
    // One on the innermost three rings, a hundred beyond: what reaches over the pole must not be of those.
    let samples: Vec<f32> = (0..16 * 8).map(|n| if n < 48 { 1.0 } else { 100.0 }).collect();
    let inside: Vec<Vec3> =
        (0..50).map(|k| ring(k % 16) + Vec3::y() * f64::from(k as u8) * 0.1).map(|d| d.normalize()).collect();
    for wavelet in [Wavelet::Haar, Wavelet::LeGall53, Wavelet::Daubechies97] {
        for value in reconstruction(&set, Method::Wavelet(wavelet)).values(&samples, &inside[16..]) {
            assert!((value - 1.0).abs() < 1e-4, "{wavelet:?}: {value}");
        }
    }
}

/// The two public ways to a kernel, and the operator's, are one.
#[test]
fn shares_values_beams_and_operators_agree() {
    let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(23);
    for (name, set) in sets().into_iter().filter(|set| ["arc", "dome", "duplicates"].contains(&set.0)) {
        let samples: Vec<f32> = (0..set.len()).map(|_| rng.random_range(0.0..1.0)).collect();
        let direction = random_direction(&mut rng);
        let map = EnvMap::from_fn(32, 16, |d| [(1.0 + d.x) as f32, (1.0 + d.y * d.z) as f32, 1.0]);
        for method in methods(&set) {
            let reconstruction = reconstruction(&set, method);
            let shares = reconstruction.at(&direction);
            let value: f64 = shares.iter().map(|&(n, share)| share * f64::from(samples[n as usize])).sum();
            let other = f64::from(reconstruction.values(&samples, &[direction])[0]);
            assert!((value - other).abs() < 1e-5, "{name}, {method:?}: {value} is not {other}");
            for outside in [Outside::Drop, Outside::Nearest] {
                let weights = reconstruction.project(&beams(&map, 8), outside);
                let lit = |weights: &[[f32; 3]]| -> f64 {
                    weights.iter().zip(&samples).map(|(w, t)| f64::from(w[1]) * f64::from(*t)).sum()
                };
                let (a, b) = (lit(&weights), lit(&operator(&set, method, outside, 32, 16).downsample(&map)));
                assert!((a - b).abs() < 3e-3 * b.abs(), "{name}, {method:?}, {outside:?}: {a} is not {b}");
            }
        }
    }
}

/// Many functions at once, at many directions and at few, on grids, scattered sets and one with duplicates: as each alone.
#[test]
fn resampled_functions_are_the_reconstructed_ones() {
    let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(41);
    let mut sets: Vec<_> = sets().into_iter().filter(|s| ["dome", "sphere", "duplicates"].contains(&s.0)).collect();
    sets.push(("thesis", thesis_grid()));
    let all: Vec<Vec3> = (0..1500).map(|_| random_direction(&mut rng)).collect();
    for (name, set) in sets {
        for method in methods(&set) {
            let reconstruction = reconstruction(&set, method);
            for (lanes, count) in [(20, 1500), (1, 30)] {
                let resampling = Resampling::new(&reconstruction, &all[..count]);
                let samples: Vec<f32> = (0..set.len() * lanes).map(|_| rng.random_range(0.0..1.0)).collect();
                let mut out = vec![9.0; count * lanes];
                resampling.apply(&samples, &mut out);
                for lane in [0, lanes / 2, lanes - 1] {
                    let own: Vec<f32> = samples[lane..].iter().step_by(lanes).copied().collect();
                    let expected = reconstruction.values(&own, &all[..count]);
                    let scale = expected.iter().fold(0.0, |a: f32, v| a.max(v.abs()));
                    for (n, expected) in expected.iter().enumerate() {
                        let found = out[n * lanes + lane];
                        let off = (found - expected).abs();
                        assert!(off <= 1e-4 * scale, "{name}, {method:?}, lane {lane}: {found}, not {expected}");
                    }
                }
            }
        }
    }
}

/// A map as beams, `n` x `n` a texel.
fn beams(map: &EnvMap, n: usize) -> Vec<Beam> {
    let (w, h) = map.image().size();
    let beam = |k: usize| {
        let (u, v) = ((k % (w * n)) as f64 / n as f64, (k / (w * n)) as f64 / n as f64);
        let side = 1.0 / n as f64;
        let steradians = latlong::band_solid_angle(v, v + side, h) * side / w as f64;
        let irradiance = std::array::from_fn(|c| steradians * f64::from(map.image().pixel(u as usize, v as usize)[c]));
        Beam { direction: latlong::direction(u + side / 2.0, v + side / 2.0, w, h), irradiance }
    };
    (0..w * n * h * n).map(beam).collect()
}

/// "The Haar wavelet interpolation is identical to the zero-order hold reconstruction" (4.3.5): but for the cells' borders,
/// which are great circles on the sphere and rings on the grid.
#[test]
fn haar_is_zero_order_on_a_grid() {
    let set = thesis_grid();
    let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(24);
    let samples: Vec<f32> = (0..set.len()).map(|_| rng.random_range(0.0..1.0)).collect();
    let directions: Vec<Vec3> =
        (0..4000).map(|_| random_direction(&mut rng)).filter(|d| d.y > 0.0 && d.y < 0.95).collect();
    let haar = reconstruction(&set, Method::Wavelet(Wavelet::Haar)).values(&samples, &directions);
    let cells = reconstruction(&set, Method::ZeroOrder).values(&samples, &directions);
    let equal = haar.iter().zip(&cells).filter(|(a, b)| a == b).count();
    assert!(equal * 100 > directions.len() * 98, "{equal} of {}", directions.len());
}

/// Where functions are fewer than lamps, the fit is the weighted least-squares one: its residual is orthogonal to them, but
/// for the ridge.
#[test]
fn harmonics_give_a_function_of_few_bands_back() {
    let set = random_set(400, 25, |_| true);
    let f = |d: &Vec3| (1.0 + d.x - 2.0 * d.y * d.z + d.x * d.y * d.z) as f32;
    let samples: Vec<f32> = set.lamps().iter().map(f).collect();
    let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(26);
    let directions: Vec<Vec3> = (0..500).map(|_| random_direction(&mut rng)).collect();
    let values = reconstruction(&set, Method::Harmonics { bands: 5 }).values(&samples, &directions);
    let worst = values.iter().zip(&directions).map(|(v, d)| (v - f(d)).abs()).fold(0.0, f32::max);
    assert!(worst < 5e-3, "off by {worst}");
}

#[test]
fn grids_are_asked_for_by_name() {
    let set = random_set(50, 27, |_| true);
    for wavelet in [Wavelet::Haar, Wavelet::LeGall53, Wavelet::Daubechies97] {
        let message = Reconstruction::new(Arc::new(set.clone()), Method::Wavelet(wavelet)).unwrap_err().to_string();
        assert!(message.contains("equal longitudes") && message.contains("b-spline"), "{message}");
    }
}

#[test]
fn wavelets_that_cannot_interpolate_are_refused() {
    let set = arc(5, 12);
    for wavelet in [Wavelet::Daubechies4, Wavelet::Daubechies8] {
        let message = Reconstruction::new(Arc::new(set.clone()), Method::Wavelet(wavelet)).unwrap_err().to_string();
        assert!(message.contains(&format!("`{}`", wavelet.id())) && message.contains("haar, 5/3 or 9/7"), "{message}");
    }
}

#[test]
fn names_are_permanent_and_unique() {
    assert_eq!(Method::ALL.len(), Method::NAMES.len());
    assert_eq!((Method::Linear.id(), Method::BSpline.id()), ("linear", "b-spline"));
    assert_eq!(Method::Wavelet(Wavelet::LeGall53).id(), "5/3");
    assert_eq!(Method::Harmonics { bands: 15 }.id(), "harmonics-225");
}

#[test]
fn cells_agree_with_counting_nearest_lamps() {
    let set = arc(5, 12);
    let omega = operator(&set, Method::ZeroOrder, Outside::Drop, 256, 128).solid_angles();
    // Equal-area points: each stands for the same solid angle.
    let n = 200_000;
    let mut count = vec![0.0; set.len()];
    let golden = PI * (3.0 - 5f64.sqrt());
    for k in 0..n {
        let y = 1.0 - (k as f64 + 0.5) / n as f64;
        let (r, (s, c)) = ((1.0 - y * y).sqrt(), (golden * k as f64).sin_cos());
        let d = Vec3::new(r * s, y, r * c);
        let nearest = (0..set.len())
            .min_by(|&a, &b| angle_between(&d, &set.lamps()[a]).total_cmp(&angle_between(&d, &set.lamps()[b])));
        count[nearest.unwrap()] += 2.0 * PI / n as f64;
    }
    for (lamp, (a, b)) in omega.iter().zip(&count).enumerate() {
        assert!((a / b - 1.0).abs() < 4e-3, "lamp {lamp}: {a} against {b}");
    }
}

#[test]
fn cells_on_a_regular_set_are_equal() {
    let poles = Directions::new([Vec3::x(), Vec3::y(), Vec3::z()].into_iter().flat_map(|d| [d, -d]).collect()).unwrap();
    for method in [Method::ZeroOrder, Method::Linear] {
        for omega in operator(&poles, method, Outside::Drop, 128, 64).solid_angles() {
            assert!((omega / (4.0 * PI / 6.0) - 1.0).abs() < 2e-3, "{method:?}: {omega}");
        }
    }
}

#[test]
fn the_axis_is_stored_with_the_set() {
    assert_eq!(arc(5, 12).axis(), Axis::Y);
}

#[test]
fn a_fine_map_and_its_coarse_mean_give_the_same_constant_parts() {
    // A texel's light is spread over the texel, so doubling the map without new detail changes little.
    let set = random_set(60, 11, |d| d.y > 0.0);
    let coarse = EnvMap::from_fn(64, 32, |d| [(1.0 + d.x) as f32, (1.0 + d.y) as f32, (1.0 + d.z) as f32]);
    let fine = Image::from_fn(128, 64, |i, j| coarse.image().pixel(i / 2, j / 2).try_into().unwrap());
    for method in methods(&set) {
        let a = operator(&set, method, Outside::Drop, 64, 32).downsample(&coarse);
        let b = operator(&set, method, Outside::Drop, 128, 64).downsample(&EnvMap::new(fine.clone()).unwrap());
        for (a, b) in a.iter().zip(&b) {
            assert!((a[0] - b[0]).abs() < 1e-4, "{method:?}: {a:?} against {b:?}");
        }
    }
}

/// `<U^T t, L'> = <t, U L'>`.
fn adjoint(set: &Directions, outside: Outside, (w, h): (usize, usize), seed: u64) {
    let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(seed);
    let map = EnvMap::from_fn(w, h, |_| std::array::from_fn(|_| rng.random_range(0.0..1.0)));
    let t: Vec<f32> = (0..set.len()).map(|_| rng.random_range(0.0..1.0)).collect();
    for method in methods(set) {
        let u = operator(set, method, outside, w, h);
        let (up, down) = (u.upsample(&t), u.downsample(&map));
        let left: f64 = up.iter().zip(map.image().data().chunks(3)).map(|(a, l)| f64::from(*a) * f64::from(l[1])).sum();
        let right: f64 = t.iter().zip(&down).map(|(t, w)| f64::from(*t) * f64::from(w[1])).sum();
        assert!((left - right).abs() <= 1e-5 * left.abs().max(1e-3), "{method:?}: {left} against {right}");
    }
}

/// Grids, and a map that some methods average down first.
#[test]
fn upsample_is_the_adjoint_of_downsample_on_grids() {
    adjoint(&thesis_grid(), Outside::Drop, (64, 32), 31);
    adjoint(&arc(6, 16), Outside::Nearest, (64, 32), 32);
    adjoint(&arc(5, 12), Outside::Drop, (600, 300), 33);
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 6, failure_persistence: None, ..ProptestConfig::default() })]

    /// On random, irregular sets.
    #[test]
    fn upsample_is_the_adjoint_of_downsample(seed in 0u64..1000, n in 1usize..60, whole in any::<bool>(), nearest in any::<bool>()) {
        let set = random_set(n, seed, |d| whole || d.z > 0.0);
        adjoint(&set, if nearest { Outside::Nearest } else { Outside::Drop }, (24, 12), seed);
    }
}
