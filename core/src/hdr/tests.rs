//! Brackets of a simulated camera: known light, response, noise and clipping.

use std::sync::Arc;

use rand::SeedableRng;
use rand_pcg::Pcg32;

use super::testing::{self, NOISE, film, inverse_film, normal, poisson};
use super::*;
use crate::image::{Image, SampleType, srgb};

/// A camera: light at white 1 -> code 0..1, rounded to `codes`.
struct Camera {
    forward: fn(f64) -> f64,
    inverse: fn(f64) -> f64,
    codes: f64,
    noise: Noise,
}

fn srgb_code(x: f64) -> f64 {
    f64::from(srgb::encode(x as f32))
}

fn srgb_light(code: f64) -> f64 {
    f64::from(srgb::decode(code as f32))
}

const FILM: Camera = Camera { forward: film, inverse: inverse_film, codes: 255.0, noise: NOISE };
const SRGB: Camera = Camera { forward: srgb_code, inverse: srgb_light, codes: 255.0, noise: NOISE };
const RAW12: Camera = Camera { forward: |x| x, inverse: |x| x, codes: 4095.0, noise: NOISE };
const LINEAR16: Camera = Camera { codes: 65_535.0, ..RAW12 };

impl Camera {
    /// The curve and type of sample to tell the merge.
    fn curve(&self) -> (Curve, SampleType) {
        if self.codes > 255.0 {
            return (Curve::Linear, SampleType::U16);
        }
        // As it is, scaled to its own white, not to the anchor of a `Response`.
        (Curve::Response(self.response()), SampleType::U8)
    }

    fn response(&self) -> Response {
        let table = std::array::from_fn(|z| (self.inverse)(z as f64 / 255.0));
        Response::new("camera", [table; 3]).unwrap()
    }

    /// What the scale of a response makes of light at white 1.
    fn scale(&self) -> f64 {
        if self.codes > 255.0 { 1.0 } else { self.response().channel(0)[ANCHOR] / (self.inverse)(128.0 / 255.0) }
    }

    fn photograph(&self, truth: &Image, s: f64, rng: &mut Pcg32) -> Image {
        let mut image = truth.clone();
        for v in image.data_mut() {
            let full = self.noise.full_well_e;
            let electrons = poisson((f64::from(*v) * s * full).min(20.0 * full), rng) + self.noise.read_e * normal(rng);
            let code = (self.forward)((electrons / full).clamp(0.0, 1.0));
            *v = ((code * self.codes).round() / self.codes) as f32;
        }
        image
    }

    fn bracket(&self, truth: &Image, exposures: &[f64], seed: u64) -> Vec<Arc<Image>> {
        let mut rng = Pcg32::seed_from_u64(seed);
        exposures.iter().map(|s| Arc::new(self.photograph(truth, *s, &mut rng))).collect()
    }

    fn options(&self) -> Options {
        let (curve, sample_type) = self.curve();
        Options { clip: [1.0; 3], noise: self.noise, ..Options::new(curve, sample_type) }
    }
}

fn shots(exposures: &[f64]) -> Vec<Shot> {
    exposures.iter().map(|s| Shot { exposure: *s, iso: 100.0, offset: [0, 0] }).collect()
}

fn merged(frames: &[Arc<Image>], exposures: &[f64], options: &Options) -> Merged {
    merge(&shots(exposures), options, &mut |i| Ok(frames[i].clone())).unwrap()
}

/// Columns of light from `low` to `high`, evenly in stops; rows and channels alike.
fn ramp(w: usize, h: usize, low: f64, high: f64) -> Image {
    let light = |x: usize| (low * (high / low).powf(x as f64 / (w - 1) as f64)) as f32;
    Image::from_fn(w, h, |x, _| [light(x); 3])
}

const TWO_STOPS: [f64; 5] = [1.0 / 16.0, 0.25, 1.0, 4.0, 16.0];

/// Median of |log2(merged / truth)| over all samples.
fn median_ev(found: &Image, truth: &Image, scale: f64) -> f64 {
    let ev = |(a, b): (&f32, &f32)| (f64::from(*a) / (f64::from(*b) * scale)).log2().abs();
    let mut errors: Vec<f64> = found.data().iter().zip(truth.data()).map(ev).collect();
    errors.sort_by(f64::total_cmp);
    errors[errors.len() / 2]
}

