//! Relume Relight in our strict host, as far as it goes without an asset: what it describes, that it can be loaded and
//! unloaded at will, and that a missing or broken file is told to the user and clears the output.
//!
//! Every [`Host`] here fails its test when the plugin broke a rule of the standard.

use std::fs;

use openfx::sys::generic::core::*;
use openfx::sys::image_effect_v1::image_effect::*;
use openfx::sys::image_effect_v1::memory::kOfxMemorySuite;
use openfx::sys::image_effect_v1::message::kOfxMessageSuite;
use openfx::sys::image_effect_v1::multi_thread::kOfxMultiThreadSuite;
use openfx::sys::image_effect_v1::param::*;
use openfx::sys::image_effect_v1::progress::kOfxProgressSuite;
use openfx::sys::image_effect_v1::time_line::kOfxTimeLineSuite;
use relume_core::settings::{Kind, RELIGHT, Setting};
use relume_tests::host::*;
use relume_tests::{alone, bundle, skipped};

/// The identifier of Relume Relight, which projects store.
const IDENTIFIER: &str = "org.relume.Relight";

/// Relume Relight in this host; `None` (and said so) where the host cannot be built.
pub fn relight(host: &Host) -> Option<Plugin> {
    if !VARIADICS_SUPPORTED {
        skipped("variadic suite functions on this platform");
        return None;
    }
    Some(host.load_effect(&bundle(), IDENTIFIER).expect("the bundle loads"))
}

#[test]
fn it_describes_itself_in_all_three_contexts() {
    let host = Host::new(Options::default());
    let Some(plugin) = relight(&host) else { return };
    assert_eq!(plugin.identifier(), IDENTIFIER);
    for context in Context::ALL {
        let described = plugin.describe(context);
        assert_eq!(described.texts(kOfxPropLabel), ["Relume Relight"]);
        assert_eq!(described.texts(kOfxImageEffectPluginPropGrouping), ["Relume"]);
        assert_eq!(described.texts(kOfxImageEffectPluginRenderThreadSafety), ["OfxImageEffectRenderFullySafe"]);
        assert_eq!(described.numbers(kOfxImageEffectPluginPropHostFrameThreading), [0.0]);
        assert_eq!(described.numbers(kOfxImageEffectPropSupportsTiles), [1.0]);
        let depths = described.texts(kOfxImageEffectPropSupportedPixelDepths);
        assert!(["OfxBitDepthByte", "OfxBitDepthFloat"].iter().all(|depth| depths.iter().any(|found| found == depth)));
        let supported = described.texts(kOfxImageEffectPropSupportedContexts);
        assert!(
            Context::ALL.iter().all(|context| supported.iter().any(|found| found == context.name().to_str().unwrap()))
        );
        let clips = described.clips();
        assert!(clips.iter().any(|clip| clip == "Output"), "{clips:?}");
        if context == Context::Generator {
            assert!(clips.iter().any(|clip| clip == "Illumination"), "{clips:?}");
        } else {
            assert_eq!(clips[0], "Source", "some hosts take the first clip for the main one");
        }
        for clip in clips.iter().filter(|clip| *clip == "Illumination") {
            assert_eq!(described.clip_numbers(clip, kOfxImageClipPropOptional), [1.0]);
        }
    }
}

