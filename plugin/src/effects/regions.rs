//! Regions of clips; clip preferences.

use super::placement::finite;
use crate::host::names::*;
use crate::host::{Call, Clip, Effect, Image, Layout, Rect, Reply};

/// The plate's region, which is the output's as well: Source's own, or the project's where Source has no end. `None`
/// where nothing is connected.
pub fn plate(effect: &Effect<'_>, source: Option<&Clip<'_>>, time: f64) -> Option<Rect<f64>> {
    let region = source?.region(time)?;
    finite(region).or_else(|| project(effect))
}

/// The project's region in canonical coordinates.
pub fn project(effect: &Effect<'_>) -> Option<Rect<f64>> {
    let properties = effect.properties()?;
    let [x1, y1] = properties.doubles(kOfxImageEffectPropProjectOffset).unwrap_or_default();
    let [width, height] = properties.doubles(kOfxImageEffectPropProjectSize)?;
    let sensible = width > 0.0 && height > 0.0;
    sensible.then_some(Rect { x1, y1, x2: x1 + width, y2: y1 + height }).and_then(finite)
}

/// The canonical region that an image says it has, rendered at a scale.
pub fn of_image(image: &Image<'_>, scale: (f64, f64)) -> Rect<f64> {
    let Layout { region, aspect, .. } = *image.layout();
    let (x, y) = (|x: i32| f64::from(x) * aspect / scale.0, |y: i32| f64::from(y) / scale.1);
    Rect { x1: x(region.x1), y1: y(region.y1), x2: x(region.x2), y2: y(region.y2) }
}

/// Answers which region the output has; a host's own idea where that is not known.
pub fn answer(call: &Call<'_>, region: Option<Rect<f64>>) -> Reply {
    match (region, call.answers) {
        (Some(Rect { x1, y1, x2, y2 }), Some(answers)) => {
            answers.set_doubles(kOfxImageEffectPropRegionOfDefinition, &[x1, y1, x2, y2]);
            Reply::Ok
        }
        _ => Reply::Default,
    }
}

/// The output is premultiplied RGBA whatever Source is.
pub fn preferences(call: &Call<'_>) -> Reply {
    let Some(answers) = call.answers else { return Reply::Default };
    answers.set_strings(c"OfxImageClipPropComponents_Output", &[kOfxImageComponentRGBA]);
    answers.set_strings(kOfxImageEffectPropPreMultiplication, &[kOfxImagePreMultiplied]);
    Reply::Ok
}
