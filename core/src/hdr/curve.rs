//! From codes to light, and what rounding to codes costs.

use super::response::{CODES, Response};
use crate::error::{Error, Result};
use crate::image::{SampleType, srgb};

/// What turns codes of a photograph into light.
#[derive(Debug, Clone, PartialEq)]
pub enum Curve {
    /// Codes are proportional to light.
    Linear,
    /// The sRGB curve.
    Srgb,
    /// A camera's own; for integer codes. Deeper than 8 bits they lie between the 256 of the table
    /// ([`Response::light`]).
    Response(Response),
}

impl Curve {
    /// Light of a code of channel `c`, white code = 1.
    pub fn light(&self, c: usize, code: f64) -> f64 {
        match self {
            Self::Linear => code,
            Self::Srgb => f64::from(srgb::decode(code as f32)),
            Self::Response(response) => response.light(c, code),
        }
    }

    /// The code of channel `c` that stands for this light.
    pub fn code(&self, c: usize, light: f64) -> f64 {
        match self {
            Self::Linear => light,
            Self::Srgb => f64::from(srgb::encode(light as f32)),
            Self::Response(response) => response.code(c, light),
        }
    }
}

/// A curve made ready for one type of sample: tables where there are codes.
///
/// A camera codes nothing as its dark level `b`, and light on top of that: `z = f(E s + d)` with `f(d) = b`, where `d` is
/// dark current, flare and the offset that keeps noise from being cut at zero. So light is `f^-1(z) - f^-1(b)`, which for
/// a linear curve is the difference of codes. It is negative where noise takes a code below the dark level: then
/// means of many stay unbiased.
#[derive(Debug, Clone)]
pub struct Decoder {
    srgb: bool,
    /// Light of the dark level.
    dark: [f32; 3],
    /// Code of the dark level.
    black: [f32; 3],
    tables: Option<Tables>,
}

#[derive(Debug, Clone)]
struct Tables {
    largest: f32,
    /// For each code of each channel its light and the variance that rounding to it adds.
    channels: [Vec<(f32, f32)>; 3],
}

impl Decoder {
    /// `black` is the code (white = 1) of no light, each channel; zeros where there is none to subtract.
    ///
    /// # Errors
    /// [`Error::Unsupported`] for a response beside floats; [`Error::Invalid`] for a black that is not a share of white.
    pub fn new(curve: &Curve, sample_type: SampleType, black: [f32; 3]) -> Result<Self> {
        let largest = sample_type.largest_code();
        if matches!(curve, Curve::Response(_)) && largest.is_none() {
            return Err(Error::Unsupported {
                place: "camera response".to_owned(),
                what: "a response for photographs of floats".to_owned(),
                advice: "say how they are encoded instead: linear or sRGB".to_owned(),
            });
        }
        // Floats may be in any unit; of codes, black is far below white.
        let sensible = |b: &f32| b.is_finite() && (largest.is_none() || (0.0..MOST_BLACK).contains(b));
        if let Some(bad) = black.iter().find(|b| !sensible(b)) {
            let expected = format!("a code from 0 to {MOST_BLACK}, where white is 1");
            return Err(Error::invalid("black level", bad.to_string(), expected));
        }
        let light = |c: usize, code: f32| if code == 0.0 { 0.0 } else { curve.light(c, f64::from(code)) };
        let dark: [f64; 3] = std::array::from_fn(|c| light(c, black[c]));
        let tables = largest.map(|largest| {
            let table =
                |c: usize| with_rounding((0..=largest).map(|z| light_of(curve, c, z, largest) - dark[c]).collect());
            Tables { largest: f32::from(largest), channels: [0, 1, 2].map(table) }
        });
        Ok(Self { srgb: *curve == Curve::Srgb, dark: dark.map(|v| v as f32), black, tables })
    }

    /// Light of a sample (white code = 1) of channel `c`.
    pub fn value(&self, c: usize, sample: f32) -> f32 {
        self.light(c, sample).0
    }

    /// Light of a sample of channel `c`, and the variance of its rounding.
    #[inline]
    pub(super) fn light(&self, c: usize, sample: f32) -> (f32, f32) {
        match &self.tables {
            Some(Tables { largest, channels }) => {
                let table = &channels[c];
                table[((sample * largest + 0.5) as usize).min(table.len() - 1)]
            }
            None if self.srgb => (srgb::decode(sample) - self.dark[c], 0.0),
            None => (sample - self.dark[c], 0.0),
        }
    }

    /// The code of no light in channel `c`.
    pub(super) fn black(&self, c: usize) -> f32 {
        self.black[c]
    }
}

