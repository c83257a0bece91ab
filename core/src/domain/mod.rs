//! What a rig could emit: the elements of `L`, with their geometry.

mod directions;
mod grid;
pub mod lp;

pub use directions::{Axis, Coverage, Directions};
pub use grid::LatLongGrid;
