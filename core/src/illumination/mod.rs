//! The light: what a user calls an environment.
//!
//! A file or a host's picture becomes an [`EnvMap`] in the stage frame; reconstruction turns it into weights.
//!
//! | part | what it holds |
//! |---|---|
//! | [`EnvMap`] | a lat-long map of radiance |
//! | [`probe`] | pictures of the surroundings in other projections, resampled and merged |

mod env_map;
pub mod probe;
#[cfg(test)]
mod tests;

pub use env_map::{EnvMap, MapCentre};
