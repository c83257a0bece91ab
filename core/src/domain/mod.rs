//! What a rig could emit: the elements of `L`, with their geometry.

mod directions;
mod grid;
pub mod lp;
mod stage_grid;

pub use directions::{Axis, Coverage, Directions};
pub use grid::LatLongGrid;
pub use stage_grid::StageGrid;
