//! From codes to light, and what rounding to codes costs.

use super::response::Response;
use crate::error::{Error, Result};
use crate::image::{SampleType, srgb};

/// What turns codes of a photograph into light.
#[derive(Debug, Clone, PartialEq)]
pub enum Curve {
    /// Codes are proportional to light.
    Linear,
    /// The sRGB curve.
    Srgb,
    /// A camera's own; for 8-bit codes only.
    Response(Response),
}

/// A curve made ready for one type of sample: tables where there are codes.
#[derive(Debug, Clone)]
pub(super) struct Decoder {
    srgb: bool,
    /// Largest code, and for each code of each channel its light and the variance that rounding to it adds.
    tables: Option<(f32, [Vec<(f32, f32)>; 3])>,
}

impl Decoder {
    /// # Errors
    /// [`Error::Unsupported`] for a response beside anything but 8-bit codes.
    pub(super) fn new(curve: &Curve, sample_type: SampleType) -> Result<Self> {
        let largest = sample_type.largest_code();
        if matches!(curve, Curve::Response(_)) && largest != Some(u16::from(u8::MAX)) {
            return Err(Error::Unsupported {
                place: "camera response".to_owned(),
                what: "a response for photographs that are not of 8 bits".to_owned(),
                advice: "say how they are encoded instead: linear or sRGB".to_owned(),
            });
        }
        let tables = largest.map(|largest| {
            let table = |c: usize| with_rounding((0..=largest).map(|z| light_of(curve, c, z, largest)).collect());
            (f32::from(largest), [0, 1, 2].map(table))
        });
        Ok(Self { srgb: *curve == Curve::Srgb, tables })
    }

    /// Light of a sample (white code = 1) of channel `c`, and the variance of its rounding.
    #[inline]
    pub(super) fn light(&self, c: usize, sample: f32) -> (f32, f32) {
        match &self.tables {
            Some((largest, tables)) => {
                let table = &tables[c];
                table[((sample * largest + 0.5) as usize).min(table.len() - 1)]
            }
            None if self.srgb => (srgb::decode(sample), 0.0),
            None => (sample, 0.0),
        }
    }
}

fn light_of(curve: &Curve, c: usize, code: u16, largest: u16) -> f64 {
    let share = f32::from(code) / f32::from(largest);
    match curve {
        Curve::Linear => f64::from(code) / f64::from(largest),
        Curve::Srgb => f64::from(srgb::decode(share)),
        Curve::Response(response) => response.channel(c)[usize::from(code)],
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
        let linear = Decoder::new(&Curve::Linear, SampleType::U8).unwrap();
        assert_eq!(linear.light(0, 51.0 / 255.0).0, 0.2);
        assert!((linear.light(1, 1.0).1 * 12.0 * 255.0 * 255.0 - 1.0).abs() < 1e-5);
        let srgb = Decoder::new(&Curve::Srgb, SampleType::Jpeg).unwrap();
        let same = Decoder::new(&Curve::Response(Response::srgb()), SampleType::Jpeg).unwrap();
        for z in 0..=255u8 {
            let sample = f32::from(z) / 255.0;
            assert_eq!(srgb.light(2, sample), same.light(2, sample));
            assert!((srgb.light(0, sample).0 - srgb::decode(sample)).abs() < 1e-6);
        }
        let float = Decoder::new(&Curve::Linear, SampleType::Float).unwrap();
        assert_eq!((float.light(0, -3.0), float.light(0, 70.0)), ((-3.0, 0.0), (70.0, 0.0)));
        let wide = Decoder::new(&Curve::Linear, SampleType::U16).unwrap();
        assert_eq!(wide.light(0, 1.0).0, 1.0);
        let refused = Decoder::new(&Curve::Response(Response::srgb()), SampleType::U16).unwrap_err().to_string();
        assert!(refused.contains("8 bits"), "{refused}");
    }
}
