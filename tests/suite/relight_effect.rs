//! Relume Relight in the test host: the pictures are the core's, whatever the host is like.

use std::ops::Range;
use std::path::{Path, PathBuf};

use relume_core::Result;
use relume_core::domain::Directions;
use relume_core::field::compress::{Scheme, compress};
use relume_core::field::{
    Access, Asset, BLOCK_HEIGHT, BLOCK_WIDTH, Bands, Contents, Kind, NewLayer, Precision, add_layers, write,
};
use relume_core::illumination::EnvMap;
use relume_core::image::{EncodeOptions, Image, Window, srgb};
use relume_core::math::Vec3;
use relume_core::reconstruct::Method;
use relume_core::relight::{Light, Look, Relighter};
use relume_core::wavelet::Wavelet;
use relume_tests::host::{Components, Context, Depth, Host, Instance, Options, Rect, RenderArgs, TestImage};

const WIDTH: usize = 53;
const HEIGHT: usize = 38;
const LAMPS: usize = 24;
const ALL: [Context; 3] = [Context::Generator, Context::Filter, Context::General];

/// T without symmetry, so that a flip or a shift shows.
fn transport(x: usize, y: usize, channel: usize, lamp: usize) -> f32 {
    0.02 + ((x * 31 + y * 17 + channel * 7 + lamp * 13) % 97) as f32 / 970.0
}

struct Formula;

impl Bands for Formula {
    fn fill(&mut self, by: usize, columns: Range<usize>, blocks: &mut [f32]) -> Result<()> {
        let mut at = blocks.iter_mut();
        for (bx, channel, lamp) in columns.flat_map(|bx| (0..3).flat_map(move |c| (0..LAMPS).map(move |l| (bx, c, l))))
        {
            for (row, column) in (0..BLOCK_HEIGHT).flat_map(|r| (0..BLOCK_WIDTH).map(move |c| (r, c))) {
                let (x, y) = (bx * BLOCK_WIDTH + column, by * BLOCK_HEIGHT + row);
                if let Some(out) = at.next().filter(|_| x < WIDTH && y < HEIGHT) {
                    *out = transport(x, y, channel, lamp);
                }
            }
        }
        Ok(())
    }
}

/// A folder with an asset and a map.
struct Props {
    folder: tempfile::TempDir,
    asset: PathBuf,
    map: PathBuf,
}

impl Props {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let (asset, map) = (folder.path().join("ball.rfield"), folder.path().join("sky.exr"));
        write_asset(&asset);
        let sky = EnvMap::from_fn(32, 16, |d| [1.5 + d.x as f32, 1.5 + d.y as f32, 1.5 + d.z as f32]);
        relume_core::image::write(&map, sky.image(), EncodeOptions::default()).unwrap();
        Self { folder, asset, map }
    }

    /// The element as the core makes it, row 0 at the top.
    fn element(&self, look: &Look, lamp: Option<usize>) -> TestImage {
        let relighter = Relighter::new(Asset::open(&self.asset, Access::Read).unwrap()).unwrap();
        let map = EnvMap::load(&self.map).unwrap();
        let weights = relighter.weights(lamp.map_or(Light::Map(&map), Light::Lamp), look).unwrap();
        let element = relighter.render(&weights, look, Window::full(WIDTH, HEIGHT)).unwrap();
        TestImage::from_rgba(WIDTH, HEIGHT, element.data().to_vec())
    }

    fn set(&self, instance: &Instance) {
        instance.set_string("asset", &self.asset.display().to_string());
        instance.set_string("environment", &self.map.display().to_string());
    }
}

fn write_asset(path: &Path) {
    let lamp = |i: usize| {
        let (z, turn) = (1.0 - (i as f64 + 0.5) / LAMPS as f64, i as f64 * 2.399_963);
        let r = (1.0 - z * z).sqrt();
        Vec3::new(r * turn.cos(), r * turn.sin(), z)
    };
    let alpha = |i: usize| if (i % WIDTH).abs_diff(26) < 20 { ((i / WIDTH) as f32 / 20.0).min(1.0) } else { 0.0 };
    let contents = Contents {
        colour_space: Default::default(),
        domain: Directions::new((0..LAMPS).map(lamp).collect()).unwrap().into(),
        irradiance: vec![std::f32::consts::PI; LAMPS],
        width: WIDTH,
        height: HEIGHT,
        precision: Precision::Float,
        largest: 1.0,
        ambient: Some(Image::from_fn(WIDTH, HEIGHT, |x, y| [x as f32 / 100.0, y as f32 / 100.0, 0.1])),
        alpha: Some((0..WIDTH * HEIGHT).map(alpha).collect()),
        reliability: None,
        provenance: serde_json::Value::Null,
    };
    write(path, &contents, &mut Formula).unwrap();
}

