//! Relume Relight under light near the object: beams, a slide and light files, on an asset of a projector and on one of lamps.

use std::fs;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use relume_core::Result;
use relume_core::domain::{Directions, Domain, Filter, Gantry};
use relume_core::field::{Access, Asset, BLOCK_HEIGHT, BLOCK_WIDTH, Bands, Contents, Precision, write};
use relume_core::illumination::LightField;
use relume_core::illumination::light_field::Slide;
use relume_core::image::{EncodeOptions, Image, Window};
use relume_core::math::Vec3;
use relume_core::relight::{Light, Look, Relighter};
use relume_core::settings::light4d;
use relume_core::settings::near::Thrown;
use relume_tests::host::{Context, Host, Instance, Options, RenderArgs, TestImage};

const WIDTH: usize = 21;
const HEIGHT: usize = 13;
const SIDE: usize = 4;

/// T without symmetry, so that no two elements are alike.
struct Formula(usize);

impl Bands for Formula {
    fn fill(&mut self, by: usize, columns: Range<usize>, blocks: &mut [f32]) -> Result<()> {
        let elements = self.0;
        for (n, block) in blocks.chunks_exact_mut(BLOCK_WIDTH * BLOCK_HEIGHT).enumerate() {
            let (bx, channel, element) = (columns.start + n / (3 * elements), n / elements % 3, n % elements);
            for (at, out) in block.iter_mut().enumerate() {
                let (x, y) = (bx * BLOCK_WIDTH + at % BLOCK_WIDTH, by * BLOCK_HEIGHT + at / BLOCK_WIDTH);
                if x < WIDTH && y < HEIGHT {
                    *out = 1e-4 * (1 + (x * 31 + y * 17 + channel * 7 + element * 13) % 97) as f32;
                }
            }
        }
        Ok(())
    }
}

/// Around the object, above and below.
fn directions() -> Vec<Vec3> {
    let direction = |i: usize| {
        let (z, turn) = (1.0 - (i as f64 + 0.5) / 9.0, i as f64 * 2.399_963);
        let r = (1.0 - z * z).sqrt();
        Vec3::new(r * turn.cos(), r * turn.sin(), z)
    };
    (0..14).map(direction).collect()
}

fn asset(path: &Path, domain: Domain) -> Arc<Relighter> {
    let irradiance = vec![std::f32::consts::PI; directions().len()];
    let elements = domain.len();
    let contents = Contents {
        domain,
        irradiance,
        width: WIDTH,
        height: HEIGHT,
        colour_space: Default::default(),
        precision: Precision::Float,
        largest: 1.0,
        ambient: None,
        alpha: None,
        reliability: None,
        provenance: serde_json::Value::Null,
    };
    write(path, &contents, &mut Formula(elements)).unwrap();
    Arc::new(Relighter::new(Asset::open(path, Access::Read).unwrap()).unwrap())
}

/// A folder with an asset of a projector, one of lamps, and a picture.
struct Props {
    folder: tempfile::TempDir,
    near: Arc<Relighter>,
    far: Arc<Relighter>,
}

impl Props {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let places: Vec<Vec3> = directions().iter().map(|d| d * 4.0).collect();
        let gantry = Gantry::looking_at_origin(&places, SIDE, 0.6, Filter::Box).unwrap();
        let near = asset(&at("near.rfield"), Domain::Gantry(Arc::new(gantry)));
        let far = asset(&at("far.rfield"), Directions::new(directions()).unwrap().into());
        let props = Self { folder, near, far };
        props.picture(1.0);
        props
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn text(&self, name: &str) -> String {
        self.path(name).display().to_string()
    }

    /// Writes the slide.
    fn picture(&self, gain: f32) {
        let slide = Image::from_fn(9, 6, |x, y| [gain * x as f32 / 8.0, gain * y as f32 / 5.0, 0.3]);
        relume_core::image::write(&self.path("slide.exr"), &slide, EncodeOptions::default()).unwrap();
    }

    fn slide(&self) -> Arc<Image> {
        let picture = relume_core::image::read(&self.path("slide.exr"), Default::default()).unwrap();
        Slide::prepared(picture).unwrap()
    }
}

/// What the core makes of a light.
fn core(relighter: &Relighter, light: Light<'_>, look: &Look) -> TestImage {
    let weights = relighter.weights(light, look).unwrap();
    let element = relighter.render(&weights, look, Window::full(WIDTH, HEIGHT)).unwrap();
    assert!(element.data().iter().any(|v| *v > 1e-3 && *v < 0.9), "it lights");
    TestImage::from_rgba(WIDTH, HEIGHT, element.data().to_vec())
}

fn with_instance(work: impl FnOnce(&Instance)) {
    let host = Host::new(Options::default());
    let plugin = host.load(&relume_tests::bundle()).unwrap();
    work(&plugin.create(Context::Generator).unwrap());
}

fn check(instance: &Instance, expected: &TestImage, status: &str) {
    let off = instance.render(&RenderArgs::default()).unwrap().largest_difference(expected);
    assert!(off < 1e-5, "{status}: off by {off}");
    let tiled = instance.render_tiles(&RenderArgs::default(), 8).largest_difference(expected);
    assert!(tiled < 1e-5, "{status}, in tiles: off by {tiled}");
    assert!(instance.string("status").contains(status), "{}", instance.string("status"));
}

fn refused(instance: &Instance, words: &[&str]) {
    let rendered = instance.render(&RenderArgs::default());
    assert!(rendered.failed() && rendered.image.is_clear(), "{words:?}");
    let message = instance.persistent_message().unwrap().text;
    assert!(words.iter().all(|word| message.contains(word)), "{message}");
}

