//! A projector's asset, relit: what it photographed comes back, far light is a stage's, parallax is right.

use std::f64::consts::PI;
use std::ops::Range;
use std::sync::OnceLock;

use relume_core::Result;
use relume_core::domain::{Domain, Gantry};
use relume_core::field::{Access, Asset, BLOCK_PIXELS, Bands, Contents, Layout, Precision, write};
use relume_core::illumination::light_field::{Blinds, Emitter, Far, Frame, Lookup, Point, Slats, Slide, Source, Spot};
use relume_core::illumination::lighting::Aim;
use relume_core::illumination::{Beam, EnvMap, Incident, LightField};
use relume_core::image::{ColourSpace, Image, Window};
use relume_core::math::Vec3;
use relume_core::reconstruct::{Method, Outside, Squares};
use relume_core::relight::{Light, Look, Relighter, Weights};
use relume_core::simulate::{self, Camera, Quality, Rows};

const SIZE: (usize, usize) = (48, 36);
const WHOLE: Window = Window { x0: 0, y0: 0, x1: SIZE.0, y1: SIZE.1 };

/// Light of a point: a picture in the directions of some camera-like frame.
#[derive(Debug)]
struct Thrown<'a> {
    place: Vec3,
    /// Radiant intensity towards a point.
    intensity: fn(&Gantry, &Vec3) -> f64,
    gantry: &'a Gantry,
}

impl Incident for Thrown<'_> {
    fn arriving(&self, at: &Vec3, each: &mut dyn FnMut(Vec3, [f64; 3])) {
        let to = self.place - at;
        let irradiance = (self.intensity)(self.gantry, at) / to.norm_squared();
        each(to.normalize(), [irradiance, 0.5 * irradiance, 0.0]);
    }

    fn radiance(&self, _: &Vec3, _: &Vec3) -> [f64; 3] {
        [0.0; 3]
    }

    fn has_radiance(&self) -> bool {
        false
    }

    fn parts(&self) -> Vec<(String, &dyn Incident)> {
        vec![("the lantern".to_owned(), self)]
    }
}

struct Columns(Vec<Image>);

impl Bands for Columns {
    fn fill(&mut self, by: usize, columns: Range<usize>, blocks: &mut [f32]) -> Result<()> {
        let layout = Layout { width: SIZE.0, height: SIZE.1, elements: self.0.len() };
        for (n, block) in blocks.chunks_exact_mut(layout.block_len()).enumerate() {
            for (at, value) in block.iter_mut().enumerate() {
                let (x, y) = ((columns.start + n / 3) * 16 + at % BLOCK_PIXELS % 16, by * 8 + at % BLOCK_PIXELS / 16);
                if x < SIZE.0 && y < SIZE.1 {
                    *value = self.0[at / BLOCK_PIXELS].pixel(x, y)[n % 3];
                }
            }
        }
        Ok(())
    }
}

fn virtual_gantry() -> simulate::Gantry {
    simulate::Gantry::demo(Camera::gantry(SIZE.0, SIZE.1), (4, 2), 8)
}

fn rows() -> &'static Rows {
    static ROWS: OnceLock<Rows> = OnceLock::new();
    ROWS.get_or_init(|| {
        let quality = Quality { samples: 4, bounces: 2, stride: 2, cone_density: 300.0, depth: 4, seed: 1 };
        virtual_gantry().trace(&quality, &mut |_, _| Ok(())).unwrap()
    })
}

fn relighter() -> &'static Relighter {
    static RELIGHTER: OnceLock<Relighter> = OnceLock::new();
    RELIGHTER.get_or_init(|| written(&virtual_gantry(), rows()))
}

