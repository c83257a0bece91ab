//! The 2D approximation of a light field: what arrives at one point, taken for all of them (figures 7.8 and 7.9).

use std::sync::Arc;

use super::{Emitter, Far, LightField, Source};
use crate::illumination::{Beam, EnvMap};
use crate::math::{Mat3, Vec3};

/// Widest map that is made: what relighting averages maps down to.
const WIDEST: usize = 2048;
/// Narrowest: 0.7 degrees a texel, for windows before maps of few texels.
const NARROWEST: usize = 512;

impl LightField {
    /// What arrives at a point by rays, as beams: what [`LightField::arriving`] says.
    pub fn beams_at(&self, at: &Vec3) -> Vec<Beam> {
        let mut beams = Vec::new();
        self.arriving(at, &mut |direction, irradiance| beams.push(Beam { direction, irradiance }));
        beams
    }

    /// What arrives at a point from the continuum, as a map: its radiance at the middle of each texel. The map is as wide as the widest
    /// one in the field, at least 512 and at most 2048 texels; what turns the field turns the map, its energy kept. `None` without a continuum.
    pub fn map_at(&self, at: &Vec3) -> Option<EnvMap> {
        let width = |source: &Source| match &source.emitter {
            Emitter::Map(map) => Some(map.image().width()),
            Emitter::Probes(probes) => Some(probes.widest()),
            _ => None,
        };
        let width = self.sources.iter().filter_map(width).max()?.clamp(NARROWEST, WIDEST);
        let unturned = Self { sources: self.sources.clone(), turn: Mat3::identity() };
        let from = self.turn.tr_mul(at);
        let map = EnvMap::from_fn(width, width / 2, |d| unturned.radiance(&from, d).map(|l| l as f32));
        Some(if self.turn == Mat3::identity() { map } else { map.rotated(&self.turn) })
    }

    /// The field as if all points were the origin: its beams there for each source under its name, and one map for all of the
    /// continuum.
    pub fn flat(&self) -> Self {
        let mut sources: Vec<Source> = Vec::new();
        for source in self.sources.iter().filter(|source| !source.is_continuum()) {
            let alone = Self { sources: vec![source.clone()], turn: self.turn };
            let beams = alone.beams_at(&Vec3::zeros()).into();
            sources.push(Source::new(source.name.clone(), Emitter::Far(Far { beams })));
        }
        let map = self.map_at(&Vec3::zeros()).map(|map| Source::new("surroundings", Emitter::Map(Arc::new(map))));
        Self::new(sources.into_iter().chain(map).collect())
    }
}
