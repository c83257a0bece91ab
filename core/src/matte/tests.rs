use std::ops::Range;
use std::path::Path;

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use super::*;
use crate::domain::{Domain, Plane};
use crate::field::{
    Access, Asset, BLOCK_HEIGHT, BLOCK_PIXELS, BLOCK_WIDTH, Bands, BlockTerms, Contents, Kind, Precision, TermBands,
    TermBasis, write, write_explicit, write_terms,
};
use crate::image::{ColourSpace, Image, Window};
use crate::relight::{Look, ScreenRelighter};
use crate::wavelet::Wavelet;

const SIZE: (usize, usize) = (21, 13);
const TEXELS: (usize, usize) = (8, 4);

/// T of each pixel, `[pixel][texel][channel]`, in some basis.
struct Pixels {
    functions: Vec<Vec<[f32; 3]>>,
}

impl Pixels {
    fn random() -> Self {
        let mut random = Pcg64Mcg::seed_from_u64(5);
        let texel = |_| [0; 3].map(|_| random.random::<f32>());
        let mut all = (0..SIZE.0 * SIZE.1 * TEXELS.0 * TEXELS.1).map(texel);
        let pixel = |_| all.by_ref().take(TEXELS.0 * TEXELS.1).collect();
        Self { functions: (0..SIZE.0 * SIZE.1).map(pixel).collect() }
    }

    fn turned(&self, turn: impl Fn(&mut [f32])) -> Self {
        let turn = |function: &Vec<[f32; 3]>| {
            let mut function = function.clone();
            turn(function.as_flattened_mut());
            function
        };
        Self { functions: self.functions.iter().map(turn).collect() }
    }
}

fn pixel_of(bx: usize, by: usize, k: usize) -> Option<usize> {
    let (x, y) = (bx * BLOCK_WIDTH + k % BLOCK_WIDTH, by * BLOCK_HEIGHT + k / BLOCK_WIDTH);
    (x < SIZE.0 && y < SIZE.1).then_some(y * SIZE.0 + x)
}

impl Bands for Pixels {
    fn fill(&mut self, by: usize, columns: Range<usize>, blocks: &mut [f32]) -> crate::Result<()> {
        let elements = self.functions[0].len();
        for (n, block) in blocks.chunks_exact_mut(elements * BLOCK_PIXELS).enumerate() {
            let (bx, c) = (columns.start + n / 3, n % 3);
            for (at, value) in block.iter_mut().enumerate() {
                if let Some(pixel) = pixel_of(bx, by, at % BLOCK_PIXELS) {
                    *value = self.functions[pixel][at / BLOCK_PIXELS][c];
                }
            }
        }
        Ok(())
    }
}

impl TermBands for Pixels {
    fn fill(&mut self, bx: usize, by: usize, block: &mut BlockTerms) -> crate::Result<()> {
        for k in 0..BLOCK_PIXELS {
            let Some(pixel) = pixel_of(bx, by, k) else { continue };
            for (location, rgb) in self.functions[pixel].iter().enumerate().filter(|(_, rgb)| **rgb != [0.0; 3]) {
                block.counts[k] += 1;
                block.locations.push(location as u32);
                block.coefficients.push(*rgb);
            }
        }
        Ok(())
    }
}

fn contents(alpha: Option<Vec<f32>>) -> Contents {
    let plane = Plane::new(TEXELS.0, TEXELS.1).unwrap();
    Contents {
        domain: Domain::Plane(plane, None),
        irradiance: Vec::new(),
        width: SIZE.0,
        height: SIZE.1,
        colour_space: ColourSpace::default(),
        precision: Precision::Half,
        largest: 40.0,
        ambient: Some(Image::from_fn(SIZE.0, SIZE.1, |x, y| [x as f32, y as f32, 1.0])),
        alpha,
        reliability: None,
        provenance: serde_json::json!({}),
    }
}

fn open(path: &Path) -> ScreenRelighter {
    ScreenRelighter::new(Asset::open(path, Access::Read).unwrap()).unwrap()
}

fn random_light() -> Vec<[f32; 3]> {
    let mut random = Pcg64Mcg::seed_from_u64(6);
    (0..TEXELS.0 * TEXELS.1).map(|_| [0; 3].map(|_| random.random::<f32>())).collect()
}

