//! What a rig must know before its photographs mean light: where lamps stand, how bright they are, what is white.
//!
//! | part | what it holds |
//! |---|---|
//! | [`ball`] | the outline of a ball in a photograph |

pub mod ball;
