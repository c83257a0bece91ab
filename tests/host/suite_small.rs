//! The memory, message, progress and timeline suites.

use std::alloc::{Layout, alloc, dealloc};
use std::ffi::{c_char, c_void};
use std::sync::Arc;

use super::log::{Message, Rule};
use super::ofx::*;
use super::shared::{Shared, blame, lock, with_current};
use super::suite_effect::{answer, effect_of};
use super::variadic::{self, show};

/// Memory.
pub static MEMORY: OfxMemorySuiteV1 =
    OfxMemorySuiteV1 { memoryAlloc: Some(memory_alloc), memoryFree: Some(memory_free) };
/// Messages that go away.
pub static MESSAGE: OfxMessageSuiteV1 = OfxMessageSuiteV1 { message: show(message) };
/// Messages that stay.
pub static MESSAGE_V2: OfxMessageSuiteV2 = OfxMessageSuiteV2 {
    message: show(message),
    setPersistentMessage: show(set_persistent),
    clearPersistentMessage: Some(clear_persistent),
};
/// Progress.
pub static PROGRESS: OfxProgressSuiteV1 = OfxProgressSuiteV1 {
    progressStart: Some(progress_start),
    progressUpdate: Some(progress_update),
    progressEnd: Some(progress_end),
};
/// The timeline.
pub static TIMELINE: OfxTimeLineSuiteV1 =
    OfxTimeLineSuiteV1 { getTime: Some(get_time), gotoTime: Some(goto_time), getTimeBounds: Some(get_bounds) };

const ALIGNMENT: usize = 64;

fn layout(size: usize) -> Option<Layout> {
    Layout::from_size_align(size.max(1), ALIGNMENT).ok()
}

unsafe extern "C" fn memory_alloc(effect: *mut c_void, size: usize, out: *mut *mut c_void) -> OfxStatus {
    // NULL is allowed here by the standard: the block then belongs to the host of this action.
    let shared = match effect.is_null() {
        true => with_current(|scope| Arc::clone(&scope.shared)).ok_or(kOfxStatErrBadHandle),
        false => effect_of(effect, "memoryAlloc").map(|effect| Arc::clone(&effect.shared)),
    };
    let found = shared.and_then(|shared| {
        let layout = layout(size).ok_or(kOfxStatErrMemory)?;
        // SAFETY: the size is not zero.
        let block = unsafe { alloc(layout) };
        if block.is_null() {
            return Err(kOfxStatErrMemory);
        }
        lock(&shared.memory).insert(block as usize, size);
        Ok(block.cast())
    });
    // SAFETY: the plugin's variable, as the standard demands.
    unsafe { answer("memoryAlloc", out, found) }
}

unsafe extern "C" fn memory_free(block: *mut c_void) -> OfxStatus {
    let found = super::shared::hosts().into_iter().find_map(|host| lock(&host.memory).remove(&(block as usize)));
    match found.and_then(layout) {
        Some(layout) => {
            // SAFETY: allocated by `memory_alloc` with this layout, and removed from the books.
            unsafe { dealloc(block.cast(), layout) };
            kOfxStatOK
        }
        None => {
            blame(Rule::BadHandle, format!("memoryFree of {block:p}, which is not allocated"));
            kOfxStatErrBadHandle
        }
    }
}

/// Reads a message and writes it down.
///
/// # Safety
/// The texts are NULL or NUL-terminated, and the arguments are what the format says.
unsafe fn note(
    handle: *mut c_void,
    kind: *const c_char,
    template: *const c_char,
    arguments: [usize; 2],
    persistent: bool,
) -> OfxStatus {
    let call = if persistent { "setPersistentMessage" } else { "message" };
    let shared = match (handle.is_null(), persistent) {
        // The message function may be called without an effect.
        (true, false) => with_current(|scope| Arc::clone(&scope.shared)).ok_or(kOfxStatErrBadHandle),
        _ => effect_of(handle, call).map(|effect| Arc::clone(&effect.shared)),
    };
    let shared = match shared {
        Ok(shared) => shared,
        Err(status) => return status,
    };
    // SAFETY: by this function's contract.
    let (kind, template) = unsafe { (text(kind).unwrap_or_default(), text(template).unwrap_or_default()) };
    // SAFETY: by this function's contract.
    let text = unsafe { variadic::format(&template, arguments) }.unwrap_or_else(|refused| {
        shared.violate(Rule::BadValue, refused);
        template
    });
    let kinds = [
        kOfxMessageFatal,
        kOfxMessageError,
        kOfxMessageWarning,
        kOfxMessageMessage,
        kOfxMessageLog,
        kOfxMessageQuestion,
    ];
    if !kinds.iter().any(|known| known.to_bytes() == kind.as_bytes()) {
        shared.violate(Rule::BadValue, format!("{call} of the kind {kind:?}"));
    }
    let message = Message { kind, text, persistent };
    if persistent {
        lock(&shared.persistent).insert(handle as usize, message.clone());
    }
    lock(&shared.messages).push(message);
    kOfxStatOK
}

