//! What a rig must know before its photographs mean light: where lamps stand, how bright they are, what is white.
//!
//! Lamps from a ball (the usual way of RTI, and thesis 2.3's stage without its encoders): photographs, one lamp each ->
//! [`survey`] -> highlights -> [`lamps`] (which is the lamp, and what is doubtful) -> a `.lp` file and a
//! [`lamp_table`].
//!
//! | part | what it holds |
//! |---|---|
//! | [`black`] | the dark level and the ambient light, from black photographs |
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
//! | [`chart`] | a colour matrix from a chart of 24 patches |

pub mod ball;
pub mod black;
pub mod chart;
pub mod failed;
pub mod highlight;
pub mod lamp_table;
pub mod lamps;
pub mod near;
pub mod overrides;
pub mod reflect;
pub mod survey;
#[cfg(test)]
mod tests;
mod white;

pub use white::{Correction, patch, white};
