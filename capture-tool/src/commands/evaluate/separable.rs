//! `relume evaluate separable`: what the minimum of horizontal and vertical sets loses, and whether the reliability map tells (7.5).

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use clap::Args;
use maud::html;
use relume_core::acquire::separable::Reliability;
use relume_core::evaluate::separable::{BAD, CameraNoise, Outcome, Study};
use relume_core::image::Image;
use relume_core::math::Vec3;
use relume_core::simulate::{Camera, Gantry, Quality, Rows, Scene};
use serde::Serialize;

use super::lines::{Chart, Line};
use super::page::{Figure, chart, document, put};
use super::pictures;
use crate::commands::values;
use crate::new_folder::{self, NewFolder};
use crate::progress::{Progress, Unit};
use crate::rigs::{RigFile, virtual_emitter};

const EXAMPLES: &str = "\
Examples:
  relume evaluate separable -o separable-report
  relume evaluate separable --squares 16 --influences 2,3,4,6,8 --noise 0.01 --floor 0.001 -o noisy
  relume evaluate separable presets/rigs/virtual-gantry.toml -o gantry-report

Three virtual scenes under a projector (a still life, a diffuse ball alone, a diffuse bowl with a ball beside it), or that of a rig
file, are photographed from some positions by horizontal and vertical sets of squares, as `relume capture --sampler separable` does,
and square by square (Peers 2006, 7.5). Open DIR/index.html; the numbers are in DIR/separable.json.

error      of a recovered photograph against the true one, mean over squares, %; brute force with the same noise beside it
bad        share of pixels whose answers are off by more than 10 %
AUC        how well the reliability map ranks bad pixels: 1 is perfect, 0.5 chance
affected   share of pixels that the map calls more than 10 % too bright under all squares";

/// Where the projector stands if no rig file says: before the object, to the left, and beside it.
const STANDS: [[f64; 3]; 3] = [[0.2, 0.5, 0.84], [-0.6, 0.6, 0.53], [0.9, 0.4, 0.2]];
/// Positions of a rig file that are looked at.
const PICKED: usize = 3;
/// The map is white where the picture would be twice as bright.
const FULL: f64 = 1.0;
/// Pixels that are wholly wrong are white in the picture of errors.
const WRONG: f64 = 0.5;
const SEED: u64 = 17;

/// Raw flags.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    /// A rig file with a projector: its positions, squares and virtual scene.
    rig: Option<PathBuf>,
    /// The folder to write to; it must be new or empty.
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// Squares along each side of the projector's picture [default: 16, or the rig file's].
    #[arg(long, value_name = "N", value_parser = values::at_least_one)]
    squares: Option<usize>,
    /// Width x height of the photographs.
    #[arg(long, value_name = "WxH", default_value = "96x72", value_parser = values::grid)]
    size: (usize, usize),
    /// Which influences d: every so many squares of a line are lit together.
    #[arg(long, value_name = "N,N", value_delimiter = ',', default_value = "1,2,3,4,5,6,8", value_parser = values::at_least_one)]
    influences: Vec<usize>,
    /// Trace light over other surfaces by so many blocks of squares across the picture: fewer make it smoother over the squares than it is,
    /// and the scheme look worse [default: each square by itself].
    #[arg(long, value_name = "N", value_parser = values::at_least_one)]
    blocks: Option<usize>,
    /// Noise of a photograph, as a share of its light.
    #[arg(long, value_name = "X", default_value_t = 0.005, allow_negative_numbers = true, value_parser = values::share)]
    noise: f64,
    /// Noise in the dark, as a share of the mean of the photograph of all squares.
    #[arg(long, value_name = "X", default_value_t = 0.0002, allow_negative_numbers = true, value_parser = values::share)]
    floor: f64,
}

/// What is photographed.
struct Subject {
    name: &'static str,
    gantry: Gantry,
}