/// Samples, wavelet terms, texel terms and explicit wavelets of one field show the same picture, the sum itself.
#[test]
fn all_representations_of_a_screen_agree() {
    let folder = tempfile::tempdir().unwrap();
    let (field, light) = (Pixels::random(), random_light());
    let expected = |pixel: usize, c: usize| -> f32 {
        0.5 * light.iter().zip(&field.functions[pixel]).map(|(l, t)| l[c] * t[c]).sum::<f32>()
    };
    let plane = Plane::new(TEXELS.0, TEXELS.1).unwrap();
    let locations: Vec<u32> = (0..plane.len() as u32).collect();
    for wavelet in [Wavelet::Haar, Wavelet::LeGall53, Wavelet::Daubechies97] {
        let transform = plane.transform(wavelet).unwrap();
        let path = |name: &str| folder.path().join(name);
        let same = |_: &mut [f32]| {};
        write(&path("dense"), &contents(None), &mut field.turned(same)).unwrap();
        let explicit = &mut field.turned(|t| transform.inverse_adjoint(t, 3));
        write_explicit(&path("explicit"), &contents(None), (wavelet, &locations), explicit).unwrap();
        let terms = &mut field.turned(|t| transform.forward(t, 3));
        write_terms(&path("terms"), &contents(None), (TermBasis::Wavelet(wavelet), Some(32)), terms).unwrap();
        write_terms(&path("texels"), &contents(None), (TermBasis::Texels, None), &mut field.turned(same)).unwrap();
        for (name, kind) in
            [("dense", Kind::Dense), ("explicit", Kind::Explicit), ("terms", Kind::Wavelet), ("texels", Kind::Wavelet)]
        {
            let relighter = open(&path(name));
            assert_eq!(relighter.choose(None).unwrap(), kind);
            relighter.asset().verify(&mut |_, _| Ok(())).unwrap();
            let look = Look { exposure_ev: -1.0, ..Look::default() };
            let weights = relighter.weights(&light, &look).unwrap();
            let lit = relighter.render(&weights, &look, Window::full(SIZE.0, SIZE.1)).unwrap();
            for (pixel, rgba) in lit.data().chunks_exact(4).enumerate() {
                for (c, &found) in rgba.iter().enumerate().take(3) {
                    let expected = expected(pixel, c);
                    assert!((found - expected).abs() < 0.004 * expected, "{name} {wavelet:?}: {found} {expected}");
                }
                assert_eq!(rgba[3], 1.0);
            }
        }
    }
}

#[test]
fn screens_and_lamps_are_not_mixed_up() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.rfield");
    write(&path, &contents(None), &mut Pixels::random()).unwrap();
    let message = crate::relight::Relighter::new(Asset::open(&path, Access::Read).unwrap()).unwrap_err().to_string();
    assert!(message.contains("a.rfield") && message.contains("relume matte"), "{message}");
    let relighter = open(&path);
    let short = relighter.weights(&[[0.0; 3]; 3], &Look::default()).unwrap_err().to_string();
    assert!(short.contains("3 texels") && short.contains("8 x 4"), "{short}");
    let beyond = (TermBasis::Texels, None);
    let mut wrong = Pixels { functions: vec![vec![[1.0; 3]; 33]; SIZE.0 * SIZE.1] };
    let message = write_terms(&path, &contents(None), beyond, &mut wrong).unwrap_err().to_string();
    assert!(message.contains("location 32"), "{message}");
    // What no reader would open is not written.
    let vast = Contents { domain: Domain::Plane(Plane::new(2048, 1024).unwrap(), None), ..contents(None) };
    let message = write_terms(&path, &vast, beyond, &mut Pixels::random()).unwrap_err().to_string();
    assert!(message.contains("2048 x 1024 texels") && message.contains("larger texels"), "{message}");
    assert_eq!(open(&path).plane().size(), TEXELS, "the field that was there stays");
}

#[test]
fn places_turn_counter_clockwise_about_the_middle() {
    let place = Place { shift: [10.0, -5.0], scale: 2.0, rotate_deg: 90.0 };
    let mapping = place.between((20, 10), (100, 60));
    // The middle of the right edge goes up.
    assert_eq!(mapping.plate([20.0, 5.0]), [60.0, 25.0 - 20.0]);
    let mut random = Pcg64Mcg::seed_from_u64(1);
    for _ in 0..50 {
        let place = Place {
            shift: [random.random_range(-50.0..50.0), random.random_range(-50.0..50.0)],
            scale: random.random_range(0.1..8.0),
            rotate_deg: random.random_range(-400.0..400.0),
        };
        let mapping = place.between((31, 17), (640, 480));
        let at = [random.random_range(0.0..31.0), random.random_range(0.0..17.0)];
        let back = mapping.object(mapping.plate(at));
        assert!((0..2).all(|i| (back[i] - at[i]).abs() < 1e-9));
    }
    for (bad, words) in [
        (Place { scale: 0.0, ..Place::default() }, "scale of 0"),
        (Place { scale: f64::NAN, ..Place::default() }, "scale"),
        (Place { rotate_deg: f64::INFINITY, ..Place::default() }, "rotation"),
        (Place { shift: [f64::NAN, 0.0], ..Place::default() }, "shift"),
    ] {
        assert!(bad.check().unwrap_err().to_string().contains(words));
    }
}

