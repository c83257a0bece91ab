//! The grid of directions that compact fields are rebuilt on.

use std::f64::consts::{PI, TAU};
use std::sync::{Arc, OnceLock};

use super::grid::TOLERANCE_RAD;
use super::{Axis, Coverage, Directions};
use crate::error::{Error, Result};
use crate::math::Vec3;
use crate::wavelet::{Edge, Normalisation, Transform, Wavelet};

/// Fewer columns have no longitudes to speak of, and halve too few times.
const FEWEST_COLUMNS: usize = 8;
/// Fewer rows, likewise.
const FEWEST_ROWS: usize = 4;
/// At the pole of the finest rows this many columns are still 3e-6 apart, so that no two are one site.
const MOST_COLUMNS: usize = 2048;

/// Directions on a regular grid about a set's axis, over its coverage and nothing else: columns are longitudes all round,
/// rows are angles from the axis, from 0 to the coverage's half-angle (180 degrees for the sphere), texel-centred.
///
/// With `W` columns, `H` rows and half-angle `a`, the texel in column i and row j lies at the longitude
/// `-pi + 2 pi (i + 1/2) / W`, right-handed about the axis (from +z towards +x about +y, from +x towards +y about +z), and
/// at the angle `a (j + 1/2) / H` from it. [`super::LatLongGrid::find`] finds the same grid, in the same order.
#[derive(Debug, Clone)]
pub struct StageGrid {
    columns: usize,
    rows: usize,
    axis: Axis,
    coverage: Coverage,
    /// Built when they are asked for: some 50 ms for 256 x 64.
    directions: OnceLock<Arc<Directions>>,
}

impl StageGrid {
    /// The grid over the coverage of a set, of `size` = (columns, rows).
    ///
    /// # Errors
    /// Sides that are odd, too small, or finer than a grid's rings are told apart.
    pub fn new(over: &Directions, size: (usize, usize)) -> Result<Self> {
        let (columns, rows) = size;
        let half_angle_rad = half_angle_rad(over.coverage());
        // A little more than the tolerance, so that rounding cannot merge two rings.
        let most_rows = (half_angle_rad / (1.01 * TOLERANCE_RAD)) as usize;
        let fits = (FEWEST_COLUMNS..=MOST_COLUMNS).contains(&columns) && (FEWEST_ROWS..=most_rows).contains(&rows);
        if !fits || columns % 2 == 1 || rows % 2 == 1 {
            let expected = format!(
                "even numbers, {FEWEST_COLUMNS} to {MOST_COLUMNS} columns and {FEWEST_ROWS} to {} rows over these lamps",
                most_rows - most_rows % 2
            );
            return Err(Error::invalid("grid", format!("{columns} x {rows}"), expected));
        }
        Ok(Self { columns, rows, axis: over.axis(), coverage: over.coverage(), directions: OnceLock::new() })
    }

    /// The transform of functions on the grid: cyclic in longitude, mirrored at both ends of the other axis, in the
    /// constant-energy normalisation.
    ///
    /// # Errors
    /// A wavelet that cannot be mirrored.
    pub fn transform(&self, wavelet: Wavelet) -> Result<Transform> {
        Transform::new(wavelet, self.size(), (Edge::Cyclic, Edge::Mirrored), Normalisation::Energy)
    }

    /// Columns and rows.
    pub fn size(&self) -> (usize, usize) {
        (self.columns, self.rows)
    }

    /// How many texels.
    pub fn texels(&self) -> usize {
        self.columns * self.rows
    }

    /// The angle from the axis to the end of the last row, radians.
    pub fn half_angle_rad(&self) -> f64 {
        half_angle_rad(self.coverage)
    }

    /// The texels' directions, row after row from the axis on, as a set of lamps of the same axis and coverage: light is
    /// projected onto them as onto lamps. Two threads that ask first both build them; the result is the same.
    ///
    /// # Errors
    /// None for a grid that could be made.
    pub fn directions(&self) -> Result<&Arc<Directions>> {
        if let Some(built) = self.directions.get() {
            return Ok(built);
        }
        let (columns, rows, end) = (self.columns, self.rows, self.half_angle_rad());
        let texel = |n: usize| {
            let longitude = -PI + TAU * ((n % columns) as f64 + 0.5) / columns as f64;
            direction(self.axis, longitude, end * ((n / columns) as f64 + 0.5) / rows as f64)
        };
        let texels = (0..self.texels()).map(texel).collect();
        let built = Arc::new(Directions::with_coverage(texels, self.axis, self.coverage)?);
        Ok(self.directions.get_or_init(|| built))
    }
}

