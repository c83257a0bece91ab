//! Fields, maps and weights, shared between instances.
//!
//! Everything that can use rayon runs on our own threads ([`Pool`]); locks are taken on the host's thread alone.

use std::collections::VecDeque;
use std::path::Path;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};

use relume_core::field::{Access, Asset};
use relume_core::illumination::{Beam, EnvMap};
use relume_core::relight::{Light, Look, Relighter, WIDEST_MAP, Weights};
use relume_core::settings::lighting::{self, Preset};

use super::Instance;
use super::controls::Controls;
use crate::error::{Error, Result};
use crate::paths;
use crate::pool::Pool;
use crate::registry::{Shelf, Stamp};

/// How many pictures' weights are kept: hosts ask for a picture tile by tile, and for a few pictures at once.
const WEIGHTS_KEPT: usize = 8;

/// A lighting that ships, by name.
type Lamps = (&'static str, Arc<Vec<Beam>>);

/// What the instances share.
#[derive(Default)]
pub struct Library {
    fields: Shelf<Relighter>,
    maps: Shelf<EnvMap>,
    lightings: Shelf<Vec<Beam>>,
    /// Lightings that ship, by name, as far as they were used.
    presets: Mutex<Vec<Lamps>>,
    /// Latest first.
    weights: Mutex<VecDeque<Entry>>,
    /// Held while weights are computed: threads that render tiles of one picture would all compute them, and the first
    /// projection of a map takes a second.
    computing: Mutex<()>,
}

/// The files one instance used last; they stay open with it.
#[derive(Default)]
pub struct Held {
    field: Option<Arc<Relighter>>,
    map: Option<Arc<EnvMap>>,
    lighting: Option<Arc<Vec<Beam>>>,
}

/// The light of a picture, owned.
#[derive(Debug, Clone)]
pub enum Lit {
    /// A captured lamp, counted from 1.
    Lamp(usize),
    /// Lamps of a lighting.
    Beams(Arc<Vec<Beam>>),
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
            Self::File(map) | Self::Clip(map) => Light::Map(map),
        }
    }
}

/// Weights with what they were made from. Files are held weakly: keeping weights must not keep files open.
struct Entry {
    field: Weak<Relighter>,
    look: Look,
    light: Origin,
    weights: Arc<Weights>,
}

enum Origin {
    Lamp(usize),
    Beams(Weak<Vec<Beam>>),
    File(Weak<EnvMap>),
    Clip(Arc<EnvMap>),
}

impl Origin {
    fn of(light: &Lit) -> Self {
        match light {
            Lit::Lamp(lamp) => Self::Lamp(*lamp),
            Lit::Beams(beams) => Self::Beams(Arc::downgrade(beams)),
            Lit::File(map) => Self::File(Arc::downgrade(map)),
            Lit::Clip(map) => Self::Clip(Arc::clone(map)),
        }
    }

    /// A clip's map is compared texel by texel: hosts' identifiers of images are not to be relied on.
    fn is(&self, light: &Lit) -> bool {
        match (self, light) {
            (Self::Lamp(a), Lit::Lamp(b)) => a == b,
            (Self::Beams(a), Lit::Beams(b)) => std::ptr::eq(a.as_ptr(), Arc::as_ptr(b)),
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
        let path = paths::expand(typed)?;
        let open = || Pool::shared()?.run(|| Ok(Relighter::new(Asset::open(&path, Access::Mapped)?)?));
        let field = self.fields.get(&Stamp::of(&path)?, open)?;
        let before = instance.held().field.replace(Arc::clone(&field));
        drop(before);
        Ok(field)
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
        let path = paths::expand(typed)?;
        // Reduced once, not for every picture.
        let open = || Pool::shared()?.run(|| Ok(EnvMap::load(&path)?.reduced(WIDEST_MAP).into_owned()));
        let map = self.maps.get(&Stamp::of(&path)?, open)?;
        let before = instance.held().map.replace(Arc::clone(&map));
        drop(before);
        Ok(map)
    }

    /// The lamps of a typed lighting file.
    ///
    /// # Errors
    /// A path that cannot be used, a file that is not a good lighting.
    pub fn lighting(&self, instance: &Instance, typed: &str) -> Result<Arc<Vec<Beam>>> {
        let path = paths::expand(typed)?;
        let beams = self.lightings.get(&Stamp::of(&path)?, || Ok(lighting::load(&path)?.lighting.beams()))?;
        let before = instance.held().lighting.replace(Arc::clone(&beams));
        drop(before);
        Ok(beams)
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
            |e: &Entry| e.look == look && std::ptr::eq(e.field.as_ptr(), Arc::as_ptr(field)) && e.light.is(light);
        let find = || self.entries().iter().find(|e| fits(e)).map(|e| Arc::clone(&e.weights));
        if let Some(weights) = find() {
            return Ok(weights);
        }
        let _computing = self.computing.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(weights) = find() {
            return Ok(weights);
        }
        let weights = Arc::new(Pool::shared()?.run(|| field.weights(light.light(), &look))?);
        let entry =
            Entry { field: Arc::downgrade(field), look, light: Origin::of(light), weights: Arc::clone(&weights) };
        let mut entries = self.entries();
        entries.push_front(entry);
        entries.truncate(WEIGHTS_KEPT);
        Ok(weights)
    }

    /// Makes the next picture open these files again.
    pub fn forget(&self, instance: &Instance, controls: &Controls) {
        *instance.held() = Held::default();
        let expand = |typed: &str| paths::expand(typed).ok();
        expand(&controls.asset).iter().for_each(|path: &std::path::PathBuf| self.fields.forget(path));
        expand(&controls.environment).iter().for_each(|path| self.maps.forget(path));
        expand(&controls.lighting_file).iter().for_each(|path| self.lightings.forget(path));
    }

    /// Lets go of everything that no instance owns.
    pub fn clear(&self) {
        self.fields.clear();
        self.maps.clear();
        self.lightings.clear();
        let presets = std::mem::take(&mut *self.presets.lock().unwrap_or_else(PoisonError::into_inner));
        drop(presets);
        let entries = std::mem::take(&mut *self.entries());
        drop(entries);
    }

    fn entries(&self) -> MutexGuard<'_, VecDeque<Entry>> {
        self.weights.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Instance {
    fn held(&self) -> MutexGuard<'_, Held> {
        self.held.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The last part of a typed path, for the status line.
pub fn file_name(typed: &str) -> String {
    paths::expand(typed)
        .ok()
        .as_deref()
        .and_then(Path::file_name)
        .map_or_else(|| typed.to_owned(), |name| name.to_string_lossy().into_owned())
}
