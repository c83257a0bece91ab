//! Effects: a descriptor while describing, an instance afterwards.

use std::ffi::{CStr, c_void};

use openfx::sys::generic::core::kOfxStatOK;
use openfx::sys::image_effect_v1::image_effect::OfxImageEffectHandle;
use openfx::sys::image_effect_v1::message::kOfxMessageError;

use super::{Clip, Params, Properties, Suites, c_text};

/// Identifies our messages in hosts that offer to silence them.
const MESSAGE_ID: &CStr = c"org.relume.message";

/// An effect of the host, for the length of one call.
#[derive(Clone, Copy)]
pub struct Effect<'a> {
    suites: &'a Suites,
    handle: OfxImageEffectHandle,
}

impl<'a> Effect<'a> {
    /// Wraps a handle; `None` for NULL.
    pub(super) fn new(suites: &'a Suites, handle: OfxImageEffectHandle) -> Option<Self> {
        (!handle.is_null()).then_some(Self { suites, handle })
    }

    /// Tells instances apart while they live.
    pub fn key(&self) -> usize {
        self.handle as usize
    }

    /// Its properties.
    pub fn properties(&self) -> Option<Properties<'a>> {
        let get = self.suites.effect.getPropertySet?;
        let mut set = std::ptr::null_mut();
        // SAFETY: the handle is live for this call of the host; the out-pointer is ours.
        let status = unsafe { get(self.handle, &mut set) };
        (status == kOfxStatOK).then(|| Properties::new(self.suites, set)).flatten()
    }

    /// Its parameters.
    pub fn params(&self) -> Option<Params<'a>> {
        let get = self.suites.effect.getParamSet?;
        let mut set = std::ptr::null_mut();
        // SAFETY: as in `properties`.
        let status = unsafe { get(self.handle, &mut set) };
        (status == kOfxStatOK).then(|| Params::new(self.suites, set)).flatten()
    }

    /// Defines a clip while describing.
    pub fn define_clip(&self, name: &CStr) -> Option<Properties<'a>> {
        let define = self.suites.effect.clipDefine?;
        let mut set = std::ptr::null_mut();
        // SAFETY: as in `properties`; the name ends in NUL.
        let status = unsafe { define(self.handle, name.as_ptr(), &mut set) };
        (status == kOfxStatOK).then(|| Properties::new(self.suites, set)).flatten()
    }

    /// A clip of an instance; `None` where the context has none of this name.
    pub fn clip(&self, name: &CStr) -> Option<Clip<'a>> {
        let get = self.suites.effect.clipGetHandle?;
        let (mut clip, mut set) = (std::ptr::null_mut(), std::ptr::null_mut());
        // SAFETY: as in `properties`; the name ends in NUL and both out-pointers are ours.
        let status = unsafe { get(self.handle, name.as_ptr(), &mut clip, &mut set) };
        (status == kOfxStatOK).then(|| Clip::new(self.suites, clip, set)).flatten()
    }

    /// Does the host want the render to stop?
    pub fn aborted(&self) -> bool {
        // SAFETY: as in `properties`.
        self.suites.effect.abort.is_some_and(|abort| unsafe { abort(self.handle) } != 0)
    }

    /// Shows an error until [`Self::clear_error`], where the host can; else shows it once.
    pub fn show_error(&self, sentence: &str) {
        let text = c_text(sentence);
        let handle = self.handle.cast::<c_void>();
        if let Some(set) = self.suites.persistent.and_then(|suite| suite.setPersistentMessage) {
            // SAFETY: the handle is live, all texts end in NUL, and "%s" takes exactly the one argument that follows.
            let status =
                unsafe { set(handle, kOfxMessageError.as_ptr(), MESSAGE_ID.as_ptr(), c"%s".as_ptr(), text.as_ptr()) };
            if status == kOfxStatOK {
                return;
            }
        }
        if let Some(message) = self.suites.message.and_then(|suite| suite.message) {
            // SAFETY: as above.
            unsafe { message(handle, kOfxMessageError.as_ptr(), MESSAGE_ID.as_ptr(), c"%s".as_ptr(), text.as_ptr()) };
        }
    }

    /// Takes the persistent message away: some hosts do not render while there is one.
    pub fn clear_error(&self) {
        if let Some(clear) = self.suites.persistent.and_then(|suite| suite.clearPersistentMessage) {
            // SAFETY: as in `properties`.
            unsafe { clear(self.handle.cast()) };
        }
    }
}