/// Figures of a scene and an influence, means over the positions.
#[derive(Debug, Serialize)]
struct Row {
    scene: &'static str,
    camera: &'static str,
    influence: usize,
    /// Of one position, black included.
    photographs: usize,
    error: f64,
    worst: f64,
    brute_force: f64,
    bad: f64,
    auc: Option<f64>,
    affected: f64,
    judged: f64,
    agreement: f64,
}

/// Pictures of a scene: file name, picture, gain, caption.
type Pictures = Vec<(String, Image, f32, String)>;

impl Arguments {
    /// Measures and writes.
    pub fn run(mut self) -> anyhow::Result<String> {
        new_folder::check(&self.output)?;
        self.influences.sort_unstable();
        self.influences.dedup();
        let subjects = self.subjects()?;
        let folder = NewFolder::begin(&self.output)?;
        let mut progress = Progress::new("tracing and recovering", Unit::Steps);
        let total = (subjects.len() * (1 + self.influences.len())) as u64;
        let (mut done, mut rows, mut shown) = (0, Vec::new(), Vec::new());
        for subject in &subjects {
            let traced = traced(subject)?;
            let studies = studies(&traced)?;
            done += 1;
            progress.step(done, total)?;
            for influence in &self.influences {
                rows.extend(self.measured(subject, &studies, *influence)?);
                done += 1;
                progress.step(done, total)?;
            }
            shown.push((subject.name, self.pictures(subject.name, &studies[0])?));
        }
        drop(progress);
        let table = table(&rows);
        write(&rows, &shown, &table, folder.path())?;
        folder.commit()?;
        Ok(format!("{table}\nOpen {}\n", self.output.join("index.html").display()))
    }

    /// The rig's scene, or all there are.
    fn subjects(&self) -> anyhow::Result<Vec<Subject>> {
        let camera = Camera::gantry(self.size.0, self.size.1);
        let mut subjects = match &self.rig {
            Some(path) => {
                let rig = RigFile::read(path)?;
                let Some(table) = &rig.gantry else {
                    anyhow::bail!("{}: a rig without a projector; only squares can be lit in sets", path.display());
                };
                let all = virtual_emitter::virtual_gantry(table, rig.simulation.scene, camera);
                let count = all.positions.len();
                let picked = PICKED.min(count);
                let positions = (0..picked).map(|n| all.positions[(2 * n + 1) * count / (2 * picked)]).collect();
                let squares = self.squares.unwrap_or(table.squares);
                vec![Subject { name: rig.simulation.scene.id(), gantry: Gantry { positions, squares, ..all } }]
            }
            None => {
                let positions = Gantry::above_table(&STANDS.map(|d| Vec3::from(d).normalize()), 4.0);
                let of = |name, scene| {
                    let usual = Gantry::demo(camera, (1, 1), self.squares.unwrap_or(16));
                    Subject { name, gantry: Gantry { scene, positions: positions.clone(), ..usual } }
                };
                vec![of("mixed", Scene::gantry()), of("convex", Scene::convex()), of("bowl", Scene::bowl())]
            }
        };
        for subject in &mut subjects {
            subject.gantry.blocks = self.blocks.unwrap_or(subject.gantry.squares);
            subject.gantry.check("the rig")?;
            let side = subject.gantry.squares;
            if let Some(wrong) = self.influences.iter().find(|d| **d > side) {
                anyhow::bail!("--influences {wrong}: there are {side} squares along a side");
            }
        }
        Ok(subjects)
    }