/// A dark level above half of white is no dark level.
const MOST_BLACK: f32 = 0.5;

fn light_of(curve: &Curve, c: usize, code: u16, largest: u16) -> f64 {
    match curve {
        // A code of 8 bits is one of the table's.
        Curve::Response(response) if usize::from(largest) == CODES - 1 => response.channel(c)[usize::from(code)],
        Curve::Srgb => f64::from(srgb::decode(f32::from(code) / f32::from(largest))),
        _ => curve.light(c, f64::from(code) / f64::from(largest)),
    }
}

/// Rounding to a code is a uniform error over one step, variance 1/12 of its square, stretched by the slope of the curve:
/// `(dx/dz)^2 / 12`, central differences inside, one-sided at the ends.
fn with_rounding(light: Vec<f64>) -> Vec<(f32, f32)> {
    let last = light.len() - 1;
    let step = |z: usize| {
        let (below, above) = (z.saturating_sub(1), (z + 1).min(last));
        (light[above] - light[below]) / (above - below) as f64
    };
    (0..light.len()).map(|z| (light[z] as f32, (step(z).powi(2) / 12.0) as f32)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_become_light_and_its_rounding() {
        let linear = Decoder::new(&Curve::Linear, SampleType::U8, [0.0; 3]).unwrap();
        assert_eq!(linear.light(0, 51.0 / 255.0).0, 0.2);
        assert!((linear.light(1, 1.0).1 * 12.0 * 255.0 * 255.0 - 1.0).abs() < 1e-5);
        let srgb = Decoder::new(&Curve::Srgb, SampleType::Jpeg, [0.0; 3]).unwrap();
        let same = Decoder::new(&Curve::Response(Response::srgb()), SampleType::Jpeg, [0.0; 3]).unwrap();
        for z in 0..=255u8 {
            let sample = f32::from(z) / 255.0;
            assert_eq!(srgb.light(2, sample), same.light(2, sample));
            assert!((srgb.light(0, sample).0 - srgb::decode(sample)).abs() < 1e-6);
        }
        let float = Decoder::new(&Curve::Linear, SampleType::Float, [0.0; 3]).unwrap();
        assert_eq!((float.light(0, -3.0), float.light(0, 70.0)), ((-3.0, 0.0), (70.0, 0.0)));
        let wide = Decoder::new(&Curve::Linear, SampleType::U16, [0.0; 3]).unwrap();
        assert_eq!(wide.light(0, 1.0).0, 1.0);
        let refused = Decoder::new(&Curve::Response(Response::srgb()), SampleType::Float, [0.0; 3]).unwrap_err();
        assert!(refused.to_string().contains("floats"), "{refused}");
    }

    #[test]
    fn light_of_the_dark_level_is_taken_off() {
        let black = [0.02, 0.03, 0.0];
        for curve in [Curve::Linear, Curve::Srgb, Curve::Response(Response::srgb())] {
            let deep = Decoder::new(&curve, SampleType::U16, black).unwrap();
            for (c, b) in black.into_iter().enumerate() {
                let dark = if b == 0.0 { 0.0 } else { curve.light(c, f64::from(b)) };
                for code in [0.0f32, 0.01, 0.3, 1.0] {
                    let at = f64::from((code * 65_535.0).round() / 65_535.0);
                    let expected = curve.light(c, at) - dark;
                    assert!((f64::from(deep.value(c, code)) - expected).abs() < 1e-6, "{curve:?} {c} {code}");
                }
                assert!(deep.value(c, b).abs() < 1e-4);
                assert!(b == 0.0 || deep.value(c, 0.0) < -1e-3, "below the dark level light is negative");
            }
        }
        let float = Decoder::new(&Curve::Linear, SampleType::Float, [0.5, 0.0, -0.1]).unwrap();
        assert_eq!([0, 1, 2].map(|c| float.value(c, 1.0)), [0.5, 1.0, 1.1]);
        for bad in [-0.1, 0.6, f32::NAN] {
            let message = Decoder::new(&Curve::Linear, SampleType::U16, [bad; 3]).unwrap_err().to_string();
            assert!(message.contains("black level"), "{message}");
        }
    }

    #[test]
    fn a_response_of_deep_codes_is_smooth_between_its_knots() {
        let deep = Decoder::new(&Curve::Response(Response::srgb()), SampleType::U16, [0.0; 3]).unwrap();
        for z in (3 * 257..=65_535).step_by(101) {
            let code = z as f32 / 65_535.0;
            let (found, expected) = (deep.value(0, code), srgb::decode(code));
            assert!((found / expected - 1.0).abs() < 1e-3, "{z}: {found} is not {expected}");
        }
    }
}
