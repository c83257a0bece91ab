//! Lamps, and shutters, that drift: a reference condition photographed again and again tells by how much.
//!
//! Each picture of the reference is brighter than the first by a gain for each channel, the robust ratio of the two; between
//! references the gain is interpolated, before the first and after the last it stays. Photographs are divided by it.
//!
//! The ratio is that of sums, `sum w B / sum w A`, which noise in neither picture biases, with Tukey's weights on
//! `(B - g A) / sqrt(g A + B)`: photon noise grows with the root of the light, and a highlight that moved is an outlier. A
//! picture that moved as a whole ([`movement`]) is moved back first: two pixels would pass for half a percent.

use std::collections::HashSet;

use super::black::median;
use super::movement::{Movement, movement};
use crate::error::{Error, Result};
use crate::image::Image;

/// Pixels count that are brighter than this share of the bright ones: below, black levels and stray light count as much.
const LEAST_LIGHT: f32 = 0.05;
/// The bright ones: one pixel of a hundred is brighter.
const BRIGHTER: f64 = 0.01;
/// Fewer pixels than this are no measurement.
const FEWEST: usize = 100;
/// Tukey's constant for 95 % efficiency at normal noise.
const TUKEY: f64 = 4.685;
/// Rounds of reweighting.
const ROUNDS: usize = 10;
/// Change of a lamp from here on is worth a sentence: what the rest of a calibration is good for.
pub const WORTH: f64 = 0.01;

/// The references so far.
#[derive(Debug, Clone)]
pub struct Drift {
    first: Image,
    points: Vec<Point>,
}

/// What one reference says.
#[derive(Debug, Clone, PartialEq)]
pub struct Point {
    /// When: seconds, or the number of the photograph; the caller's choice.
    pub at: f64,
    /// Light in units of the first reference's, RGB.
    pub gain: [f32; 3],
    /// Against the first reference; `None` of that itself.
    pub movement: Option<Movement>,
}

impl Drift {
    /// The first reference: a linear picture, dark level and ambient light subtracted.
    ///
    /// # Errors
    /// [`Error::Invalid`] where it shows no light.
    pub fn new(first: Image, at: f64) -> Result<Self> {
        if (0..3).all(|c| lit(&first, c).len() < FEWEST) {
            let expected = "at least 100 lit pixels in one channel; take a brighter condition for reference";
            return Err(Error::invalid("the reference", "a picture without light", expected));
        }
        Ok(Self { first, points: vec![Point { at, gain: [1.0; 3], movement: None }] })
    }

    /// The next reference, in any order of time. A channel too dark to tell takes the mean of the others.
    ///
    /// # Errors
    /// [`Error::Invalid`] for another size, a time that is no number, or no light where there was: the lamp is off.
    pub fn add(&mut self, picture: &Image, at: f64) -> Result<Point> {
        let place = || format!("reference {}", self.points.len() + 1);
        if picture.size() != self.first.size() || !at.is_finite() {
            let found = format!("{} x {} at {at}", picture.width(), picture.height());
            let expected = format!("{} x {} at a time", self.first.width(), self.first.height());
            return Err(Error::invalid(place(), found, expected));
        }
        let movement = movement(&self.first, picture);
        let back = match &movement {
            Movement::Known(shift) => moved_back(picture, shift.pixels),
            Movement::Unknown(_) => picture.clone(),
        };
        let gains: [Option<f64>; 3] = std::array::from_fn(|c| ratio(&self.first, &back, c));
        let told: Vec<f64> = gains.iter().flatten().copied().collect();
        let mean = told.iter().sum::<f64>() / told.len() as f64;
        if !(mean.is_finite() && gains.iter().flatten().all(|g| *g > 0.0)) {
            let expected = "the condition of the first reference, lit; is the lamp on?";
            return Err(Error::invalid(place(), "no light where the first reference has some", expected));
        }
        let point = Point { at, gain: gains.map(|g| g.unwrap_or(mean) as f32), movement: Some(movement) };
        let place = self.points.partition_point(|p| p.at <= at);
        self.points.insert(place, point.clone());
        Ok(point)
    }

    /// All references in order of time.
    pub fn points(&self) -> &[Point] {
        &self.points
    }

