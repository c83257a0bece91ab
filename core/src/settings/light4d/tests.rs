//! What is written is what is lit; what is wrong is told; the presets load.

use super::*;
use crate::illumination::Incident;
use crate::image::Image;

/// The irradiance of every ray that arrives at a point.
fn beams_at(light: &LightField, at: Vec3) -> Vec<[f64; 3]> {
    let mut all = Vec::new();
    light.arriving(&at, &mut |_, irradiance| all.push(irradiance));
    all
}

#[test]
fn every_preset_loads_under_its_title_and_gives_light() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../presets/light4d");
    let mut files: Vec<String> = std::fs::read_dir(&folder)
        .unwrap()
        .map(|entry| entry.unwrap().path().file_stem().unwrap().to_string_lossy().into_owned())
        .collect();
    files.sort();
    let mut ids: Vec<&str> = PRESETS.iter().map(|preset| preset.id).collect();
    ids.sort_unstable();
    assert_eq!(files, ids, "every file is a preset");
    for preset in PRESETS {
        let file = find(preset.id, Path::new(".")).unwrap();
        assert_eq!((file.title.as_str(), file.pictures.len()), (preset.label, 0));
        assert!(!file.about.is_empty(), "{}", preset.id);
        // The best lit of places about the origin, within a few stops of a white diffuser at 1.
        let lit = |at: Vec3| beams_at(&file.light, at).iter().map(|e| e[1]).sum::<f64>();
        let places = (-4..=4).flat_map(|x| (-4..=4).map(move |y| Vec3::new(f64::from(x), f64::from(y), 0.5) * 0.2));
        let most = places.map(lit).fold(0.0, f64::max);
        assert!((0.3..40.0).contains(&most), "{}: {most}", preset.id);
        // It varies in space.
        let places = (-4..=4).flat_map(|x| (-4..=4).map(move |y| Vec3::new(f64::from(x), f64::from(y), 0.5) * 0.2));
        let least = places.map(lit).fold(f64::INFINITY, f64::min);
        assert!(least < 0.7 * most, "{}: {least} to {most}", preset.id);
    }
}

fn parsed(text: &str) -> Result<LightFile> {
    parse("a.toml", text, Path::new("."))
}

#[test]
fn what_is_written_is_what_is_lit() {
    let text = "[[light]]\nkind = \"spot\"\nname = \"key\"\nposition = [0, 0, 4]\naim = [0, 0, 1]\nbeam = 20\nedge = 5\n\
                rgb = [1, 0.5, 0]\nstops = 1\n\
                [[light]]\nkind = \"area\"\nposition = [0, 3, 0]\nwidth = 1\nheight = 2\nturn = 30\n\
                [[light]]\nkind = \"disc\"\nazimuth = 90\nelevation = 0\nradius = 1\nstops = -1\n\
                [[light]]\nkind = \"sun\"\nazimuth = 0\nelevation = 0\ndiameter = 0\n\
                [light.blinds]\nposition = [0, 0, 2]\nwidth = 3\nheight = 3\nspacing = 0.4\nopen = 0.5\n";
    let light = parsed(text).unwrap().light;
    let spot = Frame::new(Vec3::new(0.0, 0.0, 4.0), Vec3::z(), Vec3::y()).unwrap();
    let spot = Emitter::Spot(Spot::new(spot, 20f64.to_radians(), 5f64.to_radians()));
    assert_eq!(light.sources[0], Source::new("key", spot).lit([1.0, 0.5, 0.0], 1.0));
    let area = Frame::new(Vec3::new(0.0, 3.0, 0.0), Vec3::zeros(), Vec3::y()).unwrap().rolled(30f64.to_radians());
    assert_eq!(light.sources[1], Source::new("area 2", Emitter::Area(Area::new(area, 1.0, 2.0))));
    let total: f64 = {
        let mut sum = 0.0;
        light.sources[2].arriving(&Vec3::zeros(), &mut |_, e| sum += e[2]);
        sum
    };
    assert!((total / std::f64::consts::FRAC_PI_2 - 1.0).abs() < 1e-9, "{total}");
    for (y, lit) in [(0.0, true), (0.2, false), (0.4, true)] {
        let mut seen = false;
        light.sources[3].arriving(&Vec3::new(0.0, y, 0.0), &mut |_, _| seen = true);
        assert_eq!(seen, lit, "{y}");
    }
}