/// Every column of `T`, packed.
fn written(gantry: &simulate::Gantry, rows: &Rows) -> Relighter {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("gantry.rfield");
    let gantry = gantry.domain().unwrap();
    {
        let columns: Vec<Image> = (0..gantry.len()).map(|n| rows.element(n).unwrap()).collect();
        let largest = columns.iter().flat_map(|image| image.data()).fold(0.0f32, |most, v| most.max(v.abs()));
        let contents = Contents {
            irradiance: vec![2.0; gantry.poses().len()],
            domain: Domain::from(gantry),
            width: SIZE.0,
            height: SIZE.1,
            colour_space: ColourSpace::default(),
            precision: Precision::Float,
            largest,
            ambient: None,
            alpha: None,
            reliability: None,
            provenance: serde_json::Value::Null,
        };
        write(&path, &contents, &mut Columns(columns)).unwrap();
        // Mapped: the folder may go.
        Relighter::new(Asset::open(&path, Access::Mapped).unwrap()).unwrap()
    }
}

fn lit(light: Light<'_>, look: &Look) -> Image {
    relit(relighter(), light, look)
}

fn relit(relighter: &Relighter, light: Light<'_>, look: &Look) -> Image {
    let weights = relighter.weights(light, look).unwrap();
    relighter.render(&weights, look, WHOLE).unwrap().into_rgb()
}

/// Relative L2 of the red channel.
fn off(found: &Image, truth: &Image) -> f64 {
    let all: Vec<usize> = (0..SIZE.0 * SIZE.1).collect();
    off_at(found, truth, &all)
}

/// The same over some pixels.
fn off_at(found: &Image, truth: &Image, pixels: &[usize]) -> f64 {
    let (mut difference, mut all) = (0.0, 0.0);
    for (a, b) in pixels.iter().map(|pixel| (found.data()[3 * pixel], truth.data()[3 * pixel])) {
        difference += f64::from(a - b).powi(2);
        all += f64::from(b).powi(2);
    }
    (difference / all).sqrt()
}

fn gantry() -> &'static Gantry {
    relighter().gantry().unwrap()
}

/// Even over squares, so that box filtering changes nothing.
fn by_squares(gantry: &Gantry, at: &Vec3) -> f64 {
    let Some([u, v]) = gantry.seen(3, at).filter(|s| s.iter().all(|s| (0.0..1.0).contains(s))) else { return 0.0 };
    1.0 + (u * 8.0).floor() * 0.3 + (v * 8.0).floor() * 0.1
}

#[test]
fn a_projector_in_its_own_place_is_given_back() {
    let thrown = Thrown { place: gantry().poses()[3].place, intensity: by_squares, gantry: gantry() };
    let weights = relighter().weights(Light::Field(&thrown), &Look::default()).unwrap();
    for (element, rgb) in weights.rgb.iter().enumerate() {
        let (position, row, column) = gantry().place(element);
        let expected = if position == 3 { 1.0 + 0.3 * column as f32 + 0.1 * row as f32 } else { 0.0 };
        assert!((rgb[0] - expected).abs() < 1e-4, "{element}: {} is not {expected}", rgb[0]);
    }
    let mut emitted = vec![[0.0f32; 3]; gantry().len()];
    emitted.iter_mut().zip(&weights.rgb).for_each(|(e, w)| *e = *w);
    let truth = rows().photograph(&emitted).unwrap();
    assert!(off(&lit(Light::Field(&thrown), &Look::default()), &truth) < 1e-3);
}

#[test]
fn one_square_is_photographed_again() {
    let element = gantry().element(2, 4, 3);
    let found = lit(Light::Lamp(element + 1), &Look::default());
    let mut truth = rows().element(element).unwrap();
    truth.data_mut().iter_mut().for_each(|v| *v *= 2.0);
    assert!(off(&found, &truth) < 1e-3);
    assert!(relighter().weights(Light::Lamp(513), &Look::default()).is_err());
}

/// From everywhere alike: each point of the focal plane gets the covered solid angle, times pi or so of falling light.
#[test]
fn even_light_gives_every_point_the_same() {
    let squares = Squares::new(gantry().clone().into(), Method::Linear, Outside::Drop).unwrap();
    let map = EnvMap::from_fn(64, 32, |_| [1.0; 3]);
    let weights = squares.project(&map);
    let solid_angle = gantry().directions().covered_solid_angle();
    // At the origin, from the middle of every picture.
    let middle = |p: usize| {
        let distance = gantry().poses()[p].place.norm_squared();
        [(3, 3), (3, 4), (4, 3), (4, 4)]
            .map(|(r, c)| f64::from(weights[gantry().element(p, r, c)][0]))
            .iter()
            .sum::<f64>()
            / 4.0
            / distance
    };
    let sum: f64 = (0..8).map(middle).sum();
    assert!((sum / solid_angle - 1.0).abs() < 0.02, "{sum} is not {solid_angle}");
}