fn half_angle_rad(coverage: Coverage) -> f64 {
    match coverage {
        Coverage::Sphere => PI,
        Coverage::Cap { half_angle_rad } => half_angle_rad,
    }
}

fn direction(axis: Axis, longitude_rad: f64, colatitude_rad: f64) -> Vec3 {
    let ((sin, cos), (sl, cl)) = (colatitude_rad.sin_cos(), longitude_rad.sin_cos());
    match axis {
        Axis::Y => Vec3::new(sin * sl, cos, sin * cl),
        Axis::Z => Vec3::new(sin * cl, sin * sl, cos),
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::FRAC_PI_2;

    use super::super::LatLongGrid;
    use super::*;

    fn set(axis: Axis, coverage: Coverage) -> Directions {
        Directions::with_coverage(vec![axis.vector()], axis, coverage).unwrap()
    }

    #[test]
    fn the_grid_is_found_in_its_own_order() {
        for (axis, coverage, end) in [
            (Axis::Y, Coverage::Cap { half_angle_rad: FRAC_PI_2 }, FRAC_PI_2),
            (Axis::Z, Coverage::Cap { half_angle_rad: 0.9 }, 0.9),
            (Axis::Y, Coverage::Cap { half_angle_rad: 2.4 }, 2.4),
            (Axis::Z, Coverage::Sphere, PI),
        ] {
            for (columns, rows) in [(8, 4), (64, 20), (256, 64), (10, 254)] {
                let grid = StageGrid::new(&set(axis, coverage), (columns, rows)).unwrap();
                let domain = grid.directions().unwrap();
                assert_eq!((domain.axis(), domain.coverage()), (axis, coverage));
                assert_eq!((domain.sites().len(), grid.texels()), (columns * rows, columns * rows));
                let found = LatLongGrid::find(domain).unwrap();
                assert_eq!((found.longitudes(), found.rings()), (columns, rows), "{axis:?}, {coverage:?}");
                assert!(found.sites().iter().zip(0..).all(|(site, n)| *site == n), "{axis:?}, {coverage:?}");
                // Texel centres; the rim is half a row beyond the last.
                let rim = direction(axis, 0.3, end);
                assert!((found.coordinates(&rim).1 - (rows as f64 - 0.5)).abs() < 1e-6);
                assert!(domain.lamps().iter().all(|d| domain.covers(d)));
            }
        }
    }

    /// The thesis's 256 x 64 over a hemisphere (5.4) about +y: rows from overhead to the horizon, columns from -z (behind
    /// the object) over -x round to +z.
    #[test]
    fn the_first_texels_lie_where_they_are_said_to() {
        let dome = set(Axis::Y, Coverage::Cap { half_angle_rad: FRAC_PI_2 });
        let grid = StageGrid::new(&dome, (256, 64)).unwrap();
        let texel = |column: usize, row: usize| grid.directions().unwrap().lamps()[row * 256 + column];
        assert!(texel(0, 0).y > 0.9999 && texel(0, 63).y < 0.013 && texel(0, 63).y > 0.0);
        let step = TAU / 256.0;
        for (column, towards) in [(0, -Vec3::z()), (64, -Vec3::x()), (128, Vec3::z()), (192, Vec3::x())] {
            let off = crate::math::angle_between(&texel(column, 63), &towards);
            assert!(off < step, "column {column} is {off} from {towards}");
        }
    }

    #[test]
    fn sizes_that_will_not_do_are_refused() {
        let dome = set(Axis::Y, Coverage::Cap { half_angle_rad: FRAC_PI_2 });
        for size in [(6, 4), (8, 2), (9, 4), (8, 5), (0, 0), (4096, 64), (64, 450), (usize::MAX, usize::MAX)] {
            let message = StageGrid::new(&dome, size).unwrap_err().to_string();
            assert!(message.contains("8 to 2048 columns and 4 to 444 rows"), "{message}");
        }
        // A narrow cap has room for few rings.
        let narrow = set(Axis::Z, Coverage::Cap { half_angle_rad: 0.05 });
        assert!(StageGrid::new(&narrow, (64, 16)).is_err() && StageGrid::new(&narrow, (64, 14)).is_ok());
    }
}
