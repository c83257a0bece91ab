//! The numbers: JSON as it is stored, and tables for people.

use std::fmt::Write;

use relume_core::evaluate::compression::Figures;
use relume_core::evaluate::reconstruction::Summary;
use relume_core::field::Kind;
use serde::Serialize;

use super::measure::COUNT;
use crate::commands::info::megabytes;

/// What the thesis gives for its own scene, a Formula One toy car under 1280 lamps, 256 x 64 (5.4): id of a wavelet,
/// relative H1 error at 256 coefficients.
pub const THESIS_H1: [(&str, f64); 3] = [("haar", 0.0705), ("5/3", 0.0212), ("9/7", 0.0188)];
/// The same for a threshold, with the 9/7: relative L2 error, ratio of texels to coefficients; the H1 error is below 1 %.
pub const THESIS_THRESHOLD: (f64, f64) = (0.002, 34.0);
/// What the figures of the thesis are of.
pub const THESIS_SCENE: &str = "the thesis's Formula One toy car";

/// Everything that is measured; `compression.json`.
#[derive(Debug, Serialize)]
pub struct Report {
    pub tool: &'static str,
    /// What repeats the measurement.
    pub command: String,
    pub asset: String,
    /// Columns and rows of the picture.
    pub size: [usize; 2],
    pub lamps: usize,
    /// Longitudes x angles from the axis.
    pub grid: [usize; 2],
    pub reconstruction: &'static str,
    /// Pixels of the object that are not black.
    pub pixels_seen: usize,
    /// Of them, those that were measured, chosen by chance from `seed`.
    pub pixels: usize,
    pub seed: u64,
    pub wavelets: Vec<OfWavelet>,
    pub trees: Trees,
    pub representations: Representations,
}

/// What one wavelet does.
#[derive(Debug, Serialize)]
pub struct OfWavelet {
    pub id: &'static str,
    pub label: &'static str,
    /// The same number of coefficients for every function.
    pub by_count: Vec<ByCount>,
    /// As many as each function needs for an error.
    pub by_error: Vec<ByError>,
}

/// With so many coefficients.
#[derive(Debug, Serialize)]
pub struct ByCount {
    pub count: usize,
    #[serde(flatten)]
    pub figures: Figures,
}

/// With as many as bring the relative L2 error down to `error`.
#[derive(Debug, Serialize)]
pub struct ByError {
    pub error: f64,
    /// Texels of the grid over the mean number of coefficients.
    pub ratio: f64,
    #[serde(flatten)]
    pub figures: Figures,
}

/// Ways of choosing.
#[derive(Debug, Serialize)]
pub struct Trees {
    pub wavelet: &'static str,
    pub pixels: usize,
    pub counts: Vec<usize>,
    pub choices: Vec<Choice>,
}

/// One way of choosing: relative L2 errors in the order of [`Trees::counts`].
#[derive(Debug, Serialize)]
pub struct Choice {
    pub label: &'static str,
    pub errors: Vec<Summary>,
}

/// Compact representations beside the samples.
#[derive(Debug, Serialize)]
pub struct Representations {
    /// Lights of the relit errors, in the order of [`Row::relit`].
    pub lights: Vec<String>,
    /// The samples first.
    pub rows: Vec<Row>,
    pub not_made: Vec<NotMade>,
}

/// One of them.
#[derive(Debug, Serialize)]
pub struct Row {
    pub name: String,
    pub kind: Kind,
    /// Its arrays, without the map of errors.
    pub bytes: u64,
    /// Bytes of the samples as halves over `bytes`.
    pub smaller: f64,
    /// `||T - T'|| / ||T||` over the field, Frobenius: at the lamps, or, for wavelets, on the grid.
    pub reached: f64,
    /// `||C - C'|| / ||C'||` of the relit pictures, C' by the samples: the mean over the slivers, then each map.
    pub relit: Vec<f64>,
    /// Median time of projecting a map of light, seconds.
    pub project_s: f64,
    /// Median time of relighting the whole picture, projection left out, seconds.
    pub relight_s: f64,
    /// Times of the samples over `relight_s`, measured in turns.
    pub faster: f64,
}

/// A representation that this field does not allow.
#[derive(Debug, Serialize)]
pub struct NotMade {
    pub name: String,
    pub reason: String,
}

impl Report {
    /// Which pixels were measured, in words.
    pub fn sample(&self) -> String {
        match self.pixels == self.pixels_seen {
            true => format!("all {} pixels that are not black", self.pixels),
            false => format!("{} of {} pixels that are not black, chosen by chance", self.pixels, self.pixels_seen),
        }
    }

    /// How functions were rebuilt, in words.
    pub fn rebuilt(&self) -> String {
        format!("{} lamps, {} to {} x {}", self.lamps, self.reconstruction, self.grid[0], self.grid[1])
    }
}

impl OfWavelet {
    /// At the count that the thesis gives numbers for.
    pub fn at_count(&self) -> Option<&Figures> {
        self.by_count.iter().find(|by| by.count == COUNT).map(|by| &by.figures)
    }
}

/// A share in percent with three digits that count.
pub fn percent(share: f64) -> String {
    let percent = 100.0 * share;
    match percent {
        0.0 => "0".to_owned(),
        p if p >= 99.95 => format!("{p:.0}"),
        p if p >= 9.995 => format!("{p:.1}"),
        p if p >= 0.9995 => format!("{p:.2}"),
        p => format!("{p:.3}"),
    }
}

