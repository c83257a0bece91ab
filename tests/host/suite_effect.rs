//! The image effect suite, version 1.

use std::ffi::{c_char, c_int, c_void};
use std::sync::Arc;
use std::sync::atomic::AtomicU64;

use super::clip::{Clip, Feed, Image};
use super::effect::{Effect, Role};
use super::image::TestImage;
use super::log::Rule;
use super::ofx::*;
use super::registry::{ImageMemory, Object, find, register, retire};
use super::schema;
use super::shared::{blame, lock, with_current};

/// The suite.
pub static SUITE: OfxImageEffectSuiteV1 = OfxImageEffectSuiteV1 {
    getPropertySet: Some(get_property_set),
    getParamSet: Some(get_param_set),
    clipDefine: Some(clip_define),
    clipGetHandle: Some(clip_get_handle),
    clipGetPropertySet: Some(clip_get_property_set),
    clipGetImage: Some(clip_get_image),
    clipReleaseImage: Some(clip_release_image),
    clipGetRegionOfDefinition: Some(clip_get_region_of_definition),
    abort: Some(abort),
    imageMemoryAlloc: Some(memory_alloc),
    imageMemoryFree: Some(memory_free),
    imageMemoryLock: Some(memory_lock),
    imageMemoryUnlock: Some(memory_unlock),
};

/// The effect of a handle.
pub fn effect_of<H>(handle: *mut H, call: &str) -> Result<Arc<Effect>, OfxStatus> {
    find(handle, call, "effect", |object| match object {
        Object::Effect(effect) => Some(Arc::clone(effect)),
        _ => None,
    })
}

fn clip_of(handle: OfxImageClipHandle, call: &str) -> Result<Arc<Clip>, OfxStatus> {
    find(handle, call, "clip", |object| match object {
        Object::Clip(clip) => Some(Arc::clone(clip)),
        _ => None,
    })
}

/// Hands a result to the plugin.
///
/// # Safety
/// `out` is NULL or the plugin's to write.
pub unsafe fn answer<T>(call: &str, out: *mut T, found: Result<T, OfxStatus>) -> OfxStatus {
    if out.is_null() {
        blame(Rule::NullPointer, format!("{call} was given NULL for its result"));
        return kOfxStatErrValue;
    }
    match found {
        Ok(value) => {
            // SAFETY: not NULL, by this function's contract the plugin's to write.
            unsafe { out.write(value) };
            kOfxStatOK
        }
        Err(status) => status,
    }
}

unsafe extern "C" fn get_property_set(effect: OfxImageEffectHandle, out: *mut OfxPropertySetHandle) -> OfxStatus {
    let found = effect_of(effect, "getPropertySet").map(|effect| effect.props.handle());
    // SAFETY: the plugin's variable, as the standard demands.
    unsafe { answer("getPropertySet", out, found) }
}

unsafe extern "C" fn get_param_set(effect: OfxImageEffectHandle, out: *mut OfxParamSetHandle) -> OfxStatus {
    let found = effect_of(effect, "getParamSet").map(|effect| effect.params_handle());
    // SAFETY: the plugin's variable, as the standard demands.
    unsafe { answer("getParamSet", out, found) }
}

unsafe extern "C" fn clip_define(
    effect: OfxImageEffectHandle,
    name: *const c_char,
    out: *mut OfxPropertySetHandle,
) -> OfxStatus {
    // SAFETY: the plugin passes a NUL-terminated name, as the standard demands.
    let name = unsafe { text(name) };
    let found = effect_of(effect, "clipDefine").and_then(|effect| define(&effect, name));
    if out.is_null() {
        // The standard allows NULL here.
        return found.err().unwrap_or(kOfxStatOK);
    }
    // SAFETY: the plugin's variable, as the standard demands.
    unsafe { answer("clipDefine", out, found) }
}

