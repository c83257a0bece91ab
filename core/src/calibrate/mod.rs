//! What a rig must know before its photographs mean light: where lamps stand, how bright they are, what is white.
//!
//! Lamps from a ball (the usual way of RTI, and thesis 2.3's stage without its encoders): photographs, one lamp each ->
//! [`survey`] -> highlights -> [`lamps`] (which is the lamp, and what is doubtful) -> a `.lp` file and a
//! [`lamp_table`].
//!
//! What else a rig is held against, from photographs of its own: dark level and ambient light, intensities, movement, drift,
//! linearity.
//!
//! | part | what it holds |
//! |---|---|
//! | [`black`] | the dark level and the ambient light, from black photographs |
//! | [`white_ball`] | how bright lamps are, from pictures of a matt white ball |
//! | [`movement`] | has object or camera moved between two pictures of one condition? |
//! | [`drift`] | gains of lamps over time, from a repeated reference |
//! | [`linearity`] | do the lamps' pictures add up to that of all? |
//! | [`ball`] | the outline of a ball in a photograph |
//! | [`reflect`] | which way light came that is seen at a pixel of a ball |
//! | [`highlight`] | highlights on a ball in one photograph |
//! | [`near`] | places of near lamps, their fall-off, flat fields |
//! | [`lamps`] | from highlights to lamps |
//! | [`survey`] | reads a set of photographs |
//! | [`overrides`] | what a person says about highlights |
//! | [`lamp_table`] | irradiances and places of lamps as a file |
//! | [`failed`] | lamps that were dark or hidden, found from the set's own smoothness |
//! | [`Correction`], [`patch`], [`white`](fn@white) | white balance from a patch of known reflectance |
//! | [`white_patch`](fn@white_patch) | the same of a patch under a projector's white (7.3) |
//! | [`chart`] | a colour matrix from a chart of 24 patches |
//! | [`emitter`] | what light the codes of a screen become |
//! | [`screen`] | which place of a screen each pixel sees |

pub mod ball;
pub mod black;
pub mod chart;
pub mod drift;
pub mod emitter;
pub mod failed;
pub mod highlight;
pub mod lamp_table;
pub mod lamps;
pub mod linearity;
pub mod movement;
pub mod near;
pub mod overrides;
pub mod reflect;
pub mod screen;
pub mod survey;
#[cfg(test)]
mod tests;
mod white;
pub mod white_ball;
mod white_patch;

pub use white::{Correction, patch, white};
pub use white_patch::white_patch;
