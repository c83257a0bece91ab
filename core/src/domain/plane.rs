//! The texels of a screen, or of a projector's picture.

use crate::error::{Error, Result};
use crate::wavelet::{Edge, Normalisation, Transform, Wavelet};

/// The longest side: 16384 texels, as pictures.
const LONGEST_SIDE: usize = 1 << 14;

/// A grid of texels. Columns go to the right and row 0 is at the top, as the camera sees the bare screen; the centre of texel
/// (column, row) lies at (column + 1/2, row + 1/2). Element of `L`: row x columns + column.
///
/// ```
/// use relume_core::domain::Plane;
/// let plane = Plane::new(4, 3)?;
/// assert_eq!((plane.len(), plane.element(1, 2), plane.place(9)), (12, 9, (1, 2)));
/// assert_eq!(plane.centre(9), [1.5, 2.5]);
/// # Ok::<(), relume_core::Error>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Plane {
    columns: usize,
    rows: usize,
}

impl Plane {
    /// A grid of texels.
    ///
    /// # Errors
    /// A side of zero, or of more than 16384 texels.
    pub fn new(columns: usize, rows: usize) -> Result<Self> {
        if [columns, rows].iter().all(|side| (1..=LONGEST_SIDE).contains(side)) {
            return Ok(Self { columns, rows });
        }
        let expected = format!("sides of 1 to {LONGEST_SIDE} texels");
        Err(Error::invalid("the grid of texels", format!("{columns} x {rows}"), expected))
    }

    /// Texels in a row.
    pub fn columns(&self) -> usize {
        self.columns
    }

    /// Texels in a column.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Columns and rows.
    pub fn size(&self) -> (usize, usize) {
        (self.columns, self.rows)
    }

    /// How many texels.
    #[allow(clippy::len_without_is_empty, reason = "never empty")]
    pub fn len(&self) -> usize {
        self.columns * self.rows
    }

    /// The number of a texel.
    pub fn element(&self, column: usize, row: usize) -> usize {
        row * self.columns + column
    }

    /// Column and row of a texel.
    pub fn place(&self, element: usize) -> (usize, usize) {
        (element % self.columns, element / self.columns)
    }

    /// The transform of functions on the screen: mirrored at all edges (a screen does not go round), in the constant-energy
    /// normalisation.
    ///
    /// # Errors
    /// A wavelet that cannot be mirrored.
    pub fn transform(&self, wavelet: Wavelet) -> Result<Transform> {
        if !wavelet.is_symmetric() {
            return Err(Error::Unsupported {
                place: "functions on a screen".to_owned(),
                what: format!("the wavelet `{}`, which cannot be mirrored at the edges,", wavelet.id()),
                advice: "use haar, 5/3 or 9/7".to_owned(),
            });
        }
        Transform::new(wavelet, self.size(), (Edge::Mirrored, Edge::Mirrored), Normalisation::Energy)
    }

    /// The centre of a texel, in texels from the top left corner of the grid.
    pub fn centre(&self, element: usize) -> [f64; 2] {
        let (column, row) = self.place(element);
        [column as f64 + 0.5, row as f64 + 0.5]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn grids_have_bounds() {
        assert!(Plane::new(1, 1).is_ok() && Plane::new(16384, 16384).is_ok());
        for (columns, rows) in [(0, 4), (4, 0), (16385, 1), (1, usize::MAX)] {
            let message = Plane::new(columns, rows).unwrap_err().to_string();
            assert!(message.contains(&format!("{columns} x {rows}")), "{message}");
        }
    }
}
