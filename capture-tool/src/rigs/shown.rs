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

/// Codes of a pattern; grey.
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
