//! From a picture that an emitter showed to the light that it emitted: codes, by the emitter's curve, averaged over texels.

use std::path::Path;

use super::Pattern;
use crate::domain::EmitterCurve;
use crate::error::{Error, Result};
use crate::image::read_codes;

/// Channels of a grey picture differ by no more, as shares of the largest code: what JPEG and rounding leave.
const GREY: f32 = 2.5 / 255.0;

/// The light of a pattern, less that of code 0, as [`PatternSet::pattern`](super::PatternSet::pattern) has it; `texel` pixels
/// along each side of a texel, over which light (not code) is averaged. Float pictures hold codes too, white = 1.
///
/// # Errors
/// A file that cannot be read; a coloured pattern; codes beyond 0 to 1; sides that are no multiples of a texel's.
pub fn emitted(path: &Path, curve: &EmitterCurve, texel: usize) -> Result<Pattern> {
    let (codes, _) = read_codes(path)?;
    let (width, height) = codes.size();
    let refuse = |place: String, found: String, expected: &str| Err(Error::invalid(place, found, expected));
    let place = path.display().to_string();
    if texel == 0 || !width.is_multiple_of(texel) || !height.is_multiple_of(texel) {
        let found = format!("{width} x {height} pixels");
        return refuse(place, found, &format!("sides that are multiples of a texel's {texel} pixels"));
    }
    let (columns, rows) = (width / texel, height / texel);
    let mut sums = vec![0.0f64; columns * rows];
    for (n, pixel) in codes.data().chunks_exact(codes.channels()).enumerate() {
        let (x, y) = (n % width, n / width);
        let [r, g, b] = [pixel[0], pixel[1], pixel[2]];
        let (low, high) = (r.min(g).min(b), r.max(g).max(b));
        if high - low > GREY {
            return refuse(format!("{place}, pixel ({x}, {y})"), format!("the colour {r}, {g}, {b}"), "a grey pattern");
        }
        if low < 0.0 || high > 1.0 {
            return refuse(format!("{place}, pixel ({x}, {y})"), format!("the code {high}"), "codes of 0 to 1");
        }
        sums[y / texel * columns + x / texel] += curve.light(f64::from(g));
    }
    let area = (texel * texel) as f64;
    Ok(Pattern { columns, rows, values: sums.iter().map(|sum| (sum / area) as f32).collect() })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::domain::patterns::{Kind, Noise, PatternSet};
    use crate::domain::{Bits, Emitter, Plane};
    use crate::image::{EncodeOptions, Image, write, write_grey};
    use crate::wavelet::Wavelet;

    #[test]
    fn what_is_shown_comes_back_to_half_a_code() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        let noise = Noise { wavelet: Wavelet::Haar, count: 1, seed: 1, deviation: 0.2 };
        let pattern = PatternSet::new(Kind::Noise(noise), Plane::new(16, 8).unwrap()).unwrap().pattern(0);
        for curve in [EmitterCurve::Linear, EmitterCurve::Srgb] {
            for bits in [Bits::Eight, Bits::Sixteen] {
                let emitter = Emitter::new(&curve, bits);
                let codes = pattern.codes(&emitter);
                write_grey(&path, (16, 8), &codes, bits == Bits::Eight).unwrap();
                let back = emitted(&path, &curve, 1).unwrap();
                for ((value, code), wanted) in back.values.iter().zip(&codes).zip(&pattern.values) {
                    assert!((value - emitter.light(*code)).abs() < 1e-6);
                    // Half a step where the curve is steepest; sRGB's slope at white is 2.28.
                    assert!((value - wanted).abs() <= 0.5 * 2.3 / f32::from(bits.largest()));
                }
            }
        }
    }

    #[test]
    fn texels_are_averaged_in_light() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        write_grey(&path, (4, 2), &[0, 255, 188, 188, 255, 0, 188, 188], true).unwrap();
        let back = emitted(&path, &EmitterCurve::Srgb, 2).unwrap();
        assert_eq!((back.columns, back.rows), (2, 1));
        assert!((back.values[0] - 0.5).abs() < 1e-6 && (back.values[1] - 0.502_886_5).abs() < 1e-5);
        assert!(emitted(&path, &EmitterCurve::Srgb, 3).unwrap_err().to_string().contains("a texel's 3 pixels"));
    }

    #[test]
    fn what_is_no_pattern_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.exr");
        for (pixel, words) in
            [([0.5, 0.6, 0.5], "a grey pattern"), ([1.5; 3], "codes of 0 to 1"), ([-0.1; 3], "0 to 1")]
        {
            write(&path, &Image::from_fn(2, 2, |x, _| if x == 1 { pixel } else { [0.0; 3] }), EncodeOptions::default())
                .unwrap();
            let message = emitted(&path, &EmitterCurve::Linear, 1).unwrap_err().to_string();
            assert!(message.contains("pixel (1, 0)") && message.contains(words), "{message}");
        }
    }
}
