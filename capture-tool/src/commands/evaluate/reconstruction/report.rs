//! The numbers: JSON as it is stored, and a table for people.

use std::fmt::Write;

use relume_core::evaluate::Rule;
use relume_core::evaluate::pixel_sets::PixelSet;
use relume_core::evaluate::reconstruction::Summary;
use serde::Serialize;

/// Everything that is measured; `errors.json`.
#[derive(Debug, Serialize)]
pub struct Report {
    pub tool: &'static str,
    pub asset: String,
    pub lamps: usize,
    pub kept: usize,
    pub subset: Rule,
    /// The method by which all lamps are relit, to compare relit pictures with.
    pub reference: &'static str,
    pub sets: Vec<Set>,
    /// Lights of the relit errors, in the order of [`Measured::relit`].
    pub lights: Vec<String>,
    pub methods: Vec<Measured>,
    pub refused: Vec<Refused>,
}

/// A set of pixels.
#[derive(Debug, Serialize)]
pub struct Set {
    #[serde(flatten)]
    pub set: PixelSet,
    pub count: usize,
}

/// What one method does.
#[derive(Debug, Serialize)]
pub struct Measured {
    pub id: &'static str,
    pub label: &'static str,
    /// `e_i` over each set, in the order of [`Report::sets`].
    pub errors: Vec<Summary>,
    /// `||C - C'|| / ||C'||` of the relit pictures: for each light, for each set. Under the sliver this is a mean over headings.
    pub relit: Vec<Vec<Summary>>,
}

/// A method that the lamps do not allow.
#[derive(Debug, Serialize)]
pub struct Refused {
    pub id: &'static str,
    pub label: &'static str,
    pub reason: String,
}

/// How the kept lamps were chosen, in words.
pub fn rule(rule: &Rule) -> String {
    match rule {
        Rule::Grid { longitudes, rings, every_longitude, every_ring } => format!(
            "a grid of {longitudes} longitudes x {rings} rings: every {} of every {}",
            nth(*every_longitude, "longitude"),
            nth(*every_ring, "ring")
        ),
        Rule::Spread => "well spread: each next lamp the farthest from those already kept".to_owned(),
    }
}

fn nth(n: usize, what: &str) -> String {
    match n {
        1 => what.to_owned(),
        2 => format!("2nd {what}"),
        3 => format!("3rd {what}"),
        _ => format!("{n}th {what}"),
    }
}

/// `12.3 ± 4.5`, in percent; a single number has no deviation.
pub fn percent(summary: &Summary) -> String {
    if summary.deviation == 0.0 {
        return format!("{:.1}", 100.0 * summary.mean);
    }
    format!("{:.1} ± {:.1}", 100.0 * summary.mean, 100.0 * summary.deviation)
}

/// A row a method, a column a set, for the rebuilt functions and for each light.
pub fn table(report: &Report) -> String {
    let mut text = format!(
        "{}: {} of {} lamps kept, {}\n\nRelative error of rebuilt reflectance functions, percent, mean ± deviation over the pixels:\n",
        report.asset,
        report.kept,
        report.lamps,
        rule(&report.subset)
    );
    rows(&mut text, report, |method| &method.errors);
    for (light, name) in report.lights.iter().enumerate() {
        // Writing to a string does not fail.
        let _ = writeln!(text, "\nRelit by {name}, relative error against all lamps ({}), percent:", report.reference);
        rows(&mut text, report, |method| &method.relit[light]);
    }
    for refused in &report.refused {
        let _ = writeln!(text, "\n{}: {}", refused.label, refused.reason);
    }
    text
}

fn rows<'a>(text: &mut String, report: &'a Report, numbers: impl Fn(&'a Measured) -> &'a [Summary]) {
    let first = report.methods.iter().map(|method| method.label.chars().count()).max().unwrap_or(0);
    let heads: Vec<String> = report.sets.iter().map(|set| format!("{} ({} px)", set.set.name, set.count)).collect();
    let width = |head: &String| head.chars().count().max(13);
    let _ = write!(text, "  {:first$}", "");
    for head in &heads {
        let _ = write!(text, "  {head:>w$}", w = width(head));
    }
    for method in &report.methods {
        let _ = write!(text, "\n  {:first$}", method.label);
        for (number, head) in numbers(method).iter().zip(&heads) {
            let _ = write!(text, "  {:>w$}", percent(number), w = width(head));
        }
    }
    text.push('\n');
}
