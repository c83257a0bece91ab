//! What can be done to the light, from outside: the tool on maps, on fields and on pictures, and the plugin beside it.

use std::path::Path;

use relume_core::illumination::EnvMap;
use relume_core::image::{ColourSpace, Conversion, EncodeOptions, Encoding, read, write};
use relume_tests::host::{Context, Host, Options, RenderArgs, TestImage};

use crate::cli::{Set, difference, info, relight, run, succeed, text, tool};

/// Five lamps over the front hemisphere, and a map with a sun.
fn scene() -> (Set, String) {
    let s = 0.5f64.sqrt();
    let set = Set::new(&[[0.0, 0.0, 1.0], [s, 0.0, s], [-s, 0.0, s], [0.0, s, s], [0.0, -s, s]], (21, 11), "tif");
    let sky = EnvMap::from_fn(64, 32, |d| {
        if d.x > 0.9 { [40.0, 30.0, 20.0] } else { [0.7 + 0.5 * d.y as f32, 0.8, 1.0 + 0.3 * d.z as f32] }
    });
    let path = set.path("sky.exr");
    write(&path, sky.image(), EncodeOptions::default()).unwrap();
    let path = path.display().to_string();
    (set, path)
}

/// All but the neutral.
const OPERATIONS: [&str; 12] =
    ["--rotate", "35", "--pitch", "-20", "--roll", "70", "--blur", "8", "--clamp", "12", "--map-centre", "behind"];

#[test]
fn a_changed_map_lights_as_the_map_with_the_changes() {
    let (set, sky) = scene();
    let field = set.import(&["--precision", "float"]);
    let changed = set.out().join("changed.exr");
    let said = succeed(tool(&["map", &sky, "-o"]).arg(&changed).args(OPERATIONS).args(["--exposure", "1"]));
    assert!(said.contains("64 x 32 pixels, lin_rec709"), "{said}");
    let changed = changed.display().to_string();
    let a = relight(&field, &set.out().join("a.tif"), &["--env", &changed, "--outside", "nearest"]);
    let options = [&["--env", &sky, "--outside", "nearest", "--exposure", "1"], &OPERATIONS[..]].concat();
    let b = relight(&field, &set.out().join("b.tif"), &options);
    assert!(difference(&a, &b) < 1e-5, "off by {}", difference(&a, &b));
    let plain = relight(&field, &set.out().join("c.tif"), &["--env", &sky, "--outside", "nearest", "--exposure", "1"]);
    assert!(difference(&a, &plain) > 0.05, "the operations do something");
}

#[test]
fn a_map_is_resized_with_its_energy() {
    let (set, sky) = scene();
    for columns in ["16", "50", "200"] {
        let out = set.out().join("resized.exr");
        succeed(tool(&["map", &sky, "--size", columns, "-o"]).arg(&out));
        let (before, after) = (EnvMap::load(Path::new(&sky)).unwrap(), EnvMap::load(&out).unwrap());
        assert_eq!(after.image().width().to_string(), columns);
        for (a, b) in before.integral().iter().zip(after.integral()) {
            assert!((a / b - 1.0).abs() < 1e-5, "{columns}: {a} became {b}");
        }
    }
}

#[test]
fn fields_keep_their_colours_and_pictures_are_given_in_others() {
    let (set, sky) = scene();
    let field = set.import(&["--precision", "float", "--colour-space", "lin_p3d65"]);
    assert_eq!(info(&field)["colour_space"], "lin_p3d65");
    let convert = |name: &str, space: &str| {
        let out = set.out().join(name);
        succeed(tool(&["map", &sky, "--output-space", space, "-o"]).arg(&out));
        out.display().to_string()
    };
    let aces = convert("aces.exr", "aces2065_1");
    let inside = |options: &[&str]| relight(&field, &set.out().join("lit.exr"), options);
    let plain = inside(&["--env", &sky, "--outside", "nearest"]);
    let from_aces = inside(&["--env", &aces, "--map-space", "aces2065_1", "--outside", "nearest"]);
    assert!(difference(&from_aces, &plain) < 1e-5, "the same light, told in other numbers");
    let mut picture = inside(&["--env", &sky, "--outside", "nearest", "--output-space", "acescg"]);
    picture.convert(&Conversion::between(ColourSpace::AcesCg, ColourSpace::LinRec709));
    assert!(difference(&picture, &plain) < 1e-5, "the same picture, told in other numbers");
    // A lamp gives its photograph back in the photograph's own colours.
    let lamp = inside(&["--lamp", "2", "--output-space", "lin_p3d65", "--tint", "1,1,1"]);
    assert!(difference(&lamp, &set.photographs[1]) < 1e-6);
    // White stays white whatever the space.
    let white = set.path("white.exr");
    write(&white, EnvMap::from_fn(8, 4, |_| [1.0; 3]).image(), EncodeOptions::default()).unwrap();
    let out = set.out().join("white.exr");
    succeed(tool(&["map", "--output-space", "aces2065_1", "-o"]).arg(&out).arg(&white));
    assert!(read(&out, Encoding::Auto).unwrap().data().iter().all(|v| (v - 1.0).abs() < 1e-6));
}

