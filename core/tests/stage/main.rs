//! What photographs tell, tried on the virtual stage, where the truth is known.

mod compact;
mod factored;
mod failed;
mod sparse;
mod surface;
