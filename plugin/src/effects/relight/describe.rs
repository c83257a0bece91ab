//! What the effect promises, and its clips and parameters.

use std::ffi::{CStr, CString};

use relume_core::settings::{self, Kind, Setting};

use super::{ILLUMINATION, OUTPUT, SOURCE, controls, defines, status};
use crate::host::names::*;
use crate::host::{Call, Effect, Params, Properties, Reply};

/// Parameters that turn the light.
const LIGHT: (&str, &str) = ("lightGroup", "Light");
/// Parameters of the answer to it.
const RESPONSE: (&str, &str) = ("responseGroup", "Response");

/// Numbers that are degrees of a turn.
const ANGLES: [&Setting; 3] = [&settings::ROTATION, &settings::PITCH, &settings::ROLL];

const DESCRIPTION: &str = "Lights a captured object (a .rfield asset made with Relume) with a lat-long environment, \
    a clip, lamps or one of the captured lamps, and composites it over Source. Float pixels are linear; 8-bit pixels are taken as sRGB.";

/// What holds in every context.
pub fn describe(call: &Call<'_>) -> Reply {
    let Some(properties) = call.effect.properties() else { return Reply::Failed };
    for label in [kOfxPropLabel, kOfxPropShortLabel, kOfxPropLongLabel] {
        properties.set_string(label, "Relume Relight");
    }
    properties.set_string(kOfxImageEffectPluginPropGrouping, "Relume");
    properties.set_string(kOfxPropPluginDescription, DESCRIPTION);
    properties.set_ints(kOfxPropVersion, &[1, 0, 0]);
    properties.set_string(kOfxPropVersionLabel, env!("CARGO_PKG_VERSION"));
    let contexts = [kOfxImageEffectContextFilter, kOfxImageEffectContextGeneral, kOfxImageEffectContextGenerator];
    properties.set_strings(kOfxImageEffectPropSupportedContexts, &contexts);
    promise(&properties);
    Reply::Ok
}

/// Set in Describe and again in DescribeInContext: some hosts look only at the latter.
fn promise(properties: &Properties<'_>) {
    properties.set_strings(kOfxImageEffectPropSupportedPixelDepths, &[kOfxBitDepthByte, kOfxBitDepthFloat]);
    properties.set_strings(kOfxImageEffectPluginRenderThreadSafety, &[kOfxImageEffectRenderFullySafe]);
    for (name, value) in [
        (kOfxImageEffectPluginPropSingleInstance, 0),
        (kOfxImageEffectPluginPropHostFrameThreading, 0),
        (kOfxImageEffectPropSupportsMultiResolution, 1),
        (kOfxImageEffectPropSupportsTiles, 1),
        (kOfxImageEffectPropTemporalClipAccess, 0),
        (kOfxImageEffectPluginPropFieldRenderTwiceAlways, 0),
        (kOfxImageEffectPropSupportsMultipleClipDepths, 0),
        (kOfxImageEffectPropSupportsMultipleClipPARs, 0),
    ] {
        properties.set_int(name, value);
    }
}

/// Clips and parameters of one context.
pub fn describe_in_context(call: &Call<'_>) -> Reply {
    let Some(context) = call.args.and_then(|args| args.string(kOfxImageEffectPropContext, 0)) else {
        return Reply::Failed;
    };
    if let Some(properties) = call.effect.properties() {
        promise(&properties);
    }
    let Ok(context) = CString::new(context) else { return Reply::Failed };
    let rgb = [kOfxImageComponentRGBA, kOfxImageComponentRGB];
    // Source first: some hosts take the first clip for the main one. Only a filter must have it.
    let optional = context.as_c_str() != kOfxImageEffectContextFilter;
    for name in [SOURCE, ILLUMINATION].into_iter().filter(|name| defines(&context, name)) {
        clip(&call.effect, name, &rgb, optional);
    }
    clip(&call.effect, OUTPUT, &rgb[..1], false);
    match call.effect.params() {
        Some(params) => parameters(&params),
        None => return Reply::Failed,
    }
    Reply::Ok
}

fn clip(effect: &Effect<'_>, name: &CStr, components: &[&CStr], optional: bool) {
    let Some(clip) = effect.define_clip(name) else { return };
    clip.set_strings(kOfxImageEffectPropSupportedComponents, components);
    clip.set_int(kOfxImageEffectPropTemporalClipAccess, 0);
    clip.set_int(kOfxImageEffectPropSupportsTiles, i32::from(name != ILLUMINATION));
    if name == OUTPUT {
        return;
    }
    clip.set_int(kOfxImageClipPropOptional, i32::from(optional));
    if name == ILLUMINATION {
        clip.set_string(kOfxPropLabel, "Illumination");
    }
}

fn parameters(params: &Params<'_>) {
    let (light, response) = (
        [
            &settings::ENVIRONMENT,
            &settings::LIGHTING,
            &settings::LIGHTING_FILE,
            &settings::LAMP,
            &settings::ROTATION,
            &settings::PITCH,
            &settings::ROLL,
            &settings::MAP_CENTRE,
            &settings::MAP_SPACE,
            &settings::BLUR,
            &settings::CLAMP,
            &settings::EXPOSURE,
            &settings::TINT,
        ],
        [&settings::AMBIENT, &settings::REPRESENTATION, &settings::RECONSTRUCTION, &settings::OUTSIDE],
    );
    let group_of = |id: &str| {
        let within = |group: &[&Setting]| group.iter().any(|setting| setting.id == id);
        if within(&light) { Some(LIGHT) } else { within(&response).then_some(RESPONSE) }
    };
    let mut open = None;
    for setting in settings::RELIGHT {
        let group = group_of(setting.id);
        if group != open
            && let Some((id, label)) = group
            && let Some(properties) = params.define(kOfxParamTypeGroup, id)
        {
            named(&properties, id, label, label);
            properties.set_int(kOfxParamPropGroupOpen, 1);
        }
        open = group;
        define(params, setting, group.map(|(id, _)| id));
        if setting.id == settings::ASSET.id {
            reload(params);
            status_line(params);
        }
    }
}

