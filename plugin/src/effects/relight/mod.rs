//! Relume Relight: lights a captured object with an environment, and composites it over a plate.
//!
//! Contexts Generator (no plate), Filter and General. Clips: `Source`, the plate; `Illumination`, a lat-long map that
//! takes the place of the environment file (Generator and General, for there hosts know optional clips);
//! `Output`, premultiplied RGBA. Parameters are the settings table of the core, so the command line means the same.
//!
//! Light comes from the Illumination clip if it is connected, else from the lamp above 0, else from what is near the object (the
//! light file, else the light field that ships, else beams and slide that are on), else from the lighting file, else from the
//! lighting that ships, else from the environment file.
//!
//! The element has the asset's size in canonical coordinates (square pixels at full scale). It is centred on the
//! region of definition of Source, which is then also the output's; without a Source it makes its own format from the
//! origin up ([`placement`](super::placement)). Smaller render scales are made by area from the full-size element ([`crate::area`]).
//!
//! | file | what it does |
//! |---|---|
//! | `describe` | clips, parameters and promises |
//! | `controls` | what the artist set, at a time |
//! | `library` | fields, maps and weights, shared between instances |
//! | `near` | light near the object, from files and from parameters |
//! | `regions` | region of definition, regions of interest |
//! | `render` | the picture |
//! | `status` | what is loaded, in words |

mod controls;
mod describe;
mod library;
mod near;
mod regions;
mod render;
mod status;

use std::ffi::{CStr, CString};
use std::sync::LazyLock;

use super::instances::Instances;
use super::{OUTPUT, SOURCE};
use crate::host::names::{kOfxImageEffectContextFilter, kOfxImageEffectContextGenerator, kOfxImageEffectPropContext};
use crate::host::{Action, Call, Clip, Effect, Exported, Handler, Reply};
use crate::pool::Pool;
use library::{Instance, Library};
use status::Voice;

/// The clip of the lat-long map.
const ILLUMINATION: &CStr = c"Illumination";

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
    instances: Instances<Instance>,
}

impl Relight {
    fn voice<'a>(&'a self, instance: &'a Instance) -> Voice<'a> {
        Voice { library: &self.library, instance }
    }
}

impl Handler for Relight {
    fn load(&self) {}

    fn unload(&self) {
        self.instances.clear();
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
            Action::CreateInstance => {
                let instance = self.instances.create(call);
                super::status::created(&self.voice(&instance), call);
                Reply::Ok
            }
            Action::DestroyInstance => {
                self.instances.destroy(call);
                Reply::Ok
            }
            Action::InstanceChanged => super::status::changed(&self.voice(&self.instances.of(call)), call),
            Action::RegionOfDefinition => regions::definition(&self.library, &self.instances.of(call), call),
            Action::RegionsOfInterest => regions::interest(call),
            Action::ClipPreferences => super::regions::preferences(call),
            Action::Render => render::render(&self.library, &self.instances.of(call), call),
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
