//! Relume Environment Matte in the test host: the pictures are the core's, whatever the host is like.

use std::ops::Range;
use std::path::{Path, PathBuf};

use openfx::sys::generic::core::*;
use openfx::sys::image_effect_v1::image_effect::*;
use openfx::sys::image_effect_v1::param::kOfxParamPropEnabled;
use relume_core::Result;
use relume_core::domain::{Area, Correspondence, Directions, Domain, Plane};
use relume_core::field::{Access, Asset, BLOCK_HEIGHT, BLOCK_WIDTH, Bands, Contents, Precision, write};
use relume_core::illumination::{EnvMap, MapCentre};
use relume_core::image::{EncodeOptions, Image, Window, srgb};
use relume_core::math::Vec3;
use relume_core::matte::{Backdrop, Beyond, Composite, Place, Show};
use relume_core::relight::{Look, ScreenRelighter};
use relume_core::settings::matte::MATTE;
use relume_tests::host::{
    Context, Depth, Host, Instance, Options, Plugin, Rect, RenderArgs, TestImage, VARIADICS_SUPPORTED,
};
use relume_tests::{bundle, skipped};

use crate::plugin::{assert_refused, check_setting};

const IDENTIFIER: &str = "org.relume.EnvironmentMatte";
const RELIGHT: &str = "org.relume.Relight";
const SIZE: (usize, usize) = (53, 38);
const TEXELS: (usize, usize) = (8, 6);

/// T without symmetry, so that a flip or a shift shows.
struct Formula {
    elements: usize,
}

fn transport(x: usize, y: usize, channel: usize, element: usize) -> f32 {
    ((x * 31 + y * 17 + channel * 7 + element * 13) % 97) as f32 / 970.0
}

impl Bands for Formula {
    fn fill(&mut self, by: usize, columns: Range<usize>, blocks: &mut [f32]) -> Result<()> {
        let mut at = blocks.iter_mut();
        let elements = self.elements;
        for (bx, channel, n) in columns.flat_map(|bx| (0..3).flat_map(move |c| (0..elements).map(move |n| (bx, c, n))))
        {
            for (row, column) in (0..BLOCK_HEIGHT).flat_map(|r| (0..BLOCK_WIDTH).map(move |c| (r, c))) {
                let (x, y) = (bx * BLOCK_WIDTH + column, by * BLOCK_HEIGHT + row);
                if let Some(out) = at.next().filter(|_| x < SIZE.0 && y < SIZE.1) {
                    *out = transport(x, y, channel, n);
                }
            }
        }
        Ok(())
    }
}

/// A folder with an asset of a screen, one of lamps, and a map.
struct Props {
    folder: tempfile::TempDir,
    asset: PathBuf,
    lamps: PathBuf,
    map: PathBuf,
}

/// The screen reaches beyond the picture of the object, is seen at an angle, and a little turned.
fn correspondence() -> Correspondence {
    let (w, h) = (SIZE.0 as f64, SIZE.1 as f64);
    let area = Area { from: [0.0, 0.0], to: [w, h] };
    let rows = [[0.7 / w, 0.05 / h, 0.12], [-0.04 / w, 0.6 / h, 0.2], [0.1 / w, 0.0, 1.0]];
    Correspondence::new(rows, area, None).unwrap()
}

