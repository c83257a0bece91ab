//! What is loaded, in words.

use relume_core::field::Kind;

use super::controls::Controls;
use super::library::{Instance, Library};
use super::near;
use super::{ILLUMINATION, input};
use crate::effects::files::file_name;
use crate::effects::status::{Depth, EMPTY, Speaker};
use crate::error::{Error, Result};
use crate::host::Effect;

/// What an asset of lamps says to light near it.
const LAMPS_ARE_FAR: &str = "Its lamps were far away, so light near the object cannot differ from point to point: set Near light in space to Flat, or use an asset captured with a projector.";

/// An instance with what it shares.
pub struct Voice<'a> {
    pub library: &'a Library,
    pub instance: &'a Instance,
}

impl Speaker for Voice<'_> {
    fn line(&self, effect: &Effect<'_>, time: f64, depth: Depth) -> Result<String> {
        let controls = Controls::read(effect, time);
        if controls.asset.trim().is_empty() {
            return Ok(EMPTY.to_owned());
        }
        line(self.library, self.instance, effect, &controls, depth)
    }

    fn forget(&self, effect: &Effect<'_>, time: f64) {
        self.library.forget(self.instance, &Controls::read(effect, time));
    }
}

fn line(
    library: &Library,
    instance: &Instance,
    effect: &Effect<'_>,
    controls: &Controls,
    depth: Depth,
) -> Result<String> {
    let field = library.field(instance, &controls.asset)?;
    let asset = field.asset();
    let lamps = asset.domain().len();
    let lights = match asset.domain().gantry() {
        Some(gantry) => format!("{} positions of {} x {} squares", gantry.len(), gantry.side(), gantry.side()),
        None => format!("{lamps} lamps"),
    };
    let form = match field.choose(controls.look.representation, controls.lamp.is_some())? {
        Kind::Dense => String::new(),
        kind => format!(", {}", kind.id()),
    };
    let (name, width, height) = (file_name(&controls.asset), asset.width(), asset.height());
    let about = format!("{name}: {width} x {height} pixels, {lights}{form}.");
    if input(effect, ILLUMINATION).is_some() {
        return Ok(format!("{about} Light: the Illumination clip."));
    }
    if controls.lamp.is_none() && controls.near.is_on() {
        if asset.domain().gantry().is_none() && !controls.near.flat {
            return Ok(format!("{about} {LAMPS_ARE_FAR}"));
        }
        // The files of the light tell what is wrong with them here too.
        let lights = library.near(instance, &controls.near)?;
        let flat = if controls.near.flat { ", flat" } else { "" };
        return Ok(format!("{about} Light: {}{flat}.", near::said(&controls.near, &lights)));
    }
    if let (None, Some(file)) = (controls.lamp, controls.lighting_file()) {
        let beams = library.lighting(instance, file)?.len();
        return Ok(format!("{about} Light: {}, {beams} beams.", file_name(file)));
    }
    if let (None, Some(preset)) = (controls.lamp, controls.lighting) {
        return Ok(format!("{about} Light: {}.", preset.label));
    }
    match controls.lamp {
        Some(lamp) if lamp > lamps => Ok(format!("{about} There is no lamp {lamp}; lower Lamp to {lamps} or less.")),
        Some(lamp) => Ok(format!("{about} Light: lamp {lamp}.")),
        None if depth == Depth::Asset && !controls.environment.trim().is_empty() => {
            Ok(format!("{about} Light: {}.", file_name(&controls.environment)))
        }
        None => match library.map(instance, &controls.environment) {
            Ok(map) => {
                let (width, height) = map.image().size();
                Ok(format!("{about} Light: {}, {width} x {height}.", file_name(&controls.environment)))
            }
            Err(Error::Missing(what)) => Ok(format!("{about} {what}")),
            Err(error) => Err(error),
        },
    }
}
