//! Fields, maps and weights, shared between instances.

use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError, Weak};

use relume_core::field::{Access, Asset};
use relume_core::illumination::{Beam, EnvMap, LightField};
use relume_core::image::Image as Picture;
use relume_core::relight::{Light, Look, Relighter, WIDEST_MAP, Weights};
use relume_core::settings::lighting::{self, Preset};

use super::controls::Controls;
use super::near::{self, Lights, NearFile, Origin as NearOrigin};
use crate::effects::files::{self, Held};
use crate::effects::recent::Recent;
use crate::error::{Error, Result};
use crate::pool::Pool;
use crate::registry::Shelf;

/// How many pictures' weights are kept.
const WEIGHTS_KEPT: usize = 8;

/// A lighting that ships, by name.
type Lamps = (&'static str, Arc<Vec<Beam>>);

/// What the instances share.
#[derive(Default)]
pub struct Library {
    fields: Shelf<Relighter>,
    maps: Shelf<EnvMap>,
    lightings: Shelf<Vec<Beam>>,
    pub(super) near_files: Shelf<NearFile>,
    pub(super) slides: Shelf<Picture>,
    /// Light fields that ship, by name, as far as they were used.
    pub(super) near_presets: Mutex<Vec<(&'static str, Arc<LightField>)>>,
    /// Lightings that ship, by name, as far as they were used.
    presets: Mutex<Vec<Lamps>>,
    weights: Recent<Origins, Weights, WEIGHTS_KEPT>,
}

/// What one instance owns: the files it used last.
#[derive(Default)]
pub struct Instance {
    field: Held<Relighter>,
    map: Held<EnvMap>,
    lighting: Held<Vec<Beam>>,
    pub(super) near_file: Held<NearFile>,
    pub(super) slide: Held<Picture>,
}

/// The light of a picture, owned.
#[derive(Debug, Clone)]
pub enum Lit {
    /// A captured lamp, counted from 1.
    Lamp(usize),
    /// Lamps of a lighting.
    Beams(Arc<Vec<Beam>>),
    /// Light near the object.
    Near(Lights),
    /// A map from a file.
    File(Arc<EnvMap>),
    /// A map from the Illumination clip.
    Clip(Arc<EnvMap>),
}

impl Lit {
    fn light(&self) -> Light<'_> {
        match self {
            Self::Lamp(lamp) => Light::Lamp(*lamp),
            Self::Beams(beams) => Light::Beams(beams),
            Self::Near(lights) if lights.flat => Light::Flat(&*lights.field),
            Self::Near(lights) => Light::Field(&*lights.field),
            Self::File(map) | Self::Clip(map) => Light::Map(map),
        }
    }
}

/// What weights were made from. Files are held weakly: keeping weights must not keep files open.
struct Origins {
    field: Weak<Relighter>,
    look: Look,
    light: Origin,
}

enum Origin {
    Lamp(usize),
    Beams(Weak<Vec<Beam>>),
    Near(NearOrigin, bool),
    File(Weak<EnvMap>),
    Clip(Arc<EnvMap>),
}

impl Origin {
    fn of(light: &Lit) -> Self {
        match light {
            Lit::Lamp(lamp) => Self::Lamp(*lamp),
            Lit::Beams(beams) => Self::Beams(Arc::downgrade(beams)),
            Lit::Near(lights) => Self::Near(lights.origin.clone(), lights.flat),
            Lit::File(map) => Self::File(Arc::downgrade(map)),
            Lit::Clip(map) => Self::Clip(Arc::clone(map)),
        }
    }

    /// A clip's map is compared texel by texel: hosts' identifiers of images are not to be relied on.
    fn is(&self, light: &Lit) -> bool {
        match (self, light) {
            (Self::Lamp(a), Lit::Lamp(b)) => a == b,
            (Self::Beams(a), Lit::Beams(b)) => std::ptr::eq(a.as_ptr(), Arc::as_ptr(b)),
            (Self::Near(a, flat), Lit::Near(b)) => *flat == b.flat && a.is(&b.origin),
            (Self::File(a), Lit::File(b)) => std::ptr::eq(a.as_ptr(), Arc::as_ptr(b)),
            (Self::Clip(a), Lit::Clip(b)) => a == b,
            _ => false,
        }
    }
}

impl Library {
    /// The field of a typed path, open.
    ///
    /// # Errors
    /// No path, a path that cannot be used, a file that is not a good asset.
    pub fn field(&self, instance: &Instance, typed: &str) -> Result<Arc<Relighter>> {
        if typed.trim().is_empty() {
            return Err(Error::Missing("Choose an asset: a .rfield file in the Asset parameter."));
        }
        files::open(&self.fields, &instance.field, typed, |path| {
            Ok(Relighter::new(Asset::open(path, Access::Mapped)?)?)
        })
    }

    /// The environment of a typed path, read.
    ///
    /// # Errors
    /// No path, a path that cannot be used, a file that is not a good map.
    pub fn map(&self, instance: &Instance, typed: &str) -> Result<Arc<EnvMap>> {
        if typed.trim().is_empty() {
            return Err(Error::Missing(
                "Choose an environment: a lat-long map in the Environment parameter, a connected Illumination clip, a Lighting, or a Lamp above 0.",
            ));
        }
        // Reduced once, not for every picture.
        let read = |path: &Path| Ok(EnvMap::load(path)?.reduced(WIDEST_MAP).into_owned());
        files::open(&self.maps, &instance.map, typed, read)
    }

    /// The lamps of a typed lighting file.
    ///
    /// # Errors
    /// A path that cannot be used, a file that is not a good lighting.
    pub fn lighting(&self, instance: &Instance, typed: &str) -> Result<Arc<Vec<Beam>>> {
        files::open(&self.lightings, &instance.lighting, typed, |path| Ok(lighting::load(path)?.lighting.beams()))
    }

    /// The lamps of a lighting that ships.
    ///
    /// # Errors
    /// None in practice: each preset is tested.
    pub fn preset(&self, preset: &'static Preset) -> Result<Arc<Vec<Beam>>> {
        let mut presets = self.presets.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, beams)) = presets.iter().find(|entry| entry.0 == preset.id) {
            return Ok(Arc::clone(beams));
        }
        let beams = Arc::new(preset.load()?.lighting.beams());
        presets.push((preset.id, Arc::clone(&beams)));
        Ok(beams)
    }

    /// The weights of a light, computed once a picture.
    ///
    /// # Errors
    /// A lamp that is not in the set.
    pub fn weights(&self, field: &Arc<Relighter>, light: &Lit, look: &Look) -> Result<Arc<Weights>> {
        // A change of what is not part of the weights must find them.
        let look = look.of_weights();
        let fits =
            |e: &Origins| e.look == look && std::ptr::eq(e.field.as_ptr(), Arc::as_ptr(field)) && e.light.is(light);
        let origins = || Origins { field: Arc::downgrade(field), look, light: Origin::of(light) };
        self.weights.get(fits, origins, || Ok(Pool::shared()?.run(|| field.weights(light.light(), &look))?))
    }

    /// Makes the next picture open these files again.
    pub fn forget(&self, instance: &Instance, controls: &Controls) {
        files::forget(&self.fields, &instance.field, &controls.asset);
        files::forget(&self.maps, &instance.map, &controls.environment);
        files::forget(&self.lightings, &instance.lighting, &controls.lighting_file);
        near::forget(self, instance, &controls.near);
    }

    /// Lets go of everything that no instance owns.
    pub fn clear(&self) {
        self.fields.clear();
        self.maps.clear();
        self.lightings.clear();
        self.near_files.clear();
        self.slides.clear();
        let near_presets = std::mem::take(&mut *self.near_presets.lock().unwrap_or_else(PoisonError::into_inner));
        drop(near_presets);
        let presets = std::mem::take(&mut *self.presets.lock().unwrap_or_else(PoisonError::into_inner));
        drop(presets);
        self.weights.clear();
    }
}
