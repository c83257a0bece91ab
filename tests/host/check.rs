//! What must be there after the describe actions.

use std::collections::BTreeSet;
use std::ffi::CStr;

use super::effect::Effect;
use super::log::Rule;
use super::ofx::*;
use super::param::{Param, shape};
use super::plugin::Context;
use super::props::{Type, Value};
use super::shared::lock;

/// Checks an effect after Describe.
pub fn described(effect: &Effect) {
    let missing = |what: &str| effect.shared.violate(Rule::Missing, format!("Describe set no {what}"));
    let texts = [(kOfxPropLabel, "label"), (kOfxImageEffectPluginPropGrouping, "grouping")];
    for (property, what) in texts {
        if effect.props.text(property).is_empty() {
            missing(what);
        }
    }
    let lists =
        [(kOfxImageEffectPropSupportedContexts, "contexts"), (kOfxImageEffectPropSupportedPixelDepths, "pixel depths")];
    for (property, what) in lists {
        let values = effect.props.texts(property);
        if values.is_empty() {
            missing(what);
        }
        if values.iter().collect::<BTreeSet<_>>().len() < values.len() {
            effect.shared.violate(Rule::BadValue, format!("{what} repeat: {values:?}"));
        }
    }
    let described = effect.props.get(kOfxImageEffectPluginRenderThreadSafety).is_some_and(|prop| !prop.set.is_empty());
    if !described {
        missing("render thread safety");
    }
}

/// Checks an effect after DescribeInContext.
pub fn described_in(effect: &Effect, context: Context) {
    let contexts = effect.props.texts(kOfxImageEffectPropSupportedContexts);
    if !contexts.contains(&name(context.name())) {
        effect.shared.violate(Rule::BadValue, format!("described in {context:?}, but supports {contexts:?}"));
    }
    check_clips(effect, context);
    let params = lock(&effect.params).clone();
    params.iter().for_each(|param| check_param(effect, param));
}

fn check_clips(effect: &Effect, context: Context) {
    let violate = |rule, what: String| effect.shared.violate(rule, what);
    let mandatory: &[&CStr] = match context {
        Context::Filter => &[kOfxImageEffectSimpleSourceClipName, kOfxImageEffectOutputClipName],
        Context::Generator | Context::General => &[kOfxImageEffectOutputClipName],
    };
    for clip in mandatory.iter().map(|clip| name(clip)) {
        if effect.clip(&clip).is_none() {
            violate(Rule::Missing, format!("the clip {clip} of {context:?}"));
        }
    }
    for clip in lock(&effect.clips).iter() {
        if clip.props.texts(kOfxImageEffectPropSupportedComponents).is_empty() {
            violate(Rule::Missing, format!("clip {} supports no components", clip.name));
        }
        let required = mandatory.iter().any(|name| name.to_bytes() == clip.name.as_bytes());
        let optional = clip.props.numbers(kOfxImageClipPropOptional) == [1.0];
        if context != Context::General && !required && !optional {
            violate(Rule::BadValue, format!("clip {} is not optional in {context:?}", clip.name));
        }
        if clip.is_output() && optional {
            violate(Rule::BadValue, "the output is optional".into());
        }
    }
}

fn check_param(effect: &Effect, param: &Param) {
    let violate = |rule, what: String| effect.shared.violate(rule, format!("parameter {}: {what}", param.name));
    let props = &param.props;
    if props.get(kOfxPropLabel).is_none_or(|label| label.set.is_empty()) || props.text(kOfxPropLabel).is_empty() {
        violate(Rule::Missing, "no label".into());
    }
    let parent = props.text(kOfxParamPropParent);
    if !parent.is_empty() && effect.param(&parent).is_none_or(|group| group.kind != name(kOfxParamTypeGroup)) {
        violate(Rule::UnknownName, format!("its parent {parent:?} is no group"));
    }
    for child in props.texts(kOfxParamPropPageChild) {
        let special = [kOfxParamPageSkipRow, kOfxParamPageSkipColumn].map(name);
        if !special.contains(&child) && effect.param(&child).is_none() {
            violate(Rule::UnknownName, format!("page child {child:?}"));
        }
    }
    let (kind, count) = shape(&param.kind);
    let default = props.get(kOfxParamPropDefault);
    if let Some(default) = default.filter(|default| !default.set.is_empty() && default.set.len() < count) {
        violate(Rule::WrongDimension, format!("only elements {:?} of its default are set", default.set));
    }
    if param.kind == name(kOfxParamTypeChoice) {
        check_choice(param, violate);
    } else if kind != Type::Text {
        check_ranges(param, violate);
    }
}

fn check_choice(param: &Param, violate: impl Fn(Rule, String)) {
    let options = param.props.texts(kOfxParamPropChoiceOption);
    if options.is_empty() {
        violate(Rule::Missing, "no options".into());
    }
    if options.iter().collect::<BTreeSet<_>>().len() < options.len() || options.iter().any(String::is_empty) {
        violate(Rule::BadValue, format!("its options repeat or are empty: {options:?}"));
    }
    let default = param.props.numbers(kOfxParamPropDefault);
    if !default.first().is_some_and(|&at| at >= 0.0 && (at as usize) < options.len()) {
        violate(Rule::BadValue, format!("its default {default:?} is none of {} options", options.len()));
    }
}

fn check_ranges(param: &Param, violate: impl Fn(Rule, String)) {
    let numbers = |property| param.props.numbers(property);
    let (low, high) = (numbers(kOfxParamPropMin), numbers(kOfxParamPropMax));
    let (shown_low, shown_high) = (numbers(kOfxParamPropDisplayMin), numbers(kOfxParamPropDisplayMax));
    for (at, default) in numbers(kOfxParamPropDefault).iter().enumerate() {
        let inside = |low: &[f64], high: &[f64], value: f64| {
            low.get(at).is_none_or(|low| *low <= value) && high.get(at).is_none_or(|high| value <= *high)
        };
        if !inside(&low, &high, *default) {
            violate(Rule::BadValue, format!("its default {default} is outside {low:?}..{high:?}"));
        }
        let shown = shown_low.get(at).zip(shown_high.get(at));
        if shown.is_some_and(|(a, b)| a > b) {
            violate(Rule::BadValue, format!("its display range {shown_low:?}..{shown_high:?} is backwards"));
        }
        // Hosts that find no display range show 0..1 or -1..1 and clamp to it.
        let described = |property: &CStr| param.props.get(property).is_none_or(|prop| !prop.set.is_empty());
        if ![kOfxParamPropMin, kOfxParamPropMax, kOfxParamPropDisplayMin, kOfxParamPropDisplayMax]
            .into_iter()
            .all(described)
        {
            violate(Rule::Missing, "range or display range not set".into());
        }
    }
}

/// Whether the values fit a property's legal ones; for host-side sets.
pub fn in_range(param: &Param, values: &[Value]) -> bool {
    let (low, high) = (param.props.numbers(kOfxParamPropMin), param.props.numbers(kOfxParamPropMax));
    values.iter().enumerate().all(|(at, value)| {
        let number = match value {
            Value::Int(number) => f64::from(*number),
            Value::Double(number) => *number,
            _ => return true,
        };
        low.get(at).is_none_or(|low| *low <= number) && high.get(at).is_none_or(|high| number <= *high)
    })
}
