//! The numbers: JSON as it is stored, a table for people, the chart of figure 6.30, and the page.

use std::fmt::Write;

use maud::html;
use plotters::prelude::*;
use relume_core::evaluate::implicit::Outcome;
use serde::Serialize;

use crate::commands::evaluate::page;

/// Pixels of the chart.
const SIZE: (u32, u32) = (760, 480);
/// Colours that people who confuse some of them can tell apart (Okabe and Ito 2008), one for a pair of lines.
const COLOURS: [RGBColor; 3] = [RGBColor(213, 94, 0), RGBColor(0, 158, 115), RGBColor(30, 30, 30)];

/// Everything that is measured; `implicit.json`.
#[derive(Debug, Serialize)]
pub struct Report {
    pub tool: &'static str,
    pub command: String,
    /// Columns and rows.
    pub texels: (usize, usize),
    /// Width and height of the photographs.
    pub size: (usize, usize),
    pub basis: &'static str,
    /// Standard deviation of camera noise where the white screen is seen, as a share of it.
    pub noise: f32,
    /// Covered, lit pixels: those that were solved.
    pub pixels: usize,
    /// What [`Outcome::errors`] are of.
    pub backdrops: Vec<String>,
    pub lines: Vec<Line>,
}

/// A line of the chart.
#[derive(Debug, Serialize)]
pub struct Line {
    pub label: String,
    /// Over terms; or over patterns.
    pub over_terms: bool,
    pub outcomes: Vec<Outcome>,
}

impl Line {
    /// Number of terms or patterns, and error in percent.
    fn points(&self) -> Vec<(f64, f64)> {
        let at = |outcome: &Outcome| if self.over_terms { outcome.terms } else { outcome.patterns };
        self.outcomes.iter().map(|outcome| (at(outcome) as f64, 100.0 * outcome.mean())).collect()
    }
}

/// All outcomes.
pub fn table(report: &Report) -> String {
    let mut text = format!(
        "{} covered, lit pixels; {} x {} texels; relit error, percent, mean (each backdrop); terms found\n",
        report.pixels, report.texels.0, report.texels.1
    );
    for line in &report.lines {
        let _ = writeln!(text, "\n{}", line.label);
        for outcome in &line.outcomes {
            let each: Vec<String> = outcome.errors.iter().map(|error| format!("{:.2}", 100.0 * error)).collect();
            let _ = writeln!(
                text,
                "  {:4} patterns {:4} terms  {:6.2}  ({})  {:5.1}",
                outcome.patterns,
                outcome.terms,
                100.0 * outcome.mean(),
                each.join(" "),
                outcome.terms_found
            );
        }
    }
    text
}

/// Errors over the number of terms and of patterns, in one chart as figure 6.30. SVG.
///
/// # Errors
/// What the drawing crate meets.
pub fn chart(report: &Report) -> anyhow::Result<String> {
    let mut svg = String::new();
    {
        let area = SVGBackend::with_string(&mut svg, SIZE).into_drawing_area();
        area.fill(&WHITE)?;
        draw(&area, report)?;
        area.present()?;
    }
    Ok(svg)
}

fn draw(area: &DrawingArea<SVGBackend<'_>, plotters::coord::Shift>, report: &Report) -> anyhow::Result<()> {
    let points: Vec<Vec<(f64, f64)>> = report.lines.iter().map(Line::points).collect();
    let errors = || points.iter().flatten().map(|point| point.1).filter(|error| *error > 0.0);
    let (low, high) = (errors().fold(f64::MAX, f64::min) / 1.2, errors().fold(0.0, f64::max) * 1.2);
    let right = points.iter().flatten().map(|point| point.0).fold(0.0, f64::max);
    let title = format!("Relit error, {} x {} texels, {}", report.texels.0, report.texels.1, report.basis);
    let mut chart = ChartBuilder::on(area)
        .caption(title, ("sans-serif", 16))
        .margin(10)
        .margin_right(20)
        .x_label_area_size(40)
        .y_label_area_size(58)
        .build_cartesian_2d(14.0..right * 1.1, (low..high).log_scale())?;
    chart
        .configure_mesh()
        .light_line_style(RGBColor(240, 240, 240))
        .bold_line_style(RGBColor(215, 215, 215))
        .x_desc("terms (first pair of lines), patterns (others)")
        .y_desc("relative error, percent")
        .x_label_formatter(&|v| format!("{v:.0}"))
        .y_label_formatter(&|v| if *v < 10.0 { format!("{v:.1}") } else { format!("{v:.0}") })
        .label_style(("sans-serif", 12))
        .draw()?;
    for (n, (line, points)) in report.lines.iter().zip(&points).enumerate() {
        // Pairs: the rule to stop off, thin; on, thick.
        let style = COLOURS[n / 2 % COLOURS.len()].stroke_width(1 + 2 * (n % 2) as u32);
        chart
            .draw_series(std::iter::once(PathElement::new(points.clone(), style)))?
            .label(&line.label)
            .legend(move |(x, y)| PathElement::new(vec![(x, y), (x + 22, y)], style));
        chart.draw_series(points.iter().map(|point| Circle::new(*point, 3, style.color.filled())))?;
    }
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::UpperRight)
        .background_style(WHITE.mix(0.85))
        .border_style(RGBColor(200, 200, 200))
        .label_font(("sans-serif", 12))
        .draw()?;
    Ok(())
}

/// The page.
pub fn page(report: &Report, chart: &str) -> String {
    let body = html! {
        p { (report.tool) ": " code { (report.command) } }
        p.note {
            (report.pixels) " covered, lit pixels of the virtual monitor, " (report.size.0) " x " (report.size.1)
            " photographs, camera noise of " (format!("{:.2}", 100.0 * report.noise)) " percent where the white screen is seen. Errors are "
            "||C - C'|| / ||C'|| over those pixels, the mean of " (report.backdrops.join(", ")) ". With more terms more of each "
            "reflectance function is said, but less surely: without the rule to stop there is a best number of terms."
        }
        (page::chart(chart))
        @for line in &report.lines {
            h2 { (line.label) }
            table {
                tr {
                    th { "patterns" } th { "terms" } th { "error, percent" }
                    @for backdrop in &report.backdrops { th { (backdrop) } }
                    th { "terms found" }
                }
                @for outcome in &line.outcomes {
                    tr {
                        td { (outcome.patterns) } td { (outcome.terms) }
                        td { (format!("{:.2}", 100.0 * outcome.mean())) }
                        @for error in &outcome.errors { td { (format!("{:.2}", 100.0 * error)) } }
                        td { (format!("{:.1}", outcome.terms_found)) }
                    }
                }
            }
        }
    };
    page::document("Implicit sampling: errors by terms and patterns", &body)
}