impl Props {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        let (asset, lamps, map) = (path("glass.rfield"), path("ball.rfield"), path("park.exr"));
        let screen = Plane::new(TEXELS.0, TEXELS.1).unwrap();
        write_asset(&asset, Domain::Plane(screen, Some(Box::new(correspondence()))), &[]);
        let directions = [Vec3::new(0.0, 0.6, 0.8), Vec3::new(0.6, 0.0, 0.8), Vec3::new(-0.6, 0.0, 0.8), Vec3::z()];
        write_asset(&lamps, Directions::new(directions.to_vec()).unwrap().into(), &[std::f32::consts::PI; 4]);
        let park = EnvMap::from_fn(32, 16, |d| [1.5 + d.x as f32, 1.5 + d.y as f32, 1.5 + d.z as f32]);
        relume_core::image::write(&map, park.image(), EncodeOptions::default()).unwrap();
        Self { folder, asset, lamps, map }
    }

    fn relighter(&self) -> ScreenRelighter {
        ScreenRelighter::new(Asset::open(&self.asset, Access::Read).unwrap()).unwrap()
    }

    /// What the core makes of a plate, row 0 at the top.
    fn expected(&self, plate: &TestImage, shot: &Shot<'_>) -> TestImage {
        let (relighter, size) = (self.relighter(), (plate.width(), plate.height()));
        let rgba = Image::from_data(size.0, size.1, 4, plate.data().to_vec()).unwrap();
        let screen = (relighter.plane(), relighter.correspondence());
        let light = Backdrop::new(screen, SIZE, &shot.place, size).unwrap().light(&rgba, shot.beyond);
        let weights = relighter.weights(&light, &shot.look).unwrap();
        let composite = Composite::new(SIZE, &shot.place, size).unwrap();
        let element = composite.element(&relighter, (&weights, &shot.look), Window::full(size.0, size.1)).unwrap();
        let picture = match shot.show {
            Show::Composite => Composite::over(&element, &rgba),
            Show::Element => element,
            Show::Alpha => {
                let grey = element.data().chunks_exact(4).flat_map(|pixel| [pixel[3]; 4]).collect();
                Image::from_data(size.0, size.1, 4, grey).unwrap()
            }
        };
        TestImage::from_rgba(size.0, size.1, picture.data().to_vec()).at(plate.origin.0, plate.origin.1)
    }
}

fn write_asset(path: &Path, domain: Domain, irradiance: &[f32]) {
    let alpha = |i: usize| if (i % SIZE.0).abs_diff(26) < 20 { ((i / SIZE.0) as f32 / 20.0).min(1.0) } else { 0.0 };
    let elements = domain.len();
    let contents = Contents {
        colour_space: Default::default(),
        domain,
        irradiance: irradiance.to_vec(),
        width: SIZE.0,
        height: SIZE.1,
        precision: Precision::Float,
        largest: 1.0,
        ambient: Some(Image::from_fn(SIZE.0, SIZE.1, |x, y| [x as f32 / 100.0, y as f32 / 100.0, 0.1])),
        alpha: Some((0..SIZE.0 * SIZE.1).map(alpha).collect()),
        reliability: None,
        provenance: serde_json::Value::Null,
    };
    write(path, &contents, &mut Formula { elements }).unwrap();
}

/// Settings as the core has them.
#[derive(Clone, Copy)]
struct Shot<'a> {
    place: Place,
    beyond: Beyond<'a>,
    look: Look,
    show: Show,
}

impl Default for Shot<'_> {
    fn default() -> Self {
        Self { place: Place::default(), beyond: Beyond::Stretch, look: Look::default(), show: Show::Composite }
    }
}

impl Shot<'_> {
    /// The same, as a host has them: positions go up.
    fn set(&self, instance: &Instance) {
        for (id, value) in [
            ("positionX", self.place.shift[0]),
            ("positionY", -self.place.shift[1]),
            ("scale", self.place.scale),
            ("rotate", self.place.rotate_deg),
            ("exposure", self.look.exposure_ev),
            ("ambient", self.look.ambient),
        ] {
            instance.set_double(id, value);
        }
        instance.set_doubles("tint", &self.look.tint);
        instance.set_choice_label("output", ["Composite", "Element", "Alpha"][self.show as usize]);
        match self.beyond {
            Beyond::Stretch => instance.set_choice_label("beyond", "Stretched edge"),
            Beyond::Colour(rgb) => {
                instance.set_choice_label("beyond", "Colour");
                instance.set_doubles("beyondColour", &rgb.map(f64::from));
            }
            Beyond::Map(_, view_deg) => {
                instance.set_choice_label("beyond", "Lat-long map");
                instance.set_double("viewAngle", view_deg);
            }
        }
    }
}

