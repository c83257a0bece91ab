//! The light: what a user calls an environment.
//!
//! A file or a host's picture becomes an [`EnvMap`] in the stage frame; reconstruction turns it into weights.

mod env_map;

pub use env_map::{EnvMap, MapCentre};
