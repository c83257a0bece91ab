//! `relume calibrate gamma`: the curve of a screen or projector.

use std::io::Write;
use std::path::{Path, PathBuf};

use clap::Args;
use relume_core::calibrate::emitter::{Measured, Ramp};
use relume_core::files::{check_folder, write_whole};
use relume_core::image::{Image, read};
use relume_core::{Error, Result};

use super::input::Captured;
use crate::commands::import::{EncodingChoice, one_size, pictures};
use crate::commands::{note, values};
use crate::progress::{Progress, Unit};
use crate::rigs::Condition;
use crate::session::{Photograph, Role};

const EXAMPLES: &str = "\
Examples:
  relume calibrate gamma glass-session -o screen.txt
  relume calibrate gamma ramp-photographs -o screen.txt
  relume calibrate gamma 0.exr 64.exr 128.exr 192.exr 255.exr --codes 0,64,128,192,255 -o screen.txt
  relume patterns noise -o noise --encode screen.txt

Show every grey level over the whole screen (`relume patterns ramp`), or some of them with 0 and 255,
and photograph each with the same exposure, or merged from several (`relume hdr`). Only ratios count,
so it does not matter what else is in the picture as long as nothing moves.";

/// The curve differs between channels by no more than that in screens whose greys are grey.
const TINTED: f64 = 0.02;

/// Raw flags.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    /// A session that was captured with the ramp among its calibration patterns; or the photographs, or their folder.
    #[arg(required = true)]
    photographs: Vec<PathBuf>,
    /// The code of each photograph, in the order of their names [default: 0 to 255, of 256 photographs].
    #[arg(long, value_name = "N,N...", value_parser = values::codes)]
    codes: Option<values::Codes>,
    /// How the photographs' numbers become light [default: sRGB for 8 and 16 bits, linear for floats].
    #[arg(long, value_enum)]
    encoding: Option<EncodingChoice>,
    /// The table to write, for --encode and --emitted.
    #[arg(short, long, value_name = "FILE.txt")]
    output: Option<PathBuf>,
}

impl Arguments {
    /// Measures, says, and writes.
    pub fn run(self) -> anyhow::Result<String> {
        self.output.as_deref().map(check_folder).transpose()?;
        let measured = match &self.photographs[..] {
            [one] if one.join("session.toml").is_file() => self.of_session(one)?,
            _ => self.of_files()?,
        };
        if measured.tint() > TINTED {
            note(&format!(
                "the channels' curves differ by up to {:.1} % of white: its greys are tinted, and the mean is used",
                100.0 * measured.tint()
            ));
        }
        let mut report = format!(
            "{} codes, nearest power {:.3}, noise {:.3} % of white\n",
            measured.codes.len(),
            measured.gamma(),
            100.0 * measured.uneven
        );
        if let Some(output) = &self.output {
            measured.curve()?;
            write_whole(output, |out| {
                out.write_all(measured.text().as_bytes()).map_err(|source| Error::io("write", output, source))
            })?;
            report += &format!("{}: for --encode and --emitted\n", output.display());
        }
        Ok(report)
    }

    fn of_session(&self, session: &Path) -> anyhow::Result<Measured> {
        anyhow::ensure!(
            self.codes.is_none() && self.encoding.is_none(),
            "--codes and --encoding are for photographs; a session knows both"
        );
        let captured = Captured::open(session)?;
        let code = |photograph: &Photograph| match &photograph.condition {
            Condition::Pattern { set, number, .. } if set == "ramp" => u8::try_from(*number).ok(),
            _ => None,
        };
        let ramp: Vec<(u8, &Photograph)> =
            captured.records.of(Role::Calibration).filter_map(|p| Some((code(p)?, p))).collect();
        if ramp.is_empty() {
            let expected = "\"ramp\" in `patterns` under [calibration] of the rig file";
            return Err(Error::invalid(session.display().to_string(), "no photographs of grey levels", expected).into());
        }
        let codes: Vec<u8> = ramp.iter().map(|(code, _)| *code).collect();
        Ok(measure(&codes, &mut |n| captured.developer.picture(&captured.records, ramp[n].1))?)
    }

    fn of_files(&self) -> anyhow::Result<Measured> {
        let files = match &self.photographs[..] {
            [folder] if folder.is_dir() => pictures(folder)?,
            files => files.to_vec(),
        };
        one_size(files.iter())?;
        let codes = match &self.codes {
            Some(codes) => codes.0.clone(),
            None => (0..=255).collect(),
        };
        if codes.len() != files.len() {
            let expected = "one a code: 256, or those of --codes";
            let found = format!("{} photographs for {} codes", files.len(), codes.len());
            return Err(Error::invalid("grey levels", found, expected).into());
        }
        let encoding = EncodingChoice::of(self.encoding);
        Ok(measure(&codes, &mut |n| read(&files[n], encoding))?)
    }
}

/// Black and white first, then each.
fn measure(codes: &[u8], picture: &mut dyn FnMut(usize) -> Result<Image>) -> Result<Measured> {
    let find = |wanted: u8| {
        let expected = "photographs of codes 0 and 255 among them";
        let found = || Error::invalid("grey levels", format!("none of code {wanted}"), expected);
        codes.iter().position(|code| *code == wanted).ok_or_else(found)
    };
    let (black, white) = (picture(find(0)?)?, picture(find(255)?)?);
    let mut ramp = Ramp::new(&black, &white)?;
    let mut progress = Progress::new("measuring", Unit::Steps);
    for (n, code) in codes.iter().enumerate() {
        if (1..255).contains(code) {
            ramp.add(*code, &picture(n)?)?;
        }
        progress.step(n as u64 + 1, codes.len() as u64)?;
    }
    ramp.finish()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::commands::testing;

    #[test]
    fn wrong_usage_is_refused_by_the_parser() {
        for line in
            ["gamma", "gamma a --codes 0,256", "gamma a --codes 0,0", "gamma a --codes x", "gamma a --codes 1.5"]
        {
            assert!(testing::parse::<Arguments>(line).is_err(), "{line}");
        }
        assert!(testing::parse::<Arguments>("gamma a b c --codes 0,128,255").is_ok());
    }
}
