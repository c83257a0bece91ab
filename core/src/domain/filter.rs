//! How a projector's square falls off over the angle: what aliasing is left to (7.3, figure 7.11).

use std::f64::consts::TAU;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};

/// Deviation of the Gaussian, in squares: neighbours then sum to a constant within 1.5 %.
const DEVIATION: f64 = 0.5;

/// The light of one square, by the offset from its centre in squares; separable, and largest (1) at the centre.
///
/// ```
/// use relume_core::domain::Filter;
/// let between: Vec<f64> = Filter::ALL.iter().map(|filter| filter.at(0.25)).collect();
/// assert_eq!((between[0], between[1]), (1.0, 0.75));
/// assert_eq!("tent".parse::<Filter>()?, Filter::Tent);
/// # Ok::<(), relume_core::Error>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Filter {
    /// Even light up to the edges of the square: the thesis's.
    #[default]
    Box,
    /// Linear, to zero at the centres of the neighbours.
    Tent,
    /// Half a square of deviation, cut off a square and a half away.
    Gaussian,
}

impl Filter {
    /// All, in permanent order.
    pub const ALL: [Self; 3] = [Self::Box, Self::Tent, Self::Gaussian];

    /// Permanent id.
    pub const fn id(self) -> &'static str {
        match self {
            Self::Box => "box",
            Self::Tent => "tent",
            Self::Gaussian => "gaussian",
        }
    }

    /// Light at an offset along one direction.
    pub fn at(self, offset: f64) -> f64 {
        match self {
            Self::Box => f64::from((-0.5..0.5).contains(&offset)),
            Self::Tent => (1.0 - offset.abs()).max(0.0),
            Self::Gaussian if offset.abs() > self.reach() => 0.0,
            Self::Gaussian => (-0.5 * (offset / DEVIATION).powi(2)).exp(),
        }
    }

    /// Beyond this offset there is no light.
    pub const fn reach(self) -> f64 {
        match self {
            Self::Box => 0.5,
            Self::Tent => 1.0,
            Self::Gaussian => 1.5,
        }
    }

    /// What the squares of a row add up to at any place: light of one is spread over as many.
    pub fn sum(self) -> f64 {
        match self {
            Self::Box | Self::Tent => 1.0,
            Self::Gaussian => DEVIATION * TAU.sqrt(),
        }
    }
}

impl FromStr for Filter {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self> {
        let known = Self::ALL.into_iter().find(|filter| filter.id() == name);
        known.ok_or_else(|| Error::invalid("filter", format!("`{name}`"), "box, tent or gaussian"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn neighbours_sum_to_a_constant() {
        for filter in Filter::ALL {
            assert_eq!(filter.at(0.0), 1.0);
            assert_eq!(filter.at(filter.reach() + 1e-9), 0.0);
            for n in 0..50 {
                let offset = f64::from(n) / 50.0;
                let sum: f64 = (-4..=4).map(|k| filter.at(offset - f64::from(k))).sum();
                assert!((sum / filter.sum() - 1.0).abs() < 0.03, "{filter:?} at {offset}: {sum}");
            }
        }
    }
}
