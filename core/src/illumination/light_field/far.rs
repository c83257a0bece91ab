//! Light from so far away that it is the same everywhere, until something stands before it: suns, and the lamps of lighting files.

use std::f64::consts::PI;
use std::sync::Arc;

use super::{Emitter, SPACING_RAD};
use crate::illumination::lighting::quadrature::annulus;
use crate::illumination::lighting::{Aim, Lamp};
use crate::illumination::{Beam, EnvMap};

/// Beams of a sun whose light comes through a window: so many steps has the penumbra of a slat, before footprints average it.
const SUN_BEAMS: f64 = 32.0;
/// A lamp of more beams than this is a map: every point asks for every beam.
const MOST_BEAMS: usize = 128;
/// Width of such a map: 0.7 degrees a texel, a third of the spacing.
const MAP_WIDTH: usize = 512;

/// Parallel beams.
#[derive(Debug, Clone, PartialEq)]
pub struct Far {
    /// What it consists of.
    pub beams: Arc<[Beam]>,
}

impl Far {
    /// A sun of this angle across, white, of irradiance pi: an even disc. `shadowed`: something is before it, so its disc is cut finely
    /// enough for penumbras (`SUN_BEAMS`); alone, a small disc is one beam.
    pub fn sun(aim: &Aim, diameter_rad: f64, shadowed: bool) -> Self {
        let radius = diameter_rad / 2.0;
        let fine = (2.0 * PI * (1.0 - radius.cos()) / SUN_BEAMS).sqrt().min(SPACING_RAD);
        let mut patches = Vec::new();
        // Below a hundred thousandth of a degree a disc has no solid angle to cut.
        if radius > 1e-7 {
            patches = annulus(aim, 0.0, radius, if shadowed { fine } else { SPACING_RAD });
        }
        let directions = match patches.len() {
            0 | 1 => vec![aim.direction()],
            _ => patches.into_iter().map(|patch| patch.direction).collect(),
        };
        let irradiance = [PI / directions.len() as f64; 3];
        Self { beams: directions.into_iter().map(|direction| Beam { direction, irradiance }).collect() }
    }
}

/// A lamp of a lighting file: as a few beams, or, where it is large, as a map of the same light. `shadowed` as for a [sun](Far::sun).
pub fn far_lamp(lamp: &Lamp, shadowed: bool) -> Emitter {
    let beams = lamp.beams_apart(if shadowed { SPACING_RAD / 4.0 } else { SPACING_RAD });
    if beams.len() <= MOST_BEAMS {
        return Emitter::Far(Far { beams: beams.into() });
    }
    let map = EnvMap::from_fn(MAP_WIDTH, MAP_WIDTH / 2, |d| lamp.radiance(d).map(|l| l as f32));
    // Texels at the rim are in or out as a whole: the sum is put right.
    let total = |c: usize| beams.iter().map(|beam| beam.irradiance[c]).sum::<f64>();
    let found = map.integral();
    let gain = |c: usize| if found[c] > 0.0 { (total(c) / found[c]) as f32 } else { 1.0 };
    Emitter::Map(Arc::new(map.scaled([gain(0), gain(1), gain(2)])))
}
