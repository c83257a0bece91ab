//! Spheres, boxes, discs and bowls: the nearest hit of one ray, and shadows of many directions from one point.

use nalgebra::Matrix3;

use super::V3;

/// Hits nearer than this do not count: the rounding of f32 at the size of our scenes (a few units), with room.
pub(super) const EPSILON: f32 = 2e-4;

/// Half a line.
#[derive(Debug, Clone, Copy)]
pub(super) struct Ray {
    /// Where it starts.
    pub origin: V3,
    /// Unit direction.
    pub direction: V3,
}

impl Ray {
    /// The point at a distance.
    pub fn at(&self, t: f32) -> V3 {
        self.origin + self.direction * t
    }
}

/// Many unit directions, component by component, so that loops over them vectorise.
#[derive(Debug, Clone, Default)]
pub(super) struct Bundle {
    pub x: Vec<f32>,
    pub y: Vec<f32>,
    pub z: Vec<f32>,
}

impl Bundle {
    /// A part of the directions.
    pub fn slice(&self, range: std::ops::Range<usize>) -> Slices<'_> {
        Slices { x: &self.x[range.clone()], y: &self.y[range.clone()], z: &self.z[range] }
    }

    /// Appends a direction.
    pub fn push(&mut self, d: V3) {
        self.x.push(d.x);
        self.y.push(d.y);
        self.z.push(d.z);
    }
}

/// Part of a [`Bundle`]; the three slices have one length.
#[derive(Debug, Clone, Copy)]
pub(super) struct Slices<'a> {
    pub x: &'a [f32],
    pub y: &'a [f32],
    pub z: &'a [f32],
}

/// A convex body, a finite piece of ground, or a bowl.
#[derive(Debug, Clone, PartialEq)]
pub enum Shape {
    /// A ball.
    Sphere {
        /// Its middle.
        centre: V3,
        /// Its radius.
        radius: f32,
    },
    /// A box, `axes` its orthonormal directions as columns.
    Block {
        /// Its middle.
        centre: V3,
        /// Half its extent along each of its axes.
        half: V3,
        /// Orthonormal, columns are the box's own x, y and z in the stage frame.
        axes: Matrix3<f32>,
    },
    /// A flat round piece of ground, seen from both sides.
    Disc {
        /// Its middle.
        centre: V3,
        /// Unit normal.
        normal: V3,
        /// Its radius.
        radius: f32,
    },
    /// A part of a hollow ball, a thin shell that is seen from both sides: what lies below a plane across it.
    Bowl {
        /// The middle of the ball.
        centre: V3,
        /// The ball's radius.
        radius: f32,
        /// Unit vector out of the opening.
        axis: V3,
        /// Of the rim above the middle, along the axis: 0 for half a ball.
        rim: f32,
    },
}

impl Shape {
    /// A box turned by `turn_rad` about `up`, standing with its own y along `up` (unit, not parallel to +z).
    pub fn block(centre: V3, half: V3, up: V3, turn_rad: f32) -> Self {
        let side = up.cross(&V3::z()).normalize();
        let turned = nalgebra::Rotation3::from_axis_angle(&nalgebra::Unit::new_unchecked(up), turn_rad) * side;
        Self::Block { centre, half, axes: Matrix3::from_columns(&[turned, up, turned.cross(&up)]) }
    }

    /// The nearest hit beyond [`EPSILON`], from outside or inside.
    pub(super) fn hit(&self, ray: &Ray) -> Option<f32> {
        match self {
            Self::Sphere { centre, radius } => hit_sphere(ray, centre, *radius),
            Self::Block { centre, half, axes } => hit_block(ray, centre, half, axes),
            Self::Disc { centre, normal, radius } => {
                let t = (centre - ray.origin).dot(normal) / ray.direction.dot(normal);
                (t > EPSILON && (ray.at(t) - centre).norm_squared() < radius * radius).then_some(t)
            }
            Self::Bowl { centre, radius, axis, rim } => hit_bowl(ray, centre, *radius, axis, *rim),
        }
    }

    /// The outward unit normal at a point of the surface.
    pub(super) fn normal(&self, point: &V3) -> V3 {
        match self {
            Self::Sphere { centre, .. } | Self::Bowl { centre, .. } => (point - centre).normalize(),
            Self::Block { centre, half, axes } => {
                let own = axes.tr_mul(&(point - centre));
                let axis = own.component_div(half).iamax();
                axes.column(axis) * own[axis].signum()
            }
            Self::Disc { normal, .. } => *normal,
        }
    }

    /// A ball that holds the shape.
    pub(super) fn bounds(&self) -> (V3, f32) {
        match self {
            Self::Sphere { centre, radius } | Self::Disc { centre, radius, .. } | Self::Bowl { centre, radius, .. } => {
                (*centre, *radius)
            }
            Self::Block { centre, half, .. } => (*centre, half.norm()),
        }
    }

