//! One call of the host: action, handle, arguments. Panics end here.

use std::ffi::{CStr, c_char, c_void};
use std::panic::{AssertUnwindSafe, catch_unwind};

use openfx::sys::generic::core::*;
use openfx::sys::image_effect_v1::image_effect::*;

use super::{Effect, Properties, Suites};

/// What the host wants.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Action {
    /// The library was loaded.
    Load,
    /// The library is about to be unmapped.
    Unload,
    /// Describe what holds in every context.
    Describe,
    /// Describe clips and parameters of one context.
    DescribeInContext,
    /// An instance came to be.
    CreateInstance,
    /// An instance goes.
    DestroyInstance,
    /// A parameter or clip changed.
    InstanceChanged,
    /// Memory is short.
    PurgeCaches,
    /// Which area has pixels.
    RegionOfDefinition,
    /// Which area of each input is needed.
    RegionsOfInterest,
    /// Components, depth and alpha of the output.
    ClipPreferences,
    /// Make a picture.
    Render,
    /// Brackets around changes and renders, which need nothing from us.
    Bracket,
    /// Anything else.
    Other,
}

impl Action {
    fn named(name: &CStr) -> Self {
        match name.to_bytes() {
            n if n == kOfxActionLoad.to_bytes() => Self::Load,
            n if n == kOfxActionUnload.to_bytes() => Self::Unload,
            n if n == kOfxActionDescribe.to_bytes() => Self::Describe,
            n if n == kOfxImageEffectActionDescribeInContext.to_bytes() => Self::DescribeInContext,
            n if n == kOfxActionCreateInstance.to_bytes() => Self::CreateInstance,
            n if n == kOfxActionDestroyInstance.to_bytes() => Self::DestroyInstance,
            n if n == kOfxActionInstanceChanged.to_bytes() => Self::InstanceChanged,
            n if n == kOfxActionPurgeCaches.to_bytes() => Self::PurgeCaches,
            n if n == kOfxImageEffectActionGetRegionOfDefinition.to_bytes() => Self::RegionOfDefinition,
            n if n == kOfxImageEffectActionGetRegionsOfInterest.to_bytes() => Self::RegionsOfInterest,
            n if n == kOfxImageEffectActionGetClipPreferences.to_bytes() => Self::ClipPreferences,
            n if n == kOfxImageEffectActionRender.to_bytes() => Self::Render,
            n if [kOfxActionBeginInstanceChanged, kOfxActionEndInstanceChanged].iter().any(|b| b.to_bytes() == n) => {
                Self::Bracket
            }
            n if [kOfxImageEffectActionBeginSequenceRender, kOfxImageEffectActionEndSequenceRender]
                .iter()
                .any(|b| b.to_bytes() == n) =>
            {
                Self::Bracket
            }
            _ => Self::Other,
        }
    }
}

/// What we answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reply {
    /// Done.
    Ok,
    /// Not ours: the host does what it does by default.
    Default,
    /// It failed, and a message says why.
    Failed,
}

impl From<Reply> for OfxStatus {
    fn from(reply: Reply) -> Self {
        match reply {
            Reply::Ok => kOfxStatOK,
            Reply::Default => kOfxStatReplyDefault,
            Reply::Failed => kOfxStatFailed,
        }
    }
}

/// One call about an effect.
pub struct Call<'a> {
    /// What the host wants.
    pub action: Action,
    /// What it is about.
    pub effect: Effect<'a>,
    /// Arguments.
    pub args: Option<Properties<'a>>,
    /// Where answers go.
    pub answers: Option<Properties<'a>>,
}

/// One effect of the library.
pub trait Handler: Sync {
    /// The library was loaded, perhaps not for the first time.
    fn load(&self);
    /// The library is about to be unmapped: no thread and no file may stay.
    fn unload(&self);
    /// Drops what can be made again.
    fn purge(&self);
    /// A call about a descriptor or an instance.
    fn call(&self, call: &Call<'_>) -> Reply;
}

/// A [`Handler`] that the library exports.
pub trait Exported: Handler {
    /// Permanent id: projects store it.
    const IDENTIFIER: &'static CStr;
    /// Major and minor version; projects store the major one.
    const VERSION: (u32, u32);
    /// The one there is.
    fn get() -> &'static dyn Handler;
}

/// The struct by which the host gets to know an effect.
pub const fn plugin<E: Exported>() -> OfxPlugin {
    OfxPlugin {
        pluginApi: kOfxImageEffectPluginApi.as_ptr(),
        apiVersion: 1,
        pluginIdentifier: E::IDENTIFIER.as_ptr(),
        pluginVersionMajor: E::VERSION.0,
        pluginVersionMinor: E::VERSION.1,
        setHost: Some(set_host),
        mainEntry: Some(main_entry::<E>),
    }
}

unsafe extern "C" fn set_host(host: *mut OfxHost) {
    super::suites::set_host(host);
}

unsafe extern "C" fn main_entry<E: Exported>(
    action: *const c_char,
    handle: *const c_void,
    args: OfxPropertySetHandle,
    answers: OfxPropertySetHandle,
) -> OfxStatus {
    // SAFETY: the host calls this with the arguments of a main entry.
    unsafe { dispatch(E::get, action, handle, args, answers) }
}

/// Turns the host's raw call into a safe one; a panic becomes `kOfxStatFailed`.
///
/// # Safety
/// The pointers must be what an OpenFX host passes to a main entry: a NUL-terminated action, and handles that live for
/// the length of the call or are NULL.
unsafe fn dispatch(
    get: fn() -> &'static dyn Handler,
    action: *const c_char,
    handle: *const c_void,
    args: OfxPropertySetHandle,
    answers: OfxPropertySetHandle,
) -> OfxStatus {
    if action.is_null() {
        return kOfxStatFailed;
    }
    // SAFETY: not NULL, and NUL-terminated by the contract above.
    let action = Action::named(unsafe { CStr::from_ptr(action) });
    let handled = catch_unwind(AssertUnwindSafe(|| {
        let handler = get();
        match (action, Suites::get()) {
            (Action::Unload, _) => {
                handler.unload();
                super::forget_suites();
                kOfxStatOK
            }
            (_, None) => kOfxStatErrMissingHostFeature,
            (Action::Load, Some(_)) => {
                handler.load();
                kOfxStatOK
            }
            (Action::PurgeCaches, Some(_)) => {
                handler.purge();
                kOfxStatOK
            }
            (_, Some(suites)) => {
                let Some(effect) = Effect::new(&suites, handle.cast_mut().cast()) else { return kOfxStatErrBadHandle };
                let (args, answers) = (Properties::new(&suites, args), Properties::new(&suites, answers));
                handler.call(&Call { action, effect, args, answers }).into()
            }
        }
    }));
    handled.unwrap_or_else(|payload| {
        // A payload can itself panic when dropped; leaking a few bytes after a bug is the safer end.
        std::mem::forget(payload);
        kOfxStatFailed
    })
}