fn plate(width: usize, height: usize) -> TestImage {
    let wave = |x: usize, y: usize| 0.5 + 0.4 * ((x as f32 * 0.9).sin() * (y as f32 * 0.7).cos());
    TestImage::from_fn(width, height, |x, y| [x as f32 / 64.0, y as f32 / 48.0, wave(x, y), 1.0])
}

fn matte(host: &Host) -> Option<Plugin> {
    if !VARIADICS_SUPPORTED {
        skipped("variadic suite functions on this platform");
        return None;
    }
    Some(host.load_effect(&bundle(), IDENTIFIER).expect("the bundle loads"))
}

fn with_instance(options: Options, context: Context, work: impl FnOnce(&Instance)) {
    let host = Host::new(options);
    let Some(plugin) = matte(&host) else { return };
    let instance = plugin.create(context).unwrap();
    work(&instance);
}

fn text(path: &Path) -> String {
    path.display().to_string()
}

#[track_caller]
fn close(found: &TestImage, expected: &TestImage, tolerance: f32) {
    let difference = found.largest_difference(expected);
    assert!(difference <= tolerance, "they differ by {difference}");
}

#[test]
fn the_bundle_holds_two_effects_and_this_one_describes_itself() {
    let host = Host::new(Options::default());
    let Some(plugin) = matte(&host) else { return };
    assert_eq!(host.identifiers(&bundle()).unwrap(), [RELIGHT, IDENTIFIER]);
    let general = plugin.describe_general();
    let contexts = general.texts(kOfxImageEffectPropSupportedContexts);
    assert_eq!(contexts, ["OfxImageEffectContextFilter", "OfxImageEffectContextGeneral"]);
    for context in [Context::Filter, Context::General] {
        let described = plugin.describe(context);
        assert_eq!(described.texts(kOfxPropLabel), ["Relume Environment Matte"]);
        assert_eq!(described.texts(kOfxImageEffectPluginPropGrouping), ["Relume"]);
        assert_eq!(described.texts(kOfxImageEffectPluginRenderThreadSafety), ["OfxImageEffectRenderFullySafe"]);
        assert_eq!(described.numbers(kOfxImageEffectPropSupportsTiles), [1.0]);
        assert_eq!(described.clips(), ["Source", "Output"]);
        assert_eq!(described.clip_numbers("Source", kOfxImageEffectPropSupportsTiles), [0.0], "all of it is light");
        assert_eq!(described.clip_numbers("Source", kOfxImageClipPropOptional), [0.0]);
        MATTE.iter().for_each(|setting| check_setting(&described, setting));
        let known = |name: &String| MATTE.iter().any(|setting| setting.id == name);
        let order: Vec<_> = described.params().into_iter().filter(known).collect();
        assert_eq!(order, MATTE.iter().map(|setting| setting.id).collect::<Vec<_>>());
        assert_eq!(described.param_numbers("status", kOfxParamPropEnabled), [0.0], "status is for reading");
        assert!(described.params().iter().all(|name| name.bytes().all(|byte| byte.is_ascii_alphanumeric())));
    }
}

