//! `relume evaluate explicit`: errors of relit pictures over the number of basis functions that were shown (6.6.5).

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use clap::Args;
use maud::html;
use relume_core::acquire::explicit::Weight;
use relume_core::evaluate::explicit::{Light, Study, natural_lights, relative_error, smooth_lights};
use relume_core::image::Image;
use relume_core::simulate::{Camera, Class, Monitor, Quality, Rows, classes};
use relume_core::wavelet::Wavelet;
use serde::Serialize;

use super::lines::{Chart, Line};
use super::page::{Figure, chart, document, file_name, put};
use super::pictures;
use crate::commands::values;
use crate::new_folder::{self, NewFolder};
use crate::progress::{Progress, Unit};

const EXAMPLES: &str = "\
Examples:
  relume evaluate explicit -o explicit-report
  relume evaluate explicit --texels 128x128 --counts 100,300,600,900 --wavelets haar,9/7 -o explicit-report

Two virtual scenes, one of diffuse bodies alone and one with glass, mirror and glossy bodies beside them, are sampled as
`relume capture --sampler explicit` does, and relit with lights that change slowly and lights with the statistics of photographs
(Peers 2006, 6.6.5). Open DIR/index.html; the numbers are in DIR/errors.json.";

/// The bases that a screen can show.
const WAVELETS: [Wavelet; 3] = [Wavelet::Haar, Wavelet::LeGall53, Wavelet::Daubechies97];
/// Lights with the statistics of photographs.
const NATURAL: usize = 4;
const SEED: u64 = 11;

/// Raw flags.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    /// The folder to write to; it must be new or empty.
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// Texels of the screen.
    #[arg(long, value_name = "WxH", default_value = "64x64", value_parser = values::grid)]
    texels: (usize, usize),
    /// Pixels of the camera.
    #[arg(long, value_name = "WxH", default_value = "80x60", value_parser = values::grid)]
    size: (usize, usize),
    /// After how many functions to relight.
    #[arg(long, value_name = "N,N", value_delimiter = ',', default_value = "25,50,100,200,300,400,600,900", value_parser = values::at_least_one)]
    counts: Vec<usize>,
    /// Which bases: haar, 5/3, 9/7.
    #[arg(long, value_name = "WAVELETS", value_delimiter = ',', value_parser = values::wavelet)]
    wavelets: Vec<Wavelet>,
    /// Noise of a photograph, as a share of its light.
    #[arg(long, value_name = "X", default_value_t = 0.002, allow_negative_numbers = true, value_parser = values::share)]
    noise: f64,
}

/// Mean errors of relit pictures.
#[derive(Debug, Serialize)]
struct Row {
    scene: &'static str,
    /// Which pixels.
    pixels: &'static str,
    light: &'static str,
    wavelet: &'static str,
    /// By number of functions.
    functions: Vec<usize>,
    photographs: Vec<usize>,
    /// `||C - C'|| / ||C'||`, mean over the lights.
    error: Vec<f64>,
    /// What is left of the bound (6.7), as a share.
    bound: Vec<f64>,
}

/// A scene, traced.
struct Traced {
    name: &'static str,
    rows: Rows,
    covered: Vec<bool>,
    sets: Vec<(&'static str, Vec<usize>)>,
}

/// Pictures of a scene under one light: the truth, then by wavelet and count.
struct Shown {
    scene: &'static str,
    light: &'static str,
    gain: f32,
    pictures: Vec<(String, Image)>,
}

impl Arguments {
    /// Measures and writes.
    pub fn run(mut self) -> anyhow::Result<String> {
        new_folder::check(&self.output)?;
        self.counts.sort_unstable();
        self.counts.dedup();
        if self.wavelets.is_empty() {
            self.wavelets = WAVELETS.to_vec();
        }
        let folder = NewFolder::begin(&self.output)?;
        let (rows, shown) = self.measured()?;
        let table = table(&rows);
        write(&rows, &shown, &table, folder.path())?;
        folder.commit()?;
        Ok(format!("{table}\nOpen {}\n", self.output.join("index.html").display()))
    }

