//! A loaded plugin: its main entry, and the actions that describe it.

use std::ffi::CStr;
use std::path::Path;
use std::sync::{Arc, Mutex};

use libloading::Library;
use tempfile::TempDir;

use super::check;
use super::clip::Clip;
use super::effect::{Effect, Role};
use super::instance::Instance;
use super::log::Rule;
use super::ofx::*;
use super::param::Param;
use super::props::{Prop, PropertySet, Row};
use super::render::Job;
use super::schema::{self, row};
use super::shared::{Scope, Shared, in_scope, lock};

/// How a host uses an effect.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Context {
    /// Makes pictures from nothing.
    Generator,
    /// One input.
    Filter,
    /// Anything.
    General,
}

impl Context {
    /// All three.
    pub const ALL: [Self; 3] = [Self::Generator, Self::Filter, Self::General];

    /// The standard's name.
    pub fn name(self) -> &'static CStr {
        match self {
            Self::Generator => kOfxImageEffectContextGenerator,
            Self::Filter => kOfxImageEffectContextFilter,
            Self::General => kOfxImageEffectContextGeneral,
        }
    }
}

/// A plugin after its Load action. Unloaded, and its library unmapped, when it and all its instances are gone.
#[derive(Clone)]
pub struct Plugin {
    core: Arc<Core>,
}

/// What instances need of their plugin.
pub struct Core {
    pub shared: Arc<Shared>,
    plugin: *const OfxPlugin,
    path: String,
    described: Mutex<Option<Arc<Effect>>>,
    /// Unmapped after Unload: fields are dropped after `drop`.
    _library: Option<(Library, Option<TempDir>)>,
}

// SAFETY: the plugin struct is constant, and the standard lets hosts call the main entry from any thread.
unsafe impl Send for Core {}
// SAFETY: as above.
unsafe impl Sync for Core {}

impl Core {
    /// Calls the main entry, with this thread marked as being in the action.
    pub fn act<H>(&self, action: &CStr, handle: *mut H, args: (Args, Args), job: Option<Arc<Job>>) -> OfxStatus {
        let (inputs, outputs) = (args.0.map_or(std::ptr::null_mut(), |set| set.handle()), args.1);
        let outputs = outputs.map_or(std::ptr::null_mut(), |set| set.handle());
        let scope = Scope { shared: Arc::clone(&self.shared), action: name(action), job };
        // SAFETY: the struct lives as long as the library, which `self` holds; the arguments are as the standard says.
        in_scope(scope, || unsafe {
            (*self.plugin)
                .mainEntry
                .map_or(kOfxStatErrFatal, |entry| entry(action.as_ptr(), handle.cast(), inputs, outputs))
        })
    }

    /// Property sets for the arguments of one action.
    pub fn args(&self, label: &str, rows: Vec<Row>) -> Arc<PropertySet> {
        PropertySet::new(&self.shared, label, rows)
    }

    /// An action that must answer an explicit OK.
    pub fn must<H>(&self, action: &CStr, handle: *mut H, inputs: Args) -> bool {
        let status = self.act(action, handle, (inputs, None), None);
        self.expect(action, status, &[kOfxStatOK])
    }

    /// Records an answer that is none of these.
    pub fn expect(&self, action: &CStr, status: OfxStatus, legal: &[OfxStatus]) -> bool {
        let fine = legal.contains(&status);
        if !fine {
            let legal: Vec<_> = legal.iter().map(|&status| status_name(status)).collect();
            let what = format!("{} answered {}, not {}", name(action), status_name(status), legal.join(" or "));
            self.shared.violate(Rule::Status, what);
        }
        fine
    }
}

/// The arguments of an action, or NULL.
pub type Args<'a> = Option<&'a PropertySet>;

impl Drop for Core {
    fn drop(&mut self) {
        if let Some(effect) = lock(&self.described).take() {
            effect.close();
        }
        self.must::<()>(kOfxActionUnload, std::ptr::null_mut(), None);
    }
}

impl Plugin {
    /// Checks the plugin struct, sets the host, and runs Load.
    pub(super) fn start(
        shared: &Arc<Shared>,
        host: &'static OfxHost,
        plugin: *const OfxPlugin,
        path: &Path,
        library: Option<(Library, Option<TempDir>)>,
    ) -> Result<Self, String> {
        // SAFETY: the library that owns the struct is mapped, and stays so in `library`.
        let head = unsafe { &*plugin };
        // SAFETY: the standard makes these NUL-terminated texts.
        let (api, id) = unsafe { (text(head.pluginApi), text(head.pluginIdentifier)) };
        if api.as_deref() != kOfxImageEffectPluginApi.to_str().ok() || head.apiVersion != 1 {
            return Err(format!("the plugin is of the API {api:?} {}", head.apiVersion));
        }
        if id.is_none_or(|id| id.is_empty() || !id.is_ascii()) {
            shared.violate(Rule::Missing, "the plugin has no identifier");
        }
        let set_host = head.setHost.ok_or("the plugin has no setHost")?;
        // SAFETY: the host lives for ever, and plugins do not write to it.
        unsafe { set_host(std::ptr::from_ref(host).cast_mut()) };
        let path = path.display().to_string();
        let core = Core { shared: Arc::clone(shared), plugin, path, described: Mutex::default(), _library: library };
        let plugin = Self { core: Arc::new(core) };
        if plugin.load_again() { Ok(plugin) } else { Err("the action Load failed".into()) }
    }

