//! The page of a compression report.

use maud::{Markup, html};
use relume_core::evaluate::compression::Budget;
use relume_core::evaluate::reconstruction::Summary;
use relume_core::image::Image;

use super::super::lines::{Chart, Line};
use super::super::page::{Figure, chart, document, file_name};
use super::super::pictures;
use super::measure::{COUNT, Measured, Task};
use super::report::{
    self, Choice, OfWavelet, Report, THESIS_H1, THESIS_SCENE, THESIS_THRESHOLD, percent, representation_rows, threshold,
};

/// Every picture of a report.
pub struct Figures {
    /// Names of files, and charts.
    charts: Vec<(&'static str, String)>,
    rebuilt: Figure,
    /// `[budget][wavelet]`.
    over_time: Vec<(String, Vec<Figure>)>,
    column: usize,
}

impl Figures {
    /// Exposes and encodes all pictures. All have the exposure of the functions as rebuilt.
    ///
    /// # Errors
    /// Pictures that are not finite; what the charts meet.
    pub fn new(task: &Task, measured: &Measured) -> anyhow::Result<Self> {
        let display = |picture: &Image| pictures::for_display(&task.asset, picture.clone());
        let rebuilt = display(&measured.over_time.rebuilt);
        let gain = pictures::gain(&rebuilt);
        let of_budget = |(n, budget): (usize, &Budget)| {
            let (name, words) = match *budget {
                Budget::Terms(count) => (format!("{count}-coefficients"), format!("{count} coefficients a function")),
                Budget::Error(error) => {
                    (format!("{}-percent", threshold(error)), format!("relative L2 error of {} %", threshold(error)))
                }
            };
            let figure = |(wavelet, pictures): (&OfWavelet, &Vec<Image>)| {
                let name = format!("over-time-{}-{name}.png", file_name(wavelet.id));
                Figure::new(name, &display(&pictures[n]), gain)
            };
            let figures = measured.report.wavelets.iter().zip(&measured.over_time.compressed).map(figure);
            Ok((words, figures.collect::<anyhow::Result<_>>()?))
        };
        Ok(Self {
            charts: charts(&measured.report)?,
            rebuilt: Figure::new("over-time-rebuilt.png".to_owned(), &rebuilt, gain)?,
            over_time: task.shown().iter().enumerate().map(of_budget).collect::<anyhow::Result<_>>()?,
            column: task.column,
        })
    }

    /// Names and contents of the files beside the page.
    pub fn files(&self) -> impl Iterator<Item = (&str, &[u8])> {
        let figures = std::iter::once(&self.rebuilt).chain(self.over_time.iter().flat_map(|entry| &entry.1));
        figures.map(Figure::file).chain(self.charts.iter().map(|(name, svg)| (*name, svg.as_bytes())))
    }

    fn chart(&self, name: &str) -> Markup {
        let svg = self.charts.iter().find(|entry| entry.0 == name).map_or("", |entry| &entry.1);
        chart(svg)
    }
}

/// A line a wavelet.
fn lines(report: &Report, points: impl Fn(&OfWavelet) -> Vec<(f64, f64)>) -> Vec<Line> {
    report.wavelets.iter().map(|wavelet| Line { label: wavelet.label.to_owned(), points: points(wavelet) }).collect()
}

fn charts(report: &Report) -> anyhow::Result<Vec<(&'static str, String)>> {
    let draw = |name: &'static str, title: &str, x: &str, y: &str, lines: Vec<Line>| {
        let chart = Chart { title: title.to_owned(), x: x.to_owned(), y: y.to_owned(), lines };
        Ok::<_, anyhow::Error>((name, chart.svg()?))
    };
    let by_count = |f: fn(&report::ByCount) -> f64| {
        lines(report, |w| w.by_count.iter().map(|by| (by.count as f64, 100.0 * f(by))).collect())
    };
    let by_error = |x: fn(&report::ByError) -> f64| {
        let point = |by: &report::ByError| (x(by), 100.0 * by.figures.h1_over_time.mean);
        lines(report, |w| w.by_error.iter().map(point).collect())
    };
    let trees = &report.trees;
    let choice = |choice: &Choice| Line {
        label: choice.label.to_owned(),
        points: trees.counts.iter().zip(&choice.errors).map(|(n, e)| (*n as f64, 100.0 * e.mean)).collect(),
    };
    let (count, error) = ("coefficients a function", "mean relative error, percent");
    let over_time = "mean relative H1 error over time, percent";
    Ok(vec![
        draw("h1.svg", "Sobolev H1 error by number of coefficients", count, error, by_count(|b| b.figures.h1.mean))?,
        draw("l2.svg", "L2 error by number of coefficients", count, error, by_count(|b| b.figures.l2.mean))?,
        draw("threshold.svg", "Over time, by threshold", "threshold (relative L2 error), percent", over_time, {
            by_error(|by| 100.0 * by.error)
        })?,
        draw("mean-count.svg", "Over time, by mean number", "mean number of coefficients a function", over_time, {
            by_error(|by| by.figures.terms.mean)
        })?,
        draw(
            "choices.svg",
            &format!("Ways of choosing coefficients, {}", trees.wavelet),
            count,
            error,
            trees.choices.iter().map(choice).collect(),
        )?,
    ])
}

