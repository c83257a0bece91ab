//! The C interface of OpenFX under one roof, and the few conversions every suite needs.

use std::ffi::{CStr, CString, c_char};

pub use openfx::sys::generic::core::*;
pub use openfx::sys::generic::property::*;
pub use openfx::sys::image_effect_v1::image_effect::*;
pub use openfx::sys::image_effect_v1::memory::*;
pub use openfx::sys::image_effect_v1::message::*;
pub use openfx::sys::image_effect_v1::multi_thread::*;
pub use openfx::sys::image_effect_v1::param::*;
pub use openfx::sys::image_effect_v1::progress::*;
pub use openfx::sys::image_effect_v1::time_line::*;

/// A C string as text, `None` for NULL. Invalid UTF-8 is replaced.
///
/// # Safety
/// `text` is NULL or a NUL-terminated string that lives during the call.
pub unsafe fn text(text: *const c_char) -> Option<String> {
    // SAFETY: by this function's contract.
    (!text.is_null()).then(|| unsafe { CStr::from_ptr(text) }.to_string_lossy().into_owned())
}

/// Text as a C string; what follows an inner NUL is dropped.
pub fn c_string(text: &str) -> CString {
    CString::new(text.split('\0').next().unwrap_or_default()).unwrap_or_default()
}

/// A constant of the standard as text.
pub fn name(constant: &CStr) -> String {
    constant.to_string_lossy().into_owned()
}

/// The name of a status code.
pub fn status_name(status: OfxStatus) -> String {
    let known = [
        "OK",
        "Failed",
        "ErrFatal",
        "ErrUnknown",
        "ErrMissingHostFeature",
        "ErrUnsupported",
        "ErrExists",
        "ErrFormat",
        "ErrMemory",
        "ErrBadHandle",
        "ErrBadIndex",
        "ErrValue",
        "ReplyYes",
        "ReplyNo",
        "ReplyDefault",
        "Unlicensed",
    ];
    let found = usize::try_from(status).ok().and_then(|at| known.get(at));
    found.map_or_else(|| format!("status {status}"), |name| format!("kOfxStat{name}"))
}
