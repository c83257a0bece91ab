//! What a rig must know before its photographs mean light: where lamps stand, how bright they are, what is white.
//!
//! | part | what it holds |
//! |---|---|
//! | [`Correction`], [`patch`], [`white`](fn@white) | white balance from a patch of known reflectance |
//! | [`chart`] | a colour matrix from a chart of 24 patches |
//! | [`failed`] | lamps that were dark or hidden, found from the set's own smoothness |

pub mod chart;
pub mod failed;
mod white;

pub use white::{Correction, patch, white};
