//! Lamps that an artist sets up around the object: keys, rims, softboxes, rings, skies.
//!
//! A [`Lamp`] is a distant shape in the stage frame, of one radiance all over (a dome: a gradient). It becomes
//! [`Beam`]s, each a small solid angle of it, so that its weights are integrals against the reconstruction kernels and
//! never one look at its middle: beams lie about half a degree apart, and the narrowest kernels of a rig span degrees.
//!
//! **Intensity.** Stops count from a lamp that gives a white diffuser facing it the value 1 (irradiance pi). A lamp spreads
//! that same light over its solid angle, whatever its size: the sum over its parts of radiance times solid angle is
//! `pi 2^stops` times its colour. So size changes shadows and highlights, and a white ball keeps its mean. A dome's stops
//! count from one that gives a white diffuser facing the zenith the value 1, ground left out.
//!
//! | part | what it holds |
//! |---|---|
//! | `quadrature` | shapes -> directions and solid angles |
//! | [`kelvin`] | colour temperature -> linear Rec.709 |

pub mod kelvin;
pub(super) mod quadrature;

use std::f64::consts::PI;

use super::Beam;
use crate::math::{Vec3, angle_between};
use quadrature::Patch;

/// Lamps, lit together.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Lighting {
    /// In any order: light adds.
    pub lamps: Vec<Lamp>,
}

impl Lighting {
    /// All lamps as beams, lamp after lamp. Every irradiance is finite and none is negative for lamps within the bounds
    /// that their fields state.
    pub fn beams(&self) -> Vec<Beam> {
        self.lamps.iter().flat_map(Lamp::beams).collect()
    }
}

/// One lamp.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lamp {
    /// Its form and place.
    pub shape: Shape,
    /// Linear Rec.709, not negative; [`kelvin::rgb`] gives colours of luminance 1.
    pub colour: [f64; 3],
    /// Intensity, as the module says.
    pub stops: f64,
}

/// Where a lamp's middle is, seen from the object.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Aim {
    /// Radians about +y: 0 from the camera, positive to the right of the picture (+x).
    pub azimuth_rad: f64,
    /// Radians above the horizon.
    pub elevation_rad: f64,
}

impl Aim {
    /// Unit vector from the object to the lamp: (sin az cos el, sin el, cos az cos el).
    pub fn direction(&self) -> Vec3 {
        let ((sa, ca), (se, ce)) = (self.azimuth_rad.sin_cos(), self.elevation_rad.sin_cos());
        Vec3::new(sa * ce, se, ca * ce)
    }

    /// Horizontal, to growing azimuth. Defined at the zenith too, where direction alone would not tell it.
    fn right(&self) -> Vec3 {
        let (s, c) = self.azimuth_rad.sin_cos();
        Vec3::new(c, 0.0, -s)
    }
}

/// Forms of lamps. The set is closed: a file's `kind` names one of them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Shape {
    /// Parallel light, as of a far point.
    Directional {
        /// Where it comes from.
        aim: Aim,
    },
    /// A round lamp.
    Disc {
        /// Its middle.
        aim: Aim,
        /// From the middle to the rim, in (0, pi].
        radius_rad: f64,
    },
    /// A flat rectangle that faces the object, in any unit of length. It radiates alike to all sides, so it is of one
    /// radiance.
    Softbox {
        /// Its middle.
        aim: Aim,
        /// Horizontal side, before `turn_rad`.
        width: f64,
        /// The other side.
        height: f64,
        /// From the object to its middle.
        distance: f64,
        /// Turns it in its plane: the right-hand side, as the object sees growing azimuth, goes up.
        turn_rad: f64,
    },
    /// The part of the sphere between two circles about a direction.
    Ring {
        /// The middle.
        aim: Aim,
        /// From the middle to the inner rim, in [0, outer).
        inner_rad: f64,
        /// From the middle to the outer rim, in (inner, pi].
        outer_rad: f64,
    },
    /// The sky: radiance goes from horizon to zenith with the sine of the elevation, as in the CIE's overcast sky
    /// (Moon and Spencer 1942: a third at the horizon). [`Lamp::colour`] is the zenith's.
    Dome {
        /// Colour at the horizon.
        horizon: [f64; 3],
        /// Radiance at the horizon against the zenith, in stops.
        horizon_stops: f64,
        /// Albedo of a diffuse ground, in [0, 1]: the lower half shines with what the sky gives it.
        ground: f64,
    },
}