#[test]
fn the_picture_is_the_cores_whole_or_in_tiles_wherever_the_plate_lies() {
    let props = Props::new();
    let map = EnvMap::load(&props.map).unwrap();
    let turned = Place { shift: [3.25, -5.5], scale: 0.8, rotate_deg: 33.0 };
    let large = Place { shift: [-10.0, 4.0], scale: 2.3, rotate_deg: -90.0 };
    let look = Look { exposure_ev: 0.5, tint: [1.0, 0.5, 1.5], ambient: 0.7, ..Look::default() };
    let shots = [
        Shot::default(),
        Shot { place: turned, look, ..Shot::default() },
        Shot { place: turned, show: Show::Element, beyond: Beyond::Colour([0.5, 2.0, 0.0]), ..Shot::default() },
        Shot { place: large, beyond: Beyond::Map(&map, 55.0), ..Shot::default() },
        Shot { place: large, show: Show::Alpha, ..Shot::default() },
        Shot { show: Show::Alpha, ..Shot::default() },
    ];
    let sources = [plate(64, 48), plate(71, 45).at(-9, 5).rows(12, true)];
    for (n, shot) in shots.iter().enumerate() {
        let (source, context) = (&sources[n % 2], [Context::Filter, Context::General][n / 2 % 2]);
        with_instance(Options::default(), context, |instance| {
            instance.set_string("asset", &text(&props.asset));
            instance.set_string("beyondMap", &text(&props.map));
            shot.set(instance);
            instance.clip("Source").connect(source.clone());
            let expected = props.expected(source, shot);
            close(&instance.render(&RenderArgs::default()).unwrap(), &expected, 1e-5);
            for size in [17, 40] {
                close(&instance.render_tiles(&RenderArgs::default(), size), &expected, 1e-5);
            }
            let strange = RenderArgs { row_padding: 20, negative_rows: true, ..RenderArgs::default() };
            close(&instance.render(&strange).unwrap(), &expected, 1e-5);
            let status = instance.string("status");
            assert!(status.contains("53 x 38 pixels, a screen of 8 x 6 texels"), "{status}");
            assert!(status.contains("park.exr, 32 x 16") == matches!(shot.beyond, Beyond::Map(..)), "{status}");
        });
    }
}

/// The same numbers as the command line, to 1e-5.
#[test]
fn the_command_line_makes_the_same_picture() {
    let props = Props::new();
    let file = |name: &str| props.folder.path().join(name);
    let source = plate(64, 48);
    let rgb = Image::from_fn(64, 48, |x, y| source.pixel(x, y)[..3].try_into().unwrap());
    relume_core::image::write(&file("plate.exr"), &rgb, EncodeOptions::default()).unwrap();
    with_instance(Options::default(), Context::Filter, |instance| {
        instance.set_string("asset", &text(&props.asset));
        instance.set_string("beyondMap", &text(&props.map));
        instance.clip("Source").connect(source);
        let place = Place { shift: [6.5, -3.0], scale: 0.75, rotate_deg: 20.0 };
        let look = Look { exposure_ev: -0.5, ambient: 0.25, ..Look::default() };
        let map = EnvMap::load(&props.map).unwrap();
        for (name, beyond) in [("park.exr", Beyond::Map(&map, 60.0)), ("stretch", Beyond::Stretch)] {
            for (output, show) in [("composite", Show::Composite), ("element", Show::Element)] {
                Shot { place, look, beyond, show }.set(instance);
                let made = instance.render(&RenderArgs::default()).unwrap();
                let flags = ["--place", "6.5,3,0.75,20", "--exposure", "-0.5", "--ambient", "0.25", "--view", "60"];
                let mut command = std::process::Command::new(relume_tests::relume());
                command.current_dir(props.folder.path()).args(["matte", "glass.rfield", "--plate", "plate.exr"]);
                command.args(flags).args(["--beyond", name, "--output", output, "-o", "out.exr"]);
                let said = command.output().unwrap();
                assert!(said.status.success(), "{}", String::from_utf8_lossy(&said.stderr));
                let written = relume_core::image::read(&file("out.exr"), Default::default()).unwrap();
                close(&made, &TestImage::from(&written), 1e-5);
            }
        }
    });
}

