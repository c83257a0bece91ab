//! What a rig could emit: the elements of `L`, with their geometry.

mod directions;
pub mod lp;

pub use directions::{Axis, Coverage, Directions};
