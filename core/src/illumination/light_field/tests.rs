//! Light at a point, in closed form; what blocks it; what turns it.

use super::*;
use crate::illumination::lighting::{Aim, Lamp, Shape};
use crate::illumination::{Beam, Turned, flattened};
use crate::image::Image;
use std::f64::consts::PI;

fn frame(place: [f64; 3], aim: [f64; 3]) -> Frame {
    Frame::new(place.into(), aim.into(), Vec3::y()).unwrap()
}

fn field(emitter: Emitter) -> LightField {
    LightField::new(vec![Source::new("it", emitter)])
}

/// Irradiance of channel `c` on a patch at a point with a normal.
fn on_patch(light: &LightField, at: &Vec3, normal: &Vec3, c: usize) -> f64 {
    let mut sum = 0.0;
    light.arriving(at, &mut |towards, irradiance| sum += irradiance[c] * towards.dot(normal).max(0.0));
    sum
}

fn close(found: f64, expected: f64, tolerance: f64) {
    assert!((found - expected).abs() <= tolerance * expected.abs().max(1e-12), "{found} is not {expected}");
}

/// Every kind of source at finite distance gives irradiance pi at its aim, and what stops and colour say.
#[test]
fn stops_count_at_the_aim() {
    let (place, aim) = ([1.0, 2.0, 3.0], [0.3, -0.2, 0.1]);
    let frame = frame(place, aim);
    let white = || Image::from_fn(4, 2, |_, _| [1.0f32; 3]);
    for emitter in [
        Emitter::Point(Point::new(place.into(), aim.into()).unwrap()),
        Emitter::Spot(Spot::new(frame, 0.2, 0.1)),
        Emitter::Spot(Spot::new(frame, 0.0, 0.01)),
        Emitter::Area(Area::new(frame, 0.1, 0.2)),
        Emitter::Area(Area::new(frame, 5.0, 9.0)),
        Emitter::Slide(Slide::new(frame, 0.3, white(), Lookup::Smooth).unwrap()),
        Emitter::Slide(Slide::new(frame, 0.3, white(), Lookup::Squares).unwrap()),
    ] {
        let light = LightField::new(vec![Source::new("it", emitter.clone()).lit([1.0, 0.5, 0.25], 1.0)]);
        for c in 0..3 {
            close(on_patch(&light, &aim.into(), &-frame.axis, c), PI * 2.0 / f64::from(1 << c), 1e-12);
        }
        assert_eq!(emitter.place(), Some(place.into()));
        // At twice the distance, beyond the aim, a quarter; a large area is no point.
        let beyond = frame.aim() + frame.axis * frame.distance;
        if !matches!(emitter, Emitter::Area(_)) {
            close(on_patch(&light, &beyond, &-frame.axis, 0), 2.0 * PI / 4.0, 1e-12);
        }
        // At the source there is nothing, and nowhere anything that is not finite.
        for at in [frame.place, frame.place + frame.right * 1e-7, frame.place - frame.axis, Vec3::zeros()] {
            light.arriving(&at, &mut |towards, irradiance| {
                assert!((towards.norm() - 1.0).abs() < 1e-9 && irradiance.iter().all(|e| e.is_finite() && *e >= 0.0));
                assert!(irradiance[0] < 1e12);
            });
        }
        close(on_patch(&light, &frame.place, &frame.axis, 0) + 1.0, 1.0, 1e-12);
    }
}

