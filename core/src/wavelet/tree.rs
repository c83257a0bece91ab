//! The tree of wavelet coefficients: what lies at a location, and what hangs from it.
//!
//! Level 0 is the coarsest. The low-pass rest of the coarsest level, the scaling coefficients, fill the top left corner;
//! around it, level by level, lie three bands of details:
//!
//! ```text
//! | scaling | HL 0 |      |
//! |  LH 0   | HH 0 | HL 1 |     first letter x, second y: L low-pass, H high-pass
//! |     LH 1       | HH 1 |
//! ```
//!
//! Scaling coefficients are the roots. The children of one are the three details of level 0 at its place; the children of
//! a detail are the (two by two) details of the next level and the same orientation that lie over it: four in every basis,
//! whatever the length of its filters, so that every location but a root has exactly one parent. (The thesis, 6.5, takes
//! all functions that overlap, which for long filters is no tree.) A square grid of a power of two has one root;
//! 256 x 64 has 4 x 1.
//!
//! The up to three details of a place are a *group*, and groups are a tree as well, again with four children each. Haar
//! functions overlap with those of all orientations below them, and so do the others: [`Tree::below`].

use crate::error::{Error, Result};

/// Which of the three detail functions of a place.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Orientation {
    /// LH: low-pass in x, high-pass in y (phi psi): horizontal edges.
    LowHigh,
    /// HL: high-pass in x, low-pass in y (psi phi): vertical edges.
    HighLow,
    /// HH: high-pass in both (psi psi): corners and diagonals.
    HighHigh,
}

impl Orientation {
    /// In the order of the thesis, figure 6.5.
    pub const ALL: [Self; 3] = [Self::LowHigh, Self::HighLow, Self::HighHigh];

    /// Whether it is high-pass in x, in y.
    fn high(self) -> (bool, bool) {
        (self != Self::LowHigh, self != Self::HighLow)
    }
}

/// What lies at a location.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Place {
    /// 0 is the coarsest, of the scaling coefficients too.
    pub level: u32,
    /// `None` for a scaling coefficient.
    pub orientation: Option<Orientation>,
    /// Column within the band.
    pub x: u32,
    /// Row within the band.
    pub y: u32,
}

/// The tree of the coefficients of a [`Transform`](super::Transform), by location (row * width + column).
///
/// # Panics
/// All methods that take a location, when it lies outside of the grid.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Tree {
    /// Sizes of the low-pass rest, coarsest first; the last is the whole.
    scales: Vec<(u32, u32)>,
}

impl Tree {
    /// The tree of a grid, width and height.
    ///
    /// # Errors
    /// A size of zero, or of 2^32 values or more.
    pub fn new(size: (usize, usize)) -> Result<Self> {
        let (width, height) = size;
        if width.checked_mul(height).is_none_or(|values| values == 0 || u32::try_from(values).is_err()) {
            let expected = "at least 1 x 1, and fewer than 2^32 values";
            return Err(Error::invalid("the grid of the wavelets", format!("{width} x {height}"), expected));
        }
        // A side of one has nothing to halve.
        let halvings = |side: usize| if side == 1 { u32::MAX } else { side.trailing_zeros() };
        let levels = if width * height == 1 { 1 } else { halvings(width).min(halvings(height)).max(1) };
        let scale = |halved: u32| (width.div_ceil(1 << halved) as u32, height.div_ceil(1 << halved) as u32);
        Ok(Self { scales: (0..=levels).rev().map(scale).collect() })
    }

    /// Width and height.
    pub fn size(&self) -> (usize, usize) {
        let (width, height) = self.scales[self.scales.len() - 1];
        (width as usize, height as usize)
    }

    /// How many coefficients there are.
    #[allow(clippy::len_without_is_empty, reason = "never empty")]
    pub fn len(&self) -> usize {
        let (width, height) = self.size();
        width * height
    }

    /// How many levels of details there are: `level` is below this.
    pub fn levels(&self) -> u32 {
        self.scales.len() as u32 - 1
    }

    /// Sizes of what each level starts from or leaves: that of the scaling coefficients, then what each level makes.
    pub(super) fn scales(&self) -> impl Iterator<Item = (usize, usize)> {
        self.scales.iter().map(|scale| (scale.0 as usize, scale.1 as usize))
    }

