//! Bars with deviations (figure 4.16).

use plotters::prelude::*;

use super::report::Report;

/// Pixels of a panel, one for each set of pixels.
const PANEL: (u32, u32) = (480, 60);
/// Pixels a method.
const BAR: u32 = 24;
/// Panels side by side.
const ACROSS: usize = 2;

/// One panel for each set of pixels: the mean relative error of every method as a bar, with the standard deviation. SVG.
///
/// # Errors
/// What the drawing crate meets.
pub fn error_bars(report: &Report) -> anyhow::Result<String> {
    let across = ACROSS.min(report.sets.len()).max(1);
    let down = report.sets.len().div_ceil(across);
    let height = PANEL.1 + BAR * report.methods.len() as u32;
    let mut svg = String::new();
    {
        let area =
            SVGBackend::with_string(&mut svg, (PANEL.0 * across as u32, height * down as u32)).into_drawing_area();
        area.fill(&WHITE)?;
        for (n, panel) in area.split_evenly((down, across)).iter().enumerate().take(report.sets.len()) {
            draw(panel, report, n)?;
        }
        area.present()?;
    }
    Ok(svg)
}

/// The panel of set `n`.
fn draw(panel: &DrawingArea<SVGBackend<'_>, plotters::coord::Shift>, report: &Report, n: usize) -> anyhow::Result<()> {
    let set = &report.sets[n];
    let numbers: Vec<(f64, f64)> = report
        .methods
        .iter()
        .map(|method| (100.0 * method.errors[n].mean, 100.0 * method.errors[n].deviation))
        .collect();
    let reach = numbers.iter().map(|(mean, deviation)| mean + deviation).fold(1e-3, f64::max) * 1.05;
    let title = format!("{} ({} pixels): relative error, percent", set.set.name, set.count);
    let count = numbers.len();
    let mut chart = ChartBuilder::on(panel)
        .caption(title, ("sans-serif", 14))
        .margin_right(16)
        .x_label_area_size(24)
        .y_label_area_size(150)
        // Upside down: the first method is on top.
        .build_cartesian_2d(0.0..reach, (0..count - 1).into_segmented())?;
    let label = |at: &SegmentValue<usize>| match at {
        SegmentValue::CenterOf(i) if *i < count => report.methods[count - 1 - i].label.to_owned(),
        _ => String::new(),
    };
    chart
        .configure_mesh()
        .disable_y_mesh()
        .light_line_style(TRANSPARENT)
        .y_labels(count)
        .y_label_formatter(&label)
        .x_label_formatter(&|x| if reach > 5.0 { format!("{x:.0}") } else { format!("{x:.1}") })
        .label_style(("sans-serif", 12))
        .draw()?;
    chart.draw_series(numbers.iter().rev().enumerate().map(|(i, &(mean, _))| {
        let end = if i + 1 < count { SegmentValue::Exact(i + 1) } else { SegmentValue::Last };
        let corners = [(0.0, SegmentValue::Exact(i)), (mean, end)];
        let mut bar = Rectangle::new(corners, RGBColor(74, 111, 165).filled());
        bar.set_margin(4, 4, 0, 0);
        bar
    }))?;
    chart.draw_series(numbers.iter().rev().enumerate().map(|(i, &(mean, deviation))| {
        let (low, high) = ((mean - deviation).max(0.0), mean + deviation);
        ErrorBar::new_horizontal(SegmentValue::CenterOf(i), low, mean, high, BLACK.filled(), 8)
    }))?;
    Ok(())
}
