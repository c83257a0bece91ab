//! The response of a camera: what light each of its 256 codes stands for.

use std::io::Write;
use std::path::Path;

use crate::error::{Error, Result};
use crate::files::write_whole;
use crate::image::srgb;

/// Codes of an 8-bit channel.
pub const CODES: usize = 256;
/// The code that fixes the scale.
pub const ANCHOR: usize = 128;
/// A response file is some 10 kB; more than this is no response.
const LARGEST_FILE: u64 = 1 << 20;
/// Light of a response lies between these: 200 stops, and all of them normal numbers of f32.
const LIGHT: std::ops::RangeInclusive<f64> = 0.0..=1e30;

/// Linear light of each 8-bit code, R, G and B: the inverse of the camera's response function, strictly increasing.
///
/// Scale is arbitrary in what photographs tell (Debevec and Malik 1997, section 2.1), so it is fixed: code 128 of each
/// channel stands for the light it stands for in sRGB, 0.2158605, where white is 1. Grey of code 128 stays neutral.
#[derive(Debug, Clone, PartialEq)]
pub struct Response {
    light: Box<[[f64; CODES]; 3]>,
}

impl Response {
    /// From light of any scale, a table a channel; scaled to the anchor.
    ///
    /// # Errors
    /// [`Error::Invalid`] unless every table is finite, not negative and strictly increasing.
    pub fn new(place: &str, mut light: [[f64; CODES]; 3]) -> Result<Self> {
        for (table, channel) in light.iter_mut().zip(["red", "green", "blue"]) {
            let bad = |code: usize, found: String, expected: &str| {
                Err(Error::invalid(format!("{place}, code {code}, {channel}"), found, expected))
            };
            if let Some(code) = table.iter().position(|v| !LIGHT.contains(v)) {
                return bad(code, format!("{}", table[code]), "light between 0 and 1e30");
            }
            if let Some(code) = (1..CODES).find(|&code| table[code] <= table[code - 1]) {
                let found = format!("{} after {}", table[code], table[code - 1]);
                return bad(code, found, "light that rises from code to code");
            }
            let scale = f64::from(srgb::decode(ANCHOR as f32 / 255.0)) / table[ANCHOR];
            table.iter_mut().for_each(|v| *v *= scale);
        }
        Ok(Self { light: Box::new(light) })
    }

    /// The sRGB curve as a response.
    pub fn srgb() -> Self {
        let table = std::array::from_fn(|code| f64::from(srgb::decode(code as f32 / 255.0)));
        Self { light: Box::new([table; 3]) }
    }

    /// Light of each code of channel `c` (0 red, 1 green, 2 blue).
    ///
    /// # Panics
    /// When `c` is not a channel.
    pub fn channel(&self, c: usize) -> &[f64; CODES] {
        &self.light[c]
    }

    /// Light of a code between 0 and 1 of channel `c`, also between two of the 256: cubic pieces that rise as the table does
    /// (F. Fritsch and J. Butland, "A method for constructing local monotone piecewise cubic interpolants", SIAM J. Sci.
    /// Stat. Comput. 5, 1984). The light of a gamma of 2.4 is hit to 0.1 % from code 5 of 255 on, where straight lines
    /// err by 1.6 %. Codes outside are taken for the nearest.
    ///
    /// # Panics
    /// When `c` is not a channel.
    pub fn light(&self, c: usize, code: f64) -> f64 {
        let table = &self.light[c];
        let at = code.clamp(0.0, 1.0) * (CODES - 1) as f64;
        let z = (at as usize).min(CODES - 2);
        let (t, rise) = (at - z as f64, table[z + 1] - table[z]);
        let (from, to) = (slope(table, z), slope(table, z + 1));
        // Hermite's cubic over [z, z + 1] with these slopes.
        let curve = (from + to - 2.0 * rise) * t + (3.0 * rise - 2.0 * from - to);
        table[z] + t * (from + t * curve)
    }

    /// The code between 0 and 1 that stands for this light in channel `c`: the inverse of [`Response::light`].
    ///
    /// # Panics
    /// When `c` is not a channel.
    pub fn code(&self, c: usize, light: f64) -> f64 {
        let above = self.light[c].partition_point(|v| *v <= light);
        let last = (CODES - 1) as f64;
        let (mut low, mut high) = (above.saturating_sub(1) as f64 / last, (above as f64 / last).min(1.0));
        // Fifty halvings of one code: the precision of f64.
        for _ in 0..50 {
            let middle = 0.5 * (low + high);
            if self.light(c, middle) < light { low = middle } else { high = middle }
        }
        0.5 * (low + high)
    }

    /// Writes a text file: comments behind `#`, then a line for each code: code, red, green, blue.
    ///
    /// # Errors
    /// The disk's.
    pub fn write(&self, path: &Path) -> Result<()> {
        write_whole(path, |out| {
            let mut body = || {
                writeln!(out, "# Camera response of relume: the linear light that each 8-bit code stands for.")?;
                writeln!(out, "# Scale: code 128 is 0.2158605, as in sRGB, where white is 1.")?;
                writeln!(out, "# code red green blue")?;
                let [r, g, b] = &*self.light;
                (0..CODES).try_for_each(|z| writeln!(out, "{z} {:.8e} {:.8e} {:.8e}", r[z], g[z], b[z]))
            };
            body().map_err(|source| Error::io("write", path, source))
        })
    }

