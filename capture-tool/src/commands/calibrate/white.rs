//! `relume calibrate white`: gains from a patch, or a colour matrix from a chart.

use std::io::Write;
use std::path::{Path, PathBuf};

use clap::Args;
use relume_core::Error;
use relume_core::calibrate::chart::{self, Point};
use relume_core::calibrate::{Correction, patch, white};
use relume_core::files::{check_folder, write_whole};
use relume_core::image::{Image, Window, read};
use serde::{Deserialize, Serialize};

use crate::commands::import::EncodingChoice;
use crate::commands::{note, values};

const EXAMPLES: &str = "\
Examples:
  relume calibrate white card.jpg --patch 210,140,60,40
  relume calibrate white card.exr --patch 210,140,60,40 --reflectance 0.18,0.18,0.18 -o white.toml
  relume calibrate white chart.tif --chart 112,80,540,84,536,360,110,352 -o colour.toml
  relume import lp photographs/dirs.lp -o vase.rfield --white-balance white.toml

The chart is a ColorChecker Classic; its colours are the maker's for charts made after November 2014.";

/// From this mean difference on, the fit is no good: the corners or the chart are others.
const POOR: f64 = 10.0;

/// Raw flags.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    /// The photograph, made with the camera and the lamps of the set (EXR, HDR, PNG, TIFF, JPEG).
    photograph: PathBuf,
    #[command(flatten)]
    target: Target,
    /// Reflectance of the patch; only ratios count [default: 1,1,1].
    #[arg(long, value_name = "R,G,B", conflicts_with = "chart", allow_hyphen_values = true, value_parser = values::three_positive)]
    reflectance: Option<[f64; 3]>,
    /// How the photograph's numbers become light [default: sRGB for 8 and 16 bits, linear for floats].
    #[arg(long, value_enum)]
    encoding: Option<EncodingChoice>,
    /// A .toml file to write, for --white-balance.
    #[arg(short, long, value_name = "FILE.toml")]
    output: Option<PathBuf>,
}

/// What is in the photograph.
#[derive(Debug, Args)]
#[group(required = true, multiple = false)]
struct Target {
    /// A white or grey patch: left, top, width and height in pixels.
    #[arg(long, value_name = "X,Y,W,H", allow_hyphen_values = true, value_parser = values::four_counts)]
    patch: Option<[usize; 4]>,
    /// A chart of 24 patches: the middles of its corner patches dark skin, bluish green, black and white, in pixels.
    #[arg(long, value_name = "X1,Y1,...,X4,Y4", allow_hyphen_values = true, value_parser = values::eight_numbers)]
    chart: Option<[f64; 8]>,
}

/// The file: gains or a matrix.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    #[serde(skip_serializing_if = "Option::is_none")]
    gains: Option<[f64; 3]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    matrix: Option<[[f64; 3]; 3]>,
}

impl Arguments {
    /// Measures, says, and writes.
    pub fn run(self) -> anyhow::Result<String> {
        self.output.as_deref().map(check_folder).transpose()?;
        let photograph = read(&self.photograph, EncodingChoice::of(self.encoding))?.into_rgb();
        let place = self.photograph.display().to_string();
        let (file, mut report) = match (self.target.patch, self.target.chart) {
            (Some(at), None) => from_patch(&photograph, at, self.reflectance.unwrap_or([1.0; 3]), &place)?,
            (None, Some(corners)) => from_chart(&photograph, corners, &place)?,
            _ => anyhow::bail!("give --patch or --chart"),
        };
        if let Some(output) = &self.output {
            let text = toml::to_string(&file)?;
            write_whole(output, |out| {
                out.write_all(text.as_bytes()).map_err(|source| Error::io("write", output, source))
            })?;
            report += &format!("{}: for --white-balance\n", output.display());
        }
        Ok(report)
    }
}

fn from_patch(
    photograph: &Image,
    [x, y, w, h]: [usize; 4],
    reflectance: [f64; 3],
    place: &str,
) -> anyhow::Result<(File, String)> {
    let window = Window { x0: x, y0: y, x1: x.saturating_add(w), y1: y.saturating_add(h) };
    let seen = patch(photograph, window, place)?;
    let correction = white(seen, reflectance)?;
    let rows = correction.rows();
    let gains = [rows[0][0], rows[1][1], rows[2][2]];
    let three = |v: [f64; 3]| v.map(|v| format!("{v:.5}")).join(",");
    let report = format!("patch {}\ngains {}\n", three(seen), three(gains));
    Ok((File { gains: Some(gains), matrix: None }, report))
}