#[test]
fn a_known_camera_is_undone_to_a_fiftieth_of_a_stop() {
    let truth = ramp(200, 20, 2e-3, 12.0);
    for (name, camera) in [("film", FILM), ("srgb", SRGB), ("12 bits", RAW12), ("16 bits", LINEAR16)] {
        let result = merged(&camera.bracket(&truth, &TWO_STOPS, 1), &TWO_STOPS, &camera.options());
        let error = median_ev(&result.image, &truth, camera.scale());
        assert!(error < 0.02, "{name}: {error} EV");
        // No bias: the mean over the whole range is closer still.
        let ratio = |(a, b): (&f32, &f32)| f64::from(*a) / (f64::from(*b) * camera.scale());
        let ratios = result.image.data().iter().zip(truth.data()).map(ratio);
        let mean = ratios.sum::<f64>() / truth.data().len() as f64;
        assert!((mean - 1.0).abs() < 0.005, "{name}: {mean}");
        assert_eq!(result.report.clipped_everywhere.any, 0.0, "{name}");
        for (n, photograph) in result.report.photographs.iter().enumerate() {
            let (sum, deviation) = (photograph.used + photograph.clipped + photograph.dark, photograph.deviation_ev);
            assert!((sum - 1.0).abs() < 1e-9, "{name} {n}: {photograph:?}");
            assert!(deviation.is_some_and(|ev| ev.abs() < 0.03), "{name} {n}: {photograph:?}");
        }
    }
}

#[test]
fn an_unknown_response_is_recovered_and_the_light_with_it() {
    let truth = ramp(200, 120, 2e-3, 12.0);
    for (name, camera) in [("film", FILM), ("srgb", SRGB)] {
        let frames = camera.bracket(&truth, &TWO_STOPS, 2);
        let mut survey = Survey::new(200, 120, SampleType::U8);
        frames.iter().for_each(|frame| survey.add(frame, [0, 0]));
        let clip = survey.clip().map(|c| c.unwrap_or(f32::INFINITY));
        assert_eq!(clip, [1.0; 3], "{name}");
        let recovered = recover(&survey.samples(), &TWO_STOPS, clip, LAMBDA).unwrap();
        for c in 0..3 {
            assert!(recovered.response.channel(c).windows(2).all(|w| w[1] > w[0]), "{name}: channel {c} does not rise");
        }
        let options = Options { curve: Curve::Response(recovered.response), clip, ..camera.options() };
        let error = median_ev(&merged(&frames, &TWO_STOPS, &options).image, &truth, camera.scale());
        assert!(error < 0.02, "{name}: {error} EV");
    }
}

/// Relative standard deviations over 900 realisations of each of 64 lights: the merge against the best photograph alone,
/// and against the bound of the best combination, `1 / sqrt(sum s^2 / var(x))`.
#[test]
fn a_merge_is_as_quiet_as_it_can_be() {
    let (w, h) = (64, 300);
    let truth = ramp(w, h, 1e-3, 14.0);
    for (name, camera) in [("film", FILM), ("srgb", SRGB), ("12 bits", RAW12), ("16 bits", LINEAR16)] {
        let frames = camera.bracket(&truth, &TWO_STOPS, 3);
        let result = merged(&frames, &TWO_STOPS, &camera.options());
        let (curve, sample_type) = camera.curve();
        let decoder = super::curve::Decoder::new(&curve, sample_type, [0.0; 3]).unwrap();
        let (mut worst, mut ratios) = (0.0f64, Vec::new());
        for x in 0..w {
            let light = f64::from(truth.pixel(x, 0)[0]) * camera.scale();
            let values = |image: &Image, f: &dyn Fn(usize, f32) -> f64| -> Vec<f64> {
                (0..h)
                    .flat_map(|y| image.pixel(x, y).iter().enumerate().map(|(c, v)| f(c, *v)).collect::<Vec<_>>())
                    .collect()
            };
            let (mut best, mut bound) = (f64::INFINITY, 0.0);
            for (frame, s) in frames.iter().zip(TWO_STOPS) {
                let codes = values(frame, &|_, v| f64::from(v));
                // Cut-off noise is no measure: a photograph that is black or clipped always looks quiet.
                if codes.iter().any(|v| *v <= 0.0 || *v >= 1.0) {
                    continue;
                }
                let single = deviation(&values(frame, &|c, v| f64::from(decoder.light(c, v).0) / s)) / light;
                best = best.min(single);
                bound += single.powi(-2);
            }
            if best.is_finite() {
                let noise = deviation(&values(&result.image, &|_, v| f64::from(v))) / light;
                worst = worst.max(noise / best);
                ratios.push(noise * f64::sqrt(bound));
            }
        }
        ratios.sort_by(f64::total_cmp);
        assert!(ratios.len() > 55, "{name}: only {} lights compared", ratios.len());
        assert!(worst < 1.1, "{name}: {worst} of the best photograph's noise");
        assert!(ratios[ratios.len() / 2] < 1.05, "{name}: {} of the bound", ratios[ratios.len() / 2]);
    }
}