fn plate(width: usize, height: usize) -> TestImage {
    TestImage::from_fn(width, height, |x, y| [x as f32 / 64.0, y as f32 / 48.0, 0.25, 1.0])
}

/// The element centred over a plate, as the effect's documentation has it.
fn composite(element: &TestImage, plate: &TestImage) -> TestImage {
    let mut out = plate.clone();
    let Rect { x1, y1, x2, y2 } = plate.bounds();
    let left = (f64::from(x1 + x2) / 2.0 - element.width() as f64 / 2.0).floor() as i32;
    let bottom = (f64::from(y1 + y2) / 2.0 - element.height() as f64 / 2.0).floor() as i32;
    let placed = element.clone().at(left, bottom);
    for (x, y) in (y1..y2).flat_map(|y| (x1..x2).map(move |x| (x, y))) {
        let (e, s) = (placed.canonical(x, y).unwrap_or_default(), plate.canonical(x, y).unwrap_or_default());
        out.set_canonical(x, y, std::array::from_fn(|c| e[c] + (1.0 - e[3]) * s[c]));
    }
    out
}

fn with_instance<T>(options: Options, context: Context, work: impl FnOnce(&Instance) -> T) -> T {
    let host = Host::new(options);
    let plugin = host.load(&relume_tests::bundle()).unwrap();
    let instance = plugin.create(context).unwrap();
    work(&instance)
}

fn close(a: &TestImage, b: &TestImage, tolerance: f32) {
    let difference = a.largest_difference(b);
    assert!(
        difference <= tolerance,
        "{} x {} and {} x {} differ by {difference}",
        a.width(),
        a.height(),
        b.width(),
        b.height()
    );
}

#[test]
fn describes_itself_to_a_strict_host_in_every_context() {
    let host = Host::new(Options::default());
    let plugin = host.load(&relume_tests::bundle()).unwrap();
    assert_eq!(plugin.identifier(), "org.relume.Relight");
    for context in ALL {
        let description = plugin.describe(context);
        let params = description.params();
        for setting in relume_core::settings::RELIGHT {
            assert!(params.iter().any(|p| p == setting.id), "{}", setting.id);
        }
        assert_eq!(description.clips().contains(&"Illumination".to_owned()), context != Context::Filter);
        assert_eq!(description.clips().contains(&"Source".to_owned()), context != Context::Generator);
    }
}

#[test]
fn a_generator_makes_the_picture_of_the_core_whole_or_in_tiles() {
    let props = Props::new();
    with_instance(Options::default(), Context::Generator, |instance| {
        props.set(instance);
        assert_eq!(instance.region_of_definition(1.0), [0.0, 0.0, WIDTH as f64, HEIGHT as f64]);
        let look = Look { heading_deg: 40.0, exposure_ev: 1.5, ambient: 0.5, ..Look::default() };
        for (id, value) in [("rotation", 40.0), ("exposure", 1.5), ("ambient", 0.5)] {
            instance.set_double(id, value);
        }
        let expected = props.element(&look, None);
        close(&instance.render(&RenderArgs::default()).unwrap(), &expected, 1e-6);
        for size in [7, 16, 33] {
            close(&instance.render_tiles(&RenderArgs::default(), size), &expected, 1e-6);
        }
        let strange = RenderArgs { row_padding: 20, negative_rows: true, ..RenderArgs::default() };
        close(&instance.render(&strange).unwrap(), &expected, 1e-6);
        assert!(instance.string("status").contains("24 lamps"), "{}", instance.string("status"));
    });
}