/// Each mistake is told with file, line, what is there and what should be.
#[test]
fn mistakes_are_told() {
    let spot = "[[light]]\nkind = \"spot\"\nposition = [0, 1, 2]\nbeam = 20\n";
    let sun = "[[light]]\nkind = \"sun\"\nazimuth = 0\nelevation = 0\n[light.blinds]\nposition = [0, 0, 2]\nwidth = 1\nheight = 1\n";
    let probes = "[[light]]\nkind = \"probes\"\norigin = [0, 0, 0]\nacross = [1, 0, 0]\ndown = [0, 1, 0]\ncolumns = 2\nrows = 2\n";
    for (text, words) in [
        (spot.replace("beam", "baem"), &["a.toml, line 4", "`baem`", "`beam`", "a spot takes"][..]),
        (spot.replace("spot", "sopt"), &["line 2", "sopt", "`spot`"]),
        (spot.replace("kind = \"spot\"\n", ""), &["line 1", "no `kind`", "probes", "softbox"]),
        (spot.replace("beam = 20\n", ""), &["line 1", "no `beam` in a spot"]),
        (spot.replace("20", "200"), &["line 4", "200", "0.01 to 180 degrees"]),
        (spot.replace("[0, 1, 2]", "[0, 1]"), &["line 3", "a list of 2", "3 numbers"]),
        (spot.replace("[0, 1, 2]", "[0, 0, 0]"), &["line 1", "`position` is its `aim`", "two different points"]),
        (spot.replace("[0, 1, 2]", "[0, nan, 0]"), &["line 3", "nan"]),
        (format!("{spot}kelvin = 3000\nrgb = [1, 1, 1]\n"), &["line 6", "`kelvin` or `rgb`"]),
        (format!("{spot}azimuth = 3\n"), &["line 5", "`azimuth`", "a spot takes"]),
        (format!("{sun}facing = [0, 0, 1]\n"), &["line 5", "not between the origin and `sun 1`", "behind it"]),
        (sun.replace("azimuth = 0", "azimuth = 180"), &["line 5", "not between the origin"]),
        (format!("{sun}slat = 1\n"), &["line 9", "`spacing`"]),
        (format!("{sun}spacing = 1\nopen = 0.5\ntilt = 3\n"), &["line 10", "either `open`"]),
        (format!("{sun}spacing = 1\nopen = 1.5\n"), &["line 10", "1.5", "0 to 1"]),
        (format!("{sun}gap = 1\n"), &["line 9", "`gap`", "blinds"]),
        (format!("{probes}pattern = \"p_{{column}}.exr\"\n"), &["line 8", "no `{row}`"]),
        (format!("{probes}pattern = \"p_{{colum}}.exr\"\n"), &["line 8", "`{colum}`", "{column:02}"]),
        (format!("{probes}pattern = \"p_{{column.exr\"\n"), &["line 8", "without `}`"]),
        (format!("{probes}files = [\"a\", \"b\"]\n"), &["line 8", "a list of 2", "a list of 4 names", "2 a row"]),
        (probes.to_owned(), &["line 1", "neither `files` nor `pattern`"]),
        (format!("{probes}files = []\npattern = \"a\"\n"), &["line 9", "either"]),
        (probes.replace("columns = 2", "columns = 2.5"), &["line 6", "2.5", "whole"]),
        (probes.replace("columns = 2", "columns = 4000"), &["line 6", "4000 x 2 x 1", "at most 4096"]),
        (format!("{probes}layers = 2\npattern = \"{{column}}{{row}}{{layer}}\"\n"), &["line 1", "no `deep`"]),
        ("[[light]]\nkind = \"map\"\nfile = \"no.exr\"\n".to_owned(), &["line 3", "no.exr", "cannot read"]),
        (String::new(), &["a.toml", "no light", "[[light]]"]),
    ] {
        let message = parsed(&text).unwrap_err().to_string();
        for word in words {
            assert!(message.contains(word), "no `{word}` in: {message}");
        }
        assert!(!message.contains('\n'), "{message}");
    }
    let message = find("threebeams", Path::new(".")).unwrap_err().to_string();
    assert!(message.contains("`three-beams`: a .toml file"), "{message}");
}

/// Pictures are found beside the file, and a hole in a grid is named by its place.
#[test]
fn pictures_are_read_beside_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let grey = |name: &str, v: f32| {
        crate::image::write(&at(name), &Image::from_fn(8, 4, |_, _| [v; 3]), crate::image::EncodeOptions::default())
            .unwrap();
    };
    for (n, name) in ["p_01_01.exr", "p_02_01.exr", "p_01_02.exr", "p_02_02.exr"].into_iter().enumerate() {
        grey(name, n as f32);
    }
    let text = "[[light]]\nkind = \"probes\"\nacross = [1, 0, 0]\ndown = [0, -1, 0]\ncolumns = 2\nrows = 2\n\
                pattern = \"p_{column:02}_{row:02}.exr\"\nfirst = 1\n\
                [[light]]\nkind = \"slide\"\nposition = [0, 0, 3]\nview = 20\nimage = \"p_02_02.exr\"\nlookup = \"squares\"\n\
                [[light]]\nkind = \"map\"\nfile = \"p_02_01.exr\"\nmap_centre = \"behind\"\nrotation = 30\nstops = 1\n";
    std::fs::write(at("light.toml"), text).unwrap();
    let file = load(&at("light.toml")).unwrap();
    assert_eq!(file.pictures.len(), 6);
    assert_eq!(file.pictures[5], at("p_02_01.exr"));
    let arrives = |light: &LightField, p: Vec3| light.radiance(&p, &Vec3::z())[0];
    // Map: 1 at one stop; probe (1, 0) holds 1, (0, 1) holds 2.
    assert!((arrives(&file.light, Vec3::x()) - 3.0).abs() < 1e-6);
    assert!((arrives(&file.light, -Vec3::y()) - 4.0).abs() < 1e-6);
    let white = beams_at(&file.light, Vec3::zeros());
    assert!(white.len() == 1 && (white[0][0] / (3.0 * std::f64::consts::PI) - 1.0).abs() < 1e-6);
    std::fs::remove_file(at("p_01_02.exr")).unwrap();
    let message = load(&at("light.toml")).unwrap_err().to_string();
    for word in ["light.toml, line 7", "a hole in the grid at column 0, row 1", "p_01_02.exr", "every probe"] {
        assert!(message.contains(word), "no `{word}` in: {message}");
    }
    std::fs::write(at("p_01_02.exr"), "no picture").unwrap();
    assert!(load(&at("light.toml")).unwrap_err().to_string().contains("column 0, row 1"));
}
