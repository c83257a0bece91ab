//! The property suite, version 1.

use std::collections::HashMap;
use std::ffi::{CStr, CString, c_char, c_int, c_void};
use std::sync::{Arc, Mutex};

use super::log::Rule;
use super::ofx::*;
use super::props::{PropertySet, Type, Value};
use super::registry::{Object, find};
use super::shared::{blame, lock};

/// The suite.
pub static SUITE: OfxPropertySuiteV1 = OfxPropertySuiteV1 {
    propSetPointer: Some(set_pointer),
    propSetString: Some(set_string),
    propSetDouble: Some(set_double),
    propSetInt: Some(set_int),
    propSetPointerN: Some(set_pointer_n),
    propSetStringN: Some(set_string_n),
    propSetDoubleN: Some(set_double_n),
    propSetIntN: Some(set_int_n),
    propGetPointer: Some(get_pointer),
    propGetString: Some(get_string),
    propGetDouble: Some(get_double),
    propGetInt: Some(get_int),
    propGetPointerN: Some(get_pointer_n),
    propGetStringN: Some(get_string_n),
    propGetDoubleN: Some(get_double_n),
    propGetIntN: Some(get_int_n),
    propReset: Some(reset),
    propGetDimension: Some(get_dimension),
};

static TEXTS: Mutex<Option<HashMap<CString, &'static CStr>>> = Mutex::new(None);

/// A text that lives as long as the process: plugins on several threads hold what a getter returned for a while, and
/// no host call tells when they are done. Equal texts are kept once, so little is lost.
pub fn intern(text: &CStr) -> *mut c_char {
    let mut texts = lock(&TEXTS);
    let texts = texts.get_or_insert_default();
    let kept = texts.entry(text.to_owned()).or_insert_with(|| Box::leak(text.to_owned().into_boxed_c_str()));
    kept.as_ptr().cast_mut()
}

/// The property set and the name that a call is about.
///
/// # Safety
/// `property` is NULL or a NUL-terminated string.
unsafe fn target(
    set: OfxPropertySetHandle,
    property: *const c_char,
    call: &str,
) -> Result<(Arc<PropertySet>, String), OfxStatus> {
    let set = find(set, call, "property set", |object| match object {
        Object::Props(props) => Some(Arc::clone(props)),
        Object::Image(image) => Some(Arc::clone(&image.props)),
        _ => None,
    })?;
    // SAFETY: by this function's contract.
    let name = unsafe { text(property) }.ok_or_else(|| null(call, "property name"))?;
    Ok((set, name))
}

fn null(call: &str, what: &str) -> OfxStatus {
    blame(Rule::NullPointer, format!("{call} was given NULL for its {what}"));
    kOfxStatErrValue
}

macro_rules! setter {
    ($one:ident, $many:ident, $one_name:literal, $many_name:literal, $raw:ty, $value:expr) => {
        unsafe extern "C" fn $one(
            set: OfxPropertySetHandle,
            name: *const c_char,
            index: c_int,
            value: $raw,
        ) -> OfxStatus {
            // SAFETY: the plugin passes a NUL-terminated name, as the standard demands.
            match unsafe { target(set, name, $one_name) } {
                Ok((set, name)) => $value(value).map_or_else(
                    || null($one_name, "value"),
                    |value| set.set($one_name, &name, index, vec![value], false),
                ),
                Err(status) => status,
            }
        }

        unsafe extern "C" fn $many(
            set: OfxPropertySetHandle,
            name: *const c_char,
            count: c_int,
            values: *const $raw,
        ) -> OfxStatus {
            // SAFETY: the plugin passes a NUL-terminated name, as the standard demands.
            let (set, name) = match unsafe { target(set, name, $many_name) } {
                Ok(found) => found,
                Err(status) => return status,
            };
            if values.is_null() && count > 0 {
                return null($many_name, "values");
            }
            // SAFETY: not NULL, and the plugin passes `count` values, as the standard demands.
            let values = (0..usize::try_from(count).unwrap_or(0)).map(|at| $value(unsafe { *values.add(at) }));
            match values.collect::<Option<Vec<_>>>() {
                Some(values) => set.set($many_name, &name, 0, values, true),
                None => null($many_name, "value"),
            }
        }
    };
}