/// A far beam is spread over the positions as over a stage's lamps, in the middle of the picture.
#[test]
fn far_light_is_a_stages() {
    let beam = Beam { direction: gantry().directions().lamps()[5], irradiance: [PI; 3] };
    let weights = relighter().weights(Light::Beams(&[beam]), &Look::default()).unwrap();
    let of_position = |p: usize| {
        let distance = gantry().poses()[p].place.norm_squared() as f32;
        let around = [(3, 3), (3, 4), (4, 3), (4, 4)].map(|(r, c)| weights.rgb[gantry().element(p, r, c)][0]);
        around.iter().sum::<f32>() / 4.0 / distance
    };
    for p in 0..8 {
        let expected = if p == 5 { PI as f32 } else { 0.0 };
        // Half a square away from the middle a ray comes from beside the position, and its neighbours have a share.
        assert!((of_position(p) - expected).abs() < 0.55, "{p}: {}", of_position(p));
    }
    // Flat light is the same as far light.
    let flat =
        Thrown { place: gantry().directions().lamps()[5] * 400.0, intensity: |_, _| PI * 160_000.0, gantry: gantry() };
    let [far, near] = [Light::Flat(&flat), Light::Field(&flat)].map(|light| lit(light, &Look::default()));
    let truth = lit(Light::Beams(&[beam]), &Look::default());
    assert!(off(&far, &truth) < 1e-5 && off(&near, &truth) < 0.02, "{} {}", off(&far, &truth), off(&near, &truth));
}

#[test]
fn light_behind_is_refused_or_given_to_the_nearest() {
    let behind = Thrown { place: Vec3::new(0.0, -5.0, -1.0), intensity: |_, _| 1.0, gantry: gantry() };
    let message = relighter().weights(Light::Field(&behind), &Look::default()).unwrap_err().to_string();
    assert!(message.contains("the lantern") && message.contains("nearest"), "{message}");
    let look = Look { outside: Outside::Nearest, ..Look::default() };
    let weights = relighter().weights(Light::Field(&behind), &look).unwrap();
    assert!(weights.rgb.iter().any(|rgb| rgb[0] > 0.0));
}

#[test]
fn turning_the_light_turns_it() {
    let lamps = gantry().directions().lamps();
    let thrown = Thrown { place: lamps[0] * 4.0, intensity: |_, _| 1.0, gantry: gantry() };
    let look = Look { heading_deg: 90.0, outside: Outside::Nearest, ..Look::default() };
    let turned = Thrown { place: look.orientation().matrix() * thrown.place, ..thrown };
    let neutral = Look { outside: Outside::Nearest, ..Look::default() };
    let [a, b] = [(&thrown, &look), (&turned, &neutral)].map(|(light, look)| lit(Light::Field(light), look));
    assert!(off(&a, &b) < 1e-5);
}

/// A denser gantry for comparisons with the scene lit directly, and the pixels of surfaces that no ray is mirrored by.
struct Dense {
    gantry: simulate::Gantry,
    relighter: Relighter,
    rough: Vec<usize>,
}

fn dense() -> &'static Dense {
    static DENSE: OnceLock<Dense> = OnceLock::new();
    DENSE.get_or_init(|| {
        let mut gantry = simulate::Gantry::demo(Camera::gantry(SIZE.0, SIZE.1), (8, 3), 12);
        // What a mirror ball throws on the table is right in the mean, but noise at so few rays.
        gantry.scene.objects[1].material = simulate::Material::Diffuse { albedo: [0.5; 3] };
        let quality = Quality { samples: 64, bounces: 4, stride: 2, cone_density: 300.0, depth: 4, seed: 1 };
        let rows = gantry.trace(&quality, &mut |_, _| Ok(())).unwrap();
        let rough = simulate::classes(&gantry.scene, &gantry.camera);
        let rough = rough.pixels(&[simulate::Class::Diffuse, simulate::Class::Glossy, simulate::Class::Mixed]);
        Dense { relighter: written(&gantry, &rows), gantry, rough }
    })
}