/// The parameter is the line of the table.
pub fn check_setting(described: &Description, setting: &Setting) {
    let Setting { id, label, hint, kind } = setting;
    assert_eq!(described.param_texts(id, kOfxPropLabel), [*label], "label of {id}");
    assert_eq!(described.param_texts(id, kOfxParamPropHint), [*hint], "hint of {id}");
    let numbers = |property| described.param_numbers(id, property);
    let found = described.param_kind(id);
    match kind {
        Kind::Number { default, hard, soft } => {
            assert_eq!(found, "OfxParamTypeDouble", "{id}");
            assert_eq!(numbers(kOfxParamPropDefault), [*default], "default of {id}");
            assert_eq!((numbers(kOfxParamPropMin)[0], numbers(kOfxParamPropMax)[0]), *hard, "range of {id}");
            assert_eq!(
                (numbers(kOfxParamPropDisplayMin)[0], numbers(kOfxParamPropDisplayMax)[0]),
                *soft,
                "slider of {id}"
            );
        }
        Kind::Colour { default, hard, soft } => {
            assert_eq!(found, "OfxParamTypeRGB", "{id}");
            assert_eq!(numbers(kOfxParamPropDefault), default, "default of {id}");
            for (property, value) in [
                (kOfxParamPropMin, hard.0),
                (kOfxParamPropMax, hard.1),
                (kOfxParamPropDisplayMin, soft.0),
                (kOfxParamPropDisplayMax, soft.1),
            ] {
                assert_eq!(numbers(property), [value; 3], "{property:?} of {id}");
            }
        }
        Kind::Integer { default, hard } => {
            assert_eq!(found, "OfxParamTypeInteger", "{id}");
            assert_eq!(numbers(kOfxParamPropDefault), [f64::from(*default)], "default of {id}");
            let range = [numbers(kOfxParamPropMin)[0], numbers(kOfxParamPropMax)[0]];
            assert_eq!(range, [f64::from(hard.0), f64::from(hard.1)], "range of {id}");
        }
        Kind::Choice { default, options } => {
            assert_eq!(found, "OfxParamTypeChoice", "{id}");
            assert_eq!(numbers(kOfxParamPropDefault), [*default as f64], "default of {id}");
            let labels: Vec<_> = options.iter().map(|(_, label)| *label).collect();
            assert_eq!(described.param_texts(id, kOfxParamPropChoiceOption), labels, "options of {id}");
        }
        Kind::File => {
            assert_eq!(found, "OfxParamTypeString", "{id}");
            assert_eq!(described.param_texts(id, kOfxParamPropStringMode), ["OfxParamStringIsFilePath"], "{id}");
            assert_eq!(described.param_texts(id, kOfxParamPropDefault), [""], "default of {id}");
        }
    }
}

#[test]
fn its_parameters_are_the_settings_table() {
    let host = Host::new(Options::default());
    let Some(plugin) = relight(&host) else { return };
    for context in Context::ALL {
        let described = plugin.describe(context);
        RELIGHT.iter().for_each(|setting| check_setting(&described, setting));
        let known = |name: &String| RELIGHT.iter().any(|setting| setting.id == name);
        let order: Vec<_> = described.params().into_iter().filter(known).collect();
        assert_eq!(order, RELIGHT.iter().map(|setting| setting.id).collect::<Vec<_>>());
        assert_eq!(described.param_kind("status"), "OfxParamTypeString");
        assert_eq!(described.param_numbers("status", kOfxParamPropEnabled), [0.0], "status is for reading");
        // Names with hyphens make Nuke warn.
        assert!(described.params().iter().all(|name| name.bytes().all(|byte| byte.is_ascii_alphanumeric())));
    }
}

fn plate() -> TestImage {
    TestImage::from_fn(64, 48, |x, y| [x as f32 / 64.0, y as f32 / 48.0, 0.25, 1.0])
}

fn every_memory() -> Vec<RenderArgs> {
    let float = RenderArgs {
        window: Some(Rect::new(3, 5, 50, 41)),
        bounds: Some(Rect::new(0, 0, 64, 48)),
        ..RenderArgs::default()
    };
    vec![
        RenderArgs::default(),
        float.clone(),
        RenderArgs { depth: Depth::Byte, row_padding: 20, ..float.clone() },
        RenderArgs { negative_rows: true, row_padding: 16, ..float.clone() },
        RenderArgs { bounds: Some(Rect::new(-7, 2, 60, 45)), window: None, ..float.clone() },
        RenderArgs { scale: (0.5, 0.5), window: None, bounds: Some(Rect::new(0, 0, 32, 24)), ..float },
    ]
}

/// Failed, and nothing of the picture is left.
pub fn assert_refused(rendered: &Rendered) {
    assert!(rendered.failed(), "{rendered:?}");
    assert_eq!(rendered.untouched, 0, "the output is cleared");
    assert!(rendered.image.is_clear(), "the output is cleared");
}