fn deviation(values: &[f64]) -> f64 {
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (values.len() - 1) as f64).sqrt()
}

fn constant(values: &[[f32; 3]]) -> Arc<Image> {
    Arc::new(Image::from_data(values.len(), 1, 3, values.concat()).unwrap())
}

fn linear(clip: f32) -> Options {
    Options { clip: [clip; 3], ..Options::new(Curve::Linear, SampleType::Float) }
}

#[test]
fn what_no_photograph_shows_is_taken_from_the_nearest_and_counted() {
    // Pixels: clipped in both, dark in both, dark in the short and clipped in the long one, well seen in both.
    let short = constant(&[[1.0; 3], [1e-5; 3], [1e-4, 0.5, 0.5], [0.1; 3]]);
    let long = constant(&[[1.0; 3], [2e-4; 3], [1.0; 3], [0.4; 3]]);
    // The longest first: the order does not matter.
    let result = merged(&[long, short], &[4.0, 1.0], &linear(1.0));
    let red: Vec<f32> = (0..4).map(|x| result.image.pixel(x, 0)[0]).collect();
    assert_eq!(red[0], 1.0, "clipped in both: the shortest");
    assert!((red[1] / 5e-5 - 1.0).abs() < 0.01, "dark in both: the longest, {red:?}");
    assert!((red[2] / 1e-4 - 1.0).abs() < 1e-3, "a gap: the longest that is not clipped, {red:?}");
    assert!((red[3] / 0.1 - 1.0).abs() < 1e-5, "{red:?}");
    let report = result.report;
    assert_eq!((report.clipped_everywhere.any, report.clipped_everywhere.rgb), (0.25, [0.25; 3]));
    assert_eq!((report.dark_everywhere.any, report.dark_everywhere.rgb), (0.5, [0.5, 0.25, 0.25]));
    assert_eq!(report.photographs[0].clipped, 0.5);
    assert!(report.photographs[1].dark > 0.3 && report.photographs[1].clipped == 0.25, "{report:?}");
}

#[test]
fn a_clipped_area_that_rings_does_not_pass_for_light() {
    // Well seen in the short one; the long one is 16 times over, but JPEG left 0.93 in it.
    let result = merged(&[constant(&[[0.25; 3]]), constant(&[[0.93; 3]])], &[1.0, 64.0], &linear(0.98));
    assert!((result.image.pixel(0, 0)[0] - 0.25).abs() < 1e-6, "{:?}", result.image.pixel(0, 0));
    assert_eq!(result.report.photographs[1].clipped, 1.0);
}

#[test]
fn equal_exposures_are_averaged_also_where_dark() {
    for light in [0.4f32, 2e-4] {
        let frames: Vec<Arc<Image>> = [0.8, 1.0, 1.2].iter().map(|f| constant(&[[light * f; 3]])).collect();
        let value = merged(&frames, &[2.0; 3], &linear(1.0)).image.pixel(0, 0)[1];
        assert!((value / (light / 2.0) - 1.0).abs() < 1e-3, "{value} of {light}");
    }
}

