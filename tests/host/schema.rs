//! The property tables of OpenFX 1.4: which property every kind of object has, its type, dimension and default.

use std::ffi::CStr;

use super::ofx::*;
use super::options::Options;
use super::props::{Prop, Row, Type};

/// The contexts of the standard.
pub const CONTEXTS: &[&CStr] = &[
    kOfxImageEffectContextGenerator,
    kOfxImageEffectContextFilter,
    kOfxImageEffectContextTransition,
    kOfxImageEffectContextPaint,
    kOfxImageEffectContextGeneral,
    kOfxImageEffectContextRetimer,
];
/// The depths of pixels.
pub const DEPTHS: &[&CStr] =
    &[kOfxBitDepthNone, kOfxBitDepthByte, kOfxBitDepthShort, kOfxBitDepthHalf, kOfxBitDepthFloat];
/// The components of pixels.
pub const COMPONENTS: &[&CStr] =
    &[kOfxImageComponentNone, kOfxImageComponentRGBA, kOfxImageComponentRGB, kOfxImageComponentAlpha];
/// How colour relates to alpha.
pub const ALPHAS: &[&CStr] = &[kOfxImageOpaque, kOfxImagePreMultiplied, kOfxImageUnPreMultiplied];
const FIELDS: &[&CStr] =
    &[kOfxImageFieldNone, kOfxImageFieldLower, kOfxImageFieldUpper, kOfxImageFieldBoth, kOfxImageFieldSingle];
const EXTRACTIONS: &[&CStr] = &[kOfxImageFieldBoth, kOfxImageFieldSingle, kOfxImageFieldDoubled];
const SAFETIES: &[&CStr] =
    &[kOfxImageEffectRenderUnsafe, kOfxImageEffectRenderInstanceSafe, kOfxImageEffectRenderFullySafe];

/// A row of a table.
pub fn row(constant: &CStr, prop: Prop) -> Row {
    (name(constant), prop)
}

/// The host descriptor.
pub fn host(options: &Options) -> Vec<Row> {
    let mut rows = vec![
        row(kOfxPropType, Prop::text(kOfxTypeImageEffectHost)),
        row(kOfxPropName, Prop::texts(&[&options.name])),
        row(kOfxPropLabel, Prop::text(c"Relume test host")),
        row(kOfxPropVersion, Prop::ints(&[1, 0, 0]).any_length()),
        row(kOfxPropVersionLabel, Prop::text(c"1.0")),
        row(kOfxPropAPIVersion, Prop::ints(&[1, 4]).any_length()),
        row(kOfxImageEffectHostPropIsBackground, Prop::ints(&[options.background.into()])),
        row(kOfxImageEffectHostPropNativeOrigin, Prop::text(kOfxHostNativeOriginBottomLeft)),
        row(kOfxImageEffectPropTemporalClipAccess, Prop::ints(&[1])),
        row(kOfxParamHostPropMaxParameters, Prop::ints(&[-1])),
        row(kOfxParamHostPropMaxPages, Prop::ints(&[0])),
        row(kOfxParamHostPropPageRowColumnCount, Prop::ints(&[0, 0])),
        row(kOfxPropHostOSHandle, Prop::pointer(0)),
        row(
            kOfxImageEffectPropSupportedComponents,
            Prop::texts(&COMPONENTS[1..].iter().map(|c| name(c)).collect::<Vec<_>>()).any_length(),
        ),
        row(
            kOfxImageEffectPropSupportedContexts,
            Prop::texts(&CONTEXTS.iter().map(|c| name(c)).collect::<Vec<_>>()).any_length(),
        ),
        row(
            kOfxImageEffectPropSupportedPixelDepths,
            Prop::texts(&DEPTHS[1..].iter().map(|c| name(c)).collect::<Vec<_>>()).any_length(),
        ),
        row(kOfxImageEffectInstancePropSequentialRender, Prop::ints(&[1])),
    ];
    let flags = [
        kOfxImageEffectPropSupportsMultipleClipDepths,
        kOfxImageEffectPropSupportsMultiResolution,
        kOfxImageEffectPropSupportsTiles,
        kOfxParamHostPropSupportsStringAnimation,
        kOfxParamHostPropSupportsBooleanAnimation,
        kOfxParamHostPropSupportsChoiceAnimation,
    ];
    rows.extend(flags.map(|flag| row(flag, Prop::ints(&[1]))));
    let lacks = [
        kOfxImageEffectPropSupportsOverlays,
        kOfxImageEffectPropSupportsMultipleClipPARs,
        kOfxImageEffectPropSetableFrameRate,
        kOfxImageEffectPropSetableFielding,
        kOfxParamHostPropSupportsCustomAnimation,
        kOfxParamHostPropSupportsCustomInteract,
        c"OfxParamHostPropSupportsParametricAnimation",
        kOfxParamHostPropSupportsStrChoice,
        kOfxParamHostPropSupportsStrChoiceAnimation,
    ];
    rows.extend(lacks.map(|flag| row(flag, Prop::ints(&[0]))));
    rows
}

