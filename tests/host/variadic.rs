//! The suite functions that are variadic in C.
//!
//! Stable Rust can call variadic functions but not define them. Here they are functions of fixed arguments instead,
//! behind a cast of their type, on the platforms where that is the same to a caller:
//! - x86-64 System V and AArch64 Linux: variadic arguments travel like named ones. Pointers and integers are taken from
//!   the integer registers, doubles from the floating-point ones, each counted apart; so a function declared with four
//!   pointer-sized *and* four f64 arguments finds either, and what the caller did not pass is left unread.
//! - x86-64 Windows: arguments count together, and doubles of variadic calls are (also) in the integer places, so four
//!   pointer-sized arguments find either.
//!
//! All the arguments declared here lie in registers, save on Windows, where the stack slots read are in the caller's
//! frame in any case. Elsewhere (Apple's AArch64 passes variadic arguments on the stack) the functions are absent and
//! [`SUPPORTED`] is false: tests say that they are skipped.

use std::ffi::{CStr, c_char, c_int, c_void};

use super::log::Rule;
use super::ofx::*;
use super::param::shape;
use super::props::{Type, Value};
use super::shared::blame;
use super::suite_param::{set, value};
use super::suite_property::intern;

/// Whether this platform has the functions.
pub const SUPPORTED: bool = cfg!(any(
    all(target_arch = "x86_64", any(unix, windows)),
    all(target_arch = "aarch64", target_os = "linux", target_env = "gnu")
));

type Get = unsafe extern "C" fn(OfxParamHandle, ...) -> OfxStatus;
type GetAt = unsafe extern "C" fn(OfxParamHandle, f64, ...) -> OfxStatus;
type GetOver = unsafe extern "C" fn(OfxParamHandle, f64, f64, ...) -> OfxStatus;
/// A variadic function that shows a message.
pub type Show = unsafe extern "C" fn(*mut c_void, *const c_char, *const c_char, *const c_char, ...) -> OfxStatus;
/// The same with the first two variadic arguments named.
pub type ShowFixed =
    unsafe extern "C" fn(*mut c_void, *const c_char, *const c_char, *const c_char, usize, usize) -> OfxStatus;

macro_rules! variadic {
    ($name:ident, $to:ty, $function:ident, $from:ty) => {
        /// The function of that name, where the platform allows.
        pub const $name: Option<$to> = if SUPPORTED {
            // SAFETY: a call through either type puts the arguments in the same places: see the module.
            Some(unsafe { std::mem::transmute::<$from, $to>($function) })
        } else {
            None
        };
    };
}

type Out = *mut c_void;
variadic!(GET_VALUE, Get, get, unsafe extern "C" fn(OfxParamHandle, Out, Out, Out, Out) -> OfxStatus);
variadic!(GET_VALUE_AT_TIME, GetAt, get_at, unsafe extern "C" fn(OfxParamHandle, f64, Out, Out, Out, Out) -> OfxStatus);
variadic!(GET_DERIVATIVE, GetAt, derivative, unsafe extern "C" fn(OfxParamHandle, f64) -> OfxStatus);
variadic!(GET_INTEGRAL, GetOver, integral, unsafe extern "C" fn(OfxParamHandle, f64, f64) -> OfxStatus);
#[cfg(not(windows))]
variadic!(
    SET_VALUE,
    Get,
    put,
    unsafe extern "C" fn(OfxParamHandle, usize, usize, usize, usize, f64, f64, f64, f64) -> OfxStatus
);
#[cfg(not(windows))]
variadic!(
    SET_VALUE_AT_TIME,
    GetAt,
    put_at,
    unsafe extern "C" fn(OfxParamHandle, f64, usize, usize, usize, usize, f64, f64, f64, f64) -> OfxStatus
);
#[cfg(windows)]
variadic!(SET_VALUE, Get, put, unsafe extern "C" fn(OfxParamHandle, usize, usize, usize, usize) -> OfxStatus);
#[cfg(windows)]
variadic!(
    SET_VALUE_AT_TIME,
    GetAt,
    put_at,
    unsafe extern "C" fn(OfxParamHandle, f64, usize, usize, usize, usize) -> OfxStatus
);

/// A message function as the suite wants it.
pub const fn show(function: ShowFixed) -> Option<Show> {
    if SUPPORTED {
        // SAFETY: a call through either type puts the arguments in the same places: see the module.
        Some(unsafe { std::mem::transmute::<ShowFixed, Show>(function) })
    } else {
        None
    }
}

/// # Safety
/// As many of `outs` as the parameter has elements are NULL or the plugin's to write, of the right type.
unsafe fn deliver(call: &str, found: Result<Vec<Value>, OfxStatus>, outs: [Out; 4]) -> OfxStatus {
    let values = match found {
        Ok(values) => values,
        Err(status) => return status,
    };
    for (value, out) in values.iter().zip(outs) {
        if out.is_null() {
            blame(Rule::NullPointer, format!("{call} was given NULL for a result"));
            return kOfxStatErrValue;
        }
        // SAFETY: not NULL; by this function's contract of the type that the parameter has.
        unsafe {
            match value {
                Value::Int(number) => out.cast::<c_int>().write(*number),
                Value::Double(number) => out.cast::<f64>().write(*number),
                Value::Text(text) => out.cast::<*mut c_char>().write(intern(text)),
                Value::Pointer(pointer) => out.cast::<usize>().write(*pointer),
            }
        }
    }
    kOfxStatOK
}