/// Frames by several threads and in tiles: each has the light of its own plate.
#[test]
fn the_light_moves_with_the_plate() {
    let props = Props::new();
    let frame = |time: f64| {
        TestImage::from_fn(64, 48, move |x, y| [(x as f32 / 9.0 + time as f32).sin() + 1.0, y as f32 / 48.0, 0.3, 1.0])
    };
    with_instance(Options::default(), Context::Filter, |instance| {
        instance.set_string("asset", &text(&props.asset));
        instance.clip("Source").connect_frames(move |time| Some(frame(time)));
        let frames: Vec<_> = (0..12).map(|t| RenderArgs { time: f64::from(t % 6), ..RenderArgs::default() }).collect();
        let rendered = instance.render_from_threads(&frames, 4);
        let expected: Vec<_> = (0..6).map(|t| props.expected(&frame(f64::from(t)), &Shot::default())).collect();
        for (n, rendered) in rendered.into_iter().enumerate() {
            close(&rendered.unwrap(), &expected[n % 6], 1e-5);
        }
        // What is opaque and not moved shows nothing of the plate itself but through the light.
        let solid = |image: &TestImage| image.pixel(32, 30)[0];
        assert!((solid(&expected[0]) - solid(&expected[2])).abs() > 0.05);
        instance.animate("positionX", |time| 3.0 * time);
        for time in [1.0, 2.0] {
            let place = Place { shift: [3.0 * time, 0.0], ..Place::default() };
            let args = RenderArgs { time, ..RenderArgs::default() };
            let moved = props.expected(&frame(time), &Shot { place, ..Shot::default() });
            close(&instance.render_tiles(&args, 23), &moved, 1e-5);
        }
    });
}

/// A proxy is the core's picture of the smaller plate, and close to the large picture made smaller.
#[test]
fn smaller_scales_place_a_smaller_object_in_a_smaller_plate() {
    let props = Props::new();
    let place = Place { shift: [6.0, -4.0], scale: 1.2, rotate_deg: 25.0 };
    let halved = Place { shift: [3.0, -2.0], scale: 0.6, rotate_deg: 25.0 };
    let source = TestImage::from_fn(64, 48, |x, y| [x as f32 / 64.0, y as f32 / 48.0, 0.25, 1.0]);
    for regions_in_pixels in [false, true] {
        with_instance(Options { regions_in_pixels, ..Options::default() }, Context::Filter, |instance| {
            instance.set_string("asset", &text(&props.asset));
            Shot { place, ..Shot::default() }.set(instance);
            instance.clip("Source").connect(source.clone());
            let args = RenderArgs { scale: (0.5, 0.5), ..RenderArgs::default() };
            let half = instance.render(&args).unwrap();
            let expected = props.expected(&source.scaled((0.5, 0.5)), &Shot { place: halved, ..Shot::default() });
            close(&half, &expected, 1e-5);
            close(&instance.render_tiles(&args, 10), &half, 1e-5);
            let whole = instance.render(&RenderArgs::default()).unwrap().scaled((0.5, 0.5));
            let difference = |a: &TestImage, b: &TestImage| {
                a.data().iter().zip(b.data()).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>().sqrt()
            };
            let (apart, size) = (difference(&half, &whole), difference(&whole, &TestImage::new(32, 24)));
            assert!(apart < 0.06 * size, "{apart} of {size}");
            // Elsewhere it would not be.
            instance.set_double("positionX", 10.0);
            let elsewhere = instance.render(&args).unwrap();
            assert!(difference(&elsewhere, &whole) > 3.0 * apart);
            // A scale below what a place allows is a dot, not a failure.
            instance.set_double("scale", 0.001);
            assert!(instance.render(&args).ok());
        });
    }
}

