//! The parameter suite, version 1; the variadic functions are in [`super::variadic`].

use std::ffi::{c_char, c_int, c_uint};
use std::sync::Arc;

use super::effect::{Effect, Role};
use super::log::Rule;
use super::ofx::*;
use super::param::{self, Param, Track};
use super::props::{Prop, Value};
use super::registry::{Object, find};
use super::shared::{lock, with_current};
use super::suite_effect::answer;
use super::variadic;

/// The suite.
pub static SUITE: OfxParameterSuiteV1 = OfxParameterSuiteV1 {
    paramDefine: Some(define),
    paramGetHandle: Some(get_handle),
    paramSetGetPropertySet: Some(set_get_property_set),
    paramGetPropertySet: Some(get_property_set),
    paramGetValue: variadic::GET_VALUE,
    paramGetValueAtTime: variadic::GET_VALUE_AT_TIME,
    paramGetDerivative: variadic::GET_DERIVATIVE,
    paramGetIntegral: variadic::GET_INTEGRAL,
    paramSetValue: variadic::SET_VALUE,
    paramSetValueAtTime: variadic::SET_VALUE_AT_TIME,
    paramGetNumKeys: Some(get_num_keys),
    paramGetKeyTime: Some(get_key_time),
    paramGetKeyIndex: Some(get_key_index),
    paramDeleteKey: Some(delete_key),
    paramDeleteAllKeys: Some(delete_all_keys),
    paramCopy: Some(copy),
    paramEditBegin: Some(edit_begin),
    paramEditEnd: Some(edit_end),
};

fn set_of(handle: OfxParamSetHandle, call: &str) -> Result<Arc<Effect>, OfxStatus> {
    find(handle, call, "parameter set", |object| match object {
        Object::Params(effect) => Some(Arc::clone(effect)),
        _ => None,
    })
}

fn param_of(handle: OfxParamHandle, call: &str) -> Result<Arc<Param>, OfxStatus> {
    find(handle, call, "parameter", |object| match object {
        Object::Param(param) => Some(Arc::clone(param)),
        _ => None,
    })
}

/// The parameter of a handle that has a value, and its effect, an instance.
pub fn valued(handle: OfxParamHandle, call: &str) -> Result<(Arc<Param>, Arc<Effect>), OfxStatus> {
    let param = param_of(handle, call)?;
    let effect = param.effect.upgrade().ok_or(kOfxStatErrBadHandle)?;
    if effect.role != Role::Instance || param::shape(&param.kind).1 == 0 {
        effect
            .shared
            .violate(Rule::NotAllowed, format!("{call} of {} ({}), which has no value", param.name, param.kind));
        return Err(kOfxStatErrBadHandle);
    }
    Ok((param, effect))
}

unsafe extern "C" fn define(
    set: OfxParamSetHandle,
    kind: *const c_char,
    name: *const c_char,
    out: *mut OfxPropertySetHandle,
) -> OfxStatus {
    // SAFETY: the plugin passes NUL-terminated texts, as the standard demands.
    let (kind, name) = unsafe { (text(kind), text(name)) };
    let found = set_of(set, "paramDefine")
        .and_then(|effect| define_param(&effect, &kind.unwrap_or_default(), &name.unwrap_or_default()));
    if out.is_null() {
        // The standard allows NULL here.
        return found.err().unwrap_or(kOfxStatOK);
    }
    // SAFETY: the plugin's variable, as the standard demands.
    unsafe { answer("paramDefine", out, found) }
}

