//! The largest terms of a pixel, by count and by error.

/// Exponent and four bits of a number: numbers of a bucket differ by a sixteenth at most.
const BUCKET_SHIFT: u32 = 19;
/// Up to the bucket of infinity.
const BUCKETS: usize = (f32::INFINITY.to_bits() >> BUCKET_SHIFT) as usize + 1;

/// Room to choose in.
#[derive(Debug)]
pub struct Selection {
    /// How many squares a bucket has, and their sum.
    buckets: Vec<(u32, f64)>,
    /// What lies in the bucket where the choice ends.
    border: Vec<(f32, u32)>,
}

impl Default for Selection {
    fn default() -> Self {
        Self { buckets: vec![(0, 0.0); BUCKETS], border: Vec::new() }
    }
}

fn bucket(square: f32) -> usize {
    (square.to_bits() >> BUCKET_SHIFT) as usize
}

impl Selection {
    /// Chooses the largest of some squares, ties by location, until at most `budget` is left of their sum or `most` are
    /// chosen; locations ascend. Returns what is left. Squares are finite and not negative; those below 2^-126 are nothing.
    /// One pass to sort into buckets, one to collect: no sorting but of the last bucket.
    pub fn choose(&mut self, squares: &[f32], most: usize, budget: f64, chosen: &mut Vec<u32>) -> f64 {
        chosen.clear();
        self.buckets.fill((0, 0.0));
        for &square in squares {
            let bucket = &mut self.buckets[bucket(square)];
            bucket.0 += 1;
            bucket.1 += f64::from(square);
        }
        self.buckets[0] = (0, 0.0);
        let Some((last, below)) = self.last_bucket(most, budget) else {
            return self.buckets.iter().map(|bucket| bucket.1).sum();
        };
        self.border.clear();
        for (&square, location) in squares.iter().zip(0u32..) {
            match bucket(square) {
                b if b > last => chosen.push(location),
                b if b == last => self.border.push((square, location)),
                _ => {}
            }
        }
        self.border.sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        let mut left = self.border.iter().rev().map(|term| f64::from(term.0)).sum::<f64>();
        for &(square, location) in &self.border {
            if chosen.len() >= most || below + left <= budget {
                break;
            }
            chosen.push(location);
            left -= f64::from(square);
        }
        chosen.sort_unstable();
        below + left.max(0.0)
    }

    /// The bucket where the choice ends, and the sum of those below it; `None` where nothing is chosen.
    fn last_bucket(&self, most: usize, budget: f64) -> Option<(usize, f64)> {
        let mut below = 0.0;
        let by_error = self.buckets.iter().position(|bucket| {
            let over = below + bucket.1 > budget;
            below += if over { 0.0 } else { bucket.1 };
            over
        })?;
        let mut count = 0;
        let by_count = self.buckets.iter().rposition(|bucket| {
            count += bucket.0 as usize;
            count > most
        });
        Some(match by_count {
            Some(by_count) if by_count > by_error => {
                (by_count, self.buckets[..by_count].iter().map(|bucket| bucket.1).sum())
            }
            _ => (by_error, below),
        })
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};

    use super::*;

    /// Sorting all of them.
    fn plainly(squares: &[f32], most: usize, budget: f64) -> Vec<u32> {
        let mut all: Vec<u32> = (0..squares.len() as u32).filter(|&n| squares[n as usize] > 0.0).collect();
        all.sort_by(|&a, &b| squares[b as usize].total_cmp(&squares[a as usize]).then(a.cmp(&b)));
        let left = |from: usize| all[from..].iter().rev().map(|&n| f64::from(squares[n as usize])).sum::<f64>();
        let count = (0..=all.len()).find(|&n| left(n) <= budget).unwrap_or(all.len()).min(most);
        all.truncate(count);
        all.sort_unstable();
        all
    }

    #[test]
    fn the_choice_is_that_of_sorting() {
        let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(1);
        let (mut selection, mut chosen) = (Selection::default(), Vec::new());
        for round in 0..300 {
            let spread = rng.random_range(0.1f32..20.0);
            // Also ties and zeros.
            let mut square = || (rng.random_range(-spread..spread).exp() * 4.0).floor() / 4.0;
            let squares: Vec<f32> = (0..round % 97 + 1).map(|_| square()).collect();
            let sum: f64 = squares.iter().map(|s| f64::from(*s)).sum();
            for most in [0, 1, 7, 50, usize::MAX] {
                for share in [0.0, 1e-6, 0.01, 0.3, 1.1] {
                    let left = selection.choose(&squares, most, share * sum, &mut chosen);
                    assert_eq!(chosen, plainly(&squares, most, share * sum), "{most}, {share}, {squares:?}");
                    let kept: f64 = chosen.iter().map(|&n| f64::from(squares[n as usize])).sum();
                    assert!((left - (sum - kept)).abs() <= 1e-9 * sum, "{left}, not {}", sum - kept);
                }
            }
        }
    }
}
