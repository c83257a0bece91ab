//! Boards that are not there: they speak the same bytes as real ones over pseudo-terminals, and move and light a [`World`].
//!
//! ```text
//! driver <- pty -> Served (a thread) -> Mischief (tests: noise, delays...) -> a Board -> World -> what a camera would see
//! ```
//!
//! People rehearse with them (`relume rig simulate`), and tests find out what drivers do on bad days. An answer that confirms
//! something is given only after the world, and what watches it, is up to date.
//!
//! | part | what it holds |
//! |---|---|
//! | [`World`] | axes in motion over time, levels of channels |
//! | [`served`] | a board on a pty |
//! | [`mischief`] | what goes wrong, from a seed |
//! | [`grbl`] | GRBL 1.1 |
//! | [`dmx_widget`] | an ENTTEC DMX USB Pro |
//! | [`text_board`] | lamps by lines of text |
//! | [`studio`] | the photograph of a virtual stage under what the boards do |

pub mod dmx_widget;
pub mod grbl;
pub mod mischief;
pub mod served;
pub mod studio;
#[cfg(test)]
mod tests;
pub mod text_board;
mod world;

#[cfg(test)]
pub use mischief::Strike;
pub use mischief::{Mischief, Planned};
pub use served::{Served, serve};
pub use world::{Seen, World};