#[test]
fn a_screen_that_fills_the_picture_shows_the_means_of_the_plate() {
    let plane = Plane::new(8, 4).unwrap();
    // Linear in x and y: the mean over a texel is the value at its centre, whatever the reduction.
    let plate = Image::from_fn(640, 320, |x, y| [x as f32 + 0.5, y as f32 + 0.5, 7.0]);
    let backdrop =
        Backdrop::new((plane, None), (64, 32), &Place { scale: 10.0, ..Place::default() }, (640, 320)).unwrap();
    for (at, rgb) in backdrop.light(&plate, Beyond::Stretch).iter().enumerate() {
        let [u, v] = plane.centre(at);
        let expected = [80.0 * u as f32, 80.0 * v as f32, 7.0];
        assert!((0..3).all(|c| (rgb[c] - expected[c]).abs() < 0.3), "{at}: {rgb:?} {expected:?}");
    }
}

#[test]
fn what_the_plate_does_not_reach_comes_from_elsewhere() {
    let plane = Plane::new(8, 8).unwrap();
    let plate = Image::from_fn(8, 8, |x, _| [if x < 4 { 1.0 } else { 2.0 }, 0.0, 0.0]);
    // The object's picture is twice as large as the plate, and its screen with it.
    let backdrop = Backdrop::new((plane, None), (16, 16), &Place::default(), (8, 8)).unwrap();
    let red = |beyond| -> Vec<f32> { backdrop.light(&plate, beyond).iter().map(|rgb| rgb[0]).collect() };
    let stretched = red(Beyond::Stretch);
    assert_eq!((stretched[0], stretched[7], stretched[24], stretched[31]), (1.0, 2.0, 1.0, 2.0));
    let coloured = red(Beyond::Colour([9.0, 0.0, 0.0]));
    assert_eq!((coloured[0], coloured[3 * 8 + 2], coloured[63]), (9.0, 1.0, 9.0));
    // Red grows upwards: what lies above the plate is brighter than what lies below.
    let map = crate::illumination::EnvMap::from_fn(64, 32, |d| [5.0 + d.y as f32, 0.0, 0.0]);
    let mapped = red(Beyond::Map(&map, 40.0));
    assert!(mapped[3] > 5.05 && mapped[59] < 4.95 && mapped[3 * 8 + 3] == 1.0, "{mapped:?}");
}

#[test]
fn composites_are_exact_where_nothing_moves_and_windows_are_parts_of_the_whole() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.rfield");
    let alpha: Vec<f32> = (0..SIZE.0 * SIZE.1).map(|n| (n % SIZE.0) as f32 / 20.0).collect();
    write(&path, &contents(Some(alpha)), &mut Pixels::random()).unwrap();
    let (relighter, look) = (open(&path), Look { ambient: 0.5, ..Look::default() });
    let weights = relighter.weights(&random_light(), &look).unwrap();
    let whole = relighter.render(&weights, &look, Window::full(SIZE.0, SIZE.1)).unwrap();
    let composite = Composite::new(SIZE, &Place::default(), SIZE).unwrap();
    let full = Window::full(SIZE.0, SIZE.1);
    assert_eq!(composite.element(&relighter, (&weights, &look), full).unwrap().data(), whole.data());
    let plate = Image::from_fn(SIZE.0, SIZE.1, |x, y| [x as f32, y as f32, 3.0]);
    let over = Composite::over(&whole, &plate);
    assert_eq!(&over.pixel(0, 4)[..3], [whole.pixel(0, 4)[0], whole.pixel(0, 4)[1] + 4.0, whole.pixel(0, 4)[2] + 3.0]);
    assert_eq!(over.pixel(20, 4)[..3], whole.pixel(20, 4)[..3]);
    assert!(over.data().chunks_exact(4).all(|pixel| (pixel[3] - 1.0).abs() < 1e-6));
    let place = Place { shift: [3.3, -2.1], scale: 0.7, rotate_deg: 33.0 };
    let composite = Composite::new(SIZE, &place, (40, 30)).unwrap();
    let full = composite.element(&relighter, (&weights, &look), Window::full(40, 30)).unwrap();
    let window = Window { x0: 11, y0: 7, x1: 30, y1: 22 };
    let part = composite.element(&relighter, (&weights, &look), window).unwrap();
    for y in 0..window.height() {
        for x in 0..window.width() {
            let (found, expected) = (part.pixel(x, y), full.pixel(window.x0 + x, window.y0 + y));
            assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-4 * (1.0 + b.abs())), "{x} {y}");
        }
    }
    let energy = |image: &Image| image.data().chunks_exact(4).map(|pixel| f64::from(pixel[1])).sum::<f64>();
    assert!((energy(&full) / energy(&whole) / 0.49 - 1.0).abs() < 0.02);
    let far = Composite::new(SIZE, &Place { shift: [500.0, 0.0], ..Place::default() }, (40, 30)).unwrap();
    let nothing = far.element(&relighter, (&weights, &look), Window::full(40, 30)).unwrap();
    assert!(nothing.data().iter().all(|v| *v == 0.0));
}
