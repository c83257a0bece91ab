//! A map made ready for projection: clamped, blurred, turned.

use std::borrow::Cow;

use super::{Look, WIDEST_MAP};
use crate::illumination::EnvMap;

/// The map as a look has it, in the stage frame and its own colours: at most [`WIDEST_MAP`] columns, then clamped,
/// then blurred, then turned.
///
/// Turning is what animations change. Whoever renders many turns of one map can clamp and blur it once by
/// [`EnvMap::clamped`] and [`EnvMap::blurred`], and leave both out of the looks.
pub fn prepared(map: &EnvMap, look: &Look) -> EnvMap {
    let map = map.reduced(WIDEST_MAP);
    let map = and_then(map, |map| map.clamped(look.clamp));
    let map = and_then(map, |map| map.blurred(look.blur_deg));
    map.turned(look.centre, &look.orientation())
}

/// The next step, without a copy where neither changes anything.
fn and_then<'a>(map: Cow<'a, EnvMap>, step: impl for<'b> FnOnce(&'b EnvMap) -> Cow<'b, EnvMap>) -> Cow<'a, EnvMap> {
    match map {
        Cow::Borrowed(map) => step(map),
        Cow::Owned(map) => Cow::Owned(step(&map).into_owned()),
    }
}
