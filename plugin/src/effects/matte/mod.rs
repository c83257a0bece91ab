//! Relume Environment Matte: puts an object that was captured in front of a screen before a moving plate, which it reflects,
//! refracts and lets through (6.2, 6.6.4).
//!
//! Contexts Filter and General. Clips: `Source`, the plate, which takes the place of the screen frame by frame; `Output`,
//! premultiplied RGBA. Parameters are the settings table of the core, so the command line means the same.
//!
//! The object's picture has one canonical unit (a square pixel at full scale) to its pixel, its middle on the middle of the
//! plate, then scaled, turned and moved. The light of the screen is made from the whole plate, however small the window that is
//! asked for. A smaller render scale means a smaller plate and an object that is placed smaller in it.
//!
//! | file | what it does |
//! |---|---|
//! | `describe` | clips, parameters and promises |
//! | `controls` | what the artist set, at a time |
//! | `backplate` | Source as a plate of square pixels |
//! | `library` | fields, maps, backdrops and weights, shared between instances |
//! | `regions` | region of definition, regions of interest |
//! | `render` | the picture |
//! | `status` | what is loaded, in words |

mod backplate;
mod controls;
mod describe;
mod library;
mod regions;
mod render;
mod status;

use std::ffi::CStr;
use std::sync::LazyLock;

use super::SOURCE;
use super::instances::Instances;
use crate::host::{Action, Call, Clip, Effect, Exported, Handler, Reply};
use crate::pool::Pool;
use library::{Instance, Library};
use status::Voice;

/// The plate, if something is plugged in.
fn source<'a>(effect: &Effect<'a>) -> Option<Clip<'a>> {
    effect.clip(SOURCE).filter(|clip| clip.connected())
}

static MATTE: LazyLock<EnvironmentMatte> = LazyLock::new(EnvironmentMatte::default);

/// The effect, with what its instances share.
#[derive(Default)]
pub struct EnvironmentMatte {
    library: Library,
    instances: Instances<Instance>,
}

impl EnvironmentMatte {
    fn voice<'a>(&'a self, instance: &'a Instance) -> Voice<'a> {
        Voice { library: &self.library, instance }
    }
}

impl Handler for EnvironmentMatte {
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
            Action::RegionOfDefinition => regions::definition(call),
            Action::RegionsOfInterest => regions::interest(call),
            Action::ClipPreferences => super::regions::preferences(call),
            Action::Render => render::render(&self.library, &self.instances.of(call), call),
            Action::Bracket => Reply::Ok,
            Action::Load | Action::Unload | Action::PurgeCaches | Action::Other => Reply::Default,
        }
    }
}

impl Exported for EnvironmentMatte {
    const IDENTIFIER: &'static CStr = c"org.relume.EnvironmentMatte";
    const VERSION: (u32, u32) = (1, 0);

    fn get() -> &'static dyn Handler {
        &*MATTE
    }
}
