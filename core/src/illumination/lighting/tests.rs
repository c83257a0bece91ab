//! Lamps: their light is what was asked for, from where it was asked for.

use super::*;

fn lamp(shape: Shape) -> Lamp {
    Lamp { shape, colour: [1.0, 0.5, 0.25], stops: 1.0 }
}

fn aim(azimuth: f64, elevation: f64) -> Aim {
    Aim { azimuth_rad: azimuth.to_radians(), elevation_rad: elevation.to_radians() }
}

/// Irradiance of channel `c` on a patch with a normal; `None` for each beam's own facing patch.
fn irradiance(beams: &[Beam], c: usize, normal: Option<&Vec3>) -> f64 {
    beams.iter().map(|b| b.irradiance[c] * normal.map_or(1.0, |n| n.dot(&b.direction).max(0.0))).sum()
}

fn softbox(aim: Aim, width: f64, height: f64, distance: f64) -> Shape {
    Shape::Softbox { aim, width, height, distance, turn_rad: 0.0 }
}

#[test]
fn azimuth_goes_right_and_elevation_up() {
    for (at, direction) in [
        (aim(0.0, 0.0), Vec3::z()),
        (aim(90.0, 0.0), Vec3::x()),
        (aim(-90.0, 0.0), -Vec3::x()),
        (aim(180.0, 0.0), -Vec3::z()),
        (aim(33.0, 90.0), Vec3::y()),
    ] {
        assert!((at.direction() - direction).norm() < 1e-12, "{at:?}");
        assert!(at.right().dot(&at.direction()).abs() < 1e-12);
    }
}

#[test]
fn a_lamp_keeps_its_light_whatever_its_size() {
    let to = aim(40.0, 30.0);
    let ring = |inner_rad: f64, outer_rad: f64| Shape::Ring { aim: to, inner_rad, outer_rad };
    for shape in [
        Shape::Directional { aim: to },
        Shape::Disc { aim: to, radius_rad: 1e-4 },
        Shape::Disc { aim: to, radius_rad: 0.3 },
        Shape::Disc { aim: to, radius_rad: PI },
        softbox(to, 1.0, 0.01, 2.0),
        softbox(to, 1e-3, 1e-3, 10.0),
        softbox(to, 1e4, 1e4, 1e-3),
        ring(0.2, 0.21),
        ring(1.5, 3.0),
    ] {
        let beams = lamp(shape).beams();
        for (c, expected) in [2.0 * PI, PI, 0.5 * PI].into_iter().enumerate() {
            assert!((irradiance(&beams, c, None) / expected - 1.0).abs() < 1e-9, "{shape:?}");
        }
        assert!(beams.iter().all(|b| (b.direction.norm() - 1.0).abs() < 1e-12), "{shape:?}");
        assert!(beams.iter().flat_map(|b| b.irradiance).all(|e| e.is_finite() && e >= 0.0), "{shape:?}");
        assert!(beams.len() < 70_000, "{} beams of {shape:?}", beams.len());
    }
}

/// Lambert's formula for a polygon of radiance 1 (1760): `E = 1/2 sum of edge angle x (unit normal of its plane . n)`.
#[test]
fn a_softbox_lights_a_patch_as_lamberts_formula_says() {
    let to = aim(25.0, 35.0);
    let shape = Shape::Softbox { aim: to, width: 1.4, height: 0.6, distance: 1.1, turn_rad: 0.4 };
    let (axis, level) = (to.direction(), to.right());
    let rise = axis.cross(&level);
    let (s, c) = 0.4f64.sin_cos();
    let (across, along) = ((level * c + rise * s) * 0.7, (rise * c - level * s) * 0.3);
    let middle = axis * 1.1;
    let corners = [middle - across - along, middle + across - along, middle + across + along, middle - across + along];
    // All of the softbox is before both patches.
    for normal in [axis, Vec3::new(0.3, 0.8, 0.9).normalize()] {
        assert!(corners.iter().all(|p| p.dot(&normal) > 0.0));
        let edge = |n: usize| {
            let (p, q) = (corners[n], corners[(n + 1) % 4]);
            p.angle(&q) * p.cross(&q).normalize().dot(&normal) / 2.0
        };
        let lambert: f64 = (0..4).map(edge).sum::<f64>().abs();
        // Its radiance: total over its solid angle, by the formula for a rectangle seen along its axis.
        let (a, b, d) = (0.7f64, 0.3f64, 1.1f64);
        let omega = 4.0 * (a * b / (d * (a * a + b * b + d * d).sqrt())).atan();
        let expected = 2.0 * PI / omega * lambert;
        let got = irradiance(&lamp(shape).beams(), 0, Some(&normal));
        assert!((got / expected - 1.0).abs() < 1e-4, "{got} is not {expected}");
    }
}