/// Lambert's formula for a polygon of radiance 1 (1760), as in the tests of softboxes.
#[test]
fn an_area_lights_near_points_as_lamberts_formula_says() {
    let frame = Frame::new(Vec3::new(0.4, 1.5, 2.0), Vec3::new(0.1, 0.0, -0.2), Vec3::y()).unwrap().rolled(0.3);
    let (w, h) = (1.4, 0.6);
    let light = field(Emitter::Area(Area::new(frame, w, h)));
    let corner = |x: f64, y: f64| frame.place + frame.right * (x * w / 2.0) + frame.up * (y * h / 2.0);
    let corners = [corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)];
    let lambert = |at: &Vec3, normal: &Vec3| {
        let edge = |n: usize| {
            let (p, q) = (corners[n] - at, corners[(n + 1) % 4] - at);
            p.angle(&q) * p.cross(&q).normalize().dot(normal) / 2.0
        };
        (0..4).map(edge).sum::<f64>().abs()
    };
    let radiance = PI / lambert(&frame.aim(), &-frame.axis);
    // From its own distance to a third of it, and aside.
    for (at, normal) in [
        (frame.aim() + frame.right * 0.8, Vec3::new(0.1, 0.8, 0.9)),
        (frame.aim() - frame.axis * (frame.distance * 0.66) + frame.up * 0.3, -frame.axis),
        (Vec3::new(-0.5, -0.6, 0.3), Vec3::new(0.0, 0.2, 0.9)),
    ] {
        let normal = normal.normalize();
        assert!(corners.iter().all(|p| (p - at).dot(&normal) > 0.0));
        close(on_patch(&light, &at, &normal, 0), radiance * lambert(&at, &normal), 3e-3);
    }
    // Behind it there is nothing.
    assert_eq!(on_patch(&light, &(frame.place - frame.axis), &frame.axis, 0), 0.0);
}

#[test]
fn a_beam_is_even_then_falls() {
    let frame = frame([0.0, 0.0, 5.0], [0.0; 3]);
    let spot = Spot::new(frame, 20f64.to_radians(), 4f64.to_radians());
    let light = field(Emitter::Spot(spot));
    for (degrees, share) in [(0.0f64, 1.0), (9.99, 1.0), (11.0, 0.84375), (12.0, 0.5), (13.0, 0.15625), (14.01, 0.0)] {
        let at = Vec3::new(0.0, degrees.to_radians().tan() * 5.0, 0.0);
        let mut found = 0.0;
        light.arriving(&at, &mut |_, irradiance| found = irradiance[1]);
        close(found, share * PI * degrees.to_radians().cos().powi(2), 1e-6);
    }
    let hard = Spot::new(frame, 0.4, 0.0);
    assert_eq!([hard.profile(0.19), hard.profile(0.21)], [1.0, 0.0]);
}

/// A slide lies the right way up: what is on its right is on the right of what the projector sees.
#[test]
fn a_slide_shows_the_projectors_view() {
    let columns = |x: usize, y: usize| [x as f32, y as f32, 1.0];
    let frame = frame([0.0, 0.0, 4.0], [0.0; 3]);
    let view = 2.0 * 0.25f64.atan();
    let squares = Slide::new(frame, view, Image::from_fn(4, 2, columns), Lookup::Squares).unwrap();
    let smooth = Slide::new(frame, view, Image::from_fn(4, 2, columns), Lookup::Smooth).unwrap();
    let colour = |slide: &Slide, x: f64, y: f64| {
        let mut found = None;
        let at = Vec3::new(x, y, 0.0);
        let scale = PI * 16.0 / (16.0 + x * x + y * y);
        field(Emitter::Slide(slide.clone())).arriving(&at, &mut |_, e| found = Some(e.map(|e| e / scale)));
        found
    };
    // The picture is 2 wide and 1 high in the plane z = 0; +x is on the projector's right, as on the camera's.
    for (x, y, texel) in [(-0.9, 0.4, [0.0, 0.0]), (0.9, 0.4, [3.0, 0.0]), (0.3, -0.4, [2.0, 1.0])] {
        let found = colour(&squares, x, y).unwrap();
        close(found[0], texel[0], 1e-9);
        close(found[1], texel[1], 1e-9);
    }
    // Texel centres lie at -0.75, -0.25, 0.25, 0.75; the rim is held.
    for (x, y, expected) in
        [(-0.75, 0.25, [0.0, 0.0]), (0.0, 0.0, [1.5, 0.5]), (0.6, -0.24, [2.7, 0.98]), (0.99, 0.49, [3.0, 0.0])]
    {
        let found = colour(&smooth, x, y).unwrap();
        close(found[0], expected[0], 1e-9);
        close(found[1], expected[1], 1e-9);
    }
    assert!(colour(&squares, 1.01, 0.0).is_none() && colour(&smooth, 0.0, 0.51).is_none());
    let behind = Vec3::new(0.0, 0.0, 4.5);
    assert_eq!(squares.seen(&behind), None);
    // Below a projector that hangs over the object, its picture's top is away from the camera.
    let above = Frame::new(Vec3::new(0.0, 3.0, 0.0), Vec3::zeros(), Vec3::y()).unwrap();
    assert!((above.up + Vec3::z()).norm() < 1e-12 && (above.right - Vec3::x()).norm() < 1e-12);
}