#[test]
fn a_filter_composites_over_a_plate_that_lies_anywhere() {
    let props = Props::new();
    for source in [plate(64, 48), plate(64, 48).at(-9, 5), plate(30, 61).rows(12, true), plate(65, 47).at(3, -40)] {
        for context in [Context::Filter, Context::General] {
            with_instance(Options::default(), context, |instance| {
                props.set(instance);
                instance.set_int("lamp", 5);
                instance.clip("Source").connect(source.clone());
                let element = props.element(&Look::default(), Some(5));
                let rendered = instance.render(&RenderArgs::default()).unwrap();
                close(&rendered, &composite(&element, &source), 1e-6);
                close(&instance.render_tiles(&RenderArgs::default(), 19), &rendered, 0.0);
                instance.set_choice("output", 1);
                let dark = TestImage::new(source.width(), source.height()).at(source.origin.0, source.origin.1);
                let element_alone = instance.render(&RenderArgs::default()).unwrap();
                close(&element_alone, &composite(&element, &dark), 1e-6);
                instance.set_choice("output", 2);
                let alpha = instance.render(&RenderArgs::default()).unwrap();
                let (width, height) = (alpha.width(), alpha.height());
                let expected = TestImage::from_fn(width, height, |x, y| [element_alone.pixel(x, y)[3]; 4]);
                close(&alpha, &expected, 0.0);
            });
        }
    }
}

#[test]
fn normals_and_albedo_are_outputs_that_need_no_light() {
    let props = Props::new();
    let layered = props.folder.path().join("layered.rfield");
    let asset = Asset::open(&props.asset, Access::Read).unwrap();
    let normal = |x: usize, y: usize| Vec3::new(0.02 * x as f64 - 0.5, 0.4 - 0.02 * y as f64, 1.0).normalize();
    let normals = Image::from_fn(WIDTH, HEIGHT, |x, y| normal(x, y).map(|v| v as f32).into());
    let albedo = Image::from_fn(WIDTH, HEIGHT, |x, y| [x as f32 / 64.0, y as f32 / 64.0, 0.25]);
    let layers = [NewLayer { name: "normals", picture: &normals }, NewLayer { name: "albedo", picture: &albedo }];
    add_layers(&asset, &layered, &layers, ("surface", serde_json::Value::Null), &mut |_, _| Ok(())).unwrap();
    let alpha = |i: usize| asset.alpha().unwrap()[i];
    with_instance(Options::default(), Context::Generator, |instance| {
        instance.set_string("asset", &layered.display().to_string());
        for (option, layer, edges) in [(3, &normals, true), (4, &albedo, false)] {
            instance.set_choice("output", option);
            let found = instance.render(&RenderArgs::default()).unwrap();
            let expected: Vec<f32> = (0..WIDTH * HEIGHT)
                .flat_map(|i| {
                    let (p, scale) = (layer.pixel(i % WIDTH, i / WIDTH), if edges { alpha(i) } else { 1.0 });
                    [p[0] * scale, p[1] * scale, p[2] * scale, alpha(i)]
                })
                .collect();
            close(&found, &TestImage::from_rgba(WIDTH, HEIGHT, expected), 1e-6);
        }
        // An asset without them says what to do.
        instance.set_string("asset", &props.asset.display().to_string());
        let failed = instance.render(&RenderArgs::default());
        assert_ne!(failed.status, 0, "an asset without albedo");
    });
}

#[test]
fn an_asset_with_several_representations_is_lit_by_the_one_that_is_chosen() {
    let mut props = Props::new();
    for (n, scheme) in [
        Scheme::Factored { error: 0.02 },
        Scheme::Harmonics { functions: 9 },
        Scheme::Wavelet {
            wavelet: Wavelet::Daubechies97,
            grid: (32, 16),
            reconstruction: Method::BSpline,
            error: Some(0.01),
            terms: None,
        },
    ]
    .iter()
    .enumerate()
    {
        let source = Asset::open(&props.asset, Access::Read).unwrap();
        let with_one_more = props.folder.path().join(format!("{n}.rfield"));
        compress(&source, &with_one_more, scheme, &Kind::ALL, &mut |_, _, _| Ok(())).unwrap();
        props.asset = with_one_more;
    }
    with_instance(Options::default(), Context::Generator, |instance| {
        props.set(instance);
        let picture = |choice: i32| {
            instance.set_int("representation", choice);
            instance.changed(c"OfxTypeParameter", "representation");
            instance.render(&RenderArgs::default()).unwrap()
        };
        let automatic = picture(0);
        assert!(instance.string("status").contains("24 lamps, factored."), "{}", instance.string("status"));
        for (choice, kind) in (1..).zip(Kind::OF_LAMPS) {
            let look = Look { representation: Some(kind), ..Look::default() };
            let expected = props.element(&look, None);
            let made = picture(choice);
            close(&made, &expected, 1e-6);
            close(&instance.render_tiles(&RenderArgs::default(), 33), &expected, 1e-6);
            assert_eq!(made.largest_difference(&automatic) == 0.0, kind == Kind::Factored, "{kind:?}");
        }
        // Not held: told, and cleared.
        let alone = props.folder.path().join("alone.rfield");
        let source = Asset::open(&props.asset, Access::Read).unwrap();
        compress(&source, &alone, &Scheme::Harmonics { functions: 9 }, &[], &mut |_, _, _| Ok(())).unwrap();
        instance.set_string("asset", &alone.display().to_string());
        instance.set_int("representation", 3);
        assert!(instance.render(&RenderArgs::default()).failed());
        instance.changed(c"OfxTypeParameter", "asset");
        let status = instance.string("status");
        assert!(status.contains("no `wavelet` representation"), "{status}");
    });
}

