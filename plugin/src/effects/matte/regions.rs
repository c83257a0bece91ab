//! Region of definition, regions of interest.

use super::source;
use crate::effects::regions;
use crate::host::names::*;
use crate::host::{Call, Rect, Reply};

/// The output has the region of Source.
pub fn definition(call: &Call<'_>) -> Reply {
    let time = call.args.and_then(|args| args.double(kOfxPropTime, 0)).unwrap_or_default();
    regions::answer(call, regions::plate(&call.effect, source(&call.effect).as_ref(), time))
}

/// All of Source is light, however small the window.
pub fn interest(call: &Call<'_>) -> Reply {
    let (Some(args), Some(answers)) = (call.args, call.answers) else { return Reply::Default };
    let time = args.double(kOfxPropTime, 0).unwrap_or_default();
    let Some(whole) = regions::plate(&call.effect, source(&call.effect).as_ref(), time) else { return Reply::Default };
    let asked = args.doubles::<4>(kOfxImageEffectPropRegionOfInterest);
    let [x1, y1, x2, y2] = asked.unwrap_or([whole.x1, whole.y1, whole.x2, whole.y2]);
    let Rect { x1, y1, x2, y2 } =
        Rect { x1: x1.min(whole.x1), y1: y1.min(whole.y1), x2: x2.max(whole.x2), y2: y2.max(whole.y2) };
    answers.set_doubles(c"OfxImageClipPropRoI_Source", &[x1, y1, x2, y2]);
    Reply::Ok
}
