//! Lamps and animations from outside: `relume relight --lighting`, `relume lightings`, `relume animate`, and the plugin's
//! parameters for the same.

use std::fs;
use std::path::Path;
use std::process::Command;

use relume_core::illumination::EnvMap;
use relume_core::image::{EncodeOptions, Encoding, Image, read, write};
use relume_core::math::Vec3;
use relume_core::settings::lighting::PRESETS;
use relume_tests::host::{Context, Host, Options, RenderArgs, TestImage};
use relume_tests::{bundle, relume, shared_data, skipped};

use crate::cli::{Set, difference, refuse, relight, run, succeed, text, tool};

/// 60 lamps over the front hemisphere, some degrees below the horizon left out.
fn dome() -> Set {
    let golden = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    let lamp = |k: usize| {
        let z = 1.0 - (k as f64 + 0.5) / 60.0;
        let (r, (s, c)) = ((1.0 - z * z).sqrt(), (golden * k as f64).sin_cos());
        [r * c, r * s, z]
    };
    Set::new(&(0..60).map(lamp).collect::<Vec<_>>(), (21, 11), "tif")
}

fn frame(set: &Set, name: &str, number: i64) -> Vec<u8> {
    fs::read(set.path(&format!("{name}.{number:04}.exr"))).unwrap()
}

fn animate(set: &Set, field: &Path, script: &str, frames: &str, name: &str, options: &[&str]) -> Command {
    let mut command = tool(&["animate"]);
    let output = set.path(&format!("{name}.####.exr"));
    command.arg(field).arg(set.path(script)).args(["--frames", frames]).arg("-o").arg(output).args(options);
    command
}

/// A softbox and a dome against maps of the same radiance: an independent way from light to weights.
#[test]
fn lamps_are_what_a_map_of_them_is() {
    let set = dome();
    let field = set.import(&["--precision", "float"]);
    // The softbox 2 x 1 at distance 2 before the camera, 30 degrees to the right; the CIE's overcast sky.
    let (s, c) = 30f64.to_radians().sin_cos();
    let (axis, right) = (Vec3::new(s, 0.0, c), Vec3::new(c, 0.0, -s));
    let omega = 4.0 * (1.0 * 0.5 / (2.0 * (1.0f64 + 0.25 + 4.0).sqrt())).atan();
    let softbox = |d: &Vec3| {
        let t = 2.0 / d.dot(&axis);
        let inside = t > 0.0 && (d.dot(&right) * t).abs() < 1.0 && (d.y * t).abs() < 0.5;
        [if inside { (std::f64::consts::PI / omega) as f32 } else { 0.0 }; 3]
    };
    let sky = |d: &Vec3| [if d.y > 0.0 { (3.0 / 7.0 * (1.0 + 2.0 * d.y)) as f32 } else { 0.0 }; 3];
    fs::write(
        set.path("box.toml"),
        "[[light]]\nkind = \"softbox\"\nazimuth = 30\nelevation = 0\nwidth = 2\nheight = 1\ndistance = 2\n",
    )
    .unwrap();
    fs::write(set.path("sky.toml"), "[[light]]\nkind = \"dome\"\nhorizon_stops = -1.5849625\n").unwrap();
    // The CIE's sky gives the zenith 7 / 9 of pi of its own radiance; scaled to pi that is 9 / 7 (1 + 2 sin e) / 3.
    let maps = [("box", EnvMap::from_fn(1024, 512, softbox)), ("sky", EnvMap::from_fn(1024, 512, sky))];
    for (name, map) in maps {
        let (path, toml) = (set.path(&format!("{name}.exr")), set.path(&format!("{name}.toml")));
        write(&path, map.image(), EncodeOptions::default()).unwrap();
        let (path, toml) = (path.display().to_string(), toml.display().to_string());
        for look in [&[][..], &["--rotate", "-50", "--exposure", "-1"], &["--reconstruct", "zero-order"]] {
            let lit = |light: &[&str]| relight(&field, &set.out().join("a.exr"), &[light, look].concat());
            let off = difference(&lit(&["--lighting", &toml]), &lit(&["--env", &path]));
            // The map has texels of a third of a degree at the softbox's edges, and beams lie half to one degree apart.
            assert!(off < 0.01, "{name} {look:?}: off by {off}");
        }
    }
}