#[test]
fn bytes_are_srgb() {
    let props = Props::new();
    let options = Options { depth: Depth::Byte, ..Options::default() };
    with_instance(options, Context::Filter, |instance| {
        props.set(instance);
        let code = |x: usize| (x % 256) as f32 / 255.0;
        let source = TestImage::from_fn(80, 60, |x, y| [code(x * 3), code(y * 4), code(x + y), 1.0]);
        instance.clip("Source").connect(source.clone().depth(Depth::Byte));
        let decoded = TestImage::from_fn(80, 60, |x, y| {
            let [r, g, b, a] = source.pixel(x, y);
            [srgb::decode(r), srgb::decode(g), srgb::decode(b), a]
        });
        let lit = composite(&props.element(&Look::default(), None), &decoded);
        let expected = TestImage::from_fn(80, 60, |x, y| {
            let [r, g, b, a] = lit.pixel(x, y);
            [srgb::encode(r), srgb::encode(g), srgb::encode(b), a]
                .map(|v| (v * 255.0).round().clamp(0.0, 255.0) / 255.0)
        });
        let args = RenderArgs { depth: Depth::Byte, row_padding: 3, negative_rows: true, ..RenderArgs::default() };
        // One code for what rounds the other way.
        close(&instance.render(&args).unwrap(), &expected, 1.01 / 255.0);
    });
}

#[test]
fn a_scaled_picture_is_the_mean_of_the_whole_one() {
    let props = Props::new();
    with_instance(Options::default(), Context::Generator, |instance| {
        props.set(instance);
        // The element is wholly covered by the means of 2 x 2 but for its last row and column.
        let element = props.element(&Look::default(), None);
        let args = RenderArgs { scale: (0.5, 0.5), ..RenderArgs::default() };
        let half = instance.render(&args).unwrap();
        assert_eq!((half.width(), half.height()), (WIDTH.div_ceil(2), HEIGHT.div_ceil(2)));
        for (x, y) in (0..HEIGHT as i32 / 2).flat_map(|y| (0..WIDTH as i32 / 2).map(move |x| (x, y))) {
            let at = |dx, dy| element.canonical(2 * x + dx, 2 * y + dy).unwrap();
            for c in 0..4 {
                let mean = (at(0, 0)[c] + at(1, 0)[c] + at(0, 1)[c] + at(1, 1)[c]) / 4.0;
                assert!((half.canonical(x, y).unwrap()[c] - mean).abs() < 1e-5);
            }
        }
        close(&instance.render_tiles(&args, 10), &half, 0.0);
    });
}

/// A host whose clips tell regions in the pixels of a proxy: the element is where it is in the large picture.
#[test]
fn a_proxy_centres_the_element_whatever_units_clips_tell_regions_in() {
    let props = Props::new();
    let source = plate(80, 60);
    let rendered = [false, true].map(|regions_in_pixels| {
        let mut rendered = None;
        with_instance(Options { regions_in_pixels, ..Options::default() }, Context::Filter, |instance| {
            props.set(instance);
            instance.clip("Source").connect(source.clone());
            rendered = Some(instance.render(&RenderArgs { scale: (0.5, 0.5), ..RenderArgs::default() }).unwrap());
        });
        rendered.unwrap()
    });
    close(&rendered[0], &rendered[1], 0.0);
}

