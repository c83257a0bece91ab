//! The light: what a user calls an environment.
//!
//! A file or a host's picture becomes an [`EnvMap`] in the stage frame, lamps become [`Beam`]s; reconstruction turns
//! either into weights.

mod beam;
mod env_map;

pub use beam::Beam;
pub use env_map::{EnvMap, MapCentre};
