//! Region of definition, regions of interest, clip preferences.

use super::assets::Library;
use super::controls::Controls;
use super::placement::{Placement, finite};
use super::{ILLUMINATION, Instance, SOURCE, declared, input};
use crate::host::names::*;
use crate::host::{Call, Effect, Rect, Reply};

/// The plate's region, which is the output's as well: Source's own, or the project's where Source has no end. `None`
/// where nothing is connected.
pub fn plate(effect: &Effect<'_>, time: f64) -> Option<Rect<f64>> {
    let region = input(effect, SOURCE)?.region(time)?;
    finite(region).or_else(|| project(effect))
}

/// The project's region in canonical coordinates.
fn project(effect: &Effect<'_>) -> Option<Rect<f64>> {
    let properties = effect.properties()?;
    let [x1, y1] = properties.doubles(kOfxImageEffectPropProjectOffset).unwrap_or_default();
    let [width, height] = properties.doubles(kOfxImageEffectPropProjectSize)?;
    let sensible = width > 0.0 && height > 0.0;
    sensible.then_some(Rect { x1, y1, x2: x1 + width, y2: y1 + height }).and_then(finite)
}

/// The output has the region of Source, or else the asset's size. An asset that cannot be opened is no failure here:
/// rendering says what is wrong, and hosts take a failure of this action badly.
pub fn definition(library: &Library, instance: &Instance, call: &Call<'_>) -> Reply {
    let time = call.args.and_then(|args| args.double(kOfxPropTime, 0)).unwrap_or_default();
    let region = plate(&call.effect, time).or_else(|| {
        let field = library.field(instance, &Controls::read(&call.effect, time).asset).ok()?;
        Some(Placement::own_format((field.asset().width(), field.asset().height())).region())
    });
    match (region, call.answers) {
        (Some(Rect { x1, y1, x2, y2 }), Some(answers)) => {
            answers.set_doubles(kOfxImageEffectPropRegionOfDefinition, &[x1, y1, x2, y2]);
            Reply::Ok
        }
        _ => Reply::Default,
    }
}

/// Source is needed where the output is; the Illumination as a whole, however small the window.
pub fn interest(call: &Call<'_>) -> Reply {
    let (Some(args), Some(answers)) = (call.args, call.answers) else { return Reply::Default };
    let time = args.double(kOfxPropTime, 0).unwrap_or_default();
    if declared(&call.effect, SOURCE).is_some()
        && let Some(region) = args.doubles::<4>(kOfxImageEffectPropRegionOfInterest)
    {
        answers.set_doubles(c"OfxImageClipPropRoI_Source", &region);
    }
    if let Some(clip) = declared(&call.effect, ILLUMINATION)
        && let Some(whole) = clip.region(time)
        && let Some(Rect { x1, y1, x2, y2 }) = finite(whole).or_else(|| project(&call.effect))
    {
        answers.set_doubles(c"OfxImageClipPropRoI_Illumination", &[x1, y1, x2, y2]);
    }
    Reply::Ok
}

/// The output is premultiplied RGBA whatever Source is.
pub fn preferences(call: &Call<'_>) -> Reply {
    let Some(answers) = call.answers else { return Reply::Default };
    answers.set_strings(c"OfxImageClipPropComponents_Output", &[kOfxImageComponentRGBA]);
    answers.set_strings(kOfxImageEffectPropPreMultiplication, &[kOfxImagePreMultiplied]);
    Reply::Ok
}