/// The page.
pub fn page(report: &Report, figures: &Figures) -> String {
    let body = html! {
        p {
            (report.size[0]) " × " (report.size[1]) " pixels. Reflectance functions: " (report.rebuilt())
            " (longitudes × angles from the axis of the lamps). Wavelets were measured on " (report.sample())
            "; representations on the whole field."
        }
        p { code { (report.command) } }
        (representations(report))
        (by_count(report, figures))
        (by_error(report, figures))
        (over_time(report, figures))
        (choices(report, figures))
        p.note {
            (report.tool) ". All numbers: compression.json; tables: compression.txt; charts and pictures in full size "
            "lie beside this page."
        }
    };
    document(&format!("Compression of {}", report.asset), &body)
}

fn representations(report: &Report) -> Markup {
    let (heads, rows) = representation_rows(&report.representations);
    html! {
        h2 { "Representations" }
        p {
            "Size of the arrays, and how many times smaller than the samples as 16-bit halves. Reached: ‖T − T′‖ / "
            "‖T‖ over the whole field, of what is stored. Project: from a map of light to weights, once a picture; "
            "relight: from weights to the picture; medians, and how many times faster than the samples, measured in "
            "turns. Then the relative error of relit pictures against those of the samples: the mean over the "
            "headings of a sliver of light 5 degrees wide, the hardest light there is but a single lamp"
            @if report.representations.lights.len() > 1 { ", and each map" }
            ". Wavelets are lit through the texels of their grid, linear between them, so a little of their "
            "difference is the grid's and stays however many coefficients are kept."
        }
        (table(&heads, &rows))
        @if !report.representations.not_made.is_empty() {
            ul { @for not_made in &report.representations.not_made { li { (not_made.name) ": " (not_made.reason) } } }
        }
    }
}

fn by_count(report: &Report, figures: &Figures) -> Markup {
    let thesis = |wavelet: &OfWavelet| {
        THESIS_H1.iter().find(|entry| entry.0 == wavelet.id).map(|entry| percent(entry.1)).unwrap_or_default()
    };
    let row = |wavelet: &OfWavelet| {
        let at = wavelet.at_count()?;
        let plus = |summary: &Summary| format!("{} ± {}", percent(summary.mean), percent(summary.deviation));
        Some(vec![wavelet.label.to_owned(), plus(&at.h1), plus(&at.l2), plus(&at.h1_over_time), thesis(wavelet)])
    };
    let rows: Vec<Vec<String>> = report.wavelets.iter().filter_map(row).collect();
    let heads = ["Wavelet", "H1, %", "L2, %", "H1 over time, %", "H1 in the thesis, %"].map(str::to_owned);
    html! {
        h2 { "Wavelets, the same number of coefficients for every function" }
        p {
            "Non-linear approximation: the coefficients with the largest √(Σ" sub { "c" }
            " c²) ‖s‖ are kept, one set for the three channels. H1 is the Sobolev norm, ‖v‖² + ‖∇v‖² with "
            "differences to the next longitude and to the next angle, so that lost smoothness counts (figure 5.6). "
            "The steeper a line falls, the better coefficients are used; Haar, which is made of steps, needs many "
            "more of them to come as near to smooth functions as the 5/3 and the 9/7."
        }
        @if !rows.is_empty() {
            p {
                "At "
                (COUNT)
                " coefficients, mean ± deviation over the pixels of this asset; the last column is that of "
                (THESIS_SCENE)
                ", another object and other lamps:"
            }
            (table(&heads, &rows))
        }
        div.row { (figures.chart("h1.svg")) (figures.chart("l2.svg")) }
    }
}

