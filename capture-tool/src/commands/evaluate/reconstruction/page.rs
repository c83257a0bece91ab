//! The page of a reconstruction report.

use maud::{Markup, html};
use relume_core::evaluate::pixel_sets::Traits;
use relume_core::evaluate::reconstruction::Summary;
use relume_core::image::Image;

use super::super::page::{Figure, chart, document, file_name};
use super::super::pictures;
use super::charts;
use super::measure::{Lit, Task};
use super::report::{self, Measured, Report};

/// Every picture of a report.
pub struct Figures {
    chart: String,
    sets: Vec<Figure>,
    errors: Vec<Figure>,
    /// What is white in the pictures of errors.
    white: f32,
    /// Kept lamps by each method; the reference first.
    over_time: Vec<Figure>,
    over_time_of_all: Vec<(&'static str, Figure)>,
    /// For each light: the reference, then each method.
    stills: Vec<Vec<Figure>>,
    column: usize,
}

impl Figures {
    /// Exposes and encodes all pictures. Rivals share the exposure of their reference.
    ///
    /// # Errors
    /// Pictures that are not finite; what the charts meet.
    pub fn new(task: &Task, lit: &Lit) -> anyhow::Result<Self> {
        let width = task.asset.width();
        let ids: Vec<&str> = std::iter::once("all-lamps").chain(lit.report.methods.iter().map(|m| m.id)).collect();
        let all = || std::iter::once(&lit.reference).chain(&lit.methods).zip(&ids);
        let set =
            |(n, set)| Figure::new(format!("set-{}.png", n + 1), &pictures::set_picture(set, &lit.traits, width), 1.0);
        let white = white(&lit.errors, &lit.traits);
        let error = |(plane, id): (&Vec<f32>, &&str)| {
            Figure::new(format!("error-{}.png", file_name(id)), &pictures::heat(plane, width, white), 1.0)
        };
        let gain = pictures::gain(&lit.reference.over_time);
        let over_time = all()
            .map(|(shown, id)| Figure::new(format!("over-time-{}.png", file_name(id)), &shown.over_time, gain))
            .collect::<anyhow::Result<_>>()?;
        let of_all = |(method, picture): &(relume_core::reconstruct::Method, Image)| {
            let name = format!("over-time-all-lamps-{}.png", file_name(method.id()));
            Ok((method.label(), Figure::new(name, picture, gain)?))
        };
        let stills = (0..lit.report.lights.len()).map(|light| {
            let gain = pictures::gain(&lit.reference.stills[light]);
            let light_name = if light == 0 { "sliver".to_owned() } else { format!("env-{light}") };
            all()
                .map(|(shown, id)| {
                    Figure::new(format!("{light_name}-{}.png", file_name(id)), &shown.stills[light], gain)
                })
                .collect()
        });
        Ok(Self {
            chart: charts::error_bars(&lit.report)?,
            sets: lit.sets.iter().enumerate().map(set).collect::<anyhow::Result<_>>()?,
            errors: lit.errors.iter().zip(&ids[1..]).map(error).collect::<anyhow::Result<_>>()?,
            white,
            over_time,
            over_time_of_all: lit.over_time_of_all.iter().map(of_all).collect::<anyhow::Result<_>>()?,
            stills: stills.collect::<anyhow::Result<_>>()?,
            column: task.column,
        })
    }

