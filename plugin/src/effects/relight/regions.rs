//! Region of definition, regions of interest.

use super::controls::Controls;
use super::library::{Instance, Library};
use super::{ILLUMINATION, declared, input};
use crate::effects::placement::{Placement, finite};
use crate::effects::{SOURCE, regions};
use crate::host::names::*;
use crate::host::{Call, Rect, Reply};

/// The output has the region of Source, or else the asset's size. An asset that cannot be opened is no failure here:
/// rendering says what is wrong, and hosts take a failure of this action badly.
pub fn definition(library: &Library, instance: &Instance, call: &Call<'_>) -> Reply {
    let time = call.args.and_then(|args| args.double(kOfxPropTime, 0)).unwrap_or_default();
    let plate = regions::plate(&call.effect, input(&call.effect, SOURCE).as_ref(), time);
    let region = plate.or_else(|| {
        let field = library.field(instance, &Controls::read(&call.effect, time).asset).ok()?;
        Some(Placement::own_format((field.asset().width(), field.asset().height())).region())
    });
    regions::answer(call, region)
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
        && let Some(Rect { x1, y1, x2, y2 }) = finite(whole).or_else(|| regions::project(&call.effect))
    {
        answers.set_doubles(c"OfxImageClipPropRoI_Illumination", &[x1, y1, x2, y2]);
    }
    Reply::Ok
}