fn high(elevation_deg: f64) -> Aim {
    Aim { azimuth_rad: 0.0, elevation_rad: elevation_deg.to_radians() }
}

/// Blinds two units before the origin, 3 high and wide.
fn window(slats: Option<Slats>) -> Blinds {
    Blinds::new(frame([0.0, 0.0, 2.0], [0.0; 3]), 3.0, 3.0, slats)
}

fn sun_behind(elevation_deg: f64, diameter_deg: f64, slats: Option<Slats>) -> LightField {
    let sun = Far::sun(&high(elevation_deg), diameter_deg.to_radians(), true);
    LightField::new(vec![Source::new("sun", Emitter::Far(sun)).behind(window(slats))])
}

/// Irradiance of what comes through, as a share of the sun's, over heights in the plane z = 0.
fn shares(light: &LightField, heights: impl Iterator<Item = f64>) -> Vec<f64> {
    let at = |y: f64| {
        let mut sum = 0.0;
        light.arriving(&Vec3::new(0.0, y, 0.0), &mut |_, e| sum += e[0] / PI);
        sum
    };
    heights.map(at).collect()
}

/// The mean share through slats is `1 - w |sin(a) - m cos(a)| / s`, and the window ends where it does.
#[test]
fn slats_let_through_what_their_geometry_says() {
    let (spacing, width) = (0.1, 0.09);
    for (elevation, tilt) in [(0.0, 0.0), (0.0, 45.0), (20.0, 30.0), (20.0, -30.0), (20.0, 20.0), (35.0, -60.0)] {
        let slats = Slats { spacing, width, tilt_rad: f64::to_radians(tilt), turn_rad: 0.0 };
        let light = sun_behind(elevation, 0.0, Some(slats));
        let slope = f64::to_radians(elevation).tan();
        // Ten slats, seen where the window's middle throws its light.
        let middle = -2.0 * slope;
        let found = shares(&light, (0..1000).map(|n| middle + (n as f64 + 0.5) * 1e-3 - 0.5));
        let (sin, cos) = f64::to_radians(tilt).sin_cos();
        let expected = (1.0 - width * (sin - slope * cos).abs() / spacing).max(0.0);
        let mean = found.iter().sum::<f64>() / 1000.0;
        assert!((mean - expected).abs() < 0.011, "{elevation}, {tilt}: {mean} is not {expected}");
        assert!(found.iter().all(|share| *share == 0.0 || (*share - 1.0).abs() < 1e-12));
        let above = shares(&light, [middle + 1.51, middle - 1.51].into_iter());
        assert_eq!(above, [0.0, 0.0]);
    }
    // A gap in the middle; upright strips do not change with height.
    let strips = |turn_deg: f64| Some(Slats::strips(0.4, 0.5, f64::to_radians(turn_deg)));
    assert_eq!(
        shares(&sun_behind(0.0, 0.0, strips(0.0)), [0.0, 0.09, 0.11, 0.29, 0.31].into_iter()),
        [1.0, 1.0, 0.0, 0.0, 1.0]
    );
    assert_eq!(shares(&sun_behind(0.0, 0.0, strips(90.0)), [0.0, 0.11, 0.31].into_iter()), [1.0; 3]);
}

