//! The light: what a user calls an environment.
//!
//! A file or a host's picture becomes an [`EnvMap`] in the stage frame; reconstruction turns it into weights.
//!
//! | part | what it holds |
//! |---|---|
//! | `env_map` | lat-long maps of radiance: sizes, integrals, clamping, colours, heading |
//! | `turn` | turning a map about any axis |
//! | `blur` | blurring by an angle |

mod blur;
mod env_map;
mod turn;

pub use env_map::{EnvMap, MapCentre};