unsafe extern "C" fn message(
    handle: *mut c_void,
    kind: *const c_char,
    _id: *const c_char,
    format: *const c_char,
    a: usize,
    b: usize,
) -> OfxStatus {
    // SAFETY: as the standard demands of the plugin.
    unsafe { note(handle, kind, format, [a, b], false) }
}

unsafe extern "C" fn set_persistent(
    handle: *mut c_void,
    kind: *const c_char,
    _id: *const c_char,
    format: *const c_char,
    a: usize,
    b: usize,
) -> OfxStatus {
    // SAFETY: as the standard demands of the plugin.
    unsafe { note(handle, kind, format, [a, b], true) }
}

unsafe extern "C" fn clear_persistent(handle: *mut c_void) -> OfxStatus {
    effect_of(handle, "clearPersistentMessage").map_or_else(
        |status| status,
        |effect| {
            lock(&effect.shared.persistent).remove(&(handle as usize));
            kOfxStatOK
        },
    )
}

fn progress(handle: *mut c_void, call: &str, work: impl FnOnce(&Shared, &mut usize) -> OfxStatus) -> OfxStatus {
    effect_of(handle, call).map_or_else(
        |status| status,
        |effect| work(&effect.shared, lock(&effect.shared.progress).entry(handle as usize).or_default()),
    )
}

unsafe extern "C" fn progress_start(handle: *mut c_void, _label: *const c_char) -> OfxStatus {
    progress(handle, "progressStart", |_, open| {
        *open += 1;
        kOfxStatOK
    })
}

unsafe extern "C" fn progress_update(handle: *mut c_void, amount: f64) -> OfxStatus {
    progress(handle, "progressUpdate", |shared, open| {
        if *open == 0 || !(0.0..=1.0).contains(&amount) {
            shared.violate(Rule::Unbalanced, format!("progressUpdate to {amount} with {open} progress bars open"));
        }
        if shared.aborted() { kOfxStatReplyNo } else { kOfxStatReplyYes }
    })
}

unsafe extern "C" fn progress_end(handle: *mut c_void) -> OfxStatus {
    progress(handle, "progressEnd", |shared, open| {
        if *open == 0 {
            shared.violate(Rule::Unbalanced, "progressEnd without progressStart");
            return kOfxStatFailed;
        }
        *open -= 1;
        kOfxStatOK
    })
}

unsafe extern "C" fn get_time(handle: *mut c_void, out: *mut f64) -> OfxStatus {
    let found = effect_of(handle, "getTime").map(|effect| *lock(&effect.shared.timeline));
    // SAFETY: the plugin's variable, as the standard demands.
    unsafe { answer("getTime", out, found) }
}

unsafe extern "C" fn goto_time(handle: *mut c_void, time: f64) -> OfxStatus {
    effect_of(handle, "gotoTime").map_or_else(
        |status| status,
        |effect| {
            *lock(&effect.shared.timeline) = time;
            kOfxStatOK
        },
    )
}

unsafe extern "C" fn get_bounds(handle: *mut c_void, first: *mut f64, last: *mut f64) -> OfxStatus {
    let range = effect_of(handle, "getTimeBounds").map(|effect| effect.shared.options.frame_range);
    // SAFETY: the plugin's variable, as the standard demands.
    let status = unsafe { answer("getTimeBounds", first, range.map(|range| range.0)) };
    if status != kOfxStatOK {
        return status;
    }
    // SAFETY: as above.
    unsafe { answer("getTimeBounds", last, range.map(|range| range.1)) }
}
