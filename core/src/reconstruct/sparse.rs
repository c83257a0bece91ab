//! A sparse matrix functions x texels, by function: a row's product is one gather in a fixed order.

use rayon::prelude::*;

use super::texels::Entry;

/// Rows are functions, columns texels.
#[derive(Debug, Clone)]
pub(super) struct Sparse {
    texels: usize,
    /// `entries[starts[n]..starts[n + 1]]` belong to function n.
    starts: Vec<usize>,
    /// (texel, steradians).
    entries: Vec<(u32, f32)>,
}

impl Sparse {
    /// Sorts entries by function; texels stay in the order given.
    pub fn new(functions: usize, texels: usize, given: &[Entry]) -> Self {
        let mut starts = vec![0usize; functions + 1];
        given.iter().for_each(|entry| starts[entry.function as usize + 1] += 1);
        (0..functions).for_each(|n| starts[n + 1] += starts[n]);
        let (mut next, mut entries) = (starts.clone(), vec![(0, 0.0); given.len()]);
        for entry in given {
            let place = &mut next[entry.function as usize];
            entries[*place] = (entry.texel, entry.steradians as f32);
            *place += 1;
        }
        Self { texels, starts, entries }
    }

    /// What a product reads.
    pub fn bytes(&self) -> usize {
        size_of_val(&*self.entries) + size_of_val(&*self.starts)
    }

    fn row(&self, function: usize) -> &[(u32, f32)] {
        &self.entries[self.starts[function]..self.starts[function + 1]]
    }

    /// For each function the sum over the texels of steradians times radiance; `radiance` is RGB, texel after texel.
    pub fn times(&self, radiance: &[f32]) -> Vec<[f64; 3]> {
        let product = |function: usize| {
            let mut sum = [0.0f64; 3];
            for &(texel, steradians) in self.row(function) {
                let rgb = &radiance[texel as usize * 3..][..3];
                (0..3).for_each(|c| sum[c] += f64::from(rgb[c]) * f64::from(steradians));
            }
            sum
        };
        (0..self.starts.len() - 1).into_par_iter().map(product).collect()
    }

    /// For each texel the sum over the functions of steradians times coefficient.
    pub fn transposed_times(&self, coefficients: &[f64]) -> Vec<f64> {
        let mut texels = vec![0.0f64; self.texels];
        for (function, coefficient) in coefficients.iter().enumerate() {
            for &(texel, steradians) in self.row(function) {
                texels[texel as usize] += f64::from(steradians) * coefficient;
            }
        }
        texels
    }
}