    /// What lies at a location.
    pub fn place(&self, location: u32) -> Place {
        let width = self.width();
        let (x, y) = (location % width, location / width);
        let inside = |scale: &&(u32, u32)| x < scale.0 && y < scale.1;
        let outer = self.scales.iter().position(|scale| inside(&scale)).expect("a location within the grid");
        let Some(level) = outer.checked_sub(1) else {
            return Place { level: 0, orientation: None, x, y };
        };
        let (low_x, low_y) = self.scales[level];
        let orientation = match (x >= low_x, y >= low_y) {
            (false, _) => Orientation::LowHigh,
            (true, false) => Orientation::HighLow,
            (true, true) => Orientation::HighHigh,
        };
        let (high_x, high_y) = orientation.high();
        let (x, y) = (if high_x { x - low_x } else { x }, if high_y { y - low_y } else { y });
        Place { level: level as u32, orientation: Some(orientation), x, y }
    }

    /// Where a place lies; `None` where the grid has none such.
    pub fn location(&self, place: Place) -> Option<u32> {
        let Place { level, orientation, x, y } = place;
        let inner = *self.scales.get(level as usize)?;
        let outer = *self.scales.get(level as usize + 1)?;
        let (high_x, high_y) = orientation.map_or((false, false), Orientation::high);
        let along = |high: bool, at: u32, low: u32, all: u32| {
            let (first, count) = if high { (low, all - low) } else { (0, low) };
            (at < count).then_some(first + at)
        };
        let x = along(high_x, x, inner.0, outer.0)?;
        let y = along(high_y, y, inner.1, outer.1)?;
        (orientation.is_some() || level == 0).then_some(y * self.width() + x)
    }

    /// The level, 0 the coarsest, of the scaling coefficients too.
    pub fn level(&self, location: u32) -> u32 {
        self.place(location).level
    }

    /// The orientation of a detail; `None` for a scaling coefficient.
    pub fn orientation(&self, location: u32) -> Option<Orientation> {
        self.place(location).orientation
    }

    /// The scaling coefficients, row by row.
    pub fn roots(&self) -> impl Iterator<Item = u32> + use<> {
        let (width, (columns, rows)) = (self.width(), self.scales[0]);
        (0..rows).flat_map(move |y| (0..columns).map(move |x| y * width + x))
    }

    /// What a location hangs from; `None` for a scaling coefficient.
    pub fn parent(&self, location: u32) -> Option<u32> {
        let place = self.place(location);
        place.orientation?;
        self.location(match place.level {
            0 => Place { orientation: None, ..place },
            level => Place { level: level - 1, x: place.x / 2, y: place.y / 2, ..place },
        })
    }

    /// What hangs from a location, at most four: in the order LH, HL, HH under a scaling coefficient, row by row under a
    /// detail.
    pub fn children(&self, location: u32) -> impl Iterator<Item = u32> + use<> {
        let place = self.place(location);
        let Place { level, x, y, .. } = place;
        let child = |n: u32| {
            let place = match place.orientation {
                None => Place { orientation: Some(*Orientation::ALL.get(n as usize)?), ..place },
                Some(_) => Place { level: level + 1, x: 2 * x + n % 2, y: 2 * y + n / 2, ..place },
            };
            self.location(place)
        };
        [child(0), child(1), child(2), child(3)].into_iter().flatten()
    }

    /// The details that share its place, itself among them, in the order LH, HL, HH; a scaling coefficient is alone.
    pub fn group(&self, location: u32) -> impl Iterator<Item = u32> + use<> {
        let place = self.place(location);
        let member = |n: usize| match place.orientation {
            None => (n == 0).then_some(location),
            Some(_) => self.location(Place { orientation: Some(Orientation::ALL[n]), ..place }),
        };
        [member(0), member(1), member(2)].into_iter().flatten()
    }

    /// The first of each group under that of a location: one under a scaling coefficient, four under details.
    pub fn groups_below(&self, location: u32) -> impl Iterator<Item = u32> + use<> {
        let count = if self.orientation(location).is_none() { 1 } else { 4 };
        self.group(location).next().map(|first| self.children(first)).into_iter().flatten().take(count)
    }