#[test]
fn lightings_are_listed_printed_and_lit_by_name_or_file() {
    let set = dome();
    let field = set.import(&[]);
    let list = succeed(&mut tool(&["lightings"]));
    for preset in PRESETS {
        assert!(list.contains(&format!("  {} ", preset.id)), "{list}");
    }
    let printed = succeed(&mut tool(&["lightings", "three-point"]));
    fs::write(set.path("mine.toml"), &printed).unwrap();
    let mine = set.path("mine.toml").display().to_string();
    let lit = |options: &[&str]| relight(&field, &set.out().join("a.exr"), options);
    let by_name = lit(&["--lighting", "three-point"]);
    assert!(by_name.data().iter().any(|v| *v > 0.01));
    assert_eq!(by_name.data(), lit(&["--lighting", &mine]).data());
    assert_ne!(by_name.data(), lit(&["--lighting", &mine, "--rotate", "30"]).data());
    // The rim comes from behind, where these lamps are not.
    let mut command = tool(&["relight"]);
    command.arg(&field).arg("-o").arg(set.out().join("a.exr")).args(["--lighting", "rim"]);
    let said = text(&run(&mut command).stderr);
    assert!(said.starts_with("note: ") && said.contains("rim") && said.contains("--outside nearest"), "{said}");
}

#[test]
fn bad_lightings_are_refused_with_a_sentence() {
    let set = dome();
    let field = set.import(&[]);
    let write = |text: &str| fs::write(set.path("bad.toml"), text).unwrap();
    let bad = set.path("bad.toml").display().to_string();
    for (text, lighting, words) in [
        ("[[light]]\nkind = \"disc\"\nazimut = 1\n", bad.as_str(), &["bad.toml, line 3", "`azimut`", "`azimuth`"][..]),
        ("[[light]]\nkind = \"disc\"\nazimuth = \"45deg\"\n", &bad, &["line 3", "45deg", "azimuth = 45"]),
        ("[[light]]\nkind = \"disc\"\nazimuth = 45deg\n", &bad, &["line 3", "45deg"]),
        ("", "tree-point", &["`tree-point`", "`three-point`"]),
        ("", "absent.toml", &["absent.toml"]),
    ] {
        write(text);
        let output = set.out().join("a.exr");
        refuse(tool(&["relight"]).arg(&field).arg("-o").arg(&output).args(["--lighting", lighting]), words);
        assert!(!output.exists());
    }
    for arguments in [
        &["--lighting", "key", "--lamp", "1"][..],
        &["--lighting", "key", "--env", "m.hdr"],
        &["--lighting", "key", "--map-centre", "behind"],
    ] {
        let output = run(tool(&["relight", "a.rfield", "-o", "a.exr"]).args(arguments));
        assert_eq!(output.status.code(), Some(2), "{arguments:?}");
    }
}

/// However a range is split or ordered, a frame has the same bytes; frames that are there are left until told otherwise.
#[test]
fn a_farm_may_split_frames_as_it_likes() {
    let set = dome();
    for precision in ["half", "float"] {
        let field = set.import(&["--precision", precision]);
        let script = "rotation = [[1, 0], [25, 360]]\nexposure = { keys = [[1, 0], [9, 2]], between = \"smooth\" }\n\
                      [[light]]\nlighting = \"softbox-left\"\n[[light]]\nlamp = [[1, 3], [5, 40]]\ngain = 0.5\n";
        fs::write(set.path("s.toml"), script).unwrap();
        let said = succeed(&mut animate(&set, &field, "s.toml", "1-23", "whole", &["--overwrite"]));
        assert!(said.contains("whole.####.exr: 23 frames rendered\n"), "{said}");
        for part in ["1", "2-6", "7-23x4", "8-10,12-14", "16-18,20,21,22"] {
            succeed(&mut animate(&set, &field, "s.toml", part, "split", &["--overwrite"]));
        }
        for n in 1..=23 {
            assert!(frame(&set, "whole", n) == frame(&set, "split", n), "{precision}: frame {n} differs");
        }
    }
    let field = set.import(&["--precision", "half"]);
    let before = frame(&set, "whole", 4);
    fs::write(set.path("whole.0004.exr"), &before[..100]).unwrap();
    fs::write(set.path("s.toml"), "[[light]]\nlamp = 1\n").unwrap();
    let said = succeed(&mut animate(&set, &field, "s.toml", "3-6", "whole", &[]));
    assert!(said.contains("1 frame rendered, 3 frames there already (--overwrite"), "{said}");
    assert!(frame(&set, "whole", 4) != before, "half a file is no frame");
    let kept = frame(&set, "whole", 3);
    succeed(&mut animate(&set, &field, "s.toml", "3", "whole", &["--overwrite"]));
    assert!(frame(&set, "whole", 3) != kept && frame(&set, "whole", 3) == frame(&set, "whole", 4));
}

