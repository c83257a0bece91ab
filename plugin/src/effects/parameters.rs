//! The settings table as parameters of a host, in groups; beside them the button that opens files again and the line that
//! says what is loaded.

use std::ffi::CStr;

use relume_core::settings::{self, Kind, Setting, matte, near};

use super::status;
use crate::host::names::*;
use crate::host::{Effect, Params, Properties};

/// Numbers that are degrees of a turn.
const ANGLES: [&Setting; 5] =
    [&settings::ROTATION, &settings::PITCH, &settings::ROLL, &matte::ROTATE, &near::SLIDE_TURN];

/// Numbers that are pixels.
const POSITIONS: [&Setting; 2] = [&matte::POSITION_X, &matte::POSITION_Y];

/// Where the sliders of whole numbers end.
const SLIDER_END: i32 = 500;

/// Parameters shown together.
pub struct Group {
    /// Permanent id.
    pub id: &'static str,
    /// What hosts show.
    pub label: &'static str,
    /// Shown unfolded.
    pub open: bool,
    /// What is in it; next to each other in the table.
    pub settings: &'static [Setting],
}

/// Names an effect and says what it promises, in the action Describe.
pub fn introduce(properties: &Properties<'_>, name: &str, description: &str, contexts: &[&CStr]) {
    for label in [kOfxPropLabel, kOfxPropShortLabel, kOfxPropLongLabel] {
        properties.set_string(label, name);
    }
    properties.set_string(kOfxImageEffectPluginPropGrouping, "Relume");
    properties.set_string(kOfxPropPluginDescription, description);
    properties.set_ints(kOfxPropVersion, &[1, 0, 0]);
    properties.set_string(kOfxPropVersionLabel, env!("CARGO_PKG_VERSION"));
    properties.set_strings(kOfxImageEffectPropSupportedContexts, contexts);
    promise(properties);
}

/// Set in Describe and again in DescribeInContext: some hosts look only at the latter.
pub fn promise(properties: &Properties<'_>) {
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

/// Defines a clip; Output when it is not an input. A clip `whole` is handed out as such even where only a part of the picture is
/// rendered.
pub fn clip<'a>(effect: &Effect<'a>, name: &CStr, components: &[&CStr], whole: bool) -> Option<Properties<'a>> {
    let clip = effect.define_clip(name)?;
    clip.set_strings(kOfxImageEffectPropSupportedComponents, components);
    clip.set_int(kOfxImageEffectPropTemporalClipAccess, 0);
    clip.set_int(kOfxImageEffectPropSupportsTiles, i32::from(!whole));
    Some(clip)
}

/// Defines the parameters of a table, in its order.
pub fn parameters(params: &Params<'_>, table: &[Setting], groups: &[Group]) {
    let group_of = |id: &str| groups.iter().find(|group| group.settings.iter().any(|setting| setting.id == id));
    let mut open = None;
    for setting in table {
        let group = group_of(setting.id);
        let id = group.map(|group| group.id);
        if id != open
            && let Some(group) = group
            && let Some(properties) = params.define(kOfxParamTypeGroup, group.id)
        {
            named(&properties, group.id, group.label, group.label);
            properties.set_int(kOfxParamPropGroupOpen, i32::from(group.open));
        }
        open = id;
        define(params, setting, id);
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
            let whole = angle || POSITIONS.iter().any(|position| position.id == setting.id);
            let kind = if angle { kOfxParamDoubleTypeAngle } else { kOfxParamDoubleTypePlain };
            properties.set_strings(kOfxParamPropDoubleType, &[kind]);
            properties.set_doubles(kOfxParamPropDefault, &[default]);
            range(&properties, [hard.0], [hard.1], [soft.0], [soft.1]);
            properties.set_doubles(kOfxParamPropIncrement, &[if whole { 1.0 } else { 0.1 }]);
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
            // A slider over a million is of no use; typing reaches them all.
            properties.set_int(kOfxParamPropDisplayMin, hard.0);
            properties.set_int(kOfxParamPropDisplayMax, hard.1.min(SLIDER_END));
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