/// Pixels twice as wide as high: made in squares, and averaged.
#[test]
fn wide_pixels_show_a_round_object() {
    let props = Props::new();
    // The plate changes downwards alone, so that its squares are its pixels doubled.
    let source = TestImage::from_fn(40, 48, |_, y| [y as f32 / 48.0, 1.0 - y as f32 / 48.0, 0.5, 1.0]);
    let squares = TestImage::from_fn(80, 48, |x, y| source.pixel(x / 2, y));
    let place = Place { shift: [8.0, 5.0], scale: 1.0, rotate_deg: 30.0 };
    with_instance(Options { pixel_aspect: 2.0, ..Options::default() }, Context::Filter, |instance| {
        instance.set_string("asset", &text(&props.asset));
        Shot { place, ..Shot::default() }.set(instance);
        instance.clip("Source").connect(source.clone());
        let made = instance.render(&RenderArgs::default()).unwrap();
        let element = props.expected(&squares, &Shot { place, show: Show::Element, ..Shot::default() });
        let expected = TestImage::from_fn(40, 48, |x, y| {
            let (a, b, s) = (element.pixel(2 * x, y), element.pixel(2 * x + 1, y), source.pixel(x, y));
            let mean: [f32; 4] = std::array::from_fn(|c| 0.5 * (a[c] + b[c]));
            std::array::from_fn(|c| mean[c] + (1.0 - mean[3]) * s[c])
        });
        close(&made, &expected, 1e-5);
        close(&instance.render_tiles(&RenderArgs::default(), 13), &made, 1e-5);
    });
}

#[test]
fn bytes_are_srgb() {
    let props = Props::new();
    with_instance(Options { depth: Depth::Byte, ..Options::default() }, Context::Filter, |instance| {
        instance.set_string("asset", &text(&props.asset));
        let code = |x: usize| (x % 256) as f32 / 255.0;
        let source = TestImage::from_fn(64, 48, |x, y| [code(x * 3), code(y * 5), code(x + y), 1.0]);
        instance.clip("Source").connect(source.clone().depth(Depth::Byte));
        let changed = |image: &TestImage, change: &dyn Fn(f32) -> f32| {
            TestImage::from_fn(64, 48, |x, y| {
                let [r, g, b, a] = image.pixel(x, y);
                [change(r), change(g), change(b), a]
            })
        };
        let lit = props.expected(&changed(&source, &srgb::decode), &Shot::default());
        let stored = |v: f32| (srgb::encode(v) * 255.0).round().clamp(0.0, 255.0) / 255.0;
        let args = RenderArgs { depth: Depth::Byte, row_padding: 3, negative_rows: true, ..RenderArgs::default() };
        // One code for what rounds the other way.
        close(&instance.render(&args).unwrap(), &changed(&lit, &stored), 1.01 / 255.0);
    });
}

#[test]
fn all_of_source_is_needed_and_gives_the_region() {
    let props = Props::new();
    with_instance(Options::default(), Context::General, |instance| {
        instance.set_string("asset", &text(&props.asset));
        instance.clip("Source").connect(plate(64, 48).at(-10, 7));
        assert_eq!(instance.region_of_definition(1.0), [-10.0, 7.0, 54.0, 55.0]);
        let needed = instance.regions_of_interest(1.0, [0.0, 10.0, 5.0, 12.0]).unwrap();
        assert_eq!(needed["Source"], [-10.0, 7.0, 54.0, 55.0]);
    });
}

#[test]
fn assets_of_the_other_kind_name_the_other_effect() {
    let props = Props::new();
    let host = Host::new(Options::default());
    if !VARIADICS_SUPPORTED {
        return skipped("variadic suite functions on this platform");
    }
    let plugins = host.load_effects(&bundle(), [RELIGHT, IDENTIFIER]).unwrap();
    let cases =
        [(&props.asset, "glass.rfield", "Relume Environment Matte"), (&props.lamps, "ball.rfield", "Relume Relight")];
    for (plugin, (asset, name, other)) in plugins.iter().zip(cases) {
        let instance = plugin.create(Context::Filter).unwrap();
        instance.clip("Source").connect(plate(64, 48));
        instance.set_string("asset", &text(asset));
        assert_refused(&instance.render(&RenderArgs::default()));
        let message = instance.persistent_message().unwrap().text;
        assert!(message.contains(name) && message.contains(other), "{message}");
        let status = instance.string("status");
        assert!(status.contains(name) && status.contains(other), "{status}");
    }
}

