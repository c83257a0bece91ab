//! What the effect promises, and its clips and parameters.

use relume_core::settings::{self, matte};

use crate::effects::parameters::{self, Group};
use crate::effects::{OUTPUT, SOURCE};
use crate::host::names::*;
use crate::host::{Call, Reply};

/// Where the object stands, what it is lit by, and its answer.
const GROUPS: &[Group] = &[
    Group {
        id: "placeGroup",
        label: "Place",
        open: true,
        settings: &[matte::POSITION_X, matte::POSITION_Y, matte::SCALE, matte::ROTATE],
    },
    Group {
        id: "lightGroup",
        label: "Light",
        open: true,
        settings: &[
            settings::EXPOSURE,
            settings::TINT,
            matte::BEYOND,
            matte::BEYOND_COLOUR,
            matte::BEYOND_MAP,
            settings::MAP_CENTRE,
            matte::VIEW_ANGLE,
        ],
    },
    Group { id: "responseGroup", label: "Response", open: true, settings: &[settings::AMBIENT, matte::REPRESENTATION] },
];

const DESCRIPTION: &str = "Puts an object that was captured in front of a screen (a .rfield asset made with Relume) before Source, \
    which it reflects, refracts and lets through. Float pixels are linear; 8-bit pixels are taken as sRGB.";

/// What holds in every context.
pub fn describe(call: &Call<'_>) -> Reply {
    let Some(properties) = call.effect.properties() else { return Reply::Failed };
    let contexts = [kOfxImageEffectContextFilter, kOfxImageEffectContextGeneral];
    parameters::introduce(&properties, "Relume Environment Matte", DESCRIPTION, &contexts);
    Reply::Ok
}

/// Clips and parameters, the same in every context.
pub fn describe_in_context(call: &Call<'_>) -> Reply {
    if let Some(properties) = call.effect.properties() {
        parameters::promise(&properties);
    }
    let rgb = [kOfxImageComponentRGBA, kOfxImageComponentRGB];
    // All of the plate is light, whatever part of the picture is rendered.
    if let Some(clip) = parameters::clip(&call.effect, SOURCE, &rgb, true) {
        clip.set_int(kOfxImageClipPropOptional, 0);
    }
    parameters::clip(&call.effect, OUTPUT, &rgb[..1], false);
    match call.effect.params() {
        Some(params) => parameters::parameters(&params, matte::MATTE, GROUPS),
        None => return Reply::Failed,
    }
    Reply::Ok
}
