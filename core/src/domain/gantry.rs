//! A projector that is carried about the object: positions x squares of its picture (7.2, 7.3).
//!
//! **Serialisation.** Element of `L`: `(position x n + row) x n + column`, as the thesis serialises four coordinates (7.2),
//! where a position counts for the two of them that say where light comes from. Columns go to the right and row 0 is at the top of what the
//! projector sees; positions are in the order of the capture.
//!
//! **Focal plane.** Between positions the light field is interpolated about the object: a square stands for what it lights of the
//! plane through the origin that faces the projector.

use std::sync::Arc;

use super::{Axis, Coverage, Directions, Filter, Plane};
use crate::error::{Error, Result};
use crate::math::Vec3;

/// The widest picture, radians: no lens throws more on a plane.
const WIDEST: f64 = 2.9;
/// Unit vectors and right angles are right up to this.
const CARELESS: f64 = 1e-3;
/// The most squares along a side.
pub const MOST_SQUARES: usize = 256;

/// Where a projector stands, in the stage frame and scene units, and how it looks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    /// Its lens.
    pub place: Vec3,
    /// To the right of what it sees, unit.
    pub right: Vec3,
    /// To the top of what it sees, unit.
    pub up: Vec3,
}

impl Pose {
    /// Looks at the origin, its top towards +y, or away from the camera where it looks straight up or down.
    pub fn at_origin(place: Vec3) -> Self {
        let axis = -place.normalize();
        let upright = if axis.y.abs() > 0.9999 { -Vec3::z() } else { Vec3::y() };
        let right = axis.cross(&upright).normalize();
        Self { place, right, up: right.cross(&axis) }
    }

    /// Where it looks, unit.
    pub fn axis(&self) -> Vec3 {
        self.up.cross(&self.right)
    }

    fn check(&self, n: usize) -> Result<()> {
        let [p, r, u] = [self.place, self.right, self.up];
        let square =
            (r.norm() - 1.0).abs() < CARELESS && (u.norm() - 1.0).abs() < CARELESS && r.dot(&u).abs() < CARELESS;
        let ahead = -p.dot(&self.axis());
        if square && p.norm().is_finite() && ahead > 1e-6 {
            return Ok(());
        }
        let found = format!("a projector at {:?} that looks along {:?}", p.as_slice(), self.axis().as_slice());
        let expected = "one before the object that looks towards it, right and up unit vectors at a right angle";
        Err(Error::invalid(format!("position {} of the projector", n + 1), found, expected))
    }
}

/// What a gantry could emit.
#[derive(Debug, Clone)]
pub struct Gantry {
    poses: Vec<Pose>,
    directions: Arc<Directions>,
    side: usize,
    picture: Plane,
    view_rad: f64,
    filter: Filter,
}

impl Gantry {
    /// Positions, `side` x `side` squares, the angle across the picture, and how squares fall off.
    ///
    /// # Errors
    /// No position; one that does not look at the object; no squares, or more than 256 along a side; an angle that no lens has.
    pub fn new(poses: Vec<Pose>, side: usize, view_rad: f64, filter: Filter) -> Result<Self> {
        let directions = Self::directions_of(&poses)?;
        Self::with_directions(poses, Directions::new(directions)?, (side, view_rad, filter))
    }

    /// With the axis and coverage that a container states.
    ///
    /// # Errors
    /// As [`Gantry::new`].
    pub fn with_coverage(
        poses: Vec<Pose>,
        (axis, coverage): (Axis, Coverage),
        picture: (usize, f64, Filter),
    ) -> Result<Self> {
        let places = Self::directions_of(&poses)?;
        Self::with_directions(poses, Directions::with_coverage(places, axis, coverage)?, picture)
    }

    fn directions_of(poses: &[Pose]) -> Result<Vec<Vec3>> {
        poses.iter().enumerate().try_for_each(|(n, pose)| pose.check(n))?;
        Ok(poses.iter().map(|pose| pose.place.normalize()).collect())
    }

    fn with_directions(
        poses: Vec<Pose>,
        directions: Directions,
        (side, view_rad, filter): (usize, f64, Filter),
    ) -> Result<Self> {
        if !(1..=MOST_SQUARES).contains(&side) {
            let expected = format!("1 to {MOST_SQUARES} along each side");
            return Err(Error::invalid("the projector's picture", format!("{side} squares"), expected));
        }
        if !(view_rad > 0.0 && view_rad <= WIDEST) {
            let found = format!("{:.3} degrees across", view_rad.to_degrees());
            return Err(Error::invalid("the projector's picture", found, "more than 0 and at most 166 degrees"));
        }
        let picture = Plane::new(side, side)?;
        Ok(Self { poses, directions: Arc::new(directions), side, picture, view_rad, filter })
    }

    /// A projector that always looks at the origin.
    ///
    /// # Errors
    /// As [`Gantry::new`].
    pub fn looking_at_origin(places: &[Vec3], side: usize, view_rad: f64, filter: Filter) -> Result<Self> {
        Self::new(places.iter().copied().map(Pose::at_origin).collect(), side, view_rad, filter)
    }

    /// Where the projector stood.
    pub fn poses(&self) -> &[Pose] {
        &self.poses
    }

    /// Unit vectors from the object to the positions: between them light is reconstructed as between lamps.
    pub fn directions(&self) -> &Arc<Directions> {
        &self.directions
    }

    /// n: squares along each side.
    pub fn side(&self) -> usize {
        self.side
    }

    /// Squares of one position.
    pub fn squares(&self) -> usize {
        self.side * self.side
    }

    /// Them as a grid.
    pub fn picture(&self) -> Plane {
        self.picture
    }

    /// The angle across the picture, radians.
    pub fn view_rad(&self) -> f64 {
        self.view_rad
    }