/// The sun's disc softens the edge of a slat over its diameter times the distance: an integral of the disc.
#[test]
fn the_suns_disc_makes_penumbras() {
    let light = sun_behind(0.0, 2.0, Some(Slats::strips(1.0, 0.5, 0.0)));
    // The gap ends at 0.25; the disc's radius is 2 tan(1 degree) there.
    let radius = 2.0 * 1f64.to_radians().tan();
    for t in [-1.05f64, -0.7, -0.3, 0.0, 0.4, 0.8, 1.05] {
        let found = shares(&light, [0.25 + t * radius].into_iter())[0];
        let c = t.clamp(-1.0, 1.0);
        let below = (c.acos() - c * (1.0 - c * c).sqrt()) / PI;
        assert!((found - below).abs() < 0.05, "{t}: {found} is not {below}");
    }
    assert_eq!(Far::sun(&high(3.0), 0.53f64.to_radians(), false).beams.len(), 1);
    assert_eq!(Far::sun(&high(3.0), 0.0, true).beams.len(), 1);
    let count = Far::sun(&high(3.0), 0.53f64.to_radians(), true).beams.len();
    assert!((31..=33).contains(&count), "{count}");
}

#[test]
fn a_window_is_between_the_light_and_the_point() {
    let open = window(None);
    // Of a lamp inside the room, beside the window or at it, nothing comes through it.
    for (at, lamp, through) in [
        ([0.0; 3], [0.0, 0.5, 4.0], true),
        ([0.0; 3], [0.0, 0.5, 1.0], false),
        ([0.0; 3], [0.0, 4.0, 4.0], false),
        ([0.0, 0.0, 3.0], [0.0, 0.5, 4.0], false),
        ([0.0; 3], [0.0, 0.5, -4.0], false),
    ] {
        let source = Source::new("lamp", Emitter::Point(Point::new(lamp.into(), Vec3::zeros()).unwrap())).behind(open);
        let mut seen = false;
        source.arriving(&at.into(), &mut |_, _| seen = true);
        assert_eq!(seen, through, "{at:?} {lamp:?}");
    }
    assert!(open.shades(&Vec3::z(), 3.0) && !open.shades(&Vec3::z(), 1.0) && !open.shades(&-Vec3::z(), 3.0));
    // A continuum too.
    let map = EnvMap::from_fn(8, 4, |_| [1.0; 3]);
    let sky = LightField::new(vec![Source::new("sky", Emitter::Map(Arc::new(map))).behind(open)]);
    assert_eq!(sky.radiance(&Vec3::zeros(), &Vec3::z()), [1.0; 3]);
    assert_eq!(sky.radiance(&Vec3::zeros(), &Vec3::x()), [0.0; 3]);
    assert_eq!(sky.radiance(&Vec3::new(0.0, 1.6, 0.0), &Vec3::z()), [0.0; 3]);
}

