//! Relume Relight: lights a captured object with an environment, and composites it over a plate.
//!
//! Contexts Generator (no plate), Filter and General. Clips: `Source`, the plate; `Illumination`, a lat-long map that
//! takes the place of the environment file (Generator and General, for there hosts know optional clips);
//! `Output`, premultiplied RGBA. Parameters are the settings table of the core, so the command line means the same.
//!
//! Light comes from the Illumination clip if it is connected, else from the lamp above 0, else from the lighting file, else
//! from the lighting that ships, else from the environment file.
//!
//! The element has the asset's size in canonical coordinates (square pixels at full scale). It is centred on the
//! region of definition of Source, which is then also the output's; without a Source it makes its own format from the
//! origin up ([`placement`]). Smaller render scales are made by area from the full-size element ([`crate::area`]).
//!
//! | file | what it does |
//! |---|---|
//! | `describe` | clips, parameters and promises |
//! | `controls` | what the artist set, at a time |
//! | `assets` | fields, maps and weights, shared between instances |
//! | `placement` | where the element lies |
//! | `regions` | region of definition, regions of interest, clip preferences |
//! | `render` | the picture |
//! | `status` | the line of text that says what is loaded |

mod assets;
mod controls;
mod describe;
mod placement;
mod regions;
mod render;
mod status;

use std::collections::HashMap;
use std::ffi::{CStr, CString};
use std::sync::{Arc, LazyLock, Mutex, MutexGuard, PoisonError};

use crate::host::names::{kOfxImageEffectContextFilter, kOfxImageEffectContextGenerator, kOfxImageEffectPropContext};
use crate::host::{Action, Call, Clip, Effect, Exported, Handler, Reply};
use crate::pool::Pool;
use assets::{Held, Library};

/// The clip of the plate.
const SOURCE: &CStr = c"Source";
/// The clip of the lat-long map.
const ILLUMINATION: &CStr = c"Illumination";
/// The clip of the picture.
const OUTPUT: &CStr = c"Output";

/// Is a clip of this name defined in this context? Source stands wherever there can be a plate; Illumination where hosts
/// know optional clips.
fn defines(context: &CStr, clip: &CStr) -> bool {
    let but = if clip == SOURCE { kOfxImageEffectContextGenerator } else { kOfxImageEffectContextFilter };
    clip == OUTPUT || context != but
}

/// A clip of an instance, if its context has it and something is plugged in. Asking for a clip that was not defined is an
/// error that some hosts report.
fn input<'a>(effect: &Effect<'a>, name: &CStr) -> Option<Clip<'a>> {
    declared(effect, name).filter(|clip| clip.connected())
}

/// A clip of an instance, if its context has it.
fn declared<'a>(effect: &Effect<'a>, name: &CStr) -> Option<Clip<'a>> {
    let context = effect.properties().and_then(|p| p.string(kOfxImageEffectPropContext, 0));
    let context = context.and_then(|context| CString::new(context).ok());
    // A host that does not say leaves only asking.
    context.is_none_or(|context| defines(&context, name)).then(|| effect.clip(name)).flatten()
}

static RELIGHT: LazyLock<Relight> = LazyLock::new(Relight::default);

/// The effect, with what its instances share.
#[derive(Default)]
pub struct Relight {
    library: Library,
    /// By the host's handle. Not in the host's own instance data: a render can still run while a careless host destroys
    /// the instance, and then holds its share of it.
    instances: Mutex<HashMap<usize, Arc<Instance>>>,
}

/// What one instance owns: the files it used last.
#[derive(Default)]
pub struct Instance {
    held: Mutex<Held>,
}

impl Relight {
    fn instances(&self) -> MutexGuard<'_, HashMap<usize, Arc<Instance>>> {
        self.instances.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The instance of a call; one that was never announced gets a passing one.
    fn instance(&self, call: &Call<'_>) -> Arc<Instance> {
        self.instances().get(&call.effect.key()).cloned().unwrap_or_default()
    }

    fn create(&self, call: &Call<'_>) -> Reply {
        let instance = Arc::new(Instance::default());
        self.instances().insert(call.effect.key(), Arc::clone(&instance));
        status::created(&self.library, &instance, call);
        Reply::Ok
    }

    fn destroy(&self, call: &Call<'_>) -> Reply {
        let gone = self.instances().remove(&call.effect.key());
        drop(gone);
        Reply::Ok
    }
}

impl Handler for Relight {
    fn load(&self) {}

    fn unload(&self) {
        let instances = std::mem::take(&mut *self.instances());
        drop(instances);
        self.library.clear();
        Pool::shut_down();
    }

    fn purge(&self) {
        self.library.clear();
    }

    fn call(&self, call: &Call<'_>) -> Reply {
        match call.action {
            Action::Describe => describe::describe(call),
            Action::DescribeInContext => describe::describe_in_context(call),
            Action::CreateInstance => self.create(call),
            Action::DestroyInstance => self.destroy(call),
            Action::InstanceChanged => status::changed(&self.library, &self.instance(call), call),
            Action::RegionOfDefinition => regions::definition(&self.library, &self.instance(call), call),
            Action::RegionsOfInterest => regions::interest(call),
            Action::ClipPreferences => regions::preferences(call),
            Action::Render => render::render(&self.library, &self.instance(call), call),
            Action::Bracket => Reply::Ok,
            Action::Load | Action::Unload | Action::PurgeCaches | Action::Other => Reply::Default,
        }
    }
}

impl Exported for Relight {
    const IDENTIFIER: &'static CStr = c"org.relume.Relight";
    const VERSION: (u32, u32) = (1, 0);

    fn get() -> &'static dyn Handler {
        &*RELIGHT
    }
}