fn last_message(instance: &Instance) -> String {
    instance.messages().last().expect("the user is told").text.clone()
}

#[test]
fn a_missing_asset_is_named_and_the_output_cleared() {
    for notify in [true, false] {
        let host = Host::new(Options { notify, ..Options::default() });
        let Some(plugin) = relight(&host) else { return };
        for context in Context::ALL {
            let instance = plugin.create(context).unwrap();
            if context != Context::Generator {
                instance.clip("Source").connect(plate());
            }
            instance.set_string("asset", "/nowhere/missing-%s.rfield");
            for args in every_memory() {
                assert_refused(&instance.render(&args));
                assert!(last_message(&instance).contains("/nowhere/missing-%s.rfield"), "{}", last_message(&instance));
            }
            if notify {
                let status = instance.string("status");
                assert!(status.contains("missing-%s.rfield"), "status: {status}");
            }
        }
    }
}

#[test]
fn a_broken_asset_is_named_and_the_output_cleared() {
    let folder = tempfile::tempdir().unwrap();
    let host = Host::new(Options::default());
    let Some(plugin) = relight(&host) else { return };
    for (name, content) in
        [("empty", &b""[..]), ("text", b"this is no reflectance field"), ("zip", b"PK\x03\x04\xff\xff\xff\xff")]
    {
        let path = folder.path().join(format!("{name}.rfield"));
        fs::write(&path, content).unwrap();
        let instance = plugin.create(Context::Filter).unwrap();
        instance.clip("Source").connect(plate());
        instance.set_string("asset", path.to_str().unwrap());
        assert_refused(&instance.render(&RenderArgs::default()));
        assert!(
            last_message(&instance).contains(path.file_name().unwrap().to_str().unwrap()),
            "{}",
            last_message(&instance)
        );
    }
    let instance = plugin.create(Context::Filter).unwrap();
    instance.set_string("asset", folder.path().to_str().unwrap());
    assert_refused(&instance.render(&RenderArgs::default()));
}

#[test]
fn threads_that_render_without_an_asset_do_not_meet() {
    let host = Host::new(Options::default());
    let Some(plugin) = relight(&host) else { return };
    let instances: Vec<_> = (0..3)
        .map(|_| {
            let instance = plugin.create(Context::General).unwrap();
            instance.clip("Source").connect(plate());
            instance.set_string("asset", "/nowhere/at/all.rfield");
            instance
        })
        .collect();
    let frames: Vec<_> = (0..24).map(|time| RenderArgs { time: f64::from(time), ..RenderArgs::default() }).collect();
    let calls: Vec<_> = frames.iter().zip(instances.iter().cycle()).collect();
    for rendered in from_threads(&calls, 4, |(args, instance)| instance.render(args)) {
        assert_refused(&rendered);
    }
}

#[test]
fn odd_inputs_do_not_upset_it() {
    let host = Host::new(Options::default());
    let Some(plugin) = relight(&host) else { return };
    let instance = plugin.create(Context::General).unwrap();
    instance.set_string("asset", "/nowhere/at/all.rfield");
    for name in ["Source", "Illumination"] {
        let clip = instance.clip(name);
        let feeds: [&dyn Fn(); 7] = [
            &|| clip.connect_without_image(),
            &|| clip.connect_null_image(),
            &|| clip.connect_without_pixels(),
            &|| clip.connect(plate().depth(Depth::Short).components(Components::Alpha)),
            &|| clip.connect(plate().depth(Depth::Half).components(Components::Rgb).rows(6, true)),
            &|| clip.hide_connected(true),
            &|| clip.disconnect(),
        ];
        for feed in feeds {
            feed();
            let region = instance.region_of_definition(1.0);
            assert!(region.iter().all(|edge| edge.is_finite()), "{region:?}");
            instance.regions_of_interest(1.0, [0.0, 0.0, 10.0, 10.0]);
            instance.clip_preferences();
            instance.frames_needed(1.0);
            assert_refused(
                &instance.render(&RenderArgs { bounds: Some(Rect::new(0, 0, 16, 9)), ..RenderArgs::default() }),
            );
        }
        clip.hide_connected(false);
    }
}