/// Probes that stand in free space about a few far and near lamps give back, for lines through them, the light that is there.
#[test]
fn a_grid_of_probes_gives_back_the_rays_through_it() {
    // Radiance at place p from direction d: linear in where the line meets the plane z = 0.5, and in the direction.
    let truth = |p: &Vec3, d: &Vec3| {
        let cut = p + d * ((0.5 - p.z) / d.z);
        [1.0 + 0.1 * cut.x, 1.0 + 0.2 * cut.y, 2.0 + d.x]
    };
    let at = ProbesAt {
        origin: Vec3::new(-1.0, 1.0, 0.5),
        across: Vec3::new(0.5, 0.0, 0.0),
        down: Vec3::new(0.1, -0.5, 0.0),
        deep: Vec3::zeros(),
        counts: [5, 4, 1],
    };
    let probe = |n: usize| {
        let place = at.origin + at.across * (n % 5) as f64 + at.down * (n / 5) as f64;
        EnvMap::from_fn(256, 128, |d| truth(&place, d).map(|l| l as f32))
    };
    let light = field(Emitter::Probes(Probes::new(&at, (0..20).map(probe).collect()).unwrap()));
    assert!(light.has_radiance());
    for (p, d) in [
        (Vec3::new(0.2, 0.1, 0.0), Vec3::new(0.1, 0.2, 1.0)),
        (Vec3::new(-0.3, 0.2, 1.4), Vec3::new(-0.2, 0.1, 0.9)),
        (Vec3::new(0.1, 0.3, 0.9), Vec3::new(0.3, 0.1, -0.8)),
    ] {
        let d = d.normalize();
        let (found, expected) = (light.radiance(&p, &d), truth(&p, &d));
        (0..3).for_each(|c| assert!((found[c] - expected[c]).abs() < 0.02, "{found:?} is not {expected:?}"));
    }
    // Beyond the grid its rim is held; along the plane the point itself is looked up.
    let d = Vec3::new(0.0, 0.0, 1.0);
    let far = light.radiance(&Vec3::new(50.0, 1.0, 0.0), &d);
    assert!((far[0] - 1.1).abs() < 0.02 && (far[1] - 1.2).abs() < 0.02, "{far:?}");
    let along = light.radiance(&Vec3::new(0.5, 1.0, 3.0), &Vec3::x());
    assert!(along.iter().all(|l| l.is_finite()));
}

#[test]
fn lines_and_volumes_of_probes_are_looked_up_where_the_point_is() {
    let grey = |v: usize| EnvMap::from_fn(4, 2, move |_| [v as f32; 3]);
    let step = |x: f64, y: f64, z: f64| Vec3::new(x, y, z);
    let at = ProbesAt {
        origin: step(0.0, 0.0, 0.0),
        across: step(1.0, 0.0, 0.0),
        down: step(0.0, 0.0, 0.0),
        deep: step(0.0, 0.0, 0.0),
        counts: [3, 1, 1],
    };
    let line = Probes::new(&at, (0..3).map(grey).collect()).unwrap();
    close(line.radiance(&step(1.25, 7.0, -3.0), &Vec3::x())[0], 1.25, 1e-9);
    let at = ProbesAt { down: step(0.0, -2.0, 0.0), deep: step(0.0, 0.0, 4.0), counts: [2, 2, 2], ..at };
    let volume = Probes::new(&at, (0..8).map(grey).collect()).unwrap();
    close(volume.radiance(&step(0.5, -1.0, 1.0), &Vec3::x())[1], 0.5 + 1.0 + 1.0, 1e-9);
    // One probe is a map; steps along one another, and a wrong number, are refused.
    let one = Probes::new(&ProbesAt { counts: [1, 1, 1], ..at }, vec![grey(5)]).unwrap();
    assert_eq!(one.radiance(&step(3.0, 2.0, 1.0), &Vec3::z()), [5.0; 3]);
    assert!(Probes::new(&ProbesAt { down: step(-2.0, 0.0, 0.0), ..at }, (0..8).map(grey).collect()).is_none());
    assert!(Probes::new(&at, (0..7).map(grey).collect()).is_none());
    assert!(Probes::new(&ProbesAt { across: step(0.0, 0.0, 0.0), ..at }, (0..8).map(grey).collect()).is_none());
}