    /// How far the shape reaches from the origin along a unit direction.
    pub(super) fn reach(&self, direction: &V3) -> f32 {
        match self {
            Self::Sphere { centre, radius } => centre.dot(direction) + radius,
            Self::Block { centre, half, axes } => centre.dot(direction) + axes.tr_mul(direction).abs().dot(half),
            Self::Disc { centre, normal, radius } => {
                centre.dot(direction) + radius * (1.0 - normal.dot(direction).powi(2)).max(0.0).sqrt()
            }
            Self::Bowl { centre, radius, axis, rim } => {
                let along = axis.dot(direction);
                // The top of the ball, or the highest point of the rim where that is cut away.
                if along * radius < *rim {
                    return centre.dot(direction) + radius;
                }
                let across = (1.0 - along * along).max(0.0).sqrt();
                centre.dot(direction) + rim * along + (radius * radius - rim * rim).max(0.0).sqrt() * across
            }
        }
    }

    /// Can it shade or light itself?
    pub(super) fn is_concave(&self) -> bool {
        matches!(self, Self::Bowl { .. })
    }

    /// Darkens (sets to 0) the directions that this shape blocks for a point outside of it or on its surface; a convex
    /// shape never shades its own surface, so the caller leaves out the shape that the point lies on.
    pub(super) fn shade(&self, origin: &V3, directions: Slices<'_>, visible: &mut [f32]) {
        match self {
            Self::Sphere { centre, radius } => shade_sphere(&(origin - centre), *radius, directions, visible),
            Self::Block { centre, half, axes } => {
                shade_block(&axes.tr_mul(&(origin - centre)), half, axes, directions, visible);
            }
            Self::Disc { centre, normal, radius } => {
                shade_disc(&(origin - centre), normal, *radius, directions, visible);
            }
            Self::Bowl { centre, radius, axis, rim } => {
                shade_bowl(&(origin - centre), *radius, (axis, *rim), directions, visible);
            }
        }
    }
}

fn hit_sphere(ray: &Ray, centre: &V3, radius: f32) -> Option<f32> {
    let to = centre - ray.origin;
    let along = to.dot(&ray.direction);
    // The distance of the line from the middle, taken from the foot point: exact also far from a small ball.
    let room = radius * radius - (to - ray.direction * along).norm_squared();
    if room < 0.0 {
        return None;
    }
    let half = room.sqrt();
    let t = if along - half > EPSILON { along - half } else { along + half };
    (t > EPSILON).then_some(t)
}

fn hit_bowl(ray: &Ray, centre: &V3, radius: f32, axis: &V3, rim: f32) -> Option<f32> {
    let to = centre - ray.origin;
    let along = to.dot(&ray.direction);
    let room = radius * radius - (to - ray.direction * along).norm_squared();
    if room < 0.0 {
        return None;
    }
    let half = room.sqrt();
    [along - half, along + half].into_iter().find(|t| *t > EPSILON && (ray.at(*t) - centre).dot(axis) < rim)
}

fn hit_block(ray: &Ray, centre: &V3, half: &V3, axes: &Matrix3<f32>) -> Option<f32> {
    let (o, d) = (axes.tr_mul(&(ray.origin - centre)), axes.tr_mul(&ray.direction));
    let (mut near, mut far) = (f32::NEG_INFINITY, f32::INFINITY);
    for a in 0..3 {
        let (t0, t1) = ((-half[a] - o[a]) / d[a], (half[a] - o[a]) / d[a]);
        near = near.max(t0.min(t1));
        far = far.min(t0.max(t1));
    }
    let t = if near > EPSILON { near } else { far };
    (near <= far && t > EPSILON).then_some(t)
}

fn shade_sphere(from: &V3, radius: f32, directions: Slices<'_>, visible: &mut [f32]) {
    let n = visible.len();
    let (x, y, z) = (&directions.x[..n], &directions.y[..n], &directions.z[..n]);
    let room = from.norm_squared() - radius * radius;
    for j in 0..n {
        let along = from.x * x[j] + from.y * y[j] + from.z * z[j];
        let blocked = (along < 0.0) & (along * along > room);
        visible[j] = if blocked { 0.0 } else { visible[j] };
    }
}

fn shade_block(from: &V3, half: &V3, axes: &Matrix3<f32>, directions: Slices<'_>, visible: &mut [f32]) {
    let n = visible.len();
    let (x, y, z) = (&directions.x[..n], &directions.y[..n], &directions.z[..n]);
    for j in 0..n {
        let (mut near, mut far) = (EPSILON, f32::MAX);
        for a in 0..3 {
            let step = 1.0 / (axes[(0, a)] * x[j] + axes[(1, a)] * y[j] + axes[(2, a)] * z[j]);
            let (t0, t1) = ((-half[a] - from[a]) * step, (half[a] - from[a]) * step);
            near = near.max(t0.min(t1));
            far = far.min(t0.max(t1));
        }
        visible[j] = if near < far { 0.0 } else { visible[j] };
    }
}