fn named(properties: &Properties<'_>, id: &str, label: &str, hint: &str) {
    for name in [kOfxPropLabel, kOfxPropShortLabel, kOfxPropLongLabel] {
        properties.set_string(name, label);
    }
    properties.set_string(kOfxParamPropScriptName, id);
    properties.set_string(kOfxParamPropHint, hint);
}

fn define(params: &Params<'_>, setting: &Setting, group: Option<&str>) {
    let kind = match setting.kind {
        Kind::Number { .. } => kOfxParamTypeDouble,
        Kind::Colour { .. } => kOfxParamTypeRGB,
        Kind::Integer { .. } => kOfxParamTypeInteger,
        Kind::Choice { .. } => kOfxParamTypeChoice,
        Kind::File => kOfxParamTypeString,
    };
    let Some(properties) = params.define(kind, setting.id) else { return };
    named(&properties, setting.id, setting.label, setting.hint);
    if let Some(group) = group {
        properties.set_string(kOfxParamPropParent, group);
    }
    match setting.kind {
        Kind::Number { default, hard, soft } => {
            let angle = ANGLES.iter().any(|angle| angle.id == setting.id);
            let kind = if angle { kOfxParamDoubleTypeAngle } else { kOfxParamDoubleTypePlain };
            properties.set_strings(kOfxParamPropDoubleType, &[kind]);
            properties.set_doubles(kOfxParamPropDefault, &[default]);
            range(&properties, [hard.0], [hard.1], [soft.0], [soft.1]);
            properties.set_doubles(kOfxParamPropIncrement, &[if angle { 1.0 } else { 0.1 }]);
            properties.set_int(kOfxParamPropDigits, 3);
        }
        Kind::Colour { default, hard, soft } => {
            properties.set_doubles(kOfxParamPropDefault, &default);
            range(&properties, [hard.0; 3], [hard.1; 3], [soft.0; 3], [soft.1; 3]);
        }
        Kind::Integer { default, hard } => {
            properties.set_int(kOfxParamPropDefault, default);
            for (name, value) in [(kOfxParamPropMin, hard.0), (kOfxParamPropMax, hard.1)] {
                properties.set_int(name, value);
            }
            // A slider over a million lamps is of no use; typing reaches them all.
            properties.set_int(kOfxParamPropDisplayMin, hard.0);
            properties.set_int(kOfxParamPropDisplayMax, hard.1.min(controls::LAMP_SLIDER_END));
        }
        Kind::Choice { default, options } => {
            for (index, (_, label)) in options.iter().enumerate() {
                properties.set_string_at(kOfxParamPropChoiceOption, index, label);
            }
            properties.set_int(kOfxParamPropDefault, i32::try_from(default).unwrap_or(0));
            properties.set_int(kOfxParamPropAnimates, 0);
        }
        Kind::File => {
            properties.set_strings(kOfxParamPropStringMode, &[kOfxParamStringIsFilePath]);
            // The file need not exist: it may lie on a path that only the render farm has.
            properties.set_int(kOfxParamPropStringFilePathExists, 0);
            properties.set_string(kOfxParamPropDefault, "");
            properties.set_int(kOfxParamPropAnimates, 0);
        }
    }
}

/// Both ranges: a host takes +-1 for a display range that is missing.
fn range<const N: usize>(properties: &Properties<'_>, least: [f64; N], most: [f64; N], low: [f64; N], high: [f64; N]) {
    for (name, values) in [
        (kOfxParamPropMin, least),
        (kOfxParamPropMax, most),
        (kOfxParamPropDisplayMin, low),
        (kOfxParamPropDisplayMax, high),
    ] {
        properties.set_doubles(name, &values);
    }
}

fn reload(params: &Params<'_>) {
    let Some(properties) = params.define(kOfxParamTypePushButton, status::RELOAD) else { return };
    named(&properties, status::RELOAD, "Reload", "Opens the asset and the files of the light again.");
    let Some(properties) = params.define(kOfxParamTypeInteger, status::RELOADS) else { return };
    named(&properties, status::RELOADS, "Reloads", "Counts reloads, so that the host renders again.");
    properties.set_int(kOfxParamPropDefault, 0);
    for (least, most) in [(kOfxParamPropMin, kOfxParamPropMax), (kOfxParamPropDisplayMin, kOfxParamPropDisplayMax)] {
        properties.set_int(least, 0);
        properties.set_int(most, i32::from(i16::MAX));
    }
    properties.set_int(kOfxParamPropSecret, 1);
    properties.set_int(kOfxParamPropAnimates, 0);
}

/// Text for the artist alone: not saved, not undone, no reason to render.
fn status_line(params: &Params<'_>) {
    let Some(properties) = params.define(kOfxParamTypeString, status::STATUS) else { return };
    named(&properties, status::STATUS, "Status", "What is loaded, or what is wrong.");
    properties.set_strings(kOfxParamPropStringMode, &[kOfxParamStringIsLabel]);
    properties.set_string(kOfxParamPropDefault, status::EMPTY);
    for name in [
        kOfxParamPropEnabled,
        kOfxParamPropAnimates,
        kOfxParamPropCanUndo,
        kOfxParamPropPersistant,
        kOfxParamPropEvaluateOnChange,
    ] {
        properties.set_int(name, 0);
    }
}