#[test]
fn shifted_photographs_are_brought_back() {
    let scene = |x: i32, y: i32| ((x * 7 + y * 13).rem_euclid(50) as f32 + 5.0) / 60.0;
    let frame = |dx: i32, dy: i32, s: f32| {
        Arc::new(Image::from_fn(20, 10, |x, y| [s * scene(x as i32 - dx, y as i32 - dy); 3]))
    };
    let exposures = [0.5, 1.0];
    let mut shots = shots(&exposures);
    shots[0].offset = [3, -2];
    let frames = [frame(3, -2, 0.5), frame(0, 0, 1.0)];
    let result = merge(&shots, &linear(2.0), &mut |i| Ok(frames[i].clone())).unwrap();
    for (x, y) in [(0, 0), (19, 9), (16, 3), (5, 5)] {
        assert!((result.image.pixel(x, y)[2] - scene(x as i32, y as i32)).abs() < 1e-6, "({x}, {y})");
    }
}

#[test]
fn the_scale_is_that_of_the_reference() {
    let frames = [constant(&[[0.2; 3]]), constant(&[[0.4; 3]])];
    let value =
        |reference| merged(&frames, &[0.001, 0.002], &Options { reference, ..linear(1.0) }).image.pixel(0, 0)[0];
    assert!((value(1.0) / 200.0 - 1.0).abs() < 1e-5);
    assert!((value(0.002) / 0.4 - 1.0).abs() < 1e-5);
}

#[test]
fn bad_brackets_are_refused() {
    let frame = constant(&[[0.5; 3]]);
    let try_merge = |exposures: &[f64]| merge(&shots(exposures), &linear(1.0), &mut |_| Ok(frame.clone()));
    for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let message = try_merge(&[1.0, bad]).unwrap_err().to_string();
        assert!(message.contains("photograph 2"), "{message}");
    }
    assert!(try_merge(&[]).is_err());
    let other = constant(&[[0.5; 3], [0.5; 3]]);
    let two = [frame.clone(), other];
    let message = merge(&shots(&[1.0, 2.0]), &linear(1.0), &mut |i| Ok(two[i].clone())).unwrap_err().to_string();
    assert!(message.contains("photograph 2: found 2 x 1"), "{message}");
    let stopped = merge(&shots(&[1.0]), &linear(1.0), &mut |_| Err(crate::Error::Cancelled));
    assert!(matches!(stopped, Err(crate::Error::Cancelled)));
}

/// Two dark lights, a twentieth and twice the read noise, seen by a camera with a dark level: without it subtracted they
/// come out too bright, with it their means are right, because values below it are kept.
#[test]
fn a_dark_level_is_subtracted_without_bias() {
    let truth = Image::from_fn(120, 90, |x, _| if x < 60 { [2e-5; 3] } else { [8e-4; 3] });
    let s = 1.0;
    for sensor in [testing::LINEAR, testing::FILM] {
        let curve = if sensor.film {
            let table = std::array::from_fn(|z| inverse_film(z as f64 / 255.0));
            Curve::Response(Response::new("camera", [table; 3]).unwrap())
        } else {
            Curve::Linear
        };
        let scale = curve.light(0, 0.5) / sensor.light(0.5);
        let black = [sensor.code(sensor.dark) as f32; 3];
        let frame = Arc::new(sensor.photograph(&truth, s, 5));
        let mean = |black: [f32; 3], left: bool| {
            let options = Options { black, clip: [1.0; 3], ..Options::new(curve.clone(), SampleType::U16) };
            let image = merged(std::slice::from_ref(&frame), &[s], &options).image;
            let half = (0..90).flat_map(|y| (0..60).map(move |x| (x + if left { 0 } else { 60 }, y)));
            half.map(|(x, y)| f64::from(image.pixel(x, y)[1])).sum::<f64>() / (5400.0 * scale)
        };
        // Noise of the mean of 5400 samples: 6e-4 / 73 = 8e-6.
        for (left, light) in [(true, 2e-5), (false, 8e-4)] {
            let (with, without) = (mean(black, left), mean([0.0; 3], left));
            assert!((with - light).abs() < 4e-5, "film {}: {with} is not {light}", sensor.film);
            assert!(without > light + 0.9 * sensor.dark, "{without}");
        }
    }
}
