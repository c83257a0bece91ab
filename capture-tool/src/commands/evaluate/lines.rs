//! Line charts on logarithmic axes.

use plotters::prelude::*;

/// Pixels of a chart.
const SIZE: (u32, u32) = (560, 400);
/// Colours that people who confuse some of them can tell apart (Okabe and Ito 2008).
const COLOURS: [RGBColor; 5] =
    [RGBColor(213, 94, 0), RGBColor(0, 114, 178), RGBColor(0, 158, 115), RGBColor(204, 121, 167), RGBColor(90, 90, 90)];

/// A line of a chart.
#[derive(Debug, Clone)]
pub struct Line {
    pub label: String,
    /// What is not positive cannot be shown and is left out.
    pub points: Vec<(f64, f64)>,
}

/// Lines over one pair of axes.
#[derive(Debug, Clone)]
pub struct Chart {
    pub title: String,
    pub x: String,
    pub y: String,
    pub lines: Vec<Line>,
}

impl Chart {
    /// The chart as SVG.
    ///
    /// # Errors
    /// What the drawing crate meets.
    pub fn svg(&self) -> anyhow::Result<String> {
        let mut svg = String::new();
        {
            let area = SVGBackend::with_string(&mut svg, SIZE).into_drawing_area();
            area.fill(&WHITE)?;
            self.draw(&area)?;
            area.present()?;
        }
        Ok(svg)
    }

    fn draw(&self, area: &DrawingArea<SVGBackend<'_>, plotters::coord::Shift>) -> anyhow::Result<()> {
        let shown: Vec<Vec<(f64, f64)>> = self.lines.iter().map(|line| positive(&line.points)).collect();
        let all = || shown.iter().flatten();
        let mut chart = ChartBuilder::on(area)
            .caption(&self.title, ("sans-serif", 15))
            .margin(10)
            .margin_right(20)
            .x_label_area_size(40)
            .y_label_area_size(58)
            .build_cartesian_2d(
                reach(all().map(|point| point.0)).log_scale(),
                reach(all().map(|point| point.1)).log_scale(),
            )?;
        chart
            .configure_mesh()
            .light_line_style(RGBColor(240, 240, 240))
            .bold_line_style(RGBColor(215, 215, 215))
            .x_desc(&self.x)
            .y_desc(&self.y)
            .x_label_formatter(&|v| number(*v))
            .y_label_formatter(&|v| number(*v))
            .label_style(("sans-serif", 12))
            .draw()?;
        for ((line, points), colour) in self.lines.iter().zip(&shown).zip(COLOURS.iter().cycle()) {
            let style = colour.stroke_width(2);
            chart
                .draw_series(std::iter::once(PathElement::new(points.clone(), style)))?
                .label(&line.label)
                .legend(move |(x, y)| PathElement::new(vec![(x, y), (x + 18, y)], style));
            chart.draw_series(points.iter().map(|point| Circle::new(*point, 3, colour.filled())))?;
        }
        chart
            .configure_series_labels()
            .position(legend(&shown))
            .background_style(WHITE.mix(0.85))
            .border_style(RGBColor(200, 200, 200))
            .label_font(("sans-serif", 12))
            .draw()?;
        Ok(())
    }
}

/// Where lines leave room on these axes: below those that fall to the left, below those that rise to the right.
fn legend(shown: &[Vec<(f64, f64)>]) -> SeriesLabelPosition {
    let rises = |points: &Vec<(f64, f64)>| {
        points.first().zip(points.last()).is_some_and(|(a, b)| (b.1 - a.1) * (b.0 - a.0) > 0.0)
    };
    if shown.iter().any(rises) { SeriesLabelPosition::LowerRight } else { SeriesLabelPosition::LowerLeft }
}

fn positive(points: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let is_shown = |v: f64| v > 0.0 && v.is_finite();
    points.iter().copied().filter(|(x, y)| is_shown(*x) && is_shown(*y)).collect()
}

/// From below the least to above the largest; some range where there is nothing.
fn reach(values: impl Iterator<Item = f64>) -> std::ops::Range<f64> {
    let (low, high) = values.fold((f64::INFINITY, 0.0f64), |(low, high), v| (low.min(v), high.max(v)));
    if low > high { 0.1..10.0 } else { low / 1.2..high * 1.2 }
}

/// A number of an axis: no more digits than it needs.
fn number(value: f64) -> String {
    let digits = (2 - value.abs().log10().floor() as i32).clamp(0, 6) as usize;
    let text = format!("{value:.digits$}");
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_the_digits_they_need() {
        for (value, text) in
            [(0.05, "0.05"), (1.0, "1"), (2.5, "2.5"), (100.0, "100"), (8192.0, "8192"), (0.002, "0.002")]
        {
            assert_eq!(number(value), text);
        }
    }

    #[test]
    fn what_cannot_be_shown_is_left_out() {
        let lines = |points: &[(f64, f64)]| vec![Line { label: "a <b>".to_owned(), points: points.to_vec() }];
        let chart = |lines| Chart { title: "t".to_owned(), x: "x".to_owned(), y: "y".to_owned(), lines };
        let svg = chart(lines(&[(16.0, 2.0), (32.0, 0.0), (64.0, f64::NAN), (128.0, 1.0)])).svg().unwrap();
        assert!(svg.contains("a &lt;b&gt;") && !svg.contains("NaN") && !svg.contains("inf"));
        assert_eq!(svg.matches("<circle").count(), 2);
        assert!(chart(lines(&[])).svg().unwrap().contains("<svg"));
    }
}