impl Dense {
    fn domain(&self) -> &Gantry {
        self.relighter.gantry().unwrap()
    }

    /// The scene lit directly.
    fn truth(&self, light: &dyn Incident) -> Image {
        let quality = Quality { samples: 64, bounces: 4, stride: 1, cone_density: 300.0, depth: 4, seed: 9 };
        simulate::lit(&self.gantry.scene, &self.gantry.camera, light, &quality, &mut |_, _| Ok(())).unwrap()
    }

    /// The light that the squares throw under these weights: a slide of even squares a position.
    fn thrown(&self, weights: &Weights) -> LightField {
        let side = self.domain().side();
        let slide = |position: usize| {
            let of_position = &weights.rgb[position * side * side..][..side * side];
            let pose = self.domain().poses()[position];
            // Slides count from a white diffuser at their aim.
            let white = (PI * pose.place.norm_squared()) as f32;
            let picture = Image::from_fn(side, side, |x, y| of_position[y * side + x].map(|w| w / white));
            let frame = Frame::new(pose.place, Vec3::zeros(), Vec3::y()).unwrap();
            let slide = Slide::new(frame, self.domain().view_rad(), picture, Lookup::Squares).unwrap();
            Source::new("position", Emitter::Slide(slide))
        };
        let lit =
            |position: &usize| weights.rgb[position * side * side..][..side * side].iter().any(|w| *w != [0.0; 3]);
        LightField::new((0..self.domain().poses().len()).filter(lit).map(slide).collect())
    }

    /// The relit picture against the same squares thrown directly, and against the light itself.
    fn errors(&self, light: &LightField) -> [f64; 2] {
        let look = Look::default();
        let weights = self.relighter.weights(Light::Field(light), &look).unwrap();
        let found = self.relighter.render(&weights, &look, WHOLE).unwrap().into_rgb();
        [&self.thrown(&weights), light].map(|truth| off_at(&found, &self.truth(truth), &self.rough))
    }
}

fn at(place: Vec3, aim: Vec3) -> Frame {
    Frame::new(place, aim, Vec3::y()).unwrap()
}

/// Figures 7.1 and 7.8: what the squares can show is shown; how far that is from the light itself is the rig's resolution.
#[test]
fn spots_slides_and_blinds_are_what_the_same_squares_throw() {
    let dense = dense();
    let place = dense.domain().poses()[7].place;
    let spot = Spot::new(at(place, Vec3::new(0.1, -0.2, 0.1)), 8f64.to_radians(), 2f64.to_radians());
    let check = |x: usize, y: usize| if (x / 4 + y / 4).is_multiple_of(2) { [1.0, 0.6, 0.2] } else { [0.2, 0.3, 0.9] };
    let slide = Slide::new(at(place, Vec3::zeros()), 0.4, Image::from_fn(16, 16, check), Lookup::Smooth).unwrap();
    let aim = Aim { azimuth_rad: 0.7, elevation_rad: 0.8 };
    let window = Blinds::new(at(aim.direction() * 3.0, Vec3::zeros()), 4.0, 4.0, Some(Slats::strips(0.8, 0.5, 0.0)));
    let sun = Emitter::Far(Far::sun(&aim, 0.53f64.to_radians(), true));
    let lights = [
        ("spot", Source::new("spot", Emitter::Spot(spot))),
        ("slide", Source::new("slide", Emitter::Slide(slide))),
        ("blinds", Source::new("sun", sun).behind(window)),
    ];
    for (name, source) in lights {
        let [squares, light] = dense.errors(&LightField::new(vec![source]));
        assert!(squares < 0.05, "{name}: {squares}");
        assert!(light < 0.6, "{name}: {light}");
    }
}

