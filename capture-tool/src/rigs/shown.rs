//! What a screen or projector shows under a condition: codes of texels, the same for real and virtual ones.

use std::path::PathBuf;

use relume_core::domain::Emitter;
use relume_core::domain::patterns::PatternSet;
use relume_core::image::{Encoding, read};
use relume_core::{Error, Result};

use super::{Condition, RigFile};
use crate::capture::patterns::Sets;
use crate::devices::Texels;

/// Codes of every condition of a rig's screen.
#[derive(Debug)]
pub struct Shown {
    columns: usize,
    rows: usize,
    /// What the operator takes the screen's curve for.
    assumed: Emitter,
    sets: Sets,
    references: PathBuf,
}

impl Shown {
    /// Of a rig. `references` is where pictures to be shown lie.
    ///
    /// # Errors
    /// A rig without a screen; a curve that is none.
    pub fn new(rig: &RigFile, sets: Sets, references: PathBuf) -> Result<Self> {
        let (columns, rows) = rig.texels()?;
        let curve = match (&rig.monitor, &rig.gantry) {
            (Some(monitor), _) => monitor.curve.curve()?,
            (None, Some(gantry)) => gantry.curve.curve()?,
            (None, None) => return Err(Error::invalid("rig", "no screen and no projector", "one")),
        };
        Ok(Self { columns, rows, assumed: Emitter::new(&curve, rig.bits()), sets, references })
    }

    /// The codes of a condition.
    ///
    /// # Errors
    /// A condition that no screen shows; a picture that cannot be read.
    pub fn texels(&self, condition: &Condition) -> Result<Texels> {
        let white = self.assumed.white();
        let all = |code: u16| vec![[code; 3]; self.columns * self.rows];
        let codes = match condition {
            Condition::Black { .. } => all(0),
            Condition::White { .. } => all(white),
            Condition::Pattern { set, number, .. } => {
                let known = self.sets.get(set).filter(|s| *number < s.len());
                let set = known.ok_or_else(|| Error::invalid("pattern", condition.to_string(), "one of the rig's"))?;
                pattern_codes(set, *number, &self.assumed)
            }
            Condition::Picture(name) => self.picture(name)?,
            other => return Err(Error::invalid("a screen", other.to_string(), "black, white, a pattern or a picture")),
        };
        Ok(Texels { columns: self.columns, rows: self.rows, white, codes })
    }

    /// A picture's codes as they stand in its file, at the screen's size.
    fn picture(&self, name: &str) -> Result<Vec<[u16; 3]>> {
        let picture = read(&self.references.join(name), Encoding::Linear)?.into_rgb();
        let (w, h) = picture.size();
        let white = f32::from(self.assumed.white());
        let code = |v: f32| (v.clamp(0.0, 1.0) * white).round() as u16;
        let texel = |at: usize| {
            let (x, y) = (at % self.columns, at / self.columns);
            let pixel = picture.pixel((2 * x + 1) * w / (2 * self.columns), (2 * y + 1) * h / (2 * self.rows));
            [code(pixel[0]), code(pixel[1]), code(pixel[2])]
        };
        Ok((0..self.columns * self.rows).map(texel).collect())
    }
}

/// Codes of a pattern; grey. The ramp's 256 levels are the nearest codes of deeper screens too: `relume calibrate gamma` takes level n for n / 255 of
/// white's code, which is right to half a code.
fn pattern_codes(set: &PatternSet, number: usize, assumed: &Emitter) -> Vec<[u16; 3]> {
    let pattern = set.pattern(number);
    let white = assumed.white();
    let codes = if set.is_codes() {
        pattern.values.iter().map(|v| (v * f32::from(white)).round() as u16).collect()
    } else {
        pattern.codes(assumed)
    };
    codes.into_iter().map(|code| [code.min(white); 3]).collect()
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use relume_core::domain::{Bits, EmitterCurve};

    use super::*;
    use crate::capture::patterns::{Samples, sets};

    fn shown(bits: u8) -> Shown {
        let text = std::fs::read_to_string("../presets/rigs/virtual-monitor.toml").unwrap();
        let screen =
            format!("[devices]\ncamera = {{ driver = \"virtual\" }}\nscreen = {{ driver = \"x11\", bits = {bits} }}\n");
        let text =
            format!("{}\n{screen}", text.replace("[\"ramp\", \"gray-code\", \"stripes\"]", "[\"ramp\", \"stripes\"]"));
        let rig = RigFile::parse(&text, Path::new("rig.toml")).unwrap();
        let sets = sets(&rig, Samples::Noise, 1).unwrap();
        Shown::new(&rig, sets, PathBuf::new()).unwrap()
    }

    #[test]
    fn ten_bits_are_finer_steps_of_the_same_light() {
        let (coarse, fine) = (shown(8), shown(10));
        let pattern = |set: &str, number: usize| Condition::Pattern { set: set.to_owned(), number, stop: 0 };
        let codes = |shown: &Shown, condition: &Condition| shown.texels(condition).unwrap();
        assert_eq!(codes(&fine, &Condition::White { stop: 0 }).codes[0], [1023; 3]);
        for level in [0, 1, 77, 254, 255] {
            let found = codes(&fine, &pattern("ramp", level)).codes[0][0];
            assert_eq!(found, (level as f64 / 255.0 * 1023.0).round() as u16);
            assert_eq!(codes(&coarse, &pattern("ramp", level)).codes[0][0], level as u16);
        }
        let stripes = codes(&fine, &pattern("stripes", 0));
        assert!(stripes.codes.iter().all(|code| code[0] == 0 || code[0] == 1023) && stripes.white == 1023);
        // Noise: the light that was asked for, to half a step of its codes.
        let emitters = [Bits::Eight, Bits::Ten].map(|bits| Emitter::new(&EmitterCurve::Srgb, bits));
        let light = |emitter: &Emitter, texels: &Texels| -> Vec<f32> {
            texels.codes.iter().map(|code| emitter.light(code[0])).collect()
        };
        let (a, b) = (codes(&coarse, &pattern("noise", 5)), codes(&fine, &pattern("noise", 5)));
        let wanted = fine.sets["noise"].pattern(5).values;
        let off = |light: &[f32]| light.iter().zip(&wanted).map(|(l, w)| (l - w).abs()).fold(0.0, f32::max);
        let [eight, ten] = [off(&light(&emitters[0], &a)), off(&light(&emitters[1], &b))];
        assert!(ten < 0.0012 && eight > 3.0 * ten, "{eight} {ten}");
    }
}