fn define_param(effect: &Arc<Effect>, kind: &str, name: &str) -> Result<OfxPropertySetHandle, OfxStatus> {
    let refuse = |rule, what: String, status| {
        effect.shared.violate(rule, what);
        Err(status)
    };
    if effect.role != Role::InContext {
        return refuse(Rule::NotAllowed, format!("paramDefine on a {:?}", effect.role), kOfxStatErrBadHandle);
    }
    // Later additions to the standard, which a plugin may try and this host has not.
    if ["OfxParamTypeParametric", "OfxParamTypeStrChoice", "OfxParamTypeBytes"].contains(&kind) {
        return Err(kOfxStatErrUnsupported);
    }
    if !param::KINDS.iter().any(|known| known.to_bytes() == kind.as_bytes()) {
        return refuse(Rule::BadValue, format!("{kind:?} is no kind of parameter"), kOfxStatErrUnsupported);
    }
    if name.is_empty() || effect.param(name).is_some() {
        return refuse(Rule::BadValue, format!("parameter {name:?} is defined twice or nameless"), kOfxStatErrExists);
    }
    let param = Param::new(&effect.shared, effect, kind, name, param::descriptor(kind, name));
    let props = param.props.handle();
    lock(&effect.params).push(param);
    Ok(props)
}

unsafe extern "C" fn get_handle(
    set: OfxParamSetHandle,
    name: *const c_char,
    out: *mut OfxParamHandle,
    props: *mut OfxPropertySetHandle,
) -> OfxStatus {
    // SAFETY: the plugin passes a NUL-terminated name, as the standard demands.
    let name = unsafe { text(name) }.unwrap_or_default();
    let found = set_of(set, "paramGetHandle").and_then(|effect| {
        effect.param(&name).ok_or_else(|| {
            effect.shared.violate(Rule::UnknownName, format!("paramGetHandle of {name:?}, which was not defined"));
            kOfxStatErrUnknown
        })
    });
    if let (Ok(param), false) = (&found, props.is_null()) {
        // SAFETY: not NULL; the plugin's variable, as the standard demands.
        unsafe { props.write(param.props.handle()) };
    }
    // SAFETY: the plugin's variable, as the standard demands.
    unsafe { answer("paramGetHandle", out, found.map(|param| param.handle())) }
}

unsafe extern "C" fn set_get_property_set(set: OfxParamSetHandle, out: *mut OfxPropertySetHandle) -> OfxStatus {
    let found = set_of(set, "paramSetGetPropertySet").map(|effect| effect.param_props.handle());
    // SAFETY: the plugin's variable, as the standard demands.
    unsafe { answer("paramSetGetPropertySet", out, found) }
}

unsafe extern "C" fn get_property_set(param: OfxParamHandle, out: *mut OfxPropertySetHandle) -> OfxStatus {
    let found = param_of(param, "paramGetPropertySet").map(|param| param.props.handle());
    // SAFETY: the plugin's variable, as the standard demands.
    unsafe { answer("paramGetPropertySet", out, found) }
}

/// The value at a time, or (as for paramGetValue) wherever the timeline stands.
pub fn value(handle: OfxParamHandle, call: &str, time: Option<f64>) -> Result<Vec<Value>, OfxStatus> {
    let (param, effect) = valued(handle, call)?;
    let time = time.unwrap_or_else(|| *lock(&effect.shared.timeline));
    let track = lock(&param.track).clone();
    Ok(track.at(time))
}

/// Sets a value as the plugin. The standard allows that in few actions.
pub fn set(handle: OfxParamHandle, call: &str, time: Option<f64>, read: impl FnOnce(&str) -> Vec<Value>) -> OfxStatus {
    let (param, effect) = match valued(handle, call) {
        Ok(found) => found,
        Err(status) => return status,
    };
    let action = with_current(|scope| scope.action.clone()).unwrap_or_default();
    let allowed = ["CreateInstance", "InstanceChanged", "SyncPrivateData", "InstanceEdit"];
    if !allowed.iter().any(|part| action.contains(part)) {
        effect.shared.violate(Rule::NotAllowed, format!("{call} of {} in this action", param.name));
    }
    let values = read(&param.kind);
    if !param.holds(&values) {
        effect.shared.violate(Rule::WrongType, format!("{call} of {} with {values:?}", param.name));
        return kOfxStatErrValue;
    }
    let mut track = lock(&param.track);
    match time {
        Some(time) => track.key(time, values),
        None => *track = Track::Still(values),
    }
    note_animation(&param, &track);
    kOfxStatOK
}