/// A threshold in percent, without digits that say nothing.
pub fn threshold(error: f64) -> String {
    format!("{:.3}", 100.0 * error).trim_end_matches('0').trim_end_matches('.').to_owned()
}

/// Seconds for people.
pub fn milliseconds(seconds: f64) -> String {
    let ms = 1000.0 * seconds;
    if ms < 10.0 { format!("{ms:.2} ms") } else { format!("{ms:.0} ms") }
}

/// `12.3x`.
pub fn times(ratio: f64) -> String {
    if ratio < 9.95 { format!("{ratio:.2}x") } else { format!("{ratio:.1}x") }
}

/// The tables that are printed.
pub fn tables(report: &Report) -> String {
    let mut text = format!(
        "{}: {} x {} pixels; {}; wavelets on {}\n\n",
        report.asset,
        report.size[0],
        report.size[1],
        report.rebuilt(),
        report.sample()
    );
    // Writing to a string does not fail.
    if report.wavelets.iter().any(|wavelet| wavelet.at_count().is_some()) {
        let _ = writeln!(text, "Relative error at {COUNT} coefficients a function, percent (mean):");
        let of = |wavelet: &OfWavelet| {
            let figures = wavelet.at_count()?;
            let thesis = THESIS_H1.iter().find(|entry| entry.0 == wavelet.id).map(|entry| percent(entry.1));
            let shown = [figures.h1.mean, figures.l2.mean, figures.h1_over_time.mean].map(percent);
            Some([vec![wavelet.label.to_owned()], shown.into(), vec![thesis.unwrap_or_default()]].concat())
        };
        let rows: Vec<Vec<String>> = report.wavelets.iter().filter_map(of).collect();
        table(&mut text, &["", "H1", "L2", "H1 over time", "H1 of the thesis's car"], &rows);
    }
    let _ = writeln!(text, "\nAs many coefficients as reach a relative L2 error:");
    let by_error = |wavelet: &OfWavelet| {
        let row = |by: &ByError| {
            vec![
                wavelet.label.to_owned(),
                threshold(by.error),
                format!("{:.0}", by.figures.terms.mean),
                format!("1 : {:.0}", by.ratio),
                percent(by.figures.h1.mean),
                percent(by.figures.h1_over_time.mean),
            ]
        };
        wavelet.by_error.iter().map(row).collect::<Vec<_>>()
    };
    let rows: Vec<Vec<String>> = report.wavelets.iter().flat_map(by_error).collect();
    table(&mut text, &["", "error, %", "mean count", "texels", "H1, %", "H1 over time, %"], &rows);
    let _ = writeln!(text, "\nRepresentations of the whole field:");
    let (heads, rows) = representation_rows(&report.representations);
    table(&mut text, &heads.iter().map(String::as_str).collect::<Vec<_>>(), &rows);
    for not_made in &report.representations.not_made {
        let _ = writeln!(text, "  {}: {}", not_made.name, not_made.reason);
    }
    text
}

/// Heads and cells of the table of representations; for text and page.
pub fn representation_rows(representations: &Representations) -> (Vec<String>, Vec<Vec<String>>) {
    let own = ["", "size", "of halves", "reached, %", "project", "relight", "faster"].map(str::to_owned);
    let lights = representations.lights.iter().map(|light| format!("{light}, %"));
    let cells = |row: &Row| {
        let own = [
            row.name.clone(),
            megabytes(row.bytes),
            format!("1 : {:.1}", row.smaller),
            percent(row.reached),
            milliseconds(row.project_s),
            milliseconds(row.relight_s),
            times(row.faster),
        ];
        own.into_iter().chain(row.relit.iter().map(|error| percent(*error))).collect()
    };
    (own.into_iter().chain(lights).collect(), representations.rows.iter().map(cells).collect())
}

/// Columns as wide as what is in them: the first to the left, the others to the right.
fn table(text: &mut String, heads: &[&str], rows: &[Vec<String>]) {
    let width = |n: usize| {
        let cells = rows.iter().filter_map(|row| row.get(n)).map(|cell| cell.chars().count());
        cells.chain([heads[n].chars().count()]).max().unwrap_or(0)
    };
    let widths: Vec<usize> = (0..heads.len()).map(width).collect();
    let heads: Vec<String> = heads.iter().map(|head| (*head).to_owned()).collect();
    for row in std::iter::once(&heads).chain(rows) {
        let mut line = format!("  {:w$}", row[0], w = widths[0]);
        for (cell, w) in row.iter().zip(&widths).skip(1) {
            line += &format!("  {cell:>w$}");
        }
        text.push_str(line.trim_end());
        text.push('\n');
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_have_three_digits_that_count() {
        let shown = [0.0, 0.00051, 0.0188, 0.0705, 0.1234, 1.0, 0.0999949].map(percent);
        assert_eq!([0.0005, 0.001, 0.02, 0.1].map(threshold), ["0.05", "0.1", "2", "10"]);
        assert_eq!(shown, ["0", "0.051", "1.88", "7.05", "12.3", "100", "10.0"]);
        assert_eq!((milliseconds(0.00123), milliseconds(0.0347)), ("1.23 ms".to_owned(), "35 ms".to_owned()));
        assert_eq!((times(2.0), times(12.34)), ("2.00x".to_owned(), "12.3x".to_owned()));
    }

    #[test]
    fn tables_line_up() {
        let mut text = String::new();
        table(
            &mut text,
            &["", "size"],
            &[vec!["é".to_owned(), "1 MB".to_owned()], vec!["long".to_owned(), "2".to_owned()]],
        );
        assert_eq!(text, "        size\n  é     1 MB\n  long     2\n");
    }
}