fn text_value(value: *const c_char) -> Option<Value> {
    // SAFETY: not NULL, and texts of plugins are NUL-terminated, as the standard demands.
    (!value.is_null()).then(|| Value::Text(unsafe { CStr::from_ptr(value) }.to_owned()))
}

setter!(set_pointer, set_pointer_n, "propSetPointer", "propSetPointerN", *mut c_void, |v| Some(Value::Pointer(
    v as usize
)));
setter!(set_string, set_string_n, "propSetString", "propSetStringN", *const c_char, text_value);
setter!(set_double, set_double_n, "propSetDouble", "propSetDoubleN", f64, |v| Some(Value::Double(v)));
setter!(set_int, set_int_n, "propSetInt", "propSetIntN", c_int, |v| Some(Value::Int(v)));

macro_rules! getter {
    ($one:ident, $many:ident, $one_name:literal, $many_name:literal, $raw:ty, $kind:expr, $take:expr) => {
        unsafe extern "C" fn $one(
            set: OfxPropertySetHandle,
            name: *const c_char,
            index: c_int,
            value: *mut $raw,
        ) -> OfxStatus {
            // SAFETY: name and value are the plugin's, as the standard demands; checked for NULL.
            unsafe { get(set, name, (index, 1), value, ($one_name, $kind), $take) }
        }

        unsafe extern "C" fn $many(
            set: OfxPropertySetHandle,
            name: *const c_char,
            count: c_int,
            values: *mut $raw,
        ) -> OfxStatus {
            // SAFETY: as above, with room for `count` values.
            unsafe { get(set, name, (0, count), values, ($many_name, $kind), $take) }
        }
    };
}

/// # Safety
/// `name` is NULL or NUL-terminated; `out` is NULL or has room for `count` values.
unsafe fn get<T>(
    set: OfxPropertySetHandle,
    name: *const c_char,
    (from, count): (c_int, c_int),
    out: *mut T,
    (call, kind): (&str, Type),
    take: impl Fn(&Value) -> T,
) -> OfxStatus {
    // SAFETY: by this function's contract.
    let found = unsafe { target(set, name, call) };
    if out.is_null() && count > 0 {
        return null(call, "result");
    }
    match found.and_then(|(set, name)| set.read(call, &name, from, count, kind)) {
        Ok(values) => {
            for (at, value) in values.iter().enumerate() {
                // SAFETY: not NULL, with room for `count`, and `read` returns that many.
                unsafe { out.add(at).write(take(value)) };
            }
            kOfxStatOK
        }
        Err(status) => status,
    }
}

getter!(
    get_pointer,
    get_pointer_n,
    "propGetPointer",
    "propGetPointerN",
    *mut c_void,
    Type::Pointer,
    |v: &Value| match v {
        Value::Pointer(pointer) => *pointer as *mut c_void,
        _ => std::ptr::null_mut(),
    }
);
getter!(get_string, get_string_n, "propGetString", "propGetStringN", *mut c_char, Type::Text, |v: &Value| match v {
    Value::Text(text) => intern(text),
    _ => std::ptr::null_mut(),
});
getter!(get_double, get_double_n, "propGetDouble", "propGetDoubleN", f64, Type::Double, |v: &Value| match v {
    Value::Double(number) => *number,
    _ => 0.0,
});
getter!(get_int, get_int_n, "propGetInt", "propGetIntN", c_int, Type::Int, |v: &Value| match v {
    Value::Int(number) => *number,
    _ => 0,
});

unsafe extern "C" fn reset(set: OfxPropertySetHandle, name: *const c_char) -> OfxStatus {
    // SAFETY: the plugin passes a NUL-terminated name, as the standard demands.
    match unsafe { target(set, name, "propReset") } {
        Ok((set, name)) => set.reset(&name),
        Err(status) => status,
    }
}

unsafe extern "C" fn get_dimension(set: OfxPropertySetHandle, name: *const c_char, count: *mut c_int) -> OfxStatus {
    // SAFETY: the plugin passes a NUL-terminated name, as the standard demands.
    match unsafe { target(set, name, "propGetDimension") }.and_then(|(set, name)| set.dimension(&name)) {
        Ok(_) if count.is_null() => null("propGetDimension", "result"),
        Ok(dimension) => {
            // SAFETY: not NULL; the plugin's to write.
            unsafe { count.write(dimension) };
            kOfxStatOK
        }
        Err(status) => status,
    }
}
