//! What the library exports: a host asks how many effects there are and for each one's struct.
//!
//! Written by hand because the binding's macro exports an `OfxSetHost` of the wrong type; without that optional export
//! every host passes itself through `setHost`, as it must anyhow.

#![allow(non_snake_case, reason = "the names are the standard's")]

use std::ffi::c_int;

use crate::effects::matte::EnvironmentMatte;
use crate::effects::relight::Relight;
use crate::host::{self, names::OfxPlugin};

static PLUGINS: [OfxPlugin; 2] = [host::plugin::<Relight>(), host::plugin::<EnvironmentMatte>()];

/// The number of effects in this library.
#[unsafe(no_mangle)]
pub extern "C" fn OfxGetNumberOfPlugins() -> c_int {
    PLUGINS.len() as c_int
}

/// The `nth` effect; NULL past the end. The struct lives as long as the library.
#[unsafe(no_mangle)]
pub extern "C" fn OfxGetPlugin(nth: c_int) -> *const OfxPlugin {
    usize::try_from(nth).ok().and_then(|n| PLUGINS.get(n)).map_or(std::ptr::null(), std::ptr::from_ref)
}
