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

/// The canonical region of a plate: as the clip tells it; as the image does where the clip tells nothing, or something that no
/// rounding explains (clips of MLT tell theirs in the pixels of a proxy).
pub fn seen(told: Option<Rect<f64>>, image: Option<&Image<'_>>, scale: (f64, f64)) -> Option<Rect<f64>> {
    let Some(image) = image else { return told };
    let shown = of_image(image, scale);
    let Some(told) = told else { return Some(shown) };
    let layout = image.layout();
    let pixel = (layout.aspect / scale.0, 1.0 / scale.1);
    let differs = layout.region_told && finite(shown).is_some() && !agree(&told, &shown, pixel);
    Some(if differs { shown } else { told })
}

/// Are all edges within a pixel and a bit of each other?
fn agree(a: &Rect<f64>, b: &Rect<f64>, pixel: (f64, f64)) -> bool {
    let near = |a: f64, b: f64, pixel: f64| (a - b).abs() <= 1.01 * pixel;
    near(a.x1, b.x1, pixel.0) && near(a.x2, b.x2, pixel.0) && near(a.y1, b.y1, pixel.1) && near(a.y2, b.y2, pixel.1)
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rounding_is_no_disagreement() {
        let rect = |x2: f64| Rect { x1: 0.0, y1: 0.0, x2, y2: 1081.0 };
        // 1921 x 1081 at half: 961 x 541 pixels of two units, or 960 x 540.
        assert!(agree(&rect(1921.0), &Rect { y2: 1082.0, ..rect(1922.0) }, (2.0, 2.0)));
        assert!(agree(&rect(1921.0), &Rect { y2: 1080.0, ..rect(1920.0) }, (2.0, 2.0)));
        assert!(!agree(&rect(1921.0), &rect(960.0), (2.0, 2.0)));
        assert!(!agree(&rect(1921.0), &Rect { y1: 5.0, ..rect(1921.0) }, (2.0, 2.0)));
    }
}
