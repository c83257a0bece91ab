//! Where texels land on an output: each is a square of whole pixels, all of them in the middle, black about them. Nothing is
//! resampled, so that what the camera sees is what was computed.

use crate::devices::Trouble;

/// Where texels land.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Layout {
    /// Pixels of the output: columns, rows.
    pub output: (usize, usize),
    /// Texels: columns, rows.
    pub texels: (usize, usize),
    /// Pixels along each side of a texel.
    pub texel_px: usize,
    /// The first texel's top left pixel. Where the black about them is odd, the smaller half is left and above.
    pub corner: (usize, usize),
}

impl Layout {
    /// In the middle of an output; with no word about the pixels of a texel, as many as fit. `place` names the output.
    ///
    /// # Errors
    /// An output that is too small; no texels at all.
    pub fn new(
        place: &str,
        texels: (usize, usize),
        output: (usize, usize),
        texel_px: Option<usize>,
    ) -> Result<Self, Trouble> {
        if texels.0 == 0 || texels.1 == 0 || texel_px == Some(0) {
            return Err(Trouble::stop("a picture without texels cannot be shown", "this is a mistake in relume"));
        }
        let most = (output.0 / texels.0).min(output.1 / texels.1);
        let texel_px = texel_px.unwrap_or(most.max(1));
        if texel_px > most {
            let each = if texel_px == 1 { String::new() } else { format!(" of {texel_px} pixels a side") };
            return Err(Trouble::stop(
                format!(
                    "{place} has {} x {} pixels, and {} x {} texels{each} take {} x {}",
                    output.0,
                    output.1,
                    texels.0,
                    texels.1,
                    texels.0.saturating_mul(texel_px),
                    texels.1.saturating_mul(texel_px)
                ),
                "choose a larger output or mode, smaller texels (texel_px under [devices] screen), or fewer of them",
            ));
        }
        let corner = ((output.0 - texels.0 * texel_px) / 2, (output.1 - texels.1 * texel_px) / 2);
        Ok(Self { output, texels, texel_px, corner })
    }

    /// The texel that a pixel of the output shows; none about them.
    pub fn texel(&self, x: usize, y: usize) -> Option<(usize, usize)> {
        let along = |pixel: usize, corner: usize, count: usize| {
            pixel.checked_sub(corner).map(|inside| inside / self.texel_px).filter(|texel| *texel < count)
        };
        Some((along(x, self.corner.0, self.texels.0)?, along(y, self.corner.1, self.texels.1)?))
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg32;

    use super::*;

    #[test]
    fn texels_are_squares_of_pixels_in_the_middle() {
        let mut random = Pcg32::seed_from_u64(1);
        for _ in 0..300 {
            let texels = (random.random_range(1..20), random.random_range(1..20));
            let output = (random.random_range(1..80), random.random_range(1..80));
            let wanted = random.random_bool(0.5).then(|| random.random_range(1..6));
            let most = (output.0 / texels.0).min(output.1 / texels.1);
            let laid = Layout::new("DP-1", texels, output, wanted);
            assert_eq!(laid.is_ok(), most >= wanted.unwrap_or(1), "{texels:?} on {output:?}, {wanted:?}");
            let Ok(layout) = laid else { continue };
            assert_eq!(layout.texel_px, wanted.unwrap_or(most));
            let mut seen = vec![0; texels.0 * texels.1];
            let (mut left, mut right, mut above, mut below) = (output.0, output.0, output.1, output.1);
            for (x, y) in (0..output.1).flat_map(|y| (0..output.0).map(move |x| (x, y))) {
                let Some((column, row)) = layout.texel(x, y) else { continue };
                seen[row * texels.0 + column] += 1;
                // Neighbours to the right and below are the same texel or the next one.
                if let Some(next) = layout.texel(x + 1, y) {
                    assert!(next.1 == row && (column..=column + 1).contains(&next.0));
                }
                (left, right) = (left.min(x), right.min(output.0 - 1 - x));
                (above, below) = (above.min(y), below.min(output.1 - 1 - y));
            }
            assert!(seen.iter().all(|pixels| *pixels == layout.texel_px.pow(2)), "{layout:?}");
            assert!(right - left <= 1 && below - above <= 1, "{layout:?}: in the middle");
        }
    }

    #[test]
    fn an_output_that_is_too_small_is_told_with_both_sizes() {
        let said = Layout::new("output DP-1", (128, 100), (640, 480), Some(5)).unwrap_err().to_string();
        for words in ["DP-1", "640 x 480", "128 x 100", "640 x 500", "texel_px"] {
            assert!(said.contains(words), "{words}: {said}");
        }
        assert!(Layout::new("", (0, 4), (10, 10), None).is_err());
        assert!(Layout::new("", (4, 4), (10, 10), Some(0)).is_err());
        assert!(Layout::new("", (usize::MAX, 4), (10, 10), Some(2)).is_err());
    }
}
