//! Fields, maps, backdrops and weights, shared between instances.
//!
//! Once an asset, place and size of plate: the backdrop. Once a plate: its light, and the weights. So tiles of a picture do not
//! make them again.

use std::sync::{Arc, Weak};

use relume_core::field::{Access, Asset};
use relume_core::illumination::{EnvMap, MapCentre};
use relume_core::image::Image as Picture;
use relume_core::matte::{self, Backdrop, Place};
use relume_core::relight::{Look, ScreenRelighter, Weights};

use super::backplate::Grid;
use super::controls::{Beyond, Controls};
use crate::effects::files::{self, Held};
use crate::effects::recent::Recent;
use crate::error::{Error, Result};
use crate::pool::Pool;
use crate::registry::Shelf;

/// How many pictures' weights are kept.
const WEIGHTS_KEPT: usize = 8;
/// How many backdrops are kept: a place that is animated needs one a picture, one that is not the same for all.
const BACKDROPS_KEPT: usize = 4;

/// What the instances share.
#[derive(Default)]
pub struct Library {
    fields: Shelf<ScreenRelighter>,
    maps: Shelf<EnvMap>,
    backdrops: Recent<Spot, Backdrop, BACKDROPS_KEPT>,
    weights: Recent<Origins, Weights, WEIGHTS_KEPT>,
}

/// What one instance owns: the files it used last.
#[derive(Default)]
pub struct Instance {
    field: Held<ScreenRelighter>,
    map: Held<EnvMap>,
}

/// What lies beyond the plate, with its file open.
#[derive(Debug, Clone)]
pub enum Around {
    /// The plate's edge goes on.
    Stretch,
    /// A colour.
    Colour([f32; 3]),
    /// A map, what stands in its middle, and the plate's horizontal angle in degrees.
    Map(Arc<EnvMap>, MapCentre, f64),
}

/// An object in a plate.
#[derive(Debug, Clone, Copy)]
pub struct Scene<'a> {
    pub field: &'a Arc<ScreenRelighter>,
    pub grid: &'a Grid,
    /// In cells of the grid.
    pub place: Place,
    pub around: &'a Around,
    pub look: &'a Look,
}

/// What a backdrop was made from. Files are held weakly: keeping what was made of them must not keep them open.
#[derive(Debug, Clone)]
struct Spot {
    field: Weak<ScreenRelighter>,
    place: Place,
    size: (usize, usize),
}

impl Spot {
    fn of(scene: &Scene<'_>) -> Self {
        Self { field: Arc::downgrade(scene.field), place: scene.place, size: scene.grid.size() }
    }

    fn is(&self, scene: &Scene<'_>) -> bool {
        let same_field = std::ptr::eq(self.field.as_ptr(), Arc::as_ptr(scene.field));
        same_field && self.place == scene.place && self.size == scene.grid.size()
    }
}

/// What weights were made from.
struct Origins {
    spot: Spot,
    look: Look,
    around: Surroundings,
    plate: blake3::Hash,
}

/// [`Around`], held weakly.
enum Surroundings {
    Stretch,
    Colour([f32; 3]),
    Map(Weak<EnvMap>, MapCentre, f64),
}

impl Surroundings {
    fn of(around: &Around) -> Self {
        match around {
            Around::Stretch => Self::Stretch,
            Around::Colour(rgb) => Self::Colour(*rgb),
            Around::Map(map, centre, view_deg) => Self::Map(Arc::downgrade(map), *centre, *view_deg),
        }
    }

    fn is(&self, around: &Around) -> bool {
        match (self, around) {
            (Self::Stretch, Around::Stretch) => true,
            (Self::Colour(a), Around::Colour(b)) => a == b,
            (Self::Map(a, centre_a, view_a), Around::Map(b, centre_b, view_b)) => {
                std::ptr::eq(a.as_ptr(), Arc::as_ptr(b)) && centre_a == centre_b && view_a == view_b
            }
            _ => false,
        }
    }
}

