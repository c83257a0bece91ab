//! Screens and projectors: the light that a code makes.
//!
//! `emitted(code) = white * (black + (1 - black) * g(code))`, `g` rising from 0 to 1: the truth for what is measured of a
//! display (6.3), and the light that `M` of the implicit method is made of.

use crate::error::{Error, Result};
use crate::image::srgb;

/// Codes of a display.
const CODES: usize = 256;

/// `g`: share of the range that a code lights.
#[derive(Debug, Clone, PartialEq)]
pub enum ScreenCurve {
    /// `(code / 255)^gamma`.
    Gamma(f64),
    /// The sRGB curve.
    Srgb,
    /// One number a code of 8 bits, rising from 0 to 1; between them (of deeper codes) it is linear.
    Table(Vec<f64>),
}

/// A display: each element (a screen's texel, a projector's square) emits what its code says, R, G and B by themselves.
#[derive(Debug, Clone, PartialEq)]
pub struct Screen {
    /// From codes to shares of the range.
    pub curve: ScreenCurve,
    /// What code 0 emits, as a share of code 255: 1 / contrast.
    pub black: f64,
    /// What code 255 emits, RGB: radiance of a screen, radiant intensity of a projector.
    pub white: [f32; 3],
}

impl Screen {
    /// A screen of contrast 1:1000 and gamma 2.2, as LCD screens are sold.
    pub fn monitor() -> Self {
        Self { curve: ScreenCurve::Gamma(2.2), black: 1e-3, white: [1.0; 3] }
    }

    /// A projector of contrast 1:300, as the thesis's (7.3).
    pub fn projector() -> Self {
        Self { black: 1.0 / 300.0, ..Self::monitor() }
    }

    /// Checks the figures; ask once, where they come in.
    ///
    /// # Errors
    /// [`Error::Invalid`] at `place`: a curve that does not rise from 0 to 1, a black level or white that no display has.
    pub fn check(&self, place: &str) -> Result<()> {
        let refuse = |field: &str, found: String, expected: &str| {
            Err(Error::invalid(format!("{place}, {field}"), found, expected))
        };
        match &self.curve {
            ScreenCurve::Gamma(gamma) if !(0.2..=5.0).contains(gamma) => {
                return refuse("gamma", format!("{gamma}"), "0.2 to 5");
            }
            ScreenCurve::Table(table) if table.len() != CODES => {
                return refuse("curve", format!("{} numbers", table.len()), "256, one a code");
            }
            ScreenCurve::Table(table) => {
                if let Some(code) = (1..CODES).find(|&code| table[code].is_nan() || table[code] < table[code - 1]) {
                    let found = format!("{} after {}", table[code], table[code - 1]);
                    return refuse(&format!("curve, code {code}"), found, "numbers that rise");
                }
                if (table[0], table[CODES - 1]) != (0.0, 1.0) {
                    let found = format!("{} to {}", table[0], table[CODES - 1]);
                    return refuse("curve", found, "numbers from 0 to 1");
                }
            }
            ScreenCurve::Gamma(_) | ScreenCurve::Srgb => {}
        }
        if !(0.0..1.0).contains(&self.black) {
            return refuse("black", format!("{}", self.black), "a share of white from 0 to below 1");
        }
        if !self.white.iter().all(|w| w.is_finite() && *w >= 0.0) {
            return refuse("white", format!("{:?}", self.white), "three numbers, none negative");
        }
        Ok(())
    }

    /// The share of white that an 8-bit code emits, black included.
    pub fn share(&self, code: u8) -> f64 {
        self.share_of(f64::from(code) / 255.0)
    }

    /// The same for codes of any depth: as shares of white's.
    fn share_of(&self, code: f64) -> f64 {
        let g = match &self.curve {
            ScreenCurve::Gamma(gamma) => code.powf(*gamma),
            ScreenCurve::Srgb => f64::from(srgb::decode(code as f32)),
            ScreenCurve::Table(table) => {
                let at = code * (CODES - 1) as f64;
                let low = (at as usize).min(CODES - 2);
                let entry = |n: usize| table.get(n).copied().unwrap_or(1.0);
                entry(low) + (at - low as f64) * (entry(low + 1) - entry(low))
            }
        };
        self.black + (1.0 - self.black) * g
    }

    /// What every element emits under a picture of codes up to `white` (those beyond emit as it does), RGB, in the order of the elements.
    pub fn emitted(&self, codes: &[[u16; 3]], white: u16) -> Vec<[f32; 3]> {
        let share = |code: u16| self.share_of(f64::from(code) / f64::from(white.max(1))) as f32;
        let table: Vec<f32> = (0..=white).map(share).collect();
        let element = |rgb: &[u16; 3]| std::array::from_fn(|c| table[usize::from(rgb[c].min(white))] * self.white[c]);
        codes.iter().map(element).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_run_from_black_to_white() {
        let screen = Screen { white: [2.0, 1.0, 0.5], ..Screen::projector() };
        let emitted = screen.emitted(&[[0; 3], [255; 3], [128, 0, 255]], 255);
        assert_eq!(emitted[1], [2.0, 1.0, 0.5]);
        assert!((emitted[1][0] / emitted[0][0] - 300.0).abs() < 1e-2);
        let grey = 1.0 / 300.0 + 299.0 / 300.0 * (128f64 / 255.0).powf(2.2);
        assert!((f64::from(emitted[2][0]) - 2.0 * grey).abs() < 1e-6 && emitted[2][2] == 0.5);
        let srgb = Screen { curve: ScreenCurve::Srgb, black: 0.0, white: [1.0; 3] };
        assert!((srgb.share(128) - 0.215_860_5).abs() < 1e-6);
        let table = (0..256).map(|c| f64::from(c) / 255.0).collect();
        let linear = Screen { curve: ScreenCurve::Table(table), ..srgb };
        assert!(linear.check("rig").is_ok() && (linear.share(51) - 0.2).abs() < 1e-12);
        // Ten bits: finer steps of the same curve.
        for display in [linear, Screen::monitor()] {
            let light = |code: u16, white: u16| display.emitted(&[[code; 3]], white)[0][0];
            assert_eq!((light(1023, 1023), light(0, 1023)), (light(255, 255), light(0, 255)));
            assert!((light(341, 1023) - light(85, 255)).abs() < 1e-6, "a third of white");
            assert!((1..=1023).all(|code| light(code, 1023) > light(code - 1, 1023)));
        }
    }

    #[test]
    fn impossible_displays_are_refused() {
        let table = |change: &dyn Fn(&mut Vec<f64>)| {
            let mut table = (0..256).map(|c| f64::from(c) / 255.0).collect();
            change(&mut table);
            Screen { curve: ScreenCurve::Table(table), ..Screen::monitor() }
        };
        for (screen, words) in [
            (Screen { curve: ScreenCurve::Gamma(f64::NAN), ..Screen::monitor() }, "gamma"),
            (Screen { black: 1.0, ..Screen::monitor() }, "black"),
            (Screen { white: [1.0, f32::INFINITY, 1.0], ..Screen::monitor() }, "white"),
            (table(&|t| t.truncate(255)), "255 numbers"),
            (table(&|t| t[77] = 0.9), "code 78"),
            (table(&|t| t[77] = f64::NAN), "code 77"),
            (table(&|t| t[255] = 2.0), "0 to 2"),
        ] {
            let message = screen.check("rig.toml").unwrap_err().to_string();
            assert!(message.contains(words), "{message}");
        }
        assert!(Screen::projector().check("rig").is_ok());
    }
}