impl Lamp {
    /// The lamp as beams.
    pub fn beams(&self) -> Vec<Beam> {
        self.beams_apart(quadrature::SPACING_RAD)
    }

    /// The lamp as beams about so far apart.
    pub(super) fn beams_apart(&self, spacing_rad: f64) -> Vec<Beam> {
        let total = self.colour.map(|c| PI * self.stops.exp2() * c);
        let patches = match self.shape {
            Shape::Directional { aim } => vec![Patch { direction: aim.direction(), steradians: 1.0 }],
            Shape::Disc { aim, radius_rad } => quadrature::annulus(&aim, 0.0, radius_rad, spacing_rad),
            Shape::Ring { aim, inner_rad, outer_rad } => quadrature::annulus(&aim, inner_rad, outer_rad, spacing_rad),
            Shape::Softbox { aim, width, height, distance, turn_rad } => {
                quadrature::rectangle(&aim, turn_rad, [width / distance, height / distance], spacing_rad)
            }
            Shape::Dome { ground, .. } => return self.dome(ground > 0.0, spacing_rad),
        };
        let all: f64 = patches.iter().map(|patch| patch.steradians).sum();
        let beam =
            |patch: Patch| Beam { direction: patch.direction, irradiance: total.map(|t| t * patch.steradians / all) };
        patches.into_iter().map(beam).collect()
    }

    /// Upper half, and `below` the lower one too.
    fn dome(&self, below: bool, spacing_rad: f64) -> Vec<Beam> {
        let zenith = Aim { azimuth_rad: 0.0, elevation_rad: PI / 2.0 };
        let nadir = Aim { azimuth_rad: 0.0, elevation_rad: -PI / 2.0 };
        let mut patches = quadrature::annulus(&zenith, 0.0, PI / 2.0, spacing_rad);
        if below {
            patches.extend(quadrature::annulus(&nadir, 0.0, PI / 2.0, spacing_rad));
        }
        let beam = |patch: Patch| Beam {
            direction: patch.direction,
            irradiance: self.radiance(&patch.direction).map(|l| l * patch.steradians),
        };
        patches.into_iter().map(beam).collect()
    }

    /// Radiance from a direction: of a dome as it is; of other shapes relative, 1 of their colour, for they are of one radiance.
    ///
    /// A dome has `L(e) = k (h H (1 - sin e) + Z sin e)`, Z and H the colours of zenith and horizon, h the horizon's gain. A patch
    /// facing the zenith gets `integral of L sin e dw = pi k (h H / 3 + 2 Z / 3)`; k makes that `pi 2^stops` for white.
    pub(super) fn radiance(&self, direction: &Vec3) -> [f64; 3] {
        let inside = match self.shape {
            Shape::Directional { .. } => false,
            Shape::Disc { aim, radius_rad } => angle_between(&aim.direction(), direction) <= radius_rad,
            Shape::Ring { aim, inner_rad, outer_rad } => {
                (inner_rad..=outer_rad).contains(&angle_between(&aim.direction(), direction))
            }
            Shape::Softbox { aim, width, height, distance, turn_rad } => {
                let depth = aim.direction().dot(direction);
                let [x, y] = quadrature::sides(&aim, turn_rad).map(|side| side.dot(direction).abs() * distance);
                depth > 0.0 && x <= depth * width / 2.0 && y <= depth * height / 2.0
            }
            Shape::Dome { horizon, horizon_stops, ground } => {
                let h = horizon_stops.exp2();
                let k = self.stops.exp2() / (h / 3.0 + 2.0 / 3.0);
                let up = direction.y;
                return std::array::from_fn(|c| {
                    if up < 0.0 {
                        // A diffuse ground of albedo a under irradiance E has the radiance a E / pi.
                        return ground * k * (h * horizon[c] / 3.0 + 2.0 * self.colour[c] / 3.0);
                    }
                    k * (h * horizon[c] * (1.0 - up) + self.colour[c] * up)
                });
            }
        };
        if inside { self.colour } else { [0.0; 3] }
    }
}

#[cfg(test)]
mod tests;