fn shade_disc(from: &V3, normal: &V3, radius: f32, directions: Slices<'_>, visible: &mut [f32]) {
    let n = visible.len();
    let (x, y, z) = (&directions.x[..n], &directions.y[..n], &directions.z[..n]);
    let height = from.dot(normal);
    for j in 0..n {
        let t = -height / (normal.x * x[j] + normal.y * y[j] + normal.z * z[j]);
        let (px, py, pz) = (from.x + t * x[j], from.y + t * y[j], from.z + t * z[j]);
        let blocked = (t > EPSILON) & (px * px + py * py + pz * pz < radius * radius);
        visible[j] = if blocked { 0.0 } else { visible[j] };
    }
}

/// `from` may lie on the bowl itself.
fn shade_bowl(from: &V3, radius: f32, (axis, rim): (&V3, f32), directions: Slices<'_>, visible: &mut [f32]) {
    let n = visible.len();
    let (x, y, z) = (&directions.x[..n], &directions.y[..n], &directions.z[..n]);
    let (outside, height) = (from.norm_squared() - radius * radius, from.dot(axis));
    for j in 0..n {
        let along = from.x * x[j] + from.y * y[j] + from.z * z[j];
        let rises = axis.x * x[j] + axis.y * y[j] + axis.z * z[j];
        let room = along * along - outside;
        let half = room.max(0.0).sqrt();
        let (near, far) = (-along - half, -along + half);
        let first = (near > EPSILON) & (height + near * rises < rim);
        let second = (far > EPSILON) & (height + far * rises < rim);
        let blocked = (room > 0.0) & (first | second);
        visible[j] = if blocked { 0.0 } else { visible[j] };
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg32;

    use super::*;
    use crate::simulate::sampling;

    fn shapes() -> [Shape; 4] {
        [
            Shape::Sphere { centre: V3::new(0.2, -0.1, 0.3), radius: 0.5 },
            Shape::block(V3::new(-0.2, 0.1, 0.0), V3::new(0.3, 0.5, 0.2), V3::new(0.0, 0.6, 0.8), 0.7),
            Shape::Disc { centre: V3::new(0.0, -0.2, 0.1), normal: V3::new(0.36, 0.48, 0.8), radius: 0.7 },
            Shape::Bowl { centre: V3::new(0.1, 0.1, -0.1), radius: 0.6, axis: V3::new(0.36, 0.48, 0.8), rim: 0.15 },
        ]
    }

    /// Signed "how far outside", from the definition of the shapes.
    fn outside(shape: &Shape, p: &V3) -> f32 {
        match shape {
            Shape::Sphere { centre, radius } | Shape::Bowl { centre, radius, .. } => (p - centre).norm() - radius,
            Shape::Block { centre, half, axes } => {
                let own = axes.tr_mul(&(p - centre));
                (0..3).map(|a| own[a].abs() - half[a]).fold(f32::MIN, f32::max)
            }
            Shape::Disc { centre, normal, .. } => (p - centre).dot(normal),
        }
    }

    fn random_direction(rng: &mut Pcg32) -> V3 {
        sampling::cone(&V3::z(), 2.0, rng.random())
    }

    #[test]
    fn hits_agree_with_marching_along_the_ray() {
        let mut rng = Pcg32::seed_from_u64(5);
        for shape in shapes() {
            let mut hits = 0;
            for _ in 0..400 {
                let origin = random_direction(&mut rng) * 2.0;
                let ray = Ray { origin, direction: (random_direction(&mut rng) * 0.6 - origin).normalize() };
                let sign = outside(&shape, &ray.origin).signum();
                let crosses = |t: f32| match &shape {
                    // The shell from either side, where it has not been cut away.
                    Shape::Bowl { centre, axis, rim, .. } => {
                        let side = |t: f32| outside(&shape, &ray.at(t)) < 0.0;
                        side(t) != side(t - 1e-3) && (ray.at(t) - centre).dot(axis) < *rim
                    }
                    _ => outside(&shape, &ray.at(t)) * sign < 0.0,
                };
                let crossing = (1..4000).map(|k| k as f32 * 1e-3).find(|t| crosses(*t));
                let inside_rim = |t: &f32| match &shape {
                    Shape::Disc { centre, radius, .. } => (ray.at(*t) - centre).norm() < *radius,
                    _ => true,
                };
                match (shape.hit(&ray), crossing.filter(inside_rim)) {
                    (Some(t), Some(marched)) => {
                        hits += 1;
                        assert!((t - marched).abs() < 2e-3, "{t} is not {marched}");
                        // Outward: a step along the normal leaves.
                        let step = ray.at(t) + shape.normal(&ray.at(t)) * 1e-2;
                        assert!(outside(&shape, &step) > 5e-3);
                    }
                    (None, None) => {}
                    // Grazing hits may fall between two steps or on the rim.
                    (Some(t), None) => assert!(outside(&shape, &ray.at(t + 1e-3)).abs() < 0.03),
                    (None, Some(t)) => assert!(outside(&shape, &ray.at(t)).abs() < 0.03),
                }
            }
            assert!(hits > 100, "only {hits} hits");
        }
    }

    #[test]
    fn shadows_of_many_directions_are_hits_of_single_rays() {
        let mut rng = Pcg32::seed_from_u64(6);
        let mut bundle = Bundle::default();
        (0..500).for_each(|_| bundle.push(random_direction(&mut rng)));
        for shape in shapes() {
            let mut blocked = 0;
            for _ in 0..20 {
                let origin = random_direction(&mut rng) * 1.2;
                let mut visible = vec![1.0; 500];
                shape.shade(&origin, bundle.slice(0..500), &mut visible);
                for (j, v) in visible.iter().enumerate() {
                    let direction = V3::new(bundle.x[j], bundle.y[j], bundle.z[j]);
                    let hit = shape.hit(&Ray { origin, direction }).is_some();
                    // Rounding decides rays that graze a rim: give them 1e-4.
                    if (*v == 0.0) != hit {
                        let near = |e: f32| {
                            let d = (direction + random_direction(&mut Pcg32::seed_from_u64(j as u64)) * e).normalize();
                            shape.hit(&Ray { origin, direction: d }).is_some()
                        };
                        assert!(near(1e-3) != near(-1e-3), "direction {j}");
                    }
                    blocked += usize::from(hit);
                }
            }
            assert!(blocked > 100, "only {blocked} blocked");
        }
    }

    /// From a point of a bowl: what lies before it in the bowl, or the sky through the opening.
    #[test]
    fn a_bowl_sees_itself() {
        let (axis, rim) = (V3::new(0.0, 0.6, 0.8), 0.1);
        let bowl = Shape::Bowl { centre: V3::zeros(), radius: 0.5, axis, rim };
        let mut rng = Pcg32::seed_from_u64(8);
        let mut bundle = Bundle::default();
        (0..400).for_each(|_| bundle.push(random_direction(&mut rng)));
        let (mut seen, mut open) = (0, 0);
        for _ in 0..30 {
            let point = random_direction(&mut rng) * 0.5;
            if point.dot(&axis) > rim {
                continue;
            }
            let mut visible = vec![1.0; 400];
            bowl.shade(&point, bundle.slice(0..400), &mut visible);
            for (j, v) in visible.iter().enumerate() {
                let direction = V3::new(bundle.x[j], bundle.y[j], bundle.z[j]);
                // The other end of the chord; outwards there is none.
                let chord = -2.0 * point.dot(&direction);
                let end = (point + direction * chord).dot(&axis);
                if chord.abs() < 0.02 || (end - rim).abs() < 1e-3 {
                    continue;
                }
                let blocked = chord > 0.0 && end < rim;
                assert_eq!(*v == 0.0, blocked, "chord {chord}, {end}");
                let hit = bowl.hit(&Ray { origin: point, direction });
                assert!(hit.is_some() == blocked && hit.is_none_or(|t| (t - chord).abs() < 1e-4));
                seen += usize::from(blocked);
                open += usize::from(chord > 0.0 && !blocked);
            }
        }
        assert!(seen > 500 && open > 500, "{seen}, {open}");
        for direction in [axis, -axis, V3::x(), V3::new(0.8, 0.36, 0.48)] {
            let points = (0..20_000).map(|_| random_direction(&mut rng) * 0.5).filter(|p| p.dot(&axis) < rim);
            let farthest = points.map(|p| p.dot(&direction)).fold(f32::MIN, f32::max);
            assert!((bowl.reach(&direction) - farthest).abs() < 0.01, "{direction}: {farthest}");
        }
    }

    #[test]
    fn rays_inside_glass_find_the_far_side() {
        for shape in &shapes()[..2] {
            let (centre, _) = shape.bounds();
            let ray = Ray { origin: centre, direction: V3::new(0.6, 0.0, 0.8) };
            let t = shape.hit(&ray).expect("a closed body");
            assert!(outside(shape, &ray.at(t)).abs() < 1e-5);
            assert!(shape.normal(&ray.at(t)).dot(&ray.direction) > 0.0);
        }
    }
}
