//! A folder of one-light-at-a-time photographs with its `.lp` file -> a container.
//!
//! `T_j = (photo_j - S) / E_j` (design conventions: transport is the response to unit irradiance).

use std::path::{Path, PathBuf};

use rayon::prelude::*;

use super::Photographs;
use super::measured::{Measured, PerLamp};
use super::photographs::Reporting;
use crate::calibrate::Correction;
use crate::domain::{Directions, lp};
use crate::error::{Error, Result};
use crate::field::{BLOCK_HEIGHT, Contents, Precision, write};
use crate::files::{check_folder, folder_of};
use crate::image::{ColourSpace, Encoding, Image, probe_size, read};

/// What to import, and how.
#[derive(Debug, Clone)]
pub struct ImportLp {
    /// The `.lp` file; photographs are found relative to it.
    pub lp: PathBuf,
    /// How the photographs' numbers become light.
    pub encoding: Encoding,
    /// The photograph with every lamp off: subtracted, and kept as ambient `S`.
    pub black: Option<PathBuf>,
    /// A picture of the object's coverage (its mean over the channels, taken as it is stored, without a curve).
    pub alpha: Option<PathBuf>,
    /// E: the irradiance of every lamp on a patch facing it. pi makes a white diffuser facing the lamp photograph as 1.
    pub irradiance: f32,
    /// The colours of the photographs: of their primaries, once decoded to light.
    pub colour_space: ColourSpace,
    /// What was measured of the lamps one by one; its table goes before `irradiance`.
    pub measured: Measured,
    /// How `T` is stored.
    pub precision: Precision,
    /// What to do with vectors that are not of unit length.
    pub lengths: lp::Lengths,
    /// Lamps to leave out, counted from 1 in the order of the `.lp` file: those that were dark or hidden. The rest close up.
    pub exclude: Vec<usize>,
    /// White balance of every photograph, the black one included.
    pub correction: Option<Correction>,
}

/// What an import made.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Imported {
    /// Photographs.
    pub lamps: usize,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
}

/// What a look at the `.lp` file and the headers of all photographs found.
#[derive(Debug, Clone, PartialEq)]
pub struct Checked {
    /// The photographs and their directions, without those left out.
    pub lp: lp::Lp,
    /// Columns, of every picture.
    pub width: usize,
    /// Rows, of every picture.
    pub height: usize,
}

impl ImportLp {
    /// Checks everything that can be checked without decoding: the `.lp` file, that all pictures are there, are pictures,
    /// and have one size. A mistake in the last file does not cost an hour.
    ///
    /// # Errors
    /// As [`ImportLp::run`].
    pub fn check(&self) -> Result<Checked> {
        if !(self.irradiance.is_finite() && self.irradiance > 0.0) {
            return Err(Error::invalid("irradiance", self.irradiance.to_string(), "a positive number"));
        }
        let mut lp = lp::read(&self.lp, self.lengths)?;
        self.leave_out(&mut lp)?;
        let (width, height) = self.check_sizes(&lp)?;
        self.measured.check(&lp.photographs, (width, height))?;
        Ok(Checked { lp, width, height })
    }

    /// Reads, checks and writes. `progress(steps done, all)` may stop it with an error; a step is a photograph read or a row
    /// of blocks written. Memory: about 2 GB beyond which photographs are spilled beside `output`.
    ///
    /// # Errors
    /// Each names its file: a bad `.lp`, a photograph that is missing, unreadable or of another size, a folder that is
    /// absent or full. Nothing is left behind.
    pub fn run(&self, output: &Path, progress: &mut dyn FnMut(u64, u64) -> Result<()>) -> Result<Imported> {
        check_folder(output)?;
        let Checked { lp, width, height } = self.check()?;
        let per_lamp = self.measured.check(&lp.photographs, (width, height))?;
        let irradiances = per_lamp.irradiances(lp.photographs.len(), self.irradiance);
        let black = self.black.as_deref().map(|path| self.photograph(path)).transpose()?;
        let alpha = self.alpha.as_deref().map(coverage).transpose()?;
        let domain = Directions::new(lp.directions)?;
        let mut photographs = Photographs::new(width, height, folder_of(output));
        let total = (lp.photographs.len() + height.div_ceil(BLOCK_HEIGHT)) as u64;
        // As many at a time as there are threads: their order stays, memory stays bounded.
        let all: Vec<usize> = (0..lp.photographs.len()).collect();
        for group in all.chunks(rayon::current_num_threads()) {
            let picture = |&n: &usize| self.transport(&lp.photographs[n], n, irradiances[n], &per_lamp, black.as_ref());
            let pictures: Vec<Result<Image>> = group.par_iter().map(picture).collect();
            for picture in pictures {
                photographs.push(picture?)?;
            }
            progress(photographs.len() as u64, total)?;
        }
        let contents = Contents {
            irradiance: irradiances,
            domain: domain.into(),
            width,
            height,
            colour_space: self.colour_space,
            precision: self.precision,
            largest: photographs.largest(),
            ambient: black,
            alpha,
            reliability: None,
            provenance: self.provenance(&lp.photographs, &per_lamp),
        };
        write(output, &contents, &mut Reporting { photographs: &mut photographs, progress, total })?;
        Ok(Imported { lamps: photographs.len(), width, height })
    }