    fn measured(&self) -> anyhow::Result<(Vec<Row>, Vec<Shown>)> {
        let lights = [("smooth", smooth_lights(self.texels)), ("natural", natural_lights(self.texels, NATURAL, SEED))];
        let mut progress = Progress::new("tracing and sampling", Unit::Steps);
        let total = 2 * (1 + self.wavelets.len() * lights.len() * self.counts.len()) as u64;
        let (mut rows, mut shown, mut done) = (Vec::new(), Vec::new(), 0);
        for scene in self.scenes() {
            let scene = traced(scene)?;
            done += 1;
            progress.step(done, total)?;
            for (name, lights) in &lights {
                let (more, pictures) = self.relit(&scene, name, lights, &mut || {
                    done += 1;
                    progress.step(done, total)
                })?;
                rows.extend(more);
                shown.push(pictures);
            }
        }
        Ok((rows, shown))
    }

    fn scenes(&self) -> [(&'static str, Monitor); 2] {
        let camera = Camera::monitor(self.size.0, self.size.1);
        [("diffuse", Monitor::cubes(camera, self.texels)), ("mixed", Monitor::demo(camera, self.texels))]
    }

    fn relit(
        &self,
        scene: &Traced,
        light: &'static str,
        lights: &[Light],
        step: &mut dyn FnMut() -> relume_core::Result<()>,
    ) -> anyhow::Result<(Vec<Row>, Shown)> {
        let study = |wavelet| Study {
            rows: &scene.rows,
            covered: &scene.covered,
            lights,
            wavelet,
            weight: Weight::default(),
            noise: self.noise as f32,
            seed: SEED,
        };
        let truths = study(Wavelet::Haar).truths()?;
        let masked = |picture: &Image| masked(picture, &scene.covered);
        let reference = masked(&truths[0]);
        let gain = pictures::gain(&reference);
        let mut shown = Shown { scene: scene.name, light, gain, pictures: vec![("truth".to_owned(), reference)] };
        let mut rows: Vec<Row> = Vec::new();
        for wavelet in &self.wavelets {
            let empty = |(pixels, _): &(&'static str, Vec<usize>)| Row {
                scene: scene.name,
                pixels,
                light,
                wavelet: wavelet.id(),
                functions: Vec::new(),
                photographs: Vec::new(),
                error: Vec::new(),
                bound: Vec::new(),
            };
            let mut own: Vec<Row> = scene.sets.iter().map(empty).collect();
            study(*wavelet).run(&self.counts, &mut |point| {
                for (row, (_, pixels)) in own.iter_mut().zip(&scene.sets) {
                    let errors = point.relit.iter().zip(&truths).map(|(relit, t)| relative_error(relit, t, pixels));
                    row.error.push(errors.sum::<f64>() / truths.len() as f64);
                    row.functions.push(point.functions);
                    row.photographs.push(point.photographs);
                    row.bound.push(point.bound);
                }
                shown
                    .pictures
                    .push((format!("{}, {} functions", wavelet.id(), point.functions), masked(&point.relit[0])));
                step()
            })?;
            rows.append(&mut own);
        }
        Ok((rows, shown))
    }
}

fn traced((name, monitor): (&'static str, Monitor)) -> anyhow::Result<Traced> {
    let rows = monitor.trace(&Quality::rig(), &mut |_, _| crate::progress::check())?;
    let covered: Vec<bool> = monitor.directly_seen().iter().map(|share| *share == 0.0).collect();
    let seen = classes(&monitor.scene, &monitor.camera);
    let of = |wanted: &[Class]| seen.pixels(wanted).into_iter().filter(|n| covered[*n]).collect::<Vec<_>>();
    let mut sets = vec![("all", (0..covered.len()).filter(|n| covered[*n]).collect())];
    if name == "mixed" {
        sets.extend([("diffuse", of(&[Class::Diffuse])), ("glossy", of(&[Class::Glossy]))]);
        sets.push(("specular", of(&[Class::Glass, Class::Mirror])));
    }
    Ok(Traced { name, rows, covered, sets })
}

/// What sees the screen itself is left black: (1 - alpha) times the screen is put there when relit (6.6.4).
fn masked(picture: &Image, covered: &[bool]) -> Image {
    let mut masked = picture.clone();
    for (pixel, _) in masked.data_mut().chunks_exact_mut(3).zip(covered).filter(|(_, covered)| !**covered) {
        pixel.fill(0.0);
    }
    masked
}

fn table(rows: &[Row]) -> String {
    let mut text = String::from("error of relit pictures, %, by basis functions shown (in brackets: photographs)\n");
    let mut head = (&[][..], "", "");
    for row in rows {
        if head != (&row.functions[..], row.scene, row.light) {
            head = (&row.functions, row.scene, row.light);
            let _ = write!(text, "\n{:30}", format!("{} scene, {} light", row.scene, row.light));
            row.functions.iter().for_each(|count| text += &format!("{count:>8}"));
            let _ = write!(text, "\n{:30}", "");
            row.photographs.iter().for_each(|count| text += &format!("{:>8}", format!("({count})")));
            text.push('\n');
        }
        let _ = write!(text, "  {:10}{:18}", row.wavelet, row.pixels);
        row.error.iter().for_each(|error| text += &format!("{:8.2}", 100.0 * error));
        text.push('\n');
    }
    text
}

fn charts(rows: &[Row]) -> anyhow::Result<Vec<(String, String)>> {
    let mut charts: Vec<(String, Chart)> = Vec::new();
    for row in rows {
        let name = format!("{}-{}-{}", row.scene, row.light, row.pixels);
        let points = row.functions.iter().zip(&row.error).map(|(n, error)| (*n as f64, 100.0 * error)).collect();
        let line = Line { label: row.wavelet.to_owned(), points };
        match charts.iter_mut().find(|(known, _)| *known == name) {
            Some((_, chart)) => chart.lines.push(line),
            None => {
                let title = format!("{} scene, {} pixels, {} light", row.scene, row.pixels, row.light);
                let (x, y) = ("basis functions shown".to_owned(), "relative error of relit pictures, %".to_owned());
                charts.push((name, Chart { title, x, y, lines: vec![line] }));
            }
        }
    }
    charts.into_iter().map(|(name, chart)| Ok((name, chart.svg()?))).collect()
}

fn write(rows: &[Row], shown: &[Shown], table: &str, folder: &Path) -> anyhow::Result<()> {
    let json = serde_json::to_string_pretty(rows)? + "\n";
    put(folder, [("errors.json", json.as_bytes()), ("errors.txt", table.as_bytes())])?;
    let charts = charts(rows)?;
    for (name, svg) in &charts {
        put(folder, [(format!("{name}.svg").as_str(), svg.as_bytes())])?;
    }
    let mut figures = Vec::new();
    for shown in shown {
        let figure = |(what, picture): &(String, Image)| {
            let name =
                file_name(&format!("{}-{}-{what}.png", shown.scene, shown.light)).replace(", ", "-").replace(' ', "-");
            Figure::new(name, picture, shown.gain).map(|figure| (figure, what.clone()))
        };
        let of_scene = shown.pictures.iter().map(figure).collect::<anyhow::Result<Vec<_>>>()?;
        figures.push((format!("{} scene, {} light", shown.scene, shown.light), of_scene));
    }
    for (figure, _) in figures.iter().flat_map(|(_, list)| list) {
        put(folder, [figure.file()])?;
    }
    let body = html! {
        p.note { "Explicit sampling (Peers 2006, 6.6): functions are shown one after another, chosen by what was seen of others." }
        pre { (table) }
        div.row { @for (_, svg) in &charts { (chart(svg)) } }
        @for (title, list) in &figures {
            h2 { (title) }
            div.row { @for (figure, what) in list { (figure.show("", html! { (what) })) } }
        }
    };
    put(folder, [("index.html", document("Explicit sampling", &body).as_bytes())])?;
    Ok(())
}
