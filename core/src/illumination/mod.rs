//! The light: what a user calls an environment.
//!
//! A file or a host's picture becomes an [`EnvMap`] in the stage frame, lamps become [`Beam`]s; reconstruction turns
//! either into weights.
//!
//! | part | what it holds |
//! |---|---|
//! | `env_map` | lat-long maps of radiance: sizes, integrals, clamping, colours, heading |
//! | `turn` | turning a map about any axis |
//! | `blur` | blurring by an angle |
//! | [`probe`] | pictures of the surroundings in other projections, resampled and merged |
//! | `beam` | light from one direction |
//! | `incident` | light that may differ from point to point |
//! | [`lighting`] | lamps that an artist sets up, as beams |
//! | [`light_field`] | light that varies in space: spots, slides, blinds, grids of probes |

mod beam;
mod blur;
mod env_map;
mod incident;
pub mod light_field;
pub mod lighting;
pub mod probe;
#[cfg(test)]
mod tests;
mod turn;

pub use beam::Beam;
pub use env_map::{EnvMap, MapCentre};
pub use incident::{Distant, Incident, Turned, flattened};
pub use light_field::LightField;
pub use lighting::Lighting;