    /// Drops the lamps that are to be left out.
    fn leave_out(&self, lp: &mut lp::Lp) -> Result<()> {
        let count = lp.photographs.len();
        let refuse = |found: String, expected: String| {
            Err(Error::invalid(format!("lamps left out of {}", self.lp.display()), found, expected))
        };
        if let Some(wrong) = self.exclude.iter().find(|n| !(1..=count).contains(*n)) {
            return refuse(format!("number {wrong}"), format!("1 to {count}, in the order of the file"));
        }
        let kept = |n: &usize| !self.exclude.contains(&(n + 1));
        if !(0..count).any(|n| kept(&n)) {
            return refuse(format!("all {count} of them"), "at least one lamp that stays".to_owned());
        }
        lp.photographs = (0..count).filter(kept).map(|n| lp.photographs[n].clone()).collect();
        lp.directions = (0..count).filter(kept).map(|n| lp.directions[n]).collect();
        Ok(())
    }

    fn check_sizes(&self, lp: &lp::Lp) -> Result<(usize, usize)> {
        let first = &lp.photographs[0];
        let size = probe_size(first)?;
        let others = lp.photographs.iter().skip(1).chain(&self.black).chain(&self.alpha);
        for path in others {
            let other = probe_size(path)?;
            if other != size {
                let expected = format!("{} x {} pixels, as {} has", size.0, size.1, first.display());
                return Err(Error::invalid(
                    path.display().to_string(),
                    format!("{} x {} pixels", other.0, other.1),
                    expected,
                ));
            }
        }
        Ok(size)
    }

    fn photograph(&self, path: &Path) -> Result<Image> {
        let mut picture = read(path, self.encoding)?.into_rgb();
        if let Some(correction) = &self.correction {
            correction.apply(&mut picture);
        }
        Ok(picture)
    }

    /// `(photo - S) / E` of lamp `n`, evened out where it stands near.
    fn transport(
        &self,
        path: &Path,
        n: usize,
        irradiance: f32,
        lamps: &PerLamp,
        black: Option<&Image>,
    ) -> Result<Image> {
        let mut picture = self.photograph(path)?;
        if let Some(black) = black {
            picture.data_mut().iter_mut().zip(black.data()).for_each(|(t, s)| *t -= s);
        }
        lamps.even_out(n, &mut picture, self.encoding, black)?;
        let per_irradiance = 1.0 / irradiance;
        picture.data_mut().iter_mut().for_each(|t| *t *= per_irradiance);
        Ok(picture)
    }

    fn provenance(&self, photographs: &[PathBuf], per_lamp: &PerLamp) -> serde_json::Value {
        let name = |path: &Path| path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let mut excluded = self.exclude.clone();
        excluded.sort_unstable();
        excluded.dedup();
        serde_json::json!({
            "source": "import lp",
            "lp": name(&self.lp),
            "encoding": format!("{:?}", self.encoding).to_lowercase(),
            "black": self.black.as_deref().map(name),
            "measured": per_lamp.provenance(self.measured.lamps.as_deref()),
            "alpha": self.alpha.as_deref().map(name),
            "excluded": excluded,
            "white_balance": self.correction.map(|correction| *correction.rows()),
            "photographs": photographs.iter().map(|path| name(path)).collect::<Vec<_>>(),
        })
    }
}

/// The object's coverage from a picture: numbers as stored, mean over the channels, clamped to 0..1; row by row from the top.
///
/// # Errors
/// A picture that cannot be read.
pub fn coverage(path: &Path) -> Result<Vec<f32>> {
    let picture = read(path, Encoding::Linear)?;
    let mean = |pixel: &[f32]| (pixel[..3].iter().sum::<f32>() / 3.0).clamp(0.0, 1.0);
    Ok(picture.data().chunks_exact(picture.channels()).map(mean).collect())
}
