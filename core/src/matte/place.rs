//! Where the object stands in the plate.

use crate::error::{Error, Result};

/// The smallest and largest scale: beyond these a picture is a dot, or a pixel fills the plate.
const SCALES: std::ops::RangeInclusive<f64> = 0.001..=1000.0;
/// The farthest shift, pixels.
const FARTHEST: f64 = 1e6;

/// From pixels of the object's picture to pixels of the plate: scaled and turned about its middle, whose place in the plate
/// is given from the plate's middle. Pixels from the top left, rows downwards, centres at +0.5. Neutral: middle on middle,
/// pixel on pixel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Place {
    /// To the right and downwards from the middle of the plate, pixels of the plate.
    pub shift: [f64; 2],
    /// Pixels of the plate for one of the object's picture.
    pub scale: f64,
    /// Counter-clockwise, as one looks at the picture, degrees.
    pub rotate_deg: f64,
}

impl Default for Place {
    fn default() -> Self {
        Self { shift: [0.0; 2], scale: 1.0, rotate_deg: 0.0 }
    }
}

impl Place {
    /// Refuses what is no place.
    ///
    /// # Errors
    /// Numbers that are not finite; a scale outside 0.001 to 1000; a shift of more than a million pixels.
    pub fn check(&self) -> Result<()> {
        let refuse = |found: String, expected: &str| Err(Error::invalid("the place of the object", found, expected));
        if !SCALES.contains(&self.scale) {
            return refuse(format!("a scale of {}", self.scale), "0.001 to 1000");
        }
        if !self.rotate_deg.is_finite() {
            return refuse(format!("a rotation of {}", self.rotate_deg), "a finite number of degrees");
        }
        if !self.shift.iter().all(|s| s.abs() <= FARTHEST) {
            return refuse(format!("a shift of {:?}", self.shift), "at most a million pixels");
        }
        Ok(())
    }

    /// Made ready for pictures of these sizes, width and height.
    pub(super) fn between(&self, object: (usize, usize), plate: (usize, usize)) -> Mapping {
        let half = |size: (usize, usize)| [size.0 as f64 / 2.0, size.1 as f64 / 2.0];
        let (middle, plate) = (half(object), half(plate));
        // Whole quarters of a turn without rounding.
        let (sin, cos) = match self.rotate_deg.rem_euclid(360.0) {
            0.0 => (0.0, 1.0),
            90.0 => (1.0, 0.0),
            180.0 => (0.0, -1.0),
            270.0 => (-1.0, 0.0),
            degrees => degrees.to_radians().sin_cos(),
        };
        Mapping { middle, to: [plate[0] + self.shift[0], plate[1] + self.shift[1]], sin, cos, scale: self.scale }
    }
}

/// [`Place`] between two pictures.
#[derive(Debug, Clone, Copy)]
pub(super) struct Mapping {
    middle: [f64; 2],
    to: [f64; 2],
    sin: f64,
    cos: f64,
    pub scale: f64,
}

impl Mapping {
    /// Where a place of the object's picture lies in the plate.
    pub fn plate(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let [x, y] = [self.scale * (x - self.middle[0]), self.scale * (y - self.middle[1])];
        // Rows go down: counter-clockwise is the other way round.
        [self.to[0] + self.cos * x + self.sin * y, self.to[1] - self.sin * x + self.cos * y]
    }

    /// Where a place of the plate lies in the object's picture.
    pub fn object(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let [x, y] = [x - self.to[0], y - self.to[1]];
        let (sin, cos) = (self.sin / self.scale, self.cos / self.scale);
        [self.middle[0] + cos * x - sin * y, self.middle[1] + sin * x + cos * y]
    }
}