unsafe extern "C" fn get(param: OfxParamHandle, a: Out, b: Out, c: Out, d: Out) -> OfxStatus {
    // SAFETY: the plugin passes a pointer for each element, as the standard demands.
    unsafe { deliver("paramGetValue", value(param, "paramGetValue", None), [a, b, c, d]) }
}

unsafe extern "C" fn get_at(param: OfxParamHandle, time: f64, a: Out, b: Out, c: Out, d: Out) -> OfxStatus {
    if !time.is_finite() {
        blame(Rule::BadValue, "paramGetValueAtTime at a time that is no number");
    }
    // SAFETY: the plugin passes a pointer for each element, as the standard demands.
    unsafe { deliver("paramGetValueAtTime", value(param, "paramGetValueAtTime", Some(time)), [a, b, c, d]) }
}

// Hardly any host has these two, and the standard lets a host refuse.
unsafe extern "C" fn derivative(_param: OfxParamHandle, _time: f64) -> OfxStatus {
    kOfxStatErrUnsupported
}

unsafe extern "C" fn integral(_param: OfxParamHandle, _from: f64, _to: f64) -> OfxStatus {
    kOfxStatErrUnsupported
}

/// The values for a kind of parameter, out of the registers.
fn assemble(kind: &str, integers: [usize; 4], doubles: [f64; 4]) -> Vec<Value> {
    let (kind, count) = shape(kind);
    let element = |at: usize| match kind {
        // Only the lower half of the register is defined for a C int.
        Type::Int => Some(Value::Int(integers[at] as u32 as i32)),
        Type::Double => Some(Value::Double(doubles[at])),
        Type::Pointer => Some(Value::Pointer(integers[at])),
        Type::Text if integers[at] == 0 => None,
        // SAFETY: not NULL; the plugin passes a NUL-terminated text for a text parameter.
        Type::Text => Some(Value::Text(unsafe { CStr::from_ptr(integers[at] as *const c_char) }.to_owned())),
    };
    (0..count).filter_map(element).collect()
}

#[cfg(not(windows))]
unsafe extern "C" fn put(
    param: OfxParamHandle,
    i0: usize,
    i1: usize,
    i2: usize,
    i3: usize,
    d0: f64,
    d1: f64,
    d2: f64,
    d3: f64,
) -> OfxStatus {
    set(param, "paramSetValue", None, |kind| assemble(kind, [i0, i1, i2, i3], [d0, d1, d2, d3]))
}

#[cfg(not(windows))]
unsafe extern "C" fn put_at(
    param: OfxParamHandle,
    time: f64,
    i0: usize,
    i1: usize,
    i2: usize,
    i3: usize,
    d0: f64,
    d1: f64,
    d2: f64,
    d3: f64,
) -> OfxStatus {
    set(param, "paramSetValueAtTime", Some(time), |kind| assemble(kind, [i0, i1, i2, i3], [d0, d1, d2, d3]))
}

#[cfg(windows)]
unsafe extern "C" fn put(param: OfxParamHandle, a: usize, b: usize, c: usize, d: usize) -> OfxStatus {
    let bits = [a, b, c, d];
    set(param, "paramSetValue", None, |kind| assemble(kind, bits, bits.map(|bits| f64::from_bits(bits as u64))))
}

#[cfg(windows)]
unsafe extern "C" fn put_at(param: OfxParamHandle, time: f64, a: usize, b: usize, c: usize, d: usize) -> OfxStatus {
    let bits = [a, b, c, d];
    let doubles = bits.map(|bits| f64::from_bits(bits as u64));
    set(param, "paramSetValueAtTime", Some(time), |kind| assemble(kind, bits, doubles))
}

/// printf for at most two `%s`, `%d`, `%i` or `%u`; more is refused, for more would not be in registers.
///
/// # Safety
/// The arguments are what the format says.
pub unsafe fn format(format: &str, arguments: [usize; 2]) -> Result<String, String> {
    let mut arguments = arguments.into_iter();
    let mut text = String::new();
    let mut rest = format.chars();
    while let Some(letter) = rest.next() {
        if letter != '%' {
            text.push(letter);
            continue;
        }
        let conversion = rest.next();
        if conversion == Some('%') {
            text.push('%');
            continue;
        }
        match (conversion, arguments.next()) {
            (Some('s'), Some(pointer)) if pointer != 0 => {
                // SAFETY: not NULL, and by this function's contract a NUL-terminated text.
                text.push_str(&unsafe { CStr::from_ptr(pointer as *const c_char) }.to_string_lossy());
            }
            (Some('d' | 'i' | 'u'), Some(number)) => text.push_str(&(number as u32 as i32).to_string()),
            (conversion, _) => return Err(format!("this host cannot print {conversion:?} of {format:?}")),
        }
    }
    Ok(text)
}