    /// Names and contents of the files beside the page.
    pub fn files(&self) -> impl Iterator<Item = (&str, &[u8])> {
        let figures = self.sets.iter().chain(&self.errors).chain(&self.over_time);
        let figures =
            figures.chain(self.over_time_of_all.iter().map(|entry| &entry.1)).chain(self.stills.iter().flatten());
        figures.map(Figure::file).chain([("errors.svg", self.chart.as_bytes())])
    }
}

/// The 98th percentile of all errors of pixels that are not black.
fn white(errors: &[Vec<f32>], traits: &[Traits]) -> f32 {
    let seen = |plane: &Vec<f32>| -> Vec<f32> {
        plane.iter().zip(traits).filter(|(_, t)| t.energy > 0.0).map(|(e, _)| *e).collect()
    };
    let mut all: Vec<f32> = errors.iter().flat_map(seen).collect();
    if all.is_empty() {
        return 1.0;
    }
    let at = (all.len() - 1) * 98 / 100;
    all.select_nth_unstable_by(at, f32::total_cmp).1.max(1e-3)
}

/// The page.
pub fn page(report: &Report, figures: &Figures) -> String {
    let title = format!("Reconstruction of {}", report.asset);
    let body = html! {
        p {
            "Each method rebuilds the reflectance function of every pixel from " (report.kept) " of "
            (report.lamps) " lamps (" (report::rule(&report.subset)) ") and is compared with all of them. Error of pixel i: "
            "e" sub { "i" } " = ‖U(T" sub { "i" } ") − T′" sub { "i" } "‖ / ‖T′" sub { "i" } "‖, over all lamps and "
            "channels (Peers 2006, 4.4.1). Negative values are cut in pictures only."
        }
        (errors(report, figures))
        (sets(report, figures))
        (over_time(report, figures))
        @for (light, name) in report.lights.iter().enumerate() { (relit(report, figures, light, name)) }
        @if !report.refused.is_empty() {
            h2 { "Not measured" }
            ul { @for refused in &report.refused { li { (refused.label) ": " (refused.reason) } } }
        }
        p.note { (report.tool) ". All numbers: errors.json; charts: errors.svg; pictures in full size lie beside this page." }
    };
    document(&title, &body)
}

fn errors(report: &Report, figures: &Figures) -> Markup {
    html! {
        h2 { "Errors of rebuilt reflectance functions" }
        p { "Percent, mean ± standard deviation over the pixels of a set; the lowest mean of each set is bold." }
        (table(report, |method| &method.errors))
        (chart(&figures.chart))
        p { "Error of every pixel, from black (0) over red and yellow to white (" (format!("{:.0}", 100.0 * figures.white)) " % and more):" }
        div.row {
            @for (method, figure) in report.methods.iter().zip(&figures.errors) {
                (figure.show("", html! { (method.label) }))
            }
        }
    }
}

fn sets(report: &Report, figures: &Figures) -> Markup {
    let is_found = |name: &str| report.sets.iter().any(|set| set.set.name == name && !set.set.from_mask);
    html! {
        h2 { "Sets of pixels" }
        @if ["diffuse", "glossy", "shadowed"].iter().any(|name| is_found(name)) {
            p.note {
                "Found sets come from a clamped cosine fitted to each reflectance function: glossy where much lies above it, "
                "shadowed where lamps that face the surface are dark, diffuse where neither is so and the fit is close. Other pixels are in "
                "no set but “all”."
            }
        }
        div.row {
            @for (set, figure) in report.sets.iter().zip(&figures.sets) {
                (figure.show("", html! {
                    (set.set.name) ": " (set.count) " pixels, " (if set.set.from_mask { "from a mask" } else { "found" })
                }))
            }
        }
    }
}

fn over_time(report: &Report, figures: &Figures) -> Markup {
    html! {
        h2 { "A sliver of light turning about the object" }
        p {
            "Column " (figures.column) " of the picture, over one turn of a sliver of light along a meridian, 5 degrees wide: time runs to the right, "
            "from behind over the left, the front and the right to behind again; each row is one pixel (figure 4.18)."
        }
        h3 { "From " (report.kept) " lamps, beside all " (report.lamps) }
        div.row {
            @for (n, figure) in figures.over_time.iter().enumerate() {
                (figure.show("wide", if n == 0 { reference(report) } else { html! { (report.methods[n - 1].label) } }))
            }
        }
        h3 { "From all " (report.lamps) " lamps" }
        div.row {
            @for (label, figure) in &figures.over_time_of_all { (figure.show("wide", html! { (label) })) }
        }
    }
}

fn relit(report: &Report, figures: &Figures, light: usize, name: &str) -> Markup {
    html! {
        h2 { "Relit by " (name) }
        p {
            "Relative error against " (reference(report)) ", percent"
            @if light == 0 { ", mean ± deviation over the headings; the stills show one of them (figure 4.17)" } "."
        }
        (table(report, |method| &method.relit[light]))
        div.row {
            @for (n, figure) in figures.stills[light].iter().enumerate() {
                (figure.show("", html! {
                    @if n == 0 { (reference(report)) } @else {
                        (report.methods[n - 1].label) ": "
                        (format!("{:.1} %", 100.0 * report.methods[n - 1].relit[light].first().map_or(0.0, |s| s.mean)))
                    }
                }))
            }
        }
    }
}

fn reference(report: &Report) -> Markup {
    html! { "all " (report.lamps) " lamps (" (report.reference) ")" }
}

/// A row a method, a column a set.
fn table<'a>(report: &'a Report, numbers: impl Fn(&'a Measured) -> &'a [Summary]) -> Markup {
    let lowest = |set: usize| report.methods.iter().map(|m| numbers(m)[set].mean).fold(f64::INFINITY, f64::min);
    let best: Vec<f64> = (0..report.sets.len()).map(lowest).collect();
    html! {
        table {
            tr {
                th { "Method" }
                @for set in &report.sets { th { (set.set.name) } }
            }
            @for method in &report.methods {
                tr {
                    td { (method.label) }
                    @for (number, best) in numbers(method).iter().zip(&best) {
                        td class=[(number.mean <= *best).then_some("best")] { (report::percent(number)) }
                    }
                }
            }
        }
    }
}