#[test]
fn slips_are_told_with_what_is_meant() {
    let (set, sky) = scene();
    let field = set.import(&[]).display().to_string();
    let out = set.out().join("x.exr").display().to_string();
    for (options, words) in [
        (["--pitch", "up"], &["--pitch", "not a number"][..]),
        (["--roll", "nan"], &["--roll", "finite"]),
        (["--rotate", "1,5"], &["decimal dot"]),
        (["--blur", "-3"], &["--blur", "not between 0 and 180"]),
        (["--clamp", "-1"], &["--clamp", "not between 0"]),
        (["--tint", "1,2"], &["--tint", "2 numbers", "1,0.9,0.8"]),
        (["--tint", "1,x,2"], &["`x` is not a number"]),
        (["--tint", "-1,0,0"], &["`-1` is not between"]),
        (["--map-space", "acescgg"], &["`acescg` is near", "lin_rec2020"]),
        (["--output-space", "p3"], &["lin_p3d65"]),
    ] {
        for command in [&["relight", &field, "--env", &sky][..], &["map", &sky]] {
            let output = run(tool(command).args(["-o", &out]).args(options));
            let said = text(&output.stderr);
            assert_eq!(output.status.code(), Some(2), "{options:?}: {said}");
            assert!(words.iter().all(|word| said.contains(word)), "{options:?}: {said}");
        }
    }
    for flag in ["--pitch", "--roll", "--blur", "--clamp"] {
        let output = run(&mut tool(&["relight", &field, "--lamp", "1", flag, "1", "-o", &out]));
        assert_eq!(output.status.code(), Some(2), "{flag} beside --lamp");
    }
    assert!(!Path::new(&out).exists());
}

/// With every operation set, and two of them keyed, the plugin's pictures are the tool's.
#[test]
fn the_plugin_does_the_same() {
    let (set, sky) = scene();
    let field = set.import(&["--precision", "float", "--colour-space", "acescg"]);
    let host = Host::new(Options::default());
    let plugin = host.load(&relume_tests::bundle()).unwrap();
    let instance = plugin.create(Context::Generator).unwrap();
    instance.set_string("asset", &field.display().to_string());
    instance.set_string("environment", &sky);
    for (id, value) in [("rotation", 35.0), ("roll", 70.0), ("clamp", 12.0), ("exposure", 0.5)] {
        instance.set_double(id, value);
    }
    instance.set_doubles("tint", &[1.0, 0.5, 0.25]);
    for (id, option) in [("mapCentre", 1), ("mapSpace", 1), ("outputSpace", 4), ("outside", 1)] {
        instance.set_choice(id, option);
    }
    instance.set_keys("pitch", &[(0.0, -20.0), (10.0, 20.0)]);
    instance.set_keys("blur", &[(0.0, 0.0), (10.0, 20.0)]);
    for (time, pitch, blur) in [(0.0, "-20", "0"), (5.0, "0", "10"), (10.0, "20", "20")] {
        let options = [
            &["--env", &sky, "--rotate", "35", "--pitch", pitch, "--roll", "70", "--blur", blur, "--clamp", "12"][..],
            &["--exposure", "0.5", "--tint", "1,0.5,0.25", "--map-centre", "behind", "--map-space", "lin_rec2020"],
            &["--output-space", "lin_p3d65", "--outside", "nearest"],
        ]
        .concat();
        let expected = relight(&field, &set.out().join("lit.exr"), &options);
        let (w, h) = expected.size();
        let expected = TestImage::from_fn(w, h, |x, y| {
            let p = expected.pixel(x, y);
            [p[0], p[1], p[2], 1.0]
        });
        let rendered = instance.render(&RenderArgs { time, ..RenderArgs::default() }).unwrap();
        let off = rendered.largest_difference(&expected);
        assert!(off <= 1e-5, "frame {time}: off by {off}");
    }
}
