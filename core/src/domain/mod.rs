//! What a rig could emit: the elements of `L`, with their geometry.
//!
//! | part | what it holds |
//! |---|---|
//! | `directions` | lamps at infinity, their axis and coverage |
//! | [`lp`] | their text files |
//! | `grid`, `stage_grid` | lamps on rings |
//! | `plane` | the texels of a screen |
//! | `correspondence` | which place of a screen each pixel sees |
//! | `emitter` | what light the codes of a screen or projector become |
//! | [`patterns`] | what a screen or projector shows, set by set |

mod correspondence;
mod directions;
mod emitter;
mod grid;
pub mod lp;
pub mod patterns;
mod plane;
mod stage_grid;

pub use correspondence::{Area, Correspondence, TERMS, monomials};
pub use directions::{Axis, Coverage, Directions};
pub use emitter::{Bits, Emitter, EmitterCurve};
pub use grid::LatLongGrid;
pub use plane::Plane;
pub use stage_grid::StageGrid;