/// A still script is `relume relight`; light adds, so a fade is the sum of its parts; captured lamps hold.
#[test]
fn frames_are_what_relight_makes_and_fades_are_exact() {
    let set = dome();
    let field = set.import(&["--precision", "float"]);
    let chart = EnvMap::six_poles(64, 32);
    write(&set.path("chart.exr"), chart.image(), EncodeOptions::default()).unwrap();
    let chart = set.path("chart.exr").display().to_string();
    fs::write(
        set.path("s.toml"),
        "rotation = [[0, 0], [10, 100]]\n[[light]]\nenv = \"chart.exr\"\nexposure = 2\ngain = [[0, 1], [10, 0]]\n\
         [[light]]\nlighting = \"key\"\ngain = [[0, 0], [10, 1]]\nrotation = 5\n\
         [[light]]\nlamp = [[0, 1], [10, 2]]\ngain = [[0, 0, \"hold\"], [9, 1, \"hold\"]]\n",
    )
    .unwrap();
    succeed(&mut animate(&set, &field, "s.toml", "0-10", "f", &[]));
    let picture = |n: i64| read(&set.path(&format!("f.{n:04}.exr")), Encoding::Auto).unwrap();
    let lit = |options: &[&str]| relight(&field, &set.out().join("a.exr"), options);
    let env = |heading: &str| lit(&["--env", &chart, "--rotate", heading, "--exposure", "2"]);
    let key = lit(&["--lighting", "key", "--rotate", "5"]);
    let sum = |parts: &[(f32, &Image)]| {
        let mut sum = Image::new(21, 11, 3);
        for (gain, part) in parts {
            sum.data_mut().iter_mut().zip(part.data()).for_each(|(s, p)| *s += gain * p);
        }
        sum
    };
    assert_eq!(picture(0).data(), env("0").data());
    assert!(difference(&picture(4), &sum(&[(0.6, &env("40")), (0.4, &key)])) < 1e-5);
    assert!(difference(&picture(9), &sum(&[(0.1, &env("90")), (0.9, &key), (1.0, &lit(&["--lamp", "1"]))])) < 1e-5);
    assert!(difference(&picture(10), &sum(&[(1.0, &key), (1.0, &lit(&["--lamp", "2"]))])) < 1e-5);
}

#[test]
fn bad_scripts_and_ranges_are_refused_before_anything_is_written() {
    let set = dome();
    let field = set.import(&[]);
    for (text, words) in [
        ("rotatoin = 4\n[[light]]\nlamp = 1\n", &["s.toml, line 1", "`rotatoin`", "`rotation`"][..]),
        ("rotation = [[9, 0], [1, 5]]\n[[light]]\nlamp = 1\n", &["line 1", "frame 1 after one at frame 9"]),
        ("rotation = [[1, 0], [1, 5]]\n[[light]]\nlamp = 1\n", &["line 1", "second key at frame 1"]),
        ("rotation = \"45deg\"\n[[light]]\nlamp = 1\n", &["line 1", "45deg", "rotation = 45"]),
        ("[[light]]\nenv = \"absent.hdr\"\n", &["line 2", "absent.hdr", "not there"]),
        ("[[light]]\nlighting = \"absent.toml\"\n", &["line 2", "absent.toml"]),
        ("[[light]]\nenv = \"dirs.lp\"\n", &["dirs.lp"]),
        ("[[light]]\nlamp = [[1, 2], [3, 61]]\n", &["frame 3", "lamp 61", "1 to 60"]),
        ("title = \"nothing\"\n", &["no light", "[[light]]"]),
    ] {
        fs::write(set.path("s.toml"), text).unwrap();
        refuse(&mut animate(&set, &field, "s.toml", "1-4", "out/f", &[]), words);
        assert!(!set.path("out/f.0001.exr").exists(), "{text}");
    }
    fs::write(set.path("s.toml"), "[[light]]\nlamp = 1\n").unwrap();
    refuse(&mut animate(&set, &field, "s.toml", "1-4", "absent/f", &[]), &["does not exist"]);
    refuse(&mut animate(&set, &set.path("dirs.lp"), "s.toml", "1-4", "f", &[]), &["dirs.lp"]);
    refuse(&mut animate(&set, &field, "absent.toml", "1-4", "f", &[]), &["absent.toml"]);
    for (frames, output) in [("4-1", "f.####.exr"), ("1-4y2", "f.####.exr"), ("", "f.####.exr"), ("1-4", "f.exr")] {
        let output = run(&mut tool(&["animate", "a.rfield", "s.toml", "--frames", frames, "-o", output]));
        assert_eq!(output.status.code(), Some(2), "{frames:?}");
        assert!(
            text(&output.stderr).contains(if frames == "1-4" { "####" } else { "1-4" }),
            "{}",
            text(&output.stderr)
        );
    }
}

