//! Parameters: what the artist turns.

use std::ffi::{CStr, c_char};

use openfx::sys::generic::core::kOfxStatOK;
use openfx::sys::image_effect_v1::param::{OfxParamHandle, OfxParamSetHandle};

use super::{Properties, Suites, c_text};

/// The parameters of a descriptor or an instance, for the length of one call.
///
/// The type asked for must be the one the parameter was defined with: the host's getters are variadic and cannot check.
#[derive(Clone, Copy)]
pub struct Params<'a> {
    suites: &'a Suites,
    handle: OfxParamSetHandle,
}

impl<'a> Params<'a> {
    /// Wraps a handle; `None` for NULL.
    pub(super) fn new(suites: &'a Suites, handle: OfxParamSetHandle) -> Option<Self> {
        (!handle.is_null()).then_some(Self { suites, handle })
    }

    /// Defines a parameter while describing.
    pub fn define(&self, kind: &CStr, name: &str) -> Option<Properties<'a>> {
        let define = self.suites.parameter.paramDefine?;
        let mut set = std::ptr::null_mut();
        // SAFETY: the handle is live for this call of the host, texts end in NUL and the out-pointer is ours.
        let status = unsafe { define(self.handle, kind.as_ptr(), c_text(name).as_ptr(), &mut set) };
        (status == kOfxStatOK).then(|| Properties::new(self.suites, set)).flatten()
    }

    fn find(&self, name: &str) -> Option<OfxParamHandle> {
        let get = self.suites.parameter.paramGetHandle?;
        let mut param = std::ptr::null_mut();
        // SAFETY: as in `define`; the standard lets the property set be NULL when it is not wanted.
        let status = unsafe { get(self.handle, c_text(name).as_ptr(), &mut param, std::ptr::null_mut()) };
        (status == kOfxStatOK && !param.is_null()).then_some(param)
    }

    /// A Double at a time; NaN counts as missing.
    pub fn double(&self, name: &str, time: f64) -> Option<f64> {
        let (param, get) = (self.find(name)?, self.suites.parameter.paramGetValueAtTime?);
        let mut value = 0.0_f64;
        // SAFETY: the handle came from the host just now, and a Double takes one pointer to a double.
        let status = unsafe { get(param, time, &raw mut value) };
        (status == kOfxStatOK && !value.is_nan()).then_some(value)
    }

    /// An RGB colour at a time; NaN in any channel counts as missing.
    pub fn rgb(&self, name: &str, time: f64) -> Option<[f64; 3]> {
        let (param, get) = (self.find(name)?, self.suites.parameter.paramGetValueAtTime?);
        let (mut r, mut g, mut b) = (0.0_f64, 0.0_f64, 0.0_f64);
        // SAFETY: as in `double`; an RGB takes three pointers to doubles.
        let status = unsafe { get(param, time, &raw mut r, &raw mut g, &raw mut b) };
        let value = [r, g, b];
        (status == kOfxStatOK && !value.iter().any(|v| v.is_nan())).then_some(value)
    }

    /// An Integer, or the index of a Choice, at a time.
    pub fn int(&self, name: &str, time: f64) -> Option<i32> {
        let (param, get) = (self.find(name)?, self.suites.parameter.paramGetValueAtTime?);
        let mut value = 0_i32;
        // SAFETY: as in `double`; Integer and Choice take one pointer to an int.
        let status = unsafe { get(param, time, &raw mut value) };
        (status == kOfxStatOK).then_some(value)
    }

    /// A String at a time, copied.
    pub fn string(&self, name: &str, time: f64) -> Option<String> {
        let (param, get) = (self.find(name)?, self.suites.parameter.paramGetValueAtTime?);
        let mut value: *mut c_char = std::ptr::null_mut();
        // SAFETY: as in `double`; a String takes one pointer to a pointer to char.
        let status = unsafe { get(param, time, &raw mut value) };
        if status != kOfxStatOK || value.is_null() {
            return None;
        }
        // SAFETY: the host owns a NUL-terminated text until the next call on this parameter; it is copied at once.
        Some(unsafe { CStr::from_ptr(value) }.to_string_lossy().into_owned())
    }

    /// Sets a String. Only from create-instance and instance-changed: the standard forbids it while rendering.
    pub fn set_string(&self, name: &str, value: &str) {
        let (Some(param), Some(set)) = (self.find(name), self.suites.parameter.paramSetValue) else { return };
        let text = c_text(value);
        // SAFETY: as in `double`; a String takes one pointer to NUL-terminated text, which the host copies.
        unsafe { set(param, text.as_ptr()) };
    }

    /// Sets an Integer, under the same rule.
    pub fn set_int(&self, name: &str, value: i32) {
        let (Some(param), Some(set)) = (self.find(name), self.suites.parameter.paramSetValue) else { return };
        // SAFETY: as in `double`; an Integer takes one int.
        unsafe { set(param, value) };
    }
}