#[test]
fn an_instance_as_it_comes_renders_or_says_why_not() {
    let host = Host::new(Options::default());
    let Some(plugin) = relight(&host) else { return };
    for context in Context::ALL {
        let instance = plugin.create(context).unwrap();
        instance.clip_preferences();
        let args = RenderArgs::default();
        instance.identity(&args);
        assert!(instance.time_domain().is_none_or(|(first, last)| first <= last));
        let rendered = instance.render(&args);
        assert!(rendered.ok() || (rendered.failed() && rendered.image.is_clear()));
        for action in [kOfxActionPurgeCaches, kOfxActionSyncPrivateData] {
            instance.plain_action(action);
        }
    }
}

#[test]
fn hosts_that_lack_optional_suites_are_served() {
    let optional = [kOfxMemorySuite, kOfxMultiThreadSuite, kOfxMessageSuite, kOfxProgressSuite, kOfxTimeLineSuite];
    let all = optional.to_vec();
    for missing_suites in optional.into_iter().map(|suite| vec![suite]).chain([all, Vec::new()]) {
        let host = Host::new(Options { missing_suites, persistent_messages: false, ..Options::default() });
        let Some(plugin) = relight(&host) else { return };
        let instance = plugin.create(Context::Filter).unwrap();
        instance.set_string("asset", "/nowhere/at/all.rfield");
        assert_refused(&instance.render(&RenderArgs::default()));
    }
}

#[test]
fn it_can_be_loaded_and_described_again_and_again_and_at_once() {
    let host = Host::new(Options::default());
    let Some(plugin) = relight(&host) else { return };
    for _ in 0..5 {
        assert!(plugin.load_again());
        plugin.describe_general();
        assert!(plugin.unload());
        assert!(plugin.load_again());
        Context::ALL.into_iter().for_each(|context| drop(plugin.describe(context)));
    }
    from_threads(&[0; 32], 4, |_| {
        assert!(plugin.load_again());
        plugin.describe_general();
        for context in Context::ALL {
            assert!(!plugin.describe(context).params().is_empty());
            plugin.create(context).unwrap();
        }
    });
    assert!(plugin.unload() && plugin.unload() && plugin.load_again());
    plugin.create(Context::Filter).unwrap();
}

#[test]
fn its_library_can_be_unmapped_and_mapped_again() {
    // Alone: other tests of this process must not hold the same library.
    alone("plugin::its_library_can_be_unmapped_and_mapped_again", || {
        for _ in 0..10 {
            let host = Host::new(Options::default());
            if !VARIADICS_SUPPORTED {
                return skipped("variadic suite functions on this platform");
            }
            let plugin = host.load_in_place(&bundle()).unwrap();
            let instance = plugin.create(Context::Filter).unwrap();
            instance.set_string("asset", "/nowhere/at/all.rfield");
            assert_refused(&instance.render(&RenderArgs::default()));
        }
        if cfg!(target_os = "linux") {
            let maps = fs::read_to_string("/proc/self/maps").unwrap();
            assert!(!maps.contains("Relume.ofx"), "the library is still mapped:\n{maps}");
        }
    });
}

/// Threads of this process.
fn threads() -> usize {
    fs::read_dir("/proc/self/task").map_or(0, Iterator::count)
}

#[test]
fn no_thread_outlives_unload() {
    if !cfg!(target_os = "linux") {
        return skipped("/proc");
    }
    alone("plugin::no_thread_outlives_unload", || {
        bundle();
        let before = threads();
        for _ in 0..3 {
            let host = Host::new(Options::default());
            let Some(plugin) = relight(&host) else { return };
            let instance = plugin.create(Context::Filter).unwrap();
            instance.set_string("asset", "/nowhere/at/all.rfield");
            assert_refused(&instance.render(&RenderArgs::default()));
            drop(instance);
            assert!(plugin.unload());
            assert_eq!(threads(), before, "after the action Unload");
            assert!(plugin.load_again());
            drop(plugin);
            assert_eq!(threads(), before, "after the library is gone");
        }
    });
}