#[test]
fn the_illumination_clip_takes_the_place_of_the_file() {
    let props = Props::new();
    for (context, tiled) in [(Context::General, true), (Context::Generator, false)] {
        with_instance(Options::default(), context, |instance| {
            instance.set_string("asset", &props.asset.display().to_string());
            let map = EnvMap::load(&props.map).unwrap();
            let map = map.image();
            let picture = |x: usize, y: usize| {
                let p = map.pixel(x, y);
                [p[0], p[1], p[2], 1.0]
            };
            instance.clip("Illumination").connect(TestImage::from_fn(32, 16, picture).at(100, -7).rows(8, true));
            let expected = props.element(&Look::default(), None);
            let args = RenderArgs::default();
            let rendered = if tiled { instance.render_tiles(&args, 11) } else { instance.render(&args).unwrap() };
            close(&rendered, &expected, 1e-5);
        });
    }
}

#[test]
fn mistakes_are_told_the_output_is_cleared_and_the_message_goes_with_success() {
    let props = Props::new();
    let broken = props.folder.path().join("broken.rfield");
    std::fs::write(&broken, &std::fs::read(&props.asset).unwrap()[..4000]).unwrap();
    let text = |path: &Path| path.display().to_string();
    let (asset, map) = (text(&props.asset), text(&props.map));
    let absent = text(&props.folder.path().join("absent.rfield"));
    for persistent in [true, false] {
        let options = Options { persistent_messages: persistent, ..Options::default() };
        with_instance(options, Context::Filter, |instance| {
            instance.clip("Source").connect(plate(64, 48));
            for (asset, environment, lamp, said) in [
                ("", map.as_str(), 0, "Choose an asset"),
                (absent.as_str(), map.as_str(), 0, "absent.rfield"),
                (text(&broken).as_str(), map.as_str(), 0, "broken.rfield"),
                (map.as_str(), map.as_str(), 0, "sky.exr"),
                ("${RELUME_NOT_SET}/a.rfield", map.as_str(), 0, "RELUME_NOT_SET"),
                (asset.as_str(), "", 0, "Choose an environment"),
                (asset.as_str(), asset.as_str(), 0, "ball.rfield"),
                (asset.as_str(), "", 25, "lamp 25"),
            ] {
                instance.set_string("asset", asset);
                instance.set_string("environment", environment);
                instance.set_int("lamp", lamp);
                let rendered = instance.render(&RenderArgs::default());
                assert!(rendered.failed(), "{said}");
                assert!(rendered.untouched == 0 && rendered.image.is_clear(), "{said}: not cleared");
                let message = match persistent {
                    true => instance.persistent_message().map(|m| m.text),
                    false => instance.messages().pop().map(|m| m.text),
                };
                assert!(message.as_ref().is_some_and(|m| m.contains(said)), "{message:?} says nothing of {said}");
                let status = instance.string("status");
                assert!(asset.is_empty() || status.contains(said), "{status:?} says nothing of {said}");
            }
            props.set(instance);
            instance.set_int("lamp", 0);
            assert!(instance.render(&RenderArgs::default()).ok());
            assert!(instance.persistent_message().is_none());
        });
    }
}

#[test]
fn inputs_that_are_missing_in_any_way_count_as_none() {
    let props = Props::new();
    for way in 0..5 {
        with_instance(Options::default(), Context::General, |instance| {
            props.set(instance);
            for name in ["Source", "Illumination"] {
                let clip = instance.clip(name);
                match way {
                    0 => clip.disconnect(),
                    1 => clip.connect_without_image(),
                    2 => clip.connect_null_image(),
                    3 => clip.connect_without_pixels(),
                    _ => clip.hide_connected(true),
                }
            }
            let rendered = instance.render(&RenderArgs::default());
            assert!(rendered.ok(), "way {way}: {:?}", instance.persistent_message());
        });
    }
}

#[test]
fn strange_pixels_are_refused_with_a_sentence() {
    let props = Props::new();
    with_instance(Options { fail_on_drop: false, ..Options::default() }, Context::Filter, |instance| {
        props.set(instance);
        instance.clip("Source").connect(plate(64, 48).depth(Depth::Short));
        let rendered = instance.render(&RenderArgs::default());
        assert!(rendered.failed() && rendered.image.is_clear());
        assert!(instance.persistent_message().unwrap().text.contains("OfxBitDepthShort"));
        instance.clip("Source").connect(plate(64, 48).components(Components::Rgb));
        assert!(instance.render(&RenderArgs::default()).ok());
    });
}

