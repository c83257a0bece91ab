//! The line of text that says what is loaded, or what is wrong. Written when an instance is made and when something
//! changes, never while rendering: the standard forbids that.

use relume_core::field::Kind;

use super::assets::{Library, file_name};
use super::controls::Controls;
use super::{ILLUMINATION, Instance, input};
use crate::error::{Error, Result};
use crate::host::names::*;
use crate::host::{Call, Effect, Reply};

/// Id of the line.
pub const STATUS: &str = "status";
/// What it says before anything is set.
pub const EMPTY: &str = "No asset.";
/// Id of the button that opens the files again.
pub const RELOAD: &str = "reload";
/// Id of the hidden count of reloads: a button alone does not make a host render again, a changed value does.
pub const RELOADS: &str = "reloads";

/// How far to look: opening an asset is quick, reading a large map is not.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Depth {
    Asset,
    AssetAndMap,
}

/// A project is being opened, or the effect was just added.
pub fn created(library: &Library, instance: &Instance, call: &Call<'_>) {
    write(library, instance, call, 0.0, Depth::Asset);
}

/// The artist, or the host, changed something.
pub fn changed(library: &Library, instance: &Instance, call: &Call<'_>) -> Reply {
    let Some(args) = call.args else { return Reply::Default };
    let (name, reason) = (args.string(kOfxPropName, 0), args.string(kOfxPropChangeReason, 0));
    let reason = reason.unwrap_or_default();
    let name = name.unwrap_or_default();
    // Our own writing comes back as a change.
    if reason.as_bytes() == kOfxChangeTime.to_bytes() || [STATUS, RELOADS].contains(&name.as_str()) {
        return Reply::Ok;
    }
    let time = args.double(kOfxPropTime, 0).unwrap_or_default();
    if name == RELOAD {
        let controls = Controls::read(&call.effect, time);
        library.forget(instance, &controls);
        if let Some(params) = call.effect.params() {
            let count = params.int(RELOADS, time).unwrap_or_default();
            params.set_int(RELOADS, count.wrapping_add(1) & i32::from(i16::MAX));
        }
    }
    write(library, instance, call, time, Depth::AssetAndMap);
    Reply::Ok
}

fn write(library: &Library, instance: &Instance, call: &Call<'_>, time: f64, depth: Depth) {
    let Some(params) = call.effect.params() else { return };
    let controls = Controls::read(&call.effect, time);
    let line = if controls.asset.trim().is_empty() {
        EMPTY.to_owned()
    } else {
        line(library, instance, &call.effect, &controls, depth).unwrap_or_else(|error| error.to_string())
    };
    // Hosts mark a project as changed when a value is set, even to what it was.
    if params.string(STATUS, time).as_deref() != Some(&line) {
        params.set_string(STATUS, &line);
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
    let form = match field.choose(controls.look.representation, controls.lamp.is_some())? {
        Kind::Dense => String::new(),
        kind => format!(", {}", kind.id()),
    };
    let (name, width, height) = (file_name(&controls.asset), asset.width(), asset.height());
    let about = format!("{name}: {width} x {height} pixels, {lamps} lamps{form}.");
    if input(effect, ILLUMINATION).is_some() {
        return Ok(format!("{about} Light: the Illumination clip."));
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