    /// The plugin's identifier.
    pub fn identifier(&self) -> String {
        // SAFETY: the struct lives as long as the library, which `self` holds.
        unsafe { text((*self.core.plugin).pluginIdentifier) }.unwrap_or_default()
    }

    /// Runs Load (once more: loading runs it by itself). Whether it answered OK.
    pub fn load_again(&self) -> bool {
        self.core.must::<()>(kOfxActionLoad, std::ptr::null_mut(), None)
    }

    /// Runs Unload without unmapping anything; [`Self::load_again`] must follow. Whether it answered OK.
    pub fn unload(&self) -> bool {
        self.core.must::<()>(kOfxActionUnload, std::ptr::null_mut(), None)
    }

    /// Runs the general Describe anew, and checks it.
    pub fn describe_general(&self) -> Description {
        Description { core: Arc::clone(&self.core), effect: self.describe_effect() }
    }

    fn describe_effect(&self) -> Arc<Effect> {
        let rows = schema::descriptor(&self.core.path, None);
        let effect = Effect::new(&self.core.shared, Role::Descriptor, rows);
        if self.core.must(kOfxActionDescribe, effect.handle(), None) {
            check::described(&effect);
        }
        effect
    }

    fn general_rows(&self) -> Vec<Row> {
        lock(&self.core.described).get_or_insert_with(|| self.describe_effect()).props.rows()
    }

    /// Describes the effect in a context, and checks it.
    pub fn describe(&self, context: Context) -> Description {
        let core = &self.core;
        let mut rows = self.general_rows();
        let in_context = name(context.name());
        rows.extend(
            schema::descriptor(&core.path, Some(&in_context))
                .into_iter()
                .filter(|(name, _)| name == "OfxImageEffectPropContext"),
        );
        let effect = Effect::new(&core.shared, Role::InContext, rows);
        let args = core
            .args("arguments of DescribeInContext", vec![row(kOfxImageEffectPropContext, Prop::text(context.name()))]);
        if core.must(kOfxImageEffectActionDescribeInContext, effect.handle(), Some(&args)) {
            check::described_in(&effect, context);
        }
        args.close();
        Description { core: Arc::clone(core), effect }
    }

    /// Makes an instance, with every parameter at its default.
    ///
    /// # Errors
    /// When CreateInstance did not answer OK.
    pub fn create(&self, context: Context) -> Result<Instance, String> {
        let description = self.describe(context);
        Instance::create(&self.core, &description.effect, context, self.core.plugin as usize)
    }
}

/// What a plugin said about itself.
pub struct Description {
    /// The plugin stays loaded as long.
    #[expect(dead_code, reason = "held, not read")]
    core: Arc<Core>,
    effect: Arc<Effect>,
}

impl Drop for Description {
    fn drop(&mut self) {
        self.effect.close();
    }
}

impl Description {
    /// Texts of a property of the effect.
    pub fn texts(&self, property: &CStr) -> Vec<String> {
        self.effect.props.texts(property)
    }

    /// Numbers of a property of the effect.
    pub fn numbers(&self, property: &CStr) -> Vec<f64> {
        self.effect.props.numbers(property)
    }

    /// The names of the parameters, in the order of their definition.
    pub fn params(&self) -> Vec<String> {
        lock(&self.effect.params).iter().map(|param| param.name.clone()).collect()
    }

    /// The names of the clips, in the order of their definition.
    pub fn clips(&self) -> Vec<String> {
        lock(&self.effect.clips).iter().map(|clip| clip.name.clone()).collect()
    }

    fn param(&self, param: &str) -> Arc<Param> {
        self.effect.param(param).unwrap_or_else(|| panic!("there is no parameter {param:?}"))
    }

    fn clip(&self, clip: &str) -> Arc<Clip> {
        self.effect.clip(clip).unwrap_or_else(|| panic!("there is no clip {clip:?}"))
    }

    /// The kind of a parameter, `OfxParamTypeDouble` and its like.
    ///
    /// # Panics
    /// When there is none of that name; so do all functions here.
    pub fn param_kind(&self, param: &str) -> String {
        self.param(param).kind.clone()
    }

    /// Texts of a property of a parameter.
    pub fn param_texts(&self, param: &str, property: &CStr) -> Vec<String> {
        self.param(param).props.texts(property)
    }

    /// Numbers of a property of a parameter.
    pub fn param_numbers(&self, param: &str, property: &CStr) -> Vec<f64> {
        self.param(param).props.numbers(property)
    }

    /// Texts of a property of a clip.
    pub fn clip_texts(&self, clip: &str, property: &CStr) -> Vec<String> {
        self.clip(clip).props.texts(property)
    }

    /// Numbers of a property of a clip.
    pub fn clip_numbers(&self, clip: &str, property: &CStr) -> Vec<f64> {
        self.clip(clip).props.numbers(property)
    }
}