fn by_error(report: &Report, figures: &Figures) -> Markup {
    let row = |by: &report::ByError, wavelet: &OfWavelet| {
        let terms = &by.figures.terms;
        vec![
            wavelet.label.to_owned(),
            threshold(by.error),
            format!("{:.0} ± {:.0}", terms.mean, terms.deviation),
            format!("1 : {:.1}", by.ratio),
            percent(by.figures.h1.mean),
            percent(by.figures.h1_over_time.mean),
        ]
    };
    let rows: Vec<Vec<String>> =
        report.wavelets.iter().flat_map(|wavelet| wavelet.by_error.iter().map(|by| row(by, wavelet))).collect();
    let heads = ["Wavelet", "Threshold, %", "Coefficients", "Of texels", "H1, %", "H1 over time, %"].map(str::to_owned);
    let (error, ratio) = THESIS_THRESHOLD;
    html! {
        h2 { "Wavelets, as many coefficients as each function needs" }
        p {
            "Each function gets the fewest coefficients that bring its relative L2 error down to the threshold. The "
            "H1 error is taken over time, of what the pixel shows under a sliver of light that turns about the "
            "object (figure 5.7): on the left by threshold, on the right by the mean number of coefficients, which "
            "is what is paid for it: for one threshold Haar keeps several times as many as the others. The thesis, "
            "on "
            (THESIS_SCENE)
            ", reports 1 : "
            (ratio) " at " (threshold(error))
            " % with an H1 error below 1 % for the 9/7."
        }
        div.row { (figures.chart("threshold.svg")) (figures.chart("mean-count.svg")) }
        (table(&heads, &rows))
    }
}

fn over_time(report: &Report, figures: &Figures) -> Markup {
    html! {
        h2 { "A sliver of light turning about the object" }
        p {
            "Column "
            (figures.column)
            " of the picture over one turn of a sliver of light along a meridian, 5 degrees wide: time runs to the "
            "right, from behind over the left, the front and the right to behind again; each row is one pixel "
            "(figure 5.8). Where a wavelet leaves steps, they show as vertical bars that switch on and off, as "
            "Haar's do on what is diffuse; what is smooth in the uncompressed picture should stay smooth. The 5/3 "
            "and the 9/7 leave ripples instead, about glints that outshine the rest of a function. All have "
            "the same exposure."
        }
        div.row { (figures.rebuilt.show("wide", html! { "As rebuilt, uncompressed" })) }
        @for (words, row) in &figures.over_time {
            h3 { (words) }
            div.row {
                @for (figure, wavelet) in row.iter().zip(&report.wavelets) {
                    (figure.show("wide", html! { (wavelet.label) }))
                }
            }
        }
    }
}

fn choices(report: &Report, figures: &Figures) -> Markup {
    let trees = &report.trees;
    let heads: Vec<String> =
        std::iter::once("Choice".to_owned()).chain(trees.counts.iter().map(|n| format!("{n}, %"))).collect();
    let row = |choice: &Choice| {
        let errors = choice.errors.iter().map(|error| percent(error.mean));
        std::iter::once(choice.label.to_owned()).chain(errors).collect()
    };
    let rows: Vec<Vec<String>> = trees.choices.iter().map(row).collect();
    html! {
        h2 { "Ways of choosing coefficients" }
        p {
            "Relative L2 error of "
            (trees.pixels)
            " functions with the "
            (trees.wavelet)
            ", by the number of coefficients (6.4, 6.5). The non-linear approximation knows all coefficients and is "
            "the best that any choice can do, as nearly as basis functions are orthogonal; trees hold what leads to "
            "each of their members, as they must when coefficients are asked for one by one in front of a camera; "
            "the linear one takes the coarsest first, whatever their values."
        }
        (figures.chart("choices.svg"))
        (table(&heads, &rows))
    }
}

fn table(heads: &[String], rows: &[Vec<String>]) -> Markup {
    html! {
        table {
            tr { @for head in heads { th { (head) } } }
            @for row in rows { tr { @for cell in row { td { (cell) } } } }
        }
    }
}
