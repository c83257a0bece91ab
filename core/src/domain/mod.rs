//! What a rig could emit: the elements of `L`, with their geometry.
//!
//! | part | what it holds |
//! |---|---|
//! | `directions` | lamps at infinity, their axis and coverage |
//! | [`lp`] | their text files |
//! | `grid`, `stage_grid` | lamps on rings |
//! | `plane` | the texels of a screen |
//! | `correspondence` | where on a screen the pixels of a camera look |
//! | `gantry`, `filter` | positions and squares of a projector, and how squares fall off |
//! | `kind` | lamps, texels or squares |
//! | `emitter` | what light the codes of a screen or projector become |
//! | [`patterns`] | what a screen or projector shows, set by set |

mod correspondence;
mod directions;
mod emitter;
mod filter;
mod gantry;
mod grid;
mod kind;
pub mod lp;
pub mod patterns;
mod plane;
mod stage_grid;

pub use correspondence::{Area, Correspondence, TERMS, monomials};
pub use directions::{Axis, Coverage, Directions};
pub use emitter::{Bits, Emitter, EmitterCurve};
pub use filter::Filter;
pub use gantry::{Gantry, MOST_SQUARES, Pose};
pub use grid::LatLongGrid;
pub use kind::Domain;
pub use plane::Plane;
pub use stage_grid::StageGrid;