/// A disc of radiance 1 gives a facing patch `pi sin^2 r`, an annulus the difference of two.
#[test]
fn discs_and_rings_are_even() {
    let to = aim(-70.0, -20.0);
    for (inner, outer) in [(0.0, 0.005), (0.0, 0.4), (0.3, 0.31), (0.5, 1.2)] {
        let shape = Shape::Ring { aim: to, inner_rad: inner, outer_rad: outer };
        let omega = 2.0 * PI * (f64::cos(inner) - f64::cos(outer));
        let expected = 2.0 * PI / omega * PI * (outer.sin().powi(2) - inner.sin().powi(2));
        let got = irradiance(&lamp(shape).beams(), 0, Some(&to.direction()));
        assert!((got / expected - 1.0).abs() < 1e-6, "{inner} to {outer}: {got} is not {expected}");
        // Even about the axis: the sum of directions lies on it.
        let mean: Vec3 = lamp(shape).beams().iter().map(|b| b.direction * b.irradiance[0]).sum();
        assert!(mean.normalize().dot(&to.direction()) > 1.0 - 1e-5, "{inner} to {outer}");
    }
}

/// Beams are spread evenly: no beam of a narrow ring, a cap or a dome is nearer to another than a third of a cell's side.
#[test]
fn beams_keep_their_distance() {
    for (inner_rad, outer_rad) in [(0.0, 0.15), (0.5, 0.51), (1.4, 1.42), (0.9, 1.0)] {
        let beams = lamp(Shape::Ring { aim: aim(10.0, 80.0), inner_rad, outer_rad }).beams();
        let mut nearest = f64::INFINITY;
        for (n, a) in beams.iter().enumerate() {
            for b in &beams[..n] {
                nearest = nearest.min((a.direction - b.direction).norm());
            }
        }
        let side = 0.5f64.to_radians();
        assert!(nearest > side / 3.0, "{inner_rad} to {outer_rad}: {} of a side", nearest / side);
    }
}

#[test]
fn a_dome_gives_the_zenith_its_stops() {
    for (horizon_stops, ground) in [(0.0, 0.0), ((1.0f64 / 3.0).log2(), 0.0), (2.0, 0.3)] {
        let dome =
            Lamp { shape: Shape::Dome { horizon: [1.0; 3], horizon_stops, ground }, colour: [1.0; 3], stops: -1.0 };
        let beams = dome.beams();
        let up = irradiance(&beams, 1, Some(&Vec3::y()));
        assert!((up / (PI / 2.0) - 1.0).abs() < 1e-6, "{up}");
        // The ground returns its albedo of that.
        let down = irradiance(&beams, 1, Some(&-Vec3::y()));
        assert!((down - ground * PI / 2.0).abs() < 1e-6, "{down}");
        // A patch facing the horizon: 2 x integral of L cos^2 e de, with L = h (1 - sin e) + sin e.
        let side = irradiance(&beams, 1, Some(&Vec3::z())) - ground * PI / 4.0;
        let h = horizon_stops.exp2();
        let expected = 0.5 / (h / 3.0 + 2.0 / 3.0) * (h * PI / 2.0 + (1.0 - h) * 2.0 / 3.0);
        assert!((side / expected - 1.0).abs() < 1e-4, "{side} is not {expected}");
    }
}
