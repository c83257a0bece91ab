//! The line of text that says what is loaded, or what is wrong. Written when an instance is made and when something
//! changes, never while rendering: the standard forbids that.

use crate::error::Result;
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
pub enum Depth {
    /// The asset alone.
    Asset,
    /// The map as well.
    AssetAndMap,
}

/// An instance that can say what it has loaded.
pub trait Speaker {
    /// What is loaded.
    ///
    /// # Errors
    /// What is wrong.
    fn line(&self, effect: &Effect<'_>, time: f64, depth: Depth) -> Result<String>;

    /// Makes the next picture open the files again.
    fn forget(&self, effect: &Effect<'_>, time: f64);
}

/// A project is being opened, or the effect was just added.
pub fn created(speaker: &impl Speaker, call: &Call<'_>) {
    write(speaker, call, 0.0, Depth::Asset);
}

/// The artist, or the host, changed something.
pub fn changed(speaker: &impl Speaker, call: &Call<'_>) -> Reply {
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
        speaker.forget(&call.effect, time);
        if let Some(params) = call.effect.params() {
            let count = params.int(RELOADS, time).unwrap_or_default();
            params.set_int(RELOADS, count.wrapping_add(1) & i32::from(i16::MAX));
        }
    }
    write(speaker, call, time, Depth::AssetAndMap);
    Reply::Ok
}

fn write(speaker: &impl Speaker, call: &Call<'_>, time: f64, depth: Depth) {
    let Some(params) = call.effect.params() else { return };
    let line = speaker.line(&call.effect, time, depth).unwrap_or_else(|error| error.to_string());
    // Hosts mark a project as changed when a value is set, even to what it was.
    if params.string(STATUS, time).as_deref() != Some(&line) {
        params.set_string(STATUS, &line);
    }
}
