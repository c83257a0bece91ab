//! Multi-level B-spline approximation of scattered data on the unit square (Lee, Wolberg, Shin 1997), and its adjoint.
//!
//! A level of m x m cells has (m + 3)^2 control points of uniform bicubic B-splines. One step (their eq. 5) gives each
//! control point `sum_c w_c^2 phi_c / sum_c w_c^2` with `phi_c = w_c z_c / sum w^2`, c over the data whose support it is in:
//! linear in the data z. The next level of twice as many cells fits what is left, and the levels add up on the finest
//! lattice by exact refinement. Every step is linear, so the whole has a transpose: the same steps backwards (the adjoint
//! that 4.4.2 calls far from obvious).

/// Cells a side of the first level.
const FIRST_CELLS: usize = 2;
/// Levels, from 2 x 2 to 64 x 64 cells (4.3.6).
const LEVELS: u32 = 6;
/// Cells a side of the last level.
pub(super) const CELLS: usize = FIRST_CELLS << (LEVELS - 1);
/// Control points a side of the last level.
const SIDE: usize = CELLS + 3;
/// Control points of the last level.
pub(super) const CONTROLS: usize = SIDE * SIDE;

/// Several functions side by side: as many as fill a cache line.
pub(super) type Lanes = [f32; LANES];
/// How many functions are fitted side by side.
pub(super) const LANES: usize = 16;

/// What a lattice is fitted to: the samples of one function, or of [`LANES`] of them.
pub(super) trait Datum: Copy + Default {
    /// `self += weight x other`.
    fn add(&mut self, weight: f64, other: &Self);
}

impl Datum for f64 {
    fn add(&mut self, weight: f64, other: &Self) {
        *self += weight * other;
    }
}

impl Datum for Lanes {
    fn add(&mut self, weight: f64, other: &Self) {
        let weight = weight as f32;
        self.iter_mut().zip(other).for_each(|(sum, lane)| *sum += weight * lane);
    }
}

/// Values of the four cubic B-splines over a cell at `s` in 0 to 1.
fn cubic(s: f64) -> [f64; 4] {
    let r = 1.0 - s;
    [
        r * r * r / 6.0,
        (3.0 * s * s * s - 6.0 * s * s + 4.0) / 6.0,
        (3.0 * r * r * r - 6.0 * r * r + 4.0) / 6.0,
        s * s * s / 6.0,
    ]
}

/// The 16 control points that a place in the unit square depends on, with their values there.
fn support(place: [f64; 2], cells: usize) -> [(u32, f64); 16] {
    let split = |x: f64| {
        let x = x.clamp(0.0, 1.0) * cells as f64;
        let cell = (x as usize).min(cells - 1);
        (cell, cubic(x - cell as f64))
    };
    let ((i, u), (j, v)) = (split(place[0]), split(place[1]));
    std::array::from_fn(|k| (((j + k / 4) * (cells + 3) + i + k % 4) as u32, v[k / 4] * u[k % 4]))
}

/// The control points of the last level at a place in the unit square.
pub(super) fn finest(place: [f64; 2]) -> [(u32, f64); 16] {
    support(place, CELLS)
}

/// One level: its control points, and the data in their support.
#[derive(Debug)]
struct Level {
    cells: usize,
    data: Vec<[(u32, f64); 16]>,
    /// For each control point `1 / sum_c w_c^2`, or 0 where no data is.
    inverse: Vec<f64>,
}

impl Level {
    fn new(places: &[[f64; 2]], cells: usize) -> Self {
        let data: Vec<[(u32, f64); 16]> = places.iter().map(|place| support(*place, cells)).collect();
        let mut sums = vec![0.0; (cells + 3) * (cells + 3)];
        data.iter().flatten().for_each(|(n, w)| sums[*n as usize] += w * w);
        let inverse = sums.iter().map(|sum| if *sum > 0.0 { 1.0 / sum } else { 0.0 }).collect();
        Self { cells, data, inverse }
    }

    fn controls(&self) -> usize {
        self.inverse.len()
    }

