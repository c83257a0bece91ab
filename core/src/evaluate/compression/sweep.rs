//! A turning sliver of light over functions on the grid.

use std::sync::Arc;

use super::super::sliver::{SLIVER_MAP, headings, sliver_weights};
use crate::domain::StageGrid;
use crate::error::Result;
use crate::reconstruct::{Method, Operator, Outside, Reconstruction};
use crate::wavelet::Wavelet;

/// Weights of the texels of a grid under slivers of light at some headings over one turn; functions on the grid are linear
/// between texels.
#[derive(Debug, Clone)]
pub struct Sweep {
    texels: usize,
    /// For each heading the texels that are lit.
    frames: Vec<Vec<(u32, f32)>>,
}

impl Sweep {
    /// At `frames` headings, as [`headings`] has them: under a second.
    ///
    /// # Errors
    /// None for a grid, which is one to [`Reconstruction`] too.
    pub fn new(grid: &StageGrid, frames: usize) -> Result<Self> {
        let linear = Reconstruction::new(grid.directions()?.clone(), Method::Wavelet(Wavelet::LeGall53))?;
        let operator = Operator::new(Arc::new(linear), Outside::Drop, SLIVER_MAP.0, SLIVER_MAP.1);
        let lit = |weights: Vec<f32>| (0..).zip(weights).filter(|entry| entry.1 != 0.0).collect();
        // Some headings at a time: their weights are dense.
        const TOGETHER: usize = 12;
        let all = headings(frames);
        let frames = all.chunks(TOGETHER).flat_map(|some| sliver_weights(&operator, some)).map(lit).collect();
        Ok(Self { texels: grid.texels(), frames })
    }

    /// How many headings.
    pub fn frames(&self) -> usize {
        self.frames.len()
    }

    /// Functions `[texel][lane]` over time: `[heading][lane]`.
    pub(super) fn lit(&self, functions: &[f32], lanes: usize) -> Vec<f32> {
        assert_eq!(functions.len(), self.texels * lanes, "one value a texel and lane");
        let mut values = vec![0.0; self.frames.len() * lanes];
        for (frame, sums) in self.frames.iter().zip(values.chunks_exact_mut(lanes)) {
            for &(texel, weight) in frame {
                let lanes = &functions[texel as usize * lanes..][..lanes];
                sums.iter_mut().zip(lanes).for_each(|(sum, v)| *sum += weight * v);
            }
        }
        values
    }
}