    /// The members of all groups under that of a location: up to twelve, group by group.
    pub fn below(&self, location: u32) -> impl Iterator<Item = u32> + '_ {
        self.groups_below(location).flat_map(|first| self.group(first))
    }

    /// All locations in the linear order of 6.4, figure 6.5: scaling coefficients; then level by level from the coarsest,
    /// within a level row by row, and at each place LH, HL, HH. Parents come before their children.
    pub fn linear_order(&self) -> impl Iterator<Item = u32> + '_ {
        let level = move |level: u32| {
            let (columns, rows) = self.scales[level as usize];
            let places = (0..rows).flat_map(move |y| (0..columns).map(move |x| (x, y)));
            let details = move |(x, y)| Orientation::ALL.map(|o| Place { level, orientation: Some(o), x, y });
            places.flat_map(details).filter_map(|place| self.location(place))
        };
        self.roots().chain((0..self.levels()).flat_map(level))
    }

    fn width(&self) -> u32 {
        self.scales[self.scales.len() - 1].0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZES: [(usize, usize); 9] = [(256, 64), (16, 16), (8, 1), (1, 8), (12, 20), (7, 5), (5, 8), (2, 2), (1, 1)];

    #[test]
    fn places_and_locations_are_one_to_one_and_children_have_their_parent() {
        for size in SIZES {
            let tree = Tree::new(size).unwrap();
            let mut hangs = vec![0; tree.len()];
            for location in 0..tree.len() as u32 {
                let place = tree.place(location);
                assert_eq!(tree.location(place), Some(location), "{size:?}: {place:?}");
                assert!(place.level < tree.levels());
                let limit = if place.orientation.is_none() { 3 } else { 4 };
                assert!(tree.children(location).count() <= limit);
                for child in tree.children(location) {
                    hangs[child as usize] += 1;
                    assert_eq!(tree.parent(child), Some(location));
                    let (own, child) = (place.level, tree.place(child));
                    assert_eq!(child.level, if place.orientation.is_none() { 0 } else { own + 1 });
                    assert!(place.orientation.is_none() || child.orientation == place.orientation);
                }
                assert!(tree.group(location).any(|member| member == location));
            }
            tree.roots().for_each(|root| hangs[root as usize] += 1);
            assert!(hangs.iter().all(|count| *count == 1), "{size:?}: one forest over all locations");
            let mut order: Vec<u32> = tree.linear_order().collect();
            order.sort_unstable();
            assert!(order.into_iter().eq(0..tree.len() as u32));
        }
    }

    /// 256 x 64: six levels, 4 x 1 roots; and figure 6.5 d on 8 x 8.
    #[test]
    fn known_trees() {
        let tree = Tree::new((256, 64)).unwrap();
        assert_eq!((tree.levels(), tree.roots().collect::<Vec<u32>>()), (6, vec![0, 1, 2, 3]));
        // Level 0 has 4 x 1 details: LH in row 1, HL from column 4 on, HH below it.
        assert_eq!(tree.children(2).collect::<Vec<u32>>(), [256 + 2, 6, 256 + 6]);
        assert_eq!(tree.children(6).collect::<Vec<u32>>(), [8 + 4, 8 + 5, 256 + 8 + 4, 256 + 8 + 5]);
        assert_eq!(tree.below(6).count(), 12);
        assert_eq!(tree.orientation(6), Some(Orientation::HighLow));
        assert_eq!(tree.level(256 * 63), 5);
        assert_eq!(tree.children(256 * 63).count(), 0);
        let square = Tree::new((8, 8)).unwrap();
        let order: Vec<u32> = square.linear_order().take(10).collect();
        assert_eq!(order, [0, 8, 1, 9, 16, 2, 18, 17, 3, 19]);
    }

    #[test]
    fn grids_that_cannot_be_are_refused() {
        for size in [(0, 4), (4, 0), (1 << 16, 1 << 16), (usize::MAX, 2)] {
            let message = Tree::new(size).unwrap_err().to_string();
            assert!(message.contains(&format!("{} x {}", size.0, size.1)), "{message}");
        }
    }
}