/// A beam whose every number is its own.
fn thrown(n: usize) -> Thrown {
    let k = n as f64;
    Thrown {
        position: [2.0 - 1.5 * k, 1.0 + 0.3 * k, 3.0],
        aim: [0.1 * k, -0.1, 0.2],
        angle_deg: 9.0 + k,
        edge_deg: 4.0,
        turn_deg: 0.0,
        colour: [1.0, 0.5, 0.2 * k],
        stops: 0.5 * k,
    }
}

fn set(instance: &Instance, name: &str, thrown: &Thrown) {
    for (n, axis) in ["X", "Y", "Z"].into_iter().enumerate() {
        instance.set_double(&format!("{name}{axis}"), thrown.position[n]);
        instance.set_double(&format!("{name}Aim{axis}"), thrown.aim[n]);
    }
    instance.set_double(&format!("{name}Stops"), thrown.stops);
}

#[test]
fn beams_and_a_slide_are_those_of_the_core() {
    let props = Props::new();
    with_instance(|instance| {
        instance.set_string("asset", &props.text("near.rfield"));
        instance.set_double("rotation", 20.0);
        instance.set_double("exposure", 1.0);
        let look = Look { heading_deg: 20.0, exposure_ev: 1.0, ..Look::default() };
        for n in [1, 3] {
            let (name, beam) = (format!("beam{n}"), thrown(n));
            instance.set_choice(&name, 1);
            set(instance, &name, &beam);
            instance.set_double(&format!("{name}Angle"), beam.angle_deg);
            instance.set_double(&format!("{name}Edge"), beam.edge_deg);
            instance.set_doubles(&format!("{name}Colour"), &beam.colour);
        }
        let mut sources = vec![thrown(1).beam("1").unwrap(), thrown(3).beam("3").unwrap()];
        let beams = LightField::new(sources.clone());
        check(
            instance,
            &core(&props.near, Light::Field(&beams), &look),
            "14 positions of 4 x 4 squares. Light: 2 beams.",
        );
        let slide = Thrown { angle_deg: 25.0, turn_deg: 30.0, colour: [1.0; 3], ..thrown(2) };
        instance.set_string("slide", &props.text("slide.exr"));
        set(instance, "slide", &slide);
        instance.set_double("slideView", slide.angle_deg);
        instance.set_double("slideTurn", slide.turn_deg);
        sources.push(slide.slide("s", props.slide()).unwrap());
        let all = LightField::new(sources);
        check(instance, &core(&props.near, Light::Field(&all), &look), "2 beams and the slide slide.exr");
        // A captured element goes before all of it.
        instance.set_int("lamp", 7);
        check(instance, &core(&props.near, Light::Lamp(7), &look), "lamp 7");
        instance.set_int("lamp", 0);
        for axis in ["X", "Y", "Z"] {
            instance.set_double(&format!("beam3{axis}"), 1.0);
            instance.set_double(&format!("beam3Aim{axis}"), 1.0);
        }
        refused(instance, &["beam 3", "two different points"]);
        assert!(instance.string("status").contains("beam 3"), "{}", instance.string("status"));
    });
}

#[test]
fn light_files_are_those_of_the_core_and_read_again_when_they_or_their_pictures_change() {
    let props = Props::new();
    let spot = "[[light]]\nkind = \"spot\"\nposition = [1, 2, 3]\nbeam = 12\nedge = 3\n";
    let slide = "[[light]]\nkind = \"slide\"\nposition = [-1, 1, 3]\nview = 20\nimage = \"slide.exr\"\n";
    fs::write(props.path("light.toml"), format!("{spot}{slide}")).unwrap();
    let look = Look::default();
    let expected = || {
        let file = light4d::load(&props.path("light.toml")).unwrap();
        core(&props.near, Light::Field(&file.light), &look)
    };
    with_instance(|instance| {
        instance.set_string("asset", &props.text("near.rfield"));
        instance.set_choice("light4d", 1);
        let preset = light4d::PRESETS[0].load().unwrap().light;
        check(instance, &core(&props.near, Light::Field(&preset), &look), light4d::PRESETS[0].label);
        instance.set_string("light4dFile", &props.text("light.toml"));
        let first = expected();
        check(instance, &first, "light.toml, 2 lights");
        // A float picture of the same size: only its time tells it from what it was.
        std::thread::sleep(std::time::Duration::from_millis(20));
        props.picture(2.0);
        let second = expected();
        assert!(first.largest_difference(&second) > 1e-3);
        check(instance, &second, "light.toml, 2 lights");
        fs::write(props.path("light.toml"), spot).unwrap();
        check(instance, &expected(), "light.toml");
        fs::write(props.path("light.toml"), spot.replace("beam", "baem")).unwrap();
        refused(instance, &["light.toml, line 4", "`beam`"]);
        instance.set_string("light4dFile", &props.text("absent.toml"));
        refused(instance, &["absent.toml"]);
    });
}

#[test]
fn an_asset_of_lamps_takes_near_light_flat_or_says_why_not() {
    let props = Props::new();
    with_instance(|instance| {
        instance.set_string("asset", &props.text("far.rfield"));
        instance.set_choice("light4d", 1);
        refused(instance, &["far.rfield", "differs from point to point"]);
        let status = instance.string("status");
        assert!(status.contains("14 lamps") && status.contains("set Near light in space to Flat"), "{status}");
        instance.set_choice("lightSpace", 1);
        let light = light4d::PRESETS[0].load().unwrap().light;
        check(instance, &core(&props.far, Light::Flat(&light), &Look::default()), "Three beams, flat.");
        instance.set_string("asset", &props.text("near.rfield"));
        check(instance, &core(&props.near, Light::Flat(&light), &Look::default()), "Three beams, flat.");
    });
}
