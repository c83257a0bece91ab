//! Where the element lies.
//!
//! Canonical coordinates are those of full scale and square pixels, y upwards. The element has one canonical unit to
//! its pixel and starts on a whole unit, so that at full scale it is passed on pixel by pixel.

use crate::area::Axis;
use crate::host::Rect;

/// Beyond this a region counts as infinite; the standard's flag is the largest 32-bit integer.
const INFINITE: f64 = 1e9;

/// The element in canonical coordinates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Placement {
    /// Lower left corner.
    origin: (f64, f64),
    /// Columns and rows of the element.
    size: (usize, usize),
}

impl Placement {
    /// From the origin up: the element makes its own format.
    pub fn own_format(size: (usize, usize)) -> Self {
        Self { origin: (0.0, 0.0), size }
    }

    /// Centred on a region; where that leaves half a pixel, it goes to the right and top.
    pub fn centred(size: (usize, usize), region: &Rect<f64>) -> Self {
        let start = |a: f64, b: f64, length: usize| (0.5 * (a + b) - 0.5 * length as f64).floor();
        Self { origin: (start(region.x1, region.x2, size.0), start(region.y1, region.y2, size.1)), size }
    }

    /// The canonical rectangle of the element.
    pub fn region(&self) -> Rect<f64> {
        let (x1, y1) = self.origin;
        Rect { x1, y1, x2: x1 + self.size.0 as f64, y2: y1 + self.size.1 as f64 }
    }

    /// Columns and rows of a picture rendered at a scale, whose pixels are `aspect` as wide as high. Column `i` of it
    /// covers the canonical `i * aspect / scale.0 ..`, row `j` the canonical `j / scale.1 ..`.
    pub fn axes(&self, scale: (f64, f64), aspect: f64) -> (Axis, Axis) {
        let (width, height) = self.size;
        (
            Axis { step: aspect / scale.0, origin: self.origin.0, length: width, flipped: false },
            Axis { step: 1.0 / scale.1, origin: self.origin.1, length: height, flipped: true },
        )
    }
}

/// The region, if it has an end on every side.
pub fn finite(region: Rect<f64>) -> Option<Rect<f64>> {
    let Rect { x1, y1, x2, y2 } = region;
    [x1, y1, x2, y2].iter().all(|edge| edge.abs() < INFINITE).then_some(region)
}

#[cfg(test)]
mod tests {
    use super::*;

    const PLATE: Rect<f64> = Rect { x1: -8.0, y1: 10.0, x2: 1912.0, y2: 1090.0 };

    #[test]
    fn the_element_is_centred_on_whole_pixels() {
        let placement = Placement::centred((320, 181), &PLATE);
        assert_eq!(placement.region(), Rect { x1: 792.0, y1: 459.0, x2: 1112.0, y2: 640.0 });
        let larger = Placement::centred((2000, 2000), &PLATE).region();
        assert_eq!((larger.x1, larger.y1), (-48.0, -450.0));
    }

    #[test]
    fn a_generator_starts_at_the_origin() {
        assert_eq!(Placement::own_format((7, 5)).region(), Rect { x1: 0.0, y1: 0.0, x2: 7.0, y2: 5.0 });
    }

    #[test]
    fn pixels_of_the_host_find_their_element_pixels() {
        let placement = Placement::centred((320, 180), &PLATE);
        // Lower left (792, 460): the first column, and the last row of the picture, whose rows run downwards.
        let (columns, rows) = placement.axes((1.0, 1.0), 1.0);
        assert_eq!((columns.footprint(792), rows.footprint(460)), ((0.0, 1.0), (179.0, 180.0)));
        assert_eq!((columns.footprint(1111), rows.footprint(639)), ((319.0, 320.0), (0.0, 1.0)));
        let (columns, rows) = placement.axes((0.5, 0.25), 1.0);
        assert_eq!((columns.footprint(396), rows.footprint(115)), ((0.0, 2.0), (176.0, 180.0)));
        // Anamorphic: a pixel twice as wide covers two columns of the element at full scale.
        let (columns, rows) = placement.axes((1.0, 1.0), 2.0);
        assert_eq!((columns.footprint(396), rows.footprint(639)), ((0.0, 2.0), (0.0, 1.0)));
        let (columns, _) = placement.axes((1.0 / 3.0, 1.0 / 3.0), 1.0);
        assert_eq!(columns.footprint(264), (0.0, 3.0), "a third is not exact, its edges are");
    }

    #[test]
    fn endless_regions_are_told() {
        assert_eq!(finite(PLATE), Some(PLATE));
        let end = f64::from(i32::MAX);
        assert_eq!(finite(Rect { x1: -end, y1: -end, x2: end, y2: end }), None);
        assert_eq!(finite(Rect { x2: f64::INFINITY, ..PLATE }), None);
        assert_eq!(finite(Rect { y1: f64::NAN, ..PLATE }), None);
    }
}