    /// What to divide a picture taken at a time by.
    pub fn gain(&self, at: f64) -> [f32; 3] {
        let after = self.points.partition_point(|p| p.at <= at);
        let (before, next) = (after.checked_sub(1).map(|i| &self.points[i]), self.points.get(after));
        match (before, next) {
            (Some(a), Some(b)) => {
                let t = ((at - a.at) / (b.at - a.at)) as f32;
                std::array::from_fn(|c| a.gain[c] + t * (b.gain[c] - a.gain[c]))
            }
            (Some(only), None) => only.gain,
            (None, Some(only)) => only.gain,
            (None, None) => [1.0; 3],
        }
    }

    /// The change farthest from none, of any channel: 0.03 of a lamp that gained 3 %.
    pub fn largest(&self) -> f64 {
        let changes = self.points.iter().flat_map(|p| p.gain).map(|g| f64::from(g) - 1.0);
        changes.fold(0.0, |worst: f64, change| if change.abs() > worst.abs() { change } else { worst })
    }

    /// Sentences of references that moved, or may have; `name` names the reference of a time.
    pub fn moved(&self, name: impl Fn(f64) -> String) -> Vec<String> {
        self.points.iter().filter_map(|p| p.movement.as_ref()?.verdict(&name(p.at))).collect()
    }

    /// A sentence where light changed by more than [`WORTH`].
    pub fn verdict(&self) -> Option<String> {
        let change = |p: &&Point| p.gain.map(|g| (f64::from(g) - 1.0).abs()).into_iter().fold(0.0, f64::max);
        let worst = self.points.iter().max_by(|a, b| change(a).total_cmp(&change(b)))?;
        (self.largest().abs() > WORTH).then(|| {
            let [r, g, b] = worst.gain.map(|g| 100.0 * (f64::from(g) - 1.0));
            format!(
                "the lamps drifted by {:+.1} %: {r:+.1}, {g:+.1}, {b:+.1} % in red, green and blue against the first of {} \
                 references; photographs are divided by what they drifted",
                100.0 * self.largest(),
                self.points.len()
            )
        })
    }
}

/// The picture as it would be had it not moved, between pixels linearly; black where it does not reach.
fn moved_back(picture: &Image, [dx, dy]: [f64; 2]) -> Image {
    let (w, h) = picture.size();
    Image::from_fn(w, h, |x, y| {
        let (px, py) = (x as f64 + dx, y as f64 + dy);
        let (i, j) = (px.floor(), py.floor());
        if !(i >= 0.0 && j >= 0.0 && i + 1.0 < w as f64 && j + 1.0 < h as f64) {
            return [0.0; 3];
        }
        let (a, b) = ((px - i) as f32, (py - j) as f32);
        let at = |k: usize, m: usize, c: usize| picture.pixel(i as usize + k, j as usize + m)[c];
        let row = |m: usize, c: usize| (1.0 - a) * at(0, m, c) + a * at(1, m, c);
        std::array::from_fn(|c| (1.0 - b) * row(0, c) + b * row(1, c))
    })
}

/// Pixels of channel `c` that are lit.
fn lit(picture: &Image, c: usize) -> Vec<usize> {
    let channels = picture.channels();
    let value = |k: usize| picture.data()[k * channels + c];
    let count = picture.width() * picture.height();
    let mut values: Vec<f32> = (0..count).map(value).collect();
    let Some(last) = count.checked_sub(1) else { return Vec::new() };
    let rank = ((count as f64 * (1.0 - BRIGHTER)) as usize).min(last);
    let limit = LEAST_LIGHT * *values.select_nth_unstable_by(rank, f32::total_cmp).1;
    (0..count).filter(|k| limit > 0.0 && value(*k) > limit).collect()
}