#[test]
fn mistakes_are_told_the_output_is_cleared_and_the_message_goes_with_success() {
    let props = Props::new();
    let broken = props.folder.path().join("broken.rfield");
    std::fs::write(&broken, &std::fs::read(&props.asset).unwrap()[..4000]).unwrap();
    let (asset, map, broken) = (text(&props.asset), text(&props.map), text(&broken));
    let absent = text(&props.folder.path().join("absent.rfield"));
    with_instance(Options::default(), Context::Filter, |instance| {
        instance.clip("Source").connect(plate(64, 48));
        for (asset, beyond, map, form, said) in [
            ("", 0, "", 0, "Choose an asset"),
            (absent.as_str(), 0, "", 0, "absent.rfield"),
            (broken.as_str(), 0, "", 0, "broken.rfield"),
            (map.as_str(), 0, "", 0, "park.exr"),
            ("${RELUME_NOT_SET}/a.rfield", 0, "", 0, "RELUME_NOT_SET"),
            (asset.as_str(), 2, "", 0, "Choose what lies beyond"),
            (asset.as_str(), 2, asset.as_str(), 0, "glass.rfield"),
            (asset.as_str(), 2, absent.as_str(), 0, "absent.rfield"),
            (asset.as_str(), 0, "", 4, "no `explicit` representation"),
        ] {
            instance.set_string("asset", asset);
            instance.set_string("beyondMap", map);
            instance.set_choice("beyond", beyond);
            instance.set_choice("representation", form);
            assert_refused(&instance.render(&RenderArgs::default()));
            let message = instance.persistent_message().unwrap().text;
            assert!(message.contains(said), "{message:?} says nothing of {said}");
            let status = instance.string("status");
            assert!(asset.is_empty() || status.contains(said), "{status:?} says nothing of {said}");
        }
        instance.set_choice("representation", 0);
        assert!(instance.render(&RenderArgs::default()).ok());
        assert!(instance.persistent_message().is_none());
        // Alpha needs no light, so no map either.
        instance.set_choice("beyond", 2);
        instance.set_choice("output", 2);
        assert!(instance.render(&RenderArgs::default()).ok());
        // Renamed files are seen.
        let fresh = text(&props.folder.path().join("fresh.rfield"));
        std::fs::copy(&props.asset, &fresh).unwrap();
        instance.set_string("asset", &fresh);
        assert!(instance.render(&RenderArgs::default()).ok());
        std::fs::remove_file(&fresh).unwrap();
        instance.changed(c"OfxTypeParameter", "reload");
        assert_refused(&instance.render(&RenderArgs::default()));
    });
    assert!(map.ends_with("park.exr"));
}

#[test]
fn a_plate_that_is_missing_in_any_way_is_told() {
    let props = Props::new();
    with_instance(Options { fail_on_drop: false, ..Options::default() }, Context::General, |instance| {
        instance.set_string("asset", &text(&props.asset));
        let clip = instance.clip("Source");
        let feeds: [&dyn Fn(); 6] = [
            &|| clip.disconnect(),
            &|| clip.connect_without_image(),
            &|| clip.connect_null_image(),
            &|| clip.connect_without_pixels(),
            &|| clip.connect_frames(|time| (time > 5.0).then(|| plate(64, 48))),
            &|| clip.connect(plate(64, 48).depth(Depth::Short)),
        ];
        for (n, feed) in feeds.iter().enumerate() {
            feed();
            let args = RenderArgs { bounds: Some(Rect::new(0, 0, 64, 48)), ..RenderArgs::default() };
            assert_refused(&instance.render(&args));
            let message = instance.persistent_message().unwrap().text;
            let said = if n == 5 { "OfxBitDepthShort" } else { "Connect the backplate to Source" };
            assert!(message.contains(said), "{n}: {message}");
        }
        clip.connect(plate(64, 48));
        assert!(instance.render(&RenderArgs::default()).ok() && instance.persistent_message().is_none());
    });
}

