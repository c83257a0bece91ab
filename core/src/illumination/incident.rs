//! Light that may differ from point to point (2.1): what arrives at a point.

use super::{Beam, EnvMap};
use crate::math::{Mat3, Vec3};

/// Columns of the map that stands for a light at one point.
const FLAT_COLUMNS: usize = 512;

/// Light about the object: a light field, of which an environment map is the special case that is the same everywhere.
///
/// Points are in the stage frame and scene units, the object at the origin. Lights that are seen under no angle arrive as
/// rays, what fills a range of directions has radiance; a light is one, the other, or both.
pub trait Incident: Sync + std::fmt::Debug {
    /// Calls `each` for every ray that arrives at a point: the unit vector from the point towards the light, and the irradiance
    /// that it gives a patch at the point which faces it, linear RGB.
    fn arriving(&self, at: &Vec3, each: &mut dyn FnMut(Vec3, [f64; 3]));

    /// Radiance that arrives at a point from a direction (unit, towards the light), linear RGB.
    fn radiance(&self, at: &Vec3, towards: &Vec3) -> [f64; 3];

    /// Has it radiance at all?
    fn has_radiance(&self) -> bool;

    /// Does its radiance differ from point to point?
    fn varies(&self) -> bool {
        true
    }

    /// Its lights one by one, with what a message calls them.
    fn parts(&self) -> Vec<(String, &dyn Incident)>;
}

impl Incident for EnvMap {
    fn arriving(&self, _: &Vec3, _: &mut dyn FnMut(Vec3, [f64; 3])) {}

    fn radiance(&self, _: &Vec3, towards: &Vec3) -> [f64; 3] {
        self.between(towards)
    }

    fn has_radiance(&self) -> bool {
        true
    }

    fn varies(&self) -> bool {
        false
    }

    fn parts(&self) -> Vec<(String, &dyn Incident)> {
        vec![("the map".to_owned(), self)]
    }
}

/// Distant lights, the same everywhere.
#[derive(Debug, Clone, PartialEq)]
pub struct Distant(pub Vec<Beam>);

impl Incident for Distant {
    fn arriving(&self, _: &Vec3, each: &mut dyn FnMut(Vec3, [f64; 3])) {
        self.0.iter().for_each(|beam| each(beam.direction, beam.irradiance));
    }

    fn radiance(&self, _: &Vec3, _: &Vec3) -> [f64; 3] {
        [0.0; 3]
    }

    fn has_radiance(&self) -> bool {
        false
    }

    fn varies(&self) -> bool {
        false
    }

    fn parts(&self) -> Vec<(String, &dyn Incident)> {
        vec![("the lamps".to_owned(), self)]
    }
}

/// A light turned about the object.
#[derive(Debug)]
pub struct Turned<'a> {
    /// As it was.
    pub light: &'a dyn Incident,
    /// Applied to it.
    pub rotation: Mat3,
}

impl Incident for Turned<'_> {
    fn arriving(&self, at: &Vec3, each: &mut dyn FnMut(Vec3, [f64; 3])) {
        self.light.arriving(&self.rotation.tr_mul(at), &mut |towards, irradiance| {
            each(self.rotation * towards, irradiance);
        });
    }

    fn radiance(&self, at: &Vec3, towards: &Vec3) -> [f64; 3] {
        self.light.radiance(&self.rotation.tr_mul(at), &self.rotation.tr_mul(towards))
    }

    fn has_radiance(&self) -> bool {
        self.light.has_radiance()
    }

    fn varies(&self) -> bool {
        self.light.varies()
    }

    fn parts(&self) -> Vec<(String, &dyn Incident)> {
        vec![("the light".to_owned(), self)]
    }
}

/// The light as it is at the origin, taken for the same everywhere: the 2D approximation (figures 7.8 and 7.9). Radiance becomes a
/// map of 512 x 256 texels.
pub fn flattened(light: &dyn Incident) -> (Vec<Beam>, Option<EnvMap>) {
    let (origin, mut beams) = (Vec3::zeros(), Vec::new());
    light.arriving(&origin, &mut |direction, irradiance| beams.push(Beam { direction, irradiance }));
    let seen = |towards: &Vec3| light.radiance(&origin, towards).map(|v| v as f32);
    let map = light.has_radiance().then(|| EnvMap::from_fn(FLAT_COLUMNS, FLAT_COLUMNS / 2, seen));
    (beams, map)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Orientation;

    #[test]
    fn maps_are_linear_between_texels_and_go_round() {
        let map = EnvMap::from_fn(64, 32, |d| [1.0 + d.x as f32, 2.0 + d.y as f32, 3.0 + d.z as f32]);
        for towards in [Vec3::new(1.0, 0.3, -2.0), Vec3::new(0.01, -0.2, -1.0), Vec3::new(-0.01, 0.1, -1.0), Vec3::y()]
        {
            let d = towards.normalize();
            let found = map.between(&d);
            (0..3).for_each(|c| assert!((found[c] - (1.0 + c as f64 + d[c])).abs() < 0.06, "{found:?} at {d}"));
        }
    }

    #[test]
    fn a_turned_light_is_the_light_turned() {
        let rotation = Orientation { heading_deg: 90.0, ..Orientation::default() }.matrix();
        let beam = Beam { direction: Vec3::z(), irradiance: [1.0, 2.0, 3.0] };
        let distant = Distant(vec![beam]);
        let turned = Turned { light: &distant, rotation };
        let (beams, map) = flattened(&turned);
        assert!((beams[0].direction - Vec3::x()).norm() < 1e-12 && map.is_none());
        let map = EnvMap::six_poles(64, 32);
        let turned = Turned { light: &map, rotation };
        // What was blue and before the camera is to the right.
        assert_eq!(turned.radiance(&Vec3::zeros(), &Vec3::x()), [0.0, 0.0, 1.0]);
    }
}
