//! What light the codes of a screen or projector become (6.3: "the discrete gamma curve is inversely applied").
//!
//! Light is relative and without the black level: code 0 emits 0, the largest code 1. So `(g(z) - g(0)) / (g(white) - g(0))`
//! of a measured curve g, and photographs have the black one subtracted.

use std::path::Path;

use crate::error::{Error, Result};
use crate::image::srgb;

/// Codes of a measured curve.
const CODES: usize = 256;
/// A table is some 10 kB; more than this is none.
const LARGEST_FILE: u64 = 1 << 20;
const EXPECTED: &str = "256 lines `code light` (or `code red green blue`), codes from 0 to 255";

/// The curve of an emitter.
#[derive(Debug, Clone, PartialEq, Default)]
pub enum EmitterCurve {
    /// Light is proportional to the code.
    Linear,
    /// The sRGB curve, what most screens aim at.
    #[default]
    Srgb,
    /// Measured: light of each 8-bit code, rising from 0 to 1. Between codes (of deeper files) it is linear.
    Table(Box<[f64; CODES]>),
}

impl EmitterCurve {
    /// A measured curve from light of any scale; the black level, that of code 0, is taken off.
    ///
    /// # Errors
    /// Numbers that are negative or not finite, that fall from code to code, or are all the same.
    pub fn table(place: &str, light: [f64; CODES]) -> Result<Self> {
        let bad = |code: usize, expected: &str| {
            Err(Error::invalid(format!("{place}, code {code}"), format!("light of {}", light[code]), expected))
        };
        if let Some(code) = light.iter().position(|v| !(v.is_finite() && *v >= 0.0)) {
            return bad(code, "a number that is finite and not negative");
        }
        if let Some(code) = (1..CODES).find(|&code| light[code] < light[code - 1]) {
            return bad(code, "light that does not fall from code to code");
        }
        let (black, white) = (light[0], light[CODES - 1]);
        let range = white - black;
        // Less than this is noise of the measurement, not a screen.
        if range <= 1e-6 * white {
            return bad(CODES - 1, "more light than of code 0");
        }
        Ok(Self::Table(Box::new(light.map(|v| (v - black) / range))))
    }

    /// Reads a measured curve: a text file with `#` comments, then for every code from 0 to 255 a line `code light`, or `code
    /// red green blue`, of which the mean is taken (patterns are grey).
    ///
    /// # Errors
    /// A line that is not that, with its number; missing codes; as [`EmitterCurve::table`].
    pub fn read(path: &Path) -> Result<Self> {
        let failed = |source| Error::io("read", path, source);
        let place = path.display().to_string();
        let size = std::fs::metadata(path).map_err(failed)?.len();
        if size > LARGEST_FILE {
            return Err(Error::invalid(place, format!("{size} bytes"), EXPECTED));
        }
        let bytes = std::fs::read(path).map_err(failed)?;
        let text = String::from_utf8(bytes).map_err(|_| Error::invalid(&place, "bytes that are no text", EXPECTED))?;
        let (mut light, mut codes) = ([0.0; CODES], 0);
        for (line, number) in text.lines().zip(1..) {
            let line = line.split('#').next().unwrap_or_default().trim();
            if line.is_empty() {
                continue;
            }
            match light_of_line(line, codes).filter(|_| codes < CODES) {
                Some(value) => light[codes] = value,
                None => {
                    let wanted = if codes < CODES { format!("`{codes} LIGHT`") } else { "no more codes".into() };
                    let shown: String = line.chars().take(60).collect();
                    let place = format!("{place}, line {number}");
                    return Err(Error::invalid(place, format!("`{shown}`"), format!("{wanted}, of {EXPECTED}")));
                }
            }
            codes += 1;
        }
        if codes != CODES {
            return Err(Error::invalid(place, format!("{codes} codes"), EXPECTED));
        }
        Self::table(&place, light)
    }

    /// Light of a code, both 0 to 1.
    pub fn light(&self, code: f64) -> f64 {
        match self {
            Self::Linear => code,
            Self::Srgb => f64::from(srgb::decode(code as f32)),
            Self::Table(table) => {
                let at = code * (CODES - 1) as f64;
                let low = (at as usize).min(CODES - 2);
                table[low] + (at - low as f64) * (table[low + 1] - table[low])
            }
        }
    }
}

/// `code light` or `code r g b`.
fn light_of_line(line: &str, code: usize) -> Option<f64> {
    let numbers: Vec<f64> = line.split_whitespace().map(|n| n.parse().ok()).collect::<Option<_>>()?;
    let (first, light) = numbers.split_first()?;
    let known = *first == code as f64 && (light.len() == 1 || light.len() == 3);
    known.then(|| light.iter().sum::<f64>() / light.len() as f64)
}

/// How deep codes are.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Bits {
    /// What screens and projectors take.
    #[default]
    Eight,
    /// Screens of deep colour.
    Ten,
    /// For what takes more.
    Sixteen,
}

impl Bits {
    /// The code of white.
    pub fn largest(self) -> u16 {
        match self {
            Self::Eight => 255,
            Self::Ten => 1023,
            Self::Sixteen => u16::MAX,
        }
    }
}