/// How much brighter `b` is than `a` in channel `c`; `None` where too little is lit to tell.
fn ratio(a: &Image, b: &Image, c: usize) -> Option<f64> {
    let value = |image: &Image, k: usize| f64::from(image.data()[k * image.channels() + c]);
    // Lit in both: of an object that moved a little, the sides that came and went would not weigh each other up.
    let second: HashSet<usize> = lit(b, c).into_iter().collect();
    let both = lit(a, c).into_iter().filter(|k| second.contains(k));
    let pairs: Vec<(f64, f64)> = both.map(|k| (value(a, k), value(b, k))).collect();
    if pairs.len() < FEWEST {
        return None;
    }
    let mut gain = median(&mut pairs.iter().map(|(a, b)| b / a).collect::<Vec<_>>());
    for _ in 0..ROUNDS {
        let left = |(a, b): &(f64, f64)| (b - gain * a) / (gain * a + b).max(1e-12).sqrt();
        let spread = 1.4826 * median(&mut pairs.iter().map(|p| left(p).abs()).collect::<Vec<_>>());
        let (mut up, mut down) = (0.0, 0.0);
        for pair in &pairs {
            let w = (1.0 - (left(pair) / (TUKEY * spread.max(1e-9))).powi(2)).max(0.0).powi(2);
            (up, down) = (up + w * pair.1, down + w * pair.0);
        }
        if down <= 0.0 {
            break;
        }
        gain = up / down;
    }
    Some(gain)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hdr::testing;

    fn scene(gain: [f32; 3], shift: f32) -> Image {
        Image::from_fn(160, 120, |x, y| {
            let (u, v) = ((x as f32 - 80.0 - shift) / 50.0, (y as f32 - 60.0) / 50.0);
            let ball =
                if u.hypot(v) < 1.0 { 0.2 + 0.6 * (0.5 + 0.5 * (8.0 * u).sin() * (6.0 * v).cos()) } else { 0.002 };
            std::array::from_fn(|c| gain[c] * ball)
        })
    }

    fn noisy(light: &Image, seed: u64) -> Image {
        let mut seen = testing::LINEAR.photograph(light, 1.0, seed);
        seen.data_mut().iter_mut().for_each(|v| *v -= testing::DARK as f32);
        seen
    }

    #[test]
    fn a_drift_of_three_percent_is_measured_and_interpolated() {
        let mut drift = Drift::new(noisy(&scene([1.0; 3], 0.0), 1), 0.0).unwrap();
        assert_eq!((drift.gain(5.0), drift.verdict()), ([1.0; 3], None));
        // Moved by 2 pixels as well, and references need not come in order.
        drift.add(&noisy(&scene([1.03, 1.02, 0.98], 2.0), 2), 100.0).unwrap();
        drift.add(&noisy(&scene([1.01, 1.0, 1.0], 0.0), 3), 50.0).unwrap();
        for (at, truth) in [
            (0.0, [1.0, 1.0, 1.0]),
            (25.0, [1.005, 1.0, 1.0]),
            (50.0, [1.01, 1.0, 1.0]),
            (75.0, [1.02, 1.01, 0.99]),
            (100.0, [1.03, 1.02, 0.98]),
            (1e9, [1.03, 1.02, 0.98]),
            (-1.0, [1.0, 1.0, 1.0]),
        ] {
            let found = drift.gain(at);
            assert!((0..3).all(|c| (found[c] - truth[c]).abs() < 0.002f32), "{at}: {found:?} is not {truth:?}");
        }
        let verdict = drift.verdict().unwrap();
        assert!(verdict.contains("drifted by +3.0 %") && verdict.contains("-2.0 % in red"), "{verdict}");
        assert!((drift.largest() - 0.03).abs() < 0.002);
        let moved = drift.moved(|at| format!("reference at {at} s"));
        assert!(moved.len() == 1 && moved[0].contains("at 100 s") && moved[0].contains("moved by 2.0"), "{moved:?}");
    }

    #[test]
    fn a_dark_channel_follows_the_others_and_darkness_is_refused() {
        let red = |gain: f32| scene([gain, 0.0, 0.0], 0.0);
        let mut drift = Drift::new(red(1.0), 0.0).unwrap();
        let point = drift.add(&red(0.9), 1.0).unwrap();
        assert!(point.gain.iter().all(|g| (g - 0.9).abs() < 1e-4), "{point:?}");
        let message = drift.add(&Image::new(160, 120, 3), 2.0).unwrap_err().to_string();
        assert!(message.contains("reference 3") && message.contains("lamp on"), "{message}");
        assert!(drift.add(&red(1.0), f64::NAN).is_err() && drift.add(&Image::new(4, 4, 3), 3.0).is_err());
        let dark = Drift::new(Image::new(160, 120, 3), 0.0).unwrap_err().to_string();
        assert!(dark.contains("without light"), "{dark}");
    }
}