/// The plugin's lightings are the command line's, and each light gives way as the effect's documentation has it.
#[test]
fn the_bundle_lights_with_lamps_too() {
    let set = dome();
    let field = set.import(&[]);
    fs::write(set.path("mine.toml"), PRESETS[1].text.replace("-140", "30")).unwrap();
    write(&set.path("sky.exr"), EnvMap::six_poles(32, 16).image(), EncodeOptions::default()).unwrap();
    let path = |name: &str| set.path(name).display().to_string();
    let (mine, sky) = (path("mine.toml"), path("sky.exr"));
    let lit = |options: &[&str]| TestImage::from(&relight(&field, &set.out().join("a.exr"), options));
    let host = Host::new(Options::default());
    let effect = host.load(&bundle()).unwrap();
    let instance = effect.create(Context::Generator).unwrap();
    instance.set_string("asset", &field.display().to_string());
    instance.set_string("environment", &sky);
    instance.set_double("rotation", 20.0);
    let check = |options: &[&str], status: &str| {
        let off = instance.render(&RenderArgs::default()).unwrap().largest_difference(&lit(options));
        assert!(off < 1e-5, "{options:?}: off by {off}");
        assert!(instance.string("status").contains(status), "{}", instance.string("status"));
    };
    let turned = ["--rotate", "20"];
    check(&[&["--env", &sky][..], &turned].concat(), "sky.exr");
    for (n, preset) in PRESETS.iter().enumerate().step_by(4) {
        instance.set_choice("lighting", n + 1);
        check(&[&["--lighting", preset.id][..], &turned].concat(), preset.label);
    }
    instance.set_string("lightingFile", &mine);
    check(&[&["--lighting", &mine][..], &turned].concat(), "mine.toml");
    instance.set_int("lamp", 7);
    check(&["--lamp", "7"], "lamp 7");
    instance.set_int("lamp", 0);
    fs::write(set.path("bad.toml"), "[[light]]\nkind = \"disc\"\nazimut = 1\n").unwrap();
    instance.set_string("lightingFile", &path("bad.toml"));
    let rendered = instance.render(&RenderArgs::default());
    assert!(rendered.failed() && rendered.image.is_clear());
    let message = instance.persistent_message().unwrap().text;
    assert!(message.contains("bad.toml, line 3") && message.contains("`azimuth`"), "{message}");
    assert!(instance.string("status").contains("`azimuth`"), "{}", instance.string("status"));
}

/// A turn of a real sky around real photographs: the command line's frames are the bundle's with the rotation keyed.
#[test]
fn a_turn_of_the_park_around_the_painting_is_the_same_in_the_bundle() {
    let Some(data) = shared_data() else { return skipped("../shared/data") };
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let (asset, park) = (path("p.rfield"), data.join("hdri/park.hdr").canonicalize().unwrap());
    succeed(Command::new(relume()).args(["import", "lp"]).arg(data.join("painting-72/dirs.lp")).arg("-o").arg(&asset));
    let script = format!("rotation = [[1, 0], [25, 360]]\n[[light]]\nenv = {:?}\n", park.display().to_string());
    fs::write(path("turn.toml"), script).unwrap();
    let mut command = tool(&["animate"]);
    command.arg(&asset).arg(path("turn.toml")).args(["--frames", "1-24", "-o"]).arg(path("f.####.exr"));
    assert!(succeed(&mut command).contains("24 frames rendered"));

    let host = Host::new(Options::default());
    let effect = host.load(&bundle()).unwrap();
    let instance = effect.create(Context::Generator).unwrap();
    instance.set_string("asset", &asset.display().to_string());
    instance.set_string("environment", &park.display().to_string());
    instance.set_keys("rotation", &[(1.0, 0.0), (25.0, 360.0)]);
    let frames: Vec<RenderArgs> =
        (1..=24).map(|n| RenderArgs { time: f64::from(n), ..RenderArgs::default() }).collect();
    let mut previous: Option<TestImage> = None;
    for (n, rendered) in (1..).zip(instance.render_from_threads(&frames, 2)) {
        let rendered = rendered.unwrap();
        let expected = TestImage::from(&read(&path(&format!("f.{n:04}.exr")), Encoding::Auto).unwrap());
        let off = rendered.largest_difference(&expected);
        assert!(off < 1e-5, "frame {n}: off by {off}");
        assert!(previous.is_none_or(|last| last.largest_difference(&rendered) > 1e-3), "frame {n} did not turn");
        previous = Some(rendered);
    }
}
