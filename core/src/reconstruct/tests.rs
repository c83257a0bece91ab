//! Properties that every method must have, on every kind of set.

use std::f64::consts::PI;
use std::sync::Arc;

use proptest::prelude::*;
use rand::{RngExt, SeedableRng};

use super::linear::Linear;
use super::*;
use crate::domain::{Axis, Coverage, Directions};
use crate::illumination::EnvMap;
use crate::image::Image;
use crate::math::{Vec3, angle_between};

/// The methods that interpolate and are convex: shares are not negative, and a site has all of itself.
const METHODS: [Method; 2] = [Method::ZeroOrder, Method::Linear];

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
        for method in METHODS {
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
        for method in METHODS {
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
    for method in METHODS {
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
    for method in METHODS {
        let a = operator(&set, method, Outside::Drop, 64, 32).downsample(&coarse);
        let b = operator(&set, method, Outside::Drop, 128, 64).downsample(&EnvMap::new(fine.clone()).unwrap());
        for (a, b) in a.iter().zip(&b) {
            assert!((a[0] - b[0]).abs() < 1e-4, "{method:?}: {a:?} against {b:?}");
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 10, failure_persistence: None, ..ProptestConfig::default() })]

    /// `<U^T t, L'> = <t, U L'>` on random, irregular sets.
    #[test]
    fn upsample_is_the_adjoint_of_downsample(seed in 0u64..1000, n in 1usize..60, whole in any::<bool>(), nearest in any::<bool>()) {
        let set = random_set(n, seed, |d| whole || d.z > 0.0);
        let outside = if nearest { Outside::Nearest } else { Outside::Drop };
        let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(seed);
        let map = EnvMap::from_fn(24, 12, |_| std::array::from_fn(|_| rng.random_range(0.0..1.0)));
        let t: Vec<f32> = (0..n).map(|_| rng.random_range(0.0..1.0)).collect();
        for method in METHODS {
            let u = operator(&set, method, outside, 24, 12);
            let (up, down) = (u.upsample(&t), u.downsample(&map));
            let left: f64 = up.iter().zip(map.image().data().chunks(3)).map(|(a, l)| f64::from(*a) * f64::from(l[1])).sum();
            let right: f64 = t.iter().zip(&down).map(|(t, w)| f64::from(*t) * f64::from(w[1])).sum();
            prop_assert!((left - right).abs() <= 1e-5 * left.abs().max(1e-3), "{method:?}: {left} against {right}");
        }
    }
}