fn define(effect: &Arc<Effect>, name: Option<String>) -> Result<OfxPropertySetHandle, OfxStatus> {
    let refuse = |rule, what: String, status| {
        effect.shared.violate(rule, what);
        Err(status)
    };
    if effect.role != Role::InContext {
        return refuse(Rule::NotAllowed, format!("clipDefine on a {:?}", effect.role), kOfxStatErrBadHandle);
    }
    let Some(name) = name.filter(|name| !name.is_empty()) else {
        return refuse(Rule::BadValue, "clipDefine without a name".into(), kOfxStatErrValue);
    };
    if effect.clip(&name).is_some() {
        return refuse(Rule::BadValue, format!("clip {name} is defined twice"), kOfxStatErrExists);
    }
    let clip = Clip::new(&effect.shared, effect, &name, schema::clip(&name));
    let props = clip.props.handle();
    lock(&effect.clips).push(clip);
    Ok(props)
}

unsafe extern "C" fn clip_get_handle(
    effect: OfxImageEffectHandle,
    name: *const c_char,
    out: *mut OfxImageClipHandle,
    props: *mut OfxPropertySetHandle,
) -> OfxStatus {
    // SAFETY: the plugin passes a NUL-terminated name, as the standard demands.
    let name = unsafe { text(name) }.unwrap_or_default();
    let found = effect_of(effect, "clipGetHandle").and_then(|effect| {
        if effect.role != Role::Instance {
            effect.shared.violate(Rule::NotAllowed, "clipGetHandle on a descriptor");
            return Err(kOfxStatErrBadHandle);
        }
        effect.clip(&name).ok_or_else(|| {
            effect.shared.violate(Rule::UnknownName, format!("clipGetHandle of {name:?}, which was not defined"));
            kOfxStatErrUnknown
        })
    });
    if let (Ok(clip), false) = (&found, props.is_null()) {
        // SAFETY: not NULL; the plugin's variable, as the standard demands.
        unsafe { props.write(clip.props.handle()) };
    }
    // SAFETY: the plugin's variable, as the standard demands.
    unsafe { answer("clipGetHandle", out, found.map(|clip| clip.handle())) }
}

unsafe extern "C" fn clip_get_property_set(clip: OfxImageClipHandle, out: *mut OfxPropertySetHandle) -> OfxStatus {
    let found = clip_of(clip, "clipGetPropertySet").map(|clip| clip.props.handle());
    // SAFETY: the plugin's variable, as the standard demands.
    unsafe { answer("clipGetPropertySet", out, found) }
}

unsafe extern "C" fn clip_get_image(
    clip: OfxImageClipHandle,
    time: f64,
    _region: *const OfxRectD,
    out: *mut OfxPropertySetHandle,
) -> OfxStatus {
    let found = clip_of(clip, "clipGetImage").and_then(|clip| image_at(&clip, time));
    // SAFETY: the plugin's variable, as the standard demands.
    unsafe { answer("clipGetImage", out, found) }
}

fn image_at(clip: &Clip, time: f64) -> Result<OfxPropertySetHandle, OfxStatus> {
    let effect = clip.effect.upgrade().ok_or(kOfxStatErrBadHandle)?;
    let action = with_current(|scope| scope.action.clone());
    let job = effect.job(time);
    let fitting =
        action.as_deref().is_none_or(|action| action.contains("Render") || action.contains("InstanceChanged"));
    if !fitting || effect.role != Role::Instance || !time.is_finite() {
        effect.shared.violate(Rule::NotAllowed, format!("clipGetImage of {} at {time}", clip.name));
        return Err(kOfxStatFailed);
    }
    if clip.is_output() {
        let Some(job) = job.filter(|job| job.time == time) else {
            effect.shared.violate(Rule::NotAllowed, format!("the output is not being rendered at {time}"));
            return Err(kOfxStatFailed);
        };
        return Ok(Image::output(&effect, clip, &job));
    }
    let feed = lock(&clip.feed).clone();
    match feed {
        Feed::Nothing | Feed::NoImage => Err(kOfxStatFailed),
        Feed::NullImage => Ok(std::ptr::null_mut()),
        Feed::NoData => Ok(Image::input(&effect, clip, &TestImage::new(4, 4), job, false)),
        Feed::Image(_) | Feed::Frames(_) => {
            let picture = clip.picture(time).ok_or(kOfxStatFailed)?;
            Ok(Image::input(&effect, clip, &picture, job, true))
        }
    }
}