    /// One step of the approximation: control points from data.
    fn fit<T: Datum>(&self, data: &[T]) -> Vec<T> {
        let mut controls = vec![T::default(); self.controls()];
        for (support, z) in self.data.iter().zip(data) {
            let share = 1.0 / squares(support);
            support.iter().for_each(|&(n, w)| {
                controls[n as usize].add(w * w * w * share * self.inverse[n as usize], z);
            });
        }
        controls
    }

    /// Takes the spline's values away from the data.
    fn subtract<T: Datum>(&self, controls: &[T], data: &mut [T]) {
        for (support, z) in self.data.iter().zip(data) {
            support.iter().for_each(|&(n, w)| z.add(-w, &controls[n as usize]));
        }
    }

    fn fit_transposed(&self, controls: &[f64]) -> Vec<f64> {
        let datum = |support: &[(u32, f64); 16]| {
            let sum: f64 =
                support.iter().map(|&(n, w)| w * w * w * controls[n as usize] * self.inverse[n as usize]).sum();
            sum / squares(support)
        };
        self.data.iter().map(datum).collect()
    }

    fn values_transposed(&self, data: &[f64]) -> Vec<f64> {
        let mut controls = vec![0.0; self.controls()];
        for (support, z) in self.data.iter().zip(data) {
            support.iter().for_each(|&(n, w)| controls[n as usize] += w * z);
        }
        controls
    }
}

fn squares(support: &[(u32, f64); 16]) -> f64 {
    support.iter().map(|(_, w)| w * w).sum()
}

/// The levels over some data.
#[derive(Debug)]
pub(super) struct Lattices {
    levels: Vec<Level>,
}

impl Lattices {
    /// Places lie in the unit square.
    pub fn new(places: &[[f64; 2]]) -> Self {
        Self { levels: (0..LEVELS).map(|n| Level::new(places, FIRST_CELLS << n)).collect() }
    }

    /// Control points of the last level from data.
    pub fn fit<T: Datum>(&self, data: &[T]) -> Vec<T> {
        let mut left = data.to_vec();
        let mut sum: Vec<T> = Vec::new();
        for level in &self.levels {
            let mut controls = level.fit(&left);
            // What is left after the last level is nobody's.
            if level.cells < CELLS {
                level.subtract(&controls, &mut left);
            }
            if level.cells > FIRST_CELLS {
                add_refined(&sum, level.cells / 2, &mut controls);
            }
            sum = controls;
        }
        sum
    }

    /// Multiplications that [`Lattices::fit`] takes, about.
    pub fn cost(&self) -> usize {
        // Into the control points and back out of them; then a refinement of some 6 old points a new one.
        self.levels.iter().map(|level| 2 * 16 * level.data.len() + 6 * level.controls()).sum()
    }

    /// The transpose of [`Lattices::fit`].
    pub fn fit_transposed(&self, controls: &[f64]) -> Vec<f64> {
        // What each level's sum of control points is worth, last level first.
        let mut worth = controls.to_vec();
        let mut left: Vec<f64> = Vec::new();
        for level in self.levels.iter().rev() {
            // z_next = z - E c, so dc = worth - E^T dz_next and dz = dz_next + A^T dc.
            let own = if left.is_empty() {
                worth.clone()
            } else {
                let met = level.values_transposed(&left);
                worth.iter().zip(met).map(|(w, m)| w - m).collect()
            };
            let data = level.fit_transposed(&own);
            left = if left.is_empty() { data } else { added(left, &data) };
            if level.cells > FIRST_CELLS {
                worth = refined_transposed(&worth, level.cells / 2);
            }
        }
        left
    }
}

fn added(mut a: Vec<f64>, b: &[f64]) -> Vec<f64> {
    a.iter_mut().zip(b).for_each(|(a, b)| *a += b);
    a
}

/// Which old control points a new one is made of when cells are halved, in one dimension (their eq. 13). Old ones are
/// numbered from -1, kept at place 0; so are new ones.
fn halves(new: usize) -> [(usize, f64); 3] {
    // New number k = new - 1; even ones lie on an old point, odd ones between two.
    if new % 2 == 1 {
        let middle = new.div_ceil(2);
        [(middle - 1, 0.125), (middle, 0.75), (middle + 1, 0.125)]
    } else {
        [(new / 2, 0.5), (new / 2 + 1, 0.5), (new / 2, 0.0)]
    }
}

