//! Charts for setting a screen or projector up, drawn at its own pixels.
//!
//! `grid`: is the picture whole, upright, square, not mirrored, its middle where it should be? `focus`: is it sharp in the middle and in
//! the corners, and does each pixel reach the panel by itself?

mod focus;
mod grid;
mod sheet;

pub use focus::focus;
pub use grid::{grid, usual_step};