/// What the look of a picture turns, a message names, and the 2D approximation takes for the same everywhere.
#[test]
fn a_field_is_incident_light() {
    let spot = Emitter::Spot(Spot::new(frame([0.1, 2.0, 3.0], [0.1, 0.0, 0.0]), 0.3, 0.1));
    let slats = Some(Slats::strips(0.2, 0.5, 0.0));
    let poles = Emitter::Map(Arc::new(EnvMap::six_poles(512, 256)));
    let light = LightField::new(vec![
        Source::new("spot", spot),
        Source::new("sun", Emitter::Far(Far::sun(&high(0.0), 0.01, true))).behind(window(slats)),
        Source::new("poles", poles.clone()).lit([1.0; 3], 1.0),
    ]);
    assert_eq!(light.parts().iter().map(|(name, _)| name.as_str()).collect::<Vec<_>>(), ["spot", "sun", "poles"]);
    assert!(light.has_radiance() && !light.varies());
    assert!(Source::new("view", poles).behind(window(None)).varies());
    let rotation = crate::math::Orientation { heading_deg: 90.0, ..Default::default() }.matrix();
    let turned = Turned { light: &light, rotation };
    let at = Vec3::new(0.2, 0.0, 0.3);
    let (mut plain, mut after) = (Vec::new(), Vec::new());
    light.arriving(&at, &mut |d, e| plain.push((rotation * d, e)));
    turned.arriving(&(rotation * at), &mut |d, e| after.push((d, e)));
    assert!(plain.len() > 1 && plain.len() == after.len());
    for (a, b) in plain.iter().zip(&after) {
        assert!((a.0 - b.0).norm() < 1e-12);
        close(a.1[0], b.1[0], 1e-12);
    }
    let (beams, map) = flattened(&turned);
    assert!((beams[0].direction - rotation * Vec3::new(0.1, 2.0, 3.0).normalize()).norm() < 1e-12);
    let map = map.unwrap();
    for (d, pole) in [(Vec3::x(), [0.0, 0.0, 2.0]), (Vec3::y(), [0.0, 2.0, 0.0]), (-Vec3::z(), [2.0, 0.0, 0.0])] {
        let found = map.radiance(&d);
        (0..3).for_each(|c| assert!((found[c] - pole[c]).abs() < 0.02, "{d}: {found:?}"));
    }
}

/// A far lamp gives the light of the lighting file, as a few beams or as a map.
#[test]
fn far_lamps_keep_their_light() {
    let aim = Aim { azimuth_rad: 0.7, elevation_rad: 0.4 };
    for (shape, is_map) in [
        (Shape::Directional { aim }, false),
        (Shape::Disc { aim, radius_rad: 0.05 }, false),
        (Shape::Disc { aim, radius_rad: 0.6 }, true),
        (Shape::Ring { aim, inner_rad: 0.5, outer_rad: 0.7 }, true),
        (Shape::Softbox { aim, width: 1.5, height: 0.8, distance: 1.2, turn_rad: 0.3 }, true),
        (Shape::Dome { horizon: [1.0, 0.5, 0.2], horizon_stops: 1.0, ground: 0.2 }, true),
    ] {
        let lamp = Lamp { shape, colour: [0.3, 0.6, 0.9], stops: 1.5 };
        let light = field(far_lamp(&lamp, false));
        assert_eq!(light.has_radiance(), is_map, "{shape:?}");
        let normal = Vec3::new(0.5, 0.6, 0.4).normalize();
        let sum = |beams: Vec<Beam>, c: usize| -> f64 {
            beams.iter().map(|b| b.irradiance[c] * b.direction.dot(&normal).max(0.0)).sum()
        };
        for c in 0..3 {
            let (beams, map) = flattened(&light);
            let mut found = sum(beams, c);
            if let Some(map) = map {
                let (w, h) = map.image().size();
                for (j, i) in (0..h).flat_map(|j| (0..w).map(move |i| (j, i))) {
                    let d = crate::math::latlong::direction(i as f64 + 0.5, j as f64 + 0.5, w, h);
                    let omega = crate::math::latlong::texel_solid_angle(j, w, h);
                    found += f64::from(map.image().pixel(i, j)[c]) * omega * d.dot(&normal).max(0.0);
                }
            }
            close(found, sum(lamp.beams(), c), 5e-3);
        }
    }
}