    fn measured(&self, subject: &Subject, studies: &[Study<'_>], influence: usize) -> anyhow::Result<[Row; 3]> {
        let noise = CameraNoise { share: self.noise as f32, floor: self.floor as f32, seed: SEED };
        let row = |camera: &'static str, noise: CameraNoise, plain: bool| -> anyhow::Result<Row> {
            let outcomes = studies.iter().map(|study| study.run(influence, noise, plain));
            let outcomes: Vec<Outcome> = outcomes.collect::<relume_core::Result<_>>()?;
            let mean = |of: &dyn Fn(&Outcome) -> f64| outcomes.iter().map(of).sum::<f64>() / outcomes.len() as f64;
            let ranked: Vec<f64> = outcomes.iter().filter_map(|outcome| outcome.auc).collect();
            Ok(Row {
                scene: subject.name,
                camera,
                influence,
                photographs: outcomes[0].photographs,
                error: mean(&|o| o.error),
                worst: outcomes.iter().map(|o| o.worst).fold(0.0, f64::max),
                brute_force: mean(&|o| o.brute_force),
                bad: mean(&|o| o.bad),
                auc: (!ranked.is_empty()).then(|| ranked.iter().sum::<f64>() / ranked.len() as f64),
                affected: mean(&|o| o.reliability.affected(Reliability::THRESHOLD)),
                judged: mean(&|o| o.reliability.judged()),
                agreement: mean(&|o| o.agreement),
            })
        };
        Ok([
            row("without noise", CameraNoise::NONE, false)?,
            row("noise", noise, false)?,
            row("noise, plain minimum", noise, true)?,
        ])
    }

    /// Of the first position, at the influence nearest to the thesis's.
    fn pictures(&self, scene: &str, study: &Study<'_>) -> anyhow::Result<Pictures> {
        let influence = *self.influences.iter().min_by_key(|d| d.abs_diff(3)).unwrap_or(&3);
        let (column, row) = study.brightest();
        let outcome = study.run(influence, CameraNoise::NONE, false)?;
        let found = study.recovered(influence, CameraNoise::NONE, false)?;
        let (white, truth) = (study.white()?, study.truth(column, row));
        let width = white.width();
        let errors = Image::from_fn(width, white.height(), |x, y| match outcome.errors[y * width + x] {
            Some(error) => [(error / WRONG).min(1.0) as f32; 3],
            None => [0.0, 0.0, 0.3],
        });
        let (bright, gain) = (pictures::gain(&white), pictures::gain(truth));
        let name = |what: &str| format!("{scene}-{what}.png");
        Ok(vec![
            (name("white"), white, bright, "all squares".to_owned()),
            (name("square"), truth.clone(), gain, format!("square ({column}, {row})")),
            (name("recovered"), found.square(column, row), gain, format!("recovered, d = {influence}")),
            (name("errors"), errors, 1.0, format!("errors of pixels; white: {:.0} % or more", 100.0 * WRONG)),
            (
                name("reliability"),
                outcome.reliability.picture(FULL),
                1.0,
                "reliability map; white: twice too bright or more, blue: not judged".to_owned(),
            ),
        ])
    }
}

/// Light over other surfaces is traced with care: its noise would pass for differences between squares.
fn traced(subject: &Subject) -> anyhow::Result<Rows> {
    let quality = Quality { bounces: 32, stride: 1, ..Quality::rig() };
    Ok(subject.gantry.trace(&quality, &mut |_, _| crate::progress::check())?)
}

fn studies(rows: &Rows) -> relume_core::Result<Vec<Study<'_>>> {
    (0..rows.grids().layers).map(|position| Study::new(rows, position)).collect()
}