/// Adds the same spline on a lattice of twice as many cells to control points there.
fn add_refined<T: Datum>(controls: &[T], cells: usize, sums: &mut [T]) {
    let (old, new) = (cells + 3, 2 * cells + 3);
    for (k, sum) in sums.iter_mut().enumerate() {
        for (row, across) in halves(k / new) {
            for (column, along) in halves(k % new).into_iter().filter(|(_, along)| across * along != 0.0) {
                sum.add(across * along, &controls[row * old + column]);
            }
        }
    }
}

fn refined_transposed(controls: &[f64], cells: usize) -> Vec<f64> {
    let (old, new) = (cells + 3, 2 * cells + 3);
    let mut sums = vec![0.0; old * old];
    for (k, value) in controls.iter().enumerate() {
        for (row, across) in halves(k / new) {
            for (column, along) in halves(k % new) {
                sums[row * old + column] += across * along * value;
            }
        }
    }
    sums
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};

    use super::*;

    fn places(n: usize) -> Vec<[f64; 2]> {
        let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(3);
        (0..n).map(|_| [rng.random(), rng.random()]).collect()
    }

    #[test]
    fn refining_leaves_the_spline_as_it_is() {
        let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(1);
        let controls: Vec<f64> = (0..7 * 7).map(|_| rng.random_range(-1.0..1.0)).collect();
        let mut finer = vec![0.0; 11 * 11];
        add_refined(&controls, 4, &mut finer);
        let value = |controls: &[f64], cells: usize, place: [f64; 2]| -> f64 {
            support(place, cells).iter().map(|(n, w)| w * controls[*n as usize]).sum()
        };
        for place in places(200).into_iter().chain([[0.0, 0.0], [1.0, 1.0], [0.0, 1.0]]) {
            let (a, b) = (value(&controls, 4, place), value(&finer, 8, place));
            assert!((a - b).abs() < 1e-12, "{a} became {b} at {place:?}");
        }
    }

    #[test]
    fn the_transpose_is_the_transpose() {
        let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(2);
        let lattices = Lattices::new(&places(150));
        let data: Vec<f64> = (0..150).map(|_| rng.random_range(-1.0..1.0)).collect();
        let controls: Vec<f64> = (0..CONTROLS).map(|_| rng.random_range(-1.0..1.0)).collect();
        let left: f64 = lattices.fit(&data).iter().zip(&controls).map(|(a, b)| a * b).sum();
        let right: f64 = data.iter().zip(lattices.fit_transposed(&controls)).map(|(a, b)| a * b).sum();
        assert!((left - right).abs() < 1e-10 * left.abs().max(1.0), "{left} is not {right}");
    }

    #[test]
    fn lanes_are_fitted_as_one_function_alone() {
        let places = places(90);
        let lattices = Lattices::new(&places);
        let datum = |p: &[f64; 2], lane: usize| (3.0 * p[0] + lane as f64).sin() + p[1];
        let data: Vec<Lanes> = places.iter().map(|p| std::array::from_fn(|lane| datum(p, lane) as f32)).collect();
        let together = lattices.fit(&data);
        for lane in [0, 7, LANES - 1] {
            let data: Vec<f64> = places.iter().map(|p| datum(p, lane)).collect();
            for (alone, lanes) in lattices.fit(&data).iter().zip(&together) {
                assert!((alone - f64::from(lanes[lane])).abs() < 1e-5, "{alone}, not {}", lanes[lane]);
            }
        }
    }

    /// Levels meet the data ever better; sparse data are met to rounding once each has its own control points.
    #[test]
    fn scattered_data_are_met() {
        let places = places(40);
        let data: Vec<f64> = places.iter().map(|p| (5.0 * p[0]).sin() + p[1] * p[1]).collect();
        let controls = Lattices::new(&places).fit(&data);
        for (place, datum) in places.iter().zip(&data) {
            let value: f64 = finest(*place).iter().map(|(n, w)| w * controls[*n as usize]).sum();
            assert!((value - datum).abs() < 0.02, "{value} is not {datum}");
        }
    }
}