fn labels() -> Vec<Row> {
    [kOfxPropLabel, kOfxPropShortLabel, kOfxPropLongLabel].map(|label| row(label, Prop::text(c"").writable())).into()
}

/// An effect descriptor; `in_context` in DescribeInContext.
pub fn descriptor(path: &str, in_context: Option<&str>) -> Vec<Row> {
    let flag = |value| Prop::ints(&[value]).writable();
    let mut rows = labels();
    rows.extend([
        row(kOfxPropType, Prop::text(kOfxTypeImageEffect)),
        row(kOfxPropVersion, Prop::list(Type::Int)),
        row(kOfxPropVersionLabel, Prop::text(c"").writable()),
        row(kOfxPropPluginDescription, Prop::text(c"").writable()),
        row(kOfxPropIcon, Prop::texts(&["", ""]).writable()),
        row(kOfxPluginPropFilePath, Prop::texts(&[path])),
        row(kOfxImageEffectPropSupportedContexts, Prop::list(Type::Text).one_of(CONTEXTS)),
        row(kOfxImageEffectPropSupportedPixelDepths, Prop::list(Type::Text).one_of(&DEPTHS[1..])),
        row(kOfxImageEffectPluginPropGrouping, Prop::text(c"").writable()),
        row(kOfxImageEffectPluginRenderThreadSafety, Prop::text(kOfxImageEffectRenderInstanceSafe).one_of(SAFETIES)),
        row(kOfxImageEffectPluginPropHostFrameThreading, flag(0)),
        row(kOfxImageEffectPluginPropSingleInstance, flag(0)),
        row(kOfxImageEffectPluginPropOverlayInteractV1, Prop::pointer(0).writable()),
        row(kOfxImageEffectPluginPropOverlayInteractV2, Prop::pointer(0).writable()),
        row(kOfxImageEffectPropSupportsMultiResolution, flag(1)),
        row(kOfxImageEffectPropSupportsTiles, flag(1)),
        row(kOfxImageEffectPropTemporalClipAccess, flag(0)),
        row(kOfxImageEffectPropSupportsMultipleClipDepths, flag(0)),
        row(kOfxImageEffectPropSupportsMultipleClipPARs, flag(0)),
        row(kOfxImageEffectPluginPropFieldRenderTwiceAlways, flag(1)),
        row(kOfxImageEffectInstancePropSequentialRender, flag(0)),
        row(kOfxImageEffectPropNoSpatialAwareness, Prop::text(c"false").writable()),
        row(kOfxImageEffectPropClipPreferencesSlaveParam, Prop::list(Type::Text)),
    ]);
    rows.extend(in_context.map(|context| row(kOfxImageEffectPropContext, Prop::texts(&[context]))));
    rows
}

/// An effect instance, from its descriptor's properties.
pub fn instance(descriptor: Vec<Row>, context: &str, plugin: usize, options: &Options) -> Vec<Row> {
    let writable = [kOfxImageEffectInstancePropSequentialRender, kOfxImageEffectPropSupportsTiles].map(name);
    let lock = |(name, prop): Row| {
        let writable = writable.contains(&name);
        (name, Prop { writable, ..prop })
    };
    let pair = |(x, y): (f64, f64)| Prop::doubles(&[x, y]);
    let mut rows: Vec<Row> = descriptor.into_iter().map(lock).collect();
    rows.extend([
        row(kOfxPropType, Prop::text(kOfxTypeImageEffectInstance)),
        row(kOfxImageEffectPropContext, Prop::texts(&[context])),
        row(kOfxPropInstanceData, Prop::pointer(0).writable()),
        row(kOfxImageEffectPropPluginHandle, Prop::pointer(plugin)),
        row(kOfxImageEffectPropProjectSize, pair(options.project_size)),
        row(kOfxImageEffectPropProjectOffset, pair(options.project_offset)),
        row(kOfxImageEffectPropProjectExtent, pair(options.project_extent)),
        row(kOfxImageEffectPropProjectPixelAspectRatio, Prop::doubles(&[options.pixel_aspect])),
        row(
            kOfxImageEffectInstancePropEffectDuration,
            Prop::doubles(&[options.frame_range.1 - options.frame_range.0 + 1.0]),
        ),
        row(kOfxImageEffectPropFrameRate, Prop::doubles(&[options.frame_rate])),
        row(kOfxPropIsInteractive, Prop::ints(&[0])),
    ]);
    rows
}