fn table(rows: &[Row]) -> String {
    let mut text =
        format!("one photograph a square from sets of them; bad: pixels off by more than {:.0} %\n", 100.0 * BAD);
    let mut head = ("", "");
    for row in
        rows.iter().filter(|r| r.camera == rows[0].camera).map(|r| r.scene).collect::<Vec<_>>().chunk_by(|a, b| a == b)
    {
        for camera in ["without noise", "noise", "noise, plain minimum"] {
            for row in rows.iter().filter(|r| r.scene == row[0] && r.camera == camera) {
                if head != (row.scene, row.camera) {
                    head = (row.scene, row.camera);
                    let _ = writeln!(text, "\n{} scene, {}", row.scene, row.camera);
                    text += "    d  photographs   error   worst  brute force     bad    AUC  affected  judged  sums differ\n";
                }
                let percent = |share: f64| format!("{:.2}", 100.0 * share);
                let auc = row.auc.map_or_else(|| "-".to_owned(), |auc| format!("{auc:.3}"));
                let _ = writeln!(
                    text,
                    "{:5}{:13}{:>8}{:>8}{:>13}{:>8}{:>7}{:>10}{:>8}{:>13}",
                    row.influence,
                    row.photographs,
                    percent(row.error),
                    percent(row.worst),
                    percent(row.brute_force),
                    percent(row.bad),
                    auc,
                    percent(row.affected),
                    percent(row.judged),
                    percent(row.agreement)
                );
            }
        }
    }
    text
}

fn charts(rows: &[Row]) -> anyhow::Result<Vec<(&'static str, String)>> {
    let chart = |title: &str, camera: &str| {
        let mut lines: Vec<Line> = Vec::new();
        for row in rows.iter().filter(|row| row.camera == camera) {
            let point = (row.influence as f64, 100.0 * row.error);
            match lines.iter_mut().find(|line| line.label == row.scene) {
                Some(line) => line.points.push(point),
                None => lines.push(Line { label: row.scene.to_owned(), points: vec![point] }),
            }
        }
        let (x, y) = ("influence d".to_owned(), "error of a photograph, %".to_owned());
        Chart { title: title.to_owned(), x, y, lines }.svg()
    };
    Ok(vec![
        ("without-noise", chart("Recovered squares, without noise", "without noise")?),
        ("noise", chart("Recovered squares, with noise", "noise")?),
    ])
}

fn write(rows: &[Row], shown: &[(&str, Pictures)], table: &str, folder: &Path) -> anyhow::Result<()> {
    let json = serde_json::to_string_pretty(rows)? + "\n";
    put(folder, [("separable.json", json.as_bytes()), ("separable.txt", table.as_bytes())])?;
    let charts = charts(rows)?;
    for (name, svg) in &charts {
        put(folder, [(format!("{name}.svg").as_str(), svg.as_bytes())])?;
    }
    let mut figures = Vec::new();
    for (scene, pictures) in shown {
        let figure = |(name, picture, gain, caption): &(String, Image, f32, String)| {
            Figure::new(name.clone(), picture, *gain).map(|figure| (figure, caption.clone()))
        };
        figures.push((*scene, pictures.iter().map(figure).collect::<anyhow::Result<Vec<_>>>()?));
    }
    for (figure, _) in figures.iter().flat_map(|(_, list)| list) {
        put(folder, [figure.file()])?;
    }
    let body = html! {
        p.note { "One photograph a square from 2 d n of many squares (Peers 2006, 7.5): the smaller of the horizontal and the vertical one." }
        pre { (table) }
        div.row { @for (_, svg) in &charts { (chart(svg)) } }
        @for (scene, list) in &figures {
            h2 { (scene) " scene" }
            div.row { @for (figure, caption) in list { (figure.show("", html! { (caption) })) } }
        }
    };
    put(folder, [("index.html", document("Squares from sets of them", &body).as_bytes())])?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::commands::testing;

    #[test]
    fn what_cannot_be_measured_is_refused() {
        let arguments =
            |line: &str| -> Arguments { testing::parse(&format!("separable {line} -o no-such-folder")).unwrap() };
        let refused = |line: &str| arguments(line).subjects().err().unwrap().to_string();
        assert!(refused("--squares 4 --influences 2,5").contains("--influences 5"));
        assert!(refused("no-such-rig.toml").contains("no-such-rig.toml"));
        let subjects = arguments("--squares 8 --size 12x9").subjects().unwrap();
        assert!(subjects.len() == 3 && subjects.iter().all(|s| s.gantry.squares == 8 && s.gantry.positions.len() == 3));
    }
}
