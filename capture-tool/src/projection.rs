//! Directions on flat pictures: the hemisphere about a set's axis as a disc, and lat-long maps.
//!
//! - *Nusselt*: the hemisphere projected along the axis onto a disc, so that areas are solid angles times cosines. It is seen
//!   from outside. About +z that is from the camera: +x right, +y up. About +y it is from above: +x right, +z (the camera's
//!   side) down.
//! - *Lat-long*: as all of this program's maps (OpenEXR's): what an observer at the object sees. +z in the middle, +y at the
//!   top, and +x *left* of the middle, for that observer looks out.

use clap::ValueEnum;
use relume_core::domain::Axis;
use relume_core::math::{Vec3, latlong};

/// How directions lie on a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Projection {
    /// The hemisphere about the set's axis as a disc, seen from outside.
    Nusselt,
    /// The sphere as a lat-long map, seen from the object.
    Latlong,
}

impl Projection {
    /// Width and height of a panel in pixels.
    pub fn size(self) -> (usize, usize) {
        match self {
            Self::Nusselt => (240, 240),
            Self::Latlong => (360, 180),
        }
    }

    /// The direction at a place of a picture: (0, 0) is the top left corner, (1, 1) the bottom right; `None` off the disc.
    pub fn direction(self, (u, v): (f64, f64), axis: Axis) -> Option<Vec3> {
        if self == Self::Latlong {
            return Some(latlong::direction(u, v, 1, 1));
        }
        let (right, up) = (2.0 * u - 1.0, 1.0 - 2.0 * v);
        let square = right * right + up * up;
        (square <= 1.0).then(|| {
            let out = (1.0 - square).sqrt();
            match axis {
                Axis::Z => Vec3::new(right, up, out),
                Axis::Y => Vec3::new(right, out, -up),
            }
        })
    }

    /// The place of a direction; `None` on the far hemisphere of a disc. Inverse of [`Projection::direction`].
    pub fn place(self, direction: &Vec3, axis: Axis) -> Option<(f64, f64)> {
        if self == Self::Latlong {
            return Some(latlong::coordinates(direction, 1, 1));
        }
        let (right, up, out) = match axis {
            Axis::Z => (direction.x, direction.y, direction.z),
            Axis::Y => (direction.x, -direction.z, direction.y),
        };
        (out >= 0.0).then_some((0.5 * (right + 1.0), 0.5 * (1.0 - up)))
    }

    /// The axes that a panel names, with their directions.
    pub fn poles(self, axis: Axis) -> &'static [(&'static str, [f64; 3])] {
        match (self, axis) {
            (Self::Nusselt, Axis::Z) => &[("+x", [1.0, 0.0, 0.0]), ("+y", [0.0, 1.0, 0.0])],
            (Self::Nusselt, Axis::Y) => &[("+x", [1.0, 0.0, 0.0]), ("+z", [0.0, 0.0, 1.0])],
            (Self::Latlong, _) => &[("+x", [1.0, 0.0, 0.0]), ("+z", [0.0, 0.0, 1.0]), ("-x", [-1.0, 0.0, 0.0])],
        }
    }

    /// What is where, in a line.
    pub fn words(self, axis: Axis) -> &'static str {
        match (self, axis) {
            (Self::Nusselt, Axis::Z) => "hemisphere about +z, seen from the camera: +x right, +y up",
            (Self::Nusselt, Axis::Y) => "hemisphere about +y, seen from above: +x right, +z (camera) down",
            (Self::Latlong, _) => "lat-long, seen from the object: +z (camera) in the middle, +y up, +x left",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn poles_lie_where_the_words_say() {
        let at = |p: Projection, d: Vec3, axis| p.place(&d, axis).unwrap();
        let close =
            |a: (f64, f64), b: (f64, f64)| assert!((a.0 - b.0).abs() + (a.1 - b.1).abs() < 1e-12, "{a:?} {b:?}");
        let (disc, map) = (Projection::Nusselt, Projection::Latlong);
        close(at(disc, Vec3::x(), Axis::Z), (1.0, 0.5));
        close(at(disc, Vec3::y(), Axis::Z), (0.5, 0.0));
        close(at(disc, Vec3::z(), Axis::Z), (0.5, 0.5));
        close(at(disc, Vec3::x(), Axis::Y), (1.0, 0.5));
        close(at(disc, Vec3::z(), Axis::Y), (0.5, 1.0));
        close(at(disc, Vec3::y(), Axis::Y), (0.5, 0.5));
        close(at(map, Vec3::z(), Axis::Y), (0.5, 0.5));
        close(at(map, Vec3::x(), Axis::Z), (0.25, 0.5));
        assert_eq!(disc.place(&-Vec3::z(), Axis::Z), None);
    }

    #[test]
    fn directions_invert_places() {
        for (projection, axis) in
            [(Projection::Nusselt, Axis::Z), (Projection::Nusselt, Axis::Y), (Projection::Latlong, Axis::Y)]
        {
            for place in [(0.5, 0.5), (0.3, 0.4), (0.71, 0.2), (0.2, 0.7)] {
                let direction = projection.direction(place, axis).unwrap();
                assert!((direction.norm() - 1.0).abs() < 1e-12);
                let (u, v) = projection.place(&direction, axis).unwrap();
                assert!((u - place.0).abs() + (v - place.1).abs() < 1e-9, "{projection:?} {axis:?} {place:?}");
            }
        }
        assert_eq!(Projection::Nusselt.direction((0.05, 0.05), Axis::Z), None);
    }
}
