//! L2 and Sobolev H1 norms of functions side by side.

/// Squared norms of one function.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Squares {
    /// `v^T v`.
    pub l2: f64,
    /// `(grad v)^T (grad v)`.
    pub gradient: f64,
}

impl Squares {
    /// `||v||_H1^2`.
    pub fn h1(&self) -> f64 {
        self.l2 + self.gradient
    }
}

/// Squared norms of functions `[row][column][lane]`, one for each `channels` lanes: forward differences along both axes,
/// columns all round, the last row without.
pub(super) fn squares(data: &[f32], (columns, rows): (usize, usize), lanes: usize, channels: usize) -> Vec<Squares> {
    let (mut l2, mut gradient) = (vec![0.0f64; lanes], vec![0.0f64; lanes]);
    // Sums of a row in f32, sums of rows in f64.
    let (mut row_l2, mut row_gradient) = (vec![0.0f32; lanes], vec![0.0f32; lanes]);
    let at = |x: usize, y: usize| &data[(y * columns + x) * lanes..][..lanes];
    for y in 0..rows {
        for x in 0..columns {
            let here = at(x, y);
            row_l2.iter_mut().zip(here).for_each(|(sum, v)| *sum += v * v);
            add_differences(&mut row_gradient, here, at((x + 1) % columns, y));
            if y + 1 < rows {
                add_differences(&mut row_gradient, here, at(x, y + 1));
            }
        }
        for (sums, row) in [(&mut l2, &mut row_l2), (&mut gradient, &mut row_gradient)] {
            sums.iter_mut().zip(row.iter()).for_each(|(sum, v)| *sum += f64::from(*v));
            row.fill(0.0);
        }
    }
    let sum = |(l2, gradient): (&[f64], &[f64])| Squares { l2: l2.iter().sum(), gradient: gradient.iter().sum() };
    l2.chunks(channels).zip(gradient.chunks(channels)).map(sum).collect()
}

fn add_differences(sums: &mut [f32], here: &[f32], next: &[f32]) {
    for ((sum, a), b) in sums.iter_mut().zip(here).zip(next) {
        *sum += (a - b) * (a - b);
    }
}

/// Takes a function of `channels` channels away from each of those that lie side by side.
pub(super) fn subtract(data: &mut [f32], lanes: usize, function: &[f32], channels: usize) {
    for (lanes, values) in data.chunks_exact_mut(lanes).zip(function.chunks_exact(channels)) {
        for group in lanes.chunks_exact_mut(channels) {
            group.iter_mut().zip(values).for_each(|(v, t)| *v -= t);
        }
    }
}

/// `sqrt(off / of)`; 0 where nothing is off.
pub(super) fn relative(off: f64, of: f64) -> f64 {
    if off == 0.0 { 0.0 } else { (off / of).sqrt() }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// v = 1, 2, 4, 7 in two equal rows, and the double: differences 1, 2, 3 and -6 round the end, none between rows.
    #[test]
    fn norms_of_a_known_function() {
        let line = [1.0f32, 2.0, 4.0, 7.0];
        let data: Vec<f32> = line.iter().chain(&line).flat_map(|v| [*v, 2.0 * v]).collect();
        let one = Squares { l2: 140.0, gradient: 100.0 };
        let four = Squares { l2: 560.0, gradient: 400.0 };
        assert_eq!(squares(&data, (4, 2), 2, 1), [one, four]);
        assert_eq!(squares(&data, (4, 2), 2, 2), [Squares { l2: 700.0, gradient: 500.0 }]);
        assert_eq!(one.h1(), 240.0);
        // The same numbers as one column of eight rows: 1, 2, 3, 6, 1, 2, 3 between rows, nothing round a single column.
        let column: Vec<f32> = line.iter().chain(&line).copied().collect();
        assert_eq!(squares(&column, (1, 8), 1, 1), [Squares { l2: 140.0, gradient: 64.0 }]);
    }

    #[test]
    fn differences_are_taken_channel_by_channel() {
        let mut data = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0];
        subtract(&mut data, 4, &[1.0, 2.0, 5.0, 5.0], 2);
        assert_eq!(data, [0.0, 0.0, 2.0, 2.0, 0.0, 1.0, 2.0, 3.0]);
        assert_eq!((relative(0.0, 0.0), relative(1.0, 4.0), relative(1.0, 0.0)), (0.0, 0.5, f64::INFINITY));
    }
}