#[test]
fn an_unpremultiplied_plate_is_multiplied_by_its_alpha() {
    let props = Props::new();
    with_instance(Options::default(), Context::Filter, |instance| {
        props.set(instance);
        let straight = TestImage::from_fn(64, 48, |x, y| [x as f32 / 64.0, 0.5, y as f32, (x % 5) as f32 / 4.0]);
        let multiplied = TestImage::from_fn(64, 48, |x, y| {
            let [r, g, b, a] = straight.pixel(x, y);
            [r * a, g * a, b * a, a]
        });
        let source = instance.clip("Source");
        source.connect(straight.clone());
        source.set_premultiplication(c"OfxImageAlphaUnPremultiplied");
        let element = props.element(&Look::default(), None);
        close(&instance.render(&RenderArgs::default()).unwrap(), &composite(&element, &multiplied), 1e-5);
    });
}

#[test]
fn a_host_without_a_message_suite_still_gets_a_cleared_output() {
    for name in ["org.relume.testhost", "openfx-driver"] {
        let options = Options {
            name: name.into(),
            missing_suites: vec![c"OfxMessageSuite"],
            fail_on_drop: false,
            ..Options::default()
        };
        // The host holds it against us that nothing could be said; nothing else may be wrong.
        with_instance(options, Context::General, |instance| {
            let rendered = instance.render(&RenderArgs::default());
            assert!(rendered.failed() && rendered.image.is_clear() && rendered.untouched == 0);
            assert!(instance.violations().len() <= 1, "{:?}", instance.violations());
        });
    }
}

#[test]
fn four_threads_render_different_frames() {
    let props = Props::new();
    with_instance(Options::default(), Context::Generator, |instance| {
        props.set(instance);
        instance.animate("exposure", |time| time / 4.0);
        let frames: Vec<_> = (0..16).map(|t| RenderArgs { time: f64::from(t), ..RenderArgs::default() }).collect();
        let rendered = instance.render_from_threads(&frames, 4);
        for (frame, rendered) in frames.iter().zip(rendered) {
            let look = Look { exposure_ev: frame.time / 4.0, ..Look::default() };
            close(&rendered.unwrap(), &props.element(&look, None), 1e-5);
        }
    });
}

#[test]
fn a_stopped_render_leaves_nothing_and_says_nothing() {
    let props = Props::new();
    let host = Host::new(Options::default());
    let plugin = host.load(&relume_tests::bundle()).unwrap();
    let instance = plugin.create(Context::Generator).unwrap();
    props.set(&instance);
    host.set_abort(true);
    let rendered = instance.render(&RenderArgs::default());
    assert!(rendered.image.is_clear() && instance.persistent_message().is_none());
    host.set_abort(false);
    assert!(instance.render(&RenderArgs::default()).ok());
}

#[test]
fn a_changed_or_reloaded_asset_is_seen() {
    let props = Props::new();
    with_instance(Options::default(), Context::Generator, |instance| {
        props.set(instance);
        instance.set_int("lamp", 1);
        assert!(instance.render(&RenderArgs::default()).ok());
        let bad = props.folder.path().join("bad.rfield");
        std::fs::write(&bad, "no longer an asset").unwrap();
        std::fs::rename(&bad, &props.asset).unwrap();
        instance.changed(c"OfxTypeParameter", "reload");
        assert!(instance.render(&RenderArgs::default()).failed());
        let fresh = props.folder.path().join("fresh.rfield");
        write_asset(&fresh);
        std::fs::rename(&fresh, &props.asset).unwrap();
        assert!(instance.render(&RenderArgs::default()).ok());
    });
}

#[test]
fn no_thread_of_ours_outlives_unload() {
    relume_tests::alone("relight_effect::no_thread_of_ours_outlives_unload", || {
        let props = Props::new();
        for _ in 0..3 {
            with_instance(Options::default(), Context::Generator, |instance| {
                props.set(instance);
                assert!(instance.render(&RenderArgs::default()).ok());
                assert!(!cfg!(target_os = "linux") || ours() > 0);
            });
            assert_eq!(ours(), 0);
        }
    });
}

/// Threads of this process that bear our name; 0 where the system does not tell.
fn ours() -> usize {
    let tasks = std::fs::read_dir("/proc/self/task").into_iter().flatten().flatten();
    let names = tasks.filter_map(|task| std::fs::read_to_string(task.path().join("comm")).ok());
    names.filter(|name| name.starts_with("relume-")).count()
}