impl Library {
    /// The field of a typed path, open.
    ///
    /// # Errors
    /// No path, a path that cannot be used, a file that is not a good asset of a screen.
    pub fn field(&self, instance: &Instance, typed: &str) -> Result<Arc<ScreenRelighter>> {
        if typed.trim().is_empty() {
            return Err(Error::Missing("Choose an asset: a .rfield file in the Asset parameter."));
        }
        files::open(&self.fields, &instance.field, typed, |path| {
            Ok(ScreenRelighter::new(Asset::open(path, Access::Mapped)?)?)
        })
    }

    /// What lies beyond the plate, read.
    ///
    /// # Errors
    /// A map without a path, with one that cannot be used, or that is no good map.
    pub fn around(&self, instance: &Instance, beyond: &Beyond) -> Result<Around> {
        match beyond {
            Beyond::Stretch => Ok(Around::Stretch),
            Beyond::Colour(rgb) => Ok(Around::Colour(*rgb)),
            Beyond::Map(typed, ..) if typed.trim().is_empty() => Err(Error::Missing(
                "Choose what lies beyond the plate: a lat-long map in the Map beyond parameter, or set Beyond the plate to something else.",
            )),
            Beyond::Map(typed, centre, view_deg) => {
                let map = files::open(&self.maps, &instance.map, typed, |path| Ok(EnvMap::load(path)?))?;
                Ok(Around::Map(map, *centre, *view_deg))
            }
        }
    }

    /// The weights of a plate, made once a plate; `read` gives its pixels.
    ///
    /// # Errors
    /// A representation that the asset does not hold.
    pub fn weights(
        &self,
        scene: &Scene<'_>,
        plate: blake3::Hash,
        read: impl FnOnce() -> Result<Picture>,
    ) -> Result<Arc<Weights>> {
        // A change of what is not part of the weights must find them.
        let look = scene.look.of_weights();
        let fits = |o: &Origins| o.plate == plate && o.look == look && o.spot.is(scene) && o.around.is(scene.around);
        let origins = || Origins { spot: Spot::of(scene), look, around: Surroundings::of(scene.around), plate };
        self.weights.get(fits, origins, || {
            let (backdrop, pixels) = (self.backdrop(scene)?, read()?);
            Pool::shared()?.run(|| {
                let light = lit(&backdrop, &scene.grid.squared(pixels)?, scene.around);
                Ok(scene.field.weights(&light, &look)?)
            })
        })
    }

    fn backdrop(&self, scene: &Scene<'_>) -> Result<Arc<Backdrop>> {
        let field = scene.field;
        let screen = || (field.plane(), field.correspondence());
        let object = (field.asset().width(), field.asset().height());
        let make = || Pool::shared()?.run(|| Ok(Backdrop::new(screen(), object, &scene.place, scene.grid.size())?));
        self.backdrops.get(|spot| spot.is(scene), || Spot::of(scene), make)
    }

    /// Makes the next picture open these files again.
    pub fn forget(&self, instance: &Instance, controls: &Controls) {
        files::forget(&self.fields, &instance.field, &controls.asset);
        if let Beyond::Map(typed, ..) = &controls.beyond {
            files::forget(&self.maps, &instance.map, typed);
        }
    }

    /// Lets go of everything that no instance owns.
    pub fn clear(&self) {
        self.fields.clear();
        self.maps.clear();
        self.backdrops.clear();
        self.weights.clear();
    }
}

/// The light of each texel.
fn lit(backdrop: &Backdrop, plate: &Picture, around: &Around) -> Vec<[f32; 3]> {
    match around {
        Around::Stretch => backdrop.light(plate, matte::Beyond::Stretch),
        Around::Colour(rgb) => backdrop.light(plate, matte::Beyond::Colour(*rgb)),
        Around::Map(map, MapCentre::Front, view_deg) => backdrop.light(plate, matte::Beyond::Map(map, *view_deg)),
        Around::Map(map, centre, view_deg) => {
            backdrop.light(plate, matte::Beyond::Map(&map.oriented(*centre, 0.0), *view_deg))
        }
    }
}