/// Keeps the property IsAnimating true.
pub fn note_animation(param: &Param, track: &Track) {
    let moving = !matches!(track, Track::Still(_));
    param.props.put(kOfxParamPropIsAnimating, Prop::ints(&[i32::from(moving)]));
}

fn key_times(handle: OfxParamHandle, call: &str) -> Result<Vec<f64>, OfxStatus> {
    let (param, _) = valued(handle, call)?;
    let track = lock(&param.track);
    Ok(if let Track::Keys(keys) = &*track { keys.iter().map(|(time, _)| *time).collect() } else { Vec::new() })
}

unsafe extern "C" fn get_num_keys(param: OfxParamHandle, out: *mut c_uint) -> OfxStatus {
    let found = key_times(param, "paramGetNumKeys").map(|keys| c_uint::try_from(keys.len()).unwrap_or(0));
    // SAFETY: the plugin's variable, as the standard demands.
    unsafe { answer("paramGetNumKeys", out, found) }
}

unsafe extern "C" fn get_key_time(param: OfxParamHandle, nth: c_uint, out: *mut f64) -> OfxStatus {
    let found = key_times(param, "paramGetKeyTime");
    let found = found.and_then(|keys| keys.get(nth as usize).copied().ok_or(kOfxStatErrBadIndex));
    // SAFETY: the plugin's variable, as the standard demands.
    unsafe { answer("paramGetKeyTime", out, found) }
}

unsafe extern "C" fn get_key_index(param: OfxParamHandle, time: f64, direction: c_int, out: *mut c_int) -> OfxStatus {
    let found = key_times(param, "paramGetKeyIndex").and_then(|keys| {
        let at = match direction {
            0 => keys.iter().position(|key| *key == time),
            1.. => keys.iter().position(|key| *key > time),
            _ => keys.iter().rposition(|key| *key < time),
        };
        at.and_then(|at| c_int::try_from(at).ok()).ok_or(kOfxStatFailed)
    });
    // SAFETY: the plugin's variable, as the standard demands.
    unsafe { answer("paramGetKeyIndex", out, found) }
}

unsafe extern "C" fn delete_key(param: OfxParamHandle, time: f64) -> OfxStatus {
    valued(param, "paramDeleteKey").map_or_else(
        |status| status,
        |(param, _)| match &mut *lock(&param.track) {
            Track::Keys(keys) if keys.len() > 1 && keys.iter().any(|(key, _)| *key == time) => {
                keys.retain(|(key, _)| *key != time);
                kOfxStatOK
            }
            _ => kOfxStatErrBadIndex,
        },
    )
}

unsafe extern "C" fn delete_all_keys(param: OfxParamHandle) -> OfxStatus {
    valued(param, "paramDeleteAllKeys").map_or_else(
        |status| status,
        |(param, effect)| {
            let mut track = lock(&param.track);
            *track = Track::Still(track.at(*lock(&effect.shared.timeline)));
            note_animation(&param, &track);
            kOfxStatOK
        },
    )
}

unsafe extern "C" fn copy(
    to: OfxParamHandle,
    from: OfxParamHandle,
    offset: f64,
    _range: *const OfxRangeD,
) -> OfxStatus {
    match (valued(to, "paramCopy"), valued(from, "paramCopy")) {
        (Ok((to, _)), Ok((from, _))) if to.kind == from.kind => {
            let source = lock(&from.track).clone();
            let copied = match source {
                Track::Keys(keys) => Track::Keys(keys.into_iter().map(|(time, v)| (time + offset, v)).collect()),
                other => other,
            };
            note_animation(&to, &copied);
            *lock(&to.track) = copied;
            kOfxStatOK
        }
        _ => kOfxStatErrBadHandle,
    }
}

unsafe extern "C" fn edit_begin(set: OfxParamSetHandle, _name: *const c_char) -> OfxStatus {
    set_of(set, "paramEditBegin").map_or_else(|status| status, |_| kOfxStatOK)
}

unsafe extern "C" fn edit_end(set: OfxParamSetHandle) -> OfxStatus {
    set_of(set, "paramEditEnd").map_or_else(|status| status, |_| kOfxStatOK)
}