unsafe extern "C" fn clip_release_image(image: OfxPropertySetHandle) -> OfxStatus {
    let found = find(image, "clipReleaseImage", "image", |object| match object {
        Object::Image(image) => Some(Arc::clone(image)),
        _ => None,
    });
    match found {
        Ok(object) => {
            object.released();
            retire(image as usize);
            kOfxStatOK
        }
        Err(status) => status,
    }
}

unsafe extern "C" fn clip_get_region_of_definition(
    clip: OfxImageClipHandle,
    time: f64,
    out: *mut OfxRectD,
) -> OfxStatus {
    let found = clip_of(clip, "clipGetRegionOfDefinition").and_then(|clip| {
        let effect =
            clip.effect.upgrade().filter(|effect| effect.role == Role::Instance).ok_or(kOfxStatErrBadHandle)?;
        let options = &effect.shared.options;
        if clip.is_output() {
            let ((x, y), (w, h)) = (options.project_offset, options.project_extent);
            return Ok(OfxRectD { x1: x, y1: y, x2: x + w, y2: y + h });
        }
        let bounds = clip.picture(time).ok_or(kOfxStatFailed)?.bounds();
        let [x1, y1, x2, y2] = bounds.edges().map(f64::from);
        let scale = effect.job(time).filter(|_| options.regions_in_pixels).map_or((1.0, 1.0), |job| job.scale);
        let (x, y) = (options.pixel_aspect * scale.0, scale.1);
        Ok(OfxRectD { x1: x1 * x, y1: y1 * y, x2: x2 * x, y2: y2 * y })
    });
    // SAFETY: the plugin's variable, as the standard demands.
    unsafe { answer("clipGetRegionOfDefinition", out, found) }
}

unsafe extern "C" fn abort(effect: OfxImageEffectHandle) -> c_int {
    effect_of(effect, "abort").map_or(0, |effect| c_int::from(effect.shared.aborted()))
}

unsafe extern "C" fn memory_alloc(
    effect: OfxImageEffectHandle,
    size: usize,
    out: *mut OfxImageMemoryHandle,
) -> OfxStatus {
    // The standard allows a NULL instance here: the host's effect is then unknown, so this strict host refuses it.
    let found = effect_of(effect, "imageMemoryAlloc").map(|effect| {
        let block = (0..size.div_ceil(8)).map(|_| AtomicU64::new(0)).collect();
        let memory = ImageMemory { block, effect: Arc::downgrade(&effect) };
        register(&effect.shared, Object::Memory(Arc::new(memory))) as OfxImageMemoryHandle
    });
    // SAFETY: the plugin's variable, as the standard demands.
    unsafe { answer("imageMemoryAlloc", out, found) }
}

fn memory_of(handle: OfxImageMemoryHandle, call: &str) -> Result<Arc<ImageMemory>, OfxStatus> {
    find(handle, call, "image memory", |object| match object {
        Object::Memory(memory) => Some(Arc::clone(memory)),
        _ => None,
    })
}

unsafe extern "C" fn memory_free(memory: OfxImageMemoryHandle) -> OfxStatus {
    memory_of(memory, "imageMemoryFree").map_or_else(
        |status| status,
        |_| {
            retire(memory as usize);
            kOfxStatOK
        },
    )
}

unsafe extern "C" fn memory_lock(memory: OfxImageMemoryHandle, out: *mut *mut c_void) -> OfxStatus {
    let found = memory_of(memory, "imageMemoryLock").map(|memory| memory.block.as_ptr().cast_mut().cast::<c_void>());
    // SAFETY: the plugin's variable, as the standard demands.
    unsafe { answer("imageMemoryLock", out, found) }
}

unsafe extern "C" fn memory_unlock(memory: OfxImageMemoryHandle) -> OfxStatus {
    memory_of(memory, "imageMemoryUnlock").map_or_else(|status| status, |_| kOfxStatOK)
}