    /// Reads what [`Response::write`] wrote. Light of any scale is taken, and scaled.
    ///
    /// # Errors
    /// [`Error::Invalid`] with the line: not four numbers, codes out of order, missing codes, light that does not rise.
    pub fn read(path: &Path) -> Result<Self> {
        let failed = |source| Error::io("read", path, source);
        let place = path.display().to_string();
        let size = std::fs::metadata(path).map_err(failed)?.len();
        if size > LARGEST_FILE {
            return Err(Error::invalid(place, format!("{size} bytes"), "a response file of 256 lines"));
        }
        let bytes = std::fs::read(path).map_err(failed)?;
        let text = String::from_utf8(bytes).map_err(|_| Error::invalid(&place, "bytes that are no text", EXPECTED))?;
        let mut light = [[0.0; CODES]; 3];
        let mut codes = 0;
        for (number, line) in text.lines().enumerate() {
            let line = line.split('#').next().unwrap_or_default().trim();
            if line.is_empty() {
                continue;
            }
            let Some([code, rgb @ ..]) = numbers(line).filter(|v| v[0] == codes as f64 && codes < CODES) else {
                let expected = if codes < CODES { format!("`{codes} RED GREEN BLUE`") } else { "no more codes".into() };
                return Err(Error::invalid(format!("{place}, line {}", number + 1), format!("`{line}`"), expected));
            };
            (0..3).for_each(|c| light[c][code as usize] = rgb[c]);
            codes += 1;
        }
        if codes != CODES {
            return Err(Error::invalid(place, format!("{codes} codes"), EXPECTED));
        }
        Self::new(&place, light)
    }
}

/// Slope of the interpolant at a knot: the harmonic mean of the rises on either side, which never overshoots; at the ends
/// the only one.
fn slope(table: &[f64; CODES], z: usize) -> f64 {
    let rise = |z: usize| table[z + 1] - table[z];
    match z {
        0 => rise(0),
        z if z == CODES - 1 => rise(z - 1),
        z => {
            let (before, after) = (rise(z - 1), rise(z));
            2.0 * before * after / (before + after)
        }
    }
}

const EXPECTED: &str = "a response file: 256 lines `CODE RED GREEN BLUE`";

fn numbers(line: &str) -> Option<[f64; 4]> {
    let values: Vec<f64> = line.split_whitespace().map(str::parse).collect::<Result<_, _>>().ok()?;
    values.try_into().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn between_codes_the_curve_rises_and_returns() {
        let gamma = std::array::from_fn(|z| (z as f64 / 255.0).powf(2.4));
        let response = Response::new("test", [gamma; 3]).unwrap();
        let scale = response.channel(0)[255];
        let (mut worst, mut last) = (0.0f64, -1.0);
        for k in 0..=4095 {
            let code = f64::from(k) / 4095.0;
            let light = response.light(1, code);
            assert!(light > last, "{k}");
            last = light;
            if code >= 5.0 / 255.0 {
                worst = worst.max((light / scale / code.powf(2.4) - 1.0).abs());
            }
            assert!((response.code(1, light) - code).abs() < 1e-9, "{k}");
        }
        assert!(worst < 1e-3, "{worst}");
        assert!((0..256).all(|z| (response.light(0, z as f64 / 255.0) - response.channel(0)[z]).abs() < 1e-12));
        assert_eq!((response.code(0, -1.0), response.code(0, 1e9)), (0.0, 1.0));
    }

    #[test]
    fn a_file_gives_the_response_back() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("camera.txt");
        let curve = |gamma: f64| std::array::from_fn(|z| (0.01 + z as f64 / 255.0).powf(gamma));
        let response = Response::new("test", [curve(1.8), curve(2.0), curve(2.4)]).unwrap();
        response.write(&path).unwrap();
        let back = Response::read(&path).unwrap();
        for c in 0..3 {
            let pairs = response.channel(c).iter().zip(back.channel(c));
            assert!(pairs.clone().all(|(a, b)| (a / b - 1.0).abs() < 1e-7));
            assert!((back.channel(c)[ANCHOR] - 0.215_860_5).abs() < 1e-6);
        }
    }

    #[test]
    fn bad_files_are_named_with_their_line() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("camera.txt");
        Response::srgb().write(&path).unwrap();
        let good = std::fs::read_to_string(&path).unwrap();
        let edit = |line: usize, with: &str| {
            let mut lines: Vec<&str> = good.lines().collect();
            lines[line] = with;
            lines.join("\n")
        };
        for (text, words) in [
            (String::new(), "found 0 codes"),
            (edit(10, ""), "line 12"),
            (edit(10, "7 0.1 0.2"), "line 11"),
            (edit(10, "7 0.1 0.2 x"), "`7 0.1 0.2 x`"),
            (edit(10, "7 0.0021 0.0021 nan"), "code 7, blue: found NaN"),
            (edit(10, "7 0.0021 -1 0.0021"), "code 7, green: found -"),
            (edit(10, "7 0 0 0"), "light that rises"),
            (good.clone() + "256 2 2 2\n", "no more codes"),
            (good.lines().take(100).collect::<Vec<_>>().join("\n"), "97 codes"),
        ] {
            std::fs::write(&path, text).unwrap();
            let message = Response::read(&path).unwrap_err().to_string();
            assert!(message.contains("camera.txt") && message.contains(words), "{words} is not in: {message}");
        }
        std::fs::write(&path, [0xff, 0xfe, 0x00]).unwrap();
        assert!(Response::read(&path).unwrap_err().to_string().contains("no text"));
    }
}
