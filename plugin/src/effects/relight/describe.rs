//! What the effect promises, and its clips and parameters.

use std::ffi::CString;

use relume_core::settings::{self, near};

use super::{ILLUMINATION, defines};
use crate::effects::parameters::{self, Group};
use crate::effects::{OUTPUT, SOURCE};
use crate::host::names::*;
use crate::host::{Call, Reply};

/// Parameters that turn the light, and of the answer to it.
const GROUPS: &[Group] = &[
    Group {
        id: "lightGroup",
        label: "Light",
        open: true,
        settings: &[
            settings::ENVIRONMENT,
            settings::LIGHTING,
            settings::LIGHTING_FILE,
            settings::LAMP,
            settings::ROTATION,
            settings::PITCH,
            settings::ROLL,
            settings::MAP_CENTRE,
            settings::MAP_SPACE,
            settings::BLUR,
            settings::CLAMP,
            settings::EXPOSURE,
            settings::TINT,
        ],
    },
    Group {
        id: "nearGroup",
        label: "Near light",
        open: true,
        settings: &[near::LIGHT4D, near::LIGHT4D_FILE, near::SPACE],
    },
    Group { id: "beam1Group", label: "Beam 1", open: false, settings: &near::BEAM_TABLES[0] },
    Group { id: "beam2Group", label: "Beam 2", open: false, settings: &near::BEAM_TABLES[1] },
    Group { id: "beam3Group", label: "Beam 3", open: false, settings: &near::BEAM_TABLES[2] },
    Group { id: "beam4Group", label: "Beam 4", open: false, settings: &near::BEAM_TABLES[3] },
    Group { id: "slideGroup", label: "Slide", open: false, settings: &near::SLIDE_TABLE },
    Group {
        id: "responseGroup",
        label: "Response",
        open: true,
        settings: &[settings::AMBIENT, settings::REPRESENTATION, settings::RECONSTRUCTION, settings::OUTSIDE],
    },
];

const DESCRIPTION: &str = "Lights a captured object (a .rfield asset made with Relume) with a lat-long environment, \
    a clip, lamps far or near, a thrown picture or one of the captured lamps, and composites it over Source. Float pixels are linear; 8-bit pixels are taken as sRGB.";

/// What holds in every context.
pub fn describe(call: &Call<'_>) -> Reply {
    let Some(properties) = call.effect.properties() else { return Reply::Failed };
    let contexts = [kOfxImageEffectContextFilter, kOfxImageEffectContextGeneral, kOfxImageEffectContextGenerator];
    parameters::introduce(&properties, "Relume Relight", DESCRIPTION, &contexts);
    Reply::Ok
}

/// Clips and parameters of one context.
pub fn describe_in_context(call: &Call<'_>) -> Reply {
    let Some(context) = call.args.and_then(|args| args.string(kOfxImageEffectPropContext, 0)) else {
        return Reply::Failed;
    };
    if let Some(properties) = call.effect.properties() {
        parameters::promise(&properties);
    }
    let Ok(context) = CString::new(context) else { return Reply::Failed };
    let rgb = [kOfxImageComponentRGBA, kOfxImageComponentRGB];
    // Source first: some hosts take the first clip for the main one. Only a filter must have it.
    let optional = context.as_c_str() != kOfxImageEffectContextFilter;
    for name in [SOURCE, ILLUMINATION].into_iter().filter(|name| defines(&context, name)) {
        let Some(clip) = parameters::clip(&call.effect, name, &rgb, name == ILLUMINATION) else { continue };
        clip.set_int(kOfxImageClipPropOptional, i32::from(optional));
        if name == ILLUMINATION {
            clip.set_string(kOfxPropLabel, "Illumination");
        }
    }
    parameters::clip(&call.effect, OUTPUT, &rgb[..1], false);
    match call.effect.params() {
        Some(params) => parameters::parameters(&params, settings::RELIGHT, GROUPS),
        None => return Reply::Failed,
    }
    Reply::Ok
}