/// What is not a number counts as the default, what has no end as the end of the range; a pixel of the plate that is not a
/// number is no light, and shows only where it is seen itself.
#[test]
fn numbers_that_are_none_do_no_harm() {
    let props = Props::new();
    with_instance(Options { fail_on_drop: false, ..Options::default() }, Context::Filter, |instance| {
        instance.set_string("asset", &text(&props.asset));
        let source = instance.clip("Source");
        source.connect(plate(64, 48));
        let neutral = instance.render(&RenderArgs::default()).unwrap();
        let numbers = ["positionX", "positionY", "scale", "rotate", "exposure", "ambient", "viewAngle"];
        // Expressions get past the host's own check of ranges, which looks at the first frame.
        let later = |value: f64| move |time: f64| if time == 1.0 { 1.0 } else { value };
        let args = RenderArgs { time: 2.0, ..RenderArgs::default() };
        numbers.iter().for_each(|id| instance.animate(id, later(f64::NAN)));
        instance.animate_int("output", |time| if time == 1.0 { 0 } else { -3 });
        close(&instance.render(&args).unwrap(), &neutral, 0.0);
        for end in [f64::INFINITY, f64::NEG_INFINITY, 1e300] {
            for id in numbers {
                instance.animate(id, later(end));
                let rendered = instance.render(&args);
                assert!(rendered.ok(), "{id} {end}: {:?}", instance.persistent_message());
                assert!(rendered.image.data().iter().all(|v| !v.is_nan()), "{id} {end}");
                instance.animate(id, later(f64::NAN));
            }
        }
        let mut holed = plate(64, 48);
        let mut dark = plate(64, 48);
        // Behind the opaque middle of the object.
        holed.set_canonical(32, 10, [f32::NAN, f32::INFINITY, f32::NAN, 1.0]);
        dark.set_canonical(32, 10, [0.0, 0.0, 0.0, 1.0]);
        source.connect(holed);
        close(&instance.render(&args).unwrap(), &props.expected(&dark, &Shot::default()), 1e-5);
    });
}

#[test]
fn the_middle_of_a_map_is_in_front_or_behind() {
    let props = Props::new();
    let behind = EnvMap::load(&props.map).unwrap().oriented(MapCentre::Behind, 0.0);
    let source = plate(64, 48);
    let place = Place { scale: 2.0, ..Place::default() };
    with_instance(Options::default(), Context::Filter, |instance| {
        instance.set_string("asset", &text(&props.asset));
        instance.set_string("beyondMap", &text(&props.map));
        instance.clip("Source").connect(source.clone());
        let shot = Shot { place, beyond: Beyond::Map(&behind, 90.0), ..Shot::default() };
        shot.set(instance);
        let front = instance.render(&RenderArgs::default()).unwrap();
        instance.set_choice_label("mapCentre", "Behind");
        let made = instance.render(&RenderArgs::default()).unwrap();
        close(&made, &props.expected(&source, &shot), 1e-5);
        assert!(made.largest_difference(&front) > 0.01);
    });
}

/// One library, two effects: the end of one is not the end of the other.
#[test]
fn an_effect_outlives_the_other() {
    let props = Props::new();
    let host = Host::new(Options::default());
    if !VARIADICS_SUPPORTED {
        return skipped("variadic suite functions on this platform");
    }
    let [relight, matte] = host.load_effects(&bundle(), [RELIGHT, IDENTIFIER]).unwrap();
    let source = plate(64, 48);
    let instance = matte.create(Context::Filter).unwrap();
    instance.set_string("asset", &text(&props.asset));
    instance.clip("Source").connect(source.clone());
    let expected = props.expected(&source, &Shot::default());
    let lit = relight.create(Context::Filter).unwrap();
    lit.set_string("asset", &text(&props.lamps));
    lit.set_int("lamp", 2);
    lit.clip("Source").connect(source);
    assert!(lit.render(&RenderArgs::default()).ok());
    drop(lit);
    assert!(relight.unload());
    close(&instance.render(&RenderArgs::default()).unwrap(), &expected, 1e-5);
    instance.plain_action(kOfxActionPurgeCaches);
    drop(relight);
    close(&instance.render(&RenderArgs::default()).unwrap(), &expected, 1e-5);
}