    /// How squares fall off.
    pub fn filter(&self) -> Filter {
        self.filter
    }

    /// How many elements.
    #[allow(clippy::len_without_is_empty, reason = "never empty")]
    pub fn len(&self) -> usize {
        self.poses.len() * self.squares()
    }

    /// The number of a square.
    pub fn element(&self, position: usize, row: usize, column: usize) -> usize {
        (position * self.side + row) * self.side + column
    }

    /// Position, row and column of an element.
    pub fn place(&self, element: usize) -> (usize, usize, usize) {
        (element / self.squares(), element / self.side % self.side, element % self.side)
    }

    /// Half the width of the picture at distance 1.
    fn reach(&self) -> f64 {
        (0.5 * self.view_rad).tan()
    }

    /// Where in a position's picture a point shows: shares from its left and top edge, 0 to 1 within it. None behind the lens.
    pub fn seen(&self, position: usize, point: &Vec3) -> Option<[f64; 2]> {
        let pose = &self.poses[position];
        let to = point - pose.place;
        let half = to.dot(&pose.axis()) * self.reach();
        (half > 0.0).then(|| [0.5 + 0.5 * to.dot(&pose.right) / half, 0.5 - 0.5 * to.dot(&pose.up) / half])
    }

    /// The point of the focal plane that shows at a share of a position's picture.
    pub fn at(&self, position: usize, [across, down]: [f64; 2]) -> Vec3 {
        let pose = &self.poses[position];
        let distance = -pose.place.dot(&pose.axis());
        let half = distance * self.reach();
        pose.place
            + pose.axis() * distance
            + pose.right * (half * (2.0 * across - 1.0))
            + pose.up * (half * (1.0 - 2.0 * down))
    }

    /// Solid angle of a square, seen from the lens, steradians: squares are equal on a plane, and smaller towards the edges.
    pub fn steradians(&self, row: usize, column: usize) -> f64 {
        let edge = |n: usize| self.reach() * (2.0 * n as f64 / self.side as f64 - 1.0);
        // Of the rectangle between the axis and the corner (x, y), at distance 1.
        let corner = |x: f64, y: f64| (x * y / (1.0 + x * x + y * y).sqrt()).atan();
        let (x0, x1, y0, y1) = (edge(column), edge(column + 1), edge(row), edge(row + 1));
        corner(x1, y1) - corner(x0, y1) - corner(x1, y0) + corner(x0, y0)
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;

    fn gantry() -> Gantry {
        let places = [Vec3::new(0.0, 0.0, 4.0), Vec3::new(0.0, 5.0, 0.0), Vec3::new(3.0, 3.0, 1.0)];
        Gantry::looking_at_origin(&places, 8, 0.6, Filter::Box).unwrap()
    }

    #[test]
    fn elements_are_numbered_as_documented() {
        let gantry = gantry();
        assert_eq!((gantry.len(), gantry.element(1, 2, 3)), (192, 64 + 16 + 3));
        assert!((0..192).all(|e| {
            let (position, row, column) = gantry.place(e);
            gantry.element(position, row, column) == e
        }));
    }

    #[test]
    fn places_return_and_the_right_hand_is_right() {
        let gantry = gantry();
        for position in 0..3 {
            for share in [[0.5, 0.5], [0.1, 0.7], [0.99, 0.01]] {
                let point = gantry.at(position, share);
                let back = gantry.seen(position, &point).unwrap();
                assert!((0..2).all(|n| (back[n] - share[n]).abs() < 1e-12), "{back:?}");
                let pose = &gantry.poses()[position];
                assert!(point.dot(&pose.axis()).abs() < 1e-12, "not on the plane through the origin");
            }
            assert!(gantry.at(position, [0.5, 0.5]).norm() < 1e-12);
        }
        // Beside the camera, right and up are the camera's; from above, up is away from it.
        assert!((gantry.poses()[0].right - Vec3::x()).norm() < 1e-12);
        assert!((gantry.poses()[1].up + Vec3::z()).norm() < 1e-12);
        assert!(gantry.seen(0, &Vec3::new(0.0, 0.0, 5.0)).is_none());
    }

    #[test]
    fn solid_angles_sum_to_that_of_the_picture() {
        let gantry = gantry();
        let sum: f64 = (0..64).map(|n| gantry.steradians(n / 8, n % 8)).sum();
        // A square pyramid of apex angle a: 4 asin(sin^2(a / 2)) of its planes.
        let whole = 4.0 * (0.3f64.sin().powi(2)).asin();
        assert!((sum - whole).abs() < 1e-12, "{sum} is not {whole}");
        let (middle, corner) = (gantry.steradians(3, 3), gantry.steradians(0, 0));
        assert!(corner < 0.9 * middle && corner > 0.7 * middle);
    }

    #[test]
    fn what_is_no_gantry_is_refused() {
        let good = Pose::at_origin(Vec3::new(0.0, 0.0, 4.0));
        let away = Pose { place: -good.place, ..good };
        for (poses, side, view, words) in [
            (vec![], 8, 0.6, "none"),
            (vec![good, away], 8, 0.6, "position 2"),
            (vec![Pose { up: good.right, ..good }], 8, 0.6, "right angle"),
            (vec![Pose { place: Vec3::repeat(f64::NAN), ..good }], 8, 0.6, "position 1"),
            (vec![good], 0, 0.6, "0 squares"),
            (vec![good], 257, 0.6, "257 squares"),
            (vec![good], 8, f64::NAN, "degrees"),
            (vec![good], 8, PI, "degrees"),
        ] {
            let message = Gantry::new(poses, side, view, Filter::Box).unwrap_err().to_string();
            assert!(message.contains(words), "{message}");
        }
    }
}
