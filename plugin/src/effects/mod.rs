//! The effects of the library.

pub mod relight;