/// Figure 7.7: lamps that come nearer, or that the object is moved towards.
#[test]
fn near_light_changes_the_picture_as_it_does_in_truth() {
    let dense = dense();
    let lamp = |place: Vec3| Source::new("lamp", Emitter::Point(Point::new(place, Vec3::zeros()).unwrap()));
    let directions = dense.domain().directions();
    let stood = |x: f64, y: f64, z: f64| directions.lamps()[directions.nearest(&Vec3::new(x, y, z).normalize())];
    let (left, right) = (stood(-0.6, 0.6, 0.5), stood(0.6, 0.5, 0.6));
    let far = LightField::new(vec![lamp(left * 8.0), lamp(right * 8.0)]);
    let near = LightField::new(vec![lamp(left * 2.2), lamp(right * 8.0)]);
    let pictures = [&far, &near].map(|light| relit(&dense.relighter, Light::Field(light), &Look::default()));
    let truths = [&far, &near].map(|light| dense.truth(light));
    let off = |a: &Image, b: &Image| off_at(a, b, &dense.rough);
    let moved = off(&truths[0], &truths[1]);
    let own = [off(&pictures[0], &truths[0]), off(&pictures[1], &truths[1])];
    let flat = off(&relit(&dense.relighter, Light::Flat(&near), &Look::default()), &truths[1]);
    assert!(moved > 0.08, "{moved}");
    // The change itself: what is brighter in truth is brighter here.
    let change = |pair: &[Image; 2]| -> Vec<f64> {
        dense.rough.iter().map(|p| f64::from(pair[1].data()[3 * p] - pair[0].data()[3 * p])).collect()
    };
    let (found, truth) = (change(&pictures), change(&truths));
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let alike = dot(&found, &truth) / (dot(&found, &found) * dot(&truth, &truth)).sqrt();
    assert!(alike > 0.8 && own.iter().all(|own| *own < 0.12), "{alike}, {own:?}");
    assert!(own[1] < 0.6 * flat, "{own:?}, {flat}");
}

/// A gantry's asset is no worse than a stage's with lamps in the same directions.
#[test]
fn far_light_agrees_with_a_stages_asset() {
    let dense = dense();
    let lamps = dense.domain().directions().lamps().to_vec();
    let directions = std::sync::Arc::new(relume_core::domain::Directions::new(lamps).unwrap());
    let quality = Quality { samples: 64, bounces: 4, stride: 2, cone_density: 300.0, depth: 4, seed: 3 };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("stage.rfield");
    let stage = simulate::Stage::new(&dense.gantry.scene, dense.gantry.camera, &directions, quality);
    let contents = Contents {
        domain: directions.clone().into(),
        irradiance: vec![PI as f32; directions.len()],
        width: SIZE.0,
        height: SIZE.1,
        colour_space: ColourSpace::default(),
        precision: Precision::Float,
        largest: 100.0,
        ambient: None,
        alpha: None,
        reliability: None,
        provenance: serde_json::Value::Null,
    };
    write(&path, &contents, &mut stage.bands(&mut |_, _| Ok(()))).unwrap();
    let stage = Relighter::new(Asset::open(&path, Access::Mapped).unwrap()).unwrap();
    let sky = simulate::lights::sky((128, 64));
    let above = directions.nearest(&Vec3::new(0.5, 0.7, 0.5).normalize());
    let beam = Beam { direction: directions.lamps()[above], irradiance: [PI; 3] };
    for (name, light) in [("sky", Light::Map(&sky)), ("lamp", Light::Beams(std::slice::from_ref(&beam)))] {
        let pictures = [&dense.relighter, &stage].map(|relighter| relit(relighter, light, &Look::default()));
        let truth = match light {
            Light::Map(map) => dense.truth(map),
            _ => dense.truth(&relume_core::illumination::Distant(vec![beam])),
        };
        let [gantry, stage] = [0, 1].map(|n| off_at(&pictures[n], &truth, &dense.rough));
        let both = off_at(&pictures[0], &pictures[1], &dense.rough);
        // A map is filled in between lamps and positions alike, and positions see the parallax. A captured lamp is the stage's best case, while
        // the gantry's rays come past the middle of the object from between positions.
        assert!(
            if name == "sky" { gantry < stage } else { gantry < 0.2 } && both < 0.2,
            "{name}: {gantry}, {stage}, {both}"
        );
    }
}