fn from_chart(photograph: &Image, corners: [f64; 8], place: &str) -> anyhow::Result<(File, String)> {
    let corners = std::array::from_fn(|n| Point { x: corners[2 * n], y: corners[2 * n + 1] });
    let fit = chart::fit(photograph, corners, place)?;
    let (worst, difference) = fit.worst();
    let mean = fit.mean_difference();
    if mean > POOR {
        note(
            "the colours do not fit: are the corners dark skin, bluish green, black, white, and is the encoding right?",
        );
    }
    let row = |row: &[f64; 3]| format!("  {:9.5} {:9.5} {:9.5}\n", row[0], row[1], row[2]);
    let matrix: String = fit.correction.rows().iter().map(row).collect();
    let report = format!(
        "matrix to linear Rec.709\n{matrix}times {:.4} gives reflectance\n\
         colour difference (CIE 1976): mean {mean:.2}, largest {difference:.2} ({worst})\n",
        fit.exposure
    );
    Ok((File { gains: None, matrix: Some(*fit.correction.rows()) }, report))
}

/// Reads a file that this command wrote, or one like it.
pub(in super::super) fn read_correction(path: &Path) -> anyhow::Result<Correction> {
    let text = std::fs::read_to_string(path).map_err(|source| Error::io("read", path, source))?;
    let place = path.display().to_string();
    let file: File = toml::from_str(&text).map_err(|error| {
        Error::invalid(
            &place,
            error.message().to_owned(),
            "`gains = [r, g, b]` or `matrix`, as `relume calibrate white -o` writes",
        )
    })?;
    match (file.gains, file.matrix) {
        (Some(gains), None) => Ok(Correction::gains(gains)?),
        (None, Some(matrix)) => Ok(Correction::matrix(matrix)?),
        _ => Err(Error::invalid(place, "neither or both of `gains` and `matrix`", "one of them").into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::commands::testing;

    #[test]
    fn wrong_usage_is_refused_by_the_parser() {
        let parse = |line: &str| testing::parse::<Arguments>(line);
        for line in [
            "white a.png",
            "white a.png --patch 1,2,3",
            "white a.png --patch 1,2,3,4,5",
            "white a.png --patch -1,2,3,4",
            "white a.png --patch 1,2,3,x",
            "white a.png --patch 1,2,0,4",
            "white a.png --patch 1,2,3,4 --chart 1,2,3,4,5,6,7,8",
            "white a.png --chart 1,2,3,4,5,6,7",
            "white a.png --chart 1,2,3,4,5,6,7,nan",
            "white a.png --patch 1,2,3,4 --reflectance 1,0,1",
            "white a.png --patch 1,2,3,4 --reflectance 1,-1,1",
            "white a.png --chart 1,2,3,4,5,6,7,8 --reflectance 1,1,1",
        ] {
            assert!(parse(line).is_err(), "{line}");
        }
        assert!(parse("white a.png --chart 1,2,3.5,4,5,6,7,8").is_ok());
    }

    #[test]
    fn files_are_read_back_and_checked() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("w.toml");
        for file in [
            File { gains: Some([1.5, 1.0, 2.25]), matrix: None },
            File { gains: None, matrix: Some([[1.5, -0.25, 0.0], [0.0, 1.0, 0.0], [0.1, 0.0, 2.0]]) },
        ] {
            std::fs::write(&path, toml::to_string(&file).unwrap()).unwrap();
            let found = read_correction(&path).unwrap();
            let expected = file.matrix.unwrap_or([[1.5, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 2.25]]);
            assert_eq!(found.rows(), &expected);
        }
        for (text, words) in [
            ("", "neither"),
            ("gains = [1, 2]", "gains"),
            ("gain = [1.0, 2.0, 3.0]", "gain"),
            ("gains = [1.0, 0.0, 3.0]", "0.001"),
            ("not toml", "calibrate white"),
        ] {
            std::fs::write(&path, text).unwrap();
            let message = format!("{:#}", read_correction(&path).unwrap_err());
            assert!(message.contains(words), "{text}: {message}");
        }
        assert!(read_correction(&folder.path().join("absent.toml")).unwrap_err().to_string().contains("absent.toml"));
    }
}
