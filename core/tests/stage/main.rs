//! What photographs tell, tried on the virtual stage and gantry, where the truth is known.

mod compact;
mod factored;
mod failed;
mod gantry;
mod sparse;
mod surface;
