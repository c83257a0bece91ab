//! Property sets: named, typed, indexed values on everything a host hands out.

use std::ffi::{CStr, c_char, c_void};

use openfx::sys::generic::core::{OfxPropertySetHandle, kOfxStatOK};

use super::{Suites, c_text};

/// A property set of the host, for the length of one call.
///
/// Reading gives `None` for whatever the host does not have. Writing has no answer: a host that does not know a
/// property says so and goes on with its default, and so do we.
#[derive(Clone, Copy)]
pub struct Properties<'a> {
    suites: &'a Suites,
    handle: OfxPropertySetHandle,
}

impl<'a> Properties<'a> {
    /// Wraps a handle; `None` for NULL.
    pub(super) fn new(suites: &'a Suites, handle: OfxPropertySetHandle) -> Option<Self> {
        (!handle.is_null()).then_some(Self { suites, handle })
    }

    pub(super) fn handle(&self) -> OfxPropertySetHandle {
        self.handle
    }

    /// An integer.
    pub fn int(&self, name: &CStr, index: i32) -> Option<i32> {
        let get = self.suites.property.propGetInt?;
        let mut value = 0;
        // SAFETY: the handle is live for this call of the host, the name ends in NUL, and the out-pointer is ours.
        let status = unsafe { get(self.handle, name.as_ptr(), index, &mut value) };
        (status == kOfxStatOK).then_some(value)
    }

    /// A finite or infinite number; NaN counts as missing.
    pub fn double(&self, name: &CStr, index: i32) -> Option<f64> {
        let get = self.suites.property.propGetDouble?;
        let mut value = 0.0;
        // SAFETY: as in `int`.
        let status = unsafe { get(self.handle, name.as_ptr(), index, &mut value) };
        (status == kOfxStatOK && !value.is_nan()).then_some(value)
    }

    /// Text, copied; bytes that are not UTF-8 are replaced.
    pub fn string(&self, name: &CStr, index: i32) -> Option<String> {
        let get = self.suites.property.propGetString?;
        let mut value: *mut c_char = std::ptr::null_mut();
        // SAFETY: as in `int`.
        let status = unsafe { get(self.handle, name.as_ptr(), index, &mut value) };
        if status != kOfxStatOK || value.is_null() {
            return None;
        }
        // SAFETY: an OK with a pointer means a NUL-terminated string that the host owns until the next call on this
        // set; it is copied at once.
        Some(unsafe { CStr::from_ptr(value) }.to_string_lossy().into_owned())
    }

    /// A pointer; NULL counts as missing.
    pub(super) fn pointer(&self, name: &CStr) -> Option<*mut c_void> {
        let get = self.suites.property.propGetPointer?;
        let mut value = std::ptr::null_mut();
        // SAFETY: as in `int`.
        let status = unsafe { get(self.handle, name.as_ptr(), 0, &mut value) };
        (status == kOfxStatOK && !value.is_null()).then_some(value)
    }

    /// `N` integers, all or none.
    pub fn ints<const N: usize>(&self, name: &CStr) -> Option<[i32; N]> {
        let mut values = [0; N];
        for (index, value) in values.iter_mut().enumerate() {
            *value = self.int(name, index as i32)?;
        }
        Some(values)
    }

    /// `N` numbers, all or none.
    pub fn doubles<const N: usize>(&self, name: &CStr) -> Option<[f64; N]> {
        let mut values = [0.0; N];
        for (index, value) in values.iter_mut().enumerate() {
            *value = self.double(name, index as i32)?;
        }
        Some(values)
    }

    /// Sets integers, from index 0.
    pub fn set_ints(&self, name: &CStr, values: &[i32]) {
        let Some(set) = self.suites.property.propSetInt else { return };
        for (index, &value) in values.iter().enumerate() {
            // SAFETY: the handle is live for this call of the host and the name ends in NUL.
            unsafe { set(self.handle, name.as_ptr(), index as i32, value) };
        }
    }

    /// Sets one integer.
    pub fn set_int(&self, name: &CStr, value: i32) {
        self.set_ints(name, &[value]);
    }

    /// Sets numbers, from index 0.
    pub fn set_doubles(&self, name: &CStr, values: &[f64]) {
        let Some(set) = self.suites.property.propSetDouble else { return };
        for (index, &value) in values.iter().enumerate() {
            // SAFETY: as in `set_ints`.
            unsafe { set(self.handle, name.as_ptr(), index as i32, value) };
        }
    }

    /// Sets texts, from index 0.
    pub fn set_strings(&self, name: &CStr, values: &[&CStr]) {
        let Some(set) = self.suites.property.propSetString else { return };
        for (index, value) in values.iter().enumerate() {
            // SAFETY: as in `set_ints`; the value ends in NUL and the host copies it.
            unsafe { set(self.handle, name.as_ptr(), index as i32, value.as_ptr()) };
        }
    }

    /// Sets one text.
    pub fn set_string(&self, name: &CStr, value: &str) {
        self.set_string_at(name, 0, value);
    }

    /// Sets one of several texts.
    pub fn set_string_at(&self, name: &CStr, index: usize, value: &str) {
        let Some(set) = self.suites.property.propSetString else { return };
        // SAFETY: as in `set_ints`; the value ends in NUL, outlives the call, and the host copies it.
        unsafe { set(self.handle, name.as_ptr(), index as i32, c_text(value).as_ptr()) };
    }
}