/// A clip descriptor.
pub fn clip(clip: &str) -> Vec<Row> {
    let flag = |value| Prop::ints(&[value]).writable();
    let mut rows = labels();
    rows.extend([
        row(kOfxPropType, Prop::text(kOfxTypeClip)),
        row(kOfxPropName, Prop::texts(&[clip])),
        row(kOfxImageEffectPropSupportedComponents, Prop::list(Type::Text).one_of(COMPONENTS)),
        row(kOfxImageEffectPropTemporalClipAccess, flag(0)),
        row(kOfxImageClipPropOptional, flag(0)),
        row(kOfxImageClipPropFieldExtraction, Prop::text(kOfxImageFieldDoubled).one_of(EXTRACTIONS)),
        row(kOfxImageClipPropIsMask, flag(0)),
        row(kOfxImageEffectPropSupportsTiles, flag(1)),
    ]);
    rows
}

/// What a clip of an instance has beyond its descriptor; nothing connected yet.
pub fn clip_instance(descriptor: Vec<Row>, options: &Options) -> Vec<Row> {
    let (first, last) = options.frame_range;
    let depth = options.depth.name();
    let mut rows: Vec<Row> =
        descriptor.into_iter().map(|(name, prop)| (name, Prop { writable: false, ..prop })).collect();
    rows.extend([
        row(kOfxImageEffectPropPixelDepth, Prop::text(depth)),
        row(kOfxImageEffectPropComponents, Prop::text(kOfxImageComponentRGBA)),
        row(kOfxImageClipPropUnmappedPixelDepth, Prop::text(depth)),
        row(kOfxImageClipPropUnmappedComponents, Prop::text(kOfxImageComponentRGBA)),
        row(kOfxImageEffectPropPreMultiplication, Prop::text(kOfxImagePreMultiplied)),
        row(kOfxImagePropPixelAspectRatio, Prop::doubles(&[options.pixel_aspect])),
        row(kOfxImageEffectPropFrameRate, Prop::doubles(&[options.frame_rate])),
        row(kOfxImageEffectPropUnmappedFrameRate, Prop::doubles(&[options.frame_rate])),
        row(kOfxImageEffectPropFrameRange, Prop::doubles(&[first, last])),
        row(kOfxImageEffectPropUnmappedFrameRange, Prop::doubles(&[first, last])),
        row(kOfxImageClipPropFieldOrder, Prop::text(kOfxImageFieldNone)),
        row(kOfxImageClipPropConnected, Prop::ints(&[0])),
        row(kOfxImageClipPropContinuousSamples, Prop::ints(&[0])),
    ]);
    rows
}

/// The out arguments of GetClipPreferences for these clips, at their defaults.
pub fn clip_preferences(clips: &[String], depth: &CStr, options: &Options) -> Vec<Row> {
    let mut rows = vec![
        row(kOfxImageEffectPropFrameRate, Prop::doubles(&[options.frame_rate]).writable()),
        row(kOfxImageClipPropFieldOrder, Prop::text(kOfxImageFieldNone).one_of(FIELDS)),
        row(kOfxImageEffectPropPreMultiplication, Prop::text(kOfxImagePreMultiplied).one_of(ALPHAS)),
        row(kOfxImageClipPropContinuousSamples, Prop::ints(&[0]).writable()),
        row(kOfxImageEffectFrameVarying, Prop::ints(&[0]).writable()),
    ];
    for clip in clips {
        rows.extend([
            (format!("OfxImageClipPropComponents_{clip}"), Prop::text(kOfxImageComponentRGBA).one_of(COMPONENTS)),
            (format!("OfxImageClipPropDepth_{clip}"), Prop::text(depth).one_of(DEPTHS)),
            (format!("OfxImageClipPropPAR_{clip}"), Prop::doubles(&[options.pixel_aspect]).writable()),
        ]);
    }
    rows
}