/// A curve made ready for codes of one depth: the light of each.
///
/// ```
/// use relume_core::domain::{Bits, Emitter, EmitterCurve};
/// let screen = Emitter::new(&EmitterCurve::Srgb, Bits::Eight);
/// assert_eq!(screen.code(0.5), 188);
/// assert!((screen.light(188) - 0.5029).abs() < 1e-4);
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Emitter {
    light: Vec<f32>,
}

impl Emitter {
    /// The light of every code.
    pub fn new(curve: &EmitterCurve, bits: Bits) -> Self {
        let largest = f64::from(bits.largest());
        Self { light: (0..=bits.largest()).map(|code| curve.light(f64::from(code) / largest) as f32).collect() }
    }

    /// The code whose light is nearest, of several the lowest. Light beyond 0 to 1 is given its end, NaN black.
    pub fn code(&self, light: f32) -> u16 {
        let above = self.light.partition_point(|emitted| *emitted < light);
        let code = match above {
            0 => 0,
            n if n == self.light.len() => self.below(n - 1),
            n if light - self.light[n - 1] <= self.light[n] - light => self.below(n - 1),
            n => n,
        };
        code as u16
    }

    /// The code of white, the largest.
    pub fn white(&self) -> u16 {
        (self.light.len() - 1) as u16
    }

    /// The light of a code, 0 to 1; codes beyond the largest emit as it does.
    pub fn light(&self, code: u16) -> f32 {
        self.light[usize::from(code).min(self.light.len() - 1)]
    }

    /// The lowest code that emits as much as this one.
    fn below(&self, code: usize) -> usize {
        self.light.partition_point(|emitted| *emitted < self.light[code])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gamma(exponent: f64, black: f64) -> [f64; CODES] {
        std::array::from_fn(|code| black + 80.0 * (code as f64 / 255.0).powf(exponent))
    }

    #[test]
    fn codes_return_and_no_other_is_nearer() {
        let table = EmitterCurve::table("t", gamma(2.3, 0.4)).unwrap();
        for curve in [EmitterCurve::Linear, EmitterCurve::Srgb, table] {
            let emitter = Emitter::new(&curve, Bits::Eight);
            assert_eq!((emitter.light(0), emitter.light(255)), (0.0, 1.0), "{curve:?}");
            for code in 0..=255 {
                assert_eq!(emitter.code(emitter.light(code)), code, "{curve:?}");
            }
            for n in 0..=1000 {
                let light = n as f32 / 1000.0;
                let off = |code: u16| (emitter.light(code) - light).abs();
                let nearest = (0..=255).map(off).fold(f32::MAX, f32::min);
                assert_eq!(off(emitter.code(light)), nearest, "{light} {curve:?}");
            }
        }
    }

    #[test]
    fn sixteen_bits_are_finer_by_257() {
        for curve in [EmitterCurve::Srgb, EmitterCurve::table("t", gamma(1.8, 0.0)).unwrap()] {
            let (fine, coarse) = (Emitter::new(&curve, Bits::Sixteen), Emitter::new(&curve, Bits::Eight));
            for code in 0..=255 {
                assert!((fine.light(code * 257) - coarse.light(code)).abs() < 1e-6);
            }
            assert!((fine.light(fine.code(0.123_456)) - 0.123_456).abs() < 2e-5);
        }
    }

    #[test]
    fn light_beyond_the_range_is_clipped_and_plateaus_give_their_lowest_code() {
        let mut flat = gamma(2.2, 1.0);
        flat[..20].fill(1.0);
        flat[250..].fill(81.0);
        let emitter = Emitter::new(&EmitterCurve::table("t", flat).unwrap(), Bits::Eight);
        assert_eq!([-1.0, 0.0, 1.0, 7.0, f32::NAN].map(|v| emitter.code(v)), [0, 0, 250, 250, 0]);
    }

    #[test]
    fn tables_are_read_and_mistakes_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("screen.txt");
        let lines = |columns: fn(f64) -> String| -> String {
            gamma(2.2, 0.3).iter().enumerate().map(|(code, light)| format!("{code} {}\n", columns(*light))).collect()
        };
        let read = |text: &str| {
            std::fs::write(&path, text).unwrap();
            EmitterCurve::read(&path)
        };
        let grey = read(&format!("# measured\n{}", lines(|v| format!("{v}")))).unwrap();
        let coloured = read(&lines(|v| format!("{} {v} {} # grey", 0.5 * v, 1.5 * v))).unwrap();
        let (EmitterCurve::Table(a), EmitterCurve::Table(b)) = (&grey, &coloured) else { panic!("tables") };
        assert!(a.iter().zip(b.iter()).all(|(a, b)| (a - b).abs() < 1e-12) && a[0] == 0.0 && a[255] == 1.0);
        let good = lines(|v| format!("{v}"));
        for (text, words) in [
            (String::new(), "0 codes"),
            (good.replace("\n7 ", "\nseven "), "line 8"),
            (good.replace("\n7 ", "\n8 "), "`7 LIGHT`"),
            (format!("{good}256 1\n"), "no more codes"),
            (good.replace("\n9 ", "\n9 -"), "code 9"),
            (good.replace("\n9 ", "\n9 9"), "code 10: found light"),
            ((0..256).map(|code| format!("{code} 3\n")).collect(), "more light than of code 0"),
            (format!("{good}{}", " ".repeat(2 << 20)), "bytes"),
        ] {
            let message = read(&text).unwrap_err().to_string();
            assert!(message.contains(words) && message.contains("screen.txt"), "`{words}` not in: {message}");
        }
    }
}
