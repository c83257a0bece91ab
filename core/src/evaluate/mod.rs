//! Errors and figures: how far one picture is from another.

mod compare;

pub use compare::{Comparison, compare};
